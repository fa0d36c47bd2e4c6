"""Aircraft: every axis, its sign, unit and lean, against ground truth (protocol 3.4.4)."""

from __future__ import annotations

import math
from itertools import pairwise

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.registry import Severity, udk, unreal
from usarsim_conformance.trips import Trip, near, of_classes, on_open_floor, ride

QUADROTORS = ("AirRobot", "ARDrone")
BLIMPS = ("Passarola",)
"""Blimps take long to get up to speed, so only their directions are judged."""
_UP = 3.0
"""m above start poses, so that there is room below."""
_SPEED, _SPIN = 0.6, 0.7
"""m/s and rad/s."""
_HALF = 50.0
"""Percent."""
_AXES = ("AltitudeVelocity", "LinearVelocity", "LateralVelocity", "RotationalVelocity")
_BEFORE = dict(
    pairwise(
        ("hover", "ahead", "behind", "right", "left", "up", "down", "clockwise", "anticlockwise")
    )
)
_BEFORE = {later: earlier for earlier, later in _BEFORE.items()}
"""Which leg comes before each."""
_LEANS = math.radians(25.0)
"""rad, of an AirRobot that flies anywhere (robots reference 5.2, no. 43)."""


def _drive(values: dict[str, float], extra: str = "") -> str:
    members = " ".join(f"{{{axis} {values.get(axis, 0.0):.4f}}}" for axis in _AXES)
    return f"DRIVE {members}{extra}"


def _unit(dialect: str) -> float:
    """What a rad/s is on the wire: degrees per second in udk."""
    return 1.0 if dialect == "ut2004" else math.degrees(1.0)


async def _fly(robot: Robot, trip: Trip) -> None:
    up, ahead, right, turn = _AXES
    spin = _SPIN * _unit(trip.dialect)
    for name, values in (
        ("hover", {}),
        ("ahead", {ahead: _SPEED}),
        ("behind", {ahead: -_SPEED}),
        ("right", {right: _SPEED}),
        ("left", {right: -_SPEED}),
        ("up", {up: _SPEED}),
        ("down", {up: -_SPEED}),
        ("clockwise", {turn: spin}),
        ("anticlockwise", {turn: -spin}),
    ):
        trip.legs[name] = await ride(robot, _drive(values), 2.0)
    if trip.class_name in BLIMPS:
        return
    for axis in _AXES:
        command = _drive({axis: _HALF}, " {Normalized true}")
        trip.legs[f"half {axis}"] = await ride(robot, command, 1.6)
    await ride(robot, _drive({}), 0.6)
    trip.legs["kept"] = await ride(robot, f"DRIVE {{{ahead} {_SPEED}}}", 0.4)
    trip.legs["kept"] = await ride(robot, f"DRIVE {{{right} {_SPEED}}}", 1.8)
    await ride(robot, _drive({}), 1.0)
    if trip.dialect == "udk":
        for name in ("PitchAngle", "RollAngle"):
            trip.legs[name] = await ride(robot, f"DRIVE {{{name} 12}}", 1.2)
            await ride(robot, f"DRIVE {{{name} 0}}", 0.6)


async def _flights(case: Case, classes: tuple[str, ...] = QUADROTORS) -> list[Trip]:
    async def flight(case: Case, class_name: str) -> Trip:
        return await on_open_floor(case, "a flight", class_name, _fly, _UP)

    return await of_classes(case, classes, flight)


def _moved(trip: Trip, leg: str) -> dict[str, float]:
    """Velocities as the segments of DRIVE count them, rad/s for the turn."""
    ahead, right, down = trip[leg].velocity
    return dict(zip(_AXES, (-down, ahead, right, trip[leg].turning), strict=True))


async def _axis(case: Case, axis: str, plus: str, minus: str, wanted: float) -> None:
    for trip in await _flights(case, QUADROTORS + BLIMPS):
        for leg, sign in ((plus, 1.0), (minus, -1.0)):
            found = _moved(trip, leg)
            if trip.class_name in BLIMPS:
                before = _moved(trip, _BEFORE[leg])[axis]
                case.expect(
                    sign * (found[axis] - before) > 0.1 * wanted,
                    f"{trip.class_name} with {trip[leg].command}: {found[axis]:.2f}, which should "
                    f"be {'above' if sign > 0 else 'below'} {before + sign * 0.1 * wanted:.2f}: "
                    f"{axis}",
                )
                continue
            case.expect(
                near(found[axis], sign * wanted, 0.12),
                f"{trip.class_name} with {trip[leg].command}: {found[axis]:.2f}, not "
                f"{sign * wanted:.2f}: {axis}",
            )
            others = {one: value for one, value in found.items() if one != axis}
            worst = max(others, key=lambda one: abs(others[one]))
            case.expect(
                abs(others[worst]) < 0.15 * wanted,
                f"{trip.class_name} with {trip[leg].command}, which asks for {axis} only, moves "
                f"by {others[worst]:.2f} in {worst}, not by less than {0.15 * wanted:.2f}",
            )


@unreal(
    "aerial.altitude-velocity",
    "AltitudeVelocity is m/s upwards",
    "3.4.4; robots reference 5.2, no. 42",
)
async def altitude(case: Case) -> None:
    """With AltitudeVelocity v alone an aircraft climbs at v m/s, with -v it sinks, and nothing else
    changes, within 12 percent of v."""
    await _axis(case, "AltitudeVelocity", "up", "down", _SPEED)


@unreal(
    "aerial.linear-velocity", "LinearVelocity is m/s ahead", "3.4.4; robots reference 5.2, no. 42"
)
async def linear(case: Case) -> None:
    """With LinearVelocity v alone an aircraft flies ahead at v m/s, with -v backwards, and nothing
    else changes, within 12 percent of v."""
    await _axis(case, "LinearVelocity", "ahead", "behind", _SPEED)


@unreal(
    "aerial.lateral-velocity",
    "LateralVelocity is m/s to the right",
    "3.4.4; robots reference 5.2, no. 42",
)
async def lateral(case: Case) -> None:
    """With LateralVelocity v alone an aircraft flies to the right at v m/s, with -v to the left,
    and nothing else changes, within 12 percent of v."""
    await _axis(case, "LateralVelocity", "right", "left", _SPEED)


@unreal(
    "aerial.rotational-velocity",
    "RotationalVelocity turns clockwise at its rate",
    "3.4.4 and 6, no. 152; robots reference 5.2, no. 44",
)
async def rotational(case: Case) -> None:
    """With RotationalVelocity v alone an aircraft turns clockwise at v, with -v anticlockwise:
    rad/s in ut2004, degrees per second in udk, within 12 percent."""
    await _axis(case, "RotationalVelocity", "clockwise", "anticlockwise", _SPIN)


@unreal("aerial.percent", "CONF tells what percent are of", "3.4.4", Severity.SHOULD)
async def percent(case: Case) -> None:
    """`{Normalized true}` with 50 on one axis gives half of what CONF names as its maximum, if it
    does (MaxLinearVelocity and so on); an AirRobot does 2 m/s and 100 degrees per second. Within 12
    percent."""
    judged = 0
    for trip in await _flights(case):
        for axis in _AXES:
            told = trip.conf.number(f"Max{axis}")
            if axis == "RotationalVelocity":
                told /= _unit(trip.dialect)
            if math.isnan(told) and trip.class_name == "AirRobot":
                told = math.radians(100.0) if axis == "RotationalVelocity" else 2.0
            if math.isnan(told):
                continue
            judged += 1
            found = _moved(trip, f"half {axis}")[axis]
            case.expect(
                near(found, told / 2.0, 0.12, 0.02),
                f"{trip.class_name} at 50 percent of {axis} does {found:.3f}, not "
                f"{told / 2.0:.3f}, half of Max{axis}",
            )
    if not judged:
        case.skip("CONF names no largest velocities")


@unreal(
    "aerial.pitches",
    "Flying ahead the nose goes down",
    "3.4.4; robots reference 5.2, no. 43",
    Severity.SHOULD,
)
async def pitches(case: Case) -> None:
    """An AirRobot that flies ahead has its nose down by 25 degrees, backwards up; others by MaxTilt
    of CONF, if it names one, and never the other way."""
    await _leans(case, "pitch", (("ahead", -1.0), ("behind", 1.0)))


@unreal("aerial.rolls", "Flying to the right the right side goes down", "3.4.4", Severity.SHOULD)
async def rolls(case: Case) -> None:
    """An AirRobot that flies to the right has its right side down by 25 degrees, to the left its
    left side; others by MaxTilt of CONF, if it names one, and never the other way."""
    await _leans(case, "roll", (("right", 1.0), ("left", -1.0)))


async def _leans(case: Case, angle: str, legs: tuple[tuple[str, float], ...]) -> None:
    for trip in await _flights(case):
        told = trip.conf.number("MaxTilt") / _unit(trip.dialect)
        if math.isnan(told):
            told = _LEANS if trip.class_name == "AirRobot" else math.nan
        for leg, sign in legs:
            found = sign * getattr(trip[leg], angle)
            case.expect(
                found > -0.03,
                f"{trip.class_name} with {trip[leg].command} has a {angle} of {sign * found:.2f} "
                f"rad, which should be {'above -0.03' if sign > 0 else 'below 0.03'}: {angle} has "
                "the wrong sign",
            )
            case.expect(
                math.isnan(told) or near(found, told, 0.15, 0.02),
                f"{trip.class_name} with {trip[leg].command} has a {angle} of {sign * found:.2f} "
                f"rad, not {sign * told:.2f}: {angle}, or MaxTilt of CONF",
            )


@udk("aerial.lean-angles", "PitchAngle and RollAngle are degrees", "3.4.4", Severity.SHOULD)
async def lean_angles(case: Case) -> None:
    """`DRIVE {PitchAngle 12}` raises the nose by 12 degrees, `{RollAngle 12}` lowers the right
    side by 12 degrees."""
    for trip in await _flights(case):
        for name, angle in (("PitchAngle", "pitch"), ("RollAngle", "roll")):
            found = math.degrees(getattr(trip[name], angle))
            case.expect(
                abs(found - 12.0) < 3.0,
                f"{trip.class_name} with {{{name} 12}} has a {angle} of {found:.1f} degrees, "
                f"not 12: {name}",
            )


@unreal("aerial.keeps", "Absent segments keep their value", "3.4.4")
async def keeps(case: Case) -> None:
    """LinearVelocity stays in force when LateralVelocity alone is sent after it."""
    for trip in await _flights(case):
        moved = _moved(trip, "kept")
        for axis in ("LinearVelocity", "LateralVelocity"):
            case.expect(
                near(moved[axis], _SPEED, 0.2),
                f"{trip.class_name} flies at {moved[axis]:.2f} m/s in {axis}, not at {_SPEED}, "
                "after one and then the other was sent alone",
            )
