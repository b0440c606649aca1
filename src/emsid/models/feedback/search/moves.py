r"""The moves of a feedback search: models that follow from one that is fitted.

- **Without the delay**: a linear model may need it for what maps show.
- **More steps per sample**: a model with one step makes up for what happens between samples by a higher order, which
  holds for inputs like those of its record only. So two steps are tried with lower orders too, and twice as many as
  long as that lowers the errors; whether the input is held between its samples may only show then, so both are
  tried.
- **Another family** in place of every map, begun at the maps.
- **One map more** in the directions that explain most. Each start takes a few steps in every direction; those that gain
  by it are refined, the best of all models first.
- **A map that is multiplied by a signal**. Beside the linear model the direction of the product shows, while beside a
  map that stands for it another one seems best. Its signals are held until there is another map: free, they would
  follow what that is for.

Starts with friction that sticks: the speed of a linear model, which passes a dead zone in every step.

Coulomb friction takes a fixed amount of speed in a step, or all of it if there is less. With p, the speed that the
motor would have without friction at the end of a step, and a dead zone f whose half-width is that amount,

    y(t) = f(p(t))        p(t+1) = a·f(p(t)) + s(t)

where s is what drives the motor: f = 0 is a motor that stands still. A map beside a linear model cannot begin there, as
it acts a step later; it begins at a steep saturation of the speed, which creeps, and oscillates where it is steeper
than a step allows. But a linear model is the case of a dead zone without width: with its slowest real pole a,

    y(t+1) = a·y(t) + s(t),      s(t) = C(A − aI) x(t) + …

and s is the output of a system of the other states. So any linear model is a start, with the speed replaced by f(p).

**More steps.** Friction acts in each of them. With twice as many, the model is the square root of the one without
friction, A + B_w C_z, with half the width of the dead zone and again the speed replaced by f(p). The square root of A
itself does not exist: where the motor stands still nothing of its speed is left, so that A has a pole near zero.

References:
    Kikuuwe, Takesue, Sano, Mochiyama, Fujimoto, *Admittance and impedance representations of friction based on implicit
    Euler integration*, IEEE Transactions on Robotics 22 (2006).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError, ModelError
from emsid.models.blocks.search.map_families import Family, family_of
from emsid.models.blocks.static_maps import DeadZone
from emsid.models.feedback.coordinates import WORST_CONDITION, with_state
from emsid.models.feedback.fitting import Found
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.directions import KEPT
from emsid.models.feedback.search.starts import (
    share_of,
    with_family,
    with_one_map_more,
    with_product,
    with_steps_doubled,
)
from emsid.models.feedback.search.trials import BEAM, FeedbackSearch, SearchData, Steps, Trial, much_worse, refusal
from emsid.selection.improvement import matters

Array = NDArray[np.float64]

STICKING = family_of("dead-zone")
# The half-width of the dead zone that a fit begins with, over the root mean square change of the output in a step.
WIDTH = 0.3
# Beside a dead zone that a speed passes, the linear part has a pole whose size is smaller than this.
NOTHING_LEFT = 0.3
# A pole is real if its imaginary part is smaller than this.
REAL = 1e-9


def with_speed_that_sticks(linear: Found, measured: list[Array]) -> tuple[FeedbackModel, list[Array]]:
    """A linear model whose output passes a dead zone before it acts on the next step, and its states.

    Args:
        linear: with at least one state.
        measured: (N,) the output of every segment.

    Raises:
        ModelError: if it has no real pole, or its output does not show every state.
    """
    transform = _speed_and_drive(linear.model)
    model = with_state(linear.model, transform)
    n = model.states
    matrix = np.zeros((n + 2, n + 2))
    matrix[np.ix_([*range(n), n + 1], range(n + 1))] = model.matrix
    matrix[:, n + 1], matrix[:n, 0], matrix[n + 1, 0] = matrix[:, 0], 0.0, 0.0
    matrix[n, 0] = 1.0
    change = np.concatenate([np.diff(y) for y in measured])
    width = WIDTH * float(np.sqrt(np.mean(change**2))) / model.oversampling
    with_map = replace(
        model, matrix=matrix, maps=(DeadZone(-width, width),), map_offsets=np.zeros(1), factors=np.zeros(0)
    )
    return with_map, [transform @ x for x in linear.states]


def _speed_and_drive(model: FeedbackModel) -> Array:
    """(n, n) T to a state of the output C x and of the states that drive it, from which it takes nothing.

    Raises:
        ModelError: if there is no real pole, or the output does not show every state.
    """
    n = model.states
    a, c = model.matrix[:n, :n], model.matrix[-1, :n]
    poles = np.linalg.eigvals(a)
    real = poles[np.abs(poles.imag) < REAL].real
    if not len(real):
        raise ModelError(f"{model.name}: no speed that sticks, as the linear model only oscillates")
    rows = [c]
    driving = c @ a - real.max() * c
    for _ in range(n - 1):
        rows.append(driving)
        driving = driving @ a
    transform = np.array(rows)
    sizes = np.linalg.norm(transform[1:], axis=1, keepdims=True)
    transform[1:] /= np.where(sizes > 0, sizes, 1.0)
    if not np.linalg.cond(transform) < WORST_CONDITION:
        raise ModelError(f"{model.name}: no speed that sticks, as the output of the linear model hides a state")
    return transform


def sticking_map(model: FeedbackModel) -> int | None:
    """The dead zone that a speed passes in every step, so that the linear part beside it has a pole near zero.

    Returns:
        The map, from 0; None if there is none.
    """
    n = model.states
    if not n or _least_pole(model.matrix, n) > NOTHING_LEFT:
        return None
    for k, each in enumerate(model.maps):
        if isinstance(each, DeadZone) and _least_pole(_moving(model, each, k), n) > NOTHING_LEFT:
            return k
    return None


def with_sticking_steps_doubled(model: FeedbackModel, k: int, held: bool) -> FeedbackModel:
    """A start with twice as many steps per sample, in each of which the speed sticks.

    Args:
        model: with its maps.
        k: the dead zone that the speed passes.
        held: whether its input is held over the steps of a sample.

    Raises:
        ModelError: if a pole of the motion without friction is negative or zero.
    """
    n, zone, into = model.states, model.maps[k], model.matrix[model.states + k, : model.states + 1]
    assert isinstance(zone, DeadZone)
    faster = with_steps_doubled(replace(model, matrix=_moving(model, zone, k)), held)
    poles, directions = np.linalg.eig(model.matrix[:n, :n])
    speed = np.real(directions[:, np.argmin(np.abs(poles))])
    matrix = faster.matrix.copy()
    matrix[:n, n + 1 + k] = matrix[:n, :n] @ speed / (_slope(zone) * float(into[:n] @ speed))
    matrix[:n, : n + 1] -= _slope(zone) * np.outer(matrix[:n, n + 1 + k], into)
    still = float(model.map_offsets[k])  # z at standstill
    narrower = replace(zone, b_l=0.5 * (zone.b_l + still), b_r=0.5 * (zone.b_r + still))
    return replace(faster, matrix=matrix, maps=(*model.maps[:k], narrower, *model.maps[k + 1 :]))


def _moving(model: FeedbackModel, zone: DeadZone, k: int) -> Array:
    """M with the line of a dead zone of no width in place of the zone, in the rows of the state."""
    n, matrix = model.states, model.matrix.copy()
    matrix[:n, : n + 1] += _slope(zone) * np.outer(matrix[:n, n + 1 + k], matrix[n + k, : n + 1])
    return matrix


def _slope(zone: DeadZone) -> float:
    return 0.5 * (zone.m_l + zone.m_r)


def _least_pole(matrix: Array, n: int) -> float:
    return float(np.abs(np.linalg.eigvals(matrix[:n, :n])).min())


Maps = tuple[tuple[str, int], ...]
"""Names of families and their sizes."""
OTHERS: Maps = (("polynomial", 3), ("polynomial", 5), ("two-slopes", 0), ("dead-zone", 0), ("saturation", 0))
"""Maps of few numbers that are tried in place of another one."""
FREE_FORM: Maps = (("spline", 0), ("monotone-spline", 0))
"""Maps of free form. Several of them follow a record as well as the right maps, and err in other combinations of
states, so only one takes the place of another one, where no move with fewer numbers does."""
MORE: Maps = (("polynomial", 3), ("two-slopes", 0), ("dead-zone", 0))
"""Maps that are added; a saturation is a dead zone beside a line."""
FRICTION: Maps = (("tanh", 0),)
"""The map before a sensor that loses the sign."""
FREE_FRICTION: Maps = (("spline", 8),)
CLEARLY = 0.8
"""The map that takes its place in a short record where the error on parts that are left out falls below this share: a
map of many numbers follows a record more closely than it holds on another one."""
MULTIPLIED, BESIDE_PRODUCT = family_of("two-slopes"), (family_of("dead-zone"), family_of("saturation"))
"""The map that is multiplied by a signal, a line or a magnitude, and those that are tried beside it, for friction."""
MOST_STEPS = 16
"""Steps per sample, at most: the error of friction that sticks still falls with them."""
CUBIC = 3
"""The degree of a polynomial if none is given."""
FEW = 10
"""Steps of a start in every direction."""
MANY = 8
"""The number of directions before a sensor that loses the sign, which hides where a map in the loop has its effect."""
ORDINALS = {2: "second", 3: "third", 4: "fourth", 5: "fifth", 6: "sixth"}


def usual_size(family: Family, size: int) -> int:
    """The given number of knots or degree, or the first that the family tries; of a polynomial that of a spring."""
    if size or not family.sizes:
        return size
    return CUBIC if family.name == "polynomial" and CUBIC in family.sizes else family.sizes[0]


# --- delay and steps -------------------------------------------------------------------------------------------------


def without_delay(data: SearchData, trial: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """Without a delay that is not given."""
    if settings.delay is None and trial.found.model.delay:
        data.control.doing("no delay")
        with suppress(EmsidError):
            yield data.refined(replace(trial.found.model, delay=0), trial.found.states, trial.family, trial.size)


def more_steps(data: SearchData, trial: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """With two steps per sample, from a linear model of this order and lower ones, and with twice as many again."""
    model = trial.found.model
    if settings.oversampling is not None:
        return
    if model.oversampling > 1 or len(model.maps) > 1 or model.sensor is not None or sticking_map(model) is not None:
        yield from _doubled(data, trial, settings)
        return
    for order in range(model.states, 0, -1) if settings.order is None else (model.states,):
        tried = []
        for held in settings.holds:
            data.control.doing(f"2 steps per sample, order {order}")
            with suppress(EmsidError):
                linear = data.linear(order, Steps(2, held), model.delay)
                tried.append(with_map_more(data, linear, trial.family, trial.size))
        near = [each for each in tried if not much_worse(each, trial)]
        if not near:
            return
        for each in near:  # one that is a little worse with few steps may be the right one
            yield each
            yield from _doubled(data, each, settings)


def _doubled(data: SearchData, trial: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """With twice the steps per sample, and twice again, as long as that lowers the errors."""
    while trial.found.model.oversampling < MOST_STEPS:
        model, finer = trial.found.model, list[Trial]()
        at = sticking_map(model)
        for held in settings.holds:
            data.control.doing(f"{2 * model.oversampling} steps per sample, order {model.states}")
            with suppress(EmsidError):
                start = with_steps_doubled(model, held) if at is None else with_sticking_steps_doubled(model, at, held)
                finer.append(data.refined(start, trial.found.states, trial.family, trial.size))
        fall = (1 - 1 / trial.found.minimum.samples) * trial.found.error**2  # of n log MSE by one
        lower = [each for each in finer if each.found.error**2 < fall and each.errors.mean < trial.errors.mean]
        if not lower:
            return
        trial = min(lower, key=lambda each: each.errors.mean)
        yield trial


# --- maps ------------------------------------------------------------------------------------------------------------


def with_other_maps(data: SearchData, trial: Trial, settings: FeedbackSearch, maps: Maps) -> Iterator[Trial]:
    """With maps of other families, or more knots or a higher degree of the given one."""
    others = [(family_of(name), size) for name, size in maps]
    if settings.static is not None:
        now = usual_size(settings.static, settings.size)
        larger = [size for size in settings.static.sizes if size > now]
        others = [] if settings.size or settings.static.smooth else [(settings.static, size) for size in larger[:1]]
    for family, size in others:
        if (family, size) == (trial.family, trial.size):
            continue
        data.control.doing(f"map: {family.name}")
        with suppress(EmsidError):
            start, states = with_family(trial.found, data.fitted, family, usual_size(family, size))
            yield data.refined(start, states, family, size)


class Start(NamedTuple):
    """A model with one map more after a few steps on some of the segments.

    Attributes:
        found: the model.
        family, size: of the map.
        gain: what is left of the mean square error of the model without the map on these segments.
    """

    found: Found
    family: Family
    size: int
    gain: float


def with_map_more(data: SearchData, found: Found, family: Family, size: int, hold_signals: bool = False) -> Trial:
    """The trial with one map more, in the directions that explain most.

    Args:
        data: of the search.
        found: the model without it.
        family, size: of the map.
        hold_signals: whether those of products are held while directions are compared.

    Raises:
        ModelError: if all directions diverge.
    """
    start = _begun(data, found, family, usual_size(family, size), hold_signals)
    return data.refined(start.found.model, start.found.states, family, start.size)


def maps_more(data: SearchData, models: Sequence[Trial], settings: FeedbackSearch, maps: Maps) -> Iterator[Trial]:
    """The best of several models with a map more.

    Args:
        data: of the search.
        models: without the map.
        settings: where they give a number of maps, those that gain nothing are refined too.
        maps: families and sizes that are tried.
    """
    starts = [start for each in models for start in _starts(data, each, settings, maps)]
    useful = [each for each in starts if settings.maps is not None or matters(each.gain, 1.0)]
    for start in sorted(useful, key=attrgetter("found.error"))[:BEAM]:
        with suppress(EmsidError):
            yield data.refined(start.found.model, start.found.states, start.family, start.size)


def _starts(data: SearchData, trial: Trial, settings: FeedbackSearch, maps: Maps) -> Iterator[Start]:
    """With a map more of each family, where more than noise is left."""
    found = trial.found
    if settings.maps is None and not data.more_than_noise(found):
        return
    names = [(family_of(name), size) for name, size in maps]
    if settings.static is not None:
        names = [(trial.family, trial.size)]
    for family, size in ((family, usual_size(family, size)) for family, size in names):
        data.control.doing(f"{ORDINALS[len(found.model.maps) + 1]} map: {family.name}")
        with suppress(EmsidError):
            yield _begun(data, found, family, size, kept=MANY if trial.loses_sign else KEPT)


def _begun(
    data: SearchData, found: Found, family: Family, size: int, hold_signals: bool = False, kept: int = KEPT
) -> Start:
    """The start in the best direction.

    Raises:
        ModelError: if all directions diverge.
    """
    model = found.model
    segments, directions = data.segments(model), data.directions(found, kept=kept)
    start = with_one_map_more(
        found, segments, model.edge, family, size, directions, FEW, data.control, hold_signals, refusal(model)
    )
    if start is None:
        raise ModelError(f"{model.name}: with a map in its feedback the model diverges; choose another order")
    before = float(np.mean(np.concatenate(found.minimum.residuals[share_of(segments)]) ** 2))
    return Start(start, family, size, start.error**2 / before if before else np.inf)


def with_products(data: SearchData, trial: Trial, settings: FeedbackSearch) -> Iterator[Trial]:
    """With a map that is multiplied by a signal, of this order and lower ones, alone and beside a friction."""
    model = trial.found.model
    for order in range(model.states, 0, -1) if settings.order is None else (settings.order,):
        data.control.doing(f"a map times a signal, order {order}")
        with suppress(EmsidError):
            linear = data.linear(order, Steps(model.oversampling, model.held), model.delay)
            directions, segments = data.directions(linear, True), data.segments(linear.model)
            if not directions or not directions[0].explains(linear.minimum.samples):
                continue
            found = with_product(linear, segments, linear.model.edge, MULTIPLIED, directions[0], data.control)
            with suppress(EmsidError):
                yield data.refined(found.model, found.states, MULTIPLIED, 0)
            for family in BESIDE_PRODUCT:
                with suppress(EmsidError):
                    yield with_map_more(data, found, family, 0, True)
