"""GETCONF and GETGEO: which requests are answered, what CONF tells (protocol reference 6.8), and
zoom against the limits that it tells (robots reference 2.7)."""

from __future__ import annotations

import math
import re

from usarsim_conformance.case import PATIENCE, Case
from usarsim_conformance.control import Robot
from usarsim_conformance.recordings import ground_told, items_of, standing, told
from usarsim_conformance.registry import Severity, control, gazebo, once, udk, unreal

_N4 = r"-?\d+\.\d{4}"


@unreal("conf.ground", "CONF of ground vehicles", "6, no. 130")
async def conf_ground(case: Case) -> None:
    """A ground vehicle's CONF has SteeringType, Mass, MaxSpeed, MaxTorque, MaxFrontSteer,
    MaxRearSteer in this order; Type and Name come first, in ut2004 Type before Name, in udk
    Name before Type."""
    line = await ground_told(case, "GETCONF")
    first = ("Type", "Name") if case.dialect == "ut2004" else ("Name", "Type")
    rest = ("SteeringType", "Mass", "MaxSpeed", "MaxTorque", "MaxFrontSteer", "MaxRearSteer")
    case.expect_names(line, first + rest)


@gazebo("conf.ground-gazebo", "CONF in the form of the Gazebo prototype", "4.15", Severity.SHOULD)
async def conf_gazebo(case: Case) -> None:
    """In the prototype's form Type comes before Name and nothing stands between segments."""
    line = await ground_told(case, "GETCONF")
    case.expect_names(line, ("Type", "Name", "SteeringType"), line.names[:3])
    case.expect("} {" not in line.text, f"segments have blanks between, not none: {line}")


@unreal("conf.numbers", "Numbers of CONF", "2.2 and 4.8", Severity.SHOULD)
async def conf_numbers(case: Case) -> None:
    """Numbers of the robot's CONF have four digits; steering limits of skid steered robots may be
    a plain 0 in udk."""
    line = await ground_told(case, "GETCONF")
    for name in ("Mass", "MaxSpeed", "MaxTorque", "MaxFrontSteer", "MaxRearSteer"):
        value = line.get(name) or ""
        plain = case.dialect == "udk" and "Steer" in name and value == "0"
        case.expect(
            plain or re.fullmatch(_N4, value),
            f"{name} is {value!r}, not a number with four digits behind the point: {line}",
        )


@control("conf.steering", "SteeringType is known", "4.8")
async def steering(case: Case) -> None:
    """SteeringType is SkidSteered, AckermanSteered, OmniDrive, Unknown or None."""
    value = (await ground_told(case, "GETCONF")).get("SteeringType")
    known = ("SkidSteered", "AckermanSteered", "OmniDrive", "Unknown", "None")
    case.expect(value in known, f"SteeringType is {value!r}, not one of {', '.join(known)}")


@control("conf.plausible", "CONF tells plausible numbers", "4.8", Severity.SHOULD)
async def plausible(case: Case) -> None:
    """Mass, MaxSpeed and MaxTorque are above zero, and MaxSpeed is at most 200 rad/s."""
    line = await ground_told(case, "GETCONF")
    for name, most in (("Mass", 1e5), ("MaxSpeed", 200.0), ("MaxTorque", 50000.0)):
        value = line.number(name)
        case.expect(
            0.0 < value <= most, f"{name} is {line.get(name)}, not above 0 and at most {most:g}"
        )


@unreal("conf.class-name", "The name is the class", "6, no. 133")
async def class_name(case: Case) -> None:
    """Name in vehicle CONF and GEO is the class name, without package."""
    for command in ("GETCONF", "GETGEO"):
        line = await told(case, command, "Robot")
        name = line.get("Name") or ""
        case.expect(
            name.lower() == case.robot_class.lower(),
            f"Name is {name!r}, not {case.robot_class!r}: {line}",
        )


@unreal("conf.scanner", "CONF of RangeScanner", "6, no. 136")
async def conf_scanner(case: Case) -> None:
    """RangeScanner CONF has MaxRange, MinRange, Resolution, Fov with exactly this case, before
    the panning flags."""
    line = await told(case, "GETCONF", "RangeScanner")
    start = line.names.index("Name") + 1 if "Name" in line.names else 0
    wanted = ("MaxRange", "MinRange", "Resolution", "Fov")
    case.expect_names(line, wanted, line.names[start : start + 4])


@unreal("conf.panning", "Paning and Panning", "5.2, no. 11", Severity.INFORMATIVE)
async def panning(case: Case) -> None:
    """The panning flag is spelled Paning in ut2004 and Panning in udk."""
    line = await told(case, "GETCONF", "RangeScanner")
    wanted = "Paning" if case.dialect == "ut2004" else "Panning"
    case.expect(wanted in line.names, f"{wanted} is missing: {line}")


@control("conf.scanner-agrees", "CONF and SEN of a scanner agree", "4.6 and 4.8", Severity.SHOULD)
async def scanner_agrees(case: Case) -> None:
    """Resolution and Fov of CONF are Resolution and FOV of SEN, within 1 percent."""
    conf = await told(case, "GETCONF", "RangeScanner")
    for line in (await standing(case)).of("SEN", "RangeScanner")[:1]:
        for key, sent in (("Resolution", "Resolution"), ("Fov", "FOV")):
            gap = abs(conf.number(key) - line.number(sent))
            case.expect(
                gap <= 0.01 * abs(line.number(sent)),
                f"{key} of CONF is {conf.number(key):g}, not {line.number(sent):g}, {sent} of "
                f"SEN: {conf}",
            )


@unreal("conf.sonar", "CONF of Sonar", "6, no. 137")
async def conf_sonar(case: Case) -> None:
    """Sonar CONF contains MaxRange and MinRange of every item."""
    line = await told(case, "GETCONF", "Sonar")
    for item in line.items():
        case.expect(
            {"MaxRange", "MinRange"} <= set(item),
            f"{item['Name']} has no MaxRange or no MinRange: {line}",
        )


@unreal("conf.camera", "CONF of Camera", "6, no. 138")
async def conf_camera(case: Case) -> None:
    """Camera CONF contains CameraDefFov, CameraMinFov, CameraMaxFov, CameraFov, in radians in
    ut2004 and in degrees in udk."""
    recording = await standing(case)
    line = recording.replies.get(("GETCONF", "Camera", ""))
    if line is None:
        case.skip("the robot has no Camera")
    assert line is not None
    for name in ("CameraDefFov", "CameraMinFov", "CameraMaxFov", "CameraFov"):
        case.expect(line.number(name) > 0.0, f"{name} is {line.get(name)}, not above 0: {line}")
    degrees = line.number("CameraDefFov") > 6.3
    case.expect(
        degrees == (case.dialect == "udk"),
        f"CameraDefFov is {line.get('CameraDefFov')}, not in "
        f"{'degrees' if case.dialect == 'udk' else 'rad'}: {line}",
    )


@udk("conf.actuator", "CONF of Actuator", "6, no. 139")
async def conf_actuator(case: Case) -> None:
    """Actuator CONF numbers links from 1 and gives JointType, MaxTorque, MinValue, MaxValue of
    each."""
    robot = await case.spawn("arm")
    line = await robot.client.ask("GETCONF {Type Actuator}", "CONF {Type Actuator")
    wanted = ("Link", "JointType", "MaxTorque", "MinValue", "MaxValue")
    names = tuple(name for name in line.names if name in wanted)
    case.expect(
        names == wanted * (len(names) // 5) and names,
        f"segments of links are {' '.join(names)}, not {' '.join(wanted)} for each link: {line}",
    )
    case.expect(line.get("Link") == "1", f"the first Link is {line.get('Link')}, not 1: {line}")


@unreal("conf.aerial", "CONF of aerial robots has a Type", "5.2, no. 17")
async def conf_aerial(case: Case) -> None:
    """CONF and GEO of an aerial robot have Type AerialVehicle in every dialect."""
    robot = await case.spawn("aerial")
    for command in ("GETCONF", "GETGEO"):
        line = await robot.client.ask(f"{command} {{Type Robot}}", command.removeprefix("GET"))
        if line.type == "Camera":
            line = await robot.wait(command.removeprefix("GET"))
        case.expect(
            line.type == "AerialVehicle",
            f"Type of the reply to {command} is {line.type!r}, not AerialVehicle: {line}",
        )


@control("conf.robot", "GETCONF of the robot", "6, no. 124")
async def conf_robot(case: Case) -> None:
    """`GETCONF {Type Robot}` gives exactly one line, with or without Name."""
    await _once(case, "GETCONF", "CONF")


@control("geo.robot", "GETGEO of the robot", "6, no. 124")
async def geo_robot(case: Case) -> None:
    """`GETGEO {Type Robot}` gives exactly one line, with or without Name."""
    await _once(case, "GETGEO", "GEO")


async def _once(case: Case, command: str, head: str) -> None:
    robot = await case.spawn()
    for request in (f"{command} {{Type Robot}}", f"{command} {{Type Robot}} {{Name any}}"):
        lines = await robot.client.outcome(request)
        found = [line for line in lines if line.head == head and line.type != "Camera"]
        case.expect(len(found) == 1, f"{request} is answered by {len(found)} lines, not by 1")


@control("conf.every-item", "Every item that is streamed answers", "6, no. 125", Severity.MUST)
async def every_item(case: Case) -> None:
    """For every item that appears in SEN, MISSTA or ASTA, GETCONF and GETGEO with its Type and
    Name give a line: a missing reply blocks one client for ever."""
    recording = await standing(case)
    items = items_of(recording.streamed)
    if not items:
        case.skip("the robot streams no items")
    for type, name in items:
        for command in ("GETCONF", "GETGEO"):
            line = recording.replies[command, type, name]
            case.expect(line is not None, f"{command} {{Type {type}}} {{Name {name}}} has no reply")


@control("conf.named-item", "A request by name gives that item", "3.8")
async def named_item(case: Case) -> None:
    """The reply to a request with Name tells of the item of this name only."""
    recording = await standing(case)
    for (command, type, name), line in recording.replies.items():
        if not name or line is None or type == "Robot":
            continue
        names = [item["Name"] for item in line.items()]
        case.expect(
            names == [name],
            f"{command} of {type} {name} tells of {names}, not of {name} only: {line}",
        )
        case.expect(
            line.type == type,
            f"{command} of {type} is answered with Type {line.type!r}, not {type}: {line}",
        )


@control("conf.by-type", "A request by type gives all items in a line", "6, no. 127")
async def by_type(case: Case) -> None:
    """A request by type without Name gives one line with all items of the type."""
    recording = await standing(case)
    items = items_of(recording.streamed)
    if not items:
        case.skip("the robot streams no items")
    for type in {type for type, _ in items}:
        wanted = {name for one, name in items if one == type}
        for command in ("GETCONF", "GETGEO"):
            line = recording.replies[command, type, ""]
            case.expect(line is not None, f"{command} {{Type {type}}} has no reply")
            assert line is not None
            told = {item["Name"] for item in line.items()}
            case.expect(
                wanted <= told,
                f"{', '.join(sorted(wanted - told))} is missing in the reply to {command} {{Type "
                f"{type}}}: {line}",
            )


@unreal("conf.no-match", "Nothing matches, nothing is said", "6, no. 126")
async def no_match(case: Case) -> None:
    """A request with unknown Type or Name gives no line."""
    robot = await case.spawn()
    await robot.client.listen(0.3)
    lines = await robot.client.outcome(
        "GETCONF {Type NoSuchType}",
        "GETGEO {Type NoSuchType}",
        "GETCONF {Type RangeScanner} {Name NoSuchName}",
        "GETGEO {Type RangeScanner} {Name NoSuchName}",
        "GETCONF",
        "GETGEO",
    )
    found = [line for line in lines if line.head in ("CONF", "GEO")]
    case.expect_silence(found, "GETCONF and GETGEO with unknown Type or Name")


@control("conf.canonical", "The type is spelled canonically", "6, no. 128", Severity.SHOULD)
async def canonical(case: Case) -> None:
    """The Type of a reply has the canonical spelling even if asked in lower case."""
    recording = await standing(case)
    types = sorted(recording.types() - {"Camera"})
    if not types:
        case.skip("the robot streams no items")
    robot = await case.spawn()
    line = await robot.client.ask(f"GETCONF {{Type {types[0].lower()}}}", "CONF {Type")
    case.expect(
        line.type == types[0], f"the first reply is of Type {line.type!r}, not {types[0]!r}"
    )


@unreal("conf.both-names", "MisPkg and Actuator both answer", "6, no. 141")
async def both_names(case: Case) -> None:
    """GETCONF of MisPkg and of Actuator are both answered for a robot with an arm."""
    robot = await case.spawn("arm")
    for type in ("MisPkg", "Actuator"):
        await robot.client.ask(f"GETCONF {{Type {type}}}", f"CONF {{Type {type}")


@once("conf.next-line", "The CONF is the next line", "6, no. 142")
async def next_line(case: Case) -> None:
    """After INIT and `GETCONF {Type Actuator}` in one packet the next line after the greeting is
    the CONF: one client reads exactly one line."""
    arm = await case.class_for("arm")
    place = await case.place()
    client = await case.connect()
    await client.send(case.init(place, case.new_name(), arm), "GETCONF {Type Actuator}")
    line = await client.wait(lambda line: True, PATIENCE, "line")
    case.expect(
        line.head == "CONF" and line.type == "Actuator",
        f"the line after INIT and GETCONF is {line}, not CONF of Type Actuator",
    )


_KEYS = ("CameraDefFov", "CameraMinFov", "CameraMaxFov", "CameraFov")


async def _lens(case: Case, robot: Robot) -> tuple[str, list[float]]:
    """Name of the first camera, and default, least, largest and present angle of view, rad."""
    await robot.client.send("GETCONF {Type Camera}", "GETSTARTPOSES")
    line = await robot.client.maybe(
        lambda line: line.head == "CONF" or (line.head == "NFO" and "StartPoses" in line.names)
    )
    if line is None or line.head == "NFO":
        case.skip("the robot has no camera")
    assert line is not None
    unit = math.degrees(1.0) if case.dialect == "udk" else 1.0
    return line.items()[0]["Name"], [line.number(key) / unit for key in _KEYS]


@unreal(
    "values.camera-zoom",
    "Zoom sets the angle of view",
    "robots reference 2.7; protocol reference 4.8",
)
async def camera_zoom(case: Case) -> None:
    """A Zoom, in rad, becomes CameraFov of CONF, but for CameraMinFov and CameraMaxFov, which it
    stops at; 0 is CameraDefFov again."""
    robot = await case.spawn()
    name, (usual, least, most, now) = await _lens(case, robot)
    case.expect(
        least <= usual <= most,
        f"CameraDefFov is {usual:g}, not {least:g} to {most:g}, CameraMinFov to CameraMaxFov",
    )
    case.expect(
        abs(now - usual) < 2e-3, f"CameraFov is {now:g} at first, not {usual:g}, CameraDefFov"
    )
    between = 0.6 * least + 0.4 * most
    for zoom, wanted in ((between, between), (0.5 * least, least), (1.2 * most, most), (0, usual)):
        await robot.send(
            f"SET {{Type Camera}} {{Name {name}}} {{Opcode Zoom}} {{Params {zoom:.4f}}}"
        )
        await robot.run(0.3)
        _, (*_, found) = await _lens(case, robot)
        case.expect(
            abs(found - wanted) < (0.01 if case.dialect == "udk" else 3e-3),
            f"CameraFov is {found:.4f} rad after a Zoom of {zoom:.4f}, not {wanted:.4f}",
        )
