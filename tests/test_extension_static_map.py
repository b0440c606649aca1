"""A static map added as a user adds one: a class and one line of registration, from public names only."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

import emsid
from emsid.models.blocks.static_maps import STATIC_MAPS
from emsid.report.views import cascade as views

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CubicRoot(emsid.blocks.NumberedMap):
    """f(x) = c·x/(x² + w²)^⅓, a cubic root whose slope at zero is bounded.

    Args:
        c: factor.
        width: w, where it bends into a straight line.
    """

    c: float = 1.0
    width: float = 0.1

    kind = "cubic-root"
    letters = ("c",)
    slope_letter = "c"
    meanings = {"c": "factor of the root"}  # noqa: RUF012
    absorbs_shift = False

    def value(self, x: Array) -> Array:
        return self.c * self._root(x)

    def slope(self, x: Array) -> Array:
        inside = x**2 + self.width**2
        slope: Array = self.c * (inside - 2 / 3 * x**2) / inside ** (4 / 3)
        return slope

    def parameter_gradient(self, x: Array) -> Array:
        return self._root(x)[None]

    def scaled(self, input: float, output: float) -> CubicRoot:
        return CubicRoot(self.c * output / float(np.cbrt(input)), self.width * abs(input))

    def expression(self, x: str) -> str:
        return f"{self.c:.6g}*{x}/cbrt({x}^2 + {self.width**2:.6g})"

    @classmethod
    def started(cls, x: Array, z: Array, size: int) -> CubicRoot:
        return emsid.blocks.closest(cls(1.0, 0.1 * float(np.std(x))), x, z)

    def _root(self, x: Array) -> Array:
        root: Array = x / np.cbrt(x**2 + self.width**2)
        return root


@pytest.fixture
def registered() -> Iterator[None]:
    emsid.blocks.register(CubicRoot)
    yield
    del STATIC_MAPS["cubic-root"]


TRUTH = emsid.Cascade(
    (
        emsid.blocks.Rational([0.4], [-0.6]),
        CubicRoot(1.5, 0.1),
        emsid.blocks.Rational([0.1, 0.05], [-1.3, 0.45]),
    ),
    output_offset=0.1,
)


def measured(samples: int = 2000) -> emsid.Record:
    rng = np.random.default_rng(0)
    u = np.convolve(rng.standard_normal(samples), np.ones(5) / 2, "same")
    y = TRUTH.output(u, np.zeros(TRUTH.states)) + 0.001 * rng.standard_normal(samples)
    return emsid.Record(u, y, 0.01, input_units=("V",), output_units=("rad/s",))


def test_its_derivatives_and_scale_are_right() -> None:
    block, x = CubicRoot(1.5, 0.1), np.linspace(-2, 2, 41)
    step = 1e-6
    np.testing.assert_allclose(block.slope(x), (block.value(x + step) - block.value(x - step)) / (2 * step), rtol=1e-6)
    for factor in (2.0, -0.5):
        np.testing.assert_allclose(block.scaled(factor, 3.0).value(x), 3.0 * block.value(x / factor), rtol=1e-12)


@pytest.mark.usefixtures("registered")
def test_it_is_fitted_saved_loaded_drawn_and_printed(tmp_path: Path) -> None:
    record = measured()
    structure = emsid.wiener_hammerstein((1, 2), static="cubic-root", delay=0, oversampling=1)
    fit = emsid.fit(structure, record)
    assert fit.ending is emsid.Ending.CONVERGED
    found = fit.model.blocks[1]
    assert isinstance(found, CubicRoot)
    assert found.slope_letter == found.names[0] == "c"
    run, clean = (model.output(record.input[:, 0], np.zeros(3)) for model in (fit.model, TRUTH))
    assert np.std(run[100:] - clean[100:]) < 0.02 * np.std(clean)

    emsid.save(fit.model, tmp_path / "model.json")
    model: Any = emsid.load(tmp_path / "model.json")
    np.testing.assert_array_equal(model.output(record.input[:, 0], np.zeros(3)), run)

    figure = views.static_maps(fit, record)
    assert figure is not None
    assert "cubic-root" in figure.plots[0].marks[2].label  # type: ignore[union-attr]
    assert "factor of the root" in " ".join(views.block_column(fit)["Meaning"])
    assert "cbrt(x1(t)^2" in fit.model.equation()


def test_without_registration_it_is_given_by_its_class_or_as_a_value() -> None:
    for static in (CubicRoot, CubicRoot()):
        (family,) = emsid.wiener_hammerstein((1, 2), static=static).search.families
        assert family.name == "cubic-root"


@pytest.mark.usefixtures("registered")
def test_two_maps_of_one_kind_are_refused() -> None:
    class Another(CubicRoot):
        def inverse(self, z: ArrayLike) -> Array:
            return np.asarray(z, dtype=float)

    with pytest.raises(emsid.ModelError, match="another static map of the kind 'cubic-root'"):
        emsid.blocks.register(Another)
