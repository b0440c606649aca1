r"""The error of a model over records and measured frequency responses, together.

Over a record the error is that of the free run from the best initial state, divided by the standard deviation of the
noise where there are responses too; over a response Ĝ it is that of G(θ) at its frequencies, real and imaginary part,
each divided by its standard deviation √(var Ĝ/2). So all count by their likelihood. Derivatives are by central
differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import Block, Infeasible
from emsid.models.free_run import from_rest
from emsid.models.linear.state_space import run_linear
from emsid.record import FrequencyResponse, Record

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

Respond = Callable[[Any, FrequencyResponse], Complex]
"""(model, measured) → (F, ny, nu) the response of the model at its frequencies, sampled like it."""


class LinearProblem:
    """The error of a model over segments and responses.

    Args:
        like: the model, of which ``with_estimates`` changes the parameters.
        names: of the parameters.
        steps: (p,) of the differences.
        segments: of records.
        responses: measured.
        respond: what the model responds.
        noise: standard deviation of the noise of the segments, or (ny,) of each of their outputs.
        stable: whether a model may be tried.
    """

    def __init__(
        self,
        like: Any,
        names: Sequence[str],
        steps: Array,
        segments: Sequence[Record] = (),
        responses: Sequence[FrequencyResponse] = (),
        respond: Respond | None = None,
        noise: float | Array = 1.0,
        stable: Callable[[Any], bool] = lambda model: True,
    ) -> None:
        self.like, self.names, self.steps = like, tuple(names), steps
        self.segments, self.responses, self.respond, self.noise, self.stable = (
            segments, responses, respond, noise, stable
        )  # fmt: skip
        variances = [each.total_or_relative for each in responses]
        self.weights = [np.sqrt(2 / np.maximum(each, np.finfo(float).tiny)) for each in variances]

    def model(self, theta: Array) -> Any:
        """The model with these parameters."""
        return self.like.with_estimates(self.names, theta)

    def residuals(self, theta: Array) -> list[Array]:
        """Those of every segment and every response.

        Raises:
            Infeasible: for a model that may not be tried.
        """
        model = self.model(theta)
        if not self.stable(model):
            raise Infeasible("a pole in the unstable half plane")
        out = [_free_run_error(model, segment, self.noise) for segment in self.segments]
        for measured, weight in zip(self.responses, self.weights, strict=True):
            missed = (self.respond(model, measured) - measured.response) * weight  # type: ignore[misc]
            out.append(np.concatenate([missed.real.ravel(), missed.imag.ravel()]))
        return out

    def linearised(self, theta: Array) -> list[Block]:
        """The residuals with their derivatives."""
        here, columns = self.residuals(theta), []
        for k, step in enumerate(self.steps):
            ends = []
            for side in (step, -step):
                moved = theta.copy()
                moved[k] += side
                with suppress(ModelError):
                    ends.append((side, self.residuals(moved)))
            if len(ends) < 2:  # at the limit of what is stable or possible
                ends.append((0.0, here))
            (over, above), (under, below) = ends
            columns.append([(one - other) / (over - under) for one, other in zip(above, below, strict=True)])
        return [(r, np.column_stack([column[s] for column in columns])) for s, r in enumerate(here)]

    def fit(self, minimum: Minimum) -> Fit[Any]:
        """The fit at a minimum, with the covariance that holds where neighbouring values of a response share data."""
        found = minimum.fit(self.model(minimum.estimate), self.names)
        if not self.responses:
            return found
        shared = np.repeat(
            [1.0, *(each.overlap for each in self.responses)], [len(self.segments), *[1] * len(self.responses)]
        )
        weighted = float(sum(share * (r @ r) for share, r in zip(shared, minimum.residuals, strict=True)))
        freedom = max(minimum.samples - minimum.rank, 1)
        scale = weighted / freedom / minimum.noise_variance if minimum.noise_variance > 0 else 1.0
        return replace(found, covariance=minimum.white_covariance * scale)


def _free_run_error(model: Any, segment: Record, noise: float | Array) -> Array:
    """(N·ny,) the free run of a model from the initial state that fits best over the whole segment, less the output.

    Errors are in units of the noise, one output after the other. The state acts linearly, so that it is found by least
    squares; before a start at rest, rest is known.
    """
    part, begun = model.sampled, from_rest(segment, model.memory)
    late, state = round(part.delay / part.dt), np.zeros(len(part.a))
    u = np.concatenate([np.repeat(begun.input[:1], late, axis=0), begun.input])[: len(begun)]
    forced = run_linear(part.a, part.b, part.c, part.d, state, u)[0] + model.level
    none = np.zeros_like(u)
    free = [run_linear(part.a, part.b, part.c, part.d, one, none)[0] for one in np.eye(len(state))]
    missed, rows = (forced - begun.output) / noise, np.array(free) / noise  # (N, ny), (n, N, ny)
    if not (np.isfinite(rows).all() and np.isfinite(missed).all()):
        raise Infeasible("a run that overflows")
    rows = rows.reshape(len(state), -1).T
    first = np.linalg.lstsq(rows, missed.ravel(), rcond=None)[0]
    return np.asarray((missed - (rows @ first).reshape(missed.shape))[len(begun) - len(segment) :].T.ravel())
