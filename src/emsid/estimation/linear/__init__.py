"""Least squares in one pass, in batch and recursively, and the measured frequency response."""
