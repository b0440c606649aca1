"""Linear models beside published estimates, and beside numbers of other programs on the same data.

``python bench/linear.py`` prints the numbers of SIPPY 1.0.1, of SLICOT (ctrlsys 1.1.1) and of statsmodels 0.15.0 anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from emsid import Record
from emsid.estimation.linear.subspace import cva, moesp
from test_orders import noisy
from test_prediction_error import of_armax, of_box_jenkins
from test_state_space import TRUTH, record_of

HORIZON = 10


def centred(record: Record) -> Record:
    """A record without the means of its channels, as these programs expect it."""
    return replace(
        record, input=record.input - record.input.mean(axis=0), output=record.output - record.output.mean(axis=0)
    )


@dataclass(frozen=True)
class Case:
    """A structure, a record, and the estimate of another program.

    Attributes:
        structure: ours.
        record: made anew.
        peer: kind of model and orders in SIPPY.
        estimate: of SIPPY, in the order of ours.
        options: of `emsid.fit`.
    """

    structure: Any
    record: Callable[[], Record]
    peer: tuple[str, list[int]]
    estimate: tuple[float, ...]
    options: dict[str, Any]

    def fit(self) -> emsid.Fit[Any]:
        """Our fit to the record without means."""
        return emsid.fit(self.structure, centred(self.record()), **self.options)


CASES = {
    "output-error, white noise": Case(
        emsid.arx(2, 2),
        lambda: noisy(1000, "white", 0.5, 1),
        ("OE", [2, 2, 0]),
        (-1.504138, 0.702090, 1.005449, 0.472113),
        {"free_run": True},
    ),
    "output-error, coloured noise": Case(
        emsid.arx(2, 2),
        lambda: noisy(1000, "coloured", 0.5, 1),
        ("OE", [2, 2, 0]),
        (-1.502039, 0.701887, 0.994744, 0.459467),
        {"free_run": True},
    ),
    "ARMAX": Case(
        emsid.armax(2, 2, 2),
        lambda: of_armax(1000, 1),
        ("ARMAX", [2, 2, 2, 0]),
        (-1.507776, 0.702257, 1.007151, 0.431086, -1.009543, 0.200256),
        {},
    ),
    "Box–Jenkins": Case(
        emsid.box_jenkins(2, 1, 1, 2),
        lambda: of_box_jenkins(1000, 1),
        ("BJ", [2, 1, 1, 2, 0]),
        (1.010437, 0.443997, -1.199998, 0.522130, 0.493943, -0.900049),
        {},
    ),
}


def textbook() -> Record:
    """1,000 samples of the system of Ljung's examples."""
    return record_of(TRUTH, 1000, 1.0)


@pytest.mark.parametrize("name", CASES)
def test_prediction_errors_have_the_estimates_of_sippy(name: str) -> None:
    fit = CASES[name].fit()
    peer = np.array(CASES[name].estimate)
    assert np.abs((fit.estimate[: len(peer)] - peer) / fit.standard_error[: len(peer)]).max() < 0.15


def test_subspace_methods_have_the_poles_of_slicot_and_sippy() -> None:
    """MOESP of SLICOT (IB01AD, IB01BD) finds the same poles; N4SID of SIPPY, weighted otherwise, close ones."""
    by_moesp = emsid.fit(emsid.state_space(2, horizon=HORIZON, weighting=moesp), textbook(), refine=False).model.poles
    assert max(by_moesp, key=lambda pole: pole.imag) == pytest.approx(0.749379 + 0.370486j, abs=1e-5)
    by_cva = emsid.fit(emsid.state_space(2, horizon=HORIZON, weighting=cva), textbook(), refine=False).model.poles
    assert max(by_cva, key=lambda pole: pole.imag) == pytest.approx(0.749700 + 0.371561j, abs=2e-3)


def test_instruments_have_the_gas_furnace_of_box_and_jenkins() -> None:
    """Box, Jenkins, Time Series Analysis (1970), ch. 11: −(0.53 + 0.37B + 0.51B²)/(1 − 0.57B), by likelihood."""
    u, y = np.loadtxt(Path(__file__).parent / "published" / "gas_furnace.csv", delimiter=",", skiprows=2).T
    fit = emsid.fit(emsid.arx(1, 3, nk=3, constant=True), Record(u, y, dt=9.0), instruments=True)
    published = np.array([-0.57, -0.53, -0.37, -0.51])
    assert np.abs((fit.estimate[:4] - published) / fit.standard_error[:4]).max() < 2.0
    gain = fit.estimate[1:4].sum() / (1 + fit.estimate[0])
    assert gain == pytest.approx(published[1:].sum() / (1 + published[0]), rel=0.02)


INSTRUMENTED = {
    "output-error, white noise": (-1.503769, 0.702134, 0.999998, 0.478466),
    "output-error, coloured noise": (-1.503829, 0.703859, 0.994597, 0.455930),
}
"""Refined instruments by two-stage least squares of statsmodels (IV2SLS), repeated with the new filter and free run."""


@pytest.mark.parametrize("name", INSTRUMENTED)
def test_instruments_have_the_estimates_of_statsmodels_and_of_output_error(name: str) -> None:
    """For white noise they are as good as output error, and close to it for other noise (Young 2011, ch. 7)."""
    fit = emsid.fit(CASES[name].structure, centred(CASES[name].record()), instruments=True)
    for peer in (INSTRUMENTED[name], CASES[name].estimate):
        assert np.abs((fit.estimate - peer) / fit.standard_error).max() < 0.25


def test_refined_instruments_solve_their_equation() -> None:
    """Σ ζ(t)(y_f(t) − φ_f(t)ᵀθ) = 0 of Söderström and Stoica, System Identification (1989), sec. 8.2, by its words."""
    record = noisy(2000, "coloured", 1.0, 2)
    fit = emsid.fit(emsid.arx(2, 2, constant=True), record, instruments=True)
    a, b, constant = np.append(1.0, fit.estimate[:2]), np.append(0.0, fit.estimate[2:4]), fit.estimate[4]
    u, y = record.input[:, 0], record.output[:, 0]
    noiseless = lfilter(b, a, u) + lfilter([1.0], a, np.full(len(u), constant))
    x, y, u, one = (lfilter([1.0], a, each) for each in (noiseless, y, u, np.ones(len(u))))
    start = 32  # where the filters have settled, as in the fit

    def lagged(outputs: np.ndarray) -> np.ndarray:
        columns = [-outputs[1:-1], -outputs[:-2], u[1:-1], u[:-2], one[2:]]
        return np.column_stack(columns)[start:]

    instruments, regressors, target = lagged(x), lagged(y), y[2:][start:]
    theta = np.linalg.solve(instruments.T @ regressors, instruments.T @ target)
    assert np.abs((theta - fit.estimate) / fit.standard_error).max() < 0.05
