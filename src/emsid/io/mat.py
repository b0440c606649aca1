"""MAT files: version 5 (and 7, which is the same compressed) by SciPy, version 7.3, which is HDF5, by h5py."""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from typing import Any

import numpy as np

from emsid.errors import FormatError
from emsid.io import mat5
from emsid.io.columns import Columns, from_arrays
from emsid.io.files import looks_like

_HDF5 = b"\x89HDF\r\n\x1a\n"
_HDF5_AT = (0, 512)  # MATLAB puts 512 bytes of its own before the HDF5 part
_ENDIAN_AT = slice(126, 128)


def read_mat(content: bytes) -> Columns:
    """The vectors and matrices of a MAT file; those inside a struct are called ``struct.field``.

    The version is told by the content.

    Raises:
        FormatError: for content that is no MAT file of version 5 to 7.3, or a damaged one.
    """
    if any(content[at : at + len(_HDF5)] == _HDF5 for at in _HDF5_AT):
        variables = _variables_73
    elif content[_ENDIAN_AT] in (b"IM", b"MI"):
        variables = mat5.variables
    else:
        raise FormatError(
            f"this is not a MAT file; it looks like {looks_like(content)}: give it its right suffix, or save it "
            "again with save -v7"
        )
    try:
        return from_arrays(variables(content))
    except Exception as problem:  # the parsers meet damage with whatever they stumble over
        raise FormatError(
            f"this MAT file is damaged or cut off ({type(problem).__name__}); copy or save it again"
        ) from None


def _variables_73(content: bytes) -> Iterator[tuple[str, Any]]:
    import h5py

    with h5py.File(BytesIO(content), "r") as file:
        for name, item in file.items():
            if name.startswith("#"):  # what cells and objects refer to
                continue
            if isinstance(item, h5py.Group):
                for field, inner in item.items():
                    yield f"{name}.{field}", _array(inner)
            else:
                yield name, _array(item)


def _array(item: Any) -> Any:
    """A dataset with MATLAB's order of dimensions, or what it is instead."""
    import h5py

    if not isinstance(item, h5py.Dataset):
        return item
    kind = item.attrs.get("MATLAB_class", b"double")
    if kind == b"char":
        return "text"
    if "MATLAB_empty" in item.attrs:
        return np.empty(0)
    return np.asarray(item[()]).T
