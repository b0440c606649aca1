r"""The current loop of a brushless motor: gains of its axes for a bandwidth, with the margins of a region.

Every axis has a PI controller whose zero cancels the pole of the winding, Kp = β·L and Ki = β·R. What is left is an
integrator of the gain β behind the delay t_d of reading, computing and holding,

    L(s) = β/s·e^{−s·t_d},      |L/(1 + L)|² = 1/2  at  ω = β·(sin(ω·t_d) + √(1 + sin²(ω·t_d))),

so that the closed loop falls by 3 dB at the wanted ω for this β. Without a delay both are the same.

References:
    Harnefors, Nee, IEEE Trans. Ind. Appl. 34 (1998), on the gains. `emsid.exports.firmware` has the firmware.
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from math import isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np

from emsid.controllers.gains import Row
from emsid.controllers.loops import Margins
from emsid.controllers.region import check_identified, models_of_region
from emsid.controllers.tuning import LEAST, highest, margins_of_winding
from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.exports.assumptions import refuse_assumed
from emsid.exports.firmware import LATE, crossover
from emsid.exports.verb import c_name
from emsid.io.files import indented_json, write_new
from emsid.models.verbs import as_model

WINDING = ("resistance", "inductance_d", "inductance_q")
"""The parameters of a winding with two axes."""


@dataclass(frozen=True)
class CurrentLoop:
    """The PI controllers of the currents of a brushless motor; `current_control` makes it.

    Attributes:
        name: of the model.
        dt: sample time in s.
        delay: from the reading of a current to the middle of the voltage that answers, in s.
        bandwidth: of the closed loop, −3 dB, in Hz.
        wanted_bandwidth: what was asked for in Hz; None for the fastest.
        crossover: β in rad/s, which firmware calls the bandwidth.
        proportional: of the d- and the q-axis in V/A.
        integral: of both in V/(A·s).
        margins: the worst of both axes over the region.
        draws: points of the region of the estimates; 0 for a model without intervals.
        firmware: rows of name, value and unit by firmware.
    """

    name: str
    dt: float
    delay: float
    bandwidth: float
    wanted_bandwidth: float | None
    crossover: float
    proportional: tuple[float, float]
    integral: float
    margins: Margins
    draws: int
    firmware: dict[str, list[Row]]

    @property
    def reduced(self) -> bool:
        """Whether its bandwidth is below what was asked for."""
        return self.wanted_bandwidth is not None and self.bandwidth < (1 - 1e-3) * self.wanted_bandwidth

    def to_data(self) -> dict[str, Any]:
        """Gains and margins in built-in types."""
        rows = {
            name: [{"name": row, "value": value, "unit": unit} for row, value, unit in some]
            for name, some in self.firmware.items()
        }
        return {**asdict(self), "proportional": list(self.proportional), "firmware": rows, "reduced": self.reduced}


def current_control(
    model: Any, *, dt: float | None = None, bandwidth: float | None = None, assume: Any = (), seed: int = 1
) -> CurrentLoop:
    """The current loop of an identified brushless motor.

    The bandwidth is that of the closed loop, −3 dB, as far as a gain margin of 2, a phase margin of 45° and a
    sensitivity of 2 hold for both axes of every motor of the 95 % region of the estimates; else it is reduced.

    Args:
        model: a fit or a model of a brushless motor.
        dt: sample time of the loop in s; by default that of its voltage, the delay of the plant.
        bandwidth: in Hz; by default the largest.
        assume: parameters whose values nobody gave or measured and that may be used.
        seed: of the points on the region.

    Raises:
        ModelError: for another plant, one that is not identified, or targets that the sampling cannot reach.

    >>> import emsid
    >>> motor = emsid.plants.brushless(resistance=0.12, inductance_d=9e-5, inductance_q=1.2e-4)
    >>> found = emsid.controllers.current_control(motor, dt=1e-4, bandwidth=150.0)
    >>> round(found.crossover), [round(each, 4) for each in found.proportional]
    (819, [0.0737, 0.0983])
    """
    subject: Any = as_model(model)
    values: dict[str, float] = getattr(subject, "parameter_values", dict)()
    if not {*WINDING} <= values.keys():
        raise ModelError(
            f"{subject.name} has no current loop of its own, as it is no brushless motor; give position or speed",
            arguments=("loop",),
        )
    step = dt if dt is not None else values["delay"]
    for name, value in (("dt", step), ("bandwidth", bandwidth)):
        if value is not None and not (isfinite(value) and value > 0):
            raise ModelError(f"{name} {value!r}; give a positive number", arguments=(name,))
    if bandwidth is not None and bandwidth > 0.5 / step:
        raise ModelError(
            f"a bandwidth of {bandwidth:g} Hz is above half the sampling frequency, {0.5 / step:g} Hz; ask for less, "
            "or sample faster",
            arguments=("bandwidth", "dt"),
        )
    check_identified(model)
    refuse_assumed(model if isinstance(model, Fit) else None, "control", assume)
    region = models_of_region(model, seed)
    r, d, q = np.array([[each.parameter_values()[name] for name in WINDING] for each in region]).T
    axes = [margins_of_winding(r, each, step) for each in (d, q)]
    late = LATE * step

    def worst(wanted: float) -> Margins:
        beta = crossover(wanted, late)
        return axes[0](beta).worse(axes[1](beta))

    high = pi / step if bandwidth is None else 2 * pi * bandwidth
    if not worst(high).hold(LEAST):
        high = highest(worst, high)
    beta = crossover(high, late)
    gains = (beta * float(d[0]), beta * float(q[0])), beta * float(r[0])
    return CurrentLoop(
        subject.name,
        step,
        late,
        high / (2 * pi),
        bandwidth,
        beta,
        *gains,
        worst(high),
        len(region) - 1,
        _rows(*gains, beta),
    )


def _rows(proportional: tuple[float, float], integral: float, beta: float) -> dict[str, list[Row]]:
    """The settings of every firmware; those with one gain for both axes have the mean."""
    mean = 0.5 * sum(proportional)
    return {
        "SimpleFOC": [
            ("PID_current_d.P", proportional[0], "V/A"),
            ("PID_current_q.P", proportional[1], "V/A"),
            ("PID_current_q.I", integral, "V/(A*s)"),
        ],
        "ODrive": [("motor.config.current_control_bandwidth", beta, "rad/s")],
        "VESC": [("foc_current_kp", mean, "V/A"), ("foc_current_ki", integral, "V/(A*s)")],
        "moteus": [("servo.pid_dq.kp", mean, "V/A"), ("servo.pid_dq.ki", integral, "V/(A*s)")],
    }


def summary(found: CurrentLoop) -> list[str]:
    """Bandwidth, margins and gains, a sentence each."""
    m = found.margins
    asked = f", {found.wanted_bandwidth:.4g} Hz asked for" if found.reduced else ""
    held = f"over {found.draws} points of the 95 % region" if found.draws else "at the estimate; it has no intervals"
    return [
        f"current loop of {found.name}: bandwidth {found.bandwidth:.4g} Hz{asked}, sampled every {found.dt:g} s",
        f"margins {held}: gain {m.gain:.3g}, phase {m.phase:.3g}°, sensitivity {m.sensitivity:.3g}",
        f"gains: d-axis {found.proportional[0]:.4g} V/A, q-axis {found.proportional[1]:.4g} V/A, integral "
        f"{found.integral:.4g} V/(A·s)",
    ]


def write_current(
    found: CurrentLoop, path: str | os.PathLike[str], *, name: str | None = None, force: bool = False
) -> list[Path]:
    """Write ``CONTROL.md``, ``control.json`` and the gains as ``NAME_current.h``.

    Args:
        found: the loop.
        path: folder.
        name: of the gains in C; by default that of the model.
        force: whether files that exist are replaced.

    Raises:
        ModelError: for a name that C cannot hold.
        FormatError: where files exist or cannot be written.
    """
    called = c_name(name or found.name)
    lines = [f"# {called}: current loop", "", *(f"- {each}" for each in summary(found)), ""]
    for firmware, rows in found.firmware.items():
        lines += [f"## {firmware}", "", "| setting | value | unit |", "|---|---|---|"]
        lines += [*(f"| {row} | {value:.6g} | {unit} |" for row, value, unit in rows), ""]
    d, q = found.proportional
    header = f"""\
/* Made by emsid: the current loop of {called}, every {found.dt:g} s. */
#define {called.upper()}_CURRENT_KP_D {d:.9g}f /* V/A */
#define {called.upper()}_CURRENT_KP_Q {q:.9g}f /* V/A */
#define {called.upper()}_CURRENT_KI {found.integral:.9g}f /* V/(A*s) */
"""
    files: dict[str, str | bytes] = {
        "CONTROL.md": "\n".join(lines),
        "control.json": indented_json({"schema": 1, **found.to_data()}),
        f"{called}_current.h": header,
    }
    return write_new(files, path, force=force)
