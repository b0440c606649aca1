"""What a cascade is built of: linear filters and static maps.

>>> import emsid
>>> cascade = emsid.Cascade((emsid.blocks.Rational([1.0, 0.5]), emsid.blocks.DeadZone(-0.2, 0.2)))
>>> cascade.memory > 0
True
"""

from emsid.models.blocks.block import Block
from emsid.models.blocks.cascade import Cascade, CascadeState
from emsid.models.blocks.filters import Rational, fir
from emsid.models.blocks.search.map_families import FAMILIES, Family
from emsid.models.blocks.search.topologies import CascadeSearch
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
    "FAMILIES",
    "Abs",
    "Block",
    "Cascade",
    "CascadeSearch",
    "CascadeState",
    "CoulombLinear",
    "CubicSpline",
    "DeadZone",
    "Family",
    "PiecewiseLinear",
    "Polynomial",
    "Rational",
    "Saturation",
    "Scaling",
    "StaticMap",
    "UserMap",
    "fir",
]
