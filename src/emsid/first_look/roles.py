"""Which columns are the input and the output: by their names, and by which signal influences which."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from emsid.first_look.columns import Code, Column, runs
from emsid.first_look.dynamics import influence
from emsid.first_look.names import ColumnQuantity
from emsid.io.selection import signs_of

Array = NDArray[np.float64]
Pair = tuple[str, str]

MOST_COMPARED = 8
"""The signals of at most this many columns are compared with each other."""
NAMED_WORSE = 0.9
"""Signals are compared only in pairs whose names suit worse than those of the best by less than this."""
CLEARER, LEAST = 1.5, 0.05
"""A direction is taken where the input with its sign explains more of the output: by this factor and difference."""

_AS_INPUT = {
    ColumnQuantity.VOLTAGE: 1.0,
    ColumnQuantity.DUTY: 1.0,
    ColumnQuantity.INPUT: 0.95,
    ColumnQuantity.TORQUE: 0.6,
    ColumnQuantity.FORCE: 0.6,
    ColumnQuantity.CURRENT: 0.4,
    ColumnQuantity.REFERENCE: 0.1,
    ColumnQuantity.UNKNOWN: 0.2,
}
_AS_OUTPUT = {
    ColumnQuantity.SPEED: 1.0,
    ColumnQuantity.OUTPUT: 0.95,
    ColumnQuantity.POSITION: 0.8,
    ColumnQuantity.CURRENT: 0.3,
    ColumnQuantity.ACCELERATION: 0.2,
    ColumnQuantity.TORQUE: 0.1,
    ColumnQuantity.FORCE: 0.1,
    ColumnQuantity.UNKNOWN: 0.2,
}


@dataclass(frozen=True)
class Roles:
    """The columns guessed to be input and output.

    Attributes:
        input, output: names of columns; empty where there is none.
        input_confidence, output_confidence: from 0 to 1.
        feedback: the influence of the output on the input, from 0 to 1.
        others: further pairs of input and output, which differ in the number at the end of their names.
    """

    input: str = ""
    output: str = ""
    input_confidence: float = 0.0
    output_confidence: float = 0.0
    feedback: float = 0.0
    others: tuple[tuple[str, str], ...] = ()


def find_roles(columns: Sequence[Column], clock: str, input: str = "", output: str = "") -> Roles:
    """Guess the input and the output of a file.

    Args:
        columns: of the file.
        clock: name of the time column; empty where there is none.
        input, output: where the user gives them.
    """
    possible = [column for column in columns if _may_be_channel(column, clock, (input, output))]
    compared = _most_likely(possible, (input, output))
    pairs = [
        (u, y) for u, y in permutations(compared, 2) if u.name == (input or u.name) and y.name == (output or y.name)
    ]
    if not pairs:
        only = compared[0].name if compared else ""
        return Roles(input, output or (only if only != input else ""), 1.0, 1.0 if output else 0.2)
    experiments = _experiments(columns)
    named = {
        (u.name, y.name): _as_input(u) + _as_output(y) + _of_one_experiment(experiments, u.name, y.name)
        for u, y in pairs
    }
    shares = _influences(pairs, named)
    scores = {pair: named[pair] + 0.6 * (shares[pair][0] - shares[pair][1]) + _shape(compared, pair) for pair in shares}
    if not scores:
        return Roles(input=input, output=output)
    (u, y) = _first_of_its_kind(max(scores, key=scores.__getitem__), scores, compared, experiments)
    columns_by_name = {column.name: column for column in columns}
    return Roles(
        input=u,
        output=y,
        input_confidence=_confidence(_as_input(columns_by_name[u]), scores, (u, y), 0) if not input else 1.0,
        output_confidence=_confidence(_as_output(columns_by_name[y]), scores, (u, y), 1) if not output else 1.0,
        feedback=shares[u, y][1],
        others=_further_pairs(possible, experiments, columns_by_name[u], columns_by_name[y]),
    )


def _may_be_channel(column: Column, clock: str, given: tuple[str, str]) -> bool:
    """Whether a column may be input or output: numbers that change or have a clear name, and not the time."""
    if column.kind != "numbers":
        return False
    if column.constant and not column.codes and column.meaning.confidence < 0.8:
        return False
    other = column.name == clock or column.meaning.quantity in (ColumnQuantity.TIME, ColumnQuantity.OTHER)
    return column.name in given or not other


def _most_likely(possible: Sequence[Column], given: tuple[str, str]) -> list[Column]:
    """The columns whose names suit an input or an output best, at most `MOST_COMPARED`, in the order of the file."""
    by_name = sorted(possible, key=lambda c: -max(_as_input(c), _as_output(c), 2.0 * (c.name in given)))
    return [column for column in possible if any(column is each for each in by_name[:MOST_COMPARED])]


def _influences(pairs: Sequence[tuple[Column, Column]], named: Mapping[Pair, float]) -> dict[Pair, tuple[float, float]]:
    """The influence of input on output and of output on input, of pairs whose names suit almost as well as the best."""
    best = max(named.values())
    return {
        (u.name, y.name): (influence(u.signal, y.signal), influence(y.signal, u.signal))
        for u, y in pairs
        if named[u.name, y.name] > best - NAMED_WORSE and len(u.values) == len(y.values)
    }


def _further_pairs(
    possible: Sequence[Column], experiments: Mapping[str, str], u: Column, y: Column
) -> tuple[Pair, ...]:
    """Names of further inputs and outputs of the same quantities, each pair of one experiment."""
    return tuple(
        (a.name, b.name)
        for a, b in permutations(possible, 2)
        if _of_one_experiment(experiments, a.name, b.name)
        and a.meaning.quantity is u.meaning.quantity
        and b.meaning.quantity is y.meaning.quantity
        and (a.name, b.name) != (u.name, y.name)
    )


def find_direction(columns: Sequence[Column], roles: Roles) -> str:
    """The column with the sign of an input that has none; empty where the output does not answer to that more clearly.

    Args:
        columns: of the file, equally long.
        roles: which of them are input and output.
    """
    named = {column.name: column for column in columns}
    u, y = named.get(roles.input), named.get(roles.output)
    if u is None or y is None or not u.low >= 0:
        return ""
    answer = np.gradient(y.signal) if y.meaning.quantity is ColumnQuantity.POSITION else y.signal
    shares = {
        column.name: influence(signs_of(column.values) * u.signal, answer)
        for column in columns
        if column.kind == "numbers" and column.distinct == 2 and column not in (u, y)
    }
    best = max(shares, key=shares.__getitem__, default="")
    return best if best and shares[best] > CLEARER * influence(u.signal, answer) + LEAST else ""


def _experiments(columns: Sequence[Column]) -> dict[str, str]:
    """The experiment of each column: the number at the end of its name, or the sheet or group before its last dot.

    A group counts where another one, or none, has a column of the same name. Without a group it is ``"."`` then.
    """
    groups: dict[str, list[str]] = {}
    for column in columns:
        group, _, name = column.name.rpartition(".")
        groups.setdefault(name, []).append(group)
    found = {}
    for column in columns:
        group, _, name = column.name.rpartition(".")
        found[column.name] = (group or ".") if len(groups[name]) > 1 else column.meaning.number
    return found


def _of_one_experiment(experiments: Mapping[str, str], u: str, y: str) -> float:
    """Columns such as u2 and y2, or of one sheet, belong together; 0 where nothing says so."""
    return 0.3 if experiments[u] and experiments[u] == experiments[y] else 0.0


def _first_of_its_kind(
    best: Pair,
    scores: Mapping[Pair, float],
    columns: Sequence[Column],
    experiments: Mapping[str, str],
) -> Pair:
    """The first of the pairs that differ from the best one by their experiment only."""
    known = {column.name: column for column in columns}
    if not _of_one_experiment(experiments, *best):
        return best

    def alike(pair: Pair) -> bool:
        (a, b), (u, y) = ((known[name] for name in names) for names in (pair, best))
        kinds = a.meaning.quantity is u.meaning.quantity and b.meaning.quantity is y.meaning.quantity
        other = experiments[a.name] != experiments[u.name]
        return kinds and _of_one_experiment(experiments, *pair) > 0 and (pair == best or other)

    return min(filter(alike, scores), key=lambda pair: experiments[pair[0]])


def is_difference(position: Column, speed: Column) -> bool:
    """Whether one column is the change of another from sample to sample, as of an encoder."""
    if len(position.values) != len(speed.values) or len(position.values) < 20:
        return False
    change, said = np.diff(position.values), speed.values[1:]
    moving = (change != 0) | (said != 0)
    alike = np.abs(change - said)[moving] < 1e-9
    return bool(np.count_nonzero(alike) > max(0.95 * len(alike), 10) and np.ptp(said) > 0)


def with_responses(codes: Sequence[Code], u: Array, y: Array) -> tuple[Code, ...]:
    """The codes of an input u (N,) with what the output y (N,) does there."""
    starts, lengths = runs(u)
    result = []
    rest = 0.02 * float(np.nanmax(np.abs(y), initial=0.0))
    for code in codes:
        mine = u[starts] == code.value
        first = np.abs(y[starts[mine]])
        last = np.abs(y[np.minimum(starts[mine] + lengths[mine], len(y) - 1)])
        before, after = float(np.nanmean(first)), float(np.nanmean(last))
        if max(before, after) <= rest:
            word = "rests"
        elif after < 0.7 * before:
            word = "falls"
        elif after > 1.4 * before:
            word = "rises"
        else:
            word = "moves"
        result.append(replace(code, response=word, before=before, after=after))
    return tuple(result)


def _as_input(column: Column) -> float:
    return _AS_INPUT.get(column.meaning.quantity, 0.0) * (column.meaning.confidence or 1.0)


def _as_output(column: Column) -> float:
    return _AS_OUTPUT.get(column.meaning.quantity, 0.0) * (column.meaning.confidence or 1.0)


def _shape(columns: Sequence[Column], pair: Pair) -> float:
    """Inputs change in steps, and the first of two columns is more often the input."""
    names = [column.name for column in columns]
    u, y = (columns[names.index(name)] for name in pair)
    held = float(np.mean(np.diff(u.signal) == 0)) - float(np.mean(np.diff(y.signal) == 0))
    order = 0.05 if names.index(pair[0]) < names.index(pair[1]) else 0.0
    return 0.3 * held + order


def _confidence(by_name: float, scores: dict[Pair, float], chosen: Pair, side: int) -> float:
    """How sure a role is: by the name, and by the distance to the best pair with another column in this role."""
    other = max((score for pair, score in scores.items() if pair[side] != chosen[side]), default=-1.0)
    margin = min(1.0, max(0.0, scores[chosen] - other))
    return round(min(0.98, 0.3 + 0.45 * by_name + 0.25 * margin), 2)
