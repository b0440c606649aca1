"""`feedback`: identification of feedback models without start values."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from math import sqrt
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.linear.least_squares import check_excitation
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.estimation.threads import one_blas_thread
from emsid.findings import Finding
from emsid.models.blocks.search.map_families import Family, family_of
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.feedback.fitting import ITERATIONS, Found, conclude, searched
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.choice import chosen
from emsid.models.feedback.search.moves import usual_size
from emsid.models.feedback.search.trials import OF_USE, SEARCHED, FeedbackSearch, Trial, error_of_use, refusal
from emsid.models.one_channel import Segments, check_one_channel, segments_longer_than
from emsid.record import Record
from emsid.record.holding_back import excerpt

Array = NDArray[np.float64]

# A record needs this many samples for every element of the smallest model.
SAMPLES = 60
# Longer records are fitted in a few steps from the minimum of an excerpt of the second length, the last in the normal
# form. Steps that together lower the cost by a smaller share than the last number are the last.
LONG, PART, STEPS_TO_ALL, LAST_SAVING = 20_000, 10_000, 5, 1e-4
# Last steps in the normal form, at least and at most; as many as this number of products of two derivatives allows.
LAST_STEPS, PRODUCTS = (15, 100), 4e9
# A given delay is at most the longest segment divided by this number.
SHARE_OF_DELAY = 10
# Steps of the fit to all data, at most.
FINAL_ITERATIONS = 300


@dataclass(frozen=True, eq=False, repr=False)
class FeedbackStructure:
    """A feedback model to identify; `fit` estimates it.

    Args:
        search: orders, maps and other options.
    """

    search: FeedbackSearch

    name = "feedback"

    def __repr__(self) -> str:
        static = getattr(self.search.static, "name", "chosen maps")
        return f"FeedbackStructure(order {self.search.order or 'chosen'}, {static})"

    @one_blas_thread()
    def fit(self, records: Record | Sequence[Record], *, control: Control = FREE) -> Fit[FeedbackModel]:
        """Fit the model to the free-run error; options that are not given are chosen on unseen data.

        Args:
            records: one input and one output each.
            control: cancellation, time limit and progress reports. If it ends the search, the best model so far is
                kept; its intervals are those of an excerpt of a long record.

        Raises:
            ModelError: for records of other channels or too short, or where no model can be fitted.
            Stopped: if ``control`` ends the search before there is a model.
        """
        several = [records] if isinstance(records, Record) else list(records)
        if not several:
            raise ModelError("feedback: no record to identify from; give one or several")
        for record in several:
            check_one_channel(self.name, record)
            check_excitation(record)
        if sum(map(len, several)) < SAMPLES:
            raise ModelError(f"feedback: fewer than {SAMPLES} samples; record longer")
        _check_delay(self.search.delay, several)
        search, problems = _watched(self.search)
        begun: list[Trial] = []
        try:
            for trial in chosen(several, search, control):
                begun = [trial]
            control.doing("fitting feedback to all data")
            during = control.during("fitting feedback")
            if _are_long(several):
                with suppress(ModelError):
                    begun.append(_in_part(begun[0], several, during))
                control.check()
            return self._counted(_fitted(begun, several, during))
        except ModelError as problem:
            if begun or self.search.static is None:
                raise
            raise _reason(self.search, problems) or problem from None
        except Stopped as stopped:
            if not begun:
                raise
            if _are_long(several):  # the user waits: a fit to all samples would take seconds
                several = _part_of(several, SEARCHED)
                begun = [replace(each, found=replace(each.found, states=[])) for each in begun]
            fit = _fitted(begun, several, FREE, 0)
            cut_short = Finding("choices-cut-short", self.name, {"cancelled": stopped.ending is Ending.INTERRUPTED})
            return replace(fit, ending=stopped.ending, findings=(cut_short,))

    def _counted(self, fit: Fit[FeedbackModel]) -> Fit[FeedbackModel]:
        """The fit, with a finding where it has not the number of maps that is asked for."""
        maps, asked = len(fit.model.maps), self.search.maps
        if asked in (None, maps):
            return fit
        other = Finding("other-number-of-maps", self.name, {"maps": maps, "asked": asked})
        return replace(fit, findings=(*fit.findings, other))


@one_blas_thread()
def continued(fit: Fit[FeedbackModel], records: Sequence[Record], control: Control = FREE) -> Fit[FeedbackModel]:
    """Fit a model that was found in a part of the data to all of them, in a few steps.

    Args:
        fit: of the part.
        records: one input and one output each.
        control: when to stop.

    Raises:
        Stopped: by ``control``.
    """
    segments = segments_longer_than(fit.model.memory, fit.model, records)
    return _in_few_steps(fit.model, fit.ending is not Ending.OUT_OF_BUDGET, segments, control)


def feedback(
    order: int | None = None,
    *,
    static: Family | StaticMap | type[StaticMap] | str | None = None,
    size: int = 0,
    maps: int | None = None,
    delay: int | None = None,
    oversampling: int | None = None,
    held: bool | None = None,
) -> FeedbackStructure:
    """A linear system with static maps in its feedback, to be fitted by `emsid.fit`.

    >>> feedback(order=2, static="polynomial", size=3)
    FeedbackStructure(order 2, polynomial)

    Args:
        order: of the linear part, 0 to 12; None chooses it on unseen data.
        static: the family of its maps: a name such as ``dead-zone``, a map or its class; None chooses it.
        size: number of knots, or degree, at most 100; 0 for the usual one of the family, or
            a larger one if that is better.
        maps: the number of maps, 1 to 6; None chooses it.
        delay: from the input to its first effect, in samples; None chooses it.
        oversampling: steps of the model per sample of the record; None tries 1 and 2, and up to 16 where more
            are better.
        held: whether the input is held between its samples; otherwise it is band-limited. None tries both.

    Raises:
        ModelError: for numbers outside their limits, a size without a static map that has sizes, or an unknown static
            map.
    """
    family = None if static is None else family_of(static)
    return FeedbackStructure(FeedbackSearch(order, maps, family, size, delay, oversampling, held))


def _check_delay(delay: int | None, records: Sequence[Record]) -> None:
    """Refuse a delay after which too little of every segment is left.

    Raises:
        ModelError: with the longest segment.
    """
    longest = max(len(segment) for record in records for segment in record.segments)
    if delay is not None and delay > longest // SHARE_OF_DELAY:
        raise ModelError(
            f"feedback: a delay of {delay} in a stretch of {longest} samples; give at most {longest // SHARE_OF_DELAY}",
            arguments=("nk",),
        )


def _watched(search: FeedbackSearch) -> tuple[FeedbackSearch, list[ModelError]]:
    """The search with a check of every map that is begun, and the problems of these, filled during the search.

    A user's own map may fail, or have no value, at some input that the signals of a model reach. No model is begun
    there; if none can be begun at all, the first problem says why.
    """
    family, problems = search.static, list[ModelError]()
    if family is None:
        return search, problems

    def start(x: Array, z: Array, size: int) -> StaticMap:
        map_ = family.start(x, z, size)
        try:
            finite = np.isfinite(map_.value(x))
            if not finite.all():
                raise ModelError(
                    f"feedback: the {family.name} map is not finite at an input of {x[~finite][0]:.3g}, which the "
                    "signals of the model reach; define it for all inputs"
                )
        except ModelError as problem:
            problems.append(problem)
            raise
        return map_

    watched = copy(search)  # its options are checked
    object.__setattr__(watched, "static", replace(family, start=start))
    return watched, problems


def _reason(search: FeedbackSearch, problems: Sequence[ModelError]) -> ModelError | None:
    """Why no model with the given map was begun: the first problem of the map, or that it fails now; None: unknown."""
    assert search.static is not None
    x = np.linspace(-1.0, 1.0, 5 * SAMPLES)
    try:
        if not problems:
            search.static.start(x, x, usual_size(search.static, search.size)).value(x)
    except ModelError as failure:
        return failure
    return problems[0] if problems else None


def _are_long(records: Sequence[Record]) -> bool:
    return sum(map(len, records)) > LONG


def _part_of(records: Sequence[Record], samples: int) -> list[Record]:
    """Excerpts with this many samples in all."""
    return [excerpt(record, max(samples // len(records), 1)) for record in records]


def _in_part(trial: Trial, records: Sequence[Record], control: Control) -> Trial:
    """The trial with its model fitted to a part of long records.

    Raises:
        ModelError: where its run diverges.
    """
    model = trial.found.model
    few = segments_longer_than(model.memory, model, _part_of(records, PART))
    return replace(trial, found=searched(model, few, model.edge, FINAL_ITERATIONS, 0.05, control, LAST_SAVING))


def _fitted(
    begun: Sequence[Trial], records: Sequence[Record], control: Control, iterations: int = FINAL_ITERATIONS
) -> Fit[Any]:
    """The last trial, fitted to all data; the model of the first one if that is of no use, see `error_of_use`.

    Args:
        begun: the trial that is chosen, and of long records the same in a part of them.
        records: all data; to long ones the model is fitted in a few steps.
        control: when to stop.
        iterations: at most.

    Raises:
        ModelError: where the run of every model diverges.
        Stopped: by ``control``, in long records.
    """
    fits: list[tuple[float, Fit[Any]]] = []
    attempts = [(begun[-1], iterations), (begun[0], 0)] if iterations or len(begun) > 1 else [(begun[0], 0)]
    for k, (trial, most) in enumerate(attempts, 1):
        try:
            fit = _minimum(trial.found, records, control, most)
        except ModelError:
            if k == len(attempts) and not fits:
                raise
            continue
        error = error_of_use(fit.model, segments_longer_than(fit.model.memory, fit.model, records))
        if error <= OF_USE * sqrt(fit.noise_variance):
            return fit
        fits.append((error, fit))
    return min(fits, key=itemgetter(0))[1]


def _minimum(begun: Found, records: Sequence[Record], control: Control, iterations: int) -> Fit[Any]:
    """The fit that begins at a model, and at its initial states if they are those of all segments."""
    model = begun.model
    segments = segments_longer_than(model.memory, model, records)
    if _are_long(records) and iterations:
        return _in_few_steps(model, begun.settled, segments, control)
    refused = refusal(model)
    here = searched(model, segments, model.edge, iterations, 0.05, control, states=begun.states, refused=refused)
    return conclude(here, segments, model.edge, 0.05, control, min(iterations, 2 * ITERATIONS), refused)


def _in_few_steps(model: FeedbackModel, settled: bool, segments: Segments, control: Control) -> Fit[Any]:
    """The fit to all data that begins at the minimum of a part of them.

    Args:
        model: at that minimum.
        settled: whether the search for it has converged.
        segments: of all data.
        control: when to stop.

    Raises:
        Stopped: by ``control``.
    """
    refused = refusal(model)
    here = searched(model, segments, model.edge, STEPS_TO_ALL, 0.05, control, LAST_SAVING, refused=refused)
    control.check()
    products = sum(len(y) for _, y in segments) * len(model.parameters) ** 2
    steps = int(np.clip(PRODUCTS / products, *LAST_STEPS))
    return conclude(replace(here, settled=settled), segments, model.edge, 0.05, control, steps, refused)
