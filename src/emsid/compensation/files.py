"""The files of a compensation: the C of the model, the C of its inverse beside it, and a README."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from emsid.compensation.c_source import sources
from emsid.compensation.inverse import Compensation, inductance_of
from emsid.compensation.map_inverse import MapInverse
from emsid.errors import FormatError
from emsid.estimation.fit import Fit
from emsid.exports.assumptions import sentences
from emsid.exports.verb import c_name, export
from emsid.io.files import atomic_write, together, write_several
from emsid.models.verbs import as_model

README = "COMPENSATION.md"


def write(
    model: Any,
    found: Compensation | MapInverse,
    path: str | os.PathLike[str],
    *,
    name: str | None = None,
    dt: float | None = None,
    single: bool = False,
    force: bool = False,
    more: dict[str, bytes] | None = None,
) -> list[Path]:
    """Write the model and its compensation as C.

    Args:
        model: the model or fit.
        found: its inverse.
        path: folder.
        name: of files and functions; by default that of the model.
        dt: sample time in s.
        single: single precision.
        force: whether files that exist are replaced.
        more: further files.

    Returns:
        The files that were written.

    Raises:
        ModelError: for a model without a form in C.
        FormatError: where files exist or cannot be written.
    """
    called = c_name(name or as_model(model).name)
    texts, notes = sources(found, called, single=single)
    neglected = inductance_of(as_model(model))
    if neglected > 0:
        notes = [*notes, f"The inverse neglects the inductance of {neglected:.3g} H; the C of the model has it."]
    notes = [*notes, *sentences(model if isinstance(model, Fit) else None)]
    lines = [f"# {called}: compensation", "", *[f"- {note}" for note in notes], ""]
    files: dict[str, str | bytes] = {**texts, README: "\n".join(lines), **(more or {})}
    folder = Path(path)
    there = [file for file in files if (folder / file).exists()]
    if there and not force:
        raise FormatError(f"{folder / there[0]} exists; name another folder, or replace it", arguments=("force",))
    paths = [folder / file for file in files]
    with together():
        written = export(model, "c99", folder, name=called, dt=dt, force=force, single=single)
        write_several(atomic_write, paths, files.values())
    return [*written, *paths]
