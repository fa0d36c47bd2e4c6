"""Driving wheeled robots (protocol reference 6.9)."""

from __future__ import annotations

import math
from itertools import pairwise

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot, turned
from usarsim_conformance.recordings import driven, ground_told, wheels_of
from usarsim_conformance.registry import Severity, control, once, udk, unreal, ut2004

_STILL = 0.02
"""m/s below which a robot stands; sensors print centimetres."""
_TURNS = 0.02
"""rad that even a long robot on tracks turns in a second; sensors print hundredths."""
_STEADY = 0.04
"""Share by which the speed of a robot that has reached it may still change in 0.7 s."""
_RAMP = 10
"""Times that a speed is measured, 0.7 s each, until heavy robots must have reached it."""


async def _rolling(robot: Robot, *commands: str, seconds: float = 1.0) -> tuple[float, float]:
    """Forward speed, m/s, and clockwise turning rate, rad/s, some time after commands."""
    await robot.under(*commands, seconds=0.4)
    before, start = await robot.pose(), robot.now
    await robot.run(seconds)
    after, end = await robot.pose(), robot.now
    passed = max(end - start, 1e-3)
    turn = turned(before.yaw, after.yaw)
    # Along the middle direction of the arc.
    forward, side = before.ahead(after)
    return (forward * math.cos(turn / 2) + side * math.sin(turn / 2)) / passed, turn / passed


@control("motion.forward", "Equal speeds drive forward", "6, no. 143")
async def forward(case: Case) -> None:
    """`DRIVE {Left v} {Right v}` with v above zero drives forward along the robot's x."""
    ahead, side, turn = (await driven(case)).phases["forward"].moved
    case.expect(
        ahead > 0.05, f"a robot that drives forward goes {ahead:.2f} m ahead, not above 0.05 m"
    )
    case.expect(
        abs(side) < 0.3 * ahead and abs(turn) < 0.4,
        f"a robot that drives forward goes {ahead:.2f} m ahead and {side:.2f} m right and turns "
        f"by {turn:.2f} rad, not straight on",
    )


@control("motion.back", "Negative speeds drive back", "6, no. 143")
async def back(case: Case) -> None:
    """`DRIVE {Left -v} {Right -v}` drives back."""
    ahead, _, _ = (await driven(case)).phases["back"].moved
    case.expect(
        ahead < -0.05, f"a robot that drives back goes {ahead:.2f} m ahead, not below -0.05 m"
    )


@unreal("motion.clockwise", "Left forward, right back turns clockwise", "6, no. 143")
async def clockwise(case: Case) -> None:
    """`DRIVE {Left v} {Right -v}` turns clockwise seen from above: left and right are not
    swapped. Clockwise is what increases odometry theta and, with z down, yaw."""
    _, _, turn = (await driven(case)).phases["clockwise"].moved
    case.expect(
        turn > _TURNS,
        f"yaw changes by {turn:.2f} rad, not by more than {_TURNS:g} rad, with Left above 0 and "
        "Right below 0",
    )


@unreal("motion.anticlockwise", "Right forward, left back turns anticlockwise", "6, no. 143")
async def anticlockwise(case: Case) -> None:
    """`DRIVE {Left -v} {Right v}` turns anticlockwise seen from above."""
    _, _, turn = (await driven(case)).phases["anticlockwise"].moved
    case.expect(
        turn < -_TURNS,
        f"yaw changes by {turn:.2f} rad, not by less than {-_TURNS:g} rad, with Left below 0 and "
        "Right above 0",
    )


@unreal("motion.in-place", "Opposite speeds turn on the spot", "3.4.1", Severity.SHOULD)
async def in_place(case: Case) -> None:
    """With opposite speeds the robot turns and hardly leaves its place."""
    ahead, side, _ = (await driven(case)).phases["clockwise"].moved
    case.expect(
        math.hypot(ahead, side) < 0.25,
        f"a robot with opposite speeds moves by {math.hypot(ahead, side):.2f} m, not by less than "
        "0.25 m",
    )


@control("motion.stops", "Zero stops", "6, no. 145")
async def stops(case: Case) -> None:
    """`DRIVE {Left 0} {Right 0}` stops the wheels."""
    phase = (await driven(case)).phases["steady"]
    ahead, side, turn = phase.moved
    case.expect(
        math.hypot(ahead, side) < 0.08,
        f"the robot rolls on by {math.hypot(ahead, side):.2f} m after Left 0 and Right 0, not by "
        "less than 0.08 m",
    )
    case.expect(
        abs(turn) < 0.3,
        f"the robot turns on by {turn:.2f} rad after Left 0 and Right 0, not by less than 0.3 rad",
    )


@control("motion.rests", "A robot at rest stays", "robots reference 5.3, no. 64")
async def rests(case: Case) -> None:
    """A robot that is not driven does not move."""
    ahead, side, turn = (await driven(case)).phases["rest"].moved
    case.expect(
        math.hypot(ahead, side) < 0.03,
        f"a robot at rest moves by {math.hypot(ahead, side):.3f} m, not by less than 0.03 m",
    )
    case.expect(
        abs(turn) < 0.03, f"a robot at rest turns by {turn:.3f} rad, not by less than 0.03 rad"
    )


@control("motion.speed", "WheelRadius predicts the speed", "6, no. 132", Severity.SHOULD)
async def speed(case: Case) -> None:
    """Wheel speed times WheelRadius of GEO is the speed of the robot within 10 percent."""
    drive = await driven(case)
    phase = drive.phases["forward"]
    lines = phase.sensor("GroundTruth")[2:]
    if len(lines) < 3:
        case.skip("the robot has no GroundTruth")
    first, last = lines[len(lines) // 3], lines[-1]
    times = (first.time, last.time)
    case.need(times[1] > times[0], "GroundTruth has no Time")
    gone = math.dist(first.numbers("Location")[:2], last.numbers("Location")[:2])
    found, wanted = gone / (times[1] - times[0]), drive.speed * drive.radius
    case.expect(
        abs(found - wanted) < 0.1 * wanted + 0.02,
        f"Location of GroundTruth changes by {found:.3f} m/s with wheels at {drive.speed:.2f} "
        f"rad/s, not by {wanted:.3f} m/s: speed of wheels times WheelRadius",
    )


@unreal("motion.turn-rate", "WheelSeparation predicts turning", "6, no. 132", Severity.INFORMATIVE)
async def turn_rate(case: Case) -> None:
    """r (L - R) / separation is the turning rate within 10 percent. (Wheels that scrub turn a
    real skid steered robot more slowly: informative.)"""
    drive = await driven(case)
    lines = drive.phases["clockwise"].sensor("GroundTruth")
    if len(lines) < 4:
        case.skip("the robot has no GroundTruth")
    first, last = lines[len(lines) // 3], lines[-1]
    angles = [line.numbers("Orientation")[2] for line in lines[len(lines) // 3 :]]
    found = sum(turned(a, b) for a, b in pairwise(angles)) / (last.time - first.time)
    wanted = 2.0 * drive.speed * drive.radius / drive.separation
    case.expect(
        abs(found - wanted) < 0.1 * wanted,
        f"yaw of GroundTruth changes by {found:.2f} rad/s, not by {wanted:.2f} rad/s: WheelRadius "
        "times Left less Right over WheelSeparation",
    )


@once("motion.persists", "A command stays in force", "6, no. 144")
async def persists(case: Case) -> None:
    """A drive command persists without repetition: there is no watchdog."""
    robot = await case.spawn()
    wheels = await wheels_of(robot)
    turn = min(1.0, 0.5 * wheels[2])
    await _rolling(robot, f"DRIVE {{Left {turn}}} {{Right {-turn}}}")
    await robot.run(4.0)
    _, rate = await _rolling(robot)
    case.expect(
        abs(rate) > 0.012,
        f"yaw changes by {rate:.3f} rad/s 5 s after the command, not by more than 0.012 rad/s",
    )


async def _cruising(case: Case, command: str) -> tuple[float, float, float]:
    """Speed under a command when it has stopped growing, m/s; radius and largest speed of the
    wheels. Nobody stands in the way meanwhile, who tells the time included."""
    async with case.clock.alone():
        robot = await case.spawn()
        radius, _, limit = await wheels_of(robot)
        found, before = 0.0, math.nan
        for _ in range(_RAMP):
            found, _ = await _rolling(robot, command, seconds=0.3)
            if abs(found - before) < _STEADY * abs(found):
                break
            before = found
        await robot.send("DRIVE {Left 0} {Right 0}")
        return found, radius, limit


@unreal("motion.clamped", "Speeds are clamped", "6, no. 131", exclusive=True)
async def clamped(case: Case) -> None:
    """Commanding more than MaxSpeed of CONF gives MaxSpeed."""
    found, radius, limit = await _cruising(case, "DRIVE {Left 1000} {Right 1000}")
    wanted = limit * radius
    case.expect(
        abs(found - wanted) < 0.2 * wanted,
        f"the robot drives at {found:.3f} m/s with 1000 rad/s, not at {wanted:.3f} m/s, as with "
        "MaxSpeed of CONF",
    )


@unreal("motion.normalized", "Normalized is percent", "6, no. 146", exclusive=True)
async def normalized(case: Case) -> None:
    """`DRIVE {Left 50} {Right 50} {Normalized true}` runs at half of MaxSpeed."""
    found, radius, limit = await _cruising(case, "DRIVE {Left 50} {Right 50} {Normalized true}")
    wanted = 0.5 * limit * radius
    case.expect(
        abs(found - wanted) < 0.2 * wanted,
        f"the robot drives at {found:.3f} m/s with Normalized 50, not at {wanted:.3f} m/s, half "
        "of MaxSpeed of CONF",
    )


async def _after_normalized(case: Case) -> tuple[float, float, float]:
    """Speed of a plain DRIVE after a normalized one, and what it is plain and in percent."""
    robot = await case.spawn()
    radius, _, limit = await wheels_of(robot)
    value = min(2.0, 0.8 * limit)
    command = f"DRIVE {{Left {value:.3f}}} {{Right {value:.3f}}}"
    await robot.send("DRIVE {Left 0} {Right 0} {Normalized true}")
    found, _ = await _rolling(robot, command)
    return found, value * radius, value / 100.0 * limit * radius


@ut2004("motion.normalized-once", "Normalized holds for its command", "6, no. 147")
async def normalized_once(case: Case) -> None:
    """In ut2004 a DRIVE without Normalized is in rad/s, whatever the one before was."""
    found, plain, _ = await _after_normalized(case)
    case.expect(
        abs(found - plain) < 0.25 * plain,
        f"the robot drives at {found:.3f} m/s without Normalized, not at {plain:.3f} m/s: Left "
        "and Right in rad/s",
    )


@udk("motion.normalized-sticky", "Normalized sticks in udk", "6, no. 147")
async def normalized_sticky(case: Case) -> None:
    """In udk ground vehicles remember Normalized until it is sent again."""
    found, _, percent = await _after_normalized(case)
    case.expect(
        abs(found - percent) < _STILL,
        f"the robot drives at {found:.3f} m/s without Normalized, which was sent before, not at "
        f"{percent:.3f} m/s: Left and Right in percent",
    )


async def _one_side(case: Case) -> tuple[float, float]:
    robot = await case.spawn()
    _, _, limit = await wheels_of(robot)
    value = min(2.0, 0.6 * limit)
    return await _rolling(robot, "DRIVE {Left 0} {Right 0}", f"DRIVE {{Left {value}}}")


@ut2004("motion.one-side", "One side alone keeps the other", "6, no. 148")
async def one_side(case: Case) -> None:
    """In ut2004 `DRIVE {Left v}` alone keeps the right side: the robot turns clockwise."""
    _, rate = await _one_side(case)
    case.expect(
        rate > 0.012,
        f"yaw changes by {rate:.3f} rad/s with Left alone, not by more than 0.012 rad/s",
    )


@udk("motion.one-side-udk", "One side alone does nothing in udk", "6, no. 148")
async def one_side_udk(case: Case) -> None:
    """In udk `DRIVE {Left v}` alone does nothing."""
    speed, rate = await _one_side(case)
    case.expect(
        abs(speed) < _STILL and abs(rate) < 0.05,
        f"the robot drives at {speed:.3f} m/s and {rate:.3f} rad/s with Left alone, not below "
        f"{_STILL:g} m/s and 0.05 rad/s",
    )


@once("motion.unknown-name", "A Name in a wheel command is ignored", "protocol reference, addendum")
async def unknown_name(case: Case) -> None:
    """`DRIVE {Name robot_0} {Left v} {Right v}` is a wheel command; the unknown Name is ignored."""
    robot = await case.spawn()
    radius, _, limit = await wheels_of(robot)
    value = min(2.0, 0.6 * limit)
    found, _ = await _rolling(
        robot, f"DRIVE {{Name robot_0}} {{Left {value}}} {{Right {value}}}", seconds=0.6
    )
    wanted = value * radius
    case.expect(
        found > 0.5 * wanted,
        f"the robot drives at {found:.3f} m/s after DRIVE with an unknown Name, not at about "
        f"{wanted:.3f} m/s",
    )


@once("motion.segments-of-all", "Segments of all vehicle kinds at once", "5.1.2")
async def segments_of_all(case: Case) -> None:
    """A DRIVE that carries zeros for all kinds of vehicles, as one client sends it to stop, stops
    the robot."""
    robot = await case.spawn()
    await _rolling(robot, "DRIVE {Left 2} {Right 2}", seconds=0.4)
    found, _ = await _rolling(
        robot,
        "DRIVE {Left 0.00} {Right 0.00} {Speed 0.00} {FrontSteer 0.00} {RearSteer 0.00}"
        " {AltitudeVelocity 0.00} {LinearVelocity 0.00} {LateralVelocity 0.00}"
        " {RotationalVelocity 0.00}",
        seconds=0.5,
    )
    case.expect(
        abs(found) < 0.05,
        f"the robot drives on at {found:.3f} m/s after DRIVE with zeros for all vehicles, not "
        "below 0.05 m/s",
    )


@unreal("motion.flip", "Flip does an upright robot no harm", "6, no. 153")
async def flip(case: Case) -> None:
    """`DRIVE {Flip True}` leaves an upright robot upright, where it is."""
    robot = await case.spawn()
    await robot.run(0.6)
    before, after = await case.drive(robot, "DRIVE {Flip True}", 1.5)
    moved = math.dist(before.location[:2], after.location[:2])
    case.expect(
        moved < 0.2, f"an upright robot moves by {moved:.2f} m with Flip, not by less than 0.2 m"
    )
    tilt = max(abs(turned(0.0, angle)) for angle in after.orientation[:2])
    case.expect(
        tilt < 0.2,
        f"an upright robot is tilted by {tilt:.2f} rad after Flip, not by less than 0.2 rad",
    )


@ut2004("motion.flip-over", "Flip rights an overturned robot", "6, no. 153")
async def flip_over(case: Case) -> None:
    """In ut2004 `DRIVE {Flip True}` puts an overturned ground vehicle upright."""
    await ground_told(case, "GETCONF")
    base = await case.place()
    case.need(base.tag is None or any(base.location), "the server lists no start poses")
    upside = type(base)(None, base.moved(down=-0.3).location, (math.pi, 0.0, base.rotation[2]))
    robot = await case.spawn(place=upside)
    await robot.run(1.2)
    before = await robot.pose()
    over = abs(turned(0.0, before.orientation[0]))
    # An arm may keep it from lying flat on its back.
    case.need(over > 0.8, f"the robot is not overturned, its roll is {over:.2f} rad")
    await robot.send("DRIVE {Flip True}")
    await robot.run(2.0)
    tilt = max(abs(turned(0.0, angle)) for angle in (await robot.pose()).orientation[:2])
    case.expect(
        tilt < 0.3,
        f"an overturned robot is still tilted by {tilt:.2f} rad after Flip, not by less than 0.3 "
        "rad",
    )


@ut2004("motion.wheel-by-wheel", "Wheels one by one", "6, no. 150", Severity.SHOULD)
async def wheel_by_wheel(case: Case) -> None:
    """`DRIVE {WheelNumber 0} {WheelSpeed v} {WheelNumber 1} {WheelSpeed v}` drives wheels 0 and 1
    of a skid steered robot, the foremost pair or one of each side: it moves forward."""
    robot = await case.spawn()
    radius, _, limit = await wheels_of(robot)
    value = min(2.0, 0.6 * limit)
    groups = " ".join(f"{{WheelNumber {n}}} {{WheelSpeed {value}}}" for n in range(4))
    found, _ = await _rolling(robot, f"DRIVE {groups}", seconds=0.6)
    wanted = value * radius
    case.expect(
        found > 0.4 * wanted,
        f"the robot drives at {found:.3f} m/s with WheelSpeed of each wheel, not at about "
        f"{wanted:.3f} m/s",
    )


@once("motion.order", "Commands are executed in order", "1.8")
async def in_order(case: Case) -> None:
    """Of many drive commands in one packet the last counts."""
    robot = await case.spawn()
    found, rate = await _rolling(
        robot, *[f"DRIVE {{Left {n % 5}}} {{Right {-n % 7}}}" for n in range(50)],
        "DRIVE {Left 0} {Right 0}", seconds=0.5,
    )  # fmt: skip
    case.expect(
        abs(found) < 0.05 and abs(rate) < 0.1,
        f"the robot drives at {found:.3f} m/s and {rate:.3f} rad/s, not below 0.05 m/s and 0.1 "
        "rad/s: the last of the commands is zero",
    )
