"""Linear models beside statsmodels and python-control on the same data: ``python bench/linear.py`` (extra ``bench``).

A Box–Jenkins model without poles of the input is a regression with ARMA errors, which statsmodels fits by exact maximum
likelihood (SARIMAX). Differences are given in standard errors of the estimate. A state-space model is simulated and its
frequency response computed by python-control.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.signal import lfilter

import emsid

warnings.filterwarnings("ignore")  # the peers'
Array = NDArray[np.float64]
SAMPLES = 2000
console = Console(width=120)


def record_of(seed: int = 0) -> emsid.Record:
    """y(t) = u(t − 1) + 0.5 u(t − 2) + 3 + (1 + 0.4q⁻¹)/(1 − 0.8q⁻¹) e(t)."""
    rng = np.random.default_rng(seed)
    u = rng.choice([-1.0, 1.0], SAMPLES)
    noise = lfilter([1.0, 0.4], [1.0, -0.8], rng.standard_normal(SAMPLES))
    return emsid.Record(u, lfilter([0.0, 1.0, 0.5], [1.0], u) + 3.0 + noise, 0.01)


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What a call returns, and its CPU time in s."""
    start = time.process_time()
    result = call()
    return result, time.process_time() - start


def noise_models() -> None:
    """Estimates and standard errors of a regression with ARMA(1, 1) errors."""
    from statsmodels.tsa.statespace.sarimax import SARIMAX

    record = record_of()
    u, y = record.input[:, 0], record.output[:, 0]
    emsid.fit(emsid.box_jenkins(2, 1, 1, 0), record)  # compiles
    own, seconds = timed(lambda: emsid.fit(emsid.box_jenkins(2, 1, 1, 0), record))
    lagged = np.column_stack([u[1:-1], u[:-2]])
    peer, others = timed(lambda: SARIMAX(y[2:], lagged, order=(1, 0, 1), trend="c").fit(disp=0))
    const, b1, b2, ar, ma = peer.params[:5]
    errors = dict(zip(("offset", "b1", "b2", "d1", "c1"), peer.bse[:5], strict=True))
    theirs = {
        "b1": b1,
        "b2": b2,
        "c1": ma,
        "d1": -ar,
        "offset": const / (1 - ar),
    }  # the constant goes through 1/D there
    errors["offset"] = np.nan
    table = Table(
        title=f"Regression with ARMA(1, 1) errors, {SAMPLES:,} samples: emsid {seconds:.3f} s, SARIMAX {others:.2f} s",
        title_justify="left",
    )
    for head in ("", "emsid", "± 1 s.e.", "SARIMAX", "± 1 s.e.", "difference in s.e."):
        table.add_column(head, justify="right" if head else "left")
    for name, value, error in zip(own.names, own.estimate, own.standard_error, strict=True):
        row = value, error, theirs[name], errors[name], (value - theirs[name]) / error
        table.add_row(name, *(f"{number:.4f}" for number in row[:4]), f"{row[4]:.2f}")
    console.print(table)


def control_systems() -> None:
    """The largest differences of a simulation and a frequency response to those of python-control."""
    import control

    u = np.random.default_rng(1).standard_normal((500, 2))
    model = emsid.StateSpaceModel(
        np.array([[0.9, 0.2], [-0.1, 0.7]]),
        np.array([[1.0, 0.0], [0.2, 0.5]]),
        np.array([[1.0, 0.0], [0.5, 2.0]]),
        np.array([[0.0, 0.1], [0.0, 0.0]]),
        np.zeros((2, 2)),
        np.zeros(2),
        0.01,
    )
    system = model.to_control()
    theirs = control.forced_response(system, inputs=u.T).outputs.T
    run = model.run(np.zeros(2), u)[0]
    frequency = np.geomspace(0.05, 50.0, 100)
    answer = control.frequency_response(system, 2 * np.pi * frequency).frdata.transpose(2, 0, 1)
    console.print(
        f"state space beside python-control: free run differs by {np.max(np.abs(run - theirs)):.1e}, "
        f"frequency response by {np.max(np.abs(model.response(frequency) - answer)):.1e}"
    )


if __name__ == "__main__":
    noise_models()
    control_systems()
