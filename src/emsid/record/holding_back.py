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

An excerpt of a long record: fewer samples that show what the whole record does.

Of a long record, structures are compared, and searches begun, on an excerpt. An estimate from N samples has errors in
proportion to 1/√N, so in a long record more samples cost time and change little. An excerpt has to keep the range of
the record, because a model extrapolates beyond the range that it was fitted to.

A part of a record with the samples that lead into it.

Whether two records have samples in common, such as two cuts of one file.

Samples are compared exactly. Stretches of `STRETCH` samples that are equal show how far one record is shifted against
the other. Every experiment has stretches at standstill, and at constant speed a coarse sensor repeats the same counts.
So a stretch counts only if at least half of its samples change some output, and if it occurs only once in its record.
The records have samples in common only if they are equal wherever they overlap after the shift, in twice as many
samples at least: the end of one may be like the beginning of the next by chance.

A model file has no samples to compare with, but a fingerprint: the numbers of some stretches of the record that the
model was fitted to. They are longer than those of two records.
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


Piece = tuple[int, int]
"""The first sample, and the one after the last."""

PIECES = 8
"""Pieces of a record without gaps."""
SHORT_RECORD = 500
"""A record with more segments has as many pieces, where they have no fewer samples than these."""
REACHED = 0.02
"""An excerpt reaches an extreme of a channel if it comes as near as this share of the channel's range."""


def excerpt(record: Record, most: int, least: int = PIECES) -> Record:
    """Pieces of a record at equal distances, with at most this many samples in all; a shorter record itself.

    No piece contains a gap; where segments are shorter than pieces, whole segments are taken. Where the pieces do not
    reach the smallest or the largest value of a channel, the piece next to it is moved there.

    Args:
        record: of any length.
        most: samples of the excerpt.
        least: number of its pieces, where the record has no more segments and these are long enough.
    """
    if len(record) <= most:
        return record
    return concatenate([record[first:stop] for first, stop in _pieces(record, most, least)], name=record.name)


def outside_excerpt(record: Record, most: int, least: int = PIECES) -> Record | None:
    """The samples that `excerpt` leaves out; None where it leaves out none."""
    if len(record) <= most:
        return None
    inside = np.zeros(len(record), dtype=bool)
    for first, stop in _pieces(record, most, least):
        inside[first:stop] = True
    return record.mask(inside) if not inside.all() else None


def _pieces(record: Record, most: int, least: int) -> list[Piece]:
    """The pieces of an excerpt, in the order of time."""
    pieces = _at_equal_distances(record, most, least)
    kept: set[Piece] = set()  # those that reach an extreme
    for signal in (*record.input.T, *record.output.T):
        near = REACHED * float(np.ptp(signal))
        for values in (signal, -signal):
            place = int(np.argmax(values))
            reach = [(a, b) for a, b in pieces if values[a:b].max() >= values[place] - near]
            free = [piece for piece in pieces if piece not in kept]
            if not reach and free:
                nearest = min(free, key=lambda piece: abs(sum(piece) // 2 - place))
                pieces.remove(nearest)
                there, rest = _moved(nearest, place, pieces, record)
                pieces, reach = sorted([*pieces, there, *rest]), [there]
            if kept.isdisjoint(reach):
                kept |= set(reach[:1])
    return pieces


def _moved(piece: Piece, place: int, others: Sequence[Piece], record: Record) -> tuple[Piece, list[Piece]]:
    """The piece around a sample of its segment, between the others; and the rest, where there is no room for all."""
    k = int(np.searchsorted(record.breaks, place, side="right"))
    edges = (0, *record.breaks, len(record))
    low = max([edges[k], *(stop for _, stop in others if stop <= place)])
    high = min([edges[k + 1], *(first for first, _ in others if first > place)])
    first, stop = piece
    left = stop - first - (high - low)
    if left > 0:
        return (low, high), [(first, first + left)]
    begin = min(max(place - (stop - first) // 2, low), high - (stop - first))
    return (begin, begin + stop - first), []


def _at_equal_distances(record: Record, most: int, least: int) -> list[Piece]:
    """Pieces of equal length in every long segment; of a segment that has no room for its pieces, all of it."""
    edges = np.array([0, *record.breaks, len(record)])
    sizes = np.sort(np.diff(edges))
    half = int(sizes[np.searchsorted(np.cumsum(sizes), len(record) / 2)])  # half of the samples: in segments this long
    length = max(min(most // max(least, min(len(sizes), most // SHORT_RECORD)), half), 1)
    starts = np.linspace(0, len(record) - length, most // length).astype(int)
    owners = np.searchsorted(edges, starts + length // 2, side="right") - 1
    pieces: list[Piece] = []
    for k in np.unique(owners):
        low, high = int(edges[k]), int(edges[k + 1])
        own = np.maximum(starts[owners == k], low)
        if high - low <= length * len(own):
            pieces.append((low, high))
            continue
        after = length * np.arange(len(own))  # pieces that do not overlap, from the first one on, end in the segment
        own = np.minimum(np.maximum.accumulate(own - after), high - length * len(own)) + after
        pieces += [(int(first), int(first) + length) for first in own]
    return pieces


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
