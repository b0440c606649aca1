"""Words for files and the quality of data."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, words

# --- how a file was read ----------------------------------------------------------------------------------------------


@words("sample-time-implausible", Severity.WARNING)
def sample_time_implausible(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: dt."""
    dt = f.data["dt"]
    if dt < 1:
        return f"{f.subject}: a sample time of {dt:g} s is very short for a drive; check the unit of {argument('dt')}"
    return (
        f"{f.subject}: a sample time of {dt:g} s is very long for a drive; if this number was meant in ms, give "
        f"{argument('dt')} or {argument('time_unit')} in ms"
    )


@words("rows-skipped", Severity.WARNING)
def rows_skipped(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: count, rows, line, text (of the first; may be empty), messages."""
    d = f.data
    text = f" ({d['text']!r})" if d["text"] else ""
    many = d["count"] > 1
    return (
        f"{f.subject}: {d['count']} of {d['rows']:,} rows {'are' if many else 'is'} no numbers and "
        f"{'were' if many else 'was'} skipped; {'the first' if many else 'it'} is row {d['line']}{text}"
    )


@words("clock-reset")
def clock_reset(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: count, column, line (row of the file with the first)."""
    d = f.data
    times = "once" if d["count"] == 1 else f"{d['count']} times"
    return (
        f"{f.subject}: {d['column']} begins again {times}, first in row {d['line']}; each part is a segment of its own"
    )
