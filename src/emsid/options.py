"""The options of reading and identification: each is declared once, here.

From a declaration follow the option of the command line with its group in ``emsid identify --help``, the keyword of
`emsid.identify` with its line in the docstring, the field of the page of the studio, and the row of the documentation.
Nothing large is imported here, so that ``emsid identify --help`` is fast.
"""

# ruff: noqa: RUF009 - a declaration is the default of a field
from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from emsid.arguments import as_names
from emsid.errors import ModelError, listed

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.models.blocks.search.map_families import Family
    from emsid.models.plants.drive import Bridge, Hold
    from emsid.models.regression.narx import RegressionModel, Structure
    from emsid.record import Record

Function = TypeVar("Function", bound=Callable[..., Any])
Kind = Literal[
    "switch", "whole", "wholes", "number", "fraction", "sample time", "text", "names", "values by name",
    "columns", "numbers by column", "texts by column", "rows", "file", "codes",
]  # fmt: skip
"""What the value of an option is."""


@dataclass(frozen=True)
class Declared:
    """An option.

    Args:
        name: as an argument of the library.
        kind: what its value is.
        meaning: in one sentence, without a full stop.
        metavar: what the command line shows for its value.
        group: the heading in the help of a command.
        rare: whether only ``--help-all`` shows it.
        unit: in which a number is, if it may be given with another one.
        least: the smallest value, of a whole or other number.
        default: the value where it is not given, if that is one.
        spelled: the names on the command line, where they are not that of the argument.
    """

    name: str
    kind: Kind
    meaning: str
    metavar: str = "N"
    group: str = ""
    rare: bool = False
    unit: str = ""
    least: int | None = None
    default: Any = None
    spelled: tuple[str, ...] = ()


_C, _S = "Columns and units", "Samples"
READING = (
    Declared("input", "columns", "Input column, or FILE:COL; may be repeated", "COL", _C, spelled=("input", "u")),
    Declared("output", "columns", "Output column, FILE:COL, d(COL) or edges(A,B)", "COL", _C,
        spelled=("output", "y")),
    Declared("time", "text", "Time column; it must be regular, or be resampled", "COL", _C),
    Declared("dt", "sample time", "Sample time: 0.001 (seconds), 1ms or 1kHz", "S", _C),
    Declared("dbc", "text", "Database of a log of a CAN bus: DBC, KCD, SYM or ARXML", "FILE", _C),
    Declared("units", "texts by column", "Unit of a column: rpm, deg/s, count/sample, pwm, …; converted to SI",
        "COL=UNIT", _C, spelled=("unit",)),
    Declared("time_unit", "text",
        "Unit of the time column if its header has none: s, ms, us, or 8kHz for ticks", "UNIT", _C, True),
    Declared("scale", "numbers by column", "Multiply a column by a gain", "COL=GAIN", _C),
    Declared("offset", "numbers by column", "Add to a column, after its gain", "COL=X", _C, True),
    Declared("wrap", "numbers by column", "Counter or angle that starts again after N, such as 65536 or 360", "COL=N",
        _C, True),
    Declared("shift", "numbers by column",
        "Rows by which a column is moved; -1 if a row holds the command before it", "COL=N", _C, True),
    Declared("direction", "texts by column",
        "Column with the sign of a column: negative where it is not above 0", "COL=DIR", _C, True),
    Declared("signals", "texts by column",
        "What an output measures: rotor_speed, load_speed, speed, position, current", "COL=SIGNAL", _C, True,
        spelled=("signal",)),
    Declared("counts_per_revolution", "number", "Encoder counts in one revolution, for the unit count", "N", _C),
    Declared("phases", "texts by column",
        "Phases of a brushless motor, as axes i_d and i_q: i=ia,ib,ic", "AXES=COLS", _C, True),
    Declared("rotor_angle", "text", "Angle of the rotor, by which phases are turned", "COL", _C, True),
    Declared("pole_pairs", "whole", "Pole pairs, for phases and for the unit erpm", "N", _C, True, least=1),
    Declared("electrical_angle", "switch", "The angle turns once for every pole pair", group=_C, rare=True),
    Declared("power_invariant", "switch", "The phases are scaled for axes that keep the power", group=_C, rare=True),
    Declared("supply_voltage", "number", "Voltage at full pwm, for the unit pwm", "V", _C, True, "V"),
    Declared("pwm_full_scale", "number", "Value of full pwm", "N", _C, True, default=255),
    Declared("rows", "rows", "Data rows to take, from A up to but not B", "A:B", _S),
    Declared("mask", "text", 'Samples to leave out, as in "abs(PWM) > 255"', "EXPR", _S),
    Declared("resample", "switch", "Interpolate an irregular time axis to a regular one", group=_S),
    Declared("skip_bad_rows", "switch", "Leave out damaged rows and messages of the logger, at most 2 %", group=_S,
        rare=True),
    Declared("filter", "number", "Low-pass filter all channels, forwards and backwards", "HZ", _S, True, "Hz"),
    Declared("decimate", "whole", "Keep every N-th sample, after an anti-alias filter", "N", _S, True, least=1),
    Declared("detrend", "whole", "Subtract the mean (0) or a line (1) from every channel", "ORDER", _S, True, least=0),
    Declared("derivative_window", "whole", "Samples (odd) in the filter of d(COL)", "N", _S, True, default=9),
)  # fmt: skip
"""The options of `emsid.read`."""

_M, _O, _P = "Models", "Orders and static maps", "Physical parameters"


def _option(default: Any, kind: Kind, meaning: str, metavar: str = "N", group: str = _P, **more: Any) -> Any:
    """A field of `Options` with its declaration; a default that is a type makes an empty one."""
    is_type = isinstance(default, type)
    given = {"default_factory": default} if is_type else {"default": default}
    more |= {"kind": kind, "meaning": meaning, "metavar": metavar, "group": group}
    return field(**given, metadata=more if is_type or not default else {**more, "default": default})


@dataclass(frozen=True)
class Options:
    """Options of models; those that are None are chosen on selection data.

    Args:
        comparing: whether fits only compare models; the recommended one is then fitted further.
        delay_from_data: whether ``nk`` was not given: a first look at the data shows that delay, and it may be wrong.
    """

    na: int | None = _option(None, "whole", "Coefficients of past outputs", group=_O, least=0)
    nb: int | None = _option(None, "whole", "Coefficients of past inputs", group=_O, least=1)
    nk: int | None = _option(None, "whole", "Delay in samples", group=_O, least=0)
    degree: int | None = _option(
        None, "whole", "Degree of the polynomial of a Wiener–Hammerstein regression", group=_O, rare=True, least=1
    )
    taps: int | None = _option(None, "whole", "Taps of its first filter", group=_O, rare=True, least=1)
    knots: int | None = _option(
        None, "whole", "Hinges on each side of zero in a friction regression; knots or degree of a static map",
        group=_O, rare=True, least=0,
    )  # fmt: skip
    orders: tuple[int, ...] = _option(
        (), "wholes", "Orders of the filters of a cascade, or of a feedback model", "N,...", _O, rare=True
    )  # fmt: skip
    static: Family | None = _option(
        None, "text", "Static map of a cascade or a feedback model (see `emsid list`); by default a spline where knots "
        "are given, or chosen with everything else", "NAME", _O, rare=True,
    )  # fmt: skip
    period: int | None = _option(
        None, "whole", "Samples in a period of the input in steady state, 0 where it has none; by default it is "
        "detected where the input repeats exactly", group=_O, rare=True, least=0,
    )  # fmt: skip
    ridge: float = _option(
        0.0, "number", "Ridge regression: weight of the squared parameters", "WEIGHT", _O, rare=True, least=0
    )
    forgetting: float | None = _option(
        None, "number", "Estimate regressions recursively with this forgetting factor", "FACTOR", _O, rare=True
    )
    fixed: Mapping[str, Any] = _option(
        dict, "values by name", "A known physical parameter, by name or symbol, in SI units or as 'R=2 ohm ± 5 %'",
        "NAME=X", spelled=("fix",),
    )  # fmt: skip
    datasheet: Mapping[str, Any] = _option(
        dict, "file", "Starting values and tolerances of physical parameters (see `emsid parameters`)", "TOML"
    )
    free: tuple[str, ...] = _option(
        (), "names", "Estimate exactly these physical parameters; by default the usual ones, with refinements",
        "NAME,...",
    )  # fmt: skip
    codes: tuple[tuple[float, Bridge], ...] = _option(
        (), "codes", "Values of an input that are no command, and the state of the motor bridge that they mean"
    )
    per_record: tuple[str, ...] = _option(
        (), "names", "Physical parameters with another value in each record, such as rotor_inertia", "NAME,...",
        rare=True,
    )  # fmt: skip
    recent: float | None = _option(
        None, "number", "Forget errors of a physical model's free run after this time; by default, never", "S",
        rare=True, unit="s",
    )  # fmt: skip
    hold: Hold | str | None = _option(
        None, "text", "Input between the samples: zero (held), first (straight to the next), record (as each record "
        "shows); by default decided from the data", "zero|first|record", rare=True,
    )  # fmt: skip
    profile: tuple[str, ...] = _option(
        (), "names", "Compute likelihood profiles of these physical parameters", "NAME,...", rare=True
    )
    held_back: float = _option(
        0.25, "fraction", "Part of the data to fit on which structures are chosen", "FRACTION", _M, rare=True
    )
    comparing: bool = False
    delay_from_data: bool = False

    def __post_init__(self) -> None:
        from emsid.models.blocks.search.map_families import family_of
        from emsid.models.plants.search.between_samples import as_hold

        for name in ("free", "per_record", "profile"):
            object.__setattr__(self, name, as_names(getattr(self, name)))
        if self.static is not None:
            object.__setattr__(self, "static", family_of(self.static))
        if self.hold is not None:
            object.__setattr__(self, "hold", as_hold(self.hold))
        if self.ridge and self.forgetting is not None:
            raise ModelError("ridge is for a batch estimate and forgetting for a recursive one; choose one of them")

    @classmethod
    def of(cls, options: Options | None, keywords: Mapping[str, Any]) -> Options:
        """The options, given as one value or as keywords.

        Raises:
            ModelError: for both at once.
        """
        given = {name: value for name, value in keywords.items() if value is not None and value != _default(name)}
        if options is None:
            return cls(**given)
        if given:
            raise ModelError(
                f"options and {listed(list(given))} are given; put all into one of them", arguments=tuple(given)
            )
        return options

    @property
    def given(self) -> list[str]:
        """The names of options that differ from their defaults."""
        return [each.name for each in fields(self) if getattr(self, each.name) != _default(each.name)]

    @property
    def by_name(self) -> dict[str, Any]:
        """Every option by its name; the hold is a text."""
        return vars(self) | {"hold": getattr(self.hold, "value", None)}

    def estimate(
        self,
        structure: Structure,
        records: Record | Sequence[Record],
        history: bool = False,
        each_block: Callable[[], object] | None = None,
    ) -> Fit[RegressionModel]:
        """Fit a structure with these options; see `least_squares` for all rows of a file larger than memory."""
        from emsid.estimation.linear import least_squares, recursive

        if self.forgetting is None:
            return least_squares.least_squares(structure, records, ridge=self.ridge, each_block=each_block)
        return recursive.recursive_least_squares(structure, records, forgetting=self.forgetting, history=history)


_OF_MODELS = {each.name: each for each in fields(Options) if each.metadata}


def _default(name: str) -> Any:
    found = next(each for each in fields(Options) if each.name == name)
    return found.default if found.default is not MISSING else {}


IDENTIFY = (
    Declared("models", "names",
        "Models to fit; by default regressions, a motor or axis, and blocks where these leave something", "NAME,...",
        _M),
    Declared("quick", "switch", "Fit linear models and regressions only, in seconds", group=_M),
    Declared("budget", "number",
        "Time for the whole command, such as 20s; without it there is no limit. Reading takes its part, and as "
        "much is kept for tables and page; each model gets its share of the rest, which is at least half", "S", _M,
        unit="s"),
    Declared("unseen", "fraction", "Without unseen records, keep this part unseen: the end, or some of many files",
        "FRACTION", _M, default=0.3, spelled=("unseen",)),
    Declared("transient", "whole", "Samples that start a free run in motion and are left out of errors", "N", _M, True,
        least=0),
    Declared("bootstrap", "whole", "Intervals and bands from N fits to drawn pieces of the data", "N", _M, True,
        least=0),
    Declared("seed", "whole", "Seed of the drawn pieces", "N", _M, True, least=0, default=1),
    *(Declared(name, **each.metadata) for name, each in _OF_MODELS.items()),
)  # fmt: skip
"""The options of `emsid.identify`: those of a run, and the fields of `Options`."""
KEYWORDS = frozenset(_OF_MODELS)
"""The names of those that are fields of `Options`."""
DECLARED = {each.name: each for each in (*READING, *IDENTIFY)}
"""All options by name."""


def _documented(text: str | None) -> str:
    """A docstring whose list of arguments begins with the fields of `Options`."""
    lines = "".join(f"    {name}: {DECLARED[name].meaning}.\n" for name in _OF_MODELS)
    return inspect.cleandoc(text or "").replace("Args:\n", f"Args:\n{lines}", 1)


def takes_options(function: Function) -> Function:
    """Give a function the fields of `Options` as keywords, in signature and docstring; it takes them as ``given``."""
    own = inspect.signature(function)
    *parameters, rest = own.parameters.values()
    for name, each in _OF_MODELS.items():
        default = None if each.default is MISSING else each.default
        parameters.append(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default))
    shown = own.replace(parameters=[*parameters, rest.replace(name="reading")])
    function.__signature__ = shown  # type: ignore[attr-defined]
    function.__doc__ = _documented(function.__doc__)
    return function


Options.__doc__ = _documented(Options.__doc__)
