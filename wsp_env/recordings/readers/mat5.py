"""MATLAB's MAT files of version 5: their numeric vectors, also inside structures.

Read here because scipy's reader can crash the interpreter on a damaged file. Format: "MAT-File Format", The MathWorks.
A file is a header of 128 bytes and tagged elements; an element is a type, a size and that many bytes, padded to eight;
an array is an element made of elements: flags, dimensions, name, then numbers, or for a structure its field names and
its fields.
"""

import struct
import zlib
from collections.abc import Iterator

import numpy as np

_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _COMPRESSED = 14, 15
_STRUCTURE = 2
_COMPLEX = 0x800  # flag
_NUMERIC = range(6, 16)  # classes of arrays: double, single, integers
_DEEPEST = 8  # structures in structures
_LARGEST = 1 << 34  # bytes that a compressed element may grow to: 2 thousand million numbers


def read_mat5(content: bytes) -> dict[str, np.ndarray]:
    """Return the numeric arrays of a MAT file of version 5 by name (`structure.field`).

    Raises
    ------
    ValueError, struct.error, zlib.error
        for a damaged file

    """
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise ValueError("its header is none of version 5")
    arrays: dict[str, np.ndarray] = {}
    for kind, data in _elements(content[128:], order):
        if kind == _COMPRESSED:
            unpacked = zlib.decompressobj().decompress(data, _LARGEST)
            kind, data = next(_elements(unpacked, order), (0, b""))
        if kind == _MATRIX:
            _array(data, order, "", arrays, _DEEPEST)
    return arrays


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Iterate over the elements: type and content."""
    view, at = memoryview(data), 0
    while at + 8 <= len(view):
        kind, size = struct.unpack_from(order + "II", view, at)
        if kind >> 16:  # small element: size and type share four bytes, the content has the other four
            kind, size, start, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        else:
            start = at + 8
            after = start + size + (0 if kind == _COMPRESSED else -size % 8)
        if start + size > len(view):
            raise ValueError("it ends in the middle of an array")
        yield kind, bytes(view[start : start + size])
        at = after


def _array(data: bytes, order: str, parent: str, arrays: dict[str, np.ndarray], depth: int) -> None:
    """Add the array in `data`, or those of the structure in it."""
    parts = _elements(data, order)
    flags = next(parts, (0, b""))[1]
    shape = next(parts, (0, b""))[1]
    name = next(parts, (0, b""))[1].decode("ascii", errors="replace")
    if len(flags) < 8 or len(shape) % 4:
        raise ValueError("an array in it has no header")
    word = struct.unpack_from(order + "I", flags)[0]
    kind = word & 0xFF
    dimensions = np.frombuffer(shape, order + "i4").astype(np.int64)
    path = f"{parent}.{name}" if parent and name else parent or name
    if kind in _NUMERIC:
        type_, numbers = next(parts, (0, b""))
        if type_ not in _NUMBERS:
            raise ValueError(f"the array {path} holds no numbers")
        values = np.frombuffer(numbers, order + _NUMBERS[type_])
        if len(values) != int(np.prod(dimensions)):
            raise ValueError(f"the array {path} has {len(values)} numbers, not {' x '.join(map(str, dimensions))}")
        if not word & _COMPLEX:
            arrays[path] = values.reshape(dimensions, order="F")
    elif kind == _STRUCTURE and int(np.prod(dimensions)) == 1 and depth:
        length = struct.unpack(order + "i", next(parts, (0, b""))[1])[0]
        names = next(parts, (0, b""))[1]
        if length <= 0:
            raise ValueError(f"the structure {path} has no field names")
        for start in range(0, len(names), length):
            field = names[start : start + length].split(b"\0")[0].decode("ascii", errors="replace")
            _, content = next(parts, (0, b""))
            if content:
                _array(content, order, f"{path}.{field}", arrays, depth - 1)
