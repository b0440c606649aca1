"""The page of an identification: the first screen has the best model and its errors; tables and figures follow."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING, Any

from emsid.errors import listed
from emsid.estimation.borders import border, collected
from emsid.estimation.estimates import INCLUDES_ZERO
from emsid.estimation.uncertainty.intervals import HALF_WIDTH
from emsid.identification.result import Identification
from emsid.identification.verdict import NO_INPUT
from emsid.models.characteristics import Characteristic
from emsid.record import Record
from emsid.report import views
from emsid.report.document import Fact, Notice, Report, Section, Table
from emsid.report.numbers import both_directions, estimate, first_up, less_than, number, percent
from emsid.report.views import conventions as terms
from emsid.report.views.conventions import in_words
from emsid.report.views.front import front_figure, models_table, record_table, region_tables
from emsid.units import plain_unit, with_unit
from emsid.wording import Severity, Spelling, as_python, sentence, severity
from emsid.wording.lists import NOT_SHOWN, chance

if TYPE_CHECKING:
    from emsid.estimation.estimates import Estimate
    from emsid.estimation.fit import Fit
    from emsid.models.bands import Band

# Responses of this many models are drawn with bands; a free run with its band, if samples times parameters are fewer.
BANDED, BANDED_VALUES = 3, 1_000_000
VERDICTS = "Verdicts"
DRAWN, BASELINE = 3, "arx"
"""Free runs and residuals of this many of the best models and of the linear one are drawn."""
# At most this many physical parameters, values together, and notices about data and model, are on the first screen.
PARAMETERS, CHARACTERISTICS, NOTICES = 6, 8, 6


def report(result: Identification, argument: Spelling = as_python) -> Report:
    """The page of an identification; of one that was interrupted, without figures of details.

    Args:
        result: what to show.
        argument: how names of arguments are written in its findings.

    Returns:
        The page; what of it fails is left out, and a notice says so.
    """
    best = result.on_unseen.best
    with collected() as noted:
        opening = Section("")
        with border("the first figure"):
            opening = _opening(result)
        found = list[Fact]()
        with border("values on the page"):
            found += facts(result)
        sections = tuple(_sections(result, argument))
    after = next((k for k, each in enumerate(sections, 1) if each.title == VERDICTS), 0)
    limits = [each for each in (*noted, *result.verdicts, *result.findings) if severity(each) is not Severity.INFO]
    limits.sort(key=lambda each: severity(each) is not Severity.PROBLEM)
    own = [each for each in limits if each.model in ("", best.row.model)]
    first, rest = own[:NOTICES], [*own[NOTICES:], *(each for each in limits if each not in own)]
    notes = [each for each in result.findings if severity(each) is Severity.INFO]
    others = tuple(sentence(each, argument) for each in (*rest, *notes))
    more = [Section("More findings", remarks=others)] if others else []
    return Report(
        title=f"Identification of {result.record.name}",
        summary=(*(sentence(each, argument) for each in result.findings if each.code == NO_INPUT), summary(result)),
        facts=tuple(found),
        opening=opening,
        notices=tuple(Notice(sentence(each, argument), severity(each).value) for each in first),
        advice=tuple(sentence(each, argument) for each in (*result.recommendation, *result.next_steps)),
        sections=(*sections[:after], *more, *sections[after:]),
        imprint=f"emsid identify, from {result.record.name}: {in_words(result.record)}",
    )


def _opening(result: Identification) -> Section:
    """The free run of the best model."""
    best = result.on_unseen.best
    drawn = views.measured_and_simulated(best, band=_band(result), name="best-free-run")
    return Section("", terms=(terms.FREE_RUN, terms.FIT), figures=(drawn,))


def _sections(result: Identification, argument: Spelling) -> Iterator[Section]:
    """The sections that can be made."""
    parts: dict[str, Callable[[], Iterable[Section | None]]] = {
        "table of models": lambda: [which_model(result)],
        "errors by region": lambda: [where_errors_are(result)],
        "verdicts": lambda: [verdicts(result, argument)],
        "figures of free runs": lambda: () if result.interrupted else in_detail(result),
    }
    for part, make in parts.items():
        with border(f"section of the page: {part}"):
            yield from filter(None, make())
    for k, fit in enumerate(result.fits):
        name = fit.model.name
        with border(f"section of the page: {name}", name):
            yield _model(result, fit, argument, with_bands=k < BANDED)


def _model(result: Identification, fit: Fit[Any], argument: Spelling, *, with_bands: bool) -> Section:
    """The section of a model, with the bands of its responses."""
    profiles = result.profiles.get(fit.model.name, ())
    drawn = not result.interrupted
    section = views.model_section(fit, result.record, profiles=profiles, argument=argument, drawn=drawn)
    figures = views.banded(fit, result.record) if with_bands and drawn else ()
    return replace(section, figures=(*section.figures, *figures))


def _band(result: Identification) -> Band | None:
    """The band of the best free run, if it can be computed in a moment."""
    from emsid.validation.bands import free_run_band

    best = result.on_unseen.best
    large = len(best.record) * max(len(best.fit.estimate), 1) > BANDED_VALUES
    if result.interrupted or large or not best.fit.has_bands:
        return None
    with border("band of the free run", best.row.model, expected=True):
        return free_run_band(best.fit, best.record, transient=best.transient)
    return None


def summary(result: Identification) -> str:
    """The best model, the number of models, and the amount of data."""
    row, count = result.on_unseen.best.row, len(result.fits)
    place = "is recommended of" if result.is_recommended else "is not recommended, and no other is; it is the best of"
    which = (
        f"{row.model} {place} {count} models, ranked by their free runs (simulation from the input alone) on "
        f"{result.ranked_on}."
        if count > 1
        else f"{row.model} is the only model that was fitted."
    )
    fitted = f"{which} Fitted to {_samples(result)}"
    if result.on_choice is None:
        return f"{fitted}, run on {row.samples:,} of {result.ranked_on}."
    return (
        f"{fitted}, chosen on {result.on_choice.best.row.samples:,}; the errors below are on {row.samples:,} further "
        "samples that no fit and no choice has used."
    )


def _samples(result: Identification) -> str:
    """How many samples the recommended model was fitted to, and compared with others on where these are fewer."""
    for each in result.findings:
        if each.code == "fitted-to-excerpt" and each.data["finished"]:
            return f"{each.data['of']:,} samples after a comparison of fits to {each.data['samples']:,}"
    return f"{len(result.record):,} samples"


def facts(result: Identification) -> list[Fact]:
    """The best model, its errors, its characteristics and the verdict on its residual."""
    best, unit = result.on_unseen.best, plain_unit(_unit(result))
    errors = best.row.outputs or (best.row,)
    found = [
        Fact(best.row.model, "recommended model" if result.is_recommended else "best model; none is recommended"),
        Fact(percent(best.row.fit_percent), f"fit of its free run on {result.ranked_on}"),
    ]
    if isfinite(best.row.simulation_rmse) and len(errors) == 1:
        found.append(Fact(with_unit(number(best.row.simulation_rmse), unit), "RMSE of that free run"))
    found += values(result)
    for each in result.verdicts:
        of = f" of {each.data['output']}" if len(errors) > 1 else ""
        share = each.data.get("share")
        value = "not tested" if share is None else f"{100 * share:.0f} %" if share >= 0.01 else "< 1 %"
        meaning = (
            f"residual{of} against the input"
            if share is None
            else f"of the variance of the residual{of} is predictable from the input"
        )
        found.append(Fact(value, meaning))
    return found


def values(result: Identification) -> list[Fact]:
    """The physical parameters of a recommended plant, then characteristics, as far as they have room.

    Sensor and drive come last. A value that is equal forward and backward stands there once.
    """
    best = result.chosen.model.name
    plant = [
        _parameter(row) for row in sorted(result.known, key=lambda row: row.name.startswith(("sensor.", "drive.")))
    ]
    plant = _once(plant)[:PARAMETERS]
    drive = _once([_fact(each, best) for each in result.characteristics])
    assumed = [
        Fact(with_unit(number(row.value), row.unit), f"{first_up(row.description)}, assumed, not measured")
        for row in result.chosen.assumed
    ]
    return [*plant, *drive[: CHARACTERISTICS - len(plant)], *assumed]


def _parameter(row: Estimate) -> Fact:
    """A physical parameter with its interval."""
    meaning = f"{first_up(row.description)}{f', given {listed(row.given)}' if row.given else ''}"
    if row.standard_error is None and row.interval is not None:
        low, high = (number(each) for each in row.interval)
        return Fact(with_unit(number(row.value), row.unit), meaning, f"{low} to {high}")
    half = HALF_WIDTH * (row.standard_error or 0.0)
    return Fact(with_unit(estimate(row.value, half), row.unit), meaning, half_interval(half))


def half_interval(half: float) -> str:
    """Half an interval with two digits."""
    return f"± {number(float(f'{half:.2g}'))}"


def _once(facts: Sequence[Fact]) -> list[Fact]:
    """The facts, with those that are equal forward and backward joined."""
    rows = both_directions((each.meaning, each.value, each.interval) for each in facts)
    return [Fact(value, meaning, interval) for meaning, value, interval in rows]


def _fact(each: Characteristic, best: str) -> Fact:
    """A characteristic with its interval, and its model if that is not the best one."""
    by = "" if each.model == best else f", by {each.model}"
    meaning = f"{first_up(each.name)}{by}" + f", given {', '.join(each.given)}" * bool(each.given)
    if not each.shown:
        return Fact("unknown", meaning, NOT_SHOWN)
    if each.half_width is None:
        return Fact(with_unit(number(each.value), each.unit), meaning, "interval unknown")
    if bound := less_than(each.value, each.half_width):
        return Fact(with_unit(bound, each.unit), meaning, INCLUDES_ZERO)
    value = estimate(each.value, each.half_width)
    return Fact(with_unit(value, each.unit), meaning, half_interval(each.half_width))


def which_model(result: Identification) -> Section:
    """All models in one table, with their errors in a picture and against their number of parameters."""
    drawn = front_figure(result.front)
    return Section(
        "Which model",
        terms=(terms.ONE_STEP,),
        tables=(models_table(result),),
        figures=(views.ranking(result.on_choice or result.on_unseen), *([] if drawn is None else [drawn])),
    )


def where_errors_are(result: Identification) -> Section | None:
    """Errors by operating region and by record; None where there are neither."""
    tables = (
        *region_tables(result.by_region, f"on {result.ranked_on}"),
        *([record_table(result.by_record)] if result.by_record else []),
    )
    return Section("Regions and records", tables=tables) if tables else None


def verdicts(result: Identification, argument: Spelling) -> Section:
    """The verdict on every model, and its residual tests."""
    rows = [
        (
            each.model,
            *_tested(each.data["tests"], "past-inputs"),
            *_tested(each.data["tests"], "nonlinear-term"),
            _p_values(each.data["tests"], "past-inputs"),
            _p_values(each.data["tests"], "whiteness"),
        )
        for each in result.model_verdicts
    ]
    head = ("Model", "Past inputs", "99 % limit", "Nonlinear terms", "99 % limit", "Portmanteau p", "Whiteness p")
    note = (
        "Largest correlation of the residual with past inputs, and with nonlinear functions of them, in standard "
        "deviations; 99 of 100 independent residuals stay below the limit. Portmanteau: the chance of all correlations "
        "with past inputs as large together as these. Whiteness: of one-step errors (Ljung–Box), for models of noise."
    )
    remarks = tuple(sentence(each, argument) for each in result.model_verdicts)
    tested = any(each.data["tests"] for each in result.model_verdicts)
    table = Table(head, tuple(rows), f"Residual tests on {result.unseen.name}.", note)
    return Section(VERDICTS, tables=(table,) if tested else (), remarks=remarks)


def _tested(tests: Sequence[Mapping[str, Any]], kind: str) -> tuple[str, str]:
    """The worst test of a kind and its limit."""
    of_kind = [each for each in tests if each["test"] == kind]
    if not of_kind:
        return "–", "–"
    worst = max(of_kind, key=lambda each: abs(each["largest"]) / each["limit"])
    return f"{worst['largest']:.1f}", f"{worst['limit']:.1f}"


def _p_values(tests: Sequence[Mapping[str, Any]], kind: str) -> str:
    """The smallest chance of the tests of a kind."""
    found = [each["p_value"] for each in tests if each["test"] == kind]
    return chance(min(found)).removeprefix("= ") if found else "–"


def in_detail(result: Identification) -> tuple[Section, Section]:
    """The free runs of the best models with their residuals, and the data."""
    best = result.on_unseen.assessments[:DRAWN]
    baseline = [each for each in result.on_unseen.assessments if each.row.model == BASELINE]
    linear_first = [*baseline, *(each for each in best if each not in baseline)]
    intervals = views.critical_intervals(
        result.unseen, _stretch(result.unseen), result.unseen.output - linear_first[0].simulation.output
    )
    runs = Section(
        f"Free runs on {result.ranked_on}",
        figures=(
            views.responses(linear_first, intervals),
            views.residuals(linear_first),
            *(each for each in (views.nonlinear_correlations(linear_first),) if each is not None),
        ),
    )
    return runs, Section("The data", figures=(views.inputs((result.record, result.unseen)),))


def _unit(result: Identification) -> str:
    """The unit of the first output."""
    return views.channel_axis(result.unseen.output_names[0], result.unseen.output_units[0]).unit


def _stretch(record: Record) -> float:
    """How many seconds of a record a figure of details shows: a tenth, but at least 50 samples."""
    return max(len(record) // 10, 50) * record.dt
