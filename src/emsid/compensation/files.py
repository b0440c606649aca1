"""The files of a compensation: the C of the model, the C of its inverse beside it, and a README."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from emsid.compensation.c_source import sources
from emsid.compensation.inverse import Compensation, inductance_of
from emsid.compensation.map_inverse import MapInverse
from emsid.estimation.fit import Fit
from emsid.exports.assumptions import sentences
from emsid.exports.verb import c_name, export
from emsid.io.files import together, write_new
from emsid.models.verbs import as_model

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
    found: Compensation | MapInverse,
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
    neglected = inductance_of(as_model(model))
    if neglected > 0:
        notes = [*notes, f"The inverse neglects the inductance of {neglected:.3g} H; the C of the model has it."]
    notes = [*notes, *sentences(model if isinstance(model, Fit) else None)]
    lines = [f"# {called}: compensation", "", *[f"- {note}" for note in notes], ""]
    if isinstance(found, Compensation):
        lines += [*_on_target(found, called), *(["## On the bench", "", BENCH, "", *bench, ""] if bench else [])]
    files: dict[str, str | bytes] = {**texts, README: "\n".join(lines), **(more or {})}
    with together():
        paths = write_new(files, path, force=force)
        return [*export(model, "c99", path, name=called, dt=dt, force=force, single=single), *paths]
