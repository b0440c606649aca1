"""The command line: parse, call one function, print.

Nothing heavy is imported before a command runs, so that ``emsid --help`` answers at once.
"""

import inspect
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from io import StringIO, TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, TypeVar

import typer

from emsid.cli.interruption import INTERRUPTED, INTERRUPTION, leave_quietly
from emsid.cli.terminal import SPELT_OUT, error_table, physical_table, progress_bar, show
from emsid.errors import DataError, EmsidError

if TYPE_CHECKING:
    from emsid.identification import Identification
    from emsid.record import Record
    from emsid.study import Study

app = typer.Typer(
    help="Identify electromechanical systems: from a record of voltage and speed to a model you can trust.",
    epilog="Start with: emsid study    or: emsid identify log.csv --input voltage --output speed --dt 0.001",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
Command = TypeVar("Command", bound=Callable[..., None])
Result = TypeVar("Result", "Study", "Identification")

USER_ERROR = 2


def main() -> None:
    """Run the command line; what a user can mend is one line on standard error and exit status 2."""
    INTERRUPTION.begin()
    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # they speak to programmers
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as a shell does for what runs in the background
        signal.signal(signal.SIGINT, INTERRUPTION)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # with all that is cleaned up on leaving
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors=SPELT_OUT)  # a terminal that has no ² or Ω gets ^2 and ohm
    try:
        try:
            status = app(sys.argv[1:] or ["--help"], prog_name="emsid", standalone_mode=False)
        finally:
            sys.stdout.flush()
        sys.exit(status)
    except typer.TyperException as problem:  # an option or argument that there is not, or of another type
        message = getattr(problem, "format_message", problem.__str__)()
        command = getattr(getattr(problem, "ctx", None), "command_path", "emsid")
        _end(f"{message[:1].lower()}{message[1:].rstrip('.')}; see {command} --help", USER_ERROR)
    except EmsidError as problem:
        _end(str(problem), USER_ERROR)
    except OSError as problem:  # files are no matter for this place: it is where one prints to
        sys.stdout = StringIO()  # what is left of the output must not fail once more on leaving
        if isinstance(problem, BrokenPipeError):  # the reader has seen enough
            sys.exit(1)
        _end(f"the output cannot be written ({(problem.strerror or str(problem)).lower()})", USER_ERROR)
    except BaseException:
        if INTERRUPTION.pressed:
            _end_interrupted()
        raise
    finally:
        leave_quietly()


def _end_interrupted() -> NoReturn:
    """Say what became of what was interrupted."""
    INTERRUPTION.pressed = False
    _end(INTERRUPTION.words, INTERRUPTED)


def _end(words: str, status: int) -> NoReturn:
    print(f"emsid: {words}", file=sys.stderr)
    sys.exit(status)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"emsid {version('emsid')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", is_eager=True, callback=_version)
    ] = False,
) -> None:
    pass


# --- options that every command which reads a record has -------------------------------------------------------------


def _pairs(texts: list[str], option: str) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.rpartition("=")
        if not equals or not name or not value:
            raise DataError(f"{option} {text!r}: write it as {'NAME' if option == '--fix' else 'COLUMN'}=VALUE")
        if pairs.setdefault(name, value) != value:
            raise DataError(f"{option} gives {name} twice, as {pairs[name]} and as {value}; leave one of them out")
    return pairs


def _numbers(texts: list[str], option: str) -> dict[str, float]:
    numbers = {}
    for name, value in _pairs(texts, option).items():
        try:
            numbers[name] = float(value)
        except ValueError:
            raise DataError(f"{option} {name}={value}: {value!r} is not a number") from None
    return numbers


def _names(text: str | None, option: str) -> tuple[str, ...]:
    if text is None:
        return ()
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    if not all(names):
        raise DataError(f"{option} {text!r}: write it as names with commas between")
    return names


def _counts(text: str | None, option: str) -> tuple[int, ...]:
    try:
        return () if text is None else tuple(int(count) for count in text.split(","))
    except ValueError:
        raise DataError(f"{option} {text!r}: write it as whole numbers with commas between") from None


def _rows(text: str | None) -> slice | None:
    if text is None:
        return None
    first, colon, last = text.partition(":")
    try:
        if not colon:
            raise ValueError
        return slice(int(first) if first else None, int(last) if last else None)
    except ValueError:
        raise DataError(f"--rows {text!r}: write it as A:B, the data rows from A up to but not B") from None


def _reader(
    *,
    input: Annotated[
        list[str], typer.Option("--input", "-u", metavar="COL", help="Column that drives the system; repeat for more.")
    ],
    output: Annotated[
        list[str],
        typer.Option("--output", "-y", metavar="COL", help="Column that answers, or d(COL), the derivative of one."),
    ],
    dt: Annotated[float | None, typer.Option(metavar="S", help="Sample time in seconds.")] = None,
    time: Annotated[str | None, typer.Option(metavar="COL", help="Time column, checked for regularity.")] = None,
    time_unit: Annotated[
        str | None, typer.Option(metavar="UNIT", help="Unit of the time column, if its header does not say: s, ms, us.")
    ] = None,
    resample: Annotated[
        bool, typer.Option("--resample", help="Bring an irregular time axis to a regular one.")
    ] = False,
    rows: Annotated[str | None, typer.Option(metavar="A:B", help="Data rows to take, from A up to but not B.")] = None,
    mask: Annotated[
        str | None, typer.Option(metavar="EXPR", help='Samples to leave out, as in "abs(PWM) > 255".')
    ] = None,
    scale: Annotated[list[str], typer.Option(metavar="COL=GAIN", help="Multiply a column on the way in.")] = [],  # noqa: B006
    offset: Annotated[list[str], typer.Option(metavar="COL=X", help="Add to a column, after its gain.")] = [],  # noqa: B006
    unit: Annotated[
        list[str], typer.Option(metavar="COL=UNIT", help="Unit of a column: rpm, deg/s, count/sample, pwm, …; made SI.")
    ] = [],  # noqa: B006
    counts_per_revolution: Annotated[float | None, typer.Option(metavar="N", help="What a count is.")] = None,
    supply_voltage: Annotated[float | None, typer.Option(metavar="V", help="Voltage at full pwm.")] = None,
    pwm_full_scale: Annotated[float, typer.Option(metavar="N", help="Value of full pwm.")] = 255.0,
    derivative_window: Annotated[
        int, typer.Option(metavar="N", help="Samples in the window of the d(COL) filter (odd).")
    ] = 9,
) -> "Callable[[Path], Record]":
    """How files are read."""
    from emsid.io import read

    return partial(
        read,
        input=input,
        output=output,
        dt=dt,
        time=time,
        time_unit=time_unit,
        rows=_rows(rows),
        mask=mask,
        scale=_numbers(scale, "--scale"),
        offset=_numbers(offset, "--offset"),
        units=_pairs(unit, "--unit"),
        counts_per_revolution=counts_per_revolution,
        supply_voltage=supply_voltage,
        pwm_full_scale=pwm_full_scale,
        resample=resample,
        derivative_window=derivative_window,
    )


def _given(reader: "partial[Record]", **defaults: Any) -> list[str]:
    """The options on reading that differ from their defaults."""
    usual = _reader(**defaults)
    assert isinstance(usual, partial)
    words = {"units": "unit"}  # where option and argument differ
    return [
        f"--{words.get(name, name).replace('_', '-')}"
        for name, value in reader.keywords.items()
        if value != usual.keywords[name]
    ]


def reads_records(**defaults: Any) -> Callable[[Command], Command]:
    """Give a command the options of `_reader`; what they make is its argument ``reader``.

    Args:
        defaults: for options that may be left out in this command.
    """

    def decorate(command: Command) -> Command:
        own = {name: p for name, p in inspect.signature(command).parameters.items() if name != "reader"}
        shared = {
            name: p.replace(default=defaults.get(name, p.default))
            for name, p in inspect.signature(_reader).parameters.items()
        }

        def with_options(**values: Any) -> None:
            reader = _reader(**{name: values.pop(name) for name in shared})
            command(reader=reader, **values)

        parameters = [p.replace(kind=p.KEYWORD_ONLY) for p in (*own.values(), *shared.values())]
        with_options.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        with_options.__annotations__ = {p.name: p.annotation for p in parameters}
        with_options.__name__, with_options.__doc__ = command.__name__, command.__doc__
        return with_options  # type: ignore[return-value]

    return decorate


Transient = Annotated[
    int | None,
    typer.Option(metavar="N", help="Samples that start a free run and are left out of every error.", min=0),
]
Out = Annotated[Path, typer.Option(metavar="DIR", help="Folder for what is written.")]


# --- the commands ----------------------------------------------------------------------------------------------------


@app.command()
@reads_records(input=["voltage"], output=["speed"])
def study(
    reader: Any,
    out: Out = Path("emsid-study"),
    record: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Identify from this record instead of the virtual bench.")
    ] = None,
    verify: Annotated[Path | None, typer.Option(metavar="FILE", help="Verify on this record.")] = None,
    motor: Annotated[Path | None, typer.Option(metavar="TOML", help="Parameters of the motor to simulate.")] = None,
    step: Annotated[float, typer.Option(metavar="S", help="Sample time of the simulated records.")] = 0.005,
    duration: Annotated[float, typer.Option(metavar="S", help="Length of the simulated records.")] = 20.0,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the noise on the bench.", min=0)] = 1,
    forgetting: Annotated[float, typer.Option(metavar="FACTOR", help="Forgetting of recursive estimates.")] = 1.0,
    knots: Annotated[int, typer.Option(metavar="N", help="Hinges on either side of zero.", min=0)] = 12,
    transient: Transient = None,
) -> None:
    """The study of Kara and Abokoos, end to end, on a built-in motor; no data needed.

    Writes report.html, study.json and the figures as SVG and PDF. The options on columns and times are for --record
    and --verify.

    \b
    Examples:
      emsid study
      emsid study --motor motor.toml --seed 7 --out my-study
      emsid study --record a.csv --verify b.csv --input u --output y --dt 0.01
    """
    from emsid.io import read_motor
    from emsid.study import workflow as paper

    if (record is None) != (verify is None):
        raise DataError("--record and --verify belong together: one record to identify, another to verify")
    if record is None and (given := _given(reader, input=["voltage"], output=["speed"])):
        raise DataError(f"{', '.join(given)}: that is for reading --record and --verify, which are not given")
    _check_folder(out)
    settings = paper.Settings(
        dt=step, duration=duration, seed=seed, forgetting=forgetting, knots=knots, transient=transient
    )
    if motor is not None:
        settings = replace(settings, motor=read_motor(motor))
    records = None if record is None or verify is None else (reader(record), reader(verify))
    with progress_bar() as report_progress:
        result = paper.study(settings, records, report_progress)
    with _kept(result, "the study") as result:
        _write(out, {"study.json": result.to_data()})
        for part in result.parts:
            show(error_table(part.rows, f"{part.name} study"))
        print("\n".join(paper.findings(result)), flush=True)
    drawn = _draw(out, lambda: paper.report(result))
    _say_where(out, drawn, "study.json")
    if result.interrupted or not drawn:
        _end_interrupted()


@app.command()
@reads_records()
def identify(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Records to identify from.")],
    reader: Any,
    validate: Annotated[
        list[Path], typer.Option(metavar="FILE", help="Unseen record to rank on; repeat for more.")
    ] = [],  # noqa: B006
    models: Annotated[
        str | None,
        typer.Option(metavar="NAME,...", help="Candidates, by default the regressions and wiener-hammerstein."),
    ] = None,
    unseen: Annotated[
        float,
        typer.Option(
            metavar="FRACTION", help="Part kept unseen where nothing is --validate'd: the end, or some of many files."
        ),
    ] = 0.3,
    transient: Transient = None,
    na: Annotated[int | None, typer.Option(metavar="N", help="Coefficients of past outputs.", min=0)] = None,
    nb: Annotated[int | None, typer.Option(metavar="N", help="Coefficients of past inputs.", min=1)] = None,
    nk: Annotated[int | None, typer.Option(metavar="N", help="Delay in samples.", min=0)] = None,
    degree: Annotated[int | None, typer.Option(metavar="N", help="Degree of the polynomial.", min=1)] = None,
    taps: Annotated[int | None, typer.Option(metavar="N", help="Taps of the first filter.", min=1)] = None,
    knots: Annotated[
        int | None, typer.Option(metavar="N", help="Hinges on either side of zero; knots or degree of a map.", min=0)
    ] = None,
    orders: Annotated[
        str | None, typer.Option(metavar="N,...", help="Orders of the filters of a cascade of blocks.")
    ] = None,
    static: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Static map of a cascade, of those `emsid list` names; by default chosen."),
    ] = None,
    ridge: Annotated[float, typer.Option(metavar="WEIGHT", help="Weight of the squared parameters.", min=0)] = 0.0,
    forgetting: Annotated[
        float | None, typer.Option(metavar="FACTOR", help="Estimate recursively with this forgetting factor.")
    ] = None,
    fix: Annotated[
        list[str], typer.Option(metavar="NAME=X", help="A physical parameter that is known, in SI units.")
    ] = [],  # noqa: B006
    datasheet: Annotated[
        Path | None, typer.Option(metavar="TOML", help="What a datasheet says of the physical parameters.")
    ] = None,
    brake: Annotated[
        list[float],
        typer.Option(metavar="CODE", help="Value of the command, or of a second --input, with which a motor brakes."),
    ] = [],  # noqa: B006
    coast: Annotated[
        list[float], typer.Option(metavar="CODE", help="The same, with which its bridge is open and it coasts.")
    ] = [],  # noqa: B006
    free: Annotated[
        str | None,
        typer.Option(metavar="NAME,...", help="Physical parameters to estimate: these, without refinements."),
    ] = None,
    recent: Annotated[
        float | None,
        typer.Option(metavar="S", help="Forget what disturbed a physical model's free run after this time."),
    ] = None,
    profile: Annotated[
        str | None,
        typer.Option(metavar="NAME,...", help="Physical parameters to take a likelihood profile of."),
    ] = None,
    out: Out = Path("emsid-result"),
) -> None:
    """Fit candidate models to a record and rank them by their free run on unseen data.

    Orders, delay and knots that are not given are chosen on a part of the record held back for that. Writes
    report.html, result.json, a file for every model, and the figures as SVG and PDF.

    \b
    Examples:
      emsid identify log.csv --input voltage --output speed --dt 0.001
      emsid identify log.dat -u PWM -y mVel --dt 0.010048 --mask "abs(PWM) > 255" --validate other.dat
      emsid identify drives.csv -u u11 -y z11 --dt 0.02 --models wiener-hammerstein --static abs
      emsid identify log.csv -u voltage -y speed --time t --models rigid-motor --fix resistance=1.2
      emsid identify log.csv -u voltage -y speed --time t --models rigid-motor --profile voltage_dead_zone.half_width
      emsid identify arm.mat -u vir -y "d(qm)" --time t --scale vir=35.15065 --models friction-narx --knots 8
      emsid identify arm.csv -u force -y x --time t --models linear-axis --free mass,offset --datasheet arm.toml
    """
    from emsid.identification import candidates
    from emsid.identification import workflow as identification
    from emsid.io import read_datasheet
    from emsid.models.blocks.search.map_families import FAMILIES
    from emsid.models.plants.drive import Bridge
    from emsid.models.plants.search.result import GreyBoxFit

    if static is not None and static not in FAMILIES:
        raise DataError(f"no static map {static!r}; there are {', '.join(FAMILIES)}")
    options = candidates.Options(
        na=na,
        nb=nb,
        nk=nk,
        degree=degree,
        taps=taps,
        knots=knots,
        orders=_counts(orders, "--orders"),
        static=None if static is None else FAMILIES[static],
        ridge=ridge,
        forgetting=forgetting,
        fix=_numbers(fix, "--fix"),
        datasheet={} if datasheet is None else read_datasheet(datasheet),
        codes=(*((code, Bridge.BRAKE) for code in brake), *((code, Bridge.COAST) for code in coast)),
        free=_names(free, "--free"),
        recent=recent,
        profile=_names(profile, "--profile"),
    )
    asked = _names(models, "--models") or candidates.USUAL
    if not 0 < unseen < 1:
        raise DataError(f"--unseen {unseen:g}: give a fraction between 0 and 1")
    _check_folder(out)
    records, tests = [reader(path) for path in files], [reader(path) for path in validate]
    with progress_bar() as report_progress:
        result = identification.identify(
            records,
            tests or None,
            models=asked,
            options=options,
            transient=transient,
            unseen=unseen,
            progress=report_progress,
        )
    with _kept(result, "identification") as result:
        _write(out, {"result.json": result.to_data()}, result.verification.fits, result.record)
        title = f"on {result.judged_on} ({result.unseen.name})"
        show(error_table(result.verification.rows, title, result.unseen.output_units[0]))
        for fit in result.verification.fits:
            if isinstance(fit, GreyBoxFit):
                show(physical_table(fit))
        print(f"chosen: {result.chosen.model.name}")
        if not isinstance(result.chosen, GreyBoxFit):
            print(result.chosen.model.equation())
        print("\n".join(identification.remarks(result)), flush=True)
    drawn = _draw(out, lambda: identification.report(result))
    written = [f"{fit.model.name}.json" for fit in result.verification.fits]
    possible = [f"{name}.json" for name in candidates.CANDIDATES]
    _say_where(out, drawn, "result.json", *written, possible=possible)
    if result.interrupted or not drawn:
        _end_interrupted()


@app.command()
@reads_records()
def validate(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="A model file that emsid wrote.")],
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Records that the model has not seen.")],
    reader: Any,
    transient: Transient = None,
    horizon: Annotated[int, typer.Option(metavar="K", help="Also predict this many samples ahead.", min=1)] = 1,
) -> None:
    """Run a saved model over records and print its errors, free run first.

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
            print(f"{model}: {difference}")
        if horizon > 1:
            ahead = loaded.predict(record, horizon, transient)
            error = mean_squared_error(record.output[ahead.counted], ahead.output[ahead.counted])
            print(f"{horizon} samples ahead: MSE {error:.5g}")


@app.command()
def simulate(
    out: Annotated[Path, typer.Option(metavar="FILE", help="Where to write: .csv, .parquet or .npz.")],
    excitation: Annotated[str, typer.Option(metavar="NAME", help="Test signal; `emsid list` names them.")] = "sines",
    amplitude: Annotated[float, typer.Option(metavar="V", help="Largest voltage either way.")] = 6.0,
    duration: Annotated[float, typer.Option(metavar="S", help="Length of the record.")] = 10.0,
    dt: Annotated[float, typer.Option(metavar="S", help="Sample time.")] = 0.005,
    motor: Annotated[Path | None, typer.Option(metavar="TOML", help="Parameters of the motor.")] = None,
    ideal: Annotated[bool, typer.Option("--ideal", help="No noise, quantisation or delay of the bench.")] = False,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of signal and noise.", min=0)] = 1,
) -> None:
    """Drive a motor on the virtual bench and write the record to a file.

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
    print(f"{len(record)} samples, crest factor {crest_factor(voltage):.2f}, speed up to {top:.4g} rad/s")
    print(f"written to {out}: columns {time}, {', '.join(record.input_names + record.output_names)}")


@app.command()
@reads_records()
def describe(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Records.")],
    reader: Any,
    tolerance: Annotated[
        float,
        typer.Option(
            metavar="FRACTION",
            help="What counts as excitation: singular values of the lagged input above this fraction of the largest.",
        ),
    ] = 1e-3,
) -> None:
    """What a record holds: samples, segments, time axis, ranges, crest factor, order of persistent excitation.

    \b
    Example:
      emsid describe log.csv --input voltage --output speed --time t
    """
    from emsid.excitation import crest_factor, largest_order, persistent_excitation_order
    from emsid.units import with_unit

    for path in files:
        record = reader(path)
        order, largest = persistent_excitation_order(record, tolerance=tolerance), largest_order(record)
        crest = crest_factor(record)
        print(record)
        if record.time_axis is not None:
            print(f"  time column {reader.keywords['time']}: {record.time_axis}")
        for name, unit in zip(
            record.input_names + record.output_names, record.input_units + record.output_units, strict=True
        ):
            x = record.channel(name)
            span = with_unit(f"{x.min():.5g} … {x.max():.5g}", unit)
            print(f"  {name}: {span}, mean {x.mean():.5g}, deviation {x.std():.5g}")
        print(f"  input crest factor {crest:.2f}")
        counted = f"singular values of the lagged input above {tolerance:g} of the largest"
        print(f"  persistently exciting of order {f'at least {order}' if order == largest else order}, by {counted}")


@app.command()
def parameters(
    plant: Annotated[
        str | None, typer.Argument(metavar="[PLANT]", help="A datasheet of this kind: motor or linear-axis.")
    ] = None,
) -> None:
    """Print a motor as a TOML file to edit, or a datasheet, with every parameter, its unit and its meaning.

    \b
    Examples:
      emsid parameters > motor.toml            # for study --motor and simulate --motor
      emsid parameters motor > datasheet.toml  # for identify --datasheet
    """
    from emsid.io import datasheet_template, motor_template

    if plant is None:
        print(motor_template())
        return
    from emsid.models.plants.datasheet import KINDS

    if plant not in KINDS:
        raise DataError(f"no datasheet of {plant!r}; there are {', '.join(KINDS)}")
    print(datasheet_template(plant))


@app.command(name="list")
def list_() -> None:
    """Everything that has a name: candidate models, test signals, file formats."""
    from emsid.excitation import SIGNALS
    from emsid.identification.candidates import CANDIDATES
    from emsid.io import READERS, WRITERS
    from emsid.models.blocks.search.map_families import FAMILIES

    print("models for --models:")
    for name, candidate in CANDIDATES.items():
        print(f"  {name:<32}{candidate.summary}")
    print(f"static maps for --static: {', '.join(FAMILIES)}")
    print("signals for --excitation:")
    for name, test_signal in SIGNALS.items():
        print(f"  {name:<32}{test_signal.__doc__}")
    print(f"files read: {', '.join(READERS)}")
    print(f"files written: {', '.join(WRITERS)}")


# --- what is written -------------------------------------------------------------------------------------------------


def _check_folder(folder: Path) -> None:
    """Refuse a folder that cannot be written to before hours are spent on what goes there."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        raise DataError(f"--out {folder}: {there} is not a folder that can be written to; choose another")


def _write(folder: Path, documents: dict[str, Any], fits: Any = (), origin: Any = None) -> None:
    """Write JSON documents and model files into a folder."""
    import msgspec

    from emsid.io import atomic_write, save

    for fit in fits:
        save(fit.model, folder / f"{fit.model.name}.json", origin)
    for name, content in documents.items():  # last, as it tells of the others
        atomic_write(folder / name, msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n")


@contextmanager
def _kept(result: "Result", what: str) -> Iterator["Result"]:
    """The result, with whether it was interrupted, to be written and printed even if that is interrupted.

    Then Ctrl-C means what comes next: the drawing.
    """
    stopped = result.interrupted or INTERRUPTION.pressed
    INTERRUPTION.pressed = False
    with INTERRUPTION.put_off():
        yield replace(result, interrupted=stopped)
    INTERRUPTION.words = f"{what} was interrupted; what had been found by then is above and written"


def _draw(folder: Path, report: Callable[[], Any]) -> bool:
    """Write the report with its figures; false where Ctrl-C was pressed meanwhile."""
    try:
        INTERRUPTION.raise_again()
        from emsid.estimation.nonlinear.control import Control
        from emsid.report.page import write_report

        with progress_bar() as report_progress:
            write_report(report(), folder, Control(report=lambda a: report_progress(a.doing, a.done / (a.total or 1))))
    except BaseException as problem:
        if not (INTERRUPTION.pressed or isinstance(problem, KeyboardInterrupt)) or isinstance(problem, SystemExit):
            raise
        return False
    return True


def _say_where(folder: Path, drawn: bool, *names: str, possible: Iterable[str] = ()) -> None:
    """Where to look, and what in there is of another run."""
    report = ("report.html", "figures/") if drawn else ()
    print(f"written to {folder}/: {', '.join((*report[:1], *names, *report[1:]))}")
    old = [name for name in ("report.html", *possible) if name not in (*report, *names) and (folder / name).exists()]
    if old:
        print(f"from an earlier run, not from this one: {', '.join(old)}")
