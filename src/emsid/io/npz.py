"""NPZ files, NumPy's archive of named arrays.

Sizes are read first: an archive of a few kilobytes may unpack to gigabytes. Then one array after the other becomes
columns, so that no array is in memory twice.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from math import prod
from typing import Any
from zipfile import ZipFile

from emsid.errors import FormatError
from emsid.io.columns import UNITS, Columns, from_arrays, units_from_json
from emsid.io.files import check_expansion, looks_like

_MAGIC = b"PK\x03\x04"


def read_npz(content: bytes) -> Columns:
    """The arrays of an NPZ file as columns. Pickled objects are never loaded.

    Raises:
        FormatError: for content that is no NPZ file, or a damaged one.
    """
    if not content.startswith(_MAGIC):
        raise FormatError(f"this is not an NPZ file; it looks like {looks_like(content)}: give it its right suffix")
    try:
        _check_sizes(content)
        texts: list[str] = []
        columns = from_arrays(_but_units(_arrays(content), texts))
        return replace(columns, units=units_from_json(texts[0])) if texts else columns
    except FormatError:
        raise
    except Exception as problem:  # a parser may raise any exception for a damaged file
        raise FormatError(
            f"this NPZ file is damaged, cut off or another kind of ZIP archive ({type(problem).__name__}); "
            "write it again with numpy.savez"
        ) from None


def _check_sizes(content: bytes) -> None:
    """Refuse an archive that is absurdly large when it is unpacked, and an array that is larger than its data.

    Raises:
        FormatError: that says how large.
    """
    from numpy.lib import format

    npy: Any = format
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    with ZipFile(BytesIO(content)) as archive:
        check_expansion(len(content), sum(each.file_size for each in archive.infolist()))
        for each in archive.infolist():
            with archive.open(each) as member, suppress(ValueError):  # no array of this format
                shape, _, dtype = readers.get(npy.read_magic(member), npy.read_array_header_1_0)(member)
                size = prod(shape) * dtype.itemsize
                if size > each.file_size:
                    raise FormatError(
                        f"the array {each.filename.removesuffix('.npy')!r} is said to have {size:,} bytes and has "
                        f"{each.file_size:,} at most; the file is damaged: write it again with numpy.savez"
                    )


def _but_units(arrays: Iterable[tuple[str, Any]], texts: list[str]) -> Iterator[tuple[str, Any]]:
    """The arrays without a text with units, which goes into a list."""
    import numpy as np

    for name, values in arrays:
        if name == UNITS and isinstance(values, np.ndarray) and values.dtype.kind == "U" and values.size == 1:
            texts.append(str(values.item()))
        else:
            yield name, values


def _arrays(content: bytes) -> Iterator[tuple[str, Any]]:
    import numpy as np

    with np.load(BytesIO(content), allow_pickle=False) as archive:
        for name in archive.files:
            try:
                yield name, archive[name]
            except ValueError:
                yield name, "Python objects or damaged"
