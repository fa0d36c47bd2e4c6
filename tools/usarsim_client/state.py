"""What one connection has been told so far: lines in, typed values out; no sockets, no clock."""

from __future__ import annotations

import math
import re
from typing import TypeVar

from usarsim_client.decoder import Value, decode
from usarsim_client.depth import DepthPictures
from usarsim_client.readings import DepthStrip
from usarsim_client.reports import Status, Tick
from usarsim_server.protocol.values import Dialect

Kind = TypeVar("Kind")

MOST_KEPT = 1024
"""Newest values kept, one for each kind and name; a server that invents names bloats nobody."""

_UDK_TIME = re.compile(rb"\{Time -?\d+\.\d{4}\}", re.IGNORECASE)


class RobotState:
    """The newest value of each item of a robot.

    Attributes:
        time: newest simulated s that a line told; NaN before.
        ticks: of lockstep so far.
        lines: so far.
    """

    def __init__(self) -> None:
        self.time = math.nan
        self.ticks = 0
        self.lines = 0
        self._status = b""
        self._depth = DepthPictures()
        self._newest: dict[tuple[type, str], Value] = {}

    def feed(self, line: bytes) -> list[Value]:
        """Take a line without its end; returns what it tells."""
        self.lines += 1
        values: list[Value] = []
        for value in decode(line, self.time):
            values.append(value)
            if isinstance(value, DepthStrip) and (whole := self._depth.feed(value)) is not None:
                values.append(whole)
        for value in values:
            time: float = getattr(value, "time", math.nan)
            if time > self.time or math.isnan(self.time):
                self.time = time
            match value:
                case Tick():
                    self.ticks += 1
                case Status():
                    self._status = line
                case _:
                    pass
            key = type(value), getattr(value, "name", "").lower()
            if key not in self._newest and len(self._newest) >= MOST_KEPT:
                del self._newest[next(iter(self._newest))]
            self._newest[key] = value
        return values

    def newest(self, kind: type[Kind], name: str = "") -> Kind | None:
        """The newest value of a kind.

        Args:
            kind: class of the value, as `LaserScan`; of a base class any that derives from it.
            name: of the item, in any case; empty: whichever item reported first.
        """
        wanted = name.lower()
        for (_, one), value in tuple(self._newest.items()):  # threads may ask
            if isinstance(value, kind) and (not wanted or one == wanted):
                return value
        return None

    @property
    def dialect(self) -> Dialect | None:
        """Which dialect the server speaks here, by the digits of Time in STA; None before one."""
        if not self._status:
            return None
        return Dialect.UDK if _UDK_TIME.search(self._status) else Dialect.UT2004
