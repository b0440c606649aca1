"""How often 95 % intervals of a feedback model contain the true values.

    python tests/coverage_feedback.py [records]

For each case so many records (300 by default) are simulated with 1 % noise and fitted. The true model is brought into
the form of every fit, and for every parameter the share of intervals that contain it is printed, with the median half
width of the interval over the estimate. The standard error of a share from 300 records is 1.3 %. The test suite runs a
short form.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from emsid import FeedbackModel, Fit, Record
from emsid.blocks import DeadZone, Polynomial, Saturation
from emsid.models.feedback import fitting
from emsid.models.feedback.coordinates import (
    COMPARED,
    Visited,
    coordinates_in_form,
    free_lines,
    with_factor_unit,
    with_line,
    with_state,
    with_units,
    within,
)
from emsid.models.feedback.fitting import fit_feedback
from emsid.models.feedback.normal_form import normal_form
from feedback_models import Array, before_sensor, loop, multiplied
from model_examples import DT
from test_map_bands import SPRING, smooth

Signal = Callable[[np.random.Generator, int], Array]
STEP = 1e-7  # of numerical derivatives
SATURATED = FeedbackModel(
    np.array([[0.8, 0.5, -1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), (Saturation(0.3, -0.2, 0.2),), dt=DT
)
STICKING = FeedbackModel(np.array([[0.8, 0.5, -0.3], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), (DeadZone(-0.4, 0.3),), dt=DT)


def white(rng: np.random.Generator, samples: int) -> Array:
    return rng.normal(size=samples)


def noisy(truth: FeedbackModel, signal: Signal, seed: int, samples: int) -> Record:
    """A record with 1 % noise that begins at rest."""
    rng = np.random.default_rng(seed)
    u = signal(rng, samples)
    y = truth.output(u, truth.resting(float(u[0])))
    return Record(u, y + 0.01 * np.std(y) * rng.normal(size=samples), DT)


class Fitted(NamedTuple):
    """A fit, the directions in which its parameters are free, and its record."""

    fit: Fit[FeedbackModel]
    spread: Array
    record: Record


def fitted(truth: FeedbackModel, record: Record) -> Fitted:
    """The fit from the true values."""
    found: list[Array] = []

    def kept(*args: Any) -> Array:
        found.append(coordinates_in_form(*args))
        return found[-1]

    with patch.object(fitting, "coordinates_in_form", kept):
        return Fitted(fit_feedback(truth, record), found[-1], record)


def in_the_form_of(truth: FeedbackModel, fitted: Fitted) -> FeedbackModel:
    """The true model in the form of a fit: from it to the fit, only parameters within the form change.

    It differs from the given one by a change of the state, by units, and by what is moved between maps and the linear
    part. Those are found here by a search, and not from the conditions of the form.
    """
    goal = fitted.fit.model
    u = fitted.record.input[:, 0]
    begin = _of_the_same_signs(normal_form(truth, _visited(truth, u)).model, goal)
    scale = np.maximum(np.abs(goal.parameters), 1e-3)
    axes = np.linalg.qr(fitted.spread / scale[:, None])[0]

    def rest(changes: Array) -> Array:
        apart = (_changed(begin, goal, changes).parameters - goal.parameters) / scale
        return np.asarray(apart - axes @ (axes.T @ apart))

    return _changed(begin, goal, _zero(rest, np.zeros(6 * len(truth.maps) + truth.states**2)))


def _zero(rest: Callable[[Array], Array], at: Array) -> Array:
    """Where a function is zero, by steps with the same derivatives while each takes away nine tenths.

    Directions without effect, as of an offset of z where the map absorbs no shift, get no step.
    """
    left, slopes = rest(at), None
    for _ in range(100):
        if slopes is None:
            slopes = np.column_stack([(rest(at + STEP * e) - left) / STEP for e in np.eye(len(at))])
            back = np.linalg.pinv(slopes, rcond=1e-7)
        trial = at - back @ left
        after = rest(trial)
        slow = np.abs(after).max() > 0.1 * np.abs(left).max()
        at, left, slopes = trial, after, None if slow else slopes
        if np.abs(left).max() < 1e-10:
            break
    assert np.abs(left).max() < 1e-8
    return at


def _of_the_same_signs(model: FeedbackModel, goal: FeedbackModel) -> FeedbackModel:
    n = model.states
    for i in range(len(model.maps)):
        into, out = (np.sign(np.sum(a * b)) for a, b in (
            (model.matrix[n + i], goal.matrix[n + i]), (model.matrix[:, n + 1 + i], goal.matrix[:, n + 1 + i])
        ))  # fmt: skip
        model = with_units(model, i, into, out)
        if i in model.multiplied:
            model = with_factor_unit(model, i, np.sign(model.factors[i] @ goal.factors[i]))
    return model


def _changed(model: FeedbackModel, goal: FeedbackModel, changes: Array) -> FeedbackModel:
    """The same model with lines moved, inputs of maps shifted, other units and another state."""
    of_maps, of_state = np.split(changes, [6 * len(model.maps)])
    for i, (level, slope, shift, into, out, factor) in enumerate(of_maps.reshape(-1, 6)):
        z = np.linspace(-2, 2, COMPARED)
        if free_lines(model, i, z).size:
            slope = slope if model.takes_line(i) else 0.0
            map_ = model.maps[i]
            less = map_.with_parameters(map_.parameters - within(map_, z, slope * z + level))
            model = _with_line(model, i, less, slope, level)
        model = _shifted(model, i, shift) if model.maps[i].absorbs_shift else model
        model = with_units(model, i, np.exp(into), np.exp(out))
        model = with_factor_unit(model, i, np.exp(factor)) if i in model.multiplied else model
    model = with_state(model, np.eye(model.states) + of_state.reshape(model.states, -1))
    pairs = zip(model.maps, goal.maps, strict=True)
    ranged = tuple(a.on_range(b.low, b.high) if isinstance(b, Polynomial) else a for a, b in pairs)
    return replace(model, maps=ranged)


def _with_line(model: FeedbackModel, i: int, map_: object, slope: float, level: float) -> FeedbackModel:
    maps = [*model.maps[:i], map_, *model.maps[i + 1 :]]
    moved = with_line(replace(model, maps=tuple(maps)), i, slope, level)
    assert moved is not None
    return moved[0]


def _shifted(model: FeedbackModel, i: int, shift: float) -> FeedbackModel:
    """With another offset of z, for which the map makes up."""
    map_, offsets = model.maps[i], model.map_offsets.copy()
    offsets[i] += shift
    model = replace(model, map_offsets=offsets)
    if isinstance(map_, Polynomial):
        return _with_line(model, i, replace(map_, low=map_.low + shift, high=map_.high + shift), 0.0, 0.0)
    if isinstance(map_, DeadZone):
        edges = np.array([shift * name.startswith("b") for name in map_.names])
        return _with_line(model, i, map_.with_parameters(map_.parameters + edges), 0.0, 0.0)
    assert isinstance(map_, Saturation)
    m = map_.parameters[map_.names.index("m")]
    limits = np.array([m * shift * (name != "m") for name in map_.names])
    return _with_line(model, i, map_.with_parameters(map_.parameters + limits), 0.0, -m * shift)


def _visited(model: FeedbackModel, u: Array) -> Visited:
    return Visited.of(model, [u], [model.resting(float(u[0]))])


@dataclass(frozen=True, eq=False)
class Case:
    """A system that a model is fitted to.

    Attributes:
        truth: the system.
        signal: of a random generator and a number of samples.
        samples: of a record.
    """

    truth: FeedbackModel
    signal: Signal
    samples: int

    def covered(self, seed: int) -> tuple[tuple[str, ...], NDArray[np.bool_], Array]:
        """The parameters, whose intervals contain the true value in one record, and half widths over the estimate."""
        one = fitted(self.truth, noisy(self.truth, self.signal, seed, self.samples))
        same, u = in_the_form_of(self.truth, one), one.record.input[:600, 0]
        # They may begin at other rests.
        runs = [each.output(u, each.resting(float(u[0])))[500:] for each in (same, self.truth)]
        np.testing.assert_allclose(*runs, atol=1e-8 * np.ptp(runs[1]))
        true = np.array([same.parameters[same.names.index(name)] for name in one.fit.names])
        low, high = one.fit.interval().T
        return one.fit.names, (low <= true) & (true <= high), (high - low) / 2 / np.abs(one.fit.estimate)

    def coverage(self, records: int) -> dict[str, tuple[float, float]]:
        """For every parameter the share of records whose interval contains it, and the median of the widths."""
        found = [self.covered(1000 + seed) for seed in range(records)]
        shares = np.mean([inside for _, inside, _ in found], axis=0).tolist()
        widths = np.median([width for _, _, width in found], axis=0).tolist()
        return dict(zip(found[0][0], zip(shares, widths, strict=True), strict=True))


CASES = {
    "spring": Case(SPRING, smooth, 1000),
    "saturation": Case(SATURATED, white, 1000),
    "dead zone": Case(STICKING, white, 1000),
    "polynomial": Case(loop(), white, 1500),
    "product": Case(multiplied(), white, 3000),
    "sensor": Case(before_sensor("polynomial"), white, 1500),
}


def main(records: int) -> None:
    """Print all shares and widths."""
    for name, case in CASES.items():
        print(name)
        for parameter, (share, width) in case.coverage(records).items():
            print(f"  {parameter:6} {100 * share:5.1f} %   ± {100 * width:.2g} %")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 300)
