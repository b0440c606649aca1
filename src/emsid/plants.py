"""Physical plants, whose resistance, inertia and friction `emsid.fit` estimates.

>>> import emsid
>>> emsid.plants.rigid_motor().default_free[:3]
('resistance', 'motor_constant', 'rotor_inertia')
"""

from emsid.models.plants.brushless import Brushless, Harmonic
from emsid.models.plants.cogging import Cogging
from emsid.models.plants.datasheet import Given, datasheet
from emsid.models.plants.drifting_load import DriftingLoad, LoadDrift
from emsid.models.plants.drive import Bridge, Drive, Feed, Hold
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import Recent
from emsid.models.plants.gravity import Gravity
from emsid.models.plants.grey_box import GreyBox, PlantModel
from emsid.models.plants.initial_state import InitialState
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.modal_axis import modal_axis
from emsid.models.plants.motor import DrivenMotor, MotorPlant
from emsid.models.plants.one_mass import Motion
from emsid.models.plants.own_plant import OwnPlant
from emsid.models.plants.parameters import Handle, Signal, by_direction, scalar
from emsid.models.plants.park import park
from emsid.models.plants.plant import Channels, Part, Plant, Quantity, Sampler, Sizes, StaticCharacteristic
from emsid.models.plants.registry import register
from emsid.models.plants.search.choice import choose
from emsid.models.plants.search.constructors import brushless, joint, linear_axis, motor, rigid_motor
from emsid.models.plants.search.diagnostics import (
    Curve,
    Profile,
    cogging_curve,
    dead_zone_curve,
    friction_curve,
    likelihood_profile,
)
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import Combination, Estimate, GreyBoxFit, Status
from emsid.models.plants.sensor import Sensor
from emsid.models.plants.servo import Servo
from emsid.models.plants.state import PlantState
from emsid.models.plants.tanks import tanks
from emsid.models.visited import Needs, RestsOn
from emsid.plant.friction import FrictionLaw, LawParameter, friction_law
from emsid.plant.gaussian_stribeck import GaussianStribeck
from emsid.plant.load_friction import LoadFriction, PowerFriction
from emsid.plant.parameter import Measure, Parameter

__all__ = [
    "Bridge",
    "Brushless",
    "Channels",
    "Cogging",
    "Combination",
    "Curve",
    "DriftingLoad",
    "Drive",
    "DrivenMotor",
    "DrivenPlant",
    "Estimate",
    "Feed",
    "FrictionLaw",
    "GaussianStribeck",
    "Given",
    "Gravity",
    "GreyBox",
    "GreyBoxFit",
    "Handle",
    "Harmonic",
    "Hold",
    "InitialState",
    "LawParameter",
    "LinearAxis",
    "LoadDrift",
    "LoadFriction",
    "Measure",
    "Motion",
    "MotorPlant",
    "Needs",
    "OwnPlant",
    "Parameter",
    "Part",
    "Plant",
    "PlantModel",
    "PlantState",
    "PowerFriction",
    "Profile",
    "Quantity",
    "Recent",
    "RestsOn",
    "Sampler",
    "Sensor",
    "Servo",
    "Signal",
    "Sizes",
    "StaticCharacteristic",
    "Status",
    "brushless",
    "by_direction",
    "choose",
    "cogging_curve",
    "datasheet",
    "dead_zone_curve",
    "friction_curve",
    "friction_law",
    "joint",
    "likelihood_profile",
    "linear_axis",
    "modal_axis",
    "motor",
    "park",
    "register",
    "rigid_motor",
    "scalar",
    "simulation_error",
    "tanks",
]
