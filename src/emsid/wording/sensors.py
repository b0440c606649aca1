"""Words for channels that measure something else, or not what they seem to."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.units import with_unit
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import ordinal


@words("output-clipped", Severity.WARNING)
def output_clipped(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: lower, upper, unit, share, mask (a condition; absent or empty where none is known)."""
    d = f.data
    condition = f" {d['mask']!r}" if d.get("mask") else ""
    upper = with_unit(f"{d['upper']:.4g}", d["unit"])
    return (
        f"{f.subject} is clipped to {d['lower']:.4g} … {upper} in {100 * d['share']:.2g} % of the samples; leave them "
        f"out with {argument('mask')}{condition}"
    )


@words("input-logged-slower", Severity.WARNING)
def input_logged_slower(f: Finding, argument: Spelling) -> str:
    """Subject: the input. Data: output, factor, dt (s)."""
    d = f.data
    return (
        f"{f.subject} changes at every {ordinal(d['factor'])} row, and {d['output']} does not follow the rows between; "
        f"log both at one rate, or keep every {ordinal(d['factor'])} row with {argument('decimate')} {d['factor']}"
    )


sentences("""
few-output-levels warning: {subject} has {levels} values only, which show no dynamics; measure it with a finer sensor
output-is-input warning: {subject} is {factor:.4g} times {input} in every row: one signal twice; check the columns
""")
