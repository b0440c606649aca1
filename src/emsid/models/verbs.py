"""`fit` and `simulate`: the two functions that accept a model of any kind.

`fit` takes a `Structure`, a cascade or a plant; `emsid.models.kinds` knows the estimators. It also accepts any object
with a method ``fit(records, **options)``.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, get_args, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from emsid.arguments import did_you_mean
from emsid.errors import DataError, ModelError, listed
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.models.capabilities import Estimator
from emsid.models.free_run import as_record
from emsid.models.kinds import ESTIMATORS, OF_RESPONSES, capabilities_of
from emsid.models.model import Model
from emsid.models.plants.drive import Hold
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import Weighting, all_alike
from emsid.models.plants.grey_box import GreyBox, signals_of
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import Plant
from emsid.models.plants.search.choice import choose
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.missing_tests import Shown as Shown
from emsid.models.plants.search.missing_tests import determined_by as determined_by
from emsid.models.plants.search.parts import with_parts
from emsid.models.plants.search.response_fit import fit_to_responses
from emsid.plant import Motor
from emsid.record import ChannelNames, FrequencyResponse, Record, concatenate


def fit(
    what: Any, records: Record | FrequencyResponse | Iterable[Record | FrequencyResponse], **options: Any
) -> Fit[Any]:
    """Estimate the parameters of a model of any kind from one or several records, or from frequency responses.

    ==================================================  ===============================================================
    what                                                options
    ==================================================  ===============================================================
    a structure: `emsid.arx`, `emsid.friction_narx`, …  ``ridge``, ``forgetting`` (then by recursion), ``history``;
                                                        ``free_run=True``, ``instruments=True``, ``start``,
                                                        ``transient``, ``control``
    `emsid.state_space`                                 ``free_run=True``, ``refine``, ``control``; and responses
    `emsid.armax`, `emsid.box_jenkins`                  ``start``, ``control``
    `emsid.process_model`                               ``control``
    `emsid.transfer_function`                           ``start``, ``control``; also from frequency responses
    a cascade: `emsid.wiener_hammerstein`, …            ``control``; orders and static map are given to the cascade
    a feedback model: `emsid.feedback`                  ``control``; orders and static maps are given to the structure
    a plant: `emsid.plants.rigid_motor`, …              ``fixed``, ``free``, ``bounds``, ``datasheet``, ``search``, …
    ==================================================  ===============================================================

    A structure is linear in its parameters and fitted to the one-step prediction error by least squares, or with
    ``free_run=True`` to the error of the free run, which noise of the output does not bias: ``arx`` then is an
    output-error model. ``instruments=True`` estimates a linear structure without that bias and without a search.
    A cascade and a plant are always fitted to the free run, by Gauss–Newton steps. A plant is fitted as `identify`
    fits it, with the additions that the data support; with ``free``, exactly those parameters (see `fit_plant`).

    Transfer functions, state spaces and plants are also fitted to a `FrequencyResponse`, weighted with its variance, or
    to records and responses together; a plant to its response in motion, without dry friction and dead zone.

    >>> from emsid.models.regression.narx import Structure
    >>> record = Record([1.0, 0.0, 2.0, 1.0, 0.0, 1.0], [0.0, 2.0, 1.0, 4.5, 4.25, 2.125], dt=0.1)
    >>> fit(Structure.parse("y(t-1)", "u(t-1)"), record).estimate.round(6)
    array([0.5, 2. ])

    Args:
        what: a structure, a cascade, a plant, a bare `emsid.Motor`, or anything with a method
            ``fit(records, **options)``.
        records: a record, or several experiments that share one set of parameters; or frequency responses.
        options: the options of this kind of model, by name.

    Returns:
        The model with its estimates, their covariance, and how the estimation ended.

    Raises:
        ModelError: for an object that cannot be fitted, or an unknown option.
        DataError: for an object that is not a record, or records that do not suit the model.
        Stopped: if the option ``control`` stops it before there is a model (`emsid.estimation.Stopped`).
    """
    estimator, subject = _estimator(what)
    data = as_records(records, type(subject) in OF_RESPONSES or is_plant(subject))
    if any(isinstance(each, FrequencyResponse) for each in (data if isinstance(data, Sequence) else [data])):
        estimator = OF_RESPONSES.get(type(subject), estimator)
    found = estimator(subject, data, **_checked(what, estimator, options))
    first = data[0] if isinstance(data, Sequence) else None if isinstance(data, _InSI) else data
    return replace(found, channels=ChannelNames.of(first)) if first is not None and isinstance(found, Fit) else found


def fit_plant(
    plant: Plant,
    records: Record | FrequencyResponse | Iterable[Record | FrequencyResponse],
    *,
    search: bool | None = None,
    free: str | Sequence[str] | None = None,
    fixed: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    datasheet: Mapping[str, Any] | None = None,
    signals: str | Signal | Sequence[str | Signal] | None = None,
    weighting: Weighting | None = None,
    hold: Hold | str | None = None,
    per_record: str | Sequence[str] = (),
    find_start: bool = True,
    max_iterations: int = 60,
    threads: int | None = None,
    control: Control = FREE,
) -> Fit[GreyBox]:
    """A plant fitted to the free run: with the additions that the data support, or exactly as given.

    Args:
        plant: what to fit.
        records: a record, or several; or frequency responses, see `fit_to_responses`.
        search: whether to try additions, such as a delay, a Stribeck effect, how the sensor samples or the harmonics
            of a torque, as `emsid.identify` does; by default where none of the arguments says what exactly to fit:
            ``free``, ``bounds``, ``signals``, ``find_start``, ``max_iterations``, ``threads``.
        free, fixed, bounds, datasheet, signals, weighting, hold, per_record: see `simulation_error`.
        find_start, max_iterations, threads, control: likewise.

    Raises:
        ModelError, DataError: as `simulation_error` does; for a search of a plant without a drive.
    """
    whole = (records,) if isinstance(records, Record | FrequencyResponse) else tuple(records)
    if any(isinstance(each, FrequencyResponse) for each in whole):
        if datasheet is not None or weighting is not None or hold is not None or per_record or search:
            raise ModelError(f"{plant.name}: a frequency response is fitted with free, fixed, bounds and signals only")
        return fit_to_responses(plant, whole, free=free, fixed=fixed, bounds=bounds, signals=signals, control=control)
    records = tuple(each for each in whole if isinstance(each, Record))
    exact = free is not None or bounds is not None or signals is not None or threads is not None
    exact = exact or not find_start or max_iterations != 60 or any("[" in name for name in fixed or ())
    if search and (exact or not (isinstance(plant, DrivenPlant) or plant.may_have_parts)):
        raise ModelError(
            f"{plant.name}: additions are searched for a plant with a drive or a brushless motor, without free, bounds "
            "and signals"
        )
    if isinstance(plant, DrivenPlant) and not exact and search is not False:
        together = records[0] if len(records) == 1 else concatenate(records)
        return choose(
            plant, together, fixed=fixed, datasheet=datasheet, weighting=weighting, hold=hold, per_record=per_record,
            control=control,
        )  # fmt: skip
    if plant.may_have_parts and not exact and search is not False and not per_record:
        return with_parts(
            plant, records, fixed=fixed, datasheet=datasheet, weighting=all_alike if weighting is None else weighting,
            hold=hold, control=control,
        )  # fmt: skip
    return simulation_error(
        plant, records, free=free, fixed=fixed, bounds=bounds, datasheet=datasheet, signals=signals,
        weighting=all_alike if weighting is None else weighting, hold=hold, per_record=per_record,
        find_start=find_start, max_iterations=max_iterations, threads=threads, control=control,
    )  # fmt: skip


DRIVEN: dict[type, Callable[[Any], Any]] = {Motor: DrivenMotor}
"""Types that need a drive and a sensor for a simulation, and the functions that add them."""


def _estimator(what: Any) -> tuple[Estimator, Any]:
    """The estimator for this kind of model.

    Raises:
        ModelError: for an object that cannot be fitted, with advice.
    """
    if isinstance(what, type):
        raise ModelError(f"{what.__name__} is a class; make a value of it first: {what.__name__}(…)")
    for kind in type(what).__mro__:
        if kind in ESTIMATORS:
            return ESTIMATORS[kind], what
    if is_plant(what):
        return fit_plant, what
    if callable(getattr(what, "fit", None)):
        return type(what).fit, what
    given = f"a {type(what).__name__}"
    if isinstance(what, Record):
        advice = "the model comes first and the record second: emsid.fit(emsid.arx(na=2, nb=2), record)"
    elif isinstance(what, str):
        given, advice = repr(what), "give a value, not a name: emsid.arx(na=2, nb=2), emsid.plants.rigid_motor()"
    elif isinstance(what, Fit):
        given, advice = "a Fit", "it has been fitted; to begin another search there, give fit.model, or its plant"
    elif capabilities_of(what).fitted_by:
        advice = f"give {capabilities_of(what).fitted_by}"
    elif inspect.isroutine(what):
        given, advice = f"the function {what.__name__}", f"call it: {what.__name__}(…)"
    else:
        advice = "give a structure (emsid.arx(…)), a cascade (emsid.wiener_hammerstein(…)) or a plant (emsid.plants.…)"
    raise ModelError(f"{given} cannot be fitted; {advice}")


def is_plant(thing: Any) -> bool:
    """Whether an object implements `emsid.plants.Plant`."""
    return not isinstance(thing, type) and all(
        hasattr(thing, name) for name in ("handles", "default_free", "states", "with_values", "simulate")
    )


def _checked(what: Any, estimator: Estimator, options: Mapping[str, Any]) -> Mapping[str, Any]:
    """The options, if the estimator takes them all.

    Raises:
        ModelError: with the unknown option and the known ones.
    """
    parameters = inspect.signature(estimator).parameters.values()
    try:
        hints = get_type_hints(estimator)
    except NameError:  # of a user's own, who imports them for a type checker only
        hints = {}
    known = [parameter.name for parameter in parameters if parameter.kind is inspect.Parameter.KEYWORD_ONLY]
    for parameter in parameters:
        if parameter.kind is inspect.Parameter.VAR_KEYWORD:
            if (table := get_args(hints.get(parameter.name))) == ():
                return options
            known += table[0].__annotations__  # of Unpack[table]
    for name in options:
        if name not in known:
            called = getattr(what, "name", type(what).__name__)
            near = did_you_mean(name, known)
            raise ModelError(f"{called} has no option {name!r}; it takes {listed(known)}{near}")
    return options


def as_records(records: Any, responses: bool = False) -> Any:
    """The records in SI, checked.

    Args:
        records: a record, or several.
        responses: whether frequency responses may be among them.

    Raises:
        DataError: for anything else, with advice.
    """
    allowed = (Record, FrequencyResponse) if responses else Record
    if isinstance(records, FrequencyResponse) and not responses:
        raise DataError(
            "a frequency response; emsid.transfer_function, emsid.state_space and plants are fitted to one, this is "
            "fitted to a record"
        )
    if isinstance(records, allowed):
        return records.in_si()
    if isinstance(records, str | os.PathLike):
        raise DataError(f"{str(records)!r} is a path; read it first: emsid.read({str(records)!r}, input=…, output=…)")
    if isinstance(records, np.ndarray) or not isinstance(records, Iterable):
        raise DataError(
            f"a {type(records).__name__} is no record; give emsid.Record(input, output, dt=…), or a list of records"
        )
    if isinstance(records, Sequence):
        for record in records:
            if not isinstance(record, allowed):
                raise DataError(f"a {type(record).__name__} among the records; give emsid.Record(input, output, dt=…)")
        if not records:
            raise DataError("no record to fit to; give one, or a list of them")
        return [record.in_si() for record in records]
    return records if isinstance(records, _InSI) else _InSI(records)


class _InSI:
    """Records in SI, each converted when it is its turn, as often as they are asked for."""

    def __init__(self, records: Iterable[Any]) -> None:
        self._records = records

    def __iter__(self) -> Iterator[Any]:
        return (record.in_si() if isinstance(record, Record) else record for record in self._records)


def for_model(model: Any, record: Record) -> Record:
    """A record in the units that a model was fitted to, by position; in those of a plant, which are SI.

    Args:
        model: a fit, a model or a plant; of another model the units are not known, and the record remains.
        record: to run the model on.
    """
    if isinstance(model, Fit) and model.channels is not None:
        return model.channels.in_these_units(record)
    physical = isinstance(model.model if isinstance(model, Fit) else model, GreyBox) or is_plant(model)
    return record.in_si() if physical else record


def simulate(model: Any, input: Record | ArrayLike, dt: float | None = None) -> Record:
    """The free run of a model over an input, as a record with the simulated outputs.

    >>> from emsid.models.regression.narx import Narx, Structure
    >>> arx = Narx(Structure.parse("y(t-1)", "u(t-1)"), np.array([0.5, 2.0]), dt=0.1)
    >>> simulate(arx, [1.0, 0.0, 0.0, 1.0]).output[:, 0]
    array([0. , 2. , 1. , 0.5])

    Args:
        model: a model, a `Fit`, a plant such as ``emsid.plants.rigid_motor()``, or an `emsid.Motor`.
        input: (N,) or (N, nu), in the units of the data that the model was fitted to, SI where these had units; or a
            record, which is converted to them. Where the record has outputs, those at the start of every segment give
            the initial state and are repeated in the result; otherwise every segment starts at rest.
        dt: sample time of the input in seconds, for a model without its own; a record has its own. By default that of
            the data of a fit.

    Returns:
        A record with the input and the simulated outputs, which have the names and units of the data of a fit, or those
        of a plant.

    Raises:
        ModelError: for an object that cannot be simulated, wrong inputs, another sample time, or a run that diverges.
        DataError: for an input that is not an array of numbers, or a record together with another dt.
    """
    if isinstance(input, str | os.PathLike):
        raise DataError(f"{str(input)!r} is a path; read it first: emsid.read({str(input)!r}, input=…, output=…)")
    if isinstance(input, Fit | Model):
        raise DataError("the model comes first and the input second: emsid.simulate(model, voltage, dt=1e-3)")
    if isinstance(input, Record) and dt is not None and not np.isclose(dt, input.dt, rtol=1e-6, atol=0.0):
        raise DataError(f"{input.name} has a sample time of {input.dt:g} s and dt is {dt:g} s; leave dt out")
    if isinstance(input, Record):
        input = for_model(model, input)
    subject = as_model(model, input if isinstance(input, Record) else None)
    dt = model.sample_time if dt is None and isinstance(model, Fit) else dt
    record = _named(as_record(subject, input, dt), model)
    run = subject.simulate(record)
    if run.diverged_at is not None:
        raise ModelError(f"{subject.name}: the free run diverges at sample {run.diverged_at}; give a smaller input")
    names, units = _output_channels(model, subject, run.output.shape[1], record)
    return replace(
        record,
        output=run.output,
        output_names=names,
        output_units=units,
        name=f"{subject.name} driven by {record.name}",
    )


def _named(record: Record, model: Any) -> Record:
    """A record of inputs alone with the names and units of the inputs that a fit knows."""
    channels = model.channels if isinstance(model, Fit) else None
    nameless = record.input_names == tuple(f"u{k + 1}" for k in range(record.input.shape[1]))
    if channels is None or not nameless or len(channels.inputs) != record.input.shape[1]:
        return record
    names, units = zip(*channels.inputs, strict=True)
    return replace(record, input_names=names, input_units=units)


def _output_channels(model: Any, subject: Model, count: int, record: Record) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the outputs of a run: of the record, of the fit, of the plant, or none."""
    if record.output.shape[1] == count:
        return record.output_names, record.output_units
    known = model.channels.outputs if isinstance(model, Fit) and model.channels is not None else ()
    known = known or (subject.output_channels if isinstance(subject, GreyBox) else ())
    free = len(known) == count and not {name for name, _ in known} & set(record.input_names)
    return tuple(zip(*known, strict=True)) if free else ((), ())  # type: ignore[return-value]


def as_model(thing: Any, record: Record | None = None) -> Model:
    """The model of a fit or of a plant, or the model itself.

    Args:
        thing: the object to run.
        record: the record to run it on; the units of its outputs select the outputs of a plant.

    Raises:
        ModelError: for anything else.
    """
    if isinstance(thing, Fit):
        return thing.model  # type: ignore[no-any-return]
    thing = DRIVEN.get(type(thing), lambda plant: plant)(thing)
    if is_plant(thing):
        measured = record if record is not None and record.output.shape[1] else Record(np.zeros(1), np.zeros(1), 1.0)
        return GreyBox(thing, signals_of(thing, measured))
    if isinstance(thing, type) or not isinstance(thing, Model):
        given = thing.__name__ if isinstance(thing, type) else f"a {type(thing).__name__}"
        raise ModelError(f"{given} is no model; give a model, a fit, or a plant")
    return thing
