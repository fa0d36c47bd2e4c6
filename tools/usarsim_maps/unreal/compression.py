"""Compressed parts of packages: blocks of zlib or LZO1X, with bounded output."""

from __future__ import annotations

import zlib

from usarsim_maps.unreal.archive import Archive, PackageError

__all__ = ["LZO", "LZX", "TAG", "ZLIB", "inflate_part", "lzo1x"]

TAG = 0x9E2A83C1
ZLIB, LZO, LZX = 1, 2, 4
"""Compression flags."""

MAX_BLOCK = 16 << 20
"""Bytes of one block; the engine uses 128 KiB."""


def inflate_part(archive: Archive, method: int, limit: int) -> bytes:
    """What a compressed part holds: tag, block size, totals, sizes of the blocks, the blocks.

    Args:
        archive: at the tag.
        method: compression flags.
        limit: bytes that may come out.

    Raises:
        PackageError: the part is damaged, larger than the limit, or compressed otherwise.
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
    only where no literals went before.

    Args:
        packed: all of it, end marker included.
        size: most bytes that may come out.

    Raises:
        PackageError: the stream is damaged.
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
