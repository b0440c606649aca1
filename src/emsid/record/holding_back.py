"""Which data are held back from a fit, so that the model can be tested on unseen data. All models use this module.

Normally the end of a record is held back. In a series of experiments, such as steps of ascending height, the last ones
differ from the rest; there every k-th experiment is held back, so that both parts cover all conditions. In a short
record one part holds too few samples; there cross-validation holds back each part once, at the cost of several fits.
Where the end shows little, as a drive at standstill, another part takes its place: there any model is about as good
as the mean of the output.

A part of a record that is held back knows the samples before it (`Record.part`), so that a free run over it begins in
the state that the record has led to.

The error of the best of several models is too small on the data that it was chosen on. Where the unseen data are long
enough, one part of them chooses and the other gives the error of the model that was chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from emsid.record.joining import concatenate
from emsid.record.record import Record

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
# The records to fit and the unseen records to test on.
Split = tuple[Sequence[Record], Sequence[Record]]

# Records with fewer samples than `SHORT` in total are cross-validated: each of `FOLDS` parts is unseen once.
SHORT, FOLDS = 4_000, 4
NEAR = 0.25
"""A stretch ends at a gap that is nearer to its end than this share of its length."""
LEAST_PART = 1_000
"""Unseen data are divided into a part that chooses and one that does not where each gets at least this many samples."""
FAIR = 1 / 3
"""A part shows little where the deviation of an output is less than this share of that in the record: a model that
explains two thirds of the output, as few do that are of no use, would be no better than the mean there."""


STARTS = 10
"""Without any change of the input, parts begin at each such share of their length, so that a response is little cut."""
TINY = np.finfo(float).tiny
CHANGES = 10
"""Changes are over this part of what is held back: long enough for a motion to stand out from noise, and short enough
for several of them."""


def hold_back(record: Record, fraction: float) -> tuple[Record, Record]:
    """Split a record into a part to fit and an unseen part of about this fraction of the samples.

    Args:
        record: in a series of experiments every k-th segment is held back, ``k = 1/fraction``; otherwise the end.
        fraction: between 0 and 1.

    Raises:
        DataError: for a fraction that leaves either part without a sample.
    """
    first, last = record.split(1 - fraction)
    k = round(1 / fraction)
    if not is_series(record, k):
        return first, last
    rest, held = every(record.segments, k)
    if not 0.5 < sum(map(len, held)) / len(last) < 2:
        return first, last
    return concatenate(rest), concatenate(held)


def hold_back_records(
    records: Sequence[Record], fraction: float, together: Callable[[Sequence[Record]], Record] = concatenate
) -> tuple[Record, Record]:
    """Split one or several records into a record to fit and an unseen record.

    Args:
        records: of 2k or more every k-th is unseen, ``k = 1/fraction``; otherwise the end of all of them together.
        fraction: between 0 and 1.
        together: joins several records into one and names it.

    Raises:
        DataError: for a fraction that leaves either part without a sample.
    """
    k = round(1 / fraction)
    if k < 2 or len(records) < 2 * k:
        whole = together(records)
        whole.split(1 - fraction)  # refuses what leaves nothing
        first, stop = unseen_part(whole, fraction)
        place = np.arange(len(whole))
        train = whole[:first] if stop == len(whole) else whole.mask((place >= first) & (place < stop))
        return train, replace(whole.part(first, stop), name=f"{whole.name}, unseen part")
    train, test = (together(part) for part in every(records, k))
    return train, replace(test, name=f"one in {k} of {len(records)} records")


def unseen_part(record: Record, fraction: float) -> tuple[int, int]:
    """The first sample of the part to hold back and the one after its last.

    It is the last part that shows enough and leaves enough. Where no part does, as after a long rest before the only
    motion, it is the end from where this fraction of the changes of the inputs is left. Where no input ever changes,
    as after a single step, it is the last part in which the output still responds, or the end.

    Args:
        record: all data.
        fraction: of the samples.
    """
    parts = _possible_parts(record, fraction)
    end = next(parts)
    return next((part for part in chain([end], parts) if shares(record, *part).min() >= FAIR), end)


def _possible_parts(record: Record, fraction: float) -> Iterator[tuple[int, int]]:
    """The parts that may be unseen in the order in which they are preferred, see `unseen_part`."""
    first = round((1 - fraction) * len(record))
    size = len(record) - first
    yield first, len(record)
    changed = np.flatnonzero(np.diff(record.input, axis=0).any(axis=1)) + 1
    step = size // 2 if len(changed) else size // STARTS
    every = ((k, k + size) for k in range(first, -1, -max(step, 1)))
    yield from ((k, stop) for k, stop in every if not len(changed) or np.any((changed > k) & (changed < stop)))
    if len(changed):
        yield int(changed[round((1 - fraction) * (len(changed) - 1))]), len(record)


def shares(record: Record, first: int, stop: int) -> Array:
    """(2,) how much of the motion of the record a part and the rest show; the least of all outputs.

    It is the deviation of an output, or that of its changes over a tenth of the part, whichever is larger, over that in
    the record: a position may move as much as ever while it stays near one place. Where no input changes, it is the
    deviation without that of white noise, as that of the response to an earlier input. One where an output is constant
    in the whole record.
    """
    place = np.arange(len(record))
    inside = (place >= first) & (place < stop)
    lag = max((stop - first) // CHANGES, 1)
    output = _in_common_scale(record.output)
    changes = output[lag:] - output[:-lag]
    found = np.zeros(2)
    for number, part in enumerate((inside, ~inside)):
        if not part.any():
            continue
        level = _share(output, part)
        if np.ptp(record.input[part], axis=0).any():
            found[number] = np.min(np.maximum(level, _share(changes, part[lag:] & part[:-lag])), initial=1.0)
        else:
            steps = np.diff(output, axis=0)[part[1:] & part[:-1]]
            noise = np.sum(steps**2, axis=0) / (2 * max(len(steps), 1) * np.maximum(output.var(axis=0), TINY))
            found[number] = np.sqrt(np.min(np.maximum(level**2 - noise, 0.0), initial=1.0))
    return found


def _in_common_scale(output: Array) -> Array:
    """Outputs (N, ny) over their largest values, so that the squares of any numbers are numbers."""
    largest = np.abs(output).max(axis=0, initial=0.0)
    return np.asarray(output / np.where(largest > 0, largest, 1.0))


def _share(values: Array, part: Mask) -> Array:
    """(ny,) the deviation of values (N, ny) in a part over that of all; one where they are constant."""
    whole = values.std(axis=0)
    inside = values[part].std(axis=0) if part.any() else np.zeros(values.shape[1])
    share: Array = np.divide(inside, whole, out=np.ones_like(whole), where=whole > 0)
    return share


def choice_and_headline(unseen: Record) -> tuple[Record, Record] | None:
    """Two parts of unseen data: one to choose a model on, one for the error of the model that was chosen.

    Args:
        unseen: of two segments or more every second one is in the second part; of one segment the second half.

    Returns:
        None where a part would have fewer than `LEAST_PART` samples, or shows little.
    """
    if len(unseen.segments) > 1:
        first, second = (concatenate(part) for part in every(unseen.segments, 2))
    else:
        first, second = unseen.split(0.5)
        if shares(unseen, 0, len(first)).min() < FAIR:
            return None
    if min(len(first), len(second)) < LEAST_PART:
        return None
    return replace(first, name=f"{unseen.name}, to choose"), replace(second, name=f"{unseen.name}, after the choice")


def validation_splits(records: Sequence[Record], fraction: float) -> tuple[list[Record], list[Split]]:
    """The records that a search may see, and the splits into fitted and unseen data that compare its models.

    Args:
        records: short ones are cross-validated with `FOLDS` parts, and the search sees all of them.
        fraction: the unseen part of every record, where they are long.
    """
    if sum(len(record) for record in records) < SHORT:
        return folded(records)
    halves = [hold_back(record, fraction) for record in records]
    identify = [first for first, _ in halves]
    return identify, [(identify, [second for _, second in halves])]


def folded(records: Sequence[Record]) -> tuple[list[Record], list[Split]]:
    """All records for a search to see, and `FOLDS` splits, in which every part of every record is unseen once."""
    return list(records), [_without_fold(records, k) for k in range(FOLDS)]


def parted(record: Record, folds: int) -> list[Record]:
    """A record in parts of about equal length that cover it.

    In a series of experiments every part is every k-th experiment. Otherwise the parts are stretches, with an edge at a
    gap where one is near.

    Args:
        record: of at least ``folds`` samples.
        folds: k, at least two.
    """
    if is_series(record, folds):
        return [concatenate(record.segments[k::folds]) for k in range(folds)]
    return [record.part(first, stop) for first, stop in pairwise(_edges(record, folds))]


def shows_all_in_a_part(record: Record, folds: int) -> bool:
    """Whether one of the parts that `parted` gives has so much of the motion that the rest shows little."""
    return any(shares(record, first, stop)[1] < FAIR for first, stop in pairwise(_edges(record, folds)))


def left_out_once(record: Record, folds: int, purged: int) -> list[tuple[Record, Record]]:
    """Splits of a record in which every sample is left out once: the rest, and the part that is left out, as `parted`.

    Args:
        record: of at least ``folds`` samples.
        folds: k, at least two.
        purged: samples on either side of a stretch that are in no part, as their noise is that of the stretch.
    """
    parts = parted(record, folds)
    if is_series(record, folds):
        pieces = record.segments
        rests = [concatenate([p for n, p in enumerate(pieces) if n % folds != k]) for k in range(folds)]
        return list(zip(rests, parts, strict=True))
    found, place = [], np.arange(len(record))
    for (first, stop), part in zip(pairwise(_edges(record, folds)), parts, strict=True):
        out = (place >= first - (first not in record.breaks) * purged) & (
            place < stop + (stop not in record.breaks) * purged
        )
        found.append((record.mask(out), part))
    return found


def stretches_in_turn(lengths: Sequence[int], folds: int, stretches: int, known: int) -> Iterator[list[Mask]]:
    """The samples that each fold leaves out: every ``folds``-th of equal stretches.

    A fold that leaves out one whole part of a short record may leave out all of its largest values, and where a run
    begins anew in every part, few samples must give its state.

    Args:
        lengths: of the segments.
        folds: their number.
        stretches: the number of stretches, a multiple of that.
        known: samples at the start of each segment that no fold leaves out, as they show its initial state.

    Yields:
        (N,) for every segment, whether the fold leaves out the sample.
    """
    free = np.concatenate([np.arange(length) >= known for length in lengths])
    stretch = (np.cumsum(free) - 1) * stretches // np.sum(free)
    for fold in range(folds):
        yield np.split(free & (stretch % folds == fold), np.cumsum(lengths)[:-1])


def _edges(record: Record, folds: int) -> list[int]:
    """The first sample of every stretch, and the end; at a gap that is nearer than `NEAR` stretches."""
    inner = []
    for k in range(1, folds):
        edge = round(k * len(record) / folds)
        gap = min(record.breaks, key=lambda each: abs(each - edge), default=edge)
        inner.append(gap if abs(gap - edge) < NEAR * len(record) / folds else edge)
    return [0, *inner, len(record)]


def is_series(record: Record, k: int) -> bool:
    """Whether a record is a series of experiments of similar length, so that every k-th of them can be held back."""
    lengths = [len(segment) for segment in record.segments]
    return k >= 2 and len(lengths) >= 2 * k and max(lengths) * k <= len(record)


def every(pieces: Sequence[Record], k: int) -> tuple[list[Record], list[Record]]:
    """The pieces without every k-th, and every k-th."""
    return [piece for number, piece in enumerate(pieces, 1) if number % k], list(pieces[k - 1 :: k])


def _without_fold(records: Sequence[Record], k: int) -> Split:
    """Every record without its k-th part, and the k-th parts."""
    rest, parts = [], []
    for record in records:
        first, last = (int(len(record) * edge / FOLDS) for edge in (k, k + 1))
        gone = np.zeros(len(record), dtype=bool)
        gone[first:last] = True
        rest.append(record.mask(gone))
        parts.append(record.part(first, last))
    return rest, parts
