"""Words for physical plants and their parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite

from emsid.errors import listed
from emsid.findings import Finding
from emsid.units import name_and_unit, with_unit
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.linear import SHOW_ZONE
from emsid.wording.lists import assigned, shortened

sentences(
    __name__,
    """
command-may-be-duty info: {channel} looks like a PWM duty, in whole numbers up to {full:g}; for volts give its unit pwm
    ({argument[units]}{full:255.0=>|255=>|, {argument[pwm_full_scale]}}, {argument[supply_voltage]})
codes-without-bridge info: {subject} has no bridge here, so the code {codes:list g} means zero {nothing}
input-taken-as-constant warning: {subject} is simulated as constant {other_hold}
    # Subject: the input. Data: between (the hold that fits better), ratio (of the errors).
input-taken-as-linear warning: {subject} is simulated as linear {other_hold}
    # Subject: the input. Data: between (the course that fits better), ratio (of the errors).
input-between-rows-unknown warning: means of {rows} rows of {inputs:list} fit {ratio:.2g} times better: values between
    rows are missing, so {parameters:list} {parameters:is/are} not determined; log every value
    # Subject: the plant. Data: parameters, inputs, rows (of the best mean), ratio (of the errors).
alternatives-fit-as-well info: {late:?these data show a short delay that the model does not have; the intervals cover
    {instead:or}|{instead:or}{of:? in place of {of}} explains these data equally well; the intervals cover both}
    # Data: instead (parameters), of (the one that they replace; None if there is none), late (a delay is missing).
error-above-rounding warning: the error is {ratio:.2g} times what rounding to {step:.3g[unit]} makes: an effect is
    missing; the intervals hold all parameters whose largest error is no larger
    # Subject: the plant. Data: ratio (of the error to that of rounding), step, unit.
within-rounding info: the intervals hold what keeps the model within half a step ({step:.3g[unit]}) of every reading;
    they are {narrower:.2g} times narrower than by least squares
    # Subject: the plant. Data: step, unit, narrower (the intervals than those of least squares).
outside-rounding info: no parameters keep the model within half a step ({step:.3g[unit]}) of each reading, at best
    {least:.3g}: an effect is missing or there is other noise
    # Subject: the plant. Data: step, unit, least (the largest error in steps of the values where it is smallest).
parameter-changes warning: {subject} changes during the record: {halves[0]:.4g[unit]} in its first half and
    {halves[1]:.4g[unit]} in its second would lower the squared error by {share:.0f %}
    # Subject: a parameter. Data: halves, unit, share (of the squared error), or (effects).
parameter-drifts info: {subject} is {halves[0]:.4g[unit]} in the first half of the record and {halves[1]:.4g[unit]} in
    the second, so it drifts slowly; the intervals include that
    # Subject: a parameter. Data: halves (its estimates in the first and the second half of the record), unit.
parameters-reestimated info: {subject}: with {parameters:list} from its first {samples:,} samples, the fit on the other
    {rest:,} goes from {before:None=>none|{before:.1f} %} to {after:None=>none|{after:.1f} %}
    # Subject: the record. Data: parameters, samples (they are estimated from), rest, before, after (fit in %).
single-record warning: {subject} is the only record, so {parameters:list} {parameters:has/have} one value
    ({argument[per_record]} is for several records)
    # Subject: the record. Data: parameters (those that were to differ by record).
nothing-identifiable problem: from {channels:list} alone, no parameter of {subject} is identifiable; check the columns,
    or fix what you know ({argument[fixed]})
kept-by-response warning: the response does not determine {parameters:list}; kept at {kept:commas {0} = {1:.4g[2]}}; fix
    what you know ({argument[fixed]}), or measure another output
    # Data: parameters, and the values that were kept with their units.
damping-open info: {subject} is not determined; the intervals of {parameters:list} include 0 to {most:.2g[unit]} of it;
    give it if you know it ({argument[fixed]} {subject}=…)
    # Subject: viscous friction. Data: parameters (whose intervals include it), most, unit.
free-run-drifts info: errors of the free run of {subject} add up: {error:.3g[unit]} RMS over {seconds:.3g} s,
    {whole:.3g[unit]} over the whole record; trust it for up to {seconds:.3g} s
    # Data: seconds, error, whole, unit (RMS errors of free runs of this length, and of that of the whole record).
probably-another-system info: the search of extra effects stopped after the first: its free run leaves {left:.2g %} of
    the variance, a {regression:None=>linear model {linear:.2g %}|polynomial regression {regression:.2g %}}
speed-is-a-mean info: the data show that {subject} is the mean over the sample before it, as an encoder counts, and it
    is simulated so ({argument[average]})
cogging-over-angle info: the cogging of {subject} is {size:.3g[unit]} peak to peak, {share:.2g %} of the largest torque
    in the records; its largest harmonic has {number} periods per turn
torque-ripple-over-angle info: the torque of {subject} by current changes over the angle by {size:.2g %} peak to peak;
    its largest harmonic has {number} periods per turn
friction-fades-as-gaussian info: the friction of {subject} near rest fades as exp(−(rate·speed)²), not as
    exp(−rate·speed)
residual-slow warning: the residual changes slowly (about {values:.0f} independent values in {samples:,}); the intervals
    may be too narrow: record longer
no-shaft-seen warning: the data show no shaft flexibility: one mass ({simpler}) describes them as well; use {simpler}
no-shaft-needed warning: one mass ({simpler}) with its refinements has {ratio:.2g} times the error of a motor with a
    shaft, so it is taken instead
choice-interrupted warning: the choice of refinements was stopped before its end; the best model so far is kept
""",
    other_hold="between samples; with a {between} input the error is {ratio:.3g} times smaller: give "
    "between={between!r} or {argument[hold]}",
)


@words("unit-assumed", Severity.WARNING)
def unit_assumed(f: Finding, argument: Spelling) -> str:
    d = f.data
    return f"{d['channel']} has no unit and is read as a {d['signal']} in {d['unit']}{_give_unit(f, argument)}"


def _give_unit(f: Finding, argument: Spelling) -> str:
    """What to do about a channel without a unit; its name may have one."""
    channel = f.data["channel"]
    named = name_and_unit(channel)[1]
    if not named:
        return f"; if this is wrong, give its unit ({argument('units')})"
    return f", not {named} as in its name; if this is wrong, give {argument('units')} {assigned(channel, named)}"


@words("command-unit-assumed", Severity.WARNING)
def command_unit_assumed(f: Finding, argument: Spelling) -> str:
    d = f.data
    given = {"": "has no unit", "1": "is a share"}.get(d.get("given", ""), f"is in {d.get('given')}")
    return f"{d['channel']} {given} and is read as {d['unit']}{_give_unit(f, argument)} or drive.gain"


@words("input-between-samples")
def input_between_samples(f: Finding, argument: Spelling) -> str:
    """Subject: the input. Data: straight, held (the numbers of segments with this hold)."""
    straight, held = f.data["straight"], f.data["held"]
    some = f" in {straight} of {straight + held} segments"
    return (
        f"the data show that {f.subject} changes linearly between samples{some if held else ''}, and it is simulated "
        f"so ({argument('hold')})"
    )


EFFECTS = {
    "coulomb": "a Coulomb level",
    "viscous": "viscous friction",
    "dead-zone": "a dead zone",
    "quadratic": "friction with the square of the speed",
    "stribeck": "a Stribeck level",
    "delay": "a delay of the command",
    "lag": "a lag of the sensor",
    "average": "a speed averaged over the sample",
    "inductance": "an inductance",
    "load": "a constant load",
    "gain-by-direction": "another gain backward",
    "cogging": "a force that repeats every turn",
    "backlash": "backlash before the sensor",
    "sensor-offset": "an offset of the sensor",
    "coulomb-by-direction": "a Coulomb level for each direction",
    "viscous-by-direction": "viscous friction for each direction",
    "stribeck-by-direction": "a Stribeck level for each direction",
    "dead-zone-by-direction": "a dead zone that is not symmetric",
    "voltage-drop": "a voltage drop against the current",
    "heating": "a winding that becomes warm by its copper loss",
    "resistance-drift": "a resistance that drifts",
    "coasting": "a bridge that coasts in its off-time",
    "supply": "a voltage that ends at the supply",
    "knee": "another gain above some voltage",
    "switching-loss": "a loss of the bridge where it switches",
    "current-rise": "a current that rises in every pulse",
    "load-friction": "friction that grows with the load of the gear",
}
"""What may be added to a plant, by the names that searches give it."""


def effect_words(name: str) -> str:
    """What may be added to a plant, in words; an effect of somebody else's is called by its name."""
    return EFFECTS.get(name, name.replace("-", " "))


@words("effect-missing", Severity.WARNING)
def effect_missing(f: Finding, argument: Spelling) -> str:
    """Subject: the plant. Data: effect, or (others that promise as much), parameters, share (of the squared error)."""
    effects = " or ".join(map(effect_words, (f.data["effect"], *f.data["or"])))
    return f"{effects} would lower the squared error by {100 * f.data['share']:.0f} %"


@words("effects-alike")
def effects_alike(f: Finding, argument: Spelling) -> str:
    """Subject: a parameter. Data: effects, combinations (formula, value, half width, unit)."""
    effects = " or ".join(map(effect_words, f.data["effects"]))
    known = [f"{what} = {with_unit(f'{v:.4g} ± {half:.2g}', unit)}" for what, v, half, unit in f.data["combinations"]]
    sure = f"; together they determine {listed(known)}" if known else ""
    return f"these data do not tell {f.subject} from {effects}{sure}"


@words("value-contradicted", Severity.WARNING)
def value_contradicted(f: Finding, argument: Spelling) -> str:
    """Subject: a parameter. Data: value (kept), better, unit, share (of the squared error), or (effects)."""
    value, better = (with_unit(f"{each:.4g}", f.data["unit"]) for each in (f.data["value"], f.data["better"]))
    others = "".join(f", or {effect_words(name)}" for name in f.data["or"])
    return (
        f"these data contradict {f.subject} = {value}: {better}{others} would lower the squared error by "
        f"{100 * f.data['share']:.0f} %"
    )


@words("parameters-by-record")
def parameters_by_record(f: Finding, argument: Spelling) -> str:
    """Data: parameters, records, typical (value of every parameter in another record), units."""
    d = f.data
    typical = [
        f"{name} = {with_unit(f'{value:.4g}', unit)}"
        for name, value, unit in zip(d["parameters"], d["typical"], d["units"], strict=True)
    ]
    return (
        f"{len(d['records'])} records have their own {listed(d['parameters'])}; in any other record the model uses the "
        f"median{'s' * (len(typical) > 1)}, {listed(typical)}"
    )


@words("not-identifiable", Severity.WARNING)
def not_identifiable(f: Finding, argument: Spelling) -> str:
    names, kept = f.data["parameters"], f.data["kept"]
    if len(names) == 1:
        at = ", ".join(f"{name} = {with_unit(f'{value:.4g}', unit)}" for name, value, unit in kept)
        alone = f"from {listed(f.data['channels'])} alone"
        return f"{names[0]} is not identifiable {alone}; kept at {at}; {_advice(f, argument)}"
    only = shortened(f.data["combinations"]) if f.data["combinations"] else "combinations"
    return f"only {only} of {shortened(names)} can be identified; {_advice(f, argument)}"


@words("intervals-include-zero", Severity.WARNING)
def intervals_include_zero(f: Finding, argument: Spelling) -> str:
    """Data: parameters, without (those of them without which a refit is as good), tests (which of them each shows)."""
    names, without = f.data["parameters"], f.data["without"]
    said = f"the 95 % interval{'s' * (len(names) > 1)} of {listed(names)} include{'s' * (len(names) == 1)} zero"
    without_them = f"; without {' or '.join(without)} the model fits as well" if without else ""
    tests = f.data.get("tests")
    return f"{said}{without_them}; {tests_in_words(tests, every=False) if tests else _give(argument)}"


def _give(argument: Spelling) -> str:
    return f"give what you know ({argument('fixed')})"


@words("weakly-identified", Severity.WARNING)
def weakly_identified(f: Finding, argument: Spelling) -> str:
    names = f.data["parameters"]
    if len(names) == 1:
        return f"{names[0]} is not known to better than 100 % from these data; {_advice(f, argument)}"
    better = f"; {shortened(f.data['combinations'])} known better" if f.data["combinations"] else ""
    return f"{shortened(names)} are hardly identifiable separately{better}; {_advice(f, argument)}"


LIFT = 30.0
"""Degrees of a lift that changes the torque of gravity by a tenth or more wherever it begins: 1 − cos 30° = 0.13."""


@words("gravity-not-seen", Severity.WARNING)
def gravity_not_seen(f: Finding, argument: Spelling) -> str:
    """Subject: the torque. Data: moved (by the angle, in degrees), most (the end of its interval, if any), unit."""
    moved, most = f.data["moved"], f.data["most"]
    below = "" if most is None else f" ({f.subject} is below {with_unit(f'{most:.2g}', f.data['unit'])})"
    if moved >= LIFT:
        return f"the angle moves by {moved:.0f}°, and no gravity shows{below}; fit rigid-motor, which has none"
    return (
        f"the angle moves by {moved:.2g}°, too little to show gravity{below}; record a lift of {LIFT:.0f}° or more, or "
        "fit rigid-motor"
    )


@words("resistance-changes")
def resistance_changes(f: Finding, argument: Spelling) -> str:
    """Subject: the plant. Data: rise (a part), half (of its interval), seconds, heats, time_constant, final."""
    d = f.data
    more, sure = ("rose" if d["rise"] >= 0 else "fell"), "" if d["half"] is None else f" ± {100 * d['half']:.2g}"
    said = f"the resistance {more} by {100 * abs(d['rise']):.3g}{sure} % in {d['seconds']:.3g} s"
    if not d["heats"]:
        why = "evenly with time and not by copper loss"
    elif d["final"] is None:
        why = "by copper loss, without cooling that shows"
    else:
        why = f"by copper loss (time constant {d['time_constant']:.3g} s, final rise {100 * d['final']:.3g} %)"
    return f"{said}, {why}; the recommended model begins so"


@words("load-drifts")
def load_drifts(f: Finding, argument: Spelling) -> str:
    names, mean, unit = f.data["parameters"], f.data["mean"], f.data["unit"]
    deviation = with_unit(f"{f.data['deviation']:.3g}", unit)
    drifts = f"the load of the {f.subject} drifts (standard deviation {deviation})"
    if mean is None:
        part = "the load at its start" if f.data["walks"] else "the load without drift"
        contained = f"; {listed(names)} include{'s' * (len(names) == 1)} {part}" if names else ""
        return f"{drifts} and moves the free run after {with_unit(format(f.data['trusted'], '.3g'), 's')}{contained}"
    return f"{drifts}; the intervals of {listed(names)} include the {with_unit(f'{mean:.3g}', unit)} of its mean"


def interval(ends: tuple[float, float], unit: str) -> str:
    """An interval with its unit; an end that is infinite was not found."""
    low, high = ends
    if isfinite(low) and isfinite(high):
        return f"{low:.6g} to {with_unit(f'{high:.6g}', unit)}"
    if isfinite(low):
        return f"{with_unit(f'{low:.6g}', unit)} or more, without an upper limit"
    return "unbounded" if not isfinite(high) else f"{with_unit(f'{high:.6g}', unit)} or less, without a lower limit"


TESTS = {
    "d-axis": "steps on the d-axis",
    "q-axis": "steps on the q-axis that turn the rotor",
    "both-axes": "steps on both axes that turn the rotor",
}
"""Tests by the codes of `Plant.tests`."""


def tests_in_words(tests: Mapping[str, Sequence[str]], every: bool) -> str:
    """Which test shows which parameters: *x: y*; the parameters are not named where one test shows all.

    Args:
        tests: parameters by the code of a test.
        every: whether the tests show all parameters that the sentence is about.
    """
    if every and len(tests) == 1:
        return f"{TESTS[next(iter(tests))]} show {'them' if len(next(iter(tests.values()))) > 1 else 'it'}"
    return ", ".join(f"{TESTS[code]} show {listed(list(names))}" for code, names in tests.items())


def _advice(f: Finding, argument: Spelling) -> str:
    tests = f.data.get("tests", {})
    if tests:
        every = set(f.data["parameters"]) == {name for names in tests.values() for name in names}
        return f"{tests_in_words(tests, every)}; or {_give(argument)}"
    measured = ", or measure the current" if f.data["current_missing"] else ""
    both_ways = "drive it in both directions, " if f.data.get("one_way") else ""
    zone = f"{SHOW_ZONE}, " if f.data.get("zone_unseen") else ""
    load = (
        f"record a second load of known weight ({argument('fixed')} gravity.mass[…]), or "
        if f.data.get("one_load")
        else ""
    )
    return f"{load}{zone}{both_ways}fix what you know ({argument('fixed')}){measured}"
