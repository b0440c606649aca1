"""The structure to track, from the command line: a name, a model file, or regressors as text."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from emsid.errors import DataError

if TYPE_CHECKING:
    from emsid.models.regression.narx import Structure

ORDERS = {"na": 1, "nb": 1, "nk": 1, "degree": 2}
"""Orders that are not given: those of a motor whose speed has one time constant."""


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
    from emsid.models.regression.narx import Narx, Structure
    from emsid.models.regression.structures import arx, friction_narx, polynomial_narx, wiener_hammerstein_regression

    given = {name: value for name, value in orders.items() if value is not None}
    chosen = ORDERS | given
    uses = {
        "arx": ("na", "nb", "nk"),
        "friction-narx": ("na", "nb", "nk", "knots"),
        "wiener-hammerstein-regression": ("na", "nb", "nk", "degree"),
        "polynomial-narx": ("na", "nb", "nk", "degree"),
    }
    unused = [name for name in (*given, *(("knots",) if knots else ())) if name not in uses.get(text, ())]
    if unused:
        raise DataError(f"the structure {text[:40]} does not use {', '.join(unused)}; leave them out", arguments=unused)
    made: dict[str, Callable[[], Structure]] = {
        "arx": lambda: arx(chosen["na"], chosen["nb"], chosen["nk"], inputs),
        "friction-narx": lambda: friction_narx(chosen["na"], chosen["nb"], knots=_numbers(knots), nk=chosen["nk"]),
        "wiener-hammerstein-regression": lambda: wiener_hammerstein_regression(
            chosen["na"], chosen["nb"], chosen["degree"], nk=chosen["nk"]
        ),
        "polynomial-narx": lambda: polynomial_narx(chosen["na"], chosen["nb"], chosen["degree"], chosen["nk"], inputs),
    }
    if text in made:
        structure = made[text]()
        if inputs > structure.inputs:
            raise DataError(
                f"the structure {text} has one input and {inputs} are named; name one, or use arx or polynomial-narx",
                arguments=("input", "structure"),
            )
        return structure
    if "(t" in text or ";" in text:
        return Structure.parse(*(part.strip() for part in text.split(";") if part.strip()), name="tracked")
    if Path(text).suffix == ".json":
        from emsid.io import load

        model = load(text)
        if not isinstance(model, Narx):
            raise DataError(f"{text}: a {model.name} is not linear in its parameters; name a regression")
        return model.structure
    raise DataError(
        f"structure {text[:80]!r}: name {', '.join(uses)}, a model file, or regressors such as "
        "'y(t-1); u(t-1); sign(y(t-1))'"
    )


def _numbers(text: str | None) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(",")) if text else ()
    except ValueError:
        raise DataError(f"knots {text!r}: write them as numbers with commas between", arguments=("knots",)) from None
