"""Which data are held back from a fit, so that it can be judged on data that it has not seen: one policy for all.

Held back is the end of a record. Of a series of experiments, such as steps of ascending height, no end stands for the
rest; there every k-th is held back, so that both parts see all that was done. In a short record a part says little;
where several fits can be afforded, each part is held back in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from emsid.record.record import Record, concatenate

# What identifies and what judges.
Round = tuple[Sequence[Record], Sequence[Record]]

# Records with fewer samples than `SHORT` together are short: each of `FOLDS` parts judges once.
SHORT, FOLDS = 4_000, 4


def hold_back(record: Record, fraction: float) -> tuple[Record, Record]:
    """A part to fit to, and about this fraction of the samples with which to judge fits.

    Args:
        record: of a series of experiments every k-th segment is held back, ``k = 1/fraction``, otherwise the end.
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
    """What to identify from and what is kept unseen, of one or several records.

    Args:
        records: of 2k and more every k-th is kept unseen, ``k = 1/fraction``; otherwise the end of the whole.
        fraction: between 0 and 1.
        together: makes one record of several, with a name for all.

    Raises:
        DataError: for a fraction that leaves either part without a sample.
    """
    k = round(1 / fraction)
    if k < 2 or len(records) < 2 * k:
        whole = together(records)
        train, rest = whole.split(1 - fraction)
        return train, replace(rest, name=f"{whole.name}, unseen part")
    train, test = (together(part) for part in every(records, k))
    return train, replace(test, name=f"one in {k} of {len(records)} records")


def rounds(records: Sequence[Record], fraction: float) -> tuple[list[Record], list[Round]]:
    """What choices may be made from, and the rounds in which they are judged, each on data that it does not fit.

    Args:
        records: where they are short, all of them are shown and each of `FOLDS` parts judges once.
        fraction: of every record that judges, where they are long.
    """
    if sum(len(record) for record in records) < SHORT:
        return list(records), [_without_fold(records, k) for k in range(FOLDS)]
    halves = [hold_back(record, fraction) for record in records]
    identify = [first for first, _ in halves]
    return identify, [(identify, [second for _, second in halves])]


def is_series(record: Record, k: int) -> bool:
    """Whether a record is of many experiments of about one length, so that every k-th of them may be held back."""
    lengths = [len(segment) for segment in record.segments]
    return k >= 2 and len(lengths) >= 2 * k and max(lengths) * k <= len(record)


def every(pieces: Sequence[Record], k: int) -> tuple[list[Record], list[Record]]:
    """All but every k-th of these, and every k-th."""
    return [piece for number, piece in enumerate(pieces, 1) if number % k], list(pieces[k - 1 :: k])


def _without_fold(records: Sequence[Record], k: int) -> Round:
    """Every record without its k-th part, and those parts."""
    rest, parts = [], []
    for record in records:
        first, last = (int(len(record) * edge / FOLDS) for edge in (k, k + 1))
        gone = np.zeros(len(record), dtype=bool)
        gone[first:last] = True
        rest.append(record.mask(gone))
        parts.append(record[first:last])
    return rest, parts
