"""Ports that tell the same thing tell the same numbers (side channels reference 3, 4, 6)."""

from __future__ import annotations

import math
import re

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot, pose_of, turned
from usarsim_conformance.grounds import open_floor
from usarsim_conformance.lines import number, numbers
from usarsim_conformance.places import Place
from usarsim_conformance.registry import NotApplicable, Severity, checks_of
from usarsim_conformance.side_lines import STATION, LineClient, split_reply
from usarsim_conformance.walls import controller, create, status_of

positions = checks_of("groundtruth")
wireless = checks_of("wireless")
truth = checks_of("truth")

_LISTED = re.compile(
    r"\{Name ([^{} ]+)\} \{Class ([^{} ]+)\} \{Time ([\d.]+)\} \{Location ([-\d.,]+)\} "
    r"\{Rotation ([-\d.,]+)\}"
)
_NEAR, _FAR = 2.0, 8.0
"""m between radio stations."""
_PD0, _D0, _N = -49.67, 2.0, 1.0
"""Defaults of the propagation models (side channels reference 4.5)."""


async def _told(client: LineClient, name: str) -> dict[str, str]:
    groups = split_reply(await client.ask("GETPOS"))[1]
    return next((group for group in groups if group.get("Name") == name), {})


async def _aloft(case: Case, lot: Place) -> Robot:
    """An aircraft in the air, else the robot of most checks; both with a yaw."""
    place = lot.moved(1.5, -2.0, -2.0)
    try:
        role = await case.class_for("aerial")
    except NotApplicable:
        return await case.spawn(place=lot.moved(1.5, -2.0))
    return await case.spawn(place=place, class_name=role)


@positions("getpos.exact", "GETPOS agrees with GroundTruth", "3.2, 11.50")
async def exact(case: Case) -> None:
    """Location of GETPOS is that of the robot's own GroundTruth within 3 cm on every axis, also of
    an aircraft above the ground."""
    async with open_floor(case) as lot:
        robot = await _aloft(case, lot)
        await robot.run(1.5)
        client = await LineClient.open(case, "groundtruth")
        if await robot.client.maybe(lambda line: line.type == "GroundTruth", 2.0) is None:
            case.skip(f"{robot.class_name} has no GroundTruth")
        where = (await robot.pose()).location
        told = numbers((await _told(client, robot.name)).get("Location"))
        case.need(len(told) == 3, f"GETPOS does not list {robot.name}")
        for axis, a, b in zip("xyz", told, where, strict=True):
            case.expect(
                abs(a - b) < 0.03,
                f"{axis} of Location is {a} by GETPOS, not {b}, as by GroundTruth",
            )


@positions("getpos.battery-empty", "An empty battery shows", "3.2, 11.64")
async def battery_empty(case: Case) -> None:
    """When STA tells Battery 0, GETPOS tells BatteryEmpty True: the wireless program kicks such
    robots."""
    robot = await case.spawn(extra=" {Battery 2}")
    if robot.first.get("Battery") is None:
        case.skip("STA has no Battery")
    if robot.first.number("Battery") > 3:
        case.skip("the battery cannot be set by INIT")
    client = await LineClient.open(case, "groundtruth")
    await robot.wait(
        lambda line: line.head == "STA" and line.number("Battery") == 0, what="STA with Battery 0"
    )
    await robot.run(0.5)
    found = (await _told(client, robot.name)).get("BatteryEmpty")
    case.expect(found == "True", f"BatteryEmpty is {found} while Battery of STA is 0, not True")


# Radio.


async def _stations(case: Case, lot: Place) -> tuple[list[Robot], list[LineClient]]:
    """Three stations in a row, registered with the wireless simulation."""
    robots, clients = [], []
    for ahead in (0.0, _NEAR, _FAR):
        try:
            robot = await case.spawn(place=lot.moved(ahead - 4.0), class_name=STATION)
        except Exception:
            raise NotApplicable(f"no {STATION} can be spawned") from None
        client = await LineClient.open(case, "wireless")
        await client.expect(f"INIT {{Robot {robot.name}}} {{Port 5}}", "INITREPLY {Status OK}")
        robots.append(robot)
        clients.append(client)
    return robots, clients


async def _strength(client: LineClient, other: Robot) -> float:
    line = await client.ask(f"GETSS {{Robot {other.name}}}")
    found = re.search(r"\{Strength ([^{} ]+)\}", line)
    return number(found[1]) if found else math.nan


async def _distances(case: Case, robots: list[Robot]) -> tuple[float, float]:
    client = await LineClient.open(case, "groundtruth")
    places = [numbers((await _told(client, robot.name)).get("Location")) for robot in robots]
    case.need(all(len(place) == 3 for place in places), "GETPOS does not list the stations")
    return math.dist(places[0], places[1]), math.dist(places[0], places[2])


@wireless("getss.distance", "The strength follows the distance", "4.5", Severity.SHOULD)
async def distance(case: Case) -> None:
    """By the models of the original the strength in dBm is -49.67 - 10 log10(d / 2 m) with the
    distance d of GETPOS, unless other parameters are set; it becomes smaller with it. Not
    applicable to a model that knows no distance."""
    async with open_floor(case) as lot:
        robots, clients = await _stations(case, lot)
        near, far = await _distances(case, robots)
        found = [await _strength(clients[0], other) for other in robots[1:]]
        if found == [0.0, 0.0]:
            case.skip("the model knows no distance")
        case.expect(
            found[1] < found[0],
            f"Strength is {found[1]} dBm at {far:.1f} m, not below the {found[0]} dBm at "
            f"{near:.1f} m",
        )
        for value, way in zip(found, (near, far), strict=True):
            wanted = _PD0 - 10.0 * _N * math.log10(way / _D0)
            case.expect(
                abs(value - wanted) < 0.2,
                f"Strength at {way:.2f} m is {value} dBm, not {wanted:.2f} dBm, as by the default "
                "parameters",
            )


# What stands in the way.


@positions("getobs.floor", "The floor is where things stand on it", "3.3, 3.2", Severity.SHOULD)
async def floor(case: Case) -> None:
    """GETOBS finds the floor at the height on which an object with Physics Ground stands, within 3
    cm."""
    world = await controller(case)
    async with open_floor(case) as lot:
        size = 0.5
        place = lot.moved(2.0, 0.0, -1.0)
        name = await create(
            case, world, Place(None, place.location), (size,) * 3, " {Physics Ground}"
        )
        stands = (await status_of(world, name)).numbers("Location")[2] + size / 2.0
        client = await LineClient.open(case, "groundtruth")
        x, y, z = lot.location
        near, far = z - 1.0, z + 1.5
        for _ in range(10):  # halves the way to what is met first
            middle = (near + far) / 2.0
            if await _obstacles(client, (x, y, near), (x, y, middle)):
                far = middle
            else:
                near = middle
        case.expect(
            abs(far - stands) < 0.03,
            f"ObstCount tells a floor at z {far:.2f}, not at {stands:.2f}, where an object with "
            "Physics Ground stands",
        )


async def _obstacles(client: LineClient, start: tuple[float, ...], end: tuple[float, ...]) -> float:
    points = [",".join(f"{value:.4f}" for value in point) for point in (start, end)]
    line = await client.ask(f"GETOBS {{Start {points[0]}}} {{End {points[1]}}}")
    found = re.search(r"\{ObstCount ([^{}]*)\}", line)
    return number(found[1]) if found else math.nan


# USARTruth.


async def _actor(case: Case, client: LineClient, query: str) -> list[re.Match[str]]:
    await client.send(query)
    found = []
    while (line := await client.line()) != "{End}":
        match = _LISTED.match(line)
        if match is not None:
            found.append(match)
    return found


@truth("listing.poses", "Poses agree with GroundTruth", "6.1, 11.98")
async def poses(case: Case) -> None:
    """Location and Rotation are those of the robot's own GroundTruth on every axis, within 3 cm and
    0.05 rad; Rotation also of an aircraft that leans as it flies."""
    async with open_floor(case) as lot:
        robot = await _aloft(case, lot)
        await robot.run(1.2)
        client = await LineClient.open(case, "truth")
        flies = robot.first.type == "AerialVehicle" or robot.class_name == "AirRobot"
        for name, command in (
            ("at rest", ""),
            ("flying", "DRIVE {LinearVelocity 0.3} {LateralVelocity 0.4}"),
        ):
            if command and not flies:
                continue
            if command:
                await robot.under(command, seconds=1.6)
            reports = [line for line in await robot.run(0.3) if line.type == "GroundTruth"]
            if not reports:
                case.skip(f"{robot.class_name} has no GroundTruth")
            where = pose_of(reports[-1])
            listed = await _actor(case, client, f"{{class USARBot.{robot.class_name}}}")
            case.need(listed, f"no {robot.class_name} is listed")
            mine = min(listed, key=lambda one: math.dist(numbers(one[4]), where.location))
            for axis, a, b in zip("xyz", numbers(mine[4]), where.location, strict=True):
                case.expect(
                    command or abs(a - b) < 0.03,  # it goes on flying meanwhile
                    f"{axis} of Location is {a} here, not {b}, as by GroundTruth",
                )
            angles = zip(("roll", "pitch", "yaw"), numbers(mine[5]), where.orientation, strict=True)
            for axis, a, b in angles:
                case.expect(
                    abs(turned(a, b)) < 0.05,
                    f"{name}, {axis} of Rotation is {a} here, not {b}, as by GroundTruth",
                )


@truth("listing.exact-time", "Time is that of the control port", "6.1", Severity.SHOULD)
async def exact_time(case: Case) -> None:
    """Time of a listing lies between that of the STA before it was asked for and of the one
    after."""
    robot = await case.spawn()
    client = await LineClient.open(case, "truth")
    await robot.run(0.5)
    await robot.catch_up()
    before = robot.now
    listed = await _actor(case, client, "")
    await robot.catch_up()
    after = (await robot.wait(lambda line: line.head == "STA", what="STA")).time
    case.need(listed, "nobody is listed")
    found = float(listed[0][3])
    case.expect(
        before - 0.3 <= found <= after + 0.3,
        f"Time is {found} s, not between {before} and {after} s, Time of the STA before and after",
    )


@truth("listing.objects", "Objects are listed as GetSTA tells", "6.1", Severity.SHOULD)
async def objects(case: Case) -> None:
    """An object of a world controller is listed by its class with the Location and Rotation of
    GetSTA, under its own name."""
    world = await controller(case)
    async with open_floor(case) as lot:
        place = Place(None, lot.moved(1.0, -2.0, -2.0).location, (0.2, -0.3, 0.7))
        name = await create(case, world, place, (0.6, 0.4, 0.2))
        client = await LineClient.open(case, "truth")
        listed = await _actor(case, client, f"{{class USARPhysObj.Cube}} {{name {name}}}")
        case.expect(len(listed) == 1, f"{len(listed)} objects of the name {name} are listed, not 1")
        status = await status_of(world, name)
        for index, key in ((4, "Location"), (5, "Rotation")):
            a, b = numbers(listed[0][index]), status.numbers(key)
            off = max(
                abs(turned(p, q)) if index == 5 else abs(p - q) for p, q in zip(a, b, strict=True)
            )
            case.expect(off < 0.02, f"{key} is {a} here, not {b}, as by GetSTA")
