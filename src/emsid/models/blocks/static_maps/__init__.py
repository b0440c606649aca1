r"""Static maps as blocks of a cascade: y(t) = f(x(t), θ), sample by sample.

Each map has a value, a slope ∂f/∂x, a gradient ∂f/∂θ and, if it exists, an inverse. At a kink the derivative is that of
one side.

**Scale.** Between two blocks of a cascade a factor can be moved without changing the output. `scaling` says whether the
family of f contains every o·f(x/i) (it can take any factor on either side), only those with o = |i|, or none.
`absorbs_shift` says whether it contains f(x − x₀), and `owns_level` whether it contains f + c.

References:
    Kara, Abokoos, *A Simulation and Experimental Study on Identification of an Electromechanical System*, eqs. (3.2),
    (4.7) to (4.9). de Boor, *A Practical Guide to Splines*, rev. ed. (2001).
"""

from emsid.models.blocks.static_maps.laws import CoulombLinear, DeadZone, HyperbolicTangent, Saturation, TwoSlopes
from emsid.models.blocks.static_maps.polynomial import Polynomial
from emsid.models.blocks.static_maps.registry import STATIC_MAPS, register
from emsid.models.blocks.static_maps.shaped import MonotoneSpline, OddSpline
from emsid.models.blocks.static_maps.signless import Abs, EvenSpline
from emsid.models.blocks.static_maps.static_map import NumberedMap, Scaling, StaticMap, closest
from emsid.models.blocks.static_maps.through_points import CubicSpline, PiecewiseLinear
from emsid.models.blocks.static_maps.user import UserMap

for _map in (
    CubicSpline,
    PiecewiseLinear,
    Polynomial,
    DeadZone,
    TwoSlopes,
    Saturation,
    CoulombLinear,
    HyperbolicTangent,
    Abs,
    EvenSpline,
    OddSpline,
    MonotoneSpline,
):
    register(_map)

__all__ = [
    "STATIC_MAPS",
    "Abs",
    "CoulombLinear",
    "CubicSpline",
    "DeadZone",
    "EvenSpline",
    "HyperbolicTangent",
    "MonotoneSpline",
    "NumberedMap",
    "OddSpline",
    "PiecewiseLinear",
    "Polynomial",
    "Saturation",
    "Scaling",
    "StaticMap",
    "TwoSlopes",
    "UserMap",
    "closest",
    "register",
]
