"""Where a cascade carries a dead time, on data of difference equations."""

from __future__ import annotations

import numpy as np
import pytest

from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import fit_cascade
from emsid.models.blocks.search.estimation import at_the_input
from emsid.models.blocks.static_maps import Polynomial
from independent.dead_time import record

CUBIC = (0.0, 1.0, 0.0, -0.15)


def start(first: int, second: int) -> Cascade:
    """Filters with numerators of these lengths, a leading zero where there is room for one."""
    numerators = [np.array([0.0, 0.4][-first:]), np.array([0.0, 0.3, 0.2][-second:])]
    one, other = (Rational(b, [-a]) for b, a in zip(numerators, (0.6, 0.5), strict=True))
    return Cascade((one, Polynomial(np.array(CUBIC), -2.5, 2.5), other))


@pytest.mark.parametrize("lengths", [(2, 2), (1, 3)])
def test_a_dead_time_is_counted_at_the_input_whichever_filter_it_landed_in(lengths: tuple[int, int]):
    data = record(1)
    fit = at_the_input(fit_cascade(start(*lengths), data), [data], {})
    assert fit.model.delay == 1
    assert [len(block.numerator) for block in fit.model.blocks if isinstance(block, Rational)] == [1, 2]
    (finding,) = (each for each in fit.findings if each.code == "dead-time-at-input")
    assert (finding.data["delay"], finding.data["moved"], finding.data["filters"]) == (1, 1, 2)
    errors = dict(zip(fit.names, zip(fit.estimate, fit.standard_error, strict=True), strict=True))
    for name, pole in (("G1.a1", -0.6), ("G2.a1", -0.5)):
        estimate, error = errors[name]
        assert abs(estimate - pole) < 4 * error


def test_a_cascade_without_a_dead_time_has_none():
    data = record(0)
    fit = at_the_input(fit_cascade(start(1, 2), data), [data], {})
    assert fit.model.delay == 0
    assert "dead-time-at-input" not in [finding.code for finding in fit.findings]


def test_a_fit_at_its_minimum_is_not_given_up_for_one_that_is_not():
    data = record(1)
    fit = fit_cascade(start(2, 2), data)
    assert at_the_input(fit, [data], {"max_iterations": 1, "tolerance": 1e-9}) is fit
