"""Shape and order of SEN lines (protocol reference 6.7), and numbers of GPS against places and
declared noise (robots reference 2.6)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import fmean, median, stdev

from usarsim_conformance.case import Case
from usarsim_conformance.control import Pose
from usarsim_conformance.excursions import Track, bearer, spawn_far
from usarsim_conformance.grounds import APART, lane
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place
from usarsim_conformance.ranging import CHANCE, spread_bounds
from usarsim_conformance.recordings import irregular, senses, standing, watched
from usarsim_conformance.registry import (
    UNREAL,
    Severity,
    checks_of,
    control,
    udk,
    unreal,
    ut2004,
)

measured = checks_of("control", reference="robots reference", dialects=UNREAL)

_UNTIMED = (
    "Odometry", "INS", "INU", "GPS", "Encoder", "Touch", "RFID", "RFIDTag", "HumanMotion",
    "Sound", "CO2Sensor", "Tachometer", "VictRFID",
)  # fmt: skip


_TIMED = ("Sonar", "IR", "RangeScanner", "GroundTruth", "VictSensor", "Acoustic")


_BATCHED = ("Sonar", "IR", "Encoder", "Touch")


_LONG = ("RangeScanner", "RangeScanner3D", "RangeImager", "IRScanner", "PCL", "LineLaser",
         "ObjectSensor")  # fmt: skip


_WHEN_THERE = ("RFID", "RFIDTag", "VictSensor", "VictRFID", "HumanMotion", "Sound", "Acoustic",
               "CO2Sensor", "Helper", "Camera")  # fmt: skip
"""Types that may report only when there is something to report."""


@control("sensors.named", "Every SEN has Type and Name", "6, no. 94")
async def named(case: Case) -> None:
    """Every SEN line has a Type and, unless it is the camera's, a Name."""
    for line in (await senses(case))[1]:
        case.expect(line.type, f"Type is missing: {line}")
        case.expect(line.type == "Camera" or line.get("Name"), f"Name is missing: {line}")


@control("sensors.order", "Time, Type, Name, data", "6, no. 95")
async def order(case: Case) -> None:
    """Time, if present, is the first segment; Type precedes Name; Name precedes all data."""
    for line in (await senses(case))[1]:
        names = [name for name in line.names if name != "Battery" or case.dialect != "gazebo"]
        case.expect(
            "Time" not in names[1:], f"Time stands behind {line.names[0]}, not first: {line}"
        )
        rest = names[1:] if names[0] == "Time" else names
        case.expect(rest[0] == "Type", f"{rest[0]} comes first or behind Time, not Type: {line}")
        case.expect(
            line.type == "Camera" or rest[1:2] == ["Name"],
            f"Name does not come behind Type: {line}",
        )


@ut2004("sensors.untimed", "Types without Time", "6, no. 96")
async def untimed(case: Case) -> None:
    """In ut2004 Odometry, INS, GPS, Encoder, Touch, RFID, HumanMotion, Sound, CO2Sensor lines
    have no Time: index-based clients would read the wrong segments."""
    lines = [line for line in (await senses(case))[1] if line.type in _UNTIMED]
    if not lines:
        case.skip("the robot has none of these sensors")
    for line in lines:
        case.expect("Time" not in line.names, f"Time is {line.get('Time')}, not absent: {line}")


@ut2004("sensors.timed", "Types with Time", "6, no. 96")
async def timed(case: Case) -> None:
    """In ut2004 Sonar, IR, RangeScanner, GroundTruth, VictSensor lines have a Time."""
    lines = [line for line in (await senses(case))[1] if line.type in _TIMED]
    if not lines:
        case.skip("the robot has none of these sensors")
    for line in lines:
        case.expect(
            line.names[0] == "Time", f"the first segment is {line.names[0]}, not Time: {line}"
        )


@udk("sensors.timed-udk", "Types with Time in udk", "5.3", Severity.SHOULD)
async def timed_udk(case: Case) -> None:
    """In udk all lines but those of INS, GPS, ObjectSensor and LineLaser have a Time; the INU of
    older robots, which UDK does not know, is no rule's business."""
    for line in (await senses(case))[1]:
        if line.type not in ("INS", "INU", "GPS", "ObjectSensor", "LineLaser"):
            case.expect(
                line.names[0] == "Time", f"the first segment is {line.names[0]}, not Time: {line}"
            )


@unreal("sensors.ins-untimed", "INS has no Time", "6, no. 113")
async def ins_untimed(case: Case) -> None:
    """INS lines have no Time in either dialect."""
    for line in (await senses(case, "INS"))[1]:
        case.expect("Time" not in line.names, f"Time is {line.get('Time')}, not absent: {line}")


@ut2004("sensors.batched", "One line for all of a type", "6, no. 97 and 99")
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
            case.expect(
                set(found) == items,
                f"items of one line are {' '.join(found)}, not all of {' '.join(sorted(items))}: "
                f"{line}",
            )
            data = [value for name, value in line.segments if name == "Name"]
            case.expect(
                all(len(value.split(" ")) == 3 for value in data),
                f"segments of items are {data}, not each a name, a key and a value: {line}",
            )


@udk("sensors.single", "One line for every item", "6, no. 98 and 99")
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
            case.expect(len(names) == 1, f"{len(names)} items are in one line, not 1: {line}")
            case.expect(" " not in names[0], f"Name is {names[0]!r}, not a name alone: {line}")


@ut2004("sensors.sixteen", "P2AT has sixteen sonars", "6, no. 100")
async def sixteen(case: Case) -> None:
    """A P2AT reports sixteen sonars in one line, F1..F8 and then R1..R8."""
    if case.robot_class.lower() != "p2at":
        case.skip("the robot is no P2AT; name it with --robot")
    _, lines = await senses(case, "Sonar")
    wanted = [f"{side}{number}" for side in "FR" for number in range(1, 9)]
    for line in lines:
        case.expect(
            [item["Name"] for item in line.items()] == wanted,
            f"sonars of a line are {' '.join(item['Name'] for item in line.items())}, not "
            f"{' '.join(wanted)}",
        )


@unreal("sensors.keys", "Range, Tick and Touch", "6, no. 97 to 99")
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
                case.expect(
                    wanted[type] in item, f"{wanted[type]} of {item['Name']} is missing: {line}"
                )


@control("sensors.short", "Other lines stay below 1024 bytes", "6, no. 107", Severity.SHOULD)
async def short(case: Case) -> None:
    """No SEN line of a type without long lists exceeds 1024 bytes."""
    for line in (await senses(case))[1]:
        if line.type not in _LONG:
            case.expect(
                len(line.raw) <= 1024,
                f"a line of {line.type} has {len(line.raw)} bytes, not at most 1024: {line}",
            )


@control("sensors.interval", "Sensors keep their intervals", "6, no. 122")
async def interval(case: Case) -> None:
    """Each periodic sensor reports at a steady interval of simulated time: over eight seconds no
    report is left out and none comes twice. Clients integrate odometry from what they get."""
    times: dict[tuple[str, str], list[float]] = {}
    untimed: set[tuple[str, str]] = set()
    now = math.nan
    for line in await watched(case):
        now = now if math.isnan(line.time) else line.time
        if line.head != "SEN" or line.type in _WHEN_THERE or not line.items() or math.isnan(now):
            continue
        key = line.type, line.items()[0]["Name"]
        times.setdefault(key, []).append(now)
        if math.isnan(line.time):
            untimed.add(key)
    if not times:
        case.skip("the robot has no periodic sensors")
    for key, stamps in times.items():
        odd = irregular(stamps, rough=key in untimed)
        case.expect(not odd, f"reports of {' '.join(key)} do not come at one interval: {odd}")


_NORTH, _EAST = 111_200.0, 71_670.0
"""m in a degree of latitude and of longitude, whatever the latitude."""
_AWAY = 2.5 * APART
"""m that the second and the third robot are ahead and to the right of the first: between lanes, out
of sight of robots there."""
_WATCHED = 8.0
"""s of simulated time."""


@dataclass(frozen=True)
class _Station:
    """A robot that stood still."""

    place: Pose  # where it truly was
    fixes: list[tuple[float, float, int]]
    """North and east in degrees, and satellites, of each report."""


def _degrees(line: Line, name: str, negative: str) -> float:
    whole, minutes, letter = (line.get(name) or "nan,nan,").split(",")
    size = float(whole) + float(minutes) / 60.0
    return -size if letter == negative else size


async def _stations(case: Case) -> list[_Station]:
    class_name = await bearer(case, "GPS", "GroundTruth")

    async def watch(case: Case) -> list[_Station]:
        base = lane(case)
        x, y, z = base.location

        async def stand(ahead: float, right: float) -> _Station:
            place = Place(None, (x + ahead, y + right, z), base.rotation)
            robot = await spawn_far(case, class_name, place)
            track = Track(await robot.run(_WATCHED))
            robot.close()
            fixes = [
                (
                    _degrees(line, "Latitude", "S"),
                    _degrees(line, "Longitude", "W"),
                    int(line.number("Satellites")),
                )
                for _, line in track.of("GPS")
                if line.get("Fix") == "1"
            ]
            case.need(len(fixes) >= 20, f"only {len(fixes)} GPS lines with a fix, 20 are needed")
            return _Station(track.true_poses[-1][1], fixes)

        return [await stand(0.0, 0.0), await stand(_AWAY, 0.0), await stand(0.0, _AWAY)]

    return await case.shared(f"{class_name} with GPS at three places", watch)


def _deviation(satellites: float) -> float:
    """m on each axis: a third of the line through 2.5 m with 4 and 0.75 m with 12."""
    return max(2.5 + (0.75 - 2.5) / 8.0 * (satellites - 4), 0.0) / 3.0


@measured(
    "values.gps-scale", "GPS tells metres north and east", "2.6; protocol reference 6, no. 111"
)
async def gps_scale(case: Case) -> None:
    """Latitude grows by a degree in 111,200 m along x, Longitude by one in 71,670 m along y, each
    with nothing of the other; mean of many reports, within what the noise allows."""
    first, *others = await _stations(case)
    for other in others:
        sigma = max(_deviation(min(n for _, _, n in one.fixes)) for one in (first, other))
        share = CHANCE * math.sqrt(2.0 / min(len(first.fixes), len(other.fixes)))
        slack = share * sigma + 0.3
        for axis, name, scale in ((0, "Latitude", _NORTH), (1, "Longitude", _EAST)):
            told = [[fix[axis] * scale for fix in one.fixes] for one in (first, other)]
            found = fmean(told[1]) - fmean(told[0])
            wanted = other.place.location[axis] - first.place.location[axis]
            if abs(found - wanted) < slack:
                continue
            noise = max(map(stdev, told))
            case.need(
                abs(found - wanted) >= share * noise + 0.3,
                f"{name} scatters by {noise:.2f} m, not by {sigma:.2f} m, which "
                "control.values.gps-noise is about: its scale is lost in that",
            )
            per_metre = f", {found / wanted:.3f} times the right way" if abs(wanted) > 1.0 else ""
            case.fail(
                f"{name} moved by {found:.2f} m from one robot to another, in truth {wanted:.2f} m"
                f"{per_metre}: a degree is {scale:.0f} m",
            )


@measured("values.gps-noise", "GPS is as inexact as its satellites", "2.6")
async def gps_noise(case: Case) -> None:
    """Latitude and Longitude of a robot at rest scatter by a third of 2.5 m with 4 satellites and
    of 0.75 m with 12, and so on in between; reports do not depend on each other."""
    stations = await _stations(case)
    for axis, name, scale in ((0, "Latitude", _NORTH), (1, "Longitude", _EAST)):
        grain = 1e-4 / 60.0 * scale
        squares: list[float] = []
        for one in stations:
            mean = fmean(fix[axis] for fix in one.fixes)
            part = math.sqrt(len(one.fixes) / (len(one.fixes) - 1.0))
            for fix in one.fixes:
                sigma = math.hypot(_deviation(fix[2]), grain / math.sqrt(12.0))
                squares.append((part * (fix[axis] - mean) * scale / sigma) ** 2)
        ratio, (low, high) = fmean(squares), spread_bounds(len(squares) - len(stations))
        satellites = median(fix[2] for one in stations for fix in one.fixes)
        right = math.hypot(_deviation(satellites), grain / math.sqrt(12.0))
        case.expect(
            low < ratio < high,
            f"noise of {name}, its standard deviation at rest, is {math.sqrt(ratio) * right:.2f} m "
            f"over {len(squares)} reports, not {right:.2f} m, as with {satellites:g} Satellites",
        )


@measured("values.gps-satellites", "Satellites over open floor", "2.6")
async def gps_satellites(case: Case) -> None:
    """On open floor Satellites is between 4 and 12, the same at places not far from each other."""
    counts = [fix[2] for one in await _stations(case) for fix in one.fixes]
    case.expect(min(counts) >= 4, f"Satellites is {min(counts)} with a fix, not at least 4")
    case.expect(max(counts) <= 12, f"Satellites is {max(counts)}, not at most 12")
    case.expect(
        max(counts) - min(counts) <= 1,
        f"Satellites is {min(counts)} to {max(counts)} at places near each other, not the same "
        "within 1",
    )
