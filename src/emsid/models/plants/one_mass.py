r"""One mass under a sampled force and dry friction: the fast simulation of the grey-box models.

A rigid motor without inductance and a linear axis have the same equations, one mass M with speed v and position x,

    M·dv/dt = F − D·v − T_f(v),      dx/dt = v.                     (4.4) with (4.1)–(4.3) and (4.10) inserted

F contains all forces that do not depend on speed (drive, gravity, offsets), D all damping (viscous friction, and K²/R
of the armature), and T_f is (4.7). F and D are constant between samples. While the mass slides in direction s the
friction is s·c, and for constant c the solution over any time h is

    v(h) = v₀ + (a − r·v₀)·φ₁(h),     x(h) = x₀ + v₀·h + (a − r·v₀)·φ₂(h),       r = D/M,   a = (F − s·c)/M,
    φ₁(h) = (1 − e^{−rh})/r,          φ₂(h) = (h − φ₁(h))/r,

The mass comes to rest at t = ln(1 − r·v₀/a)/r. Then friction holds it, at exactly zero speed until |F| exceeds the
break-away level, or it slides back. So with Coulomb friction the motion is exact, including sticking. A law that
depends on speed, such as a Stribeck excess or quadratic friction, is evaluated at the speed in the middle of the step,
which is of second order in h; the tests compare it with `emsid.plant.simulate`. A force that repeats with position
(`cogging`) counts with its mean over the way of the step, so that many periods in one step average out.

`move` is the only place where a mass moves: a free run, a live model and the texts in C and MATLAB reach it through
`emsid.models.plants.sampling`, with many samples or one. It is the same for every friction law: `compiled_with_law`
replaces ``level``. A law may depend on the load: on the force of the drive, less the braking of the armature, and on
that from outside, the waves and the load. At rest such a law holds the mass up to its level at these forces. A constant
drop in the voltage of a bridge is a force U against that of the drive less the braking, T: what is left of it is T −
U·sgn(T), and nothing where |T| < U, as where diodes block.

A delay by a fraction of a sample splits each sample in two parts, each with its own force. So the delay is exact too,
and every output is a continuous function of every parameter.

With an inductance the force of the drive follows with the time constant τ = L/R,

    M·dv/dt = T − B·v − w,      τ·dT/dt = F − D·v − T,

where D is the braking of the armature only, B viscous friction, and w friction and load. While the mass slides with
constant friction, y = v − v∞ is the response of a system of second order, with v∞ = (F − w)/(B + D), y' = dy/dt and

    κ = (B + D)/(M·τ),   μ = −(B/M + 1/τ)/2,   q = μ² − κ,
    y(t) = e^{μt}·[y₀·cosh √q t + (y₀' − μ·y₀)·sinh(√q t)/√q],      ∫y dt = [2μ·(y − y₀) − (y' − y₀')]/κ.

The time at which the mass comes to rest is a root of v, at which it breaks away one of T, which is an exponential.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit, with_functions
from emsid.errors import ModelError
from emsid.models.plants.effects import NEUTRAL, depends_on_speed, resistance, risen
from emsid.models.plants.servo import NO_SERVO
from emsid.plant.friction import FrictionLaw, Level, of_forces
from emsid.plant.friction import of_motion as level

Array = NDArray[np.float64]


NO_WAVES = np.empty((0, 3))
"""No cogging."""


class Motion(NamedTuple):
    """The motion of one mass, divided by the mass: dv/dt = gain·D(u) − damping·v − c·sgn(v) − offset − waves.

    Attributes:
        gain: acceleration per unit of command beyond the dead zone.
        damping: in 1/s.
        coulomb: Coulomb level, the same in both directions.
        offset: constant deceleration.
        dead_zone: half its width, in units of the command.
        waves: decelerations by the cosine and the sine of the angle of a joint.
    """

    gain: float
    damping: float
    coulomb: float
    offset: float
    dead_zone: float
    waves: tuple[float, float] = (0.0, 0.0)


class Sliding(NamedTuple):
    """Friction in both directions; every pair is (forward, backward). Of P plants, each array has a first axis (P,).

    Attributes:
        numbers: (2, n) the parameters of the friction law.
        breakaway: (2,) break-away level, in N or N·m.
        varies: (2,) whether friction depends on speed or position.
        viscous: (2,) added to D in that direction, in N·s/m or N·m·s/rad.
        quadratic: friction by the square of the speed, in N·s²/m² or N·m·s²/rad².
        waves: (n, 3) 2π over the period, cosine and sine of every harmonic of the cogging.
        load: a constant force against the positive direction.
        drop: the force that a drop in the voltage of the drive takes from it.
        servo: (4,) the controller of a servo, see `Servo.numbers`, whose targets stand for forces; (0,) without one.
        acting: the parameters of `effects` on the resistance; of several plants none.
    """

    numbers: Array
    breakaway: Array
    varies: NDArray[np.bool_]
    viscous: Array
    quadratic: Any
    waves: Array
    load: Any = 0.0
    drop: Any = 0.0
    servo: Array = NO_SERVO
    acting: Any = NEUTRAL

    @classmethod
    def of(
        cls,
        law: FrictionLaw,
        viscous: Sequence[float] = (0.0, 0.0),
        quadratic: float = 0.0,
        waves: Array = NO_WAVES,
        load: float = 0.0,
        servo: Array = NO_SERVO,
        drop: float = 0.0,
        acting: Any = NEUTRAL,
    ) -> Sliding:
        """A law, viscous friction (forward, backward), quadratic friction, cogging, load, servo, drop and effects."""
        varies = law.varies | bool(quadratic > 0 or len(waves) or drop > 0 or depends_on_speed(acting))
        numbers = law.numbers, np.array(law.breakaway), varies, np.array(viscous)
        return cls(*numbers, 1.0 * quadratic, waves, 1.0 * load, 1.0 * drop, servo, acting)

    @classmethod
    def of_all(cls, plants: Sequence[Sliding]) -> Sliding:
        """That of several plants; harmonics that one of them does not have are zero."""
        numbers, breakaway, varies, viscous, quadratic, waves, load, drop, servo, _ = zip(*plants, strict=True)
        most = max(map(len, waves))
        padded = [np.concatenate([each, np.zeros((most - len(each), 3))]) if most else each for each in waves]
        both = np.array(breakaway), np.array(varies), np.array(viscous)
        acting = map(np.array, (quadratic, padded, load, drop, servo))
        return cls(np.array(numbers), *both, *acting)


@njit(nogil=True, error_model="numpy")
def move(
    body: Any,
    friction: Sliding,
    force: Array,
    damping: Array,
    load: Array,
    dt: float,
    late: float,
    steps: int,
    still: int,
    motion: Array,
    speeds: Array,
    positions: Array,
    made: Array,
) -> None:
    """Fill ``speeds`` and ``positions`` (M + 1,) with the motion at every piece, before the force of that piece acts,
    and at the end of the last one.

    Args:
        body: with M as ``mass`` and τ as ``lag``, which is 0 without one.
        friction: T_f, the direction-dependent part of D, and the constant load.
        force, damping: (M + 1,) the force of the drive at rest, and its decrease per speed; the first value acts before
            the first piece. For a servo its targets.
        load: (M,) a load besides the constant one, over every piece.
        dt: the time of a piece in s.
        late: the fraction of a piece during which the previous force still acts, 0 to 1.
        steps: steps per piece for friction that varies.
        still: pieces at the start in which it does not move.
        motion: (2,) v and x, and behind them with a lag T, and behind T with effects on the resistance its rise ρ; it
            becomes that of the end.
        speeds, positions, made: the results, with a lag also T, else with effects on the resistance 1/(1 + ρ).
    """
    if body.lag > 0.0:
        _move_lagging(body, friction, force, damping, load, dt, late, steps, still, motion, speeds, positions, made)
        return
    v, x, per_mass = motion[0], motion[1], 1.0 / body.mass  # in every step the next one would wait for a division
    most = steps if friction.varies[0] or friction.varies[1] or len(friction.servo) > 0 else 1
    e, changes = friction.acting, friction.acting.loss > 0.0
    rise, easier = motion[3] if changes else 0.0, 1.0
    driving, halfway = 0.0, rise  # the force of the drive on average over a sample, and the rise in its middle
    known = other = (-1.0, -1.0, 0.0, 0.0)  # the last r and h with φ₁ and φ₂, of this part of a sample and of the other
    for k in range(len(force) - 1):
        speeds[k], positions[k] = v, x
        if changes:
            made[k] = 1.0 / resistance(e, abs(v), rise)
            driving, drag = (
                late * force[k] + (1.0 - late) * force[k + 1],
                late * damping[k] + (1.0 - late) * damping[k + 1],
            )
            torque, halfway = made[k] * (driving - drag * v), rise
            if k >= still:
                torque -= dropped(torque, made[k] * friction.drop)
                halfway = risen(e, rise, e.loss / made[k] * torque * torque, 0.5 * dt)
        for part in range(2):
            whole = late * dt if part == 0 else (1.0 - late) * dt
            if whole <= 0.0 or k < still:
                continue
            drag, weight = damping[k + part], friction.load + load[k]
            for _ in range(most):
                if changes:
                    easier = 1.0 / resistance(e, abs(v), halfway)
                    drag = easier * damping[k + part]
                drive, left = _driven(easier * force[k + part], load[k], friction, v, x), whole / most
                while left > 0.0:
                    net = drive - _ripple(x, 0.0, friction.waves)
                    pulled, outside = drive + weight - drag * v, net - drive - weight
                    lost = dropped(pulled, easier * friction.drop)
                    side = 0 if v > 0.0 or (v == 0.0 and net > lost) else 1
                    if v == 0.0 and abs(net - lost) <= _holds(friction, side, pulled - lost, outside):
                        break
                    direction = 1.0 - 2.0 * side
                    r = (drag + friction.viscous[side]) * per_mass
                    if friction.varies[side]:
                        a = (net - _against(abs(v), friction, side, pulled, outside, easier)) * per_mass
                        middle = max(direction * (v + (a - r * v) * (left / (2.0 + 0.5 * r * left))), 0.0)
                        if changes:
                            easier = 1.0 / resistance(e, middle, halfway)
                            drag = easier * damping[k + part]
                            drive = _driven(easier * force[k + part], load[k], friction, v, x)
                            r = (drag + friction.viscous[side]) * per_mass
                        net = drive - _ripple(x, direction * middle * left, friction.waves)
                        pulled, outside = drive + weight - drag * direction * middle, net - drive - weight
                        a = (net - _against(middle, friction, side, pulled, outside, easier)) * per_mass
                    else:
                        a = (drive - direction * friction.breakaway[side]) * per_mass
                    if r != known[0] or left != known[1]:
                        known = (r, left) + _phi(r, left)  # noqa: RUF005  (Numba unpacks no tuple in another)
                    first, second, pull = known[2], known[3], a - r * v
                    if direction * (v + pull * first) > 0.0:
                        x += v * left + pull * second
                        v += pull * first
                        break
                    if v == 0.0:  # no motion in this step: rounding, or an excess that vanishes at once
                        break
                    time = min(np.log1p(-r * v / a) / r if abs(r * left) > 1e-9 else -v / a, left)
                    x += v * time + pull * _phi(r, time)[1]
                    v = 0.0
                    left -= time
            known, other = other, known
        if changes and k >= still:
            middle = (x - positions[k]) / dt
            if v == 0.0 and speeds[k] != 0.0:  # an initial speed that friction takes at once has no effect for ever
                middle, halfway = 0.0, rise
            over = resistance(e, abs(middle), halfway)
            torque = (driving - (late * damping[k] + (1.0 - late) * damping[k + 1]) * middle) / over
            torque -= dropped(torque, friction.drop / over)
            rise = risen(e, rise, e.loss * over * torque * torque, dt)
    motion[0], motion[1] = v, x
    speeds[-1], positions[-1] = v, x
    if changes:
        motion[3], made[-1] = rise, 1.0 / resistance(e, abs(v), rise)


@njit(nogil=True, error_model="numpy")
def _move_lagging(
    body: Any,
    friction: Sliding,
    force: Array,
    damping: Array,
    load: Array,
    dt: float,
    late: float,
    steps: int,
    still: int,
    motion: Array,
    speeds: Array,
    positions: Array,
    made: Array,
) -> None:
    """`move` with a force of the drive that follows with a lag; without a drop and a servo."""
    mass, lag, drag = body.mass, body.lag, damping[0]
    v, x, pull = motion[0], motion[1], motion[2]
    e, changes = friction.acting, friction.acting.loss > 0.0
    rise, easier = motion[3] if changes else 0.0, 1.0
    rate, stiff, square, pieces = np.empty(2), np.empty(2), np.empty(2), np.empty(2, np.int64)
    known = np.empty((2, 2, 4))  # responses over a step and half of it, for each part of a sample in each direction
    for k in range(len(force) - 1):
        speeds[k], positions[k], made[k] = v, x, pull
        if k == 0 or changes:
            if changes:
                easier = 1.0 / resistance(e, abs(v), rise)
                easier = 1.0 / resistance(e, abs(v), risen(e, rise, e.loss / easier * pull * pull, 0.5 * dt))
                lag, drag = easier * body.lag, easier * damping[0]
            for side in range(2):
                rate[side] = -0.5 * (friction.viscous[side] / mass + 1.0 / lag)
                stiff[side] = (friction.viscous[side] + drag) / (mass * lag)
                square[side] = rate[side] ** 2 - stiff[side]
            quickest = np.sqrt(max(-min(square[0], square[1]), 0.0))
            for part in range(2):
                whole = late * dt if part == 0 else (1.0 - late) * dt
                pieces[part] = max(steps, int(np.ceil(quickest * whole / _QUARTER)))
                for side in range(2):
                    h = whole / pieces[part]
                    known[part, side, 0], known[part, side, 1] = _response(rate[side], square[side], 0.5 * h)
                    known[part, side, 2], known[part, side, 3] = _response(rate[side], square[side], h)
        weight = friction.load + load[k]
        for part in range(2):
            whole, ends = late * dt if part == 0 else (1.0 - late) * dt, easier * force[k + part]
            if whole <= 0.0 or k < still:
                continue
            for _ in range(pieces[part]):
                step = left = whole / pieces[part]
                while left > 0.0:
                    outside = -weight - _ripple(x, 0.0, friction.waves)
                    side = 0 if v > 0.0 or (v == 0.0 and pull + outside > 0.0) else 1
                    if v == 0.0 and abs(pull + outside) <= _holds(friction, side, pull, outside):
                        side = 0 if ends > pull else 1
                        bound = (1.0 - 2.0 * side) * _holds(friction, side, pull, outside) - outside
                        waits = left
                        if (1.0 - 2.0 * side) * (ends - bound) > 0.0:
                            waits = min(lag * np.log((ends - pull) / (ends - bound)), left)
                        pull = ends + (pull - ends) * np.exp(-waits / lag)
                        left -= waits
                        if left <= 0.0:
                            break
                    way, b = 1.0 - 2.0 * side, friction.viscous[side]
                    m, kappa, q = rate[side], stiff[side], square[side]
                    against = way * friction.breakaway[side] + weight
                    if friction.varies[side]:
                        c, s = known[part, side, 0], known[part, side, 1]
                        if left < step:
                            c, s = _response(m, q, 0.5 * left)
                        against = way * _level_of(abs(v), friction, side, pull, outside) - outside
                        steady, a = (ends - against) / (b + drag), (pull - against - b * v) / mass
                        y = (v - steady) * c + (a - m * (v - steady)) * s
                        slope = a * c + (m * a - kappa * (v - steady)) * s
                        middle = max(way * (steady + y), 0.0)
                        outside = -weight - _ripple(x, way * middle * left, friction.waves)
                        then = mass * slope + b * (steady + y) + against
                        against = way * _level_of(middle, friction, side, then, outside) - outside
                    steady, a = (ends - against) / (b + drag), (pull - against - b * v) / mass
                    begun, time, rests = v - steady, left, False
                    c, s = known[part, side, 2], known[part, side, 3]
                    if left < step:
                        c, s = _response(m, q, left)
                    y, slope = begun * c + (a - m * begun) * s, a * c + (m * a - kappa * begun) * s
                    after = way * (steady + y)
                    turns = way * a < 0.0 < way * slope if v != 0.0 else after <= 0.0
                    if turns or after <= 0.0:  # it may come to rest; the speed is extreme once at most
                        low, high = 0.0, left
                        if turns:
                            extreme = _turning(m, q, a, m * a - kappa * begun)
                            if not 0.0 < extreme < left:
                                extreme = left
                            c, s = _response(m, q, extreme)
                            passes = way * (steady + begun * c + (a - m * begun) * s) > 0.0
                            if v == 0.0:
                                low = extreme
                                if not passes:  # no motion: rounding, or an excess that vanishes at once
                                    pull = ends + (pull - ends) * np.exp(-left / lag)
                                    break
                            elif after > 0.0:
                                high = left if passes else extreme
                        rests = after <= 0.0 or high < left
                        if rests:
                            time = 0.5 * (low + high)
                            for _ in range(_MOST_HALVINGS):
                                c, s = _response(m, q, time)
                                y, slope = begun * c + (a - m * begun) * s, a * c + (m * a - kappa * begun) * s
                                if way * (steady + y) > 0.0:
                                    low = time
                                else:
                                    high = time
                                better = time - (steady + y) / slope
                                if not low < better < high:
                                    better = 0.5 * (low + high)
                                change, time = abs(better - time), better
                                if change <= 1e-15 * left:
                                    break
                    x += steady * time + (2.0 * m * (y - begun) - (slope - a)) / kappa
                    v = 0.0 if rests else steady + y
                    pull = mass * slope + b * v + against
                    left -= time
        if changes and k >= still:
            mean, drives = (x - positions[k]) / dt, late * force[k] + (1.0 - late) * force[k + 1]
            torque = easier * (drives - damping[0] * mean) - lag * (pull - made[k]) / dt
            if v == 0.0 and speeds[k] != 0.0:  # as in `move`
                torque, easier = pull, 1.0 / resistance(e, 0.0, rise)
            rise = risen(e, rise, e.loss / easier * torque * torque, dt)
    motion[0], motion[1], motion[2] = v, x, pull
    if changes:
        motion[3] = rise
    speeds[-1], positions[-1], made[-1] = v, x, pull


_QUARTER = 1.5
"""Less than a quarter of an oscillation in rad: over it a speed has one extreme at most."""
_MOST_HALVINGS = 60
"""Steps to the time at which a mass comes to rest, to the last digit; Newton's take five."""


@njit(nogil=True, error_model="numpy", inline="always")
def _level_of(speed: float, friction: Sliding, side: int, made: float, outside: float) -> float:
    """All friction but the viscous one, at a speed in a direction."""
    return float(level(speed, friction.numbers, side, made, outside) + friction.quadratic * speed * speed)


@njit(nogil=True, error_model="numpy")
def _response(m: float, q: float, t: float) -> tuple[float, float]:
    """e^{μt}·cosh √q t and e^{μt}·sinh(√q t)/√q, by their series where √q t is small."""
    z = q * t * t
    if abs(z) < 1e-6:
        grown = np.exp(m * t)
        return grown * (1.0 + 0.5 * z), grown * t * (1.0 + z / 6.0)
    root = np.sqrt(abs(q))
    if q < 0.0:
        grown = np.exp(m * t)
        return grown * np.cos(root * t), grown * np.sin(root * t) / root
    slow, fast = np.exp((m + root) * t), np.exp((m - root) * t)
    return 0.5 * (slow + fast), 0.5 * (slow - fast) / root


@njit(nogil=True, error_model="numpy")
def _turning(m: float, q: float, a: float, bend: float) -> float:
    """The time at which the slope e^{μt}·(a·cosh √q t + bend·sinh(√q t)/√q) is zero; NaN for none."""
    root, part = np.sqrt(abs(q)), -a / bend
    if root * abs(part) < 1e-6:
        return float(part)
    if q > 0.0:
        return np.arctanh(root * part) / root if root * abs(part) < 1.0 else np.nan
    found = np.arctan(root * part) / root
    return float(found if found > 0.0 else found + np.pi / root)


@njit(nogil=True, error_model="numpy")
def one_of(friction: Sliding, p: int, servo: Array) -> Sliding:
    """That of one of several plants, with this servo."""
    return Sliding(
        friction.numbers[p],
        friction.breakaway[p],
        friction.varies[p],
        friction.viscous[p],
        friction.quadratic[p],
        friction.waves[p],
        friction.load[p],
        friction.drop[p],
        servo,
        friction.acting,
    )


def compiled_with_law(law: Level, kernel: Any) -> Callable[..., None]:
    """A kernel that calls `move`, with another friction law: compiled if the law is, otherwise in plain Python."""
    return with_functions(kernel, level=of_forces(law))  # type: ignore[no-any-return]


@njit(nogil=True, error_model="numpy", inline="always")
def _driven(force: float, more: float, friction: Sliding, v: float, x: float) -> float:
    """The force on the mass, less all loads; of a servo from its target, where the mass is."""
    if len(friction.servo) == 0:
        return float(force - friction.load - more)
    gain, damping, limit, turns = friction.servo[0], friction.servo[1], friction.servo[2], friction.servo[3]
    torque = gain * (force - turns * x) - damping * turns * v
    return float(turns * min(max(torque, -limit), limit) - friction.load - more)


@njit(nogil=True, error_model="numpy", inline="always")
def dropped(made: float, most: float) -> float:
    """What a drop of ``most`` takes from a force of the drive."""
    return float(min(max(made, -most), most))


@njit(nogil=True, error_model="numpy", inline="always")
def _against(speed: float, friction: Sliding, side: int, made: float, outside: float, easier: float) -> float:
    """All friction but the viscous one, at a speed in a direction, and what a drop takes from the force of the drive.

    Args:
        speed, friction, side: how fast, and in which direction.
        made, outside: the forces of the drive and from outside.
        easier: R_a over the resistance.
    """
    lost = dropped(made, easier * friction.drop)
    friction_level = level(speed, friction.numbers, side, made - lost, outside) + friction.quadratic * speed * speed
    return float(lost + (1.0 - 2.0 * side) * friction_level)


@njit(nogil=True, error_model="numpy", inline="always")
def _holds(friction: Sliding, side: int, made: float, outside: float) -> float:
    """The net force up to which the mass stays at rest."""
    if not friction.varies[side]:
        return float(friction.breakaway[side])
    return float(level(0.0, friction.numbers, side, made, outside))


@njit(nogil=True, error_model="numpy", inline="always")
def _ripple(x: float, way: float, waves: Array) -> float:
    """The mean of the cogging between the positions x and x + way."""
    force = 0.0
    for n in range(len(waves)):
        k, cosine, sine = waves[n, 0], waves[n, 1], waves[n, 2]
        middle, half = k * (x + 0.5 * way), 0.5 * k * way
        mean = np.sin(half) / half if abs(half) > 1e-4 else 1.0 - half * half / 6.0
        force += mean * (cosine * np.cos(middle) + sine * np.sin(middle))
    return force


@njit(nogil=True, error_model="numpy", inline="always")
def _phi(r: float, h: float) -> tuple[float, float]:
    """φ₁ and φ₂ of the module docstring, by their series where rh is small."""
    z = r * h
    if abs(z) < 1e-3:
        one = h * (1.0 - z / 2.0 * (1.0 - z / 3.0 * (1.0 - z / 4.0 * (1.0 - z / 5.0))))
        two = h * h / 2.0 * (1.0 - z / 3.0 * (1.0 - z / 4.0 * (1.0 - z / 5.0 * (1.0 - z / 6.0))))
        return one, two
    one = -np.expm1(-z) / r
    return one, (h - one) / r


def check_steps(what: str, steps: int) -> None:
    """Refuse a number of steps per sample that is not a positive whole number.

    Raises:
        ModelError: naming ``what`` has it.
    """
    if not (isinstance(steps, int) and steps > 0):
        raise ModelError(f"{what} with {steps!r} steps per sample; give a positive whole number")
