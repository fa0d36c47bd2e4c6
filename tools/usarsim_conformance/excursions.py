"""Robots driven and flown so that every axis is excited, and what all their sensors said.

One excursion serves all checks of a robot class in a dialect. It takes place on open floor far
from the start poses, so that nothing comes in between.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from statistics import median

from usarsim_conformance.case import PATIENCE, Case
from usarsim_conformance.control import Pose, Robot, pose_of, turned
from usarsim_conformance.grounds import lane
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place
from usarsim_conformance.recordings import wheels_of
from usarsim_conformance.registry import Inconclusive, NotApplicable

TYPES = (
    "Sonar", "IR", "Range", "RangeScanner", "IRScanner", "RangeScanner3D", "RangeImager", "PCL",
    "LineLaser", "ObjectSensor", "Odometry", "Encoder", "Tachometer", "INS", "INU", "IMU", "Accel",
    "AcceleroMeter", "MagneticCompass", "AltitudeSensor", "MissionTime", "GPS", "GroundTruth",
    "Touch", "TouchArray", "VictSensor", "VictRFID", "RFID", "RFIDTag", "RFIDReleaser",
    "HumanMotion", "Sound", "Acoustic", "CO2Sensor", "Camera", "Battery",
)  # fmt: skip

BEARERS = ("KitBench", "KitFlyer", "RescueP2AT", "AirRobot", "P3AT", "Kenaf", "Nao")
"""Classes that carry what the robot of most checks may lack. The first two are brought along by
`--self`; other servers do not have them."""

_PACE = 0.5
"""m/s of excursions."""
HEADING = 1.0
"""rad; yaw at which driven ones begin."""
_GRAIN = 0.012
"""s: times with two digits are those of the report nearby."""


_TOLD_ELSEWHERE = {
    "AltitudeSensor": ("relativeAltitude", 0, False),
    "MagneticCompass": ("MagneticAngle", 0, True),
    "IMU": ("Rotation", 2, True),
    "INS": ("Orientation", 2, True),
    "INU": ("Orientation", 2, True),
}
"""By type of sensor: segment, number in it, and whether it is yaw or else height above ground."""
_WINDOW = 0.4
"""s over which changes are compared."""


@dataclass(frozen=True, slots=True)
class Mount:
    """Where a sensor sits: m and rad, in the frame of what carries it."""

    location: tuple[float, ...]  # x, y, z
    orientation: tuple[float, ...]  # roll, pitch, yaw
    carrier: str  # `HARD`, the class, or a part


@dataclass(frozen=True)
class Equipment:
    """What a robot class carries, as GETCONF and GETGEO tell."""

    class_name: str  # of the robot
    conf: dict[str, Line] = field(default_factory=dict)  # replies by type
    geo: dict[str, Line] = field(default_factory=dict)

    def configured(self, type: str) -> dict[str, dict[str, str]]:
        """What CONF says of each item of a type, by name."""
        line = self.conf.get(type)
        return {} if line is None else {item["Name"]: item for item in line.items()}

    def mounts(self, type: str) -> dict[str, Mount]:
        """Where each item of a type sits, by name."""
        line = self.geo.get(type)
        found = {}
        for item in [] if line is None else line.items():
            location, orientation = (
                tuple(map(float, item[key].split(","))) for key in ("Location", "Orientation")
            )
            found[item["Name"]] = Mount(location, orientation, item.get("Mount", ""))
        return found

    def on_body(self, type: str) -> dict[str, Mount]:
        """Sensors of a type that sit on the body."""
        own = ("HARD", self.class_name)
        return {name: mount for name, mount in self.mounts(type).items() if mount.carrier in own}


class Track:
    """Lines with their times, and where the robot was.

    A line without Time is given that of the report before it: reports of one step come together.
    """

    def __init__(self, lines: Sequence[Line]) -> None:
        self.lines: list[tuple[float, Line]] = []
        now = math.nan
        for line in lines:
            now = line.time if not math.isnan(line.time) else now
            if not math.isnan(now):
                self.lines.append((now, line))

    @cached_property
    def _truth(self) -> tuple[list[float], list[Pose]]:
        times: list[float] = []
        poses: list[Pose] = []
        for time, line in self.lines:
            told = line.head == "SEN" and line.type == "GroundTruth"
            if told and (not times or time > times[-1]):
                times.append(time)
                poses.append(pose_of(line))
        return times, poses

    @property
    def true_poses(self) -> list[tuple[float, Pose]]:
        """Every report of GroundTruth.

        Raises:
            NotApplicable: if there are fewer than two.
        """
        times, poses = self._truth
        if len(times) < 2:
            raise NotApplicable("the robot has no GroundTruth")
        return list(zip(times, poses, strict=True))

    def truth(self, time: float) -> Pose:
        """Where the robot was at a time, between two reports of GroundTruth.

        Raises:
            NotApplicable: if there are none.
        """
        times, poses = self._truth
        if len(times) < 2:
            raise NotApplicable("the robot has no GroundTruth")
        after = min(max(bisect.bisect_left(times, time - _GRAIN), 0), len(times) - 1)
        if abs(times[after] - time) <= _GRAIN or after == 0:
            return poses[after]
        share = min((time - times[after - 1]) / (times[after] - times[after - 1]), 1.0)
        one, two = poses[after - 1], poses[after]
        x, y, z = (a + share * (b - a) for a, b in zip(one.location, two.location, strict=True))
        roll, pitch, yaw = (
            a + share * turned(a, b) for a, b in zip(one.orientation, two.orientation, strict=True)
        )
        return Pose((x, y, z), (roll, pitch, yaw))

    @cached_property
    def lateness(self) -> tuple[float, str]:
        """By how many s GroundTruth is late, and which sensors tell that; NaN unless two agree.

        Raises:
            NotApplicable: if there is no GroundTruth.
        """
        found = {}
        for type, (key, number, turns) in _TOLD_ELSEWHERE.items():
            told = [(time, line.numbers(key)) for time, line in self.of(type)]
            values = [(time, one[number]) for time, one in told if len(one) > number]
            if len(values) >= 20:
                late = self._late(values, turns)
                if not math.isnan(late):
                    found[type] = late
        middle = median(found.values()) if found else math.nan
        agree = [type for type, late in found.items() if abs(late - middle) < 0.08]
        if len(agree) < 2 or 2 * len(agree) <= len(found):
            return math.nan, ""
        return middle, " and ".join(agree)

    def _late(self, values: Sequence[tuple[float, float]], turns: bool) -> float:
        """The shift of GroundTruth with which it changes most like other values, s; NaN if with
        none it does."""
        best = (0.9, math.nan)  # likeness, shift
        step = max(1, round(_WINDOW / ((values[-1][0] - values[0][0]) / (len(values) - 1))))
        pairs = list(zip(values, values[step:], strict=False))
        changes = [turned(a, b) if turns else b - a for (_, a), (_, b) in pairs]
        for shift in (0.05 * number for number in range(-20, 21)):
            true = []
            for (before, _), (after, _) in pairs:
                one, two = (self.truth(time + shift) for time in (before, after))
                true.append(
                    turned(one.yaw, two.yaw) if turns else one.location[2] - two.location[2]
                )
            size = math.sqrt(sum(a * a for a in changes) * sum(b * b for b in true))
            if size > 1e-6:
                like = abs(sum(a * b for a, b in zip(changes, true, strict=True))) / size
                best = max(best, (like, shift))
        return best[1]

    def of(self, type: str) -> list[tuple[float, Line]]:
        """Reports of a sensor type."""
        return [(time, line) for time, line in self.lines if line.type == type]

    def items(self, type: str, key: str) -> dict[str, list[tuple[float, str]]]:
        """What each item of a type said under a key, by name."""
        found: dict[str, list[tuple[float, str]]] = {}
        for time, line in self.of(type):
            if line.head == "SEN":
                for item in line.items():
                    if key in item:
                        found.setdefault(item["Name"], []).append((time, item[key]))
        return found

    def between(self, start: float, end: float) -> Track:
        """The part from one time to another."""
        part = Track(())
        part.lines = [(time, line) for time, line in self.lines if start <= time <= end]
        return part


@dataclass(frozen=True)
class Stretch:
    """A part of an excursion."""

    name: str  # of it
    command: tuple[float, ...]
    """What was told: rad/s of left and right wheels; or m/s up, ahead, to the right and rad/s
    clockwise."""
    track: Track  # what was said, from the command on

    @cached_property
    def steady(self) -> Track:
        """What was said when the command had taken effect."""
        lines = self.track.lines
        return self.track.between(lines[0][0] + 0.8, lines[-1][0]) if lines else self.track


@dataclass(frozen=True)
class Excursion:
    """A robot that was driven or flown about."""

    equipment: Equipment  # of its class
    radius: float  # of its wheels, m; NaN for aircraft
    separation: float
    stretches: tuple[Stretch, ...]  # in order
    track: Track  # everything, also what was said while commands were on their way

    def of(self, name: str) -> list[Stretch]:
        """Stretches of a name."""
        return [one for one in self.stretches if one.name == name]


async def equipment(case: Case, class_name: str) -> Equipment:
    """What a class carries; nothing if there is no such class."""

    async def ask(case: Case) -> Equipment:
        found = Equipment(class_name)
        place = await case.place()
        client = await case.connect()
        # Whoever knows the class tells of it before the answer to the question behind.
        init = case.init(place, case.new_name(), class_name)
        await client.send(init, "GETCONF {Type Robot}", "GETSTARTPOSES")
        first = await client.maybe(
            lambda line: line.head in ("STA", "CONF") or "StartPoses" in line.names, PATIENCE
        )
        known = first is not None and first.head != "NFO"
        within = PATIENCE if known or class_name == case.survey.robot else 3.0
        if await client.maybe(lambda line: line.head == "STA", within) is None:
            return found
        asked = [f"{word} {{Type {type}}}" for type in TYPES for word in ("GETCONF", "GETGEO")]
        await client.send(*asked, "GETSTARTPOSES")
        while (line := await client.line()) is not None:
            if line.head == "NFO" and "StartPoses" in line.names:
                break
            replies = {"CONF": found.conf, "GEO": found.geo}.get(line.head)
            if replies is not None and line.items():
                replies.setdefault(line.type, line)
        return found

    return await case.shared(f"equipment of {class_name}", ask)


async def bearer(case: Case, *types: str, fixed: str = "") -> str:
    """A class that carries sensors of all these types, that of most checks if it does.

    Args:
        case: of the check.
        types: of the sensors.
        fixed: one of them that has to sit on the body, and not on a link that moves.

    Raises:
        NotApplicable: if none of those known does.
    """
    for class_name in (case.robot_class, *BEARERS):
        worn = await equipment(case, class_name)
        if set(types) <= set(worn.conf) and (not fixed or worn.on_body(fixed)):
            return class_name
    raise NotApplicable(f"no robot of this server carries {' and '.join(types)}")


async def spawn_far(case: Case, class_name: str, place: Place | None = None) -> Robot:
    """A robot on open floor, at rest.

    Raises:
        NotApplicable: if it does not stand where it should: there is no floor.
    """
    if not case.has_place:
        await case.place()  # so many robots at a time and no more
    place = place or lane(case)
    robot = await case.spawn(place=place, class_name=class_name)
    lines = await robot.run(1.2)
    poses = [pose_of(line) for line in lines if line.type == "GroundTruth"]
    if not poses:
        raise NotApplicable(f"{class_name} has no GroundTruth")
    if math.dist(poses[-1].location, place.location) > 0.6:
        raise NotApplicable(
            f"there is no open floor at {place.location[0]:g},{place.location[1]:g}: "
            "choose an empty map"
        )
    return robot


_DRIVES = (
    ("rest", 0.0, 0.0, 0.6),
    ("forward", 1.0, 1.0, 4.0),
    ("rest", 0.0, 0.0, 1.0),
    ("clockwise", 0.6, -0.6, 12.5),
    ("rest", 0.0, 0.0, 0.8),
    ("right", 1.0, 0.5, 6.0),
    ("left", 0.5, 1.0, 7.0),
    ("back", -1.0, -1.0, 3.0),
    ("anticlockwise", -0.6, 0.6, 8.0),
    ("rest", 0.0, 0.0, 0.8),
    ("right", 1.0, 0.5, 6.0),
    ("left", 0.5, 1.0, 5.0),
    ("rest", 0.0, 0.0, 0.8),
)
"""Name, left and right as parts of the speed, and s."""


async def drive_about(case: Case, class_name: str) -> Excursion:
    """The excursion of a skid steered class.

    Raises:
        NotApplicable: if it is no such class, or tells not where it is.
    """
    worn = await equipment(case, class_name)

    async def drive(case: Case) -> Excursion:
        place = Place(None, lane(case).location, (0.0, 0.0, HEADING))
        robot = await spawn_far(case, class_name, place)
        try:
            radius, separation, limit = await wheels_of(robot)
        except Inconclusive as error:
            raise NotApplicable(str(error)) from None
        speed = min(0.8 * limit, _PACE / radius)
        stretches: list[Stretch] = []
        begun = len(robot.client.lines)
        for name, left, right, seconds in _DRIVES:
            command = (left * speed, right * speed)
            text = "DRIVE {{Left {:.4f}}} {{Right {:.4f}}}".format(*command)
            lines = await robot.under(text, seconds=seconds)
            stretches.append(Stretch(name, command, Track(lines)))
        return _told(worn, radius, separation, stretches, robot.client.lines[begun:])

    return await case.shared(f"{class_name} driven about", drive)


_FLIGHTS = (
    ("up", 1.0, 0.0, 0.0, 0.0, 2.0),
    ("hover", 0.0, 0.0, 0.0, 0.0, 1.2),
    ("forward", 0.0, 1.0, 0.0, 0.0, 2.5),
    ("hover", 0.0, 0.0, 0.0, 0.0, 1.2),
    ("right", 0.0, 0.0, 1.0, 0.0, 2.5),
    ("hover", 0.0, 0.0, 0.0, 0.0, 1.2),
    ("clockwise", 0.0, 0.0, 0.0, 0.8, 2.5),
    ("hover", 0.0, 0.0, 0.0, 0.0, 1.2),
    ("forward", 0.0, 1.0, 0.0, 0.0, 2.5),
    ("back", 0.0, -1.0, 0.0, 0.0, 2.5),
    ("left", 0.0, 0.0, -1.0, 0.0, 2.5),
    ("hover", 0.0, 0.0, 0.0, 0.0, 1.2),
    ("anticlockwise", 0.0, 0.0, 0.0, -0.8, 4.0),
    ("all", 0.5, 0.7, 0.5, 0.5, 3.0),
    ("down", -0.7, 0.0, 0.0, 0.0, 2.0),
    ("hover", 0.0, 0.0, 0.0, 0.0, 1.2),
)
"""Name; m/s up, ahead, to the right; rad/s clockwise; s."""


async def fly_about(case: Case, class_name: str) -> Excursion:
    """The excursion of an aircraft.

    Raises:
        NotApplicable: if the class does not rise, or tells not where it is.
    """
    worn = await equipment(case, class_name)

    async def fly(case: Case) -> Excursion:
        robot = await spawn_far(case, class_name)
        unit = math.degrees(1.0) if case.dialect == "udk" else 1.0
        stretches: list[Stretch] = []
        begun = len(robot.client.lines)
        for name, up, ahead, right, turn, seconds in _FLIGHTS:
            text = (
                f"DRIVE {{AltitudeVelocity {up}}} {{LinearVelocity {ahead}}}"
                f" {{LateralVelocity {right}}} {{RotationalVelocity {turn * unit:.3f}}}"
            )
            lines = await robot.under(text, seconds=seconds)
            stretches.append(Stretch(name, (up, ahead, right, turn), Track(lines)))
        told = _told(worn, math.nan, math.nan, stretches, robot.client.lines[begun:])
        (_, start), *_, (_, end) = told.stretches[0].track.true_poses
        if start.location[2] - end.location[2] < 0.2:
            raise NotApplicable(f"{class_name} does not fly")
        return told

    return await case.shared(f"{class_name} flown about", fly)


def _told(
    worn: Equipment,
    radius: float,
    separation: float,
    stretches: list[Stretch],
    lines: Sequence[Line],
) -> Excursion:
    return Excursion(worn, radius, separation, tuple(stretches), Track(lines))
