"""Comparison of models by their free runs.

One-step errors are small for almost any model, because the model is given the last measured output. Models are
therefore ranked by their free run on unseen data.

Error measures as functions of measured and modelled output, both (N, ny).

Free-run errors by operating region, and by record.

The regions of a speed y are defined from its own range, with v the 99 % quantile of |y|:

=============  ========================================================================================
standstill     |y| ≤ 0.05 v
low speed      0.05 v < |y| ≤ 0.3 v
high speed     |y| > 0.3 v
reversal       the samples between high speed in one direction and high speed in the other, unless most
               of them are at standstill; they count as nothing else
=============  ========================================================================================

Friction and dead zones show at standstill and in reversals, saturation at high speed. An output that stays away from
zero has no standstill. A position has no regions: its size says nothing about motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, ModelError
from emsid.estimation.fit import FITTED, Fit
from emsid.findings import Finding
from emsid.models.free_run import RESTING, from_rest
from emsid.models.free_run import mean_squared_error as mean_squared_error
from emsid.models.model import Model, Run
from emsid.models.verbs import for_model
from emsid.presentation import Presented
from emsid.record import Record, concatenate
from emsid.record.frames import frame
from emsid.validation.correlation import NonlinearTest, free_run_tests


@dataclass(frozen=True)
class OutputErrors:
    """The errors of one output of several.

    Attributes:
        output, unit: its name and unit.
        one_step_mse, simulation_mse: as in `Row`, in that unit squared.
        simulation_rmse: in that unit.
        fit_percent: fit of the free run.
    """

    output: str
    unit: str
    one_step_mse: float
    simulation_mse: float
    simulation_rmse: float
    fit_percent: float


@dataclass(frozen=True)
class Row:
    """One model on one record: a row of every table of results.

    Attributes:
        experiment: ``simulation``, ``experiment`` or ``record``.
        model: name of the model.
        method: how it was estimated: ``ls``, ``rls``, …
        data: ``identification`` (the data the model was fitted to), ``choice`` (unseen data that chose among models) or
            ``unseen``.
        one_step_mse: MSE (5.14) of the prediction one sample ahead, in the output's unit squared; NaN for a model that
            does not model noise (a cascade, a plant), whose prediction would mean something else.
        simulation_mse: MSE of the free run.
        simulation_rmse: RMSE of the free run, in the output's unit.
        fit_percent: fit of the free run; see `emsid.validation.comparison.fit_percent` for where there is none.
        parameters: how many were estimated.
        samples: how many samples the errors were computed on.
        diverged_at: sample at which the free run diverged, or None.
        outputs: the errors of each output if there are several. The errors above are then over all outputs together,
            without regard to their units.
    """

    experiment: str
    model: str
    method: str
    data: str
    one_step_mse: float
    simulation_mse: float
    simulation_rmse: float
    fit_percent: float
    parameters: int
    samples: int
    diverged_at: int | None = None
    outputs: tuple[OutputErrors, ...] = ()

    @property
    def fit_in_words(self) -> str:
        """The fit, or why there is none, for a sentence."""
        return _fit_in_words(self.fit_percent)

    @property
    def fitted(self) -> str:
        """How it was fitted, see `emsid.estimation.fit.Fit.fitted`."""
        return FITTED.get(self.method, self.method)

    @property
    def data_label(self) -> str:
        """The data of the row, for tables: ``used in fit``, ``used to choose`` or ``unseen``."""
        return {"identification": "used in fit", "choice": "used to choose"}.get(self.data, self.data)

    @property
    def ranked_by(self) -> float:
        """The free-run MSE; for several outputs, the mean of MSE divided by measured variance."""
        shares = [(1 - each.fit_percent / 100) ** 2 for each in self.outputs if not np.isnan(each.fit_percent)]
        return float(np.mean(shares)) if shares else self.simulation_mse

    def to_data(self) -> dict[str, Any]:
        """The fields in built-in types. Infinite numbers become None; a single output is not listed."""
        data = _finite(asdict(self))
        listed = [_finite(each) for each in data.pop("outputs")]
        return data | ({"outputs": listed} if listed else {})


def _fit_in_words(fit: float) -> str:
    if np.isfinite(fit):
        return f"a fit of {fit:.1f} %"
    return f"no fit, as {'the measured output is constant' if np.isnan(fit) else 'it diverges'}"


def _finite(data: dict[str, Any]) -> dict[str, Any]:
    return {k: None if isinstance(value, float) and not np.isfinite(value) else value for k, value in data.items()}


@dataclass(frozen=True, eq=False, repr=False)
class Assessment(Presented):
    """A fitted model run over a record.

    Attributes:
        fit: the model.
        record: the data it was run on.
        row: its errors.
        simulation: the free run.
        prediction: the prediction one step ahead.
        transient: the number of samples that start a segment in motion.
    """

    fit: Fit[Model]
    record: Record
    row: Row
    simulation: Run
    prediction: Run
    transient: int

    @cached_property
    def errors(self) -> Array:
        """(N, ny) what the free run leaves of the measured outputs; NaN for samples that do not count."""
        return np.where(self.simulation.counted[:, None], self.record.output - self.simulation.output, np.nan)

    @cached_property
    def nonlinear_tests(self) -> tuple[tuple[NonlinearTest, ...], ...]:
        """The residual of every output against nonlinear functions of the inputs, see `free_run_tests`."""
        return free_run_tests(self.record, self.simulation)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """That the free run diverges, or is no better than the mean of the output; empty where neither is the case."""
        row, seen = self.row, self.row.data == "identification"
        if row.diverged_at is not None:
            data = {"model": row.model, "sample": int(row.diverged_at), "seen": seen}
            return (Finding("free-run-diverged", row.model, data),)
        return (Finding("worse-than-mean", self.record.name),) if row.fit_percent <= 0 else ()

    def __repr__(self) -> str:
        return f"Assessment({self.row.model} on {self.record.name[:30]}: {self.row.fit_in_words})"

    @property
    def input_moves(self) -> bool:
        """Whether an input changes in the record; the data test the steady state only if none does."""
        return bool(np.ptp(self.record.input, axis=0).any())

    @cached_property
    def on_other_inputs(self) -> tuple[Run, Run]:
        """The free runs from the same initial states with the inputs shuffled, and held at their means.

        `BLOCKS` blocks of random lengths change places across the whole record, since the input can be constant in a
        segment; blocks of equal lengths would leave a periodic input as it is. The samples that start a segment stay.
        """
        record, rng = self.record, np.random.default_rng(SEED)
        moved = np.ones(len(record), dtype=bool)
        for start in (0, *record.breaks):
            moved[start : start + max(self.transient, RESTING)] = False
        u = record.input[moved]
        cuts = np.sort(rng.permutation(np.arange(1, len(u)))[: BLOCKS - 1])
        blocks = np.split(u, cuts)
        places = np.roll(rng.permutation(len(blocks)), 1)
        shuffled, held = record.input.copy(), record.input.copy()
        shuffled[moved] = np.concatenate([blocks[k] for k in places])
        held[moved] = record.input.mean(axis=0)
        run = self.fit.model.simulate
        first, second = (run(replace(record, input=u), self.transient) for u in (shuffled, held))
        return first, second


BLOCKS, SEED = 8, 1
"""The blocks of a shuffled input, few so that most are long beside the response; and the seed of their order."""


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Presented):
    """Several models on the same samples of the same records.

    Attributes:
        assessments: every model run over the record, the best free run first (of the data that chose, where these are
            others).
    """

    assessments: tuple[Assessment, ...]

    def in_order_of(self, fits: Sequence[Fit[Any]]) -> Comparison:
        """The same assessments in the order of these fits."""
        place = {id(fit): k for k, fit in enumerate(fits)}
        return Comparison(tuple(sorted(self.assessments, key=lambda each: place[id(each.fit)])))

    @property
    def by_error(self) -> Comparison:
        """The same assessments in the order of their own free-run errors, `Row.ranked_by`, for tables of these."""
        return Comparison(tuple(sorted(self.assessments, key=lambda each: each.row.ranked_by)))

    def with_fit(self, fit: Fit[Any]) -> Comparison:
        """The same with another fit of the model of its name, run over the same samples."""

        def assessed(before: Assessment) -> Assessment:
            if before.row.model != fit.model.name:
                return before
            return assess(fit, before.record, before.transient, experiment=before.row.experiment, data=before.row.data)

        return Comparison(tuple(map(assessed, self.assessments)))

    @property
    def rows(self) -> tuple[Row, ...]:
        """A row for every model."""
        return tuple(assessment.row for assessment in self.assessments)

    @property
    def fits(self) -> tuple[Fit[Any], ...]:
        """The models, the best free run first."""
        return tuple(assessment.fit for assessment in self.assessments)

    def to_frame(self, library: str = "polars") -> Any:
        """A data frame with time, measured outputs, and simulated outputs and errors of every model, one per row.

        Columns are named ``speed``, ``speed by arx`` and ``error of speed by arx``; NaN where a run has diverged.

        Args:
            library: ``"polars"`` or ``"pandas"``.
        """
        record = self.best.record
        columns = {"t": record.time}
        columns |= dict(zip(record.output_names, record.output.T, strict=True))
        for label, each in zip(labels(self.assessments), self.assessments, strict=True):
            for k, name in enumerate(record.output_names):
                simulated = each.simulation.output[:, k]
                columns[f"{name} by {label}"] = simulated
                columns[f"error of {name} by {label}"] = record.output[:, k] - simulated
        return frame(columns, library)

    @property
    def best(self) -> Assessment:
        """The first model: that with the smallest free-run error, `Row.ranked_by`, on the data that chose."""
        return self.assessments[0]

    def __repr__(self) -> str:
        best = self.best.row
        name = best.model if len(best.model) <= 40 else f"{best.model[:39]}…"
        where = self.best.record.name[:30]
        return f"Comparison({len(self.rows)} models on {where}; best {name}, fit {best.fit_percent:.2f} %)"


def labels(assessments: Sequence[Assessment]) -> tuple[str, ...]:
    """Labels for legends: the model, with how it was fitted if a model occurs twice."""
    rows = [each.row for each in assessments]
    models = [row.model for row in rows]
    names = [row.model if models.count(row.model) == 1 else f"{row.model}, {row.fitted}" for row in rows]
    return tuple(
        name if names.count(name) == 1 else f"{name}, no. {names[: k + 1].count(name)}" for k, name in enumerate(names)
    )


def validate(
    model: Fit[Any] | Model,
    record: Record,
    transient: int | None = None,
    *,
    experiment: str = "record",
    data: str = "unseen",
) -> Assessment:
    """Compute the free run and the one-step prediction of a model on a record.

    Args:
        model: the model, or a fit of it.
        record: the data, which are converted to the units of the fit. The first ``transient`` samples of a segment in
            motion start the model and are left out of errors; a segment that begins at rest counts whole.
        transient: in samples; by default as many as the model needs.
        experiment, data: labels of the row.

    Raises:
        ModelError: for a record that the model cannot be run on.
        DataError: where no sample is left for an error.
    """
    fit = as_fit(model)
    record = for_model(fit, record)
    simulation = fit.model.simulate(record, transient)
    prediction = fit.model.predict(record, 1, transient)
    counted = simulation.counted
    if not counted.any():
        raise DataError(
            f"{record.name}: no segment is longer than the {transient or fit.model.memory} samples that start "
            f"{fit.model.name}; choose a shorter transient or a longer record"
        )
    measured, free, ahead = (values[counted] for values in (record.output, simulation.output, prediction.output))
    if not models_noise(fit.model):
        ahead = np.full_like(ahead, np.nan)
    mse = mean_squared_error(measured, free)
    return Assessment(
        fit,
        record,
        Row(
            experiment=experiment,
            model=fit.model.name,
            method=fit.method,
            data=data,
            one_step_mse=_one_step(measured, ahead),
            simulation_mse=mse,
            simulation_rmse=float(np.sqrt(mse)),
            fit_percent=fit_percent(measured, free),
            parameters=fit.size,
            samples=int(np.count_nonzero(counted)),
            diverged_at=simulation.diverged_at,
            outputs=_each_output(record, measured, free, ahead) if measured.shape[1] > 1 else (),
        ),
        simulation,
        prediction,
        max(transient or 0, fit.model.memory),
    )


def models_noise(model: Model) -> bool:
    """Whether a model is one of the noise too, as a regression is that predicts from past outputs.

    Other models have a prediction one step ahead only by an assumption: their error is taken to stay as it is.
    """
    return bool(getattr(model, "models_noise", True))


def _one_step(measured: Array, ahead: Array) -> float:
    return float("nan") if np.isnan(ahead).all() else mean_squared_error(measured, ahead)


def _each_output(record: Record, measured: Array, free: Array, ahead: Array) -> tuple[OutputErrors, ...]:
    errors = []
    for k, (name, unit) in enumerate(zip(record.output_names, record.output_units, strict=True)):
        y, run, predicted = (values[:, k : k + 1] for values in (measured, free, ahead))
        mse = mean_squared_error(y, run)
        one_step = _one_step(y, predicted)
        errors.append(OutputErrors(name, unit, one_step, mse, float(np.sqrt(mse)), fit_percent(y, run)))
    return tuple(errors)


def compare(
    models: Fit[Any] | Model | Iterable[Fit[Any] | Model],
    *more: Any,
    record: Record | Sequence[Record] | None = None,
    transient: int | None = None,
    experiment: str = "record",
    data: str = "unseen",
) -> Comparison:
    """Compare models on the same samples of a record, ranked by the free run.

    ``compare([linear, motor], record)`` and ``compare(linear, motor, record)`` are the same.

    Args:
        models: a fit or a model, or a list of them.
        more: further models, and last the record.
        record: unseen data, if given by name; several records are joined by `emsid.concatenate`.
        transient: samples at the start of a segment in motion that start the models and are left out of every error;
            by default the largest number that one of the models needs.
        experiment, data: labels of the rows.

    Raises:
        ModelError: without a model, for something that is not a model, or for a record of other channels or another
            sample time than theirs.
        DataError: for something that is not a record, or where no segment is longer than the transient.
    """
    if record is None and not more:
        raise DataError("no record to compare on; it comes last: compare([linear, motor], record)")
    *others, last = more if record is None else (*more, record)
    unseen = _one_record(last)
    candidates = [as_fit(each) for some in (models, *others) for each in _several(some)]
    if not candidates:
        raise ModelError("no model to compare; give at least one fit")
    start = max((transient or 0, *(fit.model.memory for fit in candidates)))
    assessments = [assess(fit, unseen, start, experiment=experiment, data=data) for fit in candidates]
    return Comparison(tuple(sorted(assessments, key=lambda each: each.row.ranked_by)))


def as_fit(thing: Fit[Any] | Model) -> Fit[Any]:
    """A fit unchanged; a model as a fit without estimates.

    Raises:
        ModelError: for anything else.
    """
    if isinstance(thing, Fit):
        return thing
    if isinstance(thing, Record):
        raise ModelError(
            "a Record among the models; the models come first, then one record or a list of them: "
            "compare([linear, motor], record)"
        )
    if isinstance(thing, type) or not isinstance(thing, Model):
        kind = thing if isinstance(thing, type) else type(thing)
        given = repr(thing) if isinstance(thing, str) else kind.__name__
        raise ModelError(f"{given} is no fitted model; give what emsid.fit or emsid.load returned, or a list of these")
    nothing = np.empty(0)
    return Fit(thing, (), nothing, np.empty((0, 0)), np.nan, 0.0, np.nan, 0, method="file")


def _several(models: Any) -> Iterable[Any]:
    """The models in a list, or the one that is no list."""
    return models if isinstance(models, Iterable) and not isinstance(models, str) else (models,)


def _one_record(record: Record | Sequence[Record]) -> Record:
    if isinstance(record, Record):
        return record
    if isinstance(record, Sequence) and record and all(isinstance(each, Record) for each in record):
        return record[0] if len(record) == 1 else concatenate(each.in_si() for each in record)
    if any(isinstance(each, Fit | Model) for each in (record if isinstance(record, list | tuple) else [record])):
        raise DataError("the record comes last, after the models: compare([linear, motor], record)")
    raise DataError(f"a {type(record).__name__} is no record to compare on; give emsid.Record(input, output, dt=…)")


assess = assess_model = validate
"""The names of this function inside the package."""


Array = NDArray[np.float64]

FEWEST = 50
"""Errors from fewer samples say little about a model."""
SMALL = 0.02
"""An error, or a difference of errors, below this share of the output's deviation is small on any data."""


def fit_percent(measured: Array, modelled: Array) -> float:
    """100·(1 − ‖y − ŷ‖/‖y − ȳ‖), the mean over channels; 100 is perfect, 0 as good as the mean, and below is worse.

    Minus infinity for a run that diverged. A channel whose measured output is constant has no fit and is left out of
    the mean; NaN where all channels are constant.

    Args:
        measured: (N, ny) y.
        modelled: (N, ny) ŷ.
    """
    error = np.linalg.norm(measured - modelled, axis=0)
    if not np.isfinite(error).all():
        return float("-inf")
    moves = np.ptp(measured, axis=0) > 0
    if not moves.any():
        return float("nan")
    spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
    return float(np.mean(100.0 * (1.0 - error[moves] / spread[moves])))


REST, FAST, TOP = 0.05, 0.3, 0.99
"""Limits of standstill and of high speed as shares of v, and the quantile of |y| that v is."""
REGIONS = ("standstill", "low speed", "reversal", "high speed")
WORSE = 2.0
"""The error in a region is much larger from this ratio to the error in all other regions on."""
POSITIONS = frozenset({"m", "cm", "mm", "um", "µm", "rad", "mrad", "deg", "°", "turn", "rev", "count"})
"""Units of outputs without regions."""


@dataclass(frozen=True)
class RegionError:
    """The free-run error of a model in one region of one output.

    Attributes:
        model, output, unit: what it is the error of; the unit is that of the RMSE.
        region: one of `REGIONS`.
        samples: of the output in this region.
        rmse: of the free run there; infinite where it diverged.
        share: of the squared error of the output, from 0 to 1; NaN where the run diverged.
    """

    model: str
    output: str
    unit: str
    region: str
    samples: int
    rmse: float
    share: float


@dataclass(frozen=True)
class RecordError:
    """The free-run error of a model on one of several records.

    Attributes:
        model, record, output, unit: what it is the error of; the unit is that of the RMSE.
        samples: of the record after its transients.
        rmse: of the free run; infinite where it diverged.
    """

    model: str
    record: str
    output: str
    unit: str
    samples: int
    rmse: float


def region_of(y: Array, breaks: Sequence[int] = ()) -> NDArray[np.intp]:
    """(N,) the index in `REGIONS` of every sample of an output y (N,).

    Args:
        y: a speed, or another output with a zero that means rest.
        breaks: the first sample of every segment but the first; a reversal lies in one segment.
    """
    size = np.abs(y)
    top = float(np.quantile(size, TOP)) if len(y) else 0.0
    found = np.where(size > FAST * top, 3, np.where(size > REST * top, 1, 0))
    for first, stop in zip((0, *breaks), (*breaks, len(y)), strict=True):
        fast = first + np.flatnonzero(found[first:stop] == 3)
        turns = np.flatnonzero(np.sign(y[fast[1:]]) != np.sign(y[fast[:-1]]))
        for last, following in zip(fast[turns].tolist(), fast[turns + 1].tolist(), strict=True):
            between = found[last + 1 : following]
            if len(between) and np.mean(between == 0) <= 0.5:
                found[last + 1 : following] = 2
    return found


def errors_by_region(assessment: Assessment) -> tuple[RegionError, ...]:
    """The free-run errors of a model in every region that has samples, output by output; none of a position.

    Args:
        assessment: the model run over a record.
    """
    record, counted = assessment.record, assessment.simulation.counted
    found = []
    for channel, (name, unit) in enumerate(zip(record.output_names, record.output_units, strict=True)):
        if unit in POSITIONS:
            continue
        y = record.output[:, channel]
        squares = (y - assessment.simulation.output[:, channel]) ** 2
        squares = np.where(np.isfinite(squares), squares, np.inf)
        regions, total = region_of(y, record.breaks), float(np.sum(squares[counted]))
        for index, region in enumerate(REGIONS):
            here = counted & (regions == index)
            if not here.any():
                continue
            own = float(np.sum(squares[here]))
            samples = int(np.count_nonzero(here))
            share = own / total if np.isfinite(total) and total > 0 else float("nan")
            rmse = float(np.sqrt(own / samples))
            found.append(RegionError(assessment.row.model, name, unit, region, samples, rmse, share))
    return tuple(found)


def by_region(comparison: Comparison) -> tuple[RegionError, ...]:
    """The errors of every model in every region, in the order of the comparison.

    Args:
        comparison: the models run over a record.
    """
    return tuple(each for assessment in comparison.assessments for each in errors_by_region(assessment))


def by_record(fits: Sequence[Any], records: Sequence[Record], transient: int | None = None) -> tuple[RecordError, ...]:
    """The errors of every model on each of several records; none for a single one.

    Args:
        fits: fitted models.
        records: with their channels; one that is too short for the models is left out.
        transient: samples at the start of a segment in motion without error; at least what the models need.
    """
    if len(records) < 2:
        return ()
    start = max((transient or 0, *(fit.model.memory for fit in fits)))
    found = []
    for fit in fits:
        for record in records:
            if all(len(from_rest(segment, start)) <= start for segment in record.segments):
                continue
            run = fit.model.simulate(record, start)
            squares = (record.output - run.output)[run.counted] ** 2
            means = np.mean(np.where(np.isfinite(squares), squares, np.inf), axis=0)
            for name, unit, mean in zip(record.output_names, record.output_units, means.tolist(), strict=True):
                of = fit.model.name, record.name, name, unit
                found.append(RecordError(*of, int(np.count_nonzero(run.counted)), float(np.sqrt(mean))))
    return tuple(found)


def worst_region(assessment: Assessment) -> Finding | None:
    """The region whose error is much larger than that in all others, if there is one."""
    errors = [each for each in errors_by_region(assessment) if np.isfinite(each.rmse)]
    for channel, output in enumerate(assessment.record.output_names):
        small = SMALL * float(np.std(assessment.record.output[:, channel]))
        own = [each for each in errors if each.output == output]
        large = max((each for each in own if each.samples >= FEWEST), key=lambda each: each.rmse, default=None)
        others = [each for each in own if each is not large]
        if large is None or sum(each.samples for each in others) < FEWEST:
            continue
        rest = float(np.sqrt(np.average([e.rmse**2 for e in others], weights=[e.samples for e in others])))
        if large.rmse > max(WORSE * rest, small):
            data = {"model": large.model, "region": large.region, "rmse": large.rmse, "others": rest}
            return Finding("error-in-region", output, data | {"unit": large.unit, "samples": large.samples})
    return None
