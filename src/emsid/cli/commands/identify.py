"""``emsid identify``."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.imports import load_identification, load_reading, without_collection
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.options import (
    Details,
    Json,
    Out,
    Pdf,
    Transient,
    counts,
    fraction,
    names,
    option,
    physical_names,
    physical_values,
    quantity,
)
from emsid.cli.reading import reads_records
from emsid.cli.second_process import fits, is_possible, meanwhile
from emsid.cli.terminal import reader_may_leave, say_json, warn, working
from emsid.cli.writing import REPORT, as_json, attempted, check_folder, completed, draw, kept, say_where, write

if TYPE_CHECKING:
    from emsid.identification import Identification
    from emsid.identification.candidates import Physical
    from emsid.models.blocks.search.map_families import Family
    from emsid.models.plants.datasheet import Given
    from emsid.models.plants.drive import Bridge
    from emsid.record import Record

BEST = "best.json"
"""The file of the best model with its parameters from all data."""

Files = Annotated[
    list[Path],
    typer.Argument(metavar="FILE", help="Records; none where --output is FILE:COL.", show_default=False),
]
Validate = Annotated[list[Path], typer.Option(metavar="FILE", help="Unseen record to rank on; repeat for more.")]
Models = Annotated[
    list[str],
    typer.Option(
        metavar="NAME,...",
        help="Models to fit; by default regressions, a motor or axis, and blocks where these leave something.",
    ),
]
Quick = Annotated[bool, typer.Option("--quick", help="Fit linear models and regressions only, in seconds.")]
Budget = Annotated[
    float | None,
    typer.Option(
        metavar="S",
        parser=quantity("s"),
        help="Time for the whole command, such as 20s; without it there is no limit. Reading takes its part, and as "
        "much is kept for tables and page; each model gets its share of the rest, which is at least half.",
    ),
]
Unseen = Annotated[
    float,
    typer.Option(
        metavar="FRACTION",
        parser=fraction,
        help="Without --validate, keep this part unseen: the end, or some of many files.",
    ),
]
Na = Annotated[int | None, typer.Option(metavar="N", help="Coefficients of past outputs.", min=0)]
Nb = Annotated[int | None, typer.Option(metavar="N", help="Coefficients of past inputs.", min=1)]
Nk = Annotated[int | None, typer.Option(metavar="N", help="Delay in samples.", min=0)]
Degree = Annotated[int | None, typer.Option(metavar="N", help="Degree of the polynomial.", min=1)]
Taps = Annotated[int | None, typer.Option(metavar="N", help="Taps of the first filter.", min=1)]
Knots = Annotated[
    int | None, typer.Option(metavar="N", help="Hinges on each side of zero; knots or degree of a static map.", min=0)
]
Orders = Annotated[
    str | None, typer.Option(metavar="N,...", help="Orders of the filters of a cascade, or of a feedback model.")
]
Static = Annotated[
    str | None,
    typer.Option(
        metavar="NAME", help="Static map of a cascade or a feedback model (see `emsid list`); by default chosen."
    ),
]
Period = Annotated[
    int | None,
    typer.Option(metavar="N", help="Samples in a period of the input in steady state; 0: it has none.", min=0),
]
Ridge = Annotated[
    float, typer.Option(metavar="WEIGHT", help="Ridge regression: weight of the squared parameters.", min=0)
]
Forgetting = Annotated[
    float | None, typer.Option(metavar="FACTOR", help="Estimate recursively with this forgetting factor.")
]
Fix = Annotated[
    list[str], typer.Option(metavar="NAME=X", help="A known physical parameter, in SI units or as 'R=2 ohm ± 5 %'.")
]
Datasheet = Annotated[
    Path | None, typer.Option(metavar="TOML", help="Datasheet of the physical parameters (see `emsid parameters`).")
]
Brake = Annotated[
    list[float],
    typer.Option(metavar="CODE", help="Value of the input, or of a second --input, that makes the motor brake."),
]
Coast = Annotated[
    list[float], typer.Option(metavar="CODE", help="Value that opens the bridge, so that the motor coasts.")
]
Free = Annotated[
    list[str],
    typer.Option(metavar="NAME,...", help="Estimate exactly these physical parameters."),
]
PerRecord = Annotated[
    list[str],
    typer.Option(
        metavar="NAME,...", help="Physical parameters with another value in each record, such as rotor_inertia."
    ),
]
Recent = Annotated[
    float | None,
    typer.Option(
        metavar="S", parser=quantity("s"), help="Forget errors of a physical model's free run after this time."
    ),
]
HoldInput = Annotated[
    str | None,
    typer.Option(
        "--hold",
        metavar="zero|first|record",
        help="Input between the samples: zero (held), first (straight to the next), record (as each record shows).",
    ),
]
Average = Annotated[
    bool, typer.Option("--average", help="The speed is the mean over the sample before it, as an encoder counts it.")
]
Profile = Annotated[
    list[str],
    typer.Option(metavar="NAME,...", help="Compute likelihood profiles of these physical parameters."),
]

Bootstrap = Annotated[
    int, typer.Option(metavar="N", help="Intervals and bands from N fits to drawn pieces of the data.", min=0)
]
Seed = Annotated[int, typer.Option(metavar="N", help="Seed of the drawn pieces.", min=0)]


@app.command()
@reads_records()
def identify(
    reader: Any,
    files: Files = [],  # noqa: B006
    validate: Validate = [],  # noqa: B006
    models: Models = [],  # noqa: B006
    quick: Quick = False,
    budget: Budget = None,
    unseen: Unseen = 0.3,
    transient: Transient = None,
    na: Na = None,
    nb: Nb = None,
    nk: Nk = None,
    degree: Degree = None,
    taps: Taps = None,
    knots: Knots = None,
    orders: Orders = None,
    static: Static = None,
    period: Period = None,
    ridge: Ridge = 0.0,
    forgetting: Forgetting = None,
    fix: Fix = [],  # noqa: B006
    datasheet: Datasheet = None,
    brake: Brake = [],  # noqa: B006
    coast: Coast = [],  # noqa: B006
    free: Free = [],  # noqa: B006
    per_record: PerRecord = [],  # noqa: B006
    recent: Recent = None,
    hold: HoldInput = None,
    average: Average = False,
    profile: Profile = [],  # noqa: B006
    bootstrap: Bootstrap = 0,
    seed: Seed = 1,
    out: Out = Path("emsid-result"),
    details: Details = False,
    json: Json = False,
    pdf: Pdf = False,
) -> None:
    """Fit models to a record and rank them.

    Models are ranked by their free run (simulation from the input alone) on unseen data, to which no model was fitted.

    The program chooses orders, delay and knots that are not given. It writes report.html, result.json, a file for every
    model, and the figures as SVG. The best model is also in best.json, fitted again to all data if they are few.

    It prints at most 25 lines: which model, its error, what is known, what is not, what to do next; --details prints
    the rest.

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
    begun, asked = monotonic(), names(models, "--models")
    with without_collection():
        reader, files = reader.with_columns(files)
        read = _reading(reader, files, validate)
        load_identification()
        from emsid.identification import Options, candidates, workflow
    with without_collection():
        plants = [each.plant for each in physical_first(asked or candidates.USUAL)]
        options = Options(
            na=na, nb=nb, nk=nk, degree=degree, taps=taps, knots=knots, forgetting=forgetting,
            orders=counts(orders, "--orders"), static=_family(static), period=period, ridge=ridge, recent=recent,
            hold=hold, datasheet=_sheet(datasheet), codes=_codes(brake, coast),
            fixed=physical_values([*fix, *(["sensor.average=1"] if average else [])], plants),
            free=physical_names(free, "--free", plants),
            per_record=physical_names(per_record, "--per-record", plants),
            profile=physical_names(profile, "--profile", plants),
        )  # fmt: skip
        check_folder(out, "result.json", REPORT, BEST, *(f"{name}.json" for name in candidates.CANDIDATES))
        search = partial(workflow.identify, *_checked(*read(), unseen), models=asked or None, options=options)
        budget = None if budget is None else _for_searches(budget, monotonic() - begun)
    search = partial(search, transient=transient, quick=quick, budget=budget, bootstrap=bootstrap, seed=seed)
    _run(partial(search, elsewhere=fits if is_possible() else None), reader, out, json, pdf, details)


def _reading(
    reader: Any, files: Sequence[Path], validate: Sequence[Path]
) -> "Callable[[], tuple[list[Record], list[Record]]]":
    """A function that returns the result of `_read`, which a fork computes from now on if a core is free."""
    load_reading()
    return meanwhile(partial(_read, reader, files, validate))


def _read(reader: Any, files: Sequence[Path], validate: Sequence[Path]) -> "tuple[list[Record], list[Record]]":
    """The records and the unseen ones."""
    with without_collection():
        files = reader.files(files)
        records = reader.together([*files, *validate])
        return records[: len(files)], records[len(files) :]


def _checked(
    records: "list[Record]", tests: "list[Record]", unseen: float
) -> "tuple[list[Record], list[Record] | float]":
    """The records, and the unseen ones or the part to keep unseen.

    Unseen records with data of the fit are named now, before searches of minutes.
    """
    from emsid.findings import Finding
    from emsid.record.overlap import has_common_samples
    from emsid.wording import sentence

    for test in tests:
        if any(has_common_samples(test, record) for record in records):
            warn(sentence(Finding("data-not-unseen", test.name), option))
    return records, tests or unseen


def _for_searches(budget: float, spent: float) -> float:
    """The part of the time in s for the whole command that searches may take.

    What follows them takes about as long as imports and reading did, on any machine and under any load: both consist of
    Python, and of work on every sample.

    Args:
        budget: for the whole command.
        spent: before the searches.
    """
    return max(budget - 2 * spent, budget / 2) if budget > 0 else budget


def _run(
    search: "Callable[..., Identification]",
    reader: Any,
    out: Path,
    json: bool,
    pdf: bool,
    details: bool,
) -> None:
    """Identify, write and print the result, draw the report."""
    from emsid.cli.first_screen import first_screen
    from emsid.estimation.threads import one_blas_thread
    from emsid.identification import candidates
    from emsid.io import save
    from emsid.io.files import together
    from emsid.report.identification_page import report

    def save_best(result: "Identification") -> None:
        if result.is_usable:
            save(result.recommended_fit, out / BEST, result.fitted_by_recommended, reader.remembered)

    def write_all(result: "Identification", data: Any) -> None:
        with together():  # a defect in one costs that one only; a full disk leaves the older files
            problem = attempted(
                lambda: write(out, {"result.json": data}, result.fits, result.data_of, reader.remembered),
                lambda: save_best(result),
            )
        if problem is not None:
            raise problem

    with one_blas_thread():  # also of what follows from the models: beside other programs, threads wait for each other
        with working() as control:
            result = search(
                control=control,
                finished=lambda fit: attempted(lambda: write(out, {}, [fit], None, reader.remembered)),
            )
        result, data = completed(result)
        with kept(result, "identification") as result:
            unwritten = attempted(lambda: write_all(result, data))
            unshown = None
            with reader_may_leave():
                if json:
                    say_json(as_json(data))
                else:
                    unshown = attempted(lambda: first_screen(result, details))
        drawn = draw(out, lambda: report(result, option), pdf, interrupted=result.interrupted)
    if not json and unwritten is None:
        written = [*(f"{fit.model.name}.json" for fit in result.fits), *([BEST] * result.is_usable)]
        possible = [BEST, *(f"{name}.json" for name in candidates.CANDIDATES)]
        with reader_may_leave():
            say_where(out, drawn, "result.json", *written, possible=possible)
    for problem in filter(None, (unwritten, unshown)):
        raise problem
    INTERRUPTION.end(result.interrupted or not drawn)


def _sheet(path: Path | None) -> "dict[str, Given]":
    """The datasheet in a file, empty without one."""
    from emsid.io import read_datasheet

    return {} if path is None else read_datasheet(path)


def _codes(brake: Sequence[float], coast: Sequence[float]) -> "tuple[tuple[float, Bridge], ...]":
    """The values of the input that are no commands, with the state of the bridge."""
    from emsid.models.plants.drive import Bridge

    return (*((code, Bridge.BRAKE) for code in brake), *((code, Bridge.COAST) for code in coast))


def _family(static: str | None) -> "Family | None":
    from emsid.models.blocks.search.map_families import family_of

    return None if static is None else family_of(static)


def physical_first(asked: Sequence[str]) -> "list[Physical]":
    """The physical models, requested ones first. They define the names and units of parameters."""
    from emsid.identification.candidates import CANDIDATES, Physical

    physical = {name: candidate for name, candidate in CANDIDATES.items() if isinstance(candidate, Physical)}
    order = dict.fromkeys((*(name for name in asked if name in physical), *physical))
    return [physical[name] for name in order]
