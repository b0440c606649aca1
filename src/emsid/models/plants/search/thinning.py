"""Fewer samples for the many trials of a choice: every k-th output, and the mean of the command between these.

The mean of a force over a short time changes the speed of a mass as the force itself does, if this time is short
compared with the motion. So a long record of a position loses little, and every free run over it is k times faster. The
chosen plant is fitted to all samples in the end.

A speed is less smooth. It is thinned if the samples left out lie between their neighbours, except for noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from emsid.record import Record, concatenate

ENOUGH = 6000
"""Records with fewer samples in all are not thinned."""
LONGEST = 8
"""The longest distance in samples between two that are kept."""
SMOOTH = 5.0
"""The allowed mean square of interpolation errors, as a multiple of the variance of noise."""
STEEPEST, WINDOW = 0.02, 20
"""The part of all samples that is tested, and the samples of a window in which noise is measured."""


def thinned(record: Record, straight: bool, speed: bool = False) -> Record:
    """The record with every k-th sample of its outputs, so that about `ENOUGH` samples are left, or the record itself.

    Args:
        record: its inputs are commands, not codes.
        straight: whether the commands go straight from sample to sample, else they are held.
        speed: whether its output is a speed, which may change too fast.
    """
    every = min(len(record) // ENOUGH, LONGEST)
    while speed and every > 1 and not _smooth(record, every):
        every -= 1
    shortest = min(len(segment) for segment in record.segments)
    if every < 2 or shortest < 20 * every:
        return record
    return concatenate([_thinned(segment, every, straight) for segment in record.segments])


def _thinned(segment: Record, every: int, straight: bool) -> Record:
    blocks = len(segment) // every
    inputs = segment.input[: blocks * every]
    if straight:
        following = np.concatenate([segment.input[1:], segment.input[-1:]])[: blocks * every]
        inputs = 0.5 * (inputs + following)
    means = inputs.reshape(blocks, every, -1).mean(axis=1)
    output = segment.output[: blocks * every : every]
    return replace(segment, input=means, output=output, dt=every * segment.dt, before=())


def _smooth(record: Record, every: int) -> bool:
    """Whether the outputs between every k-th sample lie between these, except for noise, where they change most.

    Straight lines through every k-th sample miss the steepest samples by no more than `SMOOTH` times the noise of both.
    Noise is estimated by second differences, as the median over short windows, so jumps do not count as noise.
    """
    missed, steep, windows = [], [], []
    for segment in record.segments:
        y, index = segment.output[:, 0], np.arange(len(segment))
        missed.append(y - np.interp(index, index[::every], y[::every]))
        steep.append(np.abs(np.gradient(y[::every])).repeat(every)[: len(y)])
        bends = np.diff(y, 2) ** 2 / 6.0
        windows.append(bends[: len(bends) // WINDOW * WINDOW].reshape(-1, WINDOW).mean(axis=1))
    slope = np.concatenate(steep)
    steepest = slope >= np.quantile(slope, 1 - STEEPEST)
    error = float(np.mean(np.concatenate(missed)[steepest] ** 2))
    return error <= SMOOTH * 2.0 * float(np.median(np.concatenate(windows)))
