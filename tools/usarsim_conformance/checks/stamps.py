"""Times that reports tell against the moments at which they were taken, by a robot on its way to a
wall."""

from __future__ import annotations

import math
from statistics import median

import numpy as np

from usarsim_conformance.approach import Approach, Way, approach
from usarsim_conformance.case import Case
from usarsim_conformance.excursions import BEARERS, Mount, equipment
from usarsim_conformance.grounds import YAW
from usarsim_conformance.ranging import CHANCE, ray
from usarsim_conformance.registry import UNREAL, NotApplicable, checks_of

measured = checks_of("control", reference="protocol reference", dialects=UNREAL)

_EXACT = 0.005
"""s by which GroundTruth may be of another time than the truth port tells."""
_UNSURE = 0.02
"""s; a larger standard error tells nothing."""
_NEAR, _OFF = 0.02, 0.055
"""m by which ranges of a wall that comes nearer may be off: in the middle of all, and each, since
range, place and time are cut off at two digits."""
_LEVEL = 0.03
"""rad."""
_SLOW = 0.25
"""m/s; slower robots are not told from late ones."""


async def _approach(case: Case, *types: str, level: bool = False) -> Approach:
    """The approach of the robot of most checks, or of another that carries what is wanted; if it
    has to stay level, of none that leans when it flies ahead.

    Raises:
        NotApplicable: if there is none.
    """
    for class_name in (case.robot_class, *BEARERS):
        if not set(types) <= set((await equipment(case, class_name)).conf):
            continue
        try:
            found = await approach(case, class_name)
        except NotApplicable:
            continue
        if not level or found.leaning < _LEVEL:
            return found
    raise NotApplicable(f"no robot with {' and '.join(types)} can be driven straight to a wall")


@measured("values.truth-stamps", "GroundTruth is of the time that it tells", "2.6 and 4.6")
async def truth_stamps(case: Case) -> None:
    """A robot that drives to and fro is by GroundTruth where the truth port lists it at the same
    Time, within 5 ms: the places are fitted over the speed."""
    found = await _approach(case, "GroundTruth")
    late, error, looks = found.lateness()
    if not looks:
        case.skip("the truth port was not named, or does not list the robot")
    case.need(not math.isnan(late), f"{looks} looks at a moving robot tell no time")
    case.need(error < _UNSURE, f"Time is told to {error:.3f} s only by {looks} looks")
    case.expect(
        abs(late) < _EXACT + CHANCE * error,
        f"Time of GroundTruth is off: Location is that of {abs(late):.3f} s "
        f"{'before' if late > 0.0 else 'after'} it, by Location and Time of the truth port, not of "
        f"that moment within {_EXACT:g} s ({looks} looks)",
    )


@measured("values.scan-stamps", "A scan is of the time that it tells", "2.6 and 4.6")
async def scan_stamps(case: Case) -> None:
    """Range of a RangeScanner that comes nearer to a wall, and goes away from it, is the distance
    at the Time of the scan: not that of the scan before, nor the same twice."""
    found = await _approach(case, "RangeScanner", "GroundTruth", level=True)
    if math.isinf(found.wall):
        case.skip("there is no world controller that puts a wall")
    late, error, _ = found.lateness()
    case.need(
        not abs(late) > _UNSURE + CHANCE * error,
        f"GroundTruth is {late:.3f} s late, which control.values.truth-stamps is about",
    )
    judged: list[tuple[float, float]] = []
    for name, mount in found.equipment.on_body("RangeScanner").items():
        for way in found.ways:
            judged += _judge(case, found, way, name, mount)
    case.need(len(judged) > 8, f"only {len(judged)} scans of a wall that comes nearer")
    off = median(math.copysign(1.0, speed) * miss for miss, speed in judged)
    case.expect(
        abs(off) < _NEAR + 0.01,
        f"Range of {len(judged)} scans is {off:.3f} m larger the faster the wall comes nearer, by "
        f"the median, not by 0 within {_NEAR:g} m",
    )


def _judge(
    case: Case, found: Approach, way: Way, name: str, mount: Mount
) -> list[tuple[float, float]]:
    """By how much every scan misses the wall, m, and the speed towards it then, m/s."""
    conf = found.equipment.configured("RangeScanner")[name]
    fov, step = float(conf["Fov"]), float(conf["Resolution"])
    most = float(conf["MaxRange"])
    times, places = found.told(way)
    poses = way.track.true_poses
    judged = []
    for time, line in way.track.of("RangeScanner"):
        if line.get("Name") != name or not times[0] + 0.1 < time < times[-1] - 0.1:
            continue
        before, here, after = np.interp([time - 0.1, time, time + 0.1], times, places)
        speed = float(after - before) / 0.2
        _, pose = min(poses, key=lambda one: abs(one[0] - time))
        heading = pose.yaw - YAW
        ranges = line.numbers("Range")
        rays = [ray(mount, fov / 2.0 - number * step) for number in range(len(ranges))]
        start, way_out = rays[0][0], [one for _, one in rays]
        angles = [math.remainder(heading + math.atan2(y, x), math.tau) for x, y, _ in way_out]
        beam = min(range(len(angles)), key=lambda number: abs(angles[number]))
        ahead = math.cos(heading) * start[0] - math.sin(heading) * start[1]
        wanted = (found.wall - float(here) - ahead) / math.cos(angles[beam])
        level = abs(way_out[beam][2]) < 0.03 and abs(angles[beam]) < 0.1
        if not level or not 0.3 < wanted < 0.95 * most or abs(speed) < _SLOW:
            continue
        miss = ranges[beam] - wanted
        case.expect(
            abs(miss) < _OFF,
            f"Range of {name}, beam {beam + 1}, is {ranges[beam]:.3f} m at {time:.2f} s, not "
            f"{wanted:.3f} m, as far as a wall is that comes nearer at {speed:.2f} m/s: that was so"
            f" {miss / speed:.2f} s before",
        )
        judged.append((miss, speed))
    return judged
