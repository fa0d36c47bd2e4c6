"""Numbers of inertial sensors against the true motion (robots reference 2.5)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import wraps
from itertools import pairwise
from statistics import fmean

from usarsim_conformance.case import Case
from usarsim_conformance.control import Pose, turned
from usarsim_conformance.excursions import (
    Excursion,
    Track,
    bearer,
    drive_about,
    equipment,
    fly_about,
)
from usarsim_conformance.ranging import CHANCE, spread_bounds
from usarsim_conformance.registry import (
    UNREAL,
    Failed,
    Function,
    Inconclusive,
    NotApplicable,
    Severity,
    checks_of,
)
from usarsim_conformance.walls import turned_by

measured = checks_of("control", reference="robots reference", dialects=UNREAL)

_SIGMA = 0.05
"""Of INS, as a part of each step (robots reference 2.5: a constant of the class)."""
_AXES = ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")


async def _moved(case: Case, type: str) -> Excursion:
    """The excursion of a robot that carries a sensor: on wheels, or else in the air."""
    class_name = await bearer(case, type, "GroundTruth")
    try:
        return await drive_about(case, class_name)
    except NotApplicable:
        return await fly_about(case, class_name)


async def _flown(case: Case, type: str) -> Excursion:
    """Likewise, but in the air if an aircraft carries one."""
    for class_name in ("KitFlyer", "AirRobot", await bearer(case, type, "GroundTruth")):
        if type not in (await equipment(case, class_name)).conf:
            continue
        try:
            return await fly_about(case, class_name)
        except NotApplicable:
            continue
    return await _moved(case, type)


LATE = 0.15
"""s that GroundTruth may seem to be of another time than others tell."""


async def _lateness(case: Case) -> tuple[float, str]:
    """By how many s GroundTruth is late, and which sensors tell that; NaN if none do."""
    for type in ("IMU", "MagneticCompass", "INS"):
        try:
            late, others = (await _flown(case, type)).track.lateness
        except NotApplicable:
            continue
        if others:
            return late, others
    return math.nan, ""


def by_truth(function: Function) -> Function:
    """Make a check one that does not blame a sensor for what GroundTruth, with which it is
    compared, tells late: it cannot be judged then."""

    @wraps(function)
    async def judge(case: Case) -> None:
        try:
            await function(case)
        except Failed as error:
            try:
                late, _ = await _lateness(case)
            except Inconclusive:
                raise error from None
            case.need(
                not abs(late) >= LATE,
                f"GroundTruth is {late:.2f} s late, not 0, which control.values.truth-time is "
                f"about; against it {error}",
            )
            raise

    return judge


@measured("values.truth-time", "GroundTruth is of its time", "2.5; protocol reference 4.6")
async def truth_time(case: Case) -> None:
    """GroundTruth turns and climbs at the moment at which compass, altimeter and other sensors say
    so, within 0.15 s. Not applicable unless two of them agree about that moment."""
    late, others = await _lateness(case)
    if math.isnan(late):
        case.skip("no two sensors agree about when the robot turned and climbed")
    case.expect(
        abs(late) < LATE,
        f"GroundTruth is {late:.2f} s late, not 0: Location and Orientation change so much later "
        f"than {others}",
    )


def _grain(values: Sequence[float]) -> float:
    """The unit of the last digit printed: 0.01, or finer if the values are."""
    fine = any(abs(value * 100.0 - round(value * 100.0)) > 1e-6 for value in values)
    return 0.001 if fine else 0.01


@dataclass(frozen=True)
class _Errors:
    """Errors of an estimate at its reports, and how far the robot came between them."""

    errors: Sequence[tuple[float, ...]]  # one triple per report
    steps: Sequence[tuple[float, ...]]  # one for each of the gaps; by axis
    grain: float  # variance that rounding adds to a difference of two errors

    def ratio(self, axes: Sequence[int]) -> tuple[float, int]:
        """Mean square of the errors' growth against what sigma predicts, and of how many."""
        squares: list[float] = []
        for axis in axes:
            begin, due = 0, 0.0
            for gap, step in enumerate(self.steps):
                due += (_SIGMA * step[axis]) ** 2
                if due > 8.0 * self.grain:
                    grown = self.errors[gap + 1][axis] - self.errors[begin][axis]
                    squares.append(grown**2 / (due + self.grain))
                    begin, due = gap + 1, 0.0
        return (fmean(squares) if squares else math.nan), len(squares)


def _location_errors(track: Track) -> _Errors:
    told = [(line.numbers("Location"), track.truth(time)) for time, line in track.of("INS")]
    errors = [
        tuple(a - b for a, b in zip(location, true.location, strict=True))
        for location, true in told
    ]
    steps = [(math.dist(a.location, b.location),) * 3 for (_, a), (_, b) in pairwise(told)]
    grains = [_grain([v for location, _ in told for v in location])]
    grains.append(_grain([v for _, true in track.true_poses for v in true.location]))
    return _Errors(errors, steps, sum(2.0 * grain**2 / 12.0 for grain in grains))


def _turns(track: Track, type: str) -> list[tuple[tuple[float, ...], Pose]]:
    return [(line.numbers("Orientation"), track.truth(time)) for time, line in track.of(type)]


def _orientation_errors(track: Track, type: str) -> _Errors:
    told = _turns(track, type)
    errors: list[tuple[float, ...]] = [(0.0, 0.0, 0.0)]
    steps: list[tuple[float, ...]] = []
    for (one, true_one), (two, true_two) in pairwise(told):
        true = [
            turned(a, b) for a, b in zip(true_one.orientation, true_two.orientation, strict=True)
        ]
        grown = [turned(b, turned(a, c)) for a, b, c in zip(one, true, two, strict=True)]
        errors.append(tuple(a + b for a, b in zip(errors[-1], grown, strict=True)))
        steps.append(tuple(map(abs, true)))
    grains = [_grain([v for angles, _ in told for v in angles])]
    grains.append(_grain([v for _, true in track.true_poses for v in true.orientation]))
    return _Errors(errors, steps, sum(2.0 * grain**2 / 12.0 for grain in grains))


def _judge_noise(case: Case, found: _Errors, axes: Sequence[int], what: str) -> None:
    ratio, samples = found.ratio(axes)
    if samples < 15:
        case.skip(f"the robot is too slow to tell the noise of {what} from rounding")
    low, high = spread_bounds(samples)
    case.expect(
        low < ratio < high,
        f"noise of {what} is {math.sqrt(ratio) * _SIGMA:.3f} of each step, not {_SIGMA:g}, over "
        f"{samples} stretches",
    )


@measured("values.ins-location", "INS follows the robot", "2.5; protocol reference 4.6")
@by_truth
async def ins_location(case: Case) -> None:
    """Location of INS changes as that of GroundTruth, on every axis, but for its drift: within
    five times sigma times the root of way times step."""
    tracks = [(await _moved(case, "INS")).track]
    if tracks[0].of("Odometry"):
        tracks.append((await _flown(case, "INS")).track)
    for found in map(_location_errors, tracks):
        case.need(
            len(found.steps) > 10,
            f"only {len(found.steps)} INS lines with steps between, more than 10 are needed",
        )
        due = sum((_SIGMA * step[0]) ** 2 for step in found.steps)
        slack = CHANCE * math.sqrt(due) + 0.04
        for axis in range(3):
            worst = max((error[axis] - found.errors[0][axis] for error in found.errors), key=abs)
            # The first reports are of the sensor's own place: then it follows the reference point.
            first = [error[axis] for error in found.errors[:6]]
            worst -= fmean(first) - found.errors[0][axis]
            case.expect(
                abs(worst) < slack,
                f"{_AXES[axis]} of Location of INS goes {worst:.2f} m astray, not less than "
                f"{slack:.2f} m",
            )


@measured("values.ins-noise", "INS is as inexact as it should be", "2.5", Severity.SHOULD)
@by_truth
async def ins_noise(case: Case) -> None:
    """The error of Location grows by a normal variate with 0.05 of every step: neither nothing nor
    much more."""
    track = (await _moved(case, "INS")).track
    _judge_noise(case, _location_errors(track), (0, 1, 2), "Location")


@measured("values.ins-orientation", "INS turns with the robot", "2.5; protocol reference 4.6")
@by_truth
async def ins_orientation(case: Case) -> None:
    """Orientation of INS changes as that of GroundTruth, about every axis, but for its drift."""
    await _orientation_follows(case, "INS")


@measured("values.inu-orientation", "INU turns with the robot", "2.5; protocol reference 4.6")
@by_truth
async def inu_orientation(case: Case) -> None:
    """Orientation of INU changes as that of GroundTruth, about every axis, but for its drift."""
    await _orientation_follows(case, "INU")


async def _orientation_follows(case: Case, type: str) -> None:
    tracks = [(await _moved(case, type)).track]
    if type == "INS" and tracks[0].of("Odometry"):
        tracks.append((await _flown(case, type)).track)
    for track in tracks:
        found = _orientation_errors(track, type)
        case.need(
            len(found.steps) > 10,
            f"only {len(found.steps)} {type} lines with steps between, more than 10 are needed",
        )
        for axis in range(3):
            due = sum((_SIGMA * step[axis]) ** 2 for step in found.steps)
            slack = CHANCE * math.sqrt(due) + 0.05
            worst = max((error[axis] for error in found.errors), key=abs)
            case.expect(
                abs(worst) < slack,
                f"{_ANGLES[axis]} of Orientation of {type} goes {worst:.2f} rad astray, not less "
                f"than {slack:.2f} rad",
            )


@measured(
    "values.ins-orientation-noise", "INS turns as inexactly as it should", "2.5", Severity.SHOULD
)
@by_truth
async def ins_orientation_noise(case: Case) -> None:
    """The error of yaw in Orientation grows by a normal variate with 0.05 of every turn."""
    track = (await _moved(case, "INS")).track
    _judge_noise(case, _orientation_errors(track, "INS"), (2,), "Orientation")


@measured("values.compass", "A compass turns clockwise", "2.5; protocol reference 4.6")
@by_truth
async def compass(case: Case) -> None:
    """MagneticAngle grows with yaw, clockwise, rad for rad; without another north it is yaw."""
    track = (await _flown(case, "MagneticCompass")).track
    told = [
        (line.number("MagneticAngle"), track.truth(time).yaw)
        for time, line in track.of("MagneticCompass")
    ]
    case.need(len(told) > 10, f"only {len(told)} MagneticCompass lines, more than 10 are needed")
    away = [turned(yaw, angle) for angle, yaw in told]
    for value, (angle, yaw) in zip(away, told, strict=True):
        case.expect(
            abs(turned(away[0], value)) < 0.05,
            f"MagneticAngle is {angle:.3f} at yaw {yaw:.3f}, not "
            f"{math.remainder(yaw + away[0], math.tau):.3f}, for it was {told[0][0]:.3f} at "
            f"{told[0][1]:.3f}",
        )
    case.expect(
        all(-math.pi - 1e-3 <= angle <= math.pi + 1e-3 for angle, _ in told),
        f"MagneticAngle is up to {max(abs(angle) for angle, _ in told):.3f}, not at most pi",
    )


@measured("values.altitude", "An altimeter tells metres", "2.5; protocol reference 6, no. 123")
@by_truth
async def altitude(case: Case) -> None:
    """relativeAltitude is the height above the first report, metre for metre, and absoluteAltitude
    111 m more."""
    track = (await _flown(case, "AltitudeSensor")).track
    told = [
        (line.number("relativeAltitude"), line.number("absoluteAltitude"), track.truth(time))
        for time, line in track.of("AltitudeSensor")
    ]
    case.need(len(told) > 10, f"only {len(told)} AltitudeSensor lines, more than 10 are needed")
    for relative, absolute, true in told:
        rise = told[0][2].location[2] - true.location[2]
        case.expect(
            abs(relative - told[0][0] - rise) < 0.06,
            f"relativeAltitude rises by {relative - told[0][0]:.3f} m, not by {rise:.3f} m, as "
            "the robot",
        )
        case.expect(
            abs(absolute - relative - 111.0) < 0.01,
            f"absoluteAltitude is {absolute:.3f} m, not {relative + 111.0:.3f} m, 111 m above "
            "relativeAltitude",
        )


def _judge_acceleration(
    case: Case, flight: Excursion, type: str, key: str, gravity: float, upward: bool
) -> None:
    """Compare what a sensor adds up to in 1.6 s with the change of true velocity meanwhile, by axis
    of the world; longer, and what is rounded off would add up, too."""
    track = flight.track
    told = track.of(type)
    case.need(len(told) > 20, f"only {len(told)} {type} lines, more than 20 are needed")
    speed = [0.0, 0.0, 0.0]
    downward: list[float] = []
    course: list[tuple[float, list[float], list[float]]] = []
    for (before, _), (time, line) in pairwise(told):
        x, y, z = line.numbers(key)
        vector = turned_by(track.truth(time).orientation, (x, y, -z if upward else z))
        downward.append(vector[2])
        change = (vector[0], vector[1], vector[2] - gravity)
        speed = [v + a * (time - before) for v, a in zip(speed, change, strict=True)]
        one, two = (track.truth(time + shift).location for shift in (-0.1, 0.1))
        course.append((time, speed, [(b - a) / 0.2 for a, b in zip(one, two, strict=True)]))
    ahead = math.ceil(1.6 / (course[1][0] - course[0][0]))
    likeness: list[tuple[float, float]] = []
    for axis in range(3):
        pairs = [
            (two[1][axis] - one[1][axis], two[2][axis] - one[2][axis])
            for one, two in zip(course[1:], course[1 + ahead : -1], strict=False)
        ]
        both = sum(found * true for found, true in pairs)
        true, found = (sum(pair[n] ** 2 for pair in pairs) for n in (1, 0))
        case.need(true > 0.02 * len(pairs), f"the robot hardly moved along {_AXES[axis]}")
        likeness.append((both / true, both / math.sqrt(max(true * found, 1e-12))))
    passed = course[-1][0] - course[0][0]
    pull = fmean(downward) - (course[-1][2][2] - course[0][2][2]) / passed
    # Wrong along one axis of a tilted robot is wrong along all; that of the fault is the worst.
    worst = max(range(3), key=lambda axis: abs(likeness[axis][0] - 1.0))
    for axis in (worst, 0, 1, 2):
        slope, alike = likeness[axis]
        if 0.85 < slope < 1.15 and alike > 0.9:
            continue
        case.expect(
            abs(pull - gravity) < 0.5,
            f"gravity in {key} is {pull:.2f} m/s^2 downward in the mean of {passed:.0f} s, not "
            f"{gravity:g}",
        )
        case.fail(
            f"{_AXES[axis]} of {key} adds up to {slope:.2f} times the true change of speed, not "
            f"1.00 times (likeness {alike:.2f} of 1)"
        )


@measured("values.accel", "Accel is the change of velocity", "2.5; protocol reference 4.6")
@by_truth
async def accel(case: Case) -> None:
    """Acceleration of Accel, turned from the sensor's frame into the world's, adds up to the
    robot's velocity on every axis, z down, without gravity."""
    _judge_acceleration(case, await _flown(case, "Accel"), "Accel", "Acceleration", 0.0, False)


@measured("values.accelerometer", "An accelerometer adds gravity", "2.5; protocol reference 4.6")
@by_truth
async def accelerometer(case: Case) -> None:
    """ProperAcceleration is the change of velocity with 9.81 m/s^2 downward added, also when the
    robot is tilted."""
    flight = await _flown(case, "AcceleroMeter")
    _judge_acceleration(case, flight, "AcceleroMeter", "ProperAcceleration", 9.81, False)


@measured(
    "values.imu-acceleration", "IMU tells the change of velocity", "2.5; protocol reference 4.6"
)
@by_truth
async def imu_acceleration(case: Case) -> None:
    """XYZAcceleration of IMU, with z up as an exception, adds up to the robot's velocity."""
    _judge_acceleration(case, await _flown(case, "IMU"), "IMU", "XYZAcceleration", 0.0, True)


@measured("values.imu-rotation", "IMU tells where the robot turns", "2.5; protocol reference 4.6")
@by_truth
async def imu_rotation(case: Case) -> None:
    """Rotation of IMU is Orientation of GroundTruth, AngularVel the change of its angles per s, and
    AngularAccel that of AngularVel, each about its own axis."""
    track = (await _flown(case, "IMU")).track
    told = [(time, line) for time, line in track.of("IMU")]
    case.need(len(told) > 20, f"only {len(told)} IMU lines, more than 20 are needed")
    for time, line in told:
        true = track.truth(time).orientation
        for axis, angle in enumerate(line.numbers("Rotation")):
            case.expect(
                abs(turned(true[axis], angle)) < 0.04,
                f"{_ANGLES[axis]} of Rotation is {angle:.3f}, not {true[axis]:.3f}",
            )
    for key, source in (("AngularVel", "Rotation"), ("AngularAccel", "AngularVel")):
        for (before, one), (time, two) in pairwise(told):
            if not 0.01 < time - before < 0.5:
                continue
            for axis in range(3):
                a, b = one.numbers(source)[axis], two.numbers(source)[axis]
                change = (turned(a, b) if source == "Rotation" else b - a) / (time - before)
                found = two.numbers(key)[axis]
                case.expect(
                    abs(found - change) < 0.05 + 0.05 * abs(change),
                    f"{_ANGLES[axis]} of {key} is {found:.3f}, not {change:.3f}, the change of "
                    f"{source} per s",
                )
