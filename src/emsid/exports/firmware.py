r"""Constants for firmware: WPILib, ODrive, VESC and SimpleFOC, from resistance, torque constant, inertia and friction.

WPILib drives a motor by V = kS·sgn(ω) + kV·ω + kA·α. From the motor equations, u = R·i + K·ω and
J·α = K·i − b·ω − τ_c·sgn(ω), so that

    kS = R·τ_c/K [V],      kV = K + R·b/K [V·s/rad],      kA = R·J/K [V·s²/rad].

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
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

from emsid.errors import ModelError
from emsid.exports.formats import Export, Files
from emsid.exports.mechanics import Mechanics, mechanics

WINDINGS = ("phase", "line", "q-axis")
RPM = 60 / (2 * pi)


@dataclass(frozen=True)
class Brushless:
    """The constants of a brushless motor.

    Attributes:
        resistance: of a phase in Ω.
        inductance: of a phase in H; None where it is not known.
        flux: λ in Wb.
        pole_pairs: p.
    """

    resistance: float
    inductance: float | None
    flux: float
    pole_pairs: int

    @property
    def torque_constant(self) -> float:
        """N·m per ampere of the q current, 1.5·p·λ."""
        return 1.5 * self.pole_pairs * self.flux

    @property
    def kv(self) -> float:
        """rpm per volt between two phases (peak), 60/(2π·√3·p·λ)."""
        return RPM / (sqrt(3) * self.pole_pairs * self.flux)


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


def _motor(export: Export) -> Mechanics:
    found = mechanics(export)
    if not found.constant:
        raise ModelError(f"{export.model.name} has no resistance and torque constant; identify rigid-motor")
    return found


def _brushless(export: Export) -> Brushless:
    found = _motor(export)
    given = export.options
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
    plant = export.model.plant  # type: ignore[attr-defined]
    inductance = float(plant.value("inductance"))  # without one, the current follows the voltage at once
    return brushless(found, inductance if inductance > 0 else None, str(given["winding"]), pairs)


def wpilib(export: Export) -> tuple[Files, list[str]]:
    """kS, kV and kA, per radian and per rotation of the output.

    Raises:
        ModelError: for a model without resistance and torque constant.
    """
    found = _motor(export)
    ratio = found.resistance / found.constant
    ks = ratio * 0.5 * sum(found.friction) + found.dead_zone
    kv, ka = found.constant + ratio * found.damping, ratio * found.inertia
    text = f"""\
# Made by emsid. SimpleMotorFeedforward(kS, kV, kA)
kS: {ks!r}  # V, with the dead zone of the voltage
kV_radians: {kv!r}  # V per rad/s
kA_radians: {ka!r}  # V per rad/s^2
kV_rotations: {2 * pi * kv!r}  # V per rotation/s
kA_rotations: {2 * pi * ka!r}  # V per rotation/s^2
"""
    return {f"{export.name}.yaml": text}, list(found.notes)


def odrive(export: Export) -> tuple[Files, list[str]]:
    """The motor of an ODrive, as lines for odrivetool; gains are not designed here.

    Raises:
        ModelError: for a model without resistance and torque constant, or a winding that is not said.
    """
    found = _brushless(export)
    text = f"""\
# Made by emsid. Lines for odrivetool.
odrv0.axis0.config.motor.torque_constant = {found.torque_constant!r}  # N*m/A, 8.27/KV with KV = {found.kv:.6g} rpm/V
odrv0.axis0.config.motor.phase_resistance = {found.resistance!r}  # ohm
{_line("odrv0.axis0.config.motor.phase_inductance =", found.inductance, "H")}
odrv0.axis0.config.motor.pole_pairs = {found.pole_pairs}
"""
    return {f"{export.name}_odrive.py": text}, _notes(export, found)


def vesc(export: Export) -> tuple[Files, list[str]]:
    """The motor of a VESC, as values for the FOC page.

    Raises:
        ModelError: for a model without resistance and torque constant, or a winding that is not said.
    """
    found = _brushless(export)
    text = f"""\
# Made by emsid.
foc_motor_r: {found.resistance!r}  # ohm
{_line("foc_motor_l:", found.inductance, "H")}
foc_motor_flux_linkage: {found.flux!r}  # Wb, 5.513/(p*KV) with p = {found.pole_pairs} and KV = {found.kv:.6g} rpm/V
"""
    return {f"{export.name}_vesc.yaml": text}, _notes(export, found)


def simplefoc(export: Export) -> tuple[Files, list[str]]:
    """The motor of SimpleFOC, as its declaration.

    Raises:
        ModelError: for a model without resistance and torque constant, or a winding that is not said.
    """
    found = _brushless(export)
    inductance = "NOT_SET" if found.inductance is None else f"{found.inductance:.6g}"
    text = f"""\
// Made by emsid. Pole pairs, phase resistance in ohm, KV in rpm/V, phase inductance in H.
BLDCMotor motor = BLDCMotor({found.pole_pairs}, {found.resistance:.6g}, {found.kv:.6g}, {inductance});
"""
    return {f"{export.name}_simplefoc.h": text}, _notes(export, found)


def _line(name: str, value: float | None, unit: str) -> str:
    """A line with a value; of one that is not known a comment, as zero would be taken for a value."""
    return f"# {name} ...  # {unit}; not known, measure it" if value is None else f"{name} {value!r}  # {unit}"


def _notes(export: Export, found: Brushless) -> list[str]:
    notes = list(mechanics(export).notes)
    return notes if found.inductance is not None else [*notes, "The record does not show the inductance; measure it."]
