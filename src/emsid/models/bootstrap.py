r"""Intervals by bootstrap over segments: the model is fitted again to pieces of the data, drawn with replacement.

The data are cut into m pieces that are long compared with the memory of the system, so that pieces are nearly
independent. Of these, m are drawn with replacement, and the model is fitted to them, as separate segments. The spread
of the estimates over many draws is that over experiments (Künsch 1989). It needs no assumption on the noise within a
piece, nor that the cost is quadratic; but it needs more pieces than parameters. The covariance is multiplied by
m/(m − 1), since the mean of the pieces is estimated too.

References:
    Künsch, *The jackknife and the bootstrap for general stationary observations*, Annals of Statistics 17 (1989).
    Efron, Tibshirani, *An Introduction to the Bootstrap* (1993), sec. 8.6.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.borders import border
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.findings import Finding
from emsid.models.kinds import capabilities_of
from emsid.models.refit_data import Budget, Data
from emsid.models.refitting import refitted
from emsid.record import Record, concatenate
from emsid.record import segments as segments_of

Array = NDArray[np.float64]

PIECES, PER_PARAMETER = 30, 3
"""The number of pieces, and that for each parameter; the larger one is taken."""
LENGTHS = 3
"""The least length of a piece, in lengths of the model's memory."""
SHORTEST = 30
"""The fewest samples of a piece."""
FEWEST = 10
"""The fewest pieces, and the fewest draws."""
ENOUGH = 0.8
"""The share of the draws that must give a model."""


def bootstrap(
    fit: Fit[Any],
    records: Record | Iterable[Record],
    count: int = 200,
    *,
    rng: np.random.Generator,
    pieces: int | None = None,
    executor: Executor | None = None,
    control: Control = FREE,
) -> Fit[Any]:
    """The fit with a covariance from refits to pieces of its data, for intervals and bands.

    >>> u = np.random.default_rng(0).standard_normal(2000)
    >>> y = np.convolve(u, [0.0, 1.0, 0.5])[:2000] + 0.1 * np.random.default_rng(1).standard_normal(2000)
    >>> from emsid import arx, fit
    >>> record = Record(u, y, dt=0.01)
    >>> known = fit(arx(0, 2), record)
    >>> drawn = bootstrap(known, record, 100, rng=np.random.default_rng(2))
    >>> bool(np.all(abs(drawn.standard_error / known.standard_error - 1) < 0.5))
    True

    Args:
        fit: of a regression, a polynomial, process or state-space model, or a cascade.
        records: those that it was fitted to.
        count: how many times pieces are drawn.
        rng: draws the pieces.
        pieces: how many; by default 30, or three for each parameter if that is more, as far as the data suffice. Where
            the data have at least as many segments of their own, these are drawn.
        executor: where the fits run, such as a `concurrent.futures.ProcessPoolExecutor`; the result is the same.
        control: when to stop, and where to report progress.

    Raises:
        ModelError: for a model that cannot be fitted again, data that are too short, or numbers out of range.
        Stopped: if the control ends it.
    """
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < FEWEST:
        raise ModelError(f"bootstrap: {count!r} draws; give a whole number of at least {FEWEST}", arguments=("count",))
    several = [records] if isinstance(records, Record) else list(records)
    _check_repeated(fit, several)
    cut = pieces_of(fit, list(segments_of(several)), pieces)
    draws = rng.integers(len(cut), size=(int(count), len(cut)))
    in_turn = map if executor is None else executor.map
    found: list[Array] = []
    estimates = iter(in_turn(partial(_estimate, fit, cut), draws))
    for draw in range(int(count)):
        control.doing(f"fitting to drawn pieces ({len(cut)} of {len(cut[0]):,} samples)", draw, int(count))
        if (estimate := next(estimates)) is not None:
            found.append(estimate)
    if len(found) < ENOUGH * count:
        raise ModelError(
            f"{fit.model.name}: only {len(found)} of {count} fits to drawn pieces succeeded; record longer"
        )
    covariance = len(cut) / (len(cut) - 1) * np.atleast_2d(np.cov(np.array(found).T))
    data = {"model": fit.model.name, "count": len(found), "pieces": len(cut), "samples": min(map(len, cut))}
    return replace(
        fit, covariance=covariance, findings=(*fit.findings, Finding("intervals-by-bootstrap", fit.model.name, data))
    )


def _check_repeated(fit: Fit[Any], records: Sequence[Record]) -> None:
    """Refuse a linear fit that a refit does not repeat, such as one with a ridge, and kinds of incomparable estimates.

    Raises:
        ModelError: for these.
    """
    same = capabilities_of(fit.model).same_in_every_fit
    if same and fit.ending is Ending.SOLVED:
        again = refitted(fit, Data(records), Budget.MINIMUM).estimate
        same = np.allclose(again, fit.estimate, rtol=1e-6, atol=1e-9 * np.abs(again).max())
    if not same:
        raise ModelError(f"{fit.model_name}: a fit of this kind ({fit.method}) cannot be repeated on drawn pieces")


def _estimate(fit: Fit[Any], cut: Sequence[Record], draw: Sequence[int]) -> Array | None:
    """The estimate from one draw of pieces; None where it gives no model."""
    drawn = concatenate([cut[k] for k in draw], "drawn pieces")
    again = None
    with border(f"fit of {fit.model.name} to drawn pieces", fit.model.name, expected=True):
        again = refitted(fit, Data((drawn,)), Budget.MINIMUM)
    if again is None:
        return None
    return again.estimate if again.names == fit.names and np.isfinite(again.estimate).all() else None


def pieces_of(fit: Fit[Any], segments: Sequence[Record], pieces: int | None) -> list[Record]:
    """The pieces to draw from: the segments themselves where they are many, otherwise equal parts of them.

    Args:
        fit: of the model; its memory and number of parameters limit the pieces.
        segments: the data.
        pieces: how many; see `bootstrap`.

    Raises:
        ModelError: where there are too few.
    """
    shortest = max(SHORTEST, LENGTHS * fit.model.memory)
    long = [segment for segment in segments if len(segment) >= shortest]
    wanted = max(PIECES, PER_PARAMETER * len(fit.estimate)) if pieces is None else pieces
    samples = sum(map(len, long))
    if pieces is None:
        wanted = min(wanted, max(samples // shortest, 1))
    if len(long) >= wanted:
        cut = long
    else:
        length = max(samples // max(wanted, 1), shortest)
        cut = []
        for segment in long:
            parts = max(len(segment) // length, 1)
            edges = [len(segment) * k // parts for k in range(parts + 1)]
            cut += [segment[a:b] for a, b in pairwise(edges)]
    least = max(FEWEST, len(fit.estimate) + 1)
    if len(cut) < least:
        raise ModelError(
            f"{fit.model.name}: the records make {len(cut)} pieces of at least {shortest} samples, but a "
            f"bootstrap of {len(fit.estimate)} parameters needs {least}; record longer"
        )
    return cut
