"""``emsid track``.

The structure to track, from the command line: a name, a model file, or regressors as text.
"""

import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.live_view import view_of
from emsid.cli.options import Json, Out, Pdf, names, option, quantity
from emsid.cli.terminal import warn, working
from emsid.cli.writing import REPORT, as_json, attempted, check_folder, draw, say_where
from emsid.errors import DataError, EmsidError

if TYPE_CHECKING:
    from emsid.estimation import Rule
    from emsid.findings import Finding
    from emsid.live.log import Log
    from emsid.live.receiver import Receiver
    from emsid.live.session import Session, Settings
    from emsid.models.regression.narx import Structure
    from emsid.record import Record


ENDING = "ending; writing record and report"
MOST_RECORDS = 50
"""Write at most this many stretches of samples as records; the log has all."""

SourceName = Annotated[
    str, typer.Argument(metavar="SOURCE", help="A file, - (standard input), serial:///dev/ttyACM0, socket://host:port.")
]
StructureName = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE|TEXT",
        help="arx (the default without --state), friction-narx, polynomial-narx, wiener-hammerstein-regression, a "
        "regression model, or regressors.",
    ),
]
Count = Annotated[int | None, typer.Option(metavar="N", min=0)]
Forgetting = Annotated[float | None, typer.Option(metavar="FACTOR", help="Forgetting factor, up to 1.")]
RuleName = Annotated[
    str, typer.Option(metavar="NAME", help="directional, forgetting, drift, window, gradient or frozen.")
]
Rate = Annotated[
    float | None, typer.Option(metavar="X", help="Variance of the drift, length of the window, step of the gradient.")
]
FalseAlarm = Annotated[
    float,
    typer.Option(metavar="S", parser=quantity("s"), help="Mean time between false alarms of changes; 0 for no alarms."),
]
ModelFile = Annotated[
    Path | None, typer.Option("--model", metavar="FILE", help="A saved model to run freely beside the estimate.")
]
StateFile = Annotated[
    Path | None,
    typer.Option(
        "--state", metavar="FILE", help="Go on from the state.json of an earlier tracking, with its structure."
    ),
]
Header = Annotated[str, typer.Option(metavar="NAMES", help="Columns of a source without header: t[ms],u[V],y[rpm].")]
InputColumns = Annotated[list[str], typer.Option("--input", "-u", metavar="COL,...", help="Input columns.")]
OutputColumn = Annotated[str, typer.Option("--output", "-y", metavar="COL", help="Output column.")]
TimeColumn = Annotated[str, typer.Option("--time", metavar="COL", help="Time column, unless it is named t or time.")]
Baud = Annotated[int, typer.Option(metavar="N", help="Bits per second of a serial port.", min=50)]
Dt = Annotated[
    float | None, typer.Option(metavar="S", parser=quantity("s"), help="Sample time, without a time column.")
]
Every = Annotated[float, typer.Option(metavar="S", parser=quantity("s"), help="Time between two shown estimates.")]
Duration = Annotated[
    float | None, typer.Option(metavar="S", parser=quantity("s"), help="End after this much time of samples.")
]
Reconnect = Annotated[
    float,
    typer.Option(metavar="S", parser=quantity("s"), help="Time in which a connection that broke may come back."),
]
Patience = Annotated[
    float | None,
    typer.Option(
        metavar="S",
        parser=quantity("s"),
        help="Give up if no sample comes in this time.  [default: wait]",
    ),
]


@app.command()
def track(
    source: SourceName,
    structure: StructureName = None,
    na: Count = None,
    nb: Count = None,
    nk: Count = None,
    degree: Count = None,
    knots: Annotated[str | None, typer.Option(metavar="U,...", help="Knots of hinges, in the input's unit.")] = None,
    forgetting: Forgetting = None,
    rule: RuleName = "directional",
    rate: Rate = None,
    false_alarm: FalseAlarm = 3600.0,
    announce_only: Annotated[bool, typer.Option("--announce-only", help="Do not adapt faster after a change.")] = False,
    model: ModelFile = None,
    state: StateFile = None,
    header: Header = "",
    input: InputColumns = [],  # noqa: B006
    output: OutputColumn = "",
    time: TimeColumn = "",
    baud: Baud = 115200,
    dt: Dt = None,
    every: Every = 0.2,
    duration: Duration = None,
    patience: Patience = None,
    reconnect: Reconnect = 30.0,
    out: Out = Path("emsid-track"),
    json: Json = False,
    pdf: Pdf = False,
) -> None:
    """Track the parameters of a motor while it runs.

    Waits until the source speaks; then shows input, output, one-step prediction, parameters with 95 % intervals and
    physical values, announces changes of the load, and ends with the source, after --duration, or with Ctrl-C or
    SIGTERM. A connection that breaks may come back within --reconnect. Every received line is in log.txt within a
    second. Writes record.csv, report.html, track.json, the model, and state.json to go on from.

    \b
    Examples:
      emsid track serial:///dev/ttyACM0 --structure friction-narx --na 1 --nb 1
      emsid track socket://localhost:7000 --forgetting 0.995 --duration 60
      emsid track log.csv --structure result/arx.json
      cat log.csv | emsid track - --json
    """
    check_folder(out, "track.json", REPORT, "state.json", "record.csv")
    columns = names(input, "--input")
    orders = {"na": na, "nb": nb, "nk": nk, "degree": degree}
    if structure is None and state is not None and not knots and set(orders.values()) == {None}:
        from emsid.io.state_file import load_structure

        made = load_structure(state)
    else:
        made = structure_of(structure or "arx", orders, knots, max(len(columns), 1))
    adaptation = _rule(rule, forgetting, rate)
    from emsid.live.session import Settings

    reading = {"header": header, "inputs": columns, "output": output, "time": time}
    settings = Settings(every, duration, patience, dt, false_alarm)
    session = _session(source, made, adaptation, not announce_only, model)
    begun = None
    if state is not None:
        from emsid.io.state_file import load_state

        begun = load_state(state, made)
    if not reconnect >= 0:
        raise DataError(f"reconnect of {reconnect:g} s; give a time, or 0", arguments=("reconnect",))
    received = partial(_received, baud=baud, away=reconnect, patience=patience)
    files, problem = _followed(session, settings, reading, begun, received, out, json)
    drawn = () if session.tracking is None else _drawn(session, out, pdf)  # None: stopped before the first sample
    if not json and session.tracking is not None:
        say_where(out, drawn, *files)
    if problem is not None:
        raise problem
    stopped = session.reason == "stopped" and "log.txt" not in files  # a source that is logged has no other end
    if stopped and drawn:
        INTERRUPTION.words = "tracking was interrupted; the results so far are written"
    INTERRUPTION.end(stopped or not drawn)


def _session(source: str, structure: "Structure", rule: "Rule", adapts: bool, model: Path | None) -> "Session":
    """A session that has not begun."""
    from emsid.estimation import RecursiveLeastSquares
    from emsid.live.session import Session
    from emsid.live.tracking import Tracker

    fixed = None
    if model is not None:
        from emsid.io import load_model

        fixed = load_model(model)
    return Session(Tracker(RecursiveLeastSquares(structure, rule=rule), None, adapts, fixed), source)


def _received(
    session: "Session", out: Path, prepare: "Callable[[], None]", baud: int, away: float, patience: float | None
) -> "Receiver":
    """Open the source of a session, and receive it.

    Args:
        session: to be tracked; it gets the name of the source.
        out: the folder of the log.
        prepare: what takes long; a file that is not there is refused before it, and a board is opened after it.
        baud: of a serial port.
        away: seconds in which a connection that broke may come back.
        patience: seconds to wait for a port that nothing serves yet; None to wait until one does.
    """
    from emsid.live.log import Log
    from emsid.live.receiver import Receiver
    from emsid.live.sources import awaited, connect, is_connection, open_source

    source = session.name
    again = partial(connect, source, baud) if is_connection(source) else None
    opened = open_source(source) if again is None else None
    name, is_own = Path(source).name, Path(source).resolve().parent == out.resolve()
    if opened is not None and opened.lasting and is_own and re.fullmatch(r"record(-\d+)?\.csv", name):
        raise DataError(f"{out / name}: the record of this tracking would replace its source", arguments=("out",))
    prepare()
    opened = opened or awaited(partial(connect, source, baud), patience, warn)
    session.name = opened.name
    return Receiver(opened, None if opened.lasting else Log(out / "log.txt"), again, away=away)


def _followed(
    session: "Session",
    settings: "Settings",
    reading: dict[str, Any],
    begun: Any,
    received: "Callable[..., Receiver]",
    out: Path,
    json: bool,
) -> tuple[list[str], EmsidError | None]:
    """Track until the end, show it, and write everything but the report; the names of the files, and what failed."""
    from emsid.estimation import Control
    from emsid.estimation.borders import border, collected
    from emsid.live.protocol import LineParser
    from emsid.live.session import messages
    from emsid.live.sources import is_connection, read_log

    implies = not is_connection(session.name)
    receiver = received(session, out, partial(_compile, session, settings, max(len(reading["inputs"]), 1)))
    log, parser = receiver.log, LineParser(**reading)
    parser.implies, control = implies, Control(cancelled=lambda: INTERRUPTION.pressed)
    problems: list[EmsidError] = []
    with collected() as noted:
        try:
            with (
                border("tracking", report=problems.append, passing=OSError),
                view_of(json, option) as view,
                INTERRUPTION.asked(ENDING, view.notify, by_sigterm=True),
            ):
                for message in messages(session, receiver, parser, settings, log, control, begun):
                    with border("view of the tracking", passing=OSError):
                        view.show(message)
        finally:
            INTERRUPTION.pressed = False
            with INTERRUPTION.put_off():
                receiver.close()
                read = partial(read_log, **reading, dt=settings.dt, whole=log is None, columns=parser.columns)
                written, unwritten = _written(session, log, read, out, noted)
    return written, next(filter(None, (*problems, unwritten)), None)


def _compile(session: "Session", settings: "Settings", inputs: int) -> None:
    """Compile what the session needs, which takes half a minute once on a machine; Ctrl-C ends the command."""
    from emsid.estimation.nonlinear.compilation import cancelled_with
    from emsid.live.rehearsal import rehearse

    with working("ending; nothing was opened") as control, cancelled_with(control):
        control.doing("preparing; the first time on a machine it takes half a minute")
        rehearse(session.tracker, inputs, detects=settings.false_alarm > 0)
        control.check()


def _drawn(session: "Session", out: Path, pdf: bool) -> tuple[str, ...]:
    """Draw the report: its files; none if Ctrl-C was pressed meanwhile."""
    from emsid.report.tracking_page import tracking_report

    INTERRUPTION.words = "drawing the report was interrupted; everything else is written"
    return draw(out, lambda: tracking_report(session), pdf)


def _rule(name: str, forgetting: float | None, rate: float | None) -> "Rule":
    """The rule of adaptation.

    Raises:
        DataError: for an unknown rule, or a number that it does not use.
    """
    from emsid.estimation import Directional, Drift, Forgetting, Frozen, Gradient, Window

    factors: dict[str, Any] = {"directional": Directional, "forgetting": Forgetting}
    rates: dict[str, Any] = {"drift": Drift, "gradient": Gradient, "window": lambda samples: Window(int(samples))}
    if name not in (*factors, *rates, "frozen"):
        raise DataError(f"no rule {name!r}; there are {', '.join((*factors, *rates, 'frozen'))}", arguments=("rule",))
    if forgetting is not None and name not in factors:
        raise DataError(f"the rule {name} has no forgetting factor", arguments=("rule", "forgetting"))
    if rate is not None and name not in rates:
        raise DataError(f"the rule {name} does not use a rate", arguments=("rule", "rate"))
    if name in factors:
        rule: Rule = factors[name](USUAL if forgetting is None else forgetting)
        return rule
    if name == "window" and rate is None:
        raise DataError("the rule window needs its length in samples", arguments=("rate",))
    return Frozen() if name == "frozen" else rates[name](*(() if rate is None else (rate,)))


USUAL = 0.995
"""The forgetting factor that is not given."""


def _written(
    session: "Session", log: "Log | None", read: "Callable[..., Record]", out: Path, noted: "list[Finding]"
) -> tuple[list[str], EmsidError | None]:
    """Close the log and write the record, the result, the model and the state; the names of the files, and what failed.

    A session without a sample leaves its log only.

    Args:
        session: what was tracked.
        log: of the source; None for a file, which is its own log.
        read: reads the record from the log.
        out: the folder.
        noted: findings about parts that failed, which the session gets.
    """
    from emsid.estimation.borders import tried
    from emsid.io import atomic_write, save, write_record
    from emsid.io.files import together
    from emsid.io.state_file import save_state

    if log is not None:
        log.close()
    fit, tracking = session.fit, session.tracking
    if fit is None or tracking is None:
        return [], None

    def read_again() -> "Record":
        record = read(session.name if log is None else log.path, 0 if log is None else log.begin)
        return record[: session.counts["samples"]] if log is None else record

    record = tried("record of the tracking", read_again, None)
    segments = [] if record is None else sorted(record.segments, key=len, reverse=True)[:MOST_RECORDS]
    segments.sort(key=lambda segment: segment.times)
    session.findings += noted
    works: dict[str, Callable[[], object]] = {
        name: partial(write_record, segment, out / name)
        for k, segment in enumerate(segments, 1)
        for name in ["record.csv" if len(segments) == 1 else f"record-{k}.csv"]
    }
    works["track.json"] = lambda: atomic_write(out / "track.json", as_json(session.to_data()))
    works["state.json"] = lambda: save_state(tracking.state, fit.model.structure, out / "state.json")
    works[f"{fit.model.name}.json"] = lambda: save(fit, out / f"{fit.model.name}.json", record)
    problems = dict[str, EmsidError | None]()

    def write_all() -> None:
        with together():
            problems.update((name, attempted(work)) for name, work in works.items())

    full = attempted(write_all)
    if full is not None:
        return [] if log is None else ["log.txt"], full
    files = [name for name, problem in problems.items() if problem is None]
    problem = next(filter(None, problems.values()), None)
    return [*files, *([] if log is None else ["log.txt"])], problem


ORDERS = {"na": 1, "nb": 1, "nk": 1, "degree": 2}
"""Orders that are not given: those of a motor whose speed has one time constant."""
USES = {
    "arx": ("na", "nb", "nk"),
    "friction-narx": ("na", "nb", "nk", "knots"),
    "wiener-hammerstein-regression": ("na", "nb", "nk", "degree"),
    "polynomial-narx": ("na", "nb", "nk", "degree"),
}
"""The structures with a name, and the options that each of them uses."""


def structure_of(text: str, orders: Mapping[str, int | None], knots: str | None, inputs: int = 1) -> "Structure":
    """A structure by name, from a model file, or from regressors such as ``y(t-1); u(t-1); sign(y(t-1))``.

    Args:
        text: the name, the path or the regressors.
        orders: na, nb, nk and degree, for a name.
        knots: of the hinges of friction-narx, with commas between.
        inputs: number of input columns.

    Raises:
        DataError: for a text that is none of them, or options that it does not use.
    """
    given = {name: value for name, value in orders.items() if value is not None}
    unused = [name for name in (*given, *(("knots",) if knots else ())) if name not in USES.get(text, ())]
    if unused:
        raise DataError(f"the structure {text[:40]} does not use {', '.join(unused)}; leave them out", arguments=unused)
    if text in USES:
        return _by_name(text, ORDERS | given, knots, inputs)
    if "(t" in text or ";" in text:
        from emsid.models.regression.narx import Structure

        return Structure.parse(*(part.strip() for part in text.split(";") if part.strip()), name="tracked")
    if Path(text).suffix == ".json":
        return _in_file(text)
    raise DataError(
        f"structure {text[:80]!r}: name {', '.join(USES)}, a model file, or regressors such as "
        "'y(t-1); u(t-1); sign(y(t-1))'"
    )


def _by_name(name: str, orders: Mapping[str, int], knots: str | None, inputs: int) -> "Structure":
    """One of the structures of `USES`.

    Raises:
        DataError: for several inputs where it has one.
    """
    from emsid.models.regression.structures import arx, friction_narx, polynomial_narx, wiener_hammerstein_regression

    na, nb, nk, degree = (orders[each] for each in ("na", "nb", "nk", "degree"))
    made: dict[str, Callable[[], Structure]] = {
        "arx": lambda: arx(na, nb, nk, inputs),
        "friction-narx": lambda: friction_narx(na, nb, knots=_numbers(knots), nk=nk),
        "wiener-hammerstein-regression": lambda: wiener_hammerstein_regression(na, nb, degree, nk=nk),
        "polynomial-narx": lambda: polynomial_narx(na, nb, degree, nk, inputs),
    }
    structure = made[name]()
    if inputs > structure.inputs:
        raise DataError(
            f"the structure {name} has one input and {inputs} are named; name one, or use arx or polynomial-narx",
            arguments=("input", "structure"),
        )
    return structure


def _in_file(path: str) -> "Structure":
    """The structure of a saved regression.

    Raises:
        DataError: for another kind of model.
    """
    from emsid.io import load_model
    from emsid.models.kinds import capabilities_of

    model: Any = load_model(path)
    if not capabilities_of(model).linear_in_parameters:
        raise DataError(f"{path}: a {model.name} is not linear in its parameters; name a regression")
    structure: Structure = model.structure
    return structure


def _numbers(text: str | None) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(",")) if text else ()
    except ValueError:
        raise DataError(f"knots {text!r}: write them as numbers with commas between", arguments=("knots",)) from None
