"""Arms, mission packages and legs: every joint, its limits and speed (protocol 3.9, 3.10)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from usarsim_conformance.case import Case
from usarsim_conformance.control import Robot
from usarsim_conformance.lines import Line, number
from usarsim_conformance.registry import Failed, Severity, once, unreal, ut2004
from usarsim_conformance.trips import Leg, Trip, near, of_classes, on_open_floor, ride

ARMED = ("P2AT", "P3AT_arm")
"""A camera that pans and tilts, and an arm."""
_FAR = 100.0
"""rad or m: beyond every limit."""


@dataclass(frozen=True, slots=True)
class _Link:
    """What CONF tells of a link: limits (NaN without), speed, torque."""

    low: float
    high: float
    speed: float
    torque: float


@dataclass
class _Arm(Trip):
    """A robot with its first package."""

    name: str = ""
    links: tuple[_Link, ...] = ()
    told: Line | None = None


def _links_of(line: Line) -> tuple[_Link, ...]:
    """Links of the first item of a CONF, in the words of either era."""
    found: list[dict[str, str]] = []
    names = 0
    for name, value in line.segments:
        names += name == "Name"
        if names > 1:
            break
        if name == "Link":
            found.append({})
        elif found:
            found[-1][name] = value

    def of(link: dict[str, str], *words: str) -> float:
        return next((number(link[word]) for word in words if word in link), math.nan)

    links = []
    for link in found:
        low, high = of(link, "MinRange", "MinValue"), of(link, "MaxRange", "MaxValue")
        if not low < high:  # the first above the second means none
            low = high = math.nan
        speed = of(link, "MaxSpeed", "MaxRotationSpeed")
        links.append(_Link(low, high, speed, of(link, "MaxTorque")))
    return tuple(links)


def _values(line: Line) -> list[float]:
    return [number(value) for name, value in line.segments if name == "Value"]


def _state(leg: Leg, name: str) -> Line:
    line = leg.last(lambda line: line.head in ("MISSTA", "ASTA") and line.get("Name") == name)
    if line is None:
        raise Failed(f"no MISSTA or ASTA of {name}")
    return line


def _to(name: str, values: dict[int, float], order: int | None = None) -> str:
    end = "" if order is None else f" {{Order {order}}}"
    groups = " ".join(
        f"{{Link {link}}} {{Value {value:.4f}}}{end}" for link, value in values.items()
    )
    return f"MISPKG {{Name {name}}} {groups}"


def _offsets(begin: list[float], links: tuple[_Link, ...]) -> dict[int, float]:
    """A place of its own for every link, near where it is and within its limits."""
    wanted = {}
    for index, (at, link) in enumerate(zip(begin, links, strict=False)):
        step = 0.06 + 0.03 * (index % 4)
        sign = -1.0 if index % 2 else 1.0
        if not math.isnan(link.high):
            step = min(step, 0.2 * (link.high - link.low))
            if not link.low <= at + sign * step <= link.high:
                sign = -sign
        wanted[index + 1] = at + sign * step
    return wanted


async def _move_arm(robot: Robot, trip: Trip) -> None:
    """Every link a little, then the last one with limits as far as it goes, both ways."""
    assert isinstance(trip, _Arm)
    trip.legs["begin"] = await ride(robot, "GETSTARTPOSES", 1.0)
    first = trip["begin"].last(lambda line: line.head in ("MISSTA", "ASTA"))
    if first is None:
        return
    trip.name = first.get("Name") or ""
    type = "MisPkg" if first.head == "MISSTA" else "Actuator"
    asked = f"{{Type {type}}} {{Name {trip.name}}}"
    trip.links = _links_of(await robot.client.ask(f"GETCONF {asked}", f"CONF {{Type {type}"))
    if type == "Actuator":
        # Speeds are told under the older name only.
        older = f"GETCONF {{Type MisPkg}} {{Name {trip.name}}}"
        speeds = _links_of(await robot.client.ask(older, "CONF {Type MisPkg"))
        trip.links = tuple(
            _Link(one.low, one.high, other.speed, one.torque)
            for one, other in zip(trip.links, speeds, strict=False)
        )
    begin = _values(first)
    wanted = _offsets(begin, trip.links)
    trip.legs["offsets"] = await ride(robot, _to(trip.name, wanted), 2.0)
    trip.legs["return"] = await ride(
        robot, _to(trip.name, {link + 1: value for link, value in enumerate(begin)}), 2.0
    )
    limited = [n for n, link in enumerate(trip.links) if not math.isnan(link.low)]
    if not limited:
        return
    end, slow = limited[-1], trip.links[limited[-1]]
    reach = (slow.high - slow.low) / max(slow.speed, 0.05) + 0.8 if slow.speed > 0 else 3.0
    if reach < 15.0:
        trip.legs["most"] = await ride(robot, _to(trip.name, {end + 1: _FAR}), reach)
        trip.legs["least"] = await ride(robot, _to(trip.name, {end + 1: -_FAR}), reach)
        middle = (slow.low + slow.high) / 2.0
        trip.legs["middle"] = await ride(robot, _to(trip.name, {end + 1: middle}), reach / 2.0)
        if trip.dialect == "ut2004":
            pace = 0.5 * min(slow.speed, 0.3) if slow.speed > 0 else 0.1
            trip.legs["paced"] = await ride(robot, _to(trip.name, {end + 1: pace}, 1), 1.5)
            trip.legs["paced back"] = await ride(robot, _to(trip.name, {end + 1: -pace}, 1), 1.5)


async def _arms(case: Case) -> list[_Arm]:
    async def arm(case: Case, class_name: str) -> _Arm:
        async def move(robot: Robot, trip: Trip) -> None:
            trip.__class__ = _Arm
            assert isinstance(trip, _Arm)
            trip.name, trip.links = "", ()
            await _move_arm(robot, trip)

        found = await on_open_floor(case, "an arm", class_name, move)
        assert isinstance(found, _Arm)
        return found

    classes = dict.fromkeys((*ARMED, case.robot_class))
    arms = [one for one in await of_classes(case, tuple(classes), arm) if one.links]
    if not arms:
        case.skip("no robot with an arm could be had")
    return arms


def _sent(trip: Trip, leg: str) -> dict[int, float]:
    words = trip[leg].command.replace("{", " ").replace("}", " ").split()
    links = [int(words[n + 1]) for n, word in enumerate(words) if word == "Link"]
    values = [float(words[n + 1]) for n, word in enumerate(words) if word == "Value"]
    return dict(zip(links, values, strict=True))


@unreal("arm.each-link", "Every link goes where it is told", "3.9, 4.9 and 6, no. 157 and 158")
async def each_link(case: Case) -> None:
    """Told a place of its own each, within its limits, every link of an arm or a camera's mount
    goes there and Value under its number tells so, with its sign."""
    for arm in await _arms(case):
        for leg in ("offsets", "return"):
            found = _values(_state(arm[leg], arm.name))
            for link, wanted in _sent(arm, leg).items():
                case.expect(
                    abs(found[link - 1] - wanted) < 0.03,
                    f"{arm.class_name}: Value of link {link} of {arm.name} is "
                    f"{found[link - 1]:.3f}, not {wanted:.3f}, after {arm[leg].command[:120]}",
                )


@unreal(
    "arm.both-limits", "Links stop at both limits of CONF", "4.8 and 6, no. 160", Severity.SHOULD
)
async def both_limits(case: Case) -> None:
    """Told to go far beyond, a link stops at MaxRange or MaxValue of CONF, and the other way at
    MinRange or MinValue."""
    judged = 0
    for arm in await _arms(case):
        for leg, side in (("most", "high"), ("least", "low")):
            if leg not in arm.legs:
                continue
            judged += 1
            (link, _), *_ = _sent(arm, leg).items()
            found = _values(_state(arm[leg], arm.name))[link - 1]
            wanted = getattr(arm.links[link - 1], side)
            words = "MaxRange (MaxValue)" if side == "high" else "MinRange (MinValue)"
            case.expect(
                abs(found - wanted) < 0.05,
                f"{arm.class_name}: link {link} of {arm.name} stops at {found:.3f}, not at "
                f"{wanted:.3f}, {words} of CONF",
            )
    if not judged:
        case.skip("no link has limits that it reaches in 15 s")


@unreal("arm.speed", "Links move at the speed of CONF", "4.8", Severity.SHOULD)
async def arm_speed(case: Case) -> None:
    """On a long way a link moves at MaxSpeed (MaxRotationSpeed) of CONF, within 15 percent."""
    judged = 0
    for arm in await _arms(case):
        if "least" not in arm.legs:
            continue
        (link, _), *_ = _sent(arm, "least").items()
        told = arm.links[link - 1].speed
        rate = _rate(arm["least"], arm.name, link)
        if not told > 0.0 or math.isnan(rate):
            continue
        judged += 1
        case.expect(
            near(-rate, told, 0.15, 0.02),
            f"{arm.class_name}: link {link} of {arm.name} moves by {rate:.3f} per s, not by "
            f"{-told:.3f}, MaxSpeed of CONF",
        )
    if not judged:
        case.skip("CONF tells no speeds")


def _rate(leg: Leg, name: str, link: int) -> float:
    """How fast a link moves in the middle half of its way, rad/s or m/s."""
    found = [
        (line.time, _values(line)[link - 1])
        for line in leg.lines
        if line.head in ("MISSTA", "ASTA") and line.get("Name") == name
    ]
    if len(found) < 4:
        return math.nan
    begin, end = found[0][1], found[-1][1]
    low, high = sorted((begin + (end - begin) * 0.2, begin + (end - begin) * 0.8))
    middle = [one for one in found if low <= one[1] <= high]
    if len(middle) < 3:
        return math.nan
    return (middle[-1][1] - middle[0][1]) / (middle[-1][0] - middle[0][0])


@ut2004("arm.order", "Order 1 is a speed", "3.9", Severity.SHOULD)
async def arm_order(case: Case) -> None:
    """`{Link i} {Value v} {Order 1}` moves a link at v, both ways, within 20 percent."""
    judged = 0
    for arm in await _arms(case):
        for leg in ("paced", "paced back"):
            if leg not in arm.legs:
                continue
            (link, wanted), *_ = _sent(arm, leg).items()
            judged += 1
            found = _rate(arm[leg], arm.name, link)
            case.expect(
                near(found, wanted, 0.2),
                f"{arm.class_name}: link {link} of {arm.name} moves by {found:.3f} per s after "
                f"{arm[leg].command}, not by {wanted:.3f}: Order 1",
            )
    if not judged:
        case.skip("no link has limits that it reaches in 15 s")


@ut2004("arm.torque", "Torque stays below MaxTorque", "4.9", Severity.SHOULD)
async def torque(case: Case) -> None:
    """Torque of MISSTA never exceeds MaxTorque of CONF, in either direction."""
    for arm in await _arms(case):
        for leg in arm.legs.values():
            for line in leg.lines:
                if line.head != "MISSTA" or line.get("Name") != arm.name:
                    continue
                found = [number(value) for name, value in line.segments if name == "Torque"]
                for link, (value, told) in enumerate(zip(found, arm.links, strict=False)):
                    case.expect(
                        abs(value) <= 1.02 * told.torque + 0.01,
                        f"{arm.class_name}: Torque of link {link + 1} of {arm.name} is {value}, "
                        f"not at most {told.torque}, MaxTorque of CONF",
                    )


# Legs.

_LEGGED = ("Nao", "ERS")
_OTHERS = ("Time", "Battery", "Type", "LightToggle", "LightIntensity", "View")


async def _move_legs(robot: Robot, trip: Trip) -> None:
    trip.legs["begin"] = await ride(robot, "GETSTARTPOSES", 0.6)
    status = trip["begin"].status
    joints = [name for name in status.names if name not in _OTHERS]
    for leg, sign in (("plus", 1.0), ("minus", -1.0)):
        for number_, name in enumerate(joints):
            angle = status.number(name) + sign * _step(number_)
            await robot.send(
                f"SET {{Type Joint}} {{Name {name}}} {{Opcode Angle}} {{Params {angle:.4f}}}"
            )
        trip.legs[leg] = await ride(robot, "GETSTARTPOSES", 1.2)


def _step(index: int) -> float:
    """rad; small, so that it does not fall, and different for neighbours."""
    return 0.05 + 0.02 * (index % 5)


@once("legged.each-joint", "Every joint by its name", "3.7, 4.4 and 6, no. 156")
async def each_joint(case: Case) -> None:
    """`SET {Type Joint} {Name j} {Opcode Angle} {Params a}` moves joint j to a, and STA tells a
    under its name; where a limit is in the way of one direction, it does in the other."""

    async def walk(case: Case, class_name: str) -> Trip:
        return await on_open_floor(case, "joints", class_name, _move_legs)

    judged = 0
    for trip in await of_classes(case, _LEGGED, walk):
        begin = trip["begin"].status
        for index, name in enumerate([one for one in begin.names if one not in _OTHERS]):
            if name == "RHipYawPitch":
                continue  # of a Nao, moved by the motor of the left one
            judged += 1
            at, step = begin.number(name), _step(index)
            plus, minus = (trip[leg].status.number(name) - at for leg in ("plus", "minus"))
            good = [abs(plus - step) < 0.02, abs(minus + step) < 0.02]
            within = -step - 0.02 < minus < 0.02 and -0.02 < plus < step + 0.02
            case.expect(
                any(good) and within,
                f"{trip.class_name}: {name} of STA was {at:.3f}, told to change by {step:g} and "
                f"{-step:g} it changed by {plus:.3f} and {minus:.3f}, not by so much, nor by less "
                "at a limit",
            )
    if not judged:
        case.skip("STA tells no joints")
