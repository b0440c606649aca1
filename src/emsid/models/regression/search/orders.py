r"""Orders of linear models: every (na, nb, nk) of a grid from one triangular factor.

The regressors of every ARX structure of a grid are among those of the largest one. So `Information.select` gives each
of them its estimate and its residual from one factor of the data, all over the same samples:

    AIC = N log(RSS/N) + 2p        BIC = N log(RSS/N) + p log N        FPE = RSS/N · (N + p)/(N − p)

The free run of each on unseen data is what the program chooses by. Least squares biases ARX where the output carries
noise. An output-error model has no such bias, but needs a search. Its start comes from instruments (see
`emsid.models.regression.instruments`), again for the whole grid from one factor: first with the free run of a
state-space model, then with that of the best structure. So each number of parameters has one promising structure before
any search begins.

References:
    Ljung, *System Identification*, 2nd ed. (1999), sec. 16.4. Akaike, *A new look at the statistical model
    identification*, IEEE Transactions on Automatic Control 19 (1974). Schwarz, *Estimating the dimension of a model*,
    Annals of Statistics 6 (1978). Zhu, *Multivariable System Identification for Process Control* (2001), on reducing a
    model of high order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from math import inf, log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError, ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.linear.filtering import mirrored
from emsid.estimation.linear.information import Information
from emsid.estimation.linear.least_squares import gather
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.models.linear.subspace_fit import state_space, subspace_models
from emsid.models.model import Model
from emsid.models.regression.instruments import (
    denominator,
    free_runs,
    instrument_estimate,
    instrument_information,
    instruments,
    stable,
)
from emsid.models.regression.narx import Narx, Structure
from emsid.models.regression.search.cross_validation import CrossValidation, fit_to_compare
from emsid.models.regression.structures import arx
from emsid.record import Record
from emsid.selection.improvement import StretchErrors, better, simplest

Array = NDArray[np.float64]
Choice = Mapping[str, int]

# Passes over the grid, each with the free run and the poles of the best model so far as instruments and filter. After
# the first of them this model is fitted to the free run before it serves as instrument.
PASSES, UNFITTED = 5, 2
# The search ends after this many sizes in a row that are not better than all smaller ones.
PATIENCE = 3
# The largest order of the state-space model that gives the first instruments.
MOST_ORDERS = 6
# A size whose start has an error larger by this factor than that of the best is left out.
MUCH_WORSE = 4.0


@dataclass(frozen=True, eq=False)
class OrderRow:
    """One structure of a grid.

    Attributes:
        na, nb, nk: coefficients of past outputs and of inputs, and delay in samples.
        constant: whether there is a constant.
        parameters: how many it has, p.
        variance: RSS/N of the prediction one step ahead.
        aic, bic, fpe: criteria of Akaike and Schwarz, and the final prediction error.
        free_run: mean square error of the free run on unseen data; infinite where it diverges.
    """

    na: int
    nb: int
    nk: int
    constant: bool
    parameters: int
    variance: float
    aic: float
    bic: float
    fpe: float
    free_run: float


@dataclass(frozen=True, eq=False)
class OrderTable:
    """Every structure of a grid; prints as a table, the smallest free-run error first.

    Attributes:
        rows: in the order of the grid.
        simplest: the row with the fewest parameters whose free run is as good as the best, within noise.
    """

    rows: tuple[OrderRow, ...]
    simplest: OrderRow

    def best(self, criterion: str = "free_run") -> OrderRow:
        """The row with the smallest value of a criterion: ``free_run``, ``bic``, ``aic`` or ``fpe``.

        Raises:
            ModelError: for another name.
        """
        if criterion not in ("free_run", "bic", "aic", "fpe"):
            raise ModelError(f"no criterion {criterion!r}; there are free_run, bic, aic and fpe")
        return min(self.rows, key=lambda row: (getattr(row, criterion), row.parameters))

    def __str__(self) -> str:
        names = ("na", "nb", "nk", "const", "p", "free-run MSE", "FPE", "AIC", "BIC")
        widths = (3, 3, 3, 5, 3, 13, 11, 12, 12)
        head = " ".join(f"{name:>{width}}" for name, width in zip(names, widths, strict=True))
        lines = [
            f"{r.na:3} {r.nb:3} {r.nk:3} {'yes' if r.constant else 'no':>5} {r.parameters:3} {r.free_run:13.6g} "
            f"{r.fpe:11.6g} {r.aic:12.1f} {r.bic:12.1f}"
            for r in sorted(self.rows, key=lambda row: row.free_run)
        ]
        return "\n".join([head, *lines])


def order_grid(
    record: Record,
    *,
    na: Iterable[int] = range(1, 5),
    nb: Iterable[int] = range(1, 5),
    nk: Iterable[int] = range(4),
    constant: Iterable[bool] = (False, True),
    unseen: float = 0.25,
    control: Control = FREE,
) -> OrderTable:
    """Every ARX structure of a grid, fitted from one triangular factor, with criteria and the free run on unseen data.

    Args:
        record: one output, any number of inputs.
        na, nb, nk: the numbers of coefficients and the delays to try.
        constant: whether to try structures with a constant, without, or both.
        unseen: the fraction of the record that the free run is judged on and no structure is fitted to; a short record
            is cross-validated instead.
        control: when to stop.

    Raises:
        ModelError: for an empty grid, or a record too short for its largest structure.
    """
    axes: dict[str, list[int]]
    axes = {"na": sorted(set(na)), "nb": sorted(set(nb)), "nk": sorted(set(nk)), "constant": sorted(set(constant))}
    if not all(axes.values()):
        raise ModelError(f"order_grid: no value of {next(name for name, values in axes.items() if not values)}")
    grid = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
    largest = _largest(grid, record)
    largest.check(record)
    validation = CrossValidation.of(record, unseen, largest.memory, control)
    factors = [gather(largest, train)[0] for train, _ in validation.splits]
    whole, _ = gather(largest, record)
    rows = []
    for number, choice in enumerate(grid):
        control.doing("trying orders", number, len(grid))
        structure = _structure(choice, record)
        columns = _columns(structure, largest)
        estimates = [factor.select(columns).solve().estimate for factor in factors]
        errors = validation.errors(structure, _models(estimates, record))
        rows.append(_Judged(_row(choice, whole.select(columns), errors.mean), errors))
    chosen = simplest(rows, size=lambda judged: judged.row.parameters).row
    return OrderTable(tuple(judged.row for judged in rows), chosen)


class _Judged(NamedTuple):
    row: OrderRow
    errors: StretchErrors


def _models(estimates: Sequence[Array], record: Record) -> Callable[[Structure, Sequence[Record]], Model]:
    """The models of one structure for one split after the other."""
    following = iter(estimates)
    return lambda structure, _: structure.model(next(following), record)


def _row(choice: Choice, information: Information, free_run: float) -> OrderRow:
    samples, count = information.samples, information.parameters
    variance = information.solve().residual_sum_of_squares / samples
    fit = samples * log(variance) if variance > 0 else -inf
    fpe = variance * (samples + count) / max(samples - count, 1)
    return OrderRow(
        choice["na"],
        choice["nb"],
        choice["nk"],
        bool(choice["constant"]),
        count,
        variance,
        fit + 2 * count,
        fit + count * log(samples),
        fpe,
        free_run,
    )


def _structure(choice: Choice, record: Record) -> Structure:
    inputs = record.input.shape[1]
    return arx(choice["na"], choice["nb"], choice["nk"], inputs, constant=bool(choice["constant"]))


def _largest(grid: Sequence[Choice], record: Record) -> Structure:
    """A structure with the regressors of all structures of a grid."""
    first, last = min(c["nk"] for c in grid), max(c["nk"] + c["nb"] for c in grid)
    return arx(max(c["na"] for c in grid), last - first, first, record.input.shape[1], constant=True)


def _columns(structure: Structure, among: Structure) -> list[int]:
    places = {regressor: k for k, regressor in enumerate(among.regressors)}
    return [places[regressor] for regressor in structure.regressors]


# --- output-error models ---------------------------------------------------------------------------------------------


def output_error_orders(record: Record, grid: Sequence[Choice], held_back: float, control: Control = FREE) -> Fit[Narx]:
    """The simplest output-error model of a grid whose free run on unseen data is as good as the best.

    Args:
        record: all data.
        grid: the choices of na, nb, nk and constant.
        held_back: the fraction of selection data.
        control: when to stop.

    Returns:
        The fit to the data that the search sees, a start for that to the whole record.

    Raises:
        ModelError: where no structure of the grid can be fitted.
    """
    largest = _largest(grid, record)
    validation = CrossValidation.of(record, held_back, largest.memory, control, folds=True)
    control.doing("choosing orders", 0, len(grid))
    starts = list(_starts(record, grid, largest, validation))
    found: list[_Trial] = []
    failures = 0
    for number, (structure, theta) in enumerate(starts):
        control.doing("choosing orders", len(grid) * (number + 1) // (len(starts) + 1), len(grid))
        try:
            fit = fit_to_compare(structure, validation.fitted, theta, control)
        except EmsidError:
            continue
        trial = _Trial(fit, validation.refitted(fit))
        failures = 0 if all(better(trial.errors, each.errors) for each in found) else failures + 1
        found.append(trial)
        if failures == PATIENCE:
            break
    if not found:
        na, nb = (f"{name} = {min(c[name] for c in grid)}" for name in ("na", "nb"))
        raise ModelError(
            f"{record.name}: no linear model of {na}, {nb} or more can be fitted to its free run; give lower orders, "
            "or check the data",
            arguments=("na", "nb"),
        )
    return simplest(found, size=lambda trial: len(trial.fit.estimate)).fit


@dataclass(frozen=True, eq=False)
class _Trial:
    fit: Fit[Narx]
    errors: StretchErrors


def _starts(
    record: Record, grid: Sequence[Choice], largest: Structure, validation: CrossValidation
) -> Iterator[tuple[Structure, Array]]:
    """The structures that are fitted to the free run, with starts: of every size the one with the best start."""
    structures = [_structure(choice, record) for choice in grid]
    columns = [_columns(structure, largest) for structure in structures]
    best: dict[int, tuple[float, Structure, Array]] = {}
    longest = max(structure.memory for structure in (largest, *structures))
    below, runs = _first_instruments(validation.fitted)
    for number in range(PASSES):
        runs = _longer(runs, longest)
        information = instrument_information(instruments(largest, below, runs))
        for structure, places in zip(structures, columns, strict=True):
            theta = stable(structure, instrument_estimate(information, places))
            error = _error(structure.model(theta, record), runs)
            if len(theta) not in best or error < best[len(theta)][0]:
                best[len(theta)] = (error, structure, theta)
        least, structure, theta = min(best.values(), key=lambda each: each[0])
        if not np.isfinite(least):
            break
        if number >= UNFITTED:
            with suppress(EmsidError):
                theta = stable(
                    structure, fit_to_compare(structure, validation.fitted, theta, validation.control).estimate
                )
        below, runs = denominator(structure, theta), free_runs(structure, theta, validation.fitted)
    for _, (error, structure, theta) in sorted(best.items()):
        if error <= MUCH_WORSE * least < inf:
            yield structure, theta


def _longer(runs: Sequence[tuple[Record, Record]], memory: int) -> list[tuple[Record, Record]]:
    """The segments of which twice the memory of a structure leaves samples.

    Raises:
        ModelError: where there is none.
    """
    found = [(segment, run) for segment, run in runs if len(segment) > 2 * memory]
    if not found:
        raise ModelError(f"no segment has more than {2 * memory} samples, twice those that start the model")
    return found


def _error(model: Narx, runs: Sequence[tuple[Record, Record]]) -> float:
    """The mean square error of the free run over all segments, each from the state of its noise-free output."""
    total, samples = 0.0, 0
    for segment, run in runs:
        begin = model.memory
        state = model.initial(run, begin)
        with np.errstate(all="ignore"):
            missed = model.run(state, segment.input[begin:])[0] - segment.output[begin:]
            total += float(np.sum(missed**2))
        samples += len(missed)
    return total / max(samples, 1) if np.isfinite(total) else inf


def _first_instruments(records: Sequence[Record]) -> tuple[Array, list[tuple[Record, Record]]]:
    """A denominator, and every segment with a nearly noise-free output, from a state-space model.

    Without such a model, the measured output itself.
    """
    segments = [segment for record in records for segment in record.segments]
    try:
        models = subspace_models(state_space(), records)
        model = models.model(min(models.order, MOST_ORDERS), direct=True, noise=False)
        found = [(s, model.simulate(s)) for s in segments if len(s) > 2 * model.memory]
    except EmsidError:
        found = []
    if not found or any(run.diverged_at is not None for _, run in found):
        return np.ones(1), [(segment, segment) for segment in segments]
    below = mirrored(np.asarray(np.poly(model.a), dtype=float))
    return below, [(segment, replace(segment, output=run.output)) for segment, run in found]
