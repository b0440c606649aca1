"""The models that `emsid identify` knows by name.

Every candidate is a function from a record to a fit. It chooses orders, delay and knots that are not given on selection
data, a part of the record. Then it is fitted to the whole record.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Protocol

import numpy as np

from emsid.arguments import as_names
from emsid.errors import EmsidError, ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.linear.recursive import recursive_least_squares
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.models.blocks.search.estimation import CascadeStructure
from emsid.models.blocks.search.map_families import Family, family_of
from emsid.models.blocks.search.topologies import (
    HAMMERSTEIN,
    HAMMERSTEIN_WIENER,
    WIENER,
    WIENER_HAMMERSTEIN,
    CascadeSearch,
    Topology,
)
from emsid.models.free_run import squared_errors
from emsid.models.plants.datasheet import applicable
from emsid.models.plants.drive import Bridge, Hold
from emsid.models.plants.free_run_error import Recent, Weighting, all_alike
from emsid.models.plants.grey_box import signals_of
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import Plant
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.between_samples import as_hold
from emsid.models.plants.search.choice import choose
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.refinements import REFINEMENTS, Refinement
from emsid.models.regression.narx import Structure
from emsid.models.regression.structures import arx, friction_narx, input_knots, wiener_hammerstein_regression
from emsid.record import Record, hold_back
from emsid.selection.coordinate_search import coordinate_search
from emsid.selection.improvement import StretchErrors


@dataclass(frozen=True)
class Options:
    """Options of candidates; those that are None are chosen on selection data.

    Args:
        na: coefficients of past outputs.
        nb: coefficients of past inputs.
        nk: delay in samples.
        degree: of the polynomial of a Wiener–Hammerstein regression.
        taps: of its first filter.
        knots: hinges on each side of zero in a friction regression; knots or degree of a static map.
        orders: of the filters of a cascade of blocks, as many as it has.
        static: family of its static map, or the name of one; by default a spline where knots are given, or chosen with
            everything else.
        ridge: weight of the squared parameters.
        forgetting: forgetting factor; recursive least squares is used where it is given.
        fixed: physical parameters that are known, by name or symbol, in SI units or as texts with a unit.
        datasheet: starting values and tolerances of other parameters. By name or symbol a number in SI units, a text
            with a unit, ``{"value": "2 ohm", "tolerance": "10 %"}``, or a `Given`.
        codes: values of an input that are not a command, and the state of the motor bridge that they mean.
        free: exactly the physical parameters to estimate; by default those that the plant usually has unknown, with
            refinements.
        recent: time in s after which errors of physical models are forgotten; see `Recent`. By default, never.
        hold: how the input goes on between its samples: ``"zero"`` (held) or ``"first"`` (straight to the next one); by
            default decided from the data.
        profile: physical parameters whose likelihood profiles are computed.
        held_back: fraction of the record that is selection data; see `emsid.record.hold_back`.
    """

    na: int | None = None
    nb: int | None = None
    nk: int | None = None
    degree: int | None = None
    taps: int | None = None
    knots: int | None = None
    orders: tuple[int, ...] = ()
    static: Family | None = None
    ridge: float = 0.0
    forgetting: float | None = None
    fixed: Mapping[str, Any] = field(default_factory=dict)
    datasheet: Mapping[str, Any] = field(default_factory=dict)
    codes: tuple[tuple[float, Bridge], ...] = ()
    free: tuple[str, ...] = ()
    recent: float | None = None
    hold: Hold | str | None = None
    profile: tuple[str, ...] = ()
    held_back: float = 0.25

    def __post_init__(self) -> None:
        for name in ("free", "profile"):
            object.__setattr__(self, name, as_names(getattr(self, name)))
        if self.static is not None:
            object.__setattr__(self, "static", family_of(self.static))
        if self.hold is not None:
            object.__setattr__(self, "hold", as_hold(self.hold))
        if self.ridge and self.forgetting is not None:
            raise ModelError("ridge is for a batch estimate and forgetting for a recursive one; choose one of them")

    @property
    def given(self) -> list[str]:
        """The names of options that differ from their defaults."""
        return [each.name for each in fields(self) if getattr(self, each.name) != getattr(_DEFAULTS, each.name)]

    def estimate(self, structure: Structure, record: Record, history: bool = False) -> Fit[Any]:
        """Fit a structure with these options."""
        if self.forgetting is None:
            return least_squares(structure, record, ridge=self.ridge)
        return recursive_least_squares(structure, record, forgetting=self.forgetting, history=history)


_DEFAULTS = Options()

ROUNDS = 2
"""The number of passes over all orders and delays when they are chosen."""


@dataclass(frozen=True)
class Regression:
    """A family of linear-in-the-parameters structures as a candidate.

    Args:
        summary: what it is, in a few words.
        build: the structure for a record and choices.
        choices: the values to try for every option of the family, from simple to complex.
    """

    summary: str
    build: Callable[[Record, Mapping[str, int]], Structure]
    choices: Mapping[str, Sequence[int]]

    @property
    def uses(self) -> tuple[str, ...]:
        """The options that make a difference to it."""
        return (*self.choices, "ridge", "forgetting", "held_back")

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose options that are not given on selection data, then fit to the whole record."""
        given = {name: getattr(options, name) for name in self.choices}
        choices = {name: values if given[name] is None else (given[name],) for name, values in self.choices.items()}
        chosen = {name: values[0] for name, values in choices.items()}
        if any(len(values) > 1 for values in choices.values()):
            train, rest = hold_back(record, options.held_back)
            start = self.build(record, {name: values[-1] for name, values in choices.items()}).memory
            exact = 1e-20 * float(np.var(rest.output))  # smaller differences are rounding
            problems: list[Exception] = []

            def error(choice: Mapping[str, int]) -> StretchErrors:
                try:
                    fit = options.estimate(self.build(record, choice), train)
                    return StretchErrors.of(np.maximum(squared_errors(fit.model, [rest], start), exact))
                except (EmsidError, ValueError, ArithmeticError) as problem:  # leave out a choice that cannot be fitted
                    problems.append(problem)
                    return StretchErrors.of(np.full(len(rest), np.inf))

            total = ROUNDS * sum(map(len, choices.values()))
            chosen = coordinate_search(
                error,
                choices,
                ROUNDS,
                progress=lambda fraction: control.doing("choosing orders", round(fraction * total), total),
            )
            if problems and np.isinf(error(chosen).mean):
                raise problems[0]
        return options.estimate(self.build(record, chosen), record)


def _arx(record: Record, choice: Mapping[str, int]) -> Structure:
    return arx(**choice, inputs=record.input.shape[1])


def _check_one_input(name: str, record: Record) -> None:
    if record.input.shape[1] > 1:
        raise ModelError(f"{name} has one input and {record.name} has {', '.join(record.input_names)}; choose one")


def _wiener_hammerstein_regression(record: Record, choice: Mapping[str, int]) -> Structure:
    _check_one_input("wiener-hammerstein-regression", record)
    return wiener_hammerstein_regression(
        choice["na"], choice["nb"], choice["degree"], taps=choice["taps"], nk=choice["nk"]
    )


def _friction_narx(record: Record, choice: Mapping[str, int]) -> Structure:
    _check_one_input("friction-narx", record)
    return friction_narx(
        choice["na"],
        choice["nb"],
        knots=input_knots(record, choice["knots"]),
        nk=choice["nk"],
        speeds=stribeck_speeds(record),
    )


def stribeck_speeds(record: Record) -> tuple[float, float]:
    """Two speeds over which a Stribeck excess may decay: 3 and 10 % of the largest output."""
    top = float(abs(record.output).max())
    return float(f"{0.03 * top:.3g}"), float(f"{0.1 * top:.3g}")  # short numbers for the printed structure


class ModelKind(Protocol):
    """A kind of model that can be fitted to a record."""

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


@dataclass(frozen=True)
class Blocks:
    """A cascade of linear filters and static maps as a candidate.

    Args:
        summary: what it is, in a few words.
        topology: the filters before and after the map.
    """

    summary: str
    topology: Topology
    uses: ClassVar[tuple[str, ...]] = ("nk", "knots", "orders", "static", "hold")

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose orders, knots and delay on selection data, then fit to the free run over the whole record."""
        rate = 1 if options.hold is Hold.ZERO else None  # more steps per sample are for inputs that go on in between
        settings = CascadeSearch(static=options.static, size=options.knots, delay=options.nk, oversampling=rate)
        return CascadeStructure(self.topology, self._orders(options), settings).fit(record, control=control)

    def _orders(self, options: Options) -> tuple[int | None, int | None]:
        wanted = self.topology.first + self.topology.second
        if not options.orders:
            return None, None
        if len(options.orders) != wanted:
            raise ModelError(
                f"{self.topology.name} has {wanted} filter{'s' * (wanted > 1)}; {len(options.orders)} orders given: "
                "give one for each",
                arguments=("orders",),
            )
        given = iter(options.orders)
        first = next(given) if self.topology.first else None
        return first, next(given) if self.topology.second else None


@dataclass(frozen=True)
class Physical:
    """A plant with physical parameters as a candidate, with refinements that improve it.

    Args:
        summary: what it is, in a few words.
        plant: the plant without refinements.
        refinements: possible additions, if it has a drive.
    """

    summary: str
    plant: Plant
    refinements: tuple[Refinement, ...] = REFINEMENTS
    uses: ClassVar[tuple[str, ...]] = ("fixed", "datasheet", "codes", "free", "recent", "hold", "profile")

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose the refinements unless ``free`` is given, then fit to the whole record."""
        plant = self.coded(options)
        weighting: Weighting = all_alike
        if options.recent is not None:
            integrals = 2 if Signal.POSITION in signals_of(plant, record) else 1
            weighting = Recent(options.recent, integrals)
        driven = plant.driven
        if options.free or driven is None:
            return simulation_error(
                plant,
                record,
                free=options.free or None,
                fixed=options.fixed,
                datasheet=applicable(options.datasheet, plant),
                weighting=weighting,
                hold=options.hold,
                control=control,
            )
        return choose(
            driven,
            record,
            fixed=options.fixed,
            datasheet=options.datasheet,
            weighting=None if options.recent is None else weighting,
            hold=options.hold,
            refinements=self.refinements,
            control=control,
        )

    def coded(self, options: Options) -> Plant:
        """The plant to begin with, which knows what is no command if it has a drive."""
        driven = self.plant.driven
        return self.plant if driven is None else driven.with_drive(codes=options.codes)


class _Candidates(MutableMapping[str, ModelKind]):
    """Every kind of model by name: those given here, and every registered plant.

    Plants are looked up in the registry when they are asked for, so one registered later has a name here too.
    """

    def __init__(self, given: dict[str, ModelKind]) -> None:
        self.given = given

    def __getitem__(self, name: str) -> ModelKind:
        if name in self.given:
            return self.given[name]
        kind = PLANTS[name]
        return Physical(kind.summary, kind.start, REFINEMENTS if kind.refined else ())

    def __setitem__(self, name: str, kind: ModelKind) -> None:
        self.given[name] = kind

    def __delitem__(self, name: str) -> None:
        del self.given[name]

    def __iter__(self) -> Iterator[str]:
        yield from self.given
        yield from (name for name in PLANTS if name not in self.given)

    def __len__(self) -> int:
        return sum(1 for _ in self)


# Every model that `emsid identify` knows by name.
CANDIDATES: MutableMapping[str, ModelKind] = _Candidates(
    {
        "arx": Regression(
            "linear: past outputs and inputs", _arx, {"nk": (0, 1, 2, 3), "na": (1, 2, 3, 4), "nb": (1, 2, 3, 4)}
        ),
        "wiener-hammerstein-regression": Regression(
            "the paper's: ARX with powers and products of inputs",
            _wiener_hammerstein_regression,
            {"nk": (0, 1, 2, 3), "na": (1, 2, 3, 4), "nb": (1, 2, 3), "degree": (2, 3, 5), "taps": (1, 2)},
        ),
        "friction-narx": Regression(
            "ARX with dead-zone hinges, Coulomb and Stribeck friction",
            _friction_narx,
            {"nk": (0, 1, 2, 3), "na": (1, 2, 3), "nb": (1, 2, 3), "knots": (0, 4, 8, 12)},
        ),
        "wiener-hammerstein": Blocks("linear filter, static map, linear filter", WIENER_HAMMERSTEIN),
        "hammerstein": Blocks("static map, linear filter", HAMMERSTEIN),
        "wiener": Blocks("linear filter, static map", WIENER),
        "hammerstein-wiener": Blocks("static map, linear filter, static map", HAMMERSTEIN_WIENER),
    }
)

# The models that are fitted by default: they suit any record of one input and one output.
USUAL = ("arx", "wiener-hammerstein-regression", "friction-narx", "wiener-hammerstein")


def fit_or_problem(search: Callable[[], Fit[Any]]) -> Fit[Any]:
    """The result of a search.

    Raises:
        ModelError: also where the linear algebra fails because numbers are out of range.
    """
    try:
        return search()
    except (ValueError, ArithmeticError) as problem:
        raise ModelError(
            f"the numbers are out of range ({problem}); scale the channels, check the sample time",
            arguments=("scale", "dt"),
        ) from problem
