"""Refinements of a plant by effects of real drives, each with its starts."""
