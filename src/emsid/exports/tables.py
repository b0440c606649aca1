"""The static curves of a model as CSV: friction over speed, dead zone, static maps."""

from __future__ import annotations

from typing import Any

import numpy as np

from emsid.errors import ModelError
from emsid.exports.formats import Export, Files

POINTS = 201
"""Points of a curve."""


def csv(export: Export) -> tuple[Files, list[str]]:
    """A file for every static curve.

    Raises:
        ModelError: for a model that has none.
    """
    files: Files = {}
    plant: Any = getattr(export.model, "plant", None)
    for what in ("friction", "dead_zone"):
        curve = getattr(plant, f"{what}_characteristic", lambda: None)()
        if curve is not None:
            reach = 3 * curve.edge if curve.edge > 0 else max(law.reach for law in plant.frictions.values())
            x = np.linspace(-reach, reach, POINTS)
            head = tuple(f"{name} [{unit}]" for name, unit in (curve.x, curve.y))
            files[f"{export.name}_{what}.csv"] = _table(head, x, curve.law(x))
    for k, block in enumerate([*getattr(export.model, "blocks", ()), *getattr(export.model, "maps", ())]):
        if hasattr(block, "marks") and hasattr(block, "value"):
            marks = np.abs(np.append(block.marks()[0], 1.0)).max()
            x = np.linspace(-2 * marks, 2 * marks, POINTS)
            files[f"{export.name}_map{k + 1}.csv"] = _table(("input", "output"), x, block.value(x))
    if not files:
        raise ModelError(f"{export.model.name} has no static curve to write; export it as c99")
    return files, ["Only static curves are written; export the model as c99 to run it."]


def _table(head: tuple[str, ...], x: Any, y: Any) -> str:
    rows = (f"{a!r},{b!r}" for a, b in zip(np.asarray(x).tolist(), np.asarray(y).tolist(), strict=True))
    return "\n".join([",".join(head), *rows]) + "\n"
