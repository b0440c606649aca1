"""The masks that leave out samples which are no measurements, and what else the proposed command does about the data.

A model of a sensor that stood still, or of a drift, is a model of something else: without these samples, or without the
line, the error of all kinds of models on other records is smaller. An output at its limit stays in: a sensor may be
saturated, but a tank that overflows or an axis at its stop shows what the system does, and a model without these
samples has several times the error. The finding names the mask. The samples of a joint at its stop are left out, as
what holds it there is no part of a joint.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from emsid.findings import Finding
from emsid.first_look.columns import Column
from emsid.first_look.levels import PART
from emsid.first_look.measurement import CLIPPED
from emsid.first_look.outliers import (
    about_outliers,
    impossible_commands,
    limit_of_ordinary,
    outliers_of,
    outliers_of_answer,
)

STUCK, STOP = "value-stuck", "joint-at-stop"
LEFT_OUT = (STUCK, STOP)
"""The findings whose samples the command leaves out."""


def mask_of(columns: Sequence[Column], output: Column | None) -> str | None:
    """The condition that leaves out codes, missing values where there are many, and outliers.

    Args:
        columns: that are used.
        output: one of them.
    """
    conditions = []
    for column in columns:
        name = in_expression(column)
        if column.gaps:
            conditions.append(f"isnan({name})")
        if not column.codes:
            continue
        limit = max(abs(column.low), abs(column.high))
        if all(abs(code.value) > limit for code in column.codes):
            conditions.append(f"abs({name}) > {limit:g}")
        else:
            values = ", ".join(f"{code.value:g}" for code in column.codes)
            conditions.append(f"{name} IN ({values})")
    conditions += [finding.data["mask"] for finding in masked_outliers(columns, output)]
    return " OR ".join(conditions) or None


def masked_outliers(columns: Sequence[Column], output: Column | None) -> Iterable[Finding]:
    """A finding on the outliers of each channel if a limit leaves out these and nothing else.

    Args:
        columns: that are used; all but the output are inputs.
        output: one of them.
    """
    for column in columns:
        if column.period or column.kind != "numbers":
            continue
        y = column.signal
        if column is output:
            inputs = [other.signal for other in columns if other is not output and len(other.signal) == len(y)]
            found, away = outliers_of_answer(y, inputs[0]) if inputs else outliers_of(y)
        else:
            found, away = impossible_commands(y)
        limit = limit_of_ordinary(y, found)
        if limit is not None:
            yield about_outliers(column.name, found, away, mask=f"abs({in_expression(column)}) > {limit:g}")


def in_expression(column: Column) -> str:
    """The name of a column as a mask has it."""
    return column.name if re.fullmatch(r"[A-Za-z_]\w*", column.name) else f'"{column.name}"'


def mends(findings: Iterable[Finding], columns: Sequence[Column], mask: str) -> tuple[list[Finding], dict[str, Any]]:
    """The findings, with the masks that leave out what they are about, and arguments of `emsid.read` for all of them.

    Args:
        findings: about a record.
        columns: that new masks may be about.
        mask: with which it is read; it is a part of the new one.
    """
    named = {column.name: column for column in columns if column.kind == "numbers" and not column.period}
    found: list[Finding] = []
    conditions = [mask] if mask else []
    read: dict[str, Any] = {}
    for finding in findings:
        if finding.code in _CONDITIONS and finding.subject in named:
            condition = _CONDITIONS[finding.code](finding, named[finding.subject])
            conditions += [condition] if condition and finding.code in LEFT_OUT else []
            finding = replace(finding, data={**finding.data, "mask": condition})
        elif finding.code == "output-drifts":
            read["detrend"] = 1
        found.append(finding)
    if len(conditions) > bool(mask):
        read["mask"] = joined(conditions)
    return found, read


def joined(masks: Iterable[str]) -> str:
    """The mask of what any of several masks leaves out, each condition once."""
    return " OR ".join(dict.fromkeys(part for mask in masks for part in mask.split(" OR ")))


def _stuck(finding: Finding, column: Column) -> str:
    """The condition for a stuck value; empty where it occurs elsewhere, too."""
    value, length = finding.data["value"], finding.data["length"]
    alone = np.count_nonzero(column.values == value) <= (1 + PART) * length
    return f"{in_expression(column)} = {_exact(value)}" if alone else ""


def _cut_off(finding: Finding, column: Column) -> str:
    """The condition for the limit of an output in the numbers of its column; empty where that has no such limit."""
    name, share = in_expression(column), PART * finding.data["share"]
    ends = [(column.low, "<="), (column.high, ">=")]
    for limit, side in ends if finding.data["side"] == "lower" else ends[::-1]:  # a negative gain exchanges them
        if np.mean(column.values == limit) >= share:
            return f"{name} {side} {_exact(limit)}"
    return ""


def _exact(number: float) -> str:
    """A number as a mask has it, with all of its digits."""
    return repr(number).removesuffix(".0")


def _clipped(finding: Finding, column: Column) -> str:
    """The condition for both limits of an output."""
    name = in_expression(column)
    return f"{name} <= {_exact(column.low)} OR {name} >= {_exact(column.high)}"


_CONDITIONS = {STUCK: _stuck, STOP: _cut_off, "values-cut-off": _cut_off, CLIPPED: _clipped}
