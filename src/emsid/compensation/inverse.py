r"""The inverse of a plant of one mass: dead zone, friction, and the command for a reference speed.

The plant is the mass of `emsid.models.plants.one_mass` behind the drive of `emsid.models.plants.drive`,

    M·dv/dt = after·D(before·V) − load − (braking + viscous)·v − s·T(|v|),        V = gain·(u + offset).

Over a sample h in which V is constant the speed goes from v₀ to v₁ (φ₁, r and a as in `one_mass`), so

    a = (v₁ − v₀)/φ₁(h) + r·v₀,       F = M·a + s·T(|v|) + load + waves(x),       V = D⁻¹(F/after)/before

is the command that leads exactly from one reference speed to the next, where the friction is constant and the direction
s does not change within the sample. A law that varies is taken at the speed in the middle.

**Direction, and the rule at standstill.** s is the sign of the mean of the two reference speeds. A reference that
stands and begins to move therefore gets the friction of the direction in which it will move, from the sample before it
moves on, and at the break-away level; a reference that stands and stays gets none, as friction itself holds the body.

**Smoothing.** D⁻¹ jumps by the width of the zone at 0 and s by 2. A measured signal that passes through 0 with noise
would make the command chatter. With a width w > 0 both jumps become straight lines from −w to w: of the wanted voltage
for D⁻¹, and of the reference speed for s. D⁻¹ is exact beyond its width; within it, D(D⁻¹(z)) is smaller than z. With
an encoder the widths are those of a count and a loop with a time constant of `LOOP` samples: the speed that moves a
count in it, and the voltage with which it answers the speed that a count in a sample shows.

**Level.** Of a fit, friction and dead zone are those at the lower ends of their 95 % intervals: what is not known to
act is not compensated, as too much of it drives the plant away from its reference and too little does not.

**Level on line.** A controller whose integral is one for each direction (`integral`) learns what the level is wrong by.

**Rest.** A controller at rest beside its reference, by a count of its encoder, drives the integral to and fro. While
the reference and the encoder stand and the error is at most a count, the error counts as zero (`at_rest`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.compensation.map_inverse import MapInverse
from emsid.compensation.torque_ripple import RippleCompensation
from emsid.errors import DataError, ModelError
from emsid.estimation.fit import Fit
from emsid.models.plants.sampling import Outer
from emsid.models.starting import start
from emsid.models.verbs import as_model
from emsid.plant import DeadZoneLaw, Measure
from emsid.plant.friction import Level, sees_load

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Compensation:
    """The inverse of a plant of one mass; `compensate` makes it.

    Attributes:
        name: of the model.
        dt: sample time in s.
        zone: the dead zone, between the wanted and the applied voltage (force, for an axis).
        inside: mass, damping and factors.
        outer: drive.
        friction, law: the friction and its law.
        zone_width: width in V over which the inverse of the dead zone is smoothed; 0 for the exact one.
        speed_width: width in rad/s (m/s) over which the direction of friction is smoothed; 0 for none.
        count: of the encoder in rad (m); 0 where it is not known.
    """

    name: str
    dt: float
    zone: DeadZoneLaw
    inside: Any  # the numbers of the compiled plant, see `emsid.models.plants.sampling`
    outer: Any
    friction: Any
    law: Level
    zone_width: float = 0.0
    speed_width: float = 0.0
    count: float = 0.0

    def dead_zone_inverse(self, wanted: ArrayLike) -> Array:
        """The value before the dead zone for the value wanted after it, of any shape; 0 for 0."""
        z = np.asarray(wanted, dtype=float)
        jump = np.sign(z) if self.zone_width == 0 else np.clip(z / self.zone_width, -1.0, 1.0)
        zone = self.zone
        return np.where(z > 0, z / zone.m_r + jump * zone.b_r, np.where(z < 0, z / zone.m_l - jump * zone.b_l, 0.0))

    def friction_force(self, speed: ArrayLike, following: ArrayLike | None = None) -> Array:
        """The dry friction against a reference speed, in N·m (N), with the rule at standstill.

        Args:
            speed: reference speed in rad/s (m/s).
            following: that of the next sample; by default the same.
        """
        now = np.asarray(speed, dtype=float)
        return self._dry(now, now if following is None else np.asarray(following, dtype=float))

    def force(self, speed: ArrayLike, following: ArrayLike, position: ArrayLike = 0.0) -> Array:
        """The force of the drive, in N·m (N), that leads from one speed to the next within a sample.

        Args:
            speed: reference speed at the sample in rad/s (m/s).
            following: at the next sample.
            position: reference position in rad (m); only cogging and gravity depend on it.
        """
        now, then = np.asarray(speed, dtype=float), np.asarray(following, dtype=float)
        middle, friction = 0.5 * (now + then), self.friction
        viscous = np.where(middle >= 0, friction.viscous[0], friction.viscous[1])
        r = (self.inside.braking + viscous) / self.inside.mass
        phi = np.where(r * self.dt < SERIES, self.dt, -np.expm1(-r * self.dt) / np.maximum(r, SERIES / self.dt))
        made = self.inside.mass * ((then - now) / phi + r * now) + self._dry(now, then) + friction.load
        at = np.asarray(position, dtype=float) + middle * 0.5 * self.dt
        for k, cosine, sine in friction.waves.tolist():
            made = made + cosine * np.cos(k * at) + sine * np.sin(k * at)
        return np.asarray(made + friction.drop * np.sign(made - self.inside.braking * middle))

    def command(self, wanted: ArrayLike) -> Array:
        """The command for a voltage (force) wanted behind the dead zone, without the limit of the drive."""
        gain, offset, knee, beyond, _, loss, *_ = self.outer.drive.tolist()
        volts = self.dead_zone_inverse(wanted) / (1.0 - loss)
        if isfinite(knee):
            inner = np.clip(volts, -knee, knee)
            volts = inner + (volts - inner) / beyond
        return np.asarray(volts / gain - offset)

    def wanted(self, speed: ArrayLike, following: ArrayLike, position: ArrayLike = 0.0) -> Array:
        """The voltage (force) behind the dead zone that leads from one speed to the next, see `force`."""
        return np.asarray(self.force(speed, following, position) / (self.inside.after * self.inside.before))

    def feedforward(self, reference: ArrayLike, position: float = 0.0) -> Array:
        """The commands (N,) for a reference speed (N,), the last of which keeps its speed.

        Args:
            reference: in rad/s (m/s), at every sample.
            position: at the first sample, in rad (m).

        Raises:
            DataError: for a reference of another shape, or not finite.
        """
        speed = np.asarray(reference, dtype=float)
        if speed.ndim != 1 or not len(speed) or not np.isfinite(speed).all():
            raise DataError(f"a reference of shape {speed.shape}; give finite speeds, shape (N,)")
        then = np.append(speed[1:], speed[-1])
        at = position + np.concatenate([[0.0], np.cumsum(0.5 * self.dt * (speed + then))[:-1]])
        return self.command(self.wanted(speed, then, at))

    def at_rest(self, error: ArrayLike, speed: ArrayLike, moved: ArrayLike) -> Array:
        """The error of a position that a controller counts: 0 at rest within a count, else the error itself.

        Args:
            error: of the position in rad (m).
            speed: reference speed in rad/s (m/s).
            moved: way of the encoder since the sample before in rad (m).
        """
        e = np.asarray(error, dtype=float)
        rests = (np.asarray(speed) == 0) & (np.asarray(moved) == 0) & (np.abs(e) <= self.count)
        return np.where(rests, 0.0, e)

    def integral(self, totals: Array, step: float, speed: float, following: float) -> float:
        """The integral of a controller that adapts the level of the friction: one for each direction of the reference.

        What the friction differs from its level grows into the integral of the direction in which the drive moves, and
        is there when the reference turns to this direction again.

        Args:
            totals: (2,) the integrals forward and backward, which are changed; zeros at first.
            step: what the integral of the controller grows by in this sample.
            speed, following: reference speed at this sample and the next in rad/s (m/s).
        """
        way = float(self._way(0.5 * (speed + following)))
        parts = 0.5 * np.array([1.0 + way, 1.0 - way])
        totals += step * parts / (parts @ parts)
        return float(parts @ totals)

    def _way(self, middle: ArrayLike) -> Array:
        """The direction of a reference speed, from −1 to 1."""
        v = np.asarray(middle, dtype=float)
        return np.asarray(np.sign(v) if self.speed_width == 0 else np.clip(v / self.speed_width, -1.0, 1.0))

    def _dry(self, now: Array, then: Array) -> Array:
        """Dry and quadratic friction between two reference speeds; from a standstill at the break-away level."""
        middle = 0.5 * (now + then)
        size = np.where(now == 0, 0.0, np.abs(middle))
        each = [
            self.law(value, self.friction.numbers, side)
            for value, side in zip(np.ravel(size).tolist(), np.ravel(middle < 0).astype(int).tolist(), strict=True)
        ]
        level = np.reshape(np.array(each, dtype=float), np.shape(middle)) + self.friction.quadratic * size**2
        return np.asarray(self._way(middle) * level)


SERIES = 1e-9
"""Below this part of a time constant, (1 − e^{−rh})/r is h to rounding."""


LOOP = 10.0
"""Time constant in samples of the loop for whose counts the jumps are smoothed."""


def compensate(
    model: Any,
    *,
    dt: float | None = None,
    encoder: float | None = None,
    zone_width: float | None = None,
    speed_width: float | None = None,
) -> Compensation | MapInverse | RippleCompensation:
    """The inverse of a model, to be put before its plant.

    Args:
        model: a plant of one mass, or a fit of one; a cascade, whose static map is inverted; or a
            brushless motor with harmonics of its torque, see `RippleCompensation`. Of a fit, friction and
            dead zone are those at the lower ends of their 95 % intervals; give ``fit.model`` for the estimates.
        dt: sample time in s of the controller, for a plant.
        encoder: counts per revolution (per m) of its encoder.
        zone_width: the wanted voltage (force) up to which the inverse of the dead zone is a straight line in place of
            its jump, so that noise does not make the command chatter; 0 for the exact inverse. By default from the
            encoder, and 0 without one.
        speed_width: the reference speed up to which the direction of friction is a straight line; 0 for none. By
            default from the encoder, and 0 without one.

    Returns:
        A `Compensation` of a plant; a `MapInverse` of a cascade; a `RippleCompensation` of a brushless motor.

    Raises:
        ModelError: for a model without an inverse, with the reason, or a width or an encoder that is not positive.

    >>> import emsid
    >>> motor = emsid.plants.rigid_motor()
    >>> inverse = emsid.compensate(motor.with_values({"voltage_dead_zone.half_width": 0.5}), dt=1e-3)
    >>> inverse.dead_zone_inverse([-1.0, 0.0, 0.2])
    array([-1.5,  0. ,  0.7])
    """
    for name, width in (("zone_width", zone_width), ("speed_width", speed_width)):
        if width is not None and not (isfinite(width) and width >= 0):
            raise ModelError(f"a smoothing width of {width!r}; give zero or a positive number", arguments=(name,))
    if encoder is not None and not (isfinite(encoder) and encoder > 0):
        raise ModelError(f"an encoder of {encoder!r} counts; give a positive number", arguments=("encoder",))
    subject = lower_ends(model)
    if hasattr(subject, "blocks"):
        return MapInverse.of(subject)
    if has_harmonics(subject):
        return RippleCompensation.of(subject)
    if dt is not None and not (isfinite(dt) and dt > 0):
        raise ModelError(f"a sample time of {dt!r} s; give a positive number", arguments=("dt",))
    if dt is None and subject.dt is None:
        raise ModelError(f"{subject.name} has no sample time of its own; give the controller's", arguments=("dt",))
    sampler: Any = getattr(start(_without_inductance(subject), dt=dt), "sampler", None)
    if not getattr(sampler, "of_one_mass", False):
        raise ModelError(
            f"{subject.name} has no inverse here: that is known for a plant of one mass (rigid-motor, "
            "joint, linear-axis), the torque ripple of brushless and the static map of a cascade; identify one of these"
        )
    outer, inside, friction, _, law = sampler.numbers
    check_invertible(subject.name, outer, law)
    zone, step = DeadZoneLaw(*inside.zone.tolist()), float(outer.timing[0])
    turn = 1.0 if subject.name == "linear-axis" else 2 * pi
    count = 0.0 if encoder is None else turn / encoder
    volts = inside.mass / (inside.after * inside.before * LOOP * step) * count / step
    widths = (
        (volts if zone_width is None else zone_width),
        (count / (LOOP * step) if speed_width is None else speed_width),
    )
    return Compensation(subject.name, step, zone, inside, outer, friction, law, *widths, count)


def has_harmonics(model: Any) -> bool:
    """Whether a model is one of a plant whose torque has harmonics over the angle, or may have them."""
    return hasattr(getattr(model, "plant", None), "torque_ripple")


def lower_ends(model: Any) -> Any:
    """The model of a fit with friction levels and ends of dead zones at the lower ends of their 95 % intervals."""
    subject: Any = as_model(model)
    handles = getattr(getattr(subject, "plant", None), "handles", {})
    if not (isinstance(model, Fit) and model.has_intervals and handles):
        return subject
    lower = {}
    for name, ends in zip(model.names, model.interval().tolist(), strict=True):
        handle = handles.get(name)
        if handle is None or not all(map(isfinite, ends)):
            continue
        if "dead_zone" in name and "m_" not in name:
            lower[name] = max(ends[0], 0.0) if subject.plant.value(name) >= 0 else min(ends[1], 0.0)
        elif handle.measure is Measure.FORCE and "friction." in name:
            lower[name] = max(ends[0], 0.0)
    return subject.with_estimates(list(lower), np.array(list(lower.values())))


def inductance_of(model: Any) -> float:
    """The inductance in H that an inverse neglects, as L/R is short beside a sample or two; 0 for none."""
    return float(model.parameter_values().get("inductance", 0.0)) if hasattr(model, "plant") else 0.0


def _without_inductance(model: Any) -> Any:
    """A motor whose current has no dynamics."""
    return model.with_estimates(["inductance"], np.zeros(1)) if inductance_of(model) > 0 else model


def check_invertible(name: str, outer: Outer, law: Level) -> None:
    """Refuse a drive or a friction law whose inverse is not known.

    Raises:
        ModelError: for a bridge that coasts, codes among the commands, or friction that depends on the load.
    """
    *_, rise, freewheel = outer.drive.tolist()
    if freewheel > 0 or rise > 0:
        raise ModelError(
            f"{name} has a bridge that coasts in its off-time, whose voltage depends on the speed; its inverse is not "
            "known: let the bridge brake, or identify it without drive.freewheel"
        )
    if outer.drive[3] == 0:
        raise ModelError(f"{name} has a drive that gives nothing more beyond its knee, which has no inverse")
    if len(outer.codes):
        raise ModelError(f"{name} has codes among its commands, which have no inverse; identify it without codes")
    if sees_load(law):
        raise ModelError(
            f"the friction of {name} depends on the load, and its inverse is not known; identify it with another law"
        )
