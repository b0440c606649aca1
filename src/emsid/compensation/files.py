"""The files of a compensation: the C of the model, the C of its inverse, and a README.

The inverse is in ``NAME_compensation.h`` and ``NAME_compensation.c``, beside the files of the model. Its functions have
no state. They are the same expressions as `Compensation`; in double precision they give its numbers. The inverse of a
static map is a table, interpolated linearly, whose error at the middles of its intervals is stated.

The torque of a brushless motor over its angle also goes into tables: ``NAME_ripple.csv``, and ``NAME_odrive.h`` in the
format of ODrive's firmware 0.5, whose ``cogging_map`` has 3600 values in N·m. The value k is added to the torque while
the position is between k/3600 and (k + 1)/3600 of a turn (``Controller::update`` in ``Firmware/MotorControl/
controller.cpp``, ``Encoder::getCoggingRatio``).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from emsid.compensation.inverse import SERIES, Compensation, inductance_of
from emsid.compensation.map_inverse import MapInverse
from emsid.compensation.torque_ripple import RippleCompensation
from emsid.estimation.fit import Fit
from emsid.exports.assumptions import sentences
from emsid.exports.c99 import helpers_of, macros_of, table
from emsid.exports.verb import c_name, export
from emsid.io.files import together, write_new
from emsid.models.c_form import number
from emsid.models.c_source import INT, REAL, Text, Writer
from emsid.models.plants.brushless import Harmonic
from emsid.models.verbs import as_model
from emsid.plant.friction import of_forces

README = "COMPENSATION.md"
BENCH = """\
RMS error of the true position of a position loop, with the compensation (cascade) and without, on the model's own plant
with encoder, delay and limit; friction and dead zone are as identified and 30 % off. A fixed level is that without the
integral of each direction."""
TARGET = """\
## On the target

Every DT s, with the reference speed of this sample and of the next one in RAD/s, and what the controller adds in the
unit behind the dead zone:

```c
#include "NAME_compensation.h"

error = NAME_at_rest(wanted - position, speed, position - position_before);  /* 0 at rest within a count */
command = NAME_command(NAME_wanted(speed, following, wanted) + controller(error));
```

`controller` is a PI or PID controller. To adapt the level on line, let its integral be one for each direction:

```c
static NAME_compensation_real totals[2];

integral = NAME_integral(totals, gain * DT * error, speed, following);  /* in place of integral += gain * DT * error */
```

- Limit the command to what the drive gives, and stop the integral of the controller while it is limited.
- Stop the integral while `NAME_at_rest` gives 0: otherwise it drives the command to and fro through the dead zone.
- Give the reference speed of the trajectory, not a measured speed: its direction has no noise.
- A friction that changes with temperature and wear is learned by `NAME_integral` in the first seconds of motion in each
  direction; limit both totals to the friction itself.
- Begin with half of what `NAME_wanted` gives and raise it while reversals get smoother. Where the drive runs ahead at a
  reversal, friction is lower than when it was identified, as in a warm drive.
- Identify again when friction has changed by more than 30 %: beyond that nothing here was tried.

The inverse of the dead zone is smoothed up to ZONE, the direction of friction up to SPEED RAD/s (COUNT).

"""


RIPPLE_ON_TARGET = """\
## On the target

Every sample, with the angle of the shaft in rad, as in the log, and the torque in N·m that moves the load:

```c
#include "NAME_compensation.h"

q_current = NAME_current(wanted, d_current, angle);
```

Without these functions, the rows of `NAME_ripple.csv` do the same with a table: multiply the q-current of the
controller by `factor` of the part of the turn in which the angle is, and add `q_current`.

The angle counts from the same place as in the log; an incremental encoder needs its index for that. In single
precision keep it within a turn: a harmonic multiplies the rounding of a large angle.

The current loop must follow the q-current: harmonic n changes at n·ω rad/s at the speed ω. A loop with a bandwidth of B
rad/s leaves n·ω/√(B² + (n·ω)²) of it. Ripple becomes four times smaller up to about ω = B/(4·n); beyond ω = B/n little
is gained.

## ODrive

`NAME_odrive.h` has the cogging in the format of `controller.config.anticogging.cogging_map` of firmware 0.5. That
firmware reads the map with `get_anticogging_value` and has no function that writes it: copy the values into
`cogging_map` in its source, build it, and set `pre_calibrated` and `anticogging_enabled`. The map of firmware 0.6 is
written by its calibration only; there add `torque` of `NAME_ripple.csv` to `input_torque` from outside.
"""


def _on_target(found: Compensation, name: str) -> list[str]:
    """How the functions are called, and what a controller has to do."""
    count = f"what a count of {found.count:.4g} RAD does in a sample" if found.count > 0 else "no encoder was given"
    values = {"DT": f"{found.dt:g}", "ZONE": f"{found.zone_width:.4g}", "SPEED": f"{found.speed_width:.4g}"}
    text = TARGET.replace("COUNT", count).replace("NAME", name)
    for key, value in values.items():
        text = text.replace(key, value)
    return text.replace("RAD", "m" if found.name == "linear-axis" else "rad").splitlines()


def write(
    model: Any,
    found: Compensation | MapInverse | RippleCompensation,
    path: str | os.PathLike[str],
    *,
    name: str | None = None,
    dt: float | None = None,
    single: bool = False,
    force: bool = False,
    more: Mapping[str, str | bytes] | None = None,
    bench: Sequence[str] = (),
) -> list[Path]:
    """Write the model and its compensation as C.

    Args:
        model: the model or fit.
        found: its inverse.
        path: folder.
        name: of files and functions; by default that of the model.
        dt: sample time in s.
        single: single precision.
        force: whether files that exist are replaced.
        more: further files.
        bench: lines of a table with what the compensation reaches, for its README.

    Returns:
        The files that were written.

    Raises:
        ModelError: for a model without a form in C.
        FormatError: where files exist or cannot be written.
    """
    called = c_name(name or as_model(model).name)
    texts, notes = sources(found, called, single=single)
    neglected = 0.0 if isinstance(found, RippleCompensation) else inductance_of(as_model(model))
    if neglected > 0:
        notes = [*notes, f"The inverse neglects the inductance of {neglected:.3g} H; the C of the model has it."]
    notes = [*notes, *sentences(model if isinstance(model, Fit) else None)]
    lines = [f"# {called}: compensation", "", *[f"- {note}" for note in notes], ""]
    if isinstance(found, Compensation):
        lines += [*_on_target(found, called), *(["## On the bench", "", BENCH, "", *bench, ""] if bench else [])]
    if isinstance(found, RippleCompensation):
        lines += RIPPLE_ON_TARGET.replace("NAME", called).splitlines()
        texts |= tables(found, called)
    files: dict[str, str | bytes] = {**texts, README: "\n".join(lines), **(more or {})}
    with together():
        paths = write_new(files, path, force=force)
        return [*export(model, "c99", path, name=called, dt=dt, force=force, single=single), *paths]


POINTS = 513
"""Points of the table of an inverse map: 4 kB in single precision times two."""


def sources(
    found: Compensation | MapInverse | RippleCompensation, name: str, *, single: bool = False
) -> tuple[dict[str, str], list[str]]:
    """The header and the source, and what to know about them.

    Raises:
        ModelError: for a friction law without a form in C, or a map that has no inverse over its range.
    """
    body, declared, notes = (
        _of_map(found, name) if isinstance(found, MapInverse)
        else _of_ripple(found, name) if isinstance(found, RippleCompensation)
        else _of_plant(found, name)
    )  # fmt: skip
    real = f"{name}_compensation_real"
    head = (
        f"/* Made by emsid. */\n#ifndef {name.upper()}_COMPENSATION_H\n#define {name.upper()}_COMPENSATION_H\n\n"
        f'#ifdef __cplusplus\nextern "C" {{\n#endif\n\ntypedef {"float" if single else "double"} {real};\n\n'
        f"{declared.replace('real ', f'{real} ')}\n#ifdef __cplusplus\n}}\n#endif\n\n#endif\n"
    )
    code = (
        f'/* Made by emsid. */\n#include <math.h>\n\n#include "{name}_compensation.h"\n\ntypedef {real} real;\n\n'
        f"#define K(x) {'x##f' if single else 'x'}\n"
        f"{macros_of(body, single=single)}\n{helpers_of(body)}{body}"
    )
    return {f"{name}_compensation.h": head, f"{name}_compensation.c": code}, notes


PLANT = """\
/* The value before the dead zone for the value wanted after it. */
real NAME_dead_zone_inverse(real wanted);

/* The dry friction against a reference that has this speed and the next one a sample later. */
real NAME_friction(real speed, real following);

/* The voltage (force) behind the dead zone that leads from one speed to the next within a sample. */
real NAME_wanted(real speed, real following, real position);

/* The command for a voltage (force) wanted behind the dead zone: feed-forward plus that of the controller. */
real NAME_command(real wanted);

/* The error of a position that a controller counts: 0 where the reference has no speed, the encoder has not moved since
   the sample before, and the error is at most a count; then its integral stands, too. */
real NAME_at_rest(real error, real speed, real moved);

/* The integral of a controller that adapts the level of the friction: totals[0] forward, totals[1] backward, both 0 at
   first; step: what the integral grows by in this sample. */
real NAME_integral(real totals[2], real step, real speed, real following);

/* The command that leads from one reference speed to the next; position matters with cogging or gravity only. */
real NAME_feedforward(real speed, real following, real position);
"""

CODE = """\
static real direction(real middle)
{
    DIRECTION
}

static real level(real speed, int side)
{
    return LEVEL;
}

real NAME_dead_zone_inverse(real wanted)
{
    JUMP
    if (wanted > K(0.0)) {
        return wanted / ZONE_RIGHT + jump * ZONE_END;
    }
    return wanted < K(0.0) ? wanted / ZONE_LEFT - jump * ZONE_BEGIN : K(0.0);
}

real NAME_friction(real speed, real following)
{
    const real middle = K(0.5) * (speed + following);
    const real size = (speed > K(0.0) || speed < K(0.0)) ? FABS(middle) : K(0.0);
    return direction(middle) * (level(size, middle < K(0.0)) + QUADRATIC * size * size);
}

real NAME_wanted(real speed, real following, real position)
{
    const real middle = K(0.5) * (speed + following);
    const real r = (BRAKING + (middle >= K(0.0) ? FORWARD : BACKWARD)) / MASS;
    const real phi = r * DT < SMALL ? DT : -EXPM1(-r * DT) / r;
    real force = MASS * ((following - speed) / phi + r * speed) + NAME_friction(speed, following) + LOAD;
WAVES    return (force + DROP * sign_of(force - BRAKING * middle)) / PER_VOLT;
}

real NAME_command(real wanted)
{
    real volts = NAME_dead_zone_inverse(wanted) / LEFT;
KNEE    return volts / GAIN - OFFSET;
}

real NAME_at_rest(real error, real speed, real moved)
{
    const int rests = !(speed < K(0.0) || speed > K(0.0)) && !(moved < K(0.0) || moved > K(0.0));
    return rests && error <= COUNT && error >= -COUNT ? K(0.0) : error;
}

real NAME_integral(real totals[2], real step, real speed, real following)
{
    const real way = direction(K(0.5) * (speed + following));
    const real forward = K(0.5) * (K(1.0) + way), backward = K(0.5) * (K(1.0) - way);
    const real share = step / (forward * forward + backward * backward);
    totals[0] += share * forward;
    totals[1] += share * backward;
    return forward * totals[0] + backward * totals[1];
}

real NAME_feedforward(real speed, real following, real position)
{
    return NAME_command(NAME_wanted(speed, following, position));
}
"""


def _of_plant(found: Compensation, name: str) -> tuple[str, str, list[str]]:
    inside, zone, friction = found.inside, found.zone, found.friction
    gain, offset, knee, beyond, supply, loss, *_ = found.outer.drive.tolist()
    forward, backward = friction.viscous.tolist()
    values = {
        "DT": found.dt, "MASS": inside.mass, "BRAKING": inside.braking,
        "FORWARD": forward, "BACKWARD": backward, "QUADRATIC": float(friction.quadratic), "LOAD": float(friction.load),
        "PER_VOLT": inside.after * inside.before, "ZONE_BEGIN": zone.b_l, "ZONE_END": zone.b_r, "ZONE_LEFT": zone.m_l,
        "ZONE_RIGHT": zone.m_r, "LEFT": 1.0 - loss, "GAIN": gain, "OFFSET": offset,
        "SMALL": SERIES, "COUNT": found.count, "DROP": float(friction.drop),
    }  # fmt: skip
    defines = "".join(f"#define {key} {number(value)}\n" for key, value in values.items())
    waves = "".join(
        f"    force += {number(c)} * COS({number(k)} * at) + {number(s)} * SIN({number(k)} * at);\n"
        for k, c, s in friction.waves.tolist()
    )
    at = "    const real at = position + K(0.5) * middle * DT;\n" if waves else "    (void)position;\n"
    inner = f"(volts > {number(knee)} ? {number(knee)} : (volts < {number(-knee)} ? {number(-knee)} : volts))"
    bent = f"    volts = {inner} + (volts - {inner}) / {number(beyond)};\n" if isfinite(knee) else ""
    code = CODE.replace("DIRECTION", _jump("middle", found.speed_width, "return {};"))
    code = code.replace("JUMP", _jump("wanted", found.zone_width, "const real jump = {};"))
    writer = Writer()
    code = code.replace(
        "LEVEL", writer.call(of_forces(found.law), Text(REAL, "speed"), friction.numbers, Text(INT, "side"), 0.0, 0.0)
    )
    # C99 wants declarations before the statements that use them; the position enters the force after it is known.
    code = code.replace("    real force =", f"{at if waves else ''}    real force =").replace("WAVES", waves or at)
    code = code.replace("KNEE", bent).replace("NAME", name)
    limit = [f"The drive gives at most {supply:.6g}; the command is not limited here."] if isfinite(supply) else []
    rule = "At standstill friction has the direction of the next reference speed; a reference that stays has none."
    law = "".join(table(each, values) for each, values in writer.tables.items())
    return f"{defines}\n{law}\n{writer.functions}\n{code}", PLANT.replace("NAME", name), [rule, *limit]


RIPPLE = """\
/* The cogging torque in N*m against the motion, at an angle of the shaft in rad. */
real NAME_cogging(real angle);

/* The torque of the currents in N*m that moves the load with the torque that is wanted. */
real NAME_torque(real wanted, real angle);

/* The q-current in A for the torque that is wanted, with a d-current in A. */
real NAME_current(real wanted, real d_current, real angle);
"""
RIPPLE_CODE = """\
real NAME_cogging(real angle)
{
    real sum = K(0.0);
    (void)angle;
COGGING    return sum;
}

real NAME_torque(real wanted, real angle)
{
    real sum = K(1.0);
RIPPLE    return (wanted + NAME_cogging(angle)) / sum;
}

real NAME_current(real wanted, real d_current, real angle)
{
    return NAME_torque(wanted, angle) / (CONSTANT + RELUCTANCE * d_current);
}
"""
TABLE, COGGING_MAP = 720, 3600
"""Points of the table over the angle, two for a degree, and those of ODrive's map."""


def _of_ripple(found: RippleCompensation, name: str) -> tuple[str, str, list[str]]:
    def sums(harmonics: Sequence[Harmonic]) -> str:
        return "".join(
            f"    sum += {number(c)} * COS({number(n)} * angle) + {number(s)} * SIN({number(n)} * angle);\n"
            for n, c, s in harmonics
        )

    code = RIPPLE_CODE.replace("COGGING", sums(found.cogging)).replace("RIPPLE", sums(found.ripple))
    code = code.replace("CONSTANT", number(found.constant)).replace("RELUCTANCE", number(found.reluctance))
    notes = ["Cogging and ripple are the estimates, not ends of their intervals."]
    return code.replace("NAME", name), RIPPLE.replace("NAME", name), notes


def tables(found: RippleCompensation, name: str) -> dict[str, str]:
    """The table over the angle, and that of ODrive's firmware."""
    rows = "".join(",".join(f"{value:.9g}" for value in row) + "\n" for row in found.table(TABLE).tolist())
    values = [f"{value:.7e}f" for value in found.table(COGGING_MAP)[:, 1].tolist()]
    lines = ",\n".join("    " + ", ".join(values[k : k + 8]) for k in range(0, COGGING_MAP, 8))
    return {
        f"{name}_ripple.csv": f"angle [rad],torque [N*m],factor,q_current [A]\n{rows}",
        f"{name}_odrive.h": "/* Made by emsid: controller.config.anticogging.cogging_map of ODrive 0.5, in N*m. */\n"
        f"static const float {name}_cogging_map[{COGGING_MAP}] = {{\n{lines}\n}};\n",
    }


def _jump(x: str, width: float, statement: str) -> str:
    if width == 0:
        return statement.format(f"sign_of({x})")
    inside = f"{x} / {number(width)}"
    return statement.format(f"{inside} > K(1.0) ? K(1.0) : ({inside} < -K(1.0) ? -K(1.0) : {inside})")


MAP = """\
real NAME_map_inverse(real wanted)
{
    int low = 0;
    int high = POINTS_OF_MAP - 1;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (outputs[middle] <= wanted) {
            low = middle;
        } else {
            high = middle;
        }
    }
    if (!(outputs[high] > outputs[low])) {
        return inputs[low];
    }
    return inputs[low] + (inputs[high] - inputs[low]) * (wanted - outputs[low]) / (outputs[high] - outputs[low]);
}
"""


def _of_map(found: MapInverse, name: str) -> tuple[str, str, list[str]]:
    outputs, inputs, error = found.table(POINTS)
    defines = f"#define POINTS_OF_MAP {len(outputs)}\n\n"
    tables = f"{table('outputs', outputs)}\n{table('inputs', inputs)}\n"
    declared = f"/* The input of the static map for its wanted output. */\nreal {name}_map_inverse(real wanted);\n"
    notes = [
        f"The inverse of the map is a table from {outputs[0]:.6g} to {outputs[-1]:.6g}, interpolated linearly with an "
        f"error of at most {error:.2g} of its input between the points, and continued by its end pieces."
    ]
    return f"{defines}{tables}\n{MAP.replace('NAME', name)}", declared, notes
