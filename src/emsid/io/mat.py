"""MAT files: version 4 to 7 by SciPy, and version 7.3, which is HDF5, by h5py.

Both are parsed in a process of their own (see `emsid.io.sandbox`), because a damaged file can end the process that
parses it. MATLAB saves objects of its classes in a format that is not documented and that neither library decodes. For
each object that holds signals, a message gives the line of MATLAB that makes a file of its numbers.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from typing import Any

import numpy as np

from emsid.errors import FormatError
from emsid.io.columns import Columns, from_arrays, reason_against
from emsid.io.files import EXPANSION, SMALL, check_expansion, looks_like
from emsid.io.sandbox import in_sandbox

_LINES = {
    "iddata": "u = {0}.u; y = {0}.y; Ts = {0}.Ts; save {0}_arrays.mat u y Ts -v7",
    "idfrd": "",
    "timetable": "writetimetable({0}, '{0}.csv')",
    "table": "writetable({0}, '{0}.csv')",
    "timeseries": "t = {0}.Time; y = {0}.Data; save {0}_arrays.mat t y -v7",
    "dataset": "writetable(dataset2table({0}), '{0}.csv')",
    "Simulink.SimulationOutput": "writetimetable(extractTimetable({0}), '{0}.csv')",
    "Simulink.SimulationData.Dataset": "writetimetable(extractTimetable({0}), '{0}.csv')",
    "Simulink.SimulationData.Signal": "writetimetable(extractTimetable({0}), '{0}.csv')",
    "datetime": "{0} = posixtime({0}); save {0}_arrays.mat {0} -v7",
    "duration": "{0} = seconds({0}); save {0}_arrays.mat {0} -v7",
}
"""By class: the line with the name of the variable in it; empty where the object has no signals."""
_MODELS = ("id", "ss", "tf", "zpk", "pid", "frd", "nlarx", "nlhw")
"""How the names of classes of models begin, which hold no signals."""


def reason_against_object(name: str, kind: str) -> str:
    """Why an object is no column, and the line of MATLAB that makes a file of its numbers.

    >>> reason_against_object("run", "timetable")
    "a MATLAB object of class timetable; write it in MATLAB by: writetimetable(run, 'run.csv')"
    >>> reason_against_object("model", "idnlarx")
    'a MATLAB object of class idnlarx, which holds a model and no signals'

    Args:
        name: of the variable, or of the field that holds it.
        kind: its class; empty where that is not known.
    """
    line = _LINES.get(kind)
    if line == "" or (line is None and kind.startswith(_MODELS)):
        return f"a MATLAB object of class {kind}, which holds a model and no signals"
    variable = name if name.isidentifier() else "x"
    line = line or "x = struct({0}); save {0}_arrays.mat x -v7"
    before = "" if variable == name else f"x = {name}; "
    return f"a MATLAB object of class {kind or 'unknown'}; write it in MATLAB by: {before}{line.format(variable)}"


DEEPEST = 8
"""A struct or cell inside so many others is not read."""
MOST_OF_ARRAY = 100
"""An array of more structs or cells is not read."""

_HDF5 = b"\x89HDF\r\n\x1a\n"
_HDF5_AT = (0, 512)  # MATLAB puts 512 bytes of its own before the HDF5 part
_HEADER, _COMPRESSED = 128, 15
_ENDIAN_AT = slice(126, 128)
_DAMAGED = "this MAT file is damaged or cut off; copy or save it again"


def read_mat(content: bytes) -> Columns:
    """The vectors and matrices of a MAT file.

    The fields of a struct are called ``struct.field``, the cells of a cell array ``cell{1}``, and the fields of an
    array of structs ``struct(1).field``, at any depth up to `DEEPEST`. The signals of a capture of dSPACE (a struct
    with ``X`` and ``Y``) have their own names.

    Raises:
        FormatError: for content that is no MAT file of version 5 to 7.3, or a damaged one.
    """
    is_hdf5 = any(content[at : at + len(_HDF5)] == _HDF5 for at in _HDF5_AT)
    if not is_hdf5 and content[_ENDIAN_AT] not in (b"IM", b"MI"):
        raise FormatError(
            f"this is not a MAT file; it looks like {looks_like(content)}: give it its right suffix, or save it "
            "again with save -v7"
        )
    if not is_hdf5:
        _check_sizes(content)
    parsed = in_sandbox(parsed_73 if is_hdf5 else parsed_5, content, _DAMAGED)
    with np.load(BytesIO(parsed), allow_pickle=False) as archive:
        named = {str(name): archive[f"v{k}"] for k, name in enumerate(archive["names"])}
    return from_arrays(
        (name, str(value) if value.dtype.kind == "U" and value.ndim == 0 else value) for name, value in named.items()
    )


def _check_sizes(content: bytes) -> None:
    """Refuse compressed variables that are absurdly large when they are unpacked, before any is.

    Behind the header of 128 bytes, each has a tag of 8 bytes: the type, 15 where it is compressed, and its length.

    Raises:
        FormatError: that says how large.
    """
    order = "<u4" if content[_ENDIAN_AT] == b"IM" else ">u4"
    at = _HEADER
    while at + 8 <= len(content):
        kind, length = (int(word) for word in np.frombuffer(content, order, 2, at))
        data = memoryview(content)[at + 8 : at + 8 + length]
        if kind == _COMPRESSED:
            unpacking, most = zlib.decompressobj(), max(SMALL, EXPANSION * length)
            with suppress(zlib.error):  # SciPy refuses a damaged one
                check_expansion(length, len(unpacking.decompress(data, most)) + bool(unpacking.unconsumed_tail))
        at += 8 + length


def parsed_5(content: bytes) -> bytes:
    """The variables of a file of version 5 to 7, as `_packed` has them, for the process that parses it."""
    return _packed(_variables_5(content))


def parsed_73(content: bytes) -> bytes:
    """The variables of an HDF5 file, as `_packed` has them, for the process that parses it."""
    return _packed(_variables_73(content))


def _packed(variables: Iterator[tuple[str, Any]]) -> bytes:
    """Variables as an NPZ file; a text says why one is no array."""
    names: list[str] = []
    arrays: dict[str, Any] = {}
    for name, value in variables:
        is_array = isinstance(value, np.ndarray) and value.dtype.kind in "biufcUS"
        arrays[f"v{len(names)}"] = value if is_array else np.array(reason_against(value))
        names.append(name)
    result = BytesIO()
    np.savez(result, names=np.array(names, dtype=str), **arrays)
    return result.getvalue()


def _variables_5(content: bytes) -> Iterator[tuple[str, Any]]:
    from scipy.io.matlab import loadmat, varmats_from_mat

    for name, part in varmats_from_mat(BytesIO(content)):  # one by one, since every object is called None
        for value in [value for key, value in loadmat(part).items() if not key.startswith("__")]:
            yield from _inside(str(name), value, 0)


def _inside(name: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """The arrays in a variable as SciPy loads it; a text says why one is no array."""
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    if isinstance(value, MatlabOpaque):
        variable, kind = (value[field][0] for field in ("s0", "s2"))
        name = variable.decode("latin-1") if depth == 0 and variable else name
        yield name, reason_against_object(name, kind.decode("latin-1"))
    elif isinstance(value, MatlabObject):
        yield name, reason_against_object(name, value.classname)
    elif isinstance(value, MatlabFunction):
        yield name, "a function"
    elif not isinstance(value, np.ndarray):
        yield name, "a sparse matrix"
    elif not (value.dtype.names or value.dtype.kind == "O"):
        yield name, "text" if value.dtype.kind == "U" else value
    elif depth == DEEPEST or value.size > MOST_OF_ARRAY:
        kind = "structs" if value.dtype.names else "cells"
        yield name, f"an array of {value.size} {kind}" if depth < DEEPEST else f"{kind} inside many others"
    elif value.dtype.names and (signals := _captured(name, value)):
        yield from signals
    elif value.dtype.names:
        for k, item in enumerate(value.ravel(order="F"), start=1):
            owner = name if value.size == 1 else f"{name}({k})"
            for field in value.dtype.names:
                yield from _inside(f"{owner}.{field}", item[field], depth + 1)
    else:
        for k, item in enumerate(value.ravel(order="F"), start=1):
            yield from _inside(f"{name}{{{k}}}", item, depth + 1)


def _parts_of_capture(part: Any) -> list[Any]:
    """The structs with a name and data in a field of a capture, which is an array or a cell array of them."""
    found = list(part.ravel(order="F")) if isinstance(part, np.ndarray) and part.size <= MOST_OF_ARRAY else []
    found = [each.ravel()[0] if isinstance(each, np.ndarray) and each.size == 1 else each for each in found]
    return found if all({"Name", "Data"} <= set(getattr(each.dtype, "names", None) or ()) for each in found) else []


def _captured(owner: str, value: Any) -> list[tuple[str, Any]]:
    """The signals of a capture of dSPACE, a struct whose fields ``X`` and ``Y`` are structs with names and data.

    They have their names without the parts of a path that all have. Empty for another struct.

    Args:
        owner: the name of the variable, for signals without a name of their own.
        value: the struct.
    """
    if value.size != 1 or not {"X", "Y"} <= set(value.dtype.names):
        return []
    axes, signals = (_parts_of_capture(value.ravel()[0][field]) for field in "XY")
    if not axes or not signals:
        return []

    def named(each: Any) -> str:
        return str(each["Name"].ravel()[0]) if each["Name"].size else ""

    paths = [named(each).replace('"', "").split("/") for each in signals]
    for end in (0, -1):
        while min(map(len, paths)) > 1 and len(paths) > 1 and len({path[end] for path in paths}) == 1:
            paths = [path[1:] if end == 0 else path[:-1] for path in paths]
    names = ["/".join(path) or f"{owner}.Y({k})" for k, path in enumerate(paths, start=1)]
    times = [named(each) or ("time" if k == 0 else f"time_{k + 1}") for k, each in enumerate(axes)]
    pairs = zip((*times, *names), (*axes, *signals), strict=True)
    return [(name if names.count(name) < 2 else f"{owner}.{name}", each["Data"]) for name, each in pairs]


def _variables_73(content: bytes) -> Iterator[tuple[str, Any]]:
    import h5py

    with h5py.File(BytesIO(content), "r") as file:

        def inside(item: Any, name: str, depth: int) -> Iterator[tuple[str, Any]]:
            kind = item.attrs.get("MATLAB_class", b"").decode("latin-1")
            if "MATLAB_object_decode" in item.attrs:
                yield name, reason_against_object(name, kind)
            elif isinstance(item, h5py.Group):
                for field, part in item.items():
                    if not field.startswith("#"):  # the targets of references in cells and objects
                        yield from parts(part, f"{name}.{field}".lstrip("."), depth + 1)
            elif h5py.check_dtype(ref=item.dtype) is not None and depth and "MATLAB_empty" not in item.attrs:
                targets = item[()].ravel()[:MOST_OF_ARRAY]  # HDF5 has the order of MATLAB's columns
                shape = "{{{}}}" if kind == "cell" else "({})"
                for k, reference in enumerate(targets, start=1):
                    yield from parts(file[reference], name + shape.format(k), depth + 1)
            else:
                yield name, _array(item)

        def parts(item: Any, name: str, depth: int) -> Iterator[tuple[str, Any]]:
            if depth > DEEPEST:
                yield name, "structs or cells inside many others"
            else:
                yield from inside(item, name, depth)

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
