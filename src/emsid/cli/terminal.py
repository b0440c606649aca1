"""Printing of lines, tables and a progress bar. Nothing else prints.

Printed text may come from a file (names of columns, models and units). Such text is data: control characters and
characters that change the direction of writing are shown as escapes, and nothing in it is markup. Characters that the
encoding of the terminal lacks are spelled out.
"""

from __future__ import annotations

import codecs
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import StringIO
from math import isfinite
from typing import TYPE_CHECKING, Literal

from emsid.cli.interruption import INTERRUPTION
from emsid.units import plain_unit
from emsid.wording.lists import NOT_SHOWN

if TYPE_CHECKING:
    from rich.table import Table

    from emsid.estimation.nonlinear.control import Control
    from emsid.models.characteristics import Characteristic
    from emsid.models.plants.search.result import Estimate, GreyBoxFit
    from emsid.report import document


WIDE = 160
"""Letters in a line where the output is not a terminal."""
SPELT_OUT = "emsid-spelt-out"
"""Name of the error handler in `codecs` for characters that an encoding lacks: see `_spell_out`."""
_SPELT = {"Ω": "ohm", "·": "*", "µ": "u", "–": "-", "−": "-", "±": "+/-", "…": "...", "√": "sqrt", "∞": "inf"}
_RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def _spell_out(problem: UnicodeError) -> tuple[str, int]:
    """Spell a character in ASCII, ``kg·m²`` as ``kg*m^2``; a question mark where there is no spelling."""
    assert isinstance(problem, UnicodeEncodeError)
    text = problem.object[problem.start : problem.end]
    text = re.sub("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda power: f"^{power[0].translate(_RAISED)}", text)
    return "".join(_SPELT.get(sign, sign if sign.isascii() else "?") for sign in text), problem.end


codecs.register_error(SPELT_OUT, _spell_out)


# Control characters except the tab, line separators, characters that change the direction of writing or are invisible,
# and surrogates.
_UNPRINTABLE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff]"
)


def harmless(text: str) -> str:
    r"""A text with control characters shown as escapes, such as ``\x1b``; line breaks stay."""
    return _UNPRINTABLE.sub(lambda found: found[0].encode("unicode_escape", "surrogatepass").decode(), text)


def one_line(text: str) -> str:
    """A text as one line without control characters."""
    return harmless(" ".join(text.splitlines()))


def printable(text: str) -> str:
    """A text as this terminal shows it, to compute the width of columns."""
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    return one_line(text).encode(encoding, SPELT_OUT).decode(encoding)


def say(*lines: str) -> None:
    """Print lines on standard output."""
    for line in lines:
        print(harmless(line), flush=True)


@contextmanager
def reader_may_leave() -> Iterator[None]:
    """Within this context, nothing more is printed once the reader of the output is gone, as ``head`` soon is.

    What follows, such as the report, is still written.
    """
    try:
        yield
    except BrokenPipeError:
        sys.stdout = StringIO()  # neither this output nor that at exit fails again


def warn(words: str) -> None:
    """Print a warning on standard error."""
    print(f"emsid: {one_line(words)}", file=sys.stderr, flush=True)


def say_json(content: bytes) -> None:
    """Print a JSON document on standard output; control characters in its texts are escaped."""
    text = content.decode()
    print(_UNPRINTABLE.sub(lambda found: f"\\u{ord(found[0]):04x}", text), end="", flush=True)


Align = Literal["left", "right"]


def plain_table(
    title: str, headings: Mapping[str, Align], rows: Iterable[Sequence[str]], folded: Collection[str] = ()
) -> Table:
    """A table of texts without markup; headings wrap, and so do cells of the columns ``folded``."""
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(printable(title)), title_justify="left", box=None, pad_edge=False)
    lines = [[Text(printable(cell)) for cell in row] for row in rows]
    for k, (heading, align) in enumerate(headings.items()):
        widest = 0 if heading in folded else max((line[k].cell_len for line in lines), default=0)
        head = Text(printable(heading))
        table.add_column(head, justify=align, min_width=widest, no_wrap=head.cell_len <= widest)
    for line in lines:
        table.add_row(*line)
    return table


FREE_RUN_EXPLAINED = (
    "free run: simulation from the input alone. fit %: 100 is exact, 0 is no better than the mean of the output."
)
"""The note below a table of free runs."""
_ONE_STEP = "one-step: prediction from measured outputs up to the sample before."
_FITTED = "fitted: to the prediction one step ahead, the same sample by sample (recursive), or to the free run."
_DATA = "data: used in fit, or unseen (no model was fitted to it)."
EXPLAINED = f"{FREE_RUN_EXPLAINED} {_ONE_STEP} {_FITTED} {_DATA}"
"""The note below a table of errors."""
WITHOUT_METHOD_EXPLAINED = f"{FREE_RUN_EXPLAINED} {_ONE_STEP} {_DATA}"
"""The note below a table of the errors of models from files."""


def text_table(content: document.Table, without: Collection[str] = ()) -> Table:
    """A table of the report, with its caption above and its note below.

    Args:
        content: the table; the first column is folded only where all columns are text.
        without: headings of columns to leave out.
    """
    kept = [k for k, heading in enumerate(content.header) if heading not in without]
    words = [k for k in kept if content.is_text(k)]
    headings: dict[str, Align] = {content.header[k]: "left" if k in words else "right" for k in kept}
    folded = [content.header[k] for k in words if k > 0 or words == kept]
    table = plain_table(content.caption, headings, ([row[k] for k in kept] for row in content.rows), folded)
    table.caption = printable(content.note)
    return table


def characteristics_table(characteristics: Iterable[Characteristic]) -> Table:
    """A table of gain, time constant, dead zone and friction, with intervals."""
    lines = [
        (
            each.name,
            *_with_half(each.value if each.shown else None, each.half_width, 4),
            plain_unit(each.unit),
            NOT_SHOWN if not each.shown else _source(each),
        )
        for each in characteristics
    ]
    headings: dict[str, Align] = {"quantity": "left", "value": "right", "±": "right", "unit": "left", "model": "left"}
    return plain_table("characteristics of the drive, with 95 % intervals", headings, lines)


def _source(each: Characteristic) -> str:
    """The model that a characteristic is from, and what it depends on."""
    from emsid.estimation.estimates import INCLUDES_ZERO

    given = f", given {', '.join(each.given)}" if each.given else ""
    return f"{each.model}{'' if each.significant else f': {INCLUDES_ZERO}'}{given}"


def _with_half(value: float | None, half: float | None, digits: int) -> tuple[str, str]:
    """A value and half its interval, or the size that it does not exceed where the interval includes zero."""
    from emsid.report.numbers import less_than

    if value is None or half is None or not isfinite(half):
        return "–" if value is None else f"{value:.{digits}g}", ""
    return (bound, "") if (bound := less_than(value, half)) else (f"{value:.{digits}g}", f"{half:.2g}")


def physical_table(fit: GreyBoxFit) -> Table:
    """A table of the parameters of a plant and, if some are not identifiable, of the identifiable combinations."""
    from emsid.estimation.estimates import HALF_WIDTH
    from emsid.models.plants.search.result import Status

    rows: list[tuple[str, str, tuple[str, str], str, str]]
    rows = [(row.name, row.symbol, _of_row(row), row.unit, row.how) for row in fit.shared]
    if any(row.status in (Status.KEPT, Status.CONDITIONAL, Status.ASSUMING) for row in fit.table):
        rows += [
            (each.name, each.formula, _with_half(each.value, HALF_WIDTH * error, 5), each.unit, together.how)
            if fit.shows(each)
            else (each.name, each.formula, ("–", ""), each.unit, NOT_SHOWN)
            for together in fit.combinations
            for each, error in [(together.quantity, together.standard_error)]
        ]
    lines = [(name, symbol, *cells, plain_unit(unit), how) for name, symbol, cells, unit, how in rows]
    headings: dict[str, Align] = dict.fromkeys(("quantity", "symbol"), "left")
    headings |= dict.fromkeys(("value", "±"), "right")
    headings |= dict.fromkeys(("unit", "status"), "left")
    return plain_table(f"{fit.model.name}, with 95 % intervals", headings, lines)


def half_width(row: Estimate) -> str:
    """Half the interval of a parameter, or the interval itself where it is not symmetric."""
    if row.standard_error is None and row.interval is not None:
        return f"{row.interval[0]:.3g} to {row.interval[1]:.3g}"
    return _half(row.standard_error)


def _of_row(row: Estimate) -> tuple[str, str]:
    """The value of a parameter and half its interval, or the interval itself where it is not symmetric."""
    from emsid.estimation.estimates import HALF_WIDTH

    if row.standard_error is None or not row.estimated:
        return f"{row.value:.5g}", half_width(row)
    return _with_half(row.value, HALF_WIDTH * row.standard_error, 5)


def _half(error: float | None) -> str:
    from emsid.estimation.estimates import HALF_WIDTH

    return "" if not error or not isfinite(error) else f"{HALF_WIDTH * error:.2g}"


def show(table: Table) -> None:
    """Print a table in the width of the terminal, if there is one, with its title and note, which may be wider."""
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(width=WIDE)
    title, note = table.title, table.caption
    table.title = table.caption = None
    with console.capture() as text:  # a console would end the program where the reader of the output is gone
        if title is not None:
            console.print(title)
        console.print(table)
        if note:
            console.print(note, markup=False)
        console.print()
    print(text.get(), end="", flush=True)


def width_of_terminal() -> int:
    """The width in which `show` prints, in letters."""
    from rich.console import Console

    console = Console()
    return console.width if console.is_terminal else WIDE


class Progress:
    """Receiver of progress reports.

    Args:
        update: called with the present activity, the steps done, and their total number (None if unknown).
    """

    def __init__(self, update: Callable[[str, int, int | None], None]) -> None:
        self.update = update

    @property
    def control(self) -> Control:
        """Report the activity of a `Control`."""
        from emsid.estimation.nonlinear.control import Control

        return Control(
            cancelled=lambda: INTERRUPTION.pressed,
            report=lambda activity: self.update(activity.doing, activity.done, activity.total),
        )


STOPPING = "stopping after this step; any results so far follow (Ctrl-C again: end without them)"
"""What Ctrl-C during a search is answered."""


@contextmanager
def working(answer: str = STOPPING) -> Iterator[Control]:
    """The control of a search: it shows the present activity, and Ctrl-C cancels it.

    Args:
        answer: what Ctrl-C is answered at once.

    Raises:
        KeyboardInterrupt: if the search was interrupted before it had a result.
        ModelError: if its time was up before that.
    """
    from emsid.errors import ModelError
    from emsid.estimation.fit import Ending
    from emsid.estimation.nonlinear.control import Stopped

    with progress_bar() as progress, INTERRUPTION.asked(answer):
        try:
            yield progress.control
        except Stopped as stop:
            if stop.ending is Ending.OUT_OF_BUDGET:
                words = "the time was up before a model was found; allow more, or ask for other models"
                raise ModelError(words, arguments=("budget",)) from None
            INTERRUPTION.pressed = True
            raise KeyboardInterrupt from None


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A progress bar on standard error, if that is a terminal, with the present activity."""
    from rich import progress
    from rich.console import Console

    console = Console(stderr=True)
    columns = (
        progress.TextColumn("{task.description}", markup=False),
        progress.BarColumn(),
        progress.TextColumn("{task.fields[steps]}"),
        progress.TimeElapsedColumn(),
    )
    bar = progress.Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    task = bar.add_task("starting", total=None, steps="")

    def update(what: str, done: int, total: int | None) -> None:
        steps = "" if total is None else f"{done}/{total}"
        bar.update(task, description=one_line(what), completed=done, total=total, steps=steps)

    bar.start()
    try:
        yield Progress(update)
    finally:
        with INTERRUPTION.put_off():  # the work has ended, and its result must not be lost
            bar.stop()
