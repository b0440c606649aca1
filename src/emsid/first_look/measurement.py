"""How the channels of a record were measured: their resolution and limits, outliers, and the sample time.

References:
    Åström, Wittenmark, *Computer-Controlled Systems*, 3rd ed. (1997), sec. 2.9: 4 to 10 samples in a rise time for
    control; identification takes more.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.filtering import spectrum
from emsid.estimation.uncertainty.rounding import quantisation
from emsid.findings import Finding
from emsid.first_look.columns import FEWEST_LEVELS
from emsid.first_look.examined import Examined, is_position, units_of
from emsid.first_look.levels import FEW, LAGS, MOST, PART, SAME
from emsid.first_look.outliers import about_outliers, outliers_of_answer
from emsid.first_look.stops import stops
from emsid.selection.improvement import DIFFERENT

Array = NDArray[np.float64]

CLIPPED = "output-clipped"
"""The finding about an output that stands at both ends of its range."""
FEW_STEPS = 8
"""A deviation of fewer quantisation steps is coarse."""
FEWEST_CHANGES = 30
"""Fewer changes of a signal show no rate at which it is updated."""
FASTEST, SLOWEST = 1.5, 200.0
"""Samples in a time constant below which sampling is too slow, and above which it is too fast."""


def resolution(data: Examined) -> Iterable[Finding]:
    """Quantisation of the output, and samples at a limit of its range."""
    units, at_stop = units_of(data.record), cache(lambda: stops(data.record))
    for name, x in ((data.output, data.y), (data.input, data.u)):
        unit = units[name]
        levels, counts = np.unique(x, return_counts=True)
        step = quantisation(levels)
        is_output = name == data.output
        if is_output and len(levels) <= FEW:
            yield Finding("few-output-levels", name, {"levels": len(levels)})
        elif is_output and step is not None and x.std() < FEW_STEPS * step:
            yield Finding("coarse-values", name, {"step": step, "unit": unit, "levels": float(x.std() / step)})
        if len(levels) < FEWEST_LEVELS:
            continue
        limits = []
        for side, k, near in (("lower", 0, counts[1:11]), ("upper", -1, counts[-11:-1])):
            share = float(counts[k] / counts.sum())
            is_zero = abs(levels[k]) <= SAME * np.max(np.abs(x))
            if share < 0.01 or counts[k] < 10 * np.median(near) or is_zero:
                continue
            there = x == levels[k]
            if is_output and not _is_cut(x, there):
                continue
            if is_output and side in at_stop():
                code = "joint-at-stop"
            else:
                code = "values-cut-off" if is_output else "command-limited"
            limits.append(Finding(code, name, {"side": side, "limit": float(levels[k]), "unit": unit, "share": share}))
        if [each.code for each in limits] == ["values-cut-off"] * 2:  # a tank or an axis at one end is no such sensor
            lower, upper = (each.data["limit"] for each in limits)
            share = sum(each.data["share"] for each in limits)
            limits = [Finding(CLIPPED, name, {"lower": lower, "upper": upper, "unit": unit, "share": share})]
        yield from limits


def _is_cut(y: Array, there: NDArray[np.bool_]) -> bool:
    """Whether an output comes to a limit in motion and stays, as at the end of the range of a sensor.

    One that settles, as at the largest supply voltage, comes slowly, also in counts.
    """
    steps, arrivals = np.abs(np.diff(y)), np.flatnonzero(there[1:] & ~there[:-1])
    arrivals = arrivals[arrivals > 0]
    return bool(len(arrivals) and np.median(steps[arrivals - 1]) > PART * np.percentile(steps, 95))


def outliers(data: Examined) -> Iterable[Finding]:
    """Single samples far from both neighbours."""
    found, away = outliers_of_answer(data.measured.output[:, 0], data.measured.input[:, 0])
    if len(found):
        yield about_outliers(data.output, found, away)


def sampling(data: Examined) -> Iterable[Finding]:
    """Repeated samples, aliasing, and the sample time against the time constant."""
    dt = data.record.dt
    yield from _input_logged_slower(data)
    held = repeated(data.y[~data.near_zero] if (~data.near_zero).any() else data.y)
    if held > 1:
        yield Finding("samples-repeated", data.output, {"factor": held, "dt": dt, "better": held * dt})
        return
    size = min(len(data.y), 1024)
    frequency, power = np.fft.rfftfreq(size, dt), spectrum(data.y, data.y, size).real
    total = 3 / 8 * size**2 * float(data.y.var())  # of the whole output through the Hann window of the spectrum
    high = float(power[frequency > 0.35 / dt].sum() / total)
    if high > 0.05:
        yield Finding("aliasing-possible", data.output, {"share": high, "frequency": 0.35 / dt, "confidence": 0.5})
    if data.linear is None or data.linear.fit < 0.7:
        return
    samples = data.linear.time_constant
    numbers = {"time_constant": samples * dt, "samples": samples, "dt": dt, "confidence": round(data.linear.fit, 2)}
    if samples > max(map(len, data.record.segments)):
        if not is_position(data.record) and not _settles_without_trend(data):
            yield Finding("output-integrates", data.output, {"input": data.input})
    elif samples < FASTEST and _is_proportional(data):
        yield Finding("sampling-too-slow", data.output, numbers)
    elif samples > SLOWEST:
        yield Finding("sampling-too-fast", data.output, numbers | {"factor": int(samples // 50)})


def _input_logged_slower(data: Examined) -> Iterable[Finding]:
    """An input that changes at every k-th row only, though the drive follows one that changes more often.

    A command that is held explains every sample. After one that has changed unseen, one-step errors are larger than
    after a new one: by 2 to 30 in the square for signals of noise, PRBS and drifts, k of 2 to 5, and at most by 1.4 for
    held ones. A nonlinearity, which a linear model lacks, makes them largest after a new one.
    """
    changes = np.flatnonzero(np.diff(data.u)) + 1
    if len(changes) < FEWEST_CHANGES or data.response.delay is None:
        return
    k, delay = int(np.gcd.reduce(np.diff(changes))), max(data.response.delay, 1)
    if k < 2 or len(data.y) <= LAGS + delay:
        return
    t, lags = np.arange(LAGS + delay, len(data.y)), range(1, LAGS + 1)
    past = [data.y[t - lag] for lag in lags] + [data.u[t - delay - lag + 1] for lag in lags]
    regressors = np.column_stack([*past, np.ones(len(t))])
    errors = data.y[t] - regressors @ np.linalg.lstsq(regressors, data.y[t], rcond=None)[0]
    phase = (t - delay - changes[0]) % k
    squares = [float(np.mean(errors[phase == each] ** 2)) for each in range(k)]
    if DIFFERENT * squares[0] < min(squares[1:]):
        yield Finding("input-logged-slower", data.input, {"output": data.output, "factor": k, "dt": data.record.dt})


def _settles_without_trend(data: Examined) -> bool:
    """Whether a model that settles within the record explains the output but for its trend: it drifts then."""
    settling, longest = data.linear_without_trend, max(map(len, data.record.segments))
    if settling is None or data.linear is None:
        return False
    return settling.fit >= data.linear.fit - PART and settling.time_constant <= longest


def _is_proportional(data: Examined) -> bool:
    """Whether the output follows the delayed input without a lag to be seen, also at high frequencies of the input."""
    size = min(len(data.u), 1024)
    power = spectrum(data.u, data.u, size).real[1:]
    fast = power[np.fft.rfftfreq(size)[1:] > 1 / (2 * np.pi * FASTEST)].sum() / power.sum()
    return bool(fast > PART and abs(data.response.correlation) > MOST)


def repeated(y: Array) -> int:
    """How many times every value of y (N,) is repeated, as where a log is faster than its sensor; 1 where it is not."""
    changes = np.flatnonzero(np.diff(y) != 0)
    if len(changes) < FEWEST_CHANGES:
        return 1
    distances, sizes = np.diff(changes), np.abs(y[changes + 1] - y[changes])
    usual = int(np.median(distances))
    step = quantisation(np.unique(y)) or 0.0
    if usual < 2 or np.median(sizes) < 1.5 * step:  # slow changes of a coarse sensor repeat values as well
        return 1
    early, late = np.percentile(distances, (25, 75))
    return usual if late - early <= 0.35 * usual and np.mean(distances < 0.6 * usual) < 0.2 else 1
