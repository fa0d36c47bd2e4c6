"""Robots of a scenario file (`usar-mission/1`) that come into a running world, and go together.

Of the file only its robots count here; what else it says is a referee's. Its frame is MuJoCo's (y
left, z up), that of the gateway the protocol's.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from usarsim_client import ProtocolError, frames
from usarsim_operator.navigation import Place
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.lined import LinedTable, key_lines
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import parse_toml
from usarsim_server.protocol.values import Vector

if TYPE_CHECKING:
    from usarsim_operator.station import Station

LONGEST = 60_000
"""Characters of a scenario that a page may send."""
_NAME = Path("scenario")  # what errors call it


@dataclass(frozen=True, slots=True)
class Member:
    """A robot of a scenario.

    Attributes:
        name, kind: of it; kind is its class. start: tag of a start pose; None: `place` (m) and
            `yaw` (rad) count, in the protocol's frame.
        policy: what it does alone. route: of a patrol, m.
    """

    name: str
    kind: str
    start: str | None
    place: Vector | None
    yaw: float
    policy: str
    route: tuple[Place, ...]


def read_fleet(text: str) -> tuple[str, list[Member]]:
    """Title and robots of a scenario file.

    Raises:
        ValueError: with the line and what to write there.
    """
    try:
        content = parse_toml(text, _NAME, UsarsimError, "robot")
        top = LinedTable.top(content, _NAME, UsarsimError, lambda: key_lines(text))
        if (schema := top.text("schema")) != "usar-mission/1":
            raise top.error("schema", f"{schema!r} is not known", 'write "usar-mission/1"')
        members = [_member(one) for one in top.tables("robot")]
        if not members:
            raise top.error("robot", "there is no robot", "add a [[robot]] table with a name")
        return top.text("title"), members
    except UsarsimError as error:
        raise ValueError(str(error)) from None


def _member(table: Table) -> Member:
    place = frames.flip(table.vector("position")) if table.has("position") else None
    route = table.raw("route") or []
    try:
        way = tuple((float(x), -float(y)) for x, y in route)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise table.wrong("route", route, "a list of places [x, y]") from None
    found = Member(
        table.word("name"),
        table.text("class", "P3AT"),
        table.text("start") if table.has("start") else None,
        place,
        -math.radians(table.number("yaw_degrees", 0.0)),
        table.text("unattended", "stop"),
        way,
    )
    table.finish()
    return found


async def load(station: Station, members: list[Member]) -> None:
    """Bring all robots of a scenario, or none.

    Raises:
        ValueError: why not.
    """
    come: list[str] = []
    try:
        for one in members:
            turn = None if one.place is None else (0.0, 0.0, one.yaw)
            driven = await station.spawn(one.kind, one.name, one.start, one.place, turn)
            come.append(driven.name)
            if one.policy != "stop":
                station.autonomy.set(driven, one.policy, one.route, "the scenario")
    except (ProtocolError, OSError, TimeoutError, ValueError) as error:
        await close(station, come)
        raise ValueError(f"{one.name} cannot come: {error}") from None


async def close(station: Station, robots: list[str] | None = None) -> int:
    """Let robots go, all of the gateway's if none are named; how many."""
    own = [one.name for one in station.robots.values() if one.own]
    going = own if robots is None else [name for name in robots if name in own]
    for name in going:
        with contextlib.suppress(ProtocolError, OSError, TimeoutError):
            await station.remove(name)
    return len(going)
