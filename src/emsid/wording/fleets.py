"""Words for fleets of motors."""

from __future__ import annotations

from emsid.errors import listed
from emsid.findings import Finding
from emsid.units import with_unit
from emsid.wording.catalogue import Severity, Spelling, sentences, words


@words("differs-from-fleet", Severity.WARNING)
def differs_from_fleet(f: Finding, argument: Spelling) -> str:
    """Subject: the motor. Data: parameter, unit, value, half_width, centre, deviation (of the fleet), score."""
    half = f.data["half_width"]
    own = f"{f.data['value']:.4g}" + (f" ± {half:.2g}" if half else "")
    return (
        f"motor {f.subject} differs from its fleet: {f.data['parameter']} is {with_unit(own, f.data['unit'])}, "
        f"that of the others {with_unit(format(f.data['centre'], '.4g'), f.data['unit'])} with a deviation of "
        f"{f.data['deviation']:.2g}"
    )


@words("changed-over-periods", Severity.WARNING)
def changed_over_periods(f: Finding, argument: Spelling) -> str:
    """Subject: the motor. Data: parameter, unit, since, before, after, half_width (of the difference), score."""
    change = f"{f.data['before']:.4g} to {f.data['after']:.4g}"
    return (
        f"motor {f.subject} has changed since {f.data['since']}: {f.data['parameter']} from "
        f"{with_unit(change, f.data['unit'])}, a change of {f.data['after'] - f.data['before']:+.2g} ± "
        f"{f.data['half_width']:.2g}"
    )


@words("fleet-assumes", Severity.WARNING)
def fleet_assumes(f: Finding, argument: Spelling) -> str:
    """Data: parameters (that depend on assumed values), assumed (the names of these)."""
    names, assumed = f.data["parameters"], f.data["assumed"]
    given = " ".join(f"{argument('fixed')} {name}=…" for name in assumed)
    return (
        f"{listed(names)} depend{'s' * (len(names) == 1)} on {listed(assumed)}, assumed and not measured: they compare "
        f"motors only if it is the same in all of them; measure it: {given}"
    )


@words("motors-failed", Severity.WARNING)
def motors_failed(f: Finding, argument: Spelling) -> str:
    """Data: failed, rows."""
    failed = f.data["failed"]
    return (
        f"{failed:,} of {f.data['rows']:,} rows {'has' if failed == 1 else 'have'} no model; their reasons are listed"
    )


@words("fleet-unfinished", Severity.WARNING)
def fleet_unfinished(f: Finding, argument: Spelling) -> str:
    """Data: rows, asked."""
    done = f"{f.data['rows']:,} of {f.data['asked']:,}"
    return f"{done} rows are finished and kept; the same command again goes on from there"


@words("rows-dropped")
def rows_dropped(f: Finding, argument: Spelling) -> str:
    """Data: dropped."""
    count = f.data["dropped"]
    rows = "1 row of an earlier run was" if count == 1 else f"{count:,} rows of an earlier run were"
    return f"{rows} dropped, as the files have changed or are gone"


sentences("""
fleet-too-small info: {motors} motors are too few to say which of them differ; {least} are needed to know their
    ordinary spread
""")
