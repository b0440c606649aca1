"""Fitted models in the order of recommendation, with their errors on every part of the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import Control
from emsid.findings import Finding
from emsid.identification.determined import Undetermined
from emsid.identification.observations import about_the_fits
from emsid.identification.ranking import Ranked, ranked, ranked_ahead
from emsid.identification.recommendation import recommended
from emsid.identification.unstable import horizon_of
from emsid.identification.verdict import excluded_models, implausible_models, is_weak, model_verdicts, unusable
from emsid.options import Options
from emsid.record import Record
from emsid.record.holding_back import choice_and_headline
from emsid.validation.comparison import Comparison, compare


@dataclass(frozen=True, eq=False)
class Compared:
    """The models of an identification, compared.

    Attributes:
        record: the data they were fitted to.
        on_record: their errors on these.
        on_choice: on the unseen data that choose among them; None where `on_unseen` does.
        on_unseen: on unseen data, the recommended model first, implausible and useless ones last.
        ranking: their errors over the folds that ranked them.
        findings: of the estimators, and on how plausible the models are.
        undetermined: what the data leave open about the models.
        pole: of a plant that is unstable without its controller; else None.
        whole: what the recommended model was fitted to in the end, where that is more than `record`; else None.
    """

    record: Record
    on_record: Comparison
    on_choice: Comparison | None
    on_unseen: Comparison
    ranking: tuple[Ranked, ...]
    findings: tuple[Finding, ...]
    undetermined: Undetermined
    pole: float | None
    whole: Record | None = None

    @classmethod
    def of(
        cls,
        fits: Sequence[Fit[Any]],
        train: Record,
        test: Record,
        options: Options,
        control: Control,
        outside: Record | None = None,
        *,
        transient: int | None,
        whole: Record | None,
        pole: float | None = None,
    ) -> Compared:
        """Compare models.

        Args:
            fits: the models.
            train: what they were fitted to.
            test: unseen data.
            options: how they were fitted.
            control: when to stop; the unseen data then decide alone.
            outside: the data outside an excerpt that the models were fitted to.
            transient: samples that start the models where a segment begins in motion; they enter no error.
            whole: all data, where the unseen data are a part of them; these are then divided, and the models followed
                over folds of all data. None where the unseen data are others.
            pole: of a plant that is unstable without its controller: models are ranked by their predictions.
        """
        on_record = compare(fits, train, transient=transient, data="identification")
        findings = about_the_fits(fits, train)
        on_choice, on_unseen = _held_back(fits, test, transient, divide=whole is not None)
        chosen_on, seen = on_choice or on_unseen, whole if on_choice is None else None
        errors = {each.row.model: each.row.ranked_by for each in chosen_on.assessments}
        fitted, excluded = None if whole is None else train, excluded_models(findings, errors)
        if pole is not None:
            ranking = ranked_ahead(chosen_on, horizon_of(pole))
            useless = frozenset(each.row.model for each in chosen_on.assessments if each.row.diverged_at is None)
            left_open = Undetermined({}, frozenset(), None)
        else:
            ranking = ranked(chosen_on, fitted, options, excluded, control, outside, seen)
            useless = excluded | _useless(chosen_on, on_record)
            left_open = Undetermined.of(ranking, train, useless | implausible_models(findings))
            useless |= {each.row.model for each in chosen_on.assessments if is_weak(each, left_open.reasons)}
        order = _order(chosen_on, on_record, ranking, findings, useless, left_open)
        on_choice = on_choice and on_choice.in_order_of(order)
        return cls(train, on_record, on_choice, on_unseen.in_order_of(order), ranking, tuple(findings), left_open, pole)

    @property
    def fits(self) -> tuple[Fit[Any], ...]:
        """The models, the recommended one first."""
        return self.on_unseen.fits

    @property
    def best(self) -> Fit[Any]:
        """The recommended model."""
        return self.fits[0]

    @property
    def chosen_on(self) -> Record:
        """The unseen data that choose among the models."""
        return (self.on_choice or self.on_unseen).best.record

    def with_finished(self, fit: Fit[Any], whole: Record) -> Compared:
        """The same with a fit of the recommended model to more data; the errors that chose it stay as they were."""

        def in_place(each: Ranked) -> Ranked:
            return replace(each, fit=fit) if each.name == fit.model.name else each

        on_record, on_unseen = (each.with_fit(fit) for each in (self.on_record, self.on_unseen))
        findings = tuple(about_the_fits(on_unseen.fits, self.record))
        ranking = tuple(map(in_place, self.ranking))
        return replace(self, on_record=on_record, on_unseen=on_unseen, ranking=ranking, findings=findings, whole=whole)


def _held_back(
    fits: Sequence[Fit[Any]], unseen: Record, transient: int | None, *, divide: bool
) -> tuple[Comparison | None, Comparison]:
    """The models on the unseen data that choose among them, None where all do, and on those that give their errors."""
    parts = choice_and_headline(unseen) if divide and len(fits) > 1 else None
    if parts is None:
        return None, compare(fits, unseen, transient=transient, data="unseen")
    choice, headline = parts
    return compare(fits, choice, transient=transient, data="choice"), compare(
        fits, headline, transient=transient, data="unseen"
    )


def _useless(choice: Comparison, on_record: Comparison) -> frozenset[str]:
    """The names of the models that cannot be used, by their free run on the data that choose."""
    fitted = {each.row.model: each for each in on_record.assessments}
    return frozenset(each.row.model for each in choice.assessments if unusable(each, fitted[each.row.model]))


def _order(
    choice: Comparison,
    on_record: Comparison,
    ranking: Sequence[Ranked],
    findings: Sequence[Finding],
    useless: frozenset[str],
    left_open: Undetermined,
) -> list[Fit[Any]]:
    """The models: the recommended one, plausible ones, implausible ones, and useless ones; each group by its errors."""
    implausible = implausible_models(findings)

    def supported() -> list[str]:
        verdicts = model_verdicts(on_record, choice, findings, left_open.reasons)
        return [each.data["model"] for each in verdicts if each.code == "model-supported"]

    straight = () if left_open.levels is None else left_open.straight
    first = recommended(ranking, implausible, useless, straight=straight, supported=supported)
    by = sorted(ranking, key=lambda each: (each is not first, each.name in useless, each.name in implausible))
    return [each.fit for each in by]
