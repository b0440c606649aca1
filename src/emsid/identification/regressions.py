"""Regressions as candidates: fitted one step ahead by least squares, or to the free run, or with selected terms.

Orders, delay, knots and terms that are not given are chosen by the free run on selection data, see `CrossValidation`.
Then the model is fitted to the whole record.

Linear models with a noise model as candidates: ARMAX, Box–Jenkins and state space.

Orders that are not given are chosen from one triangular factor each: those of ARMAX and of the noise of Box–Jenkins by
the criterion of Schwarz, those of the input part of Box–Jenkins as for an output-error model, and the order of a state
space from its singular values.

**Coordinate search.** A full grid over five choices takes thousands of fits. Optimising one choice at a time, in a few
rounds, takes dozens and rarely gives another result. Values are listed from simple to complex; the simplest one that is
as good as the best is chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import chain, product, repeat
from typing import Any, ClassVar
from weakref import WeakKeyDictionary

import numpy as np

from emsid.errors import EmsidError, ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import gather
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.findings import Finding
from emsid.models.linear.prediction_error import armax_orders, box_jenkins, fit_polynomials, noise_orders
from emsid.models.linear.subspace_fit import fit_state_space, state_space
from emsid.models.regression.free_run_fit import fit_free_run
from emsid.models.regression.intervals import with_robust_intervals
from emsid.models.regression.narx import Narx, Structure
from emsid.models.regression.search.cross_validation import CrossValidation, fit_to_compare
from emsid.models.regression.search.orders import output_error_orders
from emsid.models.regression.search.terms import Trial, prune, select_by_free_run, simplest, supported
from emsid.models.regression.structures import (
    arx,
    friction_narx,
    input_knots,
    polynomial_narx,
    wiener_hammerstein_regression,
)
from emsid.models.regression.term_selection import about_dictionary, select_terms
from emsid.models.regression.transforms import Transform
from emsid.options import Options
from emsid.record import Record
from emsid.selection.improvement import STRETCHES, StretchErrors, better

BEGUN_AGAIN = 20_000
"""Searches over at most this many samples are begun again where they do not converge."""
DEGREE = 3
"""The largest degree of the products that terms are selected from, unless it is given."""
LARGE, SHORTLIST = 400, 100
"""Of a dictionary with more terms than `LARGE`, `SHORTLIST` are selected one step ahead before the free run decides."""

Choice = Mapping[str, int]
Choices = Mapping[str, Sequence[int]]
Build = Callable[[Record, Choice], Structure]


@dataclass(frozen=True)
class Regression:
    """A family of linear-in-the-parameters structures as a candidate, fitted by least squares.

    Args:
        summary: what it is, in a few words.
        build: the structure for a record and choices.
        choices: the values to try for every option of the family, from simple to complex.
    """

    summary: str
    build: Build
    choices: Choices

    @property
    def uses(self) -> tuple[str, ...]:
        """The options that make a difference to it."""
        return (*_options_among(self.choices), "ridge", "forgetting", "held_back")

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose options that are not given on selection data, then fit to the whole record."""
        structure = chosen_structure(self.build, self.choices, record, options, control)
        fit = options.estimate(structure, record, each_block=partial(control.doing, "fitting to all rows"))
        return with_robust_intervals(fit, record) if not options.ridge and options.forgetting is None else fit


# What was chosen for a record, as long as it lives: models that begin with the same orders ask for them again.
_CHOSEN: WeakKeyDictionary[Record, dict[tuple[Any, ...], Any]] = WeakKeyDictionary()


@dataclass(frozen=True)
class OutputError:
    """A linear model fitted to the free run as a candidate: ARX without the bias of its equation error."""

    summary: str
    choices: Choices

    @property
    def uses(self) -> tuple[str, ...]:
        """The options that make a difference to it."""
        return (*_options_among(self.choices), "held_back")

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose options that are not given on selection data, then fit to the free run over the whole record."""
        return refit_to(self.chosen(record, options, control), record, control)

    def chosen(self, record: Record, options: Options, control: Control) -> Fit[Narx]:
        """The fit to selection data of the structure whose free run is best."""
        given = {name: getattr(options, name, None) for name in self.choices}
        key = ("free run", *given.values(), options.held_back)
        known = _CHOSEN.setdefault(record, {})
        if key not in known:
            tried = [values if (one := given[name]) is None else (one,) for name, values in self.choices.items()]
            grid = [dict(zip(self.choices, values, strict=True)) for values in product(*tried)]
            fit = output_error_orders(record, grid, options.held_back, control)
            structure = replace(fit.model.structure, name="output-error")
            known[key] = replace(fit, model=replace(fit.model, structure=structure))
        chosen: Fit[Narx] = known[key]
        return chosen


@dataclass(frozen=True)
class FreeRunRegression:
    """A family of structures as a candidate: chosen by least squares, then fitted to the free run, without idle terms.

    Args:
        summary: what it is, in a few words.
        name: of the model.
        like: the family that is fitted by least squares.
    """

    summary: str
    name: str
    like: Regression

    @property
    def uses(self) -> tuple[str, ...]:
        """The options that make a difference to it."""
        return (*_options_among(self.like.choices), "held_back")

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose options that are not given on selection data, then fit to the free run over the whole record."""
        plain = replace(options, ridge=0.0, forgetting=None)
        structure = chosen_structure(self.like.build, self.like.choices, record, plain, control)
        structure = replace(structure, name=self.name)
        validation = CrossValidation.of(record, options.held_back, structure.memory, control)
        fit = fit_to_compare(structure, validation.fitted, None, control)
        first = Trial(fit, validation.refitted(fit))
        return refit_to(simplest([first, *prune(first, validation)]).fit, record, control)


@dataclass(frozen=True)
class PolynomialNarx:
    """Products of lagged outputs and inputs as a candidate, selected from a dictionary by the free run.

    It begins with an output-error model. The dictionary has its lags; if products help, lags one sample longer are
    tried too. With knots, it also has hinges of the inputs and dry friction.
    """

    summary: str
    linear: OutputError
    uses: ClassVar[tuple[str, ...]] = ("na", "nb", "nk", "degree", "knots", "held_back")

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Select terms on selection data, then fit to the free run over the whole record."""
        na, nb, nk, constant = self._lags(record, options, control)
        inputs = record.input.shape[1]
        structure = replace(arx(na, nb, nk, inputs, constant), name="polynomial-narx")
        given = structure.regressors
        validation = replace(CrossValidation.of(record, options.held_back, max(na, nk + nb) + 1, control), wary=True)
        fit = fit_to_compare(structure, validation.fitted, None, control)
        of_linear = validation.refitted(fit)
        dictionary = _dictionary(record, options, validation, (na, nb, nk))
        best = select_by_free_run(fit, dictionary, validation)
        if better(best.errors, of_linear):
            na, nb = na if options.na else na + 1, nb if options.nb else nb + 1
            dictionary = _dictionary(record, options, validation, (na, nb, nk))
            best = simplest([best, select_by_free_run(best.fit, dictionary, validation)])
        fit = refit_to(best.fit, record, control)

        def refit(structure: Structure, theta: Any) -> Fit[Narx] | None:
            found = refit_to(replace(fit, model=structure.model(theta, record), estimate=theta), record, control)
            return found if validation.factor(found.model) <= validation.factor(fit.model) else None

        fit = supported(fit, refit, len(dictionary), given)
        return replace(fit, findings=(*fit.findings, *_about_dictionary(dictionary, record)))

    def _lags(self, record: Record, options: Options, control: Control) -> tuple[int, int, int, bool]:
        """na, nb, nk and whether there is a constant: those of the output-error model, and at least two outputs and
        three inputs from a delay of at most one sample, since a linear model may need less than its products."""
        found = self.linear.chosen(record, options, control).model.structure
        outputs, given = (
            [f.lag for r in found.regressors for f in r.factors if (f.channel > 0) == of_input]
            for of_input in (False, True)
        )
        first, last = min(given, default=1), max(given, default=1)
        na = max([*outputs, 2]) if options.na is None else options.na
        nk = min(first, 1) if options.nk is None else options.nk
        nb = max(last - nk + 1, 3) if options.nb is None else options.nb
        return na, nb, nk, "1" in found.labels


def _dictionary(record: Record, options: Options, validation: CrossValidation, lags: tuple[int, int, int]) -> Structure:
    """The terms to select from; of many, those that predict best one step ahead."""
    na, nb, nk = lags
    dictionary = polynomial_narx(na, nb, options.degree or DEGREE, nk, record.input.shape[1])
    if options.knots:
        hard = friction_narx(1, nb, input_knots(record, options.knots), nk, speeds=stribeck_speeds(record))
        bent = [r for r in hard.regressors if any(f.transform is not Transform.VALUE for f in r.factors)]
        dictionary += Structure(tuple(bent), inputs=dictionary.inputs)
    if len(dictionary) <= LARGE:
        return dictionary
    return select_terms(dictionary, validation.fitted, SHORTLIST, validation.control).structure


def _about_dictionary(dictionary: Structure, record: Record) -> tuple[Finding, ...]:
    """Whether the record tells the terms of a dictionary apart; nothing for one with more terms than samples."""
    if len(record) < 2 * len(dictionary):
        return ()
    return about_dictionary(dictionary, gather(dictionary, record)[0])


def refit_to(fit: Fit[Narx], record: Record, control: Control) -> Fit[Narx]:
    """The same structure fitted to the free run over a whole record, from a fit to a part of it.

    A search that does not converge is begun again, unless the record is so long that this takes minutes.
    """
    short = len(record) <= BEGUN_AGAIN
    return fit_free_run(fit.model.structure, record, start=fit.estimate, control=control, restarts=short)


def chosen_structure(build: Build, choices: Choices, record: Record, options: Options, control: Control) -> Structure:
    """The structure with the best free run on selection data.

    Args:
        build: the structure for a record and choices.
        choices: the values to try for every option, from simple to complex; an option that is given has one value.
        record: all data.
        options: what is given, and how structures are fitted.
        control: when to stop.
    """
    given: dict[str, int | None] = {name: getattr(options, name, None) for name in choices}
    tried = {name: values if (one := given[name]) is None else (one,) for name, values in choices.items()}
    if all(len(values) == 1 for values in tried.values()):
        return build(record, {name: values[0] for name, values in tried.items()})
    key = (build, *map(tuple, tried.values()), options.held_back, options.ridge, options.forgetting)
    known = _CHOSEN.setdefault(record, {})
    if key in known:
        return build(record, known[key])
    start = build(record, {name: values[-1] for name, values in tried.items()}).memory
    validation = CrossValidation.of(record, options.held_back, start, control)
    exact = 1e-20 * float(np.var(record.output))  # smaller differences are rounding

    def errors(choice: Choice) -> StretchErrors:
        try:
            structure = build(record, choice)
        except EmsidError:  # leave out a choice that is no structure
            return StretchErrors.of(np.full(STRETCHES, np.inf))
        return validation.errors(structure, lambda each, records: options.estimate(each, records).model, exact)

    known[key] = coordinate_search(errors, tried, partial(control.doing, "choosing orders"))
    return build(record, known[key])


def _options_among(choices: Choices) -> tuple[str, ...]:
    """The choices that a user can give."""
    known = {each.name for each in fields(Options)}
    return tuple(name for name in choices if name in known)


# --- the families ----------------------------------------------------------------------------------------------------


def linear(record: Record, choice: Choice) -> Structure:
    """ARX with the inputs of a record."""
    return arx(
        choice["na"], choice["nb"], choice["nk"], inputs=record.input.shape[1], constant=bool(choice["constant"])
    )


def _check_one_input(name: str, record: Record) -> None:
    if record.input.shape[1] > 1:
        raise ModelError(f"{name} has one input and {record.name} has {', '.join(record.input_names)}; choose one")


def expanded_wiener_hammerstein(record: Record, choice: Choice) -> Structure:
    """The paper's regression."""
    _check_one_input("wiener-hammerstein-regression", record)
    return wiener_hammerstein_regression(
        choice["na"],
        choice["nb"],
        choice["degree"],
        taps=choice["taps"],
        nk=choice["nk"],
        constant=bool(choice["constant"]),
    )


def friction(record: Record, choice: Choice) -> Structure:
    """A friction regression with knots and Stribeck speeds in the range of a record."""
    _check_one_input("friction-narx", record)
    structure = friction_narx(
        choice["na"],
        choice["nb"],
        knots=input_knots(record, choice["knots"]),
        nk=choice["nk"],
        speeds=stribeck_speeds(record),
    )
    if record.output.min() < 0 < record.output.max() or not record.output.all():
        return structure
    kept = [  # without a change of sign, friction acts like the constant
        k for k, r in enumerate(structure.regressors) if all(f.transform is not Transform.SIGN for f in r.factors)
    ]
    names = tuple(structure.parameter_names[k] for k in kept)
    return Structure(tuple(structure.regressors[k] for k in kept), structure.name, names, structure.inputs)


def stribeck_speeds(record: Record) -> tuple[float, float]:
    """Two speeds over which a Stribeck excess may decay: 3 and 10 % of the largest output."""
    top = float(abs(record.output).max())
    return float(f"{0.03 * top:.3g}"), float(f"{0.1 * top:.3g}")  # short numbers for the printed structure


LINEAR: Choices = {"nk": (0, 1, 2, 3), "na": (1, 2, 3, 4), "nb": (1, 2, 3, 4), "constant": (0, 1)}
_FRICTION = Regression(
    "ARX with dead-zone hinges, Coulomb and Stribeck friction",
    friction,
    {"nk": (0, 1, 2, 3), "na": (1, 2, 3), "nb": (1, 2, 3), "knots": (0, 4, 8, 12)},
)
_EXPANDED = Regression(
    "the paper's: ARX with powers and products of inputs",
    expanded_wiener_hammerstein,
    {
        "nk": (0, 1, 2, 3),
        "na": (1, 2, 3, 4),
        "nb": (1, 2, 3),
        "degree": (2, 3, 5),
        "taps": (1, 2),
        "constant": (0, 1),
    },
)
OUTPUT_ERROR = OutputError("linear, fitted to the free run", LINEAR)

REGRESSIONS: dict[str, Regression | OutputError | FreeRunRegression | PolynomialNarx] = {
    "arx": Regression("linear: past outputs and inputs", linear, LINEAR),
    "output-error": OUTPUT_ERROR,
    "wiener-hammerstein-regression": _EXPANDED,
    "wiener-hammerstein-regression-free-run": FreeRunRegression(
        f"{_EXPANDED.summary}, fitted to the free run", "wiener-hammerstein-regression-free-run", _EXPANDED
    ),
    "friction-narx": _FRICTION,
    "friction-narx-free-run": FreeRunRegression(
        f"{_FRICTION.summary}, fitted to the free run", "friction-narx-free-run", _FRICTION
    ),
    "polynomial-narx": PolynomialNarx(
        "products of past outputs and inputs, selected and fitted by the free run", OUTPUT_ERROR
    ),
}
"""Every regression by name."""


NOISE_ORDERS = 3
"""The largest number of coefficients of a noise polynomial."""


def _among(given: int | None, values: Sequence[int]) -> tuple[int, ...]:
    return tuple(values) if given is None else (given,)


@dataclass(frozen=True)
class Armax:
    """ARMAX as a candidate."""

    summary: str
    uses: ClassVar[tuple[str, ...]] = ("na", "nb", "nk")

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose orders that are not given, then minimise the prediction error over the whole record."""
        control.doing("choosing orders")
        nk, na, nb = (_among(getattr(options, name), LINEAR[name]) for name in ("nk", "na", "nb"))
        structure = armax_orders(record, nk, na, nb, range(NOISE_ORDERS + 1))
        control.doing("fitting")
        return fit_polynomials(structure, record, control=control)


@dataclass(frozen=True)
class BoxJenkins:
    """Box–Jenkins as a candidate: an output-error model with a model of its noise."""

    summary: str
    like: OutputError
    uses: ClassVar[tuple[str, ...]] = ("na", "nb", "nk", "held_back")

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose orders that are not given, then minimise the prediction error over the whole record."""
        found = self.like.chosen(record, options, control).model
        lags = [
            [f.lag for r in found.structure.regressors for f in r.factors if (f.channel > 0) == of_input]
            for of_input in (False, True)
        ]
        constant = "1" in found.structure.labels
        rest = [
            (segment.output - found.simulate(segment).output)[found.memory :, 0]
            for segment in record.segments
            if len(segment) > 2 * found.memory
        ]
        nc, nd = noise_orders(rest, NOISE_ORDERS)
        first, inputs = min(lags[1]), record.input.shape[1]
        structure = box_jenkins(max(lags[1]) - first + 1, nc, nd, max(lags[0], default=0), first, inputs, constant)
        control.doing("fitting")
        return fit_polynomials(structure, record, control=control)


@dataclass(frozen=True)
class StateSpace:
    """A state-space model as a candidate, fitted to the free run."""

    summary: str
    uses: ClassVar[tuple[str, ...]] = ("orders",)
    for_what_is_left: ClassVar[int] = 1
    several_outputs: ClassVar[bool] = True

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose the order if it is not given, then minimise the error of the free run over the whole record."""
        control.doing("fitting")
        order = options.orders[0] if options.orders else None
        return fit_state_space(state_space(order, direct=True), record, free_run=True, control=control)


# --- coordinate search ------------------------------------------------------------------------------------------------

ROUNDS = 2
"""Passes over all names."""


def coordinate_search(
    error: Callable[[Mapping[str, int]], StretchErrors],
    choices: Mapping[str, Sequence[int]],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[str, int]:
    """Choose a value for every name, one name at a time, so that the free-run error is small.

    Args:
        error: of the free run of a model with these choices on unseen data; may be infinite.
        choices: the allowed values of every name, from simple to complex; the search starts in the middle.
        progress: called with the number of errors that are known, and their number in all.

    Returns:
        The chosen value of every name.
    """
    known: dict[tuple[int, ...], StretchErrors] = {}

    def error_of(choice: Mapping[str, int]) -> StretchErrors:
        key = tuple(choice.values())
        if key not in known:
            known[key] = error(choice)
        return known[key]

    chosen = {name: values[len(values) // 2] for name, values in choices.items()}
    total, done = ROUNDS * sum(map(len, choices.values())), 0
    for name in chain.from_iterable(repeat(choices, ROUNDS)):
        errors = []
        for value in choices[name]:
            errors.append(error_of({**chosen, name: value}))
            done += 1
            progress(done, total)
        best = min(errors, key=lambda each: each.mean)
        chosen[name] = next(v for v, e in zip(choices[name], errors, strict=True) if e is best or not better(best, e))
    return chosen
