"""``emsid identify``."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.options import Details, Json, Out, Pdf, Rare, option, takes
from emsid.cli.reading import reads_records
from emsid.cli.second_process import fits, is_possible, load_identification, load_reading, meanwhile, without_collection
from emsid.cli.terminal import reader_may_leave, say_json, warn, working
from emsid.cli.writing import REPORT, as_json, attempted, check_folder, completed, draw, kept, say_where, write
from emsid.options import DECLARED, IDENTIFY, KEYWORDS

if TYPE_CHECKING:
    from emsid.identification import Identification
    from emsid.models.plants.datasheet import Given
    from emsid.models.plants.drive import Bridge
    from emsid.record import Record

BEST = "best.json"
"""The file of the best model with its parameters from all data."""

Files = Annotated[
    list[Path],
    typer.Argument(metavar="FILE", help="Records; none where --output is FILE:COL.", show_default=False),
]
Validate = Annotated[
    list[Path],
    typer.Option(
        metavar="FILE", help="Unseen record to rank on; repeat for more.", rich_help_panel=DECLARED["models"].group
    ),
]
PHYSICAL = Rare(DECLARED["fixed"].group)
Brake = Annotated[
    list[float],
    typer.Option(
        metavar="CODE",
        help="Value of the input, or of a second --input, that makes the motor brake.",
        rich_help_panel=PHYSICAL,
    ),
]
Coast = Annotated[
    list[float],
    typer.Option(
        metavar="CODE", help="Value that opens the bridge, so that the motor coasts.", rich_help_panel=PHYSICAL
    ),
]
Average = Annotated[
    bool,
    typer.Option(
        "--average",
        help="The speed is the mean over the sample before it, as an encoder counts it.",
        rich_help_panel=PHYSICAL,
    ),
]


@app.command()
@reads_records()
@takes(IDENTIFY, "given")
def identify(
    reader: Any,
    given: dict[str, Any],
    files: Files = [],  # noqa: B006
    validate: Validate = [],  # noqa: B006
    brake: Brake = [],  # noqa: B006
    coast: Coast = [],  # noqa: B006
    average: Average = False,
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
    begun = monotonic()
    with without_collection():
        reader, files = reader.with_columns(files)
        read = _reading(reader, files, validate)
        load_identification()
        from emsid.identification import Options, candidates, workflow
    with without_collection():
        fixed = given.pop("fixed", {}) | ({"sensor.average": "1"} if average else {})
        options = Options(
            fixed=fixed, datasheet=_sheet(given.pop("datasheet", None)), codes=_codes(brake, coast),
            **{name: given.pop(name) for name in KEYWORDS & given.keys()},
        )  # fmt: skip
        check_folder(out, "result.json", REPORT, BEST, *(f"{name}.json" for name in candidates.CANDIDATES))
        data = _checked(*read(), given.pop("unseen", DECLARED["unseen"].default))
        if "budget" in given:
            given["budget"] = _for_searches(given["budget"], monotonic() - begun)
    search = partial(workflow.identify, *data, options=options, elsewhere=fits if is_possible() else None, **given)
    _run(search, reader, out, json, pdf, details)


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
    from emsid.record.holding_back import has_common_samples
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
