"""What the data of a record allow, and what they do not: findings before any model is fitted.

Every finding says how sure it is, as ``confidence`` from 0 to 1, and its sentence says what to do next.

References:
    Ljung, L. (1999). System Identification: Theory for the User, 2nd ed., chapters 13 (experiments) and 14 (data).
    Åström, K. J., and Wittenmark, B. (1997). Computer-Controlled Systems, 3rd ed., section 2.9: 4 to 10 samples in a
    rise time for control; identification takes more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.filtering import spectrum
from emsid.estimation.linear.least_squares import LARGEST
from emsid.excitation import largest_order, persistent_excitation_order
from emsid.excitation.between_samples import may_be_continuous, repeats
from emsid.findings import Finding
from emsid.first_look.baseline import Baseline, baseline
from emsid.first_look.columns import FEWEST_LEVELS, quantisation
from emsid.first_look.dynamics import Response, correlation, feedback, response
from emsid.first_look.names import ColumnQuantity, meaning
from emsid.first_look.nonlinearity import nonlinearity
from emsid.first_look.standstill import NEAR_ZERO, at_rest, breakaway, dead_zone, near_zero
from emsid.record import Record

Array = NDArray[np.float64]

LINEAR_ORDER, FRICTION_ORDER = 4, 8
"""The order of excitation that a linear model of second order needs, and that of a regression with friction terms."""
TOLERANCE = 1e-3
"""Singular values of the lagged input below this share of the largest are no excitation."""
MUCH_REST = 0.3
"""A larger share of samples at rest is mentioned."""
FEEDBACK = 0.15
"""An input that is correlated more than this with earlier errors of the output depends on it."""
FEW_STEPS = 8
"""A deviation of fewer quantisation steps is coarse."""
FASTEST, SLOWEST = 1.5, 200.0
"""Samples in a time constant below which sampling is too slow, and above which it is too fast."""
FAST_SHARE, PROPORTIONAL = 0.05, 0.9
"""The least share of the input's power at high frequencies, and the least correlation, to say that it is too slow."""
SPIKE = 12.0
"""A single sample this many standard deviations away from its neighbours is an outlier."""


@dataclass(frozen=True)
class _Data:
    """What the checks share: the first input and output, and a linear model of them."""

    record: Record
    response: Response
    tolerance: float

    @property
    def u(self) -> Array:
        """(N,) the first input."""
        return self.record.input[:, 0]

    @property
    def y(self) -> Array:
        """(N,) the first output."""
        return self.record.output[:, 0]

    @property
    def input(self) -> str:
        """The name of the first input."""
        return self.record.input_names[0]

    @property
    def output(self) -> str:
        """The name of the first output."""
        return self.record.output_names[0]

    @cached_property
    def near_zero(self) -> NDArray[np.bool_]:
        """(N,) whether the output is close to zero: at rest, or passing through."""
        return near_zero(self.y)

    @cached_property
    def resting(self) -> NDArray[np.bool_]:
        """(N,) whether the output is at rest."""
        return at_rest(self.y)

    @cached_property
    def linear(self) -> Baseline | None:
        """A linear model of the first output, where there is one."""
        return baseline(self.record, self.response.delay)

    @property
    def delay(self) -> int | None:
        """Samples from the input to its first effect: as the response shows it, or fewer in the linear model."""
        shown = self.response.delay
        return shown if shown is None or self.linear is None else min(shown, self.linear.delay)


def advice(record: Record, response: Response, tolerance: float = TOLERANCE) -> list[Finding]:
    """Findings about the quality of the data in a record.

    Args:
        record: at least one output.
        response: of its first output to its first input.
        tolerance: singular values of the lagged input below this share of the largest are no excitation.
    """
    if not record.output.shape[1]:
        return []
    found = list(_useless(record))
    if len(record) < FEWEST_SAMPLES:
        found = [Finding("record-too-short", record.name, {"samples": len(record), "needed": FEWEST_SAMPLES}), *found]
    if found:
        return found
    data = _Data(record, response, tolerance)
    return [finding for check in CHECKS for finding in check(data)]


def _useless(record: Record) -> Iterable[Finding]:
    """Channels that cannot be computed with, or never change: an output perhaps for friction."""
    units, u = _units(record), record.input[:, 0]
    for name in record.input_names + record.output_names:
        x = record.channel(name)
        largest = float(np.max(np.abs(x)))
        if largest and not 1 / LARGEST < largest < LARGEST:
            yield Finding("channel-out-of-scale", name, {"largest": largest})
        if np.ptp(x):
            continue
        data = {"level": float(x[0]), "unit": units[name]}
        if name in record.output_names and np.ptp(u):
            data |= {"input": record.input_names[0], "low": float(u.min()), "high": float(u.max())}
            yield Finding("output-constant", name, data | {"input_unit": record.input_units[0]})
        else:
            yield Finding("channel-constant", name, data)


def _units(record: Record) -> dict[str, str]:
    """The unit of every channel by its name; a column such as ``speed (RPM)`` may be in another one."""
    return dict(zip(record.input_names + record.output_names, record.input_units + record.output_units, strict=True))


FEWEST_SAMPLES = 50
"""A shorter record has no findings about dynamics."""


def excitation(data: _Data) -> Iterable[Finding]:
    """The order of persistent excitation against what models need."""
    order = persistent_excitation_order(data.record, tolerance=data.tolerance)
    numbers = {"order": int(order), "linear": LINEAR_ORDER, "friction": FRICTION_ORDER}
    if order < LINEAR_ORDER:
        yield Finding("excitation-too-low", data.input, numbers)
    elif order < FRICTION_ORDER:
        yield Finding("excitation-linear-only", data.input, numbers)
    else:
        at_least = order == largest_order(data.record)
        yield Finding("excitation-sufficient", data.input, numbers | {"at_least": bool(at_least)})
    pieces = [piece.input[:, 0] for piece in data.record.segments]
    if may_be_continuous(pieces):
        yield Finding("input-may-be-continuous", data.input)
    levels = len(np.unique(np.round(data.u / np.ptp(data.u), 3)))
    if levels <= 3:
        yield Finding("few-input-levels", data.input, {"levels": levels})


def answer(data: _Data) -> Iterable[Finding]:
    """Delay and sign of the response, and feedback."""
    without_sign = list(_without_sign(data))
    yield from without_sign
    response, dt = data.response, data.record.dt
    at_once = None if response.delay else response.sign
    back = 0.0 if repeats([data.u]) or _looks_ahead(data) else feedback(data.u, data.y, at_once)
    if back > FEEDBACK:
        sure = round(min(0.9, 0.5 + 2 * back), 2)
        yield Finding("feedback-likely", data.input, {"output": data.output, "correlation": back, "confidence": sure})
    if response.delay is None:
        if not without_sign:  # no linear relation is seen then
            yield Finding("no-response", data.output, {"input": data.input})
        return
    sure = round(min(0.99, 0.5 + 0.5 * abs(response.correlation)), 2)
    delay = data.delay or 0
    shared = {"input": data.input, "delay": delay, "time": delay * dt, "confidence": sure}
    yield Finding("response-negative" if response.sign < 0 else "response-delay", data.output, shared)


def _looks_ahead(data: _Data) -> bool:
    """Whether the channels were filtered forwards and backwards, so that the output seems to precede the input."""
    return data.output.startswith("d(") or any(finding.code == "data-filtered" for finding in data.record.findings)


def _without_sign(data: _Data) -> Iterable[Finding]:
    """An output that has one sign although the input has both; a position may be on one side of its zero."""
    if is_position(data.record):
        return
    positive = float(np.mean(data.u > 0.1 * np.max(np.abs(data.u))))
    negative = float(np.mean(data.u < -0.1 * np.max(np.abs(data.u))))
    low, high = float(data.y.min()), float(data.y.max())
    if min(positive, negative) < 0.1 or (low < -0.03 * high and high > -0.03 * low):
        return
    signed, unsigned = (abs(correlation(u, data.y, data.record.breaks, 0)) for u in (data.u, np.abs(data.u)))
    if signed < 0.3 or unsigned > signed:
        yield Finding("output-without-sign", data.output, {"input": data.input, "confidence": 0.5})


def motion(data: _Data) -> Iterable[Finding]:
    """Standstill, reversals, and the amplitude of the input against the dead zone; a position shows none of them."""
    if is_position(data.record):
        return
    share = float(np.mean(data.resting))
    moving = np.sign(data.y[~data.near_zero])
    reversals = int(np.count_nonzero(np.diff(moving)))
    numbers = {"share": share, "reversals": reversals}
    if np.mean(data.near_zero) > 1 - 1e-3:
        yield Finding("all-standstill", data.output, numbers)
        return
    yield Finding("much-standstill" if share > MUCH_REST else "motion", data.output, numbers)
    zone = breakaway(data.u, data.resting, data.delay or 0)
    zone = dead_zone(data.u, data.resting) if zone is None else zone
    amplitude = float(np.percentile(np.abs(data.u), 90))
    if zone is not None:
        inside = float(np.mean(np.abs(data.u) <= zone))
        unit = data.record.input_units[0]
        zones = {"dead_zone": zone, "amplitude": amplitude, "inside": inside, "unit": unit, "confidence": 0.7}
        code = "amplitude-near-dead-zone" if amplitude < 2.5 * zone else "dead-zone-likely"
        yield Finding(code, data.input, zones)


def resolution(data: _Data) -> Iterable[Finding]:
    """Quantisation of the output, and samples at a limit of its range."""
    units = _units(data.record)
    for name, x in ((data.output, data.y), (data.input, data.u)):
        unit = units[name]
        levels, counts = np.unique(x, return_counts=True)
        step = quantisation(levels)
        is_output = name == data.output
        if is_output and step is not None and x.std() < FEW_STEPS * step:
            yield Finding("coarse-values", name, {"step": step, "unit": unit, "levels": float(x.std() / step)})
        if len(levels) < FEWEST_LEVELS:
            continue
        for side, k, near in (("lower", 0, counts[1:11]), ("upper", -1, counts[-11:-1])):
            share = float(counts[k] / counts.sum())
            is_zero = abs(levels[k]) <= NEAR_ZERO * np.max(np.abs(x))
            if share < 0.01 or counts[k] < 10 * np.median(near) or is_zero:
                continue
            if is_output and not _moves_meanwhile(data.u, x == levels[k]):
                continue
            code = "values-cut-off" if is_output else "command-limited"
            yield Finding(code, name, {"side": side, "limit": float(levels[k]), "unit": unit, "share": share})


def _moves_meanwhile(u: Array, there: NDArray[np.bool_]) -> bool:
    """Whether an input varies while the output stands at a limit; else the output may have settled there."""
    inside = there[1:] & there[:-1]
    changes = np.count_nonzero((np.diff(u) != 0) & inside)
    return bool(changes > 0.05 * np.count_nonzero(inside) and u[there].std() > 0.02 * np.ptp(u))


def outliers(data: _Data) -> Iterable[Finding]:
    """Single samples far from both neighbours."""
    y = data.y
    middle = np.median(np.stack([y[:-2], y[1:-1], y[2:]]), axis=0)
    away = np.abs(y[1:-1] - middle)
    steps = np.abs(np.diff(y))
    usual = max(float(np.percentile(steps, 95)), 1e-9 * float(np.ptp(y)))
    spread = 1.4826 * float(np.median(np.abs(y - np.median(y))))
    found = 1 + np.flatnonzero((away > SPIKE * usual) & (away > 3 * spread) & (middle != y[1:-1]))
    if 0 < len(found) < 0.01 * len(y):
        size = float(np.max(away[found - 1]))
        yield Finding(
            "outliers", data.output, {"count": len(found), "sample": int(found[0]), "size": size, "confidence": 0.8}
        )


def sampling(data: _Data) -> Iterable[Finding]:
    """Jitter, repeated samples, aliasing, and the sample time against the time constant."""
    axis, dt = data.record.time_axis, data.record.dt
    if axis is not None and axis.jitter > 0.01:
        yield Finding(
            "clock-jitters", data.record.name, {"jitter": float(axis.jitter), "deviation": float(axis.deviation)}
        )
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
        if not is_position(data.record):
            yield Finding("output-integrates", data.output, {"input": data.input})
    elif samples < FASTEST and _is_proportional(data):
        yield Finding("sampling-too-slow", data.output, numbers)
    elif samples > SLOWEST:
        yield Finding("sampling-too-fast", data.output, numbers | {"factor": int(samples // 50)})


def _is_proportional(data: _Data) -> bool:
    """Whether the output follows the delayed input without a lag to be seen, also at high frequencies of the input."""
    size = min(len(data.u), 1024)
    power = spectrum(data.u, data.u, size).real[1:]
    fast = power[np.fft.rfftfreq(size)[1:] > 1 / (2 * np.pi * FASTEST)].sum() / power.sum()
    return bool(fast > FAST_SHARE and abs(data.response.correlation) > PROPORTIONAL)


def repeated(y: Array) -> int:
    """How many times every value of y (N,) is repeated, as where a log is faster than its sensor; 1 where it is not."""
    changes = np.flatnonzero(np.diff(y) != 0)
    if len(changes) < 30:
        return 1
    distances, sizes = np.diff(changes), np.abs(y[changes + 1] - y[changes])
    usual = int(np.median(distances))
    step = quantisation(np.unique(y)) or 0.0
    if usual < 2 or np.median(sizes) < 1.5 * step:  # slow changes of a coarse sensor repeat values as well
        return 1
    early, late = np.percentile(distances, (25, 75))
    return usual if late - early <= 0.35 * usual and np.mean(distances < 0.6 * usual) < 0.2 else 1


def drift(data: _Data) -> Iterable[Finding]:
    """A slow change of the output that the input does not explain; a position keeps every disturbance, and drifts.

    The dynamics of a linear model are those of the record without its trends, so that no slow pole follows the drift.
    Gain, offset and slope are then fitted together: a step of the input is a part of a trend, too. There is no drift
    where a linear model without one is as good, as of a system that integrates.
    """
    if data.linear is None or data.linear.fit < 0.3 or is_position(data.record):
        return
    changing = baseline(data.record.detrend(1), data.response.delay)
    if changing is None:
        return
    t = np.linspace(-0.5, 0.5, len(data.y))
    known = np.column_stack([changing.answer(data.u, data.record.breaks), np.ones(len(t))])
    ahead = t - known @ np.linalg.lstsq(known, t, rcond=None)[0]
    gains = np.linalg.lstsq(np.column_stack([known, t]), data.y, rcond=None)[0]
    drifting = data.y - known @ gains[:2]
    if np.linalg.norm(drifting - gains[2] * t) > np.linalg.norm(data.linear.residual):
        return
    blocks = [float(part.mean()) for part in np.array_split(drifting, 12)]
    k = np.arange(12.0) - 5.5
    slope = float(k @ blocks / (k @ k))
    rest = np.array(blocks) - np.mean(blocks) - slope * k
    error = float(np.sqrt(rest @ rest / 10 / (k @ k) * (t @ t) / (ahead @ ahead)))
    change = 12 * slope
    if abs(slope) > 6 * error and abs(change) > 0.1 * data.y.std():
        sure = 0.95 if abs(slope) >= 9 * error else round(abs(slope) / error / 20 + 0.5, 2)
        unit = data.record.output_units[0]
        yield Finding("output-drifts", data.output, {"change": change, "unit": unit, "confidence": sure})


def straightness(data: _Data) -> Iterable[Finding]:
    """How nonlinear the relation is; a linear model of a position adds up disturbances, so its error shows little."""
    found = nonlinearity(data.record, data.response, data.linear)
    yield from (each for each in found if each.code != "unexplained-output" or not is_position(data.record))


def is_position(record: Record) -> bool:
    """Whether the first output is a position, by its name and unit."""
    unit = next(iter(record.output_units), "")
    return meaning(record.output_names[0], unit).quantity is ColumnQuantity.POSITION


CHECKS: tuple[Callable[[_Data], Iterable[Finding]], ...] = (
    excitation,
    answer,
    motion,
    resolution,
    outliers,
    sampling,
    drift,
    straightness,
)
"""All checks, in the order of their findings."""


QUESTIONABLE = frozenset(
    {
        "all-standstill",
        "feedback-likely",
        "no-response",
        "outliers",
        "output-drifts",
        "output-without-sign",
        "response-negative",
        "samples-repeated",
    }
)
"""What a user of a model must know about the data that it was identified from."""


def response_of(record: Record, *, integrates: bool = False) -> Response | None:
    """How the first output answers the first input; None where too little changes, or is too large to compute with.

    Args:
        record: with an output.
        integrates: whether that is a position, even if its name and unit do not say so.
    """
    if not record.output.shape[1] or len(record) < FEWEST_SAMPLES or not np.ptp(record.output[:, 0]):
        return None
    if any(each.code == "channel-out-of-scale" for each in _useless(record)):
        return None
    return response(record.input[:, 0], record.output[:, 0], record.breaks, integrates or is_position(record))


def questions(records: Sequence[Record], responses: Sequence[Response | None]) -> list[Finding]:
    """The findings about records that call a model into question which is identified from them.

    Args:
        records: with the same channels; each finding of a kind is given once, about the first record that has it.
        responses: of the records.
    """
    found: dict[str, Finding] = {}
    for record, answered in zip(records, responses, strict=True):
        if answered is None:
            continue
        data = _Data(record, answered, TOLERANCE)
        checks = (answer, motion, outliers, sampling, drift) if np.ptp(record.input[:, 0]) else (motion, outliers)
        for finding in (each for check in checks for each in check(data)):
            if finding.code in QUESTIONABLE:
                found.setdefault(finding.code, finding)
    odd = opposite_signs((r.name, answered) for r, answered in zip(records, responses, strict=True) if answered)
    if odd:
        found.pop("response-negative", None)
    return [*odd, *found.values()]


def opposite_signs(responses: Iterable[tuple[str, Response]]) -> list[Finding]:
    """Records in which the output answers with the other sign than in most.

    Args:
        responses: the name of each record, and its response.
    """
    known = [(name, response) for name, response in responses if response.sign]
    total = sum(response.sign for _, response in known)
    usual = 1 if total >= 0 else -1
    odd = [name for name, response in known if response.sign != usual]
    return [Finding("records-of-opposite-sign", odd[0], {"records": odd, "of": len(known)})] if odd else []
