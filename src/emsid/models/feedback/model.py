"""A linear system with static maps in its feedback (nonlinear LFR).

    x(t+1) = A x(t) + B_u u(t) + B_w w(t)
    z(t)   = C_z x(t) + D_zu u(t) + z₀          g(t) = F_x x(t) + F_u u(t) + g₀          w(t) = f(z(t))·g(t)
    y(t)   = C_y x(t) + D_yu u(t) + D_yw w(t) + y₀

with one or several static maps f, each with its own z and w. Most maps have g = 1. Others are multiplied by a signal:
damping that depends on the command, as of a bridge that lets the motor coast, is f(u) times the speed. Friction, a
hardening spring, a saturation inside a controller act in a loop, which no cascade can show. A Hammerstein model (A and
z independent of w), a Wiener model (y = w) and a Wiener–Hammerstein model are cases of it; so is a motor with friction,
whose speed is driven by a dead zone. There is no path from w to z in one step, so every signal follows from those
before it.

**Redundancy.** The same output follows from other numbers: n² for the choice of the state (x′ = Tx); one for the unit
of every z, w and g, if the family of the map can take factors; one for a line k·z and one for a level of f, which can
be moved into the linear part, if the family of f contains them; one for a shift of z, if the map absorbs it. These
directions are removed from a fit (`coordinates`); a fitted model is in a normal form (`normal_form`), in which the rest
can be identified if the input excites every map.

**Sampling.** With ``oversampling`` L the model makes L steps per sample, because what a map gives varies between
samples. The input is interpolated (band-limited) to L times the rate, or held over each sample, as a drive does.

**Steady state.** A run under a constant input comes close to rest, and Newton steps complete it (`resting`).

**Sensor.** A plant may have a sensor behind it that is curved, slow, or loses the sign. Its curve is the first map, and
a filter behind that has the last states:

    the loop:      x(t+1) and z by x, u and w of the other maps
    the sensor:    s(t+1) and y by s and w₁ = f₁(z₁)

The loop does not depend on the sensor, and the output depends on the loop through z₁ only. All other elements of M are
zero, and a change of the state mixes those of the loop or those behind the sensor. So such a model has far fewer
parameters than one whose maps may act everywhere.

References:
    Paduart et al., *Identification of nonlinear systems using polynomial nonlinear state space models*, Automatica 46
    (2010). Schoukens, Tóth, *On the initialization of nonlinear LFR model identification with the best linear
    approximation*, IFAC World Congress (2020). Vanbeylen, *Nonlinear LFR block-oriented model: potential benefits and
    improved, user-friendly identification method*, IEEE TIM 62 (2013).
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.compiled import read_only
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.models.blocks.block import block_from_data
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.feedback.equations import entries, equations, numbered, shared_signals
from emsid.models.feedback.kernels import (
    LoopSignals,
    MapSlopes,
    Tables,
    derivative,
    map_slopes,
    run,
    run_each,
    run_reference,
    tables_of,
)
from emsid.models.initial_states import initial_state
from emsid.models.input_path import InputPath
from emsid.models.model import levels
from emsid.models.one_channel import OneChannelMethods
from emsid.models.terms import check_whole
from emsid.record import Record

Array = NDArray[np.float64]


# Samples for every element of the initial state of a segment.
SAMPLES_PER_STATE = 8
# Samples of a block of a derivative.
BLOCK = 8192


class FeedbackState(NamedTuple):
    """The state between two samples.

    Attributes:
        inputs: (k,) past inputs for delay and interpolation, the oldest first.
        x: (n,) the state of the linear part.
    """

    inputs: Array
    x: Array


@dataclass(frozen=True, eq=False, repr=False)
class FeedbackModel(OneChannelMethods):
    """A linear system with static maps in its feedback.

    Args:
        matrix: (n + m + 1, n + 1 + m) the linear part: rows give x(t+1), z, y from the columns x, u, w. The block from
            w to z is zero.
        maps: m static maps.
        map_offsets: (m,) z₀.
        output_offset: y₀, in the output's unit.
        delay: nk, samples from the input to its first effect.
        oversampling: L, how many steps the model makes per sample of the record.
        held: whether the input is held over the steps of a sample; otherwise it is interpolated.
        name: name in tables and files.
        dt: sample time in s of its records; None for any.
        factors: (m, n + 2) rows give g from the columns x, u, 1; by default 0, …, 0, 1 for every map.
        shared: pairs of signals, of which the first is a multiple of the second and remains one in a fit. z of a map
            may be one of the output, without what w adds to it, ``("z1", "y")``, or of z of a map before it, ``("z2",
            "z1")``, but for its offset; w may act on the state and the output as the input does, ``("w1", "u")``, or as
            another w, ``("w2", "w1")``. The elements of the first are made the closest multiple of those of the second.
        centre: (n,) the mean state over the records of its fit, from which `resting` looks for a steady state; by
            default zero. A model may have several steady states, of which those far from its data mean nothing.
        sensor: where the first map is the curve of a sensor behind the loop, how many of the last states are behind
            that curve; the elements of the matrix that `emsid.models.feedback.model` excludes are made zero.

    Raises:
        ModelError: for a matrix of another shape, with a path from w to z or with numbers that are not finite, an
            object that is no static map, an invalid delay or oversampling, pairs of other signals, a centre of another
            length, or a sensor without a map, with too many states, or beside products or pairs.
    """

    matrix: Array
    maps: tuple[StaticMap, ...] = ()
    map_offsets: Array = ()  # type: ignore[assignment]  # made an array below
    output_offset: float = 0.0
    delay: int = 0
    oversampling: int = 1
    held: bool = False
    name: str = "feedback"
    dt: float | None = None
    factors: Array = ()  # type: ignore[assignment]  # made an array below
    shared: tuple[tuple[str, str], ...] = ()
    centre: Array = ()  # type: ignore[assignment]  # made an array below
    sensor: int | None = None

    models_noise: ClassVar[bool] = False
    band_steps: ClassVar[tuple[float, ...]] = (0.01, 0.001)
    """Steps of its bands in standard errors, see `emsid.models.bands`. They are small: elements of its matrices may be
    known badly where what it does is known well, so that it is bent over a step of one standard error."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "maps", tuple(self.maps))
        m = len(self.maps)
        offsets = np.zeros(m) if np.size(self.map_offsets) == 0 else self.map_offsets
        ones = np.eye(1, self.states + 2, self.states + 1).repeat(m, axis=0)
        factors = ones if np.size(self.factors) == 0 else self.factors
        centre = np.zeros(max(self.states, 0)) if np.size(self.centre) == 0 else self.centre
        for field, value, dimensions in (
            ("matrix", self.matrix, 2),
            ("map_offsets", offsets, 1),
            ("factors", factors, 2),
            ("centre", centre, 1),
        ):
            array = np.array(value, dtype=float)
            if array.ndim != dimensions or not np.isfinite(array).all():
                raise ModelError(f"{self.name}: {field} needs {dimensions} dimensions and finite numbers")
            array.flags.writeable = False
            object.__setattr__(self, field, array)
        n = self.states
        if n < 0 or self.matrix.shape != (n + m + 1, n + 1 + m) or len(self.map_offsets) != m:
            raise ModelError(
                f"{self.name}: a matrix of shape {self.matrix.shape} and {len(self.map_offsets)} offsets for {m} maps; "
                "with n states give (n + m + 1, n + 1 + m), and one offset for each map"
            )
        if self.factors.shape != (m, n + 2):
            raise ModelError(f"{self.name}: factors of shape {self.factors.shape}; with n states give (m, n + 2)")
        if self.centre.shape != (n,):
            raise ModelError(f"{self.name}: a centre of {len(self.centre)} states; give {n}, as the matrix has")
        if self.matrix[n : n + m, n + 1 :].any():
            raise ModelError(f"{self.name}: w must not reach z in the same step; that block of the matrix is zero")
        for k, each in enumerate(self.maps, start=1):
            if not isinstance(each, StaticMap):
                raise ModelError(f"{self.name}, map {k}: {each!r} is no static map")
        check_whole(f"{self.name}: delay", self.delay, 0, "a model cannot look ahead")
        check_whole(f"{self.name}: oversampling", self.oversampling, 1, "the model makes at least one step per sample")
        if not np.isfinite(self.output_offset):
            raise ModelError(f"{self.name}: output offset {self.output_offset}; give a finite number")
        if self.dt is not None and not (np.isfinite(self.dt) and self.dt > 0):
            raise ModelError(f"{self.name}: sample time {self.dt} s; it must be a positive number of seconds")
        check_sensor(self.name, n, m, self.sensor, not (len(self.multiplied) or self.shared))
        if self.matrix[self.absent].any():
            object.__setattr__(self, "matrix", read_only(np.where(self.absent, 0.0, self.matrix)))
        pairs, matrix = shared_signals(self.name, self.matrix, m, self.shared)
        object.__setattr__(self, "shared", pairs)
        object.__setattr__(self, "matrix", matrix)

    @cached_property
    def states(self) -> int:
        """n, the order of the linear part."""
        return int(np.shape(self.matrix)[0] - 1 - len(self.maps))

    @cached_property
    def absent(self) -> NDArray[np.bool_]:
        """(n + m + 1, n + 1 + m) the elements of M that are zero as the model has a sensor."""
        return absent(self.states, len(self.maps), self.sensor)

    @property
    def parts(self) -> tuple[tuple[slice, int], ...]:
        """The states of the loop and those behind a sensor, which do not mix, with the rows of M that show them."""
        n = self.states
        if self.sensor is None:
            return ((slice(0, n), -1),)
        loop = n - self.sensor
        return ((slice(0, loop), n), (slice(loop, n), -1))

    def takes_line(self, k: int) -> bool:
        """Whether the linear part can take a line of a map: of none that is multiplied by a signal or of a sensor."""
        return k not in self.multiplied and (self.sensor is None or k > 0)

    @cached_property
    def multiplied(self) -> NDArray[np.int64]:
        """(k,) the maps that are multiplied by a signal; the rows of ``factors`` of the others are constant."""
        return np.flatnonzero(self.factors[:, :-1].any(axis=1))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """A name for every parameter: ``x1.u`` is the factor of u in the equation of x1."""
        z, w, f, g = (self.numbered(letter) for letter in "zwfg")
        x = tuple(f"x{k + 1}" for k in range(self.states))
        names = [f"{row}.{column}" for row in x for column in (*x, "u", *w)]
        names += [f"{row}.{column}" for row in z for column in (*x, "u")]
        names += [f"y.{column}" for column in (*x, "u", *w)]
        names += [f"{g[k]}.{column}" for k in self.multiplied for column in (*x, "u", "1")]
        names += [f"{own}.{name}" for own, each in zip(f, self.maps, strict=True) for name in each.names]
        return (*names, *(f"{row}.1" for row in z), "y.1")

    @cached_property
    def free_entries(self) -> NDArray[np.bool_]:
        """(n + m + 1, n + 1 + m) the elements of M that are parameters: all but those from w to z."""
        n, m = self.states, len(self.maps)
        free = np.ones(self.matrix.shape, dtype=bool)
        free[n : n + m, n + 1 :] = False
        return free

    @property
    def parameters(self) -> Array:
        """(p,) the elements of M row by row, those of F for maps that are multiplied, of the maps, z₀ and y₀."""
        own = [self.factors[self.multiplied].ravel(), *(each.parameters for each in self.maps)]
        return np.concatenate([self.matrix[self.free_entries], *own, self.map_offsets, [self.output_offset]])

    @cached_property
    def spans(self) -> tuple[slice, ...]:
        """The slice of the parameters that belongs to each map."""
        first = int(self.free_entries.sum()) + len(self.multiplied) * (self.states + 2)
        edges = np.cumsum([first, *(len(each.parameters) for each in self.maps)])
        return tuple(slice(int(a), int(b)) for a, b in pairwise(edges))

    def with_parameters(self, theta: Array | None = None, /, **values: float) -> FeedbackModel:
        """The same model with all parameters (p,) given, unchecked, or with some by name; see `RunMethods`."""
        if theta is None:
            return super().with_parameters(**values)  # type: ignore[no-any-return]
        matrix, factors, count = np.zeros(self.matrix.shape), self.factors, int(self.free_entries.sum())
        matrix[self.free_entries] = theta[:count]
        if len(self.multiplied):
            factors = factors.copy()
            factors[self.multiplied] = theta[count : self.spans[0].start].reshape(-1, factors.shape[1])
        maps = tuple(each.with_parameters(theta[span]) for each, span in zip(self.maps, self.spans, strict=True))
        first, kept = len(theta) - 1 - len(maps), ("names", "spans", "free_entries", "multiplied")
        kept_values = {name: getattr(self, name) for name in kept}
        new = copy(self)  # same structure: no new checks
        vars(new).update(matrix=matrix, maps=maps, map_offsets=theta[first:-1], output_offset=float(theta[-1]))
        vars(new).pop("_numbers", None)
        vars(new).update(kept_values, factors=factors)
        return new

    def check(self) -> None:
        """Refuse maps outside their families.

        Raises:
            Infeasible: with the map.
        """
        for k, each in enumerate(self.maps, start=1):
            try:
                each.check()
            except Infeasible as problem:
                raise Infeasible(f"{self.name}, map {k}: {problem}") from None

    @property
    def memory(self) -> int:
        """The number of samples of a segment that its initial state is estimated from."""
        return self.edge + SAMPLES_PER_STATE * self.states

    @cached_property
    def _input_path(self) -> InputPath:
        """How the input reaches the linear part."""
        return InputPath(self.delay, self.oversampling, self.held)

    @property
    def edge(self) -> int:
        """Samples at the start of a segment for which the interpolated or delayed input is not known."""
        return self._input_path.edge

    @property
    def latency(self) -> int:
        """The delay of the output in samples; see `InputPath.latency`."""
        return self._input_path.latency

    def trajectory(self, u: Array, x: Array) -> LoopSignals:
        """Every signal of the run over an input (N,), L steps per sample, from a state (n,).

        Raises:
            Infeasible: if a signal is not finite.
        """
        out, _ = self.stepped(self.entering(u), x)
        if not np.isfinite(out.y).all():
            raise Infeasible(f"the free run of {self.name} diverges; scale the channels or choose a smaller order")
        return out

    def output(self, u: Array, x: Array) -> Array:
        """(N,) the free run from an input (N,) and an initial state (n,)."""
        return self.trajectory(u, x).y[:: self.oversampling]

    def outputs(self, u: Array, states: Array) -> Array:
        """(k, N) the free runs from several initial states (k, n); NaN from where one diverges."""
        v, rate, begun = self.entering(u), self.oversampling, np.array(states, dtype=float)
        if self._numbers is None:
            return np.array([self.stepped(v, x)[0].y[::rate] for x in begun])
        y = np.empty((len(begun), len(u)))
        run_each(*self._numbers, read_only(v), begun, rate, y)
        return y

    def reachable(self, u: Array) -> Array:
        """(K, n) the states that an input (N,) produces from rest, until the run diverges."""
        out, _ = self.stepped(self.entering(u), self.resting(float(u[0])))
        visited: Array = out.x[np.isfinite(out.y)]
        return visited

    def with_state_gradient(self, u: Array, states: Array) -> tuple[Array, Array]:
        """(N,) the free run, and (N, n) its derivative with respect to the initial state."""
        passed = self.trajectory(u, states)
        return passed.y[:: self.oversampling], self.gradient(u, passed)[:, len(self.parameters) :]

    def gradient(self, u: Array, passed: LoopSignals) -> Array:
        """(N, p + n) the derivative of the output with respect to parameters and initial state.

        Args:
            u: (N,) input.
            passed: the result of `trajectory`.
        """
        blocks = [rows for _, rows in self.gradients(u, passed)]
        return blocks[0] if len(blocks) == 1 else np.concatenate(blocks)

    def gradients(self, u: Array, passed: LoopSignals) -> Iterator[tuple[slice, Array]]:
        """`gradient` by blocks of samples, each with its samples; of a long record, all together take much memory."""
        v, rate, width = read_only(self.entering(u)), self.oversampling, len(self.parameters) + self.states
        matrix, factors = read_only(self.matrix), read_only(self.factors)
        now = np.eye(self.states, width, width - self.states)
        for first in range(0, len(u), BLOCK):
            steps, out = slice(first * rate, (first + BLOCK) * rate), np.empty((min(BLOCK, len(u) - first), width))
            maps = slopes_along(self, passed.x[steps], v[steps], passed.z[steps])
            x, w = passed.x[steps], passed.w[steps]
            derivative(matrix, factors, self.multiplied, maps, v[steps], x, w, rate, now, out)
            yield slice(first, first + len(out)), out

    def factor(self, x: Array, u: Array) -> Array:
        """(K, m) g at the states (K, n) and inputs (K,)."""
        n = self.states
        found: Array = x @ self.factors[:, :n].T + np.outer(u, self.factors[:, n]) + self.factors[:, n + 1]
        return found

    def entering(self, u: Array) -> Array:
        """(NL,) the input interpolated and delayed; its first value holds before the start."""
        return np.ascontiguousarray(self._input_path.steps(u))

    def linearised(self, z: Array, g: Array) -> Array:
        """(n + 1, n + 1) the matrix from (x, u) to (x⁺, y) at the inputs (m,) of the maps and their factors (m,)."""
        n, m = self.states, len(self.maps)
        at = [(each, z[i : i + 1]) for i, each in enumerate(self.maps)]
        slopes = g * np.array([float(each.slope(here)[0]) for each, here in at])
        values = np.array([float(each.value(here)[0]) for each, here in at])
        rows = slopes[:, None] * self.matrix[n : n + m, : n + 1] + values[:, None] * self.factors[:, : n + 1]
        closed = self.matrix[:, : n + 1] + self.matrix[:, n + 1 :] @ rows
        return np.delete(closed, np.s_[n : n + m], axis=0)

    def linearised_at(self, x: Array, u: float) -> tuple[Array, Array]:
        """(n,) the state one step after a state (n,) under an input, and `linearised` there."""
        step, after = self.stepped(np.full(1, u), x)
        return after, self.linearised(step.z[0], self.factor(step.x, np.full(1, u))[0])

    def resting(self, level: float) -> Array:
        """(n,) the steady state for a constant input; see `emsid.models.feedback.model`."""
        return resting(self, level)

    def at_rest(self, level: ArrayLike = 0.0, dt: float | None = None) -> FeedbackState:
        """The steady state for a constant input; see `Model.at_rest`."""
        u = float(levels(self.name, level, 1)[0])
        return FeedbackState(np.full(self._input_path.kept, u), self.resting(u))

    def initial(self, segment: Record, samples: int) -> FeedbackState:
        """The state after the first ``samples`` samples of a segment, see `emsid.models.initial_states`."""
        u, y = segment.input[:, 0], segment.output[:samples, 0]
        x = initial_state(self, u, y)
        entering, past = self._input_path.until(u, samples)
        _, after = self.stepped(np.ascontiguousarray(entering), x)
        return FeedbackState(past, after)

    def run(self, state: FeedbackState, inputs: Array) -> tuple[Array, FeedbackState]:
        """The outputs (N, 1) for inputs (N, 1), `latency` samples late, and the state after them."""
        v, past = self._input_path.continued(state.inputs, inputs[:, 0])
        out, after = self.stepped(np.ascontiguousarray(v), state.x)
        return out.y[:: self.oversampling, None].copy(), FeedbackState(past, after)

    def equation(self) -> str:
        """One line for every signal; one step is a sample, or a fraction of it with oversampling."""
        late, faster = f"-{self.delay}" if self.delay else "", self.oversampling > 1
        sampling = ""
        if faster:
            step = f" of {self.dt:g} s" if self.dt is not None else ""
            how = "held" if self.held else "interpolated (band-limited)"
            sampling = f", with u {how} at t = 0, 1/{self.oversampling}, … samples{step}"
        entering = f"v(t) = u(t{late}){sampling}" if faster or late else ""
        step = f"1/{self.oversampling}" if faster else "1"
        return equations(self.matrix, self.factors, self._offsets, self.maps, entering, step)

    def to_data(self) -> dict[str, Any]:
        """The linear part, maps, offsets and delay."""
        return {
            "name": self.name,
            "matrix": self.matrix.tolist(),
            "maps": [each.to_data() for each in self.maps],
            "map_offsets": self.map_offsets.tolist(),
            "output_offset": self.output_offset,
            "delay": self.delay,
            "oversampling": self.oversampling,
            "held": self.held,
            **({} if self.dt is None else {"dt": self.dt}),
            **({"factors": self.factors.tolist()} if len(self.multiplied) else {}),
            **({"shared": [list(pair) for pair in self.shared]} if self.shared else {}),
            **({"centre": self.centre.tolist()} if self.centre.any() else {}),
            **({} if self.sensor is None else {"sensor": self.sensor}),
        }

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> FeedbackModel:
        """The model described by `to_data`.

        Raises:
            ModelError: for data that do not describe a feedback model.
        """
        try:
            maps = tuple(block_from_data(each) for each in data["maps"])
            return cls(
                np.array(data["matrix"], dtype=float),
                maps,  # type: ignore[arg-type]  # checked by the class
                np.array(data["map_offsets"], dtype=float),
                float(data["output_offset"]),
                int(data["delay"]),
                int(data["oversampling"]),
                bool(data.get("held", False)),
                str(data["name"]),
                None if data.get("dt") is None else float(data["dt"]),
                np.array(data.get("factors", ()), dtype=float),
                tuple((str(first), str(second)) for first, second in data.get("shared", ())),
                np.array(data.get("centre", ()), dtype=float),
                None if data.get("sensor") is None else int(data["sensor"]),
            )
        except (KeyError, TypeError, ValueError) as problem:
            raise ModelError(f"not a feedback model: {problem!r}") from None

    @cached_property
    def _numbers(self) -> tuple[Array, Array, Array, Tables] | None:
        """Its matrix, offsets, factors and maps as the kernels read them; None if a map is no polynomial."""
        with np.errstate(over="ignore", invalid="ignore"):  # of a map that a search has made too steep
            tables = tables_of(self.maps)
        if tables is None:
            return None
        return read_only(self.matrix), self._offsets, read_only(self.factors), tables

    @property
    def _offsets(self) -> Array:
        """(m + 1,) z₀ and y₀."""
        return np.append(self.map_offsets, self.output_offset)

    def stepped(self, v: Array, x: Array) -> tuple[LoopSignals, Array]:
        """The signals of a run over the input at the model's own steps, NaN from where it diverges; and the last
        state."""
        out, state = LoopSignals.empty(len(v), self.states, len(self.maps)), np.array(x, dtype=float)
        if self._numbers is not None:
            reached = run(*self._numbers, read_only(v), state, out)
        else:
            with np.errstate(over="ignore", invalid="ignore"):
                reached = run_reference(self.matrix, self._offsets, self.factors, self.maps, v, state, out)
        out.y[reached:] = np.nan
        return out, state

    def entries(self, signal: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(n + 1,) rows and columns of M that belong to z of a map or y, or to w of a map or u: ``"z1"``."""
        return entries(self.matrix, len(self.maps), signal)

    def numbered(self, letter: str) -> tuple[str, ...]:
        """z for one map; z1, z2, … for several."""
        return numbered(letter, len(self.maps))

    @property
    def names_of_outputs(self) -> tuple[str, ...]:
        """The names of what the maps give: w, or w/g where it is multiplied by a signal."""
        both = enumerate(zip(self.numbered("w"), self.numbered("g"), strict=True))
        return tuple(f"{w}/{g}" if k in self.multiplied else w for k, (w, g) in both)


def slopes_along(model: FeedbackModel, x: Array, u: Array, z: Array) -> MapSlopes:
    """The maps and their derivatives at the states (K, n), inputs (K,) and inputs of the maps (K, m) of a run."""
    g = model.factor(x, u).T if len(model.multiplied) else model.factors[:, -1:]
    return map_slopes(model.maps, g, model.multiplied, z)


# Steps in which a state comes close to rest, and Newton steps that complete it.
SETTLING, NEWTON = 2_000, 50
# Newton steps below this share of the state end when they no longer shrink, and at rest a step changes less of it.
ROUNDING = 1e-9


class Stepping(Protocol):
    """What a steady state needs of a model."""

    @property
    def states(self) -> int:
        """How many there are, n."""
        ...

    @property
    def centre(self) -> Array:
        """(n,) where the run begins."""
        ...

    def stepped(self, v: Array, x: Array) -> tuple[LoopSignals, Array]:
        """The signals of a run over an input (N,) from a state (n,), and the last state."""
        ...

    def linearised_at(self, x: Array, u: float) -> tuple[Array, Array]:
        """(n,) the state one step after a state (n,), and (n + 1, n + 1) its derivative by state and input."""
        ...


def resting(model: Stepping, level: float) -> Array:
    """(n,) the steady state for a constant input: where a run from the centre ends, completed by Newton steps.

    Where these find no rest, or one that a run leaves, it is the end of the run, as of an oscillation in friction.
    """
    out, end = model.stepped(np.full(SETTLING, level), model.centre)
    if not np.isfinite(out.y).all():
        return _completed(model, model.centre, level)
    rest = _completed(model, end, level)
    after, whole = model.linearised_at(rest, level)
    found = np.abs(after - rest).max(initial=0.0) <= ROUNDING * np.abs(rest).max(initial=0.0)
    poles = np.linalg.eigvals(whole[: model.states, : model.states]) if found else np.array([np.inf])
    return rest if np.abs(poles).max(initial=0.0) <= 1 else end


def _completed(model: Stepping, x: Array, level: float) -> Array:
    """(n,) the steady state that Newton steps from a state x (n,) lead to."""
    n, before = model.states, np.inf
    for _ in range(NEWTON):
        after, whole = model.linearised_at(x, level)
        with np.errstate(all="ignore"):
            try:
                move = np.linalg.solve(np.eye(n) - whole[:n, :n], after - x)
            except np.linalg.LinAlgError:  # an integrator rests anywhere
                break
        if not np.isfinite(move).all():
            break
        x, size = x + move, float(np.abs(move).max(initial=0.0))
        if size <= ROUNDING * np.abs(x).max(initial=0.0) and size >= before / 2:  # moves are rounding errors now
            break
        before = size
    return x


def absent(states: int, maps: int, sensor: int | None) -> NDArray[np.bool_]:
    """(n + m + 1, n + 1 + m) the elements of M that a sensor makes zero; none without a sensor.

    Args:
        states: n.
        maps: m.
        sensor: how many of the states are behind it.
    """
    n, m = states, maps
    gone = np.zeros((n + m + 1, n + 1 + m), dtype=bool)
    if sensor is not None:
        behind = range(n - sensor, n)
        rows, columns = [*behind, n + m], [*behind, n + 1]
        gone[rows], gone[:, columns] = True, True
        gone[np.ix_(rows, columns)] = False
    return gone


def check_sensor(name: str, states: int, maps: int, sensor: int | None, plain: bool) -> None:
    """Refuse a sensor that a model cannot have.

    Args:
        name: of the model.
        states: n.
        maps: m.
        sensor: how many of the states are behind it.
        plain: whether no map is multiplied by a signal, and no signals are shared.

    Raises:
        ModelError: without a map, with more states behind it than there are, or where the model is not plain.
    """
    if sensor is None:
        return
    check_whole(f"{name}: sensor", sensor, 0, "this is the number of states behind the sensor", states)
    if not maps:
        raise ModelError(f"{name}: a sensor without a map; the first map is its curve")
    if not plain:
        raise ModelError(f"{name}: a sensor, and maps that are multiplied or signals that are shared; leave out either")
