"""Least squares, in batch and recursively."""
