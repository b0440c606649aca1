"""Structures that are linear in their parameters, and the regressors they are made of.

>>> import emsid
>>> str(emsid.regression.parse_regressor("y(t-1)*u(t-2)^2"))
'y(t-1)*u(t-2)^2'
"""

from emsid.models.regression.narx import Narx, RegressionModel, Structure
from emsid.models.regression.regressors import Factor, Regressor, Tables, parse_regressor
from emsid.models.regression.search.orders import OrderRow, OrderTable, order_grid
from emsid.models.regression.structures import (
    arx,
    friction_narx,
    input_knots,
    polynomial_narx,
    wiener_hammerstein_regression,
)
from emsid.models.regression.term_selection import SelectedTerms, select_terms
from emsid.models.regression.transforms import Transform

__all__ = [
    "Factor",
    "Narx",
    "OrderRow",
    "OrderTable",
    "RegressionModel",
    "Regressor",
    "SelectedTerms",
    "Structure",
    "Tables",
    "Transform",
    "arx",
    "friction_narx",
    "input_knots",
    "order_grid",
    "parse_regressor",
    "polynomial_narx",
    "select_terms",
    "wiener_hammerstein_regression",
]
