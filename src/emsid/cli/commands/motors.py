"""``emsid motors``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.options import Json, names, pairs
from emsid.cli.terminal import say, say_json
from emsid.cli.writing import as_json
from emsid.errors import DataError, listed

if TYPE_CHECKING:
    from emsid.io.motor_library import Actuator

Add = Annotated[list[str], typer.Option("--add", metavar="NAME=MODEL", help="Add a model file under this name.")]
Records = Annotated[
    list[Path], typer.Option("--record", metavar="FILE", help="A file that it was identified from; may be repeated.")
]
Command = Annotated[str, typer.Option("--command", metavar="TEXT", help="The command line that identified it.")]
Compare = Annotated[
    list[str], typer.Option("--compare", metavar="NAME,NAME,...", help="Show these side by side, with intervals.")
]
Check = Annotated[
    list[str],
    typer.Option(
        "--check", metavar="NAME=MODEL", help="Compare a model that its command gave again, from its --record files."
    ),
]
SAME = 1e-6
"""Values that differ by a smaller part of themselves are the same: processors round differently."""


@app.command()
def motors(
    library: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of the library.")],
    add: Add = [],  # noqa: B006
    record: Records = [],  # noqa: B006
    command: Command = "",
    compare: Compare = [],  # noqa: B006
    check: Check = [],  # noqa: B006
    force: Annotated[bool, typer.Option("--force", help="Replace an actuator, or another file, of this name.")] = False,
    json: Json = False,
) -> None:
    """Keep identified actuators as data: list, add, compare, check.

    Of every actuator the library has its model file, the checksums of its records and the command line that identified
    it, so that a published value can be found again.

    \b
    Examples:
      emsid motors servos
      emsid motors servos --add mx64=result/joint.json --record lift.csv --record swing.csv --command "emsid identify …"
      emsid motors servos --compare mx64,mx106
      emsid motors servos --check mx64=again/joint.json --record lift.csv --record swing.csv
    """
    from emsid.io.motor_library import actuators, add_actuator, model_of

    if add:
        added = pairs(add, "--add", "NAME=MODEL")
        if len(added) > 1:
            raise DataError("--add takes one model at a time, as each has its own records")
        if not command:
            raise DataError("--add needs --command, the command line that identified the model")
        for name, model in added.items():
            add_actuator(library, name, model, record, command, force=force)
    if check:
        for name, model in pairs(check, "--check", "NAME=MODEL").items():
            _check(library, name, Path(model), record)
        return
    known = actuators(library)
    values = {name: _values(library, name) for name in (names(compare, "--compare") or known)}
    if json:
        data = {
            name: {**_about(known[name]), "parameters": rows, "assumed": _assumed(model_of(library, name))[0]}
            for name, rows in values.items()
        }
        say_json(as_json({"schema": 1, "motors": data}))
        return
    said = {name: _assumed(model_of(library, name))[1] for name in values}
    if compare:
        _side_by_side(values)
        say(*(f"{name}: {line}" for name, lines in said.items() for line in lines))
        return
    for name, entry in known.items():
        say(f"{name}: {', '.join(each.file for each in entry.records)}")
        say(f"  {entry.command}")
        for parameter, (value, low, high, unit) in values[name].items():
            say(f"  {parameter:<34}{_text(value, low, high)} {unit}".rstrip())
        say(*(f"  {line}" for line in said[name]))
    if not known:
        say(f"{library} has no actuators")


def _about(entry: "Actuator") -> dict[str, Any]:
    records = [{"file": record.file, "sha256": record.sha256} for record in entry.records]
    return {"model_sha256": entry.model_sha256, "records": records, "command": entry.command}


def _check(library: Path, name: str, model: Path, records: list[Path]) -> None:
    """Say whether the records are those of an actuator and a model has its values.

    Raises:
        DataError: for another record, values that differ, or an actuator without values.
    """
    from emsid.io.motor_library import check_records, model_of

    for entry in check_records(library, name, records):
        say(f"{entry.file}: the record of {name}")
    published, again = _values(library, name), _values_of(model)
    if model.samefile(model_of(library, name)):
        raise DataError(f"{model} is the model of {name} itself, so there is nothing to compare; name one found again")
    if not published:
        raise DataError(f"{name} has no estimated parameters, so there is nothing to compare")
    differing = []
    for parameter, (value, low, high, unit) in published.items():
        found = again.get(parameter, (float("nan"),))[0]
        same = abs(found - value) <= SAME * abs(value)
        verdict = "same" if same else "within its interval" if low <= found <= high else "differs"
        differing += [parameter] if verdict == "differs" else []
        say(f"  {parameter:<34}{_text(value, low, high)} {unit}; again {found:.5g}: {verdict}")
    assumed = {what: _assumed(path)[1] for what, path in (("published", model_of(library, name)), ("again", model))}
    say(*(f"  {what}: {line}" for what, lines in assumed.items() for line in lines))
    if differing:
        raise DataError(f"{model} has other values than {name}: {listed(differing)}")


def _values(library: Path, name: str) -> dict[str, tuple[float, float, float, str]]:
    """Value, interval and unit of every estimated parameter of an actuator; NaN where there is no interval."""
    from emsid.io.motor_library import model_of

    return _values_of(model_of(library, name))


def _values_of(model: Path) -> dict[str, tuple[float, float, float, str]]:
    """The same of a model file."""
    from emsid.estimation.fit import Fit
    from emsid.io import load
    from emsid.units import plain_unit

    fit: Any = load(model)
    rows = fit.table if isinstance(fit, Fit) else ()
    found = {}
    for row in rows:
        low, high = row.interval or (float("nan"), float("nan"))
        found[row.name] = (float(row.value), float(low), float(high), plain_unit(row.unit))
    return found


def _assumed(model: Path) -> tuple[list[str], list[str]]:
    """The parameters of a model file whose values nobody gave or measured, and sentences about them."""
    from emsid.estimation.fit import Fit
    from emsid.exports.assumptions import assumed, sentences
    from emsid.io import load

    loaded: Any = load(model)
    if not isinstance(loaded, Fit):
        return [], ["the sources of its values are not known: the model was saved without its fit."]
    return [row.name for row in assumed(loaded)], sentences(loaded)


def _text(value: float, low: float, high: float) -> str:
    return f"{value:.5g}" + (f"  [{low:.5g}, {high:.5g}]" if low == low else "")


def _side_by_side(values: dict[str, dict[str, tuple[float, float, float, str]]]) -> None:
    """A row for every parameter, and whether its intervals have a value in common."""
    every = dict.fromkeys(parameter for rows in values.values() for parameter in rows)
    table = [["", *values, "intervals"]]
    for parameter in every:
        cells = [rows.get(parameter) for rows in values.values()]
        there = [cell for cell in cells if cell is not None and cell[1] == cell[1]]
        verdict = ""
        if len(there) == len(values):
            verdict = "overlap" if max(c[1] for c in there) <= min(c[2] for c in there) else "differ"
        texts = ["" if cell is None else f"{_text(*cell[:3])} {cell[3]}".rstrip() for cell in cells]
        table.append([parameter, *texts, verdict])
    widths = [2 + max(map(len, column)) for column in zip(*table, strict=True)]
    for row in table:
        say("".join(f"{text:<{width}}" for text, width in zip(row, widths, strict=True)).rstrip())
