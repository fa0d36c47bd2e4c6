"""Robots and objects stand in each other's way, and are seen by scanners (robots reference 2.3, 3;
protocol reference 3.14)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from usarsim_conformance.approach import Pace, pace_of
from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.excursions import Equipment, bearer, equipment, spawn_far
from usarsim_conformance.grounds import YAW, lane
from usarsim_conformance.lines import Line, numbers
from usarsim_conformance.places import Place
from usarsim_conformance.ranging import ray
from usarsim_conformance.registry import UNREAL, NotApplicable, checks_of
from usarsim_conformance.walls import Builder, controller

measured = checks_of("control", reference="robots reference", dialects=UNREAL)

_AWAY = 0.8
"""m between two robots at first, beside what they need themselves."""
_SLOW = 0.3
"""Part of the pace at which a robot comes into touch first."""
_OVERLAP = 0.02
"""m by which bodies may overlap more in a collision than in gentle touch."""
_HELD = 0.12
"""m that a robot should have driven meanwhile when it is said to be held up: places are cut off at
two digits."""
_CUT = 0.03
"""m for two places that are cut off at two digits each."""
_BODY = 0.5
"""m from the middle of a robot within which it is seen, at least."""
_PUSHES = 1.5
"""s that it pushes."""
_WALL = (4.0, -2.0, 2.4)
"""m: width, z of the upper edge, height."""


@dataclass
class _Encounter:
    """A robot that drives against something, gently and then as fast as it goes."""

    equipment: Equipment  # of its class
    length: float  # m, of the robot, by Dimensions; 0 if not told
    gaps: dict[str, float] = field(default_factory=dict)
    """m from its reference point to what it meets, the least: `gently`, `fast`; that of another
    robot of its class, or the face of a wall. Negative for beyond."""
    touch: float = math.inf  # the same when it was held up first, driving gently
    scan: Line | None = None  # of what stands ahead, before it drives
    away: float = 0.0  # m to the reference point of the other robot then


def _along(base: Place, place: tuple[float, ...]) -> float:
    x, y = (place[axis] - base.location[axis] for axis in (0, 1))
    return math.cos(YAW) * x + math.sin(YAW) * y


def _places(lines: list[Line], base: Place) -> list[tuple[float, float]]:
    """Time, and m along the lane, of every GroundTruth."""
    return [(line.time, _along(base, numbers(line.get("Location")))) for line in lines
            if line.type == "GroundTruth"]  # fmt: skip


async def _push(robot: Robot, pace: Pace, part: float, base: Place, way: float) -> list[Line]:
    """Drive some m ahead at a part of the pace, and go on for a while, whatever is in the way."""
    begun = len(robot.client.lines)
    await robot.under(pace.command(part), seconds=way / (part * pace.speed) + _PUSHES)
    await robot.under(pace.command(0.0), seconds=0.5)
    return robot.client.lines[begun:]


async def _encounter(case: Case, class_name: str, with_robot: bool) -> _Encounter:
    worn = await equipment(case, class_name)

    async def meet(case: Case) -> _Encounter:
        base = Place(None, lane(case).location, (0.0, 0.0, YAW))
        robot = await spawn_far(case, class_name, base)
        if "AerialVehicle" in robot.first.text:
            raise NotApplicable(f"{class_name} flies over what is in its way")
        pace = await pace_of(robot)
        found = _Encounter(worn, 2.0 * pace.half)
        far = _AWAY + found.length
        other, height = None, (await robot.pose()).location[2]
        if with_robot:
            other = await spawn_far(case, class_name, base.moved(forward=far))
        else:
            width, top, high = _WALL
            builder = Builder(case, await controller(case), base, height)
            far = (await builder.put(0.0, far, width, top=top, high=high))[0].distance
        begun = len(robot.client.lines)
        await robot.run(0.6)
        scans = [line for line in robot.client.lines[begun:] if line.type == "RangeScanner"]
        found.scan, found.away = (scans[-1] if scans else None), far
        for name, part in (("gently", _SLOW), ("fast", 1.0)):
            if name == "fast":  # back to where it began
                await robot.under(pace.command(-0.5), seconds=_AWAY / (0.5 * pace.speed))
                await robot.under(pace.command(0.0), seconds=0.5)
            mine = _places(await _push(robot, pace, part, base, _AWAY + found.length), base)
            theirs = [(0.0, far)]
            if other is not None:
                await other.catch_up()
                theirs = _places(other.client.lines, base)
            gaps = [(time, place, _ahead(theirs, time) - place) for time, place in mine]
            found.gaps[name] = min(gap for _, _, gap in gaps)
            if name == "gently":
                found.touch = _touch(gaps, part * pace.speed)
        return found

    what = "another robot" if with_robot else "a wall"
    return await case.shared(f"{class_name} that drives against {what}", meet)


def _touch(gaps: list[tuple[float, float, float]], speed: float) -> float:
    """The gap when a robot that has driven at a speed is held up first; the least if it never is.

    Args:
        gaps: time, place and gap then.
        speed: m/s that it was told.
    """
    drives, span = False, _HELD / speed
    for now, place, gap in gaps:
        before = [one for one in gaps if now - span - 0.11 < one[0] <= now - span]
        if not before:
            continue
        found = (place - before[-1][1]) / (now - before[-1][0])
        drives = drives or found > 0.8 * speed
        if drives and found < 0.7 * speed:
            return gap
    return min(gap for _, _, gap in gaps)


def _ahead(theirs: list[tuple[float, float]], time: float) -> float:
    """Where the other was at a time, or nearest to it."""
    return min(theirs, key=lambda one: abs(one[0] - time))[1]


def _judge(case: Case, found: _Encounter, what: str, through: float) -> None:
    for name in ("gently", "fast"):
        case.expect(
            found.gaps[name] > through,
            f"Location of a robot that drives {name} against {what} comes as near as "
            f"{found.gaps[name]:.2f} m to it, not {through:.2f} m at least: it drives into it or "
            "through it",
        )
    deeper = found.touch - min(found.gaps.values())
    case.expect(
        deeper < _OVERLAP + _CUT,
        f"Location of a robot that drives against {what} comes {deeper:.3f} m nearer than when it "
        f"touches first: they overlap by so much, not by less than {_OVERLAP:g} m",
    )


async def _driver(case: Case) -> str:
    worn = await equipment(case, case.robot_class)
    return case.robot_class if "GroundTruth" in worn.conf else await bearer(case, "GroundTruth")


@measured("world.solid-objects", "Objects are in the way", "3; protocol reference 3.14")
async def solid_objects(case: Case) -> None:
    """A robot that drives against a wall of a world controller stops there: it overlaps with it by
    less than 2 cm more than when it touches it gently."""
    found = await _encounter(case, await _driver(case), with_robot=False)
    _judge(case, found, "a wall", max(0.04, 0.2 * found.length))


@measured("motion.solid-robots", "Robots are in each other's way", "3")
async def solid_robots(case: Case) -> None:
    """A robot that drives against another pushes it or stops: they overlap by less than 2 cm more
    than when they touch gently."""
    found = await _encounter(case, await _driver(case), with_robot=True)
    _judge(case, found, "another robot", max(0.08, 0.6 * found.length))


@measured("values.scan-robots", "A scanner sees robots", "2.3")
async def scan_robots(case: Case) -> None:
    """The least Range of a RangeScanner ahead of which another robot of its class stands is the way
    to the middle of that robot, but for the length of its body."""
    class_name = await bearer(case, "RangeScanner", "GroundTruth", fixed="RangeScanner")
    found = await _encounter(case, class_name, with_robot=True)
    if found.scan is None:
        case.skip(f"{class_name} sends no scan")
    name = found.scan.get("Name") or ""
    mount = found.equipment.on_body("RangeScanner").get(name)
    if mount is None:
        case.skip(f"GEO does not tell where {name} is on the body")
    conf = found.equipment.configured("RangeScanner")[name]
    values, step = found.scan.numbers("Range"), float(conf["Resolution"])
    half, most = float(conf["Fov"]) / 2.0, found.away - mount.location[0]
    ahead = []
    for number, value in enumerate(values):
        _, (x, y, _) = ray(mount, half - number * step)
        if abs(math.atan2(y, x)) < 0.1:
            ahead.append(value)
    if not ahead or most > 0.9 * float(conf["MaxRange"]):
        case.skip(f"{name} does not look ahead, or not so far")
    # Its body may reach beyond Dimensions, which some servers tell of the wheels only.
    least, most = most - max(found.length, _BODY), most + max(found.length, _BODY)
    case.expect(
        least < min(ahead) < most,
        f"Range of {name} is {min(ahead):.2f} m at least straight ahead, not {least:.2f} to "
        f"{most:.2f} m, where another robot stands",
    )
