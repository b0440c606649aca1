"""MAT files: version 5 (and 7, which is the same compressed) by `mat5`, version 7.3, which is HDF5, by h5py.

HDF5 is parsed in a process of its own; see `emsid.io.sandbox`.
"""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from typing import Any

import numpy as np

from emsid.errors import FormatError
from emsid.io import mat5
from emsid.io.columns import Columns, from_arrays, reason_against
from emsid.io.files import looks_like
from emsid.io.sandbox import in_sandbox

_HDF5 = b"\x89HDF\r\n\x1a\n"
_HDF5_AT = (0, 512)  # MATLAB puts 512 bytes of its own before the HDF5 part
_ENDIAN_AT = slice(126, 128)


def read_mat(content: bytes) -> Columns:
    """The vectors and matrices of a MAT file; those inside a struct are called ``struct.field``, at any depth
    up to `mat5.DEEPEST`.

    The version is recognised from the content.

    Raises:
        FormatError: for content that is no MAT file of version 5 to 7.3, or a damaged one.
    """
    if any(content[at : at + len(_HDF5)] == _HDF5 for at in _HDF5_AT):
        variables = _from_sandbox
    elif content[_ENDIAN_AT] in (b"IM", b"MI"):
        variables = mat5.variables
    else:
        raise FormatError(
            f"this is not a MAT file; it looks like {looks_like(content)}: give it its right suffix, or save it "
            "again with save -v7"
        )
    try:
        return from_arrays(variables(content))
    except FormatError:
        raise
    except Exception as problem:  # a parser may raise any exception for a damaged file
        raise FormatError(
            f"this MAT file is damaged or cut off ({type(problem).__name__}); copy or save it again"
        ) from None


def _from_sandbox(content: bytes) -> Iterator[tuple[str, Any]]:
    """The variables of a file of version 7.3."""
    damaged = "this MAT file is damaged or cut off; copy or save it again"
    with np.load(BytesIO(in_sandbox(parsed_73, content, damaged)), allow_pickle=False) as archive:
        for k, name in enumerate(archive["names"]):
            value = archive[f"v{k}"]
            yield str(name), str(value) if value.dtype.kind == "U" and value.ndim == 0 else value


def parsed_73(content: bytes) -> bytes:
    """The variables of an HDF5 file as an NPZ file, for the process that parses it; a text says why one is no array."""
    names: list[str] = []
    arrays: dict[str, Any] = {}
    for name, value in _variables_73(content):
        reason = "" if isinstance(value, np.ndarray) and value.dtype.kind in "biufcUS" else reason_against(value)
        arrays[f"v{len(names)}"] = np.array(reason) if reason else value
        names.append(name)
    result = BytesIO()
    np.savez(result, names=np.array(names, dtype=str), **arrays)
    return result.getvalue()


def _variables_73(content: bytes) -> Iterator[tuple[str, Any]]:
    import h5py

    def inside(group: Any, prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
        for name, item in group.items():
            if name.startswith("#"):  # the targets of references in cells and objects
                continue
            if isinstance(item, h5py.Group) and depth < mat5.DEEPEST:
                yield from inside(item, f"{prefix}{name}.", depth + 1)
            else:
                yield f"{prefix}{name}", _array(item)

    with h5py.File(BytesIO(content), "r") as file:
        yield from inside(file, "", 0)


def _array(item: Any) -> Any:
    """A dataset with MATLAB's order of dimensions, or a text that says why it is no array."""
    import h5py

    if not isinstance(item, h5py.Dataset):
        return item
    kind = item.attrs.get("MATLAB_class", b"double")
    if kind == b"char":
        return "text"
    if "MATLAB_empty" in item.attrs:
        return np.empty(0)
    return np.asarray(item[()]).T
