"""``emsid simulate``."""

from pathlib import Path
from typing import Annotated

import typer

from emsid.cli.app import app
from emsid.cli.options import quantity
from emsid.cli.terminal import say
from emsid.errors import DataError


@app.command()
def simulate(
    out: Annotated[Path, typer.Option(metavar="FILE", help="Where to write: .csv, .parquet or .npz.")],
    excitation: Annotated[str, typer.Option(metavar="NAME", help="Test signal; `emsid list` names them.")] = "sines",
    amplitude: Annotated[
        float, typer.Option(metavar="V", parser=quantity("V"), help="Largest voltage either way.")
    ] = 6.0,
    duration: Annotated[float, typer.Option(metavar="S", parser=quantity("s"), help="Length of the record.")] = 10.0,
    dt: Annotated[float, typer.Option(metavar="S", parser=quantity("s"), help="Sample time.")] = 0.005,
    motor: Annotated[Path | None, typer.Option(metavar="TOML", help="Parameters of the motor.")] = None,
    ideal: Annotated[bool, typer.Option("--ideal", help="No noise, quantisation or delay of the bench.")] = False,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of signal and noise.", min=0)] = 1,
) -> None:
    """Simulate a motor and write a record.

    \b
    Examples:
      emsid simulate --out record.csv
      emsid simulate --excitation multisine --amplitude 8 --duration 30 --motor motor.toml --out record.parquet
    """
    import numpy as np

    from emsid.excitation import SIGNALS, crest_factor
    from emsid.io import read_motor, write_record
    from emsid.plant import Bench, Motor

    if excitation not in SIGNALS:
        raise DataError(f"no test signal {excitation!r}; there are {', '.join(SIGNALS)}")
    if not (dt > 0 and duration > 0):
        raise DataError(f"a record of {duration:g} s sampled every {dt:g} s; both must be positive")
    rng = np.random.default_rng(seed)
    voltage = SIGNALS[excitation](round(duration / dt), dt, amplitude, rng)
    bench = Bench() if ideal else Bench.typical()
    record = bench.run(Motor() if motor is None else read_motor(motor), voltage, dt, rng)
    time = write_record(record, out)
    top = float(abs(record.output).max())
    say(f"{len(record)} samples, crest factor {crest_factor(voltage):.2f}, speed up to {top:.4g} rad/s")
    say(f"written to {out}: columns {time}, {', '.join(record.input_names + record.output_names)}")
