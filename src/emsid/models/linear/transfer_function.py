r"""A transfer function in continuous or discrete time, from records, frequency responses, or both.

    Y = e^(−τs) (b_m sᵐ + … + b₀)/(sⁿ + a_{n−1} sⁿ⁻¹ + … + a₀) U + y₀        in discrete time with z in place of s

Between samples the input is held, over records and over responses with a sample time; a response without one, as of an
analyser, is that in continuous time. The fit minimises the error over all of them (`mixed_problem`), which for white
noise of a record and normal errors of a response is the maximum likelihood.

It starts from a rational fit to the frequency response (`rational`), of a record that by local polynomials or over its
periods. In continuous time this is one in q of s = ω₀ (1 − q)/(1 + q), where the axis of frequency is the unit circle:
polynomials of s would be ill conditioned. The factor (1 + q)ⁿ⁻ᵐ makes m zeros of n. Held inputs are there taken into
account by their main effect, e^(−s·dt/2) sin(x)/x with x = π f dt.

References:
    Pintelon, Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed. (2012), ch. 9. Garnier, Wang
    (eds.), *Identification of Continuous-time Models from Sampled Data* (2008).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError, ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.problem import Mask, without
from emsid.estimation.nonlinear.rational import fit_rational
from emsid.models.linear.mixed_problem import LinearProblem
from emsid.models.linear.state_space import StateSpaceModel, ThroughStateSpace, as_form
from emsid.models.linear.system import LinearSystem
from emsid.models.measured_response import frequency_response
from emsid.models.terms import check_whole, with_known
from emsid.record import FrequencyResponse, Record

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

STEP = 1e-6
"""Relative step of the differences that give derivatives; of coefficients near zero, relative to this part of their
usual size."""
NEAR = 1e-2
BELOW = 0.8
"""The part of the band below half the sampling rate that a start in continuous time is fitted in."""
DELAYS, REFINED = 16, 3
"""Dead times that are tried, from none to a quarter of a cycle of the lowest frequency, and how many are refined."""
UNSTABLE = 1e-9
"""Poles beyond the limit of stability by this part of the fastest one's size are not tried."""


@dataclass(frozen=True, eq=False, repr=False)
class TransferFunction(ThroughStateSpace):
    """A rational function of s or z with a dead time; one input, one output.

    Args:
        numerator: (m + 1,) coefficients of descending powers.
        denominator: (n + 1,) likewise; it is divided by the first.
        delay: dead time in s; in discrete time whole samples.
        level: y₀, the output at an input of zero.
        dt: sample time in s, at which it runs; see `at`.
        discrete: whether it is a function of z.
        name: in tables and files.

    Raises:
        ModelError: for more zeros than poles, no pole, a negative dead time, or numbers that are not finite.
    """

    numerator: Array
    denominator: Array
    delay: float
    level: float
    dt: float
    discrete: bool = False
    name: str = "transfer-function"

    def __post_init__(self) -> None:
        above, below = (np.array(each, dtype=float).ravel() for each in (self.numerator, self.denominator))
        numbers = np.concatenate([above, below, [self.delay, self.level, self.dt]])
        if not np.isfinite(numbers).all() or not self.dt > 0 or self.delay < 0:
            raise ModelError(f"{self.name}: coefficients and times must be finite, the sample time positive")
        if not 1 <= len(above) <= len(below) or len(below) < 2 or not below[0]:
            raise ModelError(f"{self.name}: {len(above)} coefficients over {len(below)}; give as many at most, and two")
        for field, values in (("numerator", above / below[0]), ("denominator", below / below[0])):
            values.flags.writeable = False
            object.__setattr__(self, field, values)

    @property
    def part(self) -> LinearSystem:
        """The same without offset, as a linear system in its own time."""
        n = len(self.denominator) - 1
        above = np.concatenate([np.zeros(n + 1 - len(self.numerator)), self.numerator])
        scale = (
            1.0 if self.discrete else float(np.max(np.abs(self.denominator[1:]) ** (1 / np.arange(1, n + 1)))) or 1.0
        )
        size = scale ** np.arange(n + 1)  # of s in units of a pole, so that the states are of one size
        a = np.diag(np.ones(n - 1), 1)
        a[:, 0] -= self.denominator[1:] / size[1:]
        b = ((above - above[0] * self.denominator) / size)[1:, None]
        time = self.dt if self.discrete else None
        return LinearSystem(a * scale, b * scale, np.eye(1, n), np.full((1, 1), above[0]), time, self.delay, self.name)

    @cached_property
    def sampled(self) -> LinearSystem:
        """`part` at its sample time, for inputs that are held."""
        return self.part.to_discrete(self.dt)

    @cached_property
    def form(self) -> StateSpaceModel:
        """The same in state space, with past inputs as states."""
        return as_form(self.sampled, self.level, 8 * (len(self.denominator) - 1))

    def response(self, frequency: ArrayLike) -> Complex:
        """(F, 1, 1) the response to inputs that are held, at frequencies (F,) in Hz."""
        return self.sampled.response(frequency)

    def at(self, dt: float) -> TransferFunction:
        """The same in continuous time at another sample time in s.

        Args:
            dt: sample time in s.

        Raises:
            ModelError: in discrete time.
        """
        if self.discrete:
            raise ModelError(f"{self.name} is a function of z; identify it in continuous time")
        return replace(self, dt=float(dt))

    def to_control(self) -> Any:
        """The same sample by sample as `control.StateSpace` of python-control, without offset.

        Raises:
            ModelError: where python-control is not installed.
        """
        return self.form.to_control()

    def parameter_values(self) -> dict[str, float]:
        """b and a by the power that they belong to, the dead time and the offset."""
        m, n = len(self.numerator) - 1, len(self.denominator) - 1
        above = {f"b{m - k}": float(value) for k, value in enumerate(self.numerator)}
        below = {f"a{n - k}": float(value) for k, value in enumerate(self.denominator) if k}
        return above | below | {"delay": self.delay, "y0": self.level}

    def with_estimates(self, names: Sequence[str], values: Array) -> TransferFunction:
        """The model with other values of some parameters, by name.

        Raises:
            ModelError: for the names of other parameters, or impossible values.
        """
        known = with_known(self, names, values)
        m, n = len(self.numerator) - 1, len(self.denominator) - 1
        return replace(
            self,
            numerator=np.array([known[f"b{k}"] for k in range(m, -1, -1)]),
            denominator=np.array([1.0, *(known[f"a{k}"] for k in range(n - 1, -1, -1))]),
            delay=known["delay"],
            level=known["y0"],
        )

    def equation(self) -> str:
        """The transfer function with numbers."""
        x = "z" if self.discrete else "s"

        def polynomial(values: Array) -> str:
            top = len(values) - 1
            powers = [f"*{x}^{top - k}" if top - k > 1 else f"*{x}" if top - k else "" for k in range(top + 1)]
            text = " ".join(f"{value:+.6g}{power}" for value, power in zip(values, powers, strict=True))
            return text.removeprefix("+").replace("1*", "", 1) if values[0] == 1 and top else text.removeprefix("+")

        late = f"*exp(-{self.delay:.6g}*s)" if self.delay else ""
        if self.discrete and self.delay:
            late = f"*z^-{round(self.delay / self.dt)}"
        level = f" {self.level:+.6g}" if self.level else ""
        return f"y = ({polynomial(self.numerator)})/({polynomial(self.denominator)}){late} u{level} + e"

    def to_data(self) -> dict[str, Any]:
        """Everything that `from_data` needs, in built-in types."""
        numbers = {key: float(getattr(self, key)) for key in ("level", "dt")}
        both = {key: getattr(self, key).tolist() for key in ("numerator", "denominator")}
        return {"name": self.name, **both, "dead_time": float(self.delay), **numbers, "discrete": self.discrete}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> TransferFunction:
        """The model described by `to_data`.

        Raises:
            ModelError: for data that do not describe a model.
        """
        try:
            stored = msgspec.convert(data, _Stored)
        except msgspec.ValidationError as problem:
            raise ModelError(f"not a transfer function: {problem}") from None
        both = np.array(stored.numerator), np.array(stored.denominator)
        return cls(*both, stored.dead_time, stored.level, stored.dt, stored.discrete, stored.name)


class _Stored(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    numerator: list[float]
    denominator: list[float]
    dead_time: float
    level: float
    dt: float
    discrete: bool


@dataclass(frozen=True)
class TransferFunctionStructure:
    """What `emsid.fit` fits a `TransferFunction` to.

    Args:
        poles: n, at least 1.
        zeros: m, at most n.
        delay: whether there is a dead time.
        discrete: whether it is a function of z.
        name: in tables and files.

    Raises:
        ModelError: for other numbers of poles and zeros.
    """

    poles: int
    zeros: int
    delay: bool
    discrete: bool
    name: str = "transfer-function"

    def __post_init__(self) -> None:
        check_whole("poles", self.poles, 1, "a transfer function has one at least")
        check_whole("zeros", self.zeros, 0, "their number cannot be negative")
        if self.zeros > self.poles:
            raise ModelError(f"{self.name}: {self.zeros} zeros and {self.poles} poles; give as many zeros at most")

    @classmethod
    def of(cls, fit: Fit[TransferFunction]) -> TransferFunctionStructure:
        """What a fit has estimated."""
        model = fit.model
        late = "delay" in fit.names or (model.discrete and model.delay > 0)
        return cls(len(model.denominator) - 1, len(model.numerator) - 1, late, model.discrete, model.name)


def transfer_function(
    poles: int, zeros: int | None = None, *, delay: bool = False, discrete: bool = False
) -> TransferFunctionStructure:
    """A transfer function to be fitted to records, frequency responses, or both; one input, one output.

    >>> transfer_function(2)
    TransferFunctionStructure(poles=2, zeros=1, delay=False, discrete=False, name='transfer-function')

    Args:
        poles: how many.
        zeros: how many; by default one less than poles.
        delay: whether there is a dead time; in discrete time it is whole samples.
        discrete: whether it is a function of z, else of s.
    """
    return TransferFunctionStructure(poles, poles - 1 if zeros is None else zeros, delay, discrete)


def fit_transfer_function(
    structure: TransferFunctionStructure,
    records: Record | FrequencyResponse | Iterable[Record | FrequencyResponse],
    *,
    start: TransferFunction | None = None,
    max_iterations: int = 100,
    control: Control = FREE,
    left_out: Sequence[Mask] | None = None,
) -> Fit[TransferFunction]:
    """Fit a transfer function, see `transfer_function`.

    Args:
        structure: what to fit.
        records: records of one sample time, frequency responses, or both; of one input and one output.
        start: a model to begin with; by default the best rational fits to the frequency response.
        max_iterations: the largest number of Gauss–Newton steps.
        control: when to stop, and where to report every step.
        left_out: (N,) the samples of every segment that are not fitted.

    Raises:
        ModelError: for data of other channels, or too short ones.
    """
    several = (records,) if isinstance(records, Record | FrequencyResponse) else tuple(records)
    responses = [each for each in several if isinstance(each, FrequencyResponse)]
    experiments = [each for each in several if isinstance(each, Record)]
    for each in several:
        both = (
            each.response.shape[1:]
            if isinstance(each, FrequencyResponse)
            else (each.input.shape[1], each.output.shape[1])
        )
        if both != (1, 1):
            raise ModelError(
                f"{structure.name} has one input and one output; take a path of a response, or state_space"
            )
    if len({record.dt for record in experiments}) > 1:
        raise ModelError(f"{structure.name} needs one sample time for all records; resample them")
    least = 8 * structure.poles + 10
    segments = [segment for record in experiments for segment in record.segments if len(segment) > least]
    if not segments and not responses:
        raise ModelError(f"{structure.name}: no segment has more than {least} samples; record longer")
    begins = [start] if start is not None else list(_starts(structure, segments, responses))
    noise = 1.0
    if segments and responses:
        alone = fit_transfer_function(structure, experiments, max_iterations=max_iterations, control=control)
        noise, begins = float(np.sqrt(alone.noise_variance)), [alone.model, *begins]
    how: dict[str, Any] = {"max_iterations": max_iterations, "control": control}
    best: tuple[float, Fit[TransferFunction]] | None = None
    for begin in begins:
        names = [
            name
            for name in begin.parameter_values()
            if (segments or name != "y0") and (name != "delay" or (structure.delay and not structure.discrete))
        ]
        problem = LinearProblem(begin, names, _steps(begin, names), segments, responses, _respond, noise, _is_stable)
        values = begin.parameter_values()
        lower = np.where([name == "delay" for name in names], 0.0, -np.inf)
        try:
            minimum = gauss_newton(
                without(problem, left_out), [values[name] for name in names], lower=lower, names=names, **how
            )
        except ModelError as reason:
            failed = reason
            continue
        if best is None or minimum.cost < best[0]:
            best = minimum.cost, problem.fit(minimum)
    if best is None:
        raise ModelError(f"{structure.name}: {failed}")
    return best[1]


def _respond(model: TransferFunction, measured: FrequencyResponse) -> Complex:
    if measured.dt is None and not model.discrete:
        return model.part.response(measured.frequency)
    return model.part.to_discrete(measured.dt or model.dt).response(measured.frequency)


def _is_stable(model: TransferFunction) -> bool:
    poles = model.part.poles
    if model.discrete:
        return bool(np.all(np.abs(poles) <= 1 + UNSTABLE))
    return bool(np.all(poles.real <= UNSTABLE * np.max(np.abs(poles))))


def _steps(model: TransferFunction, names: Sequence[str]) -> Array:
    """(p,) steps of differences: relative to the values, and to the usual size where these are small."""
    x = 1.0 if model.discrete else max(float(np.max(np.abs(np.roots(model.denominator)))), 1e-3 / model.dt)
    m, n = len(model.numerator) - 1, len(model.denominator) - 1
    above = float(np.max(np.abs(model.numerator) * x ** np.arange(m, -1, -1.0))) or 1.0
    usual = {f"b{k}": above / x**k for k in range(m + 1)} | {f"a{k}": x ** (n - k) for k in range(n)}
    usual |= {"delay": model.dt, "y0": 1.0}
    values = model.parameter_values()
    return np.array([STEP * max(abs(values[name]), NEAR * usual[name]) for name in names])


def _starts(
    structure: TransferFunctionStructure, segments: Sequence[Record], responses: Sequence[FrequencyResponse]
) -> Iterator[TransferFunction]:
    """Rational fits to the frequency response, with the dead times that fit it best."""
    measured = responses[0] if responses else _of_records(segments)
    dt = segments[0].dt if segments else measured.dt or 0.5 / float(measured.frequency[-1])
    measured = measured.between(
        np.nextafter(0, 1), BELOW * 0.5 / dt if measured.dt and not structure.discrete else np.inf
    )
    n, m, late = structure.poles, structure.zeros, [0.0]
    if structure.delay:
        first, last = 0.25 / float(measured.frequency[-1]), 0.25 / float(measured.frequency[0])
        late = sorted({0.0, *np.geomspace(first, max(last, 2 * first), DELAYS - 1).tolist()})
        late = (
            sorted({round(each / dt) * dt for each in late} | {k * dt for k in range(DELAYS)})
            if structure.discrete
            else late
        )
    found: list[tuple[float, float, Array, Array]] = []
    for delay in late:
        if structure.discrete:
            turned = replace(measured.ahead(delay + (n - m) * dt), frequency=measured.frequency * dt)
            b, a, cost = fit_rational(turned, m + 1, n)
            found.append((cost, delay, b, np.append(1.0, a)))
            continue
        x = np.pi * measured.frequency * (measured.dt or 0.0)
        held = np.sinc(x / np.pi)[:, None, None]
        scale = 2 * np.pi * float(np.sqrt(measured.frequency[0] * measured.frequency[-1]))
        part = measured.ahead(delay + (measured.dt or 0.0) / 2)
        warped = replace(
            part,
            frequency=np.arctan(2 * np.pi * measured.frequency / scale) / np.pi,
            response=part.response / held,
            total=None if part.total is None else part.total / held**2,
        )
        b, a, cost = fit_rational(warped, m + 1, n, vanishing=n - m)
        found.append((cost, delay, *_unwarped(b, np.append(1.0, a), n - m, scale)))
    for _, delay, above, below in sorted(found, key=lambda each: each[0])[:REFINED]:
        yield TransferFunction(above, below, delay, _level(segments), dt, structure.discrete, structure.name)


def _unwarped(b: Array, a: Array, vanishing: int, scale: float) -> tuple[Array, Array]:
    """Numerator and denominator in s of B(q)(1 + q)^vanishing/A(q), with q = (1 − s/scale)/(1 + s/scale)."""
    up, down = np.array([1.0, 1.0]), np.array([-1.0, 1.0])  # 1 + x, 1 − x of x = s/scale, the highest power first

    def polynomial(values: Array) -> Array:
        top, total = len(values) - 1, np.zeros(len(values))
        for k, value in enumerate(values):
            term = np.ones(1)
            for factor in (*[down] * k, *[up] * (top - k)):
                term = np.convolve(term, factor)
            total += value * term
        return total / scale ** np.arange(top, -1, -1.0)

    return 2.0**vanishing * polynomial(b), polynomial(a)


def _of_records(segments: Sequence[Record]) -> FrequencyResponse:
    """The frequency response of records; by averaged windows where they suit no other method."""
    try:
        return frequency_response(segments)
    except DataError:
        return frequency_response(segments, "welch")


def _level(segments: Sequence[Record]) -> float:
    return float(np.mean([segment.output[0, 0] for segment in segments])) if segments else 0.0
