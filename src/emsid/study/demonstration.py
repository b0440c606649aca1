"""Three small records with known contents, for `emsid demo`.

The program makes the records itself, so nothing has to be downloaded. Results on them are checks and examples, not
evidence of how well a model describes a real drive.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import inf
from typing import Any, NamedTuple

import numpy as np

from emsid.excitation import amplitude_modulated_prbs, multisine
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import Saturation
from emsid.models.plants.grey_box import with_effect
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import Plant
from emsid.models.plants.sensor import Sensor
from emsid.plant import Bench, DeadZoneLaw, Friction, Motor
from emsid.record import Record
from emsid.units import plain_unit


class Simulated(NamedTuple):
    """A true value, by the name of its estimate."""

    name: str
    value: float
    unit: str
    meaning: str


@dataclass(frozen=True)
class Example:
    """A record to try commands on, and what an estimate of it is to be compared with.

    Args:
        name: of the record; its file is ``<name>.csv``.
        title: in a few words; a noun without an article.
        contents: what was simulated.
        true: everything that was simulated.
        record: makes the record.
        reading: arguments of `emsid.read` that a first look at its file finds.
    """

    name: str
    title: str
    contents: str
    true: tuple[Simulated, ...]
    record: Callable[[], Record]
    reading: Mapping[str, Any] = field(hash=False)


def _reading(u: str, y: str, *, derivative: bool = False) -> dict[str, Any]:
    """The arguments of `emsid.read` for two columns with units in their names."""
    units = {name: name.rpartition(" [")[2].rstrip("]") for name in (u, y)}
    return {"input": u, "output": f"d({y})" if derivative else y, "units": units, "time": "t [s]"}


MOTOR = Motor(
    resistance=0.8,
    inductance=1.2e-3,
    motor_constant=0.024,
    rotor_inertia=1.2e-5,
    rotor_viscous=4e-6,
    shaft_stiffness=inf,
    load_inertia=1e-15,
    load_viscous=0.0,
    rotor_friction=Friction(5e-3, 1e-3, 0.1),
    load_friction=Friction(),
    voltage_dead_zone=DeadZoneLaw(-0.25, 0.25),
)
"""The motor of the first record, with its load as one mass: no value is one that a search begins with or keeps."""
BENCH = replace(Bench.typical(), delay=0.0)
"""Its bench: a transport delay of 0.5 ms would look like an inductance."""
OFFSET = 0.05
"""Of its tachogenerator in rad/s, see `Bench.typical`."""


def motor_record() -> Record:
    """A motor with a dead zone on a noisy bench: voltage to speed, 10 s at 200 Hz."""
    rng = np.random.default_rng(1)
    voltage = amplitude_modulated_prbs(2000, 6, rng, 4.0, hold=20)
    return BENCH.run(MOTOR, voltage, 0.005, rng)


AXIS = LinearAxis(mass=2.0, viscous_friction=8.0, friction=Friction(1.5), offset=0.2)
"""The axis of the second record."""


def axis_record() -> Record:
    """A carriage on a guide with Coulomb friction: force to position, read with a resolution of 10 µm."""
    rng, dt = np.random.default_rng(2), 0.005
    force = multisine(2400, np.arange(3, 40), rng, 8.0)
    run = AXIS.simulate(force[:, None], dt, np.zeros(2), (Signal.POSITION,))[:, 0]
    position = 1e-5 * np.round((run + 2e-5 * rng.standard_normal(len(run))) / 1e-5)
    return Record(force, position, dt, ("force",), ("position",), ("N",), ("m",), name="axis")


FILTERS = (
    Rational(np.array([0.0, 0.35]), np.array([-0.65])),
    Rational(np.array([0.0, 0.2, 0.1]), np.array([-1.2, 0.5])),
)
CIRCUIT = Cascade((FILTERS[0], Saturation(), FILTERS[1]), name="circuit", dt=1e-4)
"""The circuit of the third record."""


def circuit_record() -> Record:
    """Filter, saturation, filter: driven by noise of varying size, with 1 % of noise at the output."""
    rng = np.random.default_rng(3)
    source = np.repeat(rng.uniform(0.3, 3.0, 30), 200) * rng.standard_normal(6000)
    output = CIRCUIT.simulate(source).output[:, 0]
    noisy = output + 0.01 * np.std(output) * rng.standard_normal(len(output))
    return Record(source, noisy, 1e-4, ("source",), ("output",), ("V",), ("V",), name="circuit")


def _of_plant(plant: Plant, signal: Signal) -> tuple[Simulated, ...]:
    """The true values of a plant that have an effect."""
    shown = [plant.handles[name].parameter for name in with_effect(plant, (signal,))]
    return tuple(
        Simulated(each.name, plant.value(each.name), plain_unit(each.unit), each.description) for each in shown
    )


def _of_circuit() -> tuple[Simulated, ...]:
    """The true values of the circuit: with a gain between its blocks moved, it is the same circuit."""
    first, last = (np.log(np.roots([1.0, *part.denominator])) / CIRCUIT.dt for part in FILTERS)  # poles in 1/s
    return (
        Simulated("gain", float(np.prod([part.gain for part in FILTERS])), "", "at a small input"),
        Simulated("time constant", float(-1.0 / first[0].real), "s", "of the first filter"),
        Simulated("natural frequency", float(abs(last[0])), "rad/s", "of the second filter"),
        Simulated("damping ratio", float(-last[0].real / abs(last[0])), "", "of the second filter"),
    )


EXAMPLES = (
    Example(
        "motor",
        "motor with a dead zone",
        "Voltage and speed of a permanent-magnet motor on a virtual bench: a dead zone, Coulomb and Stribeck friction, "
        "and a tachogenerator with noise, offset and ripple. Voltage and speed alone cannot show the resistance, so "
        "the command gives it.",
        _of_plant(DrivenMotor(MOTOR, sensor=Sensor(offset=OFFSET)), Signal.SPEED),
        motor_record,
        _reading("voltage [V]", "speed [rad/s]"),
    ),
    Example(
        "axis",
        "positioning axis with friction",
        "Force and position of a carriage with viscous and Coulomb friction and a constant force, read by an "
        "encoder of 10 µm.",
        _of_plant(AXIS, Signal.POSITION),
        axis_record,
        _reading("force [N]", "position [m]", derivative=True),
    ),
    Example(
        "circuit",
        "Wiener–Hammerstein circuit",
        "Filter of order 1, saturation at ±1 V, filter of order 2, with 1 % of noise at the output.",
        _of_circuit(),
        circuit_record,
        _reading("source [V]", "output [V]"),
    ),
)
