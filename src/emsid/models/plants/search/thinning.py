"""Fewer samples for the many trials of a choice: every k-th output, and the mean of the command in between.

A mass that is driven by the mean of a force over some time has the same speed afterwards, as long as the time is short
compared with its motion. So a long record of a position loses little, and every free run over it is k times faster. The
plant that is chosen is fitted to all samples in the end.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from emsid.record import Record, concatenate

ENOUGH = 6000
"""Samples in all below which nothing is left out."""
MOST = 8
"""Of so many samples, one is kept at least."""


def thinned(record: Record, straight: bool) -> Record:
    """The record with every k-th sample of its outputs, so that about `ENOUGH` samples are left, or the record itself.

    Args:
        record: its inputs are commands, not codes.
        straight: whether the commands go straight from sample to sample, else they are held.
    """
    every = min(len(record) // ENOUGH, MOST)
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
    return replace(segment, input=means, output=segment.output[: blocks * every : every], dt=every * segment.dt)
