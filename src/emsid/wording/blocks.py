"""Words for cascades of filters and static maps."""

from emsid.errors import listed
from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import shortened


@words("choices-cut-short", Severity.WARNING)
def choices_cut_short(f: Finding, argument: Spelling) -> str:
    why = "was interrupted" if f.data["cancelled"] else "ran out of time"
    return f"the search for the orders and the static map {why}; the best {f.subject} model so far is kept"


@words("other-number-of-maps", Severity.WARNING)
def other_number_of_maps(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: maps (that it has), asked (for)."""
    asked, maps = (f"{n} static map{'s' * (n != 1)}" for n in (f.data["asked"], f.data["maps"]))
    return (
        f"every {f.subject} model with {asked} diverges, so this one has {maps}; record longer, or give another order"
    )


@words("zero-cancels-pole", Severity.WARNING)
def zero_cancels_pole(f: Finding, argument: Spelling) -> str:
    real, imaginary = f.data["pole"]
    where = f"{real:.4g}" + (f" ± {imaginary:.4g}i" if imaginary else "")
    return f"{_in_block(f)}a zero nearly cancels the pole at {where}; try a lower order"


@words("dead-zone-side-unseen", Severity.WARNING)
def dead_zone_side_unseen(f: Finding, argument: Spelling) -> str:
    names, share = listed(f.data["parameters"]), 100 * f.data["share"]
    return (
        f"{_block(f)}: only {share:.2g} % of the samples leave the dead zone on the {f.data['side']}, so {names} are "
        "not known; record a larger input"
    )


@words("dead-zone-unseen", Severity.WARNING)
def dead_zone_unseen(f: Finding, argument: Spelling) -> str:
    return (
        f"{_block(f)}: the signal is inside the dead zone in {100 * f.data['share']:.2g} % of the samples only; "
        "there may be no dead zone"
    )


@words("limit-unseen", Severity.WARNING)
def limit_unseen(f: Finding, argument: Spelling) -> str:
    share = 100 * f.data["share"]
    where = f"the {f.data['side']} limit"
    reached = f"reaches {where} in {share:.2g} % of the samples only" if share else f"does not reach {where}"
    return f"{_block(f)}: the signal {reached}, so it is not known; record a larger input"


@words("knots-without-data", Severity.WARNING)
def knots_without_data(f: Finding, argument: Spelling) -> str:
    knots = [f"{knot:.4g}" for knot in f.data["knots"]]
    where = listed(knots) if len(knots) < 6 else shortened(knots)
    plural = "s" * (len(f.data["knots"]) > 1)
    return f"{_block(f)}: hardly any data around the knot{plural} at {where}; use fewer knots or a larger input"


@words("too-few-knots", Severity.WARNING)
def too_few_knots(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: block, saved (part of the error)."""
    return (
        f"{_block(f)}: the static map has too few knots; more of them would lower the error by about "
        f"{100 * f.data['saved']:.2g} %"
    )


@words("map-is-straight", Severity.INFO)
def map_is_straight(f: Finding, argument: Spelling) -> str:
    return f"{_block(f)}: the static map is a straight line in the range of the data; try a linear model"


@words("periods-averaged", Severity.INFO)
def periods_averaged(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: period (samples), periods, records, noise (standard deviation, None for one period)."""
    count, records = f.data["periods"], f.data["records"]
    parts = f"{records} record{'s' * (records > 1)} with a period of {f.data['period']:,} samples"
    if f.data["noise"] is None:
        return f"the input is periodic: the model is fitted in steady state to {parts}"
    return (
        f"the model is fitted to means over {count} periods, {parts}; the noise has a deviation of "
        f"{f.data['noise']:.3g}"
    )


@words("process-noise", Severity.INFO)
def process_noise(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: block, spread (input of the map), share of the signal, standard_errors, corrected."""
    share = f"{f.data['spread']:.3g}, {100 * f.data['share']:.2g} % of the signal"
    if f.data["corrected"]:
        return f"{_block(f)}: noise before the map (deviation {share}), for which the model is corrected"
    return f"{_block(f)}: noise before the map (deviation {share}), or a system that is not such a cascade"


@words("parameters-without-interval", Severity.WARNING)
def parameters_without_interval(f: Finding, argument: Spelling) -> str:
    return f"these data do not determine {listed(f.data['parameters'])} separately from other parameters"


def _block(f: Finding) -> str:
    return f"map {f.data['map']}" if "map" in f.data else f"block {f.data['block']}"


def _in_block(f: Finding) -> str:
    """The block, for a model that has blocks."""
    return f"{_block(f)}: " if "block" in f.data else ""


@words("map-turns-without-data", Severity.WARNING)
def map_turns_without_data(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: block, at (input of the map)."""
    return (
        f"{_block(f)}: the static map turns back at {f.data['at']:.4g}, nearly without data; use fewer "
        "knots, or record there"
    )


@words("map-leaves-range", Severity.WARNING)
def map_leaves_range(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: block, at (input of the map), value (output at rest), low, high (measured)."""
    d = f.data
    return (
        f"{_block(f)}: at {d['at']:.4g}, without data, the static map gives {d['value']:.4g} (measured {d['low']:.4g} "
        f"to {d['high']:.4g}); use fewer knots, or record there"
    )


@words("dead-time-at-input")
def dead_time_at_input(f: Finding, argument: Spelling) -> str:
    """Data: delay, moved (samples), filters."""
    samples = f"{f.data['delay']} sample{'s' * (f.data['delay'] != 1)}"
    where = "; no data show which filter it belongs to" if f.data["filters"] > 1 else ""
    return f"a dead time of {samples} is counted at the input{where}"


sentences("""
faster-than-sampling warning: the pole at {pole:.3g} has a time constant of {samples:.2g} samples; try a lower order,
    or sample faster
delay-longer-than-rise warning: its delay of {delay:.3g} s is longer than the whole response of the record, {rise:.3g}
    s; check signs and columns, or give {argument[nk]}
gain-of-other-sign warning: its gain from {input} to {output} has the opposite sign of the record's response; give
    another delay ({argument[nk]}), or record slower, less regular changes
diverges-beyond-range warning: its free run diverges on an input {factor:.3g} times as large as the record's; record a
    larger input, or give a smaller order or degree
diverges-on-constant-input warning: its free run diverges while the input stays at an extreme value; record an input
    that stays there, or give a smaller order or degree
diverges-on-steps warning: its free run diverges where the input steps; record steps too, or give a smaller order or
    degree
""")
