"""Words for physical plants and their parameters."""

from __future__ import annotations

from math import isfinite

from emsid.errors import listed
from emsid.findings import Finding
from emsid.units import name_and_unit, with_unit
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.linear import SHOW_ZONE
from emsid.wording.lists import assigned, shortened


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


@words("command-may-be-duty", Severity.INFO)
def command_may_be_duty(f: Finding, argument: Spelling) -> str:
    d = f.data
    scale = "" if d["full"] == 255 else f", {argument('pwm_full_scale')}"
    return (
        f"{d['channel']} looks like a PWM duty, in whole numbers up to {d['full']:g}; for volts give its unit pwm "
        f"({argument('units')}{scale}, {argument('supply_voltage')})"
    )


@words("codes-without-bridge", Severity.INFO)
def codes_without_bridge(f: Finding, argument: Spelling) -> str:
    codes = listed([f"{code:g}" for code in f.data["codes"]])
    return f"{f.subject} has no bridge here, so the code {codes} means zero {f.data['nothing']}"


@words("input-between-samples")
def input_between_samples(f: Finding, argument: Spelling) -> str:
    """Subject: the input. Data: straight, held (the numbers of segments with this hold)."""
    straight, held = f.data["straight"], f.data["held"]
    some = f" in {straight} of {straight + held} segments"
    return (
        f"the data show that {f.subject} changes linearly between samples{some if held else ''}, and it is simulated "
        f"so ({argument('hold')})"
    )


@words("input-taken-as-constant", Severity.WARNING)
def input_taken_as_constant(f: Finding, argument: Spelling) -> str:
    """Subject: the input. Data: between (the hold that fits better), ratio (of the errors)."""
    return _taken_as(f, argument, "constant")


@words("input-taken-as-linear", Severity.WARNING)
def input_taken_as_linear(f: Finding, argument: Spelling) -> str:
    """Subject: the input. Data: between (the course that fits better), ratio (of the errors)."""
    return _taken_as(f, argument, "linear")


def _taken_as(f: Finding, argument: Spelling, course: str) -> str:
    between, ratio = f.data["between"], f.data["ratio"]
    return (
        f"{f.subject} is simulated as {course} between samples; with a {between} input the error is {ratio:.3g} times "
        f"smaller: give between={between!r} or {argument('hold')}"
    )


@words("alternatives-fit-as-well")
def alternatives_fit_as_well(f: Finding, argument: Spelling) -> str:
    """Data: instead (parameters), of (the one that they replace; None if there is none), late (a delay is missing)."""
    others, of = " or ".join(f.data["instead"]), f.data["of"]
    if f.data["late"]:
        return f"these data show a short delay that the model does not have; the intervals cover {others}"
    replaced = f" in place of {of}" if of else ""
    return f"{others}{replaced} explains these data equally well; the intervals cover both"


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
    "coasting": "a bridge that coasts in its off-time",
    "supply": "a voltage that ends at the supply",
    "knee": "another gain above some voltage",
    "switching-loss": "a loss of the bridge where it switches",
    "current-rise": "a current that rises in every pulse",
    "load-friction": "friction that grows with the load of the gear",
}
"""What may be added to a plant, by the names that searches give it."""


@words("effect-missing", Severity.WARNING)
def effect_missing(f: Finding, argument: Spelling) -> str:
    """Subject: the plant. Data: effect, or (others that promise as much), parameters, share (of the squared error)."""
    effects = " or ".join(EFFECTS[name] for name in (f.data["effect"], *f.data["or"]))
    return f"{effects} would lower the squared error by {100 * f.data['share']:.0f} %"


@words("effects-alike")
def effects_alike(f: Finding, argument: Spelling) -> str:
    """Subject: a parameter. Data: effects, combinations (formula, value, half width, unit)."""
    effects = " or ".join(EFFECTS[name] for name in f.data["effects"])
    known = [f"{what} = {with_unit(f'{v:.4g} ± {half:.2g}', unit)}" for what, v, half, unit in f.data["combinations"]]
    sure = f"; together they determine {listed(known)}" if known else ""
    return f"these data do not tell {f.subject} from {effects}{sure}"


def _step(f: Finding) -> str:
    """The step of a reading with its unit."""
    return with_unit(f"{f.data['step']:.3g}", f.data["unit"])


@words("error-above-rounding", Severity.WARNING)
def error_above_rounding(f: Finding, argument: Spelling) -> str:
    """Subject: the plant. Data: ratio (of the error to that of rounding), step, unit."""
    return (
        f"the error is {f.data['ratio']:.2g} times what rounding to {_step(f)} makes: an effect is missing; the "
        "intervals hold all parameters whose largest error is no larger"
    )


@words("within-rounding", Severity.INFO)
def within_rounding(f: Finding, argument: Spelling) -> str:
    """Subject: the plant. Data: step, unit, narrower (the intervals than those of least squares)."""
    return (
        f"the intervals hold what keeps the model within half a step ({_step(f)}) of every reading; "
        f"they are {f.data['narrower']:.2g} times narrower than by least squares"
    )


@words("outside-rounding", Severity.INFO)
def outside_rounding(f: Finding, argument: Spelling) -> str:
    """Subject: the plant. Data: step, unit, least (the largest error in steps of the values where it is smallest)."""
    return (
        f"no parameters keep the model within half a step ({_step(f)}) of each reading, at best {f.data['least']:.3g}: "
        "an effect is missing or there is other noise"
    )


@words("value-contradicted", Severity.WARNING)
def value_contradicted(f: Finding, argument: Spelling) -> str:
    """Subject: a parameter. Data: value (kept), better, unit, share (of the squared error), or (effects)."""
    value, better = (with_unit(f"{each:.4g}", f.data["unit"]) for each in (f.data["value"], f.data["better"]))
    others = "".join(f", or {EFFECTS[name]}" for name in f.data["or"])
    return (
        f"these data contradict {f.subject} = {value}: {better}{others} would lower the squared error by "
        f"{100 * f.data['share']:.0f} %"
    )


@words("parameter-changes", Severity.WARNING)
def parameter_changes(f: Finding, argument: Spelling) -> str:
    """Subject: a parameter. Data: halves, unit, share (of the squared error), or (effects)."""
    first, second = (with_unit(f"{value:.4g}", f.data["unit"]) for value in f.data["halves"])
    return (
        f"{f.subject} changes during the record: {first} in its first half and {second} in its second would lower the "
        f"squared error by {100 * f.data['share']:.0f} %"
    )


@words("parameter-drifts")
def parameter_drifts(f: Finding, argument: Spelling) -> str:
    """Subject: a parameter. Data: halves (its estimates in the first and the second half of the record), unit."""
    first, second = (with_unit(f"{value:.4g}", f.data["unit"]) for value in f.data["halves"])
    return (
        f"{f.subject} is {first} in the first half of the record and {second} in the second, so it drifts slowly; the "
        "intervals include that"
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


@words("parameters-reestimated")
def parameters_reestimated(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: parameters, samples (they are estimated from), rest, before, after (fit in %)."""
    d = f.data
    before, after = ("none" if each is None else f"{each:.1f} %" for each in (d["before"], d["after"]))
    return (
        f"{f.subject}: with {listed(d['parameters'])} from its first {d['samples']:,} samples, the fit on the other "
        f"{d['rest']:,} goes from {before} to {after}"
    )


@words("single-record", Severity.WARNING)
def single_record(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: parameters (those that were to differ by record)."""
    have = "have" if len(f.data["parameters"]) > 1 else "has"
    return (
        f"{f.subject} is the only record, so {listed(f.data['parameters'])} {have} "
        f"one value ({argument('per_record')} is for several records)"
    )


@words("nothing-identifiable", Severity.PROBLEM)
def nothing_identifiable(f: Finding, argument: Spelling) -> str:
    return (
        f"from {listed(f.data['channels'])} alone, no parameter of {f.subject} is identifiable; check the columns, or "
        f"fix what you know ({argument('fixed')})"
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


@words("kept-by-response", Severity.WARNING)
def kept_by_response(f: Finding, argument: Spelling) -> str:
    """Data: parameters, and the values that were kept with their units."""
    at = ", ".join(f"{name} = {with_unit(f'{value:.4g}', unit)}" for name, value, unit in f.data["kept"])
    return (
        f"the response does not determine {listed(f.data['parameters'])}; kept at {at}; fix what you know "
        f"({argument('fixed')}), or measure another output"
    )


@words("weakly-identified", Severity.WARNING)
def weakly_identified(f: Finding, argument: Spelling) -> str:
    names = f.data["parameters"]
    if len(names) == 1:
        return f"{names[0]} is not known to better than 100 % from these data; {_advice(f, argument)}"
    better = f"; {shortened(f.data['combinations'])} known better" if f.data["combinations"] else ""
    return f"{shortened(names)} are hardly identifiable separately{better}; {_advice(f, argument)}"


@words("intervals-include-zero", Severity.WARNING)
def intervals_include_zero(f: Finding, argument: Spelling) -> str:
    """Data: parameters, without (those of them without which a refit is as good)."""
    names, without = f.data["parameters"], f.data["without"]
    several = len(names) > 1
    said = f"the 95 % interval{'s' * several} of {listed(names)} include{'s' * (not several)} zero"
    tried = f"; without {' or '.join(without)} the model fits as well" if without else ""
    return f"{said}{tried}; give what you know ({argument('fixed')})"


@words("damping-open")
def damping_open(f: Finding, argument: Spelling) -> str:
    """Subject: viscous friction. Data: parameters (whose intervals include it), most, unit."""
    names, most = f.data["parameters"], with_unit(f"{f.data['most']:.2g}", f.data["unit"])
    return (
        f"{f.subject} is not determined; the intervals of {listed(names)} include 0 to {most} of it; give it if you "
        f"know it ({argument('fixed')} {f.subject}=…)"
    )


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


@words("free-run-drifts")
def free_run_drifts(f: Finding, argument: Spelling) -> str:
    """Data: seconds, error, whole, unit (RMS errors of free runs of this length, and of that of the whole record)."""
    error, whole = (with_unit(f"{f.data[name]:.3g}", f.data["unit"]) for name in ("error", "whole"))
    seconds = with_unit(f"{f.data['seconds']:.3g}", "s")
    return (
        f"errors of the free run of {f.subject} add up: {error} RMS over {seconds}, {whole} over the whole record; "
        f"trust it for up to {seconds}"
    )


@words("probably-another-system")
def probably_another_system(f: Finding, argument: Spelling) -> str:
    regression = f.data.get("regression")
    other, share = ("linear model", f.data["linear"]) if regression is None else ("polynomial regression", regression)
    left, less = (f"{100 * each:.2g} %" for each in (f.data["left"], share))
    return (
        f"the search of extra effects stopped after the first: its free run leaves {left} of the variance, a {other} "
        f"{less}"
    )


def interval(ends: tuple[float, float], unit: str) -> str:
    """An interval with its unit; an end that is infinite was not found."""
    low, high = ends
    if isfinite(low) and isfinite(high):
        return f"{low:.6g} to {with_unit(f'{high:.6g}', unit)}"
    if isfinite(low):
        return f"{with_unit(f'{low:.6g}', unit)} or more, without an upper limit"
    return "unbounded" if not isfinite(high) else f"{with_unit(f'{high:.6g}', unit)} or less, without a lower limit"


def _advice(f: Finding, argument: Spelling) -> str:
    measured = ", or measure the current" if f.data["current_missing"] else ""
    both_ways = "drive it in both directions, " if f.data.get("one_way") else ""
    zone = f"{SHOW_ZONE}, " if f.data.get("zone_unseen") else ""
    load = (
        f"record a second load of known weight ({argument('fixed')} gravity.mass[…]), or "
        if f.data.get("one_load")
        else ""
    )
    return f"{load}{zone}{both_ways}fix what you know ({argument('fixed')}){measured}"


sentences("""
speed-is-a-mean info: the data show that {subject} is the mean over the sample before it, as an encoder counts, and it
    is simulated so ({argument[average]})
friction-fades-as-gaussian info: the friction of {subject} near rest fades as exp(−(rate·speed)²), not as
    exp(−rate·speed)
residual-slow warning: the residual changes slowly (about {values:.0f} independent values in {samples:,}); the
    intervals may be too narrow: record longer
no-shaft-seen warning: the data show no shaft flexibility: one mass ({simpler}) describes them as well; use {simpler}
no-shaft-needed warning: one mass ({simpler}) with its refinements has {ratio:.2g} times the error of a motor with a
    shaft, so it is taken instead
choice-interrupted warning: the choice of refinements was stopped before its end; the best model so far is kept
""")
