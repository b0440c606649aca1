"""Words for records that differ from each other, and for channels that do not measure what they seem to."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.units import in_unit, with_unit
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import duration, ordinal, sample_time

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


@words("sample-time-differs", Severity.WARNING)
def sample_time_differs(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: identified_with, dt, in s."""
    return (
        f"the model was identified at a sample time of {sample_time(f.data['identified_with'])}; {f.subject} has "
        f"{sample_time(f.data['dt'])}"
    )


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
