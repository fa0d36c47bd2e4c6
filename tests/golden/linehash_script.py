"""What clients say while their lines are hashed: commands made from what the server has answered.

Nothing here knows robot classes: the drive commands follow from the SteeringType of CONF, the
orders to arms and items from the names and links of CONF, those to loose joints from STA.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence

DIALECTS = ("ut2004", "udk")

Say = Callable[[Sequence[str], str], Iterator[str]]
"""The commands of a step, given all lines so far and the dialect."""

_WORDS = """
    Robot MisPkg Actuator Gripper ToolChanger VacuumGripper Effector Camera Viewports
    3DRangeScanner Accel Acceleration AcceleroMeter Acoustic AltitudeSensor Battery CO2Sensor
    Encoder GPS GroundTruth Helper Hokuyo HumanMotion IMU INS INU IR IRScanner KinectDepth
    LineLaser MagneticCompass MissionTime ObjectSensor Odometry PCL Range RangeImager
    RangeScanner RangeScanner3D RangeSensor RFID RFIDReleaser RFIDTag SICK Sonar Sound
    Tachometer Touch TouchArray VictRFID VictSensor Nonsense
"""
TYPES = tuple(_WORDS.split())
"""Asked for with GETCONF and GETGEO; what a robot does not have is not answered."""

FIT = {
    "SkidSteered": (
        "DRIVE {Left 2.5} {Right 1.5}",
        "DRIVE {Left -60} {Right 80} {Normalized True}",
        "DRIVE {Left 1.0} {Normalized False}",
    ),
    "AckermanSteered": (
        "DRIVE {Speed 2.0} {FrontSteer 0.2} {RearSteer -0.1}",
        "DRIVE {Speed 50} {FrontSteer -0.3} {RearSteer 0.1} {Normalized True}",
        "DRIVE {Speed -1.0} {Normalized False}",
    ),
    "OmniDrive": (
        "DRIVE {WheelNumber 0} {WheelSpeed 2} {WheelSteer 0.2} {WheelNumber 1} {WheelSpeed 2}",
        "DRIVE {WheelNumber 0} {WheelSpeed 50} {WheelNumber 1} {WheelSpeed 50} {WheelSteer -0.4} "
        "{WheelNumber 2} {WheelSpeed -50} {WheelNumber 3} {WheelSpeed 50} {Normalized True}",
        "DRIVE {WheelNumber 1} {WheelSpeed -2} {Normalized False}",
    ),
    "RotaryWing": (
        "DRIVE {AltitudeVelocity 0.8} {LinearVelocity 0.5} {LateralVelocity 0.2} "
        "{RotationalVelocity 0.3} {Normalized False}",
        "DRIVE {AltitudeVelocity 10} {LinearVelocity 40} {LateralVelocity -30} "
        "{RotationalVelocity -20} {Normalized True}",
        "DRIVE {PitchAngle 10} {RollAngle -5} {Spin1 3} {Spin2 4} {LinearVelocity 0}",
    ),
    "VariableDepth": (
        "DRIVE {Propeller 20} {Rudder 0.3} {SternPlane -0.2}",
        "DRIVE {Propeller 80} {Rudder -0.2} {SternPlane 0.1} {Normalized True}",
        "DRIVE {Rudder 0.1}",
    ),
}
"""Three drive commands for each SteeringType: plain, normalized and partial."""

SAME_AS = {"LighterThanAir": "RotaryWing"}

OPCODES = {
    **dict.fromkeys(("RangeScanner", "IRScanner", "Acoustic", "RangeImager"), ("SCAN",)),
    **dict.fromkeys(("RangeScanner3D", "3DRangeScanner", "PCL", "LineLaser"), ("SCAN",)),
    **dict.fromkeys(("Odometry", "Encoder", "Tachometer", "Battery"), ("RESET",)),
    "INS": ("POSE} {Params 1.0,2.0,0.5,0.1,0,1.57",),
    "Camera": ("ZOOM} {Params 0.6", "Nonsense} {Params 1"),
    "RFID": ("Read} {Params 101", "Write} {Params 101 seen here", "Read} {Params 101"),
    "RFIDReleaser": ("Release",),
    "Gripper": ("GRIP} {Params 1",),
    "ToolChanger": ("CLOSE",),
}
"""Opcodes for items by type, with their parameters."""

_NAME = re.compile(r"\{Name ([^ {}]+)")
_KIND = re.compile(r"\{Type ([^ {}]+)\}")
_STEERING = re.compile(r"\{SteeringType ([^ {}]+)\}")
_JOINT = re.compile(r"\{(\w+) -?\d+\.\d{4}\}")
_NO_JOINTS = frozenset({"Time", "FrontSteer", "RearSteer", "RudderAngle", "SternPlaneAngle"})


BEFORE = (
    *("GETSTARTPOSES", "GETPATHNODES", "GETCLOSESTPATHNODE {Location 4,-0.5,0}"),
    "GETCONF {Type Robot}",
)
"""What may be asked without a robot, and one question that may not."""


def init(robot: str, place: int, dialect: str, apart: float) -> str:
    """The INIT for one of the two places: by its tag at the first, by location at the second."""
    at = (
        "{Start Place0}"
        if place == 0
        else f"{{Location 0,{-apart * place:g},-0.6}} {{Rotation 0,0,0.1}}"
    )
    head = f"INIT {{ClassName USARBot.{robot}}} {{Name Tester{place}}}"
    return f"{head} {at} {{Dialect {dialect}}}"


def _names(lines: Sequence[str], kind: str) -> list[str]:
    """Names of all items of a type that CONF lines list, in order."""
    told = (line for line in lines if line.startswith("CONF") and f"{{Type {kind}}}" in line)
    return list(dict.fromkeys(name for line in told for name in _NAME.findall(line)))


def _kinds(lines: Sequence[str]) -> list[str]:
    """Types of all that CONF lines list, in order."""
    heads = (_KIND.search(line) for line in lines if line.startswith("CONF"))
    return list(dict.fromkeys(head[1] for head in heads if head))


def _arms(lines: Sequence[str]) -> dict[str, int]:
    """Number of links by name of all mission packages."""
    arms: dict[str, int] = {}
    for line in lines:
        if line.startswith("CONF {Type MisPkg}"):
            parts = re.split(r"\{Name ([^ {}]+)\}", line)
            for name, rest in zip(parts[1::2], parts[2::2], strict=True):
                arms[name] = rest.count("{Link ")
    return arms


def _joints(lines: Sequence[str]) -> list[str]:
    """Joints that STA reports by their names."""
    for line in lines:
        if line.startswith("STA"):
            return [name for name in _JOINT.findall(line) if name not in _NO_JOINTS]
    return []


def _steering(lines: Sequence[str]) -> str:
    """The SteeringType in the CONF of the robot, empty if it has none."""
    found = (_STEERING.search(line) for line in lines if line.startswith("CONF"))
    word = next((one[1] for one in found if one), "")
    return SAME_AS.get(word, word)


def _move(name: str, links: int, values: Sequence[float], order: int, dialect: str) -> str:
    """An order to all links of an arm, as the dialect has it."""
    head, first = ("MISPKG", 1) if dialect == "ut2004" or order else ("ACT", 0)
    with_order = f" {{Order {order}}}" if head == "MISPKG" else ""
    groups = " ".join(
        f"{{Link {link + first}}} {{Value {values[link % len(values)]:g}}}{with_order}"
        for link in range(links)
    )
    return f"{head} {{Name {name}}} {groups}"


def _ask(lines: Sequence[str], dialect: str) -> Iterator[str]:
    """GETCONF and GETGEO of everything."""
    for kind in TYPES:
        yield f"GETCONF {{Type {kind}}}"
        yield f"GETGEO {{Type {kind}}}"


def _go(lines: Sequence[str], dialect: str) -> Iterator[str]:
    """Set off, move the arms, light on; GETCONF and GETGEO of one item of each type by name."""
    if fit := FIT.get(_steering(lines)):
        yield fit[0]
    yield "DRIVE {Light True}"
    for name, links in _arms(lines).items():
        yield _move(name, links, (0.4, -0.3, 0.25), 0, dialect)
    for kind in _kinds(lines):
        for name in _names(lines, kind)[:1]:
            yield f"GETCONF {{Type {kind}}} {{Name {name}}}"
            yield f"GETGEO {{Type {kind.lower()}}} {{Name {name.upper()}}}"


def _set(lines: Sequence[str], dialect: str) -> Iterator[str]:
    """SET to every item, orders to loose joints."""
    for kind in _kinds(lines):
        for name in _names(lines, kind):
            for opcode in OPCODES.get(kind, ("Nonsense",)):
                yield f"SET {{Type {kind}}} {{Name {name}}} {{Opcode {opcode}}}"
    joints = _joints(lines)
    if joints and dialect == "ut2004":
        targets = (f"{{{name} {(0.3, -0.2)[n % 2]:g}}}" for n, name in enumerate(joints))
        yield "MULTIDRIVE " + " ".join(targets)
    elif joints:
        for number, name in enumerate(joints):
            target = (0.3, -0.2)[number % 2]
            yield f"SET {{Type Joint}} {{Name {name}}} {{Opcode Angle}} {{Params {target:g}}}"


def _turn(lines: Sequence[str], dialect: str) -> Iterator[str]:
    """Normalized driving, arms by speed, single joints, cameras asked again."""
    if fit := FIT.get(_steering(lines)):
        yield fit[1]
    for name, links in _arms(lines).items():
        yield _move(name, links, (0.2, 0.1, -0.1), 1, dialect)
    for joint in _joints(lines)[:2]:
        yield f"DRIVE {{Name {joint}}} {{Value 0.5}} {{Order 1}}"
    yield "GETCONF {Type Camera}"
    yield "GETGEO {Type Camera}"
    yield "SET {Type Gripper} {Opcode OPEN}"
    yield "SET {Type ToolChanger} {Opcode OPEN}"
    yield "SET {Type RangeScanner} {Opcode SCAN}"


def _strain(lines: Sequence[str], dialect: str) -> Iterator[str]:
    """Partial driving, arms by torque and back, hands closed with the arms."""
    if fit := FIT.get(_steering(lines)):
        yield fit[2]
    for name, links in _arms(lines).items():
        yield _move(name, links, (-0.2, 0.2), 2, dialect)
        yield _move(name, links, (-0.2, 0.3), 0, dialect)
        word = "MISPKG" if dialect == "ut2004" else "ACT"
        yield f"{word} {{Name {name}}} {{Gripper 1}}"
        yield f"MISPKG {{Name {name}}} {{Rotation 0,0.1,0.2}}"
    for joint in _joints(lines)[:2]:
        yield f"DRIVE {{Name {joint}}} {{Value -2}} {{Order 2}}"
    yield "SET {Type Joint} {Name AllJoints} {Opcode Stiffness} {Params 0.5}"
    for camera in _names(lines, "Camera"):
        yield f"SET {{Type Camera}} {{Name {camera}}} {{FOV 0.9}}"
        yield f"GETCONF {{Type Camera}} {{Name {camera}}}"
    cameras = [*_names(lines, "Camera"), "Disabled", "Disabled", "Disabled", "Disabled"]
    views = " ".join(f"{{Viewport{n + 1} {name}}}" for n, name in enumerate(cameras[:4]))
    yield f"SET {{Type Viewports}} {{Config QuadView}} {views}"


def _stop(lines: Sequence[str], dialect: str) -> Iterator[str]:
    """Commands of all other families, Flip, light off, what nobody knows; zoom back."""
    own = _steering(lines)
    for steering, commands in FIT.items():
        if steering != own:
            yield commands[0]
    yield "DRIVE {Left 0} {Right 0} {Normalized False} {Light False} {Flip True}"
    yield "SET {Type Camera} {Opcode ZOOM} {Params 0}"
    yield "SET {Type Joint} {Name AllAngles} {Opcode Target} {Params 0}"
    yield "TRACE {On true} {Interval 0.1} {Color Red}"
    yield "NONSENSE {Left 1}"
    yield "MOVE {Type Run} {Action New} {Location 1,1}"
    yield "CONTROL {Type GetSTA}"
    yield "DRIVE {Left nan} {Right {"
    yield "GETCONF {Type Robot} {Name Other}"
    yield "GETGEO {Type Robot}"


STEPS: tuple[tuple[Say | None, float], ...] = (
    (None, 0.4),
    (_ask, 0.4),
    (_go, 1.0),
    (_set, 0.8),
    (_turn, 0.8),
    (_strain, 0.8),
    (_stop, 0.8),
)
"""What is said, and the simulated s that pass then: five in all."""
