"""The electromechanical system of section IV: its laws, parameters and motion, and a bench to measure it."""

from emsid.plant.bench import Bench, Encoder, Tachometer, VoltageSource
from emsid.plant.dead_zone import DeadZoneLaw
from emsid.plant.friction import Friction
from emsid.plant.motor import Motor
from emsid.plant.simulation import State, Taylor, Trajectory, simulate

__all__ = [
    "Bench",
    "DeadZoneLaw",
    "Encoder",
    "Friction",
    "Motor",
    "State",
    "Tachometer",
    "Taylor",
    "Trajectory",
    "VoltageSource",
    "simulate",
]
