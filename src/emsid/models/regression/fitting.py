"""A structure fitted by the method that its options ask for."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.linear.recursive import recursive_least_squares
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.models.regression.free_run_fit import fit_free_run
from emsid.models.regression.instruments import fit_instruments
from emsid.models.regression.intervals import with_robust_intervals
from emsid.models.regression.narx import Narx, Structure
from emsid.record import Record


def fit_structure(
    structure: Structure,
    records: Record | Iterable[Record],
    *,
    ridge: float = 0.0,
    forgetting: float | None = None,
    history: bool = False,
    threads: int | None = None,
    free_run: bool = False,
    instruments: bool = False,
    start: ArrayLike | None = None,
    transient: int | None = None,
    control: Control = FREE,
) -> Fit[Narx]:
    """Least squares; recursive with a forgetting factor or a history; Gauss–Newton steps for the free run."""
    recursive = forgetting is not None or history
    if sum((bool(ridge), recursive, free_run, instruments)) > 1 and (free_run or instruments):
        raise ModelError("ridge, forgetting (or history), free_run and instruments exclude each other; choose one")
    if instruments:
        begin = None if start is None else np.asarray(start, dtype=float)
        return fit_instruments(structure, records, start=begin, control=control)
    if free_run:
        return fit_free_run(structure, records, start=start, transient=transient, control=control, restarts=True)
    if start is not None or transient is not None:
        raise ModelError("start and transient are for a fit to the free run; give free_run=True, or leave them out")
    if not recursive:
        several = (records,) if isinstance(records, Record) else tuple(records)
        fit = least_squares(structure, several, ridge=ridge, threads=threads, each_block=control.check)
        return fit if ridge else with_robust_intervals(fit, several)
    if ridge:
        raise ModelError("ridge is for a batch estimate and forgetting for a recursive one; choose one of them")
    return recursive_least_squares(structure, records, forgetting=forgetting or 1.0, history=history)
