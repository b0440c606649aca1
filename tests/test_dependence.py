"""The regressions by which a first look tests a linear model, against their definitions."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import f as fisher

import emsid
from emsid.estimation.uncertainty.coloured_residuals import MOST_POLES
from emsid.first_look.baseline import baseline
from emsid.first_look.nonlinearity import Regression, dependence

FEW = 3
"""Columns of the smaller regression."""


@pytest.fixture(scope="module")
def pieces():
    """Tables of six functions and a residual, of two segments."""
    rng = np.random.default_rng(0)
    tables = [rng.standard_normal((samples, 7)) for samples in (80, 60)]
    for table in tables:
        table[:, -1] += 0.4 * table[:, 1] + 0.3 * table[:, 4]
    return tables


def by_definition(pieces, polynomial):
    """Z and r filtered by A(q) = 1 + a₁q⁻¹ + …, without the samples that start the filter in each segment."""
    table = np.concatenate(
        [
            np.column_stack([np.convolve(column, polynomial)[MOST_POLES : len(piece)] for column in piece.T])
            for piece in pieces
        ]
    )
    return table[:, :-1], table[:, -1]


def squares_left(columns, residual):
    return float(np.sum((residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]) ** 2))


@pytest.mark.parametrize("polynomial", [[1.0], [1.0, -0.5], [1.0, -0.9, 0.4]])
def test_the_criterion_and_the_test_are_those_of_their_definitions(pieces, polynomial):
    z, r = by_definition(pieces, polynomial)
    regression = Regression(pieces, np.array(polynomial), FEW)
    samples, count = z.shape
    every, few = squares_left(z, r), squares_left(z[:, :FEW], r)
    determinant = np.linalg.slogdet(z.T @ z)[1]
    poles = len(polynomial) - 1
    criterion = (samples - count) * np.log(every) + determinant + poles * np.log(samples)
    assert regression.criterion == pytest.approx(criterion, rel=1e-10)
    ratio = (few - every) / (count - FEW) / (every / (samples - count))
    assert regression.test == pytest.approx((ratio, fisher.sf(ratio, count - FEW, samples - count)), rel=1e-9)


def test_a_column_may_be_constant_in_every_segment() -> None:
    """The sign of an input that drives forward in one segment and backward in the other one."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(2, 10, 120), 10) * np.repeat([1.0, -1.0], 600)
    y = np.concatenate([lfilter([0.0, 0.1], [1.0, -0.9], part) for part in np.split(u, 2)])
    both = emsid.Record(u, y + 0.02 * rng.standard_normal(1200), 0.01)
    linear = baseline(emsid.concatenate([both[:600], both[600:]]), 1)
    assert linear is not None
    assert dependence(linear, u, [600]).probability > 0.01
