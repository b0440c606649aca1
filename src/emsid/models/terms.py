"""Checks of numbers, arrays and parameters by name, and sums as text, for several kinds of models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError

Array = NDArray[np.float64]


def vector(values: ArrayLike, what: str) -> Array:
    """A read-only one-dimensional copy of finite numbers; ``what`` names it in messages."""
    array = np.array(values, dtype=float)
    if array.ndim != 1:
        raise ModelError(f"{what} of shape {array.shape}; give one dimension")
    if not np.isfinite(array).all():
        raise ModelError(f"{what} hold {array[~np.isfinite(array)][0]}; give finite numbers")
    array.flags.writeable = False
    return array


def check_whole(
    what: str, value: object, least: int, why: str, most: int | None = None, arguments: Sequence[str] = ()
) -> None:
    """Refuse a value that is not a whole number in a range.

    Args:
        what: it is.
        value: to be checked.
        least, most: the range; without an upper limit if ``most`` is None.
        why: the reason in the message.
        arguments: that the message names for the command line.
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or value < least or (most is not None and value > most):  # type: ignore[operator]
        limits = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise ModelError(f"{what} {value}: {why}; give a whole number {limits}", arguments=arguments)


def sum_of_terms(terms: Sequence[tuple[float, str]]) -> str:
    """``1*x + 0.5*x^2`` from (factor, text) pairs, without zeros."""
    parts = [
        f"{'-' if value < 0 else '+'} {abs(value):.6g}{f'*{text}' if text else ''}" for value, text in terms if value
    ]
    joined = " ".join(parts) or "0"
    return joined[2:] if joined.startswith("+") else joined.replace("- ", "-", 1) if joined[0] == "-" else joined


def with_known(model: Any, names: Sequence[str], values: ArrayLike) -> dict[str, float]:
    """The parameters of a model by name, some of them with other values.

    Args:
        model: with `parameter_values`.
        names, values: (k,) those that change.

    Raises:
        ModelError: for the names of other parameters.
    """
    known: dict[str, float] = model.parameter_values()
    if not set(names) <= known.keys():
        raise ModelError(f"{model.name}: {', '.join(names)} are not its parameters")
    return known | dict(zip(names, np.asarray(values, dtype=float).tolist(), strict=True))
