"""``emsid describe``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.options import Json
from emsid.cli.reading import reads_records
from emsid.cli.terminal import say, say_json
from emsid.cli.writing import as_json

ENOUGH = 4
"""An order of persistent excitation that is enough for a small model: two past outputs and two past inputs."""


@app.command()
@reads_records()
def describe(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Records.")],
    reader: Any,
    tolerance: Annotated[
        float,
        typer.Option(
            metavar="FRACTION",
            help="Singular values of the lagged input below this fraction of the largest are no excitation.",
        ),
    ] = 1e-3,
    json: Json = False,
) -> None:
    """Show what a record contains.

    Samples, segments, time axis, ranges, crest factor, order of persistent excitation.

    \b
    Example:
      emsid describe log.csv --input voltage --output speed --time t
    """
    from emsid.excitation import crest_factor, largest_order, persistent_excitation_order
    from emsid.units import with_unit

    documents: list[dict[str, Any]] = []
    for path in files:
        record = reader(path)
        order, largest = persistent_excitation_order(record, tolerance=tolerance), largest_order(record)
        crest = crest_factor(record)
        channels = zip(record.input_names + record.output_names, record.input_units + record.output_units, strict=True)
        if json:
            described = [(name, unit, record.channel(name)) for name, unit in channels]
            documents.append(
                {
                    "record": record.name,
                    "samples": len(record),
                    "segments": len(record.breaks) + 1,
                    "dt": record.dt,
                    "channels": [
                        {
                            "name": n,
                            "unit": u,
                            "min": float(x.min()),
                            "max": float(x.max()),
                            "mean": float(x.mean()),
                            "deviation": float(x.std()),
                        }
                        for n, u, x in described
                    ],
                    "crest_factor": float(crest),
                    "persistent_excitation_order": int(order),
                    "at_least": bool(order == largest),
                }
            )
            continue
        say(str(record))
        if record.time_axis is not None:
            say(f"  time column {reader.given['time']}: {record.time_axis}")
        for name, unit in channels:
            x = record.channel(name)
            span = with_unit(f"{x.min():.5g} … {x.max():.5g}", unit)
            say(f"  {name}: {span}, mean {x.mean():.5g}, deviation {x.std():.5g}")
        say(f"  input crest factor {crest:.2f}")
        at_least = "at least " if order == largest else ""
        say(f"  order of persistent excitation {at_least}{order}: {verdict(order)}")
    if json:
        say_json(as_json({"schema": 1, "records": documents}))


def verdict(order: int) -> str:
    """What an order of persistent excitation allows to estimate.

    A linear model with n parameters needs an input of order n (Ljung, section 13.2).
    """
    if order < ENOUGH:
        return "too low for most models; record with an input of more levels or frequencies"
    return f"the input is rich enough for linear models with up to {order} parameters"
