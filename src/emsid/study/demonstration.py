"""Three small records with known contents, for `emsid demo`.

The program makes the records itself, so nothing has to be downloaded. Results on them are checks and examples, not
evidence of how well a model describes a real drive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from emsid.excitation import amplitude_modulated_prbs, multisine
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import Saturation
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.parameters import Signal
from emsid.plant import Bench, Friction, Motor
from emsid.record import Record


@dataclass(frozen=True)
class Example:
    """A record to try commands on.

    Args:
        name: of the record; its file is ``<name>.csv``.
        title: in a few words; a noun without an article.
        contents: what was simulated, with its true values.
        record: makes the record.
    """

    name: str
    title: str
    contents: str
    record: Callable[[], Record]


def motor_record() -> Record:
    """The built-in motor with its dead zone on a noisy bench: voltage to speed, 10 s at 200 Hz."""
    rng = np.random.default_rng(1)
    voltage = amplitude_modulated_prbs(2000, 6, rng, 6.0, hold=20)
    return Bench.typical().run(Motor(), voltage, 0.005, rng)


AXIS = LinearAxis(mass=2.0, viscous_friction=8.0, friction=Friction(1.5), offset=0.2)
"""The axis of the second record."""


def axis_record() -> Record:
    """A carriage on a guide with Coulomb friction: force to position, read with a resolution of 10 µm."""
    rng, dt = np.random.default_rng(2), 0.005
    force = multisine(2400, np.arange(3, 40), rng, 8.0)
    run = AXIS.simulate(force[:, None], dt, np.zeros(2), (Signal.POSITION,))[:, 0]
    position = 1e-5 * np.round((run + 2e-5 * rng.standard_normal(len(run))) / 1e-5)
    return Record(force, position, dt, ("force",), ("position",), ("N",), ("m",), name="axis")


CIRCUIT = Cascade(
    (
        Rational(np.array([0.0, 0.35]), np.array([-0.65])),
        Saturation(),
        Rational(np.array([0.0, 0.2, 0.1]), np.array([-1.2, 0.5])),
    ),
    name="circuit",
    dt=1e-4,
)
"""The circuit of the third record."""


def circuit_record() -> Record:
    """Filter, saturation, filter: driven by noise of varying size, with 1 % of noise at the output."""
    rng = np.random.default_rng(3)
    source = np.repeat(rng.uniform(0.3, 3.0, 30), 200) * rng.standard_normal(6000)
    output = CIRCUIT.simulate(source).output[:, 0]
    noisy = output + 0.01 * np.std(output) * rng.standard_normal(len(output))
    return Record(source, noisy, 1e-4, ("source",), ("output",), ("V",), ("V",), name="circuit")


EXAMPLES = (
    Example(
        "motor",
        "motor with a dead zone",
        "Voltage and speed of a permanent-magnet motor on a virtual bench: a dead zone of 0.5 V to both sides, Coulomb "
        "friction, 2 Ω, a tachogenerator with noise and ripple.",
        motor_record,
    ),
    Example(
        "axis",
        "positioning axis with friction",
        "Force and position of a carriage of 2 kg with 8 N·s/m of viscous and 1.5 N of Coulomb friction and a constant "
        "force of 0.2 N, read by an encoder of 10 µm.",
        axis_record,
    ),
    Example(
        "circuit",
        "Wiener–Hammerstein circuit",
        "Filter of order 1, saturation at ±1 V, filter of order 2, with 1 % of noise at the output.",
        circuit_record,
    ),
)
