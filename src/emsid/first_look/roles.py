"""Which columns are the input and the output: the assignment with the largest total of evidence.

The table `_TABLE` has a row for each kind of evidence about one column, and `_PAIRS` one for each kind about an input
and an output together. Names have a weight of at most one, so that content overrules them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.uncertainty.rounding import runs
from emsid.first_look.columns import Code, Column
from emsid.first_look.levels import EXPLAINS, MOST, NAMED, PART, SAME, SAMPLES
from emsid.first_look.names import ColumnQuantity, meaning
from emsid.first_look.responses import SEEN, Answer, answers, same_motion, share_of_controller
from emsid.io.selection import signs_of

Array = NDArray[np.float64]
Pair = tuple[str, str]

ENOUGH = 12.0
"""Evidence in nats, 5 % of the variance left, beyond which a fit says how good a model is and not what drives what."""
MOST_COMPARED = 8
"""The signals of at most this many columns are compared with each other."""
BEST = 3
"""So many pairs are shown with what they leave unexplained."""
AS_LEVELS = "levels"
"""The reading of a column whose isolated values are no codes, but levels of a command."""
FOLLOWS = (0.6, 1.4)
"""Gains with which the output of a closed loop follows its reference."""
REPEATS = 1 - 1e-9
"""A column with a higher correlation with the times repeats them; measured ones have rounding far above this."""

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
_UNSIGNED = (ColumnQuantity.DUTY, ColumnQuantity.VOLTAGE, ColumnQuantity.INPUT, ColumnQuantity.UNKNOWN)
"""Quantities of commands that are often logged without their sign."""
_AS_OUTPUT = {
    ColumnQuantity.SPEED: 1.0,
    ColumnQuantity.OUTPUT: 0.95,
    ColumnQuantity.POSITION: 0.8,
    ColumnQuantity.CURRENT: 0.3,
    ColumnQuantity.ACCELERATION: 0.2,
    ColumnQuantity.TORQUE: 0.1,
    ColumnQuantity.FORCE: 0.4,
    ColumnQuantity.REFERENCE: -0.5,
    ColumnQuantity.UNKNOWN: 0.2,
}


@dataclass(frozen=True)
class Evidence:
    """A reason for or against a role of a column.

    Attributes:
        column: its name; of a pair, both names.
        role: ``input`` or ``output``; ``pair`` for an input and an output together.
        weight: added to the total of this role; negative for a reason against it.
        reason: in words.
    """

    column: str
    role: str
    weight: float
    reason: str

    def __str__(self) -> str:
        return f"{self.column} as {self.role}: {self.weight:+g}, {self.reason}"


@dataclass(frozen=True)
class Roles:
    """The columns guessed to be input and output.

    Attributes:
        input, output: names of columns; empty where there is none.
        input_confidence, output_confidence: from 0 to 1.
        others: further pairs of input and output, which differ in the number at the end of their names.
        table: the evidence for and against each role of each column, and for this pair.
        direction: the column with the sign of the input; empty where that has its own.
        levels: whether values far from the others are levels of the input, which the output follows.
        tried: the likeliest pairs, this one first, each with the share of the second column's variance that the best
            simple response to the first one leaves; they are ordered by all of the evidence.
        explained: the pairs of columns of which the response to the first one leaves less than half of the second one.
        integral: the evidence, in nats, that the output is an integral of the response to the input.
    """

    input: str = ""
    output: str = ""
    input_confidence: float = 0.0
    output_confidence: float = 0.0
    others: tuple[tuple[str, str], ...] = ()
    table: tuple[Evidence, ...] = ()
    direction: str = ""
    levels: bool = False
    tried: tuple[tuple[str, str, float], ...] = ()
    explained: frozenset[Pair] = frozenset()
    integral: float = 0.0


def find_roles(columns: Sequence[Column], clock: str, input: str = "", output: str = "") -> Roles:
    """The assignment of columns to input and output with the largest total of the evidence for it.

    Args:
        columns: of the file.
        clock: name of the time column; empty where there is none.
        input, output: where the user gives them.
    """
    facts = _Facts(columns, clock)
    table = _evidence(columns, facts)
    totals = {role: {name: sum(e.weight for e in rows) for name, rows in table[role].items()} for role in table}
    possible = [column for column in columns if _may_be_channel(column, clock, (input, output))]
    compared = _most_likely(possible, totals, (input, output))
    pairs = [
        (u, y) for u, y in permutations(compared, 2) if u.name == (input or u.name) and y.name == (output or y.name)
    ]
    if not pairs:
        only = compared[0].name if compared else ""
        return Roles(input, output or (only if only != input else ""), 1.0, 1.0 if output else 0.2)
    lengths = {len(column.values) for column in compared}
    for length in lengths:
        facts.compare([column for column in compared if len(column.values) == length])
    alone = {(u.name, y.name): totals["input"][u.name] + totals["output"][y.name] for u, y in pairs}
    of_pairs = {
        (u.name, y.name): [(weight * share(u, y, facts), reason) for reason, weight, share in _PAIRS]
        for u, y in pairs
        if len(u.values) == len(y.values)
    }
    scores = {pair: alone[pair] + sum(weight for weight, _ in rows) for pair, rows in of_pairs.items()}
    if not scores:
        return Roles(input=input, output=output)
    (u, y) = _first_of_its_kind(max(scores, key=scores.__getitem__), scores, compared, facts, totals)
    named = {column.name: column for column in columns}
    how = facts.read_as.get((u, y), "")
    best = sorted(scores, key=lambda pair: (pair != (u, y), -scores[pair]))[:BEST]
    return Roles(
        input=u,
        output=y,
        input_confidence=_confidence(totals["input"][u], scores, (u, y), 0, facts, named) if not input else 1.0,
        output_confidence=_confidence(totals["output"][y], scores, (u, y), 1, facts, named) if not output else 1.0,
        others=_further_pairs(possible, facts, named[u], named[y]),
        table=(
            *(each for rows in table.values() for name in rows for each in rows[name]),
            *(Evidence(f"{u}, {y}", "pair", round(weight, 3), reason) for weight, reason in of_pairs[u, y] if weight),
        ),
        direction=how if how != AS_LEVELS else "",
        levels=how == AS_LEVELS,
        integral=0.0 if (of_pair := facts.seen(u, y)) is None else of_pair.integral,
        explained=frozenset(pair for pair in scores if (seen := facts.seen(*pair)) and seen.left < EXPLAINS),
        tried=tuple((*pair, answer.left) for pair in best if (answer := facts.answer(named[pair[0]], named[pair[1]]))),
    )


def _evidence(columns: Sequence[Column], facts: _Facts) -> dict[str, dict[str, list[Evidence]]]:
    """For each role and column, what speaks for it and against it."""
    found: dict[str, dict[str, list[Evidence]]] = {role: {c.name: [] for c in columns} for role in ("input", "output")}
    for column in columns:
        for of, reason, weight, test in _TABLE:
            share = test(column, facts)
            for role in found if share else ():
                if of in (role, "channel"):
                    found[role][column.name].append(Evidence(column.name, role, round(weight * share, 3), reason))
    return found


class _Facts:
    """What the evidence for a column needs to know of the others.

    Args:
        columns: of the file.
        clock: name of the time column; empty where there is none.

    Attributes:
        experiments: of each column: the number at the end of its name, or the sheet or group before its last dot. A
            group counts where another one, or none, has a column of the same name; without a group it is ``"."`` then.
            Words at either end of names, such as those of axes, count too where other names have the same ones.
        order: the place of each column in the file.
        signals: the numbers of each column.
        read_as: for each pair, the reading of the first column that the second one answers best: the column with its
            sign, or `AS_LEVELS`; empty for its numbers as they are.
    """

    def __init__(self, columns: Sequence[Column], clock: str) -> None:
        times = next((column.values for column in columns if column.name == clock), np.zeros(0))
        self.times = times
        self.columns = columns
        breaks = np.array(columns[0].breaks if columns else (), dtype=np.intp)
        self.starts = np.union1d(np.flatnonzero(np.diff(times) < 0) + 1, breaks) if len(times) > 1 else breaks
        self.order = {column.name: k for k, column in enumerate(columns)}
        self.signals = {column.name: column.signal for column in columns if column.kind == "numbers"}
        groups: dict[str, list[str]] = {}
        for column in columns:
            group, _, name = column.name.rpartition(".")
            groups.setdefault(name, []).append(group)
        self.experiments: dict[str, str] = {}
        words = _shared_words([column.name for column in columns])
        for column in columns:
            group, _, name = column.name.rpartition(".")
            number = column.meaning.number or words.get(column.name, "")
            self.experiments[column.name] = (group or ".") if len(groups[name]) > 1 else number
        self.most: dict[tuple[ColumnQuantity, str, int], float] = {}
        self._spreads: dict[str, float] = {}
        self._held: dict[str, float] = {}
        self.read_as: dict[Pair, str] = {}
        self._answers: dict[Pair, Answer | None] = {}
        self._motions: dict[Pair, bool] = {}
        self._controlled: dict[str, float] = {}
        for column in columns:
            if column.kind == "numbers":
                key = self._kind(column)
                self.most[key] = max(self.most.get(key, 0.0), self.spread(column))

    def spread(self, column: Column) -> float:
        """The standard deviation of a column."""
        if column.name not in self._spreads:
            known = self.signals[column.name][np.isfinite(self.signals[column.name])]
            self._spreads[column.name] = float(known.std()) if len(known) else 0.0
        return self._spreads[column.name]

    def held(self, column: Column) -> float:
        """The share of rows in which a column does not change."""
        if column.name not in self._held:
            signal = self.signals[column.name]
            self._held[column.name] = float(np.count_nonzero(np.diff(signal) == 0) / max(len(signal) - 1, 1))
        return self._held[column.name]

    def answer(self, u: Column, y: Column) -> Answer | None:
        """How one column answers another one."""
        if (u.name, y.name) not in self._answers:
            self.compare((u, y))
        return self._answers[u.name, y.name]

    def seen(self, u: str, y: str) -> Answer | None:
        """How one of the columns that were compared answers another one, where a response is seen."""
        answer = self._answers.get((u, y))
        return answer if answer is not None and answer.evidence >= SEEN else None

    def compare(self, columns: Sequence[Column]) -> None:
        """Find how columns of one length answer each other, all at once: the responses to a column serve all others.

        Another reading of a column than its numbers as they are has to be clearly better.
        """
        named = {column.name: column for column in columns}
        self._compare([(name, how, x) for name, column in named.items() for how, x in self._readings(column).items()])
        if any(column.codes for column in columns):  # in rows of their own: those of codes are left out above
            self._compare([(c.name, AS_LEVELS if c.codes else "", c.values) for c in columns])
        for pair in permutations(named, 2):
            self._answers.setdefault(pair, None)

    def _compare(self, readings: Sequence[tuple[str, str, Array]]) -> None:
        table = np.column_stack([numbers for _, _, numbers in readings])
        usable = np.isfinite(table).all(axis=1)
        starts = np.searchsorted(np.flatnonzero(usable), self.starts)
        found = answers(table[usable], np.unique([0, *starts[starts < usable.sum()]]).tolist())
        for (a, b), answer in found.items():
            (u, how, _), (y, of_output, _) = readings[a], readings[b]
            known = self._answers.get((u, y))
            if (
                y not in (u, how)
                and not of_output
                and (known is None or answer.evidence > known.evidence + SEEN * bool(how))
            ):
                self._answers[u, y], self.read_as[u, y] = answer, how

    def _readings(self, column: Column) -> dict[str, Array]:
        """The numbers of a column; of a command without a sign also with the sign of every column of two values."""
        signal = self.signals[column.name]
        if column.constant or column.low < 0 or column.meaning.quantity not in _UNSIGNED:
            return {"": signal}
        signs = [x for x in self.columns if x.distinct == 2 and len(x.values) == len(signal) and x is not column]
        return {"": signal} | {each.name: signs_of(each.values) * signal for each in signs[:MOST_COMPARED]}

    def explained(self, u: Column, y: Column) -> float:
        """The evidence that the first column drives the second one, as a share of what is enough."""
        answer = self.seen(u.name, y.name)
        return 0.0 if answer is None else min(answer.evidence / ENOUGH, 1.0)

    def static(self, u: Column, y: Column) -> bool:
        """Whether the second column follows the first one at once, as two measurements of one quantity do."""
        answer = self.seen(u.name, y.name)
        return answer is not None and answer.static

    def opposes(self, u: Column, y: Column) -> bool:
        """Whether the second column answers the first one with the other sign, as few drives do."""
        answer = self.seen(u.name, y.name)
        return answer is not None and answer.sign < 0 and not answer.ambiguous

    def first(self, u: Column, y: Column) -> float:
        """How much better the second column answers the first one than the other way round, and how much later."""
        one, other = self.answer(u, y), self.answer(y, u)
        if one is None or other is None:
            return 0.0
        order = [min(each.evidence, ENOUGH) - min(each.ahead, ENOUGH / 2) for each in (one, other)]
        return float(np.clip((order[0] - order[1]) / (ENOUGH / 2), -1, 1))

    def one_motion(self, speed: Column, position: Column) -> bool:
        """Whether the displacements of a column within runs are the sums of another one."""
        pair = speed.name, position.name
        if pair not in self._motions:
            times = self.times if len(self.times) == len(speed.values) else None
            one, other = (self.signals[name] for name in pair)
            self._motions[pair] = same_motion(one, other, self.starts.tolist(), times)
        return self._motions[pair]

    def controlled(self, u: Column) -> float:
        """The share of u that a controller explains which makes an output follow a third column; 0 below a half."""
        if u.name not in self._controlled:
            found = [0.0]
            for r, y in self._answers:
                follows, drives, back = self.seen(r, y), self.seen(u.name, y), self._answers.get((y, u.name))
                if r == u.name or follows is None or drives is None:
                    continue
                better = back is None or back.evidence <= drives.evidence
                if better and FOLLOWS[0] < follows.gain < FOLLOWS[1] and not follows.integrates:
                    found.append(share_of_controller(*(self.signals[name] for name in (u.name, r, y))))
            self._controlled[u.name] = max(found) if max(found) > EXPLAINS else 0.0
        return self._controlled[u.name]

    def motion(self, column: Column) -> float:
        """The share of the largest motion of a column of the same quantity and unit; 1 where it is alone."""
        most = self.most.get(self._kind(column), 0.0)
        return self.spread(column) / most if most > 0 else 1.0

    def of_one_experiment(self, u: str, y: str) -> bool:
        """Whether two columns are such as u2 and y2, or of one sheet; False where nothing says so."""
        return bool(self.experiments[u]) and self.experiments[u] == self.experiments[y]

    @staticmethod
    def _kind(column: Column) -> tuple[ColumnQuantity, str, int]:
        return column.meaning.quantity, column.meaning.unit, len(column.values)


def _shared_words(names: Sequence[str]) -> dict[str, str]:
    """The first or the last word of names, apart by ``_``, that tells their system and no quantity.

    Two or more of these words are before, or behind, two or more other ones.

    >>> _shared_words(["ref_x", "ref_y", "pos_x", "pos_y", "speed_rpm"])
    {'ref_x': 'x', 'ref_y': 'y', 'pos_x': 'x', 'pos_y': 'y'}
    >>> _shared_words(["left_pwm", "right_pwm", "left_ticks", "right_ticks", "time"])
    {'left_pwm': 'left', 'right_pwm': 'right', 'left_ticks': 'left', 'right_ticks': 'right'}
    """
    found = {}
    for first in (True, False):
        cut = {name: name.partition("_") if first else name.rpartition("_")[::-1] for name in names if "_" in name}
        words: dict[str, set[str]] = {}
        for word, _, rest in cut.values():
            if len(word) == 1 or meaning(word).confidence < NAMED:  # letters are axes
                words.setdefault(rest, set()).add(word)
        for name, (word, _, rest) in cut.items():
            others = [other & words.get(rest, set()) for another, other in words.items() if another != rest]
            if any(word in shared and len(shared) > 1 for shared in others):
                found[name] = word
    return found


def _constant_in_runs(column: Column, facts: _Facts) -> float:
    """Whether a column changes only where a run begins."""
    if column.kind != "numbers" or column.constant or not len(facts.starts) or len(column.values) != len(facts.times):
        return 0.0
    changes = np.flatnonzero(np.diff(column.values) != 0) + 1
    return float(np.isin(changes, facts.starts).all())


def _repeats_clock(column: Column, facts: _Facts) -> float:
    """Whether a column without a name of a quantity is proportional to the times."""
    named = column.meaning.confidence >= NAMED and column.meaning.quantity is not ColumnQuantity.TIME
    if named or column.kind != "numbers" or column.constant or len(column.values) != len(facts.times):
        return 0.0
    few = slice(None, None, max(len(facts.times) // SAMPLES, 1))
    x, t = column.values[few], facts.times[few]
    known = np.isfinite(x) & np.isfinite(t)
    if np.count_nonzero(known) < 3 or not (np.ptp(t[known]) and np.ptp(x[known])):
        return 0.0
    return float(np.corrcoef(x[known], t[known])[0, 1] > REPEATS)


def _sags(column: Column, facts: _Facts) -> float:
    """Whether a voltage falls as a current rises, as that of a supply does."""
    if column.meaning.quantity is not ColumnQuantity.VOLTAGE or column.kind != "numbers":
        return 0.0
    same = [x for x in facts.columns if x.kind == "numbers" and len(x.values) == len(column.values)]
    currents = [x for x in same if x.meaning.quantity is ColumnQuantity.CURRENT and not x.constant]
    found = [answer for x in currents if (answer := facts.answer(x, column)) is not None]
    return float(any(each.evidence >= SEEN and each.sign < 0 for each in found))


def _counts_rows(column: Column, facts: _Facts) -> float:
    """Whether a column counts its rows, perhaps anew in every run."""
    steps = np.diff(column.values) if column.kind == "numbers" else np.zeros(0)
    return float(len(steps) > 2 and np.mean(steps == 1) > MOST)


def _named(column: Column, weights: Mapping[ColumnQuantity, float]) -> float:
    """How well the name or the unit of a column says that it has a role."""
    return weights.get(column.meaning.quantity, 0.0) * (column.meaning.confidence or 1.0)


_TABLE: tuple[tuple[str, str, float, Callable[[Column, _Facts], float]], ...] = (
    ("input", "its name or unit is of an input", 1.0, lambda column, facts: _named(column, _AS_INPUT)),
    ("output", "its name or unit is of an output", 1.0, lambda column, facts: _named(column, _AS_OUTPUT)),
    # Content overrules names, whose weight is at most 1.
    ("channel", "it is constant", -1.5, lambda column, facts: column.constant and not column.codes),
    ("output", "it is constant in every run", -1.5, _constant_in_runs),
    ("channel", "it repeats the times", -1.5, _repeats_clock),
    ("channel", "it counts the rows", -1.5, _counts_rows),
    ("input", "it falls as a current rises, as the voltage of a supply does", -1.0, _sags),
    (
        "channel",
        "others of its kind move much more",
        -0.5,
        lambda column, facts: column.kind == "numbers" and not column.constant and facts.motion(column) < PART,
    ),
)
"""By role, or for every channel: a reason, its weight, and a test of how far it applies to a column, from 0 to 1."""
_PAIRS: tuple[tuple[str, float, Callable[[Column, Column, _Facts], float]], ...] = (
    ("they are of one experiment", 0.6, lambda u, y, facts: facts.of_one_experiment(u.name, y.name)),
    ("a simulated response to the first explains the second", 1.0, lambda u, y, facts: facts.explained(u, y)),
    ("the response to the first is better, or later, than to the second", 0.3, lambda u, y, facts: facts.first(u, y)),
    ("the second is in proportion to the first, without lag", -0.3, lambda u, y, facts: facts.static(u, y)),
    ("the second falls when the first rises", -0.2, lambda u, y, facts: facts.opposes(u, y)),
    ("a controller sets the first", 1.0, lambda u, y, facts: facts.controlled(u)),
    ("one is the speed of the other", -1.5, lambda u, y, facts: facts.one_motion(u, y) or facts.one_motion(y, u)),
    ("the first changes in steps, more than the second", 0.3, lambda u, y, facts: facts.held(u) - facts.held(y)),
    ("the first stands before the second", 0.05, lambda u, y, facts: facts.order[u.name] < facts.order[y.name]),
)
"""A reason for an input and an output together, its weight, and how far it applies, from −1 to 1."""


def _may_be_channel(column: Column, clock: str, given: tuple[str, str]) -> bool:
    """Whether a column may be input or output: numbers that change or have a clear name, and not the time."""
    if column.kind != "numbers":
        return False
    if column.constant and not (column.codes or abs(column.low) > 0 or column.meaning.confidence >= NAMED):
        return False
    other = column.name == clock or column.meaning.quantity in (ColumnQuantity.TIME, ColumnQuantity.OTHER)
    return column.name in given or not other


def _most_likely(
    possible: Sequence[Column], totals: Mapping[str, Mapping[str, float]], given: tuple[str, str]
) -> list[Column]:
    """The columns with the most evidence for input or output, at most `MOST_COMPARED`, in the order of the file."""
    by_total = sorted(
        possible,
        key=lambda c: -max(totals["input"][c.name], totals["output"][c.name], 2.0 * (c.name in given)),
    )
    return [column for column in possible if any(column is each for each in by_total[:MOST_COMPARED])]


def _further_pairs(possible: Sequence[Column], facts: _Facts, u: Column, y: Column) -> tuple[Pair, ...]:
    """Names of further inputs and outputs of the same quantities, each pair of one experiment."""
    return tuple(
        (a.name, b.name)
        for a, b in permutations(possible, 2)
        if facts.of_one_experiment(a.name, b.name)
        and a.meaning.quantity is u.meaning.quantity
        and b.meaning.quantity is y.meaning.quantity
        and (a.name, b.name) != (u.name, y.name)
    )


def _first_of_its_kind(
    best: Pair,
    scores: Mapping[Pair, float],
    columns: Sequence[Column],
    facts: _Facts,
    totals: Mapping[str, Mapping[str, float]],
) -> Pair:
    """The first of the pairs that differ from the best one by their experiment only, and move as it does."""
    known = {column.name: column for column in columns}
    if not facts.of_one_experiment(*best):
        return best

    def alike(pair: Pair) -> bool:
        (a, b), (u, y) = ((known[name] for name in names) for names in (pair, best))
        kinds = a.meaning.quantity is u.meaning.quantity and b.meaning.quantity is y.meaning.quantity
        other = facts.experiments[a.name] != facts.experiments[u.name]
        as_much = (
            totals["input"][a.name] >= totals["input"][u.name] and totals["output"][b.name] >= totals["output"][y.name]
        )
        return as_much and kinds and facts.of_one_experiment(*pair) and (pair == best or other)

    return min(filter(alike, scores), key=lambda pair: facts.experiments[pair[0]])


def with_responses(codes: Sequence[Code], u: Array, y: Array) -> tuple[Code, ...]:
    """The codes of an input u (N,) with what the output y (N,) does there."""
    starts, lengths = runs(u)
    result = []
    rest = SAME * float(np.nanmax(np.abs(y), initial=0.0))
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


def _confidence(
    by_name: float, scores: Mapping[Pair, float], chosen: Pair, side: int, facts: _Facts, named: Mapping[str, Column]
) -> float:
    """How sure a role is: by the name, and by the distance to the best pair with another column in this role.

    That distance and a response that explains the output are worth a name. The speed and the position of one motion are
    both right; two measurements of one quantity tell nothing.
    """
    column, (u, y) = named[chosen[side]], (named[name] for name in chosen)
    explained = 0.0 if facts.static(u, y) else facts.explained(u, y)

    def same(name: str) -> bool:
        other = named[name]
        return other is column or (
            len(other.values) == len(column.values)
            and (facts.one_motion(column, other) or facts.one_motion(other, column))
        )

    others = sorted(scores, key=scores.__getitem__, reverse=True)
    other = next((scores[pair] for pair in others if not same(pair[side])), -1.0)
    margin = min(1.0, max(0.0, scores[chosen] - other))
    return round(min(0.98, 0.3 + 0.45 * max(by_name, explained * margin) + 0.25 * margin), 2)
