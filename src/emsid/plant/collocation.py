"""Forces on a motor that are not linear, as polynomials of time over a step (`emsid.plant.taylor`).

The polynomial of degree n of a force F(t) takes its values at the Chebyshev points t_j = h·[1 − cos(πj/n)]/2,

    Σ_k c_k·t_j^k = F(t_j),     c_k = F(0)·δ_k0 + h^−k·Σ_j W_kj·[F(t_j) − F(0)],

with the inverse W of the Vandermonde matrix of t_j/h. A constant force is one exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.plant.constants import Constants
from emsid.plant.friction import of_motion as load_level
from emsid.plant.friction import of_motion as rotor_level
from emsid.plant.polynomials import polynomial_value

Array = NDArray[np.float64]
Directions = NDArray[np.int64]  # (2,) by body: 1 forward, −1 backward, 0 held

_kernel = njit(nogil=True, error_model="numpy", fastmath={"contract"})

# Rows of the table of Taylor coefficients: the five states, then the derived quantities. If rotor and load have one row
# each, the row of the load is second.
CURRENT, SPEED, TWIST, ANGLE, DECAY, NET, LEVEL, WAVE, MARGIN, ROWS = 0, 1, 3, 4, 5, 7, 9, 13, 15, 16
CURVED = 6
"""How many rows, from `LEVEL` on, have forces that are polynomials of a step: friction by body and direction, and what
else acts against it: torques by its angle, and of the square of its speed."""

DEGREE = 8  # of the polynomials for other forces; the rounding of their coefficients is 10⁶ times that of the forces
_NODES = [0.5 - 0.5 * np.cos(np.pi * np.arange(n + 1) / max(n, 1)) for n in range(DEGREE + 1)]
POINTS, _WEIGHTS = np.zeros((DEGREE + 1, DEGREE + 1)), np.zeros((DEGREE + 1, DEGREE + 1, DEGREE + 1))
for _n, _nodes in enumerate(_NODES):
    POINTS[_n, : _n + 1] = _nodes
    _WEIGHTS[_n, : _n + 1, : _n + 1] = np.linalg.inv(np.vander(_nodes, increasing=True))


@_kernel
def _ripple(waves: Array, body: int, angle: float) -> float:
    """The torque of the waves of a body."""
    torque = 0.0
    for n in range(len(waves)):
        if waves[n, 0] == body:
            phase = waves[n, 1] * angle
            torque += waves[n, 2] * np.cos(phase) + waves[n, 3] * np.sin(phase)
    return torque


@_kernel
def forces_at(
    m: Constants, motion: Directions, branch: int, contact: int, disturbance: float, s: Array, t: float, out: Array
) -> None:
    """The forces ``out`` (CURVED,) at the time ``t`` of the series; a sliding body has friction in one direction."""
    now = (polynomial_value(s[0], t), polynomial_value(s[1], t), polynomial_value(s[2], t))
    twist, angle = polynomial_value(s[TWIST], t), polynomial_value(s[ANGLE], t)
    made = m.slope[branch] * (m.motor_constant * now[0] - m.corner[branch])
    shaft = 0.0 if contact == 0 else m.stiffness * (twist - contact * m.gap) + m.damping * (now[1] - now[2])
    out[4], out[5] = _ripple(m.waves, 0, angle + twist), _ripple(m.waves, 1, angle)
    outside = -disturbance - out[5]
    out[5] += m.quadratic * now[2] * abs(now[2])
    for side in range(2):
        rotor, load = motion[0] * now[1] if motion[0] != 0 else 0.0, motion[1] * now[2] if motion[1] != 0 else 0.0
        rotor, load = max(rotor, 0.0), max(load, 0.0)  # in trials, a body slides backward for a moment
        if m.rigid:
            out[side] = rotor_level(rotor, m.friction[0], side, made, outside - out[4])
            out[2 + side] = load_level(load, m.friction[1], side, made, outside - out[4])
        else:
            out[side] = rotor_level(rotor, m.friction[0], side, made, -shaft - out[4])
            out[2 + side] = load_level(load, m.friction[1], side, shaft, outside)


@_kernel
def missed_by(m: Constants, s: Array, motion: Directions, step: float, t: float, force: Array) -> float:
    """The difference of the polynomials from the forces at a time, as a relative error of speed after ``step``."""
    worst = 0.0
    for row in range(CURVED):
        body = row // 2 if row < 4 else row - 4
        if row < 4 and motion[body] != 0 and row % 2 != int(motion[body] < 0):
            continue  # friction in the other direction
        missed = abs(force[row] - polynomial_value(s[LEVEL + row], t)) * step
        share = missed / (m.inertia[0] + m.inertia[1] if m.rigid else m.inertia[body])
        worst = max(worst, share / (abs(s[SPEED + body, 0]) + m.scale[SPEED]))
    return worst


@_kernel
def put_through(values: Array, step: float, s: Array) -> None:
    """The polynomials through ``values`` (degree + 1, CURVED) at the Chebyshev points of a step."""
    degree = len(values) - 1
    for row in range(CURVED):
        power = 1.0
        for k in range(degree + 1):
            total = values[0, row] if k == 0 else 0.0
            for j in range(1, degree + 1):
                total += _WEIGHTS[degree, k, j] * (values[j, row] - values[0, row])
            s[LEVEL + row, k] = total / power
            power *= step
