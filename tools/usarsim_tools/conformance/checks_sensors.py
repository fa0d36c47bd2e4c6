"""SEN lines (protocol reference 6.7)."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from statistics import median

from usarsim_tools.conformance.case import Case
from usarsim_tools.conformance.lines import Line
from usarsim_tools.conformance.recordings import Recording, driven, standing
from usarsim_tools.conformance.registry import DIALECTS, GAZEBO, ONCE, UDK, UNREAL, UT2004, check
from usarsim_tools.conformance.verdicts import Severity

_UNTIMED = (
    "Odometry", "INS", "INU", "GPS", "Encoder", "Touch", "RFID", "RFIDTag", "HumanMotion",
    "Sound", "CO2Sensor", "Tachometer", "VictRFID",
)  # fmt: skip
_TIMED = ("Sonar", "IR", "RangeScanner", "GroundTruth", "VictSensor", "Acoustic")
_BATCHED = ("Sonar", "IR", "Encoder", "Touch")
_LONG = ("RangeScanner", "RangeScanner3D", "RangeImager", "IRScanner", "PCL", "LineLaser",
         "ObjectSensor")  # fmt: skip


async def _senses(case: Case, type: str = "") -> tuple[Recording, list[Line]]:
    recording = await standing(case)
    lines = recording.of("SEN", type)
    if not lines:
        case.skip(f"the robot has no {type or 'sensor'}")
    return recording, lines


@check(
    "control.sensors.named", "Every SEN has Type and Name", source="protocol reference 6, no. 94"
)
async def named(case: Case) -> None:
    """Every SEN line has a Type and, unless it is the camera's, a Name."""
    for line in (await _senses(case))[1]:
        case.expect(line.type, f"no Type: {line}")
        case.expect(line.type == "Camera" or line.get("Name"), f"no Name: {line}")


@check("control.sensors.order", "Time, Type, Name, data", source="protocol reference 6, no. 95")
async def order(case: Case) -> None:
    """Time, if present, is the first segment; Type precedes Name; Name precedes all data."""
    for line in (await _senses(case))[1]:
        names = [name for name in line.names if name != "Battery" or case.dialect != "gazebo"]
        case.expect("Time" not in names[1:], f"Time is not the first segment: {line}")
        rest = names[1:] if names[0] == "Time" else names
        case.expect(rest[0] == "Type", f"Type is not next: {line}")
        case.expect(line.type == "Camera" or rest[1:2] == ["Name"], f"no Name next: {line}")


@check(
    "control.sensors.untimed",
    "Types without Time",
    source="protocol reference 6, no. 96",
    dialects=UT2004,
)
async def untimed(case: Case) -> None:
    """In ut2004 Odometry, INS, GPS, Encoder, Touch, RFID, HumanMotion, Sound, CO2Sensor lines
    have no Time: index-based clients would read the wrong segments."""
    lines = [line for line in (await _senses(case))[1] if line.type in _UNTIMED]
    if not lines:
        case.skip("the robot has none of these sensors")
    for line in lines:
        case.expect("Time" not in line.names, f"a Time: {line}")


@check(
    "control.sensors.timed",
    "Types with Time",
    source="protocol reference 6, no. 96",
    dialects=UT2004,
)
async def timed(case: Case) -> None:
    """In ut2004 Sonar, IR, RangeScanner, GroundTruth, VictSensor lines have a Time."""
    lines = [line for line in (await _senses(case))[1] if line.type in _TIMED]
    if not lines:
        case.skip("the robot has none of these sensors")
    for line in lines:
        case.expect(line.names[0] == "Time", f"no Time: {line}")


@check(
    "control.sensors.timed-udk",
    "Types with Time in udk",
    source="protocol reference 5.3",
    dialects=UDK,
    severity=Severity.SHOULD,
)
async def timed_udk(case: Case) -> None:
    """In udk all lines but those of INS, GPS, ObjectSensor and LineLaser have a Time."""
    for line in (await _senses(case))[1]:
        if line.type not in ("INS", "GPS", "ObjectSensor", "LineLaser"):
            case.expect(line.names[0] == "Time", f"no Time: {line}")


@check(
    "control.sensors.ins-untimed",
    "INS has no Time",
    source="protocol reference 6, no. 113",
    dialects=UNREAL,
)
async def ins_untimed(case: Case) -> None:
    """INS lines have no Time in either dialect."""
    for line in (await _senses(case, "INS"))[1]:
        case.expect("Time" not in line.names, f"a Time: {line}")


@check(
    "control.sensors.batched",
    "One line for all of a type",
    source="protocol reference 6, no. 97 and 99",
    dialects=UT2004,
)
async def batched(case: Case) -> None:
    """In ut2004 all Sonar, IR, Encoder and Touch items of a robot are in one line per type,
    each item one segment `{Name n Range f}`."""
    recording = await standing(case)
    types = [type for type in _BATCHED if type in recording.types()]
    if not types:
        case.skip("the robot has none of these sensors")
    for type in types:
        lines = recording.of("SEN", type)
        items = {item["Name"] for line in lines for item in line.items()}
        for line in lines:
            found = [item["Name"] for item in line.items()]
            case.expect(set(found) == items, f"not all of {sorted(items)} in one line: {line}")
            data = [value for name, value in line.segments if name == "Name"]
            case.expect(
                all(len(value.split(" ")) == 3 for value in data), f"not {{Name n Key v}}: {line}"
            )


@check(
    "control.sensors.single",
    "One line for every item",
    source="protocol reference 6, no. 98 and 99",
    dialects=UDK,
)
async def single(case: Case) -> None:
    """In udk every Sonar, IR, Encoder and Touch item has a line of its own with separate
    segments."""
    recording = await standing(case)
    types = [type for type in _BATCHED if type in recording.types()]
    if not types:
        case.skip("the robot has none of these sensors")
    for type in types:
        for line in recording.of("SEN", type):
            names = [value for name, value in line.segments if name == "Name"]
            case.expect(len(names) == 1, f"{len(names)} items in one line: {line}")
            case.expect(" " not in names[0], f"pairs in one segment: {line}")


@check(
    "control.sensors.sixteen",
    "P2AT has sixteen sonars",
    source="protocol reference 6, no. 100",
    dialects=UT2004,
)
async def sixteen(case: Case) -> None:
    """A P2AT reports sixteen sonars in one line, F1..F8 and then R1..R8."""
    if case.robot_class.lower() != "p2at":
        case.skip("the robot is no P2AT; name it with --robot")
    _, lines = await _senses(case, "Sonar")
    wanted = [f"{side}{number}" for side in "FR" for number in range(1, 9)]
    for line in lines:
        case.expect([item["Name"] for item in line.items()] == wanted, f"other sonars: {line}")


@check(
    "control.sensors.keys",
    "Range, Tick and Touch",
    source="protocol reference 6, no. 97 to 99",
    dialects=UNREAL,
)
async def keys(case: Case) -> None:
    """The value of a Sonar or IR is called Range, of an Encoder Tick, of a Touch Touch."""
    recording = await standing(case)
    wanted = {"Sonar": "Range", "IR": "Range", "Encoder": "Tick", "Touch": "Touch"}
    types = set(wanted) & recording.types()
    if not types:
        case.skip("the robot has none of these sensors")
    for type in types:
        for line in recording.of("SEN", type):
            for item in line.items():
                case.expect(wanted[type] in item, f"no {wanted[type]} of {item['Name']}: {line}")


@check(
    "control.sensors.sonar-range",
    "Sonars stay in their range",
    source="protocol reference 6, no. 101",
    dialects=UNREAL,
)
async def sonar_range(case: Case) -> None:
    """Sonar values lie in [MinRange, MaxRange] of CONF; without echo the value is MaxRange."""
    recording, lines = await _senses(case, "Sonar")
    conf = recording.replies.get(("GETCONF", "Sonar", ""))
    case.need(conf is not None, "GETCONF {Type Sonar} was not answered")
    assert conf is not None
    limits = {
        item["Name"]: (float(item["MinRange"]), float(item["MaxRange"])) for item in conf.items()
    }
    for line in lines:
        for item in line.items():
            low, high = limits.get(item["Name"], (-math.inf, math.inf))
            case.expect(low - 1e-3 <= float(item["Range"]) <= high + 1e-3, f"{item}: {line}")


@check(
    "control.sensors.scan-order",
    "Segments of a scan",
    source="protocol reference 6, no. 102",
    dialects=UNREAL,
)
async def scan_order(case: Case) -> None:
    """RangeScanner segments are Name, Resolution, FOV, Range in this order, Range last, with
    exactly this spelling."""
    for line in (await _senses(case, "RangeScanner"))[1]:
        names = line.names[line.names.index("Name") :]
        case.expect(names == ("Name", "Resolution", "FOV", "Range"), f"other segments: {line}")


@check(
    "control.sensors.scan-numbers", "A scan is numbers with commas", source="protocol reference 4.6"
)
async def scan_numbers(case: Case) -> None:
    """Ranges are plain numbers joined by single commas, none missing, none at the end."""
    for line in (await _senses(case, "RangeScanner"))[1]:
        values = line.numbers("Range")
        case.expect(values and not any(map(math.isnan, values)), f"no plain numbers: {line}")


@check("control.sensors.scan-count", "Number of ranges", source="protocol reference 6, no. 103")
async def scan_count(case: Case) -> None:
    """The number of ranges is floor(FOV / Resolution) + 1 and never exceeds
    round(printed FOV / printed Resolution) + 1, beyond which one client crashes."""
    for line in (await _senses(case, "RangeScanner"))[1]:
        beams = line.number("FOV") / line.number("Resolution")
        count = len(line.numbers("Range"))
        case.expect(count <= round(beams) + 1, f"{count} ranges for {beams:.1f} steps: {line}")
        case.expect(count >= math.floor(beams), f"{count} ranges for {beams:.1f} steps: {line}")


@check(
    "control.sensors.scan-miss",
    "A beam without echo reads MaxRange",
    source="protocol reference 6, no. 105",
    dialects=UNREAL,
)
async def scan_miss(case: Case) -> None:
    """No range is larger than the MaxRange of CONF."""
    recording, lines = await _senses(case, "RangeScanner")
    conf = recording.replies.get(("GETCONF", "RangeScanner", ""))
    case.need(conf is not None, "GETCONF {Type RangeScanner} was not answered")
    assert conf is not None
    limits = {item["Name"]: float(item["MaxRange"]) for item in conf.items()}
    for line in lines:
        most, limit = max(line.numbers("Range")), limits[line.get("Name") or ""]
        case.expect(most <= limit + 1e-3, f"{most} although MaxRange is {limit}")


@check(
    "control.sensors.scan-right-first",
    "Scans begin on the right",
    source="protocol reference 6, no. 104",
    dialects=UNREAL,
    exclusive=True,
    within=60.0,
)
async def scan_right_first(case: Case) -> None:
    """An obstacle to the right of the robot, here another robot, appears in the first half of
    the range list."""
    change = await _shadow(case, right=0.9)
    case.expect(change < 0.5, f"a robot on the right shortened ranges at {change:.0%} of the list")


@check(
    "control.sensors.scan-left-first",
    "Scans begin on the left in the Gazebo prototype",
    source="protocol reference 4.15",
    dialects=GAZEBO,
    exclusive=True,
    within=60.0,
)
async def scan_left_first(case: Case) -> None:
    """In the prototype's form an obstacle on the right appears in the second half."""
    change = await _shadow(case, right=-0.9)
    case.expect(change > 0.5, f"a robot on the right shortened ranges at {change:.0%} of the list")


async def _shadow(case: Case, right: float) -> float:
    """Where in the scan a robot beside the first one shortens the ranges: 0 first, 1 last."""
    if not (await standing(case)).of("SEN", "RangeScanner"):
        case.skip("the robot has no RangeScanner")
    base = await case.place()
    case.need(base.tag is None or any(base.location), "the server lists no start poses")
    watcher = await case.spawn(place=base)
    await watcher.run(0.6)
    alone = (await watcher.sensor("RangeScanner")).numbers("Range")
    # Tall enough to be seen by a scanner on the deck of a robot like itself: tipped on its side.
    beside = base.moved(right=right, forward=0.15, down=-0.35 if right > 0 else 0.35)
    tipped = (1.57, 0.0, beside.rotation[2])
    await case.spawn(place=type(beside)(None, beside.location, tipped))
    await watcher.run(0.8)
    together = (await watcher.sensor("RangeScanner")).numbers("Range")
    nearer = [
        index / max(1, len(alone) - 1)
        for index, (one, two) in enumerate(zip(alone, together, strict=False))
        if two < one - 0.1
    ]
    case.need(nearer, "the scanner did not see a robot beside it")
    return median(nearer)


@check(
    "control.sensors.scan-length",
    "A scan of 181 beams fits 2000 bytes",
    source="protocol reference 6, no. 106",
)
async def scan_length(case: Case) -> None:
    """A RangeScanner line of at most 181 beams is shorter than 2000 bytes."""
    for line in (await _senses(case, "RangeScanner"))[1]:
        if len(line.numbers("Range")) <= 181:
            case.expect(len(line.raw) < 2000, f"{len(line.raw)} bytes: {line}")


@check(
    "control.sensors.short",
    "Other lines stay below 1024 bytes",
    source="protocol reference 6, no. 107",
    severity=Severity.SHOULD,
)
async def short(case: Case) -> None:
    """No SEN line of a type without long lists exceeds 1024 bytes."""
    for line in (await _senses(case))[1]:
        if line.type not in _LONG:
            case.expect(len(line.raw) <= 1024, f"{len(line.raw)} bytes: {line}")


@check(
    "control.sensors.odometry-start",
    "Odometry starts at zero",
    source="protocol reference 6, no. 108",
    dialects=UNREAL,
)
async def odometry_start(case: Case) -> None:
    """Odometry is 0,0,0 at spawn, wherever the robot stands."""
    for line in (await _senses(case, "Odometry"))[1][:1]:
        pose = line.numbers("Pose")
        case.expect(len(pose) == 3, f"no three numbers: {line}")
        case.expect(max(map(abs, pose)) < 0.02, f"not zero: {line}")


@check(
    "control.sensors.odometry-forward",
    "Odometry grows forward",
    source="protocol reference 6, no. 108",
    dialects=UNREAL,
)
async def odometry_forward(case: Case) -> None:
    """Odometry x grows by the distance driven, within 10 percent."""
    forward = (await driven(case)).phases["forward"]
    lines = forward.sensor("Odometry")
    if not lines:
        case.skip("the robot has no Odometry")
    rolled = lines[-1].numbers("Pose")[0] - lines[0].numbers("Pose")[0]
    case.expect(rolled > 0.0, f"x changed by {rolled:.3f} while driving forward")
    case.need(len(lines) > 2, "too few Odometry lines")
    case.expect(
        abs(rolled - forward.moved[0]) < 0.12 * abs(forward.moved[0]) + 0.07,
        f"{rolled:.3f} m by odometry, {forward.moved[0]:.3f} m in truth",
    )


@check(
    "control.sensors.odometry-clockwise",
    "Odometry theta grows clockwise",
    source="protocol reference 6, no. 108",
    dialects=UNREAL,
)
async def odometry_clockwise(case: Case) -> None:
    """Odometry theta grows in a clockwise turn."""
    lines = (await driven(case)).phases["clockwise"].sensor("Odometry")
    if len(lines) < 2:
        case.skip("the robot has no Odometry")
    turn = math.remainder(lines[-1].numbers("Pose")[2] - lines[0].numbers("Pose")[2], math.tau)
    case.expect(turn > 0.05, f"theta changed by {turn:.3f} in a clockwise turn")


@check(
    "control.sensors.encoder-forward",
    "Encoders count forward",
    source="protocol reference 6, no. 110",
    dialects=UNREAL,
)
async def encoder_forward(case: Case) -> None:
    """Encoder ticks increase when the wheels roll forward and decrease when they roll back."""
    drive = await driven(case)
    for name, sign in (("forward", 1), ("back", -1)):
        lines = drive.phases[name].sensor("Encoder")
        if len(lines) < 2:
            case.skip("the robot has no Encoder")
        ticks: dict[str, list[float]] = {}
        for line in lines:
            for item in line.items():
                ticks.setdefault(item["Name"], []).append(float(item["Tick"]))
        for item_name, values in ticks.items():
            # Encoders of udk wrap at a turn of 360 ticks.
            change = sum(math.remainder(b - a, 360.0) for a, b in pairwise(values))
            case.expect(change * sign > 0, f"{item_name} changed by {change:g} driving {name}")


@check("control.sensors.encoder-integers", "Ticks are integers", source="protocol reference 4.6")
async def encoder_integers(case: Case) -> None:
    """Encoder ticks are integers."""
    for line in (await _senses(case, "Encoder"))[1]:
        for item in line.items():
            case.expect(re.fullmatch(r"-?\d+", item.get("Tick", "")), f"{item}: {line}")


@check(
    "control.sensors.encoder-names-udk",
    "Encoders are called Wk in udk",
    source="protocol reference 4.6 and 5.3",
    dialects=UDK,
    severity=Severity.SHOULD,
)
async def encoder_names_udk(case: Case) -> None:
    """In udk encoders report under the names W0, W1, ..."""
    for line in (await _senses(case, "Encoder"))[1]:
        case.expect(re.fullmatch(r"W\d+", line.get("Name") or ""), f"{line}")


_GPS = re.compile(r"\d+,\d+\.\d{4},([NSEW])")


@check(
    "control.sensors.gps",
    "GPS in degrees, minutes and a letter",
    source="protocol reference 6, no. 111 and 112",
    dialects=UNREAL,
)
async def gps(case: Case) -> None:
    """GPS minutes have four digits, degrees are integers, hemisphere letters are N/S and E/W;
    without a fix there are no coordinates."""
    for line in (await _senses(case, "GPS"))[1]:
        case.expect(re.fullmatch("[01]", line.get("Fix") or ""), f"Fix: {line}")
        case.expect(re.fullmatch(r"\d+", line.get("Satellites") or ""), f"Satellites: {line}")
        if line.get("Fix") == "0":
            case.expect("Latitude" not in line.names, f"coordinates without a fix: {line}")
            continue
        for name, letters in (("Latitude", "NS"), ("Longitude", "EW")):
            found = _GPS.fullmatch(line.get(name) or "")
            case.expect(found and found[1] in letters, f"{name}: {line}")


@check(
    "control.sensors.ground-truth",
    "GroundTruth is Location, Orientation",
    source="protocol reference 6, no. 117",
    dialects=DIALECTS,
)
async def ground_truth(case: Case) -> None:
    """GroundTruth has Location and then Orientation."""
    for line in (await _senses(case, "GroundTruth"))[1]:
        case.expect(line.names[-2:] == ("Location", "Orientation"), f"{line}")


@check("control.sensors.ins", "INS is Location, Orientation", source="protocol reference 4.5")
async def ins(case: Case) -> None:
    """INS has Location and then Orientation."""
    for line in (await _senses(case, "INS"))[1]:
        case.expect(line.names[-2:] == ("Location", "Orientation"), f"{line}")


@check(
    "control.sensors.ins-agrees",
    "INS agrees with the truth at first",
    source="protocol reference 4.6",
    severity=Severity.SHOULD,
    dialects=UNREAL,
)
async def ins_agrees(case: Case) -> None:
    """The first INS location is that of the robot within half a metre."""
    recording, lines = await _senses(case, "INS")
    truth = recording.of("SEN", "GroundTruth")
    if not truth:
        case.skip("the robot has no GroundTruth")
    away = math.dist(lines[0].numbers("Location")[:2], truth[0].numbers("Location")[:2])
    case.expect(away < 0.5, f"{away:.2f} m away: {lines[0]}")


@check("control.sensors.touch", "Touch is True or False", source="protocol reference 6, no. 118")
async def touch(case: Case) -> None:
    """Touch values are `True` or `False`; a robot in the open touches nothing."""
    for line in (await _senses(case, "Touch"))[1]:
        for item in line.items():
            case.expect(item.get("Touch") in ("True", "False"), f"{item}: {line}")


@check(
    "control.sensors.tachometer",
    "Tachometer has Vel and Pos",
    source="protocol reference 6, no. 119",
    dialects=UNREAL,
)
async def tachometer(case: Case) -> None:
    """A Tachometer has Vel before Pos with equal counts."""
    for line in (await _senses(case, "Tachometer"))[1]:
        if line.names[-1] == "Name":
            continue  # the first report may be empty
        case.expect(line.names[-2:] == ("Vel", "Pos"), f"{line}")
        case.expect(len(line.numbers("Vel")) == len(line.numbers("Pos")), f"{line}")


@check(
    "control.sensors.victims",
    "Victims are told in known words",
    source="protocol reference 6, no. 114 and 115",
    dialects=UNREAL,
)
async def victims(case: Case) -> None:
    """A VictSensor says `{Status NoVictims}` after its Name, or PartName and Location pairs with
    parts among Arm, Hand, Chest, Pelvis, Leg, Foot."""
    parts = {"Arm", "Hand", "Chest", "Pelvis", "Leg", "Foot"}
    for line in (await _senses(case, "VictSensor"))[1]:
        data = line.segments[line.names.index("Name") + 1 :]
        if data[:1] == (("Status", "NoVictims"),):
            continue
        names = [name for name, _ in data]
        case.expect(names == ["PartName", "Location"] * (len(names) // 2) and names, f"{line}")
        case.expect({value for name, value in data if name == "PartName"} <= parts, f"{line}")


@check(
    "control.sensors.interval",
    "Sensors keep their intervals",
    source="protocol reference 6, no. 122",
    severity=Severity.SHOULD,
)
async def interval(case: Case) -> None:
    """Each periodic sensor with a Time keeps a steady interval of simulated time."""
    _, lines = await _senses(case)
    times: dict[tuple[str, str], list[float]] = {}
    for line in lines:
        if not math.isnan(line.time):
            times.setdefault((line.type, line.items()[0]["Name"]), []).append(line.time)
    for (type, name), stamps in times.items():
        gaps = [b - a for a, b in pairwise(stamps)]
        if len(gaps) < 4:
            continue
        usual = median(gaps)
        late = [gap for gap in gaps if gap > 2.0 * usual + 0.02]
        case.expect(len(late) <= 1, f"{type} {name}: {usual:.3f} s usually, but {late}")


@check(
    "control.sensors.camera-silent",
    "Cameras send no SEN",
    source="protocol reference 4.6",
    dialects=UT2004,
)
async def camera_silent(case: Case) -> None:
    """In ut2004 a camera sends no SEN line: pictures travel on another port."""
    lines = (await standing(case)).of("SEN", "Camera")
    case.expect(not lines, f"a camera's line: {lines[:1]}")


@check(
    "control.sensors.climb",
    "AltitudeSensor grows upwards",
    source="protocol reference 6, no. 123",
    dialects=ONCE,
)
async def climb(case: Case) -> None:
    """The relative altitude of an AltitudeSensor increases when climbing."""
    robot = await case.spawn("aerial")
    line = await robot.client.maybe(
        lambda line: line.head == "SEN" and line.type == "AltitudeSensor", 1.5
    )
    if line is None:
        case.skip(f"{robot.class_name} has no AltitudeSensor")
    assert line is not None
    await robot.send(
        "DRIVE {AltitudeVelocity 1} {LinearVelocity 0} {LateralVelocity 0} {RotationalVelocity 0}"
    )
    await robot.run(1.5)
    later = await robot.sensor("AltitudeSensor")
    rise = later.number("relativeAltitude") - line.number("relativeAltitude")
    case.expect(rise > 0.1, f"climbing changed it by {rise:.2f}")
