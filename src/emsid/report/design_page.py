"""The page of a designed experiment: what it gains, the signal, and the intervals that it leads to."""

from __future__ import annotations

from math import isfinite

from emsid.experiment_design import Design
from emsid.report import views
from emsid.report.document import Notice, Report, Section, Table
from emsid.report.numbers import number
from emsid.wording import Spelling, as_python, sentence, severity


def design_report(found: Design, argument: Spelling = as_python) -> Report:
    """The page of a design.

    Args:
        found: the design.
        argument: how names of arguments are written in its findings.
    """
    return Report(
        title="The next experiment",
        summary=(
            gain(found),
            f"{len(found.record):,} samples of {found.record.dt:g} s: send them to the drive, record input and output, "
            "and identify again with both records. Predicted by the model's own free run and the noise of its fit.",
        ),
        sections=(Section("Predicted intervals", tables=(widths_table(found),)),),
        imprint="emsid design",
        opening=Section("", figures=(views.inputs((found.record,), name="signal"),)),
        notices=tuple(Notice(sentence(each, argument), severity(each).value) for each in found.findings),
    )


def gain(found: Design) -> str:
    """How much narrower the wanted intervals are than with the best standard signal."""
    if found.gain == 1.0:
        return f"A {found.best.name} is as good as a designed signal within these limits."
    if not isfinite(found.gain):
        return "No standard signal within these limits moves the plant; the designed signal does."
    narrower = f"The intervals of the wanted parameters become {found.gain:.2f} times narrower"
    return f"{narrower} than with the best standard signal within the same limits."


def widths_table(found: Design) -> Table:
    """Half widths of the 95 % intervals: at present, of the design, and of the standard signals."""
    columns = {"present": found.present, "design": found.best.half_widths}
    columns |= {name: each.half_widths for name, each in found.standard.items()}
    rows = tuple(
        (
            f"{'*' if name in found.wanted else ' '} {name}",
            number(value),
            *(f"{half:.3g}" if isfinite(half := widths[name]) else "–" for widths in columns.values()),
            found.units[name],
        )
        for name, value in found.values.items()
    )
    header = ("quantity", "value", *columns, "unit")
    return Table(header, rows, "predicted half widths of 95 % intervals", "*: wanted", ends_in_text=True)
