r"""Park's transformation: voltages and currents of three phases in the frame of the rotor.

    x_d =  2/3·[a·cos φ + b·cos(φ − 2π/3) + c·cos(φ + 2π/3)],
    x_q = −2/3·[a·sin φ + b·sin(φ − 2π/3) + c·sin(φ + 2π/3)],      φ = p·θ, or θ if it is electrical.

With the factor 2/3 the amplitude stays that of a phase; with √(2/3) the power does (`power_invariant`), and numbers of
both axes are larger by √(3/2). The plants have amplitudes, so a log with power-invariant axes is divided by √(3/2).

The convention is checked against the data. In the right frame the axes follow from the motion: the voltage against ω,
by the flux, the current with the torque, of friction and of dω/dt. With the space vector s of the phases less its mean,
means over windows of a 16th of a turn are regressed,

    mean(s·e^(−jkθ)) = c_k·ω + e_k·dω/dt,      k = ±1, ±2, …,

and the power that this explains is largest for the number k of electrical turns in a turn of the angle: in another
frame the axes turn by k − k' for every turn of θ, and add up to little. A torque by the angle, as of gravity, has power
at both sides of k alike; so another number is right only where it explains much more than that on the other side.
Frames that turn against each other by less than a turn in the whole record are too alike to be told apart.

References:
    Park, AIEE Transactions 48 (1929). IEC 60050-411 on the axes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, listed
from emsid.findings import Finding
from emsid.record import Record

Array = NDArray[np.float64]

MOST_TURNS = 40
"""Electrical turns in a turn of the angle that are tried, in both directions; motors with more pole pairs are rare."""
WINDOWS = 16
"""Windows in a turn; of 4 to 16 these show the right number most clearly, of more the noise of an encoder is seen."""
ROWS = 100_000
"""Samples that are used, spread evenly over the record."""
CLEARER = 2.0
"""A number is wrong where another one explains this many times its power: no false alarm in 248 simulated logs of
at least half a turn."""
CHANCE = 15.0
"""The power of a number is no chance above so many times the median. For noise, the power of two regressors has a
χ²-distribution with four degrees of freedom; one of 80 such numbers is above it once in 3·10⁷ records."""


def park(
    record: Record,
    phases: Mapping[str, Sequence[str]],
    angle: str,
    pole_pairs: int,
    *,
    electrical: bool = False,
    offset: float = 0.0,
    power_invariant: bool = False,
) -> Record:
    """A record with the phases of a brushless motor replaced by d- and q-axis; the angle becomes one of the shaft.

    Args:
        record: with phases and angle among its inputs or outputs.
        phases: by letter, such as ``{"i": ("ia", "ib", "ic"), "v": ("va", "vb", "vc")}``; ``i_d`` and ``i_q`` take the
            place of the first. Of two names the third phase is minus their sum. Values that are axes already, in
            a pair with ``power_invariant``, are not transformed: leave them out here and divide by √(3/2).
        angle: its name; in rad.
        pole_pairs: p.
        electrical: whether the angle is electrical, so that it turns p times per turn of the shaft.
        offset: the electrical angle in rad at which the d-axis is that of phase a.
        power_invariant: whether the phases were scaled for power-invariant axes, by √(2/3) rather than 2/3.

    Raises:
        DataError: for unknown names, phases on different sides of the record, or another convention that the
            phases show clearly.
    """
    names = (*record.input_names, *record.output_names)
    whole = np.column_stack([record.input, record.output])
    wanted = [angle, *(name for some in phases.values() for name in some)]
    missing = [name for name in wanted if name not in names]
    if missing:
        raise DataError(f"{record.name}: no channel {missing[0]!r}; there are {listed(names)}")
    found_axes, shaft, notes = transformed(
        record.name,
        {letter: whole[:, [names.index(each) for each in some]] for letter, some in phases.items()},
        whole[:, names.index(angle)], pole_pairs,
        electrical=electrical, offset=offset, power_invariant=power_invariant,
    )  # fmt: skip
    columns: dict[str, tuple[str, str, Array]] = {}
    for letter, some in phases.items():
        unit = (*record.input_units, *record.output_units)[names.index(some[0])]
        d, q = found_axes[letter].T
        columns |= dict.fromkeys(some[2:], ("", "", d))
        columns |= {some[0]: (f"{letter}_d", unit, d), some[1]: (f"{letter}_q", unit, q)}
    columns[angle] = (angle, "rad", shaft)
    sides: dict[str, Any] = {}
    for side, own, units in (
        ("input", record.input_names, record.input_units),
        ("output", record.output_names, record.output_units),
    ):
        kept = dict(zip(own, units, strict=True))
        found = [columns.get(name, (name, unit, whole[:, names.index(name)])) for name, unit in kept.items()]
        found = [each for each in found if each[0]]
        sides |= {
            side: np.column_stack([each[2] for each in found]),
            f"{side}_names": tuple(each[0] for each in found),
            f"{side}_units": tuple(each[1] for each in found),
        }
    return replace(record, **sides, signals={}, findings=(*record.findings, *notes))


def transformed(
    label: str,
    phases: Mapping[str, Array],
    theta: Array,
    pole_pairs: int,
    *,
    electrical: bool = False,
    offset: float = 0.0,
    power_invariant: bool = False,
) -> tuple[dict[str, Array], Array, list[Finding]]:
    """(N, 2) d- and q-axis of some phases (N, 2 or 3), by letter, and the angle (N,) of the shaft without wraps.

    The third is a finding where the data are not sufficient to check the convention.

    Args:
        label: of the record, for messages.
        phases: by letter; of two the third is minus their sum.
        theta: (N,) the angle in rad.
        pole_pairs, electrical, offset, power_invariant: as for `park`.

    Raises:
        DataError: where the phases turn another number of times, or in the other direction.
    """
    whole: Array = np.asarray(np.unwrap(theta), dtype=np.float64)
    measured = {letter: _three(values) for letter, values in phases.items()}
    notes = _check(label, measured, whole, 1 if electrical else pole_pairs)
    phase = whole * (1 if electrical else pole_pairs) - offset
    scale = sqrt(3 / 2) if power_invariant else 1.0
    found = {letter: axes(values, phase) * scale for letter, values in measured.items()}
    return found, whole / (pole_pairs if electrical else 1), notes


def axes(abc: Array, phase: Array) -> Array:
    """(N, 2) d- and q-axis of three phases (N, 3) at an electrical angle (N,), with the amplitude of a phase."""
    turned = phase[:, None] - 2 * pi / 3 * np.array([0.0, 1.0, 2.0])
    return np.column_stack([np.sum(abc * np.cos(turned), axis=1), -np.sum(abc * np.sin(turned), axis=1)]) * 2 / 3


def _three(values: Array) -> Array:
    return values if values.shape[1] == 3 else np.column_stack([values, -values.sum(axis=1)])


def _check(label: str, measured: Mapping[str, Array], theta: Array, given: int) -> list[Finding]:
    """Refuse a number of electrical turns in a turn of the angle where the phases show another one."""
    checked = False
    for letter, abc in measured.items():
        explained = _explained(abc, theta)
        if explained is None:
            continue
        turns = float(np.ptp(theta)) / (2 * pi)
        tried = [k for k in range(-MOST_TURNS, MOST_TURNS + 1) if k and abs(k - given) * turns >= 1.0]
        powers = {k: explained(k) for k in {*tried, given}}
        best, floor = max(powers, key=lambda k: powers[k]), CHANCE * float(np.median(list(powers.values())))
        if powers[best] <= floor:
            continue
        checked |= best == given
        if powers[best] > CLEARER * max(powers[given], explained(2 * given - best)):
            times = f"{abs(best)} times{' backward' * (best < 0)}"
            raise DataError(
                f"{label}: the phases of {letter} turn {times} in a turn of the angle, not {given} "
                f"{'time' if given == 1 else 'times'}: motion explains {100 * powers[best]:.3g} % of their power, not "
                f"{100 * powers[given]:.2g} %; correct the pole pairs, or the kind and direction of the angle",
                arguments=("pole_pairs", "electrical_angle"),
            )
    if checked or not measured:
        return []
    return [Finding("axes-unchecked", label, {"turns": float(np.ptp(theta)) / (2 * pi), "given": given})]


def _explained(abc: Array, theta: Array) -> Callable[[int], float] | None:
    """The part of the power of phases that the motion explains, by the electrical turns in a turn of the angle.

    None where the rotor hardly moves, or the phases are constant.
    """
    step = -(-len(theta) // ROWS)
    theta, vector = theta[::step], (abc @ np.exp(2j * pi / 3 * np.arange(3)))[::step]
    vector = vector - vector.mean()  # offsets of the sensors
    power = float(np.sum(np.abs(vector) ** 2))
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(theta)))])
    first = np.flatnonzero(np.diff(np.floor(path * (WINDOWS / (2 * pi))), prepend=-1.0))
    if len(first) < 3 or power == 0.0:
        return None
    samples = np.diff(first, append=len(theta))
    speed = np.diff(theta[np.append(first, len(theta) - 1)]) / samples
    motion = np.column_stack([speed, np.gradient(speed, first + samples / 2)])
    directions = np.linalg.qr(motion * np.sqrt(samples)[:, None])[0]

    def explained(turns: int) -> float:
        sums = np.add.reduceat(vector * np.exp(-1j * turns * theta), first) / np.sqrt(samples)
        return float(np.sum(np.abs(directions.T @ sums) ** 2) / power)

    return explained
