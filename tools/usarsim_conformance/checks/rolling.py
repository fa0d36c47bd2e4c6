"""Numbers of wheel sensors against wheels and truth (robots reference 2.4), and intervals and
clocks that are told against those that are kept."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from statistics import fmean, linear_regression, median
from typing import NoReturn

from usarsim_conformance.case import Case
from usarsim_conformance.control import turned
from usarsim_conformance.excursions import (
    HEADING,
    Excursion,
    Stretch,
    Track,
    bearer,
    drive_about,
    equipment,
    spawn_far,
)
from usarsim_conformance.recordings import watched
from usarsim_conformance.registry import ONCE, UNREAL, checks_of, unreal

measured = checks_of("control", reference="robots reference", dialects=UNREAL)

_WHEELS = 0.05
"""Part by which a rate may differ from that of the wheels: they take a moment, times are rough."""
_GROUND = 0.12
"""Part by which rolling and way over ground may differ: tracks slip."""
_NAMES = ("forward", "back", "clockwise", "anticlockwise", "right", "left")


def rate(values: Sequence[tuple[float, float]]) -> float:
    """Slope of (time, value) pairs, per s; NaN if there are too few."""
    if len(values) < 4 or values[-1][0] <= values[0][0]:
        return math.nan
    return linear_regression([t for t, _ in values], [v for _, v in values]).slope


def unwrapped(values: Sequence[tuple[float, float]], turn: float) -> list[tuple[float, float]]:
    """Values that jump by a turn now and then, without the jumps."""
    found = list(values[:1])
    for (_, before), (time, after) in pairwise(values):
        found.append((time, found[-1][1] + math.remainder(after - before, turn)))
    return found


def stepped_rate(values: Sequence[tuple[float, float]]) -> float:
    """Median growth from one (time, value) pair to the next, per s: no jump matters; NaN if there
    are too few."""
    steps = [(b - a) / (after - before) for (before, a), (after, b) in pairwise(values)
             if after > before]  # fmt: skip
    return median(steps) if steps else math.nan


async def _drive(case: Case, type: str) -> Excursion:
    return await drive_about(case, await bearer(case, type, "GroundTruth"))


def _poses(stretch: Stretch) -> list[tuple[float, tuple[float, ...]]]:
    return [(time, line.numbers("Pose")) for time, line in stretch.steady.of("Odometry")]


@measured("values.odometry-distance", "Odometry goes as far as the wheels", "2.4")
async def odometry_distance(case: Case) -> None:
    """Along its own heading the Pose of Odometry grows at the mean speed of the wheels, within 5
    percent, and straight ahead as far as the robot really comes, within 12 percent."""
    drive = await _drive(case, "Odometry")
    for name in _NAMES:
        for stretch in drive.of(name):
            poses = _poses(stretch)
            case.need(
                len(poses) > 5,
                f"only {len(poses)} Odometry lines driving {name}, more than 5 are needed",
            )
            way = [(poses[0][0], 0.0)]
            for (_, one), (time, two) in pairwise(poses):
                middle = (one[2] + two[2]) / 2.0
                step = math.cos(middle) * (two[0] - one[0]) + math.sin(middle) * (two[1] - one[1])
                way.append((time, way[-1][1] + step))
            found, wanted = rate(way), drive.radius * sum(stretch.command) / 2.0
            slack = _WHEELS * max(map(abs, stretch.command)) * drive.radius + 0.003
            case.expect(
                abs(found - wanted) < slack,
                f"Pose x,y goes {found:.3f} m/s driving {name}, not {wanted:.3f} m/s, as the "
                "wheels",
            )
    for name in ("forward", "back"):
        for stretch in drive.of(name):
            poses = _poses(stretch)
            ends = [stretch.track.truth(time).location for time, _ in (poses[0], poses[-1])]
            rolled, true = math.dist(poses[0][1][:2], poses[-1][1][:2]), math.dist(*ends)
            case.expect(
                abs(rolled - true) < _GROUND * true + 0.03,
                f"Pose x,y went {rolled:.3f} m driving {name}, not {true:.3f} m, as the robot",
            )


@measured("values.odometry-heading", "Odometry turns as the wheels say", "2.4")
async def odometry_heading(case: Case) -> None:
    """Theta of Odometry changes at r (L - R) / WheelSeparation, clockwise positive, within 5
    percent, on curves as on the spot; the robot turns the same way."""
    drive = await _drive(case, "Odometry")
    for name in _NAMES:
        for stretch in drive.of(name):
            left, right = stretch.command
            poses = _poses(stretch)
            case.need(
                len(poses) > 5,
                f"only {len(poses)} Odometry lines driving {name}, more than 5 are needed",
            )
            found = rate(unwrapped([(time, pose[2]) for time, pose in poses], math.tau))
            wanted = drive.radius * (left - right) / drive.separation
            fast = 2.0 * drive.radius * max(abs(left), abs(right)) / drive.separation
            case.expect(
                abs(found - wanted) < _WHEELS * fast + 0.003,
                f"theta turns by {found:.3f} rad/s driving {name}, not by {wanted:.3f} rad/s, as "
                "the wheels",
            )
            if abs(wanted) > 0.1:
                true = [stretch.track.truth(time).yaw for time, _ in poses]
                angle = sum(turned(a, b) for a, b in pairwise(true))
                case.expect(
                    angle * found > 0.0,
                    f"theta turns by {found:.3f} rad/s, not the way of yaw, which turns by "
                    f"{angle:.3f} rad in all",
                )


@measured(
    "values.odometry-path", "Odometry goes where it heads", "2.4; protocol reference 6, no. 108"
)
async def odometry_path(case: Case) -> None:
    """x and y of Odometry follow from the speed of the wheels along theta: x grows with the cosine,
    y, which is to the right, with the sine."""
    drive = await _drive(case, "Odometry")
    for name in _NAMES:
        for stretch in drive.of(name):
            poses = _poses(stretch)
            case.need(
                len(poses) > 5,
                f"only {len(poses)} Odometry lines driving {name}, more than 5 are needed",
            )
            speed = drive.radius * sum(stretch.command) / 2.0
            due = [0.0, 0.0]
            for (before, one), (time, two) in pairwise(poses):
                middle = (one[2] + two[2]) / 2.0
                for axis, part in enumerate((math.cos(middle), math.sin(middle))):
                    due[axis] += speed * (time - before) * part
            gone = abs(speed) * (poses[-1][0] - poses[0][0])
            for axis, what in ((1, "y"), (0, "x")):
                found = poses[-1][1][axis] - poses[0][1][axis]
                case.expect(
                    abs(found - due[axis]) < 0.05 * gone + 0.05,
                    f"{what} of Pose changes by {found:.3f} m driving {name}, not by "
                    f"{due[axis]:.3f} m, as by theta and the wheels",
                )


_ROUNDS = 3.0 * math.tau
"""rad; whoever wraps theta does so before."""


@measured(
    "values.odometry-turns", "Theta of Odometry has no jumps", "2.4; protocol reference 2.5 and 4.6"
)
async def odometry_turns(case: Case) -> None:
    """Odometry is 0,0,0 at first where a robot is put with a yaw of 1 rad, and theta has no jumps
    while it turns round three times: it is not wrapped, and is no heading of the world."""
    drive = await _drive(case, "Odometry")
    poses = [(time, line.numbers("Pose")) for time, line in drive.track.of("Odometry")]
    case.need(len(poses) > 5, f"only {len(poses)} Odometry lines, more than 5 are needed")
    for axis, value in zip(("x", "y", "theta"), poses[0][1], strict=True):
        case.expect(
            abs(value) < 0.03,
            f"{axis} of Pose is {value:.3f} where the robot was put, with a yaw of {HEADING:g} "
            "rad, not 0",
        )
    for (_, before), (time, after) in pairwise(poses):
        case.expect(
            abs(after[2] - before[2]) < math.pi / 2.0,
            f"theta of Pose is {after[2]:.3f} at {time:.2f} s, not near {before[2]:.3f}, as in "
            "the report before: it jumps",
        )
    angles = [pose[2] for _, pose in poses]
    if max(angles) - min(angles) < _ROUNDS:
        case.skip(f"the robot turned by {max(angles) - min(angles):.1f} rad only")


_SCATTER = 0.01
_SPAN = 1.0
"""s over which ticks are counted: single ticks do not matter then."""
_FEWEST = 30.0
"""Ticks per s below which rounding hides what scatters."""


@measured("values.encoder-scatter", "Ticks come evenly", "2.4")
async def encoder_scatter(case: Case) -> None:
    """At constant speed the ticks of a second scatter by no more than 1 percent in the root mean
    square, but for what is cut off: noise is of the turn since the last report, not of all turns
    since the start."""
    drive = await _drive(case, "Encoder")
    configured = drive.equipment.configured("Encoder")
    judged = 0
    for name in ("forward", "back", "clockwise", "anticlockwise"):
        for stretch in drive.of(name):
            for item, told in stretch.steady.items("Encoder", "Tick").items():
                values = [(time, float(tick)) for time, tick in told]
                if case.dialect == "udk" and "Resolution" in configured.get(item, {}):
                    turn = round(math.tau / float(configured[item]["Resolution"]))
                    values = unwrapped(values, turn)
                rates = [
                    (b - a) / (after - before)
                    for before, a in values
                    for after, b in values
                    if _SPAN - 1e-3 <= after - before < _SPAN + 0.11
                ]
                mean = fmean(rates) if rates else 0.0
                if len(rates) < 5 or abs(mean) < _FEWEST:
                    continue
                judged += 1
                found = math.sqrt(fmean((one / mean - 1.0) ** 2 for one in rates))
                case.expect(
                    found < _SCATTER + 0.5 / abs(mean) / _SPAN,
                    f"Tick of {item} grows by {mean:.0f}/s driving {name}, and scatters by "
                    f"{100.0 * found:.1f} percent about that, not by up to {100.0 * _SCATTER:g}",
                )
    if not judged:
        case.skip("the wheels are too slow to tell how ticks scatter")


def _side(name: str, carrier: str, across: float) -> int:
    """-1 for a wheel on the left, 1 on the right, 0 if nothing tells."""
    for text in (name.lower(), carrier.lower()):
        for word, side in (("left", -1), ("right", 1)):
            if word in text:
                return side
    return 0 if abs(across) < 0.01 else int(math.copysign(1, across))


def _by_tachometer(stretch: Stretch, name: str) -> list[float]:
    """What a Tachometer says of the wheel of an encoder Wk: both count in the order of parts."""
    for texts in stretch.steady.items("Tachometer", "Vel").values():
        speeds = [[float(one) for one in text.split(",")] for _, text in texts]
        number = name[1:]
        if name[:1] == "W" and number.isdigit() and int(number) < len(speeds[0]):
            return [fmean(one[int(number)] for one in speeds)]
    return []


@measured(
    "values.encoder-ticks", "Ticks are turns of the wheel", "2.4; protocol reference 6, no. 110"
)
async def encoder_ticks(case: Case) -> None:
    """Ticks times Resolution of CONF turn as fast as the wheel of their side, within 5 percent, in
    curves as straight ahead; times WheelRadius they go as far as the robot, within 12 percent."""
    drive = await _drive(case, "Encoder")
    worn = drive.equipment
    mounts, resolutions = worn.mounts("Encoder"), worn.configured("Encoder")
    for name in _NAMES:
        for stretch in drive.of(name):
            for item, ticks in stretch.steady.items("Encoder", "Tick").items():
                if item not in mounts or "Resolution" not in resolutions.get(item, {}):
                    case.skip(f"neither CONF nor GEO tells Resolution and place of {item}")
                step = float(resolutions[item]["Resolution"])
                mount = mounts[item]
                joint = case.dialect == "udk" and mount.carrier != worn.class_name
                if joint or "_link" in mount.carrier.lower():
                    continue  # it counts turns of a joint
                side = _side(item, mount.carrier, mount.location[1])
                counted = values = [(time, float(tick)) for time, tick in ticks]
                turn = round(math.tau / step)
                if case.dialect == "udk":  # ticks begin anew with every turn there
                    values = unwrapped(values, turn)
                found = rate(values) * step
                sides = [stretch.command[0 if side < 0 else 1]] if side else stretch.command
                sides = _by_tachometer(stretch, item) or sides
                slack = _WHEELS * max(map(abs, stretch.command)) + 0.06
                if min(abs(found - wanted) for wanted in sides) >= slack:
                    # Where the count begins anew elsewhere than after a turn, its steps still tell.
                    _fail_ticks(case, item, name, stepped_rate(counted), step, sides, slack, turn)
                if name == "forward":
                    ends = [
                        stretch.track.truth(time).location for time in (values[0][0], values[-1][0])
                    ]
                    true = math.dist(*ends)
                    rolled = (values[-1][1] - values[0][1]) * step * drive.radius
                    case.expect(
                        abs(rolled - true) < _GROUND * true + 0.04,
                        f"Tick of {item} goes {rolled:.3f} m forward, not {true:.3f} m, as the "
                        "robot",
                    )


def _fail_ticks(
    case: Case,
    item: str,
    name: str,
    counts: float,
    step: float,
    sides: Sequence[float],
    slack: float,
    turn: int,
) -> NoReturn:
    """Say what is wrong with ticks that grow by some counts per s, or begin anew elsewhere than
    after a turn of so many ticks."""
    wanted = min(sides, key=lambda side: abs(counts * step - side))
    grows = f"Tick of {item} grows by {counts:.1f}/s driving {name}"
    if abs(counts * step - wanted) < slack:
        case.fail(
            f"{grows}, as it should, but does not begin anew after about {turn} ticks, a turn"
        )
    right = " or ".join(f"{side / step:.1f}/s" for side in sides)
    times = f": {counts * step / wanted:.2f} times the right value" if abs(wanted) > slack else ""
    case.fail(f"{grows}, not by {right}, as the wheel by Resolution of CONF, {step:g} rad{times}")


@measured("values.tachometer", "Vel and Pos of a Tachometer", "2.4")
async def tachometer(case: Case) -> None:
    """Vel of every wheel is the speed it was told, within 5 percent, that of one side for each, and
    half of the wheels have that of the left when the robot turns; Pos changes at Vel."""
    drive = await _drive(case, "Tachometer")
    for name in _NAMES:
        for stretch in drive.of(name):
            told = stretch.steady.items("Tachometer", "Vel")
            for item, vels in told.items():
                poses = stretch.steady.items("Tachometer", "Pos")[item]
                speeds = [tuple(map(float, text.split(","))) for _, text in vels]
                places = [(time, tuple(map(float, text.split(",")))) for time, text in poses]
                slack = _WHEELS * max(map(abs, stretch.command)) + 0.01
                sides = []
                for wheel in range(len(speeds[0])):
                    found = sum(one[wheel] for one in speeds) / len(speeds)
                    misses = [abs(found - wanted) for wanted in stretch.command]
                    sides.append(misses.index(min(misses)))
                    case.expect(
                        min(misses) < slack,
                        f"Vel {wheel + 1} of {item} is {found:.3f} rad/s driving {name}, not "
                        f"{stretch.command[0]:.3f} or {stretch.command[1]:.3f}, as the wheels "
                        "were told",
                    )
                    turning = rate([(time, pos[wheel]) for time, pos in places])
                    case.expect(
                        abs(turning - found) < slack,
                        f"Pos {wheel + 1} of {item} turns by {turning:.3f} rad/s, not by "
                        f"{found:.3f} rad/s, which is Vel",
                    )
                if stretch.command[0] != stretch.command[1]:
                    case.expect(
                        2 * sum(sides) == len(sides), f"Vel of {item} is not half left: {speeds[0]}"
                    )


_TOLD = ("Odometry", "INS", "GPS", "GroundTruth", "Tachometer", "Sonar")
"""Types whose CONF tells a ScanInterval (protocol reference 4.8)."""


@unreal("values.scan-interval", "ScanInterval is kept", "4.8 and 6, no. 122")
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
            len(times) > 2 or interval > 2.0,
            f"ScanInterval of {name} is {interval:g} s, but {len(times)} SEN lines come, not at "
            "least 3",
        )
        if len(times) < 3:
            continue
        found = (times[-1] - times[0]) / (len(times) - 1)
        case.expect(
            abs(found - interval) < 0.12 * interval + 0.005,
            f"reports come every {found:.3f} s, not every {interval:g} s, ScanInterval of {name}",
        )


@measured("values.battery-drain", "A battery loses a second in a second", "2.10")
async def battery_drain(case: Case) -> None:
    """Battery of STA is the time left in s: it falls by one a second, and no more when driving."""
    lines = [line for line in await watched(case) if line.head == "STA"]
    first, last = lines[0], lines[-1]
    if first.get("Battery") in (None, "99999"):
        case.skip("the robot has no battery")
    passed = last.time - first.time
    lost = first.number("Battery") - last.number("Battery")
    case.expect(
        abs(lost - passed) <= 1.05,
        f"Battery falls by {lost:g} in {passed:.1f} s, not by one a second",
    )


@measured("values.mission-time", "MissionTime counts minutes", "2.5", dialects=ONCE)
async def mission_time(case: Case) -> None:
    """Minutes of MissionTime is 0 at first, and 1 a minute of simulated time later."""
    robot = await spawn_far(case, await bearer(case, "MissionTime"))
    track = Track(await robot.run(63.0))
    told = [(time, line.number("Minutes")) for time, line in track.of("MissionTime")]
    case.need(len(told) > 10, f"only {len(told)} MissionTime lines, more than 10 are needed")
    case.expect(told[0][1] == 0, f"Minutes is {told[0][1]:g} at first, not 0")
    turns = [time - robot.first.time for time, minutes in told if minutes >= 1]
    case.expect(turns, f"Minutes is {told[-1][1]:g} after 63 s, not 1")
    case.expect(58.5 < turns[0] < 62.0, f"Minutes is 1 after {turns[0]:.1f} s, not after 60 s")
    case.expect(
        not any(math.isnan(minutes) for _, minutes in told),
        f"Minutes is no number in {sum(math.isnan(minutes) for _, minutes in told)} of "
        f"{len(told)} lines",
    )
