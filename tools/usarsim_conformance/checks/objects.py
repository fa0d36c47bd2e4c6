"""Objects of world controllers: where they are, how they turn and move (protocol 3.14)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from usarsim_conformance.case import Case
from usarsim_conformance.control import ControlClient, Robot, turned
from usarsim_conformance.grounds import open_floor
from usarsim_conformance.lines import Line, numbers
from usarsim_conformance.places import Place
from usarsim_conformance.registry import Severity, once
from usarsim_conformance.walls import controller, create, status_of

_SOON = 30.0
"""s of simulated time for what a controller is obeyed in; slow machines take some of it."""
_SPIN = 0.025
"""rad/s: even then no angle comes near a right one."""
_HIGH = 3.0
"""m above start poses, where no robot drives."""
_BAR = (2.0, 0.2, 0.2)
"""m: long in one direction, so that it shows how it is turned."""


def _text(values: tuple[float, ...]) -> str:
    return ",".join(f"{value:.4f}" for value in values)


def _same(line: Line, name: str, wanted: tuple[float, ...], slack: float) -> bool:
    found = line.numbers(name)
    if len(found) != len(wanted):
        return False
    if name == "Rotation":
        return all(abs(turned(a, b)) <= slack for a, b in zip(found, wanted, strict=True))
    return math.dist(found, wanted) <= slack


@once("world.poses", "GetSTA tells all of a pose", "3.14, 4.11 and 6, no. 168")
async def poses(case: Case) -> None:
    """Location and Rotation of GetSTA are those of Create, then those of AbsMove, on all axes with
    their signs; RelMove adds to both in the axes of the world, however the object is turned. Memory
    is that of Create."""
    client = await controller(case)
    async with open_floor(case) as lot:
        place = lot.moved(down=-_HIGH)
        place = Place(None, place.location, (0.2, -0.3, 0.6))
        name = await create(case, client, place, _BAR)
        line = await status_of(client, name)
        case.expect(
            line.get("Memory") == "red",
            f"Memory is {line.get('Memory')!r} after Create with red, not 'red': {line}",
        )
        await _is_at(case, client, name, place, "Create")
        place = Place(None, lot.moved(2.0, -3.0, -_HIGH - 1.0).location, (-0.1, 0.25, -0.9))
        await client.send(f"CONTROL {{Type AbsMove}} {{Name {name}}} {place.coordinates}")
        await _is_at(case, client, name, place, "AbsMove")
        await client.send(
            f"CONTROL {{Type RelMove}} {{Name {name}}} {{Location 0.5,-1,-0.25}}"
            " {Rotation 0,0,0.4}"
        )
        x, y, z = place.location
        moved = Place(None, (x + 0.5, y - 1.0, z - 0.25), (-0.1, 0.25, -0.5))
        await _is_at(case, client, name, moved, "RelMove")


async def _is_at(case: Case, client: ControlClient, name: str, place: Place, after: str) -> None:
    async def there() -> bool:
        line = await status_of(client, name)
        return _same(line, "Location", place.location, 0.02) and _same(
            line, "Rotation", place.rotation, 0.02
        )

    if await case.soon(there, _SOON):
        return
    line = await status_of(client, name)
    wrong = [
        f"{key} is {line.get(key)}, not {_text(values)}"
        for key, values in (("Location", place.location), ("Rotation", place.rotation))
        if not _same(line, key, values, 0.02)
    ]
    case.fail(f"GetSTA after {after} does not tell what was sent: {'; '.join(wrong)}")


_AHEAD = 3.0
"""m from a robot to what its scanner looks at."""
_TALL = 0.85
"""m above the robot's reference point of the middle of it; the scanner looks at its lower part."""
_LEAN = 0.35
"""rad."""


@once("world.seen", "Objects stand where GetSTA tells", "2.5, 3.14 and 4.6")
async def seen(case: Case) -> None:
    """A robot's scanner, whose mount GEO tells, sees a board where Location puts it, turned as
    Rotation says: positive yaw brings its right end nearer, positive pitch takes its lower part
    away, positive roll moves the lower part of a post to the left."""
    if case.dialect == "gazebo":
        case.skip("the order of ranges is another one")
    client = await controller(case)
    async with open_floor(case) as lot:
        robot = await case.spawn(place=lot)
        await robot.run(1.2)
        if await robot.client.maybe(_is_scan, 2.0) is None:
            case.skip(f"{robot.class_name} has no RangeScanner")
        pose = await robot.pose()
        here = Place(None, pose.location, (0.0, 0.0, pose.yaw))
        geo = await robot.client.ask("GETGEO {Type RangeScanner}", "GEO {Type RangeScanner")
        eye = numbers(geo.items()[0].get("Location"))
        case.need(len(eye) == 3, f"GEO tells no place of the scanner: {geo}")
        # The middle is this far above the beams.
        above = _TALL + eye[2]
        ahead = _AHEAD - eye[0]
        shift = above * math.tan(_LEAN)
        for words, right, size, rotation, wanted in (
            ("Location", 0.0, (0.1, 1.0, 2.0), (0.0, 0.0, 0.0), (ahead - 0.05, 0.0)),
            ("Location", 1.2, (0.1, 0.4, 2.0), (0.0, 0.0, 0.0), (ahead - 0.05, 1.2)),
            ("yaw of Rotation", 0.0, (0.1, 2.0, 2.0), (0.0, 0.0, _LEAN), (math.nan, 0.5)),
            ("pitch of Rotation", 0.0, (0.1, 1.0, 2.0), (0.0, _LEAN, 0.0), (ahead + shift, 0.0)),
            ("roll of Rotation", 0.0, (0.1, 0.2, 2.0), (_LEAN, 0.0, 0.0), (math.nan, -shift)),
        ):
            place = here.moved(_AHEAD, right, -_TALL)
            place = Place(None, place.location, (*rotation[:2], rotation[2] + pose.yaw))
            name = await create(case, client, place, size)
            await robot.run(0.6)
            points = _points(await robot.sensor("RangeScanner"))
            await client.send(f"CONTROL {{Type Kill}} {{Name {name}}}")
            case.expect(
                points,
                f"no Range of the scanner is below 5 m, though an object with {place.coordinates} "
                f"stands {_AHEAD} m ahead of it",
            )
            xs, ys = zip(*points, strict=True)
            found = (fmean(xs), fmean(ys))
            if words.startswith("yaw"):
                # Nearer on the right.
                left = [x for x, y in points if y < -0.3]
                near = [x for x, y in points if y > 0.3]
                if not left or not near:
                    await _is_gone(case, robot)
                case.need(left and near, f"the board is not seen on both sides: {points}")
                found = (math.nan, (fmean(left) - fmean(near)) / (2.0 * math.tan(_LEAN)))
            if any(abs(a - b) >= 0.15 for a, b in zip(found, wanted, strict=True)):
                await _is_gone(case, robot)
                case.fail(
                    f"an object {_AHEAD} m ahead and {right} m right with Rotation "
                    f"{_text(rotation)} is seen at {found[0]:.2f}, {found[1]:.2f}, not at "
                    f"{wanted[0]:.2f}, {wanted[1]:.2f}: {words}",
                )


async def _is_gone(case: Case, robot: Robot) -> None:
    """Fail if the scanner still sees what has been killed: that is what is wrong then."""
    await robot.run(1.0)
    points = _points(await robot.sensor("RangeScanner"))
    nearest = min((math.hypot(*at) for at in points), default=math.inf)
    case.expect(
        not points,
        f"{len(points)} values of Range are still {nearest:.2f} m and more 1 s after Kill of what "
        "stood there, not above 5 m: what is killed still blocks rays",
    )


def _is_scan(line: Line) -> bool:
    return line.head == "SEN" and line.type == "RangeScanner"


def _points(line: Line) -> list[tuple[float, float]]:
    """What a scan meets within 5 m, m ahead and right of the scanner; it goes from right to
    left."""
    ranges, fov = line.numbers("Range"), line.number("FOV")
    if len(ranges) < 2:
        return []
    step = fov / (len(ranges) - 1)
    return [
        (value * math.cos(angle), value * math.sin(angle))
        for index, value in enumerate(ranges)
        for angle in (fov / 2.0 - index * step,)
        if 0.2 < value < 5.0
    ]


@once("world.rotates", "Rotate turns at its Speed", "3.14", Severity.SHOULD)
async def rotates(case: Case) -> None:
    """`{Type Rotate} {Speed r,p,y}` turns an object about the axis of its component at so many
    rad/s, in the positive direction; about roll, pitch and yaw, within 20 percent."""
    client = await controller(case)
    async with open_floor(case) as lot:
        names = []
        for axis in range(3):
            place = lot.moved(3.0 * axis - 3.0, 0.0, -_HIGH)
            names.append(await create(case, client, Place(None, place.location), (0.4, 0.4, 0.4)))
        for axis, name in enumerate(names):
            speed = ",".join(f"{_SPIN}" if one == axis else "0" for one in range(3))
            await client.send(f"CONTROL {{Type Rotate}} {{Name {name}}} {{Speed {speed}}}")

        async def turns() -> bool:
            line = await status_of(client, names[-1])
            return any(abs(turned(0.0, angle)) > 0.015 for angle in line.numbers("Rotation"))

        case.expect(
            await case.soon(turns, _SOON),
            f"Rotation of an object with Rotate does not change within {_SOON:g} s",
        )
        first = [await _timed(case, client, name) for name in names]
        await case.clock.sleep(6.0)
        for axis, (name, before) in enumerate(zip(names, first, strict=True)):
            after = await _timed(case, client, name)
            angle = turned(
                before.line.numbers("Rotation")[axis], after.line.numbers("Rotation")[axis]
            )
            low, high = after.since(before)
            case.expect(
                _SPIN * low * 0.95 - 0.01 <= angle <= _SPIN * high * 1.05 + 0.01,
                f"Rotation of an object with Rotate about axis {axis} (roll, pitch, yaw) changes "
                f"by {angle:.2f} rad in {low:.1f} to {high:.1f} s, not by {_SPIN * low:.2f} to "
                f"{_SPIN * high:.2f} rad, Speed is {_SPIN}",
            )


@dataclass(frozen=True, slots=True)
class _Timed:
    """What GetSTA told, and between which simulated times."""

    line: Line
    earliest: float
    latest: float

    def since(self, other: _Timed) -> tuple[float, float]:
        """Least and most time since another."""
        return self.earliest - other.latest, self.latest - other.earliest


async def _timed(case: Case, client: ControlClient, name: str) -> _Timed:
    case.need(case.clock.followed, "no robot tells the time")
    earliest = case.clock.told
    line = await status_of(client, name)
    return _Timed(line, earliest, await case.clock.moment())


def _along(way: Sequence[tuple[float, ...]], at: tuple[float, ...]) -> tuple[float, float]:
    """How far along a way a place is, and how far aside of it, m."""
    gone, found = 0.0, (0.0, math.inf)
    for a, b in itertools.pairwise(way):
        length = math.dist(a, b)
        share = sum((p - q) * (r - q) for p, q, r in zip(at, a, b, strict=True)) / length**2
        share = min(max(share, 0.0), 1.0)
        aside = math.dist(at, [q + share * (r - q) for q, r in zip(a, b, strict=True)])
        if aside < found[1]:
            found = (gone + share * length, aside)
        gone += length
    return found


@once("world.path", "Way points are followed at their Speed", "3.14", Severity.SHOULD)
async def path(case: Case) -> None:
    """An object with way points and `{Type SetWP} {Speed v}` moves to them in their order at v,
    within 20 percent, and stays at the last; with Loop it goes back to the first."""
    client = await controller(case)
    async with open_floor(case) as lot:
        x, y, z = lot.moved(down=-_HIGH).location
        # A long first way: the controller may be told of it late.
        begin = Place(None, (x - 5.0, y, z))
        name = await create(case, client, begin, (0.3, 0.3, 0.3))
        points: list[tuple[float, ...]] = [
            (x + 5.0, y, z),
            (x + 5.0, y - 1.0, z),
            (x + 5.0, y - 1.0, z - 0.5),
        ]
        await client.send(
            f"CONTROL {{Type SetWP}} {{Name {name}}} {{Speed 0.5}} {{Loop false}} {{Moving false}}",
            f"CONTROL {{Type AddWP}} {{Name {name}}} {{WP {';'.join(map(_text, points))}}}",
            f"CONTROL {{Type SetWP}} {{Name {name}}} {{Moving true}}",
        )

        async def moves() -> bool:
            return not _same(await status_of(client, name), "Location", begin.location, 0.05)

        case.expect(
            await case.soon(moves, _SOON),
            f"Location of an object with way points does not change within {_SOON:g} s",
        )
        first = await _timed(case, client, name)
        await case.clock.sleep(1.6)
        second = await _timed(case, client, name)
        before, after = (one.line.numbers("Location") for one in (first, second))
        way = [begin.location, *points]
        (start, aside), (end, off) = (_along(way, at) for at in (before, after))
        case.expect(
            max(aside, off) < 0.05,
            f"Location is {max(aside, off):.2f} m aside of the way over {_text(points[0])}, not "
            f"less than 0.05 m, as {_text(before)} and then {_text(after)} show",
        )
        low, high = second.since(first)
        remains = sum(map(math.dist, way, way[1:])) - start  # whoever looks late sees it there
        case.expect(
            min(0.5 * low * 0.95, remains) - 0.02 <= end - start <= 0.5 * high * 1.05 + 0.02,
            f"on the way to {_text(points[0])} at Speed 0.5 Location went from {_text(before)} to "
            f"{_text(after)} in {low:.1f} to {high:.1f} s, {end - start:.2f} m, not 0.5 m a second",
        )

        async def there() -> bool:
            return _same(await status_of(client, name), "Location", points[-1], 0.05)

        case.expect(
            await case.soon(there, 30.0),
            f"Location after all way points is {(await status_of(client, name)).get('Location')}, "
            f"not {_text(points[-1])}",
        )
        await client.send(f"CONTROL {{Type SetWP}} {{Name {name}}} {{Loop true}}")

        async def left() -> bool:
            return not await there()

        case.expect(
            await case.soon(left, _SOON),
            f"Location with Loop is {_text(points[-1])}, the last way point, for {_SOON:g} s, and "
            "does not go back to the first",
        )


@once("world.physics", "Physics decides what falls", "3.14", Severity.SHOULD)
async def physics(case: Case) -> None:
    """An object with Physics None stays in the air; RigidBody and Falling fall to the floor, where
    Ground stands at once: half its size above it, all three at one height."""
    client = await controller(case)
    async with open_floor(case) as lot:
        names = {}
        for step, kind in enumerate(("None", "RigidBody", "Falling", "Ground")):
            place = lot.moved(2.0 * step - 3.0, 0.0, -1.2)
            extra = f" {{Physics {kind}}}"
            size = (0.5, 0.5, 0.5)
            names[kind] = await create(case, client, Place(None, place.location), size, extra)
        await case.clock.sleep(2.0)
        heights = {
            kind: (await status_of(client, name)).numbers("Location")[2]
            for kind, name in names.items()
        }
        start = lot.location[2] - 1.2
        case.expect(
            abs(heights["None"] - start) < 0.02,
            f"Location of an object with Physics None is at z {heights['None']:.2f}, not "
            f"{start:.2f}, where it was put",
        )
        for kind in ("RigidBody", "Falling"):
            case.expect(
                heights[kind] > start + 0.2 and abs(heights[kind] - heights["Ground"]) < 0.03,
                f"Location of an object with Physics {kind} is at z {heights[kind]:.2f}, not "
                f"{heights['Ground']:.2f}, as one with Ground; it was put to {start:.2f}",
            )


@once("world.robots", "AbsMove and RelMove put robots elsewhere", "3.14", Severity.SHOULD)
async def robots(case: Case) -> None:
    """AbsMove with the name of a robot puts it there, facing as told; RelMove adds. Its own sensors
    tell so."""
    client = await controller(case)
    async with open_floor(case) as lot:
        robot = await case.spawn(place=lot)
        await robot.run(0.8)
        before = await robot.pose()
        z = before.location[2]
        x, y, _ = lot.moved(2.0, -1.0).location
        for command, wanted, yaw in (
            (f"AbsMove}} {{Name {robot.name}}} {{Location {x:.3f},{y:.3f},{z:.3f}}}"
             " {Rotation 0,0,-0.8}", (x, y), -0.8),
            (f"RelMove}} {{Name {robot.name}}} {{Location -0.6,1.1,0}} {{Rotation 0,0,0.5}}",
             (x - 0.6, y + 1.1), -0.3),
        ):  # fmt: skip
            await client.send(f"CONTROL {{Type {command}")
            await case.clock.sleep(1.0)
            await robot.run(0.3)
            pose = await robot.pose()
            off = math.dist(pose.location[:2], wanted)
            case.expect(
                off < 0.06 and abs(turned(yaw, pose.yaw)) < 0.05,
                f"after {command.partition('}')[0]} the robot is at {pose.location} with a yaw of "
                f"{pose.yaw:.2f}, not at {wanted} with {yaw}: Location or Rotation",
            )
