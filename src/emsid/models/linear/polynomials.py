r"""Linear models of one output as polynomials in the shift operator, with a noise model.

    A(q) y(t) = Σᵢ Bᵢ(q)/Fᵢ(q) uᵢ(t − nk) + constant + C(q)/D(q) e(t)

A, C, D and F begin with 1. ARMAX has A, B and C; Box–Jenkins has B, F, C and D. The model runs as its innovations form
in state space, see `StateSpaceModel`: in observer form, one block for every input and one for the noise unless all have
the same denominator A.

References:
    Ljung, *System Identification*, 2nd ed. (1999), sec. 4.2. Box, Jenkins, *Time Series Analysis* (1970).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.linear.state_space import StateSpaceModel, ThroughStateSpace, observer_form
from emsid.models.terms import check_whole, sum_of_terms
from emsid.record import Record

Array = NDArray[np.float64]

FIELDS = ("a", "b", "c", "d", "f")


@dataclass(frozen=True, eq=False, repr=False)
class PolynomialModel(ThroughStateSpace):
    """A linear model of one output in polynomials.

    Args:
        a: (na,) a₁, a₂, … without the leading one.
        b: (nu, nb) b of every input; the first is that of u(t − delay).
        c: (nc,) of the numerator of the noise, without the leading one.
        d: (nd,) of its denominator.
        f: (nu, nf) of the denominator of every input.
        constant: on the right-hand side, in the output's unit.
        delay: nk in samples.
        dt: sample time in s.
        name: name in tables and files.

    Raises:
        ModelError: for arrays that do not fit together, or numbers that are not finite.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    f: Array
    constant: float
    delay: int
    dt: float
    name: str = "polynomials"

    def __post_init__(self) -> None:
        for field in FIELDS:
            values = np.array(getattr(self, field), dtype=float)
            if not np.isfinite(values).all() or not np.isfinite(self.constant):
                raise ModelError(f"{self.name}: its coefficients hold numbers that are not finite")
            if values.ndim != 1 + (field in "bf"):
                raise ModelError(f"{self.name}: {field} of shape {values.shape}; give {1 + (field in 'bf')} dimensions")
            values.flags.writeable = False
            object.__setattr__(self, field, values)
        if not self.b.size or len(self.f) != len(self.b):
            raise ModelError(f"{self.name}: b of shape {self.b.shape} and f of shape {self.f.shape}; give a row each")
        check_whole("polynomial delay", self.delay, 0, "a model cannot look ahead")

    @cached_property
    def form(self) -> StateSpaceModel:
        """The same in state space, in innovations form."""
        one = np.ones(1)
        below = np.concatenate([one, self.a])
        above = [np.concatenate([np.zeros(self.delay), row]) for row in self.b]
        noise, of_noise = np.concatenate([one, self.c]), np.convolve(below, np.concatenate([one, self.d]))
        level = self.constant / below.sum() if below.sum() else 0.0
        if not self.d.size and not self.f.size:
            a, columns = observer_form(below, [*above, noise])
            blocks = [(a, columns[:, :-1], columns[:, -1:])]
        else:
            blocks, inputs = [], len(above)
            for i, (row, of_input) in enumerate(zip(above, self.f, strict=True)):
                a, column = observer_form(np.convolve(below, np.concatenate([one, of_input])), [row])
                b = np.zeros((len(a), inputs))
                b[:, i] = column[:, 0]
                blocks.append((a, b, np.zeros((len(a), 1))))
            a, column = observer_form(of_noise, [noise])
            blocks.append((a, np.zeros((len(a), inputs)), column))
        sizes = [len(a) for a, _, _ in blocks]
        whole, edges = np.zeros((sum(sizes),) * 2), np.cumsum([0, *sizes])
        output = np.zeros((1, sum(sizes)))
        for first, last, (a, _, _) in zip(edges, edges[1:], blocks, strict=False):
            whole[first:last, first:last] = a
            output[0, first] = 1.0
        direct = np.array([[row[0] for row in above]])
        b, k = (np.vstack([block[j] for block in blocks]) for j in (1, 2))
        return StateSpaceModel(whole, b, output, direct, k, np.array([level]), self.dt, name=self.name)

    def ahead(self, segment: Record, samples: int, horizon: int) -> Array:
        """ŷ(t | t − horizon) with the noise model."""
        return self.form.ahead(segment, samples, horizon)

    @property
    def _sizes(self) -> tuple[int, int, int, int, int]:
        return len(self.a), self.b.shape[1], self.f.shape[1], len(self.c), len(self.d)

    def parameter_values(self) -> dict[str, float]:
        """The value of every coefficient by its name in `coefficient_names`."""
        values = np.concatenate([self.a, self.b.ravel(), self.f.ravel(), self.c, self.d, [self.constant]])
        return dict(zip(coefficient_names(*self._sizes, len(self.b), True), values.tolist(), strict=True))

    def with_estimates(self, names: Sequence[str], values: Array) -> PolynomialModel:
        """The model with other values of some coefficients, by name.

        Raises:
            ModelError: for the names of other parameters.
        """
        sizes, known = self._sizes, self.parameter_values()
        if not set(names) <= known.keys():
            raise ModelError(f"{self.name}: {', '.join(names)} are not its coefficients, so it has no band")
        known |= dict(zip(names, np.asarray(values, dtype=float).tolist(), strict=True))
        inputs = len(self.b)
        a, b, f, c, d, level = np.split(
            np.array(list(known.values())),
            np.cumsum([sizes[0], inputs * sizes[1], inputs * sizes[2], sizes[3], sizes[4]]),
        )
        return replace(
            self,
            a=a,
            b=b.reshape(self.b.shape),
            f=f.reshape(self.f.shape),
            c=c,
            d=d,
            constant=float(level[0]),
        )

    def equation(self) -> str:
        """The difference equation with numbers."""
        terms = []
        for i, (row, of_input) in enumerate(zip(self.b, self.f, strict=True)):
            channel = "u(t)" if len(self.b) == 1 else f"u{i + 1}(t)"
            terms.append(f"{_fraction(_text(row, self.delay), of_input)} {channel}")
        if self.constant:
            terms.append(f"{self.constant:.6g}")
        noise = _fraction(_text(np.array([1.0, *self.c])), self.d)
        terms.append(f"{noise} e(t)" if self.c.size or self.d.size else "e(t)")
        left = f"({_text(np.array([1.0, *self.a]))}) y(t)" if self.a.size else "y(t)"
        return f"{left} = {' + '.join(terms)}".replace("+ -", "- ")

    def to_control(self) -> Any:
        """The same as `control.StateSpace` of python-control, without constant and noise.

        Raises:
            ModelError: where python-control is not installed.
        """
        return self.form.to_control()

    def to_data(self) -> dict[str, Any]:
        """Everything that `from_data` needs, in built-in types."""
        arrays = {field: getattr(self, field).tolist() for field in FIELDS}
        rest = {"constant": float(self.constant), "delay": int(self.delay), "dt": float(self.dt)}
        return {"name": self.name, **arrays, **rest}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> PolynomialModel:
        """The model described by `to_data`.

        Raises:
            ModelError: for data that do not describe a model.
        """
        try:
            stored = msgspec.convert(data, _Stored)
            arrays = {field: np.array(getattr(stored, field), dtype=float) for field in FIELDS}
        except (msgspec.ValidationError, ValueError) as problem:
            raise ModelError(f"not a model in polynomials: {problem}") from None
        return cls(**arrays, constant=stored.constant, delay=stored.delay, dt=stored.dt, name=stored.name)


class _Stored(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    a: list[float]
    b: list[list[float]]
    c: list[float]
    d: list[float]
    f: list[list[float]]
    constant: float
    delay: int
    dt: float


def coefficient_names(na: int, nb: int, nf: int, nc: int, nd: int, inputs: int, constant: bool) -> tuple[str, ...]:
    """A name for every coefficient: A, then B and F of every input, C, D and the constant."""
    channels = [""] if inputs == 1 else [f"{i + 1}_" for i in range(inputs)]
    return (
        *(f"a{k + 1}" for k in range(na)),
        *(f"b{i}{k + 1}" for i in channels for k in range(nb)),
        *(f"f{i}{k + 1}" for i in channels for k in range(nf)),
        *(f"c{k + 1}" for k in range(nc)),
        *(f"d{k + 1}" for k in range(nd)),
        *["offset"] * constant,
    )


def _text(coefficients: Array, delay: int = 0) -> str:
    """A polynomial in q^-1 as text, the first coefficient at q^-delay."""
    powers = range(delay, delay + len(coefficients))
    return sum_of_terms([(float(v), f"q^-{k}" if k else "") for v, k in zip(coefficients, powers, strict=True)])


def _fraction(above: str, below: Array) -> str:
    return f"({above})" + (f"/({_text(np.array([1.0, *below]))})" if below.size else "")
