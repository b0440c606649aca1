"""What follows from the equations (4.1)–(4.11) of a motor: their text, their linear part, and meaningful quantities."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from emsid.errors import ModelError
from emsid.models.linear_parts import StateSpace
from emsid.models.plants.drive import Feed
from emsid.models.plants.parameters import TINY, Signal
from emsid.models.plants.plant import Quantity
from emsid.models.visited import Needs, RestsOn
from emsid.plant import DeadZoneLaw, Friction, FrictionLaw, Motor

GAP = "T_s = 0 for |φ| < β, else K_s·(φ − β·sgn(φ))"
"""The torque of a shaft with backlash, before its damping."""
WEIGHT = " − (T_a + m·g·l)·sin(θ − θ₀)"
"""The torque of gravity on a joint."""
LOST = "\nmotor and load move alone while |θ_m − θ_L| < β, and with one speed after they touch"
"""What backlash in a joint adds."""
STATES = ("current", "rotor speed", "load speed", "twist", "angle")
"""All that a linear motor may have."""


def equations(
    motor: Motor,
    feed: Feed,
    rotor: str,
    load: str,
    by_sign: tuple[float, float] = (0.0, 0.0),
    rises: str = "",
) -> str:
    """The equations as far as they apply, one per line.

    Args:
        motor: the motor.
        feed: what drives it.
        rotor, load: further terms of the torque on either.
        by_sign: further viscous friction backward, and the voltage drop against the current.
        rises: the equation of ρ, where the resistance changes.
    """
    back = "" if not by_sign[0] else " − ΔB·min(ω, 0)" if by_sign[0] > 0 else " + ΔB·max(ω, 0)"
    drop = " − V_d·sgn(i)" if by_sign[1] else ""
    slope = "L_a·di/dt = " if motor.inductance > 0 else "0 = "
    ohms = "R_a·(1 + ρ)" if rises else "R_a"
    electrical = [f"{slope}D_v(v_a){drop} − {ohms}·i − K_m·ω{'' if motor.is_rigid else '_m'}"]
    electrical += [rises] if rises else []
    if feed is not Feed.VOLTAGE:
        electrical = []
    made = "T" if feed is Feed.TORQUE else "K_m·i"
    torque = made if motor.torque_dead_zone is None else f"D_T({made})"
    if motor.is_rigid:
        mechanical = [f"(J_m + J_L)·dω/dt = {torque} − (B_m + B_L)·ω{back} − T_f(ω) − T_d{load}{rotor}"]
    else:
        mechanical = [
            f"J_m·dω_m/dt = {torque} − T_s − B_m·ω_m − T_f(ω_m){rotor}",
            f"J_L·dω_L/dt = T_s − B_L·ω_L − T_f(ω_L) − T_d{load}",
            f"{'T_s = K_s·φ' if not motor.shaft_backlash else GAP} + B_s·(ω_m − ω_L),  dφ/dt = ω_m − ω_L",
        ]
    return "\n".join([*electrical, *mechanical])


def linear_motor(
    motor: Motor,
    feed: Feed,
    gain: float,
    ratio: float,
    signals: Sequence[Signal],
    hung: tuple[float, float] = (0.0, 0.0),
    loaded: bool = False,
) -> StateSpace:
    """(4.1)–(4.6) without dry friction and dead zones: armature, two masses and shaft, as far as they exist.

    Args:
        motor: the motor.
        feed: what drives it.
        gain: of the drive.
        ratio: turns of the motor per turn measured.
        signals: of the outputs.
        hung: of a joint, the torque of gravity per angle about rest in N·m/rad, and the inertia of its weight.
        loaded: whether the second input is a torque on the load.
    """
    # a row has one element per state, then the command and the torque on the load
    own_current, rotor, load, twist, angle, command, torque = np.eye(7)[:, : 6 + loaded]
    if motor.is_rigid:
        load = rotor
    m, k, has_inductance = motor, motor.motor_constant, feed is Feed.VOLTAGE and motor.inductance > 0
    settled = {
        Feed.VOLTAGE: (gain * command - k * rotor) / m.resistance, Feed.CURRENT: gain * command,
        Feed.TORQUE: gain / k * command,
    }[feed]  # fmt: skip
    current = own_current if has_inductance else settled
    across = gain * command - m.resistance * own_current - k * rotor
    rows = {"current": across / m.inductance} if has_inductance else {}
    if m.is_rigid:
        viscous, inertia = m.rotor_viscous + m.load_viscous, m.rotor_inertia + m.load_inertia + hung[1]
        rows |= {"rotor speed": (k * current - viscous * rotor - hung[0] * angle - torque) / inertia}
    else:
        shaft = m.shaft_stiffness * twist + m.shaft_damping * (rotor - load)
        rows |= {
            "rotor speed": (k * current - shaft - m.rotor_viscous * rotor) / m.rotor_inertia,
            "load speed": (shaft - m.load_viscous * load - torque) / m.load_inertia,
            "twist": rotor - load,
        }
    rows |= {"angle": load}
    motion = {Signal.SPEED: load, Signal.ROTOR_SPEED: rotor, Signal.POSITION: angle}
    out = [current if signal is Signal.CURRENT else motion[signal] / ratio for signal in signals]
    kept = [STATES.index(name) for name in rows]
    table, seen = np.array(list(rows.values())), np.array(out).reshape(-1, 6 + loaded)
    return StateSpace(table[:, kept], table[:, 5:], seen[:, kept], seen[:, 5:], tuple(rows))


SLIDING = RestsOn(Needs.SLIDING)
FORWARD, BACKWARD = (RestsOn(Needs.SLIDING, way) for way in (1, -1))


def quantities(motor: Motor, feed: Feed, drop: float = 0.0, load: float = 0.0) -> tuple[Quantity, ...]:
    """Quantities that input and speed alone identify.

    Args:
        motor: the motor.
        feed: what drives it.
        drop: a voltage against the current.
        load: a constant torque.
    """
    return _of_voltage(motor, drop, load) if feed is Feed.VOLTAGE else _of_torque(motor, feed)


def of_joint(m: Motor, weight: float, inertia: float, ratio: float) -> tuple[Quantity, ...]:
    """What simulators of robots ask of a joint behind a gear, at the joint.

    Args:
        m: the motor.
        weight: the torque of gravity at horizontal in N·m.
        inertia: all of it, at the motor.
        ratio: turns of the motor per turn of the joint.
    """
    level = together(m.rotor_friction, m.load_friction).base[0]
    at_joint, damping = ratio**2 * inertia, ratio**2 * (m.rotor_viscous + m.load_viscous)
    found = [Quantity("gravity torque at horizontal", "T_a + m·g·l", "N*m", weight)]
    if ratio != 1.0:
        found += [
            Quantity("inertia at the joint", "n²·J", "kg*m^2", at_joint),
            Quantity("damping at the joint", "n²·B", "N*m*s/rad", damping),
            Quantity("friction at the joint", "n·T_c", "N*m", abs(ratio) * level, SLIDING),
        ]
    if weight > 0:
        found.append(Quantity("swing about rest", "√(T_g/J)", "rad/s", float(np.sqrt(weight / at_joint))))
    return tuple(found)


def _of_torque(m: Motor, feed: Feed) -> tuple[Quantity, ...]:
    inertia, viscous = m.rotor_inertia + m.load_inertia, m.rotor_viscous + m.load_viscous
    level, k = together(m.rotor_friction, m.load_friction).base[0], m.motor_constant
    found = [Quantity("mechanical time constant", "J/B", "s", inertia / max(viscous, TINY))]
    if feed is Feed.CURRENT:
        found += [
            Quantity("acceleration per ampere", "K/J", "rad/(A*s^2)", k / inertia),
            Quantity("Coulomb current", "T_c/K", "A", level / k, SLIDING),
        ]
    return tuple(found)


def _of_voltage(m: Motor, drop: float, load: float) -> tuple[Quantity, ...]:
    r, k = m.resistance, m.motor_constant
    inertia, viscous = m.rotor_inertia + m.load_inertia, m.rotor_viscous + m.load_viscous
    damping = k**2 / r + viscous
    slide = together(m.rotor_friction, m.load_friction)
    found = [
        Quantity("mechanical time constant", "J/(B + K²/R)", "s", inertia / damping),
        Quantity("speed per volt", "K/(K² + R·B)", "rad/(V*s)", k / r / damping),
        Quantity("acceleration per volt", "K/(R·J)", "rad/(V*s^2)", k / (r * inertia)),
        Quantity("Coulomb voltage forward", "R·T_c/K", "V", r * slide.base[0] / k, FORWARD),
        Quantity("Coulomb voltage backward", "R·T_c/K", "V", r * slide.base[1] / k, BACKWARD),
        Quantity("electromechanical time constant", "R·J/K²", "s", r * inertia / k**2),
    ]
    zone = m.voltage_dead_zone or DeadZoneLaw(0.0, 0.0)
    for k_side, side, edge, slope in ((0, "forward", zone.b_r, zone.m_r), (1, "backward", -zone.b_l, zone.m_l)):
        held, way = slide.breakaway[k_side], 1 if side == "forward" else -1
        before = "b + " + ("" if drop == 0 else "V_d + " if slope == 1 else "V_d/m + ")
        scale, torque = ("K" if slope == 1 else "(K·m)"), ("T_c + T_d" if way > 0 else "T_c − T_d")
        lost = edge + (r * (slide.base[k_side] + way * load) / k + drop) / slope
        found.append(
            Quantity(f"voltage lost (kS) {side}", f"{before}R·({torque})/{scale}", "V", lost, RestsOn(direction=way))
        )
        leaves, needs = f"{before}R·(T_c + T_s)/{scale}", RestsOn(Needs.THRESHOLD, way)
        found.append(Quantity(f"break-away voltage {side}", leaves, "V", edge + (r * held / k + drop) / slope, needs))
    found += [
        Quantity("voltage per speed (kV)", "K + R·B/K", "V*s/rad", k + r * viscous / k),
        Quantity("voltage per acceleration (kA)", "R·J/K", "V*s^2/rad", r * inertia / k),
    ]
    if m.inductance > 0:
        found.append(Quantity("electrical time constant", "L/R", "s", m.inductance / r))
    if not m.is_rigid:
        ring = m.shaft_stiffness * (1 / m.rotor_inertia + 1 / m.load_inertia)
        found += [
            Quantity("shaft resonance", "√(K_s·(1/J_m + 1/J_L))", "rad/s", float(np.sqrt(ring))),
            Quantity("inertia ratio", "J_L/J_m", "1", m.load_inertia / m.rotor_inertia),
        ]
    return tuple(found)


def together(rotor: FrictionLaw, load: FrictionLaw) -> FrictionLaw:
    """The friction of both sides of a rigid motor as one law.

    The levels of two `Friction` laws are added; the rate is that of the rotor if it has an excess.

    Raises:
        ModelError: for two different laws that both have an effect.
    """
    if not any(load.breakaway) and isinstance(load, Friction):
        return rotor
    if not (isinstance(rotor, Friction) and isinstance(load, Friction)):
        raise ModelError(
            f"a rigid motor has one friction law, and this one has {type(rotor).__name__} on the rotor and "
            f"{type(load).__name__} on the load; put all of it on the rotor: load_friction=Friction()"
        )
    sides = list(zip((rotor.forward, rotor.backward), (load.forward, load.backward), strict=True))
    return Friction(
        tuple(a.coulomb + b.coulomb for a, b in sides),  # type: ignore[arg-type]
        tuple(a.stribeck + b.stribeck for a, b in sides),  # type: ignore[arg-type]
        tuple((a if a.stribeck > 0 else b).stribeck_rate for a, b in sides),  # type: ignore[arg-type]
    )
