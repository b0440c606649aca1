"""Confidence intervals of estimates whose errors are normally distributed."""

from statistics import NormalDist

HALF_WIDTH = NormalDist().inv_cdf(0.975)
"""Half the width of a 95 % interval, in standard errors."""
