"""Words for records that differ from each other, and for channels that do not measure what they seem to."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.units import in_unit, with_unit
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import duration

CAUSES = {
    "delay": "log with one clock",
    "gain": "check load and supply",
    "level": "check sensor and load",
}


def _differs(kind: str, value: float, unit: str) -> str:
    """Words for the difference between one record and the model."""
    if kind == "delay":
        return f"is {duration(abs(value))} {'later' if value > 0 else 'earlier'}"
    if kind == "gain":
        return f"has {100 * abs(value):.3g} % {'more' if value > 0 else 'less'}"
    return f"is {with_unit(f'{abs(value):.3g}', unit)} {'above' if value > 0 else 'below'}"


@words("records-differ", Severity.WARNING)
def records_differ(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: kind, unit, share, records (name, value)."""
    kind, records = f.data["kind"], f.data["records"]
    values = [record["value"] for record in records]
    extremes = sorted((values.index(min(values)), values.index(max(values))))  # the two records furthest apart
    first, second = (f"{records[k]['name']} {_differs(kind, values[k], f.data['unit'])}" for k in extremes)
    return (
        f"the {kind} of {f.subject} differs between records ({100 * f.data['share']:.0f} % of the squared error): "
        f"{first}, {second}; {CAUSES[kind]}"
    )


@words("record-shifted", Severity.WARNING)
def record_shifted(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: output, delay (s), samples, rmse, shifted (the RMSE after a shift), unit."""
    d, way = f.data, "late" if f.data["samples"] > 0 else "early"
    before, after = f"{d['rmse']:.3g}", with_unit(f"{d['shifted']:.3g}", d["unit"])
    return (
        f"{f.subject} is {way} by {duration(abs(d['delay']))}: shifted by that, the RMSE of {d['output']} falls from "
        f"{before} to {after}; check the time stamps ({argument('shift')})"
    )


@words("channels-differ", Severity.WARNING)
def channels_differ(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: what (inputs or outputs), identified_with, channels (name, unit)."""
    mine, theirs = (
        ", ".join(in_unit(each["name"], each["unit"]) for each in f.data[side])
        for side in ("identified_with", "channels")
    )
    return f"the model was identified with the {f.data['what']} {mine}; {f.subject} has {theirs}"


sentences(
    __name__,
    """
sample-time-differs warning: the model was identified at a sample time of {identified_with:sample_time}; {subject} has
    {dt:sample_time} # Subject: the record. Data: identified_with, dt, in s.
output-clipped warning: {subject} is clipped to {lower:.4g} … {upper:.4g[unit]} in {share:.2g %} of the samples; leave
    them out with {argument[mask]}{mask:? {mask!r}}
    # Subject: the output. Data: lower, upper, unit, share, mask (a condition; absent or empty where none is known).
input-logged-slower warning: {subject} changes at every {factor:ordinal} row, and {output} does not follow the rows
    between; log both at one rate, or keep every {factor:ordinal} row with {argument[decimate]} {factor}
    # Subject: the input. Data: output, factor, dt (s).
few-output-levels warning: {subject} has {levels} values only, which show no dynamics; measure it with a finer sensor
output-is-input warning: {subject} is {factor:.4g} times {input} in every row: one signal twice; check the columns
""",
)
