"""``emsid frequency``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.options import Force, Json, PageFolder, names
from emsid.cli.reading import reads_records
from emsid.cli.terminal import Align, plain_table, say, say_json, show
from emsid.cli.writing import REPORT, as_json, check_file, check_folder, draw, say_where, write
from emsid.errors import DataError

if TYPE_CHECKING:
    from emsid.record import FrequencyResponse
    from emsid.report.document import Report

MOST_ROWS = 20
"""At most this many frequencies are printed; the table and the JSON have all."""


@app.command()
@reads_records()
def frequency(
    reader: Any,
    files: Annotated[list[Path], typer.Argument(metavar="FILE", help="Records, each an experiment; or one table.")],
    method: Annotated[
        str | None, typer.Option(metavar="NAME", help="periodic, polynomial or welch.  [default: what suits]")
    ] = None,
    reference: Annotated[
        list[str], typer.Option(metavar="NAMES", help="In closed loop, the inputs that are references.")
    ] = [],  # noqa: B006
    period: Annotated[
        int | None, typer.Option(metavar="N", help="Period of the input in samples.  [default: found]", min=1)
    ] = None,
    window: Annotated[int | None, typer.Option(metavar="N", help="Samples of a window (welch).", min=8)] = None,
    band: Annotated[str | None, typer.Option(metavar="HZ-HZ", help="Part of the frequencies, such as 1-200.")] = None,
    model: Annotated[list[Path], typer.Option(metavar="MODEL", help="Model files to draw beside the response.")] = [],  # noqa: B006
    poles: Annotated[
        int | None, typer.Option(metavar="N", help="Fit a transfer function with this many poles.", min=1)
    ] = None,
    zeros: Annotated[int | None, typer.Option(metavar="M", help="Its zeros.  [default: poles - 1]", min=0)] = None,
    dead_time: Annotated[bool, typer.Option("--dead-time", help="It has a dead time.")] = False,
    table: Annotated[Path | None, typer.Option(metavar="FILE", help="CSV table to write the response to.")] = None,
    out: PageFolder = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Estimate a frequency response from records, or read one.

    Of a periodic input, noise comes from its periods and nonlinear distortion from several files with other phases, or
    from lines that the input leaves out. Any other input is by local polynomials, or by averaged windows with the
    coherence. Several files are experiments of one system. Without --input, the file is a table of frequency, magnitude
    and phase, as an analyser or an oscilloscope writes it. With --poles, a transfer function is fitted to the response.

    \b
    Examples:
      emsid frequency sweep.csv --input voltage --output speed --dt 1ms --out response
      emsid frequency run1.csv run2.csv run3.csv -u torque -y speed --dt 0.5ms --table response.csv
      emsid frequency loop.csv -u reference,current -y speed --dt 1ms --reference reference --method welch
      emsid frequency bode.csv --poles 4 --zeros 2 --out response
    """
    from emsid.estimation.fit import Fit
    from emsid.io import load, read_frequency_response, write_frequency_response
    from emsid.models.linear.transfer_function import transfer_function
    from emsid.models.measured_response import frequency_response
    from emsid.models.verbs import fit

    if out is not None:
        check_folder(out, "frequency.json", REPORT)
    if table is not None:
        check_file(table, force)
    if reader.given.get("input"):
        records = [reader(path) for path in reader.files(files)]
        found = frequency_response(
            records, method, reference=names(reference, "--reference"), period=period, window=window
        )
    elif len(files) == 1:
        found = read_frequency_response(files[0])
    else:
        raise DataError(
            "several tables of frequency responses; give one, or the columns of records", arguments=("input",)
        )
    if band is not None:
        found = found.between(*_ends(band))
    fits: list[Fit[Any]] = []
    if poles is not None:
        fits.append(fit(transfer_function(poles, zeros, delay=dead_time), found))
    if table is not None:
        write_frequency_response(found, table)
    columns = found.columns()
    result = {
        "schema": 1,
        "name": found.name,
        "method": found.method,
        "columns": {name: values.tolist() for name, values in columns.items()},
        "models": [each.to_data() for each in fits],
    }
    if json:
        say_json(as_json(result))
    else:
        _say(found, fits)
    if out is not None:
        with INTERRUPTION.put_off():
            write(out, {"frequency.json": result}, fits)
        drawn = draw(out, lambda: _report(found, [*fits, *(load(path) for path in model)]))
        if not json:
            say_where(out, drawn, "frequency.json")
        INTERRUPTION.end(not drawn)


def _ends(text: str) -> tuple[float, float]:
    low, dash, high = text.partition("-")
    try:
        return float(low or 0), float(high) if dash else float("inf")
    except ValueError:
        raise DataError(f"--band {text!r}: write it as 1-200") from None


def _say(found: "FrequencyResponse", fits: list[Any]) -> None:
    """Print the response at some of its frequencies, and the fits."""
    import numpy as np

    columns, first = found.columns(), max(float(found.frequency[0]), 1e-3 * float(found.frequency[-1]))
    rows = np.unique(np.searchsorted(found.frequency, np.geomspace(first, float(found.frequency[-1]), MOST_ROWS)))
    rows = rows[rows < len(found)]
    headings: dict[str, Align] = dict.fromkeys([name.replace("_", " ") for name in columns], "right")
    lines = [tuple(f"{values[k]:.4g}" for values in columns.values()) for k in rows.tolist()]
    show(plain_table(f"{found.name}: {found.method}, {len(found)} frequencies, in Hz, dB and degrees", headings, lines))
    say(*(str(each) for each in fits))


def _report(found: "FrequencyResponse", models: list[Any]) -> "Report":
    """A page with the response, its levels, and models in the same axes."""
    from emsid.report.document import Report, Section
    from emsid.report.notebook import figure, tables
    from emsid.validation.analysis import bode
    from emsid.validation.responses import Several

    drawn = (
        [figure(found)]
        if not models
        else [figure(Several([bode(found), *(bode(each, dt=found.dt) for each in models)]))]
    )
    sections = []
    for each in models:
        before, own, after = tables(each)
        sections.append(
            Section(
                each.model_name, paragraphs=tuple(before), tables=() if own is None else (own,), remarks=tuple(after)
            )
        )
    return Report(
        title=f"Frequency response of {found.name}",
        summary=(f"{found!r}",),
        opening=Section("", figures=tuple(each for each in drawn if each is not None)),
        sections=tuple(sections),
        imprint="emsid frequency",
    )
