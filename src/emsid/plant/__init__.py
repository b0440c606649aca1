"""The electromechanical system of section IV: its laws, parameters and motion, and a bench to measure it."""

from emsid.plant.bench import Bench, Encoder, Tachometer, VoltageSource
from emsid.plant.dead_zone import DeadZoneLaw
from emsid.plant.friction import FRICTION_LAWS, Friction, FrictionLaw, LawParameter, friction_law
from emsid.plant.motor import Motor
from emsid.plant.parameter import Measure, Parameter
from emsid.plant.simulation import State, Taylor, Trajectory, simulate

__all__ = [
    "FRICTION_LAWS",
    "Bench",
    "DeadZoneLaw",
    "Encoder",
    "Friction",
    "FrictionLaw",
    "LawParameter",
    "Measure",
    "Motor",
    "Parameter",
    "State",
    "Tachometer",
    "Taylor",
    "Trajectory",
    "VoltageSource",
    "friction_law",
    "simulate",
]
