"""What a cascade is built of: linear filters and static maps.

>>> import emsid
>>> cascade = emsid.Cascade((emsid.blocks.Rational([1.0, 0.5]), emsid.blocks.DeadZone(-0.2, 0.2)))
>>> cascade.memory > 0
True
"""

from emsid.models.blocks.block import Block
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational, fir
from emsid.models.blocks.static_maps import (
    Abs,
    CoulombLinear,
    CubicSpline,
    DeadZone,
    PiecewiseLinear,
    Polynomial,
    Saturation,
    Scaling,
    StaticMap,
    UserMap,
)

__all__ = [
    "Abs",
    "Block",
    "Cascade",
    "CoulombLinear",
    "CubicSpline",
    "DeadZone",
    "PiecewiseLinear",
    "Polynomial",
    "Rational",
    "Saturation",
    "Scaling",
    "StaticMap",
    "UserMap",
    "fir",
]
