"""Words for an identification: requests, errors of the models, and the data on which these were computed."""

from __future__ import annotations

from typing import Any

from emsid.findings import Finding
from emsid.units import with_unit
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import listed

sentences(
    __name__,
    """
option-not-used warning: {subject:option} was given and is not used by {models:list}
    # Subject: the option. Data: models.
codes-taken-as-commands warning: this model treats {values:list g} as {values:an ordinary command/ordinary commands};
    leave these samples out with {argument[mask]} # Data: values.
built-in-values-kept warning: built in, not estimated: {parameters:list {name} {value:.6g[unit]}}; give
    {argument[fixed]} or {argument[datasheet]}, or add to {argument[free]} # Data: parameters (name, value, unit).
models-out-of-time warning: no result of {models:list} within {models:its/their} share of the time; allow more
    ({argument[budget]}), or ask for fewer models ({argument[models]}) # Data: models.
interrupted warning: stopped before its end{missing:? (not fitted: {missing:list})}, so residual tests, bands and the
    next experiment are missing # Data: missing (models that were not reached).
few-unseen-samples warning: {subject} has {samples} {samples:sample/samples}, too few to rank models on; give a second
    record of at least {needed} ({argument[unseen]}) # Subject: the unseen data. Data: samples, needed.
models-of-one-output warning: {subject} has {outputs} outputs, so models of one output are not fitted: {models:list};
    name one output ({argument[output]}), such as {output}, to fit them
    # Subject: the record. Data: outputs, models, output (the first).
quick-look info: a quick look, without {without:list}; leave out {argument[quick]} to fit these too
    # Subject: the data. Data: without (the usual models of these data that were not fitted).
fitted-to-all-data info: {searched:?structure and parameters|the parameters} of the saved model come from all
    {samples:,} samples; tables and errors shown here from {of:,} of them
    # Subject: the data. Data: model (its name), samples (of all data), of (of those that the errors are from), searched
    (whether its structure is chosen again), larger (whether because its error on unseen data is).
end-shows-little warning: the end of {subject} has {share:.0f %} of the output's deviation, {moved:?so samples {first:,}
    to {last:,} are the unseen part|and no other part is better; give {argument[unseen]}}
    # Subject: the data. Data: share (of the deviation of the output), first, last (samples of the unseen part), moved
    (whether it is another part than the end).
fitted-to-excerpt info: to save time, the models are fitted to {samples:,} of {of:,} samples of {subject};
    {finished:?then {finished} to all|name a single model ({argument[models]}) to fit it to all}
    # Subject: the data. Data: samples (of the excerpt), of (of all data to fit), finished (the model that was then
    fitted to all of them, empty for none).
error-in-region warning: {region:standstill=>at standstill|low speed=>at low speed|reversal=>in reversals|high speed=>at
    high speed} the free run is worse than elsewhere: RMSE {rmse:.4g[unit]} against {others:.4g[unit]} ({samples:,}
    samples of {subject})
    # Subject: the output. Data: model, region, rmse, others (RMSE in the other regions), unit, samples.
no-better-than-mean problem: on {data}, no model is better than the mean of {subject} # Subject: the output. Data: seen.
free-run-diverged problem: on {data}, the free run diverges at sample {sample} # Data: sample, seen.
input-constant warning: on {data}, {inputs:list {name} is constant at {level:g}}, which tests only the steady state;
    give other data ({argument[unseen]}) # Data: inputs (name, level), seen.
input-beyond-range warning: on {data}, {subject} goes from {low:g} to {high:g}; outside the fitted {fitted_low:g} to
    {fitted_high:g} models extrapolate # Subject: the input. Data: low, high, fitted_low, fitted_high, seen.
map-beyond-range warning: {subject}: its static map {map:None=>|{map} }extrapolates in {share:.3g %} of the samples of
    {data} ({low:.4g} to {high:.4g}, fitted {fitted_low:.4g} to {fitted_high:.4g})
    # Subject: the model. Data: map (None if there is one), low, high, fitted_low, fitted_high, share, seen.
knots-not-used warning: a {family} map has no knots, so {argument[knots]} is not used
code-never-occurs warning: {subject} never has the value {value:g}, which was given as a code; check {argument[brake]}
    and {argument[coast]}
datasheet-not-used warning: the datasheet has no parameter of this model, so it is not used
profile-failed warning: no profile of {subject}: {reason}
data-not-unseen warning: {subject} contains data of the fit, so errors on it say nothing about unseen data
unstable-in-loop problem: the plant is unstable without its controller (a pole of {pole:.3g} per sample), so models are
    ranked by predictions {horizon} samples ahead, not by free runs
input-explains-nothing problem: the input explains nothing of {subject}: {by} simulates it as well with the input
    shuffled, or with its mean instead; check that the columns belong together
worse-than-mean problem: on {subject}, the free run is no better than the mean of the output; check units, sample time
    and changes of the drive
""",
    data="{seen:?the data they were fitted to|unseen data}",
)


def data_name(f: Finding) -> str:
    """Name of the data that the models were ranked on."""
    return "the data they were fitted to" if f.data.get("seen") else "unseen data"


@words("profile-interval")
def profile_interval(f: Finding, argument: Spelling) -> str:
    """Subject: the parameter. Data: level, low, high (None where the profile found no end), unit."""
    return f"by its profile, the {100 * f.data['level']:g} % interval of {f.subject} {_ends(f.data)}"


def _ends(data: Any) -> str:
    low, high, unit = data["low"], data["high"], data["unit"]
    if low is not None and high is not None:
        return f"goes from {low:.6g} to {with_unit(f'{high:.6g}', unit)}"
    if low is not None:
        return f"begins at {with_unit(f'{low:.6g}', unit)}; no upper end was found"
    if high is not None:
        return f"ends at {with_unit(f'{high:.6g}', unit)}; no lower end was found"
    return "was not found: the profile stays below its threshold on both sides"


@words("model-failed", Severity.PROBLEM)
def model_failed(f: Finding, argument: Spelling) -> str:
    """Data: reason, arguments."""
    if "debug" in f.data["arguments"]:
        return f"could not be fitted: {f.data['reason']}{of_program(argument)}"
    spelt = ", ".join(argument(name) for name in f.data["arguments"])
    return f"could not be fitted: {f.data['reason']}" + (f" ({spelt})" if spelt else "")


@words("part-failed", Severity.WARNING)
def part_failed(f: Finding, argument: Spelling) -> str:
    """Subject: the part of the run. Data: reason, internal (whether it is a defect of the program)."""
    return f"{f.subject} failed: {f.data['reason']}{of_program(argument) if f.data['internal'] else ''}"


def of_program(argument: Spelling) -> str:
    """What to do about a defect of the program."""
    return f"; everything else is complete; the log `emsid` has the traceback ({argument('debug')})"


@words("models-not-needed")
def models_not_needed(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: model (its name), models (those that were not fitted)."""
    d = f.data
    spared = f"{listed(d['models'])} {'are' if len(d['models']) > 1 else 'is'} not fitted"
    return (
        f"the inputs explain nothing of the error that {d['model']} leaves, so {spared}; to fit a model all the same, "
        f"name it ({argument('models')})"
    )


@words("free-run-error")
def free_run_error(f: Finding, argument: Spelling) -> str:
    """Data: seen, outputs (name, unit, rmse, fit_percent; None for a constant output); chosen_among (how many models)
    where several were compared, with chosen_on (samples of other data that chose) or, where these data chose, apart
    (RMSE of every output with choice and error on different halves)."""
    outputs = f.data["outputs"]
    if len(outputs) == 1:
        (only,) = outputs
        return f"on {data_name(f)}, the free run has {_fit(only)}; its RMSE is {_rmse(only)}{_apart(f)}"
    each = ", ".join(f"{one['name']} {_rmse(one)} ({_short_fit(one)})" for one in outputs)
    return f"on {data_name(f)}, the free run has an RMSE of {each}{_apart(f)}"


def _apart(f: Finding) -> str:
    """What the choice among several models did to the error."""
    if f.data.get("chosen_among", 1) < 2:
        return ""
    if "chosen_on" in f.data:
        return " (the choice was made on other data)"
    apart = f.data["apart"]
    if apart is None:
        return " (these data also chose it)"
    errors, errors_here = (
        listed([_rmse(one | {"rmse": rmse}) for one, rmse in zip(f.data["outputs"], which, strict=True)])
        for which in (apart, [one["rmse"] for one in f.data["outputs"]])
    )
    return "" if errors == errors_here else f" ({errors} with the choice on another half)"


def _short_fit(output: Any) -> str:
    fit = output["fit_percent"]
    return "constant, no fit" if fit is None else f"fit {fit:.1f} %"


def _fit(output: Any) -> str:
    fit = output["fit_percent"]
    return "no fit, as the measured output is constant" if fit is None else f"a fit of {fit:.1f} %"


def _rmse(output: Any) -> str:
    return with_unit(f"{output['rmse']:.4g}", output["unit"])


@words("one-step-error-smaller")
def one_step_error_smaller(f: Finding, argument: Spelling) -> str:
    """Data: ratio."""
    ratio = f.data["ratio"]
    times = f"{ratio:,.0f}" if ratio >= 100 else f"{ratio:.3g}"
    return f"one step ahead, the MSE is {times} times smaller, as for almost any model; compare models by the free run"
