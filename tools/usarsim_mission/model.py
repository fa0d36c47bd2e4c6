"""What the referee knows of a mission and its world, as `world.json` of a run keeps it.

All in the frame of MuJoCo: x forward, y to the left, z up; metres, seconds and radians.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from usarsim_mission.errors import MissionError
from usarsim_mission.grid import Grid
from usarsim_server.base.errors import at
from usarsim_server.base.fields import field, keys
from usarsim_server.base.files import read_regular, reason
from usarsim_server.base.tables import Table, Vector, finite
from usarsim_server.protocol.json_text import parse_json

Point = tuple[float, float]
Colour = Literal["yellow", "orange", "red", "blue"]
COLOURS: tuple[str, ...] = get_args(Colour)

MAX_WORLD = 64 << 20
"""Bytes of a `world.json`: a grid of 4000 by 4000 cells is packed into a few hundred kB."""


@dataclass(frozen=True, slots=True)
class Victim:
    """Somebody to be found."""

    name: str = field(help="as the truth of the server calls it")
    pos: Vector = field(unit="m", help="middle of the body at the start")
    status: str = field(default="", help="what a mark has to say of it")


def _points(table: Table, key: str) -> tuple[Point, ...]:
    """The corners of a polygon.

    Raises:
        MissionError: they are less than three pairs of finite numbers.
    """
    pairs = table.raw(key)
    wanted = "a list of at least three points such as [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]]"
    if not isinstance(pairs, list) or len(pairs) < 3:
        raise table.wrong(key, pairs, wanted)
    points = []
    for pair in pairs:
        numbers = [finite(one) for one in pair] if isinstance(pair, list) else []
        if len(numbers) != 2 or numbers[0] is None or numbers[1] is None:
            raise table.wrong(key, pair, "a point", wanted)
        points.append((numbers[0], numbers[1]))
    return tuple(points)


@dataclass(frozen=True, slots=True)
class Zone:
    """A part of the floor with a rule; a blue one is a band in which the operator may take over."""

    name: str = field(help="unlike that of any other zone")
    colour: Colour = field(help="what the scoring file gives rules for")
    points: tuple[Point, ...] = field(
        parse=_points, expects="a list of points [x, y]", help="corners of the polygon, m"
    )


@dataclass(frozen=True, slots=True)
class Fan:
    """What a sensor of a robot covers: a sector of the floor."""

    range: float = field(unit="m", above=0.0, help="how far it sees")
    fov: float = field(default=6.3, unit="rad", above=0.0, help="opening; 6.3 is all around")
    yaw: float = field(default=0.0, unit="rad", help="of its axis, left positive")


@dataclass(frozen=True, slots=True)
class Start:
    """A robot of the mission and where it begins."""

    name: str = field(help="as INIT gives it")
    kind: str = field(key="class", default="", help="class of the robot")
    pos: Vector = field(default=(0.0, 0.0, 0.0), unit="m", help="where it begins")
    yaw: float = field(default=0.0, unit="rad", help="where it looks, left positive")
    sensors: tuple[Fan, ...] = field(default=(), help="what counts as area seen")


@dataclass(frozen=True, slots=True)
class Mission:
    """What is agreed for a run.

    Attributes:
        time_limit: of the trial; None leaves it to the scoring file.
        band: how far a blue band reaches into each of two zones of different rule.
        ends_when_all_credited: the trial ends when the last victim is credited.
        operators: how many; None leaves it to the scoring file.
    """

    name: str = field(default="", help="of the mission")
    seed: int = field(default=0, low=0, high=2**63 - 1, help="that all others follow from")
    time_limit: float | None = field(default=None, unit="s", above=0.0, help="of the trial")
    band: float = field(default=1.0, unit="m", low=0.0, high=100.0, help="each side of a border")
    ends_when_all_credited: bool = field(default=False, help="ends with the last victim")
    operators: int | None = field(default=None, low=1, high=1000, help="how many operators")


def _grid(table: Table, key: str) -> Grid:
    try:
        return Grid.unpacked(table.free(key))
    except ValueError as error:
        raise table.error(key, str(error), "write it by Grid.packed()") from None


@dataclass(frozen=True, slots=True)
class World:
    """What is true in the world: places of victims and robots, zones, floor and walls."""

    title: str = field(default="", help="of the world")
    low: Vector = field(default=(-1e3, -1e3, -1e3), unit="m", help="least corner of its bounds")
    high: Vector = field(default=(1e3, 1e3, 1e3), unit="m", help="greatest corner")
    victims: tuple[Victim, ...] = field(default=(), help="all of them")
    zones: tuple[Zone, ...] = field(default=(), help="all of them, given blue bands too")
    starts: tuple[Start, ...] = field(default=(), help="all robots of the mission")
    floor: Grid | None = field(
        default=None, parse=_grid, help="1 where robots can get from their starts, 2 walls, 0 else"
    )


def world_json(mission: Mission, world: World) -> str:
    """The text of `world.json`."""
    told = {"mission": plain(mission), **plain(world)}
    return json.dumps(told, indent=1, allow_nan=False) + "\n"


def read_world(path: Path) -> tuple[Mission, World]:
    """What a `world.json` tells.

    Raises:
        MissionError: it cannot be read, or something in it cannot be.
    """
    try:
        content = parse_json(read_regular(path, MAX_WORLD))
    except OSError as error:
        cure = "check the path and its rights"
        raise MissionError(at(path, f"cannot be read: {reason(error)}", cure)) from error
    except ValueError as error:
        cure = "take the file of another run of this mission"
        raise MissionError(at(path, f"is not valid JSON: {error}", cure)) from None
    if not isinstance(content, dict):
        raise MissionError(at(path, "is no object", "take the file of a run"))
    table = Table(content, path, MissionError)
    mission = table.one("mission", Mission, Mission())
    world = table.read(World)
    table.finish()
    return mission, world


def plain(value: Any) -> Any:
    """A declared value as JSON and TOML have it: dictionaries, lists and what stands in them."""
    if isinstance(value, Grid):
        return value.packed()
    if isinstance(value, tuple | list):
        return [plain(one) for one in value]
    if isinstance(value, Mapping):
        return {key: plain(one) for key, one in value.items()}
    cls: type = type(value)
    if not dataclasses.is_dataclass(cls):
        return value
    found = ((key.key, getattr(value, key.name)) for key in keys(cls))
    return {key: plain(one) for key, one in found if one is not None}
