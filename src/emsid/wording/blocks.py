"""Words for cascades of filters and static maps."""

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import listed, shortened

sentences(
    __name__,
    """
choices-cut-short warning: the search for the orders and the static map {cancelled:?was interrupted|ran out of time};
    the best {subject} model so far is kept
other-number-of-maps warning: every {subject} model with {asked} {asked:static map/static maps} diverges, so this one
    has {maps} {maps:static map/static maps}; record longer, or give another order
    # Subject: the model. Data: maps (that it has), asked (for).
zero-cancels-pole warning: {block:None=>|{which}: }a zero nearly cancels the pole at {pole[0]:.4g}{pole[1]:? ±
    {pole[1]:.4g}i}; try a lower order
dead-zone-side-unseen warning: {which}: only {share:.2g %} of the samples leave the dead zone on the {side}, so
    {parameters:list} are not known; record a larger input
dead-zone-unseen warning: {which}: the signal is inside the dead zone in {share:.2g %} of the samples only; there may be
    no dead zone
limit-unseen warning: {which}: the signal {share:?reaches the {side} limit in {share:.2g %} of the samples only|does not
    reach the {side} limit}, so it is not known; record a larger input
too-few-knots warning: {which}: the static map has too few knots; more of them would lower the error by about {saved:.2g
    %} # Subject: the model. Data: block, saved (part of the error).
map-is-straight info: {which}: the static map is a straight line in the range of the data; try a linear model
periods-averaged info: {noise:None=>the input is periodic: the model is fitted in steady state to {parts}|the model is
    fitted to means over {periods} periods, {parts}; the noise has a deviation of {noise:.3g}}
    # Subject: the model. Data: period (samples), periods, records, noise (standard deviation, None for one period).
process-noise info: {which}: noise before the map (deviation {spread:.3g}, {share:.2g %} of the signal), {corrected:?for
    which the model is corrected|or a system that is not such a cascade}
    # Subject: the model. Data: block, spread (input of the map), share of the signal, standard_errors, corrected.
parameters-without-interval warning: these data do not determine {parameters:list} separately from other parameters
map-turns-without-data warning: {which}: the static map turns back at {at:.4g}, nearly without data; use fewer knots, or
    record there # Subject: the model. Data: block, at (input of the map).
map-leaves-range warning: {which}: at {at:.4g}, without data, the static map gives {value:.4g} (measured {low:.4g} to
    {high:.4g}); use fewer knots, or record there
    # Subject: the model. Data: block, at (input of the map), value (output at rest), low, high (measured).
dead-time-at-input info: a dead time of {delay} {delay:sample/samples} is counted at the input{filters:1=>|; no data
    show which filter it belongs to} # Data: delay, moved (samples), filters.
faster-than-sampling warning: the pole at {pole:.3g} has a time constant of {samples:.2g} samples; try a lower order, or
    sample faster
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
""",
    which="{map:None=>block {block}|map {map}}",
    parts="{records} {records:record/records} with a period of {period:,} samples",
)


@words("knots-without-data", Severity.WARNING)
def knots_without_data(f: Finding, argument: Spelling) -> str:
    knots = [f"{knot:.4g}" for knot in f.data["knots"]]
    where = listed(knots) if len(knots) < 6 else shortened(knots)
    which = f"map {f.data['map']}" if "map" in f.data else f"block {f.data['block']}"
    plural = "s" * (len(knots) > 1)
    return f"{which}: hardly any data around the knot{plural} at {where}; use fewer knots or a larger input"
