"""Linear models with a noise model, and how they are estimated.

>>> import emsid
>>> emsid.linear.state_space(order=2, weighting=emsid.linear.moesp).horizon is None
True
"""

from emsid.models.linear.state_space import StateSpaceModel
from emsid.models.linear.subspace_fit import StateSpaceStructure, cva, moesp, state_space

__all__ = ["StateSpaceModel", "StateSpaceStructure", "cva", "moesp", "state_space"]
