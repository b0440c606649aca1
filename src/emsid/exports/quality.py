"""How a model that is exported fits data that it was not fitted to, for the README."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from emsid.errors import FormatError
from emsid.estimation.fit import Fit
from emsid.io.files import read_bytes
from emsid.record import Record

QUALITY = ("fit_percent", "simulation_rmse", "samples")
"""What the README says of a free run on unseen data."""


def quality(model: Any, unseen: Record | Mapping[str, float] | None) -> str:
    """A sentence on the free run of a model on data that it was not fitted to."""
    if unseen is None:
        return "Fit on unseen data: not known; export with a record that the model was not fitted to."
    if isinstance(unseen, Record):
        from emsid.validation.comparison import assess_model

        row = assess_model(model, unseen).row
        unseen = {name: getattr(row, name) for name in QUALITY}
    percent, rmse, samples = (float(unseen[name]) for name in QUALITY)
    return f"Fit of the free run on unseen data: {percent:.4g} %, RMSE {rmse:.4g}, {samples:.0f} samples."


def unseen_beside(path: Path, loaded: Any) -> dict[str, float] | None:
    """The fit of a model on unseen data, of the result that lies beside its file; None where there is none.

    Args:
        path: the file of the model.
        loaded: its content; a result of another fit of the same model, such as of a later run, says nothing about it.
    """
    beside = path.parent / "result.json"
    if not beside.is_file() or not isinstance(loaded, Fit):
        return None
    try:
        result, name = json.loads(read_bytes(beside)), loaded.model.name
        fit = next(each for each in result["fits"] if each["model"] == name)
        if (fit["samples"], fit["noise_variance"]) != (loaded.samples, loaded.noise_variance):
            return None
        found = next(row for row in result["rows"] if (row["model"], row["data"]) == (name, "unseen"))
        return {each: float(found[each]) for each in QUALITY}
    except (
        FormatError,
        ValueError,
        LookupError,
        TypeError,
        StopIteration,
    ):  # another file of this name, or no such row
        return None
