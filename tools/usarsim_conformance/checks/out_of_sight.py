"""What sensors tell when a wall, a roof or the distance is between, and of whom they tell (robots
reference 2.6 and 2.9)."""

from __future__ import annotations

import math
from statistics import fmean

from usarsim_conformance.case import Case
from usarsim_conformance.excursions import Track, bearer, equipment, spawn_far
from usarsim_conformance.places import Place
from usarsim_conformance.registry import UNREAL, Severity, checks_of
from usarsim_conformance.stage import boxes, need_stage, one_of, spot
from usarsim_conformance.visits import View, Visit, visit
from usarsim_conformance.walls import controller, put

measured = checks_of("control", reference="robots reference", dialects=UNREAL)

_MUFFLED = 20.0 * math.log10(2.0)
"""dB that a wall takes from a sound: its source counts as twice as far away (robots 2.9)."""


async def _behind(case: Case, type: str) -> tuple[Visit, View]:
    """A person with a wall before, and free."""
    found = await visit(case, await bearer(case, type, "GroundTruth", fixed=type))
    if found.walled is None:
        case.skip("not judged: there is no world controller that could put up a wall")
    return found, found.walled


@measured("values.victim-wall", "Walls hide victims", "2.9; protocol reference 4.8")
async def victim_wall(case: Case) -> None:
    """A victim sensor tells no PartName of somebody 2 m ahead behind a wall."""
    _, view = await _behind(case, "VictSensor")
    lines = [line for _, line in view.track.of("VictSensor")]
    case.need(lines, "no VictSensor line comes")
    seen = [line.get("PartName") for line in lines if line.get("PartName") is not None]
    case.expect(
        not seen,
        f"PartName is {seen[0] if seen else ''} in {len(seen)} of {len(lines)} lines, not absent: "
        "a wall stands between sensor and victim (robots reference 2.9: a victim that is in view)",
    )


@measured("values.loudness-wall", "Walls muffle a sound", "2.9", Severity.SHOULD)
async def loudness_wall(case: Case) -> None:
    """Loudness of somebody who calls behind a wall is 6.0 dB lower than without it, within 0.3."""
    found, view = await _behind(case, "Sound")
    told = []
    for one in (found.views["ahead"], view):
        values = [line.number("Loudness") for _, line in one.track.of("Sound")]
        told.append([value for value in values if value > 0.0])
    if not told[0]:
        case.skip("nobody calls all the time")
    case.expect(
        told[1],
        f"Loudness is 0 behind a wall, not about {fmean(told[0]) - _MUFFLED:.2f}: a call of the "
        "same person is muffled",
    )
    # The two places are not quite equally far.
    nearer, farther = (found.head_distance(one, "Sound") for one in (found.views["ahead"], view))
    lost = fmean(told[0]) - fmean(told[1]) - 20.0 * math.log10(farther / nearer)
    case.expect(
        abs(lost - _MUFFLED) < 0.3,
        f"Loudness is {fmean(told[0]):.2f} without and {fmean(told[1]):.2f} behind a wall: "
        f"{lost:.2f} dB less, not {_MUFFLED:.2f} (robots reference 2.9: as twice as far away)",
    )


@measured("values.gps-roof", "A roof hides the satellites", "2.6")
async def gps_roof(case: Case) -> None:
    """Below a roof that hides the whole sky Fix of GPS is 0, there are fewer than 4 Satellites, and
    neither Latitude nor Longitude is told."""
    need_stage(case, "a roof")
    class_name = await bearer(case, "GPS", "GroundTruth")
    (x, y, _), _ = boxes("roof")[0]
    high = case.survey.places[0].location[2]
    aside = UNREAL.index(case.dialect) * 8.0
    robot = await spawn_far(case, class_name, Place(None, (x + aside, y, high)))
    lines = [line for line in await robot.run(1.0) if line.type == "GPS"]
    case.need(len(lines) > 2, f"only {len(lines)} GPS lines, more than 2 are needed")
    for line in lines:
        count = line.number("Satellites")
        case.expect(
            count < 4.0,
            f"Satellites is {count:g} below a roof, not below 4 (robots reference 2.6: those in "
            "sight)",
        )
        case.expect(
            line.get("Fix") == "0" and line.get("Latitude") is None,
            f"Fix is {line.get('Fix')} and Latitude {line.get('Latitude')} with {count:g} "
            "Satellites below a roof, not 0 and absent (robots reference 2.6: 4 for a fix)",
        )


_RANGE = 6.0
_EXACT = 0.15
"""m: how far a tag is heard, and how near to that it is tried."""


@measured("values.rfid-range", "Tags are heard up to 6 m", "2.9", Severity.SHOULD)
async def rfid_range(case: Case) -> None:
    """A reader tells a tag that was dropped 5.85 m from it, and is silent 6.15 m from it; clients
    of the UT2004 generation quote readings from 5.5 m."""
    class_name = await bearer(case, "RFID", "RFIDReleaser", "GroundTruth", fixed="RFID")
    worn = await equipment(case, class_name)
    world = await controller(case)
    robot = await spawn_far(case, class_name)
    start = (await robot.pose()).location
    yaw = (await robot.pose()).yaw
    gun, place = next(iter(worn.mounts("RFIDReleaser").items()))
    reader = next(iter(worn.on_body("RFID").values()))
    x, y, z = place.location
    cos, sin = math.cos(yaw), math.sin(yaw)
    tag = (start[0] + cos * x - sin * y, start[1] + sin * x + cos * y, start[2] + z)
    await robot.send(f"SET {{Type RFIDReleaser}} {{Name {gun}}} {{Opcode Release}}")
    await robot.run(0.6)
    for wanted in (_RANGE - _EXACT, _RANGE + _EXACT):
        # Backwards, so that the tag is straight ahead of the reader.
        away = wanted + reader.location[0] - x
        goal = (start[0] - cos * away, start[1] - sin * away, start[2])
        await put(world, robot.name, Place(None, goal, (0.0, 0.0, yaw)))
        await robot.catch_up()
        await robot.run(1.0)
        track = Track(await robot.run(1.0))
        view = View("", 0.0, 0.0, track.true_poses[-1][1], track)
        true = math.hypot(*view.seen_from(reader, tag))
        case.need(abs(true - wanted) < 0.1, f"AbsMove puts the reader {true:.2f} m from the tag")
        lines = track.of("RFID")
        case.expect(
            bool(lines) == (wanted < _RANGE),
            f"ID of a tag {true:.2f} m away is told in {len(lines)} RFID lines, not in "
            f"{'some' if wanted < _RANGE else 'none'}: it is heard up to {_RANGE:g} m",
        )


@measured("values.victim-status", "The status is that of the world", "2.9; protocol reference 4.6")
async def victim_status(case: Case) -> None:
    """VictimStatus of VictRFID is the status that the world gives to a victim: of somebody who lies
    unconscious it is another one than of somebody who stands."""
    need_stage(case, "victims of a known status")
    class_name = await bearer(case, "VictRFID", "GroundTruth", fixed="VictRFID")
    high = case.survey.places[0].location[2]
    for number, name in enumerate(("Lying", "Standing")):
        wanted = one_of("victim", name)["status"]
        if name == "Standing":
            found = await visit(case, class_name)
            lines = [line for _, line in found.views["ahead"].track.of("VictRFID")]
        else:
            x, y, _ = spot("victim", name)
            aside = 2.0 if case.dialect == "udk" else -2.0
            place = Place(None, (x + aside, y + 0.5 * number, high))
            robot = await spawn_far(case, class_name, place)
            lines = [line for line in await robot.run(1.0) if line.type == "VictRFID"]
            robot.close()
        case.expect(lines, f"no VictRFID line within 2 m of the victim {name}, which bears a tag")
        told = lines[-1].get("VictimStatus") or lines[-1].get("Status")
        case.expect(
            told == wanted,
            f"VictimStatus of the victim {name} is {told}, not {wanted} (status in the file of the "
            "world)",
        )
