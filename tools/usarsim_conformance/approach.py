"""A robot that drives to a wall and back, and where the truth port says that it is meanwhile: what
it tells is of the moment that it tells, or is late."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import median

import numpy as np

from usarsim_client import Line as ToldLine
from usarsim_client import actor
from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot, pose_of, turned
from usarsim_conformance.excursions import Equipment, Track, equipment, spawn_far
from usarsim_conformance.grounds import YAW, lane
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place
from usarsim_conformance.registry import NotApplicable
from usarsim_conformance.side_lines import LineClient
from usarsim_conformance.walls import Builder, controller

PACE = 1.0
"""m/s of an approach; less for robots that are slower."""
_AHEAD = 6.0
"""m from the robot to the wall at first."""
_STOPS = 1.6
"""m from the wall at which it turns back."""
_WALL = (6.0, -2.6, 3.0)
"""m: width, z of the upper edge, height."""
_SLOWEST = 0.4
"""m/s."""
_RAMP = 1.2
"""s until it drives steadily."""
_LOOKS = 30
"""How often it is looked for, in one or several rounds."""
_FEWEST = 12
_EVERY = 0.2
"""s between two looks."""
_NEAR = 0.15
"""s before and after a look by which the speed is told."""
_LOST = 4.0
"""m within which the robot is the one that is listed: others of its class are far away."""
_ROUNDS = 4
_LONGEST = 12.0
"""s that a way may take."""


@dataclass
class Way:
    """One way of an approach, to the wall or back, without its beginning."""

    speed: float  # m/s that were told, negative backwards
    track: Track  # what the robot said
    seen: list[tuple[float, float]] = field(default_factory=list)
    """Time, and m along the lane, as the truth port lists the robot."""


@dataclass
class Approach:
    """A robot that drove to a wall and back."""

    equipment: Equipment  # of its class
    base: Place  # where it began; the lane goes on in the direction of its yaw
    wall: float  # m along the lane to the wall's face; inf without a wall
    ways: list[Way] = field(default_factory=list)

    def along(self, place: tuple[float, ...]) -> float:
        """m along the lane."""
        x, y = (place[axis] - self.base.location[axis] for axis in (0, 1))
        return math.cos(YAW) * x + math.sin(YAW) * y

    def aside(self, place: tuple[float, ...]) -> float:
        """m to the right of the lane."""
        x, y = (place[axis] - self.base.location[axis] for axis in (0, 1))
        return math.cos(YAW) * y - math.sin(YAW) * x

    def told(self, way: Way) -> tuple[list[float], list[float]]:
        """Times of GroundTruth, and m along the lane that it told then."""
        times: list[float] = []
        places: list[float] = []
        for time, line in way.track.of("GroundTruth"):
            place = line.numbers("Location")
            if len(place) == 3 and (not times or time > times[-1]):
                times.append(time)
                places.append(self.along(place))
        return times, places

    @property
    def leaning(self) -> float:
        """Pitch by GroundTruth while it drives, the median, rad."""
        return median(
            abs(turned(0.0, pose.orientation[1]))
            for way in self.ways
            for _, pose in way.track.true_poses
        )

    def lateness(self) -> tuple[float, float, int]:
        """By how many s GroundTruth is late, its standard error, and of how many looks: the truth
        port lists a robot farther along by that time's way. NaN if there are too few looks.

        What is cut off or rounded does not depend on the speed; the way does.
        """
        pairs: list[tuple[float, float]] = []
        for way in self.ways:
            times, places = self.told(way)
            for time, place in way.seen:
                if len(times) > 4 and times[0] + _NEAR < time < times[-1] - _NEAR:
                    before, now, after = np.interp(
                        [time - _NEAR, time, time + _NEAR], times, places
                    )
                    pairs.append(((after - before) / (2.0 * _NEAR), place - now))
        speeds, offs = np.array(pairs).reshape(-1, 2).T
        spread = float(((speeds - speeds.mean()) ** 2).sum()) if len(pairs) >= _FEWEST else 0.0
        if spread < 0.01 * len(pairs) or not pairs:
            return math.nan, math.nan, len(pairs)
        slope = float(((speeds - speeds.mean()) * offs).sum()) / spread
        rest = offs - offs.mean() - slope * (speeds - speeds.mean())
        error = math.sqrt(float((rest**2).sum()) / (len(pairs) - 2) / spread)
        return slope, error, len(pairs)


async def approach(case: Case, class_name: str) -> Approach:
    """The approach of a class that can drive or fly ahead, made once for each dialect.

    Raises:
        NotApplicable: for other classes, or without open floor.
    """
    worn = await equipment(case, class_name)

    async def come(case: Case) -> Approach:
        base = Place(None, lane(case).location, (0.0, 0.0, YAW))
        robot = await spawn_far(case, class_name, base)
        pace = await pace_of(robot)
        if pace.speed < _SLOWEST:
            raise NotApplicable(f"{class_name} is too slow to tell its way from rounding")
        found = Approach(worn, base, math.inf)
        height = (await robot.pose()).location[2]
        with contextlib.suppress(NotApplicable):  # stamps of poses can be judged without a wall
            builder = Builder(case, await controller(case), base, height)
            width, top, high = _WALL
            wall, _ = await builder.put(0.0, _AHEAD + pace.half, width, top=top, high=high)
            found.wall = wall.distance
        truth: LineClient | None = None
        with contextlib.suppress(NotApplicable):
            truth = await LineClient.open(case, "truth")
        for _ in range(_ROUNDS):
            for sign in (1.0, -1.0):
                await _go(robot, found, pace, sign, truth)
            if truth is None or sum(len(way.seen) for way in found.ways) >= _LOOKS:
                break
        return found

    return await case.shared(f"{class_name} before a wall that it approaches", come)


@dataclass(frozen=True)
class Pace:
    """How a robot is driven ahead."""

    command: Callable[[float], str]  # for a part of the speed, negative backwards
    speed: float  # m/s
    half: float  # m from the middle of the robot to its front, at most


async def pace_of(robot: Robot) -> Pace:
    """How a robot is driven straight on, at `PACE` or as fast as it goes; aircraft are in the air
    afterwards.

    Raises:
        NotApplicable: for robots that one speed does not drive straight on.
    """

    def of_robot(head: str) -> Callable[[Line], bool]:
        return lambda line: line.head == head and line.type != "Camera"

    conf = await robot.client.ask("GETCONF {Type Robot}", of_robot("CONF"))
    geo = await robot.client.ask("GETGEO {Type Robot}", of_robot("GEO"))
    half = max(geo.numbers("Dimensions"), default=0.0) / 2.0
    if "AerialVehicle" in robot.first.text + conf.text:
        rise, rest = "{AltitudeVelocity 1}", "{LateralVelocity 0} {RotationalVelocity 0}"
        await robot.under(f"DRIVE {rise} {{LinearVelocity 0}} {rest}", seconds=1.0)
        return Pace(
            lambda part: f"DRIVE {{AltitudeVelocity 0}} {{LinearVelocity {part * PACE:g}}} {rest}",
            PACE,
            half,
        )
    radius, most = geo.number("WheelRadius"), conf.number("MaxSpeed")
    steering = conf.get("SteeringType")
    if steering not in ("SkidSteered", "AckermanSteered") or not (radius > 0.0 and most > 0.0):
        raise NotApplicable(f"{robot.class_name} is no vehicle that one speed drives straight on")
    speed = min(PACE, 0.8 * most * radius)
    form = "DRIVE {{Left {0:.4f}}} {{Right {0:.4f}}}"
    if steering == "AckermanSteered":
        form = "DRIVE {{Speed {0:.4f}}} {{FrontSteer 0}} {{RearSteer 0}}"
    return Pace(lambda part: form.format(part * speed / radius), speed, half)


async def _go(
    robot: Robot, found: Approach, pace: Pace, sign: float, truth: LineClient | None
) -> None:
    """One way: to where the wall is near, or back to where it began."""
    await robot.under(pace.command(sign), seconds=_RAMP)
    way, first = Way(sign * pace.speed, Track(())), len(robot.client.lines)
    end = min(found.wall, _AHEAD) - _STOPS - pace.half if sign > 0.0 else 0.5
    latest = robot.now + _LONGEST
    here = found.base.location
    while robot.now < latest:
        lines = await robot.run(_EVERY)
        here = next(
            (pose_of(line).location for line in reversed(lines) if line.type == "GroundTruth"), here
        )
        if truth is not None:
            way.seen += [(time, found.along(place)) for time, place in await _listed(truth, robot)
                         if math.dist(place, here) < _LOST]  # fmt: skip
        if sign * (found.along(here) - end) > 0.0:
            break
    way.track = Track(robot.client.lines[first:])
    found.ways.append(way)


async def _listed(truth: LineClient, robot: Robot) -> list[tuple[float, tuple[float, ...]]]:
    """Time and place of every robot of a class, by the truth port."""
    await truth.send(f"{{class USARBot.{robot.class_name}}}")
    found = []
    while (told := actor(ToldLine((await truth.line()).encode("latin-1")))) is not None:
        found.append((told.time, told.location))
    return found
