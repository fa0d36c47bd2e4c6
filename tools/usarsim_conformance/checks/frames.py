"""Numbers, frames and time (protocol reference 6.4)."""

from __future__ import annotations

import math
import re
from itertools import pairwise

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot, turned
from usarsim_conformance.places import Place
from usarsim_conformance.recordings import driven, ground_told, standing, wheels_of
from usarsim_conformance.registry import Severity, control, gazebo, once, udk, unreal, ut2004

_ANGLES = ("roll", "pitch", "yaw")
_NUMBER = r"-?\d+\.\d+|-?\d+"


@control("numbers.plain", "Numbers are plain decimals", "6, no. 53")
async def plain(case: Case) -> None:
    """No server line contains an exponent, nan, inf, a leading plus, or a comma as decimal
    point."""
    for line in (await standing(case)).lines:
        for name, value in line.segments:
            for word in re.split(r"[ ,;\[\]]", value):
                bad = re.fullmatch(
                    r"[+-]?(nan|inf(inity)?)|[+-]?[\d.]+e[+-]?\d+|\+[\d.]+|-?\.\d+", word, re.I
                )
                case.expect(bad is None, f"{name} has {word!r}, not a plain decimal number: {line}")


@control("numbers.vectors", "Vectors have no blanks", "6, no. 54")
async def vectors(case: Case) -> None:
    """The numbers of a vector are joined by commas without blanks."""
    for line in (await standing(case)).lines:
        case.expect(
            not re.search(r"\d, +-?\d|\d ,", line.text),
            f"a vector has a blank beside a comma, not none: {line}",
        )


@control("numbers.triples", "Locations and Orientations are triples", "4.5")
async def triples(case: Case) -> None:
    """Location and Orientation always hold three numbers with commas between."""
    form = re.compile(rf"({_NUMBER}),({_NUMBER}),({_NUMBER})")
    for line in (await standing(case)).lines:
        for item in line.items():
            for name in ("Location", "Orientation"):
                value = item.get(name)
                case.expect(
                    value is None or form.fullmatch(value),
                    f"{name} is {value!r}, not three numbers with commas between: {line}",
                )


@control("numbers.booleans", "Booleans are True and False", "6, no. 55")
async def booleans(case: Case) -> None:
    """Booleans are written `True` and `False`."""
    for line in (await standing(case)).lines:
        wrong = re.search(r" (true|false|TRUE|FALSE)\}", line.text)
        case.expect(
            wrong is None or "Visible" in line.text,
            f"a boolean is {wrong and wrong[1]}, not True or False: {line}",
        )


_DIGITS: dict[str, dict[str, tuple[str, int]]] = {
    "Sonar": {"ut2004": ("Range", 4), "udk": ("Range", 4)},
    "RangeScanner": {"ut2004": ("Range", 4), "udk": ("Range", 2)},
    "Odometry": {"ut2004": ("Pose", 4), "udk": ("Pose", 4)},
    "INS": {"ut2004": ("Location", 2), "udk": ("Location", 2)},
    "GroundTruth": {"ut2004": ("Location", 2), "udk": ("Location", 3)},
}


async def _digits(case: Case, type: str) -> None:
    name, wanted = _DIGITS[type][case.dialect]
    lines = (await standing(case)).of("SEN", type)
    if not lines:
        case.skip(f"the robot has no {type}")
    for line in lines:
        for item in line.items():
            for word in (item.get(name) or "").split(","):
                found = len(word.partition(".")[2])
                case.expect(found == wanted, f"{name} has {found} digits, not {wanted}: {line}")


@unreal("digits.sonar", "Digits of Sonar", "6, no. 66", Severity.SHOULD)
async def digits_sonar(case: Case) -> None:
    """Sonar ranges have four digits after the point."""
    await _digits(case, "Sonar")


@unreal("digits.rangescanner", "Digits of RangeScanner", "6, no. 66", Severity.SHOULD)
async def digits_scanner(case: Case) -> None:
    """Ranges of a scan have four digits (ut2004) or two (udk)."""
    await _digits(case, "RangeScanner")


@unreal("digits.odometry", "Digits of Odometry", "6, no. 66", Severity.SHOULD)
async def digits_odometry(case: Case) -> None:
    """The odometry pose has four digits."""
    await _digits(case, "Odometry")


@unreal("digits.ins", "Digits of INS", "6, no. 66", Severity.SHOULD)
async def digits_ins(case: Case) -> None:
    """INS locations have two digits."""
    await _digits(case, "INS")


@unreal("digits.groundtruth", "Digits of GroundTruth", "6, no. 66", Severity.SHOULD)
async def digits_ground_truth(case: Case) -> None:
    """GroundTruth locations have two digits (ut2004) or three (udk)."""
    await _digits(case, "GroundTruth")


@unreal("digits.time", "Digits of SEN Time", "2.2", Severity.SHOULD)
async def digits_time(case: Case) -> None:
    """Time in SEN has four digits, but two for RangeScanner in ut2004."""
    for line in (await standing(case)).of("SEN"):
        value = line.get("Time")
        if value is None or line.type in ("RangeScanner3D", "RangeImager", "IRScanner"):
            continue
        wanted = 2 if case.dialect == "ut2004" and line.type == "RangeScanner" else 4
        case.expect(
            len(value.partition(".")[2]) == wanted,
            f"Time is {value}, not a number with {wanted} digits: {line}",
        )


@unreal("frames.down", "z points down", "6, no. 56")
async def down(case: Case) -> None:
    """A robot that is put higher reports a smaller z; the wire frame has z down."""
    fell = await _fallen(case, down=-1.2)
    case.expect(
        fell > 0.0,
        f"z of Location changes by {fell:.2f} m in a fall, not to above 0: z points up, not down",
    )


@gazebo("frames.up", "z points up in the Gazebo prototype", "4.15")
async def up(case: Case) -> None:
    """The prototype reports the frame of Gazebo: z up."""
    fell = await _fallen(case, down=1.2)
    case.expect(
        fell < 0.0,
        f"z of Location changes by {fell:.2f} m in a fall, not to below 0: z points down, not up",
    )


async def _fallen(case: Case, down: float) -> float:
    """By how much z of a robot grows that is put above a start pose."""
    await ground_told(case, "GETCONF")  # others may fly, or be fixed where they are put
    base = await _known_place(case)
    high = await case.spawn(place=base.moved(down=down))
    before = await high.pose()
    await high.run(2.0)
    fell = (await high.pose()).location[2] - before.location[2]
    case.need(
        abs(fell) > 0.1,
        f"z changed by {fell:.2f} m, not by more than 0.1: the robot did not fall from 1.2 m "
        "above a start pose",
    )
    return fell


@unreal("frames.floor", "Robots stand above the floor", "2.5", Severity.SHOULD)
async def floor(case: Case) -> None:
    """A mount above the reference point has a negative z in GEO: the laser of a ground robot is
    not below its wheels."""
    recording = await standing(case)
    reply = recording.replies.get(("GETGEO", "RangeScanner", ""))
    if reply is None:
        case.skip("the robot has no RangeScanner")
    for item in reply.items():
        z = float((item.get("Location") or "0,0,0").split(",")[2])
        case.expect(z < 0.05, f"the scanner is mounted at z {z}, not below 0.05: {reply}")


@unreal("frames.clockwise", "Yaw grows clockwise", "6, no. 58")
async def clockwise(case: Case) -> None:
    """A robot that turns clockwise seen from above, left wheels forward and right ones back,
    shows increasing yaw."""
    _, _, turn = (await driven(case)).phases["clockwise"].moved
    case.need(abs(turn) > 0.05, f"the robot turned by {turn:.3f} rad only")
    case.expect(turn > 0.0, f"turning clockwise changed yaw by {turn:.2f} rad, not above 0")


@unreal("frames.right", "y grows to the right", "6, no. 57")
async def right(case: Case) -> None:
    """A robot that drives a curve to the right ends with a larger y, seen from its start."""
    robot = await case.spawn()
    radius, _, limit = await wheels_of(robot)
    left = min(0.9 * limit, 0.3 / radius)
    await robot.run(0.4)
    command = f"DRIVE {{Left {left:.3f}}} {{Right {0.3 * left:.3f}}}"
    before, after = await case.drive(robot, command, 1.5)
    for _ in range(4):
        # Until it shows: what the reference point does first depends on what a robot turns about.
        if abs(turned(before.yaw, after.yaw)) > 0.5:
            break
        await robot.run(1.0)
        after = await robot.pose()
    case.need(
        abs(turned(before.yaw, after.yaw)) > 0.1,
        f"yaw changed by {turned(before.yaw, after.yaw):.2f} rad, not by more than 0.1",
    )
    _, side = before.ahead(after)
    case.expect(side > 0.005, f"y, seen from the start, changed by {side:.3f} m, not above 0.005")


@control("frames.facing", "Yaw of pi/2 faces +y", "6, no. 61")
async def facing(case: Case) -> None:
    """A robot put with yaw 1.5708 drives towards +y of the wire frame."""
    base = await _known_place(case)
    place = Place(None, base.location, (0.0, 0.0, 1.5708))
    robot = await case.spawn(place=place)
    await wheels_of(robot)
    await robot.run(0.4)
    before, after = await case.drive(robot, "DRIVE {Left 2} {Right 2}", 1.0)
    dx, dy = (after.location[axis] - before.location[axis] for axis in (0, 1))
    case.need(
        math.hypot(dx, dy) > 0.03,
        f"the robot moved by {math.hypot(dx, dy):.2f} m, not by more than 0.03",
    )
    case.expect(
        dy > abs(dx),
        f"Location of the robot changes by {dx:.2f} m along x and {dy:.2f} m along y, not along +y",
    )


_TILT, _SLACK = 0.35, 0.1
"""rad that a robot is tilted when it is put, and by which its first report may differ."""
_ABOVE, _FALLS = 1.5, 0.7
"""m that it is put above a start pose, and that it may have fallen until its first report."""


async def _tilted(case: Case, axis: int) -> None:
    base = await _known_place(case)
    rotation = [0.0, 0.0, base.rotation[2]]
    rotation[axis] = _TILT
    up = 1.0 if case.dialect == "gazebo" else -1.0
    place = Place(None, base.moved(down=up * _ABOVE).location, tuple(rotation))
    pose = await (robot := await case.spawn(place=place)).pose()
    found, fell = turned(0.0, pose.orientation[axis]), up * (place.location[2] - pose.location[2])
    flies = "AerialVehicle" in robot.first.text
    if abs(found) <= 0.1 and flies:
        case.skip("a robot that flies rights itself")
    case.need(abs(found) > 0.1, "the robot had settled before its first report")
    case.expect(
        abs(found - _TILT) < _SLACK or (flies and 0.0 < found < _TILT),
        f"{_ANGLES[axis]} of Orientation is {found:.2f} in the first report, not {_TILT} as in "
        "INIT",
    )
    case.expect(
        -_SLACK < fell < _FALLS,
        f"z of Location is {pose.location[2]:.2f} in the first report, not {place.location[2]:.2f} "
        f"as in INIT, or up to {_FALLS} m lower",
    )


@control("frames.pitch", "Nose up is positive pitch", "6, no. 59")
async def pitch(case: Case) -> None:
    """A robot put with its nose raised by 0.35 rad, pitch positive, reports that pitch first,
    within 0.1 rad, and the height of its INIT."""
    await _tilted(case, 1)


@control("frames.roll", "Right side down is positive roll", "6, no. 60")
async def roll(case: Case) -> None:
    """A robot put with its right side lowered by 0.35 rad, roll positive, reports that roll first,
    within 0.1 rad, and the height of its INIT."""
    await _tilted(case, 0)


async def _angles(case: Case, type: str, low: float, high: float) -> None:
    place = await _known_place(case)
    robot = await case.spawn(place=Place(None, place.location, (0.0, 0.0, -1.0)))
    for line in [await robot.sensor(type) for _ in range(4)]:
        for angle in line.numbers("Orientation"):
            case.expect(
                low <= angle <= high, f"an angle is {angle:g}, not {low:g} to {high:g}: {line}"
            )


@unreal("frames.ins-angles", "INS angles are not negative", "6, no. 64")
async def ins_angles(case: Case) -> None:
    """INS orientations are in [0, 6.2832), also for a robot with negative yaw."""
    if not (await standing(case)).of("SEN", "INS"):
        case.skip("the robot has no INS")
    await _angles(case, "INS", 0.0, 6.2832)


@ut2004("frames.truth-angles", "GroundTruth angles are not negative", "6, no. 65")
async def truth_angles(case: Case) -> None:
    """In ut2004 GroundTruth orientations are in [0, 6.2832)."""
    if not (await standing(case)).of("SEN", "GroundTruth"):
        case.skip("the robot has no GroundTruth")
    await _angles(case, "GroundTruth", 0.0, 6.2832)


@udk("frames.truth-angles-udk", "GroundTruth angles are signed", "6, no. 65")
async def truth_angles_udk(case: Case) -> None:
    """In udk GroundTruth orientations are in (-3.1416, 3.1416]."""
    if not (await standing(case)).of("SEN", "GroundTruth"):
        case.skip("the robot has no GroundTruth")
    await _angles(case, "GroundTruth", -3.1416, 3.1416)


@control("time.monotonic", "Time never goes back", "6, no. 67")
async def monotonic(case: Case) -> None:
    """Time never decreases on a connection, from line to line of the same kind."""
    latest: dict[tuple[str, str], float] = {}
    for line in (await standing(case)).streamed:
        if math.isnan(line.time):
            continue
        key = (line.head, line.type)
        case.expect(
            line.time >= latest.get(key, 0.0),
            f"Time is {line.time}, not at least {latest.get(key, 0.0)}, that of the {line.head} "
            f"before: {line}",
        )
        latest[key] = line.time


@control("time.advances", "Time advances", "2.6")
async def advances(case: Case) -> None:
    """Time advances from STA to STA, and all lines of a moment agree within a second."""
    lines = (await standing(case)).streamed
    times = [line.time for line in lines if line.head == "STA"]
    case.expect(
        len(times) > 2 and times[-1] > times[0],
        f"Time of STA is {times[-1:]} at last in {len(times)} lines, not above {times[:1]}, that "
        "of the first",
    )
    stated = [line.time for line in lines if not math.isnan(line.time)]
    case.expect(
        max(stated) - min(stated) < 1.0 + times[-1] - times[0],
        f"Time of all lines spans {max(stated) - min(stated):.2f} s, not less than "
        f"{1.0 + times[-1] - times[0]:.2f} s, a second more than that of STA",
    )


@once("time.shared", "All robots share a clock", "6, no. 68")
async def shared(case: Case) -> None:
    """Two robots report equal Time for lines of the same moment; Time does not start with
    INIT."""
    one = await case.spawn()
    await one.run(2.0)
    other = await case.spawn()
    # In turns, each told after the one before was read: none may be earlier than that.
    times = [await _told_now(robot) for robot in (one, other, one)]
    late = [a - b for a, b in pairwise(times)]
    case.expect(
        max(late) < 0.5,
        f"Time told by two robots in turns, one after the other, is {times}, not growing: it goes "
        f"back by {max(late):.2f} s",
    )


async def _told_now(robot: Robot) -> float:
    await robot.catch_up()
    return (await robot.wait(lambda line: line.head == "STA", what="STA")).time


async def _known_place(case: Case) -> Place:
    place = await case.place()
    case.need(place.tag is None or any(place.location), "the server lists no start poses")
    return place
