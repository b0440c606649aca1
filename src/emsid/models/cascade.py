r"""Cascades of linear filters and static maps: Wiener–Hammerstein and its relatives, block by block.

    u(t − nk) − u₀ → block 1 → block 2 → … → + y₀ → y(t)

The paper names the structure filter–map–filter (sec. II.C, fig. 2.1) and then estimates the regression that it expands
to (3.5), in which the blocks can no longer be seen. Here the blocks themselves are the model, and their parameters are
fitted to the free run, the output that the model gives from the input alone.

**Derivatives.** With block i turning xᵢ into xᵢ₊₁, the chain rule reads, row by row of a growing matrix,

    δxᵢ₊₁ = pushᵢ(δxᵢ),      and appended   gradientᵢ  and  state_gradientᵢ:

everything that moved the signal before block i is pushed through it, and the block's own parameters and starting
state join. One pass gives the output and its derivative with respect to all parameters, exactly.

**Normalisation.** A factor can be moved between a filter and the map beside it, and a level between a map and the
offset behind it, without a change outside. Two normalisations say where they are put:

- `unit_gain`, in which models are fitted and given: every filter that can pass its gain to a map has a gain of one at
  DC (at its peak, if it blocks DC). The map's input is then in the unit of u and its output in that of y.
- `unit_slope`, the paper's λ₁ = 1 (5.3): in addition the map has a slope of one, and the last filter all the gain.
  (λ₁ = 1 alone does not suffice: b₁ → cb₁, λ₂ → λ₂/c, d → d/c leaves (5.8) as it is.)

A unit DC gain is the linear constraint Σb = 1 + Σa. The fit therefore runs in the coordinates φ of `Freedom`, θ = θ₀ +
Cφ, in which one numerator coefficient follows from the others, and what is redundant stays where it is; covariances go
back through C exactly.

**Sampling.** Between samples an input that was measured through an anti-alias filter is the band-limited signal through
its samples, and a map of it makes harmonics beyond half the sampling rate. A real system's second filter removes them
before they are sampled; a model that runs at the sampling rate folds them back. With ``oversampling`` L the input is
interpolated to L times the rate, the blocks run there, and every L-th output counts. On the benchmark circuit of 2009
the held-back error of the same structure falls from 0.287 to 0.238 mV with L = 2. An input that is held between samples
(a drive's command) needs none.

**Transients.** What a filter held when a record began is not known. It is estimated along with the parameters, a few
numbers per segment, or, by choice, the first samples are left out.

References:
    Kara, Abokoos, *A Simulation and Experimental Study on Identification of an Electromechanical System*.
    Schoukens, Tiels, *Identification of block-oriented nonlinear systems starting from linear approximations: a
    survey*, Automatica 85 (2017). Pintelon, Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed.
    (2012). Ljung, *System Identification*, 2nd ed. (1999), sec. 10.3 on gradients.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.gauss_newton import Infeasible, Iteration, Minimum, gauss_newton
from emsid.estimation.losses import SQUARES, Loss, Squares
from emsid.estimation.model_error import model_error_covariance
from emsid.models.blocks import Block, block_from_data
from emsid.models.filters import INTERPOLATION_REACH, Rational, interpolated
from emsid.models.model import RUNAWAY, Run
from emsid.models.static_maps import Scaling, StaticMap
from emsid.models.terms import check_whole
from emsid.record import Record

if TYPE_CHECKING:
    from scipy.signal import dlti

Array = NDArray[np.float64]

# A segment's start is described by this many samples for every state that has to be found from it.
SAMPLES_PER_STATE = 8
# How firmly the first look at a starting state holds it at rest, relative to what the samples of the start say.
REST = 1e-2
# So many samples say how the model error bends the cost.
CURVATURE_SAMPLES = 5_000
# An offset this small, relative to the largest parameter, is rounding.
ROUNDING = 1e-12
# What finding a starting state may cost; a twentieth of its standard error is near enough, and half of it for the first
# look, which is after the variance of the residual.
FIRST_LOOK: dict[str, Any] = {"max_iterations": 4, "tolerance": 0.5, "inner": True}
START_BUDGET: dict[str, Any] = {"max_iterations": 8, "tolerance": 0.05, "inner": True}
# A search for it may begin at so many of the states that the input leads to.
TRIAL_STATES = 64
# The states that the input leads to are looked at over so many samples; no direction among them is flatter than this.
CLOUD, FLAT = 10_000, 1e-12


@dataclass(frozen=True, eq=False)
class Cascade:
    """A sequence of blocks, with offsets and an input delay.

    Args:
        blocks: filters and static maps, in the order in which the signal meets them.
        input_offset: u₀, taken off the input before the first block, in the input's unit.
        output_offset: y₀, added after the last block, in the output's unit.
        delay: nk, samples from the input to its first effect.
        oversampling: L, how many times faster than the record the blocks run.
        name: what to call it in tables and files.

    Raises:
        ModelError: without blocks, for what is no block, a delay or oversampling that is no whole number or too small,
            offsets that are not finite.
    """

    blocks: tuple[Block, ...]
    input_offset: float = 0.0
    output_offset: float = 0.0
    delay: int = 0
    oversampling: int = 1
    name: str = "cascade"

    def __post_init__(self) -> None:
        object.__setattr__(self, "blocks", tuple(self.blocks))
        if not self.blocks:
            raise ModelError(f"{self.name}: a cascade needs at least one block")
        for k, block in enumerate(self.blocks, start=1):
            if not isinstance(block, Block):
                raise ModelError(f"{self.name}, block {k}: {block!r} is no filter and no static map")
        check_whole(f"{self.name}: delay", self.delay, 0, "a model cannot look ahead")
        check_whole(f"{self.name}: oversampling", self.oversampling, 1, "blocks run at least as fast as the record")
        if not np.isfinite([self.input_offset, self.output_offset]).all():
            raise ModelError(f"{self.name}: offsets {self.input_offset}, {self.output_offset}; give finite numbers")

    @cached_property
    def names(self) -> tuple[str, ...]:
        """A name for every parameter: the block's own, after ``G1.``, ``G2.`` for filters, ``f.`` for maps."""
        letters = ["G" if isinstance(block, Rational) else "f" for block in self.blocks]
        names: list[str] = []
        for k, (letter, block) in enumerate(zip(letters, self.blocks, strict=True)):
            number = "" if letters.count(letter) == 1 else str(letters[: k + 1].count(letter))
            names += [f"{letter}{number}.{name}" for name in block.names]
        return (*names, "u0", "y0")

    @property
    def parameters(self) -> Array:
        """(p,) those of all blocks, then u₀ and y₀."""
        return np.concatenate([*(block.parameters for block in self.blocks), [self.input_offset, self.output_offset]])

    @cached_property
    def spans(self) -> tuple[slice, ...]:
        """Where in the parameters those of every block are."""
        edges = np.cumsum([0] + [len(block.parameters) for block in self.blocks])
        return tuple(slice(int(a), int(b)) for a, b in pairwise(edges))

    @cached_property
    def states(self) -> int:
        """How many numbers describe the start of all blocks together."""
        return sum(block.states for block in self.blocks)

    @property
    def memory(self) -> int:
        """How many samples of a segment its starting states are found from."""
        return self.edge + SAMPLES_PER_STATE * self.states

    @property
    def edge(self) -> int:
        """Samples of a segment at whose time the input between samples, or before them, is not known."""
        return self.delay + (INTERPOLATION_REACH if self.oversampling > 1 else 0)

    def with_parameters(self, theta: Array) -> Cascade:
        """The same cascade with other parameters (p,)."""
        blocks = tuple(block.with_parameters(theta[span]) for block, span in zip(self.blocks, self.spans, strict=True))
        new = copy(self)  # of the same structure, which need not be checked again, and whose names and spans it keeps
        vars(new).update(blocks=blocks, input_offset=float(theta[-2]), output_offset=float(theta[-1]))
        return new

    def check(self) -> None:
        """Refuse parameters that make no working model.

        Raises:
            Infeasible: for an unstable filter and the like, saying which block.
        """
        for k, block in enumerate(self.blocks, start=1):
            try:
                block.check()
            except Infeasible as problem:
                raise Infeasible(f"{self.name}, block {k}: {problem}") from None

    def signals(self, u: Array, states: Array) -> list[Array]:
        """Every signal (NL,) of the cascade: the delayed input less u₀, and what each block makes of it.

        Args:
            u: (N,) input.
            states: (s,) starting states of all blocks, one after the other.
        """
        x = self._entering(u)
        signals, first = [x], 0
        for block in self.blocks:
            x = block.output(x, states[first : first + block.states])
            first += block.states
            signals.append(x)
        return signals

    def output(self, u: Array, states: Array) -> Array:
        """(N,) the free run from an input (N,) and starting states (s,)."""
        return self.sampled(self.signals(u, states))

    def sampled(self, signals: Sequence[Array]) -> Array:
        """(N,) the output that `signals` amount to."""
        return signals[-1][:: self.oversampling] + self.output_offset

    def gradient(self, signals: Sequence[Array]) -> Array:
        """(p + s, N) the derivative of the output with respect to parameters and starting states.

        Args:
            signals: what `signals` gave.
        """
        samples, count = len(signals[0]), len(self.parameters)
        rows = np.empty((count + self.states, samples))
        rows[count - 2] = -1.0
        state = count
        for block, span, x, y in zip(self.blocks, self.spans, signals[:-1], signals[1:], strict=True):
            for before in (slice(0, span.start), slice(count - 2, count - 1), slice(count, state)):
                block.push(x, rows[before])
            rows[span] = block.gradient(x, y)
            rows[state : state + block.states] = block.state_gradient(samples)
            state += block.states
        rows[count - 1] = 1.0
        return rows[:, :: self.oversampling]

    def resting(self, level: float) -> Array:
        """(s,) starting states at which a constant input ``level`` leaves everything at rest."""
        x = level - self.input_offset
        states = []
        for block in self.blocks:
            state, x = block.resting(x)
            states.append(state)
        return np.concatenate(states)

    def starting(self, u: Array, y: Array) -> Array:
        """(s,) starting states that explain the first samples of a segment, and are such as the input leads to.

        A few samples tell nothing about a slow pole, whose part of the state would be noise carried on for long. So
        states are found twice: freely, for the variance of the residual, and then with that variance against a prior,
        the mean and covariance of the states that the input leads the blocks through. Behind a map that loses the sign
        there are several minima; the search begins at rest or at one of those states, whichever comes closest.

        Args:
            u: (N,) input of the segment.
            y: (m ≤ N,) measured output of its first samples; without any, the states at rest are given.
        """
        rest = self.resting(float(u[0])) if len(u) else np.zeros(self.states)
        if not (self.states and len(y)):
            return rest
        start = u[: len(y)]
        cloud = self._cloud(u[:CLOUD])
        trials = [rest, *cloud[:, :: -(-cloud.shape[1] // TRIAL_STATES)].T]
        missed = [float(np.sum((self.output(start, states) - y)[self.edge :] ** 2)) for states in trials]
        begin = trials[int(np.argmin(missed))]
        rows = self.gradient(self.signals(start, begin))[len(self.parameters) :, self.edge :]
        weak = np.diag(REST * np.linalg.norm(rows, axis=1))
        free = gauss_newton(_Start(self, start, y, rest, weak), begin, **FIRST_LOOK)
        freedom = len(y) - self.edge - self.states
        variance = np.sum(free.residuals[0] ** 2) / freedom if freedom > 0 else 0.0
        centre, spread = cloud.mean(axis=1), np.atleast_2d(np.cov(cloud))
        if not (variance > 0 and np.trace(spread) > 0):
            return free.estimate
        size, axes = np.linalg.eigh(spread)
        firmness = np.sqrt(variance / np.maximum(size, FLAT * size[-1]))[:, None] * axes.T
        return gauss_newton(_Start(self, start, y, centre, firmness), free.estimate, **START_BUDGET).estimate

    def _cloud(self, u: Array) -> Array:
        """(s, 2N) the states that an input (N,) leads to from zero and from rest."""
        clouds = []
        for states in (np.zeros(self.states), self.resting(float(u[0]))):
            signals = self.signals(u, states)
            visited = [block.visited(x, y) for block, x, y in zip(self.blocks, signals[:-1], signals[1:], strict=True)]
            clouds.append(np.concatenate(visited))
        return np.concatenate(clouds, axis=1)

    def simulate(self, record: Record, transient: int | None = None) -> Run:
        """Free run over every segment; the measured outputs of its start serve only to find the starting states.

        Args:
            record: one input, one output.
            transient: samples of every segment that start it, at least `memory`, which is the default.

        Raises:
            ModelError: for a record of other channels, or without a segment longer than the start.
        """
        skip = self.memory if transient is None else max(transient, self.memory)
        check_channels(self, record)
        if all(len(segment) <= skip for segment in record.segments):
            raise ModelError(f"{record.name}: no segment is longer than the {skip} samples that start {self.name}")
        output, counted = record.output.copy(), np.zeros(len(record), dtype=bool)
        bound = RUNAWAY * float(np.ptp(record.output) + np.max(np.abs(record.output)))  # a segment may be a standstill
        first, diverged = 0, None
        for segment in record.segments:
            u, y = segment.input[:, 0], segment.output[:, 0]
            stop = first + len(segment)
            if len(segment) > skip:
                with np.errstate(over="ignore", invalid="ignore"):
                    run = self.output(u, self.starting(u, y[:skip]))
                away = np.flatnonzero(~(np.abs(run) <= bound)) if bound > 0 else np.flatnonzero(~np.isfinite(run))
                if len(away):
                    run[away[0] :] = np.nan
                    diverged = first + int(away[0]) if diverged is None else diverged
                output[first + skip : stop, 0] = run[skip:]
                counted[first + skip : stop] = True
            first = stop
        return Run(output, counted, diverged)

    def predict(self, record: Record, horizon: int = 1, transient: int | None = None) -> Run:
        """The free run: all noise is taken to be on the output, so past outputs say nothing about the next one."""
        return self.simulate(record, transient)

    def equation(self) -> str:
        """One line per block; an offset that is rounding beside the other parameters is left out."""
        rounding = ROUNDING * float(np.max(np.abs(self.parameters)))
        before, behind = (
            f"{sign} ({offset:.6g})" if abs(offset) > rounding else ""
            for sign, offset in ((" -", self.input_offset), (" +", self.output_offset))
        )
        late = f"-{self.delay}" if self.delay else ""
        enters = [f"v(t) = u(t{late}){before}"] if late or before else []
        signals = ["v" if enters else "u", *(f"x{k}" for k in range(1, len(self.blocks))), "y"]
        lines = [block.equation(x, y) for block, (x, y) in zip(self.blocks, pairwise(signals), strict=True)]
        return "\n".join([*enters, *lines[:-1], f"{lines[-1]}{behind} + e(t)"])

    def to_data(self) -> dict[str, Any]:
        """Blocks, offsets and delay."""
        return {
            "name": self.name,
            "blocks": [block.to_data() for block in self.blocks],
            "input_offset": self.input_offset,
            "output_offset": self.output_offset,
            "delay": self.delay,
            "oversampling": self.oversampling,
        }

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Cascade:
        """The cascade that `to_data` described.

        Raises:
            ModelError: for data that describe none.
        """
        try:
            return cls(
                tuple(block_from_data(block) for block in data["blocks"]),
                float(data["input_offset"]),
                float(data["output_offset"]),
                int(data["delay"]),
                int(data["oversampling"]),
                str(data["name"]),
            )
        except (KeyError, TypeError, ValueError) as problem:
            raise ModelError(f"not a cascade: {problem!r}") from None

    def scipy_systems(self, dt: float) -> tuple[dlti, ...]:
        """Its filters as `scipy.signal` systems, for records of sample time ``dt``; the delay is in the first."""
        from scipy.signal import dlti

        return tuple(dlti(b, a, dt=dt / self.oversampling) for b, a in self._transfers())

    def control_systems(self, dt: float) -> tuple[Any, ...]:
        """Its filters as python-control systems, for records sampled every ``dt`` seconds; the delay is in the first.

        Raises:
            ModelError: where python-control is not installed.
        """
        from importlib import import_module

        try:
            control = import_module("control")
        except ImportError:
            raise ModelError("python-control is not installed; install it with: pip install emsid[control]") from None
        return tuple(control.TransferFunction(b, a, dt / self.oversampling) for b, a in self._transfers())

    def _transfers(self) -> list[tuple[Array, Array]]:
        """Numerator and denominator of every filter in falling powers of z."""
        pairs = [block.transfer for block in self.blocks if isinstance(block, Rational)]
        if pairs and self.delay and isinstance(self.blocks[0], Rational):
            b, a = pairs[0]
            late = np.zeros(self.delay * self.oversampling)
            pairs[0] = np.concatenate([late, b]), np.concatenate([a, late])
        return [(np.trim_zeros(b, "f"), a) for b, a in pairs]

    def _entering(self, u: Array) -> Array:
        """The input delayed (its first value held before the start), interpolated, less u₀."""
        if self.delay:
            u = np.concatenate([np.full(min(self.delay, len(u)), u[0]), u[: -self.delay]])
        return interpolated(u, self.oversampling) - self.input_offset


def check_channels(model: Cascade, record: Record) -> None:
    """Refuse a record of other than one input and one output.

    Raises:
        ModelError: naming the channels to choose from.
    """
    for side, names in (("input", record.input_names), ("output", record.output_names)):
        if len(names) != 1:
            raise ModelError(
                f"{model.name} has one {side} and {record.name} {len(names)}; choose one of "
                f"{', '.join(names) or 'them'}"
            )


# ------------------------------------------------------------------------------------------------ normalisation


def unit_gain(cascade: Cascade) -> Cascade:
    """The same model with a gain of one in every filter that can pass its gain to a map beside it.

    Raises:
        ModelError: for a filter of zeros.
    """
    for k in fixed_gains(cascade):
        block = cascade.blocks[k]
        assert isinstance(block, Rational)
        if not block.gain:
            raise ModelError(f"{cascade.name}, block {k + 1}: a filter of zeros lets nothing through; give others")
        cascade = _without_gain(cascade, k, block.gain)
    return cascade


def unit_slope(cascade: Cascade) -> Cascade:
    """The same model in the paper's normalisation λ₁ = 1: every map of unit slope, the gain in the last filter.

    Raises:
        ModelError: where a map has no slope to speak of, or there is no filter to take up its gain.
    """
    cascade = unit_gain(cascade)
    for k, block in enumerate(cascade.blocks):
        if not (isinstance(block, StaticMap) and block.scaling is Scaling.FREE):
            continue
        if block.steepness == 0:
            raise ModelError(f"{cascade.name}: block {k + 1} has a slope of zero; it cannot be scaled to one")
        blocks = list(cascade.blocks)
        behind = next((j for j in range(k + 1, len(blocks)) if isinstance(blocks[j], Rational)), None)
        before = next((j for j in range(k - 1, -1, -1) if isinstance(blocks[j], Rational)), None)
        if behind == k + 1:
            blocks[k] = block.scaled(1.0, 1 / block.steepness)
            blocks[behind] = blocks[behind].amplified(block.steepness)  # type: ignore[attr-defined]
        elif before == k - 1 and before is not None:
            blocks[k] = block.scaled(block.steepness, 1.0)
            blocks[before] = blocks[before].amplified(block.steepness)  # type: ignore[attr-defined]
        else:
            raise ModelError(f"{cascade.name}: no filter stands beside block {k + 1} to take up its slope")
        cascade = replace(cascade, blocks=tuple(blocks))
    return cascade


def normalised(fit: Fit[Cascade], normalisation: Callable[[Cascade], Cascade]) -> Fit[Cascade]:
    """The fit with its model, estimate and covariance in another normalisation, by the delta method.

    Args:
        fit: of a cascade, as the estimators give it.
        normalisation: `unit_gain`, `unit_slope` or another function that leaves the input–output behaviour alone.
    """
    theta = fit.model.parameters
    at = [fit.model.names.index(name) for name in fit.names]
    model = normalisation(fit.model)

    def moved(estimate: Array) -> Array:
        full = theta.copy()
        full[at] = estimate
        return normalisation(fit.model.with_parameters(full)).parameters

    step = np.cbrt(np.finfo(float).eps) * np.maximum(np.abs(fit.estimate), fit.standard_error)
    step[~(np.isfinite(step) & (step > 0))] = 1e-6
    slopes = np.array(
        [(moved(fit.estimate + d) - moved(fit.estimate - d)) / (2 * d.max()) for d in np.diag(step)]
    ).reshape(len(at), len(theta))
    covariance = slopes.T @ fit.covariance @ slopes
    kept = np.flatnonzero(np.diag(covariance) > 0)
    return replace(
        fit,
        model=model,
        names=tuple(model.names[k] for k in kept),
        estimate=model.parameters[kept],
        covariance=covariance[np.ix_(kept, kept)],
    )


def fixed_gains(cascade: Cascade) -> tuple[int, ...]:
    """The filters whose gain is redundant, because a map beside them can take it up."""
    return tuple(k for k in _redundant(cascade) if isinstance(cascade.blocks[k], Rational))


def _redundant(cascade: Cascade) -> tuple[int, ...]:
    """Blocks of which one scale must be fixed, filters first, so that no factor can be moved any more.

    A factor eᶜ at every inner interface is a freedom if every block admits it: a filter always, a map according to its
    `scaling`. The freedoms form a space; a block is chosen if its own gain moves in a way that the chosen do not yet
    see.
    """
    from scipy.linalg import null_space

    count = len(cascade.blocks)
    inside = np.eye(count + 1)[:, 1:count]  # interface j of count + 1; the outer two are fixed
    refused = []
    for k, block in enumerate(cascade.blocks):
        scaling = block.scaling if isinstance(block, StaticMap) else Scaling.FREE
        if scaling is Scaling.JOINT:
            refused.append(inside[k + 1] - inside[k])
        elif scaling is Scaling.NONE:
            refused += [inside[k], inside[k + 1]]
    space = null_space(np.array(refused)) if refused else np.eye(count - 1)
    chosen: list[int] = []
    seen = np.zeros((0, space.shape[1]))
    filters_first = sorted(range(count), key=lambda k: not isinstance(cascade.blocks[k], Rational))
    for k in filters_first:
        gain = (inside[k + 1] - inside[k]) @ space
        if space.shape[1] and np.linalg.matrix_rank(np.vstack([seen, gain])) > len(seen):
            seen = np.vstack([seen, gain])
            chosen.append(k)
    return tuple(chosen)


def _without_gain(cascade: Cascade, k: int, gain: float) -> Cascade:
    """The filter k divided by its gain, which the blocks behind it take up, or the map before it."""
    blocks = list(cascade.blocks)
    filter_ = blocks[k]
    assert isinstance(filter_, Rational)
    blocks[k] = filter_.amplified(1 / gain)
    for j in range(k + 1, len(blocks)):
        block = blocks[j]
        if isinstance(block, Rational):
            blocks[j] = block.amplified(gain)
            return replace(cascade, blocks=tuple(blocks))
        if isinstance(block, StaticMap) and block.scaling is Scaling.FREE:
            blocks[j] = block.scaled(1 / gain, 1.0)
            return replace(cascade, blocks=tuple(blocks))
        gain = abs(gain)
    before = blocks[k - 1] if k else None
    if isinstance(before, StaticMap) and before.scaling is Scaling.FREE:
        blocks[k - 1] = before.scaled(1.0, gain)
        return replace(cascade, blocks=tuple(blocks))
    return cascade


# ---------------------------------------------------------------------------------------------------- estimation


@dataclass(frozen=True, eq=False)
class Freedom:
    """The coordinates φ in which a cascade is fitted, θ = θ₀ + C(φ − φ₀), φ being a part of θ.

    Attributes:
        start: (p,) θ₀, a cascade of unit gain.
        free: (f,) which parameters of θ are in φ.
        tied: for every filter of unit DC gain, the coefficient that follows from its others: (anchor, others, signs),
            with θ[anchor] = 1 + signs·θ[others], from Σb = 1 + Σa.
    """

    start: Array
    free: NDArray[np.intp]
    tied: tuple[tuple[int, NDArray[np.intp], Array], ...]

    def parameters(self, phi: Array) -> Array:
        """(p,) θ for φ (f,)."""
        theta = self.start.copy()
        theta[self.free] = phi
        for anchor, others, signs in self.tied:
            theta[anchor] = 1 + signs @ theta[others]
        return theta

    def tie(self, rows: Array) -> None:
        """Turn rows of derivatives by θ, in place, into those by φ: what is tied moves with the others."""
        for anchor, others, signs in self.tied:
            rows[others] += signs[:, None] * rows[anchor]

    @cached_property
    def spread(self) -> Array:
        """(p, f) C."""
        matrix = np.zeros((len(self.start), len(self.free)))
        matrix[self.free, np.arange(len(self.free))] = 1.0
        for anchor, others, signs in self.tied:
            matrix[anchor] = signs @ matrix[others]
        return matrix


def freedom(cascade: Cascade, hold: Sequence[str] = ()) -> Freedom:
    """What is left free in a cascade of unit gain once redundant scales and levels, and ``hold``, are fixed.

    Args:
        cascade: as `unit_gain` gives it.
        hold: names of parameters that keep their values.

    Raises:
        ModelError: for a name that is not a parameter's.
    """
    names = cascade.names
    unknown = [name for name in hold if name not in names]
    if unknown:
        raise ModelError(f"{cascade.name} has no parameter {unknown[0]!r}; there are {', '.join(names)}")
    held = {names.index(name) for name in hold}
    tied = []
    for k in _redundant(cascade):
        block, span = cascade.blocks[k], cascade.spans[k]
        anchor = span.start + block.anchors[-1]
        if isinstance(block, Rational) and np.isclose(block.resting(1.0)[1], 1.0) and anchor not in held:
            others = np.array([j for j in range(span.start, span.stop) if j != anchor], dtype=np.intp)
            signs = np.where(others < span.start + len(block.numerator), -1.0, 1.0)
            tied.append((anchor, others, signs))
        held.add(anchor)
    maps = [(k, block) for k, block in enumerate(cascade.blocks) if isinstance(block, StaticMap)]
    for (k, block), (_, behind) in pairwise(maps):
        if block.owns_level and behind.absorbs_shift:
            held.add(cascade.spans[k].start + block.anchors[0])
    if not maps or maps[0][1].absorbs_shift:
        held.add(len(names) - 2)
    if maps and maps[-1][1].owns_level:
        held.add(len(names) - 1)
    free = np.array([k for k in range(len(names)) if k not in held], dtype=np.intp)
    return Freedom(cascade.parameters, free, tuple(tied))


@dataclass(frozen=True, eq=False)
class FreeRun:
    """The free-run residuals of a cascade over several segments, as the Gauss–Newton engine wants them.

    The parameters are φ (f,) and then the starting states (s,) of every segment.

    Attributes:
        cascade: of unit gain.
        freedom: its coordinates.
        segments: (u, y) of each.
        skip: samples at the start of every segment whose residual is left out.
    """

    cascade: Cascade
    freedom: Freedom
    segments: tuple[tuple[Array, Array], ...]
    skip: int

    @cached_property
    def start(self) -> Array:
        """φ₀, and the states that a free run starts with."""
        states = [self.cascade.starting(u, y[: self.cascade.memory]) for u, y in self.segments]
        return np.concatenate([self.freedom.start[self.freedom.free], *states])

    def check_values(self) -> None:
        """Refuse a start at which a block makes of finite numbers some that are not.

        Raises:
            ModelError: saying which block, and of what.
        """
        for u, _ in self.segments:
            signals = self.cascade.signals(u, np.zeros(self.cascade.states))
            for k, (x, y) in enumerate(pairwise(signals), start=1):
                bad = np.flatnonzero(~np.isfinite(y))
                if len(bad):
                    raise ModelError(
                        f"{self.cascade.name}, block {k}: from an input of {x[bad[0]]:.4g} it makes {y[bad[0]]}; "
                        "start with parameters for which all signals are finite"
                    )

    def model(self, theta: Array) -> Cascade:
        """The cascade at these parameters."""
        return self.cascade.with_parameters(self.freedom.parameters(theta[: len(self.freedom.free)]))

    def shortened(self, samples: int) -> FreeRun:
        """The same on the first part of every segment, so many samples in all, or a few more."""
        share = max(samples // len(self.segments), self.skip + 1)
        return replace(self, segments=tuple((u[:share], y[:share]) for u, y in self.segments))

    def residuals(self, theta: Array) -> list[Array]:
        """Model less measurement, per segment."""
        model = self.model(theta)
        model.check()
        return [(model.output(u, self._states(theta, k)) - y)[self.skip :] for k, (u, y) in enumerate(self.segments)]

    def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
        """Residual and derivative, per segment; the derivative by other segments' states is zero."""
        model, count = self.model(theta), len(self.freedom.free)
        parameters, blocks = len(self.freedom.start), []
        for k, (u, y) in enumerate(self.segments):
            signals = model.signals(u, self._states(theta, k))
            rows = model.gradient(signals)
            self.freedom.tie(rows)
            derivative = np.empty((len(theta), len(u) - self.skip))
            derivative[count:] = 0.0
            for j, row in enumerate(self.freedom.free):
                derivative[j] = rows[row, self.skip :]
            first = count + k * model.states
            derivative[first : first + model.states] = rows[parameters:, self.skip :]
            blocks.append(((model.sampled(signals) - y)[self.skip :], derivative.T))
        return blocks

    def _states(self, theta: Array, k: int) -> Array:
        first = len(self.freedom.free) + k * self.cascade.states
        return theta[first : first + self.cascade.states]


@dataclass(frozen=True, eq=False)
class _Start:
    """The starting states of one segment, from its first samples, with a prior ‖firmness·(states − centre)‖."""

    cascade: Cascade
    u: Array
    y: Array
    centre: Array
    firmness: Array

    def residuals(self, theta: Array) -> list[Array]:
        error = self.cascade.output(self.u, theta) - self.y
        return [error[self.cascade.edge :], self.firmness @ (theta - self.centre)]

    def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
        signals = self.cascade.signals(self.u, theta)
        rows = self.cascade.gradient(signals)[len(self.cascade.parameters) :]
        error = self.cascade.sampled(signals) - self.y
        edge = self.cascade.edge
        return [(error[edge:], rows[:, edge:].T), (self.firmness @ (theta - self.centre), self.firmness)]


def fit_cascade(
    start: Cascade,
    records: Record | Sequence[Record],
    *,
    skip: int | None = None,
    hold: Sequence[str] = (),
    loss: Loss = SQUARES,
    max_iterations: int = 50,
    max_seconds: float = np.inf,
    tolerance: float = 0.05,
    progress: Callable[[Iteration], None] | None = None,
) -> Fit[Cascade]:
    """The cascade whose free run is closest to one or several records, from a start.

    Args:
        start: blocks with start values; it is brought to `unit_gain` first.
        records: one input and one output each; every segment of each is an experiment.
        skip: samples left out at the start of every segment, whose states keep what the start finds from them; None
            estimates the states along with the parameters.
        hold: names of parameters that keep their (normalised) start values.
        loss: `Squares`, `Huber` or `Cauchy`.
        max_iterations, max_seconds, tolerance, progress: as `gauss_newton` has them.

    Returns:
        The fit, in the normalisation `unit_gain`; its covariance allows for coloured residuals and for model error.

    Raises:
        ModelError: for records of other channels or too short, a start that is unstable.
    """
    minimum, problem = search(
        start,
        records,
        skip=skip,
        hold=hold,
        loss=loss,
        max_iterations=max_iterations,
        max_seconds=max_seconds,
        tolerance=tolerance,
        progress=progress,
    )
    return conclude(minimum, problem, loss)


def search(
    start: Cascade,
    records: Record | Sequence[Record],
    *,
    skip: int | None = None,
    hold: Sequence[str] = (),
    loss: Loss = SQUARES,
    max_iterations: int = 50,
    max_seconds: float = np.inf,
    tolerance: float = 0.05,
    worth: float = 0.0,
    progress: Callable[[Iteration], None] | None = None,
) -> tuple[Minimum, FreeRun]:
    """What `fit_cascade` does before it concludes; for those who go on from the minimum, or compare several."""
    if skip is not None:
        check_whole(f"{start.name}: skip", skip, 0, "these are samples to be left out")
    start.check()
    cascade = unit_gain(start)
    cascade.check()
    problem = FreeRun(cascade, freedom(cascade, hold), gather(cascade, records, skip), max(skip or 0, cascade.edge))
    problem.check_values()
    theta = problem.start
    count = len(problem.freedom.free)
    low, high = np.full(len(theta), -np.inf), np.full(len(theta), np.inf)
    if skip is not None:
        low[count:] = high[count:] = theta[count:]
    names = [cascade.names[k] for k in problem.freedom.free]
    names += [f"state {j + 1} of segment {k + 1}" for k in range(len(problem.segments)) for j in range(cascade.states)]
    minimum = gauss_newton(
        problem,
        theta,
        lower=low,
        upper=high,
        loss=loss,
        max_iterations=max_iterations,
        max_seconds=max_seconds,
        tolerance=tolerance,
        worth=worth,
        names=names,
        progress=progress,
    )
    return minimum, problem


def conclude(minimum: Minimum, problem: FreeRun, loss: Loss = SQUARES) -> Fit[Cascade]:
    """The fit at a minimum: every parameter that moved, those that are tied included."""
    cascade = problem.model(minimum.estimate)
    count = len(problem.freedom.free)
    own = minimum.covariance if not isinstance(loss, Squares) else _honest(minimum, problem)
    covariance = _propagated(problem.freedom.spread, own[:count, :count])
    kept = np.flatnonzero(np.diag(covariance) > 0)
    names = [cascade.names[k] for k in problem.freedom.free]
    fit = minimum.fit(cascade, names)
    return replace(
        fit,
        message=_untold(minimum, names) if fit.ending is Ending.RANK_DEFICIENT else fit.message,
        names=tuple(cascade.names[k] for k in kept),
        estimate=cascade.parameters[kept],
        covariance=covariance[np.ix_(kept, kept)],
    )


def _untold(minimum: Minimum, names: Sequence[str]) -> str:
    """What the records leave open, in words; all that is not named is a starting state."""
    free = np.flatnonzero(minimum.free)

    def called(group: Sequence[int]) -> str:
        own = [names[free[k]] for k in group if free[k] < len(names)]
        words = own + ["starting states"] * (len(own) < len(group))
        return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))

    aliases = minimum.information.solve().aliases
    silent = called([group[0] for group in aliases if len(group) == 1]) if any(len(g) == 1 for g in aliases) else ""
    alike = list(dict.fromkeys(called(group) for group in aliases if len(group) > 1))
    said = [f"say nothing of {silent}"] * bool(silent) + [f"cannot tell {group} apart" for group in alike]
    return "the records " + "; they ".join(said)


def _honest(minimum: Minimum, problem: FreeRun) -> Array:
    """The covariance of the minimum, allowing for a residual that is coloured, or is model error.

    What the data cannot tell keeps its infinite variance.
    """
    covariance = minimum.covariance.copy()
    told = np.flatnonzero(minimum.free & np.isfinite(np.diag(covariance)))
    own, states = told[told < len(problem.freedom.free)], told[told >= len(problem.freedom.free)]
    if len(own) and minimum.samples > len(told):
        part = problem.shortened(CURVATURE_SAMPLES)
        covariance[np.ix_(own, own)] = model_error_covariance(problem, minimum.estimate, own, states, part)
    return covariance


def gather(cascade: Cascade, records: Record | Sequence[Record], skip: int | None) -> tuple[tuple[Array, Array], ...]:
    """(u, y) of every segment that is long enough to be used.

    Raises:
        ModelError: for records of other channels, or where no segment is long enough.
    """
    several = [records] if isinstance(records, Record) else list(records)
    needed = skip if skip is not None else cascade.memory
    segments = []
    for record in several:
        check_channels(cascade, record)
        segments += [
            (np.ascontiguousarray(piece.input[:, 0]), np.ascontiguousarray(piece.output[:, 0]))
            for piece in record.segments
            if len(piece) > needed
        ]
    if not segments:
        raise ModelError(
            f"{cascade.name}: no segment is longer than the {needed} samples that its start takes; give more data or "
            "smaller orders"
        )
    return tuple(segments)


def _propagated(spread: Array, covariance: Array) -> Array:
    """C·Σ·Cᵀ, infinite for whatever depends on something of infinite variance."""
    lost = np.isinf(np.diag(covariance))
    finite = np.where(np.isfinite(covariance), covariance, 0.0)
    result: Array = spread @ finite @ spread.T
    touched = np.flatnonzero(np.abs(spread[:, lost]).sum(axis=1) > 0)
    result[touched, touched] = np.inf
    return result


def static_band(fit: Fit[Cascade], block: int, x: ArrayLike) -> Array:
    """(m, 2) a static map's value and the standard error of it at inputs x (m,).

    Args:
        fit: of a cascade, in the normalisation it was fitted in.
        block: which block, counted from 0.
        x: (m,) inputs of that map.

    Raises:
        ModelError: where that block is not a static map.
    """
    model = fit.model
    if not 0 <= block < len(model.blocks):
        raise ModelError(f"{model.name}: no block {block}; they are counted from 0 to {len(model.blocks) - 1}")
    chosen = model.blocks[block]
    if not isinstance(chosen, StaticMap):
        raise ModelError(f"{model.name}: block {block + 1} is a filter; a band is drawn for static maps")
    at = np.asarray(x, dtype=float)
    rows = chosen.parameter_gradient(at)
    span = model.spans[block]
    inside = [(j, model.names.index(name) - span.start) for j, name in enumerate(fit.names)]
    pairs = [(j, k) for j, k in inside if 0 <= k < span.stop - span.start]
    columns, owned = [j for j, _ in pairs], [k for _, k in pairs]
    part = fit.covariance[np.ix_(columns, columns)]
    variance = np.einsum("im,ij,jm->m", rows[owned], np.where(np.isfinite(part), part, 0.0), rows[owned])
    return np.column_stack([chosen.value(at), np.sqrt(np.maximum(variance, 0))])
