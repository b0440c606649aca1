"""Model files: JSON that says what it is, in which version, and whether anybody has changed it.

::

    {"format": "emsid model", "schema": 1, "type": "narx", "model": {…}, "sha256": "…"}

The checksum is that of the other entries with their keys sorted and no blanks, so that a file may be laid out anew but
not altered. Floats are written with as many digits as bring them back exactly.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

import msgspec

from emsid.errors import EmsidError, FormatError, ModelError
from emsid.io.files import atomic_write, read_bytes

if TYPE_CHECKING:
    from emsid.models.model import Model

FORMAT = "emsid model"
SCHEMA = 1


class _Head(msgspec.Struct):
    """The two entries that every version has."""

    format: str
    schema: int


class _Document(msgspec.Struct, forbid_unknown_fields=True):
    format: str
    schema: int
    type: str
    model: dict[str, Any]
    sha256: str


def save(model: Model, path: str | os.PathLike[str]) -> None:
    """Write a model to a file, from which `load` brings it back exactly.

    Raises:
        ModelError: for a model whose type has no name in `emsid.models.MODELS`, or with a number that is not finite.
        FormatError: where the file cannot be written.
    """
    from emsid.models import MODELS

    name = next((name for name, kind in MODELS.items() if kind is type(model)), None)
    if name is None:
        raise ModelError(f"a {type(model).__name__} cannot be saved; models are {', '.join(MODELS)}")
    data = model.to_data()
    _check_finite(data, "model")
    document = _Document(FORMAT, SCHEMA, name, data, _checksum(name, data))
    atomic_write(path, msgspec.json.format(msgspec.json.encode(document), indent=2) + b"\n")


def load(path: str | os.PathLike[str]) -> Model:
    """Read a model from a file.

    Raises:
        FormatError: where the file cannot be read, is no model file, is of another version, has been altered, or
            describes no possible model.
    """
    from emsid.models import MODELS

    content = read_bytes(path)
    try:
        text = content.decode()
        head = msgspec.json.decode(text, type=_Head)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as problem:
        raise FormatError(
            f"{path}: this is not a model file, or is cut off ({problem}); save the model again"
        ) from None
    if head.format != FORMAT:
        raise FormatError(f"{path}: this is a {head.format!r} file, not an {FORMAT!r}; name a file that emsid saved")
    if head.schema != SCHEMA:
        raise FormatError(
            f"{path}: the model is written in schema {head.schema} and this version of emsid reads {SCHEMA}; use the "
            "version that wrote it, or identify it again"
        )
    try:
        document = msgspec.json.decode(text, type=_Document)
    except msgspec.MsgspecError as problem:
        raise FormatError(f"{path}: the model file is not complete ({problem}); save the model again") from None
    if document.sha256 != _checksum(document.type, document.model):
        raise FormatError(
            f"{path}: the model has been altered since it was saved (its checksum differs); restore the file, or "
            "identify the model again"
        )
    if document.type not in MODELS:
        raise FormatError(f"{path}: unknown type of model {document.type!r}; there are {', '.join(MODELS)}")
    try:
        return MODELS[document.type].from_data(document.model)
    except EmsidError as problem:
        raise FormatError(f"{path}: {problem}") from None


def _checksum(name: str, data: Mapping[str, Any]) -> str:
    content = {"format": FORMAT, "schema": SCHEMA, "type": name, "model": data}
    return hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()


def _check_finite(value: object, where: str) -> None:
    """Refuse numbers that JSON has no spelling for; ``where`` names the value in the message."""
    if isinstance(value, float) and not isfinite(value):
        raise ModelError(f"{where} is {value}; only a model with finite numbers can be saved")
    if isinstance(value, Mapping):
        for key, inner in value.items():
            _check_finite(inner, f"{where}.{key}")
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for k, inner in enumerate(value):
            _check_finite(inner, f"{where}[{k}]")
