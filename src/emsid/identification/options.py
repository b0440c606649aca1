"""Options of the models of `emsid identify`, and the interface of such a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Protocol

from emsid.arguments import as_names
from emsid.errors import ModelError, listed
from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.linear.recursive import recursive_least_squares
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.models.blocks.search.map_families import Family, family_of
from emsid.models.plants.drive import Bridge, Hold
from emsid.models.plants.search.between_samples import as_hold
from emsid.models.refit_data import Data
from emsid.models.regression.narx import Narx, Structure
from emsid.record import Record


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
        period: of a periodic input in steady state, in samples; by default it is detected where the input repeats
            exactly, and 0 takes no input for periodic.
        ridge: weight of the squared parameters.
        forgetting: forgetting factor; recursive least squares is used where it is given.
        fixed: physical parameters that are known, by name or symbol, in SI units or as texts with a unit.
        datasheet: starting values and tolerances of other parameters. By name or symbol a number in SI units, a text
            with a unit, ``{"value": "2 ohm", "tolerance": "10 %"}``, or a `Given`.
        codes: values of an input that are not a command, and the state of the motor bridge that they mean.
        free: exactly the physical parameters to estimate; by default those that the plant usually has unknown, with
            refinements.
        recent: time in s after which errors of physical models are forgotten; see `Recent`. By default, never.
        hold: the course of the input between its samples: ``"zero"`` (held), ``"first"`` (straight to the next one) or
            ``"record"`` (as each record shows); by default decided from the data.
        per_record: physical parameters that have a value of their own in every record, such as the load.
        profile: physical parameters whose likelihood profiles are computed.
        held_back: fraction of the record that is selection data; see `emsid.record.hold_back`.
        comparing: whether fits only compare models; the recommended one is then fitted further.
        delay_from_data: whether ``nk`` was not given: a first look at the data shows that delay, and it may be wrong.
    """

    na: int | None = None
    nb: int | None = None
    nk: int | None = None
    degree: int | None = None
    taps: int | None = None
    knots: int | None = None
    orders: tuple[int, ...] = ()
    static: Family | None = None
    period: int | None = None
    ridge: float = 0.0
    forgetting: float | None = None
    fixed: Mapping[str, Any] = field(default_factory=dict)
    datasheet: Mapping[str, Any] = field(default_factory=dict)
    codes: tuple[tuple[float, Bridge], ...] = ()
    free: tuple[str, ...] = ()
    recent: float | None = None
    hold: Hold | str | None = None
    per_record: tuple[str, ...] = ()
    profile: tuple[str, ...] = ()
    held_back: float = 0.25
    comparing: bool = False
    delay_from_data: bool = False

    def __post_init__(self) -> None:
        for name in ("free", "per_record", "profile"):
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

    @property
    def by_name(self) -> dict[str, Any]:
        """Every option by its name; the hold is a text."""
        return vars(self) | {"hold": getattr(self.hold, "value", None)}

    def estimate(self, structure: Structure, records: Record | Sequence[Record], history: bool = False) -> Fit[Narx]:
        """Fit a structure with these options."""
        if self.forgetting is None:
            return least_squares(structure, records, ridge=self.ridge)
        return recursive_least_squares(structure, records, forgetting=self.forgetting, history=history)


_DEFAULTS = Options()
KEYWORDS = tuple(each.name for each in fields(Options) if each.name not in ("comparing", "delay_from_data"))
"""The options that `emsid.identify` also takes as keywords: all but those that a search sets itself."""


def options_of(options: Options | None, keywords: Mapping[str, Any]) -> Options:
    """The options, given as one value or as keywords.

    Raises:
        ModelError: for both at once.
    """
    given = {name: value for name, value in keywords.items() if value is not None and value != getattr(_DEFAULTS, name)}
    if options is None:
        return Options(**given)
    if given:
        raise ModelError(
            f"options and {listed(list(given))} are given; put all into one of them", arguments=tuple(given)
        )
    return options


def refit_data(options: Options, records: Record | Sequence[Record], control: Control = FREE, **more: Any) -> Data:
    """Records as data that a model is fitted to again with these options; ``more`` are fields of `Data`."""
    several = (records,) if isinstance(records, Record) else records
    return Data(several, options.estimate, control, given=options.by_name, **more)


class ModelKind(Protocol):
    """A kind of model that can be fitted to a record.

    The structure of one with a true ``searched_anew`` is chosen again from all data where the part held back shows what
    it lacks. One with a true ``for_what_is_left`` is fitted, where nobody asks for it, only if the inputs still explain
    something of what the other models leave.
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
