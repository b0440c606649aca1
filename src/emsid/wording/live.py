"""Words for live tracking, fleets of motors and designed experiments."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.units import with_unit
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import listed

sentences(
    __name__,
    """
change-detected warning: at {time:.6g} s the {what:level=>level|size} of the prediction error of {subject} has changed,
    since about {since:.6g} s: load or motor is different now
    # Subject: the output. Data: time, since, delay, what (level or spread), false_alarm (mean time between them).
source-gap warning: {samples:None=>samples are|{samples} {samples:sample is/samples are}} missing before {time:.6g} s:
    {cause:lost=>the source has left them out|unusable=>the lines between cannot be read|backwards=>the time of the
    source has stepped back, as after a reset|disconnected=>the source was disconnected|skipped=>the tracker was too
    slow for them}; the estimate continues after the gap
    # Subject: the source. Data: time, samples (None where not known), cause.
source-awaited info: waiting for {subject}: {lines:?{lines} lines have come and none is a sample, such as {example!r};
    check the baud rate and the header|it has sent nothing yet; check that the board runs, that its lines end with a
    line break, and the baud rate}
    # Subject: the source. Data: lines (that have come and are no samples), example (one of them).
nothing-excites warning: {inputs:list {name} stays at {level:.4g[unit]}}, which excites nothing: the gain is not
    determined; change the input while tracking # Subject: the source. Data: inputs (name, level, unit), samples.
lines-not-used warning: {subject}: {lines:?{lines} lines are no samples, such as {example!r}{not_finite:? and
    }}{not_finite:?{not_finite} samples are not finite}; they are in the log only
    # Subject: the source. Data: lines (malformed), not_finite, example (a malformed line).
samples-not-tracked warning: {samples:,} samples of {subject} came faster than they were tracked; they are in the log
    only
source-silent warning: {subject} has sent nothing for {seconds:.3g} s
log-not-written problem: {subject} cannot be written ({reason}); {bytes:,} bytes wait in memory; free space on the disk
tracking-errors-coloured warning: neighbouring prediction errors correlate by {correlation:.2f}: intervals are too
    narrow; choose a larger structure
motor-not-at-zero problem: {subject} has not confirmed zero volts; switch the motor off by hand

fleet-assumes warning: {parameters:list} {parameters:depends/depend} on {assumed:list}, assumed and not measured: they
    compare motors only if it is the same in all of them; measure it: {assumed:spaced {argument[fixed]} {0}=…}
    # Data: parameters (that depend on assumed values), assumed (the names of these).
motors-failed warning: {failed:,} of {rows:,} rows {failed:has/have} no model; their reasons are listed
    # Data: failed, rows.
fleet-unfinished warning: {rows:,} of {asked:,} rows are finished and kept; the same command again goes on from there
    # Data: rows, asked.
rows-dropped info: {dropped:1=>1 row of an earlier run was|{dropped:,} rows of an earlier run were} dropped, as the
    files have changed or are gone # Data: dropped.
fleet-too-small info: {motors} motors are too few to say which of them differ; {least} are needed to know their ordinary
    spread
fleet-too-short info: {periods} periods are too few to say which motor has changed; {least} are needed
not-separable warning: {names:list} cannot be separated by any input at one load; {remedies:?record {remedies:or
    {0:current=>the current|inertia=>a second inertia that is known}}|fix {directions} of them ({argument[fixed]})}
    # Subject: the model. Data: names, directions, remedies (of ``current`` and ``inertia``).
design-assumes warning: nothing has determined {ranges:list {0}}: the limits hold for {ranges:list {1:.3g} to
    {2:.3g[3]}}
    # Subject: the model. Data: ranges (name, ends and unit).
design-gains-nothing info: nothing is gained by a design of its own: {signal} is as good within these limits
""",
)


@words("design-determines")
def design_determines(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: names (of parameters that were not known), shares (half widths of their intervals over
    their values), left (those that the signal does not determine)."""
    pairs = zip(f.data["names"], f.data["shares"], strict=True)
    known = [f"{name} ± {100 * share:.2g} %" for name, share in pairs]
    said = [f"{listed(known)} become known, in 95 % intervals that hold if the model is exact"] if known else []
    left = [f"the signal does not determine {listed(f.data['left'])}"] if f.data["left"] else []
    return "; ".join([*said, *left])


def _duration(seconds: float) -> str:
    """A time in the unit that suits its size."""
    for size, unit in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


@words("source-disconnected", Severity.WARNING)
def source_disconnected(f: Finding, argument: Spelling) -> str:
    """Subject: the source. Data: wait (seconds in which it may come back)."""
    return f"{f.subject} was disconnected; the tracking ends if it is not back within {_duration(f.data['wait'])}"


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


EFFECTS = {
    "different": ("differs from the others", "differ from the others"),
    "changed": ("has changed", "have changed"),
}
"""What a fleet is tested for (`emsid.fleets.Fleet.tested`), of one motor and of several."""
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
