r"""A plant of one mass as a Modelica model, in continuous time and without a library.

    m·dω/dt = F(u) − (b + b_±)·ω ∓ level_±(|ω|)     while it moves,     ω = 0     while |F| ≤ break-away.

A mode −1, 0 or 1 says whether the mass moves backward, stands or moves forward; events change it where the speed passes
through zero and where the force exceeds break-away, so a tool finds these times as exactly as emsid does.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import Any

from emsid.errors import ModelError
from emsid.exports.formats import Export, Files
from emsid.exports.mechanics import NEUTRAL
from emsid.models.starting import start
from emsid.plant.friction import coulomb_stribeck
from emsid.plant.gaussian_stribeck import gaussian_excess
from emsid.units import plain_unit

LAWS = {coulomb_stribeck: "exp(-{rate}*s)", gaussian_excess: "exp(-({rate}*s)^2)"}
"""How the Stribeck part of a friction law decays with the speed s."""
LEFT_OUT = (
    *("drive.delay", "drive.supply", "drive.loss", "drive.rise", "drive.freewheel", "sensor.lag", "sensor.average"),
)
"""Parameters that this form does not carry."""
WORDS = frozenset(
    """algorithm and annotation block class connect connector constant constrainedby der discrete each else elseif
    elsewhen encapsulated end enumeration equation expandable extends external false final flow for function if import
    impure in initial inner input loop model not operator or outer output package parameter partial protected public
    pure record redeclare replaceable return stream then true type when while within time""".split()  # noqa: SIM905
)
"""Words of Modelica that are no names."""


def modelica(export: Export) -> tuple[Files, list[str]]:
    """The model as a file.

    Raises:
        ModelError: for a model that is no plant of one mass, a friction law that has no form in Modelica, or a name
            that is a word of Modelica.
    """
    if export.name in WORDS:
        raise ModelError(f"{export.name!r} is a word of Modelica; give another name", arguments=("name",))
    plant: Any = getattr(export.model, "plant", None)
    sampler: Any = getattr(start(export.model, dt=export.dt or 1e-3), "sampler", None)
    if not getattr(sampler, "of_one_mass", False):
        raise ModelError(
            f"{export.model.name} is no plant of one mass, which alone has a form in Modelica; export it as fmu"
        )
    outer, inside, friction, _, law = sampler.numbers
    if law not in LAWS or len(outer.codes):
        raise ModelError(f"the friction law or the drive of {export.model.name} has no form in Modelica")
    begin = float(sampler.arrays[1][1])
    text = _text(export, plant, (outer, inside, friction), LAWS[law], begin)
    return {f"{export.name}.mo": text}, _notes(plant)


def _notes(plant: Any) -> list[str]:
    """Sentences on the parameters with an effect that are not carried."""
    neutral = NEUTRAL | {"drive.supply": inf}
    found = []
    for name in LEFT_OUT:
        if name in plant.handles and (value := float(plant.value(name))) != neutral.get(name, 0.0):
            unit = plain_unit(plant.handles[name].parameter.unit)
            found.append(f"{name} = {value:.4g}{f' {unit}' if unit else ''} is not carried.")
    return found


def _text(export: Export, plant: Any, numbers: tuple[Any, Any, Any], decay: str, begin: float) -> str:
    """The model from the numbers of its drive and sensor, of its inside and of its friction, and its first position."""
    outer, inside, friction = numbers
    turns = "motor_constant" in plant.handles
    place, speed, force = ("rad", "rad/s", "N.m") if turns else ("m", "m/s", "N")
    names = ["y"] if len(outer.signals) == 1 else [f"y{k + 1}" for k in range(len(outer.signals))]
    lines = [
        *_parameters(inside, friction, turns),
        '  input Real u "command";',
        *(f'  output Real {name} "measured";' for name in names),
        f'  Real x(start={begin!r}, fixed=true, unit="{place}") "position";',
        f'  Real w(start=0.0, fixed=true, unit="{speed}") "speed";',
        '  Integer mode(start=0, fixed=true) "1 forward, 0 at rest, -1 backward";',
        "protected",
        "  Real v, z, s;",
        *(f'  Real {name}(unit="{force}");' for name in ("pull", "net", "resisting")),
        "equation",
        *_drive(outer, inside),
        *_motion(inside, friction, decay),
        *_sensor(outer, inside, friction, names),
    ]
    return "\n".join([f'model {export.name} "identified by emsid"', *lines, f"end {export.name};", ""])


def _parameters(inside: Any, friction: Any, turns: bool) -> list[str]:
    """The declarations of the parameters."""
    mass, per_speed, force = ("kg.m2", "N.m.s/rad", "N.m") if turns else ("kg", "N.s/m", "N")
    slowness = "s/rad" if turns else "s/m"
    rows = [("mass", mass, inside.mass, "inertia"), ("drag", per_speed, inside.braking, "drag")]
    for side, way in enumerate(("forward", "backward")):
        level, excess, rate = [*friction.numbers[side].tolist(), 0.0, 0.0][:3]
        rows += [
            (f"level_{way}", force, level, f"dry friction {way}"),
            (f"excess_{way}", force, excess, f"dry friction at rest beyond it, {way}"),
            (f"rate_{way}", slowness, rate, "how it decays with the speed"),
            (f"breakaway_{way}", force, friction.breakaway[side], f"break-away {way}"),
            (f"viscous_{way}", per_speed, friction.viscous[side], f"viscous friction {way}"),
        ]
    return [f'  parameter Real {name}(unit="{unit}") = {float(value)!r} "{what}";' for name, unit, value, what in rows]


def _drive(outer: Any, inside: Any) -> list[str]:
    """The equations from the command to the force at rest."""
    gain, offset, knee, beyond = outer.drive[:4].tolist()
    begin, end, left, right = inside.zone.tolist()
    applied = f"{gain!r}*(u + ({offset!r}))"
    clipped = f" + ({beyond - 1.0!r})*({applied} - min(max({applied}, {-knee!r}), {knee!r}))" if isfinite(knee) else ""
    return [
        f"  v = {applied}{clipped};",
        f"  z = {inside.before!r}*v;",
        f"  pull = {inside.after!r}*({right!r}*max(z - ({end!r}), 0.0) - {left!r}*max({begin!r} - z, 0.0));",
    ]


def _motion(inside: Any, friction: Any, decay: str) -> list[str]:
    """The equations of the mass and its friction."""
    waves = "".join(f" - (({c!r})*cos({k!r}*x) + ({s!r})*sin({k!r}*x))" for k, c, s in friction.waves.tolist())
    forward, backward = (
        f"level_{way} + excess_{way}*{decay.format(rate=f'rate_{way}')} + {float(friction.quadratic)!r}*s^2 "
        f"+ viscous_{way}*s"
        for way in ("forward", "backward")
    )
    return [
        f"  net = pull - ({float(friction.load)!r}){waves}{_lost(inside, friction)};",
        "  s = abs(w);",
        f"  resisting = if mode == 1 then {forward}",
        f"    else {backward};",
        "  der(x) = w;",
        "  der(w) = if mode == 0 then 0.0 else (net - drag*w - mode*resisting)/mass;",
        "  mode = if pre(mode) == 1 and w >= 0.0 then 1 elseif pre(mode) == -1 and w <= 0.0 then -1",
        "    elseif net > breakaway_forward then 1 elseif net < -breakaway_backward then -1 else 0;",
    ]


def _lost(inside: Any, friction: Any) -> str:
    """The term of the force that a voltage drop takes; empty without one."""
    drop = float(friction.drop)
    return f" - min(max(pull - {inside.braking!r}*w, {-drop!r}), {drop!r})" if drop else ""


def _sensor(outer: Any, inside: Any, friction: Any, names: list[str]) -> list[str]:
    """The equations of what is measured."""
    ratio, shift = outer.sensor[:2].tolist()
    current = f"(pull - {inside.braking!r}*w{_lost(inside, friction)})/{inside.per_ampere!r}"
    read = {0: f"x/{ratio!r} + ({shift!r})", 3: current}
    other = f"w/{ratio!r} + ({shift!r})"
    return [f"  {name} = {read.get(what, other)};" for name, what in zip(names, outer.signals.tolist(), strict=True)]
