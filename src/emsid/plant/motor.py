"""The electromechanical system of section IV: a permanent magnet DC motor that drives a load through a shaft.

    L_a·di/dt   = D_v(v_a) − R_a·i − K_m·ω_m                               (4.1), (4.2)
    J_m·dω_m/dt = D_T(K_m·i) − T_s − B_m·ω_m − T_f(ω_m)                    (4.3), (4.4), (4.10)
    J_L·dω_L/dt = T_s − B_L·ω_L − T_f(ω_L) − T_d                           (4.5), (4.11)
    T_s = K_s·φ + B_s·(ω_m − ω_L),   dφ/dt = ω_m − ω_L                     (4.6), φ = θ_m − θ_L

D_v and D_T are dead zones (4.9) on the voltage or on the motor torque. Two limits are exact: with an infinitely stiff
shaft both masses turn as one, and without inductance the current is an algebraic function of voltage and speed.

With backlash of width 2β there is no torque while |φ| < β, and T_s = K_s·(φ ∓ β) + B_s·(ω_m − ω_L) on either side.

References:
    Nordin, Gutman, *Controlling mechanical systems with backlash – a survey*, Automatica 38 (2002), on the dead-zone
    model.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields, replace
from functools import cache
from math import inf, isfinite, isnan
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, ModelError
from emsid.plant.dead_zone import DeadZoneLaw
from emsid.plant.friction import Friction, FrictionLaw, find_law
from emsid.plant.parameter import Measure, Parameter
from emsid.units import conversion, with_unit

Array = NDArray[np.float64]


class StateSpace(NamedTuple):
    """ẋ = A·x + B·u, y = C·x + D·u."""

    A: Array
    B: Array
    C: Array
    D: Array


def _quantity(
    default: float,
    symbol: str,
    unit: str,
    description: str,
    measure: Measure = Measure.OTHER,
    positive: bool = False,
) -> Any:
    about = {"symbol": symbol, "unit": unit, "description": description, "measure": measure, "positive": positive}
    return field(default=default, metadata=about)


def _part(default: object, kind: type, description: str, *parameters: tuple[str, str, str, str]) -> Any:
    """A part with its own parameters, each (name, symbol, unit, description)."""
    table = tuple(Parameter(*p) for p in parameters)
    return field(default=default, metadata={"kind": kind, "description": description, "parameters": table})


def law_parameters(law: type[FrictionLaw], where: str = "", index: str = "", linear: bool = False) -> list[Parameter]:
    """The parameters of a friction law, with the place of the friction in symbols and descriptions."""
    place = f" on the {where}" if where else ""
    return [
        Parameter(
            each.name,
            (linear and each.linear_symbol) or f"{each.symbol}{index}",
            each.measure.unit(linear),
            f"{each.description}{place}",
        )
        for each in law.parameters
    ]


def _friction(default: Friction, where: str, index: str) -> Any:
    parameters = law_parameters(Friction, where, index)
    about = {"kind": FrictionLaw, "description": f"friction on the {where}", "parameters": tuple(parameters)}
    return field(default=default, metadata=about | {"where": where, "index": index})


def _dead_zone(default: DeadZoneLaw | None, where: str, unit: str) -> Any:
    return _part(
        default,
        DeadZoneLaw,
        f"dead zone on the {where}, or none",
        ("b_l", "b_l", unit, f"left break point of the dead zone on the {where}"),
        ("b_r", "b_r", unit, f"right break point of the dead zone on the {where}"),
        ("m_l", "m_l", "1", f"left slope of the dead zone on the {where}"),
        ("m_r", "m_r", "1", f"right slope of the dead zone on the {where}"),
    )


_CALLED = {FrictionLaw: "Friction or another friction law", DeadZoneLaw: "DeadZoneLaw"}


@dataclass(frozen=True)
class Motor:
    """A PMDC motor with shaft and load, (4.1)–(4.11); every parameter in SI units.

    The default is a 24 V motor of some 40 W that turns a disc without a gearbox. Its electrical time constant
    is 1 ms, its mechanical one 40 ms and the shaft rings at 145 Hz, so that sampling at 1 to 5 ms suits it.
    The drive has a dead zone of ±0.5 V, break-away needs another 0.4 V, and the friction on the load side is as
    small as in the paper. `Motor.parameters` lists names, symbols and units.

    Args:
        resistance: armature resistance R_a in Ω.
        inductance: armature inductance L_a in H; 0 for a current without dynamics.
        motor_constant: K_m in N·m/A, which is V·s/rad.
        rotor_inertia: J_m in kg·m².
        rotor_viscous: B_m in N·m·s/rad.
        shaft_stiffness: K_s in N·m/rad; infinite for a rigid shaft, see `rigid`.
        shaft_damping: B_s in N·m·s/rad; without effect for a rigid shaft.
        shaft_backlash: 2β in rad, the angle from one contact to the other; without effect for a rigid shaft.
        load_inertia: J_L in kg·m².
        load_viscous: B_L in N·m·s/rad.
        rotor_friction: Coulomb and Stribeck friction on the rotor.
        load_friction: Coulomb and Stribeck friction on the load.
        voltage_dead_zone: dead zone between the applied voltage and the armature, break points in V.
        torque_dead_zone: dead zone between K_m·i and the torque on the rotor, break points in N·m.

    Raises:
        ModelError: for a value that is not physical.
    """

    resistance: float = _quantity(2.0, "R_a", "ohm", "armature resistance", positive=True)
    inductance: float = _quantity(2e-3, "L_a", "H", "armature inductance")
    motor_constant: float = _quantity(0.05, "K_m", "N*m/A", "motor constant", positive=True)
    rotor_inertia: float = _quantity(
        2e-5,
        "J_m",
        "kg*m^2",
        "moment of inertia of the rotor, with the load",
        positive=True,
    )
    rotor_viscous: float = _quantity(1e-5, "B_m", "N*m*s/rad", "rotor viscous friction", Measure.DAMPING)
    shaft_stiffness: float = _quantity(10.0, "K_s", "N*m/rad", "shaft stiffness, infinite when rigid", positive=True)
    shaft_damping: float = _quantity(2e-3, "B_s", "N*m*s/rad", "shaft inner damping", Measure.DAMPING)
    shaft_backlash: float = _quantity(0.0, "2β", "rad", "backlash between rotor and load, its whole width")
    load_inertia: float = _quantity(3e-5, "J_L", "kg*m^2", "load moment of inertia", positive=True)
    load_viscous: float = _quantity(5e-6, "B_L", "N*m*s/rad", "load viscous friction", Measure.DAMPING)
    rotor_friction: FrictionLaw = _friction(Friction(8e-3, 2e-3, 0.3), "rotor", "m")  # noqa: RUF009
    load_friction: FrictionLaw = _friction(Friction(2e-6), "load", "L")  # noqa: RUF009
    voltage_dead_zone: DeadZoneLaw | None = _dead_zone(DeadZoneLaw(-0.5, 0.5), "voltage", "V")  # noqa: RUF009
    torque_dead_zone: DeadZoneLaw | None = _dead_zone(None, "torque", "N*m")  # noqa: RUF009

    def __post_init__(self) -> None:
        for part in _parts():
            value = getattr(self, part.name)
            if "kind" in part.metadata:
                kind = part.metadata["kind"]
                if not (isinstance(value, kind) or (value is None and kind is DeadZoneLaw)):
                    raise ModelError(f"motor {part.name} is {value!r}; give a {_CALLED[kind]}")
                continue
            if isinstance(value, float) and 0.0 < value < inf:  # as in every free run of a search
                continue
            if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or isnan(value):
                raise ModelError(f"motor {part.name} is {value!r}; give a number in {part.metadata['unit']}")
            if value < 0 or (value == 0 and part.metadata["positive"]):
                needed = "positive" if part.metadata["positive"] else "zero or positive"
                raise ModelError(
                    f"motor {part.name} is {with_unit(f'{value:g}', part.metadata['unit'])}; it must be {needed}"
                )
            if not isfinite(value) and part.name != "shaft_stiffness":
                raise ModelError(f"motor {part.name} is {value}; only shaft_stiffness may be infinite")
            object.__setattr__(self, part.name, float(value))

    @staticmethod
    def parameters() -> tuple[Parameter, ...]:
        """Every parameter with its symbol, SI unit and meaning, in the order of the fields.

        >>> Motor.parameters()[0]
        Parameter(name='resistance', symbol='R_a', unit='ohm', description='armature resistance')
        """
        return tuple(parameter for part in _parts() for parameter in _parameters(part))

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Motor:
        """A motor from a table, for example from a TOML file; omitted parameters keep their defaults.

        >>> motor = Motor.from_dict({"inductance": "1.5 mH", "load_friction": {"coulomb": "0.2 mN*m"}})
        >>> round(motor.inductance, 6), motor.load_friction.forward.coulomb
        (0.0015, 0.0002)

        Args:
            values: for every parameter a number in SI units or a text with a unit; for a friction or a dead zone a
                table, where frictions may have pairs [forward, backward]. An empty table removes the part.
                `dataclasses.asdict` gives such a table of a motor.

        Raises:
            ModelError: for an unknown name, a unit of another quantity or a value that is not physical.
        """
        known = {part.name: part for part in fields(cls)}
        _refuse_unknown(values, known, "motor")
        return cls(**{name: _read_part(known[name], value) for name, value in values.items()})

    @property
    def is_rigid(self) -> bool:
        """Whether rotor and load turn as one mass."""
        return self.shaft_stiffness == inf

    def rigid(self) -> Motor:
        """The one-mass motor: the limit of an infinitely stiff shaft."""
        return replace(self, shaft_stiffness=inf)

    def linear(self) -> StateSpace:
        """The linear part (4.1)–(4.6) as a state space.

        Inputs are the armature voltage v_a in V and the disturbance torque T_d in N·m, outputs the rotor
        speed and the load speed in rad/s. States are the current in A, the rotor speed and the load speed in
        rad/s and the shaft twist φ in rad; a motor without inductance has no current, and a rigid one has a
        single speed. Friction and dead zones are left out.
        """
        r, k = self.resistance, self.motor_constant
        j_m, j_l, b_m, b_l = self.rotor_inertia, self.load_inertia, self.rotor_viscous, self.load_viscous
        if self.is_rigid:
            inertia = j_m + j_l
            a = np.array([[-(b_m + b_l) / inertia]])
            torque, disturbance = np.array([1 / inertia]), np.array([-1 / inertia])
            c = np.array([[1.0], [1.0]])
        else:
            k_s, b_s = self.shaft_stiffness, self.shaft_damping
            a = np.array(
                [
                    [-(b_m + b_s) / j_m, b_s / j_m, -k_s / j_m],
                    [b_s / j_l, -(b_l + b_s) / j_l, k_s / j_l],
                    [1.0, -1.0, 0.0],
                ]
            )
            torque, disturbance = np.array([1 / j_m, 0.0, 0.0]), np.array([0.0, -1 / j_l, 0.0])
            c = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        feed = np.zeros((2, 2))
        if self.inductance == 0:
            a[:, 0] -= torque * k**2 / r
            return StateSpace(a, np.column_stack([torque * k / r, disturbance]), c, feed)
        n = len(a)
        whole, b = np.zeros((n + 1, n + 1)), np.zeros((n + 1, 2))
        whole[0, :2] = -r / self.inductance, -k / self.inductance
        whole[1:, 0], whole[1:, 1:] = torque * k, a
        b[0, 0], b[1:, 1] = 1 / self.inductance, disturbance
        return StateSpace(whole, b, np.column_stack([np.zeros(2), c]), feed)


@cache
def _parts() -> tuple[Field[Any], ...]:
    return fields(Motor)


def _parameters(part: Field[Any]) -> tuple[Parameter, ...]:
    info = part.metadata
    if "kind" in info:
        return tuple(p._replace(name=f"{part.name}.{p.name}") for p in info["parameters"])
    return (Parameter(part.name, info["symbol"], info["unit"], info["description"]),)


def _read_part(part: Field[Any], value: Any) -> Any:
    if "kind" not in part.metadata:
        return read_number(f"motor {part.name}", value, part.metadata["unit"])
    kind = part.metadata["kind"]
    if value is None or isinstance(value, kind):
        return value
    if not isinstance(value, Mapping):
        raise ModelError(f"motor {part.name} is {value!r}; give a table of its parameters")
    parameters = part.metadata["parameters"]
    if kind is FrictionLaw:
        kind = find_law(value.get("law", "coulomb-stribeck"))
        parameters = law_parameters(kind, part.metadata["where"], part.metadata["index"])
        value = {name: entry for name, entry in value.items() if name != "law"}
    units = {p.name: p.unit for p in parameters}
    _refuse_unknown(value, units, f"motor {part.name}")
    if kind is DeadZoneLaw and not value:
        return None
    if kind is DeadZoneLaw and not {"b_l", "b_r"} <= set(value):
        raise ModelError(f"motor {part.name} needs both b_l and b_r, in {units['b_l']}")
    return kind(**{name: _read_either(f"{part.name}.{name}", v, units[name]) for name, v in value.items()})


def _read_either(name: str, value: Any, unit: str) -> float | tuple[float, ...]:
    if isinstance(value, (tuple, list)):
        return tuple(read_number(f"motor {name}", v, unit) for v in value)
    return read_number(f"motor {name}", value, unit)


def read_number(what: str, value: Any, unit: str) -> float:
    """A number in SI units, or a text such as ``1.2 ohm`` converted to them.

    Args:
        what: the name of the parameter and of its owner, for messages.
        value: the number or the text.
        unit: the SI unit.

    Raises:
        ModelError: for anything else, or a unit of another quantity.
    """
    if isinstance(value, (int, float, np.number)) and not isinstance(value, bool):
        return float(value)
    text = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)?\s*", str(value))
    if text is None or not isinstance(value, str):
        raise ModelError(f"{what} is {value!r}; give a number in {unit}, or a text such as '1.5 {unit}'")
    if text[2] is None:
        return float(text[1])
    try:
        gain, offset, _ = conversion(text[2], unit)
    except DataError as problem:
        raise ModelError(f"{what} is {value!r}, which is not in {unit}: {problem}") from None
    return gain * float(text[1]) + offset


def _refuse_unknown(values: Mapping[str, Any], known: Mapping[str, Any], where: str) -> None:
    unknown = [str(name) for name in values if name not in known]
    if unknown:
        raise ModelError(f"{where} has no parameter {unknown[0]!r}; there are {', '.join(known)}")
