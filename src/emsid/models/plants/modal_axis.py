r"""A flexible axis in modal form: a rigid body, modes, and friction on the motor side.

    M·dv/dt = F        d²qₖ/dt² + 2ζₖωₖ dqₖ/dt + ωₖ² qₖ = φₖ F/M        F = f − F_v·w − F_c·tanh(w/v_s) − F₀
    w = v + Σ φₖ dqₖ/dt        ωₖ = 2πfₖ

w is the speed of the motor side, where the force acts and friction brakes: all masses, belts and shafts behind it are
its modes. A mode that takes part by φₖ adds a resonance at fₖ; between two resonances lies an antiresonance. n masses
have n − 1 modes.

References:
    Ewins, *Modal Testing*, 2nd ed. (2000), ch. 2. Ellis, *Control System Design Guide*, 4th ed. (2012), ch. 16.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, inf, pi

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.errors import ModelError
from emsid.models.plants.own_plant import OwnPlant
from emsid.models.plants.parameters import Signal
from emsid.plant.parameter import Parameter

Array = NDArray[np.float64]

TURN = 0.3
"""The angle in rad by which the fastest mode turns in a Runge–Kutta step: its frequency is wrong by one part in 10⁴."""
BODY = 5
"""Parameters before those of the modes."""


@njit(nogil=True)
def _speed(x: Array, p: Array) -> float:
    """The speed of the motor side."""
    speed = float(x[1])
    for k in range((len(p) - BODY) // 3):
        speed += p[BODY + 3 * k + 2] * x[3 + 2 * k]
    return float(speed)


@njit(nogil=True)
def axis_change(x: Array, u: Array, p: Array) -> Array:
    """Change of position and speed of the rigid body, then of qₖ and dqₖ/dt."""
    speed, found = _speed(x, p), np.empty(len(x))
    acceleration = (u[0] - p[1] * speed - p[2] * np.tanh(speed / p[3]) - p[4]) / p[0]
    found[0], found[1] = x[1], acceleration
    for k in range((len(p) - BODY) // 3):
        w, zeta, part = 2.0 * np.pi * p[BODY + 3 * k], p[BODY + 3 * k + 1], p[BODY + 3 * k + 2]
        q, rate = x[2 + 2 * k], x[3 + 2 * k]
        found[2 + 2 * k], found[3 + 2 * k] = rate, part * acceleration - 2.0 * zeta * w * rate - w * w * q
    return found


@njit(nogil=True)
def speed_output(x: Array, u: Array, p: Array) -> Array:
    """The speed of the motor side."""
    return np.array([_speed(x, p)])


@njit(nogil=True)
def position_output(x: Array, u: Array, p: Array) -> Array:
    """The position of the motor side."""
    position = x[0]
    for k in range((len(p) - BODY) // 3):
        position += p[BODY + 3 * k + 2] * x[2 + 2 * k]
    return np.array([position])


def modal_axis(
    frequencies: Sequence[float],
    dt: float,
    *,
    damping: float = 0.01,
    measured: Signal = Signal.SPEED,
    between: str = "held",
) -> OwnPlant:
    """An axis of one rigid body and modes, with viscous and dry friction on the motor side.

    Its values are a start for `emsid.fit`; the frequencies are those of a frequency response, or of the poles of a
    state-space model of the same record.

    >>> modal_axis([12.0, 31.0], 0.001).default_free[-3:]
    ('mode2.frequency', 'mode2.damping', 'mode2.participation')

    Args:
        frequencies: in Hz, one for every mode.
        dt: the sample time of the records in s, which decides on the Runge–Kutta steps within a sample.
        damping: the damping ratio of every mode at the start.
        measured: `Signal.SPEED` or `Signal.POSITION` of the motor side.
        between: the hold of the force between samples, see `OwnPlant`.

    Raises:
        ModelError: for frequencies that are not positive, or another signal.
    """
    if not frequencies or not min(frequencies) > 0:
        raise ModelError(f"modal axis with modes at {list(frequencies)} Hz; give at least one positive frequency")
    if measured not in (Signal.SPEED, Signal.POSITION):
        raise ModelError(f"modal axis: {measured.value} is not measured; it has speed and position")
    rows = [
        Parameter("mass", "M", "kg", "moving mass"),
        Parameter("viscous_friction", "F_v", "N*s/m", "viscous friction of the motor side"),
        Parameter("friction.coulomb", "F_c", "N", "dry friction of the motor side"),
        Parameter("friction.width", "v_s", "m/s", "speed over which dry friction changes its sign"),
        Parameter("offset", "F₀", "N", "constant force against the motion"),
    ]
    values, bounds = [1.0, 1.0, 0.0, 0.01, 0.0], [("mass", 1e-9, inf), ("viscous_friction", 0.0, inf)]
    bounds += [("friction.coulomb", 0.0, inf), ("friction.width", 1e-9, inf)]
    for k, frequency in enumerate(sorted(frequencies), 1):
        rows += [
            Parameter(f"mode{k}.frequency", f"f_{k}", "Hz", f"frequency of mode {k}"),
            Parameter(f"mode{k}.damping", f"ζ_{k}", "1", f"damping ratio of mode {k}"),
            Parameter(f"mode{k}.participation", f"φ_{k}", "1", f"part of the motor side in mode {k}"),
        ]
        values += [float(frequency), damping, 0.5]
        bounds += [(rows[-3].name, 1e-9, inf), (rows[-2].name, 0.0, 1.0), (rows[-1].name, 0.0, inf)]
    steps = max(1, ceil(2 * pi * max(frequencies) * dt / TURN))
    out = speed_output if measured is Signal.SPEED else position_output
    return OwnPlant(
        axis_change,
        out,
        tuple(rows),
        tuple(values),
        2 + 2 * len(frequencies),
        tuple(bounds),
        steps,
        "modal-axis",
        between,
    )
