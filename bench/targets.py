"""What the physical models have to reach, as one table behind the tables of ``python bench/accuracy.py``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from rich.console import Console
from rich.table import Table


class Target(NamedTuple):
    """A number that was measured, and its limit.

    Attributes:
        what: was measured, with its unit.
        found: the number.
        limit: what it has to be at most, or at least.
        least: whether the limit is a lower one.
    """

    what: str
    found: float
    limit: float
    least: bool = False

    @property
    def met(self) -> bool:
        """Whether the number is within its limit."""
        return self.found >= self.limit if self.least else self.found <= self.limit


def show(targets: Iterable[Target], console: Console) -> None:
    """Print a row for every target."""
    board = Table(title="Targets", title_justify="left")
    for k, head in enumerate(("", "found", "target", "met")):
        board.add_column(head, justify="right" if k else "left")
    for each in targets:
        sign = "≥" if each.least else "≤"
        board.add_row(each.what, f"{each.found:.4g}", f"{sign} {each.limit:g}", "yes" if each.met else "no")
    if board.row_count:
        console.print(board)
