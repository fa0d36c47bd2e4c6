"""Objects that a world controller puts into the world (protocol reference 3.14): a wall here and
there about a robot that stands still, and the geometry.

The wall is a scaled box; where it really is, the server tells (GetSTA). The robot stands where its
INIT said. So every range follows from numbers on the wire: the place of the wall, that of the
sensor (GEO), its beams and limits (CONF).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from usarsim_conformance.case import Case
from usarsim_conformance.control import ControlClient, Robot
from usarsim_conformance.excursions import Equipment, Mount, Track, equipment, spawn_far
from usarsim_conformance.grounds import lane
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place


async def controller(case: Case) -> ControlClient:
    """A connection that is a world controller.

    Raises:
        NotApplicable: if the server has none.
    """
    client = await case.connect()
    name = f"{{Name {case.new_name()}}} {{Location 0,0,0}}"
    await client.send(f"INIT {{ClassName USARBot.WorldController}} {name}")
    await client.send("CONTROL {Type GetSTA} {Name NoSuchObject}")
    if await client.maybe(lambda line: line.head == "STA") is None:
        case.skip("the server has no world controller")
    client.least_wall = _BUILDS_LEAST_WALL
    return client


_BUILDS = 45.0
"""s of simulated time for an answer behind a Create: servers may build what is new beside the
running world, one thing after the other."""
_BUILDS_LEAST_WALL = 20.0
"""s of wall time that it has at least: things are built in real time, also where 45 s of simulated
time pass in a second."""


async def status_of(client: ControlClient, name: str) -> Line:
    """What GetSTA tells of an object; a bare `STA` if it does not exist."""
    return await client.ask(
        f"CONTROL {{Type GetSTA}} {{Name {name}}}",
        lambda line: line.head == "STA",
        _BUILDS,
        "STA",
    )


async def create(
    case: Case,
    client: ControlClient,
    place: Place,
    size: tuple[float, float, float],
    extra: str = "",
) -> str:
    """A block, its middle at a place; its name.

    Args:
        case: the check.
        client: a world controller.
        place: of its middle.
        size: m along x, y, z.
        extra: further segments, with a blank before.

    Raises:
        NotApplicable: if there is no class Cube of one metre that can be scaled.
    """
    name = case.new_name()
    scale = ",".join(f"{side:g}" for side in size)
    physics = "" if "{Physics" in extra else " {Physics None}"
    await client.send(
        f"CONTROL {{Type Create}} {{ClassName Cube}} {{Name {name}}} {{Memory red}}"
        f" {place.coordinates} {{Scale {scale}}}{physics} {{Permanent false}}{extra}"
    )
    line = await status_of(client, name)
    if line.get("Name") != name:
        case.skip(f"no object of class Cube could be created: {line}")
    told = line.numbers("Size")
    case.expect(
        len(told) == 3
        and all(abs(a - b) < 0.01 + 0.01 * b for a, b in zip(told, size, strict=True)),
        f"Size of a Cube of 1 m with Scale {scale} is {line.get('Size')}, not {scale}",
    )
    case.need(all(map(math.isfinite, told)), f"Size is none: {line}")
    return name


async def put(client: ControlClient, name: str, place: Place) -> None:
    """Put an object or a robot elsewhere; returns when the order has been worked off.

    Args:
        client: a world controller.
        name: of the object or robot.
        place: where to, with its rotation.
    """
    await client.send(f"CONTROL {{Type AbsMove}} {{Name {name}}} {place.coordinates}")
    await status_of(client, "NoSuchObject")


Vector = tuple[float, float, float]

_YAW = 0.6
"""rad; a heading that no mistake about axes leaves as it is."""
_THICK = 0.1
_HIGH = 1.0
"""m, size of walls."""
_SETTLE = 0.45
"""s of reports after a wall has moved: each sensor has looked again."""
_LONG = 2.2
"""s of reports in scenes for sensors that look about for a while, or on demand."""
_LATE = 0.25
"""s of simulated time by which reports may be late."""
_BUILT = 60.0
"""s of simulated time in which a world controller's wall stands, or never does."""
_NARROW = 0.25
_STEP = math.radians(5.0)
_CIRCLE = 2.0
"""m from the robot to the wall that goes round it."""
_FAR = 45.0
"""m; ranges beyond are not tried."""


def turned_by(angles: Sequence[float], vector: Sequence[float]) -> Vector:
    """A vector of a body's frame in the frame outside, Rz(yaw) Ry(pitch) Rx(roll) (protocol
    reference 2.5)."""
    roll, pitch, yaw = angles
    x, y, z = vector
    y, z = y * math.cos(roll) - z * math.sin(roll), y * math.sin(roll) + z * math.cos(roll)
    x, z = x * math.cos(pitch) + z * math.sin(pitch), z * math.cos(pitch) - x * math.sin(pitch)
    x, y = x * math.cos(yaw) - y * math.sin(yaw), x * math.sin(yaw) + y * math.cos(yaw)
    return x, y, z


@dataclass(frozen=True, slots=True)
class Wall:
    """The face of a wall, in the robot's frame."""

    bearing: float  # of its normal, rad clockwise from ahead
    distance: float  # of its plane from the robot's reference point, m
    left: float  # its ends, m to the right of where the normal meets it
    right: float
    top: float  # z, m, down positive
    bottom: float

    def along(self, start: Vector, way: Vector) -> tuple[float, float]:
        """Where a ray meets the wall: m along it, inf for a miss, and m between there and the
        nearest edge, or by how much it misses; inf if it goes away from the wall."""
        cos, sin = math.cos(self.bearing), math.sin(self.bearing)
        speed = cos * way[0] + sin * way[1]
        if speed < 0.05:
            return math.inf, math.inf
        length = (self.distance - cos * start[0] - sin * start[1]) / speed
        if length < 0.0:
            return math.inf, math.inf
        margin = self.margin(tuple(a + length * b for a, b in zip(start, way, strict=True)))
        return (length, margin) if margin > 0.0 else (math.inf, -margin)

    def margin(self, point: Sequence[float]) -> float:
        """m from a point of the wall's plane to the nearest edge, negative outside."""
        across = -math.sin(self.bearing) * point[0] + math.cos(self.bearing) * point[1]
        return min(
            across - self.left, self.right - across, point[2] - self.top, self.bottom - point[2]
        )

    def off(self, point: Sequence[float]) -> float:
        """m from the wall's plane to a point, positive beyond it."""
        return math.cos(self.bearing) * point[0] + math.sin(self.bearing) * point[1] - self.distance


@dataclass(frozen=True)
class Scene:
    """What was said while a wall stood somewhere."""

    name: str  # of the scene
    wall: Wall | None  # where it stood; None for open floor
    place: tuple[float, ...]  # the wall's middle in the world; x, y, z, yaw
    track: Track  # what the robot said


@dataclass(frozen=True)
class Surrounded:
    """A robot among walls."""

    equipment: Equipment  # of its class
    place: Place  # of the robot
    height: float  # z of its reference point in the world
    wall_name: str  # of the wall
    scenes: tuple[Scene, ...]
    """`open` floor; a wall `ahead`, `half` of it on the left, a `low` one, `right`, `behind`,
    `left`, a `narrow` one all around, `far` ones near the ends of ranges."""
    floor: float = math.inf
    """z of the floor in the robot's frame; inf if nothing stands on it, or nobody looked."""
    order: tuple[int, int, int] = (0, 1, 2)
    """In which angles of mounts are taken, to find out whether GEO tells them in another one."""

    def of(self, *names: str) -> list[Scene]:
        """Scenes of these names; all without one."""
        return [scene for scene in self.scenes if not names or scene.name in names]

    def mounts(self, type: str) -> dict[str, Mount]:
        """Sensors of a type that sit on the body."""
        return {
            name: replace(mount, orientation=tuple(mount.orientation[one] for one in self.order))
            for name, mount in self.equipment.on_body(type).items()
        }

    def inside(self, point: Sequence[float]) -> Vector:
        """A point of the world in the robot's frame."""
        x, y = (point[n] - self.place.location[n] for n in (0, 1))
        cos, sin = math.cos(_YAW), math.sin(_YAW)
        return cos * x + sin * y, cos * y - sin * x, point[2] - self.height


class Builder:
    """Puts walls about a robot.

    Attributes:
        name: of the wall that stands.
    """

    def __init__(self, case: Case, client: ControlClient, base: Place, height: float) -> None:
        self._case = case
        self._client = client
        self._base = base
        self._height = height
        self._size: tuple[float, float, float] | None = None
        self.name = ""

    async def put(
        self,
        bearing: float,
        distance: float,
        width: float = 3.0,
        aside: float = 0.0,
        top: float = -_HIGH,
        high: float = _HIGH + 0.1,
    ) -> tuple[Wall, tuple[float, ...]]:
        """Put a wall; that before it goes, unless it only moves.

        Args:
            bearing, distance: of its face.
            width, high: of its face, m.
            aside: m to the right of where the normal meets it.
            top: z of its upper edge in the robot's frame.

        Returns:
            Where its face is, and the place of its middle in the world.
        """
        away = distance + _THICK / 2.0
        ahead = away * math.cos(bearing) - aside * math.sin(bearing)
        right = away * math.sin(bearing) + aside * math.cos(bearing)
        place = self._base.moved(ahead, right)
        spot = (
            f"{place.location[0]:.4f},{place.location[1]:.4f},{self._height + top + high / 2:.4f}"
        )
        pose = f"{{Location {spot}}} {{Rotation 0,0,{self._base.rotation[2] + bearing:.4f}}}"
        size = (_THICK, width, high)
        if self.name and size == self._size:
            await self._client.send(f"CONTROL {{Type AbsMove}} {{Name {self.name}}} {pose}")
        else:
            await self.clear()
            self.name, self._size = self._case.new_name(), size
            await self._client.send(
                f"CONTROL {{Type Create}} {{ClassName Cube}} {{Name {self.name}}} {pose}"
                f" {{Scale {','.join(f'{one:g}' for one in size)}}} {{Physics None}}"
                " {Permanent true}"
            )
        line = await self._client.ask(
            f"CONTROL {{Type GetSTA}} {{Name {self.name}}}",
            lambda line: line.head == "STA",
            _BUILT,
        )
        if line.get("Name") != self.name:
            self._case.skip(f"no wall could be built: {line}")
        return self._face(line)

    async def clear(self) -> None:
        """Take the wall away."""
        if self.name:
            await self._client.send(f"CONTROL {{Type Kill}} {{Name {self.name}}}")
            await self._client.send("CONTROL {Type GetSTA} {Name NoSuchObject}")
            await self._client.maybe(lambda line: line.head == "STA", _BUILT)
        self.name = ""

    def _face(self, line: Line) -> tuple[Wall, tuple[float, ...]]:
        x, y, z = line.numbers("Location")
        deep, wide, high = line.numbers("Size")
        yaw = line.numbers("Rotation")[2]
        bearing = math.remainder(yaw - self._base.rotation[2], math.tau)
        dx, dy = x - self._base.location[0], y - self._base.location[1]
        distance = math.cos(yaw) * dx + math.sin(yaw) * dy - deep / 2.0
        across = math.cos(yaw) * dy - math.sin(yaw) * dx
        z -= self._height
        wall = Wall(
            bearing,
            distance,
            across - wide / 2.0,
            across + wide / 2.0,
            z - high / 2.0,
            z + high / 2.0,
        )
        return wall, (x, y, z + self._height, yaw)


async def among_walls(case: Case, class_name: str, round_about: bool = False) -> Surrounded:
    """A robot of a class among walls.

    Args:
        case: of the check.
        class_name: of the robot.
        round_about: also put a narrow wall all around it, which takes a while.

    Raises:
        NotApplicable: without a world controller, or open floor.
    """
    worn = await equipment(case, class_name)

    async def build(case: Case) -> Surrounded:
        client = await controller(case)
        base = lane(case)
        base = Place(None, base.location, (0.0, 0.0, _YAW))
        robot = await spawn_far(case, class_name, base)
        height = (await robot.pose()).location[2]
        builder = Builder(case, client, base, height)
        floor = math.inf
        if not round_about:
            floor = await _floor(case, client, base.moved(forward=-2.0, down=-1.0)) - height
        scenes = [await _scene(robot, "open", None, ())]
        if round_about:
            for step in range(round(math.tau / _STEP)):
                found = await builder.put(step * _STEP, _CIRCLE, _NARROW)
                scenes.append(await _scene(robot, "narrow", *found, seconds=0.2))
        else:
            scenes += await _about(robot, builder, worn)
        name = builder.name
        seen = floor if floor > 0.0 else math.inf  # what hangs in the air stands on none
        return Surrounded(worn, base, height, name, tuple(scenes), seen)

    key = "in a circle of walls" if round_about else "among walls"
    return await case.shared(f"{class_name} {key}", build)


async def _floor(case: Case, client: ControlClient, above: Place) -> float:
    """z of what a block stands on that is put above it (protocol reference 3.14)."""
    size = 0.2
    name = await create(case, client, above, (size,) * 3, " {Physics Ground}")
    stands = (await status_of(client, name)).numbers("Location")[2] + size / 2.0
    await client.send(f"CONTROL {{Type Kill}} {{Name {name}}}")
    await status_of(client, "NoSuchObject")
    return stands


async def _about(robot: Robot, builder: Builder, worn: Equipment) -> list[Scene]:
    imagers = list(worn.mounts("RangeImager"))
    scenes = []

    async def look(name: str, found: tuple[Wall, tuple[float, ...]], seconds: float) -> None:
        scenes.append(await _scene(robot, name, *found, seconds=seconds, imagers=imagers))

    for name, bearing in (("right", 0.25), ("behind", 0.5), ("left", -0.25), ("ahead", 0.0)):
        found = await builder.put(bearing * math.tau, 1.5)
        await look(name, found, _LONG if name == "ahead" else _SETTLE)
    await look("near", await builder.put(0.0, 0.40), _SETTLE)
    await look("half", await builder.put(0.0, 1.5, 3.0, aside=-1.4), _LONG)
    await look("low", await builder.put(0.0, 1.5, 3.0, top=-0.47, high=0.57), _LONG)
    limits = {
        float(item["MaxRange"])
        for line in worn.conf.values()
        for item in line.items()
        if "MaxRange" in item and "HorizontalFOV" not in item
    }
    for limit in sorted(limit for limit in limits if 0.5 < limit < _FAR):
        for share in (0.97, 1.05):
            # The sensors that have this limit sit within some decimetres of the front.
            found = await builder.put(0.0, share * limit + 0.25, 4.0)
            await look("far", found, _SETTLE)
    return scenes


async def _scene(
    robot: Robot,
    name: str,
    wall: Wall | None,
    place: tuple[float, ...],
    seconds: float = _SETTLE,
    imagers: Sequence[str] = (),
) -> Scene:
    """What a robot says now that the wall stands."""
    begun = await settled(robot)
    first = len(robot.client.lines)
    await robot.run(_LATE)
    if seconds > 1.0:
        for one in imagers:
            await robot.client.send(f"SET {{Type RangeImager}} {{Name {one}}} {{Opcode SCAN}}")
    await robot.run(seconds)
    return Scene(name, wall, place, Track(robot.client.lines[first:]).between(begun, math.inf))


async def settled(robot: Robot) -> float:
    """From which time on reports are of the world as it is now: others may still be on their
    way, for a server measures first and writes a little later."""
    await robot.catch_up()
    told = [line.time for line in robot.client.lines[-60:] if not math.isnan(line.time)]
    return max(told, default=robot.now) + _LATE
