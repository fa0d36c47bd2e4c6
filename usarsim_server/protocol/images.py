"""The camera image stream, without sockets: requests in, framed pictures out.

A client asks with `OK` for the full frame, or with `U` and four big-endian integers for a
rectangle of it; each request is answered with one picture behind a header of five bytes
(side channels reference 2.2 to 2.4).
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass

_RECTANGLE = struct.Struct(">4I")
_REPLY = struct.Struct(">BI")
_SIZE = struct.Struct(">2H")
_START = re.compile(rb"[OU]")

MAX_RAW_SIDE = 0xFFFF
"""Largest width and height that a raw picture can name, pixels."""


@dataclass(frozen=True, slots=True)
class FullFrame:
    """`OK`: the client wants the full frame."""


@dataclass(frozen=True, slots=True)
class Rectangle:
    """`U`: the client wants a part of the full frame; pixels, origin in its upper left corner.

    Each number is unsigned and has 32 bits; whether the rectangle lies in the frame is open.
    """

    x: int
    y: int
    width: int
    height: int


Request = FullFrame | Rectangle


class RequestLexer:
    """Cuts one connection's bytes into requests (side channels reference 2.2).

    Whatever is no request is skipped without an answer; several clients rely on that. After `O`
    the next byte is used up in any case, so `OOK` asks for nothing. After `U` sixteen bytes are
    binary, whatever they look like. The same bytes give the same requests however they are cut.
    """

    __slots__ = ("_held",)

    def __init__(self) -> None:
        self._held = b""

    @property
    def pending(self) -> int:
        """Bytes held of a request that is not complete; at most 16."""
        return len(self._held)

    def feed(self, data: bytes) -> list[Request]:
        """Take the next bytes and return the requests that they complete, in order."""
        data = self._held + data
        requests: list[Request] = []
        place = 0
        while (start := _START.search(data, place)) is not None:
            place = start.start()
            length = 2 if data[place] == ord("O") else 1 + _RECTANGLE.size
            if place + length > len(data):
                self._held = data[place:]
                return requests
            if length > 2:
                requests.append(Rectangle(*_RECTANGLE.unpack_from(data, place + 1)))
            elif data[place + 1] == ord("K"):
                requests.append(FullFrame())
            place += length
        self._held = b""
        return requests


@dataclass(frozen=True, slots=True)
class ImageType:
    """What all pictures of a server are encoded as (side channels reference 2.3)."""

    number: int  # as configured, 0 or more; the first byte of a reply is this number modulo 256

    @classmethod
    def named(cls, name: str) -> ImageType:
        """The type with a name, in any letter case; an empty name is NORMAL.

        Raises:
            ValueError: if there is no such name.
        """
        if name.upper() in IMAGE_TYPES:
            return cls(IMAGE_TYPES.index(name.upper()))
        if not name:
            return NORMAL
        raise ValueError(f"no image type {name!r}")

    @property
    def byte(self) -> int:
        """First byte of every reply."""
        return self.number % 256

    @property
    def quality(self) -> int | None:
        """JPEG quality from 0 to 100, or None for raw pixels.

        Numbers without a name mean the quality of GOOD.
        """
        return _QUALITIES.get(self.number, _QUALITIES[2])

    def __str__(self) -> str:
        named = self.number < len(IMAGE_TYPES)
        return IMAGE_TYPES[self.number] if named else str(self.number)


IMAGE_TYPES = ("RAW", "SUPER", "GOOD", "NORMAL", "FAIR", "BAD")
"""Names of the image types, in the order of their numbers."""

RAW = ImageType(0)
NORMAL = ImageType(3)
"""What an original server without a choice used."""

_QUALITIES = {0: None, 1: 100, 2: 75, 3: 50, 4: 25, 5: 10}


def reply_header(image_type: ImageType, length: int) -> bytes:
    """The five bytes before a payload of this many bytes."""
    return _REPLY.pack(image_type.byte, length)


def raw_header(width: int, height: int) -> bytes:
    """The four bytes before the pixels of a raw picture (side channels reference 2.4).

    The rows follow, top row first, pixels from the left, three bytes each: blue, green, red;
    every row is filled up to `raw_row_length` bytes.

    Raises:
        ValueError: if a side is longer than `MAX_RAW_SIDE`.
    """
    if not 0 <= width <= MAX_RAW_SIDE or not 0 <= height <= MAX_RAW_SIDE:
        raise ValueError(f"a raw picture cannot be {width} x {height}")
    return _SIZE.pack(width, height)


def raw_row_length(width: int) -> int:
    """Bytes of one row of a raw picture: three per pixel, then up to a multiple of four."""
    return (3 * width + 3) // 4 * 4


def empty_reply(image_type: ImageType) -> bytes:
    """The whole answer to a rectangle that does not lie in the frame (side channels 2.7).

    Raw: a picture of 0 x 0; JPEG: no payload. Request and answer stay paired.
    """
    payload = raw_header(0, 0) if image_type.quality is None else b""
    return reply_header(image_type, len(payload)) + payload
