"""Driving cars, aircraft, flippers, arms and grippers (protocol reference 6.9)."""

from __future__ import annotations

import math
from collections.abc import Callable

from usarsim_conformance.case import Case
from usarsim_conformance.control import Pose, Robot, turned
from usarsim_conformance.lines import Line
from usarsim_conformance.registry import Severity, once, udk, unreal, ut2004

_HOVER = "DRIVE {AltitudeVelocity 0} {LinearVelocity 0} {LateralVelocity 0} {RotationalVelocity 0}"


async def _flown(case: Case, name: str, value: float, seconds: float = 1.2) -> tuple[Pose, Pose]:
    """Poses of an aerial robot before and after it has flown with one segment set."""
    robot = await case.spawn("aerial")
    # High enough that the ground does not matter.
    await robot.under(_HOVER.replace("AltitudeVelocity 0", "AltitudeVelocity 1"), seconds=1.2)
    await robot.under(_HOVER, seconds=0.6)
    before, after = await case.drive(robot, _HOVER.replace(f"{name} 0", f"{name} {value}"), seconds)
    await robot.send(_HOVER)
    return before, after


@unreal("aerial.climbs", "AltitudeVelocity climbs", "6, no. 151")
async def climbs(case: Case) -> None:
    """Positive AltitudeVelocity climbs: z becomes smaller."""
    before, after = await _flown(case, "AltitudeVelocity", 1.0)
    rise = before.location[2] - after.location[2]
    case.expect(
        rise > 0.3,
        f"z of Location falls by {rise:.2f} m as the aircraft climbs, not by more than 0.3 m",
    )


@unreal("aerial.forward", "LinearVelocity flies forward", "6, no. 151")
async def flies_forward(case: Case) -> None:
    """Positive LinearVelocity flies forward."""
    before, after = await _flown(case, "LinearVelocity", 0.6)
    ahead, _ = before.ahead(after)
    case.expect(ahead > 0.15, f"the aircraft goes {ahead:.2f} m ahead, not above 0.15 m")


@unreal("aerial.right", "LateralVelocity flies right", "6, no. 151")
async def flies_right(case: Case) -> None:
    """Positive LateralVelocity flies to the right."""
    before, after = await _flown(case, "LateralVelocity", 0.6)
    _, right = before.ahead(after)
    case.expect(right > 0.15, f"the aircraft goes {right:.2f} m to the right, not above 0.15 m")


@unreal("aerial.turns", "RotationalVelocity turns clockwise", "6, no. 151 and 152")
async def turns(case: Case) -> None:
    """Positive RotationalVelocity turns clockwise, in rad/s in ut2004 and in degrees per second
    in udk: 0.8 rad/s is 45.8 degrees per second."""
    value = 0.8 if case.dialect == "ut2004" else math.degrees(0.8)
    before, after = await _flown(case, "RotationalVelocity", value, 1.0)
    turn = turned(before.yaw, after.yaw)
    case.expect(
        0.3 < turn < 1.6,
        f"yaw of the aircraft changes by {turn:.2f} rad in 1 s, not by 0.3 to 1.6 rad",
    )


@unreal("aerial.hovers", "Zeros hover", "6, no. 151")
async def hovers(case: Case) -> None:
    """With all velocities zero the robot stays where it is in the air."""
    before, after = await _flown(case, "AltitudeVelocity", 0.0)
    away = math.dist(before.location, after.location)
    case.expect(
        away < 0.25, f"the aircraft drifts by {away:.2f} m at rest, not by less than 0.25 m"
    )


async def _steered(case: Case, *commands: str) -> tuple[float, Line]:
    robot = await case.spawn("ackerman")
    await robot.run(1.2)
    before = await robot.pose()
    lines = await robot.under(*commands, seconds=1.2)
    after = await robot.pose()
    await robot.send("DRIVE {Speed 0} {FrontSteer 0} {RearSteer 0}")
    return before.ahead(after)[0], [line for line in lines if line.head == "STA"][-1]


@unreal("ackerman.drives", "Speed drives a car", "3.4.2", exclusive=True)
async def car_drives(case: Case) -> None:
    """`DRIVE {Speed v} {FrontSteer 0} {RearSteer 0}` drives a car forward."""
    ahead, _ = await _steered(case, "DRIVE {Speed 2} {FrontSteer 0} {RearSteer 0}")
    case.expect(
        ahead > 0.05, f"the car goes {ahead:.2f} m ahead with Speed above 0, not above 0.05 m"
    )


@ut2004("ackerman.speed-alone", "Speed alone drives a car", "6, no. 149", exclusive=True)
async def speed_alone(case: Case) -> None:
    """In ut2004 Speed alone works."""
    ahead, _ = await _steered(case, "DRIVE {Speed 2}")
    case.expect(
        ahead > 0.05, f"the car goes {ahead:.2f} m ahead with Speed alone, not above 0.05 m"
    )


@udk("ackerman.all-three", "All three are needed in udk", "6, no. 149", exclusive=True)
async def all_three(case: Case) -> None:
    """In udk a car needs Speed, FrontSteer and RearSteer; one alone does nothing."""
    ahead, _ = await _steered(case, "DRIVE {Speed 2}")
    case.expect(
        abs(ahead) < 0.03,
        f"the car goes {ahead:.2f} m ahead with Speed alone, not less than 0.03 m",
    )


@unreal("ackerman.steer-limits", "Steering stays within limits", "6, no. 149", exclusive=True)
async def steer_limits(case: Case) -> None:
    """A steering angle beyond the limits of CONF stops at them."""
    _, status = await _steered(case, "DRIVE {Speed 0} {FrontSteer 9} {RearSteer 9}")
    for name in ("FrontSteer", "RearSteer"):
        case.expect(
            abs(status.number(name)) < 1.6,
            f"{name} is {status.get(name)} after 9 rad, not within 1.6 rad",
        )


@ut2004("flippers.multidrive", "MULTIDRIVE moves flippers", "6, no. 154")
async def multidrive(case: Case) -> None:
    """`MULTIDRIVE {FRFlipper 0.4} {FLflipper 0.4}` moves both flippers there, names in any
    case."""
    robot = await case.spawn("flippers")
    await robot.run(0.6)
    await robot.send("MULTIDRIVE {FRFlipper 0.4} {FLflipper 0.4}")
    lines = await robot.run(3.0)
    status = [line for line in lines if line.head == "STA"][-1]
    for name in ("FRFlipper", "FLFlipper"):
        case.expect(
            abs(status.number(name) - 0.4) < 0.1,
            f"{name} of STA is {status.get(name)}, not 0.4: {status}",
        )


def _links(line: Line) -> list[float]:
    return [float(value) for name, value in line.segments if name == "Value"]


async def _state(case: Case, robot: Robot) -> Line:
    """The next line of the first actuator's links."""
    line = await robot.client.maybe(lambda line: line.head in ("MISSTA", "ASTA"), 2.0)
    if line is None:
        case.skip(f"{robot.class_name} reports no actuator")
    assert line is not None
    return line


async def _moved(case: Case, robot: Robot, command: str, target: float) -> None:
    """The first link of an arm comes near a target."""
    name = (await _state(case, robot)).get("Name")
    await robot.send(command.replace("<arm>", name or ""))
    value = math.nan
    for _ in range(8):
        await robot.run(0.5)
        line = await robot.wait(
            lambda line: line.head in ("MISSTA", "ASTA") and line.get("Name") == name, what="links"
        )
        value = _links(line)[0]
        if abs(value - target) < 0.05:
            return
    case.fail(f"Value of link 1 of {name} is {value:.3f}, not {target}")


@unreal("arm.mispkg", "MISPKG counts links from 1", "6, no. 157")
async def mispkg(case: Case) -> None:
    """`MISPKG {Name p} {Link 1} {Value 0.2}`, with and without Order, moves the first link."""
    robot = await case.spawn("arm")
    await _moved(case, robot, "MISPKG {Name <arm>} {Link 1} {Value 0.2}", 0.2)
    await _moved(case, robot, "MISPKG {Name <arm>} {Link 1} {Value 0.1} {Order 0}", 0.1)


@udk("arm.act", "ACT counts links from 0", "6, no. 158")
async def act(case: Case) -> None:
    """`ACT {Name a} {Link 0} {Value 0.2}` moves the link that ASTA reports as Link 1."""
    robot = await case.spawn("arm")
    await _moved(case, robot, "ACT {Name <arm>} {Link 0} {Value 0.2}", 0.2)


@unreal("arm.out-of-range", "Links that are none are ignored", "6, no. 159")
async def out_of_range(case: Case) -> None:
    """Links out of range are ignored without disturbing the other groups of the command."""
    robot = await case.spawn("arm")
    await _moved(
        case, robot,
        "MISPKG {Name <arm>} {Link 99} {Value 1} {Link 0} {Value 1} {Link -1} {Value 1}"
        " {Link 1} {Value 0.15}",
        0.15,
    )  # fmt: skip


@unreal("arm.links", "Links are reported from 1", "4.9")
async def links(case: Case) -> None:
    """MISSTA (ut2004, with Torque) and ASTA (udk) number links from 1 without a gap."""
    robot = await case.spawn("arm")
    line = await _state(case, robot)
    head = "MISSTA" if case.dialect == "ut2004" else "ASTA"
    case.expect(
        line.head == head, f"the line of an arm has the head {line.head}, not {head}: {line}"
    )
    numbers = [value for name, value in line.segments if name == "Link"]
    case.expect(
        numbers == [str(n + 1) for n in range(len(numbers))] and numbers,
        f"links have the numbers {' '.join(numbers)}, not 1 and so on without a gap: {line}",
    )
    group = ("Link", "Value", "Torque") if head == "MISSTA" else ("Link", "Value")
    case.expect_names(line, ("Time", "Name", *group * len(numbers)))


@unreal("arm.limits", "Joints stop at their limits", "6, no. 160", Severity.SHOULD)
async def limits(case: Case) -> None:
    """A value beyond a joint's limit stops at the limit told by CONF."""
    robot = await case.spawn("arm")
    name = (await _state(case, robot)).get("Name") or ""
    conf = await robot.client.ask(
        f"GETCONF {{Type Actuator}} {{Name {name}}}", "CONF {Type Actuator"
    )
    low, high = conf.number("MinValue"), conf.number("MaxValue")
    if not low < high:
        case.skip("the first joint has no limits")
    await robot.send(f"MISPKG {{Name {name}}} {{Link 1}} {{Value 500}}")
    for line in await robot.run(2.0):
        if line.head in ("MISSTA", "ASTA") and line.get("Name") == name:
            value = _links(line)[0]
            case.expect(
                value <= high + 0.05,
                f"Value of link 1 of {name} is {value}, not at most {high}, MaxValue of CONF",
            )


@udk("arm.gripper", "Grippers open and close", "6, no. 161")
async def gripper(case: Case) -> None:
    """`SET {Type Gripper} {Name g} {Opcode OPEN}` and CLOSE change the Status of EFF."""
    robot = await case.spawn("gripper")
    line = await robot.client.maybe(lambda line: line.head == "EFF" and line.type == "Gripper", 2.0)
    if line is None:
        case.skip(f"{robot.class_name} has no Gripper")
    assert line is not None
    for opcode, status in (("CLOSE", "CLOSED"), ("OPEN", "OPEN"), ("CLOSE", "CLOSED")):
        await robot.send(f"SET {{Type Gripper}} {{Name {line.get('Name')}}} {{Opcode {opcode}}}")
        wanted = f"EFF with Status {status}"
        await robot.wait(_status(status), what=wanted)


def _status(status: str) -> Callable[[Line], bool]:
    return lambda line: line.head == "EFF" and line.get("Status") == status


@once(
    "legged.no-drive",
    "DRIVE moves no legged robot",
    "robots reference 5.2, no. 48",
    Severity.SHOULD,
)
async def no_drive(case: Case) -> None:
    """DRIVE to a legged robot does not move it."""
    robot = await case.spawn("legged")
    await robot.run(1.0)
    before, after = await case.drive(robot, "DRIVE {Left 2} {Right 2} {Speed 2}", 1.0)
    away = math.dist(before.location[:2], after.location[:2])
    case.expect(
        away < 0.1, f"a legged robot moves by {away:.2f} m with DRIVE, not by less than 0.1 m"
    )


@udk("legged.joints", "SET moves a joint", "6, no. 156")
async def joints(case: Case) -> None:
    """`SET {Type Joint} {Name j} {Opcode Angle} {Params 0.2}` moves a joint that STA reports."""
    robot = await case.spawn("legged")
    known = ("Time", "Battery", "Type", "LightToggle", "LightIntensity", "View")
    names = [name for name in robot.first.names if name not in known]
    case.need(names, f"STA lists no joints: {robot.first}")
    await robot.send(f"SET {{Type Joint}} {{Name {names[0]}}} {{Opcode Angle}} {{Params 0.2}}")
    lines = await robot.run(2.0)
    value = [line for line in lines if line.head == "STA"][-1].number(names[0])
    case.expect(abs(value - 0.2) < 0.06, f"{names[0]} of STA is {value}, not 0.2")


@once(
    "underwater.stays",
    "A submarine without orders stays",
    "robots reference 5.2, no. 49",
    Severity.INFORMATIVE,
    exclusive=True,
)
async def submarine(case: Case) -> None:
    """A submarine with zero input keeps its depth and ignores DRIVE keys of other families."""
    robot = await case.spawn("underwater")
    await robot.run(0.5)
    before, after = await case.drive(robot, "DRIVE {Left 2} {Right 2} {Speed 1}", 1.0)
    case.expect(
        math.dist(before.location, after.location) < 0.3,
        f"a submarine moves by {math.dist(before.location, after.location):.2f} m with Left, "
        "Right and Speed, not by less than 0.3 m",
    )
