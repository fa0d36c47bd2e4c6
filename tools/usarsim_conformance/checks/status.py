"""STA lines (protocol reference 6.6)."""

from __future__ import annotations

import math
import re
from itertools import pairwise

from usarsim_conformance.case import Case
from usarsim_conformance.checks.values import lit
from usarsim_conformance.control import Robot
from usarsim_conformance.lines import Line, numbers
from usarsim_conformance.recordings import irregular, standing, watched
from usarsim_conformance.registry import (
    Severity,
    control,
    gazebo,
    once,
    udk,
    unreal,
    ut2004,
)
from usarsim_conformance.side_lines import LineClient, split_reply

_GROUND = re.compile(
    r"STA \{Type GroundVehicle\} \{Time \d+\.\d\d\} \{FrontSteer -?\d+\.\d{4}\}"
    r" \{RearSteer -?\d+\.\d{4}\}( \{\w+ -?\d+\.\d{4}\})*"
    r" \{LightToggle (True|False)\} \{LightIntensity \d+\} \{Battery \d+\} \{View -?\d+\}"
)
_GROUND_UDK = re.compile(
    r"STA \{Time \d+\.\d{4}\} \{Battery \d+\} \{Type GroundVehicle\}"
    r" \{LightToggle (True|False)\} \{LightIntensity 100\}"
    r" \{FrontSteer (0|-?\d+\.\d{4})\} \{RearSteer (0|-?\d+\.\d{4})\}"
)
_FULL_SPEED = (
    "DRIVE {Left 3} {Right 3}",
    "DRIVE {Speed 3} {FrontSteer 0} {RearSteer 0}",
    "DRIVE {AltitudeVelocity 1} {LinearVelocity 2} {LateralVelocity 0} {RotationalVelocity 0}",
)
"""Commands ahead of skid steered robots, cars and aircraft; each passes the others over."""
_PERIODS = {"ut2004": 0.2, "udk": 0.1}


async def _states(case: Case) -> list[Line]:
    lines = (await standing(case)).of("STA")
    case.need(lines, "no STA was streamed")
    return lines


async def _ground(case: Case) -> list[Line]:
    lines = await _states(case)
    if not any("GroundVehicle" in line.text for line in lines):
        case.skip(f"{case.robot_class} is no ground vehicle")
    return lines


@ut2004("status.ground-ut2004", "STA in the order of UT2004", "6, no. 85")
async def ground_ut2004(case: Case) -> None:
    """A ground vehicle's STA is Type, Time, FrontSteer, RearSteer, joints, LightToggle,
    LightIntensity, Battery, View, in this order, with two digits of time and four of angles."""
    for line in await _ground(case):
        case.expect(
            _GROUND.fullmatch(line.text),
            "STA has another form, not Type, Time, FrontSteer, RearSteer, joints, LightToggle, "
            f"LightIntensity, Battery, View with two digits of Time and four of angles: {line}",
        )


@udk("status.ground-udk", "STA as clients of UDK read it", "4.3 and 5.3")
async def ground_udk(case: Case) -> None:
    """A ground vehicle's STA has the segments of UDK, in UDK's order or in that of UT2004 with
    View, and four digits of time."""
    for line in await _ground(case):
        digits = re.search(r"\{Time \d+\.\d{4}\}", line.text)
        case.expect(digits, f"Time is {line.get('Time')}, not a number with four digits: {line}")
        expected = {"Type", "Time", "Battery", "LightToggle", "LightIntensity", "FrontSteer"}
        case.expect(
            expected <= set(line.names),
            f"{', '.join(sorted(expected - set(line.names)))} is missing: {line}",
        )
        ordered = line.names[0] == "Type" or _GROUND_UDK.fullmatch(line.text)
        case.expect(
            ordered,
            f"segments are {' '.join(line.names)}, not in the order of UDK nor in that of UT2004: "
            f"{line}",
        )


@gazebo("status.ground-gazebo", "STA in the form of the Gazebo prototype", "4.15", Severity.SHOULD)
async def ground_gazebo(case: Case) -> None:
    """STA is Time, Battery, Type, LightToggle, LightIntensity, FrontSteer, RearSteer,
    CountPer1sec, without blanks between."""
    names = (
        "Time", "Battery", "Type", "LightToggle", "LightIntensity", "FrontSteer", "RearSteer",
        "CountPer1sec",
    )  # fmt: skip
    for line in await _ground(case):
        case.expect_names(line, names)
        case.expect("} {" not in line.text, f"segments have blanks between, not none: {line}")


@control("status.type", "STA names its type", "5.2, no. 17")
async def has_type(case: Case) -> None:
    """Every STA of a robot has a Type, whatever the dialect."""
    for line in await _states(case):
        case.expect(line.type, f"Type is missing: {line}")


@control("status.integers", "Battery and View are integers", "6, no. 89")
async def integers(case: Case) -> None:
    """Battery, View and LightIntensity are integers."""
    for line in await _states(case):
        for name in ("Battery", "View", "LightIntensity"):
            value = line.get(name)
            case.expect(
                value is None or re.fullmatch(r"-?\d+", value), f"{name} is no integer: {line}"
            )


@control("status.time", "STA carries its time", "4.3")
async def has_time(case: Case) -> None:
    """Every STA has a Time, a plain decimal number."""
    robot = await case.spawn()
    for _ in range(8):
        line = await robot.wait(lambda line: line.head == "STA", what="STA")
        case.expect(
            re.fullmatch(r"\d+\.\d+", line.get("Time") or ""),
            f"Time is {line.get('Time')}, not a number with digits behind the point: {line}",
        )


@control("status.battery", "Battery counts down slowly", "4.3", Severity.SHOULD)
async def battery(case: Case) -> None:
    """Battery is 99999 for a robot without one, else seconds that never grow at rest."""
    lines = await _states(case)
    values = [line.number("Battery") for line in lines if line.get("Battery") is not None]
    if not values:
        case.skip("STA has no Battery")
    case.expect(all(value >= 0 for value in values), f"Battery is {min(values):g}, not at least 0")
    case.expect(
        all(a >= b for a, b in pairwise(values)), f"Battery grows at rest, and should not: {values}"
    )


@control("status.light", "DRIVE Light switches the light", "6, no. 90")
async def light(case: Case) -> None:
    """`DRIVE {Light true}` changes LightToggle to True within two STA lines."""
    robot = await lit(case)
    for state in ("true", "false"):
        await robot.send(f"DRIVE {{Light {state}}}")
        await robot.catch_up()
        seen = [await robot.wait(lambda line: line.head == "STA", what="STA") for _ in range(2)]
        case.expect(
            seen[-1].get("LightToggle") == state.title(),
            f"LightToggle is {seen[-1].get('LightToggle')} after Light {state}, not "
            f"{state.title()}: {seen[-1]}",
        )


@control("status.light-moves-nothing", "Light moves nothing", "6, no. 90")
async def light_moves_nothing(case: Case) -> None:
    """`DRIVE {Light true}` alone does not move the robot."""
    robot = await case.spawn()
    await robot.run(0.5)
    before, after = await case.drive(robot, "DRIVE {Light true}", 0.8)
    ahead = before.ahead(after)
    case.expect(
        max(map(abs, ahead)) < 0.03,
        f"the robot moves by {ahead} m with Light alone, not by less than 0.03 m",
    )


@unreal("status.rate", "STA keeps its rate", "6, no. 91", Severity.SHOULD)
async def rate(case: Case) -> None:
    """STA of ground vehicles comes every 0.2 s (ut2004) or 0.1 s (udk) of simulated time: over
    eight seconds within 2 percent."""
    await _ground(case)
    times = [line.time for line in await watched(case) if line.head == "STA"]
    case.need(len(times) > 4, f"only {len(times)} STA lines")
    period = (times[-1] - times[0]) / (len(times) - 1)
    wanted = _PERIODS[case.dialect]
    case.expect(
        abs(period - wanted) <= 0.02 * wanted,
        f"STA comes every {period:.3f} s, not every {wanted:g} s",
    )


@control("status.steady", "STA is regular", "6, no. 91")
async def steady(case: Case) -> None:
    """No STA is left out and none comes twice: over eight seconds of simulated time the n-th comes
    n periods after the first. Clients integrate what they get."""
    times = [line.time for line in await watched(case) if line.head == "STA"]
    case.need(len(times) > 4, f"only {len(times)} STA lines")
    odd = irregular(times)
    case.expect(not odd, f"STA does not come at one interval: {odd}")


@ut2004("status.aerial", "STA of aerial robots", "6, no. 87")
async def aerial(case: Case) -> None:
    """An aerial robot's STA has Type AerialVehicle right after the head."""
    robot = await case.spawn("aerial")
    case.expect(
        robot.first.segments[:1] == (("Type", "AerialVehicle"),),
        f"the first segment of STA is {robot.first.segments[:1]}, not Type AerialVehicle: "
        f"{robot.first}",
    )


@ut2004("status.flippers", "STA lists the flippers", "6, no. 88")
async def flippers(case: Case) -> None:
    """A robot with four flippers lists FRFlipper, FLFlipper, RRFlipper, RLFlipper in this order
    between RearSteer and LightToggle."""
    robot = await case.spawn("flippers")
    names = [name for name in robot.first.names if name.endswith("Flipper")]
    wanted = ["FRFlipper", "FLFlipper", "RRFlipper", "RLFlipper"]
    case.expect(
        names == wanted,
        f"flippers of STA are {' '.join(names)}, not {' '.join(wanted)}: {robot.first}",
    )
    place = robot.first.names.index("RearSteer")
    case.expect(
        robot.first.names[place + 1 : place + 5] == tuple(wanted),
        f"segments behind RearSteer are {' '.join(robot.first.names[place + 1 : place + 5])}, not "
        f"{' '.join(wanted)}: {robot.first}",
    )


@unreal("status.legged", "STA of legged robots", "4.4", Severity.SHOULD)
async def legged(case: Case) -> None:
    """A legged robot's STA has Type LeggedRobot (ut2004) or LeggedVehicle (udk)."""
    robot = await case.spawn("legged")
    wanted = "LeggedRobot" if case.dialect == "ut2004" else "LeggedVehicle"
    case.expect(
        robot.first.type == wanted,
        f"Type of STA is {robot.first.type}, not {wanted}: {robot.first}",
    )


@once("status.battery-dead", "A dead battery ends SEN, not STA", "6, no. 92 and 162")
async def battery_dead(case: Case) -> None:
    """With battery 0, STA goes on, SEN stops and DRIVE has no effect."""
    robot = await case.spawn(extra=" {Battery 1}")
    if not robot.first.number("Battery") <= 2:
        case.skip("the battery cannot be set by INIT")
    await robot.wait(
        lambda line: line.head == "STA" and line.number("Battery") == 0, what="STA with Battery 0"
    )
    await robot.run(1.2)  # 0 is what is left of the last second, too
    lines = await robot.run(1.0)
    late = [line for line in lines if line.head == "SEN"]
    case.expect_silence(late, "Battery 0")
    case.expect(
        any(line.head == "STA" for line in lines),
        f"{sum(line.head == 'STA' for line in lines)} STA lines come in 1 s with Battery 0, not "
        "at least 1",
    )
    await _stays(case, robot)


async def _stays(case: Case, robot: Robot) -> None:
    """Fail if a robot without battery drives; where it is, GETPOS tells."""
    if "groundtruth" not in case.target.ports:
        return
    client = await LineClient.open(case, "groundtruth")

    async def where() -> tuple[float, ...]:
        groups = split_reply(await client.ask("GETPOS"))[1]
        told = [group for group in groups if group.get("Name") == robot.name]
        return numbers(told[0].get("Location")) if told else ()

    before = await where()
    case.need(len(before) == 3, f"GETPOS does not list {robot.name}")
    await robot.client.send(*_FULL_SPEED)
    await robot.run(2.5)
    away = math.dist(before[:2], (await where())[:2])
    case.expect(
        away < 0.1,
        f"Location of GETPOS changes by {away:.2f} m within 2.5 s under DRIVE with Battery 0, not "
        "by less than 0.1 (protocol reference 6, no. 92: DRIVE has no effect)",
    )
