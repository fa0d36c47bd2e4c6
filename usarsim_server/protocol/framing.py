"""From bytes in any chunking to complete lines (protocol reference 1.4).

Goals: worst case linear in the number of bytes, however small the chunks are; memory bounded by
one line; a line that is too long is drained to its end and the connection lives on.
"""

from __future__ import annotations

import re

MAX_LINE = 65536
"""Longest accepted line in bytes, terminator excluded.

The original server had no limit and its script buffer simply grew; protocol reference 1.4 asks for
at least this much. The longest line any known client sends is a CONTROL AddWP path of a few
kilobytes. For comparison: h11 allows 16 KiB of HTTP header, nginx four buffers of 8 KiB.
"""

_TERMINATOR = re.compile(rb"[\r\n]+")


class LineFramer:
    """Cuts one connection's bytes into lines.

    CR, LF and any run of them end a line, so CR LF, LF CR and blank lines all work; empty lines
    are skipped. A rest without terminator is held and never becomes a line by itself.

    Args:
        max_line: longest accepted line in bytes; a line of exactly this length passes.
    """

    __slots__ = ("_draining", "_held", "discarded", "max_line")

    def __init__(self, max_line: int = MAX_LINE) -> None:
        if max_line < 1:
            raise ValueError(f"max_line must be at least 1, not {max_line!r}")
        self.max_line = max_line
        self.discarded = 0
        """Number of lines thrown away because they were too long."""
        self._held = bytearray()
        self._draining = False

    @property
    def pending(self) -> int:
        """Bytes held of a line whose terminator has not arrived; at most `max_line`."""
        return len(self._held)

    def feed(self, data: bytes) -> list[bytes]:
        """Take the next bytes and return the lines they complete, without terminators."""
        lines: list[bytes] = []
        first, *others = _TERMINATOR.split(data)
        self._hold(first)
        for part in others:
            if self._held:
                lines.append(bytes(self._held))
                self._held.clear()
            self._draining = False
            self._hold(part)
        return lines

    def _hold(self, part: bytes) -> None:
        """Append a piece of the current line, or give the line up if it grows too long."""
        if self._draining:
            return
        if len(self._held) + len(part) <= self.max_line:
            self._held += part
            return
        self._held.clear()
        self._draining = True
        self.discarded += 1
