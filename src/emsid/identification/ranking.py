"""The ranking of fitted models over folds that cover all the data that may choose.

One part of a record that was held back says little where the record is short or changes its character. Here every
stretch of the data is left out once. The structure of a model is kept, and its parameters are fitted again to the rest,
from the known estimate and in a few steps (`emsid.models.refitting`). Its free run over the stretch that was left out
is compared with those of the others by the one rule, `better`. The paired stretches come from all folds, so their
spread, the noise of the ranking, contains what differs from fold to fold. Where a fold reaches amplitudes that the rest
does not, models extrapolate; their errors there are large, and weigh more in the mean square. Models are tied if
neither the differences of their mean squares, stretch by stretch, nor the ratios are larger than chance explains.

The model that is handed over is fitted to all data in the end (`all_data`). The error over the folds is too large for
it, and varies much from record to record, above all where the held-back part is the only fold. The error on data that
it was fitted to is too small and varies less. Efron's .632 estimator is the weighted mean of the two mean squares; here
it is that of their logarithms, stretch by stretch, so that a stretch that is far off while it is left out weighs less.

The part that was held back from the fits is the first fold, and needs no other fit. It selects the models that are
followed over the other folds: those with at most `MUCH_WORSE` times its smallest error. Models that were fitted to an
excerpt of a long record have not seen what lies outside of it; these data, in parts, are the other folds then, without
another fit. Where there are none and the held-back part has `MANY` samples, or where only one model is left, the
held-back part decides alone.

In a short record, with fewer than `ANEW` samples in each part for each that starts a model, a run that began anew in
every part would show above all how well few samples give a state, and one part often has most of the largest values,
which the others then lack, as a step has all of its response at the beginning. There each fold leaves out several
stretches, spread over the whole record, and the run goes on through them. These fits begin at the parameters from all
data, as those from the first part may be far off. The free run of a position never forgets an error, so there it always
begins anew.

References:
    Efron, *Estimating the error rate of a prediction rule: improvement on cross-validation*, Journal of the American
    Statistical Association 78 (1983).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.borders import border
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.first_look.data_advice import advice_by_code
from emsid.first_look.examined import is_position
from emsid.identification.candidates import refit_data
from emsid.models.free_run import free_run, predict
from emsid.models.model import Model, Run
from emsid.models.refitting import refitted, usable_refit
from emsid.options import Options
from emsid.record import Record, concatenate
from emsid.record.holding_back import Mask, is_series, left_out_once, parted, shows_all_in_a_part, stretches_in_turn
from emsid.selection.improvement import DIFFERENT, STRETCHES, StretchErrors, better, better_by_ratio, front
from emsid.validation.comparison import Assessment, Comparison

Array = NDArray[np.float64]

FOLDS = 4
"""The parts of the data that are left out in turn, with the one that was held back from the fits."""
MUCH_WORSE = 4.0
"""A model whose error on the held-back part is larger than the smallest by this factor is not followed further."""
MANY = 5_000
"""A held-back part of this many samples decides alone, unless models were fitted to an excerpt."""
ANEW = 5
"""A free run begins anew in every part that has at least this many samples for each that starts a model."""
LEAST = 2
"""A segment that is run on has at least this many samples for each that starts a model."""
INCLUDED = 0.368
"""The weight of the error on data that the fit includes, beside the error on data that it leaves out (Efron)."""


@dataclass(frozen=True, eq=False)
class Ranked:
    """A model with its free-run errors over the folds.

    Attributes:
        fit: the model.
        folds: its squared errors over the variance of the output, stretch by stretch, on every part that was left out.
        included: those of its parameters from all data, on the same stretches; empty where these are not known.
        refit: the model with these parameters; None where they are not known, or are those of the fit.
        parts: the model with its parameters from parts of the data: the share of the data that they lack, and it.
    """

    fit: Fit[Any]
    folds: tuple[StretchErrors, ...]
    included: tuple[StretchErrors, ...] = ()
    refit: Model | None = None
    parts: tuple[tuple[float, Model], ...] = ()

    @property
    def name(self) -> str:
        """Of the model."""
        name: str = self.fit.model.name
        return name

    @property
    def size(self) -> int:
        """The number of estimated parameters."""
        return self.fit.size

    @cached_property
    def left_out(self) -> StretchErrors:
        """Over all folds, on data that its parameters are not from."""
        return StretchErrors.joined(self.folds)

    @cached_property
    def errors(self) -> StretchErrors:
        """What models are ranked by: the errors left out, with those of fits to all data where these are known."""
        if not self.included:
            return self.left_out
        return self.left_out.mixed(StretchErrors.joined(self.included), INCLUDED)

    @property
    def rmse(self) -> tuple[float, float, float]:
        """Root mean square error, `errors`, over the output's deviation, and the ends of one standard error.

        The standard error is that of the mean over the stretches of all folds; NaN where a run diverges.
        """
        mean, means = self.errors.mean, self.errors.means[self.errors.samples > 0]
        if not np.isfinite(means).all() or len(means) < 2:
            return float(np.sqrt(mean)), float("nan"), float("nan")
        half = float(np.std(means, ddof=1) / np.sqrt(len(means)))
        low, high = max(mean - half, 0.0), mean + half
        return float(np.sqrt(mean)), float(np.sqrt(low)), float(np.sqrt(high))

    @property
    def fit_percent(self) -> float:
        """100·(1 − RMSE over the output's deviation)."""
        return 100 * (1 - self.rmse[0])


def ranked(
    choice: Comparison,
    fitted: Record | None,
    options: Options,
    excluded: Collection[str] = (),
    control: Control = FREE,
    outside: Record | None = None,
    whole: Record | None = None,
) -> tuple[Ranked, ...]:
    """The models of a comparison with their errors over the folds, the smallest first; then those not followed.

    Args:
        choice: the models on the part of the data that was held back from their fits.
        fitted: the data they were fitted to; None where the held-back part decides alone.
        options: how regressions are fitted.
        excluded: names of models that are not recommended whatever their error is.
        control: when to stop; the held-back part then decides.
        outside: the data outside the excerpt that the models were fitted to, if they were.
        whole: the fitted and the held-back data in one record; by default they are joined, with a gap between them.
    """
    scale = deviations((choice.best.record if fitted is None else concatenate([fitted, choice.best.record])).output)
    alone = [
        Ranked(each.fit, (stretch_errors(each.simulation, each.record, scale, STRETCHES),))
        for each in choice.assessments
    ]
    alone.sort(key=lambda each: each.errors.mean)
    if fitted is None or (outside is None and len(choice.best.record) >= MANY):
        return tuple(alone)
    usable = [each for each in choice.assessments if each.row.model not in excluded] or [choice.best]
    followed = [each for each in usable if each.row.ranked_by <= MUCH_WORSE**2 * usable[0].row.ranked_by]
    if len(followed) < 2:
        return tuple(alone)
    folds = _Folds(choice.best.transient, scale, options, control)
    try:
        if outside:
            over_all = folds.judged(followed, folds.of_outside(outside))
        else:
            whole = whole or concatenate([fitted, choice.best.record])
            over_all = folds.over_all(followed, fitted, choice.best.record, whole)
    except Stopped:
        return tuple(alone)
    over_all.sort(key=lambda each: each.errors.mean)
    fits = {id(each.fit) for each in over_all}
    return (*over_all, *(each for each in alone if id(each.fit) not in fits))


def ranked_ahead(choice: Comparison, horizon: int) -> tuple[Ranked, ...]:
    """The models of a comparison with the errors of their predictions, the smallest first.

    Args:
        choice: the models on the part of the data that was held back from their fits.
        horizon: the samples that are predicted ahead.
    """
    scale = deviations(choice.best.record.output)

    def errors(each: Assessment) -> StretchErrors:
        run = predict(each.fit.model, each.record, horizon, each.transient)
        return stretch_errors(run, each.record, scale, STRETCHES)

    return tuple(
        sorted((Ranked(each.fit, (errors(each),)) for each in choice.assessments), key=lambda each: each.errors.mean)
    )


def in_turn(fits: Sequence[Fit[Any]], whole: Record, start: int, options: Options, control: Control) -> list[Ranked]:
    """Models with their errors on stretches of all data that are left out in turn, while the run goes on.

    Args:
        fits: the models, whatever part of the data they have seen: each is fitted again to the rest.
        whole: all data.
        start: samples of every segment that start a run.
        options: how regressions are fitted.
        control: when to stop.

    Raises:
        Stopped: if ``control`` stops it.
    """
    folds = _Folds(start, deviations(whole.output), options, control)
    return [folds.in_turn(fit, whole, whole) for fit in fits]


@dataclass(frozen=True)
class FrontRow:
    """A model in the comparison of accuracy and number of parameters.

    Attributes:
        model: its name.
        parameters: the number of its estimated parameters.
        error: RMSE of the free run over all folds, `Ranked.rmse`, as a share of the deviation of the output.
        low, high: of the error, one standard error away; NaN where a run diverges.
        folds: the number of parts of the data that were left out in turn.
        on_front: whether it is better than every simpler one on the front by more than noise (`Ranked.errors`).
        recommended: whether it is the recommended model.
    """

    model: str
    parameters: int
    error: float
    low: float
    high: float
    folds: int
    on_front: bool
    recommended: bool


def front_rows(ranking: Sequence[Ranked], recommended: str) -> tuple[FrontRow, ...]:
    """The models that were compared over all folds, from simple to complex.

    Args:
        ranking: of the models.
        recommended: the name of the recommended one.
    """
    among = compared(ranking)
    kept = {id(each) for each in front(among, lambda each: each.size, as_good=close)}
    return tuple(
        FrontRow(each.name, each.size, *each.rmse, len(each.folds), id(each) in kept, each.name == recommended)
        for each in sorted(among, key=lambda each: (each.size, each.errors.mean))
    )


def close(model: Ranked, best: Ranked) -> bool:
    """Whether the ratio of two errors is within noise too: uneven errors would excuse any difference of their means."""
    much = not model.errors.mean < DIFFERENT * best.errors.mean
    return model is best or not (much or better_by_ratio(best.errors, than=model.errors))


def within_noise(model: Ranked, best: Ranked) -> bool:
    """Whether the smaller error of the best model may be chance."""
    return close(model, best) and not better(best.errors, than=model.errors)


def compared(ranking: Sequence[Ranked]) -> list[Ranked]:
    """The models that were followed over all folds, so that their errors are on the same samples and of one kind."""

    def known(each: Ranked) -> tuple[int, int]:
        return len(each.folds), len(each.included)

    most = max(map(known, ranking))
    return [each for each in ranking if known(each) == most]


Fold = tuple[Record | None, Record]
"""What models are fitted to again, None where they have not seen the part, and the part itself."""


@dataclass(frozen=True)
class _Folds:
    """How models are judged on data that are left out.

    Attributes:
        start: samples of every segment that start a run.
        scale: (ny,) of every output.
        options: how regressions are fitted.
        control: when to stop.
    """

    start: int
    scale: Array
    options: Options
    control: Control

    def of_outside(self, outside: Record) -> list[Fold]:
        """The parts of the data outside an excerpt, as far as they are long enough to run models on."""
        parts = parted(outside, FOLDS - 1)
        return [(None, part) for part in parts if max(map(len, part.segments)) > LEAST * self.start]

    def over_all(
        self, followed: Sequence[Assessment], fitted: Record, held_back: Record, whole: Record
    ) -> list[Ranked]:
        """The models over folds of all data, with the errors of fits to all of them."""
        size = len(fitted) // (FOLDS - 1)
        few = size < ANEW * self.start or shows_all_in_a_part(fitted, FOLDS - 1)
        if few and not is_series(fitted, FOLDS - 1) and not _integrates(whole):
            long = [each for each in whole.segments if len(each) > LEAST * self.start]
            if 2 * sum(map(len, long)) > len(whole):
                return [self.in_turn(each.fit, whole, concatenate(long)) for each in followed]
        folds: list[Fold] = []
        if size >= LEAST * self.start:
            every = left_out_once(fitted, FOLDS - 1, self.start)
            folds = [(concatenate([rest, held_back]), part) for rest, part in every]
        parts = [held_back, *(part for _, part in folds)]
        return [self.with_included(each, whole, parts) for each in self.judged(followed, folds)]

    def judged(self, followed: Sequence[Assessment], folds: Sequence[Fold]) -> list[Ranked]:
        """The models with their errors on the held-back part and on the other folds."""
        first = STRETCHES // FOLDS if folds else STRETCHES
        found = [[stretch_errors(each.simulation, each.record, self.scale, first)] for each in followed]
        parts = [list[tuple[float, Model]]() for _ in followed]
        for number, (others, part) in enumerate(folds, 2):
            for one, errors, known in zip(followed, found, parts, strict=True):
                self.control.doing(f"ranking {one.row.model}", number, len(folds) + 1)
                with self.failing(errors, len(part)):
                    model = one.fit.model if others is None else self.again(one.fit, others)
                    errors.append(self.errors(model, part))
                    known += [] if others is None else [(len(part) / (len(part) + len(others)), model)]
        each = zip(followed, found, parts, strict=True)
        return [Ranked(one.fit, tuple(errors), parts=tuple(known)) for one, errors, known in each]

    def in_turn(self, fit: Fit[Any], whole: Record, long: Record) -> Ranked:
        """A model with its errors on stretches that are left out in turn, while the run goes on.

        Args:
            fit: the model.
            whole: all data.
            long: the segments of them that are run on.
        """
        refit = self.to_all(fit, whole)
        known = fit if refit is None else replace(fit, model=refit)
        squares = _squares(free_run(known.model, long, self.start), long, self.scale)
        left, included, parts = list[StretchErrors](), list[StretchErrors](), list[tuple[float, Model]]()
        lengths = [len(segment) for segment in long.segments]
        for number, out in enumerate(stretches_in_turn(lengths, FOLDS, STRETCHES, self.start), 1):
            self.control.doing(f"ranking {fit.model.name}", number, FOLDS)
            mask = np.concatenate(out)
            included.append(StretchErrors.of(squares[mask], STRETCHES // FOLDS))
            with self.failing(left, int(mask.sum())):
                parts.append((float(np.mean(mask)), self.again(known, long, [mask])))
                run = free_run(parts[-1][1], long, self.start)
                left.append(StretchErrors.of(_squares(run, long, self.scale)[mask], STRETCHES // FOLDS))
        return Ranked(fit, tuple(left), tuple(included), refit, tuple(parts))

    def with_included(self, each: Ranked, whole: Record, parts: Sequence[Record]) -> Ranked:
        """A model with the error on the folds, the parts, of its parameters from all data."""
        self.control.doing(f"ranking {each.name}", len(parts), len(parts))
        refit = self.to_all(each.fit, whole)
        model = each.fit.model if refit is None else refit
        both = zip(parts, each.folds, strict=True)
        included = tuple(self.errors(model, part, len(fold.means)) for part, fold in both)
        lacking = [(len(parts[0]) / len(whole), each.fit.model)] * (refit is not None)
        return replace(each, included=included, refit=refit, parts=(*lacking, *each.parts))

    def again(self, fit: Fit[Any], data: Record, left_out: Sequence[Mask] | None = None) -> Model:
        """The model with its parameters from other data, see `refitted`."""
        model: Model = refitted(fit, refit_data(self.options, data, self.control, left_out=left_out)).model
        return model

    def to_all(self, fit: Fit[Any], whole: Record) -> Model | None:
        """The model with its parameters from all data, see `usable_refit`."""
        again = usable_refit(fit, refit_data(self.options, whole, self.control))
        return None if again is None else again.model

    def errors(self, model: Model, data: Record, stretches: int = STRETCHES // FOLDS) -> StretchErrors:
        """Of the free run."""
        return stretch_errors(free_run(model, data, self.start), data, self.scale, stretches)

    @contextmanager
    def failing(self, errors: list[StretchErrors], samples: int) -> Iterator[None]:
        """Adds infinite errors where the data do not suit a model."""
        before = len(errors)
        with border("ranking over parts of the data", expected=True):
            yield
        if len(errors) == before:
            errors.append(StretchErrors.of(np.full(samples, np.inf), STRETCHES // FOLDS))


def _integrates(record: Record) -> bool:
    """Whether the output is a position, or goes on as long as the input lasts, as a position does."""
    return is_position(record) or "output-integrates" in advice_by_code(record)


def stretch_errors(run: Run, record: Record, scale: Array, stretches: int) -> StretchErrors:
    """The squared free-run errors by stretch, see `_squares`."""
    return StretchErrors.of(_squares(run, record, scale), stretches)


def _squares(run: Run, record: Record, scale: Array) -> Array:
    """(N,) the squared free-run errors, each output in its own scale (ny,): infinite where the run has diverged, NaN in
    transients."""
    squares = np.mean(((record.output - run.output) / scale) ** 2, axis=1)
    squares[~np.isfinite(squares)] = np.inf
    return np.where(run.counted, squares, np.nan)


def deviations(outputs: Array) -> Array:
    """(ny,) the standard deviations of outputs (N, ny); one where an output is constant."""
    spread = outputs.std(axis=0)
    return np.where(spread > 0, spread, 1.0)
