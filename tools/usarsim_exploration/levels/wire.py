"""Messages of a team as bytes: a head of JSON, then runs of cells; equal for equal news.

Length of the head (4 bytes), the head, number of runs (4 bytes), and for each run start and bits in
four bytes, length in two. JSON has no tuples and no arrays, which letters of strategies hold, so
these are written as objects of one key.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.post import Message
from usarsim_exploration.strategy import Teammate
from usarsim_server.protocol.json_text import parse_json

_BITS = 26
"""Up to where the start of a run counts; its bits are above."""
_LONGEST = 0xFFFF
_LENGTH = struct.Struct("<I")


def encode(message: Message) -> bytes:
    """A message; the reverse of `decode`."""
    head = [
        message.due, message.taker, message.giver, message.base_step,
        [
            [one.number, one.name, one.role, one.speed, one.cell, one.state, one.goal, one.heard,
             _plain(one.letter), one.size]
            for one in message.entries
        ],
    ]  # fmt: skip
    text = json.dumps(head, separators=(",", ":")).encode()
    starts, lengths, bits = _runs(message.cells, message.bits)
    runs = starts.astype("<u4") | bits.astype("<u4") << _BITS
    return b"".join(
        (_LENGTH.pack(len(text)), text, _LENGTH.pack(len(runs)), runs.tobytes(),
         lengths.astype("<u2").tobytes())
    )  # fmt: skip


def decode(data: bytes) -> Message:
    """A message out of its bytes."""
    (size,) = _LENGTH.unpack_from(data)
    due, taker, giver, base_step, rows = parse_json(data[4 : 4 + size])
    (count,) = _LENGTH.unpack_from(data, 4 + size)
    runs = np.frombuffer(data, "<u4", count, 8 + size)
    lengths = np.frombuffer(data, "<u2", count, 8 + size + 4 * count).astype(np.int64)
    starts = (runs & ((1 << _BITS) - 1)).astype(np.int64)
    offsets = np.arange(int(lengths.sum())) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    entries = [
        Teammate(number, name, role, speed, _cell(cell), state, goal and _cell(goal), heard,
                 _whole(letter), size)
        for number, name, role, speed, cell, state, goal, heard, letter, size in rows
    ]  # fmt: skip
    return Message(
        due, taker, giver, base_step, entries, np.repeat(starts, lengths) + offsets,
        np.repeat((runs >> _BITS).astype(np.uint8), lengths),
    )  # fmt: skip


def _cell(pair: list[int]) -> tuple[int, int]:
    return pair[0], pair[1]


def _runs(
    cells: NDArray[np.int64], bits: NDArray[np.uint8]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.uint8]]:
    """Starts, lengths and bits of cells that follow each other and are alike."""
    if not len(cells):
        return cells, cells, bits
    begins = np.r_[True, (np.diff(cells) != 1) | (bits[1:] != bits[:-1])]
    firsts = np.flatnonzero(begins)
    lengths = np.diff(np.append(firsts, len(cells)))
    parts = -(-lengths // _LONGEST)
    again = np.arange(int(parts.sum())) - np.repeat(np.cumsum(parts) - parts, parts)
    firsts = np.repeat(firsts, parts) + _LONGEST * again
    lengths = np.diff(np.append(firsts, len(cells)))
    return cells[firsts], lengths, bits[firsts]


def _plain(value: Any) -> Any:
    """A value as JSON can write it."""
    match value:
        case None | bool() | int() | float() | str():
            return value
        case np.ndarray():
            return {"array": [value.dtype.str, value.shape, value.ravel().tolist()]}
        case np.generic():
            return value.item()
        case tuple():
            return {"tuple": [_plain(one) for one in value]}
        case list():
            return [_plain(one) for one in value]
        case set() | frozenset():
            return {"set": [_plain(one) for one in sorted(value)]}
        case Mapping():
            return {"map": [[_plain(key), _plain(one)] for key, one in value.items()]}
        case _:
            raise TypeError(f"a letter holds plain values, not {type(value).__name__}")


def _whole(value: Any) -> Any:
    """The reverse of `_plain`."""
    if isinstance(value, list):
        return [_whole(one) for one in value]
    if not isinstance(value, dict):
        return value
    ((kind, inner),) = value.items()
    match kind:
        case "array":
            return np.array(inner[2], np.dtype(inner[0])).reshape(inner[1])
        case "tuple":
            return tuple(_whole(one) for one in inner)
        case "set":
            return {_whole(one) for one in inner}
        case _:
            return {_whole(key): _whole(one) for key, one in inner}
