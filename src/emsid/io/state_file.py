"""State files: the state of a recursive estimation, as JSON with the structure it belongs to.

::

    {"format": "emsid state", "schema": 2, "structure": ["-y(t-1)", "u(t-1)"], "name": "arx",
     "parameters": ["a1", "b0"], "inputs": 1, "state": {…}, "sha256": "…"}

Floats are written with enough digits to be read back bit for bit. Schema 1, which has no name, parameters,
inputs and sum, is read too.
"""

from __future__ import annotations

import hashlib
import os
from typing import Any

import msgspec

from emsid.errors import EmsidError, FormatError
from emsid.estimation.linear.recursive import RecursiveState
from emsid.io.files import atomic_write, read_bytes
from emsid.io.limits import check_limits
from emsid.models.regression.narx import Structure
from emsid.models.regression.regressors import parse_regressor

FORMAT, SCHEMA = "emsid state", 2


class _Document(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    format: str
    schema: int
    structure: list[str]
    state: dict[str, Any]
    name: str = ""
    parameters: list[str] = []
    inputs: int = 0
    sha256: str = ""


def save_state(state: RecursiveState, structure: Structure, path: str | os.PathLike[str]) -> None:
    """Write the state of a recursion to a file, from which `load_state` reads it back bit for bit.

    Args:
        state: the state.
        structure: whose parameters it has.
        path: the file.

    Raises:
        FormatError: where the file cannot be written.
    """
    names, inputs = list(structure.parameter_names), structure.inputs
    document = _Document(FORMAT, SCHEMA, list(structure.labels), state.to_data(), structure.name, names, inputs)
    document.sha256 = _checksum(document)
    atomic_write(path, msgspec.json.encode(document) + b"\n")


def load_state(path: str | os.PathLike[str], structure: Structure) -> RecursiveState:
    """Read the state of a recursion from a file.

    Args:
        path: the file.
        structure: the structure to go on with.

    Raises:
        FormatError: where the file cannot be read, is no state file, has been altered, belongs to another structure, or
            holds what no recursion can have written.
    """
    document = _read(path)
    if document.structure != list(structure.labels):
        raise FormatError(
            f"{path}: the state belongs to other regressors than those of {structure.name}; track with the structure "
            "that it was saved with, which is the one without a structure given",
            arguments=("structure",),
        )
    try:
        state = RecursiveState.from_data(document.state)
    except EmsidError as problem:
        raise FormatError(f"{path}: {problem}") from None
    if len(state.estimate) != len(structure.labels):
        raise FormatError(f"{path}: not a state of {len(structure.labels)} parameters; save it again")
    return state


def load_structure(path: str | os.PathLike[str]) -> Structure:
    """Read the structure that the state in a file belongs to.

    Raises:
        FormatError: as `load_state` does.
    """
    document = _read(path)
    try:
        regressors = tuple(parse_regressor(text) for text in document.structure)
        return Structure(regressors, document.name or "tracked", tuple(document.parameters), document.inputs)
    except EmsidError as problem:
        raise FormatError(f"{path}: {problem}") from None


def _read(path: str | os.PathLike[str]) -> _Document:
    content = read_bytes(path, "track again", replaceable=True)  # a tracking that goes on
    try:
        document = msgspec.json.decode(content, type=_Document)
        check_limits([document.structure, document.name, document.parameters], "the state file")
    except EmsidError as problem:
        raise FormatError(f"{path}: {problem}") from None
    except (msgspec.MsgspecError, RecursionError, ValueError):
        document = None
    if document is None or document.format != FORMAT or document.schema not in (1, SCHEMA):
        raise FormatError(f"{path}: this is no state file of this version; name the state.json of a tracking")
    if document.schema == SCHEMA and document.sha256 != _checksum(document):
        raise FormatError(f"{path}: the state has been altered since it was written; track again")
    return document


def _checksum(document: _Document) -> str:
    content = {name: value for name, value in msgspec.to_builtins(document).items() if name != "sha256"}
    return hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()
