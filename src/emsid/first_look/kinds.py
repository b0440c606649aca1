"""What a file is: a dynamic record, a table of steady states, pulses of an encoder, constant, or too short.

The kind with the largest total of `_EVIDENCE` is taken, in log-odds as of the clock. A table of steady states shows a
characteristic: dead band, slope and saturation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.uncertainty.rounding import runs
from emsid.findings import Finding
from emsid.first_look.clock import Clock
from emsid.first_look.columns import Column
from emsid.first_look.levels import FEW, FEWEST_SAMPLES, MOST, PART, SAME, UNSURE
from emsid.first_look.names import ColumnQuantity
from emsid.first_look.responses import answers
from emsid.first_look.roles import ENOUGH, MOST_COMPARED, Roles
from emsid.io.edges import NEAR, count, levels, scaled, states

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
        pair: of a table of steady states, its input and its output.
        encoders: of pulses, the one or two channels of each encoder.
    """

    kind: FileKind
    evidence: Mapping[FileKind, Mapping[str, float]] = field(default_factory=dict)
    pair: tuple[Column, ...] = ()
    encoders: tuple[tuple[Column, ...], ...] = ()

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
        found = []
        for channels in self.encoders:
            low, high = levels(channels[0].values)
            counts, _ = count(*(each.values for each in channels))
            edges = int(np.nansum(np.abs(np.diff(counts))))
            data = {"low": low, "high": high, "edges": edges, "rate": edges / (len(counts) * dt)}
            names = ", ".join(each.name for each in channels)
            found.append(Finding("encoder-pulses", names, data | {"counts": f"edges({names})"}))
        return found


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
    encoders = facts.encoders if kind is FileKind.PULSES else ()
    return Kind(kind, evidence, facts.pair if kind is FileKind.STATES else (), encoders)


class _Facts:
    """What the evidence looks at.

    Attributes:
        moving: columns of numbers that change and may be channels.
        ordered: those that rise or fall in every row.
        pair: of a table of steady states, its input and its output; empty where no column is ordered.
        encoders: the channels of what may be encoders: pairs of columns that take turns to change between two levels,
            or, where there are none, every column that changes often between two levels.
        first: the channels of the first of these.
        toggling: the names of all columns that change often between two levels.
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
        toggling = [column for column in self.moving if _toggles(column.values)]
        pairs: list[tuple[Column, ...]] = []
        for pair in combinations(toggling, 2):
            if _take_turns(*(each.values for each in pair)) and not any(
                each in other for each in pair for other in pairs
            ):
                pairs.append(pair)
        self.encoders = tuple(pairs or ((each,) for each in toggling))
        self.first = self.encoders[0] if self.encoders else ()
        self.toggling = frozenset(each.name for each in toggling)

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


def _toggles(values: Array) -> bool:
    """Whether a column (N,) is near one of two levels in most rows, and changes often between them."""
    level = scaled(values[np.isfinite(values)])
    near = np.abs(level - (level > 0.5)) < NEAR
    return bool(
        np.mean(near) > 1 - PART and len(runs(states(values).astype(float))[1]) > max(len(near) / OFTEN, 2 * FEW)
    )


def _take_turns(a: Array, b: Array) -> bool:
    """Whether two columns (N,) take turns to change, as the channels of an encoder do, and seldom change at once."""
    first, second = (np.diff(states(each)) for each in (a, b))
    turns = first[first != second]
    return bool(np.mean((first & second)[first | second]) < PART and np.mean(np.diff(turns)) > MOST)


def _steady(values: Array) -> float:
    """How alike successive pulses are: 1 where their lengths change slowly, as those of a shaft do, 0 by chance."""
    lengths = runs(states(values).astype(float))[1][1:-1].astype(float)
    if len(lengths) < 2 * FEW:
        return 0.0
    change = np.abs(np.log(lengths[2:] / lengths[:-2]))  # of levels of one side, which may last longer than the other
    by_chance = np.abs(np.log(lengths[:, None] / lengths))
    return float(np.median(change) <= np.log(1.5) and np.mean(change) <= max(np.mean(by_chance), np.log(1.5)))


def _is_driven(facts: _Facts) -> float:
    """Whether the count of edges is clearly an integral of a response to another column, as a position is."""
    others = [column for column in facts.moving if column.name not in facts.toggling][:MOST_COMPARED]
    if not (facts.first and others):
        return 0.0
    counts, _ = count(*(each.values for each in facts.first))
    table = np.column_stack([*(each.signal for each in others), counts])
    found = answers(table[np.isfinite(table).all(axis=1)])
    of_count = [each.evidence for (_, y), each in found.items() if y == len(others) and each.integrates]
    return float(max(of_count, default=0.0) >= ENOUGH)


def _input_like(facts: _Facts) -> float:
    """Whether the input of a table of steady states is named as one, 1, or as a position, −1."""
    if not facts.pair:
        return 0.0
    said = facts.pair[0].meaning.quantity
    return 1.0 if said in _INPUTS else -1.0 if said is ColumnQuantity.POSITION else 0.0


def _pulse_like(facts: _Facts) -> float:
    """Whether pulses are named as a motion, 1, or as an input, −2."""
    said = [each.meaning.quantity for each in facts.first]
    return -2.0 if set(said) & set(_INPUTS) else 1.0 if set(said) & set(_MOTIONS) else 0.0


def _has_other_motion(facts: _Facts) -> bool:
    """Whether a column that does not toggle is named as a motion, or answers another column."""
    explained = {y for _, y in facts.roles.explained}
    others = (column for column in facts.moving if column.name not in facts.toggling)
    return bool(facts.first) and any(c.name in explained or c.meaning.quantity in _MOTIONS for c in others)


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
    (FileKind.PULSES, "a column toggles between two levels", 3.0, lambda facts: bool(facts.first)),
    (FileKind.PULSES, "it has two values, as a command", -3.0, lambda facts: any(x.distinct == 2 for x in facts.first)),
    (FileKind.PULSES, "its pulses are alike", 3.0, lambda facts: bool(facts.first) and _steady(facts.first[0].values)),
    (FileKind.PULSES, "two columns take turns to change", 6.0, lambda facts: len(facts.first) == 2),
    (FileKind.PULSES, "the count of edges is a position that answers another column", 4.0, _is_driven),
    (FileKind.PULSES, "its name", 2.0, _pulse_like),
    (FileKind.PULSES, "another column is a motion or answers one", -4.0, _has_other_motion),
    (
        FileKind.PULSES,
        "a response to another column explains it, as a fast answer to a square wave",
        -8.0,
        lambda facts: any(
            y == x.name and u not in facts.toggling for u, y in facts.roles.explained for x in facts.first
        ),
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
