"""What CONF tells (protocol reference 6.8)."""

from __future__ import annotations

import re

from usarsim_conformance.case import Case
from usarsim_conformance.recordings import ground_told, standing, told
from usarsim_conformance.registry import GAZEBO, UDK, UNREAL, check
from usarsim_conformance.verdicts import Severity

_N4 = r"-?\d+\.\d{4}"


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
    line = await ground_told(case, "GETCONF")
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
    line = await ground_told(case, "GETCONF")
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
    line = await ground_told(case, "GETCONF")
    for name in ("Mass", "MaxSpeed", "MaxTorque", "MaxFrontSteer", "MaxRearSteer"):
        value = line.get(name) or ""
        plain = case.dialect == "udk" and "Steer" in name and value == "0"
        case.expect(plain or re.fullmatch(_N4, value), f"{name} is {value!r}: {line}")


@check("control.conf.steering", "SteeringType is known", source="protocol reference 4.8")
async def steering(case: Case) -> None:
    """SteeringType is SkidSteered, AckermanSteered, OmniDrive, Unknown or None."""
    value = (await ground_told(case, "GETCONF")).get("SteeringType")
    known = ("SkidSteered", "AckermanSteered", "OmniDrive", "Unknown", "None")
    case.expect(value in known, f"SteeringType is {value!r}")


@check(
    "control.conf.plausible",
    "CONF tells plausible numbers",
    source="protocol reference 4.8",
    severity=Severity.SHOULD,
)
async def plausible(case: Case) -> None:
    """Mass, MaxSpeed and MaxTorque are above zero, and MaxSpeed is at most 200 rad/s."""
    line = await ground_told(case, "GETCONF")
    for name, most in (("Mass", 1e5), ("MaxSpeed", 200.0), ("MaxTorque", 50000.0)):
        value = line.number(name)
        case.expect(0.0 < value <= most, f"{name} is {line.get(name)}")


@check(
    "control.conf.class-name",
    "The name is the class",
    source="protocol reference 6, no. 133",
    dialects=UNREAL,
)
async def class_name(case: Case) -> None:
    """Name in vehicle CONF and GEO is the class name, without package."""
    for command in ("GETCONF", "GETGEO"):
        line = await told(case, command, "Robot")
        name = line.get("Name") or ""
        case.expect(name.lower() == case.robot_class.lower(), f"Name is {name!r}: {line}")


@check(
    "control.conf.scanner",
    "CONF of RangeScanner",
    source="protocol reference 6, no. 136",
    dialects=UNREAL,
)
async def conf_scanner(case: Case) -> None:
    """RangeScanner CONF has MaxRange, MinRange, Resolution, Fov with exactly this case, before
    the panning flags."""
    line = await told(case, "GETCONF", "RangeScanner")
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
    line = await told(case, "GETCONF", "RangeScanner")
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
    conf = await told(case, "GETCONF", "RangeScanner")
    for line in (await standing(case)).of("SEN", "RangeScanner")[:1]:
        for key, sent in (("Resolution", "Resolution"), ("Fov", "FOV")):
            gap = abs(conf.number(key) - line.number(sent))
            case.expect(gap <= 0.01 * abs(line.number(sent)), f"{key}: {conf}, but {line}")


@check(
    "control.conf.sonar", "CONF of Sonar", source="protocol reference 6, no. 137", dialects=UNREAL
)
async def conf_sonar(case: Case) -> None:
    """Sonar CONF contains MaxRange and MinRange of every item."""
    line = await told(case, "GETCONF", "Sonar")
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
