"""The older wireless simulation inside the simulator (side channels reference 5).

Requests are words that end in a semicolon, such as `REGISTER Robot1 192.168.0.11;`, and so do the
answers, without a line end. On a data link a robot says `SEND <length> <bytes>;` or `CLOSE;` and
hears the bare bytes of the other robot.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

__all__ = [
    "INCORRECT",
    "MAX_MESSAGE",
    "NO_LINK",
    "NO_STRENGTH",
    "OK",
    "THIRD_PARTY",
    "UNKNOWN",
    "GetStrength",
    "LinkReader",
    "Listen",
    "MessageFramer",
    "Open",
    "Register",
    "Request",
    "already_listening",
    "already_registered",
    "cannot_connect",
    "not_listening",
    "not_registered",
    "parse_message",
    "strength_reply",
]

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
_DIGITS = b"0123456789"
_SEND, _CLOSE = b"SEND ", b"CLOSE"
_LONGEST_NUMBER = 10


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
    unlike in the original, which expected clients to wait for every answer (5.1).
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
    if len(words) != count:
        return INCORRECT
    return kind(*words)


def strength_reply(strength: float) -> bytes:
    """Answer to GETSS: what is not a number or positive is an error by convention (5.3)."""
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
    """Reads what a robot sends on a data link (5.4); memory does not grow with the payload.

    Attributes:
        closed: whether CLOSE was read; nothing is read after it.
    """

    __slots__ = ("_head", "_left", "_read", "closed")

    def __init__(self) -> None:
        self.closed = False
        self._head = bytearray()
        self._left = 0
        self._read: Callable[[memoryview, bytearray], int] = self._read_word

    def feed(self, data: bytes) -> bytes:
        """Take the next bytes and return the payload in them.

        The first five bytes, `SEND` with its blank or `CLOSE`, tell what comes. Everything else, a
        length that is no number included, is skipped up to the next semicolon.
        """
        payload = bytearray()
        rest = memoryview(data)
        while rest and not self.closed:
            rest = rest[self._read(rest, payload) :]
        return bytes(payload)

    # Each of these reads a little and returns how many bytes that were.

    def _read_word(self, data: memoryview, payload: bytearray) -> int:
        byte = data[0]
        if self._head or byte not in _BLANKS:
            self._head.append(byte)
        if byte == _END:
            self._head.clear()
        elif self._head == _SEND:
            self._next(self._read_length)
        elif self._head == _CLOSE:
            self._next(self._read_goodbye)
        elif len(self._head) == len(_SEND):
            self._next(self._skip)
        return 1

    def _read_length(self, data: memoryview, payload: bytearray) -> int:
        byte = data[0]
        if byte == _SPACE and self._head:
            self._left = int(self._head)
            self._next(self._read_payload)
        elif byte in _DIGITS and len(self._head) < _LONGEST_NUMBER:
            self._head.append(byte)
        else:
            self._next(self._read_word if byte == _END else self._skip)
        return 1

    def _read_payload(self, data: memoryview, payload: bytearray) -> int:
        if not self._left:
            self._next(self._read_word)
            return 1  # one byte ends the payload, whichever it is
        part = data[: self._left]
        payload += part
        self._left -= len(part)
        return len(part)

    def _read_goodbye(self, data: memoryview, payload: bytearray) -> int:
        self.closed = data[0] == _END
        return 1

    def _skip(self, data: memoryview, payload: bytearray) -> int:
        if data[0] == _END:
            self._next(self._read_word)
        return 1

    def _next(self, read: Callable[[memoryview, bytearray], int]) -> None:
        self._head.clear()
        self._read = read
