"""The first look at several files: which of them belong together, and what they show together.

**Systems.** Files of one logger may be of different motors. Files that are read alike are told apart by two signs
together: other words above the header of the table, and another response. The response is compared by regressions of
the output on past outputs, past inputs, hinges of the input and the sign of the speed, which allow for a dead zone and
for friction: F is the growth of the residual where two records share their parameters. Two halves of one record show
how large F is without a change of the system (Chow, 1960).

**Groups.** Whether data suffice for a model is a question about all of its records: each may be one step, and all of
them may show dead zone and friction well.

**Hypotheses.** Without named columns, pairs of columns are tried as input and output, with the evidence for each. An
identification takes what is almost certain and asks for the rest.

References:
    Chow, *Tests of equality between sets of coefficients in two linear regressions*, Econometrica 28 (1960).
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.findings import Finding
from emsid.first_look.columns import Column, column_of_numbers
from emsid.first_look.data_advice import TOLERANCE, advice, opposite_signs
from emsid.first_look.examined import response_of
from emsid.first_look.levels import FEWEST_SAMPLES, LAGS, MOST, SAMPLES, UNSURE
from emsid.first_look.look import CONSTANT, FirstLook, describe
from emsid.first_look.masks import joined
from emsid.first_look.names import ColumnQuantity, meaning
from emsid.first_look.roles import find_roles
from emsid.io.columns import as_numbers
from emsid.io.reading import parsed_file, read_columns
from emsid.record import Record, concatenate
from emsid.record.holding_back import has_equal_samples

Array = NDArray[np.float64]

HINGES = 6
"""Hinges over the range of the input that both records have."""
LARGER = 3.0
"""F between records of different systems is at least this multiple of F between halves of one of them."""


class Source(NamedTuple):
    """A file among several that are read alike.

    Attributes:
        path: of the file.
        header: the lines above the header of its table.
        record: of its first input and output.
    """

    path: str
    header: Sequence[str]
    record: Record

    @property
    def name(self) -> str:
        """Of the file, without its folder."""
        return PurePath(self.path).name

    @property
    def words(self) -> frozenset[str]:
        """The words of its header, without numbers."""
        return frozenset(re.findall(r"[^\W\d_]\w+", " ".join(self.header)))


def systems(sources: Sequence[Source]) -> tuple[list[list[Source]], list[Finding]]:
    """The files of each system, and a finding for each system but the first.

    Args:
        sources: files that are read alike.
    """
    by_words: dict[frozenset[str], list[Source]] = {}
    for source in sources:
        by_words.setdefault(source.words, []).append(source)
    groups: list[list[Source]] = []
    found: list[Finding] = []
    for alike in by_words.values():
        longest = max(alike, key=lambda each: len(each.record))
        ratios = [_difference(max(group, key=lambda each: len(each.record)), longest) for group in groups]
        same = next((group for group, ratio in zip(groups, ratios, strict=True) if not ratio > LARGER), None)
        if same is not None:
            same += alike
            continue
        if groups:
            words = sorted(longest.words ^ groups[0][0].words)
            data = {"files": [each.name for each in alike], "others": [each.name for each in groups[0]]}
            found.append(
                Finding("files-of-another-system", longest.name, data | {"words": words, "ratio": min(ratios)})
            )
        groups.append(list(alike))
    return groups, found


def _difference(one: Source, other: Source) -> float:
    """F between two records over the largest F between the halves of one of them; zero where they are too short."""
    a, b = one.record[:SAMPLES], other.record[:SAMPLES]
    within = [statistic(x[: len(x) // 2], x[len(x) // 2 :]) for x in (a, b)]
    between = statistic(a, b)
    return between / max(*within, 1.0) if np.isfinite([*within, between]).all() else 0.0


def statistic(a: Record, b: Record) -> float:
    """F of a regression for two records with parameters of their own against shared ones; infinite for too few samples.

    Without a difference its mean is about one, or more where the residual is not white.
    """
    low = max(float(a.input[:, 0].min()), float(b.input[:, 0].min()))
    high = min(float(a.input[:, 0].max()), float(b.input[:, 0].max()))
    knots = np.linspace(low, high, HINGES + 2)[1:-1]
    tables = [_table(each, knots) for each in (a, b)]
    columns = tables[0].shape[1] - 1
    if min(map(len, tables)) < 4 * columns or not high > low:
        return float("inf")
    own = sum(map(_residual, tables))
    shared, free = _residual(np.vstack(tables)), sum(map(len, tables)) - 2 * columns
    return (shared - own) / columns / (own / free) if own > 0 else 0.0


def _table(record: Record, knots: Array) -> Array:
    """The regressors and, last, the output of every sample whose past is known."""
    rows = []
    for piece in record.segments:
        u, y = piece.input[:, 0], piece.output[:, 0]
        now = np.arange(LAGS, len(y))
        columns = [np.ones(len(now)), y[now - 1], y[now - 2], np.sign(y[now - 1])]
        columns += [u[now - lag] for lag in range(LAGS)]
        columns += [np.maximum(u[now - 1] - knot, 0.0) for knot in knots]
        rows.append(np.column_stack([*columns, y[now]]))
    return np.concatenate(rows)


def _residual(table: Array) -> float:
    """The sum of squares that the regression leaves."""
    scale = np.abs(table[:, :-1]).max(axis=0)
    regressors = table[:, :-1] / np.where(scale > 0, scale, 1.0)
    estimate = np.linalg.lstsq(regressors, table[:, -1], rcond=1e-9)[0]
    return float(np.sum((table[:, -1] - regressors @ estimate) ** 2))


OF_ALL = frozenset(
    {
        "amplitude-near-dead-zone",
        "dead-zone-likely",
        "excitation-linear-only",
        "excitation-sufficient",
        "excitation-too-low",
        "few-input-levels",
        "motion",
        "much-standstill",
        "nearly-linear",
        "nonlinear-likely",
        "unexplained-output",
    }
)
"""Findings about how much data show; of several files together they may be others than of each."""
LOOPS = frozenset({"feedback-likely", "reference-column"})
"""Findings about a controller, which gives a response another sign than that of the plant."""


@dataclass(frozen=True)
class Group:
    """Files for one command, and what they show together.

    Args:
        looks: at files of one system that are read in the same way.
        findings: about all of them; empty for a single file.
    """

    looks: tuple[FirstLook, ...]
    findings: tuple[Finding, ...] = ()

    @property
    def against(self) -> str:
        """The input against which the outputs of all files go; empty where there is none, or a loop explains it."""
        found = [f.data["input"] for look in self.looks for f in look.findings if _is_reversed(f)]
        in_loop = any(f.code in LOOPS for look in self.looks for f in look.findings)
        return found[0] if len(found) == len(self.looks) and not in_loop else ""

    @property
    def reading(self) -> dict[str, Any]:
        """The arguments of `emsid.read` for all files, with repairs, and the sign of an input that all oppose."""
        reading = {**self.looks[0].reading, **self.mends}
        if self.against:
            scale = reading.get("scale", {})
            reading["scale"] = {**scale, self.against: -scale.get(self.against, 1)}
        return reading

    @property
    def fit(self) -> Mapping[str, Any]:
        """The further arguments of `emsid.identify`."""
        return self.looks[0].fit

    @property
    def mends(self) -> dict[str, Any]:
        """The further arguments of `emsid.read` that any file needs, for all of them."""
        every = {name: value for look in self.looks for name, value in look.mends.items()}
        if "mask" in every:
            every["mask"] = joined(look.mends["mask"] for look in self.looks if "mask" in look.mends)
        return every


def groups(looks: Sequence[FirstLook]) -> list[Group]:
    """The files for each command: of one system, read in the same way, and with responses of the same sign.

    Args:
        looks: at every file.
    """
    kinds: dict[tuple[str, int, bool], list[FirstLook]] = {}
    for look in looks:
        if not (look.useless or look.copy_of):
            reverse = any(map(_is_reversed, look.findings))
            kinds.setdefault((look.read_as, look.system, reverse), []).append(look)
    still = [look for look in looks if look.useless == {CONSTANT}]
    return [Group(tuple(alike), tuple(_of_all(alike, still))) for alike in kinds.values()]


def without_findings_of_all(look: FirstLook, divided: Sequence[Group]) -> FirstLook:
    """The look without the findings that are said of all files of its group.

    Args:
        look: at one of several files.
        divided: the files for each command, by `groups`.
    """
    if not any(group.findings and any(look is each for each in group.looks) for group in divided):
        return look
    return replace(look, findings=tuple(finding for finding in look.findings if finding.code not in OF_ALL))


def _is_reversed(finding: Finding) -> bool:
    return finding.code == "response-negative" and finding.data["confidence"] >= UNSURE


def _of_all(alike: Sequence[FirstLook], still: Sequence[FirstLook]) -> Iterable[Finding]:
    """What files show together, with those in which the output does not move: they show where a dead zone ends."""
    if len(alike) < 2:
        return
    beside = [each for each in still if (each.read_as, each.system) == (alike[0].read_as, alike[0].system)]
    try:
        record = concatenate(each.record for each in (*alike, *beside) if each.record is not None)
    except DataError:  # of different sample times, for instance
        return
    response = response_of(record)
    if response is not None:
        yield from (each for each in advice(record, response, alike[0].tolerance) if each.code in OF_ALL)


def describe_files(
    paths: Sequence[Any], *, tolerance: float = TOLERANCE, **reading: Any
) -> tuple[list[FirstLook], list[Finding]]:
    """Look at several files, and at what they have in common.

    Two files of one signal each are the input and the output of one record where they are equally long and have the
    same times, if they have any, and where their times differ, overlap, and the signals are of different quantities.

    Args:
        paths: the files, or what they were parsed to.
        tolerance, reading: as for `describe`.

    Returns:
        What was found in each file, and findings about all of them.

    Raises:
        FormatError: where a file cannot be read at all.
        DataError: where an argument that is given cannot be used.
    """
    if len(paths) == 2 and not {"input", "output", "dbc"} & set(reading):
        pair = _input_and_output([Path(path) for path in paths])
        if pair is not None:
            u, y = pair
            file = next(path for path in paths if y.startswith(f"{path}:"))
            return [describe(file, tolerance=tolerance, **reading, input=u, output=y)], []
    looks = [describe(path, tolerance=tolerance, **reading) for path in paths]
    looks, equal = _without_copies(looks)
    looks, different = _told_apart(looks)
    return looks, [*equal, *opposite_signs((look.name, look.response) for look in looks), *different]


def _without_copies(looks: Sequence[FirstLook]) -> tuple[list[FirstLook], list[Finding]]:
    """The looks, those at the samples of an earlier file marked, and a finding for each file that has copies."""
    copies: dict[str, list[str]] = {}
    found: list[FirstLook] = []
    for look in looks:
        original = next((each for each in found if not each.copy_of and _is_copy(look.record, each.record)), None)
        if original is not None:
            copies.setdefault(original.path, []).append(look.path)
            look = replace(look, copy_of=original.path)
        found.append(look)
    return found, [Finding("files-equal", file, {"copies": others}) for file, others in copies.items()]


def _is_copy(record: Record | None, other: Record | None) -> bool:
    """Whether two records have the same samples at the same times."""
    if record is None or other is None or (record.dt, record.breaks) != (other.dt, other.breaks):
        return False
    return has_equal_samples(record, other)


def _told_apart(looks: Sequence[FirstLook]) -> tuple[list[FirstLook], list[Finding]]:
    """The looks with the numbers of their systems, and findings about those that are read alike and differ."""
    kinds: dict[str, list[FirstLook]] = {}
    for look in looks:
        if look.record is not None and look.record.output.shape[1]:
            kinds.setdefault(look.read_as, []).append(look)
    numbers: dict[str, int] = {}
    found: list[Finding] = []
    for alike in kinds.values():
        sources = [Source(each.path, each.header, each.record) for each in alike if each.record is not None]
        groups, different = systems(sources)
        numbers |= {source.path: number for number, group in enumerate(groups) for source in group}
        found += different
    return [replace(look, system=numbers.get(look.path, 0)) for look in looks], found


def _input_and_output(paths: Sequence[Path]) -> tuple[str, str] | None:
    """The names of the input and the output in two files of one signal each; None where they are something else."""
    signals, clocks, names = [], [], []
    for path in paths:
        columns = read_columns(path)
        series = columns.series
        times = [name for name in series if meaning(name).quantity is ColumnQuantity.TIME]
        if len(series) != len(times) + 1 or len(times) > 1:
            return None
        readable = not (columns.damaged or columns.clocks) and all(series[name].dtype.is_numeric() for name in times)
        names.append(times if readable else [])
        clocks.append([as_numbers(series[name]) for name in times])
        name = next(name for name in series if name not in times)
        said = max(meaning(name), meaning(path.stem), key=lambda each: each.confidence)
        shown = "1" if name == "c1" else name
        signals.append(column_of_numbers(f"{path}:{shown}", "numbers", said, as_numbers(series[name])))
    same = len(signals[0].values) == len(signals[1].values) and np.array_equal(clocks[0], clocks[1])
    if not same:
        comparable = names[0] and names[0] == names[1]
        signals = _at_common_times(signals, [clock for (clock,) in clocks]) if comparable else []
    roles = find_roles(signals, "")
    return (roles.input, roles.output) if roles.input else None


def _at_common_times(signals: Sequence[Column], clocks: Sequence[Array]) -> list[Column]:
    """Two signals (Nᵢ,) at the times (Nᵢ,) of the one with fewer samples where both have some.

    None where these are too few, or where both are of one known quantity, as in the files of two experiments.
    """
    quantities = {each.meaning.quantity for each in signals}
    begin, end = max(t[0] for t in clocks), min(t[-1] for t in clocks)
    times = min(clocks, key=len)
    times = times[(times >= begin) & (times <= end)]
    if len(times) < FEWEST_SAMPLES or (len(quantities) == 1 and quantities != {ColumnQuantity.UNKNOWN}):
        return []
    return [
        column_of_numbers(each.name, each.kind, each.meaning, np.interp(times, t, each.values))
        for each, t in zip(signals, clocks, strict=True)
    ]


LISTED = 3
"""At most this many pairs are listed."""


@dataclass(frozen=True)
class Hypothesis:
    """Files with an input and an output.

    Attributes:
        looks: at the files.
        reading: the arguments of `emsid.read` for them.
        left: the share of the variance of the output that the best simple response to the input leaves; 1 where none
            was fitted.
    """

    looks: tuple[FirstLook, ...]
    reading: Mapping[str, Any]
    left: float

    @property
    def fit(self) -> Mapping[str, Any]:
        """The further arguments of `emsid.identify`."""
        return self.looks[0].fit


def hypotheses(paths: Sequence[str | os.PathLike[str]], given: Mapping[str, Any]) -> tuple[list[Hypothesis], bool]:
    """The pairs of input and output in files, the best first, and whether that is almost certain.

    Args:
        paths: the files.
        given: the other arguments of `emsid.read` that are known.

    Returns:
        What `describe_files` proposes for every group of files, and where that is one, other likely pairs of its
        columns; nothing where there is nothing to identify.

    Raises:
        FormatError: where a file cannot be read at all.
        DataError: where an argument that is given cannot be used.
    """
    looks, _ = describe_files(paths, **given)
    found = groups(looks)
    if len(found) != 1:
        return [_hypothesis(group) for group in found][:LISTED], False
    (group,) = found
    left_out = any(look.useless for look in looks)
    sure = not left_out and all(map(_is_almost_certain, group.looks))
    if sure:
        return [_hypothesis(group)], True
    own = group.looks[0].roles
    others = [*own.others, *((u, y) for u, y, _ in own.tried[1:])]
    return [_hypothesis(group), *of_pairs(paths, given, list(dict.fromkeys(others))[: LISTED - 1])], False


def _is_almost_certain(look: FirstLook) -> bool:
    roles = look.roles
    return not roles.others and min(roles.input_confidence, roles.output_confidence, look.clock.confidence) >= MOST


def _hypothesis(group: Group) -> Hypothesis:
    return Hypothesis(
        group.looks, group.reading, max(look.roles.tried[0][2] if look.roles.tried else 1.0 for look in group.looks)
    )


def of_pairs(
    paths: Sequence[str | os.PathLike[str]], given: Mapping[str, Any], pairs: Sequence[tuple[str, str]]
) -> list[Hypothesis]:
    """The hypotheses for named pairs of columns.

    Args:
        paths: the files.
        given: the other arguments of `emsid.read` that are known.
        pairs: names of an input and an output each.
    """
    found, files = [], [parsed_file(path, in_part=True, dbc=given.get("dbc")) for path in paths] if pairs else []
    for u, y in pairs:
        divided = groups(describe_files(files, **given, input=u, output=y)[0])
        found += [_hypothesis(group) for group in divided[:1]]
    return found
