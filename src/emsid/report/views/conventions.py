"""Conventions of all views: the look of measurements and models, and the labels of models and outputs.

The time axis of a figure of a record.

Definitions of the terms in tables and figures.
"""

from __future__ import annotations

import re
from math import inf
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.report.document import Axis, Dash, Ink, Stroke, Term
from emsid.report.numbers import capital
from emsid.units import in_unit, name_and_unit
from emsid.wording.lists import sample_time

if TYPE_CHECKING:
    from emsid.record import Record


BAND = "95 % band"
MEASURED = Stroke(Ink.BLUE, Dash.SOLID, 1.6)
# The looks of models, in the order in which they are given: enough for all that are tried by default. The first two are
# the paper's: the linear model solid red, the nonlinear one dotted blue (dark, on the lighter solid blue of the
# measurement).
MODELS = (
    Stroke(Ink.RED, Dash.SOLID, 1.0),
    Stroke(Ink.NAVY, Dash.DOTTED, 1.4),
    Stroke(Ink.ORANGE, Dash.DASH_DOTTED, 1.2),
    Stroke(Ink.GREEN, Dash.DASHED, 1.2),
    Stroke(Ink.PURPLE, Dash.SOLID, 1.0),
    Stroke(Ink.GREY, Dash.DASHED, 1.2),
    Stroke(Ink.BLACK, Dash.DASH_DOTTED, 0.9),
    Stroke(Ink.GREEN, Dash.SOLID, 0.9),
    Stroke(Ink.RED, Dash.DASHED, 1.2),
    Stroke(Ink.NAVY, Dash.SOLID, 1.0),
    Stroke(Ink.ORANGE, Dash.DOTTED, 1.4),
    Stroke(Ink.PURPLE, Dash.DASHED, 1.2),
    Stroke(Ink.GREY, Dash.DOTTED, 1.4),
)


def in_words(record: Record) -> str:
    """Samples, segments, sample time and channels of a record."""
    names, units = record.input_names + record.output_names, record.input_units + record.output_units
    channels = ", ".join(in_unit(name, unit) for name, unit in zip(names, units, strict=True))
    pieces = f" in {len(record.breaks) + 1} segments" if record.breaks else ""
    return f"{len(record):,} sample{'s' * (len(record) != 1)}{pieces}, dt {sample_time(record.dt)}; {channels}"


def output_axis(record: Record, channel: int) -> Axis:
    """The axis of an output."""
    return channel_axis(record.output_names[channel], record.output_units[channel])


def channel_axis(name: str, unit: str) -> Axis:
    """The axis of a channel: its unit in place of one in the name of its column, which is shown if it has none.

    >>> channel_axis("Motor_Speed(RPM)", "").title, channel_axis("u [V]", "").title, channel_axis("f(x)", "V").title
    ('Motor_Speed [RPM]', 'u [V]', 'f(x) [V]')
    >>> channel_axis("Motor_Speed(RPM)", "rad/s").title
    'Motor_Speed [rad/s]'
    >>> channel_axis("d(qm)", "").title
    'd(qm)'
    """
    named = None if name.startswith(("d(", "edges(")) else re.fullmatch(r"(.*\S)\s*[(\[]([^()\[\]]+)[)\]]", name)
    if unit or named is None:  # d(COL) is the derivative of a column, edges(COL) its pulses counted
        return Axis(capital(name_and_unit(name)[0] if unit else name), unit)
    return Axis(capital(named[1]), named[2])


def channels(record: Record) -> range:
    """The outputs; each has its own plots."""
    return range(record.output.shape[1])


def of_output(record: Record, channel: int, before: str = ": ") -> str:
    """The part of a title that names an output if there are several."""
    return f"{before}{record.output_names[channel]}" if len(channels(record)) > 1 else ""


Array = NDArray[np.float64]

TIME = Axis("Time", "s")


def timeline(record: Record) -> tuple[Array, NDArray[np.intp]]:
    """The time axis of a figure of a record, with gaps between its segments.

    Experiments that all begin at zero are placed one after the other.

    Returns:
        (M,) time in seconds, ascending, and (M,) the index of the sample there, −1 in a gap.
    """
    times: list[ArrayLike] = []
    samples: list[ArrayLike] = []
    offset, end = 0, -inf
    for segment in record.segments:
        t = segment.time
        if t[0] < end:
            t = t + (end - t[0])
        if offset:
            times.append([(end - record.dt + t[0]) / 2])
            samples.append([-1])
        times.append(t)
        samples.append(np.arange(offset, offset + len(segment)))
        offset, end = offset + len(segment), float(t[-1]) + record.dt
    return np.concatenate(times), np.concatenate(samples).astype(np.intp)


def with_gaps(values: Array, samples: NDArray[np.intp]) -> Array:
    """(M,) values (N,) in the order of `timeline`, NaN in its gaps."""
    return np.where(samples < 0, np.nan, values[samples])


FREE_RUN = Term(
    "Free run",
    "simulation from the input alone: the model uses its own past outputs, never measured ones.",
)
ONE_STEP = Term(
    "One step ahead",
    "the model predicts the next sample from the measured past; models are not ranked by this error.",
)
FIT = Term(
    "Fit",
    "100·(1 − ‖error‖/‖output − mean‖): 100 % is exact, 0 % is no better than the mean of the output.",
)
MSE = Term("MSE, RMSE", "mean square error and its root; the RMSE is in the unit of the output.")
METHOD = Term(
    "Fitted",
    "one step: least squares of the prediction one sample ahead. recursive: the same, sample by sample. free run: a "
    "search (Gauss–Newton) for the smallest error of the simulation from the input alone.",
)
