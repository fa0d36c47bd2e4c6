"""Numbers of GPS against places and declared noise (robots reference 2.6)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import fmean, median

from usarsim_conformance.case import Case
from usarsim_conformance.control import Pose
from usarsim_conformance.excursions import Track, bearer, open_floor, spawn_far
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place
from usarsim_conformance.registry import UNREAL, check
from usarsim_conformance.statistics_of import CHANCE, spread_bounds

_NORTH, _EAST = 111_200.0, 71_670.0
"""m in a degree of latitude and of longitude, whatever the latitude."""
_AWAY = 200.0
"""m that the second and the third robot are ahead and to the right of the first."""
_WATCHED = 8.0
"""s of simulated time."""


@dataclass(frozen=True)
class _Station:
    """A robot that stood still.

    Attributes:
        place: where it truly was.
        fixes: north and east in degrees, and satellites, of each report.
    """

    place: Pose
    fixes: list[tuple[float, float, int]]


def _degrees(line: Line, name: str, negative: str) -> float:
    whole, minutes, letter = (line.get(name) or "nan,nan,").split(",")
    size = float(whole) + float(minutes) / 60.0
    return -size if letter == negative else size


async def _stations(case: Case) -> list[_Station]:
    class_name = await bearer(case, "GPS", "GroundTruth")

    async def watch(case: Case) -> list[_Station]:
        base = open_floor(case)
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
            case.need(len(fixes) >= 20, "too few GPS lines with a fix")
            return _Station(track.true_poses[-1][1], fixes)

        return [await stand(0.0, 0.0), await stand(_AWAY, 0.0), await stand(0.0, _AWAY)]

    return await case.shared(f"{class_name} with GPS at three places", watch)


def _deviation(satellites: int) -> float:
    """m on each axis: a third of the line through 2.5 m with 4 and 0.75 m with 12."""
    return max(2.5 + (0.75 - 2.5) / 8.0 * (satellites - 4), 0.0) / 3.0


@check(
    "control.values.gps-scale",
    "GPS tells metres north and east",
    source="robots reference 2.6; protocol reference 6, no. 111",
    dialects=UNREAL,
)
async def gps_scale(case: Case) -> None:
    """Latitude grows by a degree in 111,200 m along x, Longitude by one in 71,670 m along y, each
    with nothing of the other; mean of many reports, within what the noise allows."""
    first, *others = await _stations(case)
    for other in others:
        sigma = max(_deviation(min(n for _, _, n in one.fixes)) for one in (first, other))
        slack = CHANCE * sigma * math.sqrt(2.0 / min(len(first.fixes), len(other.fixes))) + 0.3
        for axis, name, scale in ((0, "Latitude", _NORTH), (1, "Longitude", _EAST)):
            means = [fmean(fix[axis] for fix in one.fixes) for one in (first, other)]
            found = (means[1] - means[0]) * scale
            wanted = other.place.location[axis] - first.place.location[axis]
            case.expect(
                abs(found - wanted) < slack,
                f"{name} moved by {found:.2f} m from one robot to another, in truth {wanted:.2f} m",
            )


@check(
    "control.values.gps-noise",
    "GPS is as inexact as its satellites",
    source="robots reference 2.6",
    dialects=UNREAL,
)
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
        case.expect(
            low < ratio < high,
            f"{name} scatters {math.sqrt(ratio):.2f} times as much as with {satellites:g} "
            f"satellites, over {len(squares)} reports",
        )


@check(
    "control.values.gps-satellites",
    "Satellites over open floor",
    source="robots reference 2.6",
    dialects=UNREAL,
)
async def gps_satellites(case: Case) -> None:
    """On open floor Satellites is between 4 and 12, the same at places not far from each other."""
    counts = [fix[2] for one in await _stations(case) for fix in one.fixes]
    case.expect(min(counts) >= 4, f"Satellites is {min(counts)} with a fix")
    case.expect(max(counts) <= 12, f"Satellites is {max(counts)}")
    case.expect(max(counts) - min(counts) <= 1, f"Satellites goes {min(counts)} to {max(counts)}")
