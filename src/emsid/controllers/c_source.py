"""The cascade in C99, for any plant: ``cascade.h`` and ``cascade.c``, with the gains of one plant in a header.

No heap, no globals, float; ``-DCASCADE_REAL=double`` makes it double. The operations are those of `RunningCascade`.
"""

from __future__ import annotations

from dataclasses import fields
from math import isfinite

from emsid.controllers.cascade import KNOTS, Settings

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

/* The gains, in SI units; u is V, A, N*m or N, as the header with the gains says. */
typedef struct {{
FIELDS}} cascade_settings;

typedef struct {{
    int begun;
    cascade_real before, speed, total, reference, current_total;
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

/* What a reference takes, and the command for a value wanted behind the dead zone. */
cascade_real cascade_feedforward(const cascade_settings *settings, cascade_real speed, cascade_real acceleration);
cascade_real cascade_command(const cascade_settings *settings, cascade_real wanted);

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

static real limited_to(real x, real most)
{
    return x > most ? most : (x < -most ? -most : x);
}

void cascade_reset(cascade_state *state)
{
    state->begun = 0;
    state->before = state->speed = state->total = state->reference = state->current_total = K(0.0);
}

real cascade_feedforward(const cascade_settings *s, real speed, real acceleration)
{
    const real middle = speed + K(0.5) * s->dt * acceleration;
    const real size = (speed < K(0.0) || speed > K(0.0)) ? absolute(middle) : K(0.0);
    const real *table = s->friction[middle < K(0.0) ? 1 : 0];
    const real part = root(size / s->friction_speed);
    const real at = (part < K(1.0) ? part : K(1.0)) * K(CASCADE_KNOTS - 1);
    const int low = (int)at < CASCADE_KNOTS - 2 ? (int)at : CASCADE_KNOTS - 2;
    const real level = table[low] + (at - (real)low) * (table[low + 1] - table[low]);
    real way;
    if (s->speed_width > K(0.0)) {
        way = limited_to(middle / s->speed_width, K(1.0));
    } else {
        way = middle > K(0.0) ? K(1.0) : (middle < K(0.0) ? K(-1.0) : K(0.0));
    }
    return s->per_speed * speed + s->per_acceleration * acceleration + s->load + way * level;
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

real cascade_step(const cascade_settings *s, cascade_state *state, real position, real wanted, real speed,
                  real acceleration)
{
    real moved, away, error, command, limited;
    int stands, near;
    if (!state->begun) {
        state->before = position;
        state->begun = 1;
    }
    moved = position - state->before;
    stands = !(moved < K(0.0) || moved > K(0.0));
    state->speed += s->smoothing * (moved / s->dt - state->speed);
    state->before = position;
    if (s->prefilter < K(1.0)) {
        acceleration = s->prefilter * (speed - state->reference) / s->dt;
        speed = state->reference;
        state->reference += acceleration * s->dt;
    }
    away = s->position > K(0.0) ? wanted - position : K(0.0);
    near = s->position > K(0.0) && !(speed < K(0.0) || speed > K(0.0)) &&
           !(acceleration < K(0.0) || acceleration > K(0.0)) && absolute(away) <= s->band;
    if (near) {
        away = K(0.0);
    }
    error = (near && stands) ? K(0.0) : speed + s->position * away - state->speed;
    command = cascade_feedforward(s, speed, acceleration) + s->proportional * error + state->total;
    if (s->current_dt > K(0.0)) {
        limited = limited_to(command, s->current_limit);
    } else {
        command = cascade_command(s, command);
        limited = limited_to(command, s->limit);
    }
    if (absolute(command) <= absolute(limited) || error * command < K(0.0)) {
        state->total += s->integral * s->dt * error;
    }
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
        f"    cascade_real {row}{'[2][CASCADE_KNOTS]' if row == 'friction' else ''};{_padded(units[row])}\n"
        for row in rows
    ).replace(f"/* {unit}", "/* u")
    values = "".join(f"    .{row} = {_literal(getattr(settings, row))},  /* {units[row] or '1'} */\n" for row in rows)
    gains = (
        f"/* Made by emsid: the gains of {name}, in {unit} and {way}. */\n#ifndef {name.upper()}_GAINS_H\n"
        f'#define {name.upper()}_GAINS_H\n\n#include "cascade.h"\n\n'
        f"static const cascade_settings {name}_gains = {{\n{values}}};\n\n#endif\n"
    )
    return {"cascade.h": HEADER.replace("FIELDS", declared), "cascade.c": SOURCE, f"{name}_gains.h": gains}


def _padded(unit: str) -> str:
    return f"  /* {unit} */" if unit else ""


def units_of(unit: str, way: str) -> dict[str, str]:
    """The unit of every setting."""
    speed = f"{way}/s"
    found = dict.fromkeys((each.name for each in fields(Settings)), "")
    return found | {
        "dt": "s", "position": "1/s", "proportional": f"{unit} per {speed}", "integral": f"{unit} per {way}",
        "per_speed": f"{unit} per {speed}", "per_acceleration": f"{unit} per {speed}^2", "load": unit,
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
