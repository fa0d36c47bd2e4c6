"""Binary messages for pages (docs/console-protocol.md): a head of 16 bytes, then the contents.

Pictures and points become smaller for a slow link.
"""

from __future__ import annotations

import io
import math
import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usarsim_client import ProtocolError
from usarsim_client.pictures import opened
from usarsim_server.protocol.values import Vector

PICTURE, SCAN, POINTS, POSES, MAP, PATH = 1, 2, 3, 4, 5, 6
SPECTATOR = 255
"""Robot of messages that belong to none."""

_HEAD = struct.Struct("<BBHId")
HEAD = _HEAD.size
"""Bytes of the head."""
_SCAN = struct.Struct("<8fHH")
_MAP = struct.Struct("<3fHH")


def head(kind: int, robot: int, sequence: int, time: float, flags: int = 0) -> bytes:
    """The head. robot: its index in `state`. time: simulated s; 0 if it is not known."""
    return _HEAD.pack(kind, robot, flags, sequence & 0xFFFFFFFF, time if time == time else 0.0)


def read_head(data: bytes) -> tuple[int, int, int, int, float]:
    """Kind, robot, flags, sequence and time of a message.

    Raises:
        struct.error: if it is too short.
    """
    kind, robot, flags, sequence, time = _HEAD.unpack_from(data)
    return kind, robot, flags, sequence, time


def scan(
    fov: float, most: float, place: Vector, turned: Vector, ranges: NDArray[np.float64]
) -> bytes:
    """Contents of a scan; ranges (n,) m as the line has them, from the right to the left."""
    leftmost = np.ascontiguousarray(ranges[::-1][:65535], "<f4")
    data = np.where(np.isfinite(leftmost), leftmost, np.float32(np.nan)).astype("<f4")
    return _SCAN.pack(fov, most, *place, *turned, len(data), 0) + data.tobytes()


def points(places: NDArray[np.float64]) -> bytes:
    """Contents of points (n, 3), m in the frame of the robot."""
    return struct.pack("<I", len(places)) + np.ascontiguousarray(places, "<f4").tobytes()


def path(places: Sequence[tuple[float, float]]) -> bytes:
    """Contents of a way, m."""
    return struct.pack("<I", len(places)) + np.asarray(places, "<f4").reshape(-1, 2).tobytes()


def grid(cell: float, corner: tuple[float, float], cells: NDArray[np.uint8]) -> bytes:
    """Contents of a map: cells (rows, columns) in runs of a count (1 to 255) and a value."""
    rows, columns = cells.shape
    flat = cells.reshape(-1)
    ends = np.flatnonzero(np.append(flat[1:] != flat[:-1], True)) + 1
    lengths = np.diff(ends, prepend=0)
    values = flat[ends - 1]
    whole = (lengths - 1) // 255  # full runs of 255 before the last one of each
    counts = np.repeat(np.full(len(lengths), 255), whole + 1)
    last = np.cumsum(whole + 1) - 1
    counts[last] = lengths - whole * 255
    pairs = np.stack((counts.astype(np.uint8), np.repeat(values, whole + 1)), axis=1)
    return _MAP.pack(cell, *corner, columns, rows) + pairs.astype(np.uint8).tobytes()


_STEPS = ((1, 50), (2, 60), (2, 40), (4, 50))
"""What a picture is tried with: by how much it is smaller each way, and its quality."""
_MOST_PIXELS = 2_000_000  # that are worked on: nobody else is served meanwhile
_POINT = 12  # bytes


def slim(data: bytes, most: int) -> bytes:
    """A message of at most so many bytes, or of as few as it can have; only pictures and points
    have detail to spare.

    Args:
        data: with its head. most: bytes.
    """
    if data[0] == PICTURE:
        return data[:HEAD] + smaller(data[HEAD:], most - HEAD)
    if data[0] == POINTS:
        begin = HEAD + 4
        points = len(data[begin:]) // _POINT
        step = -(-points // max(1, (most - begin) // _POINT))
        kept = [data[at : at + _POINT] for at in range(begin, len(data), step * _POINT)]
        return data[:HEAD] + struct.pack("<I", len(kept)) + b"".join(kept)
    return data


def smaller(jpeg: bytes, most: int) -> bytes:
    """A JPEG of at most so many bytes, if a quarter of its size allows; one that cannot be read
    stays as it is."""
    try:
        with opened(jpeg) as picture:
            many = math.ceil(math.sqrt(picture.width * picture.height / _MOST_PIXELS))
        for part, quality in _STEPS:
            with opened(jpeg) as picture:
                less = max(part, many)
                size = max(1, picture.width // less), max(1, picture.height // less)
                picture.draft("RGB", size)
                out = io.BytesIO()
                picture.convert("RGB").resize(size).save(out, "JPEG", quality=quality)
            if out.tell() <= most:
                break
    except ProtocolError:
        return jpeg
    return min(jpeg, out.getvalue(), key=len)
