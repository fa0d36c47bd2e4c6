"""Ranges, touch pads and bumpers against walls, by the places and limits that are told (robots
reference 2.2, 2.3, 2.8)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.excursions import Equipment, Track, bearer, equipment, spawn_far
from usarsim_conformance.grounds import lane
from usarsim_conformance.ranging import (
    EDGE,
    SLACK,
    Beam,
    explained,
    judge_beam,
    limit,
    ray,
    values_of,
    walls_for,
)
from usarsim_conformance.registry import UNREAL, checks_of, unreal
from usarsim_conformance.walls import (
    Builder,
    Scene,
    Surrounded,
    Vector,
    Wall,
    among_walls,
    controller,
    settled,
)

measured = checks_of("control", reference="robots reference", dialects=UNREAL)


async def _single(case: Case, type: str, least: bool) -> None:
    def judge(found: Surrounded) -> None:
        seen = 0
        for scene, item, mount, text in values_of(found, type, "Range"):
            beam = Beam(scene, item, item, *ray(mount), float(text))
            judge_beam(case, found, type, "Range", beam, least, found.floor)
            seen += 1
        case.need(
            seen > 3, f"only {seen} values of {type} that can be judged, more than 3 are needed"
        )

    explained(await walls_for(case, type), type, judge)


@measured("values.ir-range", "IR measures the distance ahead of it", "2.2")
async def ir_range(case: Case) -> None:
    """Range of IR is the distance of a wall, or of the floor if that is nearer, along the mount's
    axis, between MinRange and MaxRange of CONF, wherever the wall stands."""
    await _single(case, "IR", True)


@measured("values.range-range", "A range sensor measures the distance ahead of it", "2.2")
async def range_range(case: Case) -> None:
    """Range of a range sensor is the distance of a wall, or of the floor if that is nearer, along
    the mount's axis, up to MaxRange."""
    await _single(case, "Range", False)


@measured(
    "values.sonar-range", "A sonar measures the nearest echo", "2.2; protocol reference 6, no. 101"
)
async def sonar_range(case: Case) -> None:
    """Range of a sonar is the distance of a wall within its cone: that of its axis, or less where
    the wall is nearer within BeamAngle; MaxRange if there is none. One that looks down tells that
    of the floor."""
    explained(await walls_for(case, "Sonar"), "Sonar", partial(_judge_sonar, case))


def _judge_sonar(case: Case, found: Surrounded) -> None:
    seen = 0
    for scene, item, mount, text in values_of(found, "Sonar", "Range"):
        value, high = float(text), limit(found, "Sonar", item, "MaxRange")
        half = _beam_angle(found, item) / 2.0
        start, way = ray(mount)
        if way[2] > 0.1:
            below = _floor_within(found.floor, scene.wall, start, way, half)
            if below is not None:
                _judge_echo(case, found, item, value, below, f"the floor (scene {scene.name!r})")
                seen += 1
            continue
        if scene.wall is None or way[2] < -0.1:
            case.expect(
                abs(value - high) < SLACK,
                f"Range of {item} is {value:.3f} m with nothing before it, not MaxRange of CONF, "
                f"{high:g} m",
            )
            continue
        length, _ = scene.wall.along(start, way)
        away = abs(math.remainder(math.atan2(way[1], way[0]) - scene.wall.bearing, math.tau))
        if away > math.pi / 2.0 + half + 0.1:
            case.expect(
                abs(value - high) < SLACK,
                f"Range of {item} is {value:.3f} m with a wall behind it only, not MaxRange of "
                f"CONF, {high:g} m",
            )
        if away > math.radians(60.0) or length == math.inf:
            continue
        edges = [
            _towards(scene.wall, start, across) for across in (scene.wall.left, scene.wall.right)
        ]
        axis = math.atan2(way[1], way[0])
        if min(abs(math.remainder(edge - axis, math.tau)) for edge in edges) < half + 0.1:
            continue  # the cone reaches beyond the wall
        nearest = length * math.cos(away) / math.cos(max(away - half, 0.0))
        if abs(nearest - high) < 0.1 or abs(length - high) < 0.1:
            continue
        away_from = f"a wall (scene {scene.name!r})"
        _judge_echo(case, found, item, value, (nearest, length), away_from)
        seen += 1
    case.need(seen > 3, f"only {seen} values of Sonar that can be judged, more than 3 are needed")


def _judge_echo(
    case: Case,
    found: Surrounded,
    item: str,
    value: float,
    between: tuple[float, float],
    what: str,
) -> None:
    """The range of a sonar lies between the nearest point of its cone and that of its axis."""
    low = max(limit(found, "Sonar", item, "MinRange"), 0.0)
    high = limit(found, "Sonar", item, "MaxRange")
    nearest, farthest = (min(max(one, low), high) for one in between)
    slack = SLACK + 0.005 * farthest
    case.expect(
        nearest - slack < value < farthest + slack,
        f"Range of {item} is {value:.3f} m, not {nearest:.3f} to {farthest:.3f} m, that of {what}",
    )


def _floor_within(
    floor: float, wall: Wall | None, start: Vector, way: Vector, half: float
) -> tuple[float, float] | None:
    """How far the floor is within a cone that looks down, m, nearest and along its axis; None if
    a wall stands where the cone may reach it."""
    depth, tilt = floor - start[2], math.acos(min(way[2], 1.0))
    outside = tilt + half
    reach = depth * math.tan(outside) if outside < math.pi / 2.0 else math.inf
    if wall is not None and -wall.off(start) < reach + EDGE:
        return None
    return depth / math.cos(max(tilt - half, 0.0)), depth / way[2]


def _beam_angle(found: Surrounded, item: str) -> float:
    conf = found.equipment.configured("Sonar")[item]
    return float(conf.get("BeamAngle") or conf.get("beamAngle") or 0.349)


@measured("values.sonar-cone", "A sonar sees its cone and no more", "2.2")
async def sonar_cone(case: Case) -> None:
    """A narrow wall that goes round the robot and faces it is seen by a sonar while it covers part
    of the cone of BeamAngle about the mount's axis, and not beyond."""
    found = await among_walls(
        case, await bearer(case, "Sonar", "GroundTruth", fixed="Sonar"), round_about=True
    )
    mounts = found.mounts("Sonar")
    seen = 0
    for scene in found.of("narrow"):
        for item, told in scene.track.items("Sonar", "Range").items():
            if item not in mounts or scene.wall is None:
                continue
            start, way = ray(mounts[item])
            if abs(way[2]) > 0.1 or not scene.wall.top < start[2] - 0.05 < scene.wall.bottom - 0.1:
                continue
            half, axis = _beam_angle(found, item) / 2.0, math.atan2(way[1], way[0])
            wall = scene.wall
            one, middle, two = (
                math.remainder(_towards(wall, start, across) - axis, math.tau)
                for across in (wall.left, (wall.left + wall.right) / 2.0, wall.right)
            )
            wide = abs(math.remainder(two - one, math.tau)) / 2.0
            value = float(told[-1][1])
            high = limit(found, "Sonar", item, "MaxRange")
            echo = value < high - 0.2
            off = f"a wall {math.degrees(middle):.0f} degrees off its axis"
            least, most = _away(wall, start)
            if abs(middle) > half + wide + 0.06 and echo:
                case.expect(
                    least - 0.1 < value < most + 0.1,
                    f"Range of {item} is {value:.3f} m, neither MaxRange of CONF, {high:g} m, nor "
                    f"the {least:.2f} to {most:.2f} m of {off}: a wrong Range, or a cone wider "
                    f"than BeamAngle, {2 * half:.3f} rad, that meets something else",
                )
                case.fail(
                    f"Range of {item} is {value:.3f} m, not MaxRange of CONF, {high:g} m: it sees "
                    f"{off}, BeamAngle is {2 * half:.3f} rad"
                )
            elif abs(middle) < 0.7 * half:
                case.expect(
                    echo,
                    f"Range of {item} is {value:.3f} m, not {least:.2f} to {most:.2f} m: it does "
                    f"not see {off}, BeamAngle is {2 * half:.3f} rad",
                )
                seen += 1
    case.need(seen > 3, f"only {seen} values of Sonar that can be judged, more than 3 are needed")


def _towards(wall: Wall, start: Vector, across: float) -> float:
    """Bearing of a point of the wall's face from a place, rad."""
    cos, sin = math.cos(wall.bearing), math.sin(wall.bearing)
    x = wall.distance * cos - across * sin - start[0]
    y = wall.distance * sin + across * cos - start[1]
    return math.atan2(y, x)


def _away(wall: Wall, start: Vector) -> tuple[float, float]:
    """Least and most distance of the wall's face from a place, m, at the height of that."""
    cos, sin = math.cos(wall.bearing), math.sin(wall.bearing)
    ahead = wall.distance - cos * start[0] - sin * start[1]
    aside = cos * start[1] - sin * start[0]
    ends = wall.left - aside, wall.right - aside
    nearest = 0.0 if ends[0] < 0.0 < ends[1] else min(map(abs, ends))
    return math.hypot(ahead, nearest), math.hypot(ahead, max(map(abs, ends)))


def _scan(found: Surrounded, type: str, scenes: list[Scene]) -> Iterator[Beam]:
    """Every beam of the last scan of each scanner in some scenes."""
    mounts = found.mounts(type)
    for scene in scenes:
        for name, mount in mounts.items():
            lines = [line for _, line in scene.track.of(type) if line.get("Name") == name]
            if not lines:
                continue
            conf = found.equipment.configured(type)[name]
            fov, resolution = float(conf["Fov"]), float(conf["Resolution"])
            ranges = lines[-1].numbers("Range")
            # The printed resolution is cut off, and the last beam may be at the very end or not.
            ends = fov / max(len(ranges) - 1, 1)
            other = ends if resolution <= ends < resolution + 1e-4 else resolution
            for number, value in enumerate(ranges):
                start, way = ray(mount, fov / 2.0 - number * resolution)
                _, perhaps = ray(mount, fov / 2.0 - number * other)
                yield Beam(scene, name, f"{name}, beam {number + 1}", start, way, value, perhaps)


async def _scanner(case: Case, type: str, least: bool, found: Surrounded | None = None) -> None:
    def judge(found: Surrounded) -> None:
        seen = 0
        for beam in _scan(found, type, found.of()):
            judge_beam(case, found, type, "Range", beam, least)
            seen += 1
        case.need(
            seen > 10, f"only {seen} values of {type} that can be judged, more than 10 are needed"
        )

    explained(found or await walls_for(case, type), type, judge)


@measured(
    "values.scan-range", "A scan measures a wall", "2.3; protocol reference 6, no. 103 to 105"
)
async def scan_range(case: Case) -> None:
    """Range of every beam of a RangeScanner is the distance of the wall in its direction, beams
    going from +Fov/2, the right, to -Fov/2 by Resolution; MaxRange of CONF beyond."""
    await _scanner(case, "RangeScanner", False)


_WIDE = ("Zerg", "Matilda")
"""Classes whose scanners look back to both sides, too."""


@measured("values.scan-wide", "A scan beyond half a turn goes from right to left", "2.3")
async def scan_wide(case: Case) -> None:
    """Beams of a RangeScanner with a Fov of more than pi go from +Fov/2, behind on the right, to
    -Fov/2, too. Not applicable without such a scanner."""
    for class_name in (case.robot_class, *_WIDE):
        worn = await equipment(case, class_name)
        on_body = worn.on_body("RangeScanner")
        for name, conf in worn.configured("RangeScanner").items():
            if float(conf.get("Fov", "0")) > math.pi + 0.1 and name in on_body:
                found = await among_walls(case, class_name)
                await _scanner(case, "RangeScanner", False, found)
                return
    case.skip("no scanner known here sees more than half a turn")


@measured("values.ir-scan-range", "A scan by infrared measures a wall", "2.3")
async def ir_scan_range(case: Case) -> None:
    """Range of every beam of an IRScanner is the distance of the wall in its direction, between
    MinRange and MaxRange."""
    await _scanner(case, "IRScanner", True)


@unreal("values.scan-head", "A scan says what CONF says", "4.6 and 4.8")
async def scan_head(case: Case) -> None:
    """Resolution and FOV of a scan are Resolution and Fov of CONF, and the number of ranges follows
    from them."""
    found = await walls_for(case, "RangeScanner")
    for _, line in found.scenes[0].track.of("RangeScanner"):
        conf = found.equipment.configured("RangeScanner")[line.get("Name") or ""]
        for key, told in (("Resolution", "Resolution"), ("FOV", "Fov")):
            a, b = line.number(key), float(conf[told])
            case.expect(abs(a - b) < 1e-3, f"{key} of SEN is {a:g}, not {b:g}, {told} of CONF")
        beams = float(conf["Fov"]) / float(conf["Resolution"])
        count = len(line.numbers("Range"))
        case.expect(
            beams - 1.5 < count < beams + 1.5,
            f"Range of a scan has {count} values, not about {beams + 1.0:.1f} (Fov / Resolution "
            "of CONF + 1)",
        )


_GAPS = (50, 35, 27, 22, 17, 12, 9, 7, 5, 3, 2, 1, 0, -2)
"""mm between a pad and the wall."""
_SIDES = (25, 15, 10, 8, 6, 4, 2, 0, -4)
"""mm from a pad's middle to the edge of a wall before it."""
_INEXACT = 0.004
"""m by which a robot may stand beside the place of its INIT."""


@dataclass(frozen=True)
class _Approach:
    """What a pad said of a wall."""

    name: str  # of the pad
    ahead: list[tuple[float, bool]]  # gaps, m, with whether it was touched then
    beside: list[tuple[float, bool]]
    """Distances of the edge, m, likewise, with a wall close before the pad."""


async def _approach(case: Case, type: str) -> tuple[Equipment, _Approach]:
    class_name = await bearer(case, type, "GroundTruth")
    worn = await equipment(case, class_name)

    async def come(case: Case) -> _Approach:
        client = await controller(case)
        base = lane(case)
        robot = await spawn_far(case, class_name, base)
        height = (await robot.pose()).location[2]
        builder = Builder(case, client, base, height)
        fronts = [
            (name, mount)
            for name, mount in worn.on_body(type).items()
            if mount.location[0] > 0.0 and max(map(abs, mount.orientation)) < 0.1
        ]
        if not fronts:
            case.skip(f"no {type} looks ahead")
        name, mount = fronts[0]
        x, y, z = mount.location
        x += float(worn.configured(type)[name].get("ArcRadius") or 0.0)

        async def look(distance: float, aside: float) -> bool:
            await builder.put(0.0, distance, 0.8, aside=aside, high=1.0 + z + 0.06)
            return await _touched(robot, type, name)

        ahead = [(gap / 1000.0, await look(x + gap / 1000.0, y)) for gap in _GAPS]
        await builder.clear()
        beside = []
        if not worn.configured(type)[name].get("ArcRadius"):
            for side in _SIDES:
                # The wall is to the right of its edge.
                aside = y + side / 1000.0 + 0.4
                beside.append((side / 1000.0, await look(x + 0.001, aside)))
        return _Approach(name, ahead, beside)

    return worn, await case.shared(f"{class_name} whose {type} a wall approaches", come)


async def _touched(robot: Robot, type: str, name: str) -> bool:
    begun = await settled(robot)
    found = False
    for _, line in Track(await robot.run(0.5)).between(begun, math.inf).of(type):
        if line.head == "SEN":
            for item in line.items():
                if item.get("Name") == name:
                    found = item.get("Touch") == "True"
    return found


def _judge_reach(case: Case, found: _Approach, least: float, most: float) -> None:
    touched = [gap for gap, touch in found.ahead if touch]
    case.expect(
        touched,
        f"Touch of {found.name} is False in all {len(found.ahead)} reports before a wall that "
        "comes to it, not True at last",
    )
    first = max(touched)
    case.expect(
        first <= most + _INEXACT,
        f"Touch of {found.name} is True {1000 * first:.0f} mm before a wall, not False: it should "
        f"reach {1000 * most:.0f} mm",
    )
    for gap, touch in found.ahead:
        case.expect(
            touch or gap > least - _INEXACT,
            f"Touch of {found.name} is False {1000 * gap:.0f} mm before a wall, not True: it "
            f"should reach {1000 * least:.0f} mm",
        )


@measured("values.touch-reach", "A touch pad feels what is close", "2.8")
async def touch_reach(case: Case) -> None:
    """Touch is False while a wall is a centimetre before the pad, and True from a few millimetres
    on."""
    _, found = await _approach(case, "Touch")
    _judge_reach(case, found, 0.0, 0.005)


@measured("values.touch-diameter", "A touch pad is as large as it says", "2.8")
async def touch_diameter(case: Case) -> None:
    """A wall close before a pad is felt where its edge is nearer to the middle of the pad than half
    of Diameter of CONF, and not beside it."""
    worn, found = await _approach(case, "Touch")
    told = worn.configured("Touch")[found.name].get("Diameter")
    if told is None or not found.beside:
        case.skip("CONF tells no Diameter")
    assert told is not None
    half = float(told) / 2.0
    for edge, touch in found.beside:
        if edge > half + _INEXACT:
            case.expect(
                not touch,
                f"Touch is True with the edge of a wall {1000 * edge:.0f} mm off the middle of "
                f"the pad, not False, as beyond {1000 * half:.0f} mm, half of Diameter",
            )
        if edge < half - _INEXACT:
            case.expect(
                touch,
                f"Touch is False with the edge of a wall {1000 * edge:.0f} mm off the middle of "
                f"the pad, not True, as within {1000 * half:.0f} mm, half of Diameter",
            )


@measured("values.bumper-reach", "A bumper feels what is close", "2.8")
async def bumper_reach(case: Case) -> None:
    """Touch of a TouchArray is True from 2 cm before its arc on, ArcRadius of CONF from its
    mount."""
    _, found = await _approach(case, "TouchArray")
    _judge_reach(case, found, 0.017, 0.022)
