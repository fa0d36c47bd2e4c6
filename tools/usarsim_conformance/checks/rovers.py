"""Wheels and tracks: what CONF and GEO announce against how robots move (protocol 3.4.1)."""

from __future__ import annotations

import math
from functools import partial

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.lines import Line
from usarsim_conformance.registry import Severity, once
from usarsim_conformance.trips import Trip, near, of_classes, on_open_floor, ride

DIFFERENTIAL = ("P2DX", "P3DX")
TRACKED = ("Kenaf", "TeleMax", "Talon", "Tarantula", "Matilda", "Rugbot", "crawler_robot")
ROVERS = ("P2AT", "P3AT", "P2DX", "Talon")
"""Skid steered, of both generations; differential; on tracks."""
_PACE = 0.35
"""m/s."""
_LATE = 0.45
"""Share of the time in which speeds are measured: some robots speed up slowly."""
_FAST = 0.75
"""m/s; faster ones need more room and time to speed up."""
_SCRUBS = 2.6
"""How many times farther apart than they are wheels that scrub, or tracks, seem to be when it
turns; robots reference 3.3: 1.42 to 1.57 for a Pioneer 3-AT."""
_TORQUES = {"P2AT": 60.0, "P2DX": 50.0, "P3AT": 50000.0, "BasicSkidRobot": 50000.0}
"""N m; the largest number stands for none."""
_MASSES = {
    "P3AT": 11.9, "BasicSkidRobot": 14.0, "CasterSkidRobot": 13.0, "BasicAckermanRobot": 16.4,
    "FrontAckerman": 147.0, "P2AT": 14.0, "P2DX": 9.0, "ATRVJr": 50.0, "Talon": 52.0,
    "TeleMax": 75.0, "Tarantula": 15.0, "Zerg": 5.0, "Kurt2D": 15.6, "Kurt3D": 22.6,
    "Rugbot": 35.0, "Sedan": 1400.0, "Cooper": 1100.0, "Lisa": 25.0, "Matilda": 28.0,
}  # fmt: skip
"""kg, as in the original, or of the real machine (robots reference 1.2, 1.4, 1.6, 1.11)."""


def _drive(left: float, right: float, extra: str = "") -> str:
    return f"DRIVE {{Left {left:.4f}}} {{Right {right:.4f}}}{extra}"


async def _tour(robot: Robot, trip: Trip) -> None:
    radius, most = trip.geo.number("WheelRadius"), trip.conf.number("MaxSpeed")
    if not _sides(trip):
        return
    spin = min(0.7 * most, _PACE / radius)
    seconds = 2.4 if spin * radius > 0.2 else 3.0
    for name, command in (
        ("ahead", _drive(spin, spin)),
        ("back", _drive(-spin, -spin)),
        ("clockwise", _drive(spin, -spin)),
        ("anticlockwise", _drive(-spin, spin)),
        ("right", _drive(spin, 0.4 * spin)),
        ("left", _drive(0.4 * spin, spin)),
        ("percent", _drive(40.0, 40.0, " {Normalized true}")),
        ("percent back", _drive(-40.0, -40.0, " {Normalized true}")),
        ("too fast", _drive(1000.0, 1000.0, " {Normalized false}")),
    ):
        if name == "too fast" and most * radius > _FAST:
            continue  # there is not that much room
        trip.legs[name] = await ride(robot, command, seconds)


async def _tours(case: Case) -> list[Trip]:
    classes = dict.fromkeys((*ROVERS, case.robot_class))

    async def tour(case: Case, class_name: str) -> Trip:
        return await on_open_floor(case, "a tour", class_name, _tour)

    trips = await of_classes(case, tuple(classes), tour)
    driven = [trip for trip in trips if _sides(trip)]
    if not driven:
        case.skip(f"none of {', '.join(classes)} is driven by its sides")
    return driven


def _sides(trip: Trip) -> bool:
    """Whether it is driven by its sides: by what it says, and if in doubt by its class."""
    says = trip.conf.get("SteeringType") == "SkidSteered" or trip.class_name in ROVERS
    return says and trip.geo.number("WheelRadius") > 0.0


def _side(trip: Trip, leg: str, side: str) -> float:
    return float(trip[leg].command.split(f"{{{side} ")[1].partition("}")[0])


@once(
    "motion.radius",
    "Spin times WheelRadius is the speed, both ways",
    "3.4.1 and 6, no. 132",
    Severity.SHOULD,
)
async def radius(case: Case) -> None:
    """Ahead and back, wheels and tracks of several robots run at their spin times WheelRadius of
    GEO, along the robot's x: within 7 percent, tracks 10."""
    for trip in await _tours(case):
        share = 0.10 if trip.class_name in TRACKED else 0.07
        for leg in ("ahead", "back"):
            wanted = _side(trip, leg, "Left") * trip.geo.number("WheelRadius")
            ahead, right, _ = trip[leg].velocity_at_last(_LATE)
            case.expect(
                near(ahead, wanted, share, 0.01) and abs(right) < 0.1 * abs(wanted) + 0.01,
                f"{trip.class_name} with {trip[leg].command} runs {ahead:.3f} m/s ahead and "
                f"{right:.3f} m/s right, not {wanted:.3f} ahead: WheelRadius of GEO",
            )


@once(
    "motion.max-speed",
    "Normalized is percent of MaxSpeed, more is clamped to it",
    "4.8 and 6, no. 131 and 146",
    Severity.SHOULD,
)
async def max_speed(case: Case) -> None:
    """40 percent run at 0.4 times MaxSpeed of CONF times WheelRadius, ahead and back, and 1000
    rad/s run at MaxSpeed: within 7 percent, tracks 10. (Robots above 0.75 m/s are not tried so.)"""
    for trip in await _tours(case):
        share = 0.10 if trip.class_name in TRACKED else 0.07
        full = trip.conf.number("MaxSpeed") * trip.geo.number("WheelRadius")
        for leg, part in (("percent", 0.4), ("percent back", -0.4), ("too fast", 1.0)):
            if leg not in trip.legs or abs(part) * full > _FAST:
                continue
            found = trip[leg].velocity_at_last(_LATE)[0]
            case.expect(
                near(found, part * full, share, 0.01),
                f"{trip.class_name} with {trip[leg].command} runs {found:.3f} m/s, not "
                f"{part * full:.3f}: MaxSpeed of CONF",
            )


@once("motion.sides", "Left and Right are left and right", "3.4.1; robots reference 5.2, no. 34")
async def sides(case: Case) -> None:
    """A faster Left turns clockwise, yaw grows; a faster Right does the opposite: on the spot and
    in arcs."""
    for trip in await _tours(case):
        for leg, sign in (
            ("clockwise", 1.0), ("anticlockwise", -1.0), ("right", 1.0), ("left", -1.0),
        ):  # fmt: skip
            turning = trip[leg].turning
            case.expect(
                sign * turning > 0.01,
                f"{trip.class_name} with {trip[leg].command}: yaw changes by {turning:.3f} "
                f"rad/s, which should be {'above 0.01' if sign > 0 else 'below -0.01'}: Left and "
                "Right",
            )


@once(
    "motion.separation",
    "Turning shows WheelSeparation",
    "3.4.1; robots reference 3.2 and 5.2, no. 25 and 26",
    Severity.SHOULD,
)
async def separation(case: Case) -> None:
    """r (L - R) over the turning rate is WheelSeparation of GEO, within 10 percent for robots with
    two driven wheels (P2DX, P3DX). Wheels that scrub, and tracks, turn more slowly: it may be
    up to 2.6 times as much, more for robots that are longer than wide, but never less."""
    for trip in await _tours(case):
        told, wheel = trip.geo.number("WheelSeparation"), trip.geo.number("WheelRadius")
        exact = trip.class_name in DIFFERENTIAL
        for leg in ("clockwise", "anticlockwise"):
            turning = trip[leg].turning
            case.need(
                abs(turning) > 0.005,
                f"{trip.class_name} turns by {turning:.4f} rad/s, not by more than 0.005",
            )
            seems = wheel * (_side(trip, leg, "Left") - _side(trip, leg, "Right")) / turning
            # Long ones scrub without bound.
            scrubs = _SCRUBS if trip.geo.number("WheelBase") < 0.8 * told else math.inf
            low, high = (0.9, 1.1) if exact else (0.9, scrubs)
            case.expect(
                low * told <= seems <= high * told,
                f"{trip.class_name} turns by {turning:.3f} rad/s with {trip[leg].command} as if "
                f"its wheels stood {seems:.3f} m apart, not {low * told:.3f} to {high * told:.3f} "
                f"m: WheelSeparation of GEO is {told}",
            )


@once(
    "geo.size", "Wheels stand within the body's size", "4.7; robots reference 1.2", Severity.SHOULD
)
async def size(case: Case) -> None:
    """WheelBase is at most the length and WheelSeparation at most the width of Dimensions, and no
    less than half of it; the centre of gravity lies within."""
    for trip in await _tours(case):
        dimensions, cog = trip.geo.numbers("Dimensions"), trip.geo.numbers("COG")
        case.expect(
            len(dimensions) == 3 == len(cog),
            f"Dimensions and COG of GEO are {dimensions} and {cog}, not three numbers each: "
            f"{trip.geo}",
        )
        length, width, _ = dimensions
        base, apart = trip.geo.number("WheelBase"), trip.geo.number("WheelSeparation")
        case.expect(
            base <= 1.02 * length + 0.001 or not length,
            f"WheelBase of GEO of {trip.class_name} is {base}, not at most {length}, the length "
            "of Dimensions",
        )
        case.expect(
            0.52 * width < apart <= 1.02 * width,
            f"WheelSeparation of GEO of {trip.class_name} is {apart}, not above "
            f"{0.52 * width:.3f} and at most {1.02 * width:.3f}, by the width of Dimensions",
        )
        case.expect(
            all(abs(part) <= max(whole, length) / 2.0 + 0.001
                for part, whole in zip(cog, dimensions, strict=True)),
            f"COG of GEO of {trip.class_name} is {cog}, not within Dimensions, {dimensions}",
        )  # fmt: skip


@once(
    "conf.mass",
    "Mass is that of the class",
    "robots reference 1.2, 1.4, 1.6 and 1.11",
    Severity.SHOULD,
)
async def mass(case: Case) -> None:
    """Mass of CONF is that of the original's class, or where none is known of the real machine,
    within 20 percent."""
    judged = 0
    for trip in await _tours(case):
        wanted = _MASSES.get(trip.class_name)
        if wanted is None:
            continue
        judged += 1
        found = trip.conf.number("Mass")
        case.expect(
            near(found, wanted, 0.2),
            f"Mass of CONF of {trip.class_name} is {found} kg, not {wanted}, as its class has",
        )
    if not judged:
        case.skip("the mass of none of the classes is known")


@once(
    "conf.torque",
    "MaxTorque is that of the class",
    "4.8; robots reference 1.2 and 1.6",
    Severity.SHOULD,
)
async def max_torque(case: Case) -> None:
    """MaxTorque of CONF is that of the original's class, as it was captured."""
    for trip in await _tours(case):
        wanted = _TORQUES.get(trip.class_name)
        found = trip.conf.number("MaxTorque")
        case.expect(
            wanted is None or near(found, wanted, 0.01),
            f"MaxTorque of CONF of {trip.class_name} is {found}, not {wanted}, as its class has",
        )


@once("conf.steering-type", "SteeringType tells how it is driven", "4.8")
async def steering_type(case: Case) -> None:
    """SteeringType of CONF is SkidSteered for robots that Left and Right drive."""
    for trip in await _tours(case):
        found = trip.conf.get("SteeringType")
        case.expect(
            found == "SkidSteered",
            f"SteeringType of {trip.class_name} is {found}, not SkidSteered",
        )


@once("conf.dialects-agree", "Dialects tell the same numbers", "4.7 and 4.8", Severity.SHOULD)
async def dialects_agree(case: Case) -> None:
    """What CONF and GEO of a robot tell is the same in every dialect that the server speaks; angles
    of aircraft, MaxRotationalVelocity and MaxTilt, are in degrees in udk."""
    if len(case.survey.dialects) < 2:
        case.skip("the server speaks one dialect only")
    for command in ("GETCONF", "GETGEO"):
        told = {
            dialect: await case.shared(f"{command} of the robot", partial(_ask, command), dialect)
            for dialect in case.survey.dialects
        }
        (first, line), *others = told.items()
        for dialect, other in others:
            for name in line.names:
                values = _in_radians(line, name, first), _in_radians(other, name, dialect)
                if other.get(name) is None or not all(map(math.isfinite, values[0])):
                    continue
                case.expect(
                    len(values[0]) == len(values[1])
                    and all(near(b, a, 0.01, 0.001) for a, b in zip(*values, strict=True)),
                    f"{name} of {command} is {other.get(name)} in {dialect}, not "
                    f"{line.get(name)}, as in {first}",
                )


def _in_radians(line: Line, name: str, dialect: str) -> tuple[float, ...]:
    """Numbers of a segment, in the units of ut2004 (protocol reference 5.2, no. 16)."""
    degrees = dialect == "udk" and name in ("MaxRotationalVelocity", "MaxTilt")
    return tuple(math.radians(one) if degrees else one for one in line.numbers(name))


async def _ask(command: str, case: Case) -> Line:
    robot = await case.spawn()
    head = command.removeprefix("GET")
    return await robot.client.ask(
        f"{command} {{Type Robot}}", lambda line: line.head == head and line.type != "Camera"
    )


@once(
    "motion.upright",
    "Driving on level floor is level",
    "robots reference 5.2, no. 30",
    Severity.SHOULD,
)
async def upright(case: Case) -> None:
    """On level floor a robot neither leans nor climbs, whichever way it goes: pitch and roll stay
    within 0.15 rad, z within 6 cm."""
    for trip in await _tours(case):
        moments = [one for leg in trip.legs.values() for one in leg.moments]
        case.need(moments, f"{trip.class_name} has no GroundTruth")
        lean = max(max(abs(one.pitch), abs(one.roll)) for one in moments)
        heights = [one.location[2] for one in moments]
        case.expect(
            lean < 0.15,
            f"{trip.class_name} leans by {lean:.2f} rad, not by less than 0.15: pitch or roll",
        )
        rise = max(heights) - min(heights)
        case.expect(
            rise < 0.06, f"z of {trip.class_name} changes by {rise:.3f} m, not by less than 0.06"
        )
