"""``emsid validate``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.options import Transient
from emsid.cli.reading import reads_records
from emsid.cli.terminal import error_table, say, show


@app.command()
@reads_records()
def validate(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="A model file that emsid wrote.")],
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Records that the model has not seen.")],
    reader: Any,
    transient: Transient = None,
    horizon: Annotated[int, typer.Option(metavar="K", help="Also predict this many samples ahead.", min=1)] = 1,
) -> None:
    """Run a saved model on other records.

    \b
    Example:
      emsid validate emsid-result/friction-narx.json other.csv --input voltage --output speed --dt 0.001
    """
    from emsid.io import load, origin
    from emsid.validation.comparison import assess_model
    from emsid.validation.metrics import mean_squared_error

    loaded, source = load(model), origin(model)
    rows = [(record, assess_model(loaded, record, transient).row) for record in map(reader, files)]
    for record, row in rows:
        show(error_table([row], record.name, record.output_units[0]))
        for difference in () if source is None else source.differences(record):
            say(f"{model}: {difference}")
        if horizon > 1:
            ahead = loaded.predict(record, horizon, transient)
            error = mean_squared_error(record.output[ahead.counted], ahead.output[ahead.counted])
            say(f"{horizon} samples ahead: MSE {error:.5g}")
