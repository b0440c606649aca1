"""Damped Gauss–Newton and its loss functions."""
