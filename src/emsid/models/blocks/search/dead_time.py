r"""The dead time of a cascade, counted at its input.

A dead time passes through a static map unchanged, f(x(t − 1)) = f(x)(t − 1), so no data show which filter of a cascade
it belongs to. In a search it lands in either, as a leading coefficient b₀ of zero. Where b₀ of a filter is zero within
`ZERO` standard errors, the coefficient is removed and the delay of the cascade is a sample longer. This is kept if
Schwarz's criterion does not prefer the model before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import log

import numpy as np

from emsid.errors import EmsidError
from emsid.estimation.fit import Ending, Fit
from emsid.findings import Finding
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import Search, fit_cascade
from emsid.record import Record

ZERO = 3.0
"""A leading coefficient of fewer standard errors than this may be zero."""
LONGEST = 4
"""The most samples of dead time that are moved to the input."""
ITERATIONS = 40
"""A fit without a coefficient that is zero begins near its minimum; one that needs more steps is not taken."""


def at_the_input(fit: Fit[Cascade], records: Sequence[Record], how: Search) -> Fit[Cascade]:
    """The fit with the dead time of its filters counted at its input, and a finding where that is any.

    Args:
        fit: of a cascade; one whose search was stopped is left as it is.
        records: what it was fitted to.
        how: of further fits, as in `fit_cascade`.
    """
    moved = 0
    for _ in range(LONGEST if fit.ending is Ending.CONVERGED and fit.model.oversampling == 1 else 0):
        found = [again for k in _late(fit) if (again := _moved(fit, k, records, how)) is not None]
        if not found:
            break
        fit = min(found, key=lambda each: each.noise_variance)
        moved += 1
    if not moved:
        return fit
    filters = sum(isinstance(block, Rational) for block in fit.model.blocks)
    data = {"model": fit.model.name, "delay": fit.model.delay, "moved": moved, "filters": filters}
    return replace(fit, findings=(*fit.findings, Finding("dead-time-at-input", fit.model.name, data)))


def _late(fit: Fit[Cascade]) -> list[int]:
    """The filters whose leading coefficient may be zero."""
    cascade, errors = fit.model, dict(zip(fit.names, fit.standard_error.tolist(), strict=True))
    late = []
    for k, (block, span) in enumerate(zip(cascade.blocks, cascade.spans, strict=True)):
        if isinstance(block, Rational) and len(block.numerator) > 1:
            error = errors.get(cascade.names[span.start], 0.0)
            if np.isfinite(error) and abs(block.numerator[0]) < ZERO * error:
                late.append(k)
    return late


def _moved(fit: Fit[Cascade], k: int, records: Sequence[Record], how: Search) -> Fit[Cascade] | None:
    """The converged fit without the leading coefficient of one filter, a sample later; None where that is worse."""
    blocks = list(fit.model.blocks)
    block = blocks[k]
    assert isinstance(block, Rational)
    blocks[k] = Rational(block.numerator[1:], block.denominator, block.delay)
    limits = Search(max_iterations=min(how.get("max_iterations", ITERATIONS), ITERATIONS))
    try:
        again = fit_cascade(
            replace(fit.model, blocks=tuple(blocks), delay=fit.model.delay + 1), records, **(how | limits)
        )
    except EmsidError:
        return None
    if again.ending is not Ending.CONVERGED or not fit.noise_variance > 0:
        return None
    worse = fit.samples * log(again.noise_variance / fit.noise_variance)
    return again if worse <= log(fit.samples) else None
