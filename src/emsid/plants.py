"""Physical plants: what `emsid.fit` estimates resistances, inertias and frictions of.

>>> import emsid
>>> emsid.plants.rigid_motor().usual[:3]
('resistance', 'rotor_viscous', 'motor_constant')
"""

from emsid.models.plants.datasheet import Given, datasheet
from emsid.models.plants.drive import Bridge, Drive, Feed, Sensor
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.own_plant import OwnPlant
from emsid.models.plants.parameters import Handle, Plant, Quantity, Signal
from emsid.models.plants.search.diagnostics import Profile, likelihood_profile
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.nouns import linear_axis, motor, rigid_motor
from emsid.models.plants.search.problem import Recent
from emsid.models.plants.search.result import Combination, Estimate, GreyBoxFit
from emsid.plant.motor import Parameter

__all__ = [
    "Bridge",
    "Combination",
    "Drive",
    "DrivenMotor",
    "Estimate",
    "Feed",
    "Given",
    "GreyBox",
    "GreyBoxFit",
    "Handle",
    "LinearAxis",
    "OwnPlant",
    "Parameter",
    "Plant",
    "Profile",
    "Quantity",
    "Recent",
    "Sensor",
    "Signal",
    "datasheet",
    "likelihood_profile",
    "linear_axis",
    "motor",
    "rigid_motor",
    "simulation_error",
]
