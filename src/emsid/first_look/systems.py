"""Whether files that are read alike are of the same system.

Files of one logger may be of different motors. They are told apart by two signs together: other words above the header
of the table, and another response. The response is compared by regressions of the output on past outputs, past inputs,
hinges of the input and the sign of the speed, which allow for a dead zone and for friction: F is the growth of the
residual where two records share their parameters. Two halves of one record show how large F is without a change of the
system (Chow, 1960).

References:
    Chow, G. C. (1960). Tests of equality between sets of coefficients in two linear regressions. Econometrica 28(3),
    591–605.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import PurePath
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.findings import Finding
from emsid.first_look.levels import LAGS, SAMPLES
from emsid.record import Record

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
