"""What a file is: a dynamic record, a table of steady states, pulses of an encoder, constant, or too short.

The kind with the largest total of `_EVIDENCE` is taken, in log-odds as of the clock. A table of steady states shows a
characteristic: dead band, slope and saturation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.rounding import runs
from emsid.findings import Finding
from emsid.first_look.clock import Clock
from emsid.first_look.columns import Column
from emsid.first_look.levels import FEW, FEWEST_SAMPLES, PART, SAME, UNSURE
from emsid.first_look.names import ColumnQuantity
from emsid.first_look.roles import Roles

Array = NDArray[np.float64]

LONGEST = 2000
"""A table of steady states has at most this many rows: each of them takes a person or a program some seconds."""
OFTEN = 40
"""Pulses change their level at least once in this many rows; the levels of commands last longer than a response."""
_INPUTS = (ColumnQuantity.VOLTAGE, ColumnQuantity.DUTY, ColumnQuantity.INPUT, ColumnQuantity.REFERENCE)
_MOTIONS = (ColumnQuantity.SPEED, ColumnQuantity.POSITION)
_NO_CHANNELS = (ColumnQuantity.TIME, ColumnQuantity.OTHER)


class FileKind(StrEnum):
    """What a file may be."""

    DYNAMIC = "a dynamic record"
    STATES = "a table of steady states"
    PULSES = "pulses of an encoder"
    STILL = "a standing or constant record"
    SHORT = "a record of too few rows"


@dataclass(frozen=True)
class Kind:
    """What a file is.

    Attributes:
        kind: the likeliest.
        evidence: log-odds for every kind, by reason.
        pair: of a table of steady states, its input and its output; of pulses, their column alone.
    """

    kind: FileKind
    evidence: Mapping[FileKind, Mapping[str, float]] = field(default_factory=dict)
    pair: tuple[Column, ...] = ()

    def __str__(self) -> str:
        return str(self.kind)

    def finding(self, file: str, dt: float) -> list[Finding]:
        """What a table of steady states or pulses show; nothing of other kinds.

        Args:
            file: its name.
            dt: the sample time in seconds.
        """
        if self.kind is FileKind.STATES:
            u, y = self.pair
            data = {"input": u.name, "output": y.name, "rows": u.rows} | characteristic(u.signal, y.signal)
            return [Finding("steady-states", file, data)]
        if self.kind is FileKind.PULSES:
            (column,) = self.pair
            known = column.values[np.isfinite(column.values)]
            low, high = np.percentile(known, (10, 90))
            edges = len(_lengths(known)) - 1
            levels = {"low": float(low), "high": float(high)}
            return [
                Finding("encoder-pulses", column.name, levels | {"edges": edges, "rate": edges / (len(known) * dt)})
            ]
        return []


def kind_of(columns: Sequence[Column], clock: Clock, roles: Roles, codes: frozenset[str] = frozenset()) -> Kind:
    """The likeliest kind of a file.

    Args:
        columns: of the file.
        clock: of the file.
        roles: its input and output.
        codes: of findings with which there is nothing to identify.
    """
    facts = _Facts(columns, clock, roles, codes)
    evidence: dict[FileKind, dict[str, float]] = {kind: {} for kind in FileKind}
    for kind, reason, weight, share in _EVIDENCE:
        if value := weight * float(share(facts)):
            evidence[kind][reason] = value
    kind = max(FileKind, key=lambda each: sum(evidence[each].values()))
    pair = {FileKind.STATES: facts.pair, FileKind.PULSES: facts.pulses[:1]}.get(kind, ())
    return Kind(kind, evidence, pair)


class _Facts:
    """What the evidence looks at.

    Attributes:
        moving: columns of numbers that change and may be channels.
        ordered: those that rise or fall in every row.
        pair: of a table of steady states, its input and its output; empty where no column is ordered.
        pulses: columns that toggle between two levels, with noise, as the sensor of an encoder does.
    """

    def __init__(self, columns: Sequence[Column], clock: Clock, roles: Roles, codes: frozenset[str]) -> None:
        self.clock, self.roles, self.codes = clock, roles, codes
        self.rows = max((column.rows for column in columns), default=0)
        self.moving = tuple(
            column
            for column in columns
            if column.kind == "numbers" and not column.constant and column.rows == self.rows
            if column.name != clock.column and column.meaning.quantity not in _NO_CHANNELS
        )
        self.ordered = tuple(column for column in self.moving if _is_ordered(column.values))
        self.pair = self._pair() if 3 <= self.rows <= LONGEST else ()
        self.pulses = tuple(column for column in self.moving if column.distinct > 2 and _toggles(column.values))

    def _pair(self) -> tuple[Column, ...]:
        named = {column.name: column for column in self.moving}
        u, y = named.get(self.roles.input), named.get(self.roles.output)
        if u in self.ordered and y is not None and self.roles.input_confidence >= UNSURE:
            return (u, y) if u is not None else ()
        pairs = [(u, y) for u in self.ordered for y in self.moving if y is not u]
        return max(pairs, key=lambda pair: pair[0].name[:-1] == pair[1].name[:-1], default=())  # v_1 and v_2

    @property
    def functions(self) -> float:
        """The share of the columns that are smooth functions of the input of a table of steady states."""
        others = [column for column in self.moving if column is not self.pair[0]] if self.pair else []
        x = self.pair[0].values if self.pair else np.zeros(0)
        return float(np.mean([_roughness(x, column.values) < PART**2 for column in others])) if others else 0.0


def _is_ordered(x: Array) -> bool:
    """Whether a column (N,) rises in every row, or falls in every row."""
    steps = np.diff(x)
    return bool(len(steps) > 1 and (np.all(steps > 0) or np.all(steps < 0)))


def _roughness(x: Array, y: Array) -> float:
    """The share of the variance of y (N,) that a line from the row before to the row after leaves, over x (N,)."""
    known = np.isfinite(y)
    x, y = x[known], y[known]
    if len(y) < 3 or not np.ptp(y):
        return 1.0
    return float(np.mean(_off_line(x, y) ** 2) / np.var(y))


def _off_line(x: Array, y: Array) -> Array:
    """(N − 2,) the distances of y (N,) from a line over x (N,) from the row before to the row after."""
    return np.asarray(y[1:-1] - y[:-2] - (y[2:] - y[:-2]) * (x[1:-1] - x[:-2]) / (x[2:] - x[:-2]))


def _lengths(x: Array) -> NDArray[np.intp]:
    """The numbers of rows for which a column (N,) is above, and below, the middle between its two levels."""
    return np.asarray(runs((x > np.mean(np.percentile(x, (10, 90)))).astype(float))[1])


def _toggles(values: Array) -> bool:
    """Whether a column (N,) is near one of two levels in most rows, and changes often between them."""
    x = values[np.isfinite(values)]
    low, high = np.percentile(x, (10, 90)) if len(x) else (0.0, 0.0)
    if not high > low:
        return False
    level = (x - low) / (high - low)
    near = np.abs(level - (level > 0.5)) < 0.25
    return bool(np.mean(near) > 1 - PART and len(_lengths(x)) > max(len(x) / OFTEN, 2 * FEW))


def _steady(column: Column) -> float:
    """How alike successive pulses are: 1 where their lengths change slowly, as those of a shaft do, 0 by chance."""
    lengths = _lengths(column.values[np.isfinite(column.values)])[1:-1].astype(float)
    if len(lengths) < 2 * FEW:
        return 0.0
    change = np.abs(np.log(lengths[2:] / lengths[:-2]))  # of levels of one side, which may last longer than the other
    by_chance = np.abs(np.log(lengths[:, None] / lengths))
    return float(np.median(change) <= np.log(1.5) and np.mean(change) <= max(np.mean(by_chance), np.log(1.5)))


def _input_like(facts: _Facts) -> float:
    """Whether the input of a table of steady states is named as one, 1, or as a position, −1."""
    if not facts.pair:
        return 0.0
    said = facts.pair[0].meaning.quantity
    return 1.0 if said in _INPUTS else -1.0 if said is ColumnQuantity.POSITION else 0.0


def _pulse_like(facts: _Facts) -> float:
    """Whether pulses are named as a motion, 1, or as an input, −2."""
    said = facts.pulses[0].meaning.quantity if facts.pulses else ColumnQuantity.UNKNOWN
    return -2.0 if said in _INPUTS else 1.0 if said in _MOTIONS else 0.0


def _has_other_motion(facts: _Facts) -> bool:
    """Whether a column that does not toggle is named as a motion, or answers another column."""
    others = (column for column in facts.moving if column not in facts.pulses)
    explained = facts.roles.explained
    return bool(facts.pulses) and any(c.name in explained or c.meaning.quantity in _MOTIONS for c in others)


_SHORT = "record-too-short"
_STILL = frozenset({"channel-constant", "output-constant", "all-standstill", "output-noise-only"})
_EVIDENCE: tuple[tuple[FileKind, str, float, Callable[[_Facts], float]], ...] = (
    (FileKind.DYNAMIC, "most files are records", 3.0, lambda facts: 1.0),
    (FileKind.DYNAMIC, "a clock is there", 3.0, lambda facts: facts.clock.confidence),
    (FileKind.STATES, "a column rises or falls in every row", 3.0, lambda facts: bool(facts.pair)),
    (FileKind.STATES, "a clock is there", -6.0, lambda facts: facts.clock.confidence),
    (FileKind.STATES, "the name of that column", 2.0, _input_like),
    (FileKind.STATES, "all others are functions of it", 4.0, lambda facts: facts.functions - 0.5 * bool(facts.pair)),
    (FileKind.STATES, "few rows", 4.0, lambda facts: bool(facts.pair) and facts.rows < FEWEST_SAMPLES),
    (FileKind.PULSES, "a column toggles between two levels", 3.0, lambda facts: bool(facts.pulses)),
    (FileKind.PULSES, "its pulses are alike", 3.0, lambda facts: bool(facts.pulses) and _steady(facts.pulses[0])),
    (FileKind.PULSES, "its name", 2.0, _pulse_like),
    (FileKind.PULSES, "another column is a motion or answers one", -4.0, _has_other_motion),
    (
        FileKind.PULSES,
        "a response to another column explains it, as a fast answer to a square wave",
        -8.0,
        lambda facts: any(column.name in facts.roles.explained for column in facts.pulses[:1]),
    ),
    (FileKind.STILL, "no channel changes", 9.0, lambda facts: not facts.moving or bool(_STILL & facts.codes)),
    (FileKind.SHORT, "few rows", 8.0, lambda facts: facts.rows < FEWEST_SAMPLES or _SHORT in facts.codes),
)
"""For each kind a reason, its log-odds, and how far it applies, from 0 to 1 (of names, from −2)."""


def characteristic(u: Array, y: Array) -> dict[str, Any]:
    """Dead band, largest slope and saturation of steady states.

    The dead band is where the output does not leave its value nearest to input 0 by more than its noise; the output
    saturates where it stays within 2 % of its range from the end, over at least three rows.

    Args:
        u: (N,) the inputs; rows with a missing value (NaN) are left out.
        y: (N,) the outputs.

    Returns:
        ``dead`` (its two ends; None where there is none), ``slope`` and where it is (``at``), and ``low`` and ``high``
        (level and the input from which on the output saturates; None where it does not).
    """
    known = np.isfinite(u) & np.isfinite(y)
    order = np.argsort(u[known])
    u, y = u[known][order], y[known][order]
    span = float(np.ptp(y))
    error = _off_line(u, y)
    noise = float(np.median(np.abs(error))) if len(error) else 0.0
    zero = int(np.argmin(np.abs(u)))
    rests = np.abs(y - y[zero]) <= max(FEW * noise, PART * SAME * span)
    first, last = zero, zero
    while first > 0 and rests[first - 1]:
        first -= 1
    while last < len(u) - 1 and rests[last + 1]:
        last += 1
    between = (u[:-1] + u[1:]) / 2
    dead = [float(between[first - 1] if first else u[0]), float(between[last] if last < len(u) - 1 else u[-1])]
    width = max(FEW, len(u) // OFTEN)
    slopes = [float(np.polyfit(u[k : k + width], y[k : k + width], 1)[0]) for k in range(len(u) - width + 1)]
    steepest = int(np.argmax(np.abs(slopes)))
    ends = {}
    for name, values, inputs in (("low", y, u), ("high", y[::-1], u[::-1])):
        away = np.flatnonzero(np.abs(values - np.mean(values[:FEW])) > SAME * span)
        count = int(away[0]) if len(away) else 0
        flat = count >= FEW and abs(np.polyfit(inputs[:count], values[:count], 1)[0]) < PART * abs(slopes[steepest])
        saturated = flat and not (inputs[count - 1] <= u[last] if name == "high" else inputs[count - 1] >= u[first])
        ends[name] = [float(np.mean(values[:count])), float(inputs[count - 1])] if saturated else None
    middle = float(np.mean(u[steepest : steepest + width]))
    return {"dead": dead if last - first + 1 >= FEW else None, "slope": slopes[steepest], "at": middle, **ends}
