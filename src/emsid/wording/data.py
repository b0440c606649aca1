"""Words for the quality of data: what a record allows, what it does not, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from emsid.findings import Finding
from emsid.units import with_unit
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import assigned, duration, how_sure, ordinal, sample_time, shortened

NOTABLE_DISTORTION, HIDDEN_DISTORTION = 0.02, 0.05
"""A linear model is enough up to the first share of the amplitude; less than the second cannot be seen in the noise."""


def _in_unit(value: float, unit: str) -> str:
    """A number of three digits with its unit; thousands are written out."""
    short = float(f"{value:.3g}")
    return with_unit(f"{short:.0f}" if 1e3 <= abs(short) < 1e6 else f"{short:.3g}", unit)


# --- excitation ------------------------------------------------------------------------------------------------------


@words("channel-constant", Severity.PROBLEM)
def channel_constant(f: Finding, argument: Spelling) -> str:
    """Subject: the channel. Data: level, unit."""
    level = _in_unit(f.data["level"], f.data["unit"])
    return f"{f.subject} is constant at {level}, so nothing can be identified; record with a changing input"


@words("step-from-first-sample", Severity.WARNING)
def step_from_first_sample(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: input, gain, time_constant (s), begins (time in s; None: with the step), level, unit,
    input_unit."""
    d = f.data
    late = "" if d["begins"] is None else f", from {d['begins']:.3g} s on"
    per = f" {d['unit'] or '1'}/{d['input_unit'] or '1'}" if d["unit"] or d["input_unit"] else ""
    return (
        f"one step of {d['input']}: gain {d['gain']:.3g}{per}, time constant {d['time_constant']:.3g} s{late}; "
        "also record other levels and the other direction"
    )


@words("channel-out-of-scale", Severity.PROBLEM)
def channel_out_of_scale(f: Finding, argument: Spelling) -> str:
    """Subject: the channel. Data: largest."""
    return (
        f"{f.subject} reaches {f.data['largest']:.3g}, which cannot be computed with; scale it to an ordinary size "
        f"({argument('scale')} {assigned(f.subject, '…')})"
    )


@words("output-constant", Severity.PROBLEM)
def output_constant(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: level, unit, input, low, high, input_unit."""
    d = f.data
    return (
        f"{f.subject} stays at {_in_unit(d['level'], d['unit'])} while {d['input']} goes from {d['low']:.4g} to "
        f"{_in_unit(d['high'], d['input_unit'])}; record with a larger input, and check the sensor"
    )


@words("record-too-short", Severity.PROBLEM)
def record_too_short(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: samples, needed."""
    samples = f.data["samples"]
    return (
        f"{f.subject} has {samples} sample{'s' * (samples != 1)}, too few for a dynamic model and unseen data; record "
        f"at least {f.data['needed']}, better some hundred"
    )


# --- response --------------------------------------------------------------------------------------------------------


@words("output-without-sign", Severity.WARNING)
def output_without_sign(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: input, confidence."""
    return (
        f"{f.subject} has one sign and {f.data['input']} has both: the sensor {how_sure(f.data['confidence'])} shows "
        "the magnitude only; cascades and feedback models try that (static maps abs, even-spline)"
    )


@words("angle-hangs")
def angle_hangs(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: angle (None where the swings do not show it), unit, period (s) of small swings."""
    d = f.data
    where = "" if d["angle"] is None else f" to about {_in_unit(d['angle'], d['unit'])}"
    swings = duration(d["period"])
    return f"{f.subject} hangs: gravity returns it{where}, with small swings of {swings}; joint has this torque"


@words("angle-without-unit", Severity.WARNING)
def angle_without_unit(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: turn (in its values), seems (deg, rad, or empty for ticks)."""
    d, unit = f.data, argument("units")
    way = (
        f"read it as {d['seems']} ({unit} {assigned(f.subject, d['seems'])})"
        if d["seems"]
        else f"read it as counts ({unit} {assigned(f.subject, 'count')}, {argument('counts_per_revolution')} …)"
    )
    return f"{f.subject} has no unit, and by its gravity one turn is about {_in_unit(d['turn'], '')} of it; {way}"


@words("response-delay")
def response_delay(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: input, delay (samples), time (s), sign (0 where it is open), confidence."""
    d = f.data
    sign = ", with the same sign" if d["sign"] else ""
    return f"{f.subject} {how_sure(d['confidence'])} responds to {d['input']} {_after(d)}{sign}"


@words("delay-ambiguous")
def delay_ambiguous(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: input, period (samples), time (of a period, in s)."""
    d = f.data
    return (
        f"{d['input']} repeats every {d['period']} samples ({duration(d['time'])}), so a delay longer by that explains "
        f"{f.subject} as well; the shortest is taken"
    )


def _after(data: Mapping[str, Any]) -> str:
    """When a response begins, by its ``delay`` in samples and its ``time`` in s."""
    delay = data["delay"]
    many = "s" * (delay != 1)
    return f"after {delay} sample{many} ({duration(data['time'])})" if delay else "within the same sample"


@words("delay-from-data")
def delay_from_data(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: input, delay (samples), time (s)."""
    d = f.data
    return (
        f"all models have a delay of {d['delay']} samples ({duration(d['time'])}), because {f.subject} responds "
        f"to {d['input']} so late; {argument('nk')} sets another one"
    )


@words("response-negative", Severity.WARNING)
def response_negative(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: input, delay (samples), time (s), confidence."""
    d = f.data
    return (
        f"{f.subject} {how_sure(d['confidence'])} responds to {d['input']} with the opposite sign, {_after(d)}: leads "
        f"or sensor are reversed ({argument('scale')} {assigned(d['input'], '-1')})"
    )


@words("records-of-opposite-sign", Severity.WARNING)
def records_of_opposite_sign(f: Finding, argument: Spelling) -> str:
    """Subject: the first such record. Data: records, of."""
    odd = f.data["records"]
    return (
        f"the output answers with the opposite sign in {shortened(odd)} ({len(odd)} of {f.data['of']} records); "
        f"identify these apart ({argument('scale')})"
    )


@words("files-of-another-system", Severity.WARNING)
def files_of_another_system(f: Finding, argument: Spelling) -> str:
    """Subject: the longest of these files. Data: files, others (those of the first system), words (that only one of the
    headers has), ratio."""
    files, others = shortened(f.data["files"]), shortened(f.data["others"])
    return (
        f"{files} probably {'is' if len(f.data['files']) == 1 else 'are'} of another system than {others} (other "
        f"header, {f.data['ratio']:.2g} times the usual difference of responses); identify them separately"
    )


@words("feedback-likely", Severity.WARNING)
def feedback_likely(f: Finding, argument: Spelling) -> str:
    """Subject: the input. Data: output, correlation, confidence."""
    return (
        f"{f.subject} {how_sure(f.data['confidence'])} depends on {f.data['output']} (feedback, correlation "
        f"{f.data['correlation']:.2g}); rank models by the free run, or record without a controller"
    )


# --- motion ----------------------------------------------------------------------------------------------------------


@words("much-standstill", Severity.WARNING)
def much_standstill(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: share, reversals."""
    return (
        f"{f.subject} rests in {100 * f.data['share']:.0f} % of the samples, which show the dead zone only; record "
        "with larger inputs"
    )


@words("motion")
def motion(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: share, reversals."""
    reversals = f.data["reversals"]
    times = {0: "never changes its sign", 1: "changes its sign once"}.get(
        reversals, f"changes its sign {reversals} times"
    )
    return f"{f.subject} rests in {100 * f.data['share']:.2g} % of the samples and {times}"


@words("dead-zone-likely")
def dead_zone_likely(f: Finding, argument: Spelling) -> str:
    """Subject: the input. Data: dead_zone, amplitude, inside, unit, confidence."""
    d = f.data
    return (
        f"inputs of up to ±{_in_unit(d['dead_zone'], d['unit'])} ({100 * d['inside']:.0f} % of the samples) "
        f"{how_sure(d['confidence'])} do not move the output: dead zone or static friction"
    )


@words("amplitude-near-dead-zone", Severity.WARNING)
def amplitude_near_dead_zone(f: Finding, argument: Spelling) -> str:
    """Subject: the input. Data: dead_zone, amplitude, inside, unit, confidence."""
    d = f.data
    return (
        f"inputs of up to ±{_in_unit(d['dead_zone'], d['unit'])} {how_sure(d['confidence'])} do not move the output, "
        f"and {f.subject} is rarely above {_in_unit(d['amplitude'], d['unit'])}; record with larger inputs"
    )


# --- sensor and clock ------------------------------------------------------------------------------------------------


@words("coarse-values", Severity.WARNING)
def coarse_values(f: Finding, argument: Spelling) -> str:
    """Subject: the channel. Data: step, unit, levels (standard deviation in steps)."""
    return (
        f"{f.subject} has steps of {_in_unit(f.data['step'], f.data['unit'])} and a deviation of "
        f"{f.data['levels']:.2g} steps; compare free runs, or measure with a finer sensor"
    )


@words("values-cut-off", Severity.WARNING)
def values_cut_off(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: side, limit, unit, share, mask (a condition; absent or empty where none is known)."""
    d = f.data
    condition = f" {d['mask']!r}" if d.get("mask") else ""
    return (
        f"{f.subject} stands at its {d['side']} limit {_in_unit(d['limit'], d['unit'])} in "
        f"{100 * d['share']:.2g} % of the samples; if the sensor saturates, leave them out with "
        f"{argument('mask')}{condition}"
    )


@words("joint-at-stop", Severity.WARNING)
def joint_at_stop(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: side, limit, unit, share, and mask (a condition) or masked."""
    d = f.data
    condition = f" {d['mask']!r}" if d.get("mask") else ""
    then = "they are left out" if d.get("masked") else f"leave them out with {argument('mask')}{condition}"
    return (
        f"{f.subject} is at its {d['side']} stop, {_in_unit(d['limit'], d['unit'])}, in "
        f"{100 * d['share']:.2g} % of the samples; {then}"
    )


@words("command-limited")
def command_limited(f: Finding, argument: Spelling) -> str:
    """Subject: the input. Data: side, limit, unit, share."""
    d = f.data
    return (
        f"{f.subject} stands at its {d['side']} limit {_in_unit(d['limit'], d['unit'])} in "
        f"{100 * d['share']:.2g} % of the samples"
    )


@words("outliers", Severity.WARNING)
def outliers(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: count, sample, size, confidence, mask (a condition, empty where none is known), and
    masked where they are left out."""
    d = f.data
    many = d["count"] > 1
    condition = f" {d['mask']!r}" if d["mask"] else ""
    out = f"leave {'them' if many else 'it'} out with {argument('mask')}{condition}"
    return (
        f"{f.subject} {how_sure(d['confidence'])} has {d['count']} outlier{'s' * many} of up to {d['size']:.3g}, "
        f"{'the first' if many else 'it is'} at sample {d['sample']}; "
        + (f"{'they are' if many else 'it is'} left out" if d.get("masked") else out)
    )


@words("clock-jitters")
def clock_jitters(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: jitter (share of the sample time), deviation (s), dt (s)."""
    d = f.data
    return (
        f"the times jitter by up to {duration(d['deviation'])} ({100 * d['jitter']:.2g} % of a sample); the rows are "
        f"taken as equidistant, {sample_time(d['dt'])} apart"
    )


@words("data-resampled")
def data_resampled(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: dt (s)."""
    return f"resampled to steps of {sample_time(f.data['dt'])}; these data do not show delays below a sample"


@words("read-in-part")
def read_in_part(f: Finding, argument: Spelling) -> str:
    """Subject: the file. Data: rows (that are held), of (rows of the file), whole (arguments of reading, and words for
    others, that need neighbours of a row, so that no block of rows can be read by itself)."""
    d = f.data
    said = f"{d['rows']:,} of {d['of']:,} rows are used, from all over the file"
    if d["whole"]:
        whole = " and ".join(argument(each) if each.isidentifier() else each for each in d["whole"])
        return f"{said}; with {whole} no model is fitted to all"
    return f"{said}; only regressions fitted one step ahead, such as arx, are fitted to all"


@words("samples-repeated", Severity.WARNING)
def samples_repeated(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: factor, dt (s), better (s)."""
    d = f.data
    return (
        f"{f.subject} changes at every {ordinal(d['factor'])} sample only: it is measured every "
        f"{duration(d['better'])} and logged every {duration(d['dt'])}. Keep every {ordinal(d['factor'])} sample with "
        f"{argument('decimate')} {d['factor']}"
    )


@words("aliasing-possible", Severity.WARNING)
def aliasing_possible(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: share, frequency (Hz), confidence."""
    d = f.data
    return (
        f"{100 * d['share']:.0f} % of the power of {f.subject} is above {d['frequency']:.3g} Hz: "
        f"{how_sure(d['confidence'])} noise or aliasing; sample faster, or filter before sampling"
    )


@words("output-integrates", Severity.WARNING)
def output_integrates(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: input."""
    return (
        f"{f.subject} goes on as long as {f.data['input']} lasts, like a position; give its unit ({argument('units')} "
        f"{assigned(f.subject, 'deg')}) or take d({f.subject}) as output"
    )


@words("sampling-too-slow", Severity.WARNING)
def sampling_too_slow(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: time_constant (s), samples, dt (s), confidence."""
    d = f.data
    many = f"{d['samples']:.2g} sample{'s' * (round(d['samples'], 1) != 1)}"
    return (
        f"the response of {f.subject} takes about {many} ({duration(d['time_constant'])}), "
        f"{how_sure(d['confidence'])} too few to see its shape; sample at least five times faster"
    )


@words("sampling-too-fast", Severity.WARNING)
def sampling_too_fast(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: time_constant (s), samples, dt (s), factor, confidence."""
    d = f.data
    return (
        f"the response of {f.subject} takes about {d['samples']:.0f} samples ({duration(d['time_constant'])}), "
        f"{how_sure(d['confidence'])} more than a model needs; use {argument('decimate')} {d['factor']}"
    )


@words("output-drifts", Severity.WARNING)
def output_drifts(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: change, unit, confidence."""
    d = f.data
    return (
        f"{f.subject} {how_sure(d['confidence'])} drifts by {_in_unit(d['change'], d['unit'])}, which the input does "
        f"not explain; warm the drive up first, or subtract a line ({argument('detrend')} 1)"
    )


# --- nonlinearity ----------------------------------------------------------------------------------------------------


@words("distortion-levels")
def distortion_levels(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: periods, period (s), lines, noise, even, odd, least (shares of the amplitude)."""
    d = f.data
    if max(d["even"], d["odd"]) > max(NOTABLE_DISTORTION, d["least"]):
        then = "a nonlinear model is needed"
    elif d["least"] <= HIDDEN_DISTORTION:
        then = "a linear model is enough at this amplitude"
    else:
        then = "noise hides distortion; record more periods"
    return (
        f"over {d['periods']} periods of {duration(d['period'])}, {f.subject} has {100 * d['noise']:.2g} % noise, "
        f"{100 * d['even']:.2g} % even and {100 * d['odd']:.2g} % odd distortion: {then}"
    )


@words("nonlinear-likely")
def nonlinear_likely(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: share (of the variance), of_residual, coherence, fit_percent, confidence."""
    d = f.data
    return (
        f"{f.subject} is {how_sure(d['confidence'])} nonlinear in the input: a nonlinear model should leave about "
        f"{100 * (1 - d['of_residual']):.2g} % of a linear model's squared error"
    )


@words("nearly-linear")
def nearly_linear(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: share (of the variance), of_residual, coherence, fit_percent, confidence, because
    (little: nonlinear functions explain little; small-error: of an error that is small; noise: may do as much)."""
    d = f.data
    begins = "no clear nonlinearity of {}" if d["because"] == "noise" else "{} is nearly linear"
    error = "small squared error" if d["because"] == "small-error" else "squared error"
    chance = ", as noise may do" if d["because"] == "noise" else ""
    return (
        f"{begins.format(f.subject)}: a linear model fits to {d['fit_percent']:.1f} %, and nonlinear functions explain "
        f"{100 * d['of_residual']:.2g} % of its {error}{chance}"
    )


sentences("""
excitation-too-low warning: {subject} is too poor for a linear model of second order; record more levels or
    frequencies, such as an amplitude-modulated PRBS
excitation-linear-only warning: {subject} is rich enough for a linear model of second order, not for friction; record
    more levels or frequencies for that
excitation-sufficient info: {subject} is rich enough for linear models and for friction
few-input-levels warning: {subject} has only {levels} levels, which cannot show dead zone, saturation or friction;
    record more levels in both directions
input-may-be-continuous info: {subject} is smooth and may change between its samples; physical models decide this from
    the data unless {argument[hold]} is given
no-response warning: {subject} shows no clear response to {input}; check that these are input and output
    ({argument[input]}, {argument[output]}) of one experiment
one-load warning: {subject} is no torque: with one load, {output} shows inertia, friction and gravity only as ratios;
    record a second load of known weight ({argument[fixed]} gravity.mass[…])
output-noise-only problem: {subject} is white noise that does not depend on {input}: check drive and sensor, or record
    with a larger input
all-standstill problem: {subject} rests in the whole record, so nothing can be identified; record with a larger input
unexplained-output warning: neither a linear model (fit {fit_percent:.0f} %) nor simple nonlinear functions of {input}
    explain {subject}; check the columns, or record the load
""")
