"""A cursor over little-endian bytes that never reads beyond its end.

Compressed parts of packages: blocks of zlib or LZO1X, with bounded output.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.scene import Array

MAX_STRING = 1 << 20
"""Characters of one string."""


TAG = 0x9E2A83C1

ZLIB, LZO, LZX = 1, 2, 4
"""Compression flags."""

MAX_BLOCK = 16 << 20
"""Bytes of one block; the engine uses 128 KiB."""


class PackageError(ValueError):
    """Bytes that make no sense.

    Attributes:
        offset: where in the (decompressed) package.
        cure: what to do about it; empty: export again.
    """

    def __init__(self, problem: str, offset: int | None = None, cure: str = "") -> None:
        super().__init__(problem)
        self.offset = offset
        self.cure = cure


class Archive:
    """Reads numbers and strings from a part of a package, front to back.

    What is not there, or makes no sense, is a `PackageError`.
    """

    def __init__(self, data: bytes, offset: int = 0, end: int | None = None) -> None:
        self._data = data
        self.offset = offset  # where the next value is, counted from the beginning of the package
        self.end = len(data) if end is None else end  # of the part
        if not 0 <= offset <= self.end <= len(data):
            raise PackageError(f"a part from byte {offset} to {self.end} of {len(data)}", offset)

    @property
    def left(self) -> int:
        """Bytes that are still there."""
        return self.end - self.offset

    def copy(self) -> Archive:
        """Another cursor at the same place."""
        return Archive(self._data, self.offset, self.end)

    def skip(self, size: int) -> None:
        """Leave out some bytes."""
        if not 0 <= size <= self.left:
            raise PackageError(f"{size} bytes wanted, {self.left} are left", self.offset)
        self.offset += size

    def bytes(self, size: int) -> bytes:
        """Some bytes as they are."""
        start = self.offset
        self.skip(size)
        return self._data[start : start + size]

    def part(self, size: int) -> Archive:
        """A cursor over the next bytes alone; this one goes on behind them."""
        start = self.offset
        self.skip(size)
        return Archive(self._data, start, start + size)

    def u8(self) -> int:
        """One byte."""
        return int(self.bytes(1)[0])

    def u16(self) -> int:
        """Two bytes without sign."""
        return int.from_bytes(self.bytes(2), "little")

    def u32(self) -> int:
        """Four bytes without sign."""
        return int.from_bytes(self.bytes(4), "little")

    def u64(self) -> int:
        """Eight bytes without sign."""
        return int.from_bytes(self.bytes(8), "little")

    def i32(self) -> int:
        """Four bytes with sign."""
        return int.from_bytes(self.bytes(4), "little", signed=True)

    def i32s(self, count: int) -> tuple[int, ...]:
        """Several of them."""
        return struct.unpack(f"<{count}i", self.bytes(4 * count))

    def f32(self) -> float:
        """A single-precision number; may be NaN."""
        return float(struct.unpack("<f", self.bytes(4))[0])

    def floats(self, *shape: int) -> Array:
        """Single-precision numbers as float64."""
        count = int(np.prod(shape))
        raw = np.frombuffer(self.bytes(4 * count), dtype="<f4")
        return raw.astype(np.float64).reshape(shape)

    def count(self, item: int, what: str = "items") -> int:
        """The length of a list whose items take at least so many bytes each."""
        start = self.offset
        number = self.i32()
        if number < 0 or number * item > self.left:
            raise PackageError(f"{number} {what} in {self.left} bytes", start)
        return number

    def bulk(self, size: int, what: str) -> tuple[int, int]:
        """Skip over a list that is stored in one block, with the size of an item before it.

        That size has to be the given one, unless 0 is given. Returns where the items begin, and
        their number.
        """
        start = self.offset
        item = self.i32()
        if item <= 0 or (size and item != size):
            raise PackageError(f"{what} of {item} bytes each", start)
        number = self.count(item, what)
        begin = self.offset
        self.skip(number * item)
        return begin, number

    def table(self, begin: int, count: int, dtype: np.dtype[np.void]) -> NDArray[np.void]:
        """Records at a place that was read before."""
        if not 0 <= begin <= self.end - count * dtype.itemsize:
            raise PackageError(f"{count} records do not fit", begin)
        return np.frombuffer(self._data, dtype, count, begin)

    def string(self) -> str:
        """A string: its length with the final NUL before it; negative for UTF-16."""
        start = self.offset
        length = self.i32()
        if abs(length) > MAX_STRING:
            raise PackageError(f"a string of {abs(length)} characters", start)
        if length >= 0:
            return self.bytes(length).rstrip(b"\0").decode("latin-1")
        return self.bytes(-2 * length).decode("utf-16-le", errors="replace").rstrip("\0")


def inflate_part(archive: Archive, method: int, limit: int) -> bytes:
    """What a compressed part holds: tag, block size, totals, sizes of the blocks, the blocks.

    It is a `PackageError` if the part is damaged, gives more bytes than the limit, or is compressed
    by another method than the flags say.
    """
    start = archive.offset
    if archive.u32() != TAG:
        raise PackageError("a compressed part without its tag", start)
    block = archive.i32()
    packed, size = archive.i32s(2)
    if not 0 < block <= MAX_BLOCK or not 0 <= size <= limit or packed < 0:
        raise PackageError(f"a compressed part of {size} bytes in blocks of {block}", start)
    number = -(-size // block)
    if number * 8 > archive.left:
        raise PackageError(f"{number} compressed blocks in {archive.left} bytes", start)
    sizes = [archive.i32s(2) for _ in range(number)]
    whole = bytearray()
    for inside, outside in sizes:
        if not 0 <= outside <= min(block, size - len(whole)):
            raise PackageError(f"a compressed block of {outside} bytes", archive.offset)
        whole += _inflate(archive.bytes(inside), method, outside, archive.offset)
    if len(whole) != size:
        raise PackageError(f"compressed blocks give {len(whole)} bytes, not {size}", start)
    return bytes(whole)


def _inflate(packed: bytes, method: int, size: int, offset: int) -> bytes:
    if method & ZLIB:
        engine = zlib.decompressobj()
        try:
            whole = engine.decompress(packed, size + 1)
        except zlib.error as error:
            raise PackageError(f"a damaged block (zlib: {error})", offset) from None
    elif method & LZO:
        whole = lzo1x(packed, size)
    else:
        cure = "save the map with the editor on a PC, uncompressed"
        raise PackageError(f"compression method {method:#x} (LZX of a console?)", offset, cure)
    if len(whole) != size:
        raise PackageError(f"a block of {len(whole)} bytes or more instead of {size}", offset)
    return whole


def lzo1x(packed: bytes, size: int) -> bytes:
    """Decompress one LZO1X block.

    The stream is a chain of instructions. Each copies a match out of what has been written, then
    up to three literal bytes; runs of more literals are instructions of their own, which exist
    only where no literals went before. It ends with a marker. More bytes than `size`, and damage,
    are a `PackageError`.
    """
    out = bytearray()
    try:
        _run(packed, size, out)
    except IndexError:
        raise PackageError("a damaged block (LZO: it is cut off)") from None
    return bytes(out)


def _run(packed: bytes, size: int, out: bytearray) -> None:
    place = 0
    state = 0  # literals copied by the last instruction; 4: a long run
    if packed[0] > 17:
        count = packed[0] - 17
        place = _literals(packed, 1, count, size, out)
        state = count if count < 4 else 4
    while True:
        code = packed[place]
        place += 1
        if code < 16 and state == 0:
            count = code + 3
            if code == 0:
                more, place = _length(packed, place)
                count = 15 + 3 + more
            place = _literals(packed, place, count, size, out)
            state = 4
            continue
        if code >= 64:
            distance = 1 + ((code >> 2) & 7) + (packed[place] << 3)
            place += 1
            count = (code >> 5) + 1
            literals = code & 3
        elif code >= 32:
            count, place = _count(packed, place, code & 31, 31)
            pair = packed[place] | packed[place + 1] << 8
            place += 2
            distance = 1 + (pair >> 2)
            literals = pair & 3
        elif code >= 16:
            count, place = _count(packed, place, code & 7, 7)
            pair = packed[place] | packed[place + 1] << 8
            place += 2
            distance = ((code & 8) << 11) + (pair >> 2)
            if distance == 0:
                if place != len(packed):
                    raise PackageError("a damaged block (LZO: bytes behind its end)")
                return
            distance += 0x4000
            literals = pair & 3
        else:
            literals = code & 3
            distance = 1 + (code >> 2) + (packed[place] << 2)
            place += 1
            count = 2
            if state == 4:
                distance += 0x800
                count = 3
        _match(distance, count, size, out)
        place = _literals(packed, place, literals, size, out)
        state = literals


def _count(packed: bytes, place: int, bits: int, full: int) -> tuple[int, int]:
    """Length of a match whose bits in the instruction may not suffice."""
    if bits:
        return bits + 2, place
    more, place = _length(packed, place)
    return full + 2 + more, place


def _length(packed: bytes, place: int) -> tuple[int, int]:
    """255 for every zero byte, and the first other one."""
    start = place
    while packed[place] == 0:
        place += 1
    return (place - start) * 255 + packed[place], place + 1


def _literals(packed: bytes, place: int, count: int, size: int, out: bytearray) -> int:
    if place + count > len(packed) or len(out) + count > size:
        raise PackageError("a damaged block (LZO: too many literals)")
    out += packed[place : place + count]
    return place + count


def _match(distance: int, count: int, size: int, out: bytearray) -> None:
    start = len(out) - distance
    if start < 0 or len(out) + count > size:
        raise PackageError("a damaged block (LZO: a match from nowhere)")
    if distance >= count:
        out += out[start : start + count]
        return
    pattern = bytes(out[start:])
    out += (pattern * (count // distance + 1))[:count]
