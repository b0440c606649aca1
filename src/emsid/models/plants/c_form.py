"""A plant of one mass in C: drive, exact motion with sticking, sensor, as `emsid.models.plants.sampling` has them."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.c_form import CForm, number
from emsid.models.plants.drive import FULL, GAUSS, PIECES
from emsid.models.plants.sampling import OneMassSampler, Outer
from emsid.models.plants.stepping import PlantStepper
from emsid.plant.friction import Level, coulomb_stribeck
from emsid.plant.gaussian_stribeck import gaussian_excess
from emsid.plant.load_friction import either_torque, with_load

Array = NDArray[np.float64]

LEVELS = {
    coulomb_stribeck: "n[0] + n[1] * EXP(-n[2] * speed)",
    gaussian_excess: "n[0] + n[1] * EXP(-(n[2] * speed) * (n[2] * speed))",
    with_load: "n[0] + n[3] * FABS(made - outside) + EXP(-n[2] * speed) * (n[1] + n[4] * FABS(made - outside))",
    either_torque: "n[0] + FABS(n[3] * made - n[4] * outside) + EXP(-n[2] * speed) * (n[1] + FABS(n[5] * made - n[6] "
    "* outside) + (made * outside < K(0.0) ? (FABS(made) > FABS(outside) ? n[8] * outside * outside "
    ": n[7] * made * made) : K(0.0)))",
}
"""The friction laws in C, for the numbers ``n`` of a direction and the forces of the drive and from outside."""

MOTION = """\
static void phi(real r, real h, real *one, real *two)
{
    const real z = r * h;
    if (FABS(z) < K(1e-3)) {
        *one = h * (K(1.0) - z / K(2.0) * (K(1.0) - z / K(3.0) * (K(1.0) - z / K(4.0) * (K(1.0) - z / K(5.0)))));
        *two = h * h / K(2.0)
            * (K(1.0) - z / K(3.0) * (K(1.0) - z / K(4.0) * (K(1.0) - z / K(5.0) * (K(1.0) - z / K(6.0)))));
    } else {
        *one = -EXPM1(-z) / r;
        *two = (h - *one) / r;
    }
}

/* The mean of the force that repeats with position, between x and x + way. */
static real ripple(real x, real way)
{
    real force = K(0.0);
    int n;
    for (n = 0; n < WAVES; ++n) {
        const real k = waves[3 * n];
        const real middle = k * (x + K(0.5) * way);
        const real half = K(0.5) * k * way;
        const real mean = FABS(half) > K(1e-4) ? SIN(half) / half : K(1.0) - half * half / K(6.0);
        force += mean * (waves[3 * n + 1] * COS(middle) + waves[3 * n + 2] * SIN(middle));
    }
    return force;
}

static real against(real speed, int side, real made, real outside)
{
    return level(speed, side, made, outside) + QUADRATIC * speed * speed;
}

/* What the voltage drop takes from a force of the drive. */
static real dropped(real made)
{
    return made > DROP ? DROP : (made < -DROP ? -DROP : made);
}

/* Motion over the time `whole` under a constant force: exact for constant friction, which holds the mass at rest. */
static void move(real drive, real drag, real whole, real *speed, real *position)
{
    real v = *speed;
    real x = *position;
    int step;
    for (step = 0; step < STEPS; ++step) {
        real left = whole / (real)STEPS;
        while (left > K(0.0)) {
            real net = drive - ripple(x, K(0.0));
            real made = drive + LOAD - drag * v;
            real outside = net - drive - LOAD;
            real lost = dropped(made);
            const int side = (v > K(0.0) || (v >= K(0.0) && net > lost)) ? 0 : 1;
            const real direction = side == 0 ? K(1.0) : -K(1.0);
            const int stands = !(v > K(0.0) || v < K(0.0));
            const real r = (drag + viscous[side]) / MASS;
            real a;
            real first;
            real second;
            real pull;
            real after;
            real time;
            if (stands && FABS(net - lost) <= level(K(0.0), side, made - lost, outside)) {
                break;
            }
            if (varies[side]) {
                real middle;
                a = (net - lost - direction * against(FABS(v), side, made - lost, outside)) / MASS;
                middle = above(direction * (v + (a - r * v) * (left / (K(2.0) + K(0.5) * r * left))));
                net = drive - ripple(x, direction * middle * left);
                made = drive + LOAD - drag * direction * middle;
                outside = net - drive - LOAD;
                lost = dropped(made);
                a = (net - lost - direction * against(middle, side, made - lost, outside)) / MASS;
            } else {
                a = (drive - direction * breakaway[side]) / MASS;
            }
            phi(r, left, &first, &second);
            pull = a - r * v;
            after = v + pull * first;
            if (direction * after > K(0.0)) {
                x += v * left + pull * second;
                v = after;
                break;
            }
            if (stands) {
                break;
            }
            time = FABS(r * left) > K(1e-9) ? LOG1P(-r * v / a) / r : -v / a;
            time = time < left ? time : left;
            phi(r, time, &first, &second);
            x += v * time + pull * second;
            v = K(0.0);
            left -= time;
        }
    }
    *speed = v;
    *position = x;
}
"""

ZONED = """\
static real zoned(real value)
{
    return ZONE_RIGHT * above(value - ZONE_END) - ZONE_LEFT * above(ZONE_BEGIN - value);
}
"""

SENSE = """\
/* The reading of a speed or a position; kept has the last position and the state of the lag. */
static real sense(real value, int mean_of, real position, real *kept)
{
    if (mean_of && AVERAGE > K(0.0)) {
        const real mean = isnan(kept[0]) ? value : (position - kept[0]) / DT;
        value = AVERAGE * mean + (K(1.0) - AVERAGE) * value;
    }
    if (LAGS) {
        const real reading = LAG_NOW * value + kept[1];
        kept[1] = LAG_BEFORE * value + LAG_STAYS * reading;
        value = reading;
    }
    kept[0] = position;
    return value / RATIO + SENSOR_OFFSET;
}
"""

ROW = """\
static real row_at(const real *rows, real at)
{
    const real floored = FLOOR(at);
    const real part = at - floored;
    const int below = (int)floored;
    const int here = below < 0 ? 0 : (below > ROWS - 1 ? ROWS - 1 : below);
    const int next = below + 1 < 0 ? 0 : (below + 1 > ROWS - 1 ? ROWS - 1 : below + 1);
    return (K(1.0) - part) * rows[here] + part * rows[next];
}
"""


def c_form(stepper: PlantStepper) -> CForm:
    """The form in C of a plant of one mass, from where its stepper is.

    Raises:
        ModelError: for equations of a user, codes among its commands, or a friction law that has no form in C.
    """
    sampler, name = stepper.sampler, stepper.model.name
    if not isinstance(sampler, OneMassSampler):
        raise ModelError(
            f"{name} has equations of a user, which have no form in C; identify another plant, or a regression or "
            "feedback model"
        )
    outer, inside, friction, steps, law = sampler.numbers
    if len(outer.codes):
        raise ModelError(f"{name} has codes among its commands, which have no form in C")
    rows, motion, sensed, count = sampler.arrays
    width = friction.numbers.shape[1]
    scalars = {
        "MASS": inside.mass,
        "QUADRATIC": float(friction.quadratic),
        "LOAD": float(friction.load),
        "DROP": float(friction.drop),
    }
    whole = {"STEPS": steps, "ROWS": len(rows), "WAVES": len(friction.waves)}
    numbers, level = defines(scalars, whole, inside.zone, outer), level_of(name, law, width)
    functions = f"{numbers}\n{level}\n{MOTION}\n{ZONED}\n{around(outer)}"
    constants = (
        ("law", friction.numbers.ravel()),
        ("breakaway", friction.breakaway),
        ("varies", friction.varies.astype(np.int64)),
        ("viscous", friction.viscous),
        ("waves", friction.waves.ravel() if len(friction.waves) else np.zeros(3)),
    )
    state = (
        ("volts", rows[:, 0].copy()),
        ("conducts", rows[:, 1].copy()),
        ("motion", motion),
        ("sensed", sensed.ravel()),
        ("begun", count.astype(float)),
    )
    return CForm(1, len(outer.signals), state, _step(outer, inside), constants, functions)


def defines(scalars: Mapping[str, float], whole: Mapping[str, int], zone: Array, outer: Outer) -> str:
    """Numbers as macros: those of a plant, real and whole, and those of its dead zone and of its sensor."""
    lag, now, before, stays = outer.sensor[3:7].tolist()
    names = ("ZONE_BEGIN", "ZONE_END", "ZONE_LEFT", "ZONE_RIGHT")
    real = {
        **scalars,
        **dict(zip(names, zone[:4].tolist(), strict=True)),
        "DT": outer.timing[0],
        **dict(zip(("RATIO", "SENSOR_OFFSET", "AVERAGE"), outer.sensor[:3].tolist(), strict=True)),
        "LAG_NOW": now,
        "LAG_BEFORE": before,
        "LAG_STAYS": stays,
    }
    texts = {**{key: number(value) for key, value in real.items()}, **whole, "LAGS": int(lag > 0)}
    return "".join(f"#define {key} {value}\n" for key, value in texts.items())


def around(outer: Outer) -> str:
    """The functions of the sensor and of the drive."""
    return f"{SENSE}\n{_apply(outer)}" + (f"\n{ROW}" if outer.straight else "")


def level_of(name: str, law: Level, width: int, which: str = "") -> str:
    """The level of a law as a function of speed, side, and the forces of the drive and from outside.

    Args:
        name: of the plant, for messages.
        law: the friction law.
        width: how many numbers it has in a direction.
        which: ends the names of the function and of the table of its numbers.

    Raises:
        ModelError: for a law that has no form in C.
    """
    if law not in LEVELS:
        raise ModelError(f"the friction law of {name} has no form in C; add it to LEVELS")
    return (
        f"static real level{which}(real speed, int side, real made, real outside)\n{{\n"
        f"    const real *n = law{which} + {width} * side;\n    (void)made;\n    (void)outside;\n"
        f"    return {LEVELS[law]};\n}}\n"
    )


def _apply(outer: Outer) -> str:
    """The drive in C: voltage or force, and the conducting part of a sample."""
    gain, offset, knee, beyond, supply, loss, rise, freewheel = outer.drive.tolist()
    lines = [f"    real voltage = {number(gain)} * (command + {number(offset)});", "    *conducts = K(1.0);"]
    if isfinite(knee):
        clipped = (
            f"(voltage > {number(knee)} ? {number(knee)} : (voltage < {number(-knee)} ? {number(-knee)} : voltage))"
        )
        lines.append(f"    voltage += {number(beyond - 1.0)} * (voltage - {clipped});")
    if isfinite(supply):
        earlier, later = GAUSS
        lines += [
            f"    if (FABS(voltage) < {number(FULL * supply)}) {{",
            f"        real left = {number(1.0 - loss)} * voltage;",
            f"        real duty = FABS(left) / {number(supply)};",
            "        real open = duty < K(1.0) ? duty : K(1.0);",
        ]
        if rise > 0.0:
            ratios = [number((1 - each) / (1 + each)) for each in GAUSS]
            lines += [
                "        duty = open;",
                f"        {{\n            const real risen = -EXPM1(-duty / {number(rise)});",
                f"            const real one = {number(1 + earlier)} * LOG1P(risen * {ratios[0]});",
                f"            const real two = {number(1 + later)} * LOG1P(risen * {ratios[1]});",
                f"            const real slope = (one - two) / {number(later - earlier)};",
                f"            const real missing = one + {number(earlier)} * slope;",
                f"            left = sign_of(left) * {number(supply)} * (duty - {number(rise)} * missing);",
                f"            open = duty - {number(rise)} * slope;\n        }}",
            ]
        lines += [
            "        voltage = left;",
            f"        *conducts = K(1.0) - {number(freewheel)} * (K(1.0) - open);",
            "    } else {",
            f"        voltage = voltage > K(0.0) ? {number(supply)} : {number(-supply)};",
            "    }",
        ]
    body = "\n".join([*lines, "    return voltage;"])
    return f"static real applied(real command, real *conducts)\n{{\n{body}\n}}\n"


def _step(outer: Outer, inside: object) -> str:
    """The statements of one step."""
    before, after, braking, viscous, load, per_ampere = (
        number(getattr(inside, name)) for name in ("before", "after", "braking", "viscous", "load", "per_ampere")
    )
    late, zero = float(outer.timing[1]), float(outer.timing[2])
    lines = [
        "    real pull;",
        "    real brake;",
        "    int k;",
        "    for (k = 0; k + 1 < ROWS; ++k) {",
        "        s->volts[k] = s->volts[k + 1];",
        "        s->conducts[k] = s->conducts[k + 1];",
        "    }",
        "    s->volts[ROWS - 1] = applied(u[0], &s->conducts[ROWS - 1]);",
    ]
    if outer.straight:
        lines += [
            "    if (s->begun[0] > K(0.0)) {",
            f"        for (k = 0; k < {PIECES}; ++k) {{",
            f"            const real at = {number(zero - 1.0)} + ((real)k + K(0.5)) / K({float(PIECES)!r});",
            f"            const real force = {after} * zoned({before} * row_at(s->volts, at)) - {load};",
            f"            const real drag = {braking} * row_at(s->conducts, at) + {viscous};",
            f"            move(force, drag, DT / K({float(PIECES)!r}), &s->motion[0], &s->motion[1]);",
            "        }",
            "    }",
            f"    pull = {after} * zoned({before} * row_at(s->volts, {number(zero)}));",
            f"    brake = {braking} * row_at(s->conducts, {number(zero)});",
        ]
    else:
        parts = number(late), number(1.0 - late)
        lines += [
            f"    pull = {parts[0]} * {after} * zoned({before} * s->volts[0])",
            f"        + {parts[1]} * {after} * zoned({before} * s->volts[1]);",
            f"    brake = {braking} * ({parts[0]} * s->conducts[0] + {parts[1]} * s->conducts[1]);",
        ]
    for k, what in enumerate(outer.signals.tolist()):
        if what == 3:
            made = "pull - brake * s->motion[0]"
            lines.append(f"    y[{k}] = ({made} - dropped({made})) / {per_ampere};")
        else:
            value, mean_of = ("s->motion[1]", 0) if what == 0 else ("s->motion[0]", 1)
            lines.append(f"    y[{k}] = sense({value}, {mean_of}, s->motion[1], s->sensed + {2 * k});")
    if not outer.straight:
        for row, part in ((0, late), (1, 1.0 - late)):
            if part > 0:
                force = f"{after} * zoned({before} * s->volts[{row}]) - {load}"
                drag = f"{braking} * s->conducts[{row}] + {viscous}"
                lines.append(f"    move({force}, {drag}, {number(part)} * DT, &s->motion[0], &s->motion[1]);")
    lines += ["    (void)pull;", "    (void)brake;", "    s->begun[0] = K(1.0);"]
    return "\n".join(lines) + "\n"
