r"""Gains in the units of SimpleFOC, ODrive, VESC and WPILib, all on the side of the motor.

None of them has a load observer, so that their speed loop is a PI controller with the same sample time, delay, margins
and overshoot. ODrive and VESC command a torque or a current: theirs is for the plant without the braking of the
armature. With the torque constant K per ampere:

=========  =============================================================================================
SimpleFOC  ``PID_velocity`` in V (or A) per rad/s, ``P_angle`` in 1/s, ``LPF_velocity.Tf`` in s
ODrive     ``vel_gain`` = 2π·K·Kp in N·m per turn/s, ``vel_integrator_gain`` = 2π·K·Ki, ``pos_gain`` in 1/s
VESC       speed PID: ampere per electrical rpm = kp/20·I_max, so that kp = 20·Kp·(2π/60)/(p·I_max)
WPILib     kS, kV, kA and kP of the speed in V, and of the position in V per rotation
=========  =============================================================================================
"""

from __future__ import annotations

from math import pi

from emsid.controllers.cascade import Settings

Row = tuple[str, float, str]


def time_constant(settings: Settings) -> float:
    """That of the smoothing of the speed in s."""
    return 1 / settings.correction[1] - settings.dt


def firmware(
    settings: Settings | None,
    unit: str,
    current: Settings | None,
    constant: float,
    inductance: float,
    pole_pairs: int | None,
    current_max: float | None,
) -> dict[str, list[Row]]:
    """A table of name, value and unit for every firmware.

    Args:
        settings: the cascade with a PI controller; None where none keeps the margins.
        unit: of what it commands.
        current: that which commands a current; None where there is none.
        constant: N·m per ampere.
        inductance: in H; 0 where it is not known.
        pole_pairs: of the motor, for VESC.
        current_max: the largest current of the VESC in A.
    """
    found: dict[str, list[Row]] = {}
    if settings is None:
        return found
    s = settings
    if unit in ("V", "A"):
        volts = unit == "V"
        rows: list[Row] = [
            ("PID_velocity.P", s.proportional, f"{unit} per rad/s"),
            ("PID_velocity.I", s.integral, f"{unit} per rad"),
            ("LPF_velocity.Tf", time_constant(s), "s"),
        ]
        rows += [("P_angle.P", s.position, "1/s")] if s.position > 0 else []
        if volts:
            rows.append(("voltage_limit", abs(s.gain) * s.limit, "V"))
        if s.current_dt > 0:
            rows += [
                ("PID_current_q.P", s.current_proportional, "V/A"),
                ("PID_current_q.I", s.current_integral, "V/(A*s)"),
            ]
        found["SimpleFOC"] = rows
    if current is not None:
        turn = 2 * pi * constant
        found["ODrive"] = [
            ("controller.config.vel_gain", turn * current.proportional, "N*m per turn/s"),
            ("controller.config.vel_integrator_gain", turn * current.integral, "N*m per turn"),
            *([("controller.config.pos_gain", current.position, "1/s")] if current.position > 0 else []),
        ]
        if s.current_dt > 0 and inductance > 0:
            found["ODrive"].append(
                ("motor.config.current_control_bandwidth", s.current_proportional / inductance, "rad/s")
            )
        if pole_pairs is not None and current_max is not None:
            scale = 20 * (2 * pi / 60) / (pole_pairs * current_max)
            found["VESC"] = [
                ("s_pid_kp", scale * current.proportional, "20 I_max per electrical rpm"),
                ("s_pid_ki", scale * current.integral, "20 I_max per electrical rpm and s"),
                ("s_pid_kd", 0.0, ""),
            ]
            if s.current_dt > 0:
                found["VESC"] += [
                    ("foc_current_kp", s.current_proportional, "V/A"),
                    ("foc_current_ki", s.current_integral, "V/(A*s)"),
                ]
    if unit == "V":
        ahead = s.friction[0][0] + s.zone_high, s.friction[1][0] - s.zone_low
        found["WPILib"] = [
            ("kS forward", ahead[0], "V, with the dead zone"),
            ("kS backward", ahead[1], "V, with the dead zone"),
            ("kV", 2 * pi * s.per_speed, "V per rotation/s"),
            ("kA", 2 * pi * s.per_acceleration, "V per rotation/s^2"),
            ("kP of the speed", 2 * pi * s.proportional, "V per rotation/s"),
            ("kI of the speed", 2 * pi * s.integral, "V per rotation"),
        ]
        if s.position > 0:
            found["WPILib"] += [
                ("kP of the position", 2 * pi * s.position * s.proportional, "V per rotation"),
                ("kD of the position", 2 * pi * s.proportional, "V per rotation/s"),
            ]
    return found
