"""Identification of Wiener–Hammerstein models and related cascades without start values.

`wiener_hammerstein`, `hammerstein`, `wiener` and `hammerstein_wiener` make a `CascadeStructure`, which is fitted to
records. Options that are not given are chosen on unseen data (`cross_validation`):

1. the measured frequency response gives the orders to try and the input delay (`orders`);
2. pairs of filters are started (`starts`), the best are refined and compared, then the static map between them and
   its size are chosen (`choice`);
3. the best model is fitted to all identification data (`fitting`), and its dead time is counted at its input.

**Periodic inputs.** The search works on one period of every segment in steady state, averaged over all. For the last
fit, samples of the end of the period are put ahead of it: after them the free run is in steady state too, so no initial
state is estimated. The same steady state follows without samples ahead from a product of spectra for each filter,
between which the map acts in time. A prototype of that form for filters of third order and periods of 4,096 and 16,384
samples gave the same output within 2e-6 of its standard deviation, and its derivatives took 0.6 to 1.1 times as long:
127 samples are put ahead, and the map is evaluated in time in both. So there is no second form.

**Dead time.** A dead time passes through a static map unchanged, f(x(t − 1)) = f(x)(t − 1), so no data show which
filter of a cascade it belongs to. In a search it lands in either, as a leading coefficient b₀ of zero. Where b₀ of a
filter is zero within `ZERO` standard errors, the coefficient is removed and the delay of the cascade is a sample
longer. This is kept if Schwarz's criterion does not prefer the model before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import log
from typing import Any, TypedDict, Unpack

import numpy as np

from emsid.arguments import did_you_mean
from emsid.errors import EmsidError, ModelError, listed
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.linear.least_squares import check_excitation
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.estimation.nonlinear.problem import SQUARES, Loss
from emsid.estimation.threads import cores, one_blas_thread
from emsid.excitation.periods import averaged, period_of
from emsid.findings import Finding
from emsid.models.blocks.cascade import SAMPLES_PER_STATE, Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import Search, conclude, fit_cascade
from emsid.models.blocks.search.choice import Task, improving, with_spread_knots
from emsid.models.blocks.search.cross_validation import (
    DEFAULTS,
    HAMMERSTEIN,
    HAMMERSTEIN_WIENER,
    WIENER,
    WIENER_HAMMERSTEIN,
    CascadeSearch,
    Orders,
    Round,
    Topology,
    as_arrays,
    held_back,
    shortened,
)
from emsid.models.blocks.search.map_families import Family
from emsid.models.blocks.search.orders import (
    SAMPLES_PER_PARAMETER,
    filter_parameters,
    input_delay,
    too_few_knots,
    with_enough_knots,
)
from emsid.models.blocks.search.process_noise import Corrected, without_process_noise
from emsid.models.blocks.search.refinement import Choice, searched, with_steeper_jumps
from emsid.models.blocks.search.sign_recovery import may_be_rectified
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.one_channel import check_one_channel
from emsid.models.terms import check_whole
from emsid.record import Record

# Choices are made in one thread if they look at segments of fewer samples on average: what is computed of a segment is
# so short then that threads wait for each other.
SHARED_SAMPLES = 5_000
# A fit that only compares ends where four steps together lower its cost by less than this part: at this rate all its
# steps would save less than what makes a model better than another.
LEAST_SAVING = 1e-4
# The least number of changes of a two-level input that identify a map after a filter.
CHANGES = 5


@dataclass(frozen=True, eq=False, repr=False)
class CascadeStructure:
    """A cascade to identify: its topology, its orders and the options of the search. `fit` estimates it.

    Args:
        topology: the filters next to the static map.
        orders: of the filters before and after the map; None if the topology has no such filter, or to choose it.
        search: the static map, the delay and the options of the search.

    Raises:
        ModelError: for orders that do not fit the topology.
    """

    topology: Topology
    orders: Orders = (None, None)
    search: CascadeSearch = DEFAULTS

    def __post_init__(self) -> None:
        if not (isinstance(self.orders, tuple | list) and len(self.orders) == 2):
            raise ModelError(f"{self.name}: orders {self.orders!r}; give one for each filter, such as (1, 2)")
        least = 0 if self.topology.first and self.topology.second else 1
        for order, wanted in zip(self.orders, (self.topology.first, self.topology.second), strict=True):
            if order is not None and not wanted:
                raise ModelError(f"{self.name} has one filter; give one order")
            if order is not None:
                check_whole(f"{self.name}: order", order, least, "orders count poles")
        object.__setattr__(self, "orders", tuple(self.orders))

    def __repr__(self) -> str:
        filters = zip(self.orders, (self.topology.first, self.topology.second), strict=True)
        orders = [str(order) if order is not None else "chosen" for order, there in filters if there]
        static = getattr(self.search.static, "name", "chosen map")
        return f"CascadeStructure({self.name}: order{'s' * (len(orders) > 1)} {' and '.join(orders)}, {static})"

    @property
    def name(self) -> str:
        """The name of the topology."""
        return self.topology.name

    def fit(self, records: Record | Sequence[Record], *, control: Control = FREE) -> Fit[Cascade]:
        """Fit the cascade to the free-run error; options that are not given are chosen on unseen data.

        Args:
            records: one input and one output each.
            control: cancellation, time limit and progress reports. If it ends the search, the best model so far is
                kept.

        Raises:
            ModelError: for records of other channels or too short for the orders, or an input that does not excite the
                static map.
            Stopped: if ``control`` ends the search before there is a model.
        """
        return estimate(self.topology, records, self.orders, self.search, control)

    @one_blas_thread()
    def continued(self, model: Cascade, records: Sequence[Record], control: Control = FREE) -> Fit[Cascade]:
        """Fit a cascade that was found in a part of the data to all of them, as `fit` ends.

        Args:
            model: of this structure.
            records: one input and one output each.
            control: as in `fit`.
        """
        steady = steady_state(records, self.search.period)
        settings = replace(self.search, period=steady.period if steady else 0)
        return _fitted(model, steady.records if steady else records, steady, self.orders, settings, control)


def topology_of(model: Cascade) -> Topology:
    """The topology of a cascade, by its name or else by its first and last block."""
    named = {each.name: each for each in (WIENER_HAMMERSTEIN, HAMMERSTEIN, WIENER, HAMMERSTEIN_WIENER)}
    first, last = (isinstance(block, Rational) for block in (model.blocks[0], model.blocks[-1]))
    return named.get(model.name) or Topology(model.name, first, last and len(model.blocks) > 1)


def asked(topology: Topology, given: Mapping[str, Any]) -> CascadeStructure:
    """The cascade that options ask for, by the names of `emsid.identify`: orders, static, knots, nk, period and hold.

    Raises:
        ModelError: for another number of orders than the topology has filters.
    """
    settings = CascadeSearch(
        static=given.get("static"),
        size=given.get("knots"),
        delay=given.get("nk"),
        oversampling=1 if given.get("hold") == "zero" else None,  # more steps per sample are for continuous inputs
        period=given.get("period"),
        least_saving=LEAST_SAVING if given.get("comparing") else 0.0,
        threads=min(cores(), CascadeSearch.threads),
    )
    orders, wanted = given.get("orders") or (), topology.first + topology.second
    if orders and len(orders) != wanted:
        raise ModelError(
            f"{topology.name} has {wanted} filter{'s' * (wanted > 1)}; {len(orders)} orders given: give one for each",
            arguments=("orders",),
        )
    each = iter(orders)
    first = next(each, None) if topology.first else None
    return CascadeStructure(topology, (first, next(each, None) if topology.second else None), settings)


class CascadeOptions(TypedDict, total=False):
    """Options of a cascade and of its search, see `CascadeSearch`."""

    static: Family | StaticMap | type[StaticMap] | str | None
    size: int | None
    delay: int | None
    oversampling: int | None
    unseen: Record | Sequence[Record] | None
    transient: int | None
    period: int | None
    loss: Loss
    threads: int
    max_iterations: int
    rng: np.random.Generator | None
    rectified: bool | None


def wiener_hammerstein(
    orders: Sequence[int | None] | None = None, *misplaced: object, **given: Unpack[CascadeOptions]
) -> CascadeStructure:
    """Filter, static map, filter: ``emsid.fit(wiener_hammerstein((1, 2), static="dead-zone"), record)``.

    >>> wiener_hammerstein(orders=(1, 2), static="dead-zone", delay=1).orders
    (1, 2)

    Args:
        orders: of the two filters; each has as many poles, and one more numerator coefficient. None chooses them on
            unseen data.
        misplaced: must be empty; records are given to `emsid.fit`.
        given: ``static``, ``size``, ``delay`` and the other options of `CascadeSearch`, by name.

    Raises:
        ModelError: for invalid orders, an unknown static map, or an unknown option.
    """
    pair = (None, None) if orders is None else orders
    return _structure(WIENER_HAMMERSTEIN, pair, misplaced, given)


def hammerstein(order: int | None = None, *misplaced: object, **given: Unpack[CascadeOptions]) -> CascadeStructure:
    """Static map, then a filter, for `emsid.fit`.

    Args:
        order: of the filter; None chooses it on unseen data.
        misplaced: must be empty; records are given to `emsid.fit`.
        given: as in `wiener_hammerstein`.
    """
    return _structure(HAMMERSTEIN, (None, order), misplaced, given)


def wiener(order: int | None = None, *misplaced: object, **given: Unpack[CascadeOptions]) -> CascadeStructure:
    """A filter, then a static map, for `emsid.fit`.

    Args:
        order: of the filter; None chooses it on unseen data.
        misplaced: must be empty; records are given to `emsid.fit`.
        given: as in `wiener_hammerstein`.
    """
    return _structure(WIENER, (order, None), misplaced, given)


def hammerstein_wiener(
    order: int | None = None, *misplaced: object, **given: Unpack[CascadeOptions]
) -> CascadeStructure:
    """Static map, a filter, and a second map of the same family, for `emsid.fit`.

    Args:
        order: of the filter; None chooses it on unseen data.
        misplaced: must be empty; records are given to `emsid.fit`.
        given: as in `wiener_hammerstein`.
    """
    return _structure(HAMMERSTEIN_WIENER, (None, order), misplaced, given)


def _structure(
    topology: Topology, orders: Any, misplaced: Sequence[object], given: Mapping[str, Any]
) -> CascadeStructure:
    """The structure with these options; misplaced arguments are refused with the right usage."""
    called = topology.name.replace("-", "_")
    example = "orders=(1, 2)" if topology.first and topology.second else "order=2"
    shape = f"emsid.{called}({example}, static='dead-zone')"
    flat = orders if isinstance(orders, tuple | list) else (orders,)
    for record in (*flat, *misplaced):
        if isinstance(record, Record) or (
            isinstance(record, tuple | list) and any(isinstance(r, Record) for r in record)
        ):
            raise ModelError(f"{called} takes no record; give it to fit: emsid.fit({shape}, record)")
    for each in (*flat, *misplaced, *given.values()):
        if type(each).__name__ in ("Options", "CascadeSearch"):
            raise ModelError(f"{called} takes no {type(each).__name__}; give its options by name: {shape}")
    if misplaced:
        raise ModelError(f"{called} takes one argument by position, all others by name: {shape}")
    unknown = [name for name in given if name not in CascadeOptions.__annotations__]
    if unknown:
        names = list(CascadeOptions.__annotations__)
        near = did_you_mean(unknown[0], names)
        raise ModelError(f"{called} has no option {unknown[0]!r}; it takes {listed(names)}{near}")
    return CascadeStructure(topology, orders, CascadeSearch(**given))


@one_blas_thread()
def estimate(
    topology: Topology,
    records: Record | Sequence[Record],
    orders: Orders,
    settings: CascadeSearch,
    control: Control = FREE,
) -> Fit[Cascade]:
    """A cascade of any of the topologies, estimated; see `CascadeStructure`.

    If ``control`` ends the search, the best model so far is kept.

    Raises:
        Stopped: if there is none yet.
    """
    several = [records] if isinstance(records, Record) else list(records)
    if not several:
        raise ModelError(f"{topology.name}: no record to identify from; give one or several")
    template = Cascade((Rational(np.ones(1)),), name=topology.name)
    for record in several:
        check_one_channel(topology.name, record)
    _check_excitation(topology, several)
    _check_size(topology, several, orders, settings)
    steady = None if settings.unseen or settings.transient is not None else steady_state(several, settings.period)
    settings = replace(settings, period=steady.period if steady else 0)
    several = steady.records if steady else several
    if settings.rectified is None and topology.first:
        settings = replace(settings, rectified=may_be_rectified(several))
    fitted, rounds = held_back(several, settings)
    _check_unseen(topology, rounds, orders)
    delay = settings.delay
    if delay is None:
        signless, period = settings.families[0].loses_sign, settings.period
        delay = 0 if signless else input_delay(topology, as_arrays(fitted), orders, period)
    longest = max(len(u) for u, _ in as_arrays(fitted))
    if delay >= longest:
        raise ModelError(f"{topology.name}: a delay of {delay} in a stretch of {longest} samples; give a smaller one")
    pieces = as_arrays(shortened(fitted))
    threads = settings.threads if sum(len(u) for u, _ in pieces) > SHARED_SAMPLES * len(pieces) else 1
    choosing = replace(settings, threads=threads)
    task = Task(topology, fitted, rounds, orders, choosing, replace(template, delay=delay), control)
    best: Choice | None = None
    try:
        for choice in improving(task):
            best = choice
        assert best is not None
        start = with_spread_knots(task, best, several)
        return _fitted(start, several, steady, orders, settings, control)
    except Stopped as stopped:
        if best is None:
            raise
        fit = fit_cascade(best.model, several, transient=settings.transient, max_iterations=0)
        cut_short = Finding("choices-cut-short", topology.name, {"cancelled": stopped.ending is Ending.INTERRUPTED})
        return replace(fit, ending=stopped.ending, findings=(cut_short,))


def _fitted(
    start: Cascade,
    records: Sequence[Record],
    steady: Steady | None,
    orders: Orders,
    settings: CascadeSearch,
    control: Control,
) -> Fit[Cascade]:
    """The fit to all data of the chosen structure, corrected for noise before its map."""
    control.doing(f"fitting {start.name} to all data")
    transient = settings.transient
    if steady is not None:
        records, transient = steady.with_end_ahead(start)
    how = Search(transient=transient, loss=settings.loss, max_iterations=settings.max_iterations, control=control)
    how["threads"] = settings.threads
    first = Search(restarts=True, least_saving=settings.least_saving, control=control.during(f"fitting {start.name}"))
    found = with_steeper_jumps(searched(start, records, **(how | first)), **(how | first))
    found = found if settings.size else with_enough_knots(found, **(how | first))
    corrected = Corrected()
    if settings.loss is SQUARES:
        averages, free_map = steady.each if steady else 1.0, len(settings.families) > 1
        corrected = without_process_noise(found.minimum, found.problem, records, orders, how, averages, free_map)
    fit = corrected.fit
    if fit is None:
        fit = conclude(found.minimum, found.problem, settings.loss)
        fit = at_the_input(fit, records, how) if settings.delay is None else fit
    periods = () if steady is None else (steady.finding(start.name),)
    few = () if settings.size is None else too_few_knots(found.minimum, found.problem)
    return replace(fit, findings=(*fit.findings, *periods, *corrected.findings, *few))


def _check_excitation(topology: Topology, records: Sequence[Record]) -> None:
    for record in records:
        check_excitation(record)
    levels = np.unique(np.concatenate([record.input[:, 0] for record in records]))
    changes = sum(int(np.count_nonzero(np.diff(u))) for u, _ in as_arrays(records))
    if len(levels) == 2 and changes < CHANGES:
        raise ModelError(
            f"{topology.name}: the input changes {changes} time{'s' * (changes != 1)} between two values, too seldom "
            "to separate a static map from a filter. Use an input of many levels, or of many changes"
        )
    if len(levels) == 2 and not topology.first:
        raise ModelError(
            f"{topology.name}: the input takes two values only, {levels[0]:g} and {levels[1]:g}; a static map of it "
            "looks like a gain then. Use an input of many levels"
        )


def _check_size(topology: Topology, records: Sequence[Record], orders: Orders, settings: CascadeSearch) -> None:
    parameters = filter_parameters(topology, orders) + (settings.size or 4)
    samples = sum(len(record) for record in records)
    if samples < SAMPLES_PER_PARAMETER * parameters:
        raise ModelError(
            f"{topology.name}: about {parameters} parameters for {samples} samples; give smaller orders, fewer knots, "
            "or a longer record"
        )


def _check_unseen(topology: Topology, rounds: Sequence[Round], orders: Orders) -> None:
    """Refuse orders whose free run takes longer to start than the unseen data last."""
    needed = SAMPLES_PER_STATE * sum(order or 0 for order in orders)
    longest = min(each.longest for each in rounds)
    if needed >= longest:
        raise ModelError(
            f"{topology.name}: with these orders a free run takes {needed} samples to start, and the unseen data have "
            f"{longest}; give smaller orders or a longer record"
        )


SHORTEST = 1_000
"""Samples of the shortest period that is averaged; the average over a shorter one is a very short record."""
SETTLED = 1e-4
"""A free run is in steady state when what was before has decayed to this part."""


@dataclass(frozen=True, eq=False)
class Steady:
    """Records of one period each.

    Attributes:
        records: one for every segment.
        period: in samples.
        averages: the number of periods in all segments together.
        noise: standard deviation of the noise on the output over periods; None if no segment has two.
    """

    records: list[Record]
    period: int
    averages: int
    noise: float | None

    @property
    def each(self) -> float:
        """The mean number of periods that a record is the mean of."""
        return self.averages / len(self.records)

    def with_end_ahead(self, model: Cascade) -> tuple[list[Record], int]:
        """The records with the end of each put ahead of it, for a model to settle, and how many samples that are."""
        slowest = max((abs(pole) for b in model.blocks if isinstance(b, Rational) for pole in b.poles), default=0.0)
        decay = np.log(SETTLED) / np.log(min(max(slowest, 1e-6), 1 - 1e-9))
        ahead = int(min(model.memory + decay, self.period))
        return [_turned(record, ahead) for record in self.records], ahead

    def finding(self, name: str) -> Finding:
        """What was averaged."""
        data = {"period": self.period, "periods": self.averages, "records": len(self.records), "noise": self.noise}
        return Finding("periods-averaged", name, data)


def steady_state(records: Sequence[Record], period: int | None) -> Steady | None:
    """The records as periods in steady state; None if their inputs do not repeat.

    Args:
        records: one input, one output each.
        period: in samples, of inputs that are known to be periodic and in steady state; None detects it, 0 takes no
            input for periodic.

    Raises:
        ModelError: for a segment that is shorter than a given period.
    """
    segments = [segment for record in records for segment in record.segments]
    if period is None:
        found = {period_of(segment.input[:, 0], SHORTEST) for segment in segments}
        period = found.pop() if len(found) == 1 else None
    if not period:
        return None
    short = min(len(segment) for segment in segments)
    if short < period:
        raise ModelError(
            f"a period of {period} in a segment of {short} samples; give a smaller one, or unseen records of their own",
            arguments=("period",),
        )
    made = [averaged(segment.input[:, 0], segment.output[:, 0], period) for segment in segments]
    several = [each for each in made if each.averages > 1]
    freedom = sum(each.averages - 1 for each in several)
    noise = sum(each.variance * (each.averages - 1) for each in several) / freedom if freedom else None
    return Steady(
        [
            replace(segment[-period:], output=each.output[:, None], before=())
            for segment, each in zip(segments, made, strict=True)
        ],
        period,
        sum(each.averages for each in made),
        None if noise is None else float(np.sqrt(noise)),
    )


def _turned(record: Record, ahead: int) -> Record:
    """A period with its last samples put ahead of it."""
    around = [np.concatenate([each[len(each) - ahead :], each]) for each in (record.input, record.output)]
    return replace(record, input=around[0], output=around[1], before=())


ZERO = 3.0
"""A leading coefficient of fewer standard errors than this may be zero."""
LONGEST = 4
"""The most samples of dead time that are moved to the input."""
ITERATIONS = 40
"""A fit without a coefficient that is zero begins near its minimum; one that needs more steps is not taken."""


def at_the_input(fit: Fit[Cascade], records: Sequence[Record], how: Search) -> Fit[Cascade]:
    """The fit with the dead time of its filters counted at its input, and a finding where that is any.

    Args:
        fit: of a cascade; one whose search was stopped is left as it is.
        records: what it was fitted to.
        how: of further fits, as in `fit_cascade`.
    """
    moved = 0
    for _ in range(LONGEST if fit.ending is Ending.CONVERGED and fit.model.oversampling == 1 else 0):
        found = [again for k in _late(fit) if (again := _moved(fit, k, records, how)) is not None]
        if not found:
            break
        fit = min(found, key=lambda each: each.noise_variance)
        moved += 1
    if not moved:
        return fit
    filters = sum(isinstance(block, Rational) for block in fit.model.blocks)
    data = {"model": fit.model.name, "delay": fit.model.delay, "moved": moved, "filters": filters}
    return replace(fit, findings=(*fit.findings, Finding("dead-time-at-input", fit.model.name, data)))


def _late(fit: Fit[Cascade]) -> list[int]:
    """The filters whose leading coefficient may be zero."""
    cascade, errors = fit.model, dict(zip(fit.names, fit.standard_error.tolist(), strict=True))
    late = []
    for k, (block, span) in enumerate(zip(cascade.blocks, cascade.spans, strict=True)):
        if isinstance(block, Rational) and len(block.numerator) > 1:
            error = errors.get(cascade.names[span.start], 0.0)
            if np.isfinite(error) and abs(block.numerator[0]) < ZERO * error:
                late.append(k)
    return late


def _moved(fit: Fit[Cascade], k: int, records: Sequence[Record], how: Search) -> Fit[Cascade] | None:
    """The converged fit without the leading coefficient of one filter, a sample later; None where that is worse."""
    blocks = list(fit.model.blocks)
    block = blocks[k]
    assert isinstance(block, Rational)
    blocks[k] = Rational(block.numerator[1:], block.denominator, block.delay)
    limits = Search(max_iterations=min(how.get("max_iterations", ITERATIONS), ITERATIONS))
    try:
        again = fit_cascade(
            replace(fit.model, blocks=tuple(blocks), delay=fit.model.delay + 1), records, **(how | limits)
        )
    except EmsidError:
        return None
    if again.ending is not Ending.CONVERGED or not fit.noise_variance > 0:
        return None
    worse = fit.samples * log(again.noise_variance / fit.noise_variance)
    return again if worse <= log(fit.samples) else None


# --- what the records do not determine --------------------------------------------------------------------------------


def advice(fit: Fit[Cascade], records: Record | Sequence[Record]) -> tuple[Finding, ...]:
    """Findings on what the records do not determine in a fitted cascade.

    Args:
        fit: the fitted cascade.
        records: the records that it was fitted to.
    """
    several = [records] if isinstance(records, Record) else list(records)
    model = fit.model
    pairs = as_arrays(several)
    findings: list[Finding] = []
    for k, block in enumerate(model.blocks):
        if isinstance(block, StaticMap):
            found = block.findings(np.concatenate([model.signals_from_rest(u)[k] for u, _ in pairs]))
            findings += [replace(each, subject=model.name, data={"block": k + 1, **each.data}) for each in found]
    lost = [n for n, variance in zip(fit.names, np.diag(fit.covariance), strict=True) if not np.isfinite(variance)]
    if lost and fit.ending is not Ending.RANK_DEFICIENT:  # which has a finding of its own
        findings.append(Finding("parameters-without-interval", model.name, {"parameters": lost}))
    return tuple(findings)
