"""A cursor over little-endian bytes that never reads beyond its end."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

__all__ = ["Archive", "PackageError"]

Array = NDArray[np.float64]

MAX_STRING = 1 << 20
"""Characters of one string."""


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

    Attributes:
        offset: where the next value is, counted from the beginning of the package.
        end: where the part ends.
    """

    def __init__(self, data: bytes, offset: int = 0, end: int | None = None) -> None:
        """A part of some bytes.

        Raises:
            PackageError: the part is not inside them.
        """
        self._data = data
        self.offset = offset
        self.end = len(data) if end is None else end
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
        """Leave out some bytes.

        Raises:
            PackageError: so many are not there.
        """
        if not 0 <= size <= self.left:
            raise PackageError(f"{size} bytes wanted, {self.left} are left", self.offset)
        self.offset += size

    def bytes(self, size: int) -> bytes:
        """Some bytes as they are; `PackageError` as in `skip`, here and everywhere below."""
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
        """The length of a list whose items take at least so many bytes each.

        Raises:
            PackageError: it is negative, or longer than what is left.
        """
        start = self.offset
        number = self.i32()
        if number < 0 or number * item > self.left:
            raise PackageError(f"{number} {what} in {self.left} bytes", start)
        return number

    def bulk(self, size: int, what: str) -> tuple[int, int]:
        """Skip over a list that is stored in one block, with the size of an item before it.

        Args:
            size: that items must have; 0: any.
            what: for errors.

        Returns:
            Where the items begin, and their number.
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
        """A string: its length with the final NUL before it; negative for UTF-16.

        Raises:
            PackageError: it is absurdly long or not there.
        """
        start = self.offset
        length = self.i32()
        if abs(length) > MAX_STRING:
            raise PackageError(f"a string of {abs(length)} characters", start)
        if length >= 0:
            return self.bytes(length).rstrip(b"\0").decode("latin-1")
        return self.bytes(-2 * length).decode("utf-16-le", errors="replace").rstrip("\0")
