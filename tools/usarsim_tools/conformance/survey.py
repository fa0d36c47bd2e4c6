"""What kind of server this is: its greeting, its places, its robots and the dialects it speaks."""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from usarsim_tools.conformance.control import ControlClient
from usarsim_tools.conformance.lines import Line
from usarsim_tools.conformance.places import Place, place_from, read_start_poses, spaced
from usarsim_tools.conformance.registry import DIALECTS
from usarsim_tools.conformance.transcript import Transcript
from usarsim_tools.conformance.verdicts import Failed
from usarsim_tools.conformance.wire import Wire

__all__ = ["GROUND", "Survey", "Target", "dialect_of", "survey"]

GROUND = ("P2AT", "P3AT", "P2DX", "P3DX", "pioneer3at_with_sensors")
"""Classes tried, in this order, if the user names none; every known server had one of them."""

_SPAWNS = 4.0
"""s until a robot is given up; twice what protocol reference 6.5.70 allows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """The server to judge, as the user describes it.

    Attributes:
        host: its address.
        ports: by service; services without a port are not judged.
        robot: class for most checks; None to try those of `GROUND`.
        start: where to put robots, as `places.place_from` reads it; None for all start poses.
        dialect: the only one to judge; None for all that it speaks.
    """

    host: str = "127.0.0.1"
    ports: Mapping[str, int] = field(default_factory=lambda: {"control": 3000})
    robot: str | None = None
    start: str | None = None
    dialect: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """What was found out before the checks.

    Attributes:
        greeting: its first line, or None.
        places: where robots can be put.
        robot: class that could be spawned, or None.
        native: dialect that it speaks if not asked for any; empty without a robot.
        dialects: those to judge, each with the segment of INIT that asks for it.
    """

    greeting: Line | None
    places: tuple[Place, ...]
    robot: str | None
    native: str
    dialects: Mapping[str, str]


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


async def survey(target: Target, transcript: Transcript) -> Survey:
    """Look the server over with a few connections.

    Raises:
        Failed: if its control port cannot be reached.
    """
    client = await _connect(target, transcript)
    greeting = await client.line(2.0)
    starts: list[Place] = []
    try:
        reply = await client.ask("GETSTARTPOSES", "NFO {StartPoses")
        starts = read_start_poses(reply)
    except Failed:
        pass  # a check will say so
    finally:
        client.close()
    places = spaced(starts) or [Place(None)]
    if target.start is not None:
        places = [_named(place_from(target.start), starts)]
    for robot in (target.robot,) if target.robot else GROUND:
        status = await _status(target, transcript, robot, places[0], "")
        if status is not None:
            native = dialect_of(status)
            dialects = await _dialects(target, transcript, robot, places, native)
            return Survey(
                greeting=greeting,
                places=tuple(places),
                robot=robot,
                native=native,
                dialects=dialects,
            )
    wanted = target.dialect or DIALECTS[0]
    return Survey(
        greeting=greeting, places=tuple(places), robot=None, native="", dialects={wanted: ""}
    )


async def _dialects(
    target: Target, transcript: Transcript, robot: str, places: list[Place], native: str
) -> dict[str, str]:
    """Dialects to judge. Legacy servers know no segment Dialect, and pass it over."""
    found = {native: ""} if native else {}
    wanted = DIALECTS if target.dialect is None else (target.dialect,)
    others = [dialect for dialect in wanted if dialect != native]

    async def speaks(dialect: str, place: Place) -> bool:
        segment = f" {{Dialect {dialect}}}"
        status = await _status(target, transcript, robot, place, segment)
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


async def _status(
    target: Target, transcript: Transcript, robot: str, place: Place, extra: str
) -> Line | None:
    """The first STA of a new robot, or None."""
    client = await _connect(target, transcript)
    try:
        init = f"INIT {{ClassName USARBot.{robot}}} {{Name Survey}} {place.segments}{extra}"
        await client.send(init)
        return await client.maybe("STA", _SPAWNS)
    except Failed:
        return None
    finally:
        client.close()


async def _connect(target: Target, transcript: Transcript) -> ControlClient:
    wire = await Wire.open(target.host, target.ports["control"], transcript, "survey")
    return ControlClient(wire)


def _named(place: Place, starts: list[Place]) -> Place:
    """The start pose that has the tag of a place, with its coordinates."""
    tag = (place.tag or "").lower()
    return next((start for start in starts if (start.tag or "").lower() == tag), place)
