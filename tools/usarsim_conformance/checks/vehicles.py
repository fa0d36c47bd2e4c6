"""Cars and submarines against ground truth: signs and radii of steering (protocol reference 3.4.2),
propeller, rudder and stern planes (protocol 3.4.5)."""

from __future__ import annotations

import math

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.registry import Severity, once
from usarsim_conformance.trips import Trip, near, of_classes, on_open_floor, ride

CARS = ("Sedan", "Hummer", "FrontAckerman", "BasicAckermanRobot")
"""Steered in front: an American car, a heavy one, one of the UDK generation; steered behind."""
_WIDTHS = ("FrontAckerman", "BasicAckermanRobot")
"""Classes of the UDK generation announce the width of the joint's range as the steering limit
(protocol reference 4.8); those before them the largest angle."""
_PACE = 1.2
"""m/s."""
_ANGLE = 0.3
"""rad."""
_TURNS = 0.33
"""rad by which a car turns in a curve: yaw comes in steps of 0.01 rad in ut2004, which are 5
percent of the part of it that is measured."""
_CURVE = 25.0
"""s that a curve takes at most."""


def _drive(speed: float, front: float = 0.0, rear: float = 0.0, extra: str = "") -> str:
    return f"DRIVE {{Speed {speed:.4f}}} {{FrontSteer {front:.4f}}} {{RearSteer {rear:.4f}}}{extra}"


async def _tour(robot: Robot, trip: Trip) -> None:
    radius, most = trip.geo.number("WheelRadius"), trip.conf.number("MaxSpeed")
    speed = min(0.7 * most, _PACE / radius)
    seconds = 2.6 if speed * radius > 0.5 else 4.5
    angles = {}
    for axle in ("Front", "Rear"):
        limit = trip.conf.number(f"Max{axle}Steer")
        angles[axle] = min(_ANGLE, 0.4 * limit) if limit > 0.0 else 0.0
    legs = {
        "straight": (_drive(speed), seconds),
        "back": (_drive(-speed), seconds),
    }
    for axle, front, rear in (("Front", 1.0, 0.0), ("Rear", 0.0, 1.0)):
        angle = angles[axle]
        if not angle:
            continue
        rate = speed * radius * math.tan(angle) / max(trip.geo.number("WheelBase"), 0.1)
        curve = min(max(seconds, _TURNS / rate), _CURVE)
        legs |= {
            f"{axle} right": (_drive(speed, front * angle, rear * angle), curve),
            f"{axle} right back": (_drive(-speed, front * angle, rear * angle), curve),
            f"{axle} left": (_drive(speed, -front * angle, -rear * angle), curve),
        }
    percent = 100.0 * min(_PACE / (most * radius), 0.5)
    legs |= {
        "percent": (_drive(percent, extra=" {Normalized true}"), seconds),
        "halt": (_drive(0.0, extra=" {Normalized false}"), 1.0),
        "most": (_drive(0.0, 9.0, 9.0), 2.0),
        "least": (_drive(0.0, -9.0, -9.0), 3.0),
    }
    for name, (command, time) in legs.items():
        trip.legs[name] = await ride(robot, command, time)


async def _cars(case: Case) -> list[Trip]:
    async def tour(case: Case, class_name: str) -> Trip:
        return await on_open_floor(case, "a tour", class_name, _tour)

    return await of_classes(case, CARS, tour)


def _number(trip: Trip, leg: str, name: str) -> float:
    """A number of a leg's command."""
    return float(trip[leg].command.split(f"{{{name} ")[1].partition("}")[0])


def _steered(trip: Trip) -> list[tuple[str, str, float]]:
    """Leg, axle and the turn that its command asks for: clockwise positive."""
    return [
        (name, axle, math.copysign(1.0, _number(trip, name, "Speed"))
         * math.copysign(1.0, _number(trip, name, f"{axle}Steer"))
         * (1.0 if axle == "Front" else -1.0))
        for name in trip.legs for axle in ("Front", "Rear") if name.startswith(axle)
    ]  # fmt: skip


async def _turns(case: Case, axle: str) -> None:
    judged = 0
    for trip in await _cars(case):
        for leg, one, sign in _steered(trip):
            if one != axle:
                continue
            judged += 1
            turning = trip[leg].turning
            case.expect(
                sign * turning > 0.002,
                f"{trip.class_name} with {trip[leg].command}: yaw changes by {turning:.3f} rad/s, "
                f"which should be {'above' if sign > 0 else 'below'} 0: {axle}Steer",
            )
    if not judged:
        case.skip(f"no car of {', '.join(CARS)} is steered by {axle}Steer")


@once("ackerman.front-steer", "Positive FrontSteer turns right", "3.4.2")
async def front_steer(case: Case) -> None:
    """A positive FrontSteer turns the front wheels clockwise: driving ahead yaw grows, backwards it
    shrinks; a negative one does the opposite."""
    await _turns(case, "Front")


@once("ackerman.rear-steer", "Positive RearSteer turns rear wheels clockwise", "3.4.2")
async def rear_steer(case: Case) -> None:
    """A positive RearSteer turns the rear wheels clockwise: driving ahead the car turns left and
    yaw shrinks, backwards it grows; a negative one does the opposite."""
    await _turns(case, "Rear")


@once(
    "ackerman.radius",
    "WheelBase and angle give the radius",
    "robots reference 3.2 and 5.2, no. 40",
    Severity.SHOULD,
)
async def radius(case: Case) -> None:
    """A car turns by tan(angle) / WheelBase per metre, WheelBase as in GEO, within 15 percent (cars
    whose wheels all take the same angle slip a little)."""
    for trip in await _cars(case):
        base = trip.geo.number("WheelBase")
        for leg, axle, _ in _steered(trip):
            speed, turning = trip[leg].speed, trip[leg].turning
            case.need(
                abs(speed) > 0.01, f"{trip.class_name} drives at {speed:.3f} m/s, not above 0.01"
            )
            wanted = math.tan(abs(_number(trip, leg, f"{axle}Steer"))) / base
            found = abs(turning / speed)
            case.expect(
                near(found, wanted, 0.15),
                f"{trip.class_name} with {trip[leg].command} turns on {1 / max(found, 1e-6):.2f} m,"
                f" not on {1 / wanted:.2f} m: WheelBase {base} of GEO, or {axle}Steer",
            )


@once(
    "ackerman.speed",
    "Speed times WheelRadius is the speed",
    "6, no. 132 and 3.4.2",
    Severity.SHOULD,
)
async def speed(case: Case) -> None:
    """Straight ahead and back a car runs at Speed times WheelRadius of GEO within 7 percent, and
    along its own x."""
    for trip in await _cars(case):
        for leg in ("straight", "back"):
            wanted = _number(trip, leg, "Speed") * trip.geo.number("WheelRadius")
            ahead, right, _ = trip[leg].velocity
            case.expect(
                near(ahead, wanted, 0.07, 0.01) and abs(right) < 0.05 * abs(wanted) + 0.01,
                f"{trip.class_name} with {trip[leg].command} runs {ahead:.3f} m/s ahead and "
                f"{right:.3f} m/s right, not {wanted:.3f} ahead: Speed, or WheelRadius of GEO",
            )


@once(
    "ackerman.percent",
    "Normalized Speed is percent of MaxSpeed",
    "3.4 and 6, no. 146",
    Severity.SHOULD,
)
async def percent(case: Case) -> None:
    """`{Speed p} {Normalized true}` runs at p percent of MaxSpeed of CONF times WheelRadius, within
    7 percent."""
    for trip in await _cars(case):
        share = _number(trip, "percent", "Speed") / 100.0
        wanted = share * trip.conf.number("MaxSpeed") * trip.geo.number("WheelRadius")
        found = trip["percent"].speed
        case.expect(
            near(found, wanted, 0.07, 0.01),
            f"{trip.class_name} at {100 * share:.1f} percent runs {found:.3f} m/s, not "
            f"{wanted:.3f}: MaxSpeed of CONF",
        )


@once("ackerman.status", "STA tells the steering angles", "4.3")
async def status(case: Case) -> None:
    """FrontSteer and RearSteer of STA are the angles that the car was told, with their signs; the
    axle that is not steered stays at 0."""
    for trip in await _cars(case):
        for leg, _, _ in _steered(trip):
            for name in ("FrontSteer", "RearSteer"):
                wanted, found = _number(trip, leg, name), trip[leg].status.number(name)
                case.expect(
                    abs(found - wanted) < 0.03,
                    f"{trip.class_name} with {trip[leg].command}: {name} of STA is {found}, not "
                    f"{wanted:g}",
                )


@once(
    "ackerman.limits",
    "CONF tells the steering limits",
    "4.8; robots reference 1.4",
    Severity.SHOULD,
)
async def limits(case: Case) -> None:
    """Told to steer by 9 rad, STA tells the limit of CONF, on both sides: MaxFrontSteer and
    MaxRearSteer are the largest angle, for classes of the UDK generation the width from the
    smallest to the largest."""
    for trip in await _cars(case):
        for axle in ("Front", "Rear"):
            told = trip.conf.number(f"Max{axle}Steer")
            most, least = (trip[leg].status.number(f"{axle}Steer") for leg in ("most", "least"))
            found = most - least if trip.class_name in _WIDTHS else max(most, -least)
            case.expect(
                near(found, told, 0.05, 0.01) and least <= 0.0 <= most,
                f"{trip.class_name} steers from {least:.3f} to {most:.3f} rad, not as "
                f"Max{axle}Steer of CONF, {told}, tells: {axle}Steer",
            )


@once("ackerman.steering-type", "SteeringType of cars", "4.8")
async def steering_type(case: Case) -> None:
    """SteeringType of CONF is AckermanSteered for cars."""
    for trip in await _cars(case):
        found = trip.conf.get("SteeringType")
        case.expect(
            found == "AckermanSteered",
            f"SteeringType of {trip.class_name} is {found}, not AckermanSteered",
        )


VESSELS = ("Submarine",)
_UP = 4.0
"""m above start poses: our world is water wherever it is put, and it dives."""
_SPIN = 20.0
"""rad/s of the propeller."""
_PERCENT = 80.0


def _dive_by(propeller: float, rudder: float = 0.0, planes: float = 0.0, extra: str = "") -> str:
    return (
        f"DRIVE {{Propeller {propeller:g}}} {{Rudder {rudder:g}}} {{SternPlane {planes:g}}}{extra}"
    )


async def _dive(robot: Robot, trip: Trip) -> None:
    spin = _spin(trip)
    for name, command, seconds in (
        ("rest", _dive_by(0.0), 1.0),
        ("ahead", _dive_by(spin), 4.0),
        ("right", _dive_by(spin, _ANGLE), 2.0),
        ("left", _dive_by(spin, -_ANGLE), 3.0),
        ("dive", _dive_by(spin, 0.0, _ANGLE), 3.0),
        ("rise", _dive_by(spin, 0.0, -_ANGLE), 4.0),
        ("back", _dive_by(-spin), 4.0),
        ("most", _dive_by(0.0, 9.0, 9.0), 0.5),
        ("least", _dive_by(0.0, -9.0, -9.0), 0.5),
        ("dive again", _dive_by(spin, 0.0, _ANGLE), 0.3),
        ("kept", "DRIVE {Rudder 0.1}", 0.5),
    ):
        trip.legs[name] = await ride(robot, command, seconds)


async def _dive_percent(robot: Robot, trip: Trip) -> None:
    trip.legs["ahead"] = await ride(robot, _dive_by(_PERCENT, extra=" {Normalized true}"), 4.0)


def _spin(trip: Trip) -> float:
    most = trip.conf.number("MaxPropeller")
    return most * _PERCENT / 100.0 if most > 0.0 else _SPIN


async def _dives(case: Case) -> list[Trip]:
    async def dive(case: Case, class_name: str) -> Trip:
        return await on_open_floor(case, "a dive", class_name, _dive, _UP)

    return await of_classes(case, VESSELS, dive)


@once("underwater.propeller", "A positive Propeller drives ahead", "3.4.5")
async def propeller(case: Case) -> None:
    """A positive Propeller drives a submarine ahead along its x, a negative one slows it down and
    drives it back."""
    for trip in await _dives(case):
        ahead, right, _ = trip["ahead"].velocity
        case.expect(
            ahead > 0.1 and abs(right) < 0.2 * ahead + 0.05,
            f"{trip.class_name} with {trip['ahead'].command} goes {ahead:.2f} m/s ahead and "
            f"{right:.2f} m/s right, not above 0.1 ahead and straight on: Propeller",
        )
        before, after = trip["rise"].velocity[0], trip["back"].velocity[0]
        case.expect(
            after < before - 0.1,
            f"{trip.class_name} with {trip['back'].command} goes {after:.2f} m/s ahead, "
            f"which should be below {before - 0.1:.2f}, for it was {before:.2f} before: Propeller",
        )


@once(
    "underwater.percent",
    "Normalized Propeller is percent of MaxPropeller",
    "3.4.5",
    Severity.SHOULD,
)
async def vessel_percent(case: Case) -> None:
    """A Propeller in percent of MaxPropeller of CONF gives the speed of the same spin in rad/s,
    within 10 percent. Not applicable without MaxPropeller."""
    for trip in await _dives(case):
        if not trip.conf.number("MaxPropeller") > 0.0:
            case.skip(f"CONF names no MaxPropeller: {trip.conf}")
        other = await on_open_floor(case, "a dive in percent", trip.class_name, _dive_percent, _UP)
        legs = (other["ahead"], trip["ahead"])
        way = min(leg.gone for leg in legs)
        case.expect(
            way > 0.2,
            f"{trip.class_name} goes {way:.2f} m, not above 0.2 m, with {legs[0].command} or with "
            f"{legs[1].command}: MaxPropeller of CONF, or Propeller in percent",
        )
        found, plain = (leg.took(0.1 * way, 0.9 * way) for leg in legs)
        case.expect(
            near(found, plain, 0.1),
            f"{trip.class_name} with {legs[0].command} takes {found:.2f} s for {0.8 * way:.2f} m "
            f"from rest, not {plain:.2f} s, as with {legs[1].command}: MaxPropeller of CONF, or "
            "Propeller in percent",
        )


@once(
    "underwater.rudder",
    "A positive Rudder turns right",
    "3.4.5; as FrontSteer, 3.4.2",
    Severity.SHOULD,
)
async def rudder(case: Case) -> None:
    """Ahead, a positive Rudder turns a submarine clockwise, yaw grows; a negative one does the
    opposite."""
    for trip in await _dives(case):
        for leg, sign in (("right", 1.0), ("left", -1.0)):
            turning = trip[leg].turning
            case.expect(
                sign * turning > 0.02,
                f"{trip.class_name} with {trip[leg].command}: yaw changes by {turning:.3f} rad/s, "
                f"which should be {'above 0.02' if sign > 0 else 'below -0.02'}: Rudder",
            )


@once("underwater.stern-plane", "A positive SternPlane dives", "3.4.5", Severity.SHOULD)
async def stern_plane(case: Case) -> None:
    """Ahead, a positive SternPlane turns the nose of a submarine down, pitch below 0, and it goes
    deeper; a negative one does the opposite."""
    for trip in await _dives(case):
        for leg, sign in (("dive", 1.0), ("rise", -1.0)):
            pitch = trip[leg].moments[-1].pitch
            case.expect(
                sign * pitch < -0.02,
                f"{trip.class_name} with {trip[leg].command} has a pitch of {pitch:.2f} rad, which "
                f"should be {'below -0.02' if sign > 0 else 'above 0.02'}: SternPlane",
            )
        late = trip["dive"].moments[-len(trip["dive"].moments) // 4 :]
        down = late[-1].location[2] - late[0].location[2]
        case.expect(
            down > 0.01,
            f"{trip.class_name} with {trip['dive'].command} sinks by {down:.2f} m at last, "
            "which should be above 0.01: SternPlane",
        )


@once("underwater.status", "STA tells rudder and stern planes", "4.4", Severity.SHOULD)
async def vessel_status(case: Case) -> None:
    """RudderAngle and SternPlaneAngle of STA are the angles that were told, up to MaxRudder and
    MaxSternPlane of CONF; absent segments keep their value."""
    for trip in await _dives(case):
        if "RudderAngle" not in trip["rest"].status.names:
            case.skip(f"STA has no RudderAngle: {trip['rest'].status}")
        rudder, planes = (trip.conf.number(f"Max{name}") for name in ("Rudder", "SternPlane"))
        for leg, wanted in (
            ("right", (_ANGLE, 0.0)),
            ("left", (-_ANGLE, 0.0)),
            ("dive", (0.0, _ANGLE)),
            ("rise", (0.0, -_ANGLE)),
            ("most", (rudder, planes)),
            ("least", (-rudder, -planes)),
            ("kept", (0.1, _ANGLE)),
        ):
            for name, value in zip(("RudderAngle", "SternPlaneAngle"), wanted, strict=True):
                found = trip[leg].status.number(name)
                case.expect(
                    value != value or abs(found - value) < 0.02,
                    f"{trip.class_name} with {trip[leg].command}: {name} of STA is {found}, not "
                    f"{value:.2f}",
                )


@once(
    "underwater.depth",
    "Without orders it keeps its depth",
    "robots reference 5.2, no. 49",
    Severity.SHOULD,
)
async def depth(case: Case) -> None:
    """A submarine whose propeller stands neither rises nor sinks, and does not turn."""
    for trip in await _dives(case):
        leg = trip["rest"]
        case.expect(
            abs(leg.velocity[2]) < 0.05 and abs(leg.turning) < 0.05,
            f"{trip.class_name} with {leg.command} sinks by {leg.velocity[2]:.3f} m/s and turns "
            f"by {leg.turning:.3f} rad/s, not by less than 0.05 each",
        )
