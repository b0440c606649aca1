"""Common structures: functions that return a list of regressors.

ARX, the paper's Wiener–Hammerstein regression, and regressions with friction terms; see `narx` for structures.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import combinations_with_replacement
from math import comb

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.regression.narx import Structure
from emsid.models.regression.regressors import HIGHEST_POWER, Factor, Regressor
from emsid.models.regression.transforms import Transform
from emsid.record import Record

Array = NDArray[np.float64]

# The largest number of coefficients of a kind; a larger one is a typing error.
LARGEST_COUNT = 1000
# The largest number of regressors in a dictionary to select from.
LARGEST_DICTIONARY = 20_000


def arx(na: int, nb: int, nk: int = 1, inputs: int = 1, constant: bool = False) -> Structure:
    """ARX, ``A(q)y(t) = B(q)u(t − nk) + e(t)``; with na = 4, nb = 4 the paper's linear model (5.12, 5.13).

    Args:
        na: number of coefficients a₁ … a_na.
        nb: number of coefficients b₁ … b_nb, for every input.
        nk: delay in samples from the input to its first effect.
        inputs: number of inputs.
        constant: whether to add a constant, for channels with offsets: a record away from its operating point at zero.
    """
    _check_counts("arx", na=na, nb=nb, nk=nk, inputs=inputs - 1)
    _check_size("arx", na + nb * inputs, na=na, nb=nb, inputs=inputs)
    return Structure(
        (
            *_autoregressive(na),
            *(_lagged(k, nk + i) for k in range(1, inputs + 1) for i in range(nb)),
            *_constant(constant),
        ),
        name="arx",
        parameter_names=(
            *(f"a{i + 1}" for i in range(na)),
            *(f"b{i + 1}" if inputs == 1 else f"b{k}_{i + 1}" for k in range(1, inputs + 1) for i in range(nb)),
            *["offset"] * constant,
        ),
        inputs=inputs,
    )


def wiener_hammerstein_regression(
    na: int, nb: int, degree: int, taps: int = 1, nk: int = 1, cross_terms: bool = True, constant: bool = False
) -> Structure:
    """The paper's expanded Wiener–Hammerstein model (3.5, 3.6): ARX in y, and every monomial in the lagged input.

    An FIR filter of ``taps`` taps, a polynomial of this degree without constant term, and a second filter with ``nb``
    numerator and ``na`` denominator coefficients. Expanded, the term h_l of the second filter gives every product of
    up to ``degree`` inputs with lags from l to l + taps − 1. With one tap there are no cross terms, and na = 4, nb = 3,
    degree = 2 is the paper's (5.10).

    Args:
        na, nb: coefficients of the second filter's denominator and numerator.
        degree: of the polynomial.
        taps: of the first filter, N_g.
        nk: delay in samples from the input to its first effect.
        cross_terms: whether to keep products of inputs at different lags (in full, eq. 3.6) or only powers.
        constant: whether the polynomial has a constant term, for channels with offsets.

    Raises:
        ModelError: for invalid counts, too many regressors, or too high powers.
    """
    _check_counts("wiener_hammerstein_regression", na=na, nb=nb - 1, degree=degree - 1, taps=taps - 1, nk=nk)
    # Every shift after the first adds the products with its newest lag.
    terms = na + sum(
        comb(taps + p - 1, p) + (nb - 1) * comb(taps + p - 2, p - 1) if cross_terms else taps + nb - 1
        for p in range(1, degree + 1)
    )
    if degree > HIGHEST_POWER:
        raise ModelError(f"wiener_hammerstein_regression: degree {degree}; powers go up to {HIGHEST_POWER}, lower it")
    _check_size("wiener_hammerstein_regression", terms, na=na, nb=nb, degree=degree, taps=taps)
    regressors = list(_autoregressive(na))
    for power in range(1, degree + 1):
        seen: dict[tuple[int, ...], None] = {}
        for shift in range(nb):
            for lags in combinations_with_replacement(range(nk + shift, nk + shift + taps), power):
                if cross_terms or len(set(lags)) == 1:
                    seen[lags] = None
        for lags in sorted(seen):
            factors = tuple(Factor(1, lag, lags.count(lag)) for lag in dict.fromkeys(lags))
            regressors.append(Regressor(factors))
    return Structure(
        (*regressors, *_constant(constant)),
        name="wiener-hammerstein-regression",
        parameter_names=(
            *(f"a{i + 1}" for i in range(na)),
            *(f"s{i + 1}" for i in range(len(regressors) - na)),
            *["offset"] * constant,
        ),
    )


def friction_narx(
    na: int,
    nb: int,
    knots: Sequence[float] = (),
    nk: int = 1,
    sign: Transform = Transform.SIGN,
    width: float = 0.0,
    speeds: Sequence[float] = (),
) -> Structure:
    """ARX with terms for dry friction and a dead zone, all linear in the parameters.

    A dead zone (4.9) of unknown width is a sum of hinge functions of the input with knots at possible edges. Coulomb
    friction is the sign of the lagged speed, its Stribeck part (4.7) that sign times exp(−|y|/v). Break-away from rest
    is also a pair of hinge functions, with the same knots. A constant represents offsets.

    Args:
        na, nb: coefficients of past outputs and inputs.
        knots: knots of the hinges in the unit of the input: max(u − k, 0) for k ≥ 0, min(u − k, 0) for k < 0.
        nk: delay in samples from the input to its first effect.
        sign: `Transform.SIGN`, or `Transform.TANH`, which is smooth over ``width``.
        width: scale of the smooth sign, in the output's unit.
        speeds: Stribeck speeds v, in the output's unit, each a regressor sign(y)·exp(−|y|/v).

    Raises:
        ModelError: for invalid counts, too many regressors, or another transform.
    """
    _check_counts("friction_narx", na=na - 1, nb=nb - 1, nk=nk)
    size = na + nb * (1 + len(knots)) + len(speeds) + 2
    _check_size("friction_narx", size, na=na, nb=nb, knots=len(knots), speeds=len(speeds))
    if sign not in (Transform.SIGN, Transform.TANH):
        raise ModelError(f"friction_narx: {sign!r} is no sign of the speed; give Transform.SIGN or Transform.TANH")
    direction = Factor(0, 1, 1, sign, width if sign is Transform.TANH else 0.0)
    hinges = tuple(
        Regressor((Factor(1, nk + i, 1, Transform.ABOVE if knot >= 0 else Transform.BELOW, float(knot)),))
        for knot in knots
        for i in range(nb)
    )
    friction = (
        Regressor((direction,), negative=True),
        *(Regressor((direction, Factor(0, 1, 1, Transform.DECAY, float(v))), negative=True) for v in speeds),
    )
    return Structure(
        (*_autoregressive(na), *(_lagged(1, nk + i) for i in range(nb)), *hinges, *friction, Regressor()),
        name="friction-narx",
        parameter_names=(
            *(f"a{i + 1}" for i in range(na)),
            *(f"b{i + 1}" for i in range(nb)),
            *(f"h{k + 1}_{i + 1}" for k in range(len(knots)) for i in range(nb)),
            *(f"c{k}" for k in range(len(friction))),
            "offset",
        ),
    )


def polynomial_narx(na: int, nb: int, degree: int, nk: int = 1, inputs: int = 1, constant: bool = True) -> Structure:
    """Every product of up to ``degree`` lagged outputs and inputs: a dictionary to select terms from.

    The linear terms come first, so that the structure contains ARX with the same counts; then the constant; then the
    products, by degree. Fitted whole, it follows noise and diverges outside its data; see `select_terms`.

    Args:
        na, nb: number of lagged outputs, and of lagged values of every input.
        degree: the largest number of factors of a product, at least 1.
        nk: delay in samples from the input to its first effect.
        inputs: number of inputs.
        constant: whether to include the constant 1.

    Raises:
        ModelError: for invalid counts, or too many regressors.
    """
    _check_counts("polynomial_narx", na=na, nb=nb, degree=degree - 1, nk=nk, inputs=inputs - 1)
    channels = [(0, i + 1) for i in range(na)] + [(k, nk + i) for k in range(1, inputs + 1) for i in range(nb)]
    _check_size(
        "polynomial_narx",
        comb(len(channels) + degree, degree) - (not constant),
        most=LARGEST_DICTIONARY,
        na=na,
        nb=nb,
        degree=degree,
        inputs=inputs,
    )
    factor = cache(Factor)  # a dictionary has few different factors
    products = [
        Regressor(tuple([factor(*channel, chosen.count(channel)) for channel in dict.fromkeys(chosen)]))
        for power in range(2, degree + 1)
        for chosen in combinations_with_replacement(channels, power)
    ]
    linear = [_lagged(channel, lag) for channel, lag in channels]
    return Structure((*linear, *_constant(constant), *products), name="polynomial-narx", inputs=inputs)


def input_knots(record: Record, count: int) -> tuple[float, ...]:
    """Default knots of the hinges for an unknown dead zone: ``count`` on either side of zero.

    They reach to the largest input and are denser near zero, where dead zone and break-away are:
    ``max|u|·(i/(count + 1))²``. Where the input goes less far on one side, the knots of that side follow its own
    extreme; where it never changes its sign, all of them lie within its range, denser at the end near zero.

    Args:
        record: its first input is used.
        count: hinges on either side of zero.

    Raises:
        ModelError: for a number of hinges that no structure takes.
    """
    if not isinstance(count, int | np.integer) or not 0 <= count <= LARGEST_COUNT:
        raise ModelError(
            f"knots {count}: these are hinges on each side of zero; give a whole number from 0 to {LARGEST_COUNT}",
            arguments=("knots",),
        )
    low, high = float(record.input[:, 0].min()), float(record.input[:, 0].max())
    reach = max(-low, high)
    outermost = reach * (count / (count + 1)) ** 2

    def knots(start: float, end: float, number: int) -> list[float]:
        shares = [(k / (number + 1)) ** 2 for k in range(1, number + 1)]
        return [float(f"{start + (end - start) * share:.3g}") for share in shares]  # short decimals

    if low >= 0 or high <= 0:
        near, far = (low, high) if low >= 0 else (high, low)
        return tuple(sorted(set(knots(near, far, 2 * count))))
    below = knots(0.0, -reach if -low > outermost else low, count)
    return (*reversed(below), *knots(0.0, reach if high > outermost else high, count))


def _lagged(channel: int, lag: int) -> Regressor:
    return Regressor((Factor(channel, lag),))


def _constant(wanted: bool) -> tuple[Regressor, ...]:
    return (Regressor(),) if wanted else ()


def _autoregressive(na: int) -> tuple[Regressor, ...]:
    return tuple(Regressor((Factor(0, i + 1),), negative=True) for i in range(na))


def _check_counts(name: str, **counts: int) -> None:
    """Refuse counts, given minus their least value, that are not whole numbers from 0 to `LARGEST_COUNT`."""
    for what, value in counts.items():
        fault = (
            "no whole number" if not isinstance(value, (int, np.integer)) else "too small" if value < 0 else "too large"
        )
        if not isinstance(value, (int, np.integer)) or not 0 <= value <= LARGEST_COUNT:
            raise ModelError(f"{name}: {what} is {fault}; it counts coefficients (or samples), at most {LARGEST_COUNT}")


def _check_size(name: str, regressors: int, most: int = LARGEST_COUNT, **counts: int) -> None:
    """Refuse more than ``most`` regressors before they are created."""
    if regressors > most:
        many = f"{regressors:,}" if regressors < 1e9 else "more than 10^9"
        made_by = ", ".join(f"{what} = {count}" for what, count in counts.items())
        raise ModelError(f"{name}: {made_by} make {many} regressors, and {most:,} are the most; lower some of them")
