"""NPZ files, NumPy's archive of named arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from typing import Any

from emsid.errors import FormatError
from emsid.io.columns import UNITS, Columns, from_arrays, units_from_json
from emsid.io.files import looks_like

_MAGIC = b"PK\x03\x04"


def read_npz(content: bytes) -> Columns:
    """The arrays of an NPZ file as columns. Pickled objects are never loaded.

    Raises:
        FormatError: for content that is no NPZ file, or a damaged one.
    """
    import numpy as np

    if not content.startswith(_MAGIC):
        raise FormatError(f"this is not an NPZ file; it looks like {looks_like(content)}: give it its right suffix")
    try:
        arrays = dict(_arrays(content))
        units = arrays.get(UNITS)
        if not (isinstance(units, np.ndarray) and units.dtype.kind == "U" and units.size == 1):
            return from_arrays(arrays.items())
        columns = from_arrays((name, values) for name, values in arrays.items() if name != UNITS)
        return replace(columns, units=units_from_json(str(units.item())))
    except Exception as problem:  # a parser may raise any exception for a damaged file
        raise FormatError(
            f"this NPZ file is damaged, cut off or another kind of ZIP archive ({type(problem).__name__}); "
            "write it again with numpy.savez"
        ) from None


def _arrays(content: bytes) -> Iterator[tuple[str, Any]]:
    import numpy as np

    with np.load(BytesIO(content), allow_pickle=False) as archive:
        for name in archive.files:
            try:
                yield name, archive[name]
            except ValueError:
                yield name, "Python objects or damaged"
