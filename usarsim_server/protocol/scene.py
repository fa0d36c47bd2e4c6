"""The scene port, without sockets: frames, what a client asks for, poses (docs/scene-port.md)."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.json_text import parse_json

VERSION = 1
LONGEST = 64 * 1024
"""Bytes of a client's frame behind its length, at most."""
LEAST_RATE, MOST_RATE = 0.1, 30.0
"""Pose frames per s of wall time that a client may ask for."""

POSES = struct.Struct("<dII")
"""Simulated time (s), generation and count, before the poses."""
_HEAD = struct.Struct(">Ic")
_LENGTH = 4


class SceneError(ValueError):
    """What a client said makes no sense; the text is for the client."""


def message(fields: Mapping[str, object]) -> bytes:
    """A `J` frame.

    Raises:
        ValueError: if a number is not finite.
    """
    text = json.dumps(fields, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    payload = text.encode("utf-8", "replace")  # a name may hold half a surrogate pair
    return _HEAD.pack(len(payload) + 1, b"J") + payload


def pose_frame(time: float, generation: int, poses: NDArray[np.float32]) -> bytes:
    """A `P` frame.

    Args:
        time: simulated s.
        generation: of the `present` message that tells whose the poses are.
        poses: (n, 7) x, y, z (m), w, x, y, z.
    """
    payload = poses.astype("<f4").tobytes()
    length = 1 + POSES.size + len(payload)
    return _HEAD.pack(length, b"P") + POSES.pack(time, generation, len(poses)) + payload


Frames = tuple[tuple[str, bytes], ...]
"""A message and everything that has to be sent before it, by id."""


@dataclass(frozen=True, slots=True)
class Instant:
    """What is to be told of one instant; all frames are whole."""

    scene: Frames  # the same for the whole run
    kinds: Mapping[str, Frames]  # of all things that are present, and others
    needed: tuple[str, ...]  # kinds that are present
    generation: int
    present: bytes
    poses: bytes


def frames(held: bytearray, longest: int) -> Iterator[tuple[bytes, bytes]]:
    """Take whole frames, kind and payload, off the beginning of what has come.

    Args:
        held: the bytes; what is left of them are no whole frame.
        longest: bytes that a frame may have behind its length.

    Raises:
        SceneError: if these are no frames.
    """
    while len(held) >= _HEAD.size:
        length, kind = _HEAD.unpack_from(held)
        if not 1 <= length <= longest:
            raise SceneError(
                f"no message of the scene port (4 bytes of length, up to {longest}; J; JSON)"
            )
        if len(held) < _LENGTH + length:
            return
        payload = bytes(held[_HEAD.size : _LENGTH + length])
        del held[: _LENGTH + length]
        yield kind, payload


class FrameReader:
    """Cuts the bytes of one client into `J` frames."""

    def __init__(self) -> None:
        self._held = bytearray()

    def feed(self, data: bytes) -> list[dict[str, object]]:
        """Take the next bytes; the JSON objects that they complete.

        Raises:
            SceneError: if a frame is too long, of another kind, or no JSON object.
        """
        self._held += data
        found = []
        for kind, payload in frames(self._held, LONGEST):
            if kind != b"J":
                raise SceneError("clients send nothing but messages, of kind J")
            found.append(_object(payload))
        return found


def _object(payload: bytes) -> dict[str, object]:
    try:
        value = parse_json(payload)
    except ValueError:
        value = None
    if not isinstance(value, dict):
        raise SceneError("a message has to be one JSON object")
    return value


@dataclass(frozen=True, slots=True)
class Hello:
    """What a client begins with."""

    token: str
    channels: tuple[str, ...]
    rate_hz: float
    streams: bool = True  # whether lines that come again and again are wanted, too


def read_hello(fields: Mapping[str, object], known: Collection[str]) -> Hello:
    """What a first message asks for.

    Args:
        fields: the message.
        known: names of all channels.

    Raises:
        SceneError: if it is no hello that this server understands.
    """
    if isinstance(fields.get("hello"), bool) or fields.get("hello") != VERSION:
        raise SceneError(f'the first message has to be a hello: {{"hello": {VERSION}, ...}}')
    channels = fields.get("channels", ["scene", "poses"])
    if not isinstance(channels, list) or not all(isinstance(one, str) for one in channels):
        raise SceneError('"channels" has to be a list of texts')
    for one in channels:
        if one not in known:
            raise SceneError(f"there is no channel {one[:40]!r} (known: {', '.join(known)})")
    token = fields.get("token", "")
    if not isinstance(token, str):
        raise SceneError('"token" has to be a text')
    streams = fields.get("streams", True)
    if not isinstance(streams, bool):
        raise SceneError('"streams" has to be true or false')
    return Hello(token, tuple(dict.fromkeys(channels)), read_rate(fields), streams)


def read_number(fields: Mapping[str, object], key: str, least: float, most: float) -> float:
    """A number of a message that has to be there.

    Raises:
        SceneError: if it is not, or out of range.
    """
    value = fields.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise SceneError(f'"{key}" has to be a number from {least:g} to {most:g}')
    return float(value)


def read_text(fields: Mapping[str, object], key: str, longest: int) -> str | None:
    """A text of a message, None if there is none.

    Raises:
        SceneError: if it is something else, or too long.
    """
    value = fields.get(key)
    if value is None:
        return None
    if not isinstance(value, str) or not value or len(value) > longest:
        raise SceneError(f'"{key}" has to be a text of at most {longest} characters')
    return value


def read_rate(fields: Mapping[str, object]) -> float:
    """The rate that a message asks for, Hz, within what there is.

    Raises:
        SceneError: if it is no number.
    """
    rate = fields.get("rate_hz", MOST_RATE)
    if isinstance(rate, bool) or not isinstance(rate, int | float) or not math.isfinite(rate):
        raise SceneError('"rate_hz" has to be a number')
    return min(max(float(rate), LEAST_RATE), MOST_RATE)
