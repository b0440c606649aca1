r"""ARMAX and Box–Jenkins models, fitted to the prediction error by Gauss–Newton steps with exact derivatives.

    e = (D/C) (A y − Σᵢ wᵢ − constant)        wᵢ = Bᵢ/Fᵢ uᵢ

is minimised. Each derivative is a filtered signal (Ljung 1999, sec. 10.3)::

    ∂e/∂aₖ = (D/C) y(t − k)             ∂e/∂bₖ = −(D/(C F)) u(t − nk − k)      ∂e/∂fₖ = (D/(C F)) w(t − k)
    ∂e/∂cₖ = −(1/C) e(t − k)            ∂e/∂dₖ = (1/C) v(t − k), v = A y − Σ w − constant

The states of w at the start of every segment are estimated too. The search starts from two regressions: for ARMAX with
the residual of a long regression as the past noise (Hannan & Rissanen 1982); for Box–Jenkins from refined instruments,
and the same two regressions for the noise that remains.

References:
    Ljung, *System Identification*, 2nd ed. (1999), sec. 7.2 and 10.3. Hannan, Rissanen, *Recursive estimation of mixed
    autoregressive-moving average order*, Biometrika 69 (1982).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from math import log

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.linear.filtering import filtered, mirrored
from emsid.estimation.linear.information import Information
from emsid.estimation.linear.least_squares import check_excitation
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.problem import Block, Infeasible, Mask, without
from emsid.models.linear.polynomials import PolynomialModel, coefficient_names
from emsid.models.regression.instruments import fit_instruments
from emsid.models.regression.structures import arx
from emsid.record import Record, check_same_channels

Array = NDArray[np.float64]
Signals = tuple[Array, Array]
"""Output (N,) and inputs (N, nu) of a segment."""

LONG = 20
"""Lags of the long regression whose residual stands for the noise."""
MOST_STATES = 40
"""The largest number of states at the start of segments that are estimated."""
STABLE = 1.0 - 1e-7
"""Roots of C and F are smaller than this."""


@dataclass(frozen=True)
class PolynomialStructure:
    """The numbers of coefficients of a `PolynomialModel`; see `armax` and `box_jenkins`.

    Args:
        na, nb, nc, nd, nf: numbers of coefficients of the polynomials; nb and nf for every input.
        nk: delay in samples.
        inputs: number of inputs.
        constant: whether there is a constant.
        name: in tables and files.

    Raises:
        ModelError: for numbers that are not whole or too small.
    """

    na: int
    nb: int
    nc: int
    nd: int
    nf: int
    nk: int = 1
    inputs: int = 1
    constant: bool = True
    name: str = "polynomials"

    def __post_init__(self) -> None:
        for what, least in (("na", 0), ("nb", 1), ("nc", 0), ("nd", 0), ("nf", 0), ("nk", 0), ("inputs", 1)):
            value = getattr(self, what)
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= 1000:
                raise ModelError(f"{self.name}: {what} is {value!r}; give a whole number from {least} to 1000")

    @classmethod
    def of(cls, fit: Fit[PolynomialModel]) -> PolynomialStructure:
        """That of a fitted model."""
        model = fit.model
        sizes = len(model.a), model.b.shape[1], len(model.c), len(model.d), model.f.shape[1]
        return cls(*sizes, model.delay, len(model.b), "offset" in fit.names, model.name)

    @property
    def names(self) -> tuple[str, ...]:
        """A name for every parameter."""
        return coefficient_names(self.na, self.nb, self.nf, self.nc, self.nd, self.inputs, self.constant)

    @property
    def memory(self) -> int:
        """The largest lag of a measured signal."""
        return max(self.na, self.nk + self.nb - 1)

    def split(self, theta: Array) -> tuple[Array, Array, Array, Array, Array, float, Array]:
        """a, b (nu, nb), f (nu, nf), c, d, the constant, and the rest of θ."""
        sizes = (self.na, self.inputs * self.nb, self.inputs * self.nf, self.nc, self.nd, int(self.constant))
        a, b, f, c, d, constant, rest = np.split(theta, np.cumsum(sizes))
        level = float(constant[0]) if self.constant else 0.0
        return a, b.reshape(self.inputs, self.nb), f.reshape(self.inputs, self.nf), c, d, level, rest

    def model(self, theta: Array, record: Record) -> PolynomialModel:
        """The model with these parameters, at the sample time of a record."""
        a, b, f, c, d, constant, _ = self.split(theta)
        return PolynomialModel(a, b, c, d, f, constant, self.nk, record.dt, self.name)


def armax(na: int, nb: int, nc: int, nk: int = 1, inputs: int = 1, constant: bool = True) -> PolynomialStructure:
    """ARMAX, ``A(q) y(t) = B(q) u(t − nk) + constant + C(q) e(t)``; `emsid.fit` estimates it.

    Args:
        na, nb, nc: numbers of coefficients of A, B (for every input) and C.
        nk: delay in samples.
        inputs: number of inputs.
        constant: whether there is a constant, for channels with offsets.

    Raises:
        ModelError: for numbers that are not whole or too small.
    """
    return PolynomialStructure(na, nb, nc, 0, 0, nk, inputs, constant, "armax")


def box_jenkins(
    nb: int, nc: int, nd: int, nf: int, nk: int = 1, inputs: int = 1, constant: bool = True
) -> PolynomialStructure:
    """Box–Jenkins, ``y(t) = B(q)/F(q) u(t − nk) + constant + C(q)/D(q) e(t)``; `emsid.fit` estimates it.

    The noise has a model of its own, so that a wrong one does not bias B and F. With nc = nd = 0 it is an output-error
    model.

    Args:
        nb, nf: numbers of coefficients of B and F, for every input.
        nc, nd: numbers of coefficients of C and D.
        nk: delay in samples.
        inputs: number of inputs.
        constant: whether there is a constant, for channels with offsets.

    Raises:
        ModelError: for numbers that are not whole or too small.
    """
    return PolynomialStructure(0, nb, nc, nd, nf, nk, inputs, constant, "box-jenkins")


def fit_polynomials(
    structure: PolynomialStructure,
    records: Record | Iterable[Record],
    *,
    start: Sequence[float] | Array | None = None,
    max_iterations: int = 100,
    control: Control = FREE,
    left_out: Sequence[Mask] | None = None,
) -> Fit[PolynomialModel]:
    """The parameters that minimise the prediction error over one or several records.

    Args:
        structure: the numbers of coefficients.
        records: a record, or several experiments.
        start: (n,) parameters to begin with; by default from regressions.
        max_iterations: the largest number of Gauss–Newton steps.
        control: when to stop.
        left_out: (N,) the samples of every segment whose errors are not fitted.

    Returns:
        A fit with intervals that allow for residuals that are not white.

    Raises:
        ModelError: for records with other channels or too few samples.
    """
    several = [records] if isinstance(records, Record) else list(records)
    segments = segments_of(structure, several)
    theta = start_of(structure, several) if start is None else np.array(start, dtype=float)
    problem = PredictionError(structure, segments)
    if theta.shape != (len(structure.names),):
        raise ModelError(f"{structure.name}: a start of shape {theta.shape}; give {len(structure.names)} numbers")
    found = gauss_newton(
        without(problem, left_out),
        np.concatenate([theta, np.zeros(problem.states)]),
        max_iterations=max_iterations,
        names=(*structure.names, *(f"initial state {k + 1}" for k in range(problem.states))),
        noise=1e-12 * float(max(np.std(y) for y, _ in segments)),
        control=control,
    )
    return found.judged().fit(structure.model(found.estimate, several[0]), structure.names, "pem")


def segments_of(structure: PolynomialStructure, records: Sequence[Record]) -> list[Signals]:
    """The output and inputs of every segment that is long enough.

    Raises:
        ModelError: for other channels, or where no segment is long enough.
    """
    for record in records:
        check_excitation(record)
        check_same_channels(records[0], record)
        if record.output.shape[1] != 1 or record.input.shape[1] != structure.inputs:
            raise ModelError(
                f"{structure.name} has one output and {structure.inputs} inputs; {record.name} has "
                f"{record.output.shape[1]} and {record.input.shape[1]}"
            )
    found = [
        (s.output[:, 0], s.input)
        for record in records
        for s in record.segments
        if len(s) > structure.memory + structure.nc + structure.nd + 1
    ]
    if sum(len(y) for y, _ in found) <= 2 * len(structure.names):
        raise ModelError(f"{records[0].name}: too few samples for {len(structure.names)} parameters; record longer")
    return found


class PredictionError:
    """Prediction errors of a `PolynomialStructure` and their exact derivatives; see `Problem`.

    θ holds the parameters, and the states of w at the start of every segment, where they are few.
    """

    def __init__(self, structure: PolynomialStructure, segments: Sequence[Signals]) -> None:
        self.structure, self.segments = structure, segments
        states = len(segments) * structure.inputs * structure.nf
        self.states = states if states <= MOST_STATES else 0

    def _unpacked(self, theta: Array) -> tuple[Array, Array, Array, Array, Array, float, Array]:
        """a, b, and F, C and D with their leading ones, the constant, and the states (segments, nu, nf).

        Raises:
            Infeasible: where C or F is unstable.
        """
        s = self.structure
        a, b, f, c, d, constant, rest = s.split(theta)
        below, above = np.concatenate([[1.0], c]), np.hstack([np.ones((s.inputs, 1)), f])
        for polynomial in (below, *above):
            if len(polynomial) > 1 and np.abs(np.roots(polynomial)).max(initial=0.0) >= STABLE:
                raise Infeasible(f"{s.name}: a root of C or F leaves the unit circle; choose smaller orders")
        states = rest if self.states else np.zeros(len(self.segments) * s.inputs * s.nf)
        return (
            a,
            b,
            above,
            below,
            np.concatenate([[1.0], d]),
            constant,
            states.reshape(len(self.segments), s.inputs, s.nf),
        )

    def _errors(self, theta: Array, k: int) -> tuple[Array, Array, list[Array]]:
        """e and v (N,) of a segment, and w of every input."""
        s, (y, u) = self.structure, self.segments[k]
        a, b, f, c, d, constant, states = self._unpacked(theta)
        first, stop = s.memory, len(y)
        v = y[first:] - constant
        for lag, weight in enumerate(a, 1):
            v = v + weight * y[first - lag : stop - lag]
        outputs = []
        for i in range(s.inputs):
            drive = np.zeros(stop - first)
            for lag, weight in enumerate(b[i], s.nk):
                drive += weight * u[first - lag : stop - lag, i]
            drive[: s.nf] += states[k, i]
            outputs.append(filtered(1.0, f[i], drive))
            v = v - outputs[-1]
        return filtered(d, c, v), v, outputs

    def residuals(self, theta: Array) -> list[Array]:
        """(N − memory,) e of every segment."""
        return [self._errors(theta, k)[0] for k in range(len(self.segments))]

    def linearised(self, theta: Array) -> list[Block]:
        """e of every segment and its derivative (N − memory, θ)."""
        return [self._linearised(theta, k) for k in range(len(self.segments))]

    def _linearised(self, theta: Array, k: int) -> Block:
        s, (y, u) = self.structure, self.segments[k]
        _, _, f, c, d, _, _ = self._unpacked(theta)
        e, v, outputs = self._errors(theta, k)
        first, stop = s.memory, len(y)
        count = stop - first
        rows = [y[first - lag : stop - lag][None] for lag in range(1, s.na + 1)]
        for i in range(s.inputs):
            lagged = np.array([u[first - lag : stop - lag, i] for lag in range(s.nk, s.nk + s.nb)])
            rows.append(-filtered(1.0, f[i], lagged))
        for i in range(s.inputs):
            response = filtered(1.0, f[i], outputs[i])
            rows += [shifted(response, lag)[None] for lag in range(1, s.nf + 1)]
        split = sum(map(len, rows))
        rows += [-np.ones((1, count))] * s.constant
        starts = np.zeros((self.states, count))
        if self.states:
            impulse = np.zeros(count)
            impulse[0] = 1.0
            for i in range(s.inputs):
                response = -filtered(1.0, f[i], impulse)
                for j in range(s.nf):
                    starts[(k * s.inputs + i) * s.nf + j] = shifted(response, j)
        through = filtered(d, c, np.vstack([*rows, starts])) if rows or self.states else np.empty((0, count))
        by_e, by_v = -filtered(1.0, c, e), filtered(1.0, c, v)
        of_noise = [shifted(by_e, lag)[None] for lag in range(1, s.nc + 1)]
        of_noise += [shifted(by_v, lag)[None] for lag in range(1, s.nd + 1)]
        return e, np.vstack([through[:split], *of_noise, through[split:]]).T


def shifted(signal: Array, lag: int) -> Array:
    """A signal ``lag`` samples later, with zeros before it."""
    return np.concatenate([np.zeros(lag), signal[: len(signal) - lag]])


# --- the start -------------------------------------------------------------------------------------------------------


def start_of(structure: PolynomialStructure, records: Sequence[Record]) -> Array:
    """θ from regressions."""
    s, segments = structure, segments_of(structure, records)
    if not s.nf:
        noise = [innovations(y, u) for y, u in segments]
        information = _mixed(segments, noise, s.na, s.nk, s.nb, s.nc)
        theta = information.solve().estimate
        a, b, constant = theta[: s.na], theta[s.na : s.na + s.inputs * s.nb], theta[-1]
        c = mirrored(np.concatenate([[1.0], theta[s.na + s.inputs * s.nb : -1]]))[1:]
        return np.concatenate([a, b, c, np.zeros(s.nd), [constant] * s.constant])
    linear = arx(s.nf, s.nb, s.nk, s.inputs, constant=s.constant)
    found = fit_instruments(linear, records).estimate
    f, b = found[: s.nf], found[s.nf : s.nf + s.inputs * s.nb]
    level = found[-1] / (1.0 + f.sum()) if s.constant else 0.0
    quiet = np.concatenate([b, np.tile(f, s.inputs), np.zeros(s.nc + s.nd), [level] * s.constant])
    problem = PredictionError(s, segments)
    rest = [problem._errors(np.concatenate([quiet, np.zeros(problem.states)]), k)[1] for k in range(len(segments))]
    d, c = noise_polynomials(rest, s.nd, s.nc)
    quiet[len(quiet) - s.constant - s.nc - s.nd : len(quiet) - s.constant] = np.concatenate([c, d])
    return quiet


def innovations(y: Array, u: Array) -> Array:
    """(N,) the residual of a regression on `LONG` past outputs and inputs, fewer in a short record; zero before."""
    lags = max(1, min(LONG, len(y) // (4 * (1 + u.shape[1])) - 1))
    columns = [y[lags - k : len(y) - k] for k in range(1, lags + 1)]
    columns += [u[lags - k : len(y) - k, i] for k in range(lags + 1) for i in range(u.shape[1])]
    phi = np.vstack([*columns, np.ones(len(y) - lags)])
    theta = Information.empty(len(phi)).add_columns(np.vstack([phi, y[lags:]])).solve().estimate
    return np.concatenate([np.zeros(lags), y[lags:] - theta @ phi])


def _mixed(segments: Sequence[Signals], noise: Sequence[Array], na: int, nk: int, nb: int, nc: int) -> Information:
    """The information of y on −y, u, e in the past, and 1; for every input the nb lags from nk on."""
    first = max(na, nk + nb - 1, nc) + LONG
    inputs = segments[0][1].shape[1]
    information = Information.empty(na + inputs * nb + nc + 1)
    for (y, u), e in zip(segments, noise, strict=True):
        begin = min(first, len(y) // 2)
        n = len(y)
        columns = [-y[begin - k : n - k] for k in range(1, na + 1)]
        columns += [u[begin - k : n - k, i] for i in range(inputs) for k in range(nk, nk + nb)]
        columns += [e[begin - k : n - k] for k in range(1, nc + 1)]
        information = information.add_columns(np.vstack([*columns, np.ones(n - begin), y[begin:]]))
    return information


def noise_polynomials(rest: Sequence[Array], nd: int, nc: int) -> tuple[Array, Array]:
    """d and c of D v = C e for the noise v of every segment, without their leading ones and with stable C."""
    if not nd and not nc:
        return np.zeros(0), np.zeros(0)
    segments = [(v, np.zeros((len(v), 0))) for v in rest]
    noise = [innovations(v, u) for v, u in segments]
    theta = _mixed(segments, noise, nd, 1, 0, nc).solve().estimate
    return theta[:nd], mirrored(np.concatenate([[1.0], theta[nd:-1]]))[1:]


def armax_orders(
    record: Record, nk: Sequence[int], na: Sequence[int], nb: Sequence[int], nc: Sequence[int]
) -> PolynomialStructure:
    """The ARMAX structure of a grid with the smallest criterion of Schwarz, all from one triangular factor.

    Args:
        record: one output.
        nk, na, nb, nc: the values to try.

    Raises:
        ModelError: for a record that is too short.
    """
    inputs = record.input.shape[1]
    last = max(nk) + max(nb)
    segments = segments_of(PolynomialStructure(max(na), last, max(nc), 0, 0, 0, inputs, name="armax"), [record])
    noise = [innovations(y, u) for y, u in segments]
    information = _mixed(segments, noise, max(na), 0, last, max(nc))
    samples = information.samples

    def criterion(choice: tuple[int, int, int, int]) -> float:
        delay, a, b, c = choice
        columns = [*range(a), *(max(na) + i * last + delay + k for i in range(inputs) for k in range(b))]
        columns += [max(na) + inputs * last + k for k in range(c)] + [information.parameters - 1]
        rss = information.select(columns).solve().residual_sum_of_squares
        return samples * log(max(rss, 1e-300)) + len(columns) * log(samples)

    delay, a, b, c = min(product(nk, na, nb, nc), key=criterion)
    return armax(a, b, c, delay, inputs)


def noise_orders(rest: Sequence[Array], most: int) -> tuple[int, int]:
    """nc and nd up to ``most`` with the smallest criterion of Schwarz for a noise v, all from one triangular factor."""
    segments = [(v, np.zeros((len(v), 0))) for v in rest if len(v) > 4 * (LONG + most)]
    if not segments:
        return 0, 0
    noise = [innovations(v, u) for v, u in segments]
    information = _mixed(segments, noise, most, 1, 0, most)
    samples = information.samples

    def criterion(choice: Sequence[int]) -> float:
        columns = [*range(choice[1]), *(most + k for k in range(choice[0])), 2 * most]
        rss = information.select(columns).solve().residual_sum_of_squares
        return samples * log(max(rss, 1e-300)) + len(columns) * log(samples)

    nc, nd = min(product(range(most + 1), repeat=2), key=criterion)
    return nc, nd
