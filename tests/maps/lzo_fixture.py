"""A small compressor of the LZO1X format: greedy, for tests of the decompressor."""

from __future__ import annotations


def lzo_pack(content: bytes) -> bytes:
    """One block, with its end marker."""
    out = bytearray()
    table: dict[bytes, int] = {}
    place = start = 0
    slot = -1  # byte of the last match that takes a count of up to three literals
    while place < len(content):
        key = content[place : place + 3]
        before = table.get(key, -1) if len(key) == 3 else -1
        if len(key) == 3:
            table[key] = place
        distance = place - before
        if before < 0 or distance > 0xBFFF:
            place += 1
            continue
        length = 3
        while place + length < len(content) and content[before + length] == content[place + length]:
            length += 1
        _literals(out, content[start:place], slot)
        slot = _match(out, distance, length)
        place += length
        start = place
    _literals(out, content[start:], slot)
    return bytes(out) + bytes([17, 0, 0])


def _literals(out: bytearray, run: bytes, slot: int) -> None:
    if not run:
        return
    if slot >= 0 and len(run) <= 3:
        out[slot] |= len(run)
    elif not out and len(run) <= 238:
        out.append(17 + len(run))
    elif len(run) <= 18:
        out.append(len(run) - 3)
    else:
        out.append(0)
        _long(out, len(run) - 18)
    out += run


def _long(out: bytearray, rest: int) -> None:
    """A number of 1 or more as zeros that stand for 255 each, and the remainder."""
    out += bytes((rest - 1) // 255)
    out.append((rest - 1) % 255 + 1)


def _match(out: bytearray, distance: int, length: int) -> int:
    """An instruction; the place of the byte whose low bits count literals."""
    if length <= 8 and distance <= 0x800:
        far = distance - 1
        if length <= 4:
            out.append(0x40 | (length - 3) << 5 | (far & 7) << 2)
        else:
            out.append(0x80 | (length - 5) << 5 | (far & 7) << 2)
        slot = len(out) - 1
        out.append(far >> 3)
        return slot
    if distance <= 0x4000:
        _head(out, 0x20, 31, length)
        far = distance - 1
    else:
        far = distance - 0x4000
        _head(out, 0x10 | (far >> 14) << 3, 7, length)
        far &= 0x3FFF
    slot = len(out)
    out += (far << 2).to_bytes(2, "little")
    return slot


def _head(out: bytearray, code: int, full: int, length: int) -> None:
    if length - 2 <= full:
        out.append(code | (length - 2))
    else:
        out.append(code)
        _long(out, length - 2 - full)
