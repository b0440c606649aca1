r"""What the inputs and its own past still explain of the error of a free run.

The error e(t) is regressed on what the model has seen and done: the inputs u, its output ŷ, their powers, magnitudes
and signs and the products u·ŷ, each as it is and through lags of several lengths,

    e(t) ≈ Σᵢₖ cᵢₖ Gₖ sᵢ(t),    G₀ = 1,  Gₖ = (1 − aₖ)/(1 − aₖ q⁻¹).

The lags of 2, 8, 32, 128 samples span responses from those of a sample to those of the slowest drives. The error one
sample ago is a further column: a map between two filters is not among these functions, so larger models are tried where
the error follows from its own past, too. Coefficients are estimated on four fifths of the samples, in stretches, and
judged on the fifth left out, in turn. A true model leaves white noise, of which one stretch explains nothing in another
one, so the share is about zero there, and a little negative. It says whether a larger model can find anything of these
kinds; a significance test would ask for larger models in every long record, however little they gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.fit import Fit
from emsid.estimation.linear.filtering import filtered_from
from emsid.models.model import Run
from emsid.record import Record
from emsid.selection.improvement import NEGLIGIBLE
from emsid.validation.comparison import Assessment, assess

Array = NDArray[np.float64]

LAGS = (2, 8, 32, 128)
"""Samples of the time constants of the lags."""
PARTS, STRETCHES = 5, 4
"""Parts that are left out in turn, each of several stretches of the record."""
SHRUNK = 0.01
"""The weight of a prior of zero on every coefficient of a column of unit power, as a share of the samples: directions
in which the columns hardly differ would follow noise, and explain nothing elsewhere."""
PER_COLUMN = 10
"""The fewest samples for each column of the regression. So noise costs at most a tenth on the parts left out; where
more is lost, the error is no noise: it is of another kind in one part of the record than in another."""
LACKS = frozenset({"effect-missing", "parameter-changes", "value-contradicted", "free-run-drifts"})
"""Findings of a fit that name what it lacks."""


def leaves_nothing(fits: Sequence[Fit[Any]], record: Record) -> Fit[Any] | None:
    """The fit with the smallest free-run error, if a larger model can find nothing in what it leaves; else None.

    Args:
        fits: of any models.
        record: what they were fitted to.
    """
    found: list[Assessment] = []
    for fit in fits:
        with suppress(EmsidError):
            found.append(assess(fit, record))
    if not found:
        return None
    assessed = min(found, key=lambda each: each.row.ranked_by)
    best, run = assessed.fit, assessed.simulation
    lacks = best.ending.before_minimum or any(each.code in LACKS for each in best.findings)
    if lacks:
        return None
    share = explained_share(record, run)
    return best if share is not None and -1 / PER_COLUMN <= share <= NEGLIGIBLE else None


def explained_share(record: Record, run: Run) -> float | None:
    """The share of the mean square error of a free run that can be explained on stretches left out.

    Args:
        record: measured.
        run: the free run over it.

    Returns:
        Of the output of which it is largest; about zero or negative where only noise is left; None for a record that is
        too short to tell, or a run that diverges.
    """
    counted = run.counted & np.isfinite(run.output).all(axis=1)
    if run.diverged_at is not None or not counted.any():
        return None
    errors = np.where(counted[:, None], record.output - run.output, 0.0)
    columns = _columns(record, run.output, errors)[counted]
    if len(columns) < PER_COLUMN * columns.shape[1]:
        return None
    return max(_left_out(columns, error) for error in errors[counted].T)


def _columns(record: Record, output: Array, errors: Array) -> Array:
    """(N, m) all signals of a record, as they are and through every lag, and the last errors; segments begin anew."""
    signals = [*record.input.T, *np.nan_to_num(output).T]
    scaled = [x / (float(np.abs(x).max()) or 1.0) for x in signals]
    shapes = [shape for x in scaled for shape in (x, x**2, x**3, np.abs(x), np.sign(x))]
    known = record.input.shape[1]
    shapes += [u * y for u, y in product(scaled[:known], scaled[known:])]
    rows = np.array(shapes)
    past = np.roll(errors.T, 1, axis=1)
    past[:, [0, *record.breaks]] = 0.0
    segments = np.split(rows, record.breaks, axis=1)
    lagging = [np.concatenate([_lagging(each, samples) for each in segments], axis=1) for samples in LAGS]
    return np.asarray(np.concatenate([np.ones((1, len(record))), rows, past, *lagging]).T)


def _lagging(rows: Array, samples: int) -> Array:
    """Signals (k, N) through a lag of unit gain, from rest at their first values."""
    a = float(np.exp(-1.0 / samples))
    return filtered_from([1.0 - a], [1.0, -a], rows, a * rows[:, :1])[0]


def _left_out(columns: Array, error: Array) -> float:
    """One minus the ratio of the squared error that a regression leaves on the parts left out to that before."""
    part = np.arange(len(error)) * PARTS * STRETCHES // len(error) % PARTS
    scale = np.sqrt(np.mean(columns**2, axis=0))
    scaled = columns / np.where(scale > 0, scale, 1.0)
    left = 0.0
    for k in range(PARTS):
        out = part == k
        prior = np.sqrt(SHRUNK * np.count_nonzero(~out)) * np.eye(columns.shape[1])
        rows, known = np.vstack([scaled[~out], prior]), np.append(error[~out], np.zeros(columns.shape[1]))
        found = np.linalg.lstsq(rows, known, rcond=None)[0]
        left += float(np.sum((error[out] - scaled[out] @ found) ** 2))
    before = float(error @ error)
    return 1.0 - left / before if before > 0 else 0.0
