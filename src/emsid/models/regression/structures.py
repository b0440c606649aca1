"""Linear-in-the-parameters structures as data.

A model that is linear in its parameters, ``y(t) = φᵀ(t)θ + e(t)`` (paper, eq. 3.6), is nothing but a list of
regressors φᵢ, and a regressor is nothing but a product of powers of lagged channels, a channel being an output, an
input, or a static transform of one. So a `Structure` is a value: it prints its equation, reads it back, saves as text,
and one compiled kernel builds the regression of any of them. ARX, the paper's Wiener–Hammerstein regression and
regressions with friction terms are functions that return such a list.

Sign convention (the paper's and MATLAB's): ``A(q)y = B(q)u + e`` with ``A = 1 + a₁q⁻¹ + …``, so the regressor of a₁ is
−y(t−1).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from math import comb
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.regression.kernels import fill, fill_rounding, fold_regression
from emsid.models.regression.regressors import (
    HIGHEST_POWER,
    Factor,
    Regressor,
    Tables,
    Transform,
    parse_regressor,
    tables,
)
from emsid.record import Record

if TYPE_CHECKING:
    from emsid.models.regression.narx import Narx

Array = NDArray[np.float64]

# Rows of a regression built at a time: small enough for the second-level cache.
BLOCK = 4096
# More coefficients of a kind than this are a slip of the finger, not a model.
MOST = 1000


@dataclass(frozen=True)
class Structure:
    """A list of regressors: everything about a linear-in-the-parameters model but its parameters.

    Args:
        regressors: the list, or their text: ``Structure.parse("y(t-1)", "u(t-1)^2")``.
        name: what to call it in tables and files.
        parameter_names: a name for every parameter, θ1, θ2, … by default.
        inputs: how many input channels a record must have; by default as many as are used.
    """

    regressors: tuple[Regressor, ...]
    name: str = "structure"
    parameter_names: tuple[str, ...] = ()
    inputs: int = 0

    def __post_init__(self) -> None:
        if not self.regressors:
            raise ModelError(f"{self.name}: a structure needs at least one regressor")
        if len(set(self.regressors)) < len(self.regressors):
            twice = next(r for k, r in enumerate(self.regressors) if r in self.regressors[:k])
            raise ModelError(f"{self.name}: regressor {twice} stands twice in the list")
        used = max((f.channel for r in self.regressors for f in r.factors), default=0)
        if self.inputs < 0 or 0 < self.inputs < used:
            raise ModelError(
                f"{self.name}: {self.inputs} inputs, and its regressors use {used}; give that many or more, or none"
            )
        names = self.parameter_names or tuple(f"θ{k + 1}" for k in range(len(self)))
        if len(names) != len(self):
            raise ModelError(f"{self.name}: {len(names)} parameter names for {len(self)} regressors")
        object.__setattr__(self, "parameter_names", names)
        object.__setattr__(self, "inputs", max(self.inputs, used))

    @classmethod
    def parse(cls, *texts: str, name: str = "structure") -> Structure:
        """The structure whose regressors are written as text.

        Understood are products and powers of ``y(t-1)``, ``u(t-2)``, ``u2(t)``, ``sign(…)``, ``abs(…)``,
        ``tanh(…/0.1)``, ``exp(-abs(…)/0.1)``, ``max(…-0.3, 0)``, ``min(…+0.3, 0)``, a leading minus, and ``1``.

        >>> Structure.parse("y(t-1)*u(t-2)^2", "sign(y(t-1))", "max(u(t-1)-0.3, 0)").equation()
        'y(t) = θ1*y(t-1)*u(t-2)^2 + θ2*sign(y(t-1)) + θ3*max(u(t-1)-0.3, 0) + e(t)'

        Raises:
            ModelError: where a text is not understood, with the text and the part at fault.
        """
        return cls(tuple(parse_regressor(text) for text in texts), name=name)

    def __len__(self) -> int:
        return len(self.regressors)

    def __add__(self, other: Structure) -> Structure:
        """Both lists of regressors, those of `other` that are already there left out."""
        new = [k for k, regressor in enumerate(other.regressors) if regressor not in self.regressors]
        return Structure(
            self.regressors + tuple(other.regressors[k] for k in new),
            name=self.name,
            inputs=max(self.inputs, other.inputs),
        )

    @cached_property
    def memory(self) -> int:
        """How many past samples a prediction needs: the largest lag."""
        return max((f.lag for r in self.regressors for f in r.factors), default=0)

    def equation(self, parameters: Sequence[float] | Array | None = None) -> str:
        """The difference equation, with names or with numbers for the parameters; what has weight zero is left out."""
        terms = []
        for k, regressor in enumerate(self.regressors):
            if parameters is not None and parameters[k] == 0:
                continue
            product = str(Regressor(regressor.factors))
            tail = "" if product == "1" else f"*{product}"
            if parameters is None:
                sign, weight = ("-" if regressor.negative else "+"), self.parameter_names[k]
            else:
                value = -parameters[k] if regressor.negative else parameters[k]
                sign, weight = ("-" if value < 0 else "+"), f"{abs(value):.6g}"
            terms.append(f"{sign} {weight}{tail}")
        text = " ".join(terms) or "0"
        return f"y(t) = {text.removeprefix('+ ')} + e(t)"

    @cached_property
    def tables(self) -> Tables:
        """The structure as the kernels read it."""
        return tables(self.regressors)

    def check(self, record: Record) -> None:
        """Refuse a record that this structure cannot be fitted to or run on.

        Raises:
            ModelError: for other than one output, too few inputs, or no segment longer than the memory.
        """
        if record.output.shape[1] != 1:
            raise ModelError(
                f"{self.name} has one output and {record.name} {record.output.shape[1]}; choose one of "
                f"{', '.join(record.output_names) or 'them'}"
            )
        if record.input.shape[1] < self.inputs:
            raise ModelError(f"{self.name} uses input u{self.inputs}; {record.name} has {record.input.shape[1]}")
        longest = max(len(segment) for segment in record.segments)
        if longest <= self.memory:
            raise ModelError(
                f"{record.name}: its longest segment has {longest} samples; {self.name} looks back {self.memory}; "
                "record longer, leave out less, or choose fewer or smaller lags"
            )

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Every regressor as text."""
        return tuple(str(regressor) for regressor in self.regressors)

    def chunks(self, record: Record, size: int) -> Sequence[tuple[Record, int, int]]:
        """The samples with enough past, in pieces (segment, start, stop) of at most ``size``."""
        return [
            (segment, start, min(start + size, len(segment)))
            for segment in record.segments
            for start in range(self.memory, len(segment), size)
        ]

    def blocks(self, segment: Record, start: int, stop: int) -> Iterator[Array]:
        """[Φ y] of samples ``start`` to ``stop`` of a segment in blocks of columns (n + 1, ≤ `BLOCK`)."""
        for first in range(start, stop, BLOCK):
            count = min(BLOCK, stop - first)
            block = np.empty((len(self) + 1, count))
            fill(block, self.tables, *self._window(segment, first, first + count), self.memory, count)
            yield block

    def rounding(self, segment: Record, start: int, stop: int) -> Iterator[Array]:
        """What the products in `blocks` have lost by rounding, (n, ≤ `BLOCK`) each; transforms count as exact."""
        for first in range(start, stop, BLOCK):
            count = min(BLOCK, stop - first)
            lost = np.empty((len(self), count))
            fill_rounding(lost, self.tables, *self._window(segment, first, first + count), self.memory)
            yield lost

    def fold(self, factor: Array, segment: Record, start: int, stop: int) -> None:
        """Fold [Φ y] of samples ``start`` to ``stop`` of a segment into a factor (n + 1, n + 1), in place."""
        fold_regression(factor, self.tables, *self._window(segment, start, stop), self.memory)

    def _window(self, segment: Record, start: int, stop: int) -> tuple[Array, Array]:
        """y (m,) and u (nu, m) of these samples and of those that they look back to, as the kernels read them."""
        seen = slice(start - self.memory, stop)
        return segment.output[seen, 0], np.ascontiguousarray(segment.input[seen].T)

    def model(self, parameters: Array, record: Record) -> Narx:
        """The model with these parameters, at the sample time of this record."""
        from emsid.models.regression.narx import Narx

        return Narx(self, parameters, record.dt)

    def regression(self, record: Record) -> tuple[Array, Array]:
        """Φ (N, n) and y (N,) of a whole record, for whoever wants to look at them."""
        self.check(record)
        stacked = np.hstack([b for chunk in self.chunks(record, len(record)) for b in self.blocks(*chunk)])
        return stacked[:-1].T, stacked[-1]


def arx(na: int, nb: int, nk: int = 1, inputs: int = 1) -> Structure:
    """ARX, ``A(q)y(t) = B(q)u(t − nk) + e(t)``; with na = 4, nb = 4 the paper's linear model (5.12, 5.13).

    Args:
        na: how many coefficients a₁ … a_na.
        nb: how many coefficients b₁ … b_nb, for every input.
        nk: delay in samples from the input to its first effect.
        inputs: how many inputs.
    """
    _check_counts("arx", na=na, nb=nb, nk=nk, inputs=inputs - 1)
    _check_size("arx", na + nb * inputs, na=na, nb=nb, inputs=inputs)
    return Structure(
        _autoregressive(na) + tuple(_lagged(k, nk + i) for k in range(1, inputs + 1) for i in range(nb)),
        name="arx",
        parameter_names=(
            *(f"a{i + 1}" for i in range(na)),
            *(f"b{i + 1}" if inputs == 1 else f"b{k}_{i + 1}" for k in range(1, inputs + 1) for i in range(nb)),
        ),
        inputs=inputs,
    )


def wiener_hammerstein_regression(
    na: int, nb: int, degree: int, taps: int = 1, nk: int = 1, cross_terms: bool = True
) -> Structure:
    """The paper's expanded Wiener–Hammerstein model (3.5, 3.6): ARX in y, and every monomial in the lagged input.

    An FIR filter of ``taps`` taps, a polynomial of this degree without constant term, and a second filter with ``nb``
    numerator and ``na`` denominator coefficients. Expanded, the term h_l of the second filter brings every product of
    up to ``degree`` inputs with lags from l to l + taps − 1. With one tap there are no cross terms, and na = 4, nb = 3,
    degree = 2 is the paper's (5.10).

    Args:
        na, nb: coefficients of the second filter's denominator and numerator.
        degree: of the polynomial.
        taps: of the first filter, N_g.
        nk: delay in samples from the input to its first effect.
        cross_terms: whether products of differently lagged inputs are kept (in full, eq. 3.6) or only powers.

    Raises:
        ModelError: for counts that are none, or more regressors or higher powers than there may be.
    """
    _check_counts("wiener_hammerstein_regression", na=na, nb=nb - 1, degree=degree - 1, taps=taps - 1, nk=nk)
    # Every shift after the first adds the products that its newest lag is part of.
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
        tuple(regressors),
        name="wiener-hammerstein-regression",
        parameter_names=(
            *(f"a{i + 1}" for i in range(na)),
            *(f"s{i + 1}" for i in range(len(regressors) - na)),
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
    """ARX with what dry friction and a dead zone add, all of it linear in the parameters.

    A dead zone (4.9) of unknown width is a sum of hinges of the input with their knots where its edges may be. Coulomb
    friction is the sign of the lagged speed, its Stribeck part (4.7) that sign times exp(−|y|/v). A drive at rest is
    released only by an input beyond break-away, another pair of hinges, so the same knots serve that too. A constant
    takes up offsets.

    Args:
        na, nb: coefficients of past outputs and inputs.
        knots: where hinges are put, in the input's unit: max(u − k, 0) for k ≥ 0, min(u − k, 0) for k < 0.
        nk: delay in samples from the input to its first effect.
        sign: `Transform.SIGN`, or `Transform.TANH`, smooth over ``width``.
        width: scale of the smooth sign, in the output's unit.
        speeds: Stribeck speeds v, in the output's unit, each a regressor sign(y)·exp(−|y|/v).

    Raises:
        ModelError: for counts that are none, more regressors than there may be, a transform that is no sign.
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


def input_knots(record: Record, count: int) -> tuple[float, ...]:
    """Where to put hinges when nothing is known of the dead zone: ``count`` on either side of zero.

    They reach to the largest input and are closer together near zero, where dead zones and break-away are:
    ``max|u|·(i/(count + 1))²``.
    """
    _check_counts("input_knots", count=count)
    reach = float(np.max(np.abs(record.input[:, 0])))
    positive = [float(f"{reach * (k / (count + 1)) ** 2:.3g}") for k in range(1, count + 1)]  # to be read by people
    return (*(-knot for knot in reversed(positive)), *positive)


def _lagged(channel: int, lag: int) -> Regressor:
    return Regressor((Factor(channel, lag),))


def _autoregressive(na: int) -> tuple[Regressor, ...]:
    return tuple(Regressor((Factor(0, i + 1),), negative=True) for i in range(na))


def _check_counts(name: str, **counts: int) -> None:
    """Refuse counts, given less what they must at least be, that are no whole numbers within reason."""
    for what, value in counts.items():
        fault = (
            "no whole number" if not isinstance(value, (int, np.integer)) else "too small" if value < 0 else "too large"
        )
        if not isinstance(value, (int, np.integer)) or not 0 <= value <= MOST:
            raise ModelError(f"{name}: {what} is {fault}; it counts coefficients (or samples), at most {MOST}")


def _check_size(name: str, regressors: int, **counts: int) -> None:
    """Refuse, before they are made, more regressors than there can be data for."""
    if regressors > MOST:
        many = f"{regressors:,}" if regressors < 1e9 else "more than 10^9"
        made_by = ", ".join(f"{what} = {count}" for what, count in counts.items())
        raise ModelError(f"{name}: {made_by} make {many} regressors, and {MOST:,} are the most; lower some of them")


def regression_reference(structure: Structure, y: Iterable[float], u: Array) -> Array:
    """Φ by the definition, sample by sample: slow, obvious, and what `fill` is compared with."""
    signals = [np.asarray(list(y)), *np.asarray(u, dtype=float).T]
    transforms = {
        Transform.VALUE: lambda x, p: x,
        Transform.SIGN: lambda x, p: np.sign(x),
        Transform.TANH: lambda x, p: np.tanh(x / p),
        Transform.ABOVE: lambda x, p: max(x - p, 0.0),
        Transform.BELOW: lambda x, p: min(x - p, 0.0),
        Transform.ABS: lambda x, p: abs(x),
        Transform.DECAY: lambda x, p: np.exp(-abs(x) / p),
    }
    rows = []
    for t in range(structure.memory, len(signals[0])):
        row = []
        for regressor in structure.regressors:
            value = -1.0 if regressor.negative else 1.0
            for f in regressor.factors:
                value *= transforms[f.transform](signals[f.channel][t - f.lag], f.parameter) ** f.power
            row.append(value)
        rows.append(row)
    return np.array(rows)
