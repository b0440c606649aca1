r"""Curves of feedback models for estimates that are moved a little, to first order and without another search.

The rest x = g(x, u, θ) moves by (I − g_x)⁻¹ g_θ δ. A free run starts from a state x₀ that its first samples show, by
least squares; with their exact derivatives J_θ and J_x it moves by dx₀/dθ = −J_x⁺ J_θ, and a later sample by
J_θ + J_x dx₀/dθ.

**Bands of static maps** are in units of their inputs and outputs that the data determine. The data determine a map f of
z to w up to the units of z and w, and often only up to a line beside it. A fit fixes the units by elements of its
matrices (`emsid.models.feedback.coordinates`). Where the data hardly determine these, as where a lag of z and a lag of
w have about the same effect, the units change from one estimate to another while the map of the signals remains the
same. So a model close to the fitted one is compared with it in the units of signals:

    z    its mean and standard deviation over the record are those of the fitted model
    w    the gain from w to the output is that of the fitted model: its root mean square over the spectrum of w, with
         all maps replaced by the lines that are closest to them over the record (their equivalent gains)
    g    of a map that is multiplied by a signal, the root mean square of the signal

A map that takes one factor on both sides (`Scaling.JOINT`) has the unit of z only, and one that takes none has no free
unit. Of a map that contains lines the shape is shown: what differs from a line over most of the inputs that it has
seen, or from a level, if it is multiplied by a signal. A cascade has the same units by its filters, which have a gain
of one (`emsid.models.blocks.gain`).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError, ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.models.bands import Band, with_error
from emsid.models.blocks.static_maps import Scaling
from emsid.models.characteristics import settled
from emsid.models.feedback.coordinates import Visited, free_lines
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.normal_form import power_of, squared_gains
from emsid.models.free_run import from_rest
from emsid.models.initial_states import initial_state
from emsid.record import Record

Array = NDArray[np.float64]

OSCILLATION = 400
"""Steps over which the output of a model that oscillates at a constant input is averaged."""
STILL, GROWS = 1e-6, 1.5
"""An output that changes by less than the first share is at rest; an oscillation that grows faster than by the second
from one half of these steps to the other is unstable."""

OBSERVABLE = 1e-2
"""A direction of the initial state is estimated if the first samples show it by this share of the best one."""
STATE_STEPS, STATE_SAMPLES = 3, 2_000
"""Steps to the initial state of a model close to another one, and samples that show it."""

EQUATION, UNCHANGED, MOST_DIGITS = 10_000, 0.01, 8
"""An equation has the digits of its intervals, and at most so many more: as many as its free run over so many samples
needs to change by less than this share of its residual; on other data it may change ten times as much."""


def about_rest(model: FeedbackModel, level: float) -> tuple[Array, Array]:
    """The state (n,) at rest, and the linear part there, (n + 1, n + 1) from (x, u) to (x⁺, y)."""
    rest = model.resting(level)
    return rest, model.linearised_at(rest, level)[1]


def feedback_at_rest(model: FeedbackModel, levels: Array) -> Callable[[FeedbackModel], Array]:
    """A function from a feedback model, or one with parameters close to it, to its outputs (m,) at rest.

    One step from the rests of the model, with its linear part there, leads to those of the other, to first order. Where
    a model oscillates, as in stiff friction, it is the mean of the oscillation.

    Args:
        model: with the rests.
        levels: (m,) of a constant input.

    Raises:
        ModelError: where it does not come to rest.
    """
    n, found = model.states, list[tuple[Array, Array, Array]]()
    for level in levels:
        rest, whole = about_rest(model, float(level))
        if _oscillates(model, float(level), rest):
            found.append((np.full(OSCILLATION, level), rest, np.zeros(n)))
            continue
        settled(model, float(level))
        back = np.linalg.solve((np.eye(n) - whole[:n, :n]).T, whole[n, :n])
        found.append((np.full(1, level), rest, np.asarray(back, dtype=np.float64)))

    def outputs(other: FeedbackModel) -> Array:
        values = []
        for level, rest, back in found:
            out, after = other.stepped(level, rest)
            values.append(float(out.y.mean()) + back @ (after - rest))
        return np.array(values)

    return outputs


def _oscillates(model: FeedbackModel, level: float, state: Array) -> bool:
    """Whether the output neither rests nor grows from a state where a run for a constant input ended."""
    y = model.stepped(np.full(OSCILLATION, level), state)[0].y
    if not np.isfinite(y).all():
        return False
    early, late = (float(np.ptp(half)) for half in np.array_split(y, 2))
    return bool(early > STILL * np.abs(y).max() and late < GROWS * early)


def feedback_run_error(fit: Fit[Any], record: Record, transient: int | None) -> Array:
    """(N, 1) the standard error of the free run of a feedback model over a record, NaN before the end of a transient.

    Args:
        fit: with the covariance; parameters of no finite variance are kept.
        record: with the channels of the model.
        transient: as in `emsid.models.free_run.free_run`.

    Raises:
        ModelError: for a run that diverges.
    """
    model: FeedbackModel = fit.model
    first = max(model.memory, transient or 0)
    at = [model.names.index(name) for name in fit.names]
    known = np.isfinite(np.diag(fit.covariance))
    covariance = np.where(np.outer(known, known), fit.covariance, 0.0)
    errors = []
    for begun in record.segments:
        segment = from_rest(begun, first)
        error = np.full((len(segment), 1), np.nan)
        if len(segment) > first:
            u, y = np.ascontiguousarray(segment.input[:, 0]), segment.output[:first, 0]
            try:
                rows = model.gradient(u, model.trajectory(u, initial_state(model, u, y)))
            except Infeasible as problem:
                raise ModelError(str(problem)) from None
            by_theta, by_state = rows[:, at], rows[:, len(model.parameters) :]
            begin = slice(model.edge, first)
            moved = np.linalg.pinv(by_state[begin], rcond=OBSERVABLE) @ by_theta[begin]
            slopes = (by_theta - by_state @ moved)[first:]
            error[first:, 0] = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", slopes, covariance, slopes), 0.0))
        errors.append(error[len(segment) - len(begun) :])
    return np.concatenate(errors)


def visited(model: FeedbackModel, record: Record) -> Visited:
    """The signals of the model over the record, from rest at the first input."""
    inputs = _inputs(record)
    return Visited.of(model, inputs, [model.resting(float(u[0])) for u in inputs])


def visited_in_free_run(model: FeedbackModel, record: Record) -> Visited:
    """The signals of the model over the record, each segment from the state that its first samples show.

    The rest of a model with a slow pole may be far from all states of the data. A segment that is too short to show a
    state begins at rest.
    """
    return Visited.of(model, _inputs(record), _first_states(model, record))


def visited_alongside(model: FeedbackModel, record: Record) -> Callable[[FeedbackModel], Visited]:
    """A function from a feedback model close to this one to its signals over the record.

    The free run of this one begins as in `visited_in_free_run`. That of another one begins at the states from which its
    output is closest to that of this one, as those of a fit move with its parameters.
    """
    states, inputs = _first_states(model, record), _inputs(record)
    begun = [u[:STATE_SAMPLES] for u in inputs]
    outputs = [model.output(u, x) for u, x in zip(begun, states, strict=True)]

    def signals(other: FeedbackModel) -> Visited:
        moved = []
        for u, y, state in zip(begun, outputs, states, strict=True):
            x = state
            for _ in range(STATE_STEPS):
                run, rows = other.with_state_gradient(u, x)
                x = x + np.linalg.lstsq(rows[other.edge :], (y - run)[other.edge :], rcond=None)[0]
            moved.append(x)
        return Visited.of(other, inputs, moved)

    return signals


def _first_states(model: FeedbackModel, record: Record) -> list[Array]:
    """The states (n,) that the first samples of every segment show; those of rest if it is too short."""
    several = zip(_inputs(record), [each.output[: model.memory, 0] for each in record.segments], strict=True)
    return [initial_state(model, u, y if len(u) > model.memory else y[:0]) for u, y in several]


def _inputs(record: Record) -> list[Array]:
    """(N,) the input of every segment."""
    return [np.ascontiguousarray(segment.input[:, 0]) for segment in record.segments]


def rounded_equation(fit: Fit[Any], record: Record) -> str:
    """The equation of a feedback model with the digits that the data support; a model file has all of them.

    The digits of an interval alone are too few: where the data determine a sum, each of its terms needs the digits of
    the sum.
    """
    model: FeedbackModel = fit.model
    error = fit.standard_error
    if not fit.has_intervals or not (np.isfinite(error) & (error > 0)).all():
        return model.equation()
    begin = record[:EQUATION]
    run, most = _output_or_none(model, begin), UNCHANGED * float(np.sqrt(fit.noise_variance))
    if run is None:
        return model.equation()
    first = -np.floor(np.log10(error)).astype(int)
    for more in range(MOST_DIGITS):
        values = [round(value, places + more) for value, places in zip(fit.estimate.tolist(), first, strict=True)]
        rounded = model.with_estimates(fit.names, np.array(values))
        moved = _output_or_none(rounded, begin)
        if moved is not None and np.sqrt(np.mean((moved - run) ** 2)) <= most:
            return rounded.equation()
    return model.equation()


def _output_or_none(model: FeedbackModel, record: Record) -> Array | None:
    """(K,) the output from rest; None where the run diverges."""
    with suppress(EmsidError, Infeasible):
        model.check()
        return visited(model, record).y
    return None


# At most this many inputs of a map, between these quantiles, show a line in it; beyond them a curve may be unknown.
COMPARED, MIDDLE = 2_000, (0.1, 0.9)
LONGEST = 10_000
"""Samples of a record from whose runs the units are taken."""


def map_band(fit: Fit[Any], record: Record, k: int, x: Array, *, level: float = 0.95) -> Band:
    """A static map of a feedback model with its band; without one where no parameter of the map is estimated.

    Args:
        fit: of the model.
        record: with the inputs of the model.
        k: the map, from 0.
        x: (m,) inputs of the map.
        level: of the band.
    """
    model: FeedbackModel = fit.model
    value = model.maps[k].value(x)
    if not fit.has_bands or not set(model.names[model.spans[k]]) & set(fit.names):
        return Band(x, value, np.full(len(x), np.nan), level)
    return Band(x, value, with_error(fit, map_shape(model, record, k, x))[1], level)


def map_shape(model: FeedbackModel, record: Record, k: int, x: Array) -> Callable[[FeedbackModel], Array]:
    """A function from a feedback model close to this one to its map (m,) at inputs x (m,), in the units of this one.

    Args:
        model: whose units are taken.
        record: with the inputs of the model.
        k: the map, from 0.
        x: (m,) inputs of the map.
    """
    of = visited_alongside(model, record[:LONGEST])
    run = of(model)
    power = power_of(run.w[:, k])
    mean, unit_in, unit_out = _units(model, run, k, power)
    low, high = np.quantile(run.z[:, k], MIDDLE)
    at = run.z[(low <= run.z[:, k]) & (run.z[:, k] <= high), k]
    at = at[:: max(1, len(at) // COMPARED)]
    mix = free_lines(model, k, at)
    lines, compared = (np.vander(each, len(mix), increasing=True) @ mix for each in (x, at))
    without = lines @ np.linalg.pinv(compared)

    def shape(other: FeedbackModel) -> Array:
        centre, into, out = _units(other, of(other), k, power)
        values, seen = (
            other.maps[k].value(centre + (each - mean) * into / unit_in) * out / unit_out for each in (x, at)
        )
        return np.asarray(values - without @ seen)

    return shape


def _units(model: FeedbackModel, run: Visited, k: int, power: Array) -> tuple[float, float, float]:
    """Mean and unit of the input of a map, and the unit in which its output is compared."""
    map_, z = model.maps[k], run.z[:, k]
    unit = float(np.std(z)) or 1.0
    if map_.scaling is Scaling.NONE:
        return 0.0, 1.0, 1.0
    if map_.scaling is Scaling.JOINT:
        return float(z.mean()), unit, 1.0 / unit
    g = float(np.sqrt(np.mean(model.factor(run.x, run.u)[:, k] ** 2)))
    n = model.states
    behind = np.append(model.matrix[:n, n + 1 + k], model.matrix[-1, n + 1 + k])
    return float(z.mean()), unit, g * float(np.sqrt(behind @ squared_gains(model, run, k, power) @ behind))
