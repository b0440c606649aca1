"""What can be done about a finding, as a change of the step that a button of the page makes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from emsid.findings import Finding
from emsid.record import Record

Edit = dict[str, Any]
PHYSICAL = ["rigid-motor", "arx"]
"""Models to compare where a physical one is proposed."""

EDITS: dict[str, Callable[[Finding, Record], Edit]] = {
    "next-physical-model": lambda finding, record: {"models": PHYSICAL},
    "interrupted": lambda finding, record: {"again": True},
    "models-left-out": lambda finding, record: {"models": []},
    "response-negative": lambda finding, record: {"given": {"scale": {record.input_names[0]: -1.0}}},
}
"""By the code of a finding: the changed parts of a step; ``given`` are arguments of `emsid.read`, and ``again`` fits
again without a change."""


def edit_for(finding: Finding, record: Record) -> Edit | None:
    """The change that a finding proposes; None where it proposes none that can be made here."""
    if finding.code in EDITS:
        return EDITS[finding.code](finding, record)
    named = finding.data.get("column") or finding.data.get("channel")
    if "as-output" in finding.code and named:
        return {"given": {"output": named}, "again": True}
    return None
