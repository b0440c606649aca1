r"""Constants for firmware: WPILib, ODrive, VESC, moteus and SimpleFOC, from what a motor has.

All values are those on the side of the motor, also of a joint behind a gear.

WPILib drives a motor by V = kS·sgn(ω) + kG·cos(θ) + kV·ω + kA·α. From the motor equations, u = R·i + K·ω and
J·α = K·i − b·ω − τ_c·sgn(ω) − τ_g·cos(θ), so that

    kS = R·τ_c/K [V],      kG = R·τ_g/K [V],      kV = K + R·b/K [V·s/rad],      kA = R·J/K [V·s²/rad].

A brushless motor has several resistances and constants. ``winding`` says which ones the record shows:

========  ===============================  ======================================================
winding   R                                K
========  ===============================  ======================================================
phase     of a phase                       peak voltage of a phase over speed
line      between two phases               peak voltage between two phases over speed (also six-step on direct current)
q-axis    of a phase                       torque per ampere of the q current
========  ===============================  ======================================================

With p pole pairs, the flux linkage is λ = K_phase/p = K_line/(√3·p), and the torque per ampere of the q current is
1.5·p·λ. With KV in rpm per volt between two phases, λ = 5.513/(p·KV) and torque_constant = 8.27/KV.

A current loop with the gains L·β and R·β, of a phase, cancels the pole R/L. Firmware calls β its bandwidth, which it
is without delay. With the delay t_d of reading, computing and holding the closed loop falls by 3 dB at

    ω = β·(sin(ω·t_d) + √(1 + sin²(ω·t_d))),

so that β is chosen for the bandwidth ω that is wanted: `crossover`. A controller that answers a reading in its next
period has t_d of one and a half periods; its period is the option ``current_dt``, or the delay of a brushless plant.
A brushless motor has an inductance of each axis. Its flux linkage is that of a phase; so nothing has to be said about
its winding.

How the firmware computes with them, in its public source:

=========  =============================================================================================
ODrive     ``p_gain = current_control_bandwidth * phase_inductance``, ``i_gain = R/L * p_gain``, in rad/s
           (``Firmware/MotorControl/motor.cpp``, ``Motor::update_current_controller_gains``)
VESC       ``kp = l * bw``, ``ki = r * bw``; L_d and L_q are ``foc_motor_l`` less and plus half of
           ``foc_motor_ld_lq_diff`` (``conf_general_calc_apply_foc_cc_kp_ki_gain``, ``foc_precalc_values``)
moteus     ``kp = w_3db * inductance``, ``ki = w_3db * resistance``; torque constant 3/2/√3·60/(2π)/``Kv``
           (``moteus_tool.py``, ``calculate_bandwidth``; ``fw/bldc_servo.cc``); ``poles`` counts both poles
SimpleFOC  ``P = axis_inductance * 2π * bandwidth``, ``I = phase_resistance * 2π * bandwidth``; the voltage of
           a phase is ω/(``KV_rating``·√3)·60/(2π) (``FOCMotor::tuneCurrentController``, ``estimateBEMF``)
=========  =============================================================================================
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from math import inf, nan, pi, sin, sqrt
from typing import Any

from emsid.errors import ModelError
from emsid.exports.formats import Export, Files
from emsid.exports.mechanics import CARRIED, WINDING, Mechanics, left_out, mechanics
from emsid.models.plants.brushless import Brushless as Plant

WINDINGS = ("phase", "line", "q-axis")
RPM = 60 / (2 * pi)
BANDWIDTH = 1000.0
"""Of a current loop in rad/s where none is given: the default of ODrive and of VESC."""


_OF_AXES = ("inductance_d", "inductance_q", "flux", "pole_pairs", "inertia", "delay", "advance", "dead_time_current")
"""Parameters of a brushless plant that need no note: carried, constants of the test, or without an effect alone."""


LATE = 1.5
"""Periods from the reading of a current to the middle of the voltage that answers."""


def crossover(bandwidth: float, delay: float) -> float:
    """β in rad/s of a current loop that falls by 3 dB at a bandwidth in rad/s, behind a delay in s."""
    turned = sin(min(bandwidth * delay, 0.5 * pi))
    return bandwidth / (turned + sqrt(1.0 + turned * turned))


@dataclass(frozen=True)
class Brushless:
    """The constants of a brushless motor.

    Attributes:
        resistance: of a phase in Ω.
        inductance: of a phase in H, the mean of both axes; None where it is not known.
        flux: λ in Wb.
        pole_pairs: p.
        difference: L_q − L_d in H.
    """

    resistance: float
    inductance: float | None
    flux: float
    pole_pairs: int
    difference: float = 0.0

    @property
    def torque_constant(self) -> float:
        """N·m per ampere of the q current, 1.5·p·λ."""
        return 1.5 * self.pole_pairs * self.flux

    @property
    def kv(self) -> float:
        """rpm per volt between two phases (peak), 60/(2π·√3·p·λ)."""
        return RPM / (sqrt(3) * self.pole_pairs * self.flux)

    def gains(self, bandwidth: float) -> tuple[float, float, float]:
        """Those of the current loop: proportional of the d- and the q-axis in V/A, and integral in V/(A·s)."""
        mean = self.inductance or 0.0
        d, q = mean - 0.5 * self.difference, mean + 0.5 * self.difference
        return bandwidth * d, bandwidth * q, bandwidth * self.resistance


def brushless(found: Mechanics, inductance: float | None, winding: str, pole_pairs: int) -> Brushless:
    """The constants of a brushless motor.

    Args:
        found: resistance and constant of the record.
        inductance: of the record in H; None where it is not known.
        winding: what they are, of `WINDINGS`.
        pole_pairs: of the motor.

    Raises:
        ModelError: for another word, or no pole pairs.
    """
    if winding not in WINDINGS:
        raise ModelError(
            f"winding {winding!r}: say whether resistance and constant of the record are those of a phase, between two "
            f"phases (line) or of the q axis: {', '.join(WINDINGS)}",
            arguments=("option",),
        )
    if pole_pairs < 1:
        raise ModelError(f"{pole_pairs} pole pairs; give at least one", arguments=("option",))
    half = 0.5 if winding == "line" else 1.0
    flux = {"phase": found.constant, "line": found.constant / sqrt(3), "q-axis": found.constant / 1.5}[winding]
    phase = None if inductance is None else half * inductance
    return Brushless(half * found.resistance, phase, flux / pole_pairs, pole_pairs)


def _motor(export: Export, carried: Collection[str]) -> Mechanics:
    """The mechanics on the side of the motor."""
    found = mechanics(export, carried, of_motor=True)
    if not found.constant:
        raise ModelError(f"{export.model.name} has no resistance and torque constant; identify rigid-motor")
    side = f"Values are those on the side of the motor, which turns {found.turns:g} times per turn of the joint."
    return replace(found, notes=(*[side] * (found.turns != 1.0), *found.notes))


def _brushless(export: Export) -> tuple[Brushless, float, list[str]]:
    """The motor, β of its current loop in rad/s, and what is not carried."""
    given = export.options
    plant = getattr(export.model, "plant", None)
    wanted = _number(given, "bandwidth", BANDWIDTH, "that of the current loop in rad/s")
    period = plant.delay if isinstance(plant, Plant) else 0.0
    if "current_dt" in given or period > 0:
        period = _number(given, "current_dt", period, "the sample time of the current loop in s")
    bandwidth = crossover(wanted, LATE * period)
    if isinstance(plant, Plant):
        both = plant.inductance_d, plant.inductance_q
        motor = Brushless(plant.resistance, 0.5 * sum(both), plant.flux, round(plant.pole_pairs), both[1] - both[0])
        left = left_out(plant, (*WINDING, *CARRIED, *_OF_AXES))
        return motor, bandwidth, [*left]
    found = _motor(export, WINDING)
    if "winding" not in given or "pole_pairs" not in given:
        raise ModelError(
            "a brushless motor has several resistances and constants: give winding (phase, line or q-axis) and "
            "pole_pairs",
            arguments=("option",),
        )
    try:
        pairs = int(str(given["pole_pairs"]))
    except ValueError:
        raise ModelError(f"pole_pairs {given['pole_pairs']!r}; give a whole number", arguments=("option",)) from None
    inductance = float(export.model.plant.value("inductance"))  # type: ignore[attr-defined]
    known = inductance > 0  # without one, the current follows the voltage at once
    motor = brushless(found, inductance if known else None, str(given["winding"]), pairs)
    unknown = "The record does not show the inductance: it and the gains of the current loop are left out; measure it."
    return motor, bandwidth, [*found.notes, *[unknown] * (not known)]


def _number(given: Mapping[str, Any], name: str, usual: float, what: str) -> float:
    """A positive option.

    Raises:
        ModelError: for another value.
    """
    try:
        value = float(str(given.get(name, usual)))
    except ValueError:
        value = nan
    if not 0 < value < inf:
        raise ModelError(f"{name} {given[name]!r}; give {what}", arguments=("option",))
    return value


def wpilib(export: Export) -> tuple[Files, list[str]]:
    """kS, kG, kV and kA, per radian and per rotation of the motor.

    Raises:
        ModelError: for a model without resistance and torque constant.
    """
    found = _motor(export, CARRIED)
    ratio = found.resistance / found.constant
    forward, backward = (ratio * each + found.dead_zone for each in found.friction)
    kv, ka = found.constant + ratio * found.damping, ratio * found.inertia
    text = f"""\
# Made by emsid, on the side of the motor. SimpleMotorFeedforward(kS, kV, kA), ArmFeedforward(kS, kG, kV, kA)
kS: {0.5 * (forward + backward)!r}  # V, with the dead zone of the voltage; the mean of both directions
kS_forward: {forward!r}  # V
kS_backward: {backward!r}  # V
"""
    if found.weight:
        level = f"horizontal where the joint reads {found.hangs + 0.5 * pi:.6g} rad"
        text += f"kG: {ratio * found.weight!r}  # V, times the cosine of the angle of the arm; {level}\n"
    text += f"""\
kV_radians: {kv!r}  # V per rad/s
kA_radians: {ka!r}  # V per rad/s^2
kV_rotations: {2 * pi * kv!r}  # V per rotation/s
kA_rotations: {2 * pi * ka!r}  # V per rotation/s^2
"""
    notes = list(found.notes)
    if forward != backward:
        notes.append(f"kS has one number, the mean of {forward:.4g} V forward and {backward:.4g} V backward.")
    if found.stiffness:
        notes.append("The controller of the servo is not carried.")
    return {f"{export.name}.yaml": text}, notes


def odrive(export: Export) -> tuple[Files, list[str]]:
    """The motor of an ODrive, as lines for odrivetool; it computes the gains of its current loop from the bandwidth.

    Raises:
        ModelError: for a model without resistance and torque constant, a winding that is not said, or a bandwidth that
            is not positive.
    """
    found, bandwidth, notes = _brushless(export)
    motor = "odrv0.axis0.config.motor"
    lines = [
        "# Made by emsid, on the side of the motor. Lines for odrivetool.",
        f"{motor}.torque_constant = {found.torque_constant!r}  # N*m/A, 8.27/KV with KV = {found.kv:.6g} rpm/V",
        f"{motor}.phase_resistance = {found.resistance!r}  # ohm",
        f"{motor}.pole_pairs = {found.pole_pairs}",
    ]
    if found.inductance is not None:
        gains = f"p gain {bandwidth * found.inductance:.6g} V/A, i gain {found.gains(bandwidth)[2]:.6g} V/(A*s)"
        lines.append(f"{motor}.phase_inductance = {found.inductance!r}  # H")
        lines.append(f"{motor}.current_control_bandwidth = {bandwidth!r}  # rad/s: {gains}")
    return {f"{export.name}_odrive.py": "\n".join(lines) + "\n"}, notes


def vesc(export: Export) -> tuple[Files, list[str]]:
    """The motor of a VESC, as values for the FOC page.

    Raises:
        ModelError: as `odrive`.
    """
    found, bandwidth, notes = _brushless(export)
    flux = f"Wb, 5.513/(p*KV) with p = {found.pole_pairs} and KV = {found.kv:.6g} rpm/V"
    lines = [
        "# Made by emsid, on the side of the motor.",
        f"foc_motor_r: {found.resistance!r}  # ohm",
        f"foc_motor_flux_linkage: {found.flux!r}  # {flux}",
    ]
    if found.inductance is not None:
        lines.append(f"foc_motor_l: {found.inductance!r}  # H, the mean of both axes")
        lines.append(f"foc_motor_ld_lq_diff: {found.difference!r}  # H, L_q - L_d")
        lines.append(f"foc_current_kp: {bandwidth * found.inductance!r}  # V/A, beta {bandwidth:.6g} rad/s")
        lines.append(f"foc_current_ki: {bandwidth * found.resistance!r}  # V/(A*s)")
    return {f"{export.name}_vesc.yaml": "\n".join(lines) + "\n"}, notes


def simplefoc(export: Export) -> tuple[Files, list[str]]:
    """The motor of SimpleFOC, as its declaration, and the gains of its current loop.

    Raises:
        ModelError: as `odrive`.
    """
    found, bandwidth, notes = _brushless(export)
    given = f"{found.pole_pairs}, {found.resistance:.6g}, {found.kv:.6g}"
    d, q, integral = found.gains(bandwidth)
    if found.inductance is None:
        given, what, text = f"{given}, NOT_SET", "KV in rpm/V", ""
    else:
        given, what = f"{given}, {found.inductance:.6g}", "KV in rpm/V, phase inductance in H"
        text = f"""
// The current loop with beta = {bandwidth:.6g} rad/s, in V/A and V/(A*s); call it before motor.init().
static inline void tune_current_loop() {{
  motor.PID_current_q.P = {q:.6g};
  motor.PID_current_d.P = {d:.6g};
  motor.PID_current_q.I = motor.PID_current_d.I = {integral:.6g};
}}
"""
    head = f"// Made by emsid, on the side of the motor. Pole pairs, phase resistance in ohm, {what}.\n"
    return {f"{export.name}_simplefoc.h": f"{head}BLDCMotor motor = BLDCMotor({given});\n{text}"}, notes


def moteus(export: Export) -> tuple[Files, list[str]]:
    """The motor of a moteus, as lines for ``moteus_tool --restore-config``, which skips comments.

    Raises:
        ModelError: as `odrive`.
    """
    found, bandwidth, notes = _brushless(export)
    lines = [
        f"motor.poles {2 * found.pole_pairs}",
        f"motor.resistance_ohm {found.resistance!r}",
        f"motor.Kv {found.kv!r}",
    ]
    if found.inductance is not None:
        lines.append(f"servo.pid_dq.kp {bandwidth * found.inductance!r}")
        lines.append(f"servo.pid_dq.ki {found.gains(bandwidth)[2]!r}")
    return {f"{export.name}_moteus.cfg": "\n".join(lines) + "\n"}, notes
