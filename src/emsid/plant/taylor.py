"""The motor as Taylor series between events, with friction as a set-valued law, compiled.

Between two events the equations of the motor are analytic: the input is constant, every body either slides in a known
direction or is held by friction, and the torque is on a known branch of its dead zone. The only nonlinear term is the
Stribeck exponential e = exp(−α₂·s·ω) of a body sliding in direction s, with ė = −α₂·s·ω̇·e. So the Taylor coefficients
x_k of every quantity follow from the equations order by order, for example

    ω_{k+1} = (net torque − friction)_k / [J·(k + 1)],
    e_{k+1} = −α₂·s/(k + 1) · Σ_j (j + 1)·ω_{j+1}·e_{k−j},

to any order and without another evaluation of the law. The step for which the last terms stay below the tolerance is
known in advance (Jorba and Zou, Experimental Mathematics 14, 2005). The series is also the dense output.

Any other force – of any friction law, also by load, of friction by the square of the speed, of torques that repeat with
an angle – is a polynomial of time over the step, through its values at the Chebyshev points of the step, where the
series has speeds, angles and loads. The series follows from the polynomials as above, and they from the series, in
turns, until nothing changes (Picard iteration; a collocation method). Between these points the polynomials and the
forces are compared; where they differ by more than the tolerance, as at a corner of a force, the step is shorter.

A step ends at the first event in it, which is the first zero of a polynomial:

- the speed of a sliding body reaches zero: the body is held, its speed is exactly 0;
- the net torque on a held body exceeds the break-away level α₀ + α₁ of its direction: the body slides;
- the torque leaves its branch of the dead zone;
- with backlash, rotor and load come into contact or part.

`first_below` finds it, also where there are two crossings in one step. A torque exceeds a level only if it is larger by
`_SLACK` times the acting torques; so rounding errors do not release a body that friction holds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit, with_functions
from emsid.plant.collocation import (
    ANGLE,
    CURRENT,
    CURVED,
    DECAY,
    DEGREE,
    LEVEL,
    MARGIN,
    NET,
    POINTS,
    ROWS,
    SPEED,
    TWIST,
    WAVE,
    Directions,
    forces_at,
    missed_by,
    put_through,
)
from emsid.plant.constants import Constants, acting_laws
from emsid.plant.friction import of_forces
from emsid.plant.motor import Motor
from emsid.plant.polynomials import first_below, polynomial_value, product_integral

Array = NDArray[np.float64]

_kernel = njit(nogil=True, error_model="numpy", fastmath={"contract"})


_SLACK = 1e-12  # relative; a thousand times the rounding of a sum of torques
_SETTLED = 1e-10  # relative error of speed up to which series and polynomials agree
_ROUNDS = 12  # of series and polynomials in turns, which take four to six; a shorter step then converges
_BEYOND = 1.0 + 1e-9  # of the time at which a body comes to rest, so that a step has it
_SHORTEST = 1e-9  # of a sample; a step beside a jump of a force
_MOST_STEPS = 100_000  # in one sample
SPARE_STEPS = 10_000  # of a bounded simulation, in addition to those per sample
SPARE_EVENTS = 64  # array elements for events, in addition to one per sample


@_kernel
def run(
    m: Constants,
    volts: Array,
    armature: Array,
    torques: Array,
    holds: Array,
    order: int,
    tolerance: float,
    longest: float,
    budget: float,
    energy: bool,
    states: Array,
    spent: Array,
    instant: Array,
    events: NDArray[np.int64],
    counts: NDArray[np.int64],
) -> None:
    """Simulate from ``states[0]``: fill ``states`` (N + 1, 5), ``spent``, and ``instant`` and ``events`` up to their
    length; ``counts`` are the numbers of events and of samples done.

    It returns nothing: Ctrl-C while a kernel converts its arrays to objects would end the interpreter.
    """
    s = np.zeros((ROWS, order + 1))
    centred = np.empty(order + 1)
    margin = np.empty(order + 1)
    motion = np.zeros(2, np.int64)
    x = np.empty(5)
    for row in range(5):
        x[row] = states[0, row]
    happened = 0
    latest = np.full(2, -1)
    clock = 0.0
    taken = 0.0
    work = np.empty((2, CURVED))
    for k in range(len(volts)):
        for body in range(2):
            motion[body] = _motion_at(m, body, x[SPEED + body])
        contact = _contact_at(m, x)
        torque = m.motor_constant * x[CURRENT]
        branch = 1 + int(torque > m.edge[1]) - int(torque < m.edge[0])
        left, wide = holds[k], holds[k]
        for _ in range(_MOST_STEPS):
            if taken >= budget:
                break
            taken += 1.0
            if m.curved:
                fixed, step = (motion, branch, contact, armature[k], torques[k]), min(left, longest, wide)
                step = _settle(m, x, *fixed, step, _SHORTEST * holds[k], tolerance, s, work, margin, centred)
                wide = 2.0 * step
            else:
                _expand(m, x, motion, branch, contact, armature[k], torques[k], s)
                step = min(left, longest, _step_for(m, s, tolerance))
            while True:
                step, event, body, turn = _first_event(m, s, motion, branch, contact, torques[k], step, margin, centred)
                if m.curved or not _decay_error(m, s, motion, step) > tolerance:
                    break
                step *= 0.5
            if energy:
                _spend(m, s, motion, branch, contact, volts[k], armature[k], torques[k], step, margin, spent)
            _advance(s, step, x)
            left -= step
            if event == _BRANCH:
                branch += turn
            elif event == _CONTACT:
                x[TWIST] = m.gap * (turn if contact == 0 else contact)
                contact += turn
            elif event == _MOTION:
                x[SPEED + body] = 0.0
                if m.rigid:
                    x[SPEED + 1] = 0.0
                now = clock + (holds[k] - left)
                happened = _note_event(now, body, motion[body], turn, latest, happened, instant, events)
                motion[body] = turn
                if m.rigid:
                    motion[1] = turn
            elif not left > 0.0:
                break
        check = left
        for row in range(5):
            states[k + 1, row] = x[row]
            check += x[row] - x[row]
        if check != 0.0:  # time is left over, or a state is not finite
            counts[0], counts[1] = happened, k
            return
        clock += holds[k]
    counts[0], counts[1] = happened, len(volts)


@_kernel
def _note_event(
    now: float,
    body: int,
    before: int,
    after: int,
    latest: Directions,
    happened: int,
    instant: Array,
    events: NDArray[np.int64],
) -> int:
    """Write an event into ``instant`` and ``events`` as far as they reach; the number of events with it.

    A body that was held for no time has reversed: both are one event. ``latest`` (2,) is the last event of each body.
    """
    again, capacity = latest[body], len(instant)
    if after != 0 and 0 <= again < capacity and instant[again] == now and events[again, 2] == 0:
        events[again, 2] = after
        return happened
    if happened < capacity:
        instant[happened] = now
        events[happened, 0], events[happened, 1], events[happened, 2] = body, before, after
    latest[body] = happened
    return happened + 1


@_kernel
def _motion_at(m: Constants, body: int, speed: float) -> int:
    """The motion for a speed; a body without friction is never held, and slides at speed 0 too."""
    if speed == 0.0 and not m.holds[0 if m.rigid else body]:
        return 1
    return int(speed > 0.0) - int(speed < 0.0)


@_kernel
def _contact_at(m: Constants, x: Array) -> int:
    """The side on which rotor and load touch: 1 or −1, or 0 within the backlash; without backlash 1."""
    if m.gap == 0.0:
        return 1
    side = int(x[TWIST] > 0.0) - int(x[TWIST] < 0.0)
    beyond = abs(x[TWIST]) - m.gap
    closing = side * (x[SPEED] - x[SPEED + 1])
    return side if beyond > 0.0 or (beyond == 0.0 and closing > 0.0) else 0


@_kernel
def _expand(
    m: Constants, x: Array, motion: Directions, branch: int, contact: int, volt: float, disturbance: float, s: Array
) -> None:
    """The Taylor coefficients ``s`` (rows, order + 1) of all quantities around the state ``x``."""
    order = s.shape[1] - 1
    for row in range(5):
        s[row, 0] = x[row]
    for body in range(2):
        sliding = not m.curved and motion[body] != 0 and m.friction[body, int(motion[body] < 0), 1] > 0.0
        rate = m.friction[body, int(motion[body] < 0), 2]
        for k in range(order + 1):
            s[DECAY + body, k] = 0.0
        if sliding:
            s[DECAY + body, 0] = np.exp(-rate * motion[body] * x[SPEED + body])
    # A division is much slower than a product.
    per_ohm = 1.0 / m.resistance
    per_henry = 1.0 / m.inductance if m.inductance > 0.0 else 0.0
    rotor_share = 1.0 / (m.inertia[0] + m.inertia[1] if m.rigid else m.inertia[0])
    load_share = 1.0 / m.inertia[1]
    for k in range(order + 1):
        unit = 1.0 if k == 0 else 0.0
        if m.inductance == 0.0:
            s[CURRENT, k] = (volt * unit - m.motor_constant * s[SPEED, k]) * per_ohm
        torque = m.slope[branch] * (m.motor_constant * s[CURRENT, k] - m.corner[branch] * unit)
        shaft = 0.0
        if contact != 0:
            twist = s[TWIST, k] - contact * m.gap * unit
            shaft = m.stiffness * twist + m.damping * (s[SPEED, k] - s[SPEED + 1, k])
        s[NET, k] = torque - shaft - m.viscous[0] * s[SPEED, k] - s[WAVE, k]
        s[NET + 1, k] = shaft - m.viscous[1] * s[SPEED + 1, k] - disturbance * unit - s[WAVE + 1, k]
        if m.rigid:
            s[NET, k] += s[NET + 1, k]
            s[NET + 1, k] = s[NET, k]
        if k == order:
            return
        part = 1.0 / (k + 1)
        if m.inductance > 0.0:
            drop = m.resistance * s[CURRENT, k] + m.motor_constant * s[SPEED, k]
            s[CURRENT, k + 1] = (volt * unit - drop) * (per_henry * part)
        rotor = _friction_term(m, s, motion, 0, k)
        load = _friction_term(m, s, motion, 1, k)
        if m.rigid:
            gained = (s[NET, k] - rotor - load) * (rotor_share * part)
            s[SPEED, k + 1] = gained if motion[0] != 0 else 0.0
            s[SPEED + 1, k + 1] = s[SPEED, k + 1]
        else:
            s[SPEED, k + 1] = (s[NET, k] - rotor) * (rotor_share * part) if motion[0] != 0 else 0.0
            s[SPEED + 1, k + 1] = (s[NET + 1, k] - load) * (load_share * part) if motion[1] != 0 else 0.0
        s[TWIST, k + 1] = (s[SPEED, k] - s[SPEED + 1, k]) * part
        s[ANGLE, k + 1] = s[SPEED + 1, k] * part
        for body in range(2):
            if s[DECAY + body, 0] > 0.0:
                total = 0.0
                for j in range(k + 1):
                    total += (j + 1) * s[SPEED + body, j + 1] * s[DECAY + body, k - j]
                rate = m.friction[body, int(motion[body] < 0), 2]
                s[DECAY + body, k + 1] = -rate * motion[body] * total * part


@_kernel
def _friction_term(m: Constants, s: Array, motion: Directions, body: int, k: int) -> float:
    """Taylor coefficient ``k`` of the friction on a sliding body."""
    side = int(motion[body] < 0)
    if m.curved:
        return float(motion[body] * s[LEVEL + 2 * body + side, k])
    level = m.friction[body, side, 0] if k == 0 else 0.0
    return float(motion[body] * (level + m.friction[body, side, 1] * s[DECAY + body, k]))


@_kernel
def _settle(
    m: Constants,
    x: Array,
    motion: Directions,
    branch: int,
    contact: int,
    volt: float,
    disturbance: float,
    step: float,
    shortest: float,
    tolerance: float,
    s: Array,
    work: Array,
    margin: Array,
    centred: Array,
) -> float:
    """The series and the polynomials of all forces from the state ``x``; the step for which they hold, up to ``step``.

    A step ends where a body comes to rest, since its friction is known up to there only.
    """
    degree = min(DEGREE, s.shape[1] - 2)
    s[LEVEL:MARGIN] = 0.0
    settled = min(tolerance, _SETTLED)
    values = np.empty((degree + 1, CURVED))
    while True:
        changed = np.inf
        for _ in range(_ROUNDS):
            _expand(m, x, motion, branch, contact, volt, disturbance, s)
            if changed <= settled:
                break
            step = min(step, max(_step_for(m, s, tolerance), shortest))
            for body in range(2):
                if motion[body] != 0 and m.holds[0 if m.rigid else body]:
                    at = first_below(0.0, float(motion[body]), s[SPEED + body], step, margin, centred)
                    step = min(step, _BEYOND * at) if at > 0.0 else step
            changed = 0.0
            for j in range(degree + 1):
                t = step * POINTS[degree, j]
                forces_at(m, motion, branch, contact, disturbance, s, t, values[j])
                changed = max(changed, missed_by(m, s, motion, step, t, values[j]))
            put_through(values, step, s)
        worst = 0.0
        for j in range(degree if np.isfinite(tolerance) else 0):
            t = 0.5 * step * (POINTS[degree, j] + POINTS[degree, j + 1])
            forces_at(m, motion, branch, contact, disturbance, s, t, work[0])
            worst = max(worst, missed_by(m, s, motion, step, t, work[0]))
        if step <= shortest or (changed <= settled and worst <= tolerance):
            return step
        better = 0.9 * (tolerance / worst) ** (1.0 / (degree + 2)) if worst > tolerance else 0.5
        step *= min(max(better, 0.1), 0.5)


@_kernel
def _step_for(m: Constants, s: Array, tolerance: float) -> float:
    """The step for which the last two terms of every series stay below the tolerance, in s."""
    order = s.shape[1] - 1
    last, before = 0.0, 0.0
    for row in range(4):
        scale = abs(s[row, 0]) + m.scale[row]
        last = max(last, abs(s[row, order]) / scale)
        before = max(before, abs(s[row, order - 1]) / scale)
    step = np.inf
    if last > 0.0:
        step = min(step, (tolerance / last) ** (1.0 / order))
    if before > 0.0:
        step = min(step, (tolerance / before) ** (1.0 / (order - 1)))
    return step


@_kernel
def _decay_error(m: Constants, s: Array, motion: Directions, step: float) -> float:
    """The difference of the Stribeck series from the exponential of the speed after ``step``, as a relative error
    of speed.

    The last terms of a series do not bound its remainder while the terms grow, as they do for an excess that
    increases when the body slows down; this difference does.
    """
    worst = 0.0
    for body in range(2):
        side = int(motion[body] < 0)
        if motion[body] != 0 and m.friction[body, side, 1] > 0.0:
            speed = polynomial_value(s[SPEED + body], step)
            exact = np.exp(-m.friction[body, side, 2] * motion[body] * speed)
            missed = abs(exact - polynomial_value(s[DECAY + body], step))
            change = m.friction[body, side, 1] * missed * step / m.inertia[body]
            worst = max(worst, change / (abs(s[SPEED + body, 0]) + m.scale[SPEED]))
    return worst


_NONE, _MOTION, _BRANCH, _CONTACT = 0, 1, 2, 3


@_kernel
def _first_event(
    m: Constants,
    s: Array,
    motion: Directions,
    branch: int,
    contact: int,
    disturbance: float,
    step: float,
    margin: Array,
    centred: Array,
) -> tuple[float, int, int, int]:
    """The first event up to ``step``: its time, kind, body, and the new motion or the change of branch or contact."""
    kind, which, turn = _NONE, 0, 0
    drive = m.motor_constant * (abs(s[CURRENT, 0]) + m.scale[CURRENT])
    shaft = m.stiffness * abs(s[TWIST, 0]) + m.damping * (abs(s[SPEED, 0]) + abs(s[SPEED + 1, 0]))
    for body in range(1 if m.rigid else 2):
        if not m.holds[body]:
            continue
        level = max(m.breakaway[body, 0], m.breakaway[body, 1])
        if motion[body] != 0:
            at = first_below(0.0, float(motion[body]), s[SPEED + body], step, margin, centred)
            if at <= step:
                step, kind, which, turn = at, _MOTION, body, 0
            continue
        slack = _SLACK * (level + drive + shaft + abs(disturbance))
        for side in range(2):
            direction = 1 - 2 * side
            if m.curved:
                for k in range(s.shape[1]):
                    s[MARGIN, k] = s[LEVEL + 2 * body + side, k] - direction * s[NET + body, k]
                    if m.rigid:
                        s[MARGIN, k] += s[LEVEL + 2 + side, k]
                at = first_below(slack, 1.0, s[MARGIN], step, margin, centred)
            else:
                bound = m.breakaway[body, side] + slack
                at = first_below(bound, float(-direction), s[NET + body], step, margin, centred)
            if at <= step:
                step, kind, which, turn = at, _MOTION, body, direction
    for side in range(2):
        edge, outward = m.edge[side], 2 * side - 1
        if not np.isfinite(edge):
            continue
        if branch == 1:
            bound, change = outward * edge + _SLACK * (drive + abs(edge)), outward
        elif branch == 2 * side:
            bound, change = -outward * edge, -outward
        else:
            continue
        at = first_below(bound, -change * m.motor_constant, s[CURRENT], step, margin, centred)
        if at <= step:
            step, kind, turn = at, _BRANCH, change
    for outward in (-1, 1) if m.gap > 0.0 else (0, 0):
        if outward == 0 or contact == -outward:
            continue
        away = contact == outward
        bound, factor = -m.gap if away else m.gap, float(outward if away else -outward)
        at = first_below(bound, factor, s[TWIST], step, margin, centred)
        if at <= step:
            step, kind, turn = at, _CONTACT, -outward if away else outward
    return step, kind, which, turn


@_kernel
def _advance(s: Array, step: float, x: Array) -> None:
    """The state ``x`` after a step; its five series are evaluated in parallel for speed."""
    a, b, c, d, e = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(s.shape[1] - 1, -1, -1):
        a = a * step + s[0, k]
        b = b * step + s[1, k]
        c = c * step + s[2, k]
        d = d * step + s[3, k]
        e = e * step + s[4, k]
    x[0], x[1], x[2], x[3], x[4] = a, b, c, d, e


@_kernel
def _spend(
    m: Constants,
    s: Array,
    motion: Directions,
    branch: int,
    contact: int,
    volt: float,
    armature: float,
    disturbance: float,
    step: float,
    work: Array,
    spent: Array,
) -> None:
    """Add the energies of one step to ``spent``, in the order of `Energy`: integrals of products of two series."""
    current, rotor, load = s[CURRENT], s[SPEED], s[SPEED + 1]
    unit = np.ones(1)
    charge = product_integral(unit, current, step)
    spent[0] += volt * charge
    spent[2] += m.resistance * product_integral(current, current, step)
    for body in range(2):
        speed = s[SPEED + body]
        spent[3 + body] += m.viscous[body] * product_integral(speed, speed, step)
        for k in range(len(work)):
            work[k] = _friction_term(m, s, motion, body, k)
        spent[5 + body] += product_integral(work, speed, step)
    for k in range(len(work)):
        work[k] = rotor[k] - load[k]
    if contact != 0:
        spent[7] += m.damping * product_integral(work, work, step)
    for k in range(len(work)):
        work[k] = (1.0 - m.slope[branch]) * m.motor_constant * current[k]
    work[0] += m.slope[branch] * m.corner[branch]
    spent[8] += (volt - armature) * charge + product_integral(work, rotor, step)
    spent[9] += disturbance * product_integral(unit, load, step)


def with_laws(kernel: Any, motor: Motor) -> Any:
    """A kernel that calls `run`, with the friction laws of a motor."""
    rotor, load = (of_forces(type(law).level) for law in acting_laws(motor))
    return with_functions(kernel, rotor_level=rotor, load_level=load)
