"""Plays the inputs of a recorded session again, through the rules of a gateway, in lockstep.

    usarsim serve --world arena --seed 7 --lockstep --port 3001 --scene-port 3002
    python -m usarsim_operator.replay session.rec --connect 127.0.0.1:3001 --scene-port 3002

Each input counts at the tick at which it counted then. At a fresh server with the same world, seed
and robots, every robot is told the same bytes at the same ticks, and the world ends in the same
state to the last bit; the program compares both with the recording, and exits with 1 if they
differ.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import math
import re
import sys
from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from usarsim_operator.pages import Page
from usarsim_operator.pulse import Pulse
from usarsim_operator.recording import Recording, Text
from usarsim_operator.requests import Desk
from usarsim_operator.roles import Role
from usarsim_operator.station import Settings, Station
from usarsim_server.base.addresses import split_address
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.private import secret

_PING = re.compile(r'"type"\s*:\s*"ping"')

Sent = tuple[int, str, str]
"""Tick, robot, what it was told."""


@dataclass(frozen=True, slots=True)
class Said:
    """Something that counted at a tick.

    Attributes:
        tick: how many had passed. page: id of who said it.
        text: as sent; None: the page came or went. role, name, on, seat: of such a page.
    """

    tick: int
    page: int
    text: str | None = None
    role: str = "operator"
    name: str = ""
    on: bool = True
    seat: int = 1


@dataclass(slots=True)
class Session:
    """What a log tells of a session in lockstep; also an observer that writes one.

    Attributes:
        robots: name and class of those that were there from the beginning.
        said: all inputs in order. sent: what robots were told, in order.
        states: digests of the world, by simulated s. ticks: how many have passed.
    """

    robots: list[tuple[str, str]] = field(default_factory=list)
    said: list[Said] = field(default_factory=list)
    sent: list[Sent] = field(default_factory=list)
    states: dict[float, str] = field(default_factory=dict)
    ticks: int = 0
    station: Station | None = None

    def take(self, kind: str, facts: Mapping[str, Any]) -> None:
        """Read an entry of a log; others than those of lockstep are passed over."""
        tick = facts.get("tick")
        if kind == "world":
            self.states[float(facts["at"])] = str(facts["state"])
        if tick is None:
            return
        self.ticks = max(self.ticks, int(tick))
        match kind:
            case "lockstep":
                self.robots = [(one["name"], one["class"]) for one in facts["robots"]]
            case "input":
                text = facts["text"]
                text = text if isinstance(text, str) else json.dumps(text)
                if not _PING.search(text):  # which no rule hears
                    self.said.append(Said(tick, facts["page"], text))
            case "connect":
                about = facts["role"], facts["name"], facts["on"], facts.get("seat", 1)
                self.said.append(Said(tick, facts["page"], None, *about))
            case "sent":
                self.sent.append((tick, facts["robot"], facts["text"]))

    # -- as an observer -----------------------------------------------------------------------

    def input(self, page: Page, text: str, heard: float) -> None:
        """See `Observer`."""
        lockstep = None if self.station is None else self.station.lockstep
        if lockstep is not None:
            self.take("input", {"tick": lockstep.tick, "page": page.id, "text": text})

    def note(self, kind: str, facts: Mapping[str, object]) -> None:
        """See `Observer`."""
        self.take(kind, facts)

    def event(self, fields: Mapping[str, object]) -> None:
        """See `Observer`."""


def session_of(recording: Recording) -> Session:
    """What a recording tells.

    Raises:
        UsarsimError: if it cannot be read, or was not taken in lockstep.
    """
    session = Session()
    for entry in recording:
        if isinstance(entry, Text):
            session.take(str(entry.fields.get("type")), entry.fields)
    if not session.robots:
        raise UsarsimError(
            "no session in lockstep is recorded there (record one: usarsim serve --lockstep, "
            "usarsim console --record FILE)"
        )
    return session


class Player:
    """Says again what pages said, each text at its tick; one of `Lockstep.before`."""

    def __init__(self, station: Station, said: Iterable[Said]) -> None:
        self._station, self._desk = station, Desk(station)
        self._said = list(said)
        self._next = 0
        self._pages: dict[int, Page] = {}

    def __call__(self, tick: int) -> None:
        """Put what was said at a tick where the gateway finds it."""
        while self._next < len(self._said) and self._said[self._next].tick <= tick:
            self._say(self._said[self._next])
            self._next += 1

    def _say(self, one: Said) -> None:
        station = self._station
        assert station.lockstep is not None
        if one.text is not None:
            if (page := self._pages.get(one.page)) is not None:
                station.lockstep.hear(self._desk, page, one.text)
        elif one.on:
            role = Role(one.role)
            page = Page(one.page, one.name, role, None, station.now, seat=one.seat)
            station._page_ids = itertools.count(max(one.page + 1, station.new_id()))
            self._pages[one.page] = page
            station.join(page)
        elif (page := self._pages.pop(one.page, None)) is not None:
            page.end()
            station.leave(page)


Spawn = Callable[[Station], Awaitable[None]]
"""Brings the robots into the world that were there from the beginning."""


async def replay(settings: Settings, session: Session, spawn: Spawn | None = None) -> Session:
    """Play a session again at a fresh server in lockstep, as fast as it goes.

    Args:
        settings: of the gateway; pace and latch do not matter.
        session: what was logged.
        spawn: see there; None: one after the other at the next start place, as `--robot` does.

    Returns:
        The same of this time; of the states of the world the last one, at least.

    Raises:
        OSError, ProtocolError: if the server is not there or refuses.
        TimeoutError: if the scene port is given and does not tell the state of the world.
    """
    given = Settings(
        settings.host,
        settings.port,
        settings.image_port,
        settings.scene,
        settings.scene_token,
        lockstep=True,
        pace=math.inf,
    )
    station = Station(given)
    again = Session(station=station)
    station.observers.add(again)
    try:
        await station.open()
        if spawn is not None:
            await spawn(station)
        else:
            for name, class_name in session.robots:
                await station.spawn(class_name, name)
        lockstep, pulse = station.lockstep, Pulse(station)
        assert lockstep is not None
        lockstep.loses = False
        lockstep.before.append(Player(station, session.said))
        while lockstep.tick < session.ticks:
            await lockstep.round(pulse)
        if given.scene is not None:
            again.states[round(lockstep.time, 6)] = await lockstep.state()
        again.ticks = lockstep.tick
    finally:
        await station.close()
    return again


def differences(then: Session, now: Session) -> list[str]:
    """Where two sessions differ in what robots were told and in the state of the world."""
    found = []
    end = min(then.ticks, now.ticks)
    first, second = ([one for one in side.sent if one[0] < end] for side in (then, now))
    for one, other in itertools.zip_longest(first, second):
        if one != other:
            found.append(f"robots were told {one}, and now {other}")
            break
    for time in sorted(then.states.keys() & now.states.keys()):
        if then.states[time] != now.states[time]:
            found.append(f"the world is another one from {time:g} s on, at the latest")
            break
    return found


def main(arguments: list[str] | None = None) -> int:
    """Replay a recording; 0: all was the same, 1: it was not, 2: it could not be played."""
    parser = argparse.ArgumentParser(prog="python -m usarsim_operator.replay", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("recording", type=Path)
    parser.add_argument("--connect", metavar="HOST:PORT", default="127.0.0.1:3000")
    parser.add_argument("--scene-port", metavar="N", type=int)
    parser.add_argument("--scene-token", metavar="TEXT|FILE", default="")
    given = parser.parse_args(arguments)
    host, port = split_address(given.connect)
    scene = None if given.scene_port is None else (host, given.scene_port)
    try:
        then = session_of(Recording(given.recording))
        settings = Settings(host, int(port), 5003, scene, secret(given.scene_token))
        now = asyncio.run(replay(settings, then))
    except (UsarsimError, OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    found = differences(then, now)
    compared = len(then.states.keys() & now.states.keys())
    for one in found:
        print(one)
    print(
        f"{now.ticks} ticks, {len(now.said)} inputs, {len(now.sent)} commands to robots, "
        f"{compared} states of the world: {'not the same' if found else 'the same'}"
    )
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main())
