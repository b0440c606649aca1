"""From a record to a ranked list of models: what `emsid identify` does.

Every one of the `candidates` asked for is fitted to what may be seen; the ranking is by free run on data that none of
them has seen in any step.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from emsid.arguments import as_names_with_commas, did_you_mean
from emsid.errors import DataError, EmsidError, ModelError
from emsid.estimation.fit import Ending, Fit
from emsid.identification.candidates import CANDIDATES, USUAL, Blocks, Options, Physical, Progress, fit_or_problem
from emsid.identification.records import Records, given_records
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.diagnostics import advice
from emsid.models.plants.datasheet import applicable
from emsid.models.plants.grey_box import assumptions
from emsid.models.plants.parameters import find_handle, parts, without_overlap
from emsid.models.plants.plant import DrivenPlant
from emsid.models.plants.search.diagnostics import Profile, likelihood_profile
from emsid.models.plants.search.result import GreyBoxFit
from emsid.presentation import Presented
from emsid.record import Record, concatenate
from emsid.units import with_unit
from emsid.validation.agreement import disagreement
from emsid.validation.comparison import Comparison, compare
from emsid.wording import sentence

if TYPE_CHECKING:
    from emsid.report.document import Report

# More records than so many are counted, not named.
NAMED = 4

# An input that leaves the range identified from by more than this part of it asks models for a guess.
BEYOND = 0.1


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Presented):
    """What came out.

    Attributes:
        record: what the models were fitted to.
        unseen: what they were ranked on.
        identification: the models on `record`.
        verification: the models on `unseen`, the best free run first.
        failed: for every candidate that could not be fitted, why.
        profiles: likelihood profiles of physical parameters, by model.
        asides: what else is to be said of a wish that could not be met, in sentences.
        interrupted: whether the user stopped it before all candidates were done.
    """

    record: Record
    unseen: Record
    identification: Comparison
    verification: Comparison
    failed: Mapping[str, str]
    profiles: Mapping[str, tuple[Profile, ...]] = field(default_factory=dict)
    asides: tuple[str, ...] = ()
    interrupted: bool = False

    def __repr__(self) -> str:
        best = self.chosen.model.name[:40]
        return f"Identification({len(self.verification.fits)} models on {self.judged_on}; best {best})"

    @property
    def seen(self) -> bool:
        """Whether a record to judge by is one of those identified from."""
        known = self.record.segments
        return any(
            len(one) == len(other)
            and np.array_equal(one.input, other.input)
            and np.array_equal(one.output, other.output)
            for one in self.unseen.segments
            for other in known
        )

    @property
    def judged_on(self) -> str:
        """What the models were ranked on, for titles and sentences."""
        return "data identified from" if self.seen else "unseen data"

    @property
    def chosen(self) -> Fit[Any]:
        """The model with the best free run on unseen data."""
        return self.verification.best.fit

    def to_data(self) -> dict[str, Any]:
        """What ``result.json`` holds."""
        rows = (*self.identification.rows, *self.verification.rows)
        return {
            "schema": 1,
            "rows": [row.to_data() for row in rows],
            "chosen": self.chosen.model.name,
            "profiles": [{"model": name} | each.to_data() for name, some in self.profiles.items() for each in some],
            "remarks": remarks(self),
        }


def identify(
    records: Records,
    validation: Records | None = None,
    *,
    models: str | Sequence[str] = USUAL,
    options: Options | None = None,
    transient: int | None = None,
    unseen: float = 0.3,
    progress: Progress = lambda what, fraction: None,
    **reading: Any,
) -> Identification:
    """Fit the candidate structures and rank them by their free run on unseen data.

    Args:
        records: what to identify from: a record, the path of a file, or several of either.
        validation: unseen data; without it, the last part of ``records`` is kept unseen, or of many every k-th.
        models: names of `CANDIDATES`; one name, several with commas, or a list.
        options: what the user fixes.
        transient: samples at the start of every segment that start a free run and are left out of every error.
        unseen: the fraction of ``records`` kept unseen where there is no validation data.
        progress: called with the candidate at work and the fraction done of it.
        reading: where paths are given, how to read them: ``input``, ``output``, ``time`` and the other arguments of
            `emsid.read`.

    Raises:
        ModelError: for an unknown name, wishes that no candidate can meet, or where no candidate can be fitted.
        DataError: for records that do not belong together.
    """
    options = options or Options()
    models = as_names_with_commas(models)
    records, judges = given_records(records, reading), given_records(() if validation is None else validation, reading)
    unknown = [name for name in models if name not in CANDIDATES]
    if unknown or not models:
        near = did_you_mean(unknown[0], CANDIDATES) if unknown else ""
        raise ModelError(f"no model {', '.join(unknown) or 'is named'}; there are {', '.join(CANDIDATES)}{near}")
    plants = {name: each.coded(options) for name in models if isinstance(each := CANDIDATES[name], Physical)}
    asides = _check_physics(plants, models, options) + [
        f"{option} was given and is not used by {', '.join(dict.fromkeys(models))}."
        for option in options.given
        if not any(option in CANDIDATES[name].uses for name in models)
    ]
    if options.static is not None and not options.static.sizes and options.knots is not None:
        asides += [
            f"{name}: a map of the family {options.static.name} has no knots; knots was set aside for it."
            for name in dict.fromkeys(models)
            if isinstance(CANDIDATES[name], Blocks)
        ]
    several = records
    record = _one(several)
    asides += [sentence(each) for plant in plants.values() for each in assumptions(plant, record)]
    if options.codes:
        absent = [f"{code:g}" for code, _ in options.codes if code not in record.input[:, -1]]
        asides += [
            f"{code} is a code that {record.input_names[-1]} never has: check --brake and --coast." for code in absent
        ]
        values = ", ".join(f"{code:g}" for code, _ in options.codes)
        asides += [
            f"{name}: takes the codes {values} for commands; leave these samples out for it (--mask)."
            for name in dict.fromkeys(models)
            if name not in plants
        ]
    train, test = (record, _one(judges)) if judges else _set_apart(several, unseen)
    timeless = [name for name in dict.fromkeys(models) if name not in plants]
    if timeless and not np.isclose(train.dt, test.dt, rtol=1e-3, atol=0.0):
        raise DataError(
            f"{test.name} is sampled every {test.dt:g} s and {train.name} every {train.dt:g} s, so it cannot judge "
            f"{', '.join(timeless)}; resample one of them, or check the unit of its times"
        )
    fits: list[Fit[Any]] = []
    failed: dict[str, EmsidError] = {}
    interrupted = False
    for name in dict.fromkeys(models):
        try:
            fits.append(fit_or_problem(partial(CANDIDATES[name], train, options, partial(progress, name))))
            interrupted = fits[-1].ending is Ending.INTERRUPTED
            progress(name, 1.0)
        except KeyboardInterrupt:
            interrupted = True
        except EmsidError as problem:
            failed[name] = problem
        if interrupted:
            break
    if not fits:
        if failed:
            raise next(iter(failed.values()))
        raise KeyboardInterrupt
    asides += [sentence for fit in fits for sentence in _held(fit, options)]
    profiles, missing, stopped = _profiles(fits, () if interrupted else options.profile, progress)
    judged: list[Comparison] = []
    for data, words in ((train, "identification"), (test, "verification")):
        try:
            judged.append(compare(fits, data, transient, data=words))
        except KeyboardInterrupt:  # what has been found is judged all the same
            stopped = True
            judged.append(compare(fits, data, transient, data=words))
    if not (interrupted or stopped):
        asides += _disagreements(judged[1], (*several, *judges))
    return Identification(
        train,
        test,
        judged[0],
        judged[1],
        {name: str(problem) for name, problem in failed.items()},
        profiles,
        (*asides, *missing),
        interrupted or stopped,
    )


def _check_physics(plants: Mapping[str, DrivenPlant], models: Sequence[str], options: Options) -> list[str]:
    """Which models a datasheet is set aside for, in sentences.

    Raises:
        ModelError: for what is said or asked of physical parameters that none of the models has.
    """
    sheet = options.datasheet
    with_sheet = [name for name, plant in plants.items() if applicable(sheet, plant)]
    if sheet and not with_sheet:
        usable = [n for n, each in CANDIDATES.items() if isinstance(each, Physical) and applicable(sheet, each.plant)]
        raise ModelError(
            f"the datasheet says nothing of {', '.join(models)}; choose a model that it is for: {', '.join(usable)}"
        )
    asked = {"fixed": options.fix, "free": options.free, "profiled": options.profile}
    if any(asked.values()) and not plants:
        what, names = next((what, names) for what, names in asked.items() if names)
        usable = [name for name, each in CANDIDATES.items() if isinstance(each, Physical)]
        raise ModelError(
            f"{', '.join(names)} cannot be {what}, because {', '.join(models)} has no physical parameters; models that "
            f"have are {', '.join(usable)}"
        )

    def open_names(plant: DrivenPlant, names: Iterable[str]) -> tuple[str, ...]:
        return without_overlap(plant, names, [name for name in options.fix if name in plant.handles])

    def owners_of(name: str) -> list[DrivenPlant]:
        owners = [plant for plant in plants.values() if name in plant.handles]
        if not owners:
            find_handle(next(iter(plants.values())), name)  # says so
        return owners

    for name in options.profile:
        owners = owners_of(name)
        if not any(open_names(owner, [name]) for owner in owners):
            others = [other for other in owners[0].handles if open_names(owners[0], [other])]
            raise ModelError(f"{name} is fixed, so it has no profile; {owners[0].name} also has {', '.join(others)}")
        if options.free and not any({name, *parts(owner, name)} & set(options.free) for owner in owners):
            raise ModelError(
                f"{name} is not free, so it has no profile; free are {', '.join(options.free)}: add it, or take a "
                "profile of one of these"
            )
    for name in (*options.fix, *options.free):
        owners_of(name)
    return [
        f"{name}: the datasheet says nothing of this model and was set aside for it."
        for name in plants
        if sheet and name not in with_sheet
    ]


def _held(fit: Fit[Any], options: Options) -> list[str]:
    """What a plant usually has unknown and a choice of what is free has left as it is built in, in a sentence."""
    if not (options.free and isinstance(fit, GreyBoxFit)):
        return []
    plant = fit.model.plant
    given = (name for name, each in applicable(options.datasheet, plant).items() if each.value is not None)
    taken = [name for name in (*options.free, *options.fix, *given) if name in plant.handles]
    names = [name for name in without_overlap(plant, plant.usual, taken) if plant.value(name)]
    values = ", ".join(f"{name} {plant.handles[name].with_unit(plant.value(name))}" for name in names)
    return [f"{fit.model.name}: held at what is built in: {values}; give --fix or --datasheet."] * bool(names)


def _profiles(
    fits: Sequence[Fit[Any]], names: Sequence[str], progress: Progress
) -> tuple[dict[str, tuple[Profile, ...]], list[str], bool]:
    """The profiles that can be taken, by model; in sentences why others cannot; whether the user stopped it.

    Where a parameter was split by direction, both of its parts are meant.
    """
    taken: dict[str, tuple[Profile, ...]] = {}
    missing: list[str] = []
    for fit in fits:
        if not isinstance(fit, GreyBoxFit):
            continue
        model, plant = fit.model.name, fit.model.plant
        asked = [name for name in names if name in plant.handles]
        split = {name: [part for part in parts(plant, name) if part in fit.names] for name in asked}
        for name in dict.fromkeys(one for whole in asked for one in split[whole] or [whole]):
            try:
                profile = likelihood_profile(fit, name, progress=partial(progress, f"{model}: {name}"))
                taken[model] = (*taken.get(model, ()), profile)
            except KeyboardInterrupt:
                return taken, missing, True
            except EmsidError as problem:
                missing.append(f"{model}: no profile of {name}: {problem}.")
    return taken, missing, False


def remarks(result: Identification) -> list[str]:
    """What a user should know about the result, in sentences that follow from it."""
    best, unit = result.verification.best.row, result.unseen.output_units[0]
    sentences = []
    if result.seen:
        sentences.append(
            f"{result.unseen.name} is among what was identified from: these errors say nothing of unseen data."
        )
    if np.isfinite(best.simulation_mse) and best.outputs:
        each_output = "; ".join(each.error_in_words for each in best.outputs)
        sentences.append(f"{best.model}: on {result.judged_on}, the RMSE of the free run is {each_output}.")
    elif np.isfinite(best.simulation_mse):
        sentences.append(
            f"{best.model}: on {result.judged_on}, the free run has {best.fit_in_words}; its RMSE is "
            f"{with_unit(f'{best.simulation_rmse:.4g}', unit)}."
        )
        if best.fit_percent <= 0:
            sentences.append(
                f"No model is better on {result.judged_on} than the mean of {result.unseen.output_names[0]}."
            )
    sentences += _beyond(result)
    if 0 < 2 * best.one_step_mse < best.simulation_mse < np.inf:
        sentences.append(
            f"{best.model}: one step ahead its MSE is {best.simulation_mse / best.one_step_mse:,.3g} times smaller; "
            "that is what any model finds easy."
        )
    sentences += [
        f"{row.model}: the free run diverges at sample {row.diverged_at} of the {result.judged_on}."
        for row in result.verification.rows
        if row.diverged_at is not None
    ]
    for fit in result.verification.fits:
        words = (
            [*fit.words, fit.ended]
            if isinstance(fit, GreyBoxFit)
            else [fit.message, *(sentence(each) for each in fit.findings)]
        )
        words += advice(fit, result.record) if isinstance(fit.model, Cascade) else []
        sentences += [f"{fit.model.name}: {each.rstrip('.')}." for each in words if each]
    sentences += [
        f"{name}: the profile of {each.name} has its {100 * each.level:g} % interval {each.in_words}."
        for name, profiles in result.profiles.items()
        for each in profiles
    ]
    sentences += [
        f"{name} could not be fitted: {why.removeprefix(f'{name}: ')}." for name, why in result.failed.items()
    ]
    return [*sentences, *result.asides]


def _beyond(result: Identification) -> list[str]:
    """What unseen data cannot judge, or ask of models that have seen nothing like it, in sentences."""
    u = result.unseen.input
    if np.all(np.ptp(u, axis=0) == 0):
        levels = " and ".join(
            f"{name} is {level:g}" for name, level in zip(result.unseen.input_names, u[0], strict=True)
        )
        return [
            f"{levels} throughout the {result.judged_on}, which tell no more than where a model comes to rest: judge "
            "on data in which it changes (--validate, --unseen)."
        ]
    sentences = []
    for name, new, known in zip(result.unseen.input_names, u.T, result.record.input.T, strict=True):
        slack = BEYOND * np.ptp(known)
        if new.min() < known.min() - slack or new.max() > known.max() + slack:
            sentences.append(
                f"{name} goes from {new.min():g} to {new.max():g} in the {result.judged_on}, and from {known.min():g} "
                f"to {known.max():g} in what was identified from: beyond that, models guess."
            )
    return sentences


def _disagreements(comparison: Comparison, records: Sequence[Record]) -> list[str]:
    """What the records disagree in, in words of the best model that shows it."""
    try:
        found = (disagreement(fit.model, records) for fit in comparison.fits)
        return [each.in_words for each in found if each][:1]
    except KeyboardInterrupt:  # all that matters is known
        return []


def _set_apart(records: Sequence[Record], unseen: float) -> tuple[Record, Record]:
    """What to identify from, and about this fraction of it that is kept unseen.

    Of a series, such as steps of ascending height, it is every k-th record: the last part would be another experiment.
    """
    k = round(1 / unseen)
    if k < 2 or len(records) < 2 * k:
        whole = _one(records)
        train, rest = whole.split(1 - unseen)
        return train, replace(rest, name=f"{whole.name}, unseen part")
    test = _one(records[k - 1 :: k])
    train = _one([record for number, record in enumerate(records, 1) if number % k])
    return train, replace(test, name=f"one in {k} of {len(records)} records")


def _one(records: Record | Iterable[Record]) -> Record:
    """The records as one, which is called by all of their names."""
    if isinstance(records, Record):
        return records
    several = tuple(records)
    names = dict.fromkeys(record.name for record in several)
    return concatenate(several, ", ".join(names) if len(names) <= NAMED else f"{len(names)} records")


def report(result: Identification) -> Report:
    """What a page says about the result."""
    from emsid.report import views
    from emsid.report.document import Fact, Report, Section
    from emsid.report.numbers import percent

    best, unit = result.verification.best, result.unseen.output_units[0]
    linear_first = sorted(result.verification.assessments, key=lambda each: each.row.model != "arx")
    intervals = views.critical_intervals(
        result.unseen, _stretch(result.unseen), result.unseen.output - linear_first[0].simulation.output
    )
    return Report(
        title=f"Identification of {result.record.name}",
        summary=tuple(remarks(result)),
        facts=(
            Fact(best.row.model, "the best of the models in free run"),
            Fact(percent(best.row.fit_percent), f"fit of its free run on {result.judged_on}"),
            Fact(f"{len(result.record):,}", "samples to identify from"),
            Fact(f"{best.row.samples:,}", "samples to judge by"),
        ),
        sections=(
            Section(
                "Which model",
                tables=(
                    views.results_table(
                        result.verification.rows, unit=unit, caption=f"On {result.judged_on}, {result.unseen.name}."
                    ),
                    views.results_table(result.identification.rows, unit=unit, caption="On the data identified from."),
                ),
                figures=(views.ranking(result.verification),),
            ),
            Section(
                f"Free run on {result.judged_on}",
                figures=(
                    views.measured_and_simulated(best),
                    views.responses(linear_first, intervals),
                    views.residuals(linear_first),
                ),
            ),
            Section("What it was identified from", figures=(views.inputs((result.record, result.unseen)),)),
            *(
                views.model_section(fit, result.record, profiles=result.profiles.get(fit.model.name, ()))
                for fit in result.verification.fits
            ),
        ),
        imprint=f"emsid, from {result.record}",
    )


def _stretch(record: Record) -> float:
    """How many seconds of a record a figure of details shows: a tenth, but at least 50 samples."""
    return max(len(record) // 10, 50) * record.dt
