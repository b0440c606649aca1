r"""Start values of a grey box from its records.

All signals pass through the same filter, which also gives the derivatives of a speed or a position. The equation of one
mass is then linear in its coefficients:

    dv/dt = gain·D(u) − damping·v − c·sgn(v) − offset.

A regression on the samples in motion gives them, for several filters and several widths of the dead zone; the result
with the smallest simulation error is the start (`estimation`). This is the least-squares inverse dynamics of robotics
(Gautier, Khalil), with 1/(1 + τs)² run forward and backward as the filter.

If a mass settles within a few samples, its acceleration is not visible, only the speed at which it settles,

    v = (gain·D(u) − c·sgn(v) − offset)/damping,

for which there is a second regression, tried with several dampings. If neither regression gives a start, plausible
motions are tried: time constants from a few samples to a thousand, with little and with much friction.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, EmsidError, listed
from emsid.estimation.threads import in_threads
from emsid.models.plants.drive import Drive
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.motion_regression import OFFSET, SLIDING, rows_with_waves, solved, speed_of
from emsid.models.plants.one_mass import Motion
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import Plant
from emsid.models.plants.search.speeds import motion_channel, top_speed
from emsid.models.plants.search.task import Task, cost_of
from emsid.record import Record

Array = NDArray[np.float64]

FILTERS = (1.0, 3.0, 8.0, 20.0)
"""Time constants of the filter, in samples."""
DEAD_ZONES = (0.0, 0.05, 0.1, 0.2, 0.35)
"""Half widths of the dead zone, as a part of the largest command."""
SETTLING = (0.5, 1.5, 5.0, 15.0)
"""Time constants of a mass that settles quickly, in samples."""
PLAUSIBLE = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
"""Time constants in samples that are always tried."""
RATE = 20.0
"""A rate of Stribeck friction to begin with, times the top speed."""
LEVELS = (0.02, 0.1)
"""Coulomb levels tried with them, as a part of the largest command."""


def motions(
    segments: Sequence[Record],
    channel: int,
    is_position: bool,
    dead_zone: bool,
    offset: float = 0.0,
    turn: float = 0.0,
) -> Iterator[Motion]:
    """The motion of one mass according to several regressions.

    Args:
        segments: records without gaps, driven by their first input.
        channel: the output that is a speed or a position.
        is_position: which of the two.
        dead_zone: whether to try dead zones.
        offset: of the command.
        turn: the phase per unit of position with which a force on a joint repeats; 0 for none.
    """
    largest = max(float(np.max(np.abs(s.input[:, 0]))) for s in segments)
    for samples in FILTERS:
        for part in DEAD_ZONES if dead_zone else (0.0,):
            width = part * largest
            rows = [
                rows_with_waves(segment, channel, is_position, samples, width, offset, turn)
                for segment in segments
                if len(segment) > 12
            ]
            if not rows:
                continue
            matrix = np.concatenate(rows)
            if len(matrix) < 12:
                continue
            one_way = (matrix[:, SLIDING] < 0).all() or (matrix[:, SLIDING] > 0).all()
            matrix[:, OFFSET] *= not (one_way or turn)  # an offset is the same as friction there, or nearly as a wave
            gain, damping, coulomb, drop, *waves = solved(matrix[:, :-1], matrix[:, -1])
            if gain != 0:
                yield Motion(gain, max(damping, 0.0), coulomb, drop, width, (waves[0], waves[1]) if turn else (0, 0))
            if samples == FILTERS[0] and not turn:
                gain, coulomb, drop = solved(matrix[:, [0, SLIDING, OFFSET]], -matrix[:, 1])
                if gain != 0:
                    for time in SETTLING:
                        rate = 1 / (time * segments[0].dt)
                        yield Motion(rate * gain, rate, rate * coulomb, rate * drop, width)


def after_drive(
    plant: DrivenPlant, segments: Sequence[Record], channel: int = 0, is_position: bool = False
) -> list[Record]:
    """Segments whose only input is the effective command: zero for codes, after the knee, and the torque of a servo.

    Args:
        plant: with its drive.
        segments: of which a motion is measured.
        channel, is_position: see `motions`.
    """

    def commanded(segment: Record) -> Array:
        y = segment.output[:, channel]
        position = y if is_position else np.cumsum(y) * segment.dt
        return plant.commanded(segment, position, speed_of(y, segment.dt, is_position))

    return [
        replace(
            segment,
            input=commanded(segment)[:, None],
            input_names=segment.input_names[:1],
            input_units=segment.input_units[:1],
        )
        for segment in segments
    ]


def plausible_motions(segments: Sequence[Record], channel: int) -> Iterator[Motion]:
    """Motions of a speed that are always tried: with `PLAUSIBLE` time constants and `LEVELS` of friction.

    Args:
        segments, channel: see `motions`.
    """
    largest = max(float(np.max(np.abs(s.input[:, 0]))) for s in segments)
    top = max(float(np.max(np.abs(s.output[:, channel]))) for s in segments)
    for time in PLAUSIBLE if largest > 0 else ():
        for level in LEVELS:
            rate = 1 / (time * segments[0].dt)
            yield Motion(rate * (1 + level) * top / largest, rate, rate * level * top, 0.0, 0.0)


def starts_of(task: Task) -> list[Plant]:
    """The plants to begin with, the best simulation first: the plant as given, and plants from regressions.

    An unknown knee is tried at several voltages. Unknown Stribeck friction begins with a rate that is not zero: at zero
        its excess would be part of the Coulomb level.
    """
    if not isinstance(task.given, DrivenPlant):
        others = [_within(each, task) for each in task.given.suggested(task.segments, task.signals)]
        return sorted([task.plant, *others], key=lambda plant: cost_of(task.problem(plant, task.asked)))
    starts: list[tuple[float, Plant]] = []
    for each in task.given.knee_starts(_with_stribeck_rate(task), task.asked, task.limits):
        starts += _suggested(each, task)
    return [plant for _, plant in sorted(starts, key=lambda start: start[0])]


def _within(plant: Plant, task: Task) -> Plant:
    """A plant with its values that are asked for within their limits, and no other one that was given changed."""
    given, handles = task.given.value, plant.handles
    kept = {n: task.plant.value(n) for n in handles if n in task.fixed or plant.value(n) == given(n)}
    return plant.with_values(
        {**kept, **{name: float(np.clip(plant.value(name), *task.limits[name])) for name in task.asked}}
    )


def _with_stribeck_rate(task: Task) -> Plant:
    usual = usual_rates(task, task.asked)
    return task.plant.with_values({name: rate for name, rate in usual.items() if task.plant.value(name) == 0})


def usual_rates(task: Task, names: Sequence[str]) -> dict[str, float]:
    """Rates of Stribeck friction to begin with, for those of the names that are such rates."""
    channel, is_position = motion_channel(task.signals)
    rates = [name for name in names if name.endswith(".stribeck_rate")]
    if not rates or channel is None:
        return {}
    rate = RATE / top_speed(task.segments, channel, is_position)
    return {name: float(np.clip(rate, *task.limits[name])) for name in rates}


def _suggested(plant: Plant, task: Task) -> list[tuple[float, Plant]]:
    """The plant as given, and with the results of regressions on the records, each with its cost."""
    asked, limits = task.asked, task.limits
    first = task.problem(plant, asked)
    if not isinstance(plant, DrivenPlant):
        return [(cost_of(first), plant)]
    drive = plant.drive
    against = _currents_against(drive, first)
    channel, is_position = motion_channel(first.signals)
    if channel is None:
        _refuse_signs(first, against)
        return [(cost_of(first), plant)]
    zone = any("dead_zone" in name for name in asked)
    kept = plant.handles.keys() - asked
    commanded = after_drive(plant, first.segments, channel, is_position)

    def tried(motion: Motion, start: DrivenPlant) -> tuple[float, float, Plant]:
        if task.control.ending is not None:  # the best so far is searched from, and that search ends at once
            return inf, inf, start
        try:
            suggested = start.with_motion(motion, kept)
            moved = task.problem(
                start.with_values({n: float(np.clip(suggested.value(n), *limits[n])) for n in asked}), asked
            )
            return cost_of(moved), cost_of(moved, channel), moved.plant
        except EmsidError:
            return inf, inf, start

    likely = list(motions(commanded, channel, is_position, zone, drive.offset, plant.turn))
    turned = plant.reversed_drive()
    forward = [(motion, plant) for motion in likely if motion.gain / drive.gain > 0]
    backward = [(motion, turned) for motion in likely if motion.gain / turned.drive.gain > 0]
    with in_threads(first.threads) as in_turn:
        costs = list(in_turn(lambda pair: tried(*pair), [*forward, *backward]))
    straight = [(cost_of(first), cost_of(first, channel), plant), *costs[: len(forward)]]
    turned_round = min((cost for _, cost, _ in costs[len(forward) :]), default=inf)
    if turned_round < WRONG_WAY * min(cost for _, cost, _ in straight):
        against.append(channel)
    _refuse_signs(first, against)
    if not is_position:
        plausible = plausible_motions(commanded, channel)
        straight += [tried(motion, plant) for motion in plausible if motion.gain / drive.gain > 0]
    return [(cost, moved) for cost, _, moved in straight]


def _currents_against(drive: Drive, problem: FreeRunError) -> list[int]:
    """The currents that fall where the voltage rises: any motor takes power."""
    voltage = np.concatenate([drive.gain * drive.commands(segment.input) for segment in problem.segments])
    found = []
    for channel in (k for k, signal in enumerate(problem.signals) if signal is Signal.CURRENT):
        current = np.concatenate([segment.output[:, channel] for segment in problem.segments])
        size = float(np.std(voltage) * np.std(current))
        if float(np.mean((voltage - np.mean(voltage)) * current)) < -PASSIVE * size:
            found.append(channel)
    return found


def _refuse_signs(problem: FreeRunError, against: Sequence[int]) -> None:
    """Refuse outputs with the opposite sign of the command."""
    if not against:
        return
    record = problem.segments[0]
    command, turning = record.input_names[0], [record.output_names[channel] for channel in sorted(against)]
    outputs = len(record.output_names)
    turned = [command] if len(turning) == outputs > 1 else turning
    raise DataError(
        f"{record.name}: {listed([repr(name) for name in turning])} {'go' if len(turning) > 1 else 'goes'} against "
        f"{command!r}; if that is how it was wired or logged, turn the sign of "
        f"{'one of them' if outputs == 1 else listed(turned)} with scale {' '.join(f'{name}=-1' for name in turned)}",
        arguments=("scale",),
    )


WRONG_WAY = 0.1
"""If a plant with a reversed drive lowers the cost to this share, a sign is wrong."""
PASSIVE = 0.2
"""Voltage and current of a motor are not negatively correlated, except by chance and delays, below this size."""


def started(
    plant: DrivenPlant, segments: Sequence[Record], signals: Sequence[Signal], free: Collection[str]
) -> list[DrivenPlant]:
    """The plant with its free parameters from regressions on the records, and from plausible motions."""
    found, kept = [], plant.handles.keys() - free
    is_position = signals[0] is Signal.POSITION
    commanded = after_drive(plant, segments, 0, is_position)
    zone = any("dead_zone" in name for name in free)
    likely = list(motions(commanded, 0, is_position, zone, plant.drive.offset, plant.turn))
    if not is_position:
        likely += plausible_motions(commanded, 0)
    for motion in likely:
        try:
            moved = plant.with_motion(motion, kept)
            found.append(plant.with_values({name: moved.value(name) for name in free}))
        except EmsidError:  # a motion that this plant cannot have
            continue
    return found
