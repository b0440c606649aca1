"""What can be done about a finding, as a change of the step that a button of the page makes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from emsid.findings import Finding
from emsid.record import Record

Edit = dict[str, Any]
PHYSICAL = ["rigid-motor", "arx"]
"""Models to compare where a physical one is proposed."""

FREE_RUN = "-free-run"
"""The end of the names of regressions that are fitted to the free run."""


def fit_free_run(finding: Finding, record: Record) -> Edit:
    """The same regression fitted to the free run; of a linear one that is output-error."""
    from emsid.identification.candidates import CANDIDATES

    name = f"{finding.model}{FREE_RUN}"
    return {"models": [name if name in CANDIDATES else "output-error"]}


EDITS: dict[str, Callable[[Finding, Record], Edit]] = {
    "next-physical-model": lambda finding, record: {"models": PHYSICAL},
    "regression-biased": fit_free_run,
    "map-is-straight": lambda finding, record: {"models": ["output-error"]},
    "interrupted": lambda finding, record: {"again": True},
    "response-negative": lambda finding, record: {"given": {"scale": {record.input_names[0]: -1.0}}},
}
"""By the code of a finding: the changed parts of a step; ``given`` are arguments of `emsid.read`, and ``again`` fits
again without a change."""


def edit_for(finding: Finding, record: Record) -> Edit | None:
    """The change that a finding proposes; None where it proposes none that can be made here."""
    return EDITS[finding.code](finding, record) if finding.code in EDITS else None


def channels_for(finding: Finding, reading: Mapping[str, Any]) -> Edit | None:
    """The arguments of `emsid.read` with the further channels that a first look proposes; None where it has none.

    A position takes the place of the speed that comes from it; a load and a current are used beside what is.
    """
    if finding.code != "further-channels":
        return None
    found = finding.data
    if found["positions"]:
        return {"output": found["positions"][0]}
    role, more = ("output", found["outputs"]) if found["outputs"] else ("input", found["inputs"])
    present = reading[role]
    return {role: [*([present] if isinstance(present, str) else present), *more]}
