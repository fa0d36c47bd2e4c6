"""Finds what of a mission cannot be: zones that overlap, starts in walls, victims out of reach.

Each finding is an error as others are, with file, line and cure; all of them are told at once.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np

from usarsim_mission.errors import ScoringError
from usarsim_mission.scenario import fleet
from usarsim_mission.scenario.description import Scenario
from usarsim_mission.scenario.staging import Staged
from usarsim_server.base.errors import UsarsimError, problem_and_advice
from usarsim_server.base.tables import Table
from usarsim_server.radio.configuration import read_radio
from usarsim_server.worlds.description import Victim, read_pose
from usarsim_server.worlds.polygons import overlap
from usarsim_server.worlds.surroundings import LiveVictim

IN_VIEW = 2.0
"""m from a victim, on the floor, from where a robot has to see some part of it."""
EYE = 0.4
"""m above the floor: of a camera."""
BURIED = 0.5
"""Share of a victim's parts that may be in a wall: limbs may lean on one."""
TRUNK = ("Head", "Chest", "Pelvis")
"""Between which there must be no wall, however thin."""
APART = 0.3
"""m between two robots' starts below which they are one place."""
OUTSIDE = 0.01
"""m by which a zone may be outside of the bounds."""


def findings(staged: Staged) -> list[UsarsimError]:
    """Everything that cannot be, in the order of the file's keys."""
    return list(
        itertools.chain(
            _robots(staged),
            _zones(staged),
            _nobody(staged),
            _victims(staged),
            _places(staged),
            _radio(staged),
        )
    )


def cautions(scenario: Scenario) -> list[str]:
    """What happens with some teams only: a line each."""
    names = [f"{event.name!r}" for event in scenario.events if event.do == "link_drops"]
    if not names:
        return []
    return [
        f"link_drops ({', '.join(names)}) acts on robots of the console; those that a team's own "
        "program brings keep their links, and the log says so"
    ]


def _robots(staged: Staged) -> Iterator[UsarsimError]:
    tables = staged.scenario.table.tables("robot")
    places = [robot.start.pose.position for robot in staged.robots]
    lower, upper = staged.base.lower, staged.base.upper
    inside = staged.ground.inside(np.array(places))
    for number, (table, robot) in enumerate(zip(tables, staged.robots, strict=True)):
        place = places[number]
        key = "start" if robot.entry.position is None else "position"
        twin = next((n for n in range(number) if math.dist(places[n], place) < APART), None)
        if not all(low <= x <= high for low, x, high in zip(lower, place, upper, strict=True)):
            yield table.error(key, f"{_shown(place)} is outside of the world", _bounds(staged))
        elif twin is not None:
            problem = f"{robot.entry.name} and {staged.robots[twin].entry.name} start at one place"
            yield table.error(key, problem, _another_start(staged))
        elif inside[number]:
            yield table.error(key, f"{_shown(place)} is within a wall", _another_start(staged))
        elif number in staged.reached.stuck and robot.description.kind not in fleet.FLOORLESS:
            problem = f"there is no floor with room for a {robot.description.name} there"
            yield table.error(key, problem, _another_start(staged))
        for x, y in robot.entry.route:
            if not len(staged.reached.near((x, y), 0.5)):
                problem = f"nobody gets to ({x:g}, {y:g})"
                yield table.error("route", problem, "name places on the floor that robots reach")


def _zones(staged: Staged) -> Iterator[UsarsimError]:
    """O-01: zones do not overlap; blue bands may lie on others."""
    tables = dict(zip(_own(staged), staged.scenario.table.tables("zone"), strict=True))
    top = staged.scenario.table
    (west, south, _), (east, north, _) = staged.base.lower, staged.base.upper
    for zone in staged.zones:
        for x, y in zone.points if zone.name in tables else ():
            in_x = west - OUTSIDE <= x <= east + OUTSIDE
            if not in_x or not south - OUTSIDE <= y <= north + OUTSIDE:
                problem = f"corner ({x:g}, {y:g}) is outside of the world"
                yield tables[zone.name].error("polygon", problem, _bounds(staged))
                break
    ruled = [zone for zone in staged.zones if zone.colour != "blue"]
    for one, other in itertools.combinations(ruled, 2):
        if overlap(one.points, other.points):
            table = tables.get(other.name) or tables.get(one.name) or top
            problem = f"zones {one.name} and {other.name} overlap"
            yield table.error("", problem, "let them share a border at most")
    names = [zone.name.lower() for zone in staged.zones]
    for name in sorted({name for name in names if names.count(name) > 1}):
        cure = "choose another name, or keep_zones = false"
        yield top.error("zone", f"the world has a zone called {name!r}, too", cure)


def _own(staged: Staged) -> list[str]:
    return [zone.name for zone in staged.scenario.zones]


def _nobody(staged: Staged) -> Iterator[UsarsimError]:
    table = staged.scenario.table
    if not staged.victims:
        cure = "add [[victim]] tables, or keep_victims = true"
        yield table.error("victim", "there is nobody to be found", cure)
        return
    try:
        staged.rules.check(len(staged.victims))
    except ScoringError as error:
        problem, advice = problem_and_advice(str(error))
        yield table.error("scoring", problem, advice or "choose another one")


def _victims(staged: Staged) -> Iterator[UsarsimError]:
    top = staged.scenario.table
    tables = {
        entry.name: table
        for entry, table in zip(staged.scenario.victims, top.tables("victim"), strict=True)
    }
    speed = max(fleet.speed_of(robot.description) for robot in staged.robots)
    for victim in staged.victims:
        table = tables.get(victim.name, top)
        problem = _unreachable(staged, victim, speed)
        if problem is not None:
            key = "position" if table.has("position") or table is top else "place"
            yield table.error(key, f"{victim.name} {problem[0]}", problem[1])


def _unreachable(staged: Staged, victim: Victim, speed: float) -> tuple[str, str] | None:
    """What is wrong with the place of a victim, and its cure."""
    place = victim.pose.position
    limits = zip(staged.base.lower, place, staged.base.upper, strict=True)
    if not all(low <= x <= high for low, x, high in limits):
        return f"is outside of the world at {_shown(place)}", _bounds(staged)
    body = LiveVictim(victim, 0).parts(0.0)
    parts = np.array([part.position for part in body])
    trunk = {part.name: part.position for part in body if part.name in TRUNK}
    ends = np.array([trunk["Head"], trunk["Pelvis"]])
    through = not staged.ground.sees(ends, trunk["Chest"]).all()
    if through or staged.ground.inside(parts).mean() > BURIED:
        return "is within a wall or below the floor", "move it out"
    near = staged.reached.near(place, IN_VIEW)
    eyes = near + np.array([0.0, 0.0, EYE])
    seen = np.zeros(len(near), dtype=bool)
    for part in parts:
        if len(near):
            seen |= staged.ground.sees(eyes, part)
    if not seen.any():
        what = f"gets within {IN_VIEW:g} m of it" if not len(near) else "gets to where it is seen"
        return f"cannot be reached: no robot {what}", "move it to where robots get"
    way = float(staged.reached.ways(near[seen]).min())
    needed, limit = way / speed, staged.scenario.time_limit
    if needed > limit:
        problem = f"is {way:.1f} m away, {needed:.0f} s at {speed:.2g} m/s"
        return problem, f"write time_limit = {math.ceil(needed)} or more, or move it"
    return None


def _places(staged: Staged) -> Iterator[UsarsimError]:
    """Each candidate has to do, whatever the seed."""
    scenario = staged.scenario
    content = scenario.content or {}
    if not content.get("place"):
        return
    speed = max(fleet.speed_of(robot.description) for robot in staged.robots)
    for table in scenario.table.tables("place"):
        victim = _stand_in(table)
        problem = _unreachable(staged, victim, speed)
        if problem is not None:
            yield table.error("position", f"whoever is there {problem[0]}", problem[1])


def _stand_in(table: Table) -> Victim:
    """Somebody in a place, as it is written."""
    posture = table.text("posture", "lying")
    return Victim("anybody", read_pose(table), posture)


def _radio(staged: Staged) -> Iterator[UsarsimError]:
    radio = staged.scenario.radio
    if radio:
        try:
            read_radio(radio, "radio")
        except UsarsimError as error:
            problem, advice = problem_and_advice(str(error))
            yield staged.scenario.table.error("radio", problem, advice or "see docs/wireless.md")


def _shown(place: tuple[float, float, float]) -> str:
    return f"({', '.join(f'{part:g}' for part in place)})"


def _bounds(staged: Staged) -> str:
    (x0, y0, _), (x1, y1, _) = staged.base.lower, staged.base.upper
    return f"stay within x {x0:g} to {x1:g} and y {y0:g} to {y1:g}"


def _another_start(staged: Staged) -> str:
    """Start poses that nobody of the mission has."""
    taken = {robot.start.tag for robot in staged.robots}
    free = [start.tag for start in staged.base.starts if start.tag not in taken]
    return f"take {' or '.join(free[:3])}" if free else "choose another place"
