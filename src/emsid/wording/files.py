"""Words for files: how they were read, what their columns hold, and what was guessed about them."""

from __future__ import annotations

from shlex import quote

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import assigned, duration, how_sure, listed, sample_time, shortened

# --- how a file was read ---------------------------------------------------------------------------------------------


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


@words("sample-time-contradicted", Severity.WARNING)
def sample_time_contradicted(f: Finding, argument: Spelling) -> str:
    """Subject: the file. Data: dt (s), said (s), source (``preamble``, ``file name`` or the name of an entry)."""
    d = f.data
    where = {"preamble": "the header", "file name": "the name"}.get(d["source"], f"the entry {d['source']}")
    return (
        f"{f.subject}: {where} of the file says {duration(d['said'])} between rows, and {duration(d['dt'])} is used; "
        f"check {argument('dt')}"
    )


@words("sample-time-of-file", Severity.WARNING)
def sample_time_of_file(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: column (its clock), dt (s), before (s, of the record that the model is from)."""
    d = f.data
    return (
        f"{f.subject}: {d['column']} says {duration(d['dt'])} between rows, where the record of the model had "
        f"{duration(d['before'])}; the clock of the file is used"
    )


@words("rows-skipped", Severity.WARNING)
def rows_skipped(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: count, rows, line, text (of the first; may be empty), messages."""
    d = f.data
    text = f" ({d['text']!r})" if d["text"] else ""
    many = d["count"] > 1
    return (
        f"{f.subject}: {d['count']} of {d['rows']:,} rows {'were' if many else 'was'} skipped, because a column in use "
        f"has no number there; {'the first' if many else 'it'} is row {d['line']}{text}"
    )


@words("clock-reset")
def clock_reset(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: count, column, line (row of the file with the first)."""
    d = f.data
    times = "once" if d["count"] == 1 else f"{d['count']} times"
    return (
        f"{f.subject}: {d['column']} begins again {times}, first in row {d['line']}; each part is a segment of its own"
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


@words("data-detrended")
def data_detrended(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: order (of the polynomial)."""
    order = f.data["order"]
    what = {0: "the mean", 1: "a line in time"}.get(order, f"a polynomial in time of order {order}")
    return (
        f"{f.subject}: {what} of every channel was subtracted, so 0 is no longer rest; models with friction need the "
        f"data without {argument('detrend')}"
    )


@words("files-equal", Severity.WARNING)
def files_equal(f: Finding, argument: Spelling) -> str:
    """Subject: the file. Data: copies (other files, or the same again)."""
    return (
        f"{f.subject} and {shortened(f.data['copies'])} have the same samples, which count once: only one is proposed"
    )


@words("clocks-of-files")
def clocks_of_files(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: columns (inputs and outputs), share (of the time, in which all have samples)."""
    share = f.data["share"]
    rest = ", the rest is left out" if share < 0.9995 else ""
    return (
        f"{f.subject}: the times of {listed(f.data['columns'])} come from different files, with {100 * share:.3g} % in "
        f"common{rest}; check that both clocks began together"
    )


# --- what was guessed ------------------------------------------------------------------------------------------------


@words("role-uncertain", Severity.WARNING)
def role_uncertain(f: Finding, argument: Spelling) -> str:
    """Subject: the column. Data: role, confidence."""
    role = f.data["role"]
    sure = how_sure(f.data["confidence"])
    return f"{f.subject} is {sure} the {role}; if another column is, name it with {argument(role)}"


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


@words("not-readable", Severity.PROBLEM)
def not_readable(f: Finding, argument: Spelling) -> str:
    """Subject: the file. Data: reason, arguments."""
    spelt = ", ".join(argument(name) for name in f.data["arguments"])
    return f"{f.subject}: with the proposed columns, no record can be read: {f.data['reason']}" + (
        f" ({spelt})" if spelt else ""
    )


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


@words("sample-time-unknown", Severity.WARNING)
def sample_time_unknown(f: Finding, argument: Spelling) -> str:
    """Subject: the file. Data: assumed (s), texts (columns of texts that are called times)."""
    texts = f.data.get("texts", [])
    unread = f", as the texts in {listed(texts)} are no times that are understood" if texts else ""
    return (
        f"{f.subject}: the sample time is not given{unread}; {f.data['assumed']:g} s is assumed, so times and time "
        f"constants count samples. Give the true one with {argument('dt')}"
    )


@words("time-unit-assumed", Severity.WARNING)
def time_unit_assumed(f: Finding, argument: Spelling) -> str:
    """Subject: the time column or the file. Data: unit, dt (s), confidence, source."""
    what = {"preamble": "above the header of", "file name": "in the name"}
    of_column = f.data["source"] == "column"
    which = "" if of_column else f"{what.get(f.data['source'], 'in the entry ' + f.data['source'] + ' of')} "
    return (
        f"the unit of the time {which}{f.subject} is {how_sure(f.data['confidence'])} {f.data['unit']} (sample time "
        f"{sample_time(f.data['dt'])}); check {argument('time_unit' if of_column else 'dt')}"
    )


@words("sample-time-from-text")
def sample_time_from_text(f: Finding, argument: Spelling) -> str:
    """Subject: the file. Data: dt (s), source (``preamble``, ``file name`` or the name of an entry)."""
    source = f.data["source"]
    where = {"preamble": "the lines above the header", "file name": "its name"}.get(source, f"its entry {source}")
    time = sample_time(f.data["dt"])
    return f"{f.subject}: the sample time {time} comes from {where}; check it with {argument('dt')}"


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


# --- what the columns hold -------------------------------------------------------------------------------------------

_THERE = {
    "falls": "the output falls there",
    "rises": "the output rises there",
    "rests": "the output rests there",
    "moves": "the output goes on there",
}


@words("isolated-values", Severity.WARNING)
def isolated_values(f: Finding, argument: Spelling) -> str:
    """Subject: the column. Data: codes (value, count, share, response), low, high."""
    codes = []
    for code in f.data["codes"]:
        there = _THERE.get(code["response"], "")
        codes.append(f"{code['value']:g} ({100 * code['share']:.2g} %{', ' * bool(there)}{there})")
    return (
        f"{f.subject} is also {listed(codes)}, likely codes and no commands; use {argument('mask')}, "
        f"{argument('brake')} or {argument('coast')}"
    )


@words("value-stuck", Severity.WARNING)
def value_stuck(f: Finding, argument: Spelling) -> str:
    """Subject: the column. Data: row, length, value, and mask (a condition; absent or empty where none is known) or
    masked."""
    d = f.data
    if d.get("masked"):
        return (
            f"{f.subject} stays at {d['value']:g} for {d['length']} samples from sample {d['row']} on, while the input "
            "changes; they are left out"
        )
    mask = f"{argument('mask')} {d['mask']!r}" if d.get("mask") else f"{argument('rows')} or {argument('mask')}"
    return (
        f"{f.subject} stays at {d['value']:g} for {d['length']} rows from data row {d['row']} on; if the log stood "
        f"still, leave them out with {mask}"
    )


@words("position-differentiated")
def position_differentiated(f: Finding, argument: Spelling) -> str:
    """Subject: the column. Data: input (whose effect shows it; empty where the name of the column says it)."""
    u = f.data["input"]
    why = f"seems to be a position, as its change responds to {u}" if u else "is a position"
    return (
        f"{f.subject} {why}; d({f.subject}) is proposed, and {argument('output')} {quote(f.subject)} gives a model of "
        "the position"
    )


@words("command-before-its-row")
def command_before_its_row(f: Finding, argument: Spelling) -> str:
    """Subject: the input. Data: output."""
    return (
        f"{f.data['output']} reacts to {f.subject} one row too early; check the logger, or use {argument('shift')} "
        f"{assigned(f.subject, '-1')}"
    )


@words("sign-lost", Severity.WARNING)
def sign_lost(f: Finding, argument: Spelling) -> str:
    """Subject: the input. Data: output, candidates (columns of two values)."""
    columns = f.data["candidates"]
    named = f" ({listed(columns)} may be it)" if columns else ""
    return (
        f"{f.subject} is never negative, and {f.data['output']} goes both ways; give the column with the sign by "
        f"{argument('direction')} {assigned(f.subject, columns[0] if columns else '…')}{named}"
    )


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


@words("unit-not-used")
def unit_not_used(f: Finding, argument: Spelling) -> str:
    """Subject: the column. Data: unit, channels."""
    return (
        f"the unit {f.data['unit']} of {f.subject} is not used, as the column is neither input nor output; these are "
        f"{listed(f.data['channels'])}"
    )


@words("difference-of-position")
def difference_of_position(f: Finding, argument: Spelling) -> str:
    """Subject: the column. Data: position."""
    return (
        f"{f.subject} is the change of {f.data['position']} per row; with an encoder, give {argument('units')} "
        f"{assigned(f.subject, 'count/sample')} and {argument('counts_per_revolution')}"
    )


sentences("""
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
""")
