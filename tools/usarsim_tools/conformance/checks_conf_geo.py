"""GETCONF and GETGEO (protocol reference 6.8)."""

from __future__ import annotations

import re

from usarsim_tools.conformance.case import Case
from usarsim_tools.conformance.lines import Line
from usarsim_tools.conformance.places import Place
from usarsim_tools.conformance.recordings import items_of, standing
from usarsim_tools.conformance.registry import GAZEBO, ONCE, UDK, UNREAL, UT2004, check
from usarsim_tools.conformance.verdicts import Severity

_N4 = r"-?\d+\.\d{4}"
_V4 = rf"{_N4},{_N4},{_N4}"


async def _reply(case: Case, command: str, type: str, name: str = "") -> Line:
    """The recorded reply to a request; the check fails without one."""
    recording = await standing(case)
    key = (command, type, name)
    if key not in recording.replies:
        case.skip(f"the robot has no {type}")
    line = recording.replies[key]
    if line is None:
        case.fail(f"{command} of type {type} was not answered")
    return line


async def _robot(case: Case, command: str) -> Line:
    line = await _reply(case, command, "Robot")
    if "GroundVehicle" not in line.text:
        case.skip(f"{case.robot_class} is no ground vehicle")
    return line


@check("control.conf.robot", "GETCONF of the robot", source="protocol reference 6, no. 124")
async def conf_robot(case: Case) -> None:
    """`GETCONF {Type Robot}` gives exactly one line, with or without Name."""
    await _once(case, "GETCONF", "CONF")


@check("control.geo.robot", "GETGEO of the robot", source="protocol reference 6, no. 124")
async def geo_robot(case: Case) -> None:
    """`GETGEO {Type Robot}` gives exactly one line, with or without Name."""
    await _once(case, "GETGEO", "GEO")


async def _once(case: Case, command: str, head: str) -> None:
    robot = await case.spawn()
    for request in (f"{command} {{Type Robot}}", f"{command} {{Type Robot}} {{Name any}}"):
        await robot.send(request)
        lines = await robot.client.listen(0.7)
        found = [line for line in lines if line.head == head and line.type != "Camera"]
        case.expect(len(found) == 1, f"{request} gave {len(found)} lines")


@check(
    "control.conf.ground",
    "CONF of ground vehicles",
    source="protocol reference 6, no. 130",
    dialects=UNREAL,
)
async def conf_ground(case: Case) -> None:
    """A ground vehicle's CONF has SteeringType, Mass, MaxSpeed, MaxTorque, MaxFrontSteer,
    MaxRearSteer in this order; Type and Name come first, in ut2004 Type before Name, in udk
    Name before Type."""
    line = await _robot(case, "GETCONF")
    first = ("Type", "Name") if case.dialect == "ut2004" else ("Name", "Type")
    rest = ("SteeringType", "Mass", "MaxSpeed", "MaxTorque", "MaxFrontSteer", "MaxRearSteer")
    case.expect(line.names == first + rest, f"other segments: {line}")


@check(
    "control.conf.ground-gazebo",
    "CONF in the form of the Gazebo prototype",
    source="protocol reference 4.15",
    dialects=GAZEBO,
    severity=Severity.SHOULD,
)
async def conf_gazebo(case: Case) -> None:
    """In the prototype's form Type comes before Name and nothing stands between segments."""
    line = await _robot(case, "GETCONF")
    case.expect(line.names[:3] == ("Type", "Name", "SteeringType"), f"other segments: {line}")
    case.expect("} {" not in line.text, f"blanks between segments: {line}")


@check(
    "control.conf.numbers",
    "Numbers of CONF",
    source="protocol reference 2.2 and 4.8",
    dialects=UNREAL,
    severity=Severity.SHOULD,
)
async def conf_numbers(case: Case) -> None:
    """Numbers of the robot's CONF have four digits; steering limits of skid steered robots may be
    a plain 0 in udk."""
    line = await _robot(case, "GETCONF")
    for name in ("Mass", "MaxSpeed", "MaxTorque", "MaxFrontSteer", "MaxRearSteer"):
        value = line.get(name) or ""
        plain = case.dialect == "udk" and "Steer" in name and value == "0"
        case.expect(plain or re.fullmatch(_N4, value), f"{name} is {value!r}: {line}")


@check("control.conf.steering", "SteeringType is known", source="protocol reference 4.8")
async def steering(case: Case) -> None:
    """SteeringType is SkidSteered, AckermanSteered, OmniDrive, Unknown or None."""
    value = (await _robot(case, "GETCONF")).get("SteeringType")
    known = ("SkidSteered", "AckermanSteered", "OmniDrive", "Unknown", "None")
    case.expect(value in known, f"SteeringType is {value!r}")


@check(
    "control.conf.plausible",
    "CONF tells plausible numbers",
    source="protocol reference 4.8",
    severity=Severity.SHOULD,
)
async def plausible(case: Case) -> None:
    """Mass, MaxSpeed and MaxTorque are above zero, and MaxSpeed is at most 100 rad/s."""
    line = await _robot(case, "GETCONF")
    for name, most in (("Mass", 1e5), ("MaxSpeed", 100.0), ("MaxTorque", 50000.0)):
        value = line.number(name)
        case.expect(0.0 < value <= most, f"{name} is {line.get(name)}")


@check(
    "control.geo.ground",
    "GEO of ground vehicles",
    source="protocol reference 6, no. 129",
    dialects=UNREAL,
)
async def geo_ground(case: Case) -> None:
    """A ground vehicle's GEO has Type, Name, Dimensions, COG, WheelRadius, WheelSeparation,
    WheelBase in this order."""
    line = await _robot(case, "GETGEO")
    names = ("Type", "Name", "Dimensions", "COG", "WheelRadius", "WheelSeparation", "WheelBase")
    case.expect(line.names == names, f"other segments: {line}")


@check(
    "control.geo.numbers",
    "Numbers of GEO",
    source="protocol reference 2.2",
    dialects=UNREAL,
    severity=Severity.SHOULD,
)
async def geo_numbers(case: Case) -> None:
    """Numbers and vectors of the robot's GEO have four digits, and wheels a size."""
    line = await _robot(case, "GETGEO")
    for name in ("Dimensions", "COG"):
        case.expect(re.fullmatch(_V4, line.get(name) or ""), f"{name}: {line}")
    for name in ("WheelRadius", "WheelSeparation", "WheelBase"):
        case.expect(re.fullmatch(_N4, line.get(name) or ""), f"{name}: {line}")
        case.expect(line.number(name) > 0.0, f"{name}: {line}")


@check(
    "control.conf.class-name",
    "The name is the class",
    source="protocol reference 6, no. 133",
    dialects=UNREAL,
)
async def class_name(case: Case) -> None:
    """Name in vehicle CONF and GEO is the class name, without package."""
    for command in ("GETCONF", "GETGEO"):
        line = await _reply(case, command, "Robot")
        name = line.get("Name") or ""
        case.expect(name.lower() == case.robot_class.lower(), f"Name is {name!r}: {line}")


@check(
    "control.conf.every-item",
    "Every item that is streamed answers",
    source="protocol reference 6, no. 125",
    severity=Severity.MUST,
)
async def every_item(case: Case) -> None:
    """For every item that appears in SEN, MISSTA or ASTA, GETCONF and GETGEO with its Type and
    Name give a line: a missing reply blocks one client for ever."""
    recording = await standing(case)
    items = items_of(recording.streamed)
    case.need(items, "the robot streams no items")
    for type, name in items:
        for command in ("GETCONF", "GETGEO"):
            line = recording.replies[command, type, name]
            case.expect(line is not None, f"{command} {{Type {type}}} {{Name {name}}}: no reply")


@check(
    "control.conf.named-item", "A request by name gives that item", source="protocol reference 3.8"
)
async def named_item(case: Case) -> None:
    """The reply to a request with Name tells of the item of this name only."""
    recording = await standing(case)
    for (command, type, name), line in recording.replies.items():
        if not name or line is None or type == "Robot":
            continue
        names = [item["Name"] for item in line.items()]
        case.expect(names == [name], f"{command} of {type} {name} told of {names}: {line}")
        case.expect(line.type == type, f"{command} of {type} told of type {line.type}")


@check(
    "control.conf.by-type",
    "A request by type gives all items in a line",
    source="protocol reference 6, no. 127",
)
async def by_type(case: Case) -> None:
    """A request by type without Name gives one line with all items of the type."""
    recording = await standing(case)
    items = items_of(recording.streamed)
    case.need(items, "the robot streams no items")
    for type in {type for type, _ in items}:
        wanted = {name for one, name in items if one == type}
        for command in ("GETCONF", "GETGEO"):
            line = recording.replies[command, type, ""]
            case.expect(line is not None, f"{command} {{Type {type}}}: no reply")
            assert line is not None
            told = {item["Name"] for item in line.items()}
            case.expect(wanted <= told, f"{command} {{Type {type}}} lacks {wanted - told}: {line}")


@check(
    "control.conf.no-match",
    "Nothing matches, nothing is said",
    source="protocol reference 6, no. 126",
    dialects=UNREAL,
)
async def no_match(case: Case) -> None:
    """A request with unknown Type or Name gives no line."""
    robot = await case.spawn()
    await robot.client.listen(0.3)
    await robot.send(
        "GETCONF {Type NoSuchType}",
        "GETGEO {Type NoSuchType}",
        "GETCONF {Type RangeScanner} {Name NoSuchName}",
        "GETGEO {Type RangeScanner} {Name NoSuchName}",
        "GETCONF",
        "GETGEO",
    )
    lines = await robot.client.listen(1.5)
    found = [line for line in lines if line.head in ("CONF", "GEO")]
    case.expect(not found, f"it was answered: {found[:1]}")


@check(
    "control.conf.canonical",
    "The type is spelled canonically",
    source="protocol reference 6, no. 128",
    severity=Severity.SHOULD,
)
async def canonical(case: Case) -> None:
    """The Type of a reply has the canonical spelling even if asked in lower case."""
    recording = await standing(case)
    types = sorted(recording.types() - {"Camera"})
    case.need(types, "the robot streams no items")
    robot = await case.spawn()
    line = await robot.client.ask(f"GETCONF {{Type {types[0].lower()}}}", "CONF {Type")
    case.expect(line.type == types[0], f"{line.type!r} instead of {types[0]!r}")


@check(
    "control.geo.sensors-ut2004",
    "GEO of sensors in pairs",
    source="protocol reference 6, no. 134",
    dialects=UT2004,
)
async def geo_pairs(case: Case) -> None:
    """In ut2004 the GEO of sensors has one segment per item: `{Name n Location v Orientation v
    Mount m}`; one client crashes on any other form."""
    recording = await standing(case)
    form = re.compile(
        rf"GEO \{{Type \w+\}}"
        rf"( \{{Name [^ {{}}]+ Location {_V4} Orientation {_V4} Mount [^{{}}]+\}})+"
    )
    asked = 0
    for (command, type, _), line in recording.replies.items():
        if command != "GETGEO" or line is None or type in ("Robot", "MisPkg", "Actuator"):
            continue
        asked += 1
        case.expect(form.fullmatch(line.text), f"another form: {line}")
    case.need(asked, "no sensor answered GETGEO")


@check(
    "control.geo.sensors-udk",
    "GEO of sensors in segments",
    source="protocol reference 6, no. 134",
    dialects=UDK,
)
async def geo_segments(case: Case) -> None:
    """In udk the GEO of sensors has separate segments in the order Name, Location, Orientation,
    Mount."""
    recording = await standing(case)
    asked = 0
    for (command, type, _), line in recording.replies.items():
        if command != "GETGEO" or line is None or type in ("Robot", "MisPkg", "Actuator"):
            continue
        asked += 1
        names = tuple(name for name in line.names[1:] if name != "MountLink")
        groups = len(names) // 4
        case.expect(
            names == ("Name", "Location", "Orientation", "Mount") * groups,
            f"other segments: {line}",
        )
        case.expect(all(" " not in v for n, v in line.segments if n == "Name"), f"pairs: {line}")
    case.need(asked, "no sensor answered GETGEO")


@check(
    "control.geo.body-frame",
    "Mounts are told in the body frame",
    source="protocol reference 6, no. 135",
    dialects=UNREAL,
)
async def body_frame(case: Case) -> None:
    """Mount poses are in the body frame whatever the yaw of the robot."""
    recording = await standing(case)
    types = sorted(recording.types() - {"Camera"})
    case.need(types, "the robot streams no items")
    type = "RangeScanner" if "RangeScanner" in types else types[0]
    place = await case.place()
    case.need(place.tag is None or any(place.location), "the server lists no start poses")
    turned = Place(None, place.location, (0.0, 0.0, place.rotation[2] + 1.5708))
    robot = await case.spawn(place=turned)
    line = await robot.client.ask(f"GETGEO {{Type {type}}}", "GEO {Type")
    before = await _reply(case, "GETGEO", type)
    case.expect(line.text == before.text, f"{before} became {line} when turned by 90 degrees")


@check(
    "control.conf.scanner",
    "CONF of RangeScanner",
    source="protocol reference 6, no. 136",
    dialects=UNREAL,
)
async def conf_scanner(case: Case) -> None:
    """RangeScanner CONF has MaxRange, MinRange, Resolution, Fov with exactly this case, before
    the panning flags."""
    line = await _reply(case, "GETCONF", "RangeScanner")
    start = line.names.index("Name") + 1 if "Name" in line.names else 0
    wanted = ("MaxRange", "MinRange", "Resolution", "Fov")
    case.expect(line.names[start : start + 4] == wanted, f"other segments: {line}")


@check(
    "control.conf.panning",
    "Paning and Panning",
    source="protocol reference 5.2, no. 11",
    dialects=UNREAL,
    severity=Severity.INFORMATIVE,
)
async def panning(case: Case) -> None:
    """The panning flag is spelled Paning in ut2004 and Panning in udk."""
    line = await _reply(case, "GETCONF", "RangeScanner")
    wanted = "Paning" if case.dialect == "ut2004" else "Panning"
    case.expect(wanted in line.names, f"no {wanted}: {line}")


@check(
    "control.conf.scanner-agrees",
    "CONF and SEN of a scanner agree",
    source="protocol reference 4.6 and 4.8",
    severity=Severity.SHOULD,
)
async def scanner_agrees(case: Case) -> None:
    """Resolution and Fov of CONF are Resolution and FOV of SEN, within 1 percent."""
    conf = await _reply(case, "GETCONF", "RangeScanner")
    for line in (await standing(case)).of("SEN", "RangeScanner")[:1]:
        for told, sent in (("Resolution", "Resolution"), ("Fov", "FOV")):
            gap = abs(conf.number(told) - line.number(sent))
            case.expect(gap <= 0.01 * abs(line.number(sent)), f"{told}: {conf}, but {line}")


@check(
    "control.conf.sonar", "CONF of Sonar", source="protocol reference 6, no. 137", dialects=UNREAL
)
async def conf_sonar(case: Case) -> None:
    """Sonar CONF contains MaxRange and MinRange of every item."""
    line = await _reply(case, "GETCONF", "Sonar")
    for item in line.items():
        case.expect({"MaxRange", "MinRange"} <= set(item), f"{item['Name']} lacks them: {line}")


@check(
    "control.conf.camera", "CONF of Camera", source="protocol reference 6, no. 138", dialects=UNREAL
)
async def conf_camera(case: Case) -> None:
    """Camera CONF contains CameraDefFov, CameraMinFov, CameraMaxFov, CameraFov, in radians in
    ut2004 and in degrees in udk."""
    recording = await standing(case)
    line = recording.replies.get(("GETCONF", "Camera", ""))
    if line is None:
        case.skip("the robot has no Camera")
    assert line is not None
    for name in ("CameraDefFov", "CameraMinFov", "CameraMaxFov", "CameraFov"):
        case.expect(line.number(name) > 0.0, f"no {name}: {line}")
    degrees = line.number("CameraDefFov") > 6.3
    case.expect(degrees == (case.dialect == "udk"), f"in the wrong unit: {line}")


@check(
    "control.conf.actuator",
    "CONF of Actuator",
    source="protocol reference 6, no. 139",
    dialects=UDK,
)
async def conf_actuator(case: Case) -> None:
    """Actuator CONF numbers links from 1 and gives JointType, MaxTorque, MinValue, MaxValue of
    each."""
    robot = await case.spawn("arm")
    line = await robot.client.ask("GETCONF {Type Actuator}", "CONF {Type Actuator")
    wanted = ("Link", "JointType", "MaxTorque", "MinValue", "MaxValue")
    names = tuple(name for name in line.names if name in wanted)
    case.expect(names == wanted * (len(names) // 5) and names, f"other segments: {line}")
    case.expect(line.get("Link") == "1", f"links do not begin with 1: {line}")


@check(
    "control.geo.actuator",
    "GEO of Actuator and MisPkg",
    source="protocol reference 6, no. 140",
    dialects=UNREAL,
)
async def geo_actuator(case: Case) -> None:
    """In udk GEO of an Actuator has Parent 0 for the base; in ut2004 GEO of a MisPkg has
    ParentLink -1."""
    robot = await case.spawn("arm")
    type, name, base = (
        ("Actuator", "Parent", "0") if case.dialect == "udk" else ("MisPkg", "ParentLink", "-1")
    )
    line = await robot.client.ask(f"GETGEO {{Type {type}}}", f"GEO {{Type {type}")
    case.expect(line.get(name) == base, f"{name} of the first link: {line}")


@check(
    "control.conf.both-names",
    "MisPkg and Actuator both answer",
    source="protocol reference 6, no. 141",
    dialects=UNREAL,
)
async def both_names(case: Case) -> None:
    """GETCONF of MisPkg and of Actuator are both answered for a robot with an arm."""
    robot = await case.spawn("arm")
    for type in ("MisPkg", "Actuator"):
        await robot.client.ask(f"GETCONF {{Type {type}}}", f"CONF {{Type {type}")


@check(
    "control.conf.next-line",
    "The CONF is the next line",
    source="protocol reference 6, no. 142",
    dialects=ONCE,
)
async def next_line(case: Case) -> None:
    """After INIT and `GETCONF {Type Actuator}` in one packet the next line after the greeting is
    the CONF: one client reads exactly one line."""
    arm = await case.class_for("arm")
    place = await case.place()
    client = await case.connect()
    await client.send(case.init(place, case.new_name(), arm), "GETCONF {Type Actuator}")
    line = await client.wait(lambda line: True, 6.0, "line")
    case.expect(line.head == "CONF" and line.type == "Actuator", f"the next line is {line}")


@check(
    "control.conf.aerial",
    "CONF of aerial robots has a Type",
    source="protocol reference 5.2, no. 17",
    dialects=UNREAL,
)
async def conf_aerial(case: Case) -> None:
    """CONF and GEO of an aerial robot have Type AerialVehicle in every dialect."""
    robot = await case.spawn("aerial")
    for command in ("GETCONF", "GETGEO"):
        line = await robot.client.ask(f"{command} {{Type Robot}}", command.removeprefix("GET"))
        if line.type == "Camera":
            line = await robot.wait(command.removeprefix("GET"))
        case.expect(line.type == "AerialVehicle", f"{line}")
