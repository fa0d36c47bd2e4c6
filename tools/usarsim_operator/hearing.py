"""Which lines of a robot are worth reading, decided by their first bytes; sans-IO.

A robot with every usual sensor tells ninety lines a second, and a page shows a tenth of them. What
nobody sees is not taken apart: of most sensors only their names are noted, so that their ages and
rates are known.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from enum import Enum

from usarsim_operator.telemetry import SOURCES, Telemetry

STATUS = 0.2
"""s of the gateway's clock between two STA that are read."""
GLANCE = 0.5
"""s between two scans that are read of a robot that no page is about."""

_TYPE = re.compile(rb"\{\s*Type\s+([^}\s]+)", re.IGNORECASE)
_NAME = re.compile(rb"\{\s*Name\s+([^}\s]+)", re.IGNORECASE)
_SCANS = frozenset({"rangescanner", "irscanner"})
_NEEDED = frozenset({"touch", "toucharray", "sound"})
_POINTS = frozenset({"rangescanner3d", "3drangescanner", "rangeimager", "pcl", "linelaser"})
_MOST = 256  # types that are remembered


class Interest(Enum):
    """How much pages want to know of a robot; values are s that may pass between two reads."""

    NONE = 0.5
    """There is no page: answers to questions only."""
    ALL_ROBOTS = 0.1
    """It is one of many."""
    CHOSEN = 0.0
    """A page is about it, or drives it."""


class Ear:
    """Hears one robot.

    Attributes:
        interest: how much is wanted.
    """

    def __init__(self, telemetry: Telemetry, clock: Callable[[], float]) -> None:
        """telemetry: notes who was heard. clock: s of the gateway's."""
        self.interest = Interest.CHOSEN
        self._telemetry, self._clock = telemetry, clock
        self._types: dict[bytes, str] = {}
        self._read: dict[bytes, float] = {}

    def wants(self, line: bytes) -> bool:
        """Whether a line is to be taken apart."""
        head = line[:4].upper()
        if head == b"SEN ":
            return self.interest is not Interest.NONE and self._sensor(line)
        if head == b"STA ":
            return self.interest is not Interest.NONE and self._due(b"{STA}", STATUS)
        if head in (b"MISS", b"ASTA", b"EFF "):
            return self.interest is Interest.CHOSEN
        return True

    def _sensor(self, line: bytes) -> bool:
        found = _TYPE.search(line)
        if found is None:
            return True
        kind = self._types.get(found[1])
        if kind is None:
            kind = found[1].decode("latin-1")
            if len(self._types) < _MOST:
                self._types[found[1]] = kind
        lower = kind.lower()
        if lower in _NEEDED:
            return True
        chosen = self.interest is Interest.CHOSEN
        if kind in SOURCES:
            wanted = self._telemetry.prefers(kind, self._clock())
        elif lower in _SCANS:
            name = _NAME.search(line)
            wanted = chosen or self._due(name[1] if name else b"", GLANCE)
        else:
            wanted = chosen and lower in _POINTS
        if not wanted:
            now = self._clock()
            for name in _NAME.findall(line):
                self._telemetry.hear(name.decode("latin-1"), kind, now)
        return wanted

    def _due(self, key: bytes, period: float) -> bool:
        now = self._clock()
        if now - self._read.get(key, -1e9) < period:
            return False
        if len(self._read) >= _MOST:
            self._read.clear()
        self._read[key] = now
        return True
