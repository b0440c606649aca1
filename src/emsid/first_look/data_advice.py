"""What the data of a record allow, and what they do not: findings before any model is fitted.

Every finding says how sure it is, as ``confidence`` from 0 to 1, and its sentence says what to do next.

References:
    Ljung, *System Identification*, 2nd ed. (1999), ch. 13 on experiments and 14 on data.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from emsid.estimation.linear.least_squares import settles
from emsid.estimation.uncertainty.whiteness import whiteness
from emsid.excitation import largest_order, persistent_excitation_order
from emsid.excitation.between_samples import full_duty, jumps, may_be_continuous, repeats
from emsid.excitation.periods import period_of
from emsid.findings import Finding
from emsid.first_look.dynamics import acts_in_its_own_row, correlation, feedback
from emsid.first_look.examined import Examined, Response, is_position, out_of_scale, response_of, units_of
from emsid.first_look.hanging import hangs
from emsid.first_look.levels import CHANCE, FEWEST_SAMPLES, MOST, PART, UNSURE
from emsid.first_look.measurement import outliers, resolution, sampling
from emsid.first_look.nonlinearity import nonlinearity
from emsid.first_look.standstill import breakaway, dead_zone
from emsid.first_look.step_response import step_response
from emsid.record import Record
from emsid.wording import sentence as worded

LINEAR_ORDER, FRICTION_ORDER = 4, 8
"""The order of excitation that a linear model of second order needs, and that of a regression with friction terms."""
TOLERANCE = 1e-3
"""Singular values of the lagged input below this share of the largest are no excitation."""
SAME_SIGNAL = 1e-6
"""Two channels with this largest difference, as a share of the largest value, are one signal in another unit: numbers
written with seven digits differ by half as much."""
MUCH_REST = 0.3
"""A larger share of samples at rest is mentioned."""


class Advice(list[Finding]):
    """Findings about data; prints as sentences."""

    def __str__(self) -> str:
        return "\n".join(worded(each) for each in self)


def advice(record: Record, response: Response | None = None, tolerance: float = TOLERANCE) -> Advice:
    """Findings about the quality of the data in a record.

    Args:
        record: at least one output.
        response: of its first output to its first input; found by default.
        tolerance: singular values of the lagged input below this share of the largest are no excitation.
    """
    if not record.output.shape[1]:
        return Advice()
    found = list(useless(record))
    if len(record) < FEWEST_SAMPLES:
        found = [Finding("record-too-short", record.name, {"samples": len(record), "needed": FEWEST_SAMPLES}), *found]
    if found:
        return Advice(found)
    known = (response_of(record) or Response(None, 0, 0.0)) if response is None else response
    data = Examined(record, known, tolerance)
    return Advice(finding for check in CHECKS for finding in check(data))


def useless(record: Record) -> Iterable[Finding]:
    """Channels that cannot be computed with, or never change: an output perhaps for friction."""
    units, u = units_of(record), record.input[:, 0]
    for name in record.input_names + record.output_names:
        x = record.channel(name)
        if largest := out_of_scale(x):
            yield Finding("channel-out-of-scale", name, {"largest": largest})
        if np.ptp(x):
            continue
        data = {"level": float(x[0]), "unit": units[name]}
        if name in record.output_names and np.ptp(u):
            data |= {"input": record.input_names[0], "low": float(u.min()), "high": float(u.max())}
            yield Finding("output-constant", name, data | {"input_unit": record.input_units[0]})
        elif name in record.output_names or not (x[0] and settles(record)):
            yield Finding("channel-constant", name, data)
    y = record.output[:, 0]
    if np.ptp(u) and np.ptp(y):
        k = int(np.argmax(np.abs(u)))  # the ratio of the largest values, of which no square is needed
        if y[k] and np.max(np.abs(y / y[k] - u / u[k])) <= SAME_SIGNAL:
            data = {"input": record.input_names[0], "factor": float(y[k] / u[k])}
            yield Finding("output-is-input", record.output_names[0], data)


def excitation(data: Examined) -> Iterable[Finding]:
    """The order of persistent excitation against what models need; of a constant input, what its step shows."""
    if not np.ptp(data.u):
        yield from _step(data)
        return
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
    if may_be_continuous(pieces) and not any(map(jumps, pieces)):
        yield Finding("input-may-be-continuous", data.input)
    levels = len(np.unique(np.round(data.u / np.ptp(data.u), 3)))
    if levels <= 3:
        yield Finding("few-input-levels", data.input, {"levels": levels})


def _step(data: Examined) -> Iterable[Finding]:
    """Gain, time constant and delay of the response to an input that stepped at the beginning."""
    step = step_response(data.record)
    if step is not None:
        units = units_of(data.record)
        numbers = {
            "input": data.input,
            "gain": step.gain,
            "time_constant": step.time_constant,
            "begins": step.begins if step.resting else None,
            "level": float(data.u[0]),
            "unit": units[data.output],
            "input_unit": units[data.input],
        }
        yield Finding("step-from-first-sample", data.output, numbers)


def duty(data: Examined) -> Iterable[Finding]:
    """Whether a command without a unit may be the duty of a PWM."""
    if not data.record.input_units[0] and (full := full_duty(data.u)):
        yield Finding("command-may-be-duty", data.input, {"channel": data.input, "full": full})


def answer(data: Examined) -> Iterable[Finding]:
    """Delay and sign of the response, and feedback; a constant input shows neither."""
    if not np.ptp(data.u):
        return
    response, dt = data.response, data.record.dt
    if response.without_sign and not is_position(data.record):
        yield Finding("output-without-sign", data.output, {"input": data.input, "confidence": 0.5})
    period = period_of(data.u)
    open_loop = repeats([data.u]) or period is not None  # a controller passes noise on, which never repeats
    back = 0.0 if open_loop or _looks_ahead(data) else feedback(data.u, data.y, response.sign)
    if back > PART:
        sure = round(min(0.9, 0.5 + 2 * back), 2)
        yield Finding("feedback-likely", data.input, {"output": data.output, "correlation": back, "confidence": sure})
    if response.delay is None:
        yield Finding("no-response", data.output, {"input": data.input})
        return
    delay = data.delay or 0
    most = UNSURE if response.resolution > 1 or _hardly_changes(data, delay) else 0.99
    sure = round(min(most, 0.5 + 0.5 * abs(response.correlation)), 2)
    shared = {"input": data.input, "delay": delay, "time": delay * dt, "sign": response.sign, "confidence": sure}
    yield Finding("response-negative" if response.sign < 0 else "response-delay", data.output, shared)
    if period is not None:
        yield Finding("delay-ambiguous", data.output, {"input": data.input, "period": period, "time": period * dt})


def command_row(data: Examined) -> Iterable[Finding]:
    """Whether the input is written into the row after the one where it begins to act."""
    if data.response.sign and not _looks_ahead(data) and acts_in_its_own_row(data.u, data.y, data.response.sign):
        yield Finding("command-before-its-row", data.input, {"output": data.output})


def _hardly_changes(data: Examined, delay: int) -> bool:
    """Whether a smooth input is nearly the same after this delay, so that friction or a slow response look like it."""
    pieces = [piece.input[:, 0] for piece in data.record.segments]
    if not delay or not may_be_continuous(pieces) or any(map(jumps, pieces)):
        return False
    return correlation(data.u[:-delay], data.u[delay:], (), 0) > MOST


def _looks_ahead(data: Examined) -> bool:
    """Whether an output may seem to precede its input: channels were filtered forwards and backwards, or resampled."""
    return data.output.startswith("d(") or any(finding.code in LOOKING_AHEAD for finding in data.record.findings)


def motion(data: Examined) -> Iterable[Finding]:
    """Standstill, reversals, and the amplitude of the input against the dead zone; a position shows none of them."""
    if is_position(data.record):
        return
    if _is_noise(data):
        yield Finding("output-noise-only", data.output, {"input": data.input})
        return
    share = float(np.mean(data.resting))
    signs = np.split(np.where(data.near_zero, 0.0, np.sign(data.still)), list(data.record.breaks))
    reversals = sum(int(np.count_nonzero(np.diff(piece[piece != 0]))) for piece in signs)
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


def _is_noise(data: Examined) -> bool:
    """Whether the output is white, and does not respond to an input that changes."""
    if data.response.delay is not None or not np.ptp(data.u):
        return False
    pieces = np.split(data.y - data.y.mean(), list(data.record.breaks))
    test = whiteness(pieces, 0)
    return test is not None and test.p_value >= CHANCE


def drift(data: Examined) -> Iterable[Finding]:
    """A slow change of the output that the input does not explain."""
    if data.drift is not None:
        found, unit = data.drift, data.record.output_units[0]
        shared = {"change": found.change, "unit": unit, "confidence": found.confidence}
        yield Finding("output-drifts", data.output, shared)


def straightness(data: Examined) -> Iterable[Finding]:
    """How nonlinear the relation is; a linear model of a position adds up disturbances, so its error shows little."""
    found = nonlinearity(data.record, data.response, data.linear)
    yield from (each for each in found if each.code != "unexplained-output" or not is_position(data.record))


CHECKS: tuple[Callable[[Examined], Iterable[Finding]], ...] = (
    excitation,
    duty,
    command_row,
    answer,
    motion,
    hangs,
    resolution,
    outliers,
    sampling,
    drift,
    straightness,
)
"""All checks, in the order of their findings."""


LOOKING_AHEAD = frozenset({"data-filtered", "data-resampled"})
"""Findings about a record whose outputs may seem to precede its inputs by a part of a sample."""
QUESTIONABLE = frozenset(
    {
        "all-standstill",
        "command-before-its-row",
        "feedback-likely",
        "few-output-levels",
        "input-logged-slower",
        "no-response",
        "outliers",
        "output-clipped",
        "output-drifts",
        "output-integrates",
        "output-is-input",
        "output-noise-only",
        "output-without-sign",
        "response-negative",
        "samples-repeated",
        "values-cut-off",
    }
)
"""What a user of a model must know about the data that it was identified from."""


def advice_by_code(record: Record) -> dict[str, Finding]:
    """What the first look finds in a record, the first finding of every code."""
    found = advice(record, response_of(record) or Response(None, 0, 0.0))
    return {each.code: each for each in reversed(found)}


def questions(records: Sequence[Record], responses: Sequence[Response | None]) -> list[Finding]:
    """The findings about records that call a model into question which is identified from them.

    Args:
        records: with the same channels; each finding of a kind is given once, about the first record that has it.
        responses: of the records.
    """
    found: dict[str, Finding] = {}
    for record, answered in zip(records, responses, strict=True):
        for finding in advice(record, answered or Response(None, 0, 0.0)):
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
