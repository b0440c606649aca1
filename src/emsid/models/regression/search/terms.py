r"""Terms of a nonlinear regression, selected from a dictionary by the free run.

Least squares selects the terms that predict best one step ahead. At a short sample time almost all terms predict well,
and the errors hardly show which of them a free run needs. So terms are selected by the linearised free run. At the
model so far, the output changes by ``δŷ = Σⱼ Sⱼ δθⱼ``, where Sⱼ is the exact derivative with respect to the parameter
of a term, those not yet in the model at θⱼ = 0 included. Orthogonal forward selection on [S, y − ŷ] finds the term that
reduces the free-run error most. It is added, and all parameters are fitted again. Terms are added until they no longer
reduce the error on unseen data; then those with the smallest θⱼ²/var θⱼ are removed, as long as that error hardly
grows.

Unseen data do not show all that is superfluous: of many terms, some reduce the error on any data by chance. So those
that the fit to all data does not support are removed in the end, by the extended criterion of Schwarz, see `supported`.

References:
    Billings, *Nonlinear System Identification* (2013), ch. 3. Piroddi, Spinelli, *An identification algorithm for
    polynomial NARX models based on simulation error minimization*, International Journal of Control 76 (2003).
    Chen, Chen, *Extended Bayesian information criteria for model selection with large model spaces*, Biometrika 95
    (2008).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from math import log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.fit import Fit
from emsid.estimation.linear.information import Information
from emsid.models.regression.free_run_fit import FreeRunError
from emsid.models.regression.narx import Narx, Structure
from emsid.models.regression.regressors import Regressor
from emsid.models.regression.search.cross_validation import CrossValidation, fit_to_compare
from emsid.models.regression.term_selection import forward_selection
from emsid.selection.improvement import StretchErrors, better
from emsid.selection.improvement import simplest as simplest_model

Array = NDArray[np.float64]

# The search ends after this many terms in a row that do not reduce the error on unseen data, by more than noise.
PATIENCE = 5
# The largest number of terms.
MOST_TERMS = 40
# A trial whose mean square error on the fitted data is larger by more than this factor lacks a term.
WORSE = 1.25
# One in this many terms is removed at a time.
AT_ONCE = 6
# Samples in which the derivatives of all terms of a dictionary are compared; of a longer record, every k-th.
COMPARED = 20_000


Refit = Callable[[Structure, Array], Fit[Narx] | None]
"""Fits a structure to data, from a start."""


class Trial(NamedTuple):
    """A structure with its fit to the data that the search sees, and its free-run errors on unseen data."""

    fit: Fit[Narx]
    errors: StretchErrors

    @property
    def terms(self) -> int:
        """How many terms it has."""
        return len(self.fit.estimate)


def select_by_free_run(start: Fit[Narx], dictionary: Structure, validation: CrossValidation) -> Trial:
    """The simplest structure whose free run on unseen data is as good as the best that was found.

    Args:
        start: a model to begin with, such as an output-error model; its terms can be removed too.
        dictionary: terms that can be added.
        validation: the data.

    Raises:
        Stopped: if the control of the validation ends the search.
    """
    trials = grow(Trial(start, validation.refitted(start)), dictionary, validation)
    trials += prune(simplest(trials), validation)
    return simplest(trials)


def simplest(trials: Sequence[Trial]) -> Trial:
    """The trial with the fewest terms among those that are as good as the best."""
    return simplest_model(trials, lambda trial: trial.terms, as_good=_fits_as_well)


def as_good(simpler: Trial, best: Trial) -> bool:
    """Whether a trial with fewer terms is as good: on unseen data within noise, and not much worse on fitted data."""
    return _fits_as_well(simpler, best) and not better(best.errors, simpler.errors)


def _fits_as_well(simpler: Trial, best: Trial) -> bool:
    """Whether a trial is not much worse on fitted data.

    This matters where few unseen stretches hold most of the error: chance then explains any difference.
    """
    return simpler.fit.noise_variance <= WORSE * best.fit.noise_variance


def grow(first: Trial, dictionary: Structure, validation: CrossValidation) -> list[Trial]:
    """The trials with one term more at a time."""
    trials, best, failures = [first], first.errors, 0
    while failures < PATIENCE and trials[-1].terms < MOST_TERMS:
        validation.control.doing(f"adding term {trials[-1].terms + 1}", trials[-1].terms, MOST_TERMS)
        structure, start = next_term(trials[-1].fit, dictionary, validation)
        if structure is None:
            break
        try:
            fit = fit_to_compare(structure, validation.fitted, start, validation.control)
        except EmsidError:
            break
        trials.append(Trial(fit, validation.refitted(fit)))
        if better(trials[-1].errors, best):
            best, failures = trials[-1].errors, 0
        else:
            failures += 1
    return trials


def next_term(fit: Fit[Narx], dictionary: Structure, validation: CrossValidation) -> tuple[Structure | None, Array]:
    """The structure with the term that reduces the linearised free-run error most, and a start for its parameters.

    The structure is None where every other term is a combination of those there are.
    """
    structure = fit.model.structure
    whole = structure + dictionary
    here = np.concatenate([fit.estimate, np.zeros(len(whole) - len(structure))])
    count = len(structure)
    try:
        chosen = forward_selection(linearised(whole, here, validation), count + 1, first=range(count)).order
    except (EmsidError, ValueError):  # terms that depend on each other: nothing can be added
        return None, here
    if len(chosen) == count:
        return None, here
    return with_terms(whole, chosen), here[list(chosen)]


def linearised(structure: Structure, theta: Array, validation: CrossValidation) -> Information:
    """The information of [S, y − ŷ] at θ, from at most `COMPARED` samples."""
    segments = [s for record in validation.fitted for s in record.segments if len(s) > structure.memory]
    every = max(1, -(-sum(map(len, segments)) // COMPARED))
    information = Information.empty(len(structure))
    for residual, derivative in FreeRunError(structure, segments, structure.memory).linearised(theta):
        rows = np.vstack([derivative[::every].T, -residual[::every]])
        information = information.add_columns(np.ascontiguousarray(rows))
    return information


def prune(best: Trial, validation: CrossValidation) -> list[Trial]:
    """The trials with fewer terms, as long as the error on unseen data hardly grows.

    Of many terms several are removed at a time, and half as many where that was too many.
    """
    trials: list[Trial] = []
    last = least = best
    number = max(1, best.terms // AT_ONCE)
    while last.terms > number:
        validation.control.doing(f"removing terms of {best.terms}", best.terms - last.terms, best.terms)
        trial = _without(last, number, validation)
        if trial is not None and as_good(trial, least) and as_good(trial, best):
            last, least = trial, min(least, trial, key=lambda each: each.errors.mean)
            trials.append(trial)
        elif number > 1:
            number //= 2
        else:
            break
    return trials


def _without(trial: Trial, number: int, validation: CrossValidation) -> Trial | None:
    """The trial without the terms of smallest θⱼ²/var θⱼ; None where the rest cannot be fitted."""
    structure, theta = trial.fit.model.structure, trial.fit.estimate
    try:
        covariance = linearised(structure, theta, validation).solve().covariance
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = np.nan_to_num(theta**2 / np.diag(covariance))
        kept = np.sort(np.argsort(weight)[number:])
        start = of_the_rest(theta, covariance, kept)
        fit = fit_to_compare(with_terms(structure, kept.tolist()), validation.fitted, start, validation.control)
    except EmsidError:
        return None
    return Trial(fit, validation.refitted(fit))


def supported(fit: Fit[Narx], refit: Refit, dictionary: int, given: Collection[Regressor] = ()) -> Fit[Narx]:
    """A fit to all data without the terms that these do not support, fitted again after each.

    The weakest term is removed as long as θⱼ²/var θⱼ is below that of Schwarz's criterion, log N, and for a term that
    was selected below that of the extended criterion, log N + 2 log P: of P terms, the strongest one without a true
    effect has about 2 log P. A term without which the fit is much worse (`WORSE`) stays: where a model lacks something,
    its residual is large and slow, and hardly any term is certain.

    Args:
        fit: to all data.
        refit: fits a structure to them, from a start; None where the model is not to be used.
        dictionary: P, the number of terms that were selected from.
        given: terms that were not selected.
    """
    products, most = {regressor.factors for regressor in given}, WORSE * fit.noise_variance
    while len(fit.estimate) > 1 and np.isfinite(fit.covariance).all():
        structure, theta = fit.model.structure, fit.estimate
        selected = np.array([regressor.factors not in products for regressor in structure.regressors])
        least = log(fit.samples) + selected * 2 * log(dictionary)
        with np.errstate(divide="ignore"):
            support = theta**2 / np.diag(fit.covariance) / least
        weakest = int(np.argmin(support))
        if not support[weakest] < 1:
            break
        kept = np.delete(np.arange(len(theta)), weakest)
        try:
            shorter = refit(with_terms(structure, kept.tolist()), of_the_rest(theta, fit.covariance, kept))
        except EmsidError:
            break
        if shorter is None or shorter.noise_variance > most:
            break
        fit = shorter
    return fit


def of_the_rest(theta: Array, covariance: Array, kept: NDArray[np.intp]) -> Array:
    """(k,) the kept parameters where the others are zero, at the minimum of a cost that is quadratic about θ.

    θₖ − Cₖᵣ Cᵣᵣ⁻¹ θᵣ with the covariance C (n, n), for the kept k and the removed r. Without this step the free run is
    often far from the record, and a fit begins anew with the one-step prediction.
    """
    gone = np.setdiff1d(np.arange(len(theta)), kept)
    inside = covariance[np.ix_(gone, gone)]
    if not np.isfinite(covariance).all() or np.linalg.cond(inside) > 1 / np.finfo(float).eps:
        return theta[kept]
    moved: Array = covariance[np.ix_(kept, gone)] @ np.linalg.solve(inside, theta[gone])
    return theta[kept] - moved


def with_terms(structure: Structure, indices: Sequence[int]) -> Structure:
    """A structure with some of the regressors, under the same name; each parameter is called by its term."""
    chosen = tuple(structure.regressors[k] for k in indices)
    return Structure(chosen, structure.name, tuple(map(str, chosen)), structure.inputs)
