"""Words for the quality of data: what a record allows, what it does not, and what to do next."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import duration, how_sure

NOTABLE_DISTORTION, HIDDEN_DISTORTION = 0.02, 0.05
"""A linear model is enough up to the first share of the amplitude; less than the second cannot be seen in the noise."""

sentences(
    __name__,
    """
channel-constant problem: {subject} is constant at {level:short[unit]}, so nothing can be identified; record with a
    changing input # Subject: the channel. Data: level, unit.
step-from-first-sample warning: one step of {input}: gain {gain:.3g}{per}, time constant {time_constant:.3g}
    s{begins:None=>|, from {begins:.3g} s on}; also record other levels and the other direction
    # Subject: the output. Data: input, gain, time_constant (s), begins (time in s; None: with the step), level, unit,
    input_unit.
channel-out-of-scale problem: {subject} reaches {largest:.3g}, which cannot be computed with; scale it to an ordinary
    size ({argument[scale]} {subject:assign …}) # Subject: the channel. Data: largest.
output-constant problem: {subject} stays at {level:short[unit]} while {input} goes from {low:.4g} to
    {high:short[input_unit]}; record with a larger input, and check the sensor
    # Subject: the output. Data: level, unit, input, low, high, input_unit.
record-too-short problem: {subject} has {samples} {samples:sample/samples}, too few for a dynamic model and unseen data;
    record at least {needed}, better some hundred # Subject: the record. Data: samples, needed.
excitation-too-low warning: {subject} is too poor for a linear model of second order; record more levels or frequencies,
    such as an amplitude-modulated PRBS
excitation-linear-only warning: {subject} is rich enough for a linear model of second order, not for friction; record
    more levels or frequencies for that
excitation-sufficient info: {subject} is rich enough for linear models and for friction
few-input-levels warning: {subject} has only {levels} levels, which cannot show dead zone, saturation or friction;
    record more levels in both directions
input-may-be-continuous info: {subject} is smooth and may change between its samples; physical models decide this from
    the data unless {argument[hold]} is given

output-without-sign warning: {subject} has one sign and {input} has both: the sensor {confidence:sure} shows the
    magnitude only; cascades and feedback models try that (static maps abs, even-spline)
    # Subject: the output. Data: input, confidence.
no-response warning: {subject} shows no clear response to {input}; check that these are input and output
    ({argument[input]}, {argument[output]}) of one experiment
angle-hangs info: {subject} hangs: gravity returns it{angle:None=>| to about {angle:short[unit]}}, with small swings of
    {period:duration}; joint has this torque
    # Subject: the output. Data: angle (None where the swings do not show it), unit, period (s) of small swings.
angle-without-unit warning: {subject} has no unit, and by its gravity one turn is about {turn:short} of it; read it as
    {seems:?{seems} ({argument[units]} {subject:assign {seems}})|counts ({argument[units]} {subject:assign count},
    {argument[counts_per_revolution]} …)}
    # Subject: the output. Data: turn (in its values), seems (deg, rad, or empty for ticks).
one-load warning: {subject} is no torque: with one load, {output} shows inertia, friction and gravity only as ratios;
    record a second load of known weight ({argument[fixed]} gravity.mass[…])
response-delay info: {subject} {confidence:sure} responds to {input} {after}{sign:?, with the same sign}
    # Subject: the output. Data: input, delay (samples), time (s), sign (0 where it is open), confidence.
delay-ambiguous info: {input} repeats every {period} samples ({time:duration}), so a delay longer by that explains
    {subject} as well; the shortest is taken
    # Subject: the output. Data: input, period (samples), time (of a period, in s).
delay-from-data info: all models have a delay of {delay} samples ({time:duration}), because {subject} responds to
    {input} so late; {argument[nk]} sets another one # Subject: the output. Data: input, delay (samples), time (s).
response-negative warning: {subject} {confidence:sure} responds to {input} with the opposite sign, {after}: leads or
    sensor are reversed ({argument[scale]} {input:assign -1})
    # Subject: the output. Data: input, delay (samples), time (s), confidence.
records-of-opposite-sign warning: the output answers with the opposite sign in {records:some} ({records:len} of {of}
    records); identify these apart ({argument[scale]}) # Subject: the first such record. Data: records, of.
files-of-another-system warning: {files:some} probably {files:is/are} of another system than {others:some} (other
    header, {ratio:.2g} times the usual difference of responses); identify them separately
    # Subject: the longest of these files. Data: files, others (those of the first system), words (that only one of the
    headers has), ratio.
feedback-likely warning: {subject} {confidence:sure} depends on {output} (feedback, correlation {correlation:.2g}); rank
    models by the free run, or record without a controller # Subject: the input. Data: output, correlation, confidence.
output-noise-only problem: {subject} is white noise that does not depend on {input}: check drive and sensor, or record
    with a larger input

all-standstill problem: {subject} rests in the whole record, so nothing can be identified; record with a larger input
much-standstill warning: {subject} rests in {share:.0f %} of the samples, which show the dead zone only; record with
    larger inputs # Subject: the output. Data: share, reversals.
motion info: {subject} rests in {share:.2g %} of the samples and {reversals:0=>never changes its sign|1=>changes its
    sign once|changes its sign {reversals} times} # Subject: the output. Data: share, reversals.
dead-zone-likely info: inputs of up to ±{dead_zone:short[unit]} ({inside:.0f %} of the samples) {confidence:sure} do not
    move the output: dead zone or static friction
    # Subject: the input. Data: dead_zone, amplitude, inside, unit, confidence.
amplitude-near-dead-zone warning: inputs of up to ±{dead_zone:short[unit]} {confidence:sure} do not move the output, and
    {subject} is rarely above {amplitude:short[unit]}; record with larger inputs
    # Subject: the input. Data: dead_zone, amplitude, inside, unit, confidence.

coarse-values warning: {subject} has steps of {step:short[unit]} and a deviation of {levels:.2g} steps; compare free
    runs, or measure with a finer sensor # Subject: the channel. Data: step, unit, levels (standard deviation in steps).
values-cut-off warning: {subject} stands at its {side} limit {limit:short[unit]} in {share:.2g %} of the samples; if the
    sensor saturates, leave them out with {masking}
    # Subject: the output. Data: side, limit, unit, share, mask (a condition; absent or empty where none is known).
joint-at-stop warning: {subject} is at its {side} stop, {limit:short[unit]}, in {share:.2g %} of the samples;
    {masked:?they are left out|leave them out with {masking}}
    # Subject: the output. Data: side, limit, unit, share, and mask (a condition) or masked.
command-limited info: {subject} stands at its {side} limit {limit:short[unit]} in {share:.2g %} of the samples
    # Subject: the input. Data: side, limit, unit, share.
outliers warning: {subject} {confidence:sure} has {count} {count:outlier/outliers} of up to {size:.3g}, {count:it is/the
    first} at sample {sample}; {masked:?{count:it is/they are} left out|leave {count:it/them} out with {masking}}
    # Subject: the output. Data: count, sample, size, confidence, mask (a condition, empty where none is known), and
    masked where they are left out.
clock-jitters info: the times jitter by up to {deviation:duration} ({jitter:.2g %} of a sample); the rows are taken as
    equidistant, {dt:sample_time} apart
    # Subject: the record. Data: jitter (share of the sample time), deviation (s), dt (s).
data-resampled info: resampled to steps of {dt:sample_time}; these data do not show delays below a sample
    # Subject: the record. Data: dt (s).
samples-repeated warning: {subject} changes at every {factor:ordinal} sample only: it is measured every
    {better:duration} and logged every {dt:duration}. Keep every {factor:ordinal} sample with {argument[decimate]}
    {factor} # Subject: the output. Data: factor, dt (s), better (s).
aliasing-possible warning: {share:.0f %} of the power of {subject} is above {frequency:.3g} Hz: {confidence:sure} noise
    or aliasing; sample faster, or filter before sampling
    # Subject: the output. Data: share, frequency (Hz), confidence.
output-integrates warning: {subject} goes on as long as {input} lasts, like a position; give its unit ({argument[units]}
    {subject:assign deg}) or take d({subject}) as output # Subject: the output. Data: input.
sampling-too-fast warning: the response of {subject} takes about {samples:.0f} samples ({time_constant:duration}),
    {confidence:sure} more than a model needs; use {argument[decimate]} {factor}
    # Subject: the output. Data: time_constant (s), samples, dt (s), factor, confidence.
output-drifts warning: {subject} {confidence:sure} drifts by {change:short[unit]}, which the input does not explain;
    warm the drive up first, or subtract a line ({argument[detrend]} 1)
    # Subject: the output. Data: change, unit, confidence.

nearly-linear info: {because:noise=>no clear nonlinearity of {subject}|{subject} is nearly linear}: a linear model fits
    to {fit_percent:.1f} %, and nonlinear functions explain {of_residual:.2g %} of its {because:small-error=>small
    |}squared error{because:noise=>, as noise may do|}
    # Subject: the output. Data: share (of the variance), of_residual, coherence, fit_percent, confidence, because
    (little: nonlinear functions explain little; small-error: of an error that is small; noise: may do as much).
unexplained-output warning: neither a linear model (fit {fit_percent:.0f} %) nor simple nonlinear functions of {input}
    explain {subject}; check the columns, or record the load
""",
    after="{delay:0=>within the same sample|after {delay} {delay:sample/samples} ({time:duration})}",
    masking="{argument[mask]}{mask:? {mask!r}}",
    per="{unit:? {unit}/{input_unit:?{input_unit}|1}|{input_unit:? 1/{input_unit}}}",
)


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


@words("sampling-too-slow", Severity.WARNING)
def sampling_too_slow(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: time_constant (s), samples, dt (s), confidence."""
    d = f.data
    many = f"{d['samples']:.2g} sample{'s' * (round(d['samples'], 1) != 1)}"
    return (
        f"the response of {f.subject} takes about {many} ({duration(d['time_constant'])}), "
        f"{how_sure(d['confidence'])} too few to see its shape; sample at least five times faster"
    )


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
