"""Submarines: propeller, rudder and stern planes against ground truth (protocol 3.4.5)."""

from __future__ import annotations

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.registry import ONCE, check
from usarsim_conformance.trips import Trip, near, of_classes, on_open_floor, ride
from usarsim_conformance.verdicts import Severity

VESSELS = ("Submarine",)
_UP = 4.0
"""m above start poses: our world is water wherever it is put, and it dives."""
_SPIN = 20.0
"""rad/s of the propeller."""
_PERCENT = 80.0
_ANGLE = 0.3
"""rad."""


def _drive(propeller: float, rudder: float = 0.0, planes: float = 0.0, extra: str = "") -> str:
    return (
        f"DRIVE {{Propeller {propeller:g}}} {{Rudder {rudder:g}}} {{SternPlane {planes:g}}}{extra}"
    )


async def _dive(robot: Robot, trip: Trip) -> None:
    spin = _spin(trip)
    for name, command, seconds in (
        ("rest", _drive(0.0), 1.0),
        ("ahead", _drive(spin), 4.0),
        ("right", _drive(spin, _ANGLE), 2.0),
        ("left", _drive(spin, -_ANGLE), 3.0),
        ("dive", _drive(spin, 0.0, _ANGLE), 3.0),
        ("rise", _drive(spin, 0.0, -_ANGLE), 4.0),
        ("back", _drive(-spin), 4.0),
        ("most", _drive(0.0, 9.0, 9.0), 0.5),
        ("least", _drive(0.0, -9.0, -9.0), 0.5),
        ("dive again", _drive(spin, 0.0, _ANGLE), 0.3),
        ("kept", "DRIVE {Rudder 0.1}", 0.5),
    ):
        trip.legs[name] = await ride(robot, command, seconds)


async def _dive_in_percent(robot: Robot, trip: Trip) -> None:
    trip.legs["ahead"] = await ride(robot, _drive(_PERCENT, extra=" {Normalized true}"), 4.0)


def _spin(trip: Trip) -> float:
    most = trip.conf.number("MaxPropeller")
    return most * _PERCENT / 100.0 if most > 0.0 else _SPIN


async def _dives(case: Case) -> list[Trip]:
    async def dive(case: Case, class_name: str) -> Trip:
        return await on_open_floor(case, "a dive", class_name, _dive, _UP)

    return await of_classes(case, VESSELS, dive)


@check(
    "control.underwater.propeller",
    "A positive Propeller drives ahead",
    source="protocol reference 3.4.5",
    dialects=ONCE,
)
async def propeller(case: Case) -> None:
    """A positive Propeller drives a submarine ahead along its x, a negative one slows it down and
    drives it back."""
    for trip in await _dives(case):
        ahead, right, _ = trip["ahead"].velocity
        case.expect(
            ahead > 0.1 and abs(right) < 0.2 * ahead + 0.05,
            f"{trip.class_name} with {trip['ahead'].command} goes {ahead:.2f} m/s ahead and "
            f"{right:.2f} m/s right: Propeller",
        )
        before, after = trip["rise"].velocity[0], trip["back"].velocity[0]
        case.expect(
            after < before - 0.1,
            f"{trip.class_name} with {trip['back'].command} goes {after:.2f} m/s ahead, "
            f"{before:.2f} before: Propeller",
        )


@check(
    "control.underwater.percent",
    "Normalized Propeller is percent of MaxPropeller",
    source="protocol reference 3.4.5",
    dialects=ONCE,
    severity=Severity.SHOULD,
)
async def percent(case: Case) -> None:
    """A Propeller in percent of MaxPropeller of CONF gives the speed of the same spin in rad/s,
    within 10 percent. Not applicable without MaxPropeller."""
    for trip in await _dives(case):
        if not trip.conf.number("MaxPropeller") > 0.0:
            case.skip(f"CONF names no MaxPropeller: {trip.conf}")
        other = await on_open_floor(
            case, "a dive in percent", trip.class_name, _dive_in_percent, _UP
        )
        plain, found = trip["ahead"].gone[0], other["ahead"].gone[0]
        case.expect(
            near(found, plain, 0.1, 0.05),
            f"{trip.class_name} with {other['ahead'].command} goes {found:.2f} m from rest, with "
            f"{trip['ahead'].command} {plain:.2f}: MaxPropeller of CONF, or Propeller in percent",
        )


@check(
    "control.underwater.rudder",
    "A positive Rudder turns right",
    source="protocol reference 3.4.5; as FrontSteer, 3.4.2",
    dialects=ONCE,
    severity=Severity.SHOULD,
)
async def rudder(case: Case) -> None:
    """Ahead, a positive Rudder turns a submarine clockwise, yaw grows; a negative one does the
    opposite."""
    for trip in await _dives(case):
        for leg, sign in (("right", 1.0), ("left", -1.0)):
            turning = trip[leg].turning
            case.expect(
                sign * turning > 0.02,
                f"{trip.class_name} with {trip[leg].command}: yaw changes by {turning:.3f} rad/s:"
                " Rudder",
            )


@check(
    "control.underwater.stern-plane",
    "A positive SternPlane dives",
    source="protocol reference 3.4.5",
    dialects=ONCE,
    severity=Severity.SHOULD,
)
async def stern_plane(case: Case) -> None:
    """Ahead, a positive SternPlane turns the nose of a submarine down, pitch below 0, and it goes
    deeper; a negative one does the opposite."""
    for trip in await _dives(case):
        for leg, sign in (("dive", 1.0), ("rise", -1.0)):
            pitch = trip[leg].moments[-1].pitch
            case.expect(
                sign * pitch < -0.02,
                f"{trip.class_name} with {trip[leg].command} has a pitch of {pitch:.2f} rad: "
                "SternPlane",
            )
        late = trip["dive"].moments[-len(trip["dive"].moments) // 4 :]
        down = late[-1].location[2] - late[0].location[2]
        case.expect(
            down > 0.01,
            f"{trip.class_name} with {trip['dive'].command} sinks by {down:.2f} m at last: "
            "SternPlane",
        )


@check(
    "control.underwater.status",
    "STA tells rudder and stern planes",
    source="protocol reference 4.4",
    dialects=ONCE,
    severity=Severity.SHOULD,
)
async def status(case: Case) -> None:
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


@check(
    "control.underwater.depth",
    "Without orders it keeps its depth",
    source="robots reference 5.2, no. 49",
    dialects=ONCE,
    severity=Severity.SHOULD,
)
async def depth(case: Case) -> None:
    """A submarine whose propeller stands neither rises nor sinks, and does not turn."""
    for trip in await _dives(case):
        leg = trip["rest"]
        case.expect(
            abs(leg.velocity[2]) < 0.05 and abs(leg.turning) < 0.05,
            f"{trip.class_name} at rest sinks by {leg.velocity[2]:.3f} m/s and turns by "
            f"{leg.turning:.3f} rad/s",
        )
