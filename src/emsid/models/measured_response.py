"""`frequency_response`: the frequency response of a system from its records, by the method that suits them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.arguments import as_names
from emsid.errors import DataError, listed
from emsid.estimation.frequency import NEIGHBOURS, best_linear, half_width, local_polynomials, shared, welch
from emsid.excitation.periods import period_of, settled_periods, whole_periods
from emsid.record import Record
from emsid.record.frequency_response import FrequencyResponse

Array = NDArray[np.float64]


def frequency_response(
    records: Record | Iterable[Record],
    method: str | None = None,
    *,
    reference: str | Sequence[str] = (),
    period: int | None = None,
    window: int | None = None,
) -> FrequencyResponse:
    """The frequency response from the inputs to the outputs.

    ====================  ============================================================================================
    method                what it is
    ====================  ============================================================================================
    ``"periodic"``        the best linear approximation from inputs that repeat, with levels of noise (from periods) and
                          of nonlinear distortion: from several realisations (robust method), or from the lines that an
                          input does not excite (fast method, `emsid.excitation.multisine` with detection lines)
    ``"polynomial"``      the local polynomial method, for any input: leakage is estimated and removed
    ``"welch"``           averaged Hann windows with half overlap, with the coherence
    ====================  ============================================================================================

    Every segment is an experiment. The response is that of inputs held between samples.

    >>> rng = np.random.default_rng(0)
    >>> u = np.tile(rng.standard_normal(100), 3)
    >>> y = np.append(0.0, 2 * u[:-1])
    >>> found = frequency_response(Record(u, y, dt=0.01))
    >>> found.magnitude[:2, 0, 0].round(2)
    array([6.02, 6.02])

    Args:
        records: a record, or several of the same channels.
        method: see above; by default ``"periodic"`` where all inputs repeat, else ``"polynomial"``.
        reference: in closed loop, the names of those input channels that are references, one for every other input: the
            response is that from the other inputs, through the references.
        period: of the input in samples; found where the input, or the reference, repeats exactly.
        window: samples of a window of Welch's method; by default an eighth of the longest segment, at least 16.

    Raises:
        DataError: for records without outputs or of other channels, an unknown method, a period or window that does not
            suit, inputs that cannot be told apart, or references that do not move the inputs.
    """
    several = (records,) if isinstance(records, Record) else tuple(records)
    if not several:
        raise DataError("no record to estimate a frequency response from; give one, or a list of them")
    first, names = several[0], as_names(reference)
    for record in several:
        if (record.dt, record.input_names, record.output_names) != (first.dt, first.input_names, first.output_names):
            raise DataError(f"{record.name} has other channels or another sample time than {first.name}")
    if not first.output.shape[1]:
        raise DataError(f"{first.name} has no output; a frequency response needs one")
    missing = [name for name in names if name not in first.input_names]
    if missing:
        raise DataError(f"{first.name} has no input {missing[0]!r} as reference; it has {listed(first.input_names)}")
    of_r = [first.input_names.index(name) for name in names]
    of_u = [k for k in range(len(first.input_names)) if k not in of_r]
    if names and len(of_u) != len(of_r):
        raise DataError(f"{len(of_r)} references for {len(of_u)} other inputs; give one for every input")
    segments = [segment for record in several for segment in record.segments]
    u, y = [segment.input[:, of_u] for segment in segments], [segment.output for segment in segments]
    r = [segment.input[:, of_r] for segment in segments] if names else u
    known = {"periodic": _periodic, "polynomial": _polynomial, "welch": _welch}
    if method is None:
        period = _common_period(r) if period is None and window is None else period
        method = "periodic" if period else "welch" if window else "polynomial"
    if method not in known:
        raise DataError(f"{method!r} is no method; give {listed(list(known))}")
    try:
        found = known[method](r, u, y, bool(names), period if method == "periodic" else window, first.dt)
    except DataError as problem:
        raise DataError(f"{first.name}: {problem}") from None
    units = [first.input_units[k] for k in of_u]
    return FrequencyResponse(
        **found,
        dt=first.dt,
        input_names=tuple(first.input_names[k] for k in of_u),
        output_names=first.output_names,
        input_units=tuple(units),
        output_units=first.output_units,
        name=first.name,
    )


Signals = Sequence[Array]
Method = Callable[[Signals, Signals, Signals, bool, int | None, float], dict[str, Any]]
"""(references, inputs, outputs of every segment, whether in closed loop, period or window, dt) → the response."""


def _periodic(r: Signals, u: Signals, y: Signals, closed: bool, period: int | None, dt: float) -> dict[str, Any]:
    size = period or _common_period(r)
    if not size:
        raise DataError("the inputs do not repeat in all segments with one period; give it, or another method")
    if min(map(len, u)) < size:
        raise DataError(f"a segment is shorter than the period of {size} samples")
    settled = [settled_periods(each, size) for each in y]
    parts = [[whole_periods(each, size)[-count:] for each, count in zip(x, settled, strict=True)] for x in (u, y, r)]
    found = best_linear(parts[0], parts[1], parts[2])
    how = "robust" if found.total is not None and found.even is None else "fast"
    many = f"{len(u)} experiment{'s' * (len(u) != 1)} of {min(settled)} periods"
    return {
        "frequency": found.lines / (size * dt),
        "response": found.response,
        "total": found.noise if found.total is None else found.total,
        "noise": None if found.total is None else found.noise,
        "even": found.even,
        "realisations": max(len(u) // u[0].shape[1], 1),
        "method": f"periodic, {many}" if found.total is None else f"{how} method, {many}",
    }


def _polynomial(r: Signals, u: Signals, y: Signals, closed: bool, window: int | None, dt: float) -> dict[str, Any]:
    f, found = local_polynomials(r, _seen(u, y, closed))
    response, total = found.plant(u[0].shape[1], closed)
    overlap = shared(half_width(r[0].shape[1]))
    return {
        "frequency": f / dt, "response": response, "total": total, "overlap": overlap, "method": "local polynomials"
    }  # fmt: skip


def _welch(r: Signals, u: Signals, y: Signals, closed: bool, window: int | None, dt: float) -> dict[str, Any]:
    longest = max(map(len, u))
    size = max(16, longest // 8) if window is None else window
    if not 8 <= size <= longest:
        raise DataError(f"a window of {size} samples; give 8 to {longest}, the longest segment")
    regressed, coherence = welch(r, _seen(u, y, closed), size)
    response, total = regressed.plant(u[0].shape[1], closed)
    return {
        "frequency": np.fft.rfftfreq(size, dt)[1:],
        "response": response,
        "total": total,
        "coherence": coherence[:, : y[0].shape[1]],
        "overlap": NEIGHBOURS,
        "method": f"Welch, windows of {size} samples",
    }


def _seen(u: Signals, y: Signals, closed: bool) -> Signals:
    return [np.hstack(pair) for pair in zip(y, u, strict=True)] if closed else y


def _common_period(r: Signals) -> int | None:
    """The period in samples with which all channels of all segments repeat; None where one does not."""
    periods = [period_of(each[:, k]) if np.ptp(each[:, k]) else 1 for each in r for k in range(each.shape[1])]
    if not all(periods):
        return None
    common = lcm(*(period or 1 for period in periods))
    return common if 1 < common <= min(map(len, r)) // 2 else None
