"""Several records as one, and the segments of several records."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from emsid.errors import DataError
from emsid.findings import Finding
from emsid.record.record import Record
from emsid.units import channel_and_unit


def concatenate(records: Iterable[Record], name: str | None = None) -> Record:
    """Join several experiments into one record; each becomes one or more segments.

    Args:
        records: with the same channels and sample time.
        name: of the joined record; by default the name of the first.

    Raises:
        DataError: where sample times, channel names or units differ.
    """
    pieces = tuple(records)
    if not pieces:
        raise DataError("no record to concatenate")
    first = pieces[0]
    for other in pieces[1:]:
        check_same_channels(first, other)
    offsets = np.cumsum([0] + [len(piece) for piece in pieces])
    starts = [
        int(offset + edge) for offset, piece in zip(offsets[:-1], pieces, strict=True) for edge in (0, *piece.breaks)
    ]
    return replace(
        first,
        input=np.concatenate([piece.input for piece in pieces]),
        output=np.concatenate([piece.output for piece in pieces]),
        breaks=tuple(starts[1:]),
        times=tuple(time for piece in pieces for time in piece.times),
        name=name or first.name,
        sources=_sources(pieces),
        time_axis=first.time_axis if all(piece.time_axis == first.time_axis for piece in pieces) else None,
        findings=_of_all(pieces),
        before=tuple(each for piece in pieces for each in piece.before or (None,) * (len(piece.breaks) + 1)),
        excerpt_of=tuple(each for piece in pieces for each in piece.excerpt_of),
    )


def continuing(before: Record | None, piece: Record) -> Record:
    """A segment joined to the samples right before it, as one segment.

    Args:
        before: the samples before it; None for none.
        piece: of one segment.

    Raises:
        DataError: where sample times, channel names or units differ.
    """
    if before is None:
        return piece
    joined = concatenate([before, piece])
    return replace(joined, breaks=(), times=joined.times[:1], sources=(), before=())


def _sources(pieces: Sequence[Record]) -> tuple[str, ...]:
    """The name of the experiment of every segment; empty where all have the same name."""
    found = tuple(name for piece in pieces for name in piece.experiments)
    return found if len(set(found)) > 1 else ()


def _of_all(pieces: Sequence[Record]) -> tuple[Finding, ...]:
    """The findings of all pieces; those that the pieces have in common once."""
    found: list[Finding] = []
    for piece in pieces:
        found += [finding for finding in piece.findings if finding not in found]
    return tuple(found)


def check_same_channels(first: Record, other: Record) -> None:
    """Refuse two records with different sample times, channels or units, which one model cannot describe.

    Names may differ in how they write the unit of the channel.
    """
    if not np.isclose(first.dt, other.dt, rtol=1e-6, atol=0.0):
        raise DataError(
            f"{other.name} is sampled every {other.dt:g} s and {first.name} every {first.dt:g} s; resample one of them"
        )
    for what in ("input_names", "output_names", "input_units", "output_units"):
        side, _, facts = what.partition("_")
        alike = facts == "names" and _channels(first, side) == _channels(other, side)
        if not alike and getattr(first, what) != getattr(other, what):
            raise DataError(
                f"{other.name} has {what.replace('_', ' ')} {getattr(other, what)} and {first.name} "
                f"{getattr(first, what)}; they must agree"
            )


def _channels(record: Record, side: str) -> list[tuple[str, str]]:
    """The channels of a side with their units, without the units in their names."""
    names, units = getattr(record, f"{side}_names"), getattr(record, f"{side}_units")
    return [channel_and_unit(name, unit) for name, unit in zip(names, units, strict=True)]


def segments(records: Record | Iterable[Record]) -> Iterator[Record]:
    """Every segment of one or several records, in order; the records are read one at a time."""
    for record in (records,) if isinstance(records, Record) else records:
        yield from record.segments
