"""Range scanners (protocol reference 6.7)."""

from __future__ import annotations

import math
from statistics import median

from usarsim_conformance.case import Case
from usarsim_conformance.recordings import senses, standing, told
from usarsim_conformance.registry import GAZEBO, UNREAL, check


@check(
    "control.sensors.scan-order",
    "Segments of a scan",
    source="protocol reference 6, no. 102",
    dialects=UNREAL,
)
async def scan_order(case: Case) -> None:
    """RangeScanner segments are Name, Resolution, FOV, Range in this order, Range last, with
    exactly this spelling."""
    for line in (await senses(case, "RangeScanner"))[1]:
        names = line.names[line.names.index("Name") :]
        case.expect(names == ("Name", "Resolution", "FOV", "Range"), f"other segments: {line}")


@check(
    "control.sensors.scan-numbers", "A scan is numbers with commas", source="protocol reference 4.6"
)
async def scan_numbers(case: Case) -> None:
    """Ranges are plain numbers joined by single commas, none missing, none at the end."""
    for line in (await senses(case, "RangeScanner"))[1]:
        values = line.numbers("Range")
        case.expect(values and not any(map(math.isnan, values)), f"no plain numbers: {line}")


@check("control.sensors.scan-count", "Number of ranges", source="protocol reference 6, no. 103")
async def scan_count(case: Case) -> None:
    """The number of ranges is floor(FOV / Resolution) + 1 and never exceeds
    round(printed FOV / printed Resolution) + 1, beyond which one client crashes."""
    for line in (await senses(case, "RangeScanner"))[1]:
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
    recording, lines = await senses(case, "RangeScanner")
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
    size = (await told(case, "GETGEO", "Robot")).numbers("Dimensions")[:2]
    if len(size) == 2:  # large robots get room
        right = math.copysign(max(abs(right), 0.5 * size[1] + 0.5 * max(size) + 0.2), right)
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
    for line in (await senses(case, "RangeScanner"))[1]:
        if len(line.numbers("Range")) <= 181:
            case.expect(len(line.raw) < 2000, f"{len(line.raw)} bytes: {line}")
