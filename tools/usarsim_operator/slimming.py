"""Binary messages for a slow link: the same contents with less detail."""

from __future__ import annotations

import io
import math
import struct

from usarsim_client import ProtocolError
from usarsim_client.pictures import opened
from usarsim_operator import packets

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
    if data[0] == packets.PICTURE:
        return data[: packets.HEAD] + smaller(data[packets.HEAD :], most - packets.HEAD)
    if data[0] == packets.POINTS:
        begin = packets.HEAD + 4
        points = len(data[begin:]) // _POINT
        step = -(-points // max(1, (most - begin) // _POINT))
        kept = [data[at : at + _POINT] for at in range(begin, len(data), step * _POINT)]
        return data[: packets.HEAD] + struct.pack("<I", len(kept)) + b"".join(kept)
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
