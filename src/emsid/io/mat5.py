"""MAT files of version 5 (MATLAB 5 to 7), as far as a record needs them: real arrays, also inside a struct.

The layout is that of MathWorks' *MAT-File Format*. Behind a header of 128 bytes stand data elements, each a tag (type
and number of bytes; both in 4 bytes where the data fit into 4 more) and its data, filled up to 8 bytes. A variable is
an element of type 14 made of further ones: flags with the class, dimensions, name, values. Since version 7 it is
wrapped in one of type 15, compressed. A struct has, in place of values, the length and text of its field names and then
a nameless variable for each.

It is read here, and not by SciPy, because `scipy.io.loadmat` can take the whole process down on a damaged file. Here
every length is checked against what is there.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from math import prod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.io.files import EXPANSION, SMALL, check_expansion

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_STRUCT = 2
_REAL = range(6, 16)  # classes double, single and the integers
_COMPLEX = 0x0800
DEEPEST = 8
"""A struct inside so many others is not read."""
_MOST_OF_ARRAY = 100
"""An array of more structs is not read."""
_OTHER = {1: "a cell array", 3: "an object", 4: "text", 5: "a sparse matrix", 16: "a function", 17: "an object"}


class Damaged(Exception):
    """The bytes do not follow the format."""


def _unpacked(data: memoryview) -> bytes:
    """A compressed element; its size is checked before it is in memory."""
    unpacking = zlib.decompressobj()
    whole = unpacking.decompress(data, max(SMALL, EXPANSION * len(data)))
    check_expansion(len(data), len(whole) + bool(unpacking.unconsumed_tail))
    if not (unpacking.eof or unpacking.unconsumed_tail):
        raise zlib.error("cut off")
    return whole


class _Element(NamedTuple):
    kind: int
    data: memoryview


def variables(content: bytes) -> Iterator[tuple[str, NDArray[np.generic] | str]]:
    """Every variable of a file: its name and its array, or a text that says why it is no array.

    The fields of a struct are called ``struct.field``, those of an array of structs ``struct(1).field``.

    Raises:
        Damaged: where the bytes do not follow the format.
    """
    order = "<" if content[126:128] == b"IM" else ">"
    for element in _elements(memoryview(content)[_HEADER:], order):
        if element.kind == _COMPRESSED:
            try:
                whole = _unpacked(element.data)
            except zlib.error as problem:
                raise Damaged(str(problem)) from None
            element = next(_elements(memoryview(whole), order), _Element(0, memoryview(b"")))
        if element.kind != _MATRIX:
            raise Damaged(f"an element of type {element.kind} in place of a variable")
        yield from _variable(element.data, order)


def _elements(data: memoryview, order: str) -> Iterator[_Element]:
    """The elements that follow each other in ``data``."""
    at = 0
    while at < len(data):
        if at + 8 > len(data):
            raise Damaged("it ends inside a tag")
        first, second = (int(word) for word in np.frombuffer(data[at : at + 8], order + "u4"))
        small = first >> 16
        kind, length, begin = (first & 0xFFFF, small, at + 4) if small else (first, second, at + 8)
        if begin + length > len(data) or (small and length > 4):
            raise Damaged("it ends inside an element")
        yield _Element(kind, data[begin : begin + length])
        # compressed elements alone are not filled up to 8 bytes
        at = at + 8 if small else begin + length + (0 if kind == _COMPRESSED else -length % 8)


def _variable(
    data: memoryview, order: str, prefix: str = "", depth: int = 0
) -> Iterator[tuple[str, NDArray[np.generic] | str]]:
    """The variable in the data of one element; ``prefix`` is its name where it is a field of a struct."""
    parts = _elements(data, order)
    flags = _numbers(parts, order)
    if len(flags) < 1:
        raise Damaged("a variable without flags")
    kind, is_complex = int(flags[0]) & 0xFF, bool(int(flags[0]) & _COMPLEX)
    if kind == 17:  # it has no dimensions
        yield _text(parts, order), _OTHER[kind]
        return
    shape = tuple(int(n) for n in _numbers(parts, order))
    name = prefix or _text(parts, order)
    if prefix:
        _text(parts, order)
    if kind in _OTHER:
        yield name, _OTHER[kind]
    elif kind == _STRUCT:
        yield from _struct(parts, order, name, shape, depth)
    elif kind not in _REAL:
        raise Damaged(f"a variable of class {kind}")
    elif is_complex:
        yield name, "complex numbers"
    else:
        values = _numbers(parts, order)
        if min(shape, default=0) < 0 or prod(shape) != len(values):
            raise Damaged(f"{len(values)} values for an array of shape {shape}")
        yield name, values.reshape(shape, order="F")


def _struct(
    parts: Iterator[_Element], order: str, name: str, shape: tuple[int, ...], depth: int
) -> Iterator[tuple[str, NDArray[np.generic] | str]]:
    """The fields of a struct, or of every struct of an array, which follow each other."""
    if depth >= DEEPEST or not 0 < prod(shape) <= _MOST_OF_ARRAY:
        yield name, f"an array of {prod(shape)} structs" if depth < DEEPEST else "a struct inside many others"
        return
    width = _numbers(parts, order)
    labels = _text(parts, order)
    if len(width) != 1 or width[0] < 1:
        raise Damaged("a struct without the length of its field names")
    step = int(width[0])
    fields = [labels[k : k + step].partition("\0")[0] for k in range(0, len(labels), step)]
    owners = [name] if prod(shape) == 1 else [f"{name}({k + 1})" for k in range(prod(shape))]
    for full in (f"{owner}.{field}" for owner in owners for field in fields):
        value = next(parts, None)
        if value is None or value.kind != _MATRIX:
            raise Damaged(f"no value for the field {full!r}")
        if len(value.data):
            yield from _variable(value.data, order, full, depth + 1)
        else:
            yield full, "empty"


def _numbers(parts: Iterator[_Element], order: str) -> NDArray[np.generic]:
    """The next element as numbers; the type it is stored in may be smaller than the class of the variable."""
    element = next(parts, None)
    if element is None or element.kind not in _NUMBERS:
        raise Damaged("numbers are missing")
    kind = np.dtype(order + _NUMBERS[element.kind])
    if len(element.data) % kind.itemsize:
        raise Damaged("half a number")
    return np.frombuffer(element.data, kind)


def _text(parts: Iterator[_Element], order: str) -> str:
    return _numbers(parts, order).tobytes().decode("latin-1")
