"""Robots driven through several commands, with where they really were: numbers against numbers."""

from __future__ import annotations

import asyncio
import itertools
import math
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from statistics import fmean, linear_regression
from typing import TypeVar

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot, turned
from usarsim_conformance.grounds import open_floor
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place
from usarsim_conformance.registry import Inconclusive, NotApplicable

Made = TypeVar("Made")


@dataclass(frozen=True, slots=True)
class Moment:
    """Where a robot was, in the frame of the wire: m and rad, yaw without jumps."""

    time: float  # simulated s
    location: tuple[float, ...]  # x, y, z
    roll: float  # right side down, nose up, clockwise seen from above
    pitch: float
    yaw: float


@dataclass
class Leg:
    """What a robot did under one command."""

    command: str  # that was in force
    lines: list[Line]  # what it said meanwhile
    moments: list[Moment] = field(default_factory=list)  # where it was, by GroundTruth

    def _steady(self, share: float = 0.6) -> tuple[Moment, Moment]:
        """Begin and end of the later part, when ramps are over."""
        if len(self.moments) < 5:
            raise Inconclusive("the robot has no GroundTruth to tell where it was")
        return self.moments[int(len(self.moments) * (1.0 - share))], self.moments[-1]

    @property
    def velocity(self) -> tuple[float, float, float]:
        """Speed ahead, to the right and down, m/s, in the directions of its middle yaw."""
        return self.velocity_at_last(0.6)

    def velocity_at_last(self, share: float) -> tuple[float, float, float]:
        """The same, in the last share of the time only.

        It is the slope of all places over time (least squares), not the way between two of them:
        reports are rounded to centimetres, which is some 5 percent of the way of a second.
        """
        first, last = self._steady(share)
        later = [one for one in self.moments if one.time >= first.time]
        times = [one.time for one in later]
        x, y, z = (
            linear_regression(times, axis).slope
            for axis in zip(*(one.location for one in later), strict=True)
        )
        middle = (first.yaw + last.yaw) / 2.0
        cos, sin = math.cos(middle), math.sin(middle)
        return cos * x + sin * y, cos * y - sin * x, z

    @property
    def speed(self) -> float:
        """m/s along its path, negative backwards."""
        first, last = self._steady()
        # On an arc of h to either side of its middle, places along the middle's direction go as
        # sin(t) for -h <= t <= h, whose slope by least squares is 3 (sin h - h cos h) / h^3.
        ahead, right, _ = self.velocity
        half = abs(last.yaw - first.yaw) / 2.0
        curved = 1e-2 < half < 3.0
        longer = half**3 / (3.0 * (math.sin(half) - half * math.cos(half))) if curved else 1.0
        return math.copysign(math.hypot(ahead, right) * longer, ahead)

    @property
    def turning(self) -> float:
        """rad/s, clockwise."""
        first, last = self._steady()
        return (last.yaw - first.yaw) / (last.time - first.time)

    @property
    def gone(self) -> float:
        """How far it went, m, as the crow flies."""
        self._steady()
        return self._away(self.moments[-1])

    def took(self, near: float, far: float) -> float:
        """s from when it was so far from its first place to when it was farther; between reports
        by a straight line. Unlike how far it comes in a time, this does not depend on when its
        first report came after the command.

        Args:
            near: m.
            far: m, at most `gone`.
        """
        passed = []
        for wanted in (near, far):
            for before, after in itertools.pairwise(self.moments):
                a, b = self._away(before), self._away(after)
                if a <= wanted <= b and b > a:
                    share = (wanted - a) / (b - a)
                    passed.append(before.time + share * (after.time - before.time))
                    break
        if len(passed) < 2:
            raise Inconclusive(f"it does not go from {near:.2f} to {far:.2f} m on a straight way")
        return passed[1] - passed[0]

    def _away(self, moment: Moment) -> float:
        return math.dist(self.moments[0].location, moment.location)

    @property
    def roll(self) -> float:
        """Mean of the last fifth, rad."""
        return self._mean("roll")

    @property
    def pitch(self) -> float:
        """Mean of the last fifth, rad."""
        return self._mean("pitch")

    def _mean(self, name: str) -> float:
        first, _ = self._steady(0.2)
        return fmean(getattr(one, name) for one in self.moments if one.time >= first.time)

    @property
    def status(self) -> Line:
        """Its last STA."""
        return [line for line in self.lines if line.head == "STA"][-1]

    def last(self, accept: Callable[[Line], bool]) -> Line | None:
        """Its last line of some kind."""
        return next((line for line in reversed(self.lines) if accept(line)), None)


@dataclass
class Trip:
    """A robot, what it says of itself, and what it did."""

    class_name: str  # of the robot
    dialect: str  # that it spoke
    conf: Line  # what it told of itself
    geo: Line
    legs: dict[str, Leg] = field(default_factory=dict)  # by name

    def __getitem__(self, name: str) -> Leg:
        return self.legs[name]


def moments_of(lines: Sequence[Line]) -> list[Moment]:
    """Where a robot was by its GroundTruth, or by INS if it has none."""
    for type in ("GroundTruth", "INS"):
        found: list[Moment] = []
        for line in lines:
            place, angles = line.numbers("Location"), line.numbers("Orientation")
            if line.head != "SEN" or line.type != type or len(place) != 3 or len(angles) != 3:
                continue
            if not all(map(math.isfinite, (*place, *angles, line.time))):
                continue
            roll, pitch = (turned(0.0, angle) for angle in angles[:2])
            yaw = angles[2]
            if found:
                yaw = found[-1].yaw + turned(found[-1].yaw, yaw)
            if not found or line.time > found[-1].time:
                found.append(Moment(line.time, place, roll, pitch, yaw))
        if found:
            return found
    return []


async def ride(robot: Robot, command: str, seconds: float) -> Leg:
    """What a robot does under a command for a simulated time, from when it was executed."""
    lines = await robot.under(command, seconds=seconds)
    return Leg(command, lines, moments_of(lines))


async def begin(
    case: Case, class_name: str, place: Place, settle: float = 1.0
) -> tuple[Robot, Trip]:
    """A robot of a class and what it tells of itself.

    Raises:
        NotApplicable: if the server has no such class.
    """
    try:
        robot = await case.spawn(place=place, class_name=class_name)
    except Inconclusive as error:
        raise NotApplicable(str(error)) from None

    def of_robot(head: str) -> Callable[[Line], bool]:
        return lambda line: line.head == head and line.type != "Camera"

    conf = await robot.client.ask("GETCONF {Type Robot}", of_robot("CONF"))
    geo = await robot.client.ask("GETGEO {Type Robot}", of_robot("GEO"))
    await robot.run(settle)
    return robot, Trip(class_name, case.dialect, conf, geo)


async def on_open_floor(
    case: Case,
    key: str,
    class_name: str,
    drive: Callable[[Robot, Trip], Awaitable[None]],
    up: float = 0.0,
) -> Trip:
    """A trip of a robot of a class on open floor, made once for each dialect.

    Args:
        case: the check that wants it.
        key: name of the trip.
        class_name: of the robot.
        drive: drives it and fills in the legs.
        up: m above the height of start poses.

    Raises:
        NotApplicable: if there is no such class, or no open floor.
    """

    async def make(case: Case) -> Trip | NotApplicable:
        try:
            async with open_floor(case) as lot:
                robot, trip = await begin(case, class_name, lot.moved(down=-up))
                try:
                    await drive(robot, trip)
                finally:
                    robot.close()
                return trip
        except NotApplicable as error:
            return error  # not broken: there is nothing to judge

    made = await case.shared(f"{key} of {class_name}", make)
    if isinstance(made, NotApplicable):
        raise made
    return made


async def of_classes(
    case: Case, classes: Sequence[str], make: Callable[[Case, str], Awaitable[Made]]
) -> list[Made]:
    """The same for several classes side by side, without those that the server does not have.

    Raises:
        NotApplicable: if it has none of them.
        Inconclusive: if one could not be judged.
    """
    found = await asyncio.gather(
        *(make(case, class_name) for class_name in classes), return_exceptions=True
    )
    for one in found:
        if isinstance(one, BaseException) and not isinstance(one, NotApplicable):
            raise one
    made = [one for one in found if not isinstance(one, BaseException)]
    if not made:
        raise NotApplicable("; ".join(dict.fromkeys(str(one) for one in found)))
    return made


def near(found: float, wanted: float, share: float, least: float = 0.0) -> bool:
    """Whether a number is within a share of another, or within a least difference."""
    return abs(found - wanted) <= max(share * abs(wanted), least)
