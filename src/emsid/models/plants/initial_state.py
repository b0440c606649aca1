"""The state of a plant at the start of a record, as its first samples show it.

An error of the initial state never decays in the free run of a position. If the model is less exact than the sensor, an
estimated initial state would compensate for later errors of the model. It is then taken from the first samples alone:
from a polynomial of second order through as many of them as it fits within their noise. An initial state that was
estimated from a whole record is used only where it agrees with that. Many records begin at rest, with a counter at zero
or where an arm hangs. This is assumed unless the record contradicts it, because an unknown initial state costs
precision of all parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from enum import Enum
from math import inf, log, sqrt
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import Plant
from emsid.models.plants.state import HELD, RISE
from emsid.record import Record

Array = NDArray[np.float64]

SAMPLES = (20, 40, 80, 160)
"""Numbers of samples that a polynomial is fitted to, from the fewest to the most."""
WORSE = 1.5
"""A polynomial through more samples must leave no more than this many times the variance."""
AGREES = 5.0
"""An estimated initial state may differ from that of the first samples by this many standard deviations."""
CLEARLY = 0.1
"""Rest replaces the state of the first samples where its cost is below this share of theirs."""


class InitialState(Enum):
    """How a fit finds the initial states of its segments."""

    SAMPLES = "as the first samples show it"
    FREE = "estimated"
    REST = "at rest at position zero, or where the first reading is"


class InitialMotion(NamedTuple):
    """What the first samples of a position show, as (value, standard deviation)."""

    speed: tuple[float, float]
    position: tuple[float, float]


class Fitted(Protocol):
    """Where a search has ended."""

    @property
    def cost(self) -> float:
        """Half the sum of squares of the error."""
        ...

    @property
    def states(self) -> list[Array]:
        """The initial state of every segment."""
        ...

    @property
    def residuals(self) -> list[Array]:
        """The weighted error of every segment."""
        ...


Found = TypeVar("Found", bound=Fitted)


def starts_from_samples(plant: Plant, signals: Sequence[Signal]) -> bool:
    """Whether the start of a free run can be taken from the first samples: where a position is all that is measured."""
    return plant.driven is not None and tuple(signals) == (Signal.POSITION,)


def begun(
    plant: Plant,
    signals: Sequence[Signal],
    segments: Sequence[Record],
    start: InitialState,
    states: Sequence[Array] | None = None,
) -> tuple[list[Array], list[tuple[int, ...]]]:
    """The initial state of every segment, and which of its elements are estimated.

    Args:
        plant: with its parameters.
        signals: of the outputs.
        segments: of which every one has a start.
        start: how it is found; it is estimated where more than a position is measured.
        states: to begin with, by default what the first samples show.
    """
    first = [plant.first_state(signals, segment) for segment in segments] if states is None else list(states)
    slow = slow_states(plant, len(segments))
    if start is InitialState.FREE or not starts_from_samples(plant, signals):
        return first, free_states(plant, signals, segments)
    if start is InitialState.REST:
        read = [plant.first_state(signals, segment[:1])[1] for segment in segments]
        pairs = zip(segments, first, read, strict=True)
        first = [at_rest(state, 0.0 if begins_at_zero(segment) else float(where)) for segment, state, where in pairs]
    return first, slow


def slow_states(plant: Plant, segments: int) -> list[tuple[int, ...]]:
    """The states of every segment that its first samples do not show: how far a resistance has risen.

    The first segment begins without a rise, which is what the resistance refers to.
    """
    return [(RISE,) if k and plant.changes_resistance else () for k in range(segments)]


def free_states(plant: Plant, signals: Sequence[Signal], segments: Sequence[Record]) -> list[tuple[int, ...]]:
    """The states of every segment that are estimated."""
    slow = slow_states(plant, len(segments))
    return [(*plant.free_states(signals, each), *more) for each, more in zip(segments, slow, strict=True)]


def begins_at_zero(segment: Record) -> bool:
    """Whether the first reading of a position is zero within the noise, which is that of its second differences."""
    y = segment.output[: SAMPLES[0], 0]
    noise = float(np.std(np.diff(y, 2))) / sqrt(6.0) if len(y) > 3 else 0.0
    return abs(float(y[0])) <= AGREES * noise


def at_rest(state: Array, position: float) -> Array:
    """An initial state at rest at a position."""
    rest = np.zeros_like(state)
    rest[1], rest[HELD] = position, 1.0
    rest[RISE:] = state[RISE:]
    return rest


def as_seen(
    segments: Sequence[Record], sampled: float, search: Callable[[InitialState, Found | None], Found | None]
) -> tuple[InitialState, Found] | None:
    """Another source of initial states than the first samples, if the records allow it, and the fit with it.

    A polynomial cannot follow a step at the start of a record, wherever its position is. So rest is used also where its
    cost is a small share of that with states from the first samples; neither kind of state is estimated.

    Args:
        segments: with all their samples.
        sampled: the cost with initial states from the first samples.
        search: a fit with such initial states, begun where an earlier one ended; None where nothing can be simulated.

    Returns:
        None where the first samples are the best source.
    """
    free = search(InitialState.FREE, None)
    if free is None:
        return None
    seen = agree(segments, free.states)
    rests = agree(segments, [np.zeros_like(state) for state in free.states])
    with suppress(Stopped):
        still = search(InitialState.REST, free if seen else None)
        better = still is not None and (rests or still.cost < CLEARLY * sampled)
        if still is not None and better and (not seen or may_rest(still.cost, free.cost, free.residuals)):
            return InitialState.REST, still
    return (InitialState.FREE, free) if seen else None


def agree(segments: Sequence[Record], states: Sequence[Array]) -> bool:
    """Whether estimated initial states agree with the first samples of a measured position, in every segment.

    Only a few samples are used: over many, a polynomial differs from the position by more than the noise.
    """
    seen = [initial_motion(segment.output[: SAMPLES[0], 0], segment.dt) for segment in segments]
    return all(
        abs(found - value) <= AGREES * deviation
        for state, each in zip(states, seen, strict=True)
        for found, (value, deviation) in zip(state, each, strict=False)
    )


def may_rest(resting: float, free: float, residuals: Sequence[Array]) -> bool:
    """Whether rest at the start raises the cost by no more than noise explains (χ², at 95 %).

    Args:
        resting: the cost with such starts.
        free: that with estimated starts.
        residuals: with estimated starts, of every segment.
    """
    from scipy.special import chdtri

    added = effective_samples(residuals) * log(resting / free) if free > 0 else inf
    return added <= float(chdtri(2 * len(residuals), 0.05))


def starts_at_rest(y: Array, signal: Signal = Signal.POSITION) -> bool:
    """Whether the first three samples of an output are equal, and for a position more of them than in a motion.

    In motion the counts of an encoder change at nearly equal intervals, and with noise some samples are equal by
    chance. Then about as many samples are equal again soon after the first change.
    """
    changes = np.flatnonzero(np.diff(y))  # the last samples before them
    if len(y) < 4 or not len(changes) or signal is not Signal.POSITION:
        return len(y) > 3 and float(np.ptp(y[:3])) == 0.0
    end = min(changes[0] + SAMPLES[0], len(y) - 1)
    longest = int(np.max(np.diff(np.append(changes[changes < end], end))))
    return int(changes[0]) > max(longest, 1)


def initial_motion(y: Array, dt: float) -> InitialMotion:
    """Speed and position at the first sample of a measured position (N,).

    The first samples of a counter that stands still until a step are equal, and no polynomial goes through the step. So
    where a polynomial leaves more than the counts explain, it is at rest for as long as they are equal.
    """
    found = InitialMotion((0.0, np.inf), (float(y[0]), 0.0))
    least = np.inf
    for samples in sorted({min(count, len(y)) for count in SAMPLES}):
        if samples < 4:
            break
        powers = np.vander(np.arange(samples) * dt, 3, increasing=True)
        coefficients = np.linalg.lstsq(powers, y[:samples], rcond=None)[0]
        variance = float(np.sum((powers @ coefficients - y[:samples]) ** 2)) / (samples - 3)
        if variance > WORSE * least:
            break
        least = min(least, variance)
        position, speed = np.sqrt(variance * np.diag(np.linalg.inv(powers.T @ powers)))[:2]
        found = InitialMotion((float(coefficients[1]), float(speed)), (float(coefficients[0]), float(position)))
    changes = np.abs(np.diff(y[: SAMPLES[0]]))
    if starts_at_rest(y) and changes.any():
        deviation = float(np.min(changes[changes > 0])) / sqrt(12.0)  # of counts, as if they were spread evenly
        if least > WORSE * deviation**2:
            equal = 1 + int(np.argmax(changes > 0))
            return InitialMotion((0.0, deviation / (equal * dt)), (float(y[0]), deviation))
    return found
