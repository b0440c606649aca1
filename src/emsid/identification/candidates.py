"""The models of `emsid identify`, by name.

Every candidate is a function from a record to a fit. It chooses orders, delay and knots that are not given on selection
data, a part of the record. Then it is fitted to the whole record.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, MutableMapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf, sqrt
from typing import Any, ClassVar, Protocol

import numpy as np

from emsid.errors import DataError, EmsidError, ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import FREE, Activity, Control, Stopped
from emsid.findings import Finding
from emsid.first_look.baseline import ORDERS, baseline
from emsid.first_look.examined import is_position
from emsid.first_look.hanging import hanging
from emsid.first_look.names import ColumnQuantity, is_of_a_process, meaning
from emsid.identification.regressions import OUTPUT_ERROR, REGRESSIONS, Armax, BoxJenkins, StateSpace
from emsid.models.blocks.search.cross_validation import (
    HAMMERSTEIN,
    HAMMERSTEIN_WIENER,
    WIENER,
    WIENER_HAMMERSTEIN,
    Topology,
)
from emsid.models.blocks.search.estimation import asked
from emsid.models.blocks.search.map_families import SPLINE
from emsid.models.blocks.search.sign_recovery import keeps_its_sign, may_be_rectified
from emsid.models.feedback.search.estimation import FeedbackStructure
from emsid.models.feedback.search.trials import FeedbackSearch
from emsid.models.plants.by_name import names_had
from emsid.models.plants.datasheet import applicable
from emsid.models.plants.drive import Hold
from emsid.models.plants.free_run_error import Recent, Weighting, all_alike
from emsid.models.plants.grey_box import check_channels, signals_of
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import Plant
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.choice import choose
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.parts import with_parts
from emsid.models.plants.search.result import GreyBoxFit, has_physical_parameters
from emsid.models.refit_data import Data
from emsid.options import Options
from emsid.record import Record
from emsid.record.holding_back import excerpt
from emsid.units import name_and_unit

REFERENCE = 8_000
"""The most samples of the regression that a plant which leaves much of the output is compared with."""
SLOW = 10
"""An output may be a position where the time constant of its linear model exceeds the duration of the record divided by
this: a record that shows the parameters of a speed also shows that it settles."""
FEW = 10
"""Steps of the fits that only tell a speed from a position: an axis is found to its noise in fewer."""


class ModelKind(Protocol):
    """A kind of model that can be fitted to a record.

    The structure of one with a true ``searched_anew`` is chosen again from all data where the part held back shows what
    it lacks. One with ``for_what_is_left`` is fitted, where nobody asks for it, only if the inputs still explain
    something of what the models without it leave; with two, also of what those with one leave. Only those with a true
    ``several_outputs`` are for records of several.
    """

    @property
    def summary(self) -> str:
        """What it is, in a few words."""
        ...

    @property
    def uses(self) -> tuple[str, ...]:
        """The options that make a difference to it."""
        ...

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose options that are not given on selection data, then fit to the whole record."""
        ...


def refit_data(options: Options, records: Record | Sequence[Record], control: Control = FREE, **more: Any) -> Data:
    """Records as data that a model is fitted to again with these options; ``more`` are fields of `Data`."""
    several = (records,) if isinstance(records, Record) else records
    return Data(several, options.estimate, control, given=options.by_name, **more)


@dataclass(frozen=True)
class Blocks:
    """A cascade of linear filters and static maps as a candidate.

    Args:
        summary: what it is, in a few words.
        topology: the filters before and after the map.
    """

    summary: str
    topology: Topology
    uses: ClassVar[tuple[str, ...]] = ("nk", "knots", "orders", "static", "period", "hold")
    for_what_is_left: ClassVar[int] = 2

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose orders, knots and delay on selection data, then fit to the free run over the whole record."""
        return asked(self.topology, options.by_name).fit(record, control=control)


@dataclass(frozen=True)
class Feedback:
    """A linear system with static maps in its feedback as a candidate.

    Args:
        summary: what it is, in a few words.
    """

    summary: str
    uses: ClassVar[tuple[str, ...]] = ("nk", "knots", "orders", "static", "hold", "held_back")
    searched_anew: ClassVar[bool] = True
    for_what_is_left: ClassVar[int] = 2

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose order, maps and steps per sample on selection data, then fit to the free run over the whole record."""
        return self._structure(options).fit(record, control=control)

    def _structure(self, options: Options) -> FeedbackStructure:
        if len(options.orders) > 1:
            raise ModelError(
                f"feedback has one linear part; {len(options.orders)} orders given: give one", arguments=("orders",)
            )
        if options.knots == 0:
            raise ModelError("feedback: its maps have at least one knot, or degree; 0 given", arguments=("knots",))
        static = options.static or (SPLINE if options.knots else None)
        held = None if options.hold is None else options.hold is Hold.ZERO
        order = options.orders[0] if options.orders else None
        given, linear = (None, options.nk or 0) if options.delay_from_data else (options.nk, 0)
        knots = (options.knots or 0) if static is not None and static.sizes else 0  # `unused_requests` says so
        search = FeedbackSearch(
            order, None, static, knots, given, held=held, held_back=options.held_back, linear_delay=linear
        )
        return FeedbackStructure(search)


@dataclass(frozen=True)
class Physical:
    """A plant with physical parameters as a candidate, with additions that improve it.

    Args:
        summary: what it is, in a few words.
        plant: the plant without additions.
        effects: what is tried, if it has a drive; None for what suits this kind of plant.
    """

    summary: str
    plant: Plant
    effects: tuple[str, ...] | None = None
    uses: ClassVar[tuple[str, ...]] = ("fixed", "datasheet", "codes", "free", "recent", "hold", "per_record", "profile")
    searched_anew: ClassVar[bool] = True

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose the additions unless ``free`` is given, then fit to the whole record.

        A plant with a shaft is one mass where that, with its own additions, has a smaller error.
        """
        plant = self.coded(options).for_command(with_unit_of_name(record))
        if plant.driven is not None and plant.driven.turn:
            _check_turn(record, options)
        weighting: Weighting = all_alike
        if options.recent is not None:
            integrals = 2 if Signal.POSITION in signals_of(plant, record) else 1
            weighting = Recent(options.recent, integrals)
        by_record = any("[" in name for name in options.fixed)  # additions are for one value in all records
        driven = plant.driven
        if driven is None and not (options.free or by_record or options.per_record):
            return with_parts(
                plant,
                record,
                fixed=options.fixed,
                datasheet=applicable(options.datasheet, plant),
                weighting=weighting,
                hold=options.hold,
                control=control,
            )
        if options.free or by_record or driven is None:
            return simulation_error(
                plant,
                record,
                free=options.free or None,
                fixed=options.fixed,
                datasheet=applicable(options.datasheet, plant),
                weighting=weighting,
                hold=options.hold,
                per_record=options.per_record,
                control=control,
            )
        simpler = self._without_shaft(record, options, control)
        linear = baseline(record, options.nk, ORDERS)
        try:
            fit = choose(
                driven,
                record,
                fixed=options.fixed,
                datasheet=options.datasheet,
                weighting=None if options.recent is None else weighting,
                hold=options.hold,
                per_record=options.per_record,
                effects=self.effects,
                linear=inf if linear is None else (1 - linear.fit) ** 2,
                regression=partial(_left_by_regression, record, control),
                control=control,
            )
        except Stopped:
            if simpler is None:
                raise
            return simpler
        if simpler is None or simpler.weighting != fit.weighting or simpler.cost >= fit.cost:
            return fit
        data = {"model": fit.model.name, "simpler": simpler.model.name, "ratio": sqrt(simpler.cost / fit.cost)}
        return replace(simpler, findings=(Finding("no-shaft-needed", fit.model.name, data), *simpler.findings))

    def _without_shaft(self, record: Record, options: Options, control: Control) -> GreyBoxFit | None:
        """The plant as one mass, fitted with its own additions; None where it has no shaft, or one that is known."""
        shaft = self.plant.secondary
        less = self.plant.simpler(self.plant.default_free)
        if less is None or shaft & {*options.fixed, *options.datasheet}:
            return None
        try:
            fit = CANDIDATES[less[0].name](record, options, control)
        except (EmsidError, Stopped):
            return None
        return fit if has_physical_parameters(fit) else None

    def coded(self, options: Options) -> Plant:
        """The plant to begin with; its drive, if it has one, has the codes that are no commands."""
        driven = self.plant.driven
        return self.plant if driven is None else driven.with_drive(codes=options.codes)


def _check_turn(record: Record, options: Options) -> None:
    """Refuse an angle without a unit whose gravity shows another turn than 2π, unless its turn is given or estimated.

    Raises:
        DataError: with the turn that it seems to have.
    """
    if record.output_units[0] or "gravity.period" in (*options.fixed, *options.free):
        return
    found = hanging(record)
    if found is not None and found.unit != "rad":
        name = record.output_names[0]
        unit = f"{name}={found.unit}" if found.unit else f"{name}=count, with the counts per revolution"
        raise DataError(
            f"{record.name}: {name!r} has no unit, and by its gravity one turn is about {found.turn:.4g} of it, not "
            f"2π: give its unit ({unit}), or the turn as gravity.period",
            arguments=("units", "fixed"),
        )


def _left_by_regression(record: Record, control: Control) -> float:
    """The share of the output's variance that a polynomial regression leaves in free run; infinite where it fails."""
    part = excerpt(record, REFERENCE)
    try:
        fit = REGRESSIONS["polynomial-narx"](part, Options(), control.quietly())
    except EmsidError:
        return inf
    return fit.noise_variance / float(np.var(part.output))


class _Candidates(MutableMapping[str, ModelKind]):
    """Every kind of model by name: those given here, and every registered plant.

    Plants are looked up in the registry when they are asked for, so one registered later has a name here too. They come
    last, in the order of the registry, also where one has another kind of model.
    """

    def __init__(self, given: dict[str, ModelKind]) -> None:
        self.given = given

    def __getitem__(self, name: str) -> ModelKind:
        if name in self.given:
            return self.given[name]
        kind = PLANTS[name]
        return Physical(kind.summary, kind.start, None if kind.refined or kind.start.secondary else ())

    def __setitem__(self, name: str, kind: ModelKind) -> None:
        self.given[name] = kind

    def __delitem__(self, name: str) -> None:
        del self.given[name]

    def __iter__(self) -> Iterator[str]:
        yield from (name for name in self.given if name not in PLANTS)
        yield from PLANTS

    def __len__(self) -> int:
        return sum(1 for _ in self)


# Every model of `emsid identify`, by name.
CANDIDATES: MutableMapping[str, ModelKind] = _Candidates(
    {
        **REGRESSIONS,
        "armax": Armax("linear, with moving-average noise through the same poles"),
        "box-jenkins": BoxJenkins("linear, with a noise model of its own", OUTPUT_ERROR),
        "state-space": StateSpace("linear, of many modes or several outputs, fitted to the free run"),
        "wiener-hammerstein": Blocks("linear filter, static map, linear filter", WIENER_HAMMERSTEIN),
        "hammerstein": Blocks("static map, linear filter", HAMMERSTEIN),
        "wiener": Blocks("linear filter, static map", WIENER),
        "feedback": Feedback("linear, with static maps in its feedback: friction, a spring, a limit in a loop"),
        "hammerstein-wiener": Blocks("static map, linear filter, static map", HAMMERSTEIN_WIENER),
    }
)

# The models that are fitted by default: they suit any record of one input and one output. A state space of high order
# joins where the others leave something that the inputs explain, as resonances do.
USUAL = (*REGRESSIONS, "state-space", "wiener-hammerstein", "feedback")


# The models of a quick look at one output: linear ones, and the two regressions that take no search.
QUICK = ("arx", "output-error", "wiener-hammerstein-regression", "friction-narx")


FOR_FEEDBACK = 400
"""Fewer samples than these are not fitted by a feedback model by default."""
FOR_RECTIFIED = 200
"""The same for an output that is rectified, which other models describe less well."""


def quick_for(record: Record) -> tuple[str, ...]:
    """The models of a quick look at a record: `QUICK`, and for several outputs the usual ones, which are linear."""
    return QUICK if record.output.shape[1] == 1 else usual_for(record)


def left_out(record: Record, names: Sequence[str]) -> list[Finding]:
    """The finding that these models are a quick look, with the usual ones of the record that are not among them."""
    without = [name for name in usual_for(record) if name not in names]
    return [Finding("quick-look", record.name, {"without": without})] if without else []


def of_one_output(record: Record) -> list[Finding]:
    """The finding that the usual models of one output are left out, for a record of several."""
    count = record.output.shape[1]
    models = [name for name in USUAL if not getattr(CANDIDATES[name], "several_outputs", False)]
    data = {"outputs": count, "models": models, "output": record.output_names[0]}
    return [Finding("models-of-one-output", record.name, data)] if count > 1 else []


def usual_for(record: Record, known: Iterable[str] = (), control: Control | None = None) -> tuple[str, ...]:
    """The models that are fitted to a record by default: `USUAL`, and the first plant of one mass that it may be of.

    A Wiener model is fitted too where the output comes close to zero without a change of its sign, as that of a sensor
    that shows absolute values does.

    Units decide that, as far as there are any: a voltage, a current or a torque and a speed are those of a motor, a
    force and a position those of an axis; without a unit, the name of the output does, and the input has the unit that
    its name implies. A channel without a unit that is named as one of a process, such as a level, is of neither.

    An angle that hangs (`first_look.hanging`) is that of a joint.

    The speed of a wheel in m/s is that of a motor where the radius of the wheel is among the ``known`` parameters.

    For several outputs these are the models that have several; `of_one_output` names the others.

    A feedback model has too many parameters for fewer samples than `FOR_FEEDBACK`, or `FOR_RECTIFIED` where the input
    has both signs and the output one.

    Args:
        record: that is fitted.
        known: physical parameters that are given, or asked for.
        control: of the fits that decide whether a slow output without a name is a position; None for a list without
            these fits, in which it is a speed.
    """
    if record.output.shape[1] > 1:
        return tuple(name for name in USUAL if getattr(CANDIDATES[name], "several_outputs", False))
    one_each = record.input.shape[1] == 1
    position = is_position(record)
    starts = {name: kind.start for name, kind in PLANTS.items() if kind.refined and kind.usual}
    folded = ("wiener",) if one_each and not position and keeps_its_sign(record.output[:, 0]) else ()
    least = FOR_RECTIFIED if folded and may_be_rectified([record]) else FOR_FEEDBACK
    usual = tuple(name for name in USUAL if name != "feedback" or len(record) >= least)
    plants = [name for name, start in starts.items() if _may_be_of(start, record, known)]
    wanted = Signal.POSITION if position else Signal.SPEED
    plants.sort(key=lambda name: wanted not in signals_of(starts[name], record))
    if control is not None and len(plants) > 1 and _may_be_either(record):
        control.report(Activity("telling a speed from a position"))
        plants = [min(plants, key=lambda name: _rough_error(starts[name], record, control.quietly()))]
    joints = [name for name, kind in PLANTS.items() if one_each and position and _is_joint(kind.start, record, known)]
    return (*usual, *folded, *(joints or plants)[:1])


def _may_be_either(record: Record) -> bool:
    """Whether an output that nothing names as a speed or a position is so slow that it may be a position."""
    if record.output_units[0] or meaning(record.output_names[0]).quantity is not ColumnQuantity.OUTPUT:
        return False
    linear = baseline(record, None)
    return linear is not None and SLOW * linear.time_constant > max(map(len, record.segments))


def _rough_error(start: Plant, record: Record, control: Control) -> float:
    """The error of a plant without additions after some steps, on a part of a record; infinite where it has no fit."""
    if start.driven is None:
        return inf
    try:
        plant = start.driven.for_command(record)
        part = excerpt(record, REFERENCE)
        return simulation_error(plant, part, max_iterations=FEW, control=control).cost
    except (EmsidError, Stopped):
        return inf


def _is_joint(plant: Plant, record: Record, known: Iterable[str]) -> bool:
    """Whether a record is of this joint: an angle in rad that hangs."""
    joint = plant.driven
    if joint is None or not joint.turn or record.output_units[0] != "rad":
        return False
    return _may_be_of(plant, record, known) and hanging(record) is not None


def lift_an_arm(names: Iterable[str]) -> bool:
    """Whether some of these models are joints."""
    driven = (PLANTS[name].start.driven for name in names if name in PLANTS)
    return any(each is not None and each.turn for each in driven)


def _may_be_of(plant: Plant, record: Record, known: Iterable[str]) -> bool:
    if plant.driven is None or plant.secondary:
        return False
    if _is_of_a_process(record):
        return False
    record = with_unit_of_name(record)
    plant = plant.for_command(record).measured_by({}, names_had(plant, known))
    try:
        check_channels(plant, signals_of(plant, record), record)
    except EmsidError:
        return False
    turns = record.input_units[0] == "N*m" and not record.output_units[0]  # where no unit says that a mass is moved
    return not turns or (plant.channels is not None and plant.channels.commands == ("N*m",))


def _is_of_a_process(record: Record) -> bool:
    """Whether the name of the output, or else of the input, says so; a unit from elsewhere says more than a name."""
    (output, *_), (unit, *_) = record.output_names, record.output_units
    if unit in ("", name_and_unit(output)[1]) and is_of_a_process(output):
        return True
    (given, *_), (input_unit, *_) = record.input_names, record.input_units
    moves = meaning(output, unit).quantity in (ColumnQuantity.SPEED, ColumnQuantity.POSITION)
    return not moves and input_unit in ("", name_and_unit(given)[1]) and is_of_a_process(given)


UNITS_OF_NAMES = {ColumnQuantity.CURRENT: "A", ColumnQuantity.TORQUE: "N*m", ColumnQuantity.FORCE: "N"}
"""The unit of an input without one, by what its name says it is."""


def with_unit_of_name(record: Record) -> Record:
    """A record whose first input has the unit that its name implies, where it has none: a current is no voltage."""
    unit = UNITS_OF_NAMES.get(meaning(record.input_names[0]).quantity, "")
    if record.input_units[0] or not unit:
        return record
    return replace(record, input_units=(unit, *record.input_units[1:]))
