"""A station whose clock is turned by hand: robots that note what they are told, pages that collect.

Everything between a page's text and the bytes for a robot is the gateway's own; only sockets and
the clock are not there, so that limits in milliseconds are held by a test on a busy machine, too.
"""

from __future__ import annotations

import asyncio
import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from usarsim_client import decoder
from usarsim_operator.pages import Page
from usarsim_operator.pulse import WATCH, Pulse
from usarsim_operator.requests import Desk
from usarsim_operator.robot_link import Driven
from usarsim_operator.roles import Role
from usarsim_operator.station import Settings, Station

Message = dict[str, Any]


class VirtualPage:
    """A page with everything that it was sent."""

    def __init__(self, station: VirtualStation, name: str, role: Role, seat: int = 1) -> None:
        self.texts: list[Message] = []
        self.frames: list[bytes] = []
        self.stalled = asyncio.Event()
        self.stalled.set()
        self._ids = itertools.count(1)
        self._station = station
        self.page = Page(station.new_id(), name, role, self, station.now, seat=seat)
        station.join(self.page)
        self.task = asyncio.create_task(self.page.send_all())

    async def send_str(self, data: str, compress: int | None = None) -> None:
        await self.stalled.wait()
        self.texts.append(json.loads(data))

    async def send_bytes(self, data: bytes, compress: int | None = None) -> None:
        await self.stalled.wait()
        self.frames.append(data)

    def say(self, type: str, **fields: Any) -> None:
        """Say something."""
        self._station.desk.hear(self.page, json.dumps({"type": type, **fields}))

    async def ask(self, type: str, **fields: Any) -> Message:
        """Say something that is answered at once."""
        number = next(self._ids)
        self.say(type, id=number, **fields)
        await self._station.settle()
        return next(one for one in self.texts if one.get("id") == number)

    @property
    def alarms(self) -> list[tuple[str, str]]:
        """Robot and kind of what it was told last, except what is acknowledged."""
        states = [one for one in self.texts if one["type"] == "state"]
        rows = states[-1]["alarms"] if states else []
        return [(one["robot"], one["kind"]) for one in rows if not one["acknowledged"]]


class VirtualStation(Station):
    """Use inside an event loop; `end` it.

    Attributes:
        clock: s. wire: when, to which robot, what.
        notes: what the log was told.
    """

    def __init__(self, latch: Path | None = None, **more: Any) -> None:
        self.clock = 100.0
        self.wire: list[tuple[float, str, bytes]] = []
        self.notes: list[tuple[str, Message]] = []
        super().__init__(Settings("127.0.0.1", 1, latch=latch, **more))
        self.desk, self.pulse = Desk(self), Pulse(self)

    @property
    def now(self) -> float:
        return self.clock

    def _note(self, what: str, facts: Any) -> None:
        self.notes.append((what, dict(facts)))

    def spawned(self, name: str) -> Driven:
        """A robot of the gateway."""

        async def send(data: bytes) -> None:
            self.wire.append((self.clock, name, data))

        return self._add(name, "P3AT", send, own=True)

    def hear(self, name: str, line: str) -> None:
        """A robot reports."""
        driven = self.robots[name]
        for value in decoder.decode(line.encode(), self.clock - 100.0):
            self._heard(driven, value)

    async def settle(self) -> None:
        """Let all tasks do what they can do now."""
        for _ in range(8):
            await asyncio.sleep(0)

    async def run(self, seconds: float, each: Callable[[], None] = lambda: None) -> None:
        """Let time pass; `each` is called before each beat."""
        end = self.clock + seconds
        while self.clock < end - 1e-9:
            self.clock = min(self.clock + WATCH, end)
            each()
            self.pulse.beat()
            await self.settle()

    def told(self, robot: str, since: float = 0.0) -> list[tuple[float, bytes]]:
        """What a robot was told since a moment."""
        return [(time, data) for time, name, data in self.wire if name == robot and time >= since]

    async def end(self, *pages: VirtualPage) -> None:
        for page in pages:
            page.task.cancel()
        for robot in list(self.robots.values()):
            await robot.close()
