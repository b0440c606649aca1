"""Words for an identification: requests, errors of the models, and the data on which these were computed."""

from __future__ import annotations

from typing import Any

from emsid.findings import Finding
from emsid.units import with_unit
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import listed


def data_name(f: Finding) -> str:
    """Name of the data that the models were ranked on."""
    return "the data they were fitted to" if f.data.get("seen") else "unseen data"


# --- what was asked for ----------------------------------------------------------------------------------------------


@words("option-not-used", Severity.WARNING)
def option_not_used(f: Finding, argument: Spelling) -> str:
    """Subject: the option. Data: models."""
    return f"{argument(f.subject)} was given and is not used by {listed(f.data['models'])}"


@words("codes-taken-as-commands", Severity.WARNING)
def codes_taken_as_commands(f: Finding, argument: Spelling) -> str:
    """Data: values."""
    values = f.data["values"]
    ordinary = "ordinary commands" if len(values) > 1 else "an ordinary command"
    return (
        f"this model treats {listed([f'{value:g}' for value in values])} as {ordinary}; leave these samples out with "
        f"{argument('mask')}"
    )


@words("built-in-values-kept", Severity.WARNING)
def built_in_values_kept(f: Finding, argument: Spelling) -> str:
    """Data: parameters (name, value, unit)."""
    values = [
        f"{each['name']} {with_unit(format(each['value'], '.6g'), each['unit'])}" for each in f.data["parameters"]
    ]
    return (
        f"built in, not estimated: {listed(values)}; give {argument('fixed')} or {argument('datasheet')}, or add to "
        f"{argument('free')}"
    )


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


@words("models-out-of-time", Severity.WARNING)
def models_out_of_time(f: Finding, argument: Spelling) -> str:
    """Data: models."""
    models = f.data["models"]
    share = "their share" if len(models) > 1 else "its share"
    return (
        f"no result of {listed(models)} within {share} of the time; allow more ({argument('budget')}), or ask for "
        f"fewer models ({argument('models')})"
    )


@words("interrupted", Severity.WARNING)
def interrupted(f: Finding, argument: Spelling) -> str:
    """Data: missing (models that were not reached)."""
    missing = f.data["missing"]
    rest = f" (not fitted: {listed(missing)})" if missing else ""
    return f"stopped before its end{rest}, so residual tests, bands and the next experiment are missing"


# --- errors, and the data they were computed on ----------------------------------------------------------------------


@words("few-unseen-samples", Severity.WARNING)
def few_unseen_samples(f: Finding, argument: Spelling) -> str:
    """Subject: the unseen data. Data: samples, needed."""
    samples = "1 sample" if f.data["samples"] == 1 else f"{f.data['samples']} samples"
    return (
        f"{f.subject} has {samples}, too few to rank models on; give a second record of at least {f.data['needed']} "
        f"({argument('unseen')})"
    )


@words("models-of-one-output", Severity.WARNING)
def models_of_one_output(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: outputs, models, output (the first)."""
    return (
        f"{f.subject} has {f.data['outputs']} outputs, so models of one output are not fitted: "
        f"{listed(f.data['models'])}; name one output ({argument('output')}), such as {f.data['output']}, to fit them"
    )


@words("quick-look")
def quick_look(f: Finding, argument: Spelling) -> str:
    """Subject: the data. Data: without (the usual models of these data that were not fitted)."""
    return f"a quick look, without {listed(f.data['without'])}; leave out {argument('quick')} to fit these too"


@words("models-not-needed")
def models_not_needed(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: model (its name), models (those that were not fitted)."""
    d = f.data
    spared = f"{listed(d['models'])} {'are' if len(d['models']) > 1 else 'is'} not fitted"
    return (
        f"the inputs explain nothing of the error that {d['model']} leaves, so {spared}; to fit a model all the same, "
        f"name it ({argument('models')})"
    )


@words("fitted-to-all-data")
def fitted_to_all_data(f: Finding, argument: Spelling) -> str:
    """Subject: the data. Data: model (its name), samples (of all data), of (of those that the errors are from),
    searched (whether its structure is chosen again), larger (whether because its error on unseen data is)."""
    d = f.data
    saved = "structure and parameters" if d["searched"] else "the parameters"
    return (
        f"{saved} of the saved model come from all {d['samples']:,} samples; tables and errors shown here from "
        f"{d['of']:,} of them"
    )


@words("end-shows-little", Severity.WARNING)
def end_shows_little(f: Finding, argument: Spelling) -> str:
    """Subject: the data. Data: share (of the deviation of the output), first, last (samples of the unseen part), moved
    (whether it is another part than the end)."""
    d = f.data
    little = f"the end of {f.subject} has {100 * d['share']:.0f} % of the output's deviation"
    if d["moved"]:
        return f"{little}, so samples {d['first']:,} to {d['last']:,} are the unseen part"
    return f"{little}, and no other part is better; give {argument('unseen')}"


@words("fitted-to-excerpt")
def fitted_to_excerpt(f: Finding, argument: Spelling) -> str:
    """Subject: the data. Data: samples (of the excerpt), of (of all data to fit), finished (the model that was then
    fitted to all of them, empty for none)."""
    d = f.data
    then = (
        f"then {d['finished']} to all"
        if d["finished"]
        else f"name a single model ({argument('models')}) to fit it to all"
    )
    return f"to save time, the models are fitted to {d['samples']:,} of {d['of']:,} samples of {f.subject}; {then}"


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


@words("error-in-region", Severity.WARNING)
def error_in_region(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: model, region, rmse, others (RMSE in the other regions), unit, samples."""
    d = f.data
    here, others = (with_unit(f"{d[which]:.4g}", d["unit"]) for which in ("rmse", "others"))
    return (
        f"{_REGIONS[d['region']]} the free run is worse than elsewhere: RMSE {here} against {others} ({d['samples']:,} "
        f"samples of {f.subject})"
    )


_REGIONS = {
    "standstill": "at standstill",
    "low speed": "at low speed",
    "reversal": "in reversals",
    "high speed": "at high speed",
}


@words("no-better-than-mean", Severity.PROBLEM)
def no_better_than_mean(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: seen."""
    return f"on {data_name(f)}, no model is better than the mean of {f.subject}"


@words("free-run-diverged", Severity.PROBLEM)
def free_run_diverged(f: Finding, argument: Spelling) -> str:
    """Data: sample, seen."""
    return f"on {data_name(f)}, the free run diverges at sample {f.data['sample']}"


@words("one-step-error-smaller")
def one_step_error_smaller(f: Finding, argument: Spelling) -> str:
    """Data: ratio."""
    ratio = f.data["ratio"]
    times = f"{ratio:,.0f}" if ratio >= 100 else f"{ratio:.3g}"
    return f"one step ahead, the MSE is {times} times smaller, as for almost any model; compare models by the free run"


@words("input-constant", Severity.WARNING)
def input_constant(f: Finding, argument: Spelling) -> str:
    """Data: inputs (name, level), seen."""
    levels = listed([f"{each['name']} is constant at {each['level']:g}" for each in f.data["inputs"]])
    return f"on {data_name(f)}, {levels}, which tests only the steady state; give other data ({argument('unseen')})"


@words("input-beyond-range", Severity.WARNING)
def input_beyond_range(f: Finding, argument: Spelling) -> str:
    """Subject: the input. Data: low, high, fitted_low, fitted_high, seen."""
    d = f.data
    return (
        f"on {data_name(f)}, {f.subject} goes from {d['low']:g} to {d['high']:g}; outside the fitted "
        f"{d['fitted_low']:g} to {d['fitted_high']:g} models extrapolate"
    )


@words("map-beyond-range", Severity.WARNING)
def map_beyond_range(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: map (None if there is one), low, high, fitted_low, fitted_high, share, seen."""
    d = f.data
    which = "its static map" if d["map"] is None else f"its static map {d['map']}"
    return (
        f"{f.subject}: {which} extrapolates in {100 * d['share']:.3g} % of the samples of {data_name(f)} "
        f"({d['low']:.4g} to {d['high']:.4g}, fitted {d['fitted_low']:.4g} to {d['fitted_high']:.4g})"
    )


sentences("""
knots-not-used warning: a {family} map has no knots, so {argument[knots]} is not used
code-never-occurs warning: {subject} never has the value {value:g}, which was given as a code; check {argument[brake]}
    and {argument[coast]}
datasheet-not-used warning: the datasheet has no parameter of this model, so it is not used
profile-failed warning: no profile of {subject}: {reason}
data-not-unseen warning: {subject} contains data of the fit, so errors on it say nothing about unseen data
unstable-in-loop problem: the plant is unstable without its controller (a pole of {pole:.3g} per sample), so models
    are ranked by predictions {horizon} samples ahead, not by free runs
input-explains-nothing problem: the input explains nothing of {subject}: {by} simulates it as well with the input
    shuffled, or with its mean instead; check that the columns belong together
worse-than-mean problem: on {subject}, the free run is no better than the mean of the output; check units, sample time
    and changes of the drive
""")
