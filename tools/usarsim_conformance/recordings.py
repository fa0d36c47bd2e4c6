"""Robots watched once, for the many checks that only look at what was said."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import fmean, median

from usarsim_conformance.case import PATIENCE, Case
from usarsim_conformance.control import ControlClient, Pose, Robot, pose_of
from usarsim_conformance.lines import Line
from usarsim_conformance.registry import Failed, Inconclusive, NotApplicable

_WATCHED = 1.7
"""s of simulated time; eight reports of a sensor with an interval of 0.2 s."""
_WATCHED_LONG = 8.0
"""s of simulated time in which no report may be missing."""
_EXEMPT = ("Camera",)
"""SEN types that name no item, nor could be asked for by one."""


@dataclass
class Recording:
    """A robot that stood still."""

    lines: list[Line] = field(default_factory=list)  # all, the greeting included, in order
    streamed: list[Line] = field(default_factory=list)
    """Those after the first STA, that one included."""
    replies: dict[tuple[str, str, str], Line | None] = field(default_factory=dict)
    """What GETCONF and GETGEO answered, by command, type and item name; an empty name stands for a
    request by type, None for no answer."""
    waited: float = math.nan
    """s of simulated time from INIT to the first STA or SEN, at most: a little before INIT the
    reference robot told the time."""
    torn: int = 0  # chunks of bytes that did not end with a line

    def of(self, head: str, type: str = "") -> list[Line]:
        """Streamed lines of a head, and of a type if given."""
        return [
            line for line in self.streamed if line.head == head and (not type or line.type == type)
        ]

    def types(self, head: str = "SEN") -> set[str]:
        """Types streamed under a head."""
        return {line.type for line in self.of(head) if line.type}


async def standing(case: Case) -> Recording:
    """The recording of a robot that stands, made once for each dialect."""
    return await case.shared("a recording of a standing robot", _stand)


async def watched(case: Case) -> list[Line]:
    """What a robot that stands says in eight seconds of simulated time, none of it passed over."""
    return await case.shared("a robot watched for long", _watch)


async def _watch(case: Case) -> list[Line]:
    robot = await case.spawn()
    await robot.run(0.5)
    return await robot.run(_WATCHED_LONG)


def irregular(times: Sequence[float], rough: bool = False) -> str:
    """What is wrong with the times of a stream that should be regular; empty if nothing.

    The n-th report has to come n periods after the first, within 3/4 of a period: a report that is
    left out, or comes twice, shifts all that follow.

    Args:
        times: of its reports, s of simulated time.
        rough: whether they are those of other lines nearby, and jitter.
    """
    span = 4 if rough else 1
    if len(times) < 3 * span:
        return ""
    gaps = [(b - a) / span for a, b in zip(times, times[span:], strict=False)]
    # The mean of those that are whole: they may alternate between two multiples of a time step.
    usual = median(gaps)
    period = fmean(gap for gap in gaps if abs(gap - usual) <= 0.5 / span * usual)
    for number, time in enumerate(times):
        late = time - times[0] - number * period
        if abs(late) > 0.75 * period + 0.02:
            what = "late: one is missing" if late > 0.0 else "early: one too many"
            return f"every {period:.3f} s, but no. {number + 1} at {time:g} s is {what}"
    return ""


async def senses(case: Case, type: str = "") -> tuple[Recording, list[Line]]:
    """The recording, and the SEN lines in it, of a type if given.

    Raises:
        NotApplicable: if there are none.
    """
    recording = await standing(case)
    lines = recording.of("SEN", type)
    if not lines:
        raise NotApplicable(f"the robot has no {type or 'sensor'}")
    return recording, lines


async def told(case: Case, command: str, type: str, name: str = "") -> Line:
    """What the standing robot answered to GETCONF or GETGEO.

    Raises:
        NotApplicable: if it has no item of the type.
        Failed: if it did not answer.
    """
    replies = (await standing(case)).replies
    if (command, type, name) not in replies:
        raise NotApplicable(f"the robot has no {type}")
    line = replies[command, type, name]
    if line is None:
        raise Failed(f"{command} of type {type} has no answer")
    return line


async def ground_told(case: Case, command: str) -> Line:
    """What a ground vehicle answered to GETCONF or GETGEO of the robot.

    Raises:
        NotApplicable: if the robot is none.
        Failed: if it did not answer.
    """
    line = await told(case, command, "Robot")
    if "GroundVehicle" not in line.text:
        raise NotApplicable(f"{case.robot_class} is no ground vehicle")
    return line


async def _stand(case: Case) -> Recording:
    recording = Recording()
    client = await case.connect()
    place = await case.place()
    await case.clock.sleep(0.0)  # until the time is told, which is then fresh
    begun = case.clock.told
    await client.send(case.init(place, case.new_name()))
    first = await client.maybe(lambda line: line.head in ("STA", "SEN"), PATIENCE)
    if first is None:
        raise Inconclusive(f"the robot sent nothing within {PATIENCE:g} s of its INIT")
    robot = Robot(client, "", case.robot_class, place, first)
    recording.streamed = [first, *await robot.run(_WATCHED)]
    recording.torn = client.wire.torn
    if case.survey.timed:
        times = (line.time for line in recording.streamed if not math.isnan(line.time))
        recording.waited = next(times, math.nan) - begun
    wanted: list[tuple[str, str]] = [("Robot", "")]
    for type, name in items_of(recording.streamed):
        wanted += [(type, name)] if (type, "") in wanted else [(type, ""), (type, name)]
    for type in ("Camera", "MisPkg", "Actuator"):
        wanted += [(type, "")] if (type, "") not in wanted else []
    for type, name in wanted:
        for command in ("GETCONF", "GETGEO"):
            named = f" {{Name {name}}}" if name else ""
            request = f"{command} {{Type {type}}}{named}"
            reply = await _reply(client, request, command.removeprefix("GET"))
            recording.replies[command, type, name] = reply
    recording.lines = list(client.lines)
    return recording


async def _reply(client: ControlClient, request: str, head: str) -> Line | None:
    """The reply to a request, None if the request behind it is answered and it is not."""
    await client.send(request, "GETSTARTPOSES")
    found: Line | None = None
    while (line := await client.line()) is not None:
        if line.head == head and found is None:
            found = line
        elif line.head == "NFO" and "StartPoses" in line.names:
            break
    return found


def items_of(lines: list[Line]) -> list[tuple[str, str]]:
    """Type and name of every item that was streamed, each once, in order."""
    found: dict[tuple[str, str], None] = {}
    for line in lines:
        if line.head in ("MISSTA", "ASTA"):
            type = "MisPkg" if line.head == "MISSTA" else "Actuator"
        elif line.head in ("SEN", "EFF") and line.type not in _EXEMPT:
            type = line.type
        else:
            continue
        for item in line.items():
            if item.get("Name"):
                found.setdefault((type, item["Name"]))
    return list(found)


@dataclass
class Phase:
    """A part of a drive."""

    command: str  # that was in force
    lines: list[Line]  # what was said meanwhile
    start: Pose | None = None  # poses before and after; None if the robot tells none
    end: Pose | None = None

    def sensor(self, type: str) -> list[Line]:
        """Lines of a sensor type."""
        return [line for line in self.lines if line.head == "SEN" and line.type == type]

    @property
    def moved(self) -> tuple[float, float, float]:
        """How far forward and right, m, and how far turned clockwise, rad."""
        if self.start is None or self.end is None:
            raise NotApplicable("the robot has no GroundTruth and no INS to tell where it is")
        forward, right = self.start.ahead(self.end)
        return forward, right, math.remainder(self.end.yaw - self.start.yaw, math.tau)


@dataclass
class Drive:
    """A drive of a skid steered robot: forward, back, clockwise, anticlockwise, stops between."""

    speed: float  # of the wheels, rad/s
    radius: float  # of the wheels, m
    separation: float  # of the wheels, m
    max_speed: float  # of the wheels as in CONF, rad/s
    phases: dict[str, Phase] = field(default_factory=dict)
    """By name: rest, forward, stopped, back, clockwise, anticlockwise."""


async def driven(case: Case) -> Drive:
    """The recording of a drive, made once for each dialect."""
    return await case.shared("a recording of a driving robot", _drive)


async def wheels_of(robot: Robot) -> tuple[float, float, float]:
    """Radius and separation of the wheels, m, and their largest speed, rad/s.

    Raises:
        NotApplicable: if the robot is not skid steered.
        Inconclusive: if it does not tell.
    """
    try:
        conf = await robot.client.ask("GETCONF {Type Robot}", "CONF {")
        geo = await robot.client.ask("GETGEO {Type Robot}", "GEO {")
    except Failed as error:
        raise Inconclusive(f"how the robot is driven cannot be found out: {error}") from None
    if conf.get("SteeringType") != "SkidSteered":
        raise NotApplicable(f"the robot is not skid steered but {conf.get('SteeringType')}")
    found = geo.number("WheelRadius"), geo.number("WheelSeparation"), conf.number("MaxSpeed")
    if not all(value > 0.0 for value in found):
        raise Inconclusive(f"wheels that are no wheels: {found}")
    return found


_PHASES = (
    ("rest", 0, 0, 0.4),
    ("forward", 1, 1, 1.4),
    ("stopped", 0, 0, 0.8),
    ("back", -1, -1, 1.0),
    ("halted", 0, 0, 0.6),
    ("clockwise", 1, -1, 1.2),
    ("steady", 0, 0, 0.6),
    ("anticlockwise", -1, 1, 0.8),
)
_PACE = 0.3
"""m/s; slow enough for the room that every start place has."""


async def _drive(case: Case) -> Drive:
    robot = await case.spawn()
    radius, separation, max_speed = await wheels_of(robot)
    speed = min(0.6 * max_speed, _PACE / radius)
    drive = Drive(speed, radius, separation, max_speed)
    await robot.run(0.6)  # settle
    for name, left, right, seconds in _PHASES:
        command = f"DRIVE {{Left {left * speed:.4f}}} {{Right {right * speed:.4f}}}"
        lines = await robot.under(command, seconds=seconds)
        poses = _poses(lines)
        drive.phases[name] = Phase(command, lines, *(poses[0], poses[-1]) if poses else ())
    return drive


def _poses(lines: list[Line]) -> list[Pose]:
    for type in ("GroundTruth", "INS"):
        found = [line for line in lines if line.head == "SEN" and line.type == type]
        if found:
            return [pose_of(line) for line in found]
    return []
