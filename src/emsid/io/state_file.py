"""State files: the state of a recursive estimation, as JSON with the regressors it belongs to.

::

    {"format": "emsid state", "schema": 1, "structure": ["-y(t-1)", "u(t-1)"], "state": {…}}

Floats are written with enough digits to be read back bit for bit.
"""

from __future__ import annotations

import os

import msgspec

from emsid.errors import FormatError, ModelError
from emsid.estimation.linear.least_squares import LinearStructure
from emsid.estimation.linear.recursive_state import RecursiveState
from emsid.io.files import atomic_write, read_bytes

FORMAT, SCHEMA = "emsid state", 1


def save_state(state: RecursiveState, structure: LinearStructure[object], path: str | os.PathLike[str]) -> None:
    """Write the state of a recursion to a file, from which `load_state` reads it back bit for bit.

    Args:
        state: the state.
        structure: whose parameters it has.
        path: the file.

    Raises:
        FormatError: where the file cannot be written.
    """
    document = {"format": FORMAT, "schema": SCHEMA, "structure": list(structure.labels), "state": state.to_data()}
    atomic_write(path, msgspec.json.encode(document) + b"\n")


def load_state(path: str | os.PathLike[str], structure: LinearStructure[object]) -> RecursiveState:
    """Read the state of a recursion from a file.

    Args:
        path: the file.
        structure: the structure to go on with.

    Raises:
        FormatError: where the file cannot be read, is no state file, or belongs to another structure.
    """
    content = read_bytes(path, "track again", replaceable=True)  # a tracking that goes on
    try:
        document = msgspec.json.decode(content)
    except (msgspec.MsgspecError, RecursionError, ValueError):
        document = None
    if not isinstance(document, dict) or document.get("format") != FORMAT or document.get("schema") != SCHEMA:
        raise FormatError(f"{path}: this is no state file of this version; name the state.json of a tracking")
    labels = document.get("structure")
    if labels != list(structure.labels):
        raise FormatError(
            f"{path}: the state belongs to other regressors than those of {structure.name}; track with the structure "
            "that it was saved with",
            arguments=("structure",),
        )
    try:
        return RecursiveState.from_data(document["state"])
    except (KeyError, ModelError) as problem:
        raise FormatError(f"{path}: {problem}") from None
