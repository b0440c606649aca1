"""The error by which regressions are chosen: the free run on parts of the data that were not fitted.

A short record is cross-validated: each of several parts, which together cover the whole record, is unseen once, and
the structure is fitted anew to the rest. Of a long record a part is held back. A model that diverges on larger inputs
than those of the record (`emsid.models.extrapolation`) is never chosen, and one that diverges only while an extreme
input is held is chosen where that is asked for and it is much better than those that do not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from emsid.errors import EmsidError
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.models.extrapolation import MUCH_BETTER, Extremes, diverges, diverges_held
from emsid.models.free_run import squared_errors
from emsid.models.model import Model
from emsid.models.regression.free_run_fit import fit_free_run
from emsid.models.regression.narx import Narx, Structure
from emsid.record import Record
from emsid.record.holding_back import Split, excerpt, folded, validation_splits
from emsid.selection.improvement import STRETCHES, StretchErrors

# The samples of a search, an excerpt of a longer record.
SEARCHED = 20_000
# The same where every part is unseen once.
FOLDED = 32_000
# Steps and tolerance of a fit that is only compared with others, and the relative reduction of its cost over a few
# steps below which it ends.
ITERATIONS, TOLERANCE, SAVING = 30, 0.03, 1e-4


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Splits of a record into data to fit and unseen data.

    Attributes:
        fitted: the records that a search sees.
        splits: of these or of the whole record.
        transient: samples at the start of every unseen segment that enter no error.
        control: when to stop.
        wary: whether a model that diverges while an extreme input is held is compared, by `MUCH_BETTER` times its
            error; otherwise it is refused.
    """

    fitted: Sequence[Record]
    splits: Sequence[Split]
    transient: int
    control: Control = FREE
    wary: bool = False

    @classmethod
    def of(
        cls, record: Record, held_back: float, transient: int, control: Control = FREE, folds: bool = False
    ) -> CrossValidation:
        """The splits of a record, of which a long one is searched in pieces.

        Args:
            record: all data.
            held_back: the fraction that is unseen, where the record is not cross-validated.
            transient: samples at the start of every unseen segment that enter no error.
            control: when to stop.
            folds: whether a long record is cross-validated too, in shorter pieces.
        """
        searched = [excerpt(record, FOLDED if folds else SEARCHED)]
        fitted, splits = folded(searched) if folds else validation_splits(searched, held_back)
        return cls(fitted, splits, transient, control)

    @cached_property
    def extremes(self) -> tuple[Extremes, ...]:
        """The records that a search sees, with inputs that they lack."""
        return tuple(Extremes(record) for record in self.fitted)

    @property
    def refits(self) -> bool:
        """Whether every split has its own data to fit."""
        return len(self.splits) > 1

    def refitted(self, fit: Fit[Narx]) -> StretchErrors:
        """The errors of a structure, fitted to the free run of each split's own data from a known fit."""

        def again(structure: Structure, train: Sequence[Record]) -> Model:
            if not self.refits:
                return fit.model
            return fit_to_compare(structure, train, fit.estimate, self.control).model

        return self.errors(fit.model.structure, again)

    def errors(
        self, structure: Structure, model_for: Callable[[Structure, Sequence[Record]], Model], least: float = 0.0
    ) -> StretchErrors:
        """The errors of the free run over the unseen data of all splits; infinite where it diverges or may do so.

        Args:
            structure: what is fitted.
            model_for: fits it to the records of a split.
            least: squared errors are at least this, as smaller ones are rounding.
        """
        parts = []
        for train, unseen in self.splits:
            try:
                model = model_for(structure, train)
                factor = self.factor(model)
                squares = np.full(1, np.inf) if np.isinf(factor) else squared_errors(model, unseen, self.transient)
            except (EmsidError, ValueError, ArithmeticError):  # what cannot be fitted to a part is not chosen
                squares = np.full(1, np.inf)
            if np.isinf(squares).any():
                return StretchErrors.of(np.full(STRETCHES, np.inf))
            parts.append(StretchErrors.of(factor * np.maximum(squares, least), STRETCHES // len(self.splits)))
        return StretchErrors.joined(parts)

    def factor(self, model: Model) -> float:
        """By how much the squared errors of a model count more because of what it does beyond the data."""
        if any(diverges(model, extremes.larger) for extremes in self.extremes):
            return np.inf
        if not any(diverges_held(model, extremes) for extremes in self.extremes):
            return 1.0
        safe = self.wary and not any(diverges(model, extremes.backwards) for extremes in self.extremes)
        return MUCH_BETTER**2 if safe else np.inf


def fit_to_compare(structure: Structure, records: Record | Sequence[Record], start: Any, control: Control) -> Fit[Narx]:
    """A fit to the free run that is as exact as a comparison of errors needs, without intervals."""
    return fit_free_run(
        structure,
        records,
        start=start,
        max_iterations=ITERATIONS,
        tolerance=TOLERANCE,
        least_saving=SAVING,
        control=control.quietly(),
        covariances=False,
    )
