"""The older wireless simulation inside the simulator (side channels reference 5).

Requests are words that end in a semicolon, such as `REGISTER Robot1 192.168.0.11;`, and so do the
answers, without a line end. On a data link a robot says `SEND <length> <bytes>;` or `CLOSE;` and
hears the bare bytes of the other robot.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

from usarsim_server.protocol.values import LONGEST_NAME, clean_name

MAX_MESSAGE = 4096
"""Longest message in bytes; longer ones are drained and answered as incorrect."""

OK = b"OK;"
INCORRECT = b"Fail: Incorrect Message;"
UNKNOWN = b"Fail: Unknown Message;"
NO_STRENGTH = b"Fail: Could not calculate signal strength;"
NO_LINK = b"Fail: Could not establish connection;"
THIRD_PARTY = b"Fail: Server does not accept third party requests;"

_BLANKS = b" \t\r\n"
_END, _SPACE = b"; "
_SEND, _CLOSE = b"SEND ", b"CLOSE"
_JUNK = re.compile(rb"(?:[ \t\r\n]*+(?!SEND |CLOSE)[^;]*+;)*+[ \t\r\n]*+")
"""Words that mean nothing, each with its semicolon, and the blanks before the next."""
_NUMBER = re.compile(rb"[0-9]{0,10}")


@dataclass(frozen=True, slots=True)
class Register:
    """A robot tells its address."""

    name: str
    address: str


@dataclass(frozen=True, slots=True)
class Listen:
    """A robot accepts a link on a port of its own; ports are compared as text."""

    name: str
    port: str


@dataclass(frozen=True, slots=True)
class Open:
    """Join a port of one robot with one of another that listens there."""

    name: str
    port: str
    other: str
    other_port: str


@dataclass(frozen=True, slots=True)
class GetStrength:
    """How strong is the signal between two robots?"""

    one: str
    other: str


Request = Register | Listen | Open | GetStrength

_REQUESTS: dict[str, tuple[type[Request], int]] = {
    "REGISTER": (Register, 2),
    "LISTEN": (Listen, 2),
    "OPEN": (Open, 4),
    "GETSS": (GetStrength, 2),
}


class MessageFramer:
    """Cuts one connection's bytes into messages.

    All complete messages of a chunk are found, and blanks and line ends between them are skipped,
    unlike in the original, which expected clients to wait for every answer (side channels 5.1).
    """

    __slots__ = ("_draining", "_held")

    def __init__(self) -> None:
        self._held = bytearray()
        self._draining = False

    def feed(self, data: bytes) -> list[bytes | None]:
        """Take the next bytes; returns messages without semicolon, None for one too long."""
        messages: list[bytes | None] = []
        *ended, rest = data.split(b";")
        for part in ended:
            self._hold(part)
            messages.append(None if self._draining else bytes(self._held).strip(_BLANKS))
            self._held.clear()
            self._draining = False
        self._hold(rest)
        return messages

    def _hold(self, part: bytes) -> None:
        if not self._held:
            part = part.lstrip(_BLANKS)
        if self._draining or len(self._held) + len(part) > MAX_MESSAGE:
            self._draining = True
            self._held.clear()
        else:
            self._held += part


def parse_message(message: bytes | None) -> Request | bytes:
    """The request of a message (None: one too long), or the answer to one that is none."""
    if message is None:
        return INCORRECT
    verb, *words = message.decode("latin-1").split() or [""]
    kind, count = _REQUESTS.get(verb.upper(), (None, 0))
    if kind is None:
        return UNKNOWN
    if len(words) != count or max(map(len, words)) > LONGEST_NAME:
        return INCORRECT
    return kind(*map(clean_name, words))


def strength_reply(strength: float) -> bytes:
    """Answer to GETSS: what is not a number or positive is an error by convention
    (side channels 5.3)."""
    if not -math.inf < strength <= 0.0:
        return NO_STRENGTH
    return f"OK:{strength + 0.0:.6g};".encode("ascii")


def already_registered(name: str) -> bytes:
    """REGISTER with another address than before."""
    return _fail(f"Robot with name {name} already registered")


def not_registered(name: str) -> bytes:
    """LISTEN before REGISTER."""
    return _fail(f"Robot {name} not registered")


def already_listening(name: str, port: str) -> bytes:
    """LISTEN twice."""
    return _fail(f"Robot with name {name} already listening at port {port}")


def not_listening(name: str, port: str) -> bytes:
    """OPEN towards a port that nobody listens on."""
    return _fail(f"{name} not listening on port {port}")


def cannot_connect(name: str) -> bytes:
    """OPEN towards a robot out of reach."""
    return _fail(f"Cannot connect to {name}")


def _fail(reason: str) -> bytes:
    return f"Fail: {reason};".encode("latin-1", "replace")


class LinkReader:
    """Reads what a robot sends on a data link (side channels 5.4); memory does not grow with the
    payload.

    Works on whole buffers: junk is passed over by one search, however many words it has.

    Attributes:
        closed: whether CLOSE was read; nothing is read after it.
    """

    __slots__ = ("_held", "_left", "_read", "closed")

    def __init__(self) -> None:
        self.closed = False
        self._held = b""
        self._left = 0
        self._read: Callable[[bytes, int, bytearray], int] = self._read_word

    def feed(self, data: bytes) -> bytes:
        """Take the next bytes and return the payload in them.

        The first five bytes, `SEND` with its blank or `CLOSE`, tell what comes. Everything else, a
        length that is no number included, is skipped up to the next semicolon.
        """
        payload = bytearray()
        data, self._held = self._held + data, b""
        place = 0
        while place < len(data) and not self.closed:
            place = self._read(data, place, payload)
        return bytes(payload)

    # Each of these reads on from a place in the bytes and returns the place behind it.

    def _read_word(self, data: bytes, place: int, payload: bytearray) -> int:
        start = _place_behind(_JUNK, data, place)
        word = data[start : start + len(_SEND)]
        if len(word) < len(_SEND):
            return self._hold(data, start)
        reads = {_SEND: self._read_length, _CLOSE: self._read_goodbye}
        self._read = reads.get(word, self._skip)
        return start + len(word)

    def _read_length(self, data: bytes, place: int, payload: bytearray) -> int:
        end = _place_behind(_NUMBER, data, place)
        if end == len(data):
            return self._hold(data, place)
        if data[end] == _SPACE and end > place:
            self._left = int(data[place:end])
            self._read = self._read_payload
        else:
            self._read = self._read_word if data[end] == _END else self._skip
        return end + 1

    def _read_payload(self, data: bytes, place: int, payload: bytearray) -> int:
        if not self._left:
            self._read = self._read_word
            return place + 1  # one byte ends the payload, whichever it is
        part = data[place : place + self._left]
        payload += part
        self._left -= len(part)
        return place + len(part)

    def _read_goodbye(self, data: bytes, place: int, payload: bytearray) -> int:
        end = data.find(b";", place)
        self.closed = end >= 0
        return len(data)

    def _skip(self, data: bytes, place: int, payload: bytearray) -> int:
        end = data.find(b";", place)
        if end < 0:
            return len(data)
        self._read = self._read_word
        return end + 1

    def _hold(self, data: bytes, place: int) -> int:
        """Keep what is not complete for the next bytes: a word, or the digits of a length."""
        self._held = data[place:]
        return len(data)


def _place_behind(pattern: re.Pattern[bytes], data: bytes, place: int) -> int:
    found = pattern.match(data, place)
    assert found is not None  # the patterns match nothing, too
    return found.end()
