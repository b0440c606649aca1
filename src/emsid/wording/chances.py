"""Words for the chance that a test gives."""

from __future__ import annotations

SMALLEST = 1e-16
"""A smaller chance says no more than this one, and a test is not that exact."""


def chance(p: float) -> str:
    """A chance, for the sign after its name.

    >>> chance(0.0312), chance(4e-126)
    ('= 0.031', '< 1e-16')
    """
    return f"= {p:.2g}" if p >= SMALLEST else f"< {SMALLEST:g}"
