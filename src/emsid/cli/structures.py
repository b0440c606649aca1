"""The structure to track, from the command line: a name, a model file, or regressors as text."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emsid.errors import DataError

if TYPE_CHECKING:
    from emsid.models.regression.narx import Structure

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
