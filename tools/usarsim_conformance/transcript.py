"""What went over the wire during a check, short enough to print."""

from __future__ import annotations

import time
from collections import deque

_FIRST, _LAST = 30, 70
"""Entries kept from the beginning and from the end."""
_WIDTH = 300
"""Characters shown of one entry."""


class Transcript:
    """The first and the last things sent and received; bounded, whatever a server pours out."""

    def __init__(self) -> None:
        self._begun = time.monotonic()
        self._first: list[str] = []
        self._last: deque[str] = deque(maxlen=_LAST)
        self._count = 0

    def sent(self, who: str, data: bytes) -> None:
        """Note bytes that the kit sent."""
        self._add(f"{who} > {_shown(data)}")

    def received(self, who: str, data: bytes) -> None:
        """Note bytes that came from the server."""
        self._add(f"{who} < {_shown(data)}")

    def note(self, who: str, text: str) -> None:
        """Note something else: opened, closed, reset."""
        self._add(f"{who} * {text}")

    def entries(self) -> tuple[str, ...]:
        """What was kept, in order; a line of its own tells how much was left out."""
        left_out = self._count - len(self._first) - len(self._last)
        gap = (f"... {left_out} more ...",) if left_out else ()
        return (*self._first, *gap, *self._last)

    def _add(self, text: str) -> None:
        entry = f"{time.monotonic() - self._begun:8.3f} {text}"
        self._count += 1
        if len(self._first) < _FIRST:
            self._first.append(entry)
        else:
            self._last.append(entry)


def _shown(data: bytes) -> str:
    """Bytes as text with line ends visible, cut in the middle if long."""
    head, tail = data, b""
    if len(data) > _WIDTH:
        head, tail = data[: _WIDTH * 2 // 3], data[-_WIDTH // 3 :]
    text = _visible(head)
    return text + f" ...({len(data)} bytes)... " + _visible(tail) if tail else text


def _visible(data: bytes) -> str:
    signs = {10: "\\n", 13: "\\r", 9: "\\t", 92: "\\\\"}
    return "".join(
        signs.get(byte) or (chr(byte) if 32 <= byte < 127 else f"\\x{byte:02x}") for byte in data
    )
