"""The electromechanical system of section IV: its laws, its parameters, its simulation, and a virtual bench."""

from emsid.plant.bench import Bench, Encoder, SpeedSensor, Tachometer, VoltageSource
from emsid.plant.constants import Extra
from emsid.plant.dead_zone import DeadZoneLaw
from emsid.plant.friction import FRICTION_LAWS, Friction, FrictionLaw, LawParameter, OneDirection, friction_law
from emsid.plant.gaussian_stribeck import GaussianStribeck
from emsid.plant.load_friction import LoadFriction, PowerFriction
from emsid.plant.motor import Motor, StateSpace
from emsid.plant.parameter import Measure, Parameter
from emsid.plant.simulation import Energy, Events, State, Taylor, Trajectory, simulate

__all__ = [
    "FRICTION_LAWS",
    "Bench",
    "DeadZoneLaw",
    "Encoder",
    "Energy",
    "Events",
    "Extra",
    "Friction",
    "FrictionLaw",
    "GaussianStribeck",
    "LawParameter",
    "LoadFriction",
    "Measure",
    "Motor",
    "OneDirection",
    "Parameter",
    "PowerFriction",
    "SpeedSensor",
    "State",
    "StateSpace",
    "Tachometer",
    "Taylor",
    "Trajectory",
    "VoltageSource",
    "friction_law",
    "simulate",
]
