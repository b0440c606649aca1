"""What is said of physical plants and their parameters."""

from __future__ import annotations

from emsid.errors import listed
from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, words


@words("unit-assumed", Severity.WARNING)
def unit_assumed(f: Finding, argument: Spelling) -> str:
    d = f.data
    return (
        f"{f.subject}: {d['channel']} has no unit and is taken for a {d['signal']} in {d['unit']}; if it is something "
        f"else, give its unit ({argument('unit')})"
    )


@words("command-unit-assumed", Severity.WARNING)
def command_unit_assumed(f: Finding, argument: Spelling) -> str:
    d = f.data
    return (
        f"{f.subject}: {d['channel']} has no unit and is taken for {d['unit']}; if it is something else, give its unit "
        f"({argument('unit')}), or how many {d['unit']} one of it is (drive.gain)"
    )


@words("codes-without-bridge", Severity.INFO)
def codes_without_bridge(f: Finding, argument: Spelling) -> str:
    codes = listed([f"{code:g}" for code in f.data["codes"]])
    return f"{f.subject}: no bridge drives it here, so {codes} is taken to mean no {f.data['nothing']}"
