"""MATLAB files of version 5 to 7: numbers, text, cells and structures.

scipy reads these files too, but a damaged one can end the process.

Format: MathWorks, "MAT-File Format", 2024.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, Final, Literal

import numpy as np

_NUMBERS: Final = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip
_TEXTS: Final = {16: "utf-8", 17: "utf-16", 18: "utf-32"}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCTURE, _TEXT, _NUMERIC = 1, 2, 4, range(6, 16)
_COMPLEX: Final = 0x800
_HEADER: Final = 128
_BYTE_ORDER: Final[Mapping[str, Literal["little", "big"]]] = {"<": "little", ">": "big"}
_DEEPEST: Final = 50


class UnreadArrayError(ValueError):
    """The file contains an array of a class that only MATLAB can read, such as an object."""


def read(content: bytes, most: int) -> Mapping[str, Any]:
    """The variables of a file by name.

    Arrays lose dimensions of length 1; one structure is a dict, several are a list of them; cells are lists.

    Parameters
    ----------
    content
        The file.
    most
        Largest total size of the data of compressed variables [bytes].

    Raises
    ------
    UnreadArrayError
        The file contains objects, functions, or sparse or complex arrays.
    ValueError
        The file is damaged, or larger than ``most`` when unpacked.
    """
    order = "<" if content[126:128] == b"IM" else ">"
    variables = {}
    for kind, data in _elements(content[_HEADER:], order):
        if kind == _COMPRESSED:
            unpacked = zlib.decompressobj().decompress(data, most + 1)
            most -= len(unpacked)
            if most < 0:
                raise ValueError("the file is too large when unpacked; save the calibration alone")
            kind, data = next(_elements(unpacked, order))
        if kind == _MATRIX:
            name, value = _array(data, order, 0)
            if not name:
                raise UnreadArrayError("a variable without a name")
            variables[name] = value
    if not variables:
        raise ValueError("the file contains no variable")
    return variables


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Type and bytes of each element; small ones hold their data in the four bytes behind a shorter tag."""
    position, byte_order = 0, _BYTE_ORDER[order]
    while position + 8 <= len(data):
        kind, size = (int.from_bytes(data[position + step : position + step + 4], byte_order) for step in (0, 4))
        start = position + 8
        if kind >> 16:
            kind, size, start = kind & 0xFFFF, kind >> 16, position + 4
        if size > len(data) - start or (start == position + 4 and size > 4):
            raise ValueError("an element is longer than the rest of the file")
        yield kind, data[start : start + size]
        # Elements fill multiples of 8 bytes, but for compressed ones; small ones take 8 with their tag.
        padded = position + 8 if start == position + 4 else start + -(-size // 8) * 8
        position = start + size if kind == _COMPRESSED else padded


def _array(data: bytes, order: str, depth: int) -> tuple[str, Any]:
    """Name and value of an array."""
    if not data:
        return "", np.zeros(0)  # as MATLAB writes an empty member
    if depth > _DEEPEST:
        raise ValueError(f"arrays are nested more than {_DEEPEST} levels deep")
    parts = _elements(data, order)
    flags = int(_numbers(*next(parts), order)[0])
    kind_of_array = flags & 0xFF
    if kind_of_array not in (_CELL, _STRUCTURE, _TEXT, *_NUMERIC) or flags & _COMPLEX:
        raise UnreadArrayError("an object, a function, or a sparse or complex array")
    shape = tuple(int(length) for length in _numbers(*next(parts), order))
    count = math.prod(shape)
    if not shape or min(shape) < 0 or count > len(data):
        raise ValueError("an array has a wrong size")
    name = next(parts)[1].decode("latin-1")

    def inner() -> Any:
        element = next(parts, None)
        if element is None or element[0] != _MATRIX:
            raise ValueError("a member of a structure or a cell is missing")
        return _array(element[1], order, depth + 1)[1]

    if kind_of_array == _STRUCTURE:
        length, names = int(_numbers(*next(parts), order)[0]), next(parts)[1]
        if length < 1:
            raise ValueError("names of members have no length")
        keys = [names[i : i + length].split(b"\0")[0].decode("latin-1") for i in range(0, len(names), length)]
        every = [{key: inner() for key in keys} for _ in range(count)]
        return name, every[0] if count == 1 else every
    if kind_of_array == _CELL:
        return name, [inner() for _ in range(count)]
    kind, content = next(parts, (0, b""))
    if kind_of_array == _TEXT:
        order_name = "le" if order == "<" else "be"
        encoding = _TEXTS.get(kind, "utf-16" if kind == 4 else "latin-1")
        return name, content.decode(encoding if encoding in ("utf-8", "latin-1") else f"{encoding}-{order_name}")
    values = _numbers(kind, content, order)
    if values.size != count:
        raise ValueError("an array has a wrong number of values")
    values = np.squeeze(values.reshape(shape, order="F"))
    return name, values.item() if values.ndim == 0 else values


def _numbers(kind: int, data: bytes, order: str) -> np.ndarray[Any, Any]:
    if kind not in _NUMBERS:
        raise ValueError(f"numbers of type {kind} are unknown")
    return np.frombuffer(data, dtype=order + _NUMBERS[kind])
