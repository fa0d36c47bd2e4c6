"""Intervals and clocks that are told, against those that are kept."""

from __future__ import annotations

import math

from usarsim_conformance.case import Case
from usarsim_conformance.excursions import Track, bearer, equipment, spawn_far
from usarsim_conformance.recordings import watched
from usarsim_conformance.registry import ONCE, UNREAL, check

_TOLD = ("Odometry", "INS", "GPS", "GroundTruth", "Tachometer", "Sonar")
"""Types whose CONF tells a ScanInterval (protocol reference 4.8)."""


@check(
    "control.values.scan-interval",
    "ScanInterval is kept",
    source="protocol reference 4.8 and 6, no. 122",
    dialects=UNREAL,
)
async def scan_interval(case: Case) -> None:
    """ScanInterval of CONF is the time between two reports in s, within 12 percent."""
    worn = await equipment(case, case.robot_class)
    told = {
        (type, name): float(item["ScanInterval"])
        for type in _TOLD
        for name, item in worn.configured(type).items()
        if "ScanInterval" in item
    }
    if not told:
        case.skip("no CONF tells a ScanInterval")
    track = Track(await watched(case))
    for (type, name), interval in told.items():
        times = [
            time
            for time, line in track.of(type)
            if line.head == "SEN" and any(item.get("Name") == name for item in line.items())
        ]
        if interval == 0.0:
            continue
        case.expect(
            len(times) > 2 or interval > 2.0, f"ScanInterval of {name} is {interval:g}, but no SEN"
        )
        if len(times) < 3:
            continue
        found = (times[-1] - times[0]) / (len(times) - 1)
        case.expect(
            abs(found - interval) < 0.12 * interval + 0.005,
            f"ScanInterval of {name} is {interval:g} s, its reports come every {found:.3f} s",
        )


@check(
    "control.values.battery-drain",
    "A battery loses a second in a second",
    source="robots reference 2.10",
    dialects=UNREAL,
)
async def battery_drain(case: Case) -> None:
    """Battery of STA is the time left in s: it falls by one a second, and no more when driving."""
    lines = [line for line in await watched(case) if line.head == "STA"]
    first, last = lines[0], lines[-1]
    if first.get("Battery") in (None, "99999"):
        case.skip("the robot has no battery")
    passed = last.time - first.time
    lost = first.number("Battery") - last.number("Battery")
    case.expect(abs(lost - passed) <= 1.05, f"Battery fell by {lost:g} in {passed:.1f} s")


@check(
    "control.values.mission-time",
    "MissionTime counts minutes",
    source="robots reference 2.5",
    dialects=ONCE,
)
async def mission_time(case: Case) -> None:
    """Minutes of MissionTime is 0 at first, and 1 a minute of simulated time later."""
    robot = await spawn_far(case, await bearer(case, "MissionTime"))
    track = Track(await robot.run(63.0))
    told = [(time, line.number("Minutes")) for time, line in track.of("MissionTime")]
    case.need(len(told) > 10, "too few MissionTime lines")
    case.expect(told[0][1] == 0, f"Minutes is {told[0][1]:g} after a second")
    turns = [time - robot.first.time for time, minutes in told if minutes >= 1]
    case.expect(turns, "Minutes is still 0 after a minute")
    case.expect(58.5 < turns[0] < 62.0, f"Minutes is 1 after {turns[0]:.1f} s")
    case.expect(not any(math.isnan(minutes) for _, minutes in told), "Minutes is no number")
