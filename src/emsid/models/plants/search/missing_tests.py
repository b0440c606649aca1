r"""What records can determine of a plant, and which test shows the rest.

A test steps some of the inputs that a plant declares (`Plant.tests`), with steps of random height that last from a few
samples to a quarter of the test. What it adds is the information SᵀS/σ² of the derivative of its free run
(`emsid.estimation.uncertainty.identifiability`), at values that are plausible where nothing is known: dry friction and
damping are zero, so that it moves; what a bound holds at zero has its usual value. A parameter becomes known by a test
if the information of record and test together determines it.

Before a search, the information of a record is that at values from regressions (`Plant.suggested`), with the noise of
every output from what the free run there leaves of it. An output of which it explains nothing says nothing, but in a
motion without currents. Where a motion is not seen in the outputs, friction holds it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.estimation.uncertainty.identifiability import Identifiability, identifiability
from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.parameters import CURRENTS, DISSIPATED, TINY, Signal
from emsid.models.plants.plant import Plant
from emsid.models.plants.search.task import Task, cost_of, prepare
from emsid.record import Record

Array = NDArray[np.float64]

SAMPLES = 4000
"""Samples of a test: 40 steps as long as the slowest of its sections on average; more add to what is known of all."""
SURE = 0.25
"""A parameter is known whose relative standard error is smaller than this: its interval excludes zero. With half or
twice of it, 6 of 72 statements about simulated records change, all about records of noise or weak excitation."""
SHORTEST = 4
"""Samples of the shortest step of a test; twice as long ones change 5 of these 72 statements, 2 samples none."""
REACTION = 3
"""Samples in which a controller reacts to noise by its proportional part. Without its removal 21 of these 72 statements
change: of records in which only noise excites an axis, its inductance would be known."""
STRETCHES, STRETCH = 8, 500
"""A record is looked at in so many stretches of so many samples: in 0.05 s a brushless motor at 10 kHz shows its
currents ten times and its inertia; in longer ones errors of assumed values add up in the angle. Half as many or half
as long ones change 26 of 72 statements, twice as many or as long ones none."""


@dataclass(frozen=True)
class Shown:
    """What a record can determine.

    Attributes:
        moving: whether a motion is seen.
        flowing: the outputs of currents that are more than noise.
        known: the parameters that it determines.
        unknown: the others.
        ratios: those of the others of which it determines a combination.
        tests: for a code of `Plant.tests` those of the others that this test shows.
    """

    moving: bool
    flowing: tuple[Signal, ...]
    known: tuple[str, ...]
    unknown: tuple[str, ...]
    ratios: tuple[str, ...]
    tests: Mapping[str, tuple[str, ...]]


def tests_for(
    plant: Plant,
    signals: Sequence[Signal],
    dt: float,
    before: Identifiability,
    unknown: Sequence[str],
    size: float,
    scale: Array,
) -> dict[str, tuple[str, ...]]:
    """For every test that shows some of the parameters, the simplest first, which ones; each is shown by one test.

    Args:
        plant: at the estimate.
        signals: the outputs that are recorded.
        dt: sample time in s.
        before: what the records determine.
        unknown: the parameters that they do not.
        size: of the steps of an input.
        scale: (ny,) by which every output is divided in the noise of ``before``.
    """
    left, found = set(unknown), dict[str, tuple[str, ...]]()
    in_groups = {name for group in before.groups for name in group}
    open_before = np.array([name in in_groups for name in before.names])
    likely = _moving(plant.for_test(), unknown)
    for code, names in likely.tests.items():
        if not left:
            break
        try:
            rows = _derivative(likely, signals, dt, before, _steps(likely, names, size), scale)
        except EmsidError:
            continue
        triangle: Array = np.asarray(np.linalg.qr(np.vstack([before.triangle, rows]), mode="r"))
        both = Identifiability(before.names, triangle, before.noise, before.sizes)
        error = _errors(both)
        sure = (error < SURE) & ((error < 0.5 * _errors(before)) | open_before)
        shown = left & {name for name, enough in zip(before.names, sure, strict=True) if enough}
        shown -= {name for group in both.groups for name in group}
        if shown:
            found[code] = tuple(name for name in unknown if name in shown)
            left -= shown
    return found


def _errors(known: Identifiability) -> Array:
    """(p,) relative standard errors; zero along directions without any effect."""
    variance = np.diagonal(np.linalg.pinv(known.triangle.T @ known.triangle))
    return np.asarray(known.noise * np.sqrt(np.maximum(variance, 0.0)))


def shown_by_tests(
    task: Task, plant: Plant, names: Sequence[str], before: Identifiability, unknown: Sequence[str]
) -> dict[str, tuple[str, ...]]:
    """`tests_for` after a search.

    Args:
        task: what was asked.
        plant: at the estimate.
        names: the parameters that were estimated.
        before: what the records determine of those asked for.
        unknown: the others.
    """
    if not (unknown and plant.tests):
        return {}
    scale = task.problem(plant, names).output_scale
    return tests_for(plant, task.signals, task.segments[0].dt, before, unknown, _largest(plant, task.segments), scale)


def _largest(plant: Plant, segments: Sequence[Record]) -> float:
    """The largest value of the inputs that a test may choose."""
    some = len(plant.test_names)
    return max(float(np.max(np.abs(each.input[:, :some]))) for each in segments) or 1.0


def _moving(plant: Plant, unknown: Sequence[str]) -> Plant:
    """The plant with plausible values where nothing is known: it moves."""
    usual, values = type(plant)(), dict[str, float]()
    for name in unknown:
        handle = plant.handles[name]
        if handle.measure in DISSIPATED and handle.lower == 0.0:
            values[name] = 0.0
        elif abs(plant.value(name)) <= max(handle.lower, TINY):
            values[name] = usual.value(name)
    return plant.with_values(values)


def _steps(plant: Plant, names: Sequence[str], size: float) -> Array:
    """(N, inputs) random steps on some inputs of a test."""
    rng = np.random.default_rng(1)
    inputs = np.zeros((SAMPLES, len(plant.test_names)))
    for name in names:
        column = inputs[:, plant.test_names.index(name)]
        at = 0
        while at < SAMPLES:
            long = int(np.exp(rng.uniform(np.log(SHORTEST), np.log(SAMPLES / 4))))
            column[at : at + long] = size * rng.uniform(-1.0, 1.0)
            at += long
    return inputs


def _derivative(
    plant: Plant, signals: Sequence[Signal], dt: float, of: Identifiability, commands: Array, scale: Array
) -> Array:
    """(N·ny, p) the derivative of a test's outputs by relative changes, in units of ``scale`` (ny,)."""
    at_rest = np.zeros(plant.states)

    def run(moved: Plant) -> Array:
        with np.errstate(all="ignore"):
            return np.asarray((moved.simulate(commands, dt, at_rest, signals) / scale).ravel())

    here, columns = run(plant), []
    for name, size in zip(of.names, of.sizes.tolist(), strict=True):
        step = 1e-5 * size
        columns.append((run(plant.with_values({name: plant.value(name) + step})) - here) / 1e-5)
    rows = np.column_stack(columns)
    return rows[np.isfinite(rows).all(axis=1)]


def determined_by(plant: Plant, record: Record, fixed: Mapping[str, float | str] | None = None) -> Shown:
    """What a record can determine of a plant, without a search.

    Args:
        plant: whose parameters are asked for.
        record: with inputs and outputs.
        fixed: known values, as `emsid.fit` takes them.

    Raises:
        ModelError, DataError: as `emsid.fit` does.
    """
    task = prepare(plant, [_without_reaction(each) for each in _stretches(record)], fixed=fixed, threads=1)
    force = FAR_TOO_MUCH * task.problem(task.plant, ()).plausible_size(_level(task.plant))
    begun: list[tuple[float, bool, FreeRunError]] = []
    y = np.concatenate([each.output for each in task.segments])
    currents = [k for k, signal in enumerate(task.signals) if signal in CURRENTS]
    seen = _size(y) > SEEN * _noise(y)
    rests = any(not seen[k] for k, signal in enumerate(task.signals) if signal not in CURRENTS)
    for start in (*task.plant.suggested(task.segments, task.signals), task.plant):
        values = {name: start.value(name) for name in task.asked}
        for moving, holding in ((True, {}), (False, {_level(task.plant): force}))[rests:]:
            tried = task.problem(start.with_values(values | holding), task.asked)
            begun.append((cost_of(tried), moving, tried))
    _, moving, problem = min(begun, key=lambda each: each[0])
    noise = _unexplained(problem)
    flows = seen | (_size(y) > SEEN * noise)
    counts = noise < y.std(axis=0)
    blocks = [block.copy() for _, block in problem.exactly(problem.start)]
    if currents and not flows[currents].any():
        without = task.problem(problem.plant.with_values(problem.plant.open_circuit), task.asked)
        noise, counts = np.minimum(noise, _unexplained(without)), np.ones(len(noise), dtype=bool)
        for block, (_, other) in zip(blocks, without.exactly(without.start), strict=True):
            for k, name in enumerate(task.asked):
                if name in problem.plant.of_current:
                    block[:, k] = 0.0
                elif np.linalg.norm(other[:, k]) > BY_MOTION * np.linalg.norm(block[:, k]):
                    block[:, k] = other[:, k]
    per = counts * problem.output_scale / noise
    rows = [each * np.repeat(per, len(seg))[:, None] for each, seg in zip(blocks, task.segments, strict=True)]
    names = task.asked
    found = identifiability(rows, problem.scales, names, 1.0)
    hidden = {name for group in found.groups for name in group}
    sure = dict(zip(names, _errors(found) < SURE, strict=True))
    unknown = tuple(name for name in names if name in hidden or not sure[name])
    tests = tests_for(problem.plant, task.signals, record.dt, found, unknown, _largest(plant, task.segments), noise)
    return Shown(
        moving,
        tuple(task.signals[k] for k in currents if flows[k]),
        tuple(name for name in names if name not in unknown),
        unknown,
        tuple(name for group in found.groups if _has_combination(found, group) for name in group),
        tests,
    )


def _has_combination(found: Identifiability, group: Sequence[str]) -> bool:
    """Whether a combination of parameters is determined that are not by themselves."""
    places = [found.names.index(name) for name in group]
    share = np.linalg.norm(found.directions[places], axis=0)
    return bool(len(group) > np.count_nonzero((found.spread > 1.0) & (share > 0.5)))


BY_MOTION = 0.01
"""A parameter acts on the motion itself if this part of its effect is left without currents; a flux acts on a voltage
that is measured where no current flows. Half or twice of it changes none of 72 statements, zero 10, infinity 8."""
SEEN = 2.0
"""A current flows, and a rotor turns, whose mean square is four times that of its noise."""
EXACT = 1e-6
"""The smallest error of a model, as a part of an output: that of data without noise."""
FAR_TOO_MUCH = 100.0
"""Friction of so many plausible sizes, ten times what the input overcomes, holds a motor; 10 to 200 of them hold it
alike in 72 records."""


def _level(plant: Plant) -> str:
    """The parameter of dry friction that holds a plant at rest."""
    (name, law), *_ = plant.frictions.items()
    return f"{name}.{law.parameters[0].name}"


def _stretches(record: Record) -> list[Record]:
    """Parts of a record, evenly over it; the whole of a short one."""
    segments = record.segments
    if len(record) <= STRETCHES * STRETCH:
        return list(segments)
    share = STRETCHES / len(record)
    found = []
    for segment in segments:
        for k in range(max(round(share * len(segment)), len(segments) <= STRETCHES)):
            begin = round((k + 0.5) / max(round(share * len(segment)), 1) * max(len(segment) - STRETCH, 0))
            found.append(segment[begin : begin + STRETCH])
    return found


def _without_reaction(segment: Record) -> Record:
    """A segment without what a controller makes of the noise of its readings, which excites nothing.

    The noise is what is left of the outputs after a prediction from two samples before; of the inputs, what is in
    proportion to it at up to `REACTION` samples is subtracted.
    """
    u, y = segment.input, segment.output
    if len(segment) < 10 * (2 * y.shape[1] + 3 * u.shape[1]):
        return segment
    past = np.hstack([*(np.roll(y, k, axis=0) for k in (1, 2)), *(np.roll(u, k, axis=0) for k in (1, 2, 3))])[3:]
    left = np.zeros_like(y)
    left[3:] = y[3:] - past @ np.linalg.lstsq(past, y[3:], rcond=None)[0]
    late = np.hstack([np.roll(left, k, axis=0) for k in range(REACTION)])[2 * REACTION :]
    react = np.zeros_like(u)
    react[2 * REACTION :] = (
        late @ np.linalg.lstsq(late, u[2 * REACTION :] - u[2 * REACTION :].mean(axis=0), rcond=None)[0]
    )
    return replace(segment, input=u - react)


def _size(y: Array) -> Array:
    """(ny,) the root of the mean square of every output."""
    return np.asarray(np.sqrt(np.mean(y**2, axis=0)))


def _unexplained(problem: FreeRunError) -> Array:
    """(ny,) the root of the mean square of what a free run leaves of every output; infinite where there is none."""
    try:
        return np.maximum(_size(problem.errors().T), EXACT * problem.output_scale)
    except Infeasible:
        return np.full(len(problem.signals), np.inf)


def _noise(y: Array) -> Array:
    """(ny,) the standard deviation of white noise with the same median of second differences; never zero."""
    second = np.median(np.abs(np.diff(y, 2, axis=0)), axis=0) / 0.6745 / sqrt(6.0)
    steps = [np.diff(np.unique(column)) for column in y.T]
    rounded = np.array([each.min() / sqrt(12.0) if len(each) else 0.0 for each in steps])
    return np.asarray(np.maximum(np.maximum(second, rounded), 1e-6 * np.maximum(np.ptp(y, axis=0), 1e-9)))
