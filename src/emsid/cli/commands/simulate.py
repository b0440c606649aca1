"""``emsid simulate``."""

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.options import Force, Json, option, quantity
from emsid.cli.reading import reads_records
from emsid.cli.terminal import say, say_json
from emsid.cli.writing import as_json, check_file
from emsid.errors import DataError

if TYPE_CHECKING:
    from emsid.findings import Finding
    from emsid.record import Record

STEP = 0.005
"""Sample time in s of a record of the built-in motor."""


class Start(StrEnum):
    """Where the free run of a saved model begins in every segment of its inputs."""

    REST = "rest"
    ESTIMATED = "estimated"


@app.command()
@reads_records()
def simulate(
    reader: Any,
    model: Annotated[Path | None, typer.Argument(metavar="MODEL", help="A model file that emsid wrote.")] = None,
    file: Annotated[
        Path | None, typer.Argument(metavar="INPUT", help="A file with the inputs to run the model on.")
    ] = None,
    *,
    start: Annotated[
        Start, typer.Option(help="Begin MODEL at rest, or in the state that the first outputs in INPUT show.")
    ] = Start.REST,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Where to write: .csv, .parquet or .npz.")],
    excitation: Annotated[str, typer.Option(metavar="NAME", help="Test signal; `emsid list` names them.")] = "sines",
    amplitude: Annotated[
        float, typer.Option(metavar="V", parser=quantity("V"), help="Largest voltage in both directions.")
    ] = 6.0,
    duration: Annotated[float, typer.Option(metavar="S", parser=quantity("s"), help="Length of the record.")] = 10.0,
    motor: Annotated[Path | None, typer.Option(metavar="TOML", help="Parameters of the motor.")] = None,
    ideal: Annotated[bool, typer.Option("--ideal", help="No noise, quantisation or delay of the bench.")] = False,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of signal and noise.", min=0)] = 1,
    force: Force = False,
    json: Json = False,
) -> None:
    """Simulate a motor, or a saved model, and write a record.

    Without MODEL, the built-in motor or that of --motor answers a test signal on a virtual bench. With MODEL, the
    model runs freely on the inputs in a file. It is read as the model file remembers, with the options for columns,
    units and times that are given in its place. The model begins at rest, and outputs in that file are not used. With
    --start estimated, the first outputs of every segment give the initial state, as in `emsid validate`; they are
    repeated in the result.

    \b
    Examples:
      emsid simulate --out record.csv
      emsid simulate emsid-result/arx.json voltage.csv --out simulated.csv
      emsid simulate emsid-result/arx.json other.csv --input u --time t --out simulated.csv
      emsid simulate emsid-result/arx.json other.csv --start estimated --out simulated.csv
      emsid simulate --excitation multisine --amplitude 8 --duration 30 --motor motor.toml --out record.parquet
    """
    from emsid.excitation import crest_factor
    from emsid.io import write_record
    from emsid.units import with_unit
    from emsid.wording import sentence

    found: list[Finding] = []
    if model is None:
        others = [name for name in reader.typed if name != "--dt"]
        if others := [*others, *(["--start"] if start is not Start.REST else [])]:
            raise DataError(f"{', '.join(others)}: only for the file with the inputs of a model; name both, or neither")
        check_file(out, force)
        record = _of_motor(excitation, amplitude, duration, reader.given.get("dt", STEP), motor, ideal, seed)
    elif file is None:
        raise DataError(f"{model}: name the file with the inputs to run the model on: simulate MODEL INPUT")
    else:
        check_file(out, force)
        record, begun, found = _of_model(model, file, reader, start)
    time = write_record(record, out)
    crest, outputs = float(crest_factor(record)), zip(record.output_names, record.output_units, strict=True)
    largest = [(name, float(abs(record.channel(name)).max()), unit) for name, unit in outputs]
    if json:
        channels = [time, *record.input_names, *record.output_names]
        tops = [{"name": name, "largest": top, "unit": unit} for name, top, unit in largest]
        document = {"file": str(out), "samples": len(record), "dt": record.dt, "columns": channels}
        if model is not None:
            document |= {"start": start.value, "findings": [finding.to_data() for finding in found]}
        say_json(as_json({"schema": 1, **document, "crest_factor": crest, "outputs": tops}))
        return
    levels = ", ".join(f"{name} up to {with_unit(f'{top:.4g}', unit)}" for name, top, unit in largest)
    say(f"{len(record):,} samples, crest factor {crest:.2f}, {levels}", *([begun] if model is not None else []))
    say(*(f"- {sentence(finding, option)}" for finding in found))
    say(f"written to {out}: columns {time}, {', '.join(record.input_names + record.output_names)}")


def _of_model(path: Path, file: Path, reader: Any, start: Start) -> "tuple[Record, str, list[Finding]]":
    """The free run of a saved model over the inputs in a file, where it begins, in words, and what differs in the file.

    The file is read as the model file remembers and as is given; its outputs are read only to estimate the start.
    """
    from emsid.io import ParsedFile, load_model, origin, read, read_columns, read_options
    from emsid.models.verbs import simulate as run
    from emsid.units import column_of, name_and_unit

    model, source = load_model(path), origin(path)
    reader = reader.after(read_options(path), () if source is None else source.names)
    parsed = ParsedFile(file, read_columns(file, dbc=reader.given.get("dbc")))
    reading = reader.for_columns(parsed.columns)
    if source is None or "input" not in reading:
        raise DataError(f"{path}: the file does not say how its record was read; identify the model again")
    outputs = reading["output"] if start is Start.ESTIMATED else ()
    columns = [*reading["input"], *outputs]
    known = {name_and_unit(each)[0] for name in columns for each in (name, column_of(name))}
    options: dict[str, Any] = {
        name: {column: each for column, each in value.items() if name_and_unit(column)[0] in known}
        if isinstance(value, dict)
        else value
        for name, value in reading.items()
    }
    record = read(parsed, **(options | {"output": outputs}))
    driven = run(model, record)
    names, units = zip(*source.outputs, strict=True)
    begun = f"begins at rest; if {file.name} has outputs, --start estimated takes the initial state from them"
    if start is Start.ESTIMATED:
        begun = f"begins in the state that the first outputs in {file.name} show; these are repeated in the result"
    return replace(driven, output_names=names, output_units=units), f"{model.name} {begun}", source.differences(record)


def _of_motor(
    excitation: str, amplitude: float, duration: float, dt: float, motor: Path | None, ideal: bool, seed: int
) -> "Record":
    """The record of a motor on the virtual bench."""
    import numpy as np

    from emsid.excitation import SIGNALS
    from emsid.io import read_motor
    from emsid.plant import Bench, Motor

    if excitation not in SIGNALS:
        raise DataError(f"no test signal {excitation!r}; there are {', '.join(SIGNALS)}")
    if not (dt > 0 and duration > 0):
        raise DataError(f"duration {duration:g} s and sample time {dt:g} s; both must be positive")
    rng = np.random.default_rng(seed)
    voltage = SIGNALS[excitation](round(duration / dt), dt, amplitude, rng)
    bench = Bench() if ideal else Bench.typical()
    return bench.run(Motor() if motor is None else read_motor(motor), voltage, dt, rng)
