r"""What may be added to a plant: a table of moves, each with the neutral value that its parameters have without it.

A plant contains itself with an addition at its neutral value, so that a score tells what the addition promises
(`emsid.models.search.score`), and the search only refits what promises something (`choice`). To add one, write a
function that yields it and name it in `MOVES`.

Some parameters have an effect only beside others: a Stribeck excess needs a rate, a factor beyond a knee the voltage of
the knee. Such an addition is yielded with a few values of the latter, of which the most promising is refitted.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.models.plants.drive import FULL
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.parameters import Signal, parts
from emsid.models.plants.search.cogging import wave
from emsid.models.plants.search.speeds import top_speed
from emsid.plant import Friction, FrictionLaw, GaussianStribeck, LoadFriction, PowerFriction
from emsid.record import Record

INDUCTANCE, SLOPE, QUADRATIC = "inductance", "voltage_dead_zone.m_l", "quadratic_viscous"
BACKWARD, DROP = "viscous_backward", "voltage_drop"
VISCOUS = ("rotor_viscous", "viscous_friction")
ZONES = ("voltage_dead_zone.half_width", "dead_zone.half_width")
HARMONICS = (("cogging.period", "cogging.cosine_1", "cogging.sine_1"), ("cogging.cosine_2", "cogging.sine_2"))
SPEEDS = frozenset({Signal.SPEED, Signal.ROTOR_SPEED})
RATES = (5.0, 20.0, 60.0, 200.0)
"""Rates of Stribeck friction, times the top speed: an excess that fades over a fifth of it, down to one that a few
samples around rest show."""
WIDER = 0.4
"""Rates of a Gaussian excess relative to these: it is flat near rest and then falls fast."""
BREAKS, WIDTHS = (0.9, 0.7, 0.4), (0.02, 0.1)
"""Parts of the largest voltage where a supply ends or a gain changes, and half widths of a dead zone, to begin with."""
LATE = (0.3, 1.0, 2.5)
"""Delays in samples to begin with: a held command has a kink at every whole number of them."""
GAPS = (0.3, 1.0, 3.0, 10.0)
"""Widths of a backlash to begin with, in angles that the load turns by in a sample at its top speed."""
COOLING = (0.0, 2.0, 8.0)
"""Rates of cooling to begin with, over the length of the longest segment: one that does not show, and two that do."""
RISES = (0.1, 0.4)
"""Rises of the resistance to begin with: the promise of a score is by the first, and far too large for the latter."""
TOLD_APART = VISCOUS[:1]
"""A changing resistance tells viscous friction from the braking of the armature. Left out by the choice, a small one
moves K_m and J by two standard errors: 9 of 19 intervals of K_m had the truth, and 21 of 21 with it."""
SEEN = 0.05
"""The least part of the samples at full duty, and below it, that shows a loss of a bridge that switches."""


@dataclass(frozen=True, eq=False)
class Addition:
    """Parameters that a plant does not have yet.

    Attributes:
        effect: what they describe, for `emsid.wording`.
        start: the plant with the parameters at their neutral values, and with what they need beside them.
        names: of the parameters.
        beside: parameters that have an effect only beside them, and are estimated with them.
        along: parameters that the data determine only with it, and that are estimated with it unless they are known.
        instead: parameters that are no longer estimated, each with those that stand for it, such as both directions.
        probe: values to which the effect is a difference, for parameters without a derivative where they are neutral
            and those of which a derivative says little about usual values.
        begins: further values to begin a refit with.
        kept: values that they have and that are not estimated, such as a mean over the whole sample.
        law: the friction law without the addition, where that is another one.
        scored: whether a score can say what it promises; others are always refitted.
    """

    effect: str
    start: DrivenPlant
    names: tuple[str, ...]
    beside: tuple[str, ...] = ()
    along: tuple[str, ...] = ()
    instead: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    probe: Mapping[str, float] = field(default_factory=dict)
    begins: tuple[Mapping[str, float], ...] = ()
    kept: Mapping[str, float] = field(default_factory=dict)
    law: type[FrictionLaw] | None = None
    scored: bool = True

    @property
    def sides(self) -> dict[str, str]:
        """Parameters for one direction, or one case, each with the parameter that it stands for a part of."""
        return {side: whole for whole, several in self.instead.items() for side in several}

    def free(self, free: Sequence[str]) -> tuple[str, ...]:
        """The parameters that are estimated with it, where these are without it."""
        present = [new for name in free for new in self.instead.get(name, (name,))]
        added = [name for name in (*self.names, *self.beside, *self.along) if name not in self.kept]
        return tuple(dict.fromkeys((*present, *added)))

    def begun(self, step: NDArray[np.float64], bounds: Mapping[str, tuple[float, float]]) -> list[DrivenPlant]:
        """The plants that a refit begins with: at the step that the score promises, and at usual values."""
        if self.kept:
            return [self.start.with_values(self.kept)]
        promised = {name: self.start.value(name) + by for name, by in zip(self.names, step.tolist(), strict=True)}
        values = [promised, *self.begins] if step.any() else [*self.begins] or [promised]
        inside = [{name: float(np.clip(value, *bounds[name])) for name, value in each.items()} for each in values]
        return [self.start.with_values(each) for each in inside]

    def taken_out(self, plant: DrivenPlant, free: Sequence[str]) -> tuple[DrivenPlant, tuple[str, ...]] | None:
        """A plant that has the addition without it, and what is free then; None where another one is built on it."""
        sides = self.sides
        added = {*self.names, *self.beside, *self.along, *sides} - self.kept.keys()
        if not added <= {*free}:
            return None
        means = {
            whole: float(np.mean([abs(plant.value(side)) for side in several])) if several else self.start.value(whole)
            for whole, several in self.instead.items()
        }
        neutral = {name: self.start.value(name) for name in (*self.names, *self.along) if name not in sides}
        plain = plant if self.law is None else with_law(plant, self.law)
        left = [sides.get(name, name) for name in free if name in sides or name not in added]
        left += [whole for whole, several in self.instead.items() if not several]
        values = {name: value for name, value in {**neutral, **means}.items() if name in plain.handles}
        return plain.with_values(values), tuple(dict.fromkeys(left))


@dataclass(frozen=True, eq=False)
class Situation:
    """A plant, what is estimated of it, and the records.

    Args:
        plant: with its estimates.
        free: what is estimated.
        segments: the records.
        signals: of their outputs.
        scored: whether only moves are wanted of which a score can say what they promise.
    """

    plant: DrivenPlant
    free: tuple[str, ...]
    segments: Sequence[Record]
    signals: Sequence[Signal]
    scored: bool = False

    @cached_property
    def fast(self) -> float:
        """The top speed."""
        return top_speed(self.segments, 0, self.signals[0] is Signal.POSITION)

    @property
    def dt(self) -> float:
        """The sample time in s."""
        return self.segments[0].dt

    @property
    def seconds(self) -> float:
        """The length of the longest segment in s."""
        return max(map(len, self.segments)) * self.dt

    @cached_property
    def largest(self) -> float:
        """The largest voltage that is commanded."""
        return max(self.plant.drive.largest(each.input) for each in self.segments)

    @cached_property
    def loss(self) -> float:
        """The mean copper loss in W of its free run."""
        plant, current = self.plant, (Signal.CURRENT,)
        runs = [plant.simulate(s.input, s.dt, plant.first_state(self.signals, s), current) for s in self.segments]
        return plant.value("resistance") * float(np.mean(np.concatenate(runs) ** 2))

    @property
    def law(self) -> FrictionLaw:
        """The friction law of the moving mass."""
        return self.plant.frictions[self.plant.friction_name]

    def of_friction(self, name: str) -> str:
        """The full name of a parameter of the law."""
        return f"{self.plant.friction_name}.{name}"

    @property
    def level(self) -> str:
        """The name of its level."""
        return level_name(self.plant)

    def both(self, name: str) -> tuple[str, ...]:
        """The names for each direction of a parameter that is estimated for both; none where it is not."""
        sides = parts(self.plant, name) if name in self.free else ()
        return sides if len(sides) == 2 else ()

    @property
    def levels(self) -> tuple[str, ...]:
        """The levels for each direction; none where a constant load, which has the same effect, is estimated too."""
        return self.both(self.level) if self.plant.load_name not in self.free else ()


Moves = Callable[[Situation], Iterable[Addition]]


def level_name(plant: DrivenPlant) -> str:
    """The name of the level of its friction, the first parameter of the law."""
    return f"{plant.friction_name}.{plant.frictions[plant.friction_name].parameters[0].name}"


def with_law(plant: DrivenPlant, law: type[FrictionLaw], **values: Any) -> DrivenPlant:
    """The plant with another law, which has the values of the old one by the same names, and those given."""
    old = plant.frictions[plant.friction_name]
    known = {each.name for each in fields(law)}
    same = {each.name: getattr(old, each.name) for each in fields(old) if each.name in known}
    return plant.with_frictions({**plant.frictions, plant.friction_name: law(**{**same, **values})})


# --- friction and load ------------------------------------------------------------------------------------------------


def coulomb(at: Situation) -> Iterator[Addition]:
    """A level of friction."""
    yield Addition("coulomb", at.plant, (at.level,))


def viscous(at: Situation) -> Iterator[Addition]:
    """Friction that grows with the speed."""
    yield from (Addition("viscous", at.plant, (name,)) for name in VISCOUS)


def dead_zone(at: Situation) -> Iterator[Addition]:
    """A command below which nothing moves."""
    for name in ZONES:
        yield Addition("dead-zone", at.plant, (name,), begins=tuple({name: part * at.largest} for part in WIDTHS))


def of_one_mass(at: Situation, effect: str, name: str) -> Iterator[Addition]:
    """A parameter whose neutral value is the one that it has; beside a shaft a free run takes twenty times as long."""
    if at.plant.is_one_mass:
        yield Addition(effect, at.plant, (name,))


def stribeck(at: Situation) -> Iterator[Addition]:
    """Friction is larger near rest."""
    excess, rate = at.of_friction("stribeck"), at.of_friction("stribeck_rate")
    if excess in at.free or rate not in at.plant.handles:
        return
    shapes: list[tuple[DrivenPlant, float, type[Friction] | None]] = [(at.plant, 1.0, None)]
    if type(at.law) is Friction and not at.plant.turn and at.plant.is_one_mass:
        shapes.append((with_law(at.plant, GaussianStribeck), WIDER, Friction))
    third = 0.3 * at.plant.value(at.level)
    for plant, factor, law in shapes:
        rates = [factor * times / at.fast for times in RATES]
        begins = tuple({excess: third, rate: each} for each in rates)
        for each in rates:
            begun = plant.with_values({excess: 0.0, rate: each})
            yield Addition("stribeck", begun, (excess,), (rate,), begins=begins, law=law)


def stribeck_by_direction(at: Situation) -> Iterator[Addition]:
    """Each direction has its own excess of friction near rest."""
    excess, rate = at.of_friction("stribeck"), at.of_friction("stribeck_rate")
    if sides := at.both(excess):
        yield Addition("stribeck-by-direction", at.plant, sides[1:], instead={excess: sides})
    elif rate in at.plant.handles and not {rate, excess, *parts(at.plant, excess)} & {*at.free}:
        for times in RATES:
            begun = at.plant.with_values({excess: 0.0, rate: times / at.fast})
            yield Addition("stribeck-by-direction", begun, parts(at.plant, excess), (rate,))


def coulomb_by_direction(at: Situation) -> Iterator[Addition]:
    """Each direction has its own level of friction."""
    if sides := at.levels:
        yield Addition("coulomb-by-direction", at.plant, sides[1:], instead={at.level: sides})


def by_direction(at: Situation, effect: str, names: tuple[str, ...]) -> Iterator[Addition]:
    """Each direction has its own viscous friction, or its own end of the dead zone."""
    for name in names:
        if sides := at.both(name):
            yield Addition(effect, at.plant, sides[1:], instead={name: sides})
    if names == VISCOUS and at.plant.is_one_mass:
        yield Addition(effect, at.plant, (BACKWARD,))


def load(at: Situation) -> Iterator[Addition]:
    """A constant load acts on the mass."""
    if at.level in at.free or not set(parts(at.plant, at.level)) <= set(at.free):
        yield Addition("load", at.plant, (at.plant.load_name,))


def cogging(at: Situation) -> Iterator[Addition]:
    """A force repeats with the position, measured or integrated: with one harmonic, then with two.

    It is always refitted: the angle of a free run drifts away from the one that is measured. Of a measured speed the
    position is the integral, which is not known in a second segment.
    """
    period = HARMONICS[0][0]
    if at.scored or not at.plant.is_one_mass:
        return
    if period in at.free:
        yield Addition("cogging", at.plant, HARMONICS[1])
    elif period in at.plant.handles and (Signal.POSITION in at.signals[:1] or len(at.segments) == 1):
        found = wave(at.plant, at.segments, at.signals)
        if found is not None:
            values = dict(zip(HARMONICS[0], found[1], strict=True))
            begun = at.plant.with_values({**dict.fromkeys(HARMONICS[0][1:], 0.0), period: values[period]})
            begins = [values]
            with suppress(EmsidError):  # a motion that this plant cannot have
                moved = at.plant.with_motion(found[0])
                begins.append({**{name: moved.value(name) for name in at.free if name in moved.handles}, **values})
            yield Addition("cogging", begun, HARMONICS[0][1:], (period,), begins=tuple(begins), scored=False)


def backlash(at: Situation) -> Iterator[Addition]:
    """The load, or its sensor, follows the motion only behind a gap."""
    if at.plant.secondary:
        begins = tuple({"shaft_backlash": part * at.fast * at.dt} for part in GAPS)
        yield Addition("backlash", at.plant, ("shaft_backlash",), begins=begins, scored=False)  # zero has no derivative
    else:
        yield Addition("backlash", at.plant, ("sensor.backlash",))


def loaded(at: Situation) -> Iterator[Addition]:
    """Friction of a gear grows with its load: near rest more, in each direction of power, with its square."""
    if not at.plant.turn:
        return
    factor, near, rate = (at.of_friction(name) for name in ("load", "load_stribeck", "stribeck_rate"))
    if type(at.law) is Friction:
        yield Addition("load-friction", with_law(at.plant, LoadFriction), (factor,), law=Friction)
    elif type(at.law) is LoadFriction and factor in at.free:
        if rate in at.free and near not in at.free:
            yield Addition("load-friction", at.plant, (near,))
        numbers = at.law.numbers
        plain, excess = (tuple(numbers[:, k].tolist()) for k in (3, 4))
        begun = with_law(
            at.plant, PowerFriction, motor=plain, outside=plain, motor_stribeck=excess, outside_stribeck=excess
        )
        split = {
            name: (at.of_friction(f"motor{end}"), at.of_friction(f"outside{end}"))
            for name, end in ((factor, ""), (near, "_stribeck"))
            if name in at.free
        }
        outside = tuple(sides[1] for sides in split.values())
        yield Addition("load-friction", begun, outside, instead=split, law=LoadFriction)
    elif type(at.law) is PowerFriction and rate in at.free:
        squares = tuple(at.of_friction(name) for name in ("motor_squared", "outside_squared"))
        yield Addition("load-friction", at.plant, squares)


# --- how a sample is taken --------------------------------------------------------------------------------------------


def delay(at: Situation) -> Iterator[Addition]:
    """The command acts late."""
    begins = tuple({"drive.delay": late * at.dt} for late in LATE)
    yield Addition("delay", at.plant, ("drive.delay",), begins=begins)


def lag(at: Situation) -> Iterator[Addition]:
    """The sensor filters."""
    if {*at.signals} != {Signal.CURRENT}:
        begins = tuple({"sensor.lag": 2 * late * at.dt} for late in LATE)
        yield Addition("lag", at.plant, ("sensor.lag",), begins=begins)


def average(at: Situation) -> Iterator[Addition]:
    """The speed is the mean over the sample before it, as from counting the edges of an encoder."""
    if SPEEDS & {*at.signals}:
        yield Addition("average", at.plant, ("sensor.average",), kept={"sensor.average": 1.0})


def may_have_inductance(plant: DrivenPlant) -> bool:
    """Whether a voltage drives it, without a drop, which is not simulated beside an inductance."""
    return (plant.can_coast or bool(plant.secondary)) and not (DROP in plant.handles and plant.value(DROP))


def inductance(at: Situation) -> Iterator[Addition]:
    """The current follows the voltage after some time."""
    if may_have_inductance(at.plant):
        henry = at.dt * at.plant.value("resistance")
        begins = {INDUCTANCE: 0.5 * henry}, {INDUCTANCE: 1.5 * henry}
        yield Addition("inductance", at.plant, (INDUCTANCE,), probe=begins[0], begins=begins)


def sensor_offset(at: Situation) -> Iterator[Addition]:
    """A speed sensor does not read zero at rest."""
    if Signal.POSITION not in at.signals:
        yield Addition("sensor-offset", at.plant, ("sensor.offset",))


# --- what a bridge adds -----------------------------------------------------------------------------------------------


def gain_by_direction(at: Situation) -> Iterator[Addition]:
    """A negative voltage acts more, or less, than a positive one.

    At constant speed a smaller gain has the same effect as more friction: if both differ by direction, one of them
    alone may explain nothing.
    """
    yield Addition("gain-by-direction", at.plant, (SLOPE,))
    if sides := at.levels:
        yield Addition("gain-by-direction", at.plant, (SLOPE, sides[1]), instead={at.level: sides})


def voltage_drop(at: Situation) -> Iterator[Addition]:
    """The bridge, or the brushes, take a constant voltage that opposes the current."""
    if at.plant.can_coast and INDUCTANCE not in at.free and not at.plant.value(INDUCTANCE):
        yield Addition("voltage-drop", at.plant, (DROP,), begins=({DROP: 0.05 * at.largest},))


def heating(at: Situation) -> Iterator[Addition]:
    """The winding becomes warm by its copper loss, and so its resistance rises; at several rates of cooling."""
    if not at.plant.can_coast or not {"winding_drift", "heating"}.isdisjoint(at.free):
        return
    per_unit = at.plant.value("temperature_coefficient") * at.loss * at.seconds  # the rise for a heating of one
    quickest = at.plant.handles["cooling"].upper * at.seconds
    for rate in [each for each in COOLING if each <= quickest] if per_unit > 0 else ():
        begun = at.plant.with_values({"heating": 0.0, "cooling": rate / at.seconds})
        begins = tuple({"heating": part * max(rate, 1.0) / per_unit} for part in RISES)
        beside = ("cooling",) if rate else ()
        yield Addition("heating", begun, ("heating",), beside, TOLD_APART, probe=begins[0], begins=begins)


def winding_drift(at: Situation) -> Iterator[Addition]:
    """The resistance rises or falls with time."""
    if at.plant.can_coast and "heating" not in at.free:
        yield Addition("resistance-drift", at.plant, ("winding_drift",), along=TOLD_APART)


def coasting(at: Situation) -> Iterator[Addition]:
    """The bridge leaves the armature open in its off-time; the largest command is full duty without a supply given."""
    if at.plant.can_coast:
        supply = at.plant.drive.supply if isfinite(at.plant.drive.supply) else at.largest
        begins = tuple({"drive.freewheel": part} for part in (0.3, 0.9))
        yield Addition("coasting", at.plant.with_drive(supply=supply), ("drive.freewheel",), begins=begins)


def supply_limit(at: Situation) -> Iterator[Addition]:
    """The voltage ends at the supply, below the largest one that is commanded."""
    if at.plant.can_coast and not isfinite(at.plant.drive.supply):
        begun = at.plant.with_drive(supply=at.largest)
        begins = tuple({"drive.supply": part * at.largest} for part in BREAKS[:2])
        yield Addition("supply", begun, ("drive.supply",), probe=begins[0], begins=begins)


def knee(at: Situation) -> Iterator[Addition]:
    """Beyond some voltage the gain is another one, as that of a bridge near full duty, where it switches no more."""
    if at.plant.can_coast and not isfinite(at.plant.drive.knee):
        for part in BREAKS:
            begun = at.plant.with_drive(knee=part * min(at.largest, at.plant.drive.supply), beyond=1.0)
            yield Addition("knee", begun, ("drive.beyond",), ("drive.knee",))


def switching_loss(at: Situation) -> Iterator[Addition]:
    """Below full duty the bridge switches and loses a part of its on-time; both must be in the records."""
    drive = at.plant.drive
    if at.plant.can_coast and isfinite(drive.supply):
        commands = np.concatenate([drive.commands(each.input) for each in at.segments])
        wanted = np.abs(drive.gain * (commands + drive.offset))
        full = wanted >= FULL * drive.supply
        if min(np.mean(full), np.mean(~full & (wanted > 0))) >= SEEN:
            yield Addition("switching-loss", at.plant, ("drive.loss",), begins=({"drive.loss": 0.05},))


def current_rise(at: Situation) -> Iterator[Addition]:
    """The armature current of a bridge that coasts rises anew in every pulse, which looks like a dead zone."""
    if at.plant.can_coast and at.plant.drive.freewheel:
        zone = [name for name in (ZONES[0], *parts(at.plant, ZONES[0])) if name in at.free]
        plain = at.plant.with_values(dict.fromkeys(zone, 0.0))
        begins = ({"drive.rise": 0.05}, {"drive.rise": 0.2})
        yield Addition(
            "current-rise", plain, ("drive.rise",), instead=dict.fromkeys(zone, ()), begins=begins, scored=False
        )


BASIC: dict[str, Moves] = {
    "coulomb": coulomb, "viscous": viscous, "dead-zone": dead_zone, "stribeck": stribeck,
    "load": load, "coulomb-by-direction": coulomb_by_direction, "delay": delay, "lag": lag, "average": average,
    "coasting": coasting,
}  # fmt: skip
"""What every driven plant may have."""
MOVES: dict[str, Moves] = {
    **BASIC, "quadratic": partial(of_one_mass, effect="quadratic", name=QUADRATIC),
    "stribeck-by-direction": stribeck_by_direction,
    "viscous-by-direction": partial(by_direction, effect="viscous-by-direction", names=VISCOUS),
    "dead-zone-by-direction": partial(by_direction, effect="dead-zone-by-direction", names=ZONES),
    "cogging": cogging, "inductance": inductance, "sensor-offset": sensor_offset,
    "gain-by-direction": gain_by_direction, "voltage-drop": voltage_drop, "supply": supply_limit, "knee": knee,
    "switching-loss": switching_loss, "current-rise": current_rise, "load-friction": loaded, "backlash": backlash,
    "heating": heating, "resistance-drift": winding_drift,
}  # fmt: skip
"""All moves by the effect that they add."""
OF_JOINT = (*BASIC, "load-friction")
"""Those of a joint: what its gear adds, and not what only a search over speeds of a motor tells apart."""
OF_SHAFT = ("dead-zone", "inductance", "backlash")
"""Those of a motor with an elastic shaft, which is too slow to simulate for the others."""


def moves_of(plant: DrivenPlant) -> tuple[str, ...]:
    """The effects that are tried for a plant of this kind."""
    return OF_SHAFT if plant.secondary else OF_JOINT if plant.turn else tuple(n for n in MOVES if n != "backlash")


def additions(
    at: Situation, known: Collection[str], effects: Iterable[str] = MOVES, fixed: Mapping[str, float] | None = None
) -> Iterator[Addition]:
    """What may be added to a plant.

    Args:
        at: the plant and the records.
        known: parameters whose values were given; they are never added.
        effects: what is tried.
        fixed: values that no addition changes.
    """
    taken = {*at.free, *known}
    taken |= {side for name in taken for side in parts(at.plant, name)}
    for effect in effects:
        for row in MOVES[effect](at):
            new = {*row.names, *row.beside} - row.sides.keys()
            have = all(name in row.start.handles for name in row.names)
            if not have or not taken.isdisjoint(new) or not row.instead.keys().isdisjoint(known):
                continue
            if at.scored and not row.scored:
                continue
            if all(row.start.value(name) == value for name, value in (fixed or {}).items()) and _is_neutral(at, row):
                yield replace(row, along=tuple(name for name in row.along if name not in taken))


def _is_neutral(at: Situation, row: Addition) -> bool:
    """Whether the plant does not have the effect yet."""
    for name in (name for name in row.names if name in at.plant.handles and name not in row.sides):
        value = at.plant.value(name)
        if (isfinite(value) and value != row.start.value(name)) or _apart(at.plant, name):
            return False
    return not any(at.plant.value(name) for name in row.kept)


def _apart(plant: DrivenPlant, name: str) -> bool:
    """Whether a parameter for both directions has an effect in one of them."""
    return any(plant.value(side) != plant.value(name) for side in parts(plant, name) if "dead_zone" not in name)
