r"""A linear model in state space, with several inputs and outputs.

    x(t + 1) = A x(t) + B u(t) + K e(t)
    y(t)     = C x(t) + D u(t) + y₀ + e(t)

e is white noise, and y₀ the output at an input of zero in steady state. The free run has e = 0. The prediction has
e = y − ŷ: with A − KC in place of A, measured outputs drive the state (the innovations form; K is the gain of the
steady-state Kalman filter). With K = 0 all noise is that of the output.

`ThroughStateSpace` is a linear model that runs as one in state space.

References:
    Ljung, *System Identification*, 2nd ed. (1999), sec. 4.3.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.compiled import njit
from emsid.errors import ModelError
from emsid.estimation.compiled import read_only
from emsid.estimation.linear.modal_form import Modal, modal_basis
from emsid.models.free_run import RunMethods
from emsid.models.linear.system import LinearSystem
from emsid.models.linear_parts import python_control
from emsid.models.model import levels
from emsid.models.terms import sum_of_terms
from emsid.record import Record

Array = NDArray[np.float64]

# An eigenvalue of A that is one within this fraction has no steady state.
INTEGRATES = 1e-9
# In a basis of this condition, ten of sixteen digits are kept; in the modal basis, A is the same within this part.
BASIS, SAME = 1e6, 1e-12
MATRICES = ("a", "b", "c", "d", "k")


@dataclass(frozen=True, eq=False, repr=False)
class StateSpaceModel(RunMethods):
    """A linear model in state space.

    Args:
        a: (n, n).
        b: (n, nu).
        c: (ny, n).
        d: (ny, nu).
        k: (n, ny) gain of the innovations.
        level: (ny,) y₀, the output in steady state at an input of zero.
        dt: sample time in s.
        start: samples of a segment from which the initial state is estimated; by default eight for every state.
        name: name in tables and files.

    Raises:
        ModelError: for matrices that do not fit together, or numbers that are not finite.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    k: Array
    level: Array
    dt: float
    start: int = 0
    name: str = "state-space"

    def __post_init__(self) -> None:
        for field in (*MATRICES, "level"):
            values = np.array(getattr(self, field), dtype=float)
            if not np.isfinite(values).all():
                raise ModelError(f"{self.name}: {field} holds numbers that are not finite")
            values.flags.writeable = False
            object.__setattr__(self, field, values)
        n, outputs, inputs = len(self.a), len(self.level), self.b.shape[1] if self.b.ndim == 2 else 0
        wanted = {"a": (n, n), "b": (n, inputs), "c": (outputs, n), "d": (outputs, inputs), "k": (n, outputs)}
        for field, shape in wanted.items():
            if getattr(self, field).shape != shape or not n:
                raise ModelError(f"{self.name}: {field} of shape {getattr(self, field).shape}; {shape} fits the others")
        if not (np.isfinite(self.dt) and self.dt > 0):
            raise ModelError(f"{self.name}: sample time {self.dt} s; it must be a positive number of seconds")
        least = -(-n // outputs)  # samples that determine the state
        object.__setattr__(self, "start", max(int(self.start), least) if self.start else 8 * least)

    @property
    def order(self) -> int:
        """n, the number of states."""
        return len(self.a)

    @property
    def memory(self) -> int:
        """The number of samples of a segment that give its initial state."""
        return self.start

    @property
    def sampled(self) -> LinearSystem:
        """The same as a linear system, without offset and noise."""
        return LinearSystem(self.a, self.b, self.c, self.d, self.dt, name=self.name)

    @property
    def latency(self) -> int:
        """Zero: the model does not interpolate its input."""
        return 0

    @property
    def poles(self) -> NDArray[np.complex128]:
        """(n,) eigenvalues of A."""
        return np.linalg.eigvals(self.a).astype(complex)

    def check_record(self, record: Record) -> None:
        """Refuse a record of other channels; its outputs may be missing.

        Raises:
            ModelError: with the difference.
        """
        inputs, outputs = self.b.shape[1], len(self.level)
        if record.input.shape[1] != inputs or record.output.shape[1] not in (0, outputs):
            raise ModelError(
                f"{self.name} has {inputs} inputs and {outputs} outputs; {record.name} has "
                f"{record.input.shape[1]} and {record.output.shape[1]}"
            )

    def at_rest(self, level: ArrayLike = 0.0, dt: float | None = None) -> Array:
        """(n,) the steady state for a constant input; zero for a model without one, such as an integrator."""
        u, rest = levels(self.name, level, self.b.shape[1]), np.eye(self.order) - self.a
        if np.abs(np.linalg.eigvals(rest)).min() < INTEGRATES:
            return np.zeros(self.order)
        return np.asarray(np.linalg.solve(rest, self.b @ u))

    def initial(self, segment: Record, samples: int) -> Array:
        """(n,) the state after these samples, by least squares on their outputs, with the noise model."""
        y, u = segment.output[:samples], segment.input[:samples]
        a, b, d = self.predictor
        return run_linear(a, b, self.c, d, self.first_state(y, u), np.hstack([u, y - self.level]))[1]

    def first_state(self, y: Array, u: Array) -> Array:
        """(n,) the state before outputs y (N, ny) and inputs u (N, nu), by least squares on the prediction error.

        NaN where the prediction overflows, so that a run from there diverges.
        """
        a, b, d = self.predictor
        forced, _ = run_linear(a, b, self.c, d, np.zeros(self.order), np.hstack([u, y - self.level]))
        rows, power = [], self.c
        for _ in range(len(y)):
            rows.append(power)
            power = power @ a
        both = np.column_stack([np.vstack(rows), (y - self.level - forced).ravel()])
        if not np.isfinite(both).all():
            return np.full(self.order, np.nan)
        return np.asarray(np.linalg.lstsq(both[:, :-1], both[:, -1], rcond=None)[0])

    def run(self, state: Array, inputs: Array) -> tuple[Array, Array]:
        """The outputs (N, ny) for inputs (N, nu), and the state (n,) after them."""
        outputs, after = run_linear(self.a, self.b, self.c, self.d, state, inputs)
        return outputs + self.level, after

    def advance(self, state: Array, u: ArrayLike) -> tuple[Array, Array]:
        """The output (ny,) for the input (nu,) of one sample, and the state after it."""
        outputs, after = self.run(state, levels(self.name, u, self.b.shape[1])[None, :])
        return outputs[0], after

    def ahead(self, segment: Record, samples: int, horizon: int) -> Array:
        """ŷ(t | t − horizon): simulated from the state that measured outputs up to ``horizon`` samples before give.

        What the innovations add to the state of the free run decays with A.
        """
        start, u, y = self.initial(segment, samples), segment.input[samples:], segment.output[samples:]
        everything, none = np.eye(self.order), np.zeros((self.order, self.b.shape[1]))
        free = run_linear(self.a, self.b, everything, none, start, u)[0]
        values = free @ self.c.T + u @ self.d.T + self.level
        if horizon <= len(u):
            a, b, _ = self.predictor
            both, nothing = np.hstack([u, y - self.level]), np.zeros((self.order, b.shape[1]))
            added = run_linear(a, b, everything, nothing, start, both)[0] - free
            last = len(u) - horizon + 1
            values[horizon - 1 :] += added[:last] @ (self.c @ np.linalg.matrix_power(self.a, horizon - 1)).T
        return values

    @property
    def predictor(self) -> tuple[Array, Array, Array]:
        """A − KC, [B − KD, K] and [D, 0]: the predictor, driven by u and y − y₀."""
        return (
            self.a - self.k @ self.c,
            np.hstack([self.b - self.k @ self.d, self.k]),
            np.hstack([self.d, np.zeros((len(self.level),) * 2)]),
        )

    def response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """(F, ny, nu) the frequency response at frequencies (F,) in Hz."""
        z = np.exp(2j * np.pi * np.atleast_1d(np.asarray(frequency, dtype=float)) * self.dt)
        resolvent = z[:, None, None] * np.eye(self.order) - self.a
        return np.asarray(
            self.c @ np.linalg.solve(resolvent, np.broadcast_to(self.b, (len(z), *self.b.shape))) + self.d
        )

    def coefficients(self, direct: bool, noise: bool) -> tuple[tuple[str, ...], Array]:
        """The names and values of the coefficients of its transfer functions, which depend on no basis of the state.

        Those are sums over its modes, sections of second order (a real pole that is left has the first order), so that
        the coefficients of many modes are as well determined as the modes: yᵢ = Σⱼ (b₀ᵢⱼ + Σₖ Bₖᵢⱼ(q)/Aₖ(q)) uⱼ + y₀,
        and the noise of a single output has 1 + Σₖ (Cₖ(q)/Aₖ(q) − 1). With up to two states this is B/A and C/A.

        Args:
            direct: whether the input affects the output in the same sample.
            noise: whether C(q) of the noise is among them; it exists for one output.
        """
        n, (outputs, inputs) = self.order, self.d.shape
        form = Modal.of(self.a, np.hstack([self.b, self.k]), self.c, self.d, self.level)
        kept = (~np.stack([np.zeros_like(form.single), form.single], axis=1)).ravel()
        below = np.stack([-2 * form.centre, form.centre**2 - form.lower * form.upper], axis=1)
        below[form.single, 0] = -form.centre[form.single]
        first = np.einsum("imp,mpj->ijm", form.c, form.b)
        other = np.stack([form.upper[:, None] * form.b[:, 1], form.lower[:, None] * form.b[:, 0]], axis=1)
        second = np.einsum("imp,mpj->ijm", form.c, other) - form.centre * first  # of C(A − 2σ)B
        above = np.stack([first, second], axis=3).reshape(outputs, inputs + outputs, -1)[:, :, kept]
        values = [below.ravel()[kept]]
        for i in range(outputs):
            for j in range(inputs):
                values += [self.d[i, j : j + 1]] * direct + [above[i, j]]
        if noise:
            values.append(values[0] + above[0, inputs])
        return coefficient_names(n, outputs, inputs, direct, noise), np.concatenate([*values, self.level])

    def parameter_values(self) -> dict[str, float]:
        """The value of every coefficient by name, see `coefficients`."""
        names, values = self.coefficients(bool(self.d.any()), bool(self.k.any()) and len(self.level) == 1)
        return dict(zip(names, values.tolist(), strict=True))

    def with_estimates(self, names: Sequence[str], values: Array) -> StateSpaceModel:
        """The model with these coefficients, see `coefficients`: n states for every output, or every input if fewer.

        Every section is in observer form, or transposed in controller form. Of `parameter_values`, some are enough;
        others keep their values.

        With several outputs it has no noise model, since the coefficients do not describe it.

        Raises:
            ModelError: for the names of other parameters.
        """
        outputs, inputs = self.d.shape
        own = self.parameter_values()
        if set(names) < own.keys():
            own |= dict(zip(names, np.asarray(values, dtype=float).tolist(), strict=True))
            names, values = tuple(own), np.array(list(own.values()))
        copies = min(inputs, outputs)  # it may be such a form already
        for n, direct, noise in product((self.order, self.order // copies), (False, True), (False, True)):
            whole = coefficient_names(n, outputs, inputs, direct, noise and outputs == 1)
            if tuple(names) in (whole, whole[:-outputs]):  # a frequency response shows no level
                values = np.append(values, self.level[: len(whole) - len(names)])
                break
        else:
            raise ModelError(f"{self.name}: {', '.join(names)} are not its coefficients, so it has no band")
        noise = noise and outputs == 1
        below, above, of_noise, level = np.split(
            np.asarray(values, dtype=float), np.cumsum([n, (n + direct) * inputs * outputs, n * noise])
        )
        rows = above.reshape(outputs, inputs, n + direct)
        a, one = np.zeros((n, n)), np.zeros(n)
        for k in range(0, n, 2):  # the observer form of every section
            a[k : k + 2, k], one[k] = -below[k : k + 2], 1.0
            a[k : k + 1, k + 1 : k + 2] = 1.0
        every, places = np.zeros((copies, n, copies, n)), np.arange(copies)
        every[places, :, places] = a if copies == outputs else a.T
        part, ones = rows[:, :, direct:], np.asarray(np.kron(np.eye(copies), one), dtype=float)
        if copies == outputs:
            b, c = part.transpose(0, 2, 1).reshape(-1, inputs), ones
        else:
            b, c = ones.T, part.reshape(outputs, -1)
        return replace(
            self,
            a=every.reshape(len(b), len(b)),
            b=b,
            c=c,
            d=rows[:, :, 0] if direct else np.zeros_like(self.d),
            k=(of_noise - below)[:, None] if noise else np.zeros((len(b), outputs)),
            level=level,
        )

    def in_modal_form(self) -> StateSpaceModel:
        """The same in a basis where A has blocks of one or two states on its diagonal; itself where none is good.

        C code of it has few products, and single precision is enough for many lightly damped modes.
        """
        basis = modal_basis(self.a, False)[0]
        a, b, c = Modal.of(self.a, np.hstack([self.b, self.k]), self.c, self.d, self.level).matrices()
        apart = np.abs(self.a @ basis - basis @ a).max() > SAME * np.abs(self.a).max()  # several poles at one place
        if apart or np.linalg.cond(basis) > BASIS:
            return self
        return replace(self, a=a, b=b[:, : self.b.shape[1]], c=c, k=b[:, self.b.shape[1] :])

    def equation(self) -> str:
        """The difference equations with numbers."""
        inputs = ["u(t)"] if self.b.shape[1] == 1 else [f"u{j + 1}(t)" for j in range(self.b.shape[1])]
        outputs = ["y(t)"] if len(self.level) == 1 else [f"y{i + 1}(t)" for i in range(len(self.level))]
        noises = [output.replace("y", "e") for output in outputs]
        states = [f"x{i + 1}(t)" for i in range(self.order)]

        def line(left: str, parts: Sequence[tuple[Array, Sequence[str]]], rest: str = "") -> str:
            terms = [(float(v), name) for values, names in parts for v, name in zip(values, names, strict=True)]
            return f"{left} = {sum_of_terms(terms)}{rest}"

        lines = [
            line(f"x{i + 1}(t+1)", [(self.a[i], states), (self.b[i], inputs), (self.k[i], noises)])
            for i in range(self.order)
        ]
        lines += [
            line(
                outputs[i], [(self.c[i], states), (self.d[i], inputs), (self.level[i : i + 1], [""])], f" + {noises[i]}"
            )
            for i in range(len(outputs))
        ]
        return "\n".join(lines)

    def to_control(self) -> Any:
        """The same as `control.StateSpace` of python-control, without y₀ and noise.

        Raises:
            ModelError: where python-control is not installed.
        """
        return python_control().ss(self.a, self.b, self.c, self.d, self.dt)

    def to_data(self) -> dict[str, Any]:
        """Everything that `from_data` needs, in built-in types."""
        matrices = {field: getattr(self, field).tolist() for field in (*MATRICES, "level")}
        return {"name": self.name, **matrices, "dt": float(self.dt), "start": self.start}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> StateSpaceModel:
        """The model described by `to_data`.

        Raises:
            ModelError: for data that do not describe a model.
        """
        try:
            stored = msgspec.convert(data, _Stored)
            arrays = {field: np.array(getattr(stored, field), dtype=float) for field in (*MATRICES, "level")}
        except (msgspec.ValidationError, ValueError) as problem:
            raise ModelError(f"not a state-space model: {problem}") from None
        return cls(**arrays, dt=stored.dt, start=stored.start, name=stored.name)


class _Stored(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    a: list[list[float]]
    b: list[list[float]]
    c: list[list[float]]
    d: list[list[float]]
    k: list[list[float]]
    level: list[float]
    dt: float
    start: int


def observer_form(below: Array, above: Sequence[Array]) -> tuple[Array, Array]:
    """A (n, n) and one column of B (n, k) for each numerator over a common denominator; C is (1, 0, …).

    The direct terms are the first coefficients of the numerators.
    """
    n = max(len(below) - 1, *(len(each) - 1 for each in above), 1)
    padded = np.zeros(n + 1)
    padded[: len(below)] = below
    a = np.diag(np.ones(n - 1), 1)
    a[:, 0] -= padded[1:]
    columns = np.zeros((n, len(above)))
    for k, each in enumerate(above):
        columns[: len(each) - 1, k] = each[1:]
        columns[:, k] -= padded[1:] * each[0]
    return a, columns


def as_state_space(system: Any) -> Any:
    """A system of python-control in state space; its own conversion drops coefficients below 1e-14 with a warning.

    Args:
        system: in state space, or a transfer function of one output with a common denominator for all inputs.
    """
    library = python_control()
    if not isinstance(system, library.TransferFunction):
        return library.ss(system)
    below = np.asarray(system.den[0][0], dtype=float)
    above = [np.pad(each, (len(below) - len(each), 0)) / below[0] for each in system.num[0]]
    a, b = observer_form(below / below[0], above)
    return library.ss(a, b, np.eye(1, len(a)), [[each[0] for each in above]], system.dt)


def coefficient_names(order: int, outputs: int, inputs: int, direct: bool, noise: bool) -> tuple[str, ...]:
    """The names of `StateSpaceModel.coefficients`."""
    slots = [(f"mode{k // 2 + 1}." if order > 2 else "", k % 2 + 1) for k in range(order)]
    names = [f"{mode}a{k}" for mode, k in slots]
    for i, j in product(range(1, outputs + 1), range(1, inputs + 1)):
        label = "b" if outputs == inputs == 1 else f"b{j}_" if outputs == 1 else f"b{i}{j}_"
        names += [f"{label}0"] * direct + [f"{mode}{label}{k}" for mode, k in slots]
    names += [f"{mode}c{k}" for mode, k in slots] * noise
    names += ["y0" if outputs == 1 else f"y0_{i + 1}" for i in range(outputs)]
    return tuple(names)


def run_linear(a: Array, b: Array, c: Array, d: Array, state: Array, inputs: Array) -> tuple[Array, Array]:
    """The outputs (N, ny) of x(t + 1) = A x + B u, y = C x + D u from a state (n,), and the state after them."""
    after, outputs = np.array(state, dtype=float), np.empty((len(inputs), len(c)))
    a, b, c, d, u = (read_only(each) for each in (a, b, c, d, inputs))
    run_in_place(a, b, c, d, after, u, outputs)
    return outputs, after


@njit(nogil=True)
def run_in_place(a: Array, b: Array, c: Array, d: Array, x: Array, u: Array, y: Array) -> None:
    """Write y (N, ny) for u (N, nu) and leave in x (n,) the state after them."""
    n, inputs, following = len(a), u.shape[1], np.empty(len(a))
    for t in range(len(u)):
        for i in range(len(c)):
            total = 0.0
            for j in range(n):
                total += c[i, j] * x[j]
            for j in range(inputs):
                total += d[i, j] * u[t, j]
            y[t, i] = total
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += a[i, j] * x[j]
            for j in range(inputs):
                total += b[i, j] * u[t, j]
            following[i] = total
        for i in range(n):
            x[i] = following[i]


def run_reference(a: Array, b: Array, c: Array, d: Array, state: Array, inputs: Array) -> tuple[Array, Array]:
    """`run_linear` by its definition, in NumPy: a slow and simple reference."""
    x, outputs = np.array(state, dtype=float), []
    for u in inputs:
        outputs.append(c @ x + d @ u)
        x = a @ x + b @ u
    return np.array(outputs), x


# --- models that run in state space -----------------------------------------------------------------------------------


class ThroughStateSpace(RunMethods, ABC):
    """A model whose runs, states and response are those of its `form`."""

    @property
    @abstractmethod
    def form(self) -> StateSpaceModel:
        """The same in state space."""

    @property
    def memory(self) -> int:
        """The number of samples of a segment that give its initial state."""
        return self.form.memory

    @property
    def latency(self) -> int:
        """Zero: the model does not interpolate its input."""
        return 0

    def check_record(self, record: Record) -> None:
        """Refuse a record of other channels; its outputs may be missing.

        Raises:
            ModelError: with the difference.
        """
        self.form.check_record(record)

    def at_rest(self, level: ArrayLike = 0.0, dt: float | None = None) -> Array:
        """The steady state for a constant input; zero for a model without one, such as an integrator."""
        return self.form.at_rest(level, dt)

    def initial(self, segment: Record, samples: int) -> Array:
        """The state after these samples, by least squares on their outputs, with the noise model if there is one."""
        return self.form.initial(segment, samples)

    def run(self, state: Array, inputs: Array) -> tuple[Array, Array]:
        """The outputs (N, 1) for inputs (N, nu), and the state after them."""
        return self.form.run(state, inputs)

    def advance(self, state: Array, u: ArrayLike) -> tuple[Array, Array]:
        """The output (1,) for the input (nu,) of one sample, and the state after it."""
        return self.form.advance(state, u)

    def response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """(F, 1, nu) the frequency response from the inputs at frequencies (F,) in Hz."""
        return self.form.response(frequency)


def as_form(part: LinearSystem, level: float, start: int) -> StateSpaceModel:
    """A system of one output in discrete time as a model without noise, with its dead time as states.

    Args:
        part: in discrete time.
        level: the output at an input of zero.
        start: samples of a segment that give the initial state.
    """
    whole = part.with_past_inputs()
    none = np.zeros((len(whole.a), 1))
    return StateSpaceModel(
        whole.a, whole.b, whole.c, whole.d, none, np.array([level]), whole.dt or 1.0, start=start, name=part.name
    )
