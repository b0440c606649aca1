"""Static maps whose input leaves its range in the fit."""

from __future__ import annotations

import numpy as np
import pytest

import emsid
from emsid import Record
from emsid.findings import Finding
from emsid.identification import identify
from emsid.identification.evidence import about_the_maps
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import Polynomial
from emsid.models.feedback.model import FeedbackModel
from emsid.models.kinds import capabilities_of

DT = 0.01
RESONANT = Rational([0.0, 0.1], [-1.7, 0.9])
CUBIC = Polynomial(np.array([0.0, 1.0, 0.0, 0.2]))
CASCADE = Cascade((RESONANT, CUBIC))
LOOP = FeedbackModel(np.array([[1.7, 1, 0.1, -0.05], [-0.9, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]]), (CUBIC,), dt=DT)


def sine(frequency: float, samples: int = 600) -> Record:
    """An input of unit amplitude at a frequency in radians per sample."""
    u = np.sin(frequency * np.arange(samples))
    return Record(u, u, DT)


@pytest.mark.parametrize("model", [CASCADE, LOOP], ids=["cascade", "feedback"])
def test_a_map_is_continued_where_a_resonance_makes_its_input_larger(model: Cascade | FeedbackModel) -> None:
    low, high = sine(0.05), sine(0.46)
    assert about_the_maps(model, high, low, False) == []
    assert about_the_maps(model, low, high, True) == []
    (found,) = about_the_maps(model, low, high, False)
    assert (found.code, found.subject, found.data["map"]) == ("map-beyond-range", model.name, None)
    z, known = (capabilities_of(model).maps_in_use(model, record)[0].input for record in (high, low))
    assert (found.data["low"], found.data["high"]) == (z.min(), z.max())
    assert z.max() > 1.5 * known.max()
    slack = 0.1 * np.ptp(known)
    assert found.data["share"] == np.mean((z > known.max() + slack) | (z < known.min() - slack)) > 0.1


def test_only_maps_that_leave_their_range_are_named() -> None:
    two = Cascade((CUBIC, RESONANT, CUBIC))
    (found,) = about_the_maps(two, sine(0.05), sine(0.46), False)
    assert found.data["map"] == 2
    assert about_the_maps(Cascade((RESONANT,)), sine(0.05), sine(0.46), False) == []
    assert about_the_maps(emsid.simulate, sine(0.05), sine(0.46), False) == []


def test_it_is_said_of_the_best_model() -> None:
    rng = np.random.default_rng(3)

    def driven(size: float) -> Record:
        u = size * rng.normal(size=1500)
        return Record(u, CASCADE.output(u, np.zeros(2)) + 0.01 * rng.normal(size=len(u)), DT)

    result = identify(driven(1.0), driven(2.0), models=["wiener"])
    found = [finding for finding in result.findings if finding.code == "map-beyond-range"]
    assert [type(each) for each in found] == [Finding]
