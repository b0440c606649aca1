"""What an identification is asked for: data divided into what is fitted and what is unseen, models, and how to fit.

The records of `identify`, given as records or as paths of files.

Checks of the requested models and options before anything is fitted.

A request that no model can meet is an error; a request that some models cannot meet is a finding.

The delay that all models are given, where the data show a long one.

Plants that are unstable without their controller: a free run cannot rank models of them.

A magnet that levitates, or a pendulum that is held upright, is recorded in a loop. A right model of it predicts the
next samples well and its free run grows without bound, as the inputs of the record hold the real plant and not the
model. A stable model does not, and may even have another sign of the gain: the controller moves the input against the
output.

The sign of such a plant is a pole outside the unit circle in a regression one step ahead, from every quarter of the
record. Noise may move a pole out a little, as that of a position at 1; so it counts only if an error would grow by
`RUNAWAY` over a quarter. Where the input repeats itself, or moves the output within its row, such a regression has
other solutions; so a plant that the simulated response of a simple stable system explains is not one of these. Models
are then ranked by their predictions over the samples in which an error grows by the factor e.

Long records: models are compared with fits to an excerpt, and the recommended one is then fitted to all samples.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import combinations
from math import ceil, inf, log
from typing import Any, TypeVar

import numpy as np

from emsid.arguments import as_names_with_commas, did_you_mean
from emsid.errors import DataError, EmsidError, ModelError
from emsid.estimation.linear.least_squares import check_sizes, least_squares
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.findings import Finding
from emsid.first_look.baseline import middle
from emsid.first_look.data_advice import questions
from emsid.first_look.examined import Response, response_of
from emsid.first_look.faults import without_faults
from emsid.first_look.levels import PART
from emsid.first_look.responses import answers
from emsid.first_look.stops import without_stops
from emsid.identification.candidates import (
    CANDIDATES,
    Physical,
    left_out,
    lift_an_arm,
    of_one_output,
    quick_for,
    usual_for,
    with_unit_of_name,
)
from emsid.io.reading import common_step, parsed_file, read, read_columns
from emsid.models.free_run import RUNAWAY
from emsid.models.plants.datasheet import Given, applicable, as_datasheet, without_tolerances
from emsid.models.plants.grey_box import assumptions
from emsid.models.plants.parameters import find_handle, full_name, parts, without_overlap
from emsid.models.plants.plant import Plant
from emsid.models.regression.free_run_fit import fit_free_run
from emsid.models.regression.structures import arx
from emsid.options import Options
from emsid.plant.motor import read_number
from emsid.record import Record, concatenate
from emsid.record.holding_back import FAIR, excerpt, hold_back_records, outside_excerpt, shares
from emsid.selection.improvement import matters

FEWEST, FEWEST_FITTED = 20, 10
"""With fewer samples nothing is left to test a model on after it is fitted, and too little to fit it to."""


@dataclass(frozen=True, eq=False)
class Task:
    """What an identification is asked for.

    Attributes:
        records: the given records.
        others: the records that were given as unseen data; empty where a part of `records` is kept unseen.
        record: all of `records`, joined.
        to_fit: the data that are not unseen.
        train: what the models are fitted to; of a long record an excerpt of `to_fit`.
        outside: the data of `to_fit` outside the excerpt; None where all of them are fitted.
        unseen: the data that no model is fitted to.
        names: of the models.
        plants: those of them that are physical, by name.
        asked: the options as they were given.
        options: the same with what the data say about a delay, and codes as values of the channel.
        transient: samples that start a free run where a segment begins in motion.
        responses: of the outputs of `records`, as far as a first look shows them.
        chosen: what was found about the delay, and about models that were left out.
        pole: of a plant that is unstable without its controller, see `unstable_pole`; else None.
    """

    records: tuple[Record, ...]
    others: tuple[Record, ...]
    record: Record
    to_fit: Record
    train: Record
    outside: Record | None
    unseen: Record
    names: tuple[str, ...]
    plants: Mapping[str, Plant]
    asked: Options
    options: Options
    transient: int | None
    responses: tuple[Response | None, ...]
    chosen: tuple[Finding, ...]
    pole: float | None = None

    @classmethod
    def of(
        cls,
        records: Records,
        unseen: Records | float,
        names: tuple[str, ...] | None,
        options: Options,
        transient: int | None,
        reading: Mapping[str, Any],
        control: Control = FREE,
        *,
        quick: bool = False,
    ) -> Task:
        """The task of `identify`, from its arguments.

        Raises:
            ModelError: for options that no model can meet.
            DataError: for records that differ in channels or sample time, too few samples, or something that is not a
                record.
        """
        several = given_records(records, reading)
        others = () if isinstance(unseen, (int, float)) else given_records(unseen, reading)
        several, others = tuple(map(without_faults, several)), tuple(map(without_faults, others))
        record = _long_enough(as_one(several))
        check_sizes(record)
        without = [] if names else of_one_output(record)
        if not names:
            known = (*options.fixed, *options.datasheet, *options.free)
            names = quick_for(record) if quick else usual_for(record, known, control)
        if lift_an_arm(names):
            several, others = tuple(map(without_stops, several)), tuple(map(without_stops, others))
            record = _long_enough(as_one(several))
        asked = understood(options, names)
        responses = tuple(map(response_of, several))
        options, about_delay = with_delay(codes_of_channel(asked, record), several, responses)
        pole = unstable_pole(record)
        if pole is not None:  # by free runs, the orders of a stable model would be chosen
            options = replace(options, na=options.na or ORDER, nb=options.nb or ORDER)
        plants = plants_of(names, options)
        check_physics(plants, names, options)
        to_fit, test = (record, as_one(others)) if others else hold_back_records(several, _fraction(unseen), as_one)
        _check_records(to_fit, test, [name for name in names if name not in plants], transient)
        train, outside = to_compare(to_fit, names)
        data = several, others, record, to_fit, train, outside, test
        return cls(*data, names, plants, asked, options, transient, responses, (*without, *about_delay), pole)

    @property
    def is_excerpt(self) -> bool:
        """Whether the models are fitted to a part of the data only."""
        return self.train is not self.to_fit

    def findings(self, *, quick: bool) -> list[Finding]:
        """What the data and the request show before any model is fitted.

        Args:
            quick: whether the usual models that take longer are left out.
        """
        return [
            *self.record.findings,
            *self._about_the_unseen_part(),
            *questions(self.records, self.responses),
            *self.chosen,
            *([] if self.pole is None else [self._in_loop(self.pole)]),
            *unused_requests(self.plants, self.names, self.asked, self.record, quick=quick),
            *(each.about(name) for name, plant in self.plants.items() for each in self._assumptions(plant)),
        ]

    def _about_the_unseen_part(self) -> list[Finding]:
        """That another part than the end is unseen, or that no part of the record is fit to be unseen."""
        size = len(self.unseen)
        if self.others or len(self.unseen.segments) > 1 or len(self.unseen) + len(self.to_fit) != len(self.record):
            return []
        share = float(shares(self.record, len(self.record) - size, len(self.record))[0])
        first = round((self.unseen.time[0] - self.record.time[0]) / self.record.dt)
        if share >= FAIR or self.record.breaks:
            return []
        moved = first + size < len(self.record)
        data = {"share": share, "first": first, "last": first + size - 1, "moved": moved}
        return [Finding("end-shows-little", self.record.name, data)]

    def _in_loop(self, pole: float) -> Finding:
        """About a plant that is unstable without its controller."""
        data = {"pole": pole, "time": self.record.dt / log(pole), "horizon": horizon_of(pole)}
        return Finding("unstable-in-loop", self.record.output_names[0], data)

    def _assumptions(self, plant: Plant) -> list[Finding]:
        """The units that are assumed of channels without one; none where the input cannot drive the plant."""
        try:
            return assumptions(plant.for_command(with_unit_of_name(self.record)), self.record)
        except ModelError:  # its fit says why
            return []


def _long_enough(record: Record) -> Record:
    """The record.

    Raises:
        DataError: where it has too few samples to fit a model and to test it.
    """
    if len(record) >= FEWEST:
        return record
    raise DataError(
        f"{record.name}: {len(record)} samples are too few to fit a model and to test it; record at least {FEWEST}",
        arguments=("rows",),
    )


def _check_records(train: Record, test: Record, discrete: Sequence[str], transient: int | None) -> None:
    """Refuse too few samples to fit, data of another sample time, and a transient that leaves no sample.

    Raises:
        DataError: naming the models, or the record.
    """
    if discrete and not np.isclose(train.dt, test.dt, rtol=1e-3, atol=0.0):
        raise DataError(
            f"{test.name} is sampled every {test.dt:g} s and {train.name} every {train.dt:g} s, so "
            f"{', '.join(discrete)} cannot be simulated on it; resample one of them, or check the unit of its times"
        )
    if len(train) < FEWEST_FITTED:
        left = f"{len(train)} sample{'s' * (len(train) != 1)} to fit; keep a smaller part unseen, or record longer"
        raise DataError(f"{test.name}, of {len(test)} samples, leaves {left}", arguments=("unseen",))
    for record in (train, test):
        longest = max(map(len, record.segments))
        if longest <= (transient or 0):
            left = f"leaves no sample for an error; the longest segment has {longest}"
            raise DataError(f"{record.name}: a transient of {transient} samples {left}", arguments=("transient",))


def _fraction(unseen: Any) -> float:
    """The fraction to keep unseen.

    Raises:
        DataError: where it is none.
    """
    if isinstance(unseen, (int, float)) and 0 < unseen < 1:
        return float(unseen)
    raise DataError(f"unseen: {unseen!r} is not a fraction between 0 and 1, nor a record", arguments=("unseen",))


Path = str | os.PathLike[str]
Records = Record | Path | Iterable[Record | Path]

NAMED = 4
"""Name at most this many records in a title; of more give the number."""

# The arguments of `emsid.read` that describe a file.
READING = tuple(name for name in read.__annotations__ if name not in ("path", "return"))


def given_records(records: Records, reading: Mapping[str, Any]) -> tuple[Record, ...]:
    """All given records, in SI; paths are read.

    Args:
        records: one record or path, or several.
        reading: arguments of `emsid.read`.

    Raises:
        DataError: for something else, a file without names of its columns, or an unknown argument of reading.
        FormatError: for a file that cannot be read.
    """
    strange = next((name for name in reading if name not in READING), None)
    if strange is not None:
        near = did_you_mean(strange, (*READING, "models", "options", "unseen", "transient", "control"))
        raise DataError(f"identify takes no {strange!r}; files are read with {', '.join(READING)}{near}")
    if isinstance(records, Record | str | os.PathLike):
        records = (records,)
    elif not isinstance(records, Iterable) or hasattr(records, "dtype"):
        raise DataError(f"a {type(records).__name__} is no record; give emsid.Record(input, output, dt=…), or a path")
    sources = tuple(records)
    reading = _with_columns(sources, reading)
    found = tuple(_record(each, reading) for each in sources)
    step = common_step(found, reading)
    return found if step is None else tuple(_record(each, {**reading, "dt": step}) for each in sources)


def _with_columns(sources: Sequence[Record | Path], reading: Mapping[str, Any]) -> Mapping[str, Any]:
    """How to read paths, with the columns that a first look is almost certain of where none are named.

    Raises:
        DataError: with the best hypotheses, where the columns are open.
        FormatError: where a file cannot be read.
    """
    paths = [each for each in sources if isinstance(each, str | os.PathLike)]
    if not paths or reading.get("input") or reading.get("output"):
        return reading
    from emsid.first_look.together import hypotheses  # its reading of files is not needed for records

    found, sure = hypotheses(paths, reading)
    if sure and len(found[0].looks) == len(paths):
        return found[0].reading
    if not found:
        return reading  # the message about missing names follows
    pairs = [f"input={each.reading['input']!r}, output={each.reading['output']!r}" for each in found]
    raise DataError(
        f"{paths[0]}: the columns are not certain; give {' or '.join(pairs)}; emsid.describe shows the evidence"
    )


def _record(given: Record | Path, reading: Mapping[str, Any]) -> Record:
    if isinstance(given, Record):
        return given.in_si()
    if not isinstance(given, str | os.PathLike):
        raise DataError(f"a {type(given).__name__} is no record; give emsid.Record(input, output, dt=…), or a path")
    missing = [name for name in ("input", "output") if name not in reading]
    if missing:
        columns = ", ".join(read_columns(given, dbc=reading.get("dbc")).series)
        raise DataError(f"{given}: name its columns with {' and '.join(missing)}; there are {columns}")
    return read(parsed_file(given, in_part=True, dbc=reading.get("dbc")), **reading)


def as_one(records: Sequence[Record]) -> Record:
    """The records joined to one, with all of their names; a single record unchanged."""
    if len(records) == 1:
        return records[0]
    names = dict.fromkeys(record.name for record in records)
    return concatenate(records, ", ".join(names) if len(names) <= NAMED else f"{len(names)} records")


T = TypeVar("T")


def model_names(models: str | Iterable[str]) -> tuple[str, ...]:
    """The names of the models, each once; a text is one name, or several with commas.

    Raises:
        ModelError: for an unknown name, or without a name.
    """
    names = tuple(dict.fromkeys(as_names_with_commas(models)))
    unknown = [str(name) for name in names if name not in CANDIDATES]
    if unknown or not names:
        what = f"no model is called {', '.join(unknown)}" if unknown else "no model is named"
        near = did_you_mean(unknown[0], CANDIDATES) if unknown else ""
        raise ModelError(f"{what}; there are {', '.join(CANDIDATES)}{near}", arguments=("models",))
    return names


def plants_of(models: Sequence[str], options: Options) -> dict[str, Plant]:
    """The plants of the physical models, before the search."""
    return {name: each.coded(options) for name in models if isinstance(each := CANDIDATES[name], Physical)}


def understood(options: Options, models: Sequence[str]) -> Options:
    """The options with full names of physical parameters and values in SI units; unknown names are unchanged.

    ``free``, ``fixed`` and ``profile`` may have symbols, ``fixed`` texts with a unit, and ``datasheet`` what
    `emsid.models.plants.datasheet.datasheet` takes.

    Raises:
        ModelError: where all the physical models refuse a value or a datasheet entry; it is the error of the first one.
    """
    plants = {name: each.plant for name in models if isinstance(each := CANDIDATES[name], Physical)}
    if not plants:
        return options

    def of_some(reading: Callable[[Plant], T]) -> T:
        problems: list[ModelError] = []
        for plant in plants.values():
            try:
                return reading(plant)
            except ModelError as problem:
                problems.append(problem)
        raise problems[0]

    def full(name: str) -> str:
        base, bracket, record = name.partition("[")  # of one record
        try:
            return of_some(lambda plant: full_name(plant, base)) + bracket + record
        except ModelError:  # `check_physics` refuses it
            return name

    def value(name: str, typed: float | str) -> float:
        name = name.partition("[")[0]
        if not any(full(name) in plant.handles for plant in plants.values()):
            return np.nan  # likewise
        return of_some(
            lambda plant: read_number(f"{plant.name} {name}", typed, find_handle(plant, name).parameter.unit)
        )

    fixed, tolerances = without_tolerances(options.fixed)
    values = {full(name): value(name, typed) for name, typed in fixed.items()}
    if len(values) < len(fixed):
        twice = next(full(a) for a, b in combinations(fixed, 2) if full(a) == full(b))
        raise ModelError(f"{twice} is given twice; leave one of them out", arguments=("fixed",))
    if wrong := [name for name, each in values.items() if np.isinf(each)]:
        raise ModelError(f"{wrong[0]}: give a finite number", arguments=("fixed",))
    sheet: Mapping[str, Any] = options.datasheet
    if not all(isinstance(each, Given) for each in sheet.values()):
        sheet = of_some(lambda plant: as_datasheet(plant, sheet))
    sheet = {**sheet, **{full(name): Given(values[full(name)], part) for name, part in tolerances.items()}}
    return replace(
        options,
        free=tuple(map(full, options.free)),
        per_record=tuple(map(full, options.per_record)),
        profile=tuple(map(full, options.profile)),
        fixed=values,
        datasheet=sheet,
    )


def check_physics(plants: Mapping[str, Plant], models: Sequence[str], options: Options) -> None:
    """Refuse options for physical parameters that none of the models has.

    Raises:
        ModelError: with the names of the parameters and the possible ones.
    """
    physical = {name: each.plant for name, each in CANDIDATES.items() if isinstance(each, Physical)}
    sheet, asked = options.datasheet, ", ".join(models)
    if sheet and not any(applicable(sheet, plant) for plant in plants.values()):
        usable = ", ".join(name for name, plant in physical.items() if applicable(sheet, plant))
        words = f"the datasheet has no parameter of {asked}; choose a model that has some of them: {usable}"
        raise ModelError(words, arguments=("models",))
    for what, names in (
        ("fixed", options.fixed),
        ("free", options.free),
        ("profiled", options.profile),
        ("estimated for each record", options.per_record),
    ):
        if names and not plants:
            raise ModelError(
                f"{', '.join(names)} cannot be {what}, because {asked} has no physical parameters; models that have "
                f"are {', '.join(physical)}",
                arguments=("models",),
            )

    def not_fixed(plant: Plant, name: str) -> tuple[str, ...]:
        return without_overlap(plant, [name], [known for known in options.fixed if known in plant.handles])

    for name in options.profile:
        owners = _owners(plants, name)
        if not any(not_fixed(owner, name) for owner in owners):
            others = ", ".join(other for other in owners[0].handles if not_fixed(owners[0], other))
            words = f"{name} is fixed, so it has no profile; {owners[0].name} also has {others}"
            raise ModelError(words, arguments=("fixed", "profile"))
        if options.free and not any({name, *parts(owner, name)} & set(options.free) for owner in owners):
            raise ModelError(
                f"{name} is not estimated, so it has no profile; add it to the free parameters, or take a profile of "
                f"one of these: {', '.join(options.free)}",
                arguments=("free", "profile"),
            )
    for name in (*options.fixed, *options.free, *options.per_record):
        _owners(plants, name)


def _owners(plants: Mapping[str, Plant], name: str) -> list[Plant]:
    """The plants that have a parameter.

    Raises:
        ModelError: where none has it.
    """
    name = name.partition("[")[0]
    owners = [plant for plant in plants.values() if name in plant.handles]
    if not owners:
        find_handle(next(iter(plants.values())), name)  # raises an error that lists the known names
    return owners


def unused_requests(
    plants: Mapping[str, Plant], models: Sequence[str], options: Options, record: Record, *, quick: bool = False
) -> list[Finding]:
    """Options that some of the models do not use, and the usual models that a quick look leaves out."""
    findings = left_out(record, models) if quick else []
    findings += [
        Finding("datasheet-not-used", name, {"model": name})
        for name, plant in plants.items()
        if options.datasheet and not applicable(options.datasheet, plant)
    ]
    findings += [
        Finding("option-not-used", option, {"models": list(models)})
        for option in options.given
        if option != "codes"  # more is said below
        and not any(option in CANDIDATES[name].uses for name in models)
    ]
    family = options.static
    if family is not None and not family.sizes and options.knots is not None:
        findings += [
            Finding("knots-not-used", name, {"model": name, "family": family.name})
            for name in models
            if "static" in CANDIDATES[name].uses
        ]
    channel = record.input_names[-1]
    values = [float(value) for value, _ in options.codes]
    present = [value for value in values if record.converted(channel, value) in record.input[:, -1]]
    findings += [Finding("code-never-occurs", channel, {"value": value}) for value in values if value not in present]
    without = [name for name in models if name not in plants] if present else []
    return findings + [Finding("codes-taken-as-commands", name, {"model": name, "values": present}) for name in without]


def codes_of_channel(options: Options, record: Record) -> Options:
    """The options with codes as values of the channel; they are given as the numbers of the file, as in a mask."""
    channel = record.input_names[-1]
    return replace(options, codes=tuple((record.converted(channel, code), state) for code, state in options.codes))


LONGEST_SEARCHED = 5
"""Delays of up to this many samples are left to the searches of the models."""
SAMPLES = 4_000
"""At most this many, from the middle of the records, show a delay."""
SHARE = 10
"""The longest delay that is looked for is this part of a record: a longer one leaves few responses to see it by."""
HIGHER = 4
"""The order of a linear model without a delay that is compared with one of second order with it."""
CHANCE = 3.84
"""Times the variance of the noise, the cost that one superfluous parameter saves by chance in 5 % (χ²)."""
QUICK: dict[str, Any] = {"max_iterations": 20, "tolerance": 0.1, "covariances": False}
"""Options of a fit that is only compared."""


def with_delay(
    options: Options, records: Sequence[Record], responses: Sequence[Response | None] = ()
) -> tuple[Options, tuple[Finding, ...]]:
    """The options with the delay that the data show, if it is long and none is given, and a finding about that.

    Args:
        options: of the models.
        records: the data; those of the first input and output are looked at.
        responses: their responses by the first look, where clear. Its delay is the shortest of those that explain as
            much: with a periodic input, one that is longer by a part of a period does.
    """
    first = records[0]
    if options.nk is not None or not first.input.shape[1] or not first.output.shape[1]:
        return options, ()
    changing = [each for each in records if np.ptp(each.input[:, 0])]  # a constant input shows no delay
    if not changing:
        return options, ()
    seen = [each.delay + each.resolution - 1 for each in responses if each is not None and each.delay is not None]
    longest = min(max(map(len, changing)) // SHARE, *seen) if seen else max(map(len, changing)) // SHARE
    delay = _shown([middle(each, SAMPLES // len(changing)) for each in changing], longest)
    if delay <= LONGEST_SEARCHED:
        return options, ()
    data = {"input": first.input_names[0], "delay": delay, "time": delay * first.dt}
    return replace(options, nk=delay, delay_from_data=True), (Finding("delay-from-data", first.output_names[0], data),)


def _shown(records: Sequence[Record], longest: int) -> int:
    """The delay that a linear model needs, in samples, up to the longest; one where it needs none.

    The error of an output-error model of second order falls with its delay as far as that of the data, and rises beyond
    it. So the best power of two is found, and the delay then by halved steps; of delays with the same error the longest
    has the fewest superfluous coefficients. A slow or a nonlinear response may only look late, and then a model
    of higher order without a delay is better. All these models have few parameters: what a nonlinear system leaves has
    so few independent errors that one parameter for every sample before the delay would always explain a part of it.
    """
    error = cache(partial(_error, records, 2))
    longest = min(longest, max(map(len, records)) // SHARE)
    best = min((1 << k for k in range(longest.bit_length())), key=error, default=1)
    step = best // 2
    while step:
        best = min((best, best + step, best - step), key=error)
        step //= 2
    same = 1 + CHANCE / sum(map(len, records))
    if not 0 < error(best) < inf:  # nothing can be fitted, or any delay fits
        return 1
    while best < longest and error(best + 1) <= same * error(best):
        best += 1
    return 1 if best <= LONGEST_SEARCHED or matters(_error(records, HIGHER, 1), error(best)) else best


def _error(records: Sequence[Record], order: int, delay: int) -> float:
    """The variance of the residual of an output-error model; infinite where none can be fitted."""
    try:
        return fit_free_run(arx(order, order, delay, 1, True), records, **QUICK).noise_variance
    except EmsidError:
        return inf


ORDER = 4
"""Past inputs and outputs of the regression: a mechanical plant with an actuator and a sensor has as many."""
QUARTERS = 4
"""The parts of the record that have to show the pole."""


def unstable_pole(record: Record) -> float | None:
    """The size of the pole outside the unit circle, the smallest of all quarters; None for a plant without one.

    Args:
        record: one input and one output.
    """
    if record.input.shape[1] != 1 or record.output.shape[1] != 1:
        return None
    segment = max(record.segments, key=len)
    size, found = len(segment) // QUARTERS, []
    for k in range(QUARTERS):
        try:
            fit = least_squares(arx(ORDER, ORDER, constant=True), segment[k * size : (k + 1) * size])
        except EmsidError:  # too short, or not excited
            return None
        poles = np.roots(fit.model.linear_part()[0])
        found.append(float(np.abs(poles).max(initial=0.0)))
    smallest = min(found)
    if smallest <= 1 or size * log(smallest) <= log(RUNAWAY):
        return None
    answer = answers(np.hstack([record.input, record.output]), [0, *record.breaks], [0]).get((0, 1))
    explained = answer is not None and answer.left < PART and not answer.integrates
    return None if explained else smallest


def horizon_of(pole: float) -> int:
    """The samples in which an error grows by the factor e, at least two."""
    return max(2, ceil(1 / log(pole)))


COMPARED, PIECES, MOST_PIECES = 24_000, 3, 8
"""The samples and pieces of the excerpt that several models are fitted to. Of several experiments one piece each,
as long as these, and at most eight pieces. From n samples the mean square error of a model with p parameters and white
noise is larger by the share p/n, so more would not change which model is best. A piece is as long as the stretch that
filters of a cascade are compared on; shorter ones led some to other minima."""


def to_compare(train: Record, names: Sequence[str]) -> tuple[Record, Record | None]:
    """The data to fit these models to: an excerpt of a long record, if there are several models to compare.

    Args:
        train: the data to fit.
        names: of the models.

    Returns:
        These data, and those outside the excerpt; None where all data are fitted.
    """
    if len(names) == 1:
        return train, None
    pieces = min(max(PIECES, len(train.segments)), MOST_PIECES)
    size = COMPARED * pieces // PIECES, pieces
    return excerpt(train, *size), outside_excerpt(train, *size)
