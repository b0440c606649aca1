"""Words for records that differ from each other."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.units import with_unit
from emsid.wording.catalogue import Severity, Spelling, words

CAUSES = {
    "delay": "log input and output with one clock, or identify the records one by one",
    "gain": "load or supply may have changed, or the model lacks a nonlinearity",
    "level": "the offset of a sensor or a constant load may have changed, or the model lacks a nonlinearity",
}


def _differs(kind: str, value: float, unit: str) -> str:
    """Words for the difference between one record and the model."""
    if kind == "delay":
        return f"is {1e3 * abs(value):.3g} ms {'later' if value > 0 else 'earlier'}"
    if kind == "gain":
        return f"has {100 * abs(value):.3g} % {'more' if value > 0 else 'less'}"
    return f"is {with_unit(f'{abs(value):.3g}', unit)} {'above' if value > 0 else 'below'}"


@words("records-differ", Severity.WARNING)
def records_differ(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: kind, unit, share, records (name, value)."""
    kind, records = f.data["kind"], f.data["records"]
    values = [each["value"] for each in records]
    extremes = sorted((values.index(min(values)), values.index(max(values))))  # the two records furthest apart
    first, second = (f"{records[k]['name']} {_differs(kind, values[k], f.data['unit'])}" for k in extremes)
    return (
        f"the records differ in the {kind} of {f.subject}: compared with the model, {first} and {second}. This makes "
        f"{100 * f.data['share']:.0f} % of the squared error; {CAUSES[kind]}"
    )
