"""The page of an identification: the verdict, the free run on unseen data, values; then tables and figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from emsid.errors import listed
from emsid.estimation.borders import border, collected
from emsid.estimation.estimates import HALF_WIDTH, INCLUDES_ZERO
from emsid.identification.result import Identification
from emsid.identification.verdict import NO_INPUT
from emsid.models.characteristics import Characteristic
from emsid.record import Record
from emsid.record.channels import ChannelNames
from emsid.report import views
from emsid.report.document import Fact, Notice, Report, Section, Table
from emsid.report.numbers import both_directions, estimate, first_up, less_than, number
from emsid.report.views import conventions as terms
from emsid.report.views.conventions import in_words
from emsid.report.views.front import correlation_table, front_figure, models_table, record_table, region_tables
from emsid.units import with_unit
from emsid.wording import Severity, Spelling, as_python, sentence, severity
from emsid.wording.first_screen import other_reasons
from emsid.wording.lists import NOT_SHOWN, chance

if TYPE_CHECKING:
    from emsid.estimation.estimates import Estimate
    from emsid.estimation.fit import Fit
    from emsid.models.bands import Band
    from emsid.validation.comparison import Assessment

# Curves at rest of this many models have bands; a free run has its band, if samples times parameters are fewer.
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
            found += values(result)
        sections = tuple(_sections(result, argument))
    after = next((k for k, each in enumerate(sections, 1) if each.title == VERDICTS), 0)
    limits = [each for each in (*noted, *result.verdicts, *result.findings) if severity(each) is not Severity.INFO]
    limits.sort(key=lambda each: severity(each) is not Severity.PROBLEM)
    own = [each for each in limits if each.model in ("", best.row.model)]
    verdict = result.model_verdicts[0]
    said = {reason["code"] for reason in verdict.data["reasons"]}
    own = [each for each in own if each.code not in said and each is not verdict]
    first, rest = own[:NOTICES], [*own[NOTICES:], *(each for each in limits if each.model not in ("", best.row.model))]
    notes = [each for each in result.findings if severity(each) is Severity.INFO]
    others = tuple(sentence(each, argument) for each in (*rest, *notes))
    more = [Section("More findings", remarks=others)] if others else []
    return Report(
        title=f"Identification of {result.record.name}",
        summary=(
            *(sentence(each, argument) for each in result.findings if each.code == NO_INPUT),
            sentence(result.recommendation[0], argument),
            summary(result, argument),
        ),
        facts=tuple(found),
        opening=opening,
        notices=(
            *(Notice(first_up(reason), Severity.WARNING.value) for reason in other_reasons(verdict)),
            *(Notice(sentence(each, argument), severity(each).value) for each in first),
        ),
        advice=tuple(sentence(each, argument) for each in (*result.recommendation[1:], *result.next_steps)),
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
        "responses of the models": lambda: () if result.interrupted else [responses(result)],
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
    """The section of a model; of the best ones with the correlations of the estimates, static map and friction."""
    profiles = result.profiles.get(fit.model.name, ())
    drawn = not result.interrupted
    section = views.model_section(fit, result.record, profiles=profiles, argument=argument, drawn=drawn)
    if not with_bands:
        return section
    correlations = correlation_table(fit)
    return replace(
        section,
        tables=(*section.tables, *filter(None, [correlations])),
        figures=(*section.figures, *(views.banded(fit, result.record) if drawn else ())),
    )


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


def summary(result: Identification, argument: Spelling = as_python) -> str:
    """How good the best model is, and how that was tested: on which samples, beside how many models, its residual."""
    row, others = result.on_unseen.best.row, len(result.fits) - 1
    found = [sentence(each, argument) for each in result.findings if each.code == "free-run-error"]
    beside = f", beside {others} other model{'s' * (others > 1)}" if others else ""
    chosen = "" if result.on_choice is None else f", chosen on {result.on_choice.best.row.samples:,}"
    kind = " that no fit and no choice has used" * (not result.seen)
    tested = (
        f"Tested in free run (simulation from the input alone){beside}: fitted to {_samples(result)}{chosen}, run on "
        f"{row.samples:,}{kind}."
    )
    return " ".join((*found, tested, *(sentence(each, argument) for each in result.verdicts)))


def _samples(result: Identification) -> str:
    """How many samples the recommended model was fitted to, and compared with others on where these are fewer."""
    for each in result.findings:
        if each.code == "fitted-to-excerpt" and each.data["finished"]:
            return f"{each.data['of']:,} samples after a comparison of fits to {each.data['samples']:,}"
    return f"{len(result.record):,} samples"


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


def responses(result: Identification) -> Section:
    """Step and frequency responses and poles of the linear and the best models, with the response of the data."""
    from emsid.report.views.analysis import model_figures
    from emsid.validation.bands import usual_step

    record = result.record
    fits = [replace(each.fit, channels=ChannelNames.of(record)) for each in _drawn(result)]
    return Section("Responses", figures=model_figures(fits, [usual_step(u) for u in record.input.T], record))


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
    linear_first = _drawn(result)
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


def _drawn(result: Identification) -> list[Assessment]:
    """The linear model and the best ones."""
    best = result.on_unseen.assessments[:DRAWN]
    baseline = [each for each in result.on_unseen.assessments if each.row.model == BASELINE]
    return [*baseline, *(each for each in best if each not in baseline)]


def _stretch(record: Record) -> float:
    """How many seconds of a record a figure of details shows: a tenth, but at least 50 samples."""
    return max(len(record) // 10, 50) * record.dt
