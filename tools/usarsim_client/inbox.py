"""What has come from a server and was not read yet, and lines in it; no sockets."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

from usarsim_server.protocol.grammar import Command, parse_line

Read = TypeVar("Read")
Take = Callable[["Inbox"], Read | None]
"""Takes something out of an inbox if all of it is there, and otherwise leaves it alone."""
Wanted = str | Callable[["Line"], bool]
"""The line that is waited for: what it begins with, or a function that accepts it."""


class ProtocolError(Exception):
    """The server said something that the protocol does not know, or nothing in time."""


class HangupError(ProtocolError):
    """The server closed the connection."""


def command(*texts: str) -> bytes:
    """Commands as they are sent: one character per byte, each with its line end."""
    return "".join(f"{text}\r\n" for text in texts).encode("latin-1")


@dataclass(frozen=True)
class Line:
    """A line of the server; the grammar is that of `usarsim_server.protocol.grammar`."""

    raw: bytes  # all bytes, the line end included

    @cached_property
    def text(self) -> str:
        """Without the line end, one character per byte."""
        return self.raw.rstrip(b"\r\n").decode("latin-1")

    @cached_property
    def _command(self) -> Command:
        return next(iter(parse_line(self.raw.rstrip(b"\r\n"))), Command(""))

    @property
    def head(self) -> str:
        """The word before the first brace, in upper case: STA, SEN, NFO, CONF, GEO, RES."""
        return self._command.word

    @property
    def segments(self) -> tuple[tuple[str, str], ...]:
        """Name and value of what stands in braces; a value may hold further pairs."""
        return self._command.segments

    def get(self, name: str, default: str | None = None) -> str | None:
        """Value of the first segment of a name in any case."""
        return self._command.get(name, default)

    def numbers(self, name: str) -> tuple[float, ...]:
        """Value of a segment as numbers between commas; NaN in the place of what is none."""
        return tuple(map(_number, (self.get(name) or "").split(",")))

    @property
    def time(self) -> float:
        """Simulated s of the segment Time; NaN without one."""
        return self.numbers("Time")[0]

    def fits(self, wanted: Wanted) -> bool:
        """Whether it is the line that is waited for."""
        return self.text.startswith(wanted) if isinstance(wanted, str) else wanted(self)

    def __str__(self) -> str:
        return self.text


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


class Inbox:
    """Bytes in the order in which they came; the methods but `feed` are kinds of `Take`."""

    def __init__(self) -> None:
        self._held = bytearray()

    def feed(self, data: bytes) -> None:
        """Add what has come."""
        self._held += data

    def __len__(self) -> int:
        return len(self._held)

    @property
    def rest(self) -> bytes:
        """What is there."""
        return bytes(self._held)

    def everything(self) -> bytes | None:
        """What is there, at least a byte."""
        return self.exactly(len(self._held)) if self._held else None

    def exactly(self, count: int) -> bytes | None:
        """So many bytes."""
        if len(self._held) < count:
            return None
        taken = bytes(self._held[:count])
        del self._held[:count]
        return taken

    def until(self, mark: bytes) -> bytes | None:
        """Bytes up to and with an end mark."""
        found = self._held.find(mark)
        return self.exactly(found + len(mark)) if found >= 0 else None

    def line(self) -> Line | None:
        """A line, whatever stands before its LF."""
        raw = self.until(b"\n")
        return None if raw is None else Line(raw)
