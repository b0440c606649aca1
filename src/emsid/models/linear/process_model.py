r"""A process model: gain, time constants, a zero and a dead time, from the free run.

    y(t) = K · (1 + T_z s) / ((1 + T₁ s) … (1 + Tₙ s)) · e^(−L s) u(t) + y₀

for an input that is held over every sample. The dead time is L = (m + f)·dt with a whole number m of samples and a
fraction f. Over a sample the earlier input acts for f·dt and the later one for the rest,

    x(t + 1) = e^(A dt) x(t) + e^(A (1 − f) dt) Γ(f dt) u(t − m − 1) + Γ((1 − f) dt) u(t − m)

with Γ(h) = ∫₀ʰ e^(A s) ds B, so that the output is continuous in L. The model runs as a `StateSpaceModel` whose further
states are past inputs.
A search from the best of a grid of time constants and dead times minimises the error of the free run.

References:
    Ljung, *System Identification*, 2nd ed. (1999), sec. 4.3. Åström, Wittenmark, *Computer-Controlled Systems*, 3rd ed.
    (1997), sec. 2.3.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.problem import Mask, without
from emsid.models.linear.mixed_problem import LinearProblem
from emsid.models.linear.state_space import StateSpaceModel, ThroughStateSpace, as_form
from emsid.models.linear.system import LinearSystem
from emsid.models.terms import with_known
from emsid.record import Record

Array = NDArray[np.float64]

LONGEST = 10_000
"""The longest dead time in samples; every one of them is a state."""
STEP = 1e-5
"""Relative step of the differences that give derivatives; of a time, relative to the sample time at least."""
TIMES, DEAD_TIMES = 6, 6
"""Time constants and dead times of the grid that a search begins with."""
SHORTEST, LARGEST = 0.3, 0.5
"""The shortest time constant in samples, as records show no shorter one, and the longest as a part of the record."""


@dataclass(frozen=True, eq=False, repr=False)
class ProcessModel(ThroughStateSpace):
    """A gain with time constants, a zero and a dead time.

    Args:
        gain: K, in units of the output over those of the input.
        time_constants: T₁, …, Tₙ in s, positive.
        zero: T_z in s; 0 for none.
        delay: L in s.
        offset: y₀, the output at an input of zero.
        dt: sample time in s.
        name: in tables and files.

    Raises:
        ModelError: for no or negative time constants, a negative or very long delay, or numbers that are not finite.
    """

    gain: float
    time_constants: tuple[float, ...]
    zero: float
    delay: float
    offset: float
    dt: float
    name: str = "process"

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_constants", tuple(float(constant) for constant in self.time_constants))
        numbers = (self.gain, *self.time_constants, self.zero, self.delay, self.offset, self.dt)
        if not np.isfinite(numbers).all() or not self.dt > 0:
            raise ModelError(f"{self.name}: gain, times and offset must be finite, and the sample time positive")
        if not self.time_constants or min(self.time_constants) <= 0 or len(self.time_constants) > 8:
            raise ModelError(f"{self.name}: time constants {self.time_constants}; give one to eight positive ones")
        if not 0 <= self.delay <= LONGEST * self.dt:
            raise ModelError(
                f"{self.name}: a delay of {self.delay:g} s; give 0 to {LONGEST:,} samples of {self.dt:g} s"
            )

    @cached_property
    def continuous(self) -> tuple[Array, Array, Array, float]:
        """A, B, C and D in continuous time, without the dead time."""
        n = len(self.time_constants)
        a, b = np.diag([-1.0 / constant for constant in self.time_constants]), np.zeros((n, 1))
        for k in range(1, n):
            a[k, k - 1] = 1.0 / self.time_constants[k]
        b[0, 0] = 1.0 / self.time_constants[0]
        c = self.gain * (np.eye(1, n, n - 1) + self.zero * a[-1:])
        return a, b, c, float(self.gain * self.zero * b[-1, 0])

    def to_control(self) -> Any:
        """The same sample by sample as `control.StateSpace` of python-control, without offset.

        Raises:
            ModelError: where python-control is not installed.
        """
        return self.form.to_control()

    @property
    def part(self) -> LinearSystem:
        """The same without offset, in continuous time."""
        a, b, c, d = self.continuous
        return LinearSystem(a, b, c, np.full((1, 1), d), None, self.delay, self.name)

    @cached_property
    def sampled(self) -> LinearSystem:
        """`part` at its sample time, for inputs that are held."""
        return self.part.to_discrete(self.dt)

    @property
    def level(self) -> float:
        """`offset`."""
        return self.offset

    @cached_property
    def form(self) -> StateSpaceModel:
        """The same in state space, with past inputs as states."""
        return as_form(self.sampled, self.offset, 8 * len(self.time_constants))

    def response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """(F, 1, 1) the frequency response at frequencies (F,) in Hz; whole samples of its dead time need no states."""
        return self.sampled.response(frequency)

    def parameter_values(self) -> dict[str, float]:
        """gain, T1, T2, …, Tz, delay and offset."""
        times = {f"T{k + 1}": constant for k, constant in enumerate(self.time_constants)}
        return {"gain": self.gain, **times, "Tz": self.zero, "delay": self.delay, "offset": self.offset}

    def with_estimates(self, names: Sequence[str], values: Array) -> ProcessModel:
        """The model with other values of some parameters, by name.

        Raises:
            ModelError: for the names of other parameters, or impossible values.
        """
        known = with_known(self, names, values)
        times = tuple(known[f"T{k + 1}"] for k in range(len(self.time_constants)))
        return replace(
            self,
            gain=known["gain"],
            time_constants=times,
            zero=known["Tz"],
            delay=known["delay"],
            offset=known["offset"],
        )

    def equation(self) -> str:
        """The transfer function with numbers."""
        above = f"(1 + {self.zero:.6g}*s)" if self.zero else ""
        below = "".join(f"(1 + {constant:.6g}*s)" for constant in self.time_constants)
        late = f"*exp(-{self.delay:.6g}*s)" if self.delay else ""
        return f"y = {self.gain:.6g}{above}/({below}){late} u {self.offset:+.6g} + e"

    def to_data(self) -> dict[str, Any]:
        """Everything that `from_data` needs, in built-in types."""
        numbers = {key: float(getattr(self, key)) for key in ("gain", "zero", "offset", "dt")}
        return {
            "name": self.name, "time_constants": list(self.time_constants), "dead_time": float(self.delay), **numbers
        }  # fmt: skip

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> ProcessModel:
        """The model described by `to_data`.

        Raises:
            ModelError: for data that do not describe a model.
        """
        try:
            stored = msgspec.convert(data, _Stored)
        except msgspec.ValidationError as problem:
            raise ModelError(f"not a process model: {problem}") from None
        times = tuple(stored.time_constants)
        return cls(stored.gain, times, stored.zero, stored.dead_time, stored.offset, stored.dt, stored.name)


class _Stored(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    gain: float
    time_constants: list[float]
    zero: float
    dead_time: float
    offset: float
    dt: float


@dataclass(frozen=True)
class ProcessStructure:
    """What `emsid.fit` fits a `ProcessModel` to.

    Args:
        poles: how many time constants, 1 to 4.
        zero: whether there is a zero.
        delay: whether there is a dead time.
        name: in tables and files.

    Raises:
        ModelError: for another number of poles.
    """

    poles: int
    zero: bool
    delay: bool
    name: str = "process"

    def __post_init__(self) -> None:
        if isinstance(self.poles, bool) or not isinstance(self.poles, int) or not 1 <= self.poles <= 4:
            raise ModelError(f"{self.name}: {self.poles!r} poles; give 1 to 4")

    @classmethod
    def of(cls, fit: Fit[ProcessModel]) -> ProcessStructure:
        """What a fit has estimated."""
        return cls(len(fit.model.time_constants), "Tz" in fit.names, "delay" in fit.names, fit.model.name)


def process_model(poles: int = 1, zero: bool = False, delay: bool = True) -> ProcessStructure:
    """A process model to be fitted: a gain, time constants, perhaps a zero and a dead time; one input, one output.

    >>> process_model(poles=2)
    ProcessStructure(poles=2, zero=False, delay=True, name='process')

    Args:
        poles: how many time constants, 1 to 4.
        zero: whether there is a zero.
        delay: whether there is a dead time.
    """
    return ProcessStructure(poles, zero, delay)


def _start(structure: ProcessStructure, segments: Sequence[Record]) -> ProcessModel:
    """The best of a grid of equal time constants and dead times; gain and offset are linear."""
    dt, longest = segments[0].dt, max(map(len, segments))
    times = np.geomspace(2 * dt, 0.1 * longest * dt, TIMES)
    waits = [0.0] if not structure.delay else [0.0, *np.geomspace(dt, 0.05 * longest * dt, DEAD_TIMES - 1)]
    best = (np.inf, ProcessModel(1.0, (times[0],) * structure.poles, 0.0, 0.0, 0.0, dt, structure.name))
    for time, wait in product(times, waits):
        spread = tuple(time / structure.poles * (1.0 + 0.3 * k) for k in range(structure.poles))
        model = ProcessModel(1.0, spread, 0.0, wait, 0.0, dt, structure.name)
        x = np.concatenate([model.run(model.at_rest(segment.input[0]), segment.input)[0][:, 0] for segment in segments])
        y = np.concatenate([segment.output[:, 0] for segment in segments])
        columns = np.column_stack([x, np.ones(len(x))])
        (gain, offset), *_ = np.linalg.lstsq(columns, y, rcond=None)
        cost = float(np.sum((columns @ np.array([gain, offset]) - y) ** 2))
        if cost < best[0]:
            best = cost, replace(model, gain=float(gain), offset=float(offset))
    return best[1]


def fit_process(
    structure: ProcessStructure,
    records: Record | Iterable[Record],
    *,
    start: ProcessModel | None = None,
    max_iterations: int = 100,
    control: Control = FREE,
    left_out: Sequence[Mask] | None = None,
) -> Fit[ProcessModel]:
    """Fit a process model to the free run, see `process_model`.

    Args:
        structure: what to fit.
        records: a record, or several, of one input and one output at one sample time.
        start: a model to begin with; by default the best of a grid.
        max_iterations: the largest number of Gauss–Newton steps.
        control: when to stop, and where to report every step.
        left_out: (N,) the samples of every segment that are not fitted.

    Raises:
        ModelError: for records of other channels, or too short ones.
    """
    several = (records,) if isinstance(records, Record) else tuple(records)
    least = 8 * structure.poles + 10
    for record in several:
        if record.input.shape[1] != 1 or record.output.shape[1] != 1 or record.dt != several[0].dt:
            raise ModelError(f"{structure.name} has one input and one output, and one sample time for all records")
    segments = [segment for record in several for segment in record.segments if len(segment) > least]
    if not segments:
        raise ModelError(f"{structure.name}: no segment has more than {least} samples; record longer")
    begin = start or _start(structure, segments)
    names = [
        name
        for name in begin.parameter_values()
        if (structure.zero or name != "Tz") and (structure.delay or name != "delay")
    ]
    dt, longest = begin.dt, max(map(len, segments)) * begin.dt
    limits = {f"T{k + 1}": (SHORTEST * dt, LARGEST * longest) for k in range(structure.poles)}
    limits["delay"] = (0.0, min(0.25 * longest, LONGEST * dt))
    limits["Tz"] = (-LARGEST * longest, LARGEST * longest)
    lower, upper = (np.array([limits.get(name, (-np.inf, np.inf))[side] for name in names]) for side in (0, 1))
    values = begin.parameter_values()
    sizes = np.array([dt if name[0] in "Td" else 1e-3 for name in names])
    problem = LinearProblem(begin, names, STEP * np.maximum(np.abs([values[name] for name in names]), sizes), segments)
    theta = np.clip([values[name] for name in names], lower, upper)
    seen = without(problem, left_out)
    how: dict[str, Any] = {"max_iterations": max_iterations, "names": names, "control": control}
    minimum = gauss_newton(seen, theta, lower=lower, upper=upper, **how)
    return problem.fit(minimum)
