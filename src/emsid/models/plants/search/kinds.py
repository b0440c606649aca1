"""The errors of a trial on kinds of samples that it was not fitted to: levels of the command, directions, speeds.

The end of a record is the same kind of experiment as its beginning. A refinement that acts at large commands only, or
in one direction, is tested by leaving such samples out: the plant is fitted to the errors of all others and compared on
those left out. Each kind is left out in turn, so a fit to small commands has to hold at large ones, and the reverse.

One side of a break, such as the limit of a supply, shows nothing about the other. So the record must have both: enough
samples on each side, and on neither a larger error with the break than without. On the side with fewer samples the
error is smaller by more than noise. The mean over all samples would not show this if few of them are beyond the break,
as when a supply limits one of many records.

A delay, a lag and a mean over the sample delay the output in the same way while the speed grows and while it falls. If
the record has both, they are compared like the sides of a break: a drive with a soft start, or a bridge that brakes in
another way than it drives, is late in one of them only. Steps from rest have only one, and nothing is known about the
other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.models.plants.drive import FULL
from emsid.models.plants.motion_regression import speed_of
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.trials import Trial, Trials
from emsid.record import Record
from emsid.selection.improvement import StretchErrors, better, matters

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SHARE = 0.1
"""A kind of samples is left out where it is at least this part of all, and leaves at least as many."""
SEEN = 0.02
"""Each side of a break has at least this part of all samples."""
MOVING = 0.03
"""Samples slower than this part of the top speed have no direction."""
BESIDE = 1.02
"""A voltage is beyond a break if it is larger by this factor: the largest one may be the limit itself."""
PARTS = 3
"""Parts of equal size of the levels of a command or a speed, from small to large."""
STRETCHES = 8
"""Stretches of every kind that errors are compared in."""


def kinds(segments: Sequence[Record], signals: Sequence[Signal]) -> Iterator[tuple[Mask, ...]]:
    """The samples of every kind, (N,) for each segment.

    Args:
        segments: records without gaps, driven by their first input.
        signals: the quantities of their outputs; the first one is used.
    """
    commands = [np.abs(segment.input[:, 0]) for segment in segments]
    speeds = [speed_of(each.output[:, 0], each.dt, signals[0] is Signal.POSITION) for each in segments]
    for values in (commands, [np.abs(speed) for speed in speeds]):
        for low, high in _ranges(np.concatenate(values)):
            yield from _enough([(each > low) & (each <= high) for each in values])
    for sign in (1.0, -1.0):
        yield from _enough([sign * speed > 0 for speed in speeds])


def better_on_kinds(trials: Trials, rich: Trial, simple: Trial) -> bool:
    """Whether the richer of two trials predicts most kinds of samples, each left out of its fit, better.

    If the records have one kind only, the answer is no. Every kind counts once, however large its errors are: without
        the samples of one of them a plant may be poorly determined.
    """
    better_ones = [
        _left_out(trials, rich, mask).mean < _left_out(trials, simple, mask).mean
        for mask in kinds(trials.segments, trials.signals)
    ]
    return sum(better_ones) > len(better_ones) / 2


def both_directions_seen(trials: Trials) -> bool:
    """Whether the records show both directions of the motion."""
    is_position = trials.signals[0] is Signal.POSITION
    speed = np.concatenate([speed_of(each.output[:, 0], each.dt, is_position) for each in trials.segments])
    moving = MOVING * float(np.max(np.abs(speed)))
    return min(float(np.mean(speed > moving)), float(np.mean(speed < -moving))) >= SEEN


def better_on_both_sides(trials: Trials, rich: Trial, simple: Trial, name: str) -> bool:
    """Whether the record has both sides of a break in the voltage, and the break improves them.

    Args:
        trials: what the two share.
        rich, simple: the trials with and without the break.
        name: the parameter of the richer one that is the voltage of the break; a supply limits what a knee leaves.
    """
    drive, level = rich.plant.drive, rich.plant.value(name)
    wanted = _wanted(trials, rich)
    if name == "drive.supply":
        wanted = [drive.after_knee(each) for each in wanted]
    beyond = [np.abs(each) > BESIDE * level for each in wanted]
    return _better_on_both(trials, rich, simple, beyond, [~each for each in beyond])


def better_at_full_duty_and_below(trials: Trials, rich: Trial, simple: Trial) -> bool:
    """Whether a loss below full duty improves the samples on both of its sides, with the other parameters fitted again.

    Args:
        trials: what the two share.
        rich, simple: the trials with and without the loss.
    """
    full = [np.abs(each) >= FULL * rich.plant.drive.supply for each in _wanted(trials, rich)]
    return _better_on_both(trials, rich, simple, full, [~each for each in full])


def _wanted(trials: Trials, trial: Trial) -> list[Array]:
    """(N,) of every segment, the voltage (force) before any limit, in V (N)."""
    drive = trial.plant.drive
    return [drive.gain * (drive.commands(segment.input) + drive.offset) for segment in trials.segments]


def better_in_both_changes(trials: Trials, rich: Trial, simple: Trial) -> bool:
    """Whether a refinement that delays the output improves acceleration and deceleration; true with only one.

    Args:
        trials: what the two share.
        rich, simple: the trials with and without the refinement; the free run of the latter shows where the speed
            changes, without noise.
    """
    grows, falls = _changes(trials, simple)
    return not _enough_of_each(grows, falls) or _better_on_both(trials, rich, simple, grows, falls)


def _changes(trials: Trials, trial: Trial) -> tuple[list[Mask], list[Mask]]:
    """(N,) of every segment, masks of acceleration and of deceleration in a free run."""
    is_position = trials.signals[0] is Signal.POSITION
    changes = []
    for segment, state in zip(trials.segments, trial.states, strict=True):
        run = trial.plant.simulate(segment.input, segment.dt, state, trials.signals)[:, 0]
        speed = np.abs(speed_of(run, segment.dt, is_position))
        changes.append(np.diff(speed, prepend=speed[:1]))
    least = MOVING * max(float(np.max(np.abs(change))) for change in changes)
    return [each > least for each in changes], [each < -least for each in changes]


def _enough_of_each(one: Sequence[Mask], other: Sequence[Mask]) -> bool:
    return min(float(np.mean(np.concatenate(side))) for side in (one, other)) >= SEEN


def _better_on_both(trials: Trials, rich: Trial, simple: Trial, one: Sequence[Mask], other: Sequence[Mask]) -> bool:
    """Whether both sides have enough samples, and a smaller error on that with fewer and no larger one on the other."""
    if not _enough_of_each(one, other):
        return False
    sides = [np.concatenate([np.tile(some, len(trials.signals)) for some in side]) for side in (one, other)]
    fewer, others = sorted(sides, key=np.sum)
    squares = [np.concatenate(each.residuals) ** 2 for each in (rich, simple)]
    with_it, without = (float(np.mean(each[others])) for each in squares)
    return not matters(without, than=with_it) and better(*(StretchErrors.of(each[fewer]) for each in squares))


def _left_out(trials: Trials, trial: Trial, mask: Sequence[Mask]) -> StretchErrors:
    """The errors on some samples of a trial that is fitted again to the errors of all others."""
    others = replace(trials, counted=tuple((~some).astype(float) for some in mask))
    again = others.fitted([trial.plant], trial.names, trial.states)
    squares = np.concatenate(trials.residuals(trial if again is None else again)) ** 2
    counted = np.concatenate([np.tile(some, len(trials.signals)) for some in mask])
    return StretchErrors.of(np.where(counted, squares, np.nan), STRETCHES)


def _ranges(values: Array) -> list[tuple[float, float]]:
    """The ranges of `PARTS` parts of some values; zero is a part of its own and is left out."""
    moving = values[values > 0]
    if not len(moving):
        return []
    edges = np.quantile(moving, np.linspace(0, 1, PARTS + 1))
    edges[0] = 0.0
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def _enough(masks: list[Mask]) -> Iterator[tuple[Mask, ...]]:
    """The masks, if they are enough of all samples and leave enough."""
    share = float(np.mean(np.concatenate(masks)))
    if SHARE <= share <= 1 - SHARE:
        yield tuple(masks)
