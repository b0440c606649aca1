r"""Static maps as blocks of a cascade: y(t) = f(x(t), θ), sample by sample.

Each gives its value, its slope ∂f/∂x, its gradient ∂f/∂θ and, where there is one, its inverse. At a kink the derivative
is that of one side.

**Scale.** Between two blocks of a cascade a factor can be moved without changing anything outside. A map says with
`scaling` whether its family holds, with f, every o·f(x/i) (it can take up any factor on either side), only those with
o = |i|, or none; with `absorbs_shift` whether it holds f(x − x₀), and with `owns_level` whether it holds f + c.

References:
    Kara, Abokoos, *A Simulation and Experimental Study on Identification of an Electromechanical System*, eqs. (3.2),
    (4.7) to (4.9). de Boor, *A Practical Guide to Splines*, rev. ed. (2001).
"""

from emsid.models.blocks.static_maps.laws import Abs, CoulombLinear, DeadZone, NumberedMap, Saturation
from emsid.models.blocks.static_maps.polynomial import Polynomial
from emsid.models.blocks.static_maps.registry import STATIC_MAPS, register
from emsid.models.blocks.static_maps.static_map import Scaling, StaticMap, closest
from emsid.models.blocks.static_maps.through_points import CubicSpline, PiecewiseLinear
from emsid.models.blocks.static_maps.user import UserMap

for _map in (CubicSpline, PiecewiseLinear, Polynomial, DeadZone, Saturation, CoulombLinear, Abs):
    register(_map)

__all__ = [
    "STATIC_MAPS",
    "Abs",
    "CoulombLinear",
    "CubicSpline",
    "DeadZone",
    "NumberedMap",
    "PiecewiseLinear",
    "Polynomial",
    "Saturation",
    "Scaling",
    "StaticMap",
    "UserMap",
    "closest",
    "register",
]
