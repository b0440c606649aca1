"""``emsid bench serve`` and ``emsid bench run``."""

from collections.abc import Callable
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import Commands, app
from emsid.cli.commands.track import Baud, Header
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.options import Force, Json, option, quantity
from emsid.cli.terminal import progress_bar, say, say_json, warn
from emsid.cli.writing import as_json, attempted, check_file
from emsid.errors import DataError
from emsid.findings import Finding

if TYPE_CHECKING:
    from emsid.live.driving import Drive, Limits
    from emsid.record import Record

bench = Commands(
    help="Serve a simulated motor, or send a test signal to a motor.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(bench, name="bench")

Seconds = Annotated[float | None, typer.Option(metavar="S", parser=quantity("s"), help="End after this time.")]


@bench.command()
def serve(
    motor: Annotated[Path | None, typer.Option(metavar="TOML", help="Parameters of the motor.")] = None,
    port: Annotated[int, typer.Option(metavar="N", help="TCP port; 0 for any free one.", min=0, max=65535)] = 7000,
    host: Annotated[str, typer.Option(metavar="ADDRESS", help="Where to listen; by default this machine only.")] = (
        "127.0.0.1"
    ),
    terminal: Annotated[bool, typer.Option("--terminal", help="Open a pseudo-terminal too.")] = False,
    dt: Annotated[float, typer.Option(metavar="S", parser=quantity("s"), help="Sample time.")] = 1e-3,
    pace: Annotated[
        float, typer.Option(metavar="X", help="Speed in multiples of real time; 0: a sample for every command.")
    ] = 1.0,
    change: Annotated[
        list[str], typer.Option(metavar="NAME=VALUE@S", help="A change while it runs: disturbance=0.05@30.")
    ] = [],  # noqa: B006
    ideal: Annotated[bool, typer.Option("--ideal", help="No noise of the sensor, no limit of the amplifier.")] = False,
    duration: Seconds = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the noise.", min=0)] = 1,
    json: Json = False,
) -> None:
    """Serve a simulated motor on a TCP port, as a board would.

    It sends samples and takes commands in the line protocol (docs/line-protocol.md): `u 1.5`, `stop`, `?`. The motor
    stands at 0 V until a command comes, half a second after the last one, and when its driver disconnects. Ctrl-C ends
    it.

    \b
    Examples:
      emsid bench serve
      emsid bench serve --motor motor.toml --port 7001 --terminal --change load_inertia="0.003 kg*m^2"@30
    """
    from emsid.io import read_motor
    from emsid.live.board import Board, read_change
    from emsid.live.server import Server
    from emsid.plant import Bench, Motor

    made = Motor() if motor is None else read_motor(motor)
    changes = tuple(sorted(map(read_change, change), key=lambda each: each.time))
    board = Board(made, dt, Bench() if ideal else Bench.typical(), changes, seed)
    server = Server(board, host, port, terminal, pace)
    address = f"socket://{server.address[0]}:{server.address[1]}"
    if json:
        say_json(as_json({"schema": 1, "source": address, "terminal": server.terminal, "dt": dt, "pace": pace}))
    else:
        say(f"serving {address}" + (f" and {server.terminal}" if server.terminal else "") + "; Ctrl-C ends")
    with INTERRUPTION.asked("ending; the motor is set to 0 V"):
        server.run(lambda: INTERRUPTION.pressed, duration)
    INTERRUPTION.pressed = False


@bench.command()
def run(
    source: Annotated[str, typer.Option(metavar="SOURCE", help="serial:///dev/ttyACM0 or socket://host:port.")],
    limit: Annotated[float, typer.Option(metavar="V", parser=quantity("V"), help="The largest voltage.")],
    excitation: Annotated[
        str, typer.Option(metavar="NAME", help="Test signal; `emsid list` names them.")
    ] = "multisine",
    signal: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A file with the signal, as `emsid design` writes it.")
    ] = None,
    amplitude: Annotated[
        float | None,
        typer.Option(metavar="V", parser=quantity("V"), help="Its largest voltage.  [default: the limit]"),
    ] = None,
    duration: Annotated[float, typer.Option(metavar="S", parser=quantity("s"), help="Its length.")] = 10.0,
    speed_limit: Annotated[
        float | None, typer.Option(metavar="X", parser=quantity("rad/s"), help="The largest speed, in rad/s.")
    ] = None,
    time_limit: Annotated[
        float | None, typer.Option(metavar="S", parser=quantity("s"), help="The longest run on the clock.")
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the signal.", min=0)] = 1,
    header: Header = "",
    baud: Baud = 115200,
    patience: Annotated[
        float, typer.Option(metavar="S", parser=quantity("s"), help="Time to wait for the port, and for a sample.")
    ] = 5.0,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Where to write the record: .csv, .parquet, .npz.")] = Path(
        "record.csv"
    ),
    force: Force = False,
    json: Json = False,
) -> None:
    """Drive a board with a test signal and write a record.

    Watches the limits of voltage, speed and time, and always ends with the motor at 0 V, also after Ctrl-C or when the
    connection breaks. Everything received is in a log beside the record. A server may start up to --patience later.

    \b
    Examples:
      emsid bench run --source socket://localhost:7000 --excitation prbs --limit 6V
      emsid bench run --source serial:///dev/ttyACM0 --limit 6V --speed-limit "2000 rpm" --duration 30
    """
    from emsid.excitation import SIGNALS
    from emsid.live.driving import Limits
    from emsid.live.sources import is_connection

    if excitation not in SIGNALS:
        raise DataError(f"no test signal {excitation!r}; there are {', '.join(SIGNALS)}")
    if not is_connection(source):
        raise DataError(f"{source} takes no commands; name a serial port or a socket", arguments=("source",))
    size = limit if amplitude is None else amplitude
    limits = Limits(limit, speed_limit, time_limit)
    if size > limit:
        raise DataError(
            f"an amplitude of {size:g} V above the limit of {limit:g} V; lower it", arguments=("amplitude",)
        )
    if not duration > 0:
        raise DataError(f"a duration of {duration:g} s; give a positive one", arguments=("duration",))
    if not (isfinite(patience) and patience > 0):
        raise DataError(f"patience of {patience:g} s; give a positive time", arguments=("patience",))
    check_file(out, force)

    voltages = _made(excitation, duration, size, seed) if signal is None else _in_file(signal, limit)
    result, record = _driven(source, voltages, limits, header, baud, patience, out)
    files: list[str] = []
    with INTERRUPTION.put_off():
        unwritten = attempted(lambda: files.extend(_write(record, out, force)))
    _say(result, source, files, record, json)
    if unwritten is not None:
        raise unwritten
    if result.at_zero is not True or result.reason not in ("done", "interrupted"):
        raise typer.Exit(1)
    INTERRUPTION.words = "the run was interrupted; what was recorded until then is written"
    INTERRUPTION.end(result.reason == "interrupted")


def _made(excitation: str, duration: float, amplitude: float, seed: int) -> "Callable[[float], Any]":
    """The test signal, made for the sample time of a board."""
    import numpy as np

    from emsid.excitation import SIGNALS

    rng = np.random.default_rng(seed)
    return lambda dt: SIGNALS[excitation](max(round(duration / dt), 1), dt, amplitude, rng)


def _in_file(path: Path, limit: float) -> "Callable[[float], Any]":
    """The signal in a file, held over the samples of a board.

    Raises:
        DataError: for a signal beyond the limit.
    """
    import numpy as np

    from emsid.io import read, read_columns

    columns = read_columns(path)
    names = list(columns.series)
    if len(names) != 2:
        raise DataError(
            f"{path}: {len(names)} columns; a signal has a time and a command, as `emsid design` writes them",
            arguments=("signal",),
        )
    time, name = names
    record = read(path, input=name, output=(), time=time)
    command = record.input[:, 0]
    if np.max(np.abs(command)) > limit:
        raise DataError(
            f"{path}: its largest voltage {np.max(np.abs(command)):g} V is above the limit of {limit:g} V; raise the "
            "limit, or design it again",
            arguments=("signal",),
        )

    def held(dt: float) -> Any:
        at = np.arange(max(round(len(command) * record.dt / dt), 1)) * dt / record.dt
        return command[np.minimum(np.floor(at + 1e-9).astype(int), len(command) - 1)]

    return held


def _driven(
    source: str,
    signal: "Callable[[float], Any]",
    limits: "Limits",
    header: str,
    baud: int,
    patience: float,
    out: Path,
) -> "tuple[Drive, Record]":
    """Drive the board and write its log; what happened, and the record."""
    from emsid.estimation import Control
    from emsid.live.driving import drive
    from emsid.live.log import Log
    from emsid.live.protocol import LineParser
    from emsid.live.receiver import Receiver
    from emsid.live.sources import awaited, open_source, read_log

    again = partial(open_source, source, baud)
    opened = awaited(again, patience, warn)
    with INTERRUPTION.asked("stopping the motor", by_sigterm=True), INTERRUPTION.put_off():
        log = Log(out.with_suffix(".log.txt"))
        receiver = Receiver(opened, log, again)
        try:
            with progress_bar() as progress:
                control = Control(cancelled=lambda: INTERRUPTION.pressed, report=progress.control.report)
                result = drive(receiver, LineParser(header), signal, limits, control, patience=patience)
        finally:
            INTERRUPTION.pressed = False
            receiver.close()
            log.close()
    if result.reason == "interrupted" and not result.samples:
        INTERRUPTION.words = "interrupted; the board has sent no sample, so 0 V is not confirmed"
        INTERRUPTION.pressed = True
        INTERRUPTION.raise_again()
    with INTERRUPTION.put_off():
        return result, read_log(log.path, log.begin, header)


def _write(record: Any, out: Path, force: bool) -> list[str]:
    """Write every stretch of a record to a file; one that exists is replaced with ``force`` only."""
    from emsid.io import write_record
    from emsid.io.files import together

    segments = record.segments
    paths = [out] if len(segments) == 1 else [out.with_stem(f"{out.stem}-{k + 1}") for k in range(len(segments))]
    with together():
        for path, segment in zip(paths, segments, strict=True):
            check_file(path, force)
            write_record(segment, path)
    return [str(path) for path in paths]


REASONS = {
    "done": "the signal was sent to its end",
    "interrupted": "the run was interrupted",
    "disconnected": "the connection broke",
    "silent": "the board sent no more samples",
    "restarted": "the board started again",
    "time": "the time limit was reached",
    "voltage": "the board applied more than the voltage limit",
    "speed": "the speed limit was passed",
}


def _say(result: "Drive", source: str, files: list[str], record: Any, json: bool) -> None:
    """Print what happened."""
    from emsid.wording import sentence

    if json:
        data = {name: getattr(result, name) for name in ("reason", "at_zero", "samples", "commands", "dt", "largest")}
        say_json(as_json({"schema": 1, "source": source, **data, "files": files}))
        return
    zero = "the motor is at 0 V" if result.at_zero else sentence(Finding("motor-not-at-zero", source), option)
    say(f"{REASONS[result.reason]}; {zero}")
    written = f"; written to {', '.join(files)}" if files else ""
    say(f"{len(record)} samples, largest output {result.largest:.4g}{written}")
