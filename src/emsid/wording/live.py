"""Words for live tracking, fleets of motors and designed experiments."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.units import with_unit
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import listed

CAUSES = {
    "lost": "the source has left them out",
    "unusable": "the lines between cannot be read",
    "backwards": "the time of the source has stepped back, as after a reset",
    "disconnected": "the source was disconnected",
    "skipped": "the tracker was too slow for them",
}


def _duration(seconds: float) -> str:
    """A time in the unit that suits its size."""
    for size, unit in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


@words("change-detected", Severity.WARNING)
def change_detected(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: time, since, delay, what (level or spread), false_alarm (mean time between them)."""
    what = "level" if f.data["what"] == "level" else "size"
    return (
        f"at {f.data['time']:.6g} s the {what} of the prediction error of {f.subject} has changed, since about "
        f"{f.data['since']:.6g} s: load or motor is different now"
    )


@words("source-gap", Severity.WARNING)
def source_gap(f: Finding, argument: Spelling) -> str:
    """Subject: the source. Data: time, samples (None where not known), cause."""
    count = f.data["samples"]
    missing = (
        "samples are missing" if count is None else f"{count} {'samples are' if count != 1 else 'sample is'} missing"
    )
    return f"{missing} before {f.data['time']:.6g} s: {CAUSES[f.data['cause']]}; the estimate continues after the gap"


@words("source-disconnected", Severity.WARNING)
def source_disconnected(f: Finding, argument: Spelling) -> str:
    """Subject: the source. Data: wait (seconds in which it may come back)."""
    return f"{f.subject} was disconnected; the tracking ends if it is not back within {_duration(f.data['wait'])}"


@words("source-awaited")
def source_awaited(f: Finding, argument: Spelling) -> str:
    """Subject: the source. Data: lines (that have come and are no samples), example (one of them)."""
    if f.data["lines"]:
        came = f"{f.data['lines']} lines have come and none is a sample, such as {f.data['example']!r}"
        return f"waiting for {f.subject}: {came}; check the baud rate and the header"
    return (
        f"waiting for {f.subject}: it has sent nothing yet; check that the board runs, that its lines end with a line "
        "break, and the baud rate"
    )


@words("nothing-excites", Severity.WARNING)
def nothing_excites(f: Finding, argument: Spelling) -> str:
    """Subject: the source. Data: inputs (name, level, unit), samples."""
    stays = listed(
        [f"{x['name']} stays at {with_unit(format(x['level'], '.4g'), x['unit'])}" for x in f.data["inputs"]]
    )
    return f"{stays}, which excites nothing: the gain is not determined; change the input while tracking"


@words("lines-not-used", Severity.WARNING)
def lines_not_used(f: Finding, argument: Spelling) -> str:
    """Subject: the source. Data: lines (malformed), not_finite, example (a malformed line)."""
    parts = []
    if f.data["lines"]:
        parts.append(f"{f.data['lines']} lines are no samples, such as {f.data['example']!r}")
    if f.data["not_finite"]:
        parts.append(f"{f.data['not_finite']} samples are not finite")
    return f"{f.subject}: {' and '.join(parts)}; they are in the log only"


sentences("""
samples-not-tracked warning: {samples:,} samples of {subject} came faster than they were tracked; they are in the log
    only
source-silent warning: {subject} has sent nothing for {seconds:.3g} s
log-not-written problem: {subject} cannot be written ({reason}); {bytes:,} bytes wait in memory; free space on the
    disk
tracking-errors-coloured warning: neighbouring prediction errors correlate by {correlation:.2f}: intervals are too
    narrow; choose a larger structure
motor-not-at-zero problem: {subject} has not confirmed zero volts; switch the motor off by hand
""")


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


FACTORS = {
    "torque": "ratio of resistance to torque constant",
    "angle": "gear or encoder count",
    "voltage": "drive gain or supply",
}
"""What a factor of all torques, angles or voltages may be."""


@words("differs-by-one-cause", Severity.WARNING)
def differs_by_one_cause(f: Finding, argument: Spelling) -> str:
    """Subject: the motor. Data: causes (the likeliest first), factor, ratios (to the fleet), parameters."""
    ratios = listed([f"{name} × {ratio:.3g}" for name, ratio in f.data["ratios"].items()])
    other = ", or ".join(FACTORS[each] for each in f.data["causes"])
    return f"motor {f.subject} has another {other} than its fleet, by a factor of {f.data['factor']:.3g}: {ratios}"


@words("noisier-than-fleet", Severity.WARNING)
def noisier_than_fleet(f: Finding, argument: Spelling) -> str:
    """Subject: the motor. Data: value, half_width, centre, deviation (of the fleet), unit, score, parameter."""
    return (
        f"motor {f.subject} has {f.data['value'] / f.data['centre']:.2g} times the noise of its fleet: "
        f"{with_unit(format(f.data['value'], '.3g'), f.data['unit'])} in place of {f.data['centre']:.3g}; look at its "
        "encoder"
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
fleet-too-short info: {periods} periods are too few to say which motor has changed; {least} are needed
""")


REMEDIES = {"current": "the current", "inertia": "a second inertia that is known"}


@words("not-separable", Severity.WARNING)
def not_separable(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: names, directions, remedies (of ``current`` and ``inertia``)."""
    count = f.data["directions"]
    remedies = " or ".join(REMEDIES[each] for each in f.data["remedies"])
    advice = f"record {remedies}" if remedies else f"fix {count} of them ({argument('fixed')})"
    return f"{listed(f.data['names'])} cannot be separated by any input at one load; {advice}"


sentences("""
design-gains-nothing info: nothing is gained by a design of its own: {signal} is as good within these limits
""")
