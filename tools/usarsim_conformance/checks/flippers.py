"""Flippers, and wheels that are driven one by one (protocol reference 3.4.3, 3.5)."""

from __future__ import annotations

import math

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.registry import Severity, ut2004
from usarsim_conformance.trips import Trip, near, of_classes, on_open_floor, ride

CRAWLERS = ("Kenaf", "TeleMax")
_FLIPPERS = ("FRFlipper", "FLFlipper", "RRFlipper", "RLFlipper")
_LOW = 0.7
"""rad that a flipper is lowered by: it lifts its corner of the robot."""
_RAISED = {"FRFlipper": -0.25, "FLFlipper": -0.35, "RRFlipper": 0.3, "RLFlipper": 0.4}
_LOWERS = {"FR": 1.0, "FL": 1.0, "RR": -1.0, "RL": -1.0}
"""All flippers turn about the same axis: a positive angle lowers the front ones and raises the rear
ones, as clients of Kenaf expect."""


_PAIRS = {
    "front": ("FRFlipper", "FLFlipper"),
    "rear": ("RRFlipper", "RLFlipper"),
    "right": ("FRFlipper", "RRFlipper"),
    "left": ("FLFlipper", "RLFlipper"),
}


async def _lower_each(robot: Robot, trip: Trip) -> None:
    level = dict.fromkeys(_FLIPPERS, 0.0)

    def angles(values: dict[str, float]) -> str:
        return "MULTIDRIVE " + " ".join(f"{{{name} {value:g}}}" for name, value in values.items())

    trip.legs["level"] = await ride(robot, angles(level), 2.0)
    if any(name not in trip["level"].status.names for name in _FLIPPERS):
        return
    for pair, names in _PAIRS.items():
        lowered = {name: _LOW * _LOWERS[name[:2]] for name in names}
        trip.legs[pair] = await ride(robot, angles(lowered), 1.6)
        await ride(robot, angles(level), 1.3)
    for name in _FLIPPERS:
        # Raised, so that nothing is in their way; each stays, as the next one is sent alone.
        raised = {name: _RAISED[name]}
        trip.legs[name] = await ride(robot, angles(raised), 0.7)
    one = _FLIPPERS[0]
    trip.legs["single"] = await ride(robot, f"DRIVE {{Name {one}}} {{Value -0.5}}", 0.7)


async def _crawls(case: Case) -> list[Trip]:
    async def crawl(case: Case, class_name: str) -> Trip:
        return await on_open_floor(case, "flippers", class_name, _lower_each)

    trips = await of_classes(case, CRAWLERS, crawl)
    found = [trip for trip in trips if "single" in trip.legs]
    if not found:
        case.skip("STA of none of the tracked robots tells four flippers")
    return found


@ut2004("flippers.each", "Every flipper by its name", "3.5, 4.3 and 6, no. 154 and 155")
async def each(case: Case) -> None:
    """MULTIDRIVE with one flipper moves this one to its angle, as STA tells it under the same name
    with the same sign, and no other; absent ones keep theirs. DRIVE with Name and Value does the
    same."""
    for trip in await _crawls(case):
        wanted = dict.fromkeys(_FLIPPERS, 0.0)
        for name in _FLIPPERS:
            wanted[name] = _RAISED[name]
            _compare(case, trip, name, wanted)
        _compare(case, trip, "single", wanted | {_FLIPPERS[0]: -0.5})


def _compare(case: Case, trip: Trip, leg: str, wanted: dict[str, float]) -> None:
    for name, angle in wanted.items():
        found = trip[leg].status.number(name)
        case.expect(
            abs(found - angle) < 0.08,
            f"{trip.class_name} after {trip[leg].command}: {name} of STA is {found:.3f}, not "
            f"{angle:g}",
        )


@ut2004(
    "flippers.lift",
    "Lowered flippers lift their side",
    "3.5; robots reference 5.2, no. 46",
    Severity.SHOULD,
)
async def lift(case: Case) -> None:
    """A positive angle lowers a front flipper and a negative one a rear flipper. With both front
    ones lowered the front goes up, with both rear ones the rear, with those of a side that side."""
    for trip in await _crawls(case):
        level = trip["level"]
        for pair, angle, sign in (
            ("front", "pitch", 1.0), ("rear", "pitch", -1.0),
            ("right", "roll", -1.0), ("left", "roll", 1.0),
        ):  # fmt: skip
            change = getattr(trip[pair], angle) - getattr(level, angle)
            case.expect(
                sign * change > 0.05,
                f"{trip.class_name} after {trip[pair].command}: {angle} changes by {change:.3f} "
                f"rad, which should be {'above 0.05' if sign > 0 else 'below -0.05'} with {pair} "
                f"up: {' or '.join(_PAIRS[pair])}",
            )


# Wheels one by one.

_WHEELERS = ("Lisa",)
_SKIDDERS = ("P2AT",)
_PACE = 0.3
"""m/s."""
_STEER = 0.4
"""rad."""


def _wheels(*groups: tuple[int, float, float | None]) -> str:
    return "DRIVE " + " ".join(
        f"{{WheelNumber {number}}} {{WheelSpeed {spin:.4f}}}"
        + ("" if angle is None else f" {{WheelSteer {angle:g}}}")
        for number, spin, angle in groups
    )


async def _wheel_by_wheel(robot: Robot, trip: Trip) -> None:
    spin = min(_PACE / trip.geo.number("WheelRadius"), 0.6 * trip.conf.number("MaxSpeed"))
    every, slow = range(4), 0.3 * spin
    steered = trip.class_name in _WHEELERS
    angle = 0.0 if steered else None
    orders = {
        "straight": _wheels(*((n, spin, angle) for n in every)),
        "left side": _wheels(*((n, slow if n % 2 else spin, angle) for n in every)),
        "right side": _wheels(*((n, spin if n % 2 else slow, angle) for n in every)),
        "back": _wheels(*((n, -spin, angle) for n in every)),
    }
    if steered:
        # Steered on the spot first: a wheel that turns while it rolls pushes the robot about.
        for name, front, rear in (
            ("all right", _STEER, _STEER),
            ("all left", -_STEER, -_STEER),
            ("front right", 0.25, -0.25),
            ("front left", -0.25, 0.25),
        ):
            orders[f"turn {name}"] = _wheels(*((n, 0.0, front if n < 2 else rear) for n in every))
            orders[name] = _wheels(*((n, spin, None) for n in every))
    for name, command in orders.items():
        trip.legs[name] = await ride(robot, command, 1.2 if name.startswith("turn") else 1.6)


async def _steps(case: Case, classes: tuple[str, ...]) -> list[Trip]:
    async def step(case: Case, class_name: str) -> Trip:
        return await on_open_floor(case, "wheel by wheel", class_name, _wheel_by_wheel)

    return await of_classes(case, classes, step)


@ut2004("omni.speed", "WheelSpeed times WheelRadius is the speed", "3.4.3", Severity.SHOULD)
async def wheel_speed(case: Case) -> None:
    """With the same WheelSpeed on all wheels and none steered the robot runs at WheelSpeed times
    WheelRadius of GEO straight ahead, backwards with a negative one, within 8 percent."""
    for trip in await _steps(case, _WHEELERS + _SKIDDERS):
        for leg, sign in (("straight", 1.0), ("back", -1.0)):
            spin = abs(float(trip[leg].command.split("{WheelSpeed ")[1].partition("}")[0]))
            wanted = sign * spin * trip.geo.number("WheelRadius")
            ahead, right, _ = trip[leg].velocity
            case.expect(
                near(ahead, wanted, 0.08, 0.01) and abs(right) < 0.03,
                f"{trip.class_name} with {trip[leg].command} runs {ahead:.3f} m/s ahead and "
                f"{right:.3f} right, not {wanted:.3f} ahead: WheelSpeed",
            )


@ut2004("omni.sides", "Even wheels are left, odd ones right", "3.4.3", Severity.SHOULD)
async def wheel_sides(case: Case) -> None:
    """Wheels are counted front left, front right, rear left, rear right: with 0 and 2 faster than 1
    and 3 the robot turns clockwise."""
    for trip in await _steps(case, _WHEELERS + _SKIDDERS):
        for leg, sign in (("left side", 1.0), ("right side", -1.0)):
            turning = trip[leg].turning
            case.expect(
                sign * turning > 0.02,
                f"{trip.class_name} with {trip[leg].command}: yaw changes by {turning:.3f} "
                f"rad/s, which should be {'above 0.02' if sign > 0 else 'below -0.02'}: "
                "WheelNumber",
            )


@ut2004("omni.steer", "WheelSteer is positive to the right", "3.4.3 and 3.4.2", Severity.SHOULD)
async def wheel_steer(case: Case) -> None:
    """With all wheels steered by 0.4 rad the robot moves 0.4 rad to the right of where it looks and
    does not turn; with wheels 0 and 1, the front ones, to the right and the others to the left it
    turns clockwise. Negative angles do the opposite."""
    for trip in await _steps(case, _WHEELERS):
        for leg, sign in (("all right", 1.0), ("all left", -1.0)):
            ahead, right, _ = trip[leg].velocity
            found = math.atan2(right, ahead)
            case.expect(
                abs(found - sign * _STEER) < 0.08 and abs(trip[leg].turning) < 0.15,
                f"{trip.class_name} with all wheels at {sign * _STEER:g} rad moves {found:.2f} rad "
                f"to the right of its x and turns by {trip[leg].turning:.2f} rad/s, not "
                f"{sign * _STEER:g} rad and 0 rad/s: WheelSteer",
            )
        for leg, sign in (("front right", 1.0), ("front left", -1.0)):
            turning = trip[leg].turning
            case.expect(
                sign * turning > 0.05,
                f"{trip.class_name} with its front wheels at {sign * 0.25:g} rad: yaw changes by "
                f"{turning:.3f} rad/s, which should be {'above' if sign > 0 else 'below'} "
                f"{sign * 0.05:g}: WheelSteer, or WheelNumber",
            )


@ut2004(
    "omni.steering-type", "SteeringType of robots driven wheel by wheel", "4.8", Severity.SHOULD
)
async def steering_type(case: Case) -> None:
    """SteeringType of CONF is OmniDrive for a robot whose wheels are steered one by one."""
    for trip in await _steps(case, _WHEELERS):
        found = trip.conf.get("SteeringType")
        case.expect(
            found == "OmniDrive", f"SteeringType of {trip.class_name} is {found}, not OmniDrive"
        )


# Lamps.


@ut2004("status.light-intensity", "LightIntensity follows the lamp", "4.3", Severity.SHOULD)
async def light_intensity(case: Case) -> None:
    """In ut2004 LightIntensity of STA is 0 while the headlight is off, above 0 while it is on."""
    robot = await case.spawn()
    if robot.first.get("LightIntensity") is None:
        case.skip("STA has no LightIntensity")
    for word, lit in (("true", True), ("false", False)):
        await robot.send(f"DRIVE {{Light {word}}}")
        status = [line for line in await robot.run(0.6) if line.head == "STA"][-1]
        found = status.number("LightIntensity")
        case.expect(
            (found > 0.0) == lit,
            f"LightIntensity is {found:g} with Light {word}, not {'above 0' if lit else '0'}",
        )
