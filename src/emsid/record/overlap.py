"""Whether two records have samples in common, such as two cuts of one file.

Samples are compared exactly. Stretches of `STRETCH` samples that are equal show how far one record is shifted against
the other. Every experiment has stretches at standstill, and at constant speed a coarse sensor repeats the same counts.
So a stretch counts only if at least half of its samples change some output, and if it occurs only once in its record.
The records have samples in common only if they are equal wherever they overlap after the shift, in twice as many
samples at least: the end of one may be like the beginning of the next by chance.

A model file has no samples to compare with, but a fingerprint: the numbers of some stretches of the record that the
model was fitted to. They are longer than those of two records.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.record.record import Record

STRETCH = 16
"""Samples of a stretch that is looked for; a common part of twice as many contains one wherever it begins."""
COMMON = 2 * STRETCH
"""The fewest common samples of two segments, where the shorter one has as many."""

LONG = 64
"""Samples of a stretch in a fingerprint."""
APART, FEWEST, MOST_STRETCHES = 1_000, 32, 256
"""A fingerprint has one stretch for about this many samples; the fewest and the most stretches."""


def fingerprint(record: Record) -> bytes:
    """The numbers of stretches spread over a record, 8 bytes each; empty for a short, constant or periodic record."""
    numbers = np.concatenate([_stretches(segment, LONG) for segment in record.segments])
    once = np.flatnonzero(_occurs_once(numbers))
    count = min(max(len(numbers) // APART, FEWEST), MOST_STRETCHES, len(once))
    kept = once[np.linspace(0, len(once) - 1, count).round().astype(int)]
    return bytes(numbers[kept].astype("<u8").tobytes())


def has_fingerprint(record: Record, known: bytes) -> bool:
    """Whether a record contains some of the record that a fingerprint is from.

    It sees a part that is longer than `LONG` samples and than the distance of the stretches in the fingerprint.
    """
    sought = np.frombuffer(known[: len(known) // 8 * 8], dtype="<u8")
    return any(bool(np.isin(sought, _stretches(segment, LONG)).any()) for segment in record.segments)


def has_equal_samples(record: Record, other: Record) -> bool:
    """Whether two records have the same inputs and outputs, sample by sample."""
    return np.array_equal(record.input, other.input) and np.array_equal(record.output, other.output)


def has_common_samples(record: Record, other: Record) -> bool:
    """Whether a stretch of one record is also one of the other, in every input and output."""
    return any(_shared_stretch(one, two) for one in record.segments for two in other.segments)


def _shared_stretch(one: Record, other: Record) -> bool:
    """Whether two segments are equal, or have a stretch in common."""
    if one.input.shape[1:] != other.input.shape[1:] or one.output.shape[1:] != other.output.shape[1:]:
        return False
    if has_equal_samples(one, other):
        return True
    few, many = sorted((one, other), key=len)
    if len(few) < STRETCH:
        return False
    sought, present = _stretches(few), _stretches(many)
    starts = np.flatnonzero(_occurs_once(sought))
    starts = starts[starts % STRETCH == 0]
    starts = starts[np.isin(sought[starts], present)]  # sorts once; each start below searches the whole record
    return any(
        _equal_after(few, many, int(k - start)) for start in starts for k in np.flatnonzero(present == sought[start])
    )


def _equal_after(few: Record, many: Record, shift: int) -> bool:
    """Whether segments are equal wherever they overlap if sample 0 of the first is sample ``shift`` of the second."""
    here = slice(max(0, -shift), min(len(few), len(many) - shift))
    if here.stop - here.start < min(COMMON, len(few)):
        return False
    there = slice(here.start + shift, here.stop + shift)
    return np.array_equal(few.output[here], many.output[there]) and np.array_equal(few.input[here], many.input[there])


def _stretches(segment: Record, length: int = STRETCH) -> NDArray[np.uint64]:
    """(N − length + 1,) a hash of every stretch, equal only for equal stretches; zero at standstill."""
    if len(segment) < length:
        return np.zeros(0, dtype=np.uint64)
    values = np.column_stack([segment.input, segment.output]) + 0.0  # no negative zero
    bits = np.ascontiguousarray(values).view(np.uint64)
    rng = np.random.default_rng(0)
    factors = rng.integers(1, 2**63, length + bits.shape[1], dtype=np.uint64) | np.uint64(1)
    row = _mixed((bits * factors[length:]).sum(axis=1, dtype=np.uint64))
    count = len(segment) - length + 1
    number = np.zeros(count, dtype=np.uint64)
    for k, factor in enumerate(factors[:length]):
        number += row[k : k + count] * factor
    changes = np.concatenate([[0], np.cumsum(np.any(np.diff(segment.output, axis=0) != 0, axis=1))])
    moving = changes[length - 1 :] - changes[:count] >= STRETCH // 2
    return np.where(moving, number, np.uint64(0))


def _occurs_once(numbers: NDArray[np.uint64]) -> NDArray[np.bool_]:
    """(N,) whether a stretch is in motion, and differs from all others of its record."""
    _, group, count = np.unique(numbers, return_inverse=True, return_counts=True)
    return np.asarray((count[group] == 1) & (numbers != 0))


def _mixed(bits: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """A number from every number whose bits all depend on all of it (the finaliser of MurmurHash3)."""
    bits = bits ^ (bits >> np.uint64(33))
    bits = bits * np.uint64(0xFF51AFD7ED558CCD)
    return np.asarray(bits ^ (bits >> np.uint64(29)))
