r"""Cascades of linear filters and static maps: Wiener–Hammerstein and its relatives, block by block.

    u(t − nk) − u₀ → block 1 → block 2 → … → + y₀ → y(t)

The paper proposes the structure filter–map–filter (sec. II.C, fig. 2.1) and estimates its expansion as a regression
(3.5), in which the blocks are no longer separate. Here the blocks themselves are the model. Their parameters are fitted
to the free run, the output that the model computes from the input alone.

**Derivatives.** With block i turning xᵢ into xᵢ₊₁, the chain rule reads, row by row of a growing matrix,

    δxᵢ₊₁ = pushᵢ(δxᵢ),      and appended   gradientᵢ  and  state_gradientᵢ:

the derivatives of the signal before block i pass through it, and those with respect to the block's own parameters and
initial state are appended. One pass gives the output and its exact derivative with respect to all parameters.

**Sampling.** An input that was measured through an anti-alias filter is band-limited between its samples, and a static
map generates harmonics above half the sampling rate. In a real system the second filter removes them before sampling; a
model that runs at the sampling rate aliases them. With ``oversampling`` L the input is interpolated to L times the
rate, the blocks run at that rate, and every L-th output is used. On the benchmark circuit of 2009 the error on unseen
data of the same structure falls from 0.287 to 0.238 mV with L = 2. An input that is held between samples (a drive's
command) needs no oversampling.

`gain` fixes the factors and levels that can be moved inside a cascade without changing its output; `fitting` fits a
cascade.

References:
    Kara, Abokoos, *A Simulation and Experimental Study on Identification of an Electromechanical System*.
    Schoukens, Tiels, *Identification of block-oriented nonlinear systems starting from linear approximations: a
    survey*, Automatica 85 (2017). Pintelon, Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed.
    (2012). Ljung, *System Identification*, 2nd ed. (1999), sec. 10.3 on gradients.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.linear.filtering import filter_rows
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.models.blocks.block import Block, block_from_data
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.initial_states import initial_state
from emsid.models.input_path import InputPath
from emsid.models.linear_parts import python_control
from emsid.models.model import levels
from emsid.models.one_channel import OneChannelMethods
from emsid.models.terms import check_whole
from emsid.record import Record

Array = NDArray[np.float64]

# Samples for every element of the initial state of a segment.
SAMPLES_PER_STATE = 8
# Reachable states are collected at this many times, or fewer.
REACHABLE = 4_000
# An offset this small, relative to the largest parameter, is rounding.
ROUNDING = 1e-12


class CascadeState(NamedTuple):
    """The state of a cascade between two samples.

    Attributes:
        inputs: (k,) past inputs for delay and interpolation, the oldest first.
        blocks: (s,) the states of all blocks in order.
    """

    inputs: Array
    blocks: Array


@dataclass(frozen=True, eq=False, repr=False)
class Cascade(OneChannelMethods):
    """A sequence of blocks, with offsets and an input delay.

    Args:
        blocks: filters and static maps, in the order of the signal.
        input_offset: u₀, subtracted from the input before the first block, in the input's unit.
        output_offset: y₀, added after the last block, in the output's unit.
        delay: nk, samples from the input to its first effect.
        oversampling: L, how many times faster than the record the blocks run.
        name: name in tables and files.
        dt: sample time in s of its records; None for any.

    Raises:
        ModelError: without blocks, for an object that is not a block, an invalid delay or oversampling, or offsets that
            are not finite.
    """

    blocks: tuple[Block, ...]
    input_offset: float = 0.0
    output_offset: float = 0.0
    delay: int = 0
    oversampling: int = 1
    name: str = "cascade"
    dt: float | None = None

    models_noise: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not isinstance(self.blocks, tuple):
            object.__setattr__(self, "blocks", (self.blocks,) if isinstance(self.blocks, Block) else tuple(self.blocks))
        if not self.blocks:
            raise ModelError(f"{self.name}: a cascade needs at least one block")
        for k, block in enumerate(self.blocks, start=1):
            # A check against a protocol looks for every method; those of the program need none.
            if not isinstance(block, (Rational, StaticMap, Block)):
                raise ModelError(f"{self.name}, block {k}: {block!r} is no filter and no static map")
        check_whole(f"{self.name}: delay", self.delay, 0, "a model cannot look ahead")
        check_whole(f"{self.name}: oversampling", self.oversampling, 1, "blocks run at least as fast as the record")
        if not np.isfinite([self.input_offset, self.output_offset]).all():
            raise ModelError(f"{self.name}: offsets {self.input_offset}, {self.output_offset}; give finite numbers")
        if self.dt is not None and not (np.isfinite(self.dt) and self.dt > 0):
            raise ModelError(f"{self.name}: sample time {self.dt} s; it must be a positive number of seconds")

    @cached_property
    def names(self) -> tuple[str, ...]:
        """A name for every parameter: the block's own, prefixed with ``G1.``, ``G2.`` for filters, ``f.`` for maps."""
        letters = ["G" if isinstance(block, Rational) else "f" for block in self.blocks]
        names: list[str] = []
        for k, (letter, block) in enumerate(zip(letters, self.blocks, strict=True)):
            number = "" if letters.count(letter) == 1 else str(letters[: k + 1].count(letter))
            names += [f"{letter}{number}.{name}" for name in block.names]
        return (*names, "u0", "y0")

    @property
    def parameters(self) -> Array:
        """(p,) the parameters of all blocks, then u₀ and y₀."""
        return np.concatenate([*(block.parameters for block in self.blocks), [self.input_offset, self.output_offset]])

    @property
    def filters(self) -> dict[int, Rational]:
        """The linear filters by their places among the blocks, from 0."""
        return {k: block for k, block in enumerate(self.blocks) if isinstance(block, Rational)}

    @property
    def maps(self) -> dict[int, StaticMap]:
        """The static maps by their places among the blocks, from 0."""
        return {k: block for k, block in enumerate(self.blocks) if isinstance(block, StaticMap)}

    @cached_property
    def spans(self) -> tuple[slice, ...]:
        """The slice of the parameters that belongs to each block."""
        edges = np.cumsum([0] + [len(block.parameters) for block in self.blocks])
        return tuple(slice(int(a), int(b)) for a, b in pairwise(edges))

    @cached_property
    def states(self) -> int:
        """The number of states of all blocks."""
        return sum(block.states for block in self.blocks)

    @property
    def memory(self) -> int:
        """The number of samples of a segment that its initial states are estimated from."""
        return self.edge + SAMPLES_PER_STATE * self.states

    @cached_property
    def _input_path(self) -> InputPath:
        """How the input reaches the first block."""
        return InputPath(self.delay, self.oversampling)

    @property
    def edge(self) -> int:
        """Samples at the start of a segment for which the interpolated or delayed input is not known."""
        return self._input_path.edge

    @property
    def latency(self) -> int:
        """The delay of the output in samples; see `InputPath.latency`."""
        return self._input_path.latency

    def with_parameters(self, theta: Array | None = None, /, **values: float) -> Cascade:
        """The same cascade with all parameters (p,) given, unchecked, or with some by name; see `RunMethods`."""
        if theta is None:
            return super().with_parameters(**values)  # type: ignore[no-any-return]
        blocks = tuple(block.with_parameters(theta[span]) for block, span in zip(self.blocks, self.spans, strict=True))
        new = copy(self)  # same structure: no new checks, same names and spans
        vars(new).update(blocks=blocks, input_offset=float(theta[-2]), output_offset=float(theta[-1]))
        return new

    def check(self) -> None:
        """Refuse parameters of a model that cannot be run.

        Raises:
            Infeasible: for an unstable filter and the like, with the block.
        """
        for k, block in enumerate(self.blocks, start=1):
            try:
                block.check()
            except Infeasible as problem:
                raise Infeasible(f"{self.name}, block {k}: {problem}") from None

    def signals(self, u: Array, states: Array) -> list[Array]:
        """Every signal (NL,) of the cascade: the delayed input minus u₀, then the output of each block.

        Args:
            u: (N,) input.
            states: (s,) initial states of all blocks in order.
        """
        x = self._entering(u)
        signals, first = [x], 0
        for block in self.blocks:
            x = block.output(x, states[first : first + block.states])
            first += block.states
            signals.append(x)
        return signals

    def signals_from_rest(self, u: Array) -> list[Array]:
        """`signals` over an input (N,) from rest at its first value."""
        return self.signals(u, self.resting(float(u[0])))

    def output(self, u: Array, states: Array) -> Array:
        """(N,) the free run from an input (N,) and initial states (s,)."""
        return self.sampled(self.signals(u, states))

    def outputs(self, u: Array, states: Array) -> Array:
        """(k, N) the free runs from an input (N,) and several initial states (k, s), faster than one by one."""
        rows, first = np.repeat(self._entering(u)[None], len(states), axis=0), 0
        for block in self.blocks:
            own = np.array(states[:, first : first + block.states], order="C")
            if isinstance(block, Rational):
                filter_rows(*block.transfer, rows, rows, own)
            elif isinstance(block, StaticMap):
                rows = block.value(rows.ravel()).reshape(rows.shape)
            else:
                rows = np.array([block.output(x, state) for x, state in zip(rows, own, strict=True)])
            first += block.states
        return rows[:, :: self.oversampling] + self.output_offset

    def sampled(self, signals: Sequence[Array]) -> Array:
        """(N,) the output, from the result of `signals`."""
        return signals[-1][:: self.oversampling] + self.output_offset

    def gradient(self, signals: Sequence[Array], states: bool = True) -> Array:
        """(p + s, N) the derivative of the output with respect to parameters and initial states.

        Args:
            signals: the result of `signals`.
            states: False leaves the initial states out, (p, N).
        """
        samples, count = len(signals[0]), len(self.parameters)
        rows = np.empty((count + self.states * states, samples))
        rows[count - 2] = -1.0
        state = count
        for block, span, x, y in zip(self.blocks, self.spans, signals[:-1], signals[1:], strict=True):
            for before in (slice(0, span.start), slice(count - 2, count - 1), slice(count, state)):
                block.push(x, rows[before])
            rows[span] = block.gradient(x, y)
            if states:
                rows[state : state + block.states] = block.state_gradient(samples)
                state += block.states
        rows[count - 1] = 1.0
        return rows[:, :: self.oversampling]

    def state_gradient(self, signals: Sequence[Array]) -> Array:
        """(s, N) the derivative of the output with respect to the initial states alone; see `gradient`."""
        rows, first = np.empty((self.states, len(signals[0]))), 0
        for block, x in zip(self.blocks, signals[:-1], strict=True):
            if first:
                block.push(x, rows[:first])
            rows[first : first + block.states] = block.state_gradient(len(x))
            first += block.states
        return rows[:, :: self.oversampling]

    def resting(self, level: float) -> Array:
        """(s,) the steady states for a constant input ``level``."""
        x = level - self.input_offset
        states = []
        for block in self.blocks:
            state, x = block.resting(x)
            states.append(state)
        return np.concatenate(states)

    def initial_state(self, u: Array, y: Array, quick: bool = False) -> Array:
        """(s,) initial states for an input (N,), from the first outputs (m ≤ N,); see `emsid.models.initial_states`."""
        return initial_state(self, u, y, quick)

    def with_state_gradient(self, u: Array, states: Array) -> tuple[Array, Array]:
        """(N,) the free run, and (N, s) its derivative with respect to the initial states."""
        signals = self.signals(u, states)
        return self.sampled(signals), self.state_gradient(signals).T

    def reachable(self, u: Array) -> Array:
        """(2m, s) the states that an input (N,) produces from zero and from rest, at `REACHABLE` times or fewer."""
        reachable = []
        for states in (np.zeros(self.states), self.resting(float(u[0]))):
            signals = self.signals(u, states)
            times = np.arange(0, len(signals[0]), -(-len(signals[0]) // REACHABLE))
            inside = zip(self.blocks, signals[:-1], signals[1:], strict=True)
            reachable.append(np.concatenate([block.visited(x, y, times) for block, x, y in inside]))
        visited: Array = np.concatenate(reachable, axis=1).T
        return visited

    def at_rest(self, level: ArrayLike = 0.0, dt: float | None = None) -> CascadeState:
        """The steady state for a constant input; see `Model.at_rest`."""
        u = float(levels(self.name, level, 1)[0])
        return CascadeState(np.full(self._input_path.kept, u), self.resting(u))

    def initial(self, segment: Record, samples: int) -> CascadeState:
        """The state after the first ``samples`` samples of a segment, estimated by `initial_state`."""
        u, y = segment.input[:, 0], segment.output[:samples, 0]
        states = self.initial_state(u, y)
        entering, past = self._input_path.until(u, samples)
        x, first = entering - self.input_offset, 0
        after = []
        for block in self.blocks:
            x, state = block.run(x, states[first : first + block.states])
            after.append(state)
            first += block.states
        return CascadeState(past, np.concatenate(after))

    def run(self, state: CascadeState, inputs: Array) -> tuple[Array, CascadeState]:
        """The outputs (N, 1) for inputs (N, 1), `latency` samples late, and the state after them."""
        entering, past = self._input_path.continued(state.inputs, inputs[:, 0])
        x, first, after = entering - self.input_offset, 0, []
        for block in self.blocks:
            x, kept = block.run(x, state.blocks[first : first + block.states])
            after.append(kept)
            first += block.states
        return self.sampled([x])[:, None], CascadeState(past, np.concatenate(after))

    def equation(self) -> str:
        """One line per block, without offsets that are rounding.

        Time t and q⁻¹ count samples of the record. With oversampling, the first line says so, and delays are fractions
        of a sample: ``q^-(1/2)`` is one step of a block at twice the rate.
        """
        rounding = ROUNDING * float(np.max(np.abs(self.parameters)))
        before, behind = (
            f" {'-' if offset < 0 else '+'} {abs(offset):.6g}" if abs(offset) > rounding else ""
            for offset in (-self.input_offset, self.output_offset)
        )
        late = f"-{self.delay}" if self.delay else ""
        faster = self.oversampling > 1
        enters = [f"v(t) = u(t{late}){before}{self._steps if faster else ''}"] if late or before or faster else []
        signals = ["v" if enters else "u", *(f"x{k}" for k in range(1, len(self.blocks))), "y"]
        lines = [
            block.equation(x, y, self.oversampling) if isinstance(block, Rational) else block.equation(x, y)
            for block, (x, y) in zip(self.blocks, pairwise(signals), strict=True)
        ]
        return "\n".join([*enters, *lines[:-1], f"{lines[-1]}{behind} + e(t)"])

    @property
    def _steps(self) -> str:
        """The note on the sampling of the blocks, for oversampling."""
        step = f" of {self.dt:g} s" if self.dt is not None else ""
        return f", with u interpolated (band-limited) at t = 0, 1/{self.oversampling}, … samples{step}"

    def to_data(self) -> dict[str, Any]:
        """Blocks, offsets and delay."""
        return {
            "name": self.name,
            "blocks": [block.to_data() for block in self.blocks],
            "input_offset": self.input_offset,
            "output_offset": self.output_offset,
            "delay": self.delay,
            "oversampling": self.oversampling,
            **({} if self.dt is None else {"dt": self.dt}),
        }

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Cascade:
        """The cascade described by `to_data`.

        Raises:
            ModelError: for data that do not describe a cascade.
        """
        try:
            return cls(
                tuple(block_from_data(block) for block in data["blocks"]),
                float(data["input_offset"]),
                float(data["output_offset"]),
                int(data["delay"]),
                int(data["oversampling"]),
                str(data["name"]),
                None if data.get("dt") is None else float(data["dt"]),
            )
        except (KeyError, TypeError, ValueError) as problem:
            raise ModelError(f"not a cascade: {problem!r}") from None

    def to_control(self, dt: float | None = None) -> tuple[Any, ...]:
        """Its filters as python-control systems; the delay is in the first.

        Args:
            dt: sample time of the records in s, by default that of the cascade; oversampled filters get their own step.

        Raises:
            ModelError: if python-control is not installed, or no sample time is known.
        """
        control = python_control()
        return tuple(control.TransferFunction(b, a, self._step(dt)) for b, a in self._transfers())

    def _step(self, dt: float | None) -> float:
        """The step of the blocks in s."""
        given = self.dt if dt is None else dt
        if given is None:
            raise ModelError(f"{self.name} has no sample time; give that of the records, dt=… in s", arguments=("dt",))
        return given / self.oversampling

    def _transfers(self) -> list[tuple[Array, Array]]:
        """Numerator and denominator of every filter in falling powers of z."""
        pairs = [block.transfer for block in self.blocks if isinstance(block, Rational)]
        if pairs and self.delay and isinstance(self.blocks[0], Rational):
            b, a = pairs[0]
            late = np.zeros(self.delay * self.oversampling)
            pairs[0] = np.concatenate([late, b]), np.concatenate([a, late])
        return [(np.trim_zeros(b, "f"), a) for b, a in pairs]

    def _entering(self, u: Array) -> Array:
        """The input at the steps of the blocks, minus u₀."""
        return self._input_path.steps(u) - self.input_offset
