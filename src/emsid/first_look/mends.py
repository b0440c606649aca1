"""What the proposed command does about samples that are no measurements, and about a drift.

A model of a sensor that stood still, or of a drift, is a model of something else: without these samples, or without the
line, the error of all kinds of models on other records is smaller. An output at its limit stays in: a sensor may be
saturated, but a tank that overflows or an axis at its stop shows what the system does, and a model without these
samples has several times the error. The finding names the mask. The samples of a joint at its stop are left out, as
what holds it there is no part of a joint.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from emsid.findings import Finding
from emsid.first_look.columns import Column
from emsid.first_look.levels import PART
from emsid.first_look.masks import in_expression

STUCK, STOP = "value-stuck", "joint-at-stop"
LEFT_OUT = (STUCK, STOP)
"""The findings whose samples the command leaves out."""
LEAST = 0.5
"""The value of a column is the limit of a record where its share of the rows is at least this part of that found."""


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
    name, share = in_expression(column), LEAST * finding.data["share"]
    ends = [(column.low, "<="), (column.high, ">=")]
    for limit, side in ends if finding.data["side"] == "lower" else ends[::-1]:  # a negative gain exchanges them
        if np.mean(column.values == limit) >= share:
            return f"{name} {side} {_exact(limit)}"
    return ""


def _exact(number: float) -> str:
    """A number as a mask has it, with all of its digits."""
    return repr(number).removesuffix(".0")


_CONDITIONS = {STUCK: _stuck, STOP: _cut_off, "values-cut-off": _cut_off}
