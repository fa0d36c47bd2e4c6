"""What kind of server this is: its greeting, its places, its robots and the dialects it speaks."""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

from usarsim_conformance.clock import SimulatedClock
from usarsim_conformance.control import ControlClient
from usarsim_conformance.lines import Line
from usarsim_conformance.places import APART, Place, place_from, read_start_poses, spaced
from usarsim_conformance.registry import DIALECTS, Failed
from usarsim_conformance.wire import Transcript, Wire

GROUND = ("P2AT", "P3AT", "P2DX", "P3DX", "pioneer3at_with_sensors")
"""Classes tried, in this order, if the user names none; every known server had one of them."""

_GUESSES = 10.0
"""s until a class that nobody named is given up."""
_SPAWNS = 15.0
"""s until a class that there should be is given up."""
_ANSWERS = 10.0
"""s until an answer is given up."""
_CLEAR = 0.5
"""m of room for a robot to move in beside its own size."""
_REACH = 5.5
"""m between arms on fixed bases, which tell no size."""
_KEEPER = "KitClock"
"""Name of the robot that tells the time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """The server to judge, as the user describes it."""

    host: str = "127.0.0.1"  # its address
    ports: Mapping[str, int] = field(default_factory=lambda: {"control": 3000})
    """By service; services without a port are not judged."""
    robot: str | None = None  # class for most checks; None to try those of `GROUND`
    start: str | None = None
    """Where to put robots, as `places.place_from` reads it; None for all start poses."""
    dialect: str | None = None  # the only one to judge; None for all that it speaks
    staged: bool = False  # it is ours, in the world of the kit, with the usual robot


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """What was found out before the checks."""

    greeting: Line | None  # its first line, or None
    places: tuple[Place, ...]  # where robots can be put
    tilted: tuple[Place, ...] = ()  # start poses with a roll or a pitch, where most are not put
    robot: str | None  # class that could be spawned, or None
    native: str  # dialect that it speaks if not asked for any; empty without a robot
    dialects: Mapping[str, str]  # those to judge, each with the segment of INIT that asks for it
    timed: bool  # whether a robot stands aside and tells simulated time


def dialect_of(status: Line) -> str:
    """The dialect that an STA line looks like; empty if it is like none."""
    if re.search(r"\}\{", status.text) and "View" not in status.names:
        return "gazebo"
    digits = len((status.get("Time") or "").partition(".")[2])
    if digits in (2, 4):
        return "ut2004" if digits == 2 else "udk"
    if not status.segments or math.isnan(status.time):
        return ""
    return "ut2004" if status.names[0] == "Type" else "udk"


async def survey(target: Target, transcript: Transcript, clock: SimulatedClock) -> Survey:
    """Look the server over with a few connections, and set the clock by a robot.

    Raises:
        Failed: if its control port cannot be reached.
    """
    visit = _Visit(target, transcript, clock)
    client = await visit.connect()
    greeting, told = await _welcome(client)
    clock.ask_on(client.wire)
    tilted = tuple(place for place in told if place.is_tilted)
    starts = [place for place in told if not place.is_tilted] or told
    places = spaced(starts) or [Place(None)]
    if target.start is not None:
        places = [_named(place_from(target.start), told)]
    aside = _aside(places[0], starts)
    if len(places) > 1 and aside is not None:
        places = [place for place in places if place != aside]
    for robot in (target.robot,) if target.robot else GROUND:
        within = _SPAWNS if target.robot else _GUESSES
        client, status = await visit.robot(robot, places[0], within=within)
        apart = await _room(client) if status is not None else APART
        client.close()
        if status is None:
            continue
        if apart > APART and target.start is None:
            places = spaced(starts, apart) or places
            aside = _aside(places[0], places)
            places = [place for place in places if place != aside]
        if aside is not None:
            await clock.follow(partial(_keep, visit, robot, aside))
        native = dialect_of(status)
        return Survey(
            greeting=greeting,
            places=tuple(places),
            tilted=tilted,
            robot=robot,
            native=native,
            dialects=await _dialects(visit, robot, places, native),
            timed=clock.followed,
        )
    wanted = target.dialect or DIALECTS[0]
    return Survey(
        greeting=greeting,
        places=tuple(places),
        tilted=tilted,
        robot=None,
        native="",
        dialects={wanted: ""},
        timed=False,
    )


@dataclass(frozen=True, slots=True)
class _Visit:
    """What every connection of the survey needs."""

    target: Target
    transcript: Transcript
    clock: SimulatedClock

    async def connect(self) -> ControlClient:
        port = self.target.ports["control"]
        return ControlClient(
            await Wire.open(self.target.host, port, self.transcript, "survey", self.clock)
        )

    async def robot(
        self,
        class_name: str,
        place: Place,
        extra: str = "",
        name: str = "Survey",
        within: float = _SPAWNS,
    ) -> tuple[ControlClient, Line | None]:
        """A connection with a new robot, and its first STA if it has sent one."""
        client = await self.connect()
        try:
            await client.send(
                f"INIT {{ClassName USARBot.{class_name}}} {{Name {name}}} {place.segments}{extra}"
            )
            return client, await client.maybe("STA", within)
        except Failed:
            return client, None
        except BaseException:
            client.close()
            raise


async def _welcome(client: ControlClient) -> tuple[Line | None, list[Place]]:
    """The greeting, if there is one, and the start poses.

    They are asked for twice: a server without a greeting has answered by then, and is not waited
    for.
    """
    lines: list[Line] = []
    try:
        for _ in range(2):
            await client.send("GETSTARTPOSES")
            while (line := await client.line(_ANSWERS)) is not None:
                lines.append(line)
                if _lists_poses(line):
                    break
    except Failed:
        pass  # checks will say so
    greeting = lines[0] if lines and not _lists_poses(lines[0]) else None
    listed = [line for line in lines if _lists_poses(line)]
    return greeting, read_start_poses(listed[-1]) if listed else []


def _lists_poses(line: Line) -> bool:
    return line.head == "NFO" and "StartPoses" in line.names


def _aside(place: Place, starts: list[Place]) -> Place | None:
    """The start pose farthest from a place; None if there is no other."""
    others = [one for one in spaced(starts) if math.dist(one.location, place.location) > APART]
    return max(others, key=lambda one: math.dist(one.location, place.location), default=None)


async def _room(client: ControlClient) -> float:
    """How far apart robots of this class have to be put, m, for none to be in another's way."""
    try:
        await client.send("GETGEO {Type Robot}")
        geo = await client.maybe("GEO", _ANSWERS)
    except Failed:
        return APART
    if geo is None:
        return APART
    if "StaticPlatform" in geo.text:
        return _REACH
    size = [value for value in geo.numbers("Dimensions")[:2] if math.isfinite(value)]
    return max(APART, math.hypot(*size) + _CLEAR)


async def _keep(visit: _Visit, robot: str, aside: Place) -> Wire | None:
    """A robot that stands aside and tells the time."""
    client, status = await visit.robot(robot, aside, name=_KEEPER)
    if status is not None:
        return client.wire
    client.close()
    return None


async def _dialects(visit: _Visit, robot: str, places: list[Place], native: str) -> dict[str, str]:
    """Dialects to judge. Legacy servers know no segment Dialect, and pass it over."""
    target = visit.target
    found = {native: ""} if native else {}
    # Asked for by name even if it is the native one: other robot classes may have another.
    wanted = (target.dialect,) if target.dialect is not None else DIALECTS
    others = [dialect for dialect in wanted if dialect != native or target.dialect is not None]

    async def speaks(dialect: str, place: Place) -> bool:
        client, status = await visit.robot(robot, place, f" {{Dialect {dialect}}}")
        client.close()
        return status is not None and dialect_of(status) == dialect

    if len(places) > len(others):
        answers = await asyncio.gather(*map(speaks, others, places[1:]))
    else:
        answers = [await speaks(dialect, places[-1]) for dialect in others]
    for dialect, answer in zip(others, answers, strict=True):
        if answer:
            found[dialect] = f" {{Dialect {dialect}}}"
    if native and len(found) > 1:
        # It understands the segment, and other robot classes may have another native dialect.
        found[native] = f" {{Dialect {native}}}"
    if target.dialect is not None:
        # The user knows better than a look at one line.
        return {target.dialect: found.get(target.dialect, "")}
    return {name: found[name] for name in DIALECTS if name in found} or {DIALECTS[0]: ""}


def _named(place: Place, starts: list[Place]) -> Place:
    """The start pose that has the tag of a place, with its coordinates."""
    tag = (place.tag or "").lower()
    return next((start for start in starts if (start.tag or "").lower() == tag), place)
