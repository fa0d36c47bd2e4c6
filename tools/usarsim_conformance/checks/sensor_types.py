"""What sensors of each type measure (protocol reference 6.7)."""

from __future__ import annotations

import math
import re
from itertools import pairwise

from usarsim_conformance.case import Case
from usarsim_conformance.recordings import driven, senses, standing
from usarsim_conformance.registry import Severity, control, udk, unreal, ut2004

_OF_MOUNTS = ("ECTilt", "ECPan")
"""Encoders that count turns of a camera's mount (robots reference 2)."""


@unreal("sensors.sonar-range", "Sonars stay in their range", "6, no. 101")
async def sonar_range(case: Case) -> None:
    """Sonar values lie in [MinRange, MaxRange] of CONF; without echo the value is MaxRange."""
    recording, lines = await senses(case, "Sonar")
    conf = recording.replies.get(("GETCONF", "Sonar", ""))
    case.need(conf is not None, "GETCONF {Type Sonar} was not answered")
    assert conf is not None
    limits = {
        item["Name"]: (float(item["MinRange"]), float(item["MaxRange"])) for item in conf.items()
    }
    for line in lines:
        for item in line.items():
            low, high = limits.get(item["Name"], (-math.inf, math.inf))
            case.expect(
                low - 1e-3 <= float(item["Range"]) <= high + 1e-3,
                f"Range of {item['Name']} is {item['Range']}, not {low:g} to {high:g}, MinRange "
                f"to MaxRange of CONF: {line}",
            )


@unreal("sensors.odometry-start", "Odometry starts at zero", "6, no. 108")
async def odometry_start(case: Case) -> None:
    """Odometry is 0,0,0 at spawn, wherever the robot stands."""
    for line in (await senses(case, "Odometry"))[1][:1]:
        pose = line.numbers("Pose")
        case.expect(len(pose) == 3, f"Pose is {line.get('Pose')}, not three numbers: {line}")
        case.expect(
            max(map(abs, pose)) < 0.02, f"Pose is {line.get('Pose')} at first, not 0,0,0: {line}"
        )


@unreal("sensors.odometry-forward", "Odometry grows forward", "6, no. 108")
async def odometry_forward(case: Case) -> None:
    """Odometry x grows by the distance driven, within 10 percent."""
    forward = (await driven(case)).phases["forward"]
    lines = forward.sensor("Odometry")
    if not lines:
        case.skip("the robot has no Odometry")
    rolled = lines[-1].numbers("Pose")[0] - lines[0].numbers("Pose")[0]
    case.expect(
        rolled > 0.0,
        f"x of Pose changes by {rolled:.3f} m while driving forward, not by more than 0",
    )
    case.need(len(lines) > 2, f"only {len(lines)} Odometry lines, more than 2 are needed")
    case.expect(
        abs(rolled - forward.moved[0]) < 0.12 * abs(forward.moved[0]) + 0.07,
        f"x of Pose changes by {rolled:.3f} m, not by {forward.moved[0]:.3f} m, as the robot in "
        "truth",
    )


@unreal("sensors.odometry-clockwise", "Odometry theta grows clockwise", "6, no. 108")
async def odometry_clockwise(case: Case) -> None:
    """Odometry theta grows in a clockwise turn."""
    lines = (await driven(case)).phases["clockwise"].sensor("Odometry")
    if len(lines) < 2:
        case.skip("the robot has no Odometry")
    turn = math.remainder(lines[-1].numbers("Pose")[2] - lines[0].numbers("Pose")[2], math.tau)
    case.expect(
        turn > 0.05,
        f"theta of Pose changes by {turn:.3f} in a clockwise turn, not by more than 0.05",
    )


@unreal("sensors.encoder-forward", "Encoders count forward", "6, no. 110")
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
            if item_name in _OF_MOUNTS:
                continue
            # Encoders of udk wrap at a turn of 360 ticks.
            change = sum(math.remainder(b - a, 360.0) for a, b in pairwise(values))
            case.expect(
                change * sign > 0,
                f"Tick of {item_name} changes by {change:g} driving {name}, which should be "
                f"{'above' if sign > 0 else 'below'} 0",
            )


@control("sensors.encoder-integers", "Ticks are integers", "4.6")
async def encoder_integers(case: Case) -> None:
    """Encoder ticks are integers."""
    for line in (await senses(case, "Encoder"))[1]:
        for item in line.items():
            case.expect(
                re.fullmatch(r"-?\d+", item.get("Tick", "")),
                f"Tick of {item.get('Name')} is {item.get('Tick')!r}, not an integer: {line}",
            )


@udk("sensors.encoder-names-udk", "Encoders are called Wk in udk", "4.6 and 5.3", Severity.SHOULD)
async def encoder_names_udk(case: Case) -> None:
    """In udk encoders of wheels report under the names W0, W1, ..."""
    for line in (await senses(case, "Encoder"))[1]:
        if line.get("Name") in _OF_MOUNTS:
            continue
        case.expect(
            re.fullmatch(r"W\d+", line.get("Name") or ""),
            f"Name of an encoder is {line.get('Name')!r}, not W and a number: {line}",
        )


_GPS = re.compile(r"\d+,\d+\.\d{4},([NSEW])")


@unreal("sensors.gps", "GPS in degrees, minutes and a letter", "6, no. 111 and 112")
async def gps(case: Case) -> None:
    """GPS minutes have four digits, degrees are integers, hemisphere letters are N/S and E/W;
    without a fix there are no coordinates."""
    for line in (await senses(case, "GPS"))[1]:
        case.expect(
            re.fullmatch("[01]", line.get("Fix") or ""),
            f"Fix is {line.get('Fix')!r}, not 0 or 1: {line}",
        )
        case.expect(
            re.fullmatch(r"\d+", line.get("Satellites") or ""),
            f"Satellites is {line.get('Satellites')!r}, not an integer: {line}",
        )
        if line.get("Fix") == "0":
            case.expect(
                "Latitude" not in line.names,
                f"Latitude is {line.get('Latitude')} with Fix 0, not absent: {line}",
            )
            continue
        for name, letters in (("Latitude", "NS"), ("Longitude", "EW")):
            found = _GPS.fullmatch(line.get(name) or "")
            case.expect(
                found and found[1] in letters,
                f"{name} is {line.get(name)!r}, not degrees, minutes with four digits, and "
                f"{' or '.join(letters)}: {line}",
            )


@control("sensors.ground-truth", "GroundTruth is Location, Orientation", "6, no. 117")
async def ground_truth(case: Case) -> None:
    """GroundTruth has Location and then Orientation."""
    for line in (await senses(case, "GroundTruth"))[1]:
        case.expect_names(line, ("Location", "Orientation"), line.names[-2:])


@control("sensors.ins", "INS is Location, Orientation", "4.5")
async def ins(case: Case) -> None:
    """INS has Location and then Orientation."""
    for line in (await senses(case, "INS"))[1]:
        case.expect_names(line, ("Location", "Orientation"), line.names[-2:])


@unreal("sensors.ins-agrees", "INS agrees with the truth at first", "4.6", Severity.SHOULD)
async def ins_agrees(case: Case) -> None:
    """The first INS location is that of the robot within half a metre."""
    recording, lines = await senses(case, "INS")
    truth = recording.of("SEN", "GroundTruth")
    if not truth:
        case.skip("the robot has no GroundTruth")
    away = math.dist(lines[0].numbers("Location")[:2], truth[0].numbers("Location")[:2])
    case.expect(
        away < 0.5,
        f"Location of INS is {away:.2f} m off that of GroundTruth at first, not within 0.5 m: "
        f"{lines[0]}",
    )


@control("sensors.touch", "Touch is True or False", "6, no. 118")
async def touch(case: Case) -> None:
    """Touch values are `True` or `False`; a robot in the open touches nothing."""
    for line in (await senses(case, "Touch"))[1]:
        for item in line.items():
            case.expect(
                item.get("Touch") in ("True", "False"),
                f"Touch of {item.get('Name')} is {item.get('Touch')!r}, not True or False: {line}",
            )


@unreal("sensors.tachometer", "Tachometer has Vel and Pos", "6, no. 119")
async def tachometer(case: Case) -> None:
    """A Tachometer has Vel before Pos with equal counts."""
    for line in (await senses(case, "Tachometer"))[1]:
        if line.names[-1] == "Name":
            continue  # the first report may be empty
        case.expect_names(line, ("Vel", "Pos"), line.names[-2:])
        case.expect(
            len(line.numbers("Vel")) == len(line.numbers("Pos")),
            f"Pos has {len(line.numbers('Pos'))} numbers, not {len(line.numbers('Vel'))}, as Vel: "
            f"{line}",
        )


@unreal("sensors.victims", "Victims are told in known words", "6, no. 114 and 115")
async def victims(case: Case) -> None:
    """A VictSensor says `{Status NoVictims}` after its Name, or PartName and Location pairs with
    parts among Arm, Hand, Chest, Pelvis, Leg, Foot."""
    parts = {"Arm", "Hand", "Chest", "Pelvis", "Leg", "Foot"}
    for line in (await senses(case, "VictSensor"))[1]:
        data = line.segments[line.names.index("Name") + 1 :]
        if data[:1] == (("Status", "NoVictims"),):
            continue
        names = [name for name, _ in data]
        case.expect(
            names == ["PartName", "Location"] * (len(names) // 2) and names,
            f"segments behind Name are {' '.join(names)}, not PartName and Location by turns: "
            f"{line}",
        )
        odd = {value for name, value in data if name == "PartName"} - parts
        case.expect(
            not odd,
            f"PartName is {', '.join(sorted(odd))}, not one of {', '.join(sorted(parts))}: {line}",
        )


@ut2004("sensors.camera-silent", "Cameras send no SEN", "4.6")
async def camera_silent(case: Case) -> None:
    """In ut2004 a camera sends no SEN line: pictures travel on another port."""
    lines = (await standing(case)).of("SEN", "Camera")
    case.expect(not lines, f"{len(lines)} SEN lines come from a camera, not 0")


@udk("sensors.climb", "AltitudeSensor grows upwards", "6, no. 123")
async def climb(case: Case) -> None:
    """The relative altitude of an AltitudeSensor increases when climbing."""
    robot = await case.spawn("aerial")
    line = await robot.client.maybe(
        lambda line: line.head == "SEN" and line.type == "AltitudeSensor", 2.0
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
    case.expect(
        rise > 0.1, f"relativeAltitude changes by {rise:.2f} m in a climb, not by more than 0.1 m"
    )
