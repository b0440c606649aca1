"""Linear models beside other programs on the same data: ``python bench/linear.py`` (extra ``bench``).

A Box–Jenkins model without poles of the input is a regression with ARMA errors, which statsmodels fits by exact maximum
likelihood (SARIMAX). SIPPY fits output-error, ARMAX and Box–Jenkins models, and state space by N4SID; SLICOT (through
ctrlsys) fits state space by MOESP and N4SID. Refined instruments are repeated two-stage least squares (IV2SLS of
statsmodels), each time with the filter and the free run of the estimate before. Differences are given in standard
errors of the estimate. A state-space model is simulated and its frequency response computed by python-control.
``tests/test_linear_peers.py`` has the numbers of SIPPY, SLICOT and IV2SLS that are printed here.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.signal import lfilter

import emsid

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from test_linear_peers import CASES, HORIZON, INSTRUMENTED, Case, centred, textbook

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


def instruments() -> None:
    """Refined instruments beside IV2SLS."""
    from statsmodels.sandbox.regression.gmm import IV2SLS

    for name in INSTRUMENTED:
        record = centred(CASES[name].record())
        own = emsid.fit(CASES[name].structure, record, instruments=True)
        u, y = record.input[:, 0], record.output[:, 0]
        theta = np.linalg.lstsq(_lagged(y, u), y[2:], rcond=None)[0]
        for _ in range(30):
            a, b = np.r_[1.0, theta[:2]], np.r_[0.0, theta[2:]]
            x, past, command = (lfilter([1.0], a, each) for each in (lfilter(b, a, u), y, u))
            settled = slice(40, None)  # of the filters
            known, instrument = (_lagged(each, command)[settled] for each in (past, x))
            theta = IV2SLS(past[2:][settled], known, instrument=instrument).fit().params
        apart = ", ".join(f"{each:.3f}" for each in (own.estimate - theta) / own.standard_error)
        console.print(f"{name}: IV2SLS {', '.join(f'{each:.6f}' for each in theta)}; emsid differs by {apart} s.e.")


def _lagged(outputs: Array, inputs: Array) -> Array:
    """(N − 2, 4) the regressors of a linear model of second order."""
    return np.column_stack([-outputs[1:-1], -outputs[:-2], inputs[1:-1], inputs[:-2]])


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


def prediction_errors() -> None:
    """Output-error, ARMAX and Box–Jenkins models beside SIPPY, which has no intervals."""
    from sippy_unipi import system_identification

    def peer_of(case: Case) -> list[float]:
        """The coefficients of SIPPY in the order of ours."""
        record = centred(case.record())
        kind, orders = case.peer
        options = {f"{kind}_orders": orders, f"{kind}_mod": "OPT"} if kind != "BJ" else {"BJ_orders": orders}
        found = system_identification(record.output.T, record.input.T, kind, **options)
        (b, f), (c, d) = (
            [np.trim_zeros(np.asarray(each[0][0]), "f") for each in (system.num, system.den)]
            for system in (found.G, found.H)
        )
        return (
            [*f[1:], *b] if kind == "OE" else [*f[1:], *b, *c[1:]] if kind == "ARMAX" else [*b, *f[1:], *c[1:], *d[1:]]
        )

    table = Table(title="Prediction errors beside SIPPY", title_justify="left")
    for head in ("", "emsid", "± 1 s.e.", "SIPPY", "difference in s.e."):
        table.add_column(head, justify="right" if head else "left")
    for name, case in CASES.items():
        own, seconds = timed(case.fit)
        peer, others = timed(lambda case=case: peer_of(case))
        for k, value in enumerate(peer):
            row = own.estimate[k], own.standard_error[k], value
            table.add_row(f"{name}: {own.names[k]}", *(f"{x:.6f}" for x in row), f"{(row[0] - value) / row[1]:.3f}")
        table.add_row(f"{name}: CPU s", f"{seconds:.3f}", "", f"{others:.3f}", "")
    console.print(table)


def subspaces() -> None:
    """The poles of the system of Ljung's examples by subspace methods."""
    import ctrlsys
    from sippy_unipi import system_identification

    record = centred(textbook())
    u, y = (np.asfortranarray(each) for each in (record.input, record.output))
    weight = emsid.estimation.linear.subspace.moesp
    own = emsid.fit(emsid.state_space(2, horizon=HORIZON, weighting=weight), textbook(), refine=False).model.poles
    order, factor, *_ = ctrlsys.ib01ad("M", "Q", "N", "O", "N", "N", HORIZON, 1, 1, u, y, 0.0, -1.0)
    slicot = np.linalg.eigvals(ctrlsys.ib01bd("C", "A", "N", HORIZON, order, 1, 1, len(u), factor, 0.0)[0])
    sippy = system_identification(y.T, u.T, "N4SID", SS_fixed_order=2, SS_f=HORIZON, SS_p=HORIZON).A
    for name, poles in (("emsid, MOESP", own), ("SLICOT, MOESP", slicot), ("SIPPY, N4SID", np.linalg.eigvals(sippy))):
        console.print(f"{name}: {max(poles.real):.6f} ± {max(poles.imag):.6f}i")


def many_samples(samples: int = 100_000) -> None:
    """The CPU time of a state space of order 10 with two outputs beside SLICOT, and that of refined ones.

    SLICOT estimates B and D from its factor, by Householder reflections or, faster, by the Cholesky factor of products,
    which halves the digits; emsid by reflections, and B and D from free runs over all samples.
    """
    import ctrlsys

    rng, frequency = np.random.default_rng(0), np.linspace(0.02, 0.4, 5)
    poles = np.exp((-0.02 + 2j * np.pi) * frequency)
    a = np.kron(np.diag(poles.real), np.eye(2)) + np.kron(np.diag(poles.imag), [[0.0, 1.0], [-1.0, 0.0]])
    b, c, none = rng.standard_normal((10, 1)), rng.standard_normal((2, 10)), np.zeros((2, 1))
    model = emsid.StateSpaceModel(a, b, c, none, np.zeros((10, 2)), np.zeros(2), 0.01)
    u = rng.standard_normal((samples, 1))
    y = model.run(np.zeros(10), u)[0]
    record = centred(emsid.Record(u, y + 0.05 * y.std(axis=0) * rng.standard_normal(y.shape), 0.01))
    structure = emsid.state_space(10, horizon=2 * HORIZON)
    emsid.fit(structure, record[:2000], free_run=True)  # compiles
    data = [np.asfortranarray(each) for each in (record.input, record.output)]
    for name, algorithm in (("reflections", "Q"), ("Cholesky", "C")):

        def slicot(algorithm: str = algorithm) -> Any:
            _, factor, *_ = ctrlsys.ib01ad("M", algorithm, "N", "O", "N", "N", 2 * HORIZON, 1, 2, *data, 0.0, -1.0)
            return ctrlsys.ib01bd("C", "A", "N", 2 * HORIZON, 10, 2, 1, samples, factor, 0.0)

        console.print(f"SLICOT, subspace, {name}: {timed(slicot)[1]:.2f} s")
    for name, options in (
        ("subspace", {"refine": False}),
        ("refined to the free run", {"free_run": True}),
        ("refined one step ahead", {}),
    ):
        console.print(
            f"emsid, {name}: {timed(lambda options=options: emsid.fit(structure, record, **options))[1]:.2f} s"
        )


if __name__ == "__main__":
    noise_models()
    instruments()
    control_systems()
    try:
        prediction_errors()
        subspaces()
        many_samples()
    except ImportError as problem:
        console.print(f"{problem}: install the extra with pip install 'emsid[bench]'")
