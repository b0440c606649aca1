"""Tables and a progress bar on a terminal, and what it shows in place of signs that it has not."""

from __future__ import annotations

import codecs
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import isfinite
from typing import TYPE_CHECKING

from emsid.cli.interruption import INTERRUPTION
from emsid.units import plain_unit, readable_unit

if TYPE_CHECKING:
    from rich.table import Table

    from emsid.models.plants.search.result import GreyBoxFit
    from emsid.validation.comparison import Row


SPELT_OUT = "emsid-spelt-out"
"""What to do about signs that an encoding has not, by its name among the `codecs`: see `_spell_out`."""
_SPELT = {"Ω": "ohm", "·": "*", "µ": "u", "–": "-", "−": "-", "±": "+/-", "…": "...", "√": "sqrt", "∞": "inf"}
_RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def _spell_out(problem: UnicodeError) -> tuple[str, int]:
    """The same as one types it, ``kg·m²`` as ``kg*m^2``; a question mark for what has no such spelling."""
    assert isinstance(problem, UnicodeEncodeError)
    text = problem.object[problem.start : problem.end]
    text = re.sub("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda power: f"^{power[0].translate(_RAISED)}", text)
    return "".join(_SPELT.get(sign, sign if sign.isascii() else "?") for sign in text), problem.end


codecs.register_error(SPELT_OUT, _spell_out)


def _shown(text: str) -> str:
    """A text as it will stand on this terminal, for columns to be as wide."""
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    return text.encode(encoding, SPELT_OUT).decode(encoding)


def error_table(rows: Sequence[Row], title: str, unit: str = "") -> Table:
    """A line for every row, or where it is of several outputs, for every output."""
    from rich.markup import escape
    from rich.table import Table

    from emsid.validation.comparison import OutputErrors

    several = any(row.outputs for row in rows)
    words = ("model", "method", "data", *("output",) * several)
    rmse = "free-run RMSE" if several or not unit else f"free-run RMSE [{_shown(readable_unit(unit))}]"
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for heading in words:
        table.add_column(heading, no_wrap=True)
    for heading in (rmse, "free-run MSE", "fit %", "one-step MSE"):
        table.add_column(escape(heading), justify="right", no_wrap=True)
    for row in rows:
        note = "" if row.diverged_at is None else f" (diverged at sample {row.diverged_at})"
        for errors in row.outputs or (row,):
            names = []
            if isinstance(errors, OutputErrors):
                names = [_shown(f"{errors.output} [{plain_unit(errors.unit)}]".removesuffix(" []"))]
            table.add_row(
                row.model + note,
                row.method,
                row.data,
                *map(escape, names),
                f"{errors.simulation_rmse:.5g}",
                f"{errors.simulation_mse:.4g}",
                f"{errors.fit_percent:.2f}" if isfinite(errors.fit_percent) else "–",
                f"{errors.one_step_mse:.4g}",
            )
    return table


def physical_table(fit: GreyBoxFit) -> Table:
    """What a record says of a plant: its parameters, and where some had to be held, what it tells all the same."""
    from rich.table import Table

    table = Table(title=f"{fit.model.name}, with 95 % intervals", title_justify="left", box=None, pad_edge=False)
    for column, heading in enumerate(("quantity", "", "value", "±", "unit", "")):
        table.add_column(_shown(heading), justify="right" if column in (2, 3) else "left", no_wrap=True)
    rows = [(row.name, row.symbol, row.value, row.standard_error, row.unit, row.status) for row in fit.table]
    if any(row.status in ("held", "conditional") for row in fit.table):
        told = [(each.quantity, each.standard_error) for each in fit.combinations]
        rows += [(each.name, each.formula, each.value, error, each.unit, "told") for each, error in told]
    for name, symbol, value, error, unit, status in rows:
        width = "" if not error or not isfinite(error) else f"{1.96 * error:.2g}"  # none where a bound holds it
        table.add_row(*map(_shown, (name, symbol, f"{value:.5g}", width, plain_unit(unit), status)))
    return table


def show(table: Table) -> None:
    from rich.console import Console

    console = Console()
    if not console.is_terminal:
        console = Console(width=160)
    console.print(table)


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """A bar on standard error that names what is being done."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    task = bar.add_task("starting", total=1.0)

    def advance(what: str, fraction: float) -> None:
        INTERRUPTION.raise_again()
        bar.update(task, description=what, completed=fraction)

    bar.start()
    try:
        yield advance
    finally:
        with INTERRUPTION.put_off():  # the work is done or has been left, and nothing of it may be lost
            bar.stop()
