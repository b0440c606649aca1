"""Linear models with a noise model, and how they are estimated.

>>> import emsid
>>> emsid.linear.state_space(order=2, weighting=emsid.linear.moesp).horizon is None
True
"""

from emsid.models.linear.polynomials import PolynomialModel
from emsid.models.linear.prediction_error import PolynomialStructure, armax, box_jenkins
from emsid.models.linear.process_model import ProcessModel, ProcessStructure
from emsid.models.linear.state_space import StateSpaceModel
from emsid.models.linear.subspace_fit import StateSpaceStructure, cva, moesp, state_space
from emsid.models.linear.transfer_function import TransferFunction, TransferFunctionStructure, transfer_function

__all__ = [
    "PolynomialModel",
    "PolynomialStructure",
    "ProcessModel",
    "ProcessStructure",
    "StateSpaceModel",
    "StateSpaceStructure",
    "TransferFunction",
    "TransferFunctionStructure",
    "armax",
    "box_jenkins",
    "cva",
    "moesp",
    "state_space",
    "transfer_function",
]
