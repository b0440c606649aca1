"""Words for files: how they were read, what their columns hold, and what was guessed about them."""

from __future__ import annotations

from shlex import quote

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import duration, listed, sample_time, shortened
from emsid.wording.plants import tests_in_words

sentences(
    __name__,
    """
sample-time-contradicted warning: {subject}: {source:preamble=>the header|file name=>the name|the entry {source}} of the
    file says {said:duration} between rows, and {dt:duration} is used; check {argument[dt]}
    # Subject: the file. Data: dt (s), said (s), source (``preamble``, ``file name`` or the name of an entry).
sample-time-of-file warning: {subject}: {column} says {dt:duration} between rows, where the record of the model had
    {before:duration}; the clock of the file is used
    # Subject: the record. Data: column (its clock), dt (s), before (s, of the record that the model is from).
rows-skipped warning: {subject}: {count} of {rows:,} rows {count:was/were} skipped, because a column in use has no
    number there; {count:it/the first} is row {line}{text:? ({text!r})}
    # Subject: the record. Data: count, rows, line, text (of the first; may be empty), messages.
axes-unchecked warning: {subject}: {given} electrical {given:turn/turns} in a turn of the angle {given:is/are} not
    checked: the rotor moves over {turns:.2g} turns; record a few turns under load
    # Subject: the record. Data: turns (of the angle, from its least to its largest value), given.
clock-reset info: {subject}: {column} begins again {count:1=>once|{count} times}, first in row {line}; each part is a
    segment of its own # Subject: the record. Data: count, column, line (row of the file with the first).
data-detrended info: {subject}: {order:0=>the mean|1=>a line in time|a polynomial in time of order {order}} of every
    channel was subtracted, so 0 is no longer rest; models with friction need the data without {argument[detrend]}
    # Subject: the record. Data: order (of the polynomial).
files-equal warning: {subject} and {copies:some} have the same samples, which count once: only one is proposed
    # Subject: the file. Data: copies (other files, or the same again).
role-uncertain warning: {subject} is {confidence:sure} the {role}; if another column is, name it with {role:option}
    # Subject: the column. Data: role, confidence.
not-readable problem: {subject}: with the proposed columns, no record can be read: {reason}{arguments:?
    ({arguments:commas option})} # Subject: the file. Data: reason, arguments.
sample-time-unknown warning: {subject}: the sample time is not given{texts:?, as the texts in {texts:list} are no times
    that are understood}; {assumed:g} s is assumed, so times and time constants count samples. Give the true one with
    {argument[dt]} # Subject: the file. Data: assumed (s), texts (columns of texts that are called times).
time-unit-assumed warning: the unit of the time {source:column=>|preamble=>above the header of |file name=>in the name
    |in the entry {source} of }{subject} is {confidence:sure} {unit} (sample time {dt:sample_time}); check
    {source:column=>{argument[time_unit]}|{argument[dt]}}
    # Subject: the time column or the file. Data: unit, dt (s), confidence, source.
sample-time-from-text info: {subject}: the sample time {dt:sample_time} comes from {source:preamble=>the lines above the
    header|file name=>its name|its entry {source}}; check it with {argument[dt]}
    # Subject: the file. Data: dt (s), source (``preamble``, ``file name`` or the name of an entry).
isolated-values warning: {subject} is also {codes:list {value:g} ({share:.2g %}{response:falls=>, the output falls
    there|rises=>, the output rises there|rests=>, the output rests there|moves=>, the output goes on there|})}, likely
    codes and no commands; use {argument[mask]}, {argument[brake]} or {argument[coast]}
    # Subject: the column. Data: codes (value, count, share, response), low, high.
value-stuck warning: {subject} stays at {value:g} for {length} {masked:?samples from sample {row} on, while the input
    changes; they are left out|rows from data row {row} on; if the log stood still, leave them out with
    {mask:?|{argument[rows]} or }{argument[mask]}{mask:? {mask!r}}}
    # Subject: the column. Data: row, length, value, and mask (a condition; absent or empty where none is known) or
    masked.
command-before-its-row info: {output} reacts to {subject} one row too early; check the logger, or use {argument[shift]}
    {subject:assign -1} # Subject: the input. Data: output.
sign-lost warning: {subject} is never negative, and {output} goes both ways; give the column with the sign by
    {argument[direction]} {candidates:?{subject:assign {candidates[0]}} ({candidates:list} may be it)|{subject:assign
    …}} # Subject: the input. Data: output, candidates (columns of two values).
brushless-columns info: {subject} has voltages ({voltages:list}) and currents ({currents:list}) of the rotor axes of a
    brushless motor{speed:?{rests:?; {speed} is noise, and left out|, and its speed, {speed}}}; the model is brushless
    # Subject: the file. Data: voltages, currents, speed (columns; speed may be empty), rests (whether the rotor does).
phases-of-motor warning: {subject} has phases of a brushless motor; {argument[phases]} {phases:list},
    {argument[rotor_angle]} {angle}{electrical:? with {argument[electrical_angle]}} and {argument[pole_pairs]} turn them
    to the axes of its rotor # Subject: the file. Data: phases (texts for the argument), angle (column), electrical.
pole-pairs-open warning: {subject}: the number of pole pairs is not given, and {usual:g} is assumed: give it
    ({argument[fixed]} pole_pairs=…), as flux and inertia depend on it # Subject: the file. Data: usual.
speed-electrical warning: {subject} is electrical: {argument[units]} {subject:assign erpm} {argument[pole_pairs]}
    {pole_pairs:None=>N gives the speed of the shaft; with 1, inertia and friction are divided by N²|{pole_pairs:g}
    gives the speed of the shaft}
    # Subject: the column. Data: pole_pairs (None where not given).
unit-unknown warning: the unit {unit} of {subject} is not known; {argument[units]} {subject:assign …} gives one, and
    without it the values are not converted # Subject: the column. Data: unit.
unit-not-used info: the unit {unit} of {subject} is not used, as the column is neither input nor output; these are
    {channels:list} # Subject: the column. Data: unit, channels.
difference-of-position info: {subject} is the change of {position} per row; with an encoder, give {argument[units]}
    {subject:assign count/sample} and {argument[counts_per_revolution]} # Subject: the column. Data: position.
rows-of-messages info: {subject}: the {rows:,} rows have values in some columns only, as messages do; the input keeps
    its value until the next output
encoder-pulses info: {subject} toggles between {low:.3g} and {high:.3g} like an encoder, {rate:.4g} times per second;
    its edges are counted as a position, {counts}
edges-missed warning: {subject}: {missed:,} of {edges:,} edges were missed, as both channels changed in one row, and
    counted in the direction of the edge before; sample faster
position-wraps info: {subject} starts again after {period:.10g}; {argument[wrap]} makes it continuous
reference-column warning: {subject} looks like the reference of a controller, which makes {input} depend on {follows}
    (feedback); compare models by the free run
direction-column info: {subject} has no sign, and {output} responds to it more clearly with that of {column}, which is
    taken as its direction ({argument[direction]})
""",
)


@words("sample-time-implausible", Severity.WARNING)
def sample_time_implausible(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: dt."""
    dt = f.data["dt"]
    if dt < 1:
        return f"{f.subject}: a sample time of {dt:g} s is very short for a drive; check the unit of {argument('dt')}"
    return (
        f"{f.subject}: a sample time of {dt:g} s is very long for a drive; if it is in ms, give "
        f"{argument('dt')} or {argument('time_unit')} in ms"
    )


@words("file-cut-off", Severity.WARNING)
def file_cut_off(f: Finding, argument: Spelling) -> str:
    """Subject: the file. Data: columns (by name, the samples that are there, and those that there should be or 0)."""
    parts = [
        f"{name} has {read:,} of {whole:,} samples"
        if whole
        else f"{name or 'it'} ends after {read:,} samples, within another one"
        for name, (read, whole) in f.data["columns"].items()
    ]
    return f"{f.subject} is cut off: {listed(parts)}; copy it again if there is a whole one"


@words("data-filtered")
def data_filtered(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: cutoff (Hz, or None), factor (of decimation, 1 for none)."""
    d = f.data
    what = [f"low-pass filtered at {d['cutoff']:g} Hz"] if d["cutoff"] is not None else []
    what += [f"decimated by {d['factor']}"] if d["factor"] > 1 else []
    return f"{f.subject}: all channels were {listed(what)}, forwards and backwards, so these data cannot show feedback"


@words("clocks-of-files")
def clocks_of_files(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: columns (inputs and outputs), share (of the time, in which all have samples)."""
    share = f.data["share"]
    rest = ", the rest is left out" if share < 0.9995 else ""
    return (
        f"{f.subject}: the times of {listed(f.data['columns'])} come from different files, with {100 * share:.3g} % in "
        f"common{rest}; check that both clocks began together"
    )


@words("no-role-found", Severity.WARNING)
def no_role_found(f: Finding, argument: Spelling) -> str:
    """Subject: the file. Data: roles."""
    roles = f.data["roles"]
    return (
        f"{f.subject}: no column looks like the {' or the '.join(roles)}; name it with "
        f"{listed([argument(role) for role in roles])}"
    )


@words("steady-states", Severity.PROBLEM)
def steady_states(f: Finding, argument: Spelling) -> str:
    """Subject: the file. Data: input, output, rows, dead (low and high end, or None), slope, at (its input), and low
    and high (level and first input of the saturation, or None)."""
    d = f.data
    u, y = d["input"], d["output"]
    said = [f"rests from {d['dead'][0]:.3g} to {d['dead'][1]:.3g}"] if d["dead"] else []
    said += [f"has a slope up to {d['slope']:.4g} at {d['at']:.3g}"]
    ends = [f"{d[end][0]:.4g}" for end in ("low", "high") if d[end]]
    said += [f"saturates at {listed(ends)}"] if ends else []
    return f"steady states over {u}: {y} {listed(said)}; they show no dynamics"


@words("values-missing", Severity.WARNING)
def values_missing(f: Finding, argument: Spelling) -> str:
    """Subject: the column. Data: count, rows."""
    count, rows = f.data["count"], f.data["rows"]
    column = f.subject if f.subject.isidentifier() else f'"{f.subject}"'
    return (
        f"{f.subject} has no number in {count:,} of {rows:,} rows ({100 * count / rows:.2g} %); "
        f"{argument('mask')} 'isnan({column})' leaves them out, and a new segment begins after each gap"
    )


@words("several-experiments", Severity.WARNING)
def several_experiments(f: Finding, argument: Spelling) -> str:
    """Subject: the file. Data: chosen, pairs (of input and output)."""
    pairs = shortened([" and ".join(pair) for pair in f.data["pairs"]], between="; ")
    taken = " and ".join(f.data["chosen"])
    return f"{f.subject}: of several pairs of input and output, {taken} are taken; others are {pairs}"


@words("clock-irregular", Severity.WARNING)
def clock_irregular(f: Finding, argument: Spelling) -> str:
    """Subject: the time column. Data: gaps, longest (s), duplicates, jitter, dt (s)."""
    d = f.data
    many = "s of up to" if d["gaps"] != 1 else " of"
    parts = [f"{d['gaps']} gap{many} {duration(d['longest'])}"] if d["gaps"] else []
    parts += [f"{d['duplicates']} repeated time{'s' * (d['duplicates'] != 1)}"] if d["duplicates"] else []
    parts += [f"steps that differ by up to {100 * d['jitter']:.2g} %"] if d["jitter"] > 0.01 else []
    steps = f"steps of {sample_time(d['dt'])}"
    return f"{f.subject} is not regular: {listed(parts)}; {argument('resample')} interpolates to {steps}"


@words("position-differentiated")
def position_differentiated(f: Finding, argument: Spelling) -> str:
    """Subject: the column. Data: input (whose effect shows it; empty where the name of the column says it)."""
    u = f.data["input"]
    why = f"seems to be a position, as its change responds to {u}" if u else "is a position"
    return (
        f"{f.subject} {why}; d({f.subject}) is proposed, and {argument('output')} {quote(f.subject)} gives a model of "
        "the position"
    )


@words("record-determines")
def record_determines(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: turns (whether the rotor moves), currents (axes on which one flows), known, unknown
    (parameters), ratios (those of the unknown of which a combination is known), tests (which of them each shows)."""
    d = f.data
    flows = {0: "no current", 1: f"current on the {''.join(d['currents'])}-axis"}
    turns = "the rotor turns" if d["turns"] else "the rotor rests"
    record = f"{turns}, {flows.get(len(d['currents']), 'currents on both axes')}"
    if not d["unknown"]:
        return f"{record}: all parameters of a brushless motor can be determined"
    known = f"{listed(d['known'])} can be determined" if d["known"] else "nothing can be determined"
    ratios = f", {listed(d['ratios'])} as ratios" if d["ratios"] else ""
    tests = f"; {tests_in_words(d['tests'], every=False)}" if d["tests"] else f"; not {listed(d['unknown'])}"
    return f"{record}: {known}{ratios}{tests}"


@words("further-channels")
def further_channels(f: Finding, argument: Spelling) -> str:
    """Subject: the file. Data: inputs, outputs, positions (lists of columns)."""
    d = f.data
    said = []
    if d["inputs"]:
        said.append(f"{listed(d['inputs'])} may be a load (a second {argument('input')})")
    if d["outputs"]:
        said.append(f"{listed(d['outputs'])} a second {argument('output')}")
    if d["positions"]:
        said.append(f"{listed(d['positions'])} the better {argument('output')}, as the speed comes from it")
    return f"{f.subject}: {'; '.join(said)}"
