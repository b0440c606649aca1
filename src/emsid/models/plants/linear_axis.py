"""A linear axis as a plant: one mass on a guide, driven by a force.

    M = mass,   F = D_F(f) − offset,   D = viscous friction,   and quadratic friction and cogging where there are any,

simulated by the fast loop of `one_mass`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import inf, isfinite
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.linear_parts import StateSpace
from emsid.models.plants.characteristics import dead_zone_over_command, friction_over_speed
from emsid.models.plants.cogging import Cogging, check_quadratic, cogging_handles, extra_terms, without_idle
from emsid.models.plants.drive import Drive, Feed, outer_handles
from emsid.models.plants.driven import NEED_SUPPLY, DrivenPlant
from emsid.models.plants.one_mass import Motion, Sliding, check_steps
from emsid.models.plants.parameters import TINY, Handle, Signal, by_direction, dead_zone_handles, law_handles, scalar
from emsid.models.plants.plant import Channels, Quantity, StaticCharacteristic
from emsid.models.plants.sampling import DrivenSampler, Inside, Outer, one_mass_sampler
from emsid.models.plants.sensor import Sensor
from emsid.models.plants.state import PlantState
from emsid.models.visited import Needs, RestsOn
from emsid.plant import DeadZoneLaw, Friction, FrictionLaw, Measure, Parameter

Array = NDArray[np.float64]


@cache
def _handles(law: type[FrictionLaw]) -> Mapping[str, Handle]:
    """Mass, frictions, offset, dead zone, drive and sensor."""
    outer = outer_handles("N", "newtons", Measure.FORCE, "m", Measure.OTHER)
    viscous = Parameter("viscous_friction", "F_v", "N*s/m", "viscous friction")
    quadratic = Parameter("quadratic_viscous", "F_q", Measure.QUADRATIC.unit(linear=True), "quadratic viscous friction")
    offset = Parameter("offset", "F₀", "N", "constant force against the motion")
    return {
        **scalar(("mass",), Parameter("mass", "M", "kg", "moving mass"), lower=TINY),
        **by_direction(("viscous_friction",), viscous, Measure.DAMPING),
        **law_handles(("friction",), "friction", law, linear=True),
        **scalar(("offset",), offset, Measure.FORCE, -inf),
        **dead_zone_handles(("dead_zone",), "dead_zone", "force", "N", Measure.FORCE),
        **scalar(("quadratic_viscous",), quadratic, Measure.QUADRATIC),
        **cogging_handles("N", "m"),
        **{
            name: handle
            for name, handle in outer.items()
            if name not in (*NEED_SUPPLY, "sensor.ratio", "sensor.radius")
        },
    }


@dataclass(frozen=True)
class LinearAxis(DrivenPlant):
    """A mass on a guide: M·dv/dt = D_F(f) − F_v·v − T_f(v) − offset; input a force, output position or speed.

    An initial state is a speed in m/s and a position in m, and optionally the initial reading in m/s of a sensor with a
    lag, by default the true speed.

    Args:
        mass: in kg.
        viscous_friction: in N·s/m; a number, or a pair (forward, backward).
        friction: Coulomb and Stribeck friction (4.7), its levels in N and its rate in s/m.
        offset: constant force in N, such as gravity on an inclined axis.
        dead_zone: on the force, break points in N.
        quadratic_viscous: friction by the square of the speed, in N·s²/m².
        cogging: force over position, in N and m.
        drive: converts the command to a force; its gain is in N per unit.
        sensor: between the motion and the log.
        steps: steps per sample for the Stribeck excess.

    Raises:
        ModelError: for a value that is not physical.
    """

    load_unit: ClassVar[str] = "N"
    mass: float = 1.0
    viscous_friction: float | tuple[float, float] = 1.0
    friction: FrictionLaw = Friction(0.1)  # noqa: RUF009
    offset: float = 0.0
    dead_zone: DeadZoneLaw | None = None
    drive: Drive = Drive()  # noqa: RUF009  (frozen)
    sensor: Sensor = Sensor()  # noqa: RUF009  (frozen)
    steps: int = 1
    quadratic_viscous: float = 0.0
    cogging: Cogging = Cogging(1.0)  # noqa: RUF009  (frozen)

    def __post_init__(self) -> None:
        pair = self.viscous_friction
        pair = (float(pair[0]), float(pair[1])) if isinstance(pair, (tuple, list)) else (float(pair), float(pair))
        object.__setattr__(self, "viscous_friction", pair)
        if not (isfinite(self.mass) and self.mass > 0):
            raise ModelError(f"linear axis with a mass of {self.mass} kg; it must be positive")
        if not (min(pair) >= 0 and isfinite(max(pair))):
            raise ModelError(f"linear axis with viscous friction {pair}; it cannot be negative and must be finite")
        if not isfinite(self.offset):
            raise ModelError(f"linear axis with an offset of {self.offset} N; it must be finite")
        check_quadratic("linear axis", self.quadratic_viscous)
        check_steps("linear axis", self.steps)

    @property
    def name(self) -> str:
        """``linear-axis``."""
        return "linear-axis"

    @property
    def handles(self) -> Mapping[str, Handle]:
        """Mass, frictions, offset, dead zone, drive and sensor."""
        return _handles(type(self.friction))

    @property
    def default_free(self) -> tuple[str, ...]:
        """Mass, viscous and Coulomb friction, offset."""
        return ("mass", "viscous_friction", f"friction.{self.friction.parameters[0].name}", "offset")

    @property
    def body(self) -> str:
        """``axis``."""
        return "axis"

    @property
    def channels(self) -> Channels:
        """Position and speed, for a force or a command that the drive converts to a force."""
        units = {Signal.SPEED: "m/s", Signal.POSITION: "m", Signal.ROTOR_SPEED: "rad/s", Signal.CURRENT: "A"}
        commands = ("N", "V", "A", "N*m")
        return Channels(
            units, Signal.POSITION, commands, "newtons", "", self.drive.codes,
            zero_when_open="force", load=self.load_unit if self.drive.loaded else "",
        )  # fmt: skip

    @property
    def frictions(self) -> Mapping[str, FrictionLaw]:
        """The friction of the guide."""
        return {"friction": self.friction}

    def with_frictions(self, laws: Mapping[str, FrictionLaw]) -> Self:
        """The axis with another friction law."""
        return replace(self, **dict(laws))  # type: ignore[arg-type]

    @property
    def friction_name(self) -> str:
        """``friction``."""
        return "friction"

    @property
    def load_name(self) -> str:
        """``offset``."""
        return "offset"

    def start(
        self, state: Array, command: Array, dt: float, signals: Sequence[Signal], samples: int | None = None
    ) -> PlantState:
        """The state before the first sample, from speed and position; see `DrivenMotor.start`."""
        missing = [signal.value for signal in signals if signal not in (Signal.SPEED, Signal.POSITION)]
        if missing:
            raise ModelError(f"linear-axis has no {missing[0]} to compare with; it has position and speed")
        commands = self.drive.standing(command, dt, samples, self.before(state, command))
        return PlantState(dt, np.array(state[:2], dtype=float), commands, self.sensor.first(signals, state, dt))

    def _sampler(self, state: PlantState, signals: Sequence[Signal]) -> DrivenSampler:
        """See `Plant.sampler`."""
        outer, zone = Outer.of(self.drive, self.sensor, state, signals), Inside.numbers_of(self.dead_zone)
        inside = Inside(zone, 1.0, 1.0, 0.0, 1.0 * self.mass, 1.0, 0.0)
        viscous: tuple[float, float] = self.viscous_friction  # type: ignore[assignment]
        friction = Sliding.of(self.friction, viscous, self.quadratic_viscous, self.cogging.waves, self.offset)
        return one_mass_sampler(outer, inside, type(self.friction).level, friction, self.steps, state)

    @property
    def is_one_mass(self) -> bool:
        """Always."""
        return True

    def holding(self, load: float, position: float) -> float:
        """The force that balances the offset and a load."""
        force = self.offset + load
        return force if self.dead_zone is None else float(self.dead_zone.inverse(force))

    def linearised(self, signals: Sequence[Signal]) -> StateSpace:
        """A mass with viscous friction, the mean of both directions."""
        drag = float(np.mean(self.viscous_friction)) / self.mass
        acting = [self.drive.gain, *[-1.0] * self.drive.loaded]  # the command, and a load
        a, b = np.array([[-drag, 0.0], [1.0, 0.0]]), np.array([acting, [0.0] * len(acting)]) / self.mass
        out = np.array([[0.0, 1.0] if signal is Signal.POSITION else [1.0, 0.0] for signal in signals])
        part = StateSpace(a, b, out / self.sensor.scale, np.zeros((len(out), len(acting))), ("speed", "position"))
        return part.with_lag(self.sensor.lag, tuple(range(len(out))))

    def with_motion(self, motion: Motion, fixed: Collection[str] = ()) -> Self:
        """The axis with this motion: the gain gives the mass, unless it is fixed, and the mass gives the rest."""
        mass = self.mass if "mass" in fixed else max(self.drive.gain / motion.gain, TINY)
        zone = motion.dead_zone * abs(self.drive.gain)
        return replace(
            self,
            mass=mass,
            viscous_friction=max(mass * motion.damping, 0.0),
            friction=self.friction.sliding_at(mass * max(motion.coulomb, 0.0)),
            offset=mass * motion.offset,
            dead_zone=None if self.dead_zone is None else replace(self.dead_zone, b_l=-zone, b_r=zone),
        )

    def friction_characteristic(self) -> StaticCharacteristic:
        """All friction over speed, with the viscous part."""
        viscous: tuple[float, float] = self.viscous_friction  # type: ignore[assignment]
        return friction_over_speed((self.friction,), viscous, self.quadratic_viscous, "Speed v", "m/s", "force")

    def dead_zone_characteristic(self) -> StaticCharacteristic | None:
        """The dead zone on the force."""
        return dead_zone_over_command(self.dead_zone, "force")

    def equations(self) -> str:
        """One mass and its position."""
        extra = extra_terms(self.quadratic_viscous, self.cogging, "F_q", "v", "x")
        return f"M·dv/dt = D(f) − F_v·v − T_f(v) − F₀{extra}\ndx/dt = v"

    def to_data(self) -> dict[str, Any]:
        """Parameters and sensor, and the dead zone if there is one."""
        data = super().to_data()
        parameters = without_idle(data["parameters"])
        if self.dead_zone is None:
            parameters = {name: value for name, value in parameters.items() if not name.startswith("dead_zone.")}
        return {**data, "parameters": parameters, "feed": Feed.VOLTAGE.value}

    def quantities(self) -> tuple[Quantity, ...]:
        """Quantities that do not need the gain of the drive."""
        viscous, (level, _) = self.viscous_friction, self.friction.base
        return (
            Quantity("time constant", "M/F_v", "s", self.mass / max(float(np.mean(viscous)), TINY)),
            Quantity("acceleration per unit of command", "k_u/M", "m/s^2", self.drive.gain / self.mass),
            Quantity(
                "Coulomb friction in units of command", "F_c/k_u", "1", level / self.drive.gain, RestsOn(Needs.SLIDING)
            ),
        )
