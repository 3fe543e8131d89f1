"""What scipy takes for granted of a MAT-file of version 5, where a file that lies would end the whole process.

Types, sizes and nesting of elements are looked at first; of a plain array its numbers are not, so that only what is
wanted of a large file is read.
"""

import dataclasses
import math
import pathlib
import struct
import zlib
from typing import BinaryIO

HEADER = 128
SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
"""Bytes of a number of each type of data."""
TEXTS = (16, 17, 18)
INT8, INT32, UINT32, MATRIX, COMPRESSED = 1, 5, 6, 14, 15
CELL, STRUCT, OBJECT, CHARACTERS, SPARSE, FUNCTION = 1, 2, 3, 4, 5, 16
NUMBERS = range(6, 16)
COMPLEX = 1 << 11
START = 1 << 12
"""So many bytes of a plain array say what it is; names are shorter."""


def sound_variables(path: pathlib.Path) -> list[slice]:
    """Where the variables of a file stand in it.

    **Raises:** `ValueError` or `zlib.error` for a file that scipy must not be given.
    """
    found = []
    with path.open("rb") as file:
        order = "<" if file.read(HEADER)[126:] == b"IM" else ">"
        end = file.seek(0, 2)
        at = HEADER
        while at < end:
            file.seek(at)
            kind, size = struct.unpack(f"{order}II", _exactly(file.read(8), 8))
            if kind not in (MATRIX, COMPRESSED) or size > end - at - 8:
                raise ValueError(f"a variable of type {kind} with {size} bytes")
            _variable(file, order, kind, size)
            found.append(slice(at, at + 8 + size))
            at += 8 + size
    return found


def _variable(file: BinaryIO, order: str, kind: int, size: int) -> None:
    start = file.read(min(size, START))
    if kind == MATRIX:
        if not _is_plain(_Elements(start, order)):
            start += file.read(size - len(start))
        _matrix(_Elements(start, order, size))
        return
    inner = zlib.decompressobj().decompress(start, START)
    head, whole = struct.unpack(f"{order}II", _exactly(inner[:8], 8))
    if head != MATRIX:
        raise ValueError(f"a compressed variable of type {head}")
    if not _is_plain(_Elements(inner[8:], order)):
        inner = zlib.decompress(start + file.read(size - len(start)))
    _matrix(_Elements(inner[8 : 8 + whole], order, whole))


@dataclasses.dataclass
class _Elements:
    """Elements one after the other; `size` is their bytes, of which only the first may be at hand."""

    content: bytes
    order: str
    size: int = 0
    at: int = 0

    def __post_init__(self) -> None:
        self.size = self.size or len(self.content)

    def next(self) -> tuple[int, int, int]:
        """Type, size and place of the next one."""
        word, size = struct.unpack(f"{self.order}II", _exactly(self.content[self.at : self.at + 8], 8))
        if word >> 16:  # a small one, in its own tag
            kind, size, begin, self.at = word & 0xFFFF, word >> 16, self.at + 4, self.at + 8
            if size > 4:
                raise ValueError(f"a small element of {size} bytes")
        else:
            kind, begin = word, self.at + 8
            self.at = begin + -(-size // 8) * 8
        if begin + size > self.size or (kind not in SIZES and kind not in (*TEXTS, MATRIX)):
            raise ValueError(f"an element of type {kind} with {size} bytes")
        return kind, size, begin

    def numbers(self, kind: int) -> tuple[int, ...]:
        """An element of whole numbers of 4 bytes."""
        found, size, begin = self.next()
        if found != kind or size % 4:
            raise ValueError(f"an element of type {found} where one of type {kind} belongs")
        content = _exactly(self.content[begin : begin + size], size)
        return struct.unpack(f"{self.order}{size // 4}{'i' if kind == INT32 else 'I'}", content)


def _is_plain(elements: _Elements) -> bool:
    return elements.numbers(UINT32)[0] & 0xFF in NUMBERS


def _matrix(elements: _Elements) -> None:
    flags, *_ = elements.numbers(UINT32)
    sizes, kind = elements.numbers(INT32), flags & 0xFF
    if len(sizes) < 2 or min(sizes) < 0:
        raise ValueError(f"an array of sizes {sizes}")
    count = math.prod(sizes)
    elements.next()  # its name
    if kind in NUMBERS:
        for _ in range(2 if flags & COMPLEX else 1):
            _numbers(elements, count)
    elif kind == CHARACTERS:
        if elements.next()[0] == MATRIX:
            raise ValueError("text that is an array")
    elif kind == CELL:
        _nested(elements, count)
    elif kind in (STRUCT, OBJECT):
        _struct(elements, kind, count)
    elif kind == SPARSE:
        for _ in range(4 if flags & COMPLEX else 3):
            _numbers(elements, None)
    elif kind == FUNCTION:
        _nested(elements, 1)
    else:
        raise ValueError(f"an array of class {kind}")


def _numbers(elements: _Elements, count: int | None) -> None:
    kind, size, _ = elements.next()
    if kind not in SIZES or (count is not None and size != count * SIZES[kind]):
        raise ValueError(f"{count} numbers of type {kind} in {size} bytes")


def _struct(elements: _Elements, kind: int, count: int) -> None:
    if kind == OBJECT:
        elements.next()  # the name of its class
    (length,) = elements.numbers(INT32)
    found, size, _ = elements.next()
    if length <= 0 or found != INT8 or size % length:
        raise ValueError(f"names of {length} bytes in {size}")
    _nested(elements, count * (size // length))


def _nested(elements: _Elements, count: int) -> None:
    for _ in range(count):
        kind, size, begin = elements.next()
        if kind != MATRIX:
            raise ValueError(f"an element of type {kind} where an array belongs")
        if size:
            _matrix(_Elements(elements.content[begin : begin + size], elements.order))


def _exactly(content: bytes, size: int) -> bytes:
    if len(content) != size:
        raise ValueError("an end before its time")
    return content
