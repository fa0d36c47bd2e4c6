"""The team of a scenario: `[team]` for what all robots have in common, `[[robot]]` for each.

Without `[[robot]]` a number is enough: robots start where the world has places for them, and the
formation says who explores and who carries news.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from usarsim_exploration.cycle import BASE, Member
from usarsim_exploration.environment import Cell
from usarsim_exploration.rules import TODAY, RunRules
from usarsim_exploration.strategy import Formation, Role
from usarsim_exploration.worlds import (
    DRAWS,
    Draw,
    World,
    draw_places,
    scale_of,
    settle,
    start_around,
)
from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table

MOST = 64
"""Robots of a team."""
NOBODY = "nobody"
_CURE = "write a free cell"


@dataclass(frozen=True, kw_only=True)
class Kit:
    """What a robot has; keys of `[team]` and of each `[[robot]]`."""

    speed: float = field(default=10.0, above=0.0, high=1000.0, unit="cells a step", help="drive")
    reach: int = field(
        default=100, low=1, high=2000, unit="cells", help="how far the range finder looks"
    )
    view: float = field(
        default=180.0, low=1.0, high=360.0, unit="degrees", help="its field of view, 181 rays"
    )
    noise: float = field(
        default=0.0, low=0.0, high=100.0, unit="cells",
        help="standard deviation of readings of walls",
    )  # fmt: skip
    radio: float = field(
        default=200.0, low=0.0, high=10_000.0, unit="cells", help="range of the radio"
    )


@dataclass(frozen=True, kw_only=True)
class Team(Kit):
    """Keys of `[team]`."""

    robots: int = field(default=4, low=1, high=MOST, help="how many, if there is no `[[robot]]`")
    formation: Literal["explorers", "pairs", "chain", "of the strategy"] = field(
        default="of the strategy",
        help="who reports to whom, where `[[robot]]` does not say it: all to the base; relay and "
        "explorer in turn; or one behind the other, the last one explores",
    )
    base: tuple[int, int] | Draw | None = field(
        default=None, low=0, unit="cells", words={one: one for one in DRAWS},
        help="column and row of the base; the world's; or drawn by the seed: away from walls, "
        "beside one, or where most room is, and so are the robots' starts",
    )  # fmt: skip
    base_radio: float | None = field(
        default=None, low=0.0, high=10_000.0, unit="cells", help="range of its radio; the team's"
    )


@dataclass(frozen=True, kw_only=True)
class Robot(Kit):
    """Keys of `[[robot]]`; those of `[team]` beside."""

    name: str = field(default="", help="default R1, R2, ...")
    start: tuple[int, int] | None = field(
        default=None, low=0, unit="cells", help="column and row; default a place near the base"
    )
    heading: float = field(
        default=0.0, low=-360.0, high=360.0, unit="degrees", help="clockwise from the right"
    )
    role: Literal["explorer", "relay", "of the formation"] = field(
        default="of the formation", help="at the start"
    )
    parent: str = field(default="", shown="of the formation", help="whom it reports to; or nobody")
    child: str = field(
        default="", shown="of the formation", help="whom it collects from; or nobody"
    )


def read_team(
    table: Table,
    world: World,
    formation: Formation,
    seed: int,
    rules: RunRules = TODAY,
    *,
    bodies: bool = False,
) -> tuple[Member, ...]:
    """The members, the base first.

    Args:
        table: of the whole scenario. world: for places. formation: if the file names none.
        seed: of places that are drawn. rules: of the run. bodies: robots have some.

    Raises:
        ExplorationError: naming the robot, what is wrong with it, and the cure.
    """
    inner = table.table("team")
    team = inner.read(Team)
    if team.formation != "of the strategy":
        formation = team.formation
    scale = scale_of(world.environment.cell) if bodies and rules.starts else 1.0
    if isinstance(team.base, str):
        world = draw_places(world.environment, world.title, team.base, seed, scale)
    base = world.base if team.base is None or isinstance(team.base, str) else team.base
    if not world.environment.is_free(base):
        raise inner.error("base", f"{list(base)} is a wall or outside", _CURE)
    kit = Robot(
        speed=team.speed, reach=team.reach, view=team.view, noise=team.noise, radio=team.radio
    )
    rows = table.tables("robot")
    if rows and inner.has("robots") and team.robots != len(rows):
        problem = f"{team.robots} are announced, {len(rows)} are described"
        raise inner.error("robots", problem, "remove it: each [[robot]] is one")
    inner.finish()
    robots = [row.read(Robot, kit) for row in rows] or [kit] * team.robots
    if len(robots) > MOST:
        raise table.error("robot", f"{len(robots)} are too many", f"describe at most {MOST}")
    names = ["Base", *(one.name or f"R{number}" for number, one in enumerate(robots, 1))]
    radio = team.radio if team.base_radio is None else team.base_radio
    found = [Member("Base", "base", base, reach=0, radio_range=radio, parent=None)]
    starts = world.starts
    if base != world.base and rules.starts:
        starts = start_around(world.environment, base, scale)
    elif base != world.base:
        stated_outside = not world.environment.inside[base[1], base[0]]
        starts = settle(world.environment, world.title, base, anywhere=stated_outside).starts
    places = [cell for cell in starts if cell != base]
    for number, robot in enumerate(robots, 1):
        row = rows[number - 1] if rows else inner
        if names.index(names[number]) != number:
            raise row.error("name", f"{names[number]!r} is taken", "give each robot its own")
        start = robot.start or _place(places, number, base)
        if not world.environment.is_free(start):
            raise row.error("start", f"{list(start)} is a wall or outside", _CURE)
        role, parent, child = _station(formation, number, len(robots))
        if robot.role != "of the formation":
            role = robot.role
        found.append(
            Member(
                names[number], role, start, math.radians(robot.heading),
                robot.speed, robot.reach, math.radians(robot.view), robot.radio,
                _number(row, "parent", robot.parent, names, parent),
                _number(row, "child", robot.child, names, child), robot.noise,
            )
        )  # fmt: skip
        if rows:
            row.finish()
    return tuple(found)


def written(team: tuple[Member, ...]) -> dict[str, object]:
    """A team as tables of a scenario that say everything."""
    base, *robots = team
    return {
        "team": {"base": list(base.cell), "base_radio": base.radio_range},
        "robot": [
            {
                "name": one.name,
                "start": list(one.cell),
                "heading": round(math.degrees(one.heading), 9),
                "role": one.role,
                "parent": NOBODY if one.parent is None else team[one.parent].name,
                "child": NOBODY if one.child is None else team[one.child].name,
                "speed": one.speed,
                "reach": one.reach,
                "view": round(math.degrees(one.view), 9),
                "noise": one.noise,
                "radio": one.radio_range,
            }
            for one in robots
        ],
    }


def _place(places: list[Cell], number: int, base: Cell) -> Cell:
    """A start of the world; more robots than it has places share these."""
    return places[(number - 1) % len(places)] if places else base


def _station(formation: Formation, number: int, count: int) -> tuple[Role, int | None, int | None]:
    """Role, parent and child of a robot."""
    if formation == "chain":
        last = number == count
        return ("explorer", number - 1, None) if last else ("relay", number - 1, number + 1)
    if formation == "pairs":
        if number % 2 == 0:
            return "explorer", number - 1, None
        if number < count:
            return "relay", BASE, number + 1
    return "explorer", BASE, None


def _number(table: Table, key: str, name: str, names: list[str], default: int | None) -> int | None:
    if not name:
        return default
    found = table.choice(key, [*names, NOBODY])
    return None if found == NOBODY else names.index(found)
