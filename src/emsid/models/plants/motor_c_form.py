"""A plant in C, with a shaft or an inductance too: that of one mass is in `emsid.models.plants.c_form`.

The state of a motor is current, speeds of rotor and load, twist and angle. emsid moves it by Taylor series of any order
between events; the form in C by Runge–Kutta steps of order four of a fixed length, `PER_TIME_CONSTANT` to the
shortest time constant. A step in which a speed passes through zero, or the torque on a body that is held exceeds
break-away, or rotor and load touch or part, is cut there by the secant method.
"""

from __future__ import annotations

from math import ceil, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.c_form import CForm, number
from emsid.models.plants import c_form as one_mass
from emsid.models.plants.drive import PIECES
from emsid.models.plants.sampling import LaggingSampler, MotorSampler
from emsid.models.plants.stepping import PlantStepper
from emsid.plant.constants import Constants

Array = NDArray[np.float64]
PER_TIME_CONSTANT, LEAST = 20, 4
"""Steps to the shortest time constant, and in a sample: the free run of motors through stops and reversals is then
within 4·10⁻⁵ of its deviation, with half as many within 1.4·10⁻⁴, measured; with backlash, whose impacts multiply
errors, within 10⁻³. The form in emsid takes Stribeck friction beside an inductance in two steps in a sample: 4·10⁻⁴."""
MOST_STEPS = 1_000
"""Steps in a sample that a board may take; a shaft that needs more is as good as rigid."""

MOTION = """\
static real shaft_torque(const real *x)
{
    const real beyond = x[3] > GAP ? x[3] - GAP : (x[3] < -GAP ? x[3] + GAP : K(0.0));
    const int apart = GAP > K(0.0) && !(beyond > K(0.0) || beyond < K(0.0));
    return RIGID || apart ? K(0.0) : STIFFNESS * beyond + DAMPING * (x[1] - x[2]);
}

static real current_of(const real *x, real volts)
{
    return INDUCTANCE > K(0.0) ? x[0] : (volts - CONSTANT * x[1]) / RESISTANCE;
}

/* The torque that repeats with the angle of a body. */
static real ripple(int body, real angle)
{
    real torque = K(0.0);
    int n;
    for (n = 0; n < WAVES; ++n) {
        const real *w = waves + 4 * n;
        if ((int)w[0] == body) {
            torque += w[2] * COS(w[1] * angle) + w[3] * SIN(w[1] * angle);
        }
    }
    return torque;
}

/* For rotor and load the torque that drives it, the one from outside, and all that acts besides friction; the same for
   both where the shaft is rigid. */
static void torques(const real *x, real volts, real *made, real *outside, real *net)
{
    const real torque = CONSTANT * current_of(x, volts);
    const real shaft = shaft_torque(x);
    const real own = ripple(0, x[4] + x[3]);
    made[0] = WITHIN * torque + RIGHT * above(torque - EDGE_RIGHT) - LEFT * above(EDGE_LEFT - torque);
    made[1] = shaft;
    outside[0] = -shaft - own;
    outside[1] = -LOAD - ripple(1, x[4]);
    net[0] = made[0] + outside[0] - viscous[0] * x[1];
    net[1] = made[1] + outside[1] - viscous[1] * x[2] - QUADRATIC * x[2] * FABS(x[2]);
    if (RIGID) {
        made[1] = made[0];
        outside[0] = outside[1] - own;
        outside[1] = outside[0];
        net[0] += net[1];
        net[1] = net[0];
    }
}

/* The friction on a body that slides, or begins to; of both where the shaft is rigid. */
static real friction(int body, int way, const real *x, const real *made, const real *outside)
{
    const int side = way < 0 ? 1 : 0;
    real level = K(0.0);
    if (body == 0) {
        level += level_0((real)way * x[1], side, made[0], outside[0]);
    }
    if (body == 1 || RIGID) {
        level += level_1((real)way * x[2], side, made[1], outside[1]);
    }
    return level;
}

static void slopes(const real *x, const int *way, real volts, real *d)
{
    real made[2];
    real outside[2];
    real net[2];
    torques(x, volts, made, outside, net);
    d[0] = INDUCTANCE > K(0.0) ? (volts - RESISTANCE * x[0] - CONSTANT * x[1]) * PER_HENRY : K(0.0);
    if (RIGID) {
        net[0] -= (real)way[0] * friction(0, way[0], x, made, outside);
        d[1] = way[0] ? net[0] / (inertia[0] + inertia[1]) : K(0.0);
        d[2] = d[1];
    } else {
        d[1] = way[0] ? (net[0] - (real)way[0] * friction(0, way[0], x, made, outside)) / inertia[0] : K(0.0);
        d[2] = way[1] ? (net[1] - (real)way[1] * friction(1, way[1], x, made, outside)) / inertia[1] : K(0.0);
    }
    d[3] = x[1] - x[2];
    d[4] = x[2];
}

static void stepped(const real *x, const int *way, real volts, real h, real *out)
{
    static const real parts[4] = {K(0.0), K(0.5), K(0.5), K(1.0)};
    static const real weights[4] = {K(1.0), K(2.0), K(2.0), K(1.0)};
    real d[5] = {K(0.0), K(0.0), K(0.0), K(0.0), K(0.0)};
    real sum[5] = {K(0.0), K(0.0), K(0.0), K(0.0), K(0.0)};
    int k;
    int j;
    for (k = 0; k < 4; ++k) {
        for (j = 0; j < 5; ++j) {
            out[j] = x[j] + parts[k] * h * d[j];
        }
        slopes(out, way, volts, d);
        for (j = 0; j < 5; ++j) {
            sum[j] += weights[k] * d[j];
        }
    }
    for (j = 0; j < 5; ++j) {
        out[j] = x[j] + h / K(6.0) * sum[j];
    }
}

/* The direction of each body: it slides, is held, or begins to slide. */
static void ways(const real *x, real volts, int *way)
{
    real made[2];
    real outside[2];
    real net[2];
    int body;
    torques(x, volts, made, outside, net);
    for (body = 0; body < 2; ++body) {
        const int of = RIGID ? 0 : body;
        const real v = x[1 + body];
        way[body] = (v > K(0.0)) - (v < K(0.0));
        if (way[body] == 0) {
            way[body] = (net[body] > friction(of, 1, x, made, outside))
                - (net[body] < -friction(of, -1, x, made, outside));
        }
    }
}

/* What is left until a body that slides stands, or until the torque on one that is held exceeds break-away; of a third
   one, until rotor and load touch or part. */
static real margin(const real *x, const int *way, real volts, int body)
{
    real made[2];
    real outside[2];
    real net[2];
    if (body > 1) {
        return FABS(x[3]) - GAP;
    }
    if (way[body] != 0) {
        return (real)way[body] * x[1 + body];
    }
    torques(x, volts, made, outside, net);
    return friction(body, net[body] > K(0.0) ? 1 : -1, x, made, outside) - FABS(net[body]);
}

/* The part of a step until the first event, which changes the motion of a body; all of it where there is none. */
static real until(const real *x, const int *way, real volts, real h, int *changes)
{
    real least = h;
    int body;
    *changes = -1;
    for (body = 0; body < (RIGID ? 1 : (GAP > K(0.0) ? 3 : 2)); ++body) {
        real out[5];
        real low = K(0.0);
        real high = h;
        const real first = margin(x, way, volts, body);
        const real turned = body > 1 && first < K(0.0) ? -K(1.0) : K(1.0);
        real before = turned * first;
        real after;
        int k;
        stepped(x, way, volts, h, out);
        after = turned * margin(out, way, volts, body);
        if (!(before > K(0.0) && after < K(0.0))) {
            continue;
        }
        for (k = 0; k < SECANTS && before > K(0.0); ++k) {
            const real middle = low + (high - low) * before / (before - after);
            real now;
            stepped(x, way, volts, middle, out);
            now = turned * margin(out, way, volts, body);
            if (now < K(0.0)) {
                high = middle;
                after = now;
            } else {
                low = middle;
                before = now;
            }
        }
        if (high < least) {
            least = high;
            *changes = body;
        }
    }
    return least;
}

static void move_motor(real command, real whole, real *x)
{
    const real volts = zoned(command);
    const int count = whole < DT ? (int)((real)STEPS * whole / DT) + 1 : STEPS;
    real out[5];
    int way[2];
    int step;
    int j;
    for (step = 0; step < count; ++step) {
        real left = whole / (real)count;
        int cut;
        for (cut = 0; cut < CUTS && left > K(0.0); ++cut) {
            int changes = -1;
            real part = left;
            ways(x, volts, way);
            if (cut + 1 < CUTS) {
                part = until(x, way, volts, left, &changes);
            }
            stepped(x, way, volts, part, out);
            for (j = 0; j < 5; ++j) {
                x[j] = out[j];
            }
            if ((changes == 0 || changes == 1) && way[changes] != 0) {
                x[1 + changes] = K(0.0);
                if (RIGID) {
                    x[2] = K(0.0);
                }
            }
            left -= part;
        }
    }
    x[0] = current_of(x, volts);
}
"""


def c_form(stepper: PlantStepper) -> CForm:
    """The form in C of a plant, from where its stepper is.

    Raises:
        ModelError: for equations of a user, a bridge that coasts or codes among the commands, a shaft that needs too
            small a step, or a friction law that has no form in C.
    """
    sampler, name = stepper.sampler, stepper.model.name
    if isinstance(sampler, LaggingSampler):
        sampler = sampler.as_motor()
    if not isinstance(sampler, MotorSampler):
        return one_mass.c_form(stepper)
    outer, m, rest, laws = sampler.numbers
    zone, load, stiff = rest[:4], float(rest[4]), bool(rest[9] > 0)
    freewheel = float(outer.drive[7])
    if len(outer.codes) or freewheel > 0:
        raise ModelError(f"{name} has codes among its commands or a bridge that coasts, which have no form in C here")
    dt = float(outer.timing[0])
    steps = max(LEAST, ceil(PER_TIME_CONSTANT * dt * fastest(m)))
    if steps > MOST_STEPS:
        raise ModelError(
            f"{name} needs {steps} steps in a sample, and has no form in C; identify it with a rigid shaft or without "
            "inductance, or with a smaller sample time"
        )
    rows, motion, sensed, count = sampler.arrays
    if stiff:
        motion[1], motion[3] = motion[2], 0.0
    state = (
        ("volts", rows[:, 0].copy()),
        ("motion", motion),
        ("sensed", sensed.ravel()),
        ("begun", count.astype(float)),
    )
    defines = one_mass.defines(_scalars(m, load), _whole(m, steps, len(rows)), zone, outer)
    levels = (one_mass.level_of(name, law, m.friction.shape[2], f"_{k}") for k, law in enumerate(laws))
    functions = "\n".join([defines, one_mass.ZONED, *levels, MOTION, one_mass.around(outer)])
    note = f"A sample is passed in {steps} steps of {dt / steps:.3g} s; emsid takes steps of its own length."
    return CForm(1, len(outer.signals), state, _step(outer), _tables(m), functions, (note,))


def fastest(m: Constants) -> float:
    """The fastest rate of a motor in 1/s: of its current, of its shaft, or of its speed."""
    inertia = m.inertia
    whole = float(inertia.sum())
    rates = [float(m.viscous.sum()) / whole]
    if m.inductance > 0:
        rates.append(m.resistance / m.inductance)
        rates.append(m.motor_constant / sqrt(m.inductance * (whole if m.rigid else float(inertia[0]))))
    else:
        rates.append(m.motor_constant**2 / m.resistance / (whole if m.rigid else float(inertia[0])))
    if not m.rigid:
        share = float((1 / inertia).sum())
        rates += [sqrt(m.stiffness * share), m.damping * share]
    return max(rates)


def _scalars(m: Constants, load: float) -> dict[str, float]:
    """The real numbers of a motor, for macros."""
    bounded = bool(np.isfinite(m.edge).all())
    return {
        "RESISTANCE": m.resistance,
        "INDUCTANCE": m.inductance,
        "PER_HENRY": 1 / m.inductance if m.inductance > 0 else 0.0,
        "CONSTANT": m.motor_constant,
        "STIFFNESS": m.stiffness,
        "DAMPING": m.damping,
        "GAP": m.gap,
        "LOAD": load,
        "QUADRATIC": m.quadratic,
        "WITHIN": float(m.slope[1]),
        "LEFT": float(m.slope[0]) if bounded else 0.0,
        "RIGHT": float(m.slope[2]) if bounded else 0.0,
        "EDGE_LEFT": float(m.edge[0]) if bounded else 0.0,
        "EDGE_RIGHT": float(m.edge[1]) if bounded else 0.0,
    }


def _whole(m: Constants, steps: int, rows: int) -> dict[str, int]:
    """The whole numbers of a motor, for macros."""
    return {"RIGID": int(m.rigid), "STEPS": steps, "ROWS": rows, "WAVES": len(m.waves), "SECANTS": 4, "CUTS": 8}


def _tables(m: Constants) -> tuple[tuple[str, Array], ...]:
    """The arrays of a motor, by body and direction."""
    return (
        ("inertia", m.inertia),
        ("viscous", m.viscous),
        ("law_0", m.friction[0].ravel()),
        ("law_1", m.friction[1].ravel()),
        ("waves", m.waves.ravel() if len(m.waves) else np.zeros(4)),
    )


def _step(outer: Any) -> str:
    """The statements of one step."""
    late, zero = float(outer.timing[1]), float(outer.timing[2])
    lines = [
        "    real conducts;",
        "    int k;",
        "    for (k = 0; k + 1 < ROWS; ++k) {",
        "        s->volts[k] = s->volts[k + 1];",
        "    }",
        "    s->volts[ROWS - 1] = applied(u[0], &conducts);",
    ]
    if outer.straight:
        lines += [
            "    if (s->begun[0] > K(0.0)) {",
            f"        for (k = 0; k < {PIECES}; ++k) {{",
            f"            const real at = {number(zero - 1.0)} + ((real)k + K(0.5)) / K({float(PIECES)!r});",
            f"            move_motor(row_at(s->volts, at), DT / K({float(PIECES)!r}), s->motion);",
            "        }",
            "    }",
        ]
    for k, what in enumerate(outer.signals.tolist()):
        if what == 3:
            lines.append(f"    y[{k}] = s->motion[0];")
            continue
        value, mean_of, place = {
            0: ("s->motion[4]", 0, "s->motion[4]"),
            1: ("s->motion[2]", 1, "s->motion[4]"),
            2: ("s->motion[1]", 1, "s->motion[4] + s->motion[3]"),
        }[what]
        lines.append(f"    y[{k}] = sense({value}, {mean_of}, {place}, s->sensed + {2 * k});")
    if not outer.straight:
        for row, part in ((0, late), (1, 1.0 - late)):
            if part > 0:
                lines.append(f"    move_motor(s->volts[{row}], {number(part)} * DT, s->motion);")
    return "\n".join([*lines, "    (void)conducts;", "    s->begun[0] = K(1.0);"]) + "\n"
