"""The blocks of a cascade, linear filters and static maps, and the feedback model, which has static maps in a loop.

>>> import emsid
>>> cascade = emsid.Cascade((emsid.blocks.Rational([1.0, 0.5]), emsid.blocks.DeadZone(-0.2, 0.2)))
>>> cascade.memory > 0
True
"""

from emsid.models.blocks.block import Block
from emsid.models.blocks.cascade import Cascade, CascadeState
from emsid.models.blocks.filters import Rational, fir
from emsid.models.blocks.search.cross_validation import CascadeSearch, Topology
from emsid.models.blocks.search.estimation import CascadeOptions, CascadeStructure
from emsid.models.blocks.search.map_families import Family
from emsid.models.blocks.static_maps import (
    STATIC_MAPS,
    Abs,
    CoulombLinear,
    CubicSpline,
    DeadZone,
    EvenSpline,
    HyperbolicTangent,
    MonotoneSpline,
    NumberedMap,
    OddSpline,
    PiecewiseLinear,
    Polynomial,
    Saturation,
    Scaling,
    StaticMap,
    TwoSlopes,
    UserMap,
    closest,
    register,
)
from emsid.models.blocks.static_maps.static_map import Pieces
from emsid.models.feedback.kernels import LoopSignals
from emsid.models.feedback.model import FeedbackModel, FeedbackState
from emsid.models.feedback.search.estimation import FeedbackStructure
from emsid.models.feedback.search.trials import FeedbackSearch

__all__ = [
    "STATIC_MAPS",
    "Abs",
    "Block",
    "Cascade",
    "CascadeOptions",
    "CascadeSearch",
    "CascadeState",
    "CascadeStructure",
    "CoulombLinear",
    "CubicSpline",
    "DeadZone",
    "EvenSpline",
    "Family",
    "FeedbackModel",
    "FeedbackSearch",
    "FeedbackState",
    "FeedbackStructure",
    "HyperbolicTangent",
    "LoopSignals",
    "MonotoneSpline",
    "NumberedMap",
    "OddSpline",
    "Pieces",
    "PiecewiseLinear",
    "Polynomial",
    "Rational",
    "Saturation",
    "Scaling",
    "StaticMap",
    "Topology",
    "TwoSlopes",
    "UserMap",
    "closest",
    "fir",
    "register",
]
