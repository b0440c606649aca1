"""The motor as Taylor series between events, with friction as a set-valued law, compiled.

Between two events the equations of the motor are analytic: the input is constant, every body either slides in a known
direction or is held by friction, and the torque is on a known branch of its dead zone. The only nonlinear term is the
Stribeck exponential e = exp(−α₂·s·ω) of a body sliding in direction s, with ė = −α₂·s·ω̇·e. So the Taylor coefficients
x_k of every quantity follow from the equations order by order, for example

    ω_{k+1} = (net torque − friction)_k / [J·(k + 1)],
    e_{k+1} = −α₂·s/(k + 1) · Σ_j (j + 1)·ω_{j+1}·e_{k−j},

to any order and without another evaluation of the law. The step for which the last terms stay below the tolerance is
known in advance (Jorba and Zou, Experimental Mathematics 14, 2005). The series is also the dense output.

A step ends at the first event in it, which is the first zero of a polynomial:

- the speed of a sliding body reaches zero: the body is held, its speed is exactly 0;
- the net torque on a held body exceeds the break-away level α₀ + α₁ of its direction: the body slides;
- the torque leaves its branch of the dead zone;
- with backlash, rotor and load come into contact or part.

`first_below` finds it, also where there are two crossings in one step. A torque exceeds a level only if it is larger by
`_SLACK` times the acting torques; so rounding errors do not release a body that friction holds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.plant.constants import Constants
from emsid.plant.polynomials import first_below, polynomial_value, product_integral

Array = NDArray[np.float64]
Directions = NDArray[np.int64]  # (2,) by body: 1 forward, −1 backward, 0 held

_kernel = njit(nogil=True, error_model="numpy", fastmath={"contract"})


# Rows of the table of Taylor coefficients: the five states, then the derived quantities. If rotor and load have one row
# each, the row of the load is second.
_CURRENT, _SPEED, _TWIST, _ANGLE, _DECAY, _NET, _ROWS = 0, 1, 3, 4, 5, 7, 9

_SLACK = 1e-12  # relative; a thousand times the rounding of a sum of torques
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
    s = np.zeros((_ROWS, order + 1))
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
    for k in range(len(volts)):
        for body in range(2):
            motion[body] = _motion_at(m, body, x[_SPEED + body])
        contact = _contact_at(m, x)
        torque = m.motor_constant * x[_CURRENT]
        branch = 1 + int(torque > m.edge[1]) - int(torque < m.edge[0])
        left = holds[k]
        for _ in range(_MOST_STEPS):
            if taken >= budget:
                break
            taken += 1.0
            _expand(m, x, motion, branch, contact, armature[k], torques[k], s)
            step = min(left, longest, _step_for(m, s, tolerance))
            while True:
                step, event, body, turn = _first_event(m, s, motion, branch, contact, torques[k], step, margin, centred)
                if not _decay_error(m, s, motion, step) > tolerance:
                    break
                step *= 0.5
            if energy:
                _spend(m, s, motion, branch, contact, volts[k], armature[k], torques[k], step, margin, spent)
            _advance(s, step, x)
            left -= step
            if event == _BRANCH:
                branch += turn
            elif event == _CONTACT:
                x[_TWIST] = m.gap * (turn if contact == 0 else contact)
                contact += turn
            elif event == _MOTION:
                x[_SPEED + body] = 0.0
                if m.rigid:
                    x[_SPEED + 1] = 0.0
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
    joint = 0 if m.rigid else body
    if speed == 0.0 and m.breakaway[joint, 0] + m.breakaway[joint, 1] == 0.0:
        return 1
    return int(speed > 0.0) - int(speed < 0.0)


@_kernel
def _contact_at(m: Constants, x: Array) -> int:
    """The side on which rotor and load touch: 1 or −1, or 0 within the backlash; without backlash 1."""
    if m.gap == 0.0:
        return 1
    side = int(x[_TWIST] > 0.0) - int(x[_TWIST] < 0.0)
    beyond = abs(x[_TWIST]) - m.gap
    closing = side * (x[_SPEED] - x[_SPEED + 1])
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
        sliding = motion[body] != 0 and m.stribeck[body, int(motion[body] < 0)] > 0.0
        rate = m.stribeck_rate[body, int(motion[body] < 0)]
        for k in range(order + 1):
            s[_DECAY + body, k] = 0.0
        if sliding:
            s[_DECAY + body, 0] = np.exp(-rate * motion[body] * x[_SPEED + body])
    # A division is much slower than a product.
    per_ohm = 1.0 / m.resistance
    per_henry = 1.0 / m.inductance if m.inductance > 0.0 else 0.0
    rotor_share = 1.0 / (m.inertia[0] + m.inertia[1] if m.rigid else m.inertia[0])
    load_share = 1.0 / m.inertia[1]
    for k in range(order + 1):
        unit = 1.0 if k == 0 else 0.0
        if m.inductance == 0.0:
            s[_CURRENT, k] = (volt * unit - m.motor_constant * s[_SPEED, k]) * per_ohm
        torque = m.slope[branch] * (m.motor_constant * s[_CURRENT, k] - m.corner[branch] * unit)
        shaft = 0.0
        if contact != 0:
            twist = s[_TWIST, k] - contact * m.gap * unit
            shaft = m.stiffness * twist + m.damping * (s[_SPEED, k] - s[_SPEED + 1, k])
        s[_NET, k] = torque - shaft - m.viscous[0] * s[_SPEED, k]
        s[_NET + 1, k] = shaft - m.viscous[1] * s[_SPEED + 1, k] - disturbance * unit
        if m.rigid:
            s[_NET, k] += s[_NET + 1, k]
            s[_NET + 1, k] = s[_NET, k]
        if k == order:
            return
        part = 1.0 / (k + 1)
        if m.inductance > 0.0:
            drop = m.resistance * s[_CURRENT, k] + m.motor_constant * s[_SPEED, k]
            s[_CURRENT, k + 1] = (volt * unit - drop) * (per_henry * part)
        rotor = _friction_term(m, s, motion, 0, k)
        load = _friction_term(m, s, motion, 1, k)
        if m.rigid:
            gained = (s[_NET, k] - rotor - load) * (rotor_share * part)
            s[_SPEED, k + 1] = gained if motion[0] != 0 else 0.0
            s[_SPEED + 1, k + 1] = s[_SPEED, k + 1]
        else:
            s[_SPEED, k + 1] = (s[_NET, k] - rotor) * (rotor_share * part) if motion[0] != 0 else 0.0
            s[_SPEED + 1, k + 1] = (s[_NET + 1, k] - load) * (load_share * part) if motion[1] != 0 else 0.0
        s[_TWIST, k + 1] = (s[_SPEED, k] - s[_SPEED + 1, k]) * part
        s[_ANGLE, k + 1] = s[_SPEED + 1, k] * part
        for body in range(2):
            if s[_DECAY + body, 0] > 0.0:
                total = 0.0
                for j in range(k + 1):
                    total += (j + 1) * s[_SPEED + body, j + 1] * s[_DECAY + body, k - j]
                rate = m.stribeck_rate[body, int(motion[body] < 0)]
                s[_DECAY + body, k + 1] = -rate * motion[body] * total * part


@_kernel
def _friction_term(m: Constants, s: Array, motion: Directions, body: int, k: int) -> float:
    """Taylor coefficient ``k`` of the friction (4.7) on a sliding body."""
    side = int(motion[body] < 0)
    level = m.coulomb[body, side] if k == 0 else 0.0
    return float(motion[body] * (level + m.stribeck[body, side] * s[_DECAY + body, k]))


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
        if motion[body] != 0 and m.stribeck[body, side] > 0.0:
            speed = polynomial_value(s[_SPEED + body], step)
            exact = np.exp(-m.stribeck_rate[body, side] * motion[body] * speed)
            missed = abs(exact - polynomial_value(s[_DECAY + body], step))
            change = m.stribeck[body, side] * missed * step / m.inertia[body]
            worst = max(worst, change / (abs(s[_SPEED + body, 0]) + m.scale[_SPEED]))
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
    drive = m.motor_constant * (abs(s[_CURRENT, 0]) + m.scale[_CURRENT])
    shaft = m.stiffness * abs(s[_TWIST, 0]) + m.damping * (abs(s[_SPEED, 0]) + abs(s[_SPEED + 1, 0]))
    for body in range(1 if m.rigid else 2):
        level = max(m.breakaway[body, 0], m.breakaway[body, 1])
        if level == 0.0:
            continue
        if motion[body] != 0:
            at = first_below(0.0, float(motion[body]), s[_SPEED + body], step, margin, centred)
            if at <= step:
                step, kind, which, turn = at, _MOTION, body, 0
            continue
        slack = _SLACK * (level + drive + shaft + abs(disturbance))
        for side in range(2):
            direction = 1 - 2 * side
            at = first_below(m.breakaway[body, side] + slack, float(-direction), s[_NET + body], step, margin, centred)
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
        at = first_below(bound, -change * m.motor_constant, s[_CURRENT], step, margin, centred)
        if at <= step:
            step, kind, turn = at, _BRANCH, change
    for outward in (-1, 1) if m.gap > 0.0 else (0, 0):
        if outward == 0 or contact == -outward:
            continue
        away = contact == outward
        bound, factor = -m.gap if away else m.gap, float(outward if away else -outward)
        at = first_below(bound, factor, s[_TWIST], step, margin, centred)
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
    current, rotor, load = s[_CURRENT], s[_SPEED], s[_SPEED + 1]
    unit = np.ones(1)
    charge = product_integral(unit, current, step)
    spent[0] += volt * charge
    spent[2] += m.resistance * product_integral(current, current, step)
    for body in range(2):
        speed = s[_SPEED + body]
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
