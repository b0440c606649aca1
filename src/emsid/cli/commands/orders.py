"""``emsid orders``."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.options import Json, option
from emsid.cli.reading import reads_records
from emsid.cli.terminal import Align, plain_table, say, say_json, show, working
from emsid.cli.writing import as_json
from emsid.errors import DataError

if TYPE_CHECKING:
    from emsid.models.regression.search.orders import OrderRow

MOST_ROWS = 20
"""At most this many structures are printed; the JSON has all."""
HIGHEST = 1000
"""The largest order or delay that can be asked for."""


def _grid(what: str) -> Any:
    return typer.Option(metavar="N,M or N-M", help=f"{what}: numbers to try.")


@app.command()
@reads_records()
def orders(
    reader: Any,
    files: Annotated[list[Path], typer.Argument(metavar="FILE", help="Records; several are joined.")],
    na: Annotated[str, _grid("Coefficients of past outputs")] = "1-4",
    nb: Annotated[str, _grid("Coefficients of past inputs")] = "1-4",
    nk: Annotated[str, _grid("Delay in samples")] = "0-3",
    unseen: Annotated[
        float, typer.Option(metavar="FRACTION", help="Part of the record that the free run is judged on.")
    ] = 0.25,
    json: Json = False,
) -> None:
    """Compare all orders and delays of a linear model (ARX).

    Each is fitted with and without a constant, all from one triangular factor. The table has the free run on unseen
    data and the criteria AIC, BIC and FPE, the smallest free-run error first.

    \b
    Examples:
      emsid orders log.csv --input voltage --output speed --dt 10ms
      emsid orders log.csv -u voltage -y speed --time t --na 1-6 --nb 1,2,4 --nk 1
    """
    from emsid.estimation.nonlinear.compilation import cancelled_with
    from emsid.identification.task import as_one
    from emsid.models.regression.search.orders import order_grid

    grid = {name: numbers(text, option(name)) for name, text in (("na", na), ("nb", nb), ("nk", nk))}
    if not 0 < unseen < 1:
        raise DataError(f"{option('unseen')} {unseen:g}: give a fraction between 0 and 1")
    record = as_one(reader.together(reader.files(files)))
    with working() as control, cancelled_with(control):
        found = order_grid(record, na=grid["na"], nb=grid["nb"], nk=grid["nk"], unseen=unseen, control=control)
    best = {name: found.best(name) for name in ("free_run", "bic", "aic", "fpe")}
    if json:
        rows = [asdict(row) for row in found.rows]
        chosen = {name: asdict(row) for name, row in {"simplest": found.simplest, **best}.items()}
        say_json(as_json({"schema": 1, "record": record.name, "rows": rows, "best": chosen}))
        return
    ordered = sorted(found.rows, key=lambda row: row.free_run)
    headings: dict[str, Align] = dict.fromkeys(
        ("na", "nb", "nk", "constant", "p", "free-run RMSE", "FPE", "AIC", "BIC"), "right"
    )
    first = ordered[:MOST_ROWS]
    show(plain_table(f"{len(ordered)} structures of ARX on {record.name}", headings, [_line(row) for row in first]))
    say(f"simplest within noise of the best free run: {_named(found.simplest)}")
    said = (("free run", "free_run"), ("BIC", "bic"), ("AIC", "aic"), ("FPE", "fpe"))
    say("smallest " + "; ".join(f"{title}: {_named(best[name])}" for title, name in said))


def numbers(text: str, name: str) -> tuple[int, ...]:
    """Whole numbers of ``1,2,4``, ``1-4`` or ``1-3,6``.

    Raises:
        DataError: for anything else.
    """
    found: list[int] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        try:
            low, high = int(first), int(last if dash else first)
        except ValueError:
            low, high = 0, -1
        if not 0 <= low <= high <= HIGHEST:
            raise DataError(f"{name} {text!r}: write whole numbers with commas between, or a range such as 1-4")
        found += range(low, high + 1)
    return tuple(sorted(set(found)))


def _named(row: "OrderRow") -> str:
    constant = " with a constant" if row.constant else ""
    return f"na = {row.na}, nb = {row.nb}, nk = {row.nk}{constant} ({row.parameters} parameters)"


def _line(row: "OrderRow") -> tuple[str, ...]:
    return (
        str(row.na),
        str(row.nb),
        str(row.nk),
        "yes" if row.constant else "no",
        str(row.parameters),
        f"{row.free_run**0.5:.5g}",
        f"{row.fpe:.5g}",
        f"{row.aic:.1f}",
        f"{row.bic:.1f}",
    )
