"""The cascade in C99, for any plant: ``cascade.h`` and ``cascade.c``, with the gains of one plant in a header.

No heap, no globals, float; ``-DCASCADE_REAL=double`` makes it double. The operations are those of `RunningCascade`.
"""

from __future__ import annotations

from dataclasses import fields
from math import isfinite

from emsid.controllers.cascade import KNOTS, LATE, MOST_DELAY, Settings

LARGEST = 3.0e38
"""What stands for infinity in single precision."""

HEADER = f"""\
/* Made by emsid: a cascade of position, speed and current loop. No heap; one cascade_state for every drive. */
#ifndef EMSID_CASCADE_H
#define EMSID_CASCADE_H

#ifdef __cplusplus
extern "C" {{
#endif

#ifndef CASCADE_REAL
#define CASCADE_REAL float
#endif
typedef CASCADE_REAL cascade_real;

#define CASCADE_KNOTS {KNOTS}
#define CASCADE_KEPT {MOST_DELAY + 2} /* commands that are kept, for a delay of {MOST_DELAY} samples at most */

/* The gains, in SI units; u is V, A, N*m or N, as the header with the gains says.
   model: of the observer over a sample: speed left, position per speed, speed and position per u; correction: of
   position, speed and load; notch: b0, b1, b2, a1, a2; waves: of gravity and cogging, each 1/period, cosine, sine. */
typedef struct {{
FIELDS}} cascade_settings;

typedef struct {{
    int begun, rests, latest;
    cascade_real before, shift, speed, load, loads[2], push, wanted, total, reference, notch[2], current_total;
    cascade_real made[CASCADE_KEPT];
}} cascade_state;

/* Begin, with the drive at rest. */
void cascade_reset(cascade_state *state);

/* Once every settings->dt: the command, limited; with a current loop the current for cascade_current.
   position: measured; wanted, speed, acceleration: the reference and its derivatives. */
cascade_real cascade_step(const cascade_settings *settings, cascade_state *state, cascade_real position,
                          cascade_real wanted, cascade_real speed, cascade_real acceleration);

/* Once every settings->current_dt: the command for a wanted current. */
cascade_real cascade_current(const cascade_settings *settings, cascade_state *state, cascade_real wanted,
                             cascade_real current);

/* The command for a value wanted behind the dead zone, and the value that a command gives. */
cascade_real cascade_command(const cascade_settings *settings, cascade_real wanted);
cascade_real cascade_behind(const cascade_settings *settings, cascade_real command);

#ifdef __cplusplus
}}
#endif

#endif
"""

SOURCE = """\
/* Made by emsid. */
#include "cascade.h"

#include <math.h>

typedef cascade_real real;

#define K(x) ((real)(x))

static real absolute(real x)
{
    return x < K(0.0) ? -x : x;
}

static real root(real x)
{
    return sizeof(real) == sizeof(float) ? (real)sqrtf((float)x) : (real)sqrt((double)x);
}

static real wave(real angle, real cosine, real sine)
{
    if (sizeof(real) == sizeof(float)) {
        return (real)((float)cosine * cosf((float)angle) + (float)sine * sinf((float)angle));
    }
    return (real)((double)cosine * cos((double)angle) + (double)sine * sin((double)angle));
}

static real limited_to(real x, real most)
{
    return x > most ? most : (x < -most ? -most : x);
}

void cascade_reset(cascade_state *state)
{
    int k;
    state->begun = state->rests = state->latest = 0;
    state->before = state->shift = state->speed = state->load = state->push = state->wanted = K(0.0);
    state->total = state->reference = K(0.0);
    state->loads[0] = state->loads[1] = state->notch[0] = state->notch[1] = state->current_total = K(0.0);
    for (k = 0; k < CASCADE_KEPT; k++) {
        state->made[k] = K(0.0);
    }
}

/* The direction of the reference when the command acts, and the friction against it. */
static real friction(const cascade_settings *s, real speed, real acceleration, real *level)
{
    const real middle = speed + (s->delay + K(0.5) * s->dt) * acceleration;
    const real size = (speed < K(0.0) || speed > K(0.0)) ? absolute(middle) : K(0.0);
    const real *table = s->friction[middle < K(0.0) ? 1 : 0];
    const real part = root(size / s->friction_speed);
    const real at = (part < K(1.0) ? part : K(1.0)) * K(CASCADE_KNOTS - 1);
    const int low = (int)at < CASCADE_KNOTS - 2 ? (int)at : CASCADE_KNOTS - 2;
    *level = table[low] + (at - (real)low) * (table[low + 1] - table[low]);
    if (s->speed_width > K(0.0)) {
        return limited_to(middle / s->speed_width, K(1.0));
    }
    return middle > K(0.0) ? K(1.0) : (middle < K(0.0) ? K(-1.0) : K(0.0));
}

/* What gravity and cogging take at a reference when the command acts. */
static real waves(const cascade_settings *s, real position, real speed)
{
    const real at = position + (s->delay + K(0.5) * s->dt) * speed;
    real total = K(0.0);
    unsigned k;
    for (k = 0; k < sizeof s->waves / sizeof s->waves[0]; k++) {
        if (absolute(s->waves[k][1]) > K(0.0) || absolute(s->waves[k][2]) > K(0.0)) {
            total += wave(s->waves[k][0] * at, s->waves[k][1], s->waves[k][2]);
        }
    }
    return total;
}

real cascade_command(const cascade_settings *s, real wanted)
{
    real jump = K(1.0);
    if (s->zone_width > K(0.0) && absolute(wanted) < s->zone_width) {
        jump = absolute(wanted) / s->zone_width;
    }
    if (wanted > K(0.0)) {
        wanted = wanted / s->slope_high + jump * s->zone_high;
    } else if (wanted < K(0.0)) {
        wanted = wanted / s->slope_low + jump * s->zone_low;
    }
    return wanted / s->gain - s->offset;
}

real cascade_behind(const cascade_settings *s, real command)
{
    const real volts = s->gain * (command + s->offset);
    const real high = volts - s->zone_high, low = volts - s->zone_low;
    return (high > K(0.0) ? s->slope_high * high : K(0.0)) + (low < K(0.0) ? s->slope_low * low : K(0.0));
}

real cascade_step(const cascade_settings *s, cascade_state *state, real position, real wanted, real speed,
                  real acceleration)
{
    const int follows = s->position > K(0.0), whole = (int)(s->delay / s->dt + K(LATE));
    const real rest = s->delay / s->dt - (real)whole, part = rest > K(0.0) ? rest : K(0.0);
    real moved, away, way, level, resists, dry, found, error, made, raw, command, limited, net;
    int still, near, stands, rests, newest, earlier, k;
    if (!state->begun) {
        state->before = position;
        state->begun = 1;
    }
    moved = position - state->before;
    state->before = position;
    if (s->prefilter < K(1.0)) {
        acceleration = s->prefilter * (speed - state->reference) / s->dt;
        speed = state->reference;
        state->reference += acceleration * s->dt;
    }
    still = !(speed < K(0.0) || speed > K(0.0)) && !(acceleration < K(0.0) || acceleration > K(0.0));
    away = follows ? wanted - position : K(0.0);
    near = follows && still && absolute(away) <= s->band;
    stands = near && absolute(moved) <= K(2.0) * s->band;
    way = friction(s, speed, acceleration, &level);
    resists = way * level;
    rests = still && follows && s->adapt > K(0.0);
    if (rests) {
        const int side = away < K(0.0) ? 1 : 0;
        if (!state->rests || wanted < state->wanted || wanted > state->wanted) {
            level = s->friction[side][0];
            for (k = 1; k < CASCADE_KNOTS; k++) {
                level = s->friction[side][k] < level ? s->friction[side][k] : level;
            }
            state->push = side ? -level : level;
            if (!state->rests) {
                state->load = state->loads[side];
            }
        }
        if (near || away * state->push <= K(0.0)) {
            state->push = K(0.0);
        }
        resists = state->push;
    }
    state->rests = rests;
    state->wanted = wanted;
    dry = resists + s->load + waves(s, follows ? wanted : position, speed);

    /* the observer, corrected by the position */
    found = stands ? K(0.0) : moved - state->shift;
    state->speed = stands ? K(0.0) : state->speed + s->correction[1] * found;
    if (still) {
        state->load -= s->correction[2] * found;
    } else {
        const real forward = K(0.5) * (K(1.0) + s->adapt * way), backward = K(0.5) * (K(1.0) - s->adapt * way);
        const real share = s->correction[2] * found / (forward * forward + backward * backward);
        state->loads[0] -= share * forward;
        state->loads[1] -= share * backward;
        state->load = forward * state->loads[0] + backward * state->loads[1];
    }

    error = stands ? K(0.0) : speed + s->position * (near ? K(0.0) : away) - state->speed;
    raw = s->per_speed * (speed + s->delay * acceleration) + s->per_acceleration * acceleration + dry;
    raw += s->proportional * error + state->total + state->load;
    made = s->notch[0] * raw + state->notch[0];
    state->notch[0] = s->notch[1] * raw - s->notch[3] * made + state->notch[1];
    state->notch[1] = s->notch[2] * raw - s->notch[4] * made;
    command = s->current_dt > K(0.0) ? made : cascade_command(s, made);
    limited = limited_to(command, s->current_dt > K(0.0) ? s->current_limit : s->limit);
    if (absolute(command) > absolute(limited)) {
        made = s->current_dt > K(0.0) ? limited : cascade_behind(s, limited);
    }
    if (absolute(command) <= absolute(limited) || error * command < K(0.0)) {
        state->total += s->integral * s->dt * error;
    }

    /* the observer, over the sample that follows, in which the command of a delay ago acts */
    newest = (state->latest + 1) % CASCADE_KEPT;
    state->latest = newest;
    state->made[newest] = made - dry;
    earlier = (newest + CASCADE_KEPT - whole) % CASCADE_KEPT;
    net = (K(1.0) - part) * state->made[earlier] - state->load;
    net += part * state->made[(earlier + CASCADE_KEPT - 1) % CASCADE_KEPT];
    state->shift = (s->correction[0] - K(1.0)) * found + s->model[1] * state->speed + s->model[3] * net;
    state->speed = s->model[0] * state->speed + s->model[2] * net;
    return limited;
}

real cascade_current(const cascade_settings *s, cascade_state *state, real wanted, real current)
{
    const real error = wanted - current;
    const real command = cascade_command(s, s->current_proportional * error + state->current_total);
    const real limited = limited_to(command, s->limit);
    if (absolute(command) <= absolute(limited) || error * command < K(0.0)) {
        state->current_total += s->current_integral * s->current_dt * error;
    }
    return limited;
}
"""


def sources(settings: Settings, name: str, unit: str, way: str) -> dict[str, str]:
    """``cascade.h`` and ``cascade.c`` for any plant, and ``NAME_gains.h`` for this one.

    Args:
        settings: the gains.
        name: of the gains in C.
        unit: of what the speed loop commands.
        way: rad or m.
    """
    units = units_of(unit, way)
    rows = [each.name for each in fields(Settings)]
    declared = "".join(
        f"    cascade_real {row}{_lengths(getattr(settings, row))};{_padded(units[row])}\n" for row in rows
    ).replace(f"/* {unit}", "/* u")
    values = "".join(f"    .{row} = {_literal(getattr(settings, row))},  /* {units[row] or '1'} */\n" for row in rows)
    gains = (
        f"/* Made by emsid: the gains of {name}, in {unit} and {way}. */\n#ifndef {name.upper()}_GAINS_H\n"
        f'#define {name.upper()}_GAINS_H\n\n#include "cascade.h"\n\n'
        f"static const cascade_settings {name}_gains = {{\n{values}}};\n\n#endif\n"
    )
    return {
        "cascade.h": HEADER.replace("FIELDS", declared),
        "cascade.c": SOURCE.replace("LATE", repr(LATE)),
        f"{name}_gains.h": gains,
    }


def _lengths(value: object) -> str:
    return f"[{len(value)}]{_lengths(value[0])}" if isinstance(value, tuple) else ""


def _padded(unit: str) -> str:
    return f"  /* {unit} */" if unit else ""


def units_of(unit: str, way: str) -> dict[str, str]:
    """The unit of every setting."""
    speed = f"{way}/s"
    found = dict.fromkeys((each.name for each in fields(Settings)), "")
    return found | {
        "dt": "s", "position": "1/s", "proportional": f"{unit} per {speed}", "integral": f"{unit} per {way}",
        "delay": "s", "model": f"1, s, {speed} and {way} per {unit}", "correction": f"1, 1/s, {unit} per {way}",
        "waves": f"1/{way}, {unit}, {unit}", "per_speed": f"{unit} per {speed}",
        "per_acceleration": f"{unit} per {speed}^2", "load": unit,
        "friction": f"{unit}, forward and backward", "friction_speed": speed, "speed_width": speed,
        "zone_low": "V", "zone_high": "V", "zone_width": "V", "gain": "V per unit of the command",
        "offset": "unit of the command", "limit": "unit of the command", "band": way, "current_dt": "s",
        "current_proportional": "V/A", "current_integral": "V/(A*s)", "current_limit": "A",
    }  # fmt: skip


def _literal(value: object) -> str:
    """A number, or the tables of friction, in C."""
    if isinstance(value, tuple):
        return "{" + ", ".join(_literal(each) for each in value) + "}"
    number = float(value)  # type: ignore[arg-type]
    return f"(cascade_real){number if isfinite(number) else LARGEST!r}"


SKETCH = """\
// Made by emsid: the cascade of NAME on a board. Fill in the two functions of your hardware.
#include "NAME_gains.h"

static cascade_state state;

static float read_position(void)
{
    return 0.0f;  // the encoder in WAY: counts * TURN
}

static void write_command(float command)
{
    (void)command;  // to the drive, within +-LIMIT
}

void setup()
{
    cascade_reset(&state);
}

void loop()
{
    static unsigned long next = micros();
    while ((long)(micros() - next) < 0) {
    }
    next += MICROSul;
    const float wanted = 0.0f, speed = 0.0f, acceleration = 0.0f;  // the reference and its derivatives
    write_command(cascade_step(&NAME_gains, &state, read_position(), wanted, speed, acceleration));
}
"""


def sketch(settings: Settings, name: str, way: str, resolution: float) -> str:
    """An Arduino sketch around the cascade; of a cascade with a current loop only its speed and position loop."""
    return (
        SKETCH.replace("NAME", name)
        .replace("WAY", way)
        .replace("TURN", f"{resolution:.9g}f")
        .replace("LIMIT", f"{settings.current_limit if settings.current_dt > 0 else settings.limit:.4g}")
        .replace("MICROS", str(round(settings.dt * 1e6)))
    )
