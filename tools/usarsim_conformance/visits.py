"""Robots that look at people: at one who stands, from several places, and at one who walks.

Where people are, the truth port tells.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from statistics import fmean

from usarsim_client import Line, actor
from usarsim_conformance.case import Case
from usarsim_conformance.control import Pose, Robot
from usarsim_conformance.excursions import Equipment, Mount, Track, equipment, spawn_far
from usarsim_conformance.places import LEAVES, Place
from usarsim_conformance.registry import DIALECTS, NotApplicable
from usarsim_conformance.side_lines import LineClient
from usarsim_conformance.walls import Vector, controller, create, turned_by

_VIEWS = (
    ("ahead", 2.0, 0.0, 2.0),
    ("right", 2.0, 0.2, 2.0),
    ("left", 2.0, -0.2, 2.0),
    ("beside", 2.0, 0.85, 2.0),
    ("far", 3.5, 0.0, 8.2),
    ("away", 8.0, 0.0, 2.0),
    ("near", 0.9, 0.0, 2.0),
)
"""Name, m to the person, rad to the right at which it is, s."""
_TOWARDS_WALL = 0.8
"""rad, to where a robot looks when a wall stands between; the others look to 0.2 to 1.4, so that
nobody is in another's way."""
_WALL = (0.1, 1.3, 2.0)
"""m, half way between robot and person: thickness, width, height."""
_HEAD = 0.65
"""m from a person's pelvis, which truth tells, up to the head, about."""


@dataclass(frozen=True, slots=True)
class Person:
    """Somebody whom the truth port lists as a victim."""

    name: str  # there
    location: Vector  # of the pelvis, m


@dataclass(frozen=True)
class View:
    """What a robot said of a person at a place."""

    name: str  # of the place
    distance: float  # of the person from the robot's reference point, m and rad
    bearing: float
    pose: Pose  # of the robot
    track: Track  # what it said

    def seen_from(self, mount: Mount, point: Vector) -> Vector:
        """A point of the world in the frame of a sensor, x ahead, y to the right, z down."""
        away = tuple(a - b for a, b in zip(point, self.pose.location, strict=True))
        inside = _back(self.pose.orientation, away)
        on_body = tuple(a - b for a, b in zip(inside, mount.location, strict=True))
        return _back(mount.orientation, on_body)


@dataclass(frozen=True)
class Visit:
    """A person seen from several places."""

    equipment: Equipment  # of the robots
    person: Person  # who was visited
    views: dict[str, View]  # by name
    walled: View | None
    """From 2 m straight ahead with a wall half way; None without a world controller."""

    def mount(self, type: str) -> tuple[str, Mount]:
        """Name and place of the first sensor of a type on the body."""
        return next(iter(self.equipment.on_body(type).items()))

    def head_distance(self, view: View, type: str) -> float:
        """m from a sensor to the person's head, about."""
        x, y, z = self.person.location
        _, mount = self.mount(type)
        return math.hypot(*view.seen_from(mount, (x, y, z - _HEAD)))


def _back(angles: tuple[float, ...], vector: tuple[float, ...]) -> Vector:
    """A vector of the frame outside in a body's frame: by the transposed rotation."""
    axes = [turned_by(angles, axis) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    x, y, z = (sum(a * b for a, b in zip(axis, vector, strict=True)) for axis in axes)
    return x, y, z


async def people(case: Case) -> dict[str, tuple[float, Vector]]:
    """Time and place of every victim, by name.

    Raises:
        NotApplicable: if the truth port was not named.
    """
    client = await LineClient.open(case, "truth")
    await client.send("")
    found: dict[str, tuple[float, Vector]] = {}
    while (told := actor(Line((await client.line()).encode("latin-1")))) is not None:
        if "victim" in told.class_name.lower():
            x, y, z = told.location
            found[told.name] = (told.time, (x, y, z))
    client.wire.close()
    return found


async def _standing(case: Case, walks: bool) -> Person:
    before = await people(case)
    await case.clock.sleep(2.5)
    after = await people(case)
    for name, (_, place) in sorted(after.items()):
        moved = name in before and math.dist(before[name][1], place) > 0.05
        upright = place[2] < -0.8
        if moved == walks and upright:
            return Person(name, place)
    raise NotApplicable(f"nobody {'walks' if walks else 'stands'} in this world")


async def visit(case: Case, class_name: str) -> Visit:
    """A standing person seen by robots of a class.

    Raises:
        NotApplicable: if nobody stands, or there is no floor about them.
    """
    worn = await equipment(case, class_name)

    async def look(case: Case) -> Visit:
        person = await _standing(case, walks=False)
        high = case.survey.places[0].location[2]
        # Others may look at the same person, in another dialect or class: from their side.
        side = DIALECTS.index(case.dialect) * math.pi
        side += 0.0 if class_name == case.survey.robot else math.pi / 2.0

        def before(towards: float, distance: float, yaw: float) -> Place:
            x = person.location[0] - distance * math.cos(towards)
            y = person.location[1] - distance * math.sin(towards)
            return Place(None, (x, y, high), (0.0, 0.0, yaw))

        async def view(
            name: str, towards: float, distance: float, bearing: float, s: float
        ) -> View:
            place = before(towards, distance, towards - bearing)
            robot = await spawn_far(case, class_name, place)
            track = Track(await robot.run(s))
            found = View(name, distance, bearing, track.true_poses[-1][1], track)
            robot.close()
            await case.clock.sleep(LEAVES)
            return found

        views = {
            name: await view(name, 0.2 + 0.2 * number + side, distance, bearing, seconds)
            for number, (name, distance, bearing, seconds) in enumerate(_VIEWS)
        }
        walled, towards = None, _TOWARDS_WALL + side
        with contextlib.suppress(NotApplicable):
            client = await controller(case)
            wall = before(towards, 1.0, towards).moved(down=-_WALL[2] / 2.0)
            await create(case, client, wall, _WALL)
            walled = await view("walled", towards, 2.0, 0.0, 2.0)
            client.close()
        return Visit(worn, person, views, walled)

    return await case.shared(f"{class_name} visits somebody", look)


@dataclass(frozen=True)
class Walker:
    """What HumanMotion says of somebody who walks."""

    ahead: list[tuple[float, float, float]]
    """Before the robot: distance in m, speed in m/s, probability."""
    behind: list[float]  # probabilities, 2.2 m and less behind the robot's back


async def watch_walker(case: Case, class_name: str) -> Walker:
    """Somebody who walks before robots of a class, and behind the back of one."""

    async def watch(case: Case) -> Walker:
        person = await _standing(case, walks=True)
        worn = await equipment(case, class_name)
        mount = next(iter(worn.on_body("HumanMotion").values()))
        high = case.survey.places[0].location[2]
        found: list[tuple[float, float, float]] = []

        async def beside(away: float, yaw: float) -> Robot:
            x, y, _ = person.location
            place = Place(None, (x + away, y, high), (0.0, 0.0, yaw))
            return await spawn_far(case, class_name, place)

        for away in (2.2, 3.2):
            robot = await beside(away, math.pi)
            course: list[tuple[float, Vector]] = []
            begun = len(robot.client.lines)
            for _ in range(45):
                course.append((await people(case))[person.name])
                await robot.run(0.2)
            track = Track(robot.client.lines[begun:])
            for time, line in track.of("HumanMotion"):
                near = [one for one in course if abs(one[0] - time) < 0.5]
                if len(near) < 2 or near[-1][0] - near[0][0] < 0.5:
                    continue
                span = near[-1][0] - near[0][0]
                speed = math.dist(near[0][1], near[-1][1]) / span
                spots = [fmean(spot[axis] for _, spot in near) for axis in range(3)]
                chest = (spots[0], spots[1], spots[2] - 0.3)
                view = View("", away, 0.0, track.truth(time), track)
                found.append(
                    (math.hypot(*view.seen_from(mount, chest)), speed, line.number("Prob"))
                )
            robot.close()
        robot = await beside(2.2, 0.0)
        lines = await robot.run(6.0)
        robot.close()
        behind = [line.number("Prob") for line in lines if line.type == "HumanMotion"]
        return Walker(found, behind)

    return await case.shared(f"{class_name} watches somebody walk", watch)
