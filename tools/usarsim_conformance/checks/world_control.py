"""World controllers (protocol reference 6.10) and people who walk (protocol 3.13, 4.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

from usarsim_conformance.case import PATIENCE, Case
from usarsim_conformance.control import ControlClient, turned
from usarsim_conformance.grounds import open_floor
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place
from usarsim_conformance.registry import NotApplicable, Severity, once
from usarsim_conformance.walls import controller, status_of

_HIGH = -40.0
"""m, wire z of the objects that checks create, out of every robot's way."""


async def _gone(client: ControlClient, name: str) -> bool:
    return (await status_of(client, name)).text == "STA"


def _row(case: Case) -> float:
    """A y of its own for every object: none is created where another one is."""
    return 2.0 * next(case.run.numbers)


async def _create(
    case: Case,
    client: ControlClient,
    x: float = 0.0,
    *,
    name: str = "",
    y: float | None = None,
    z: float = _HIGH,
    permanent: bool = False,
) -> tuple[str, float]:
    """An object at x; its name and its y, both its own unless given."""
    name, y = name or case.new_name(), _row(case) if y is None else y
    await client.send(
        f"CONTROL {{Type Create}} {{ClassName Box}} {{Name {name}}} {{Memory red}}"
        f" {{Location {x},{y},{z}}} {{Rotation 0,0,0}} {{Physics None}}"
        f" {{Permanent {'true' if permanent else 'false'}}}"
    )
    return name, y


async def _created(case: Case) -> tuple[ControlClient, str, float]:
    client = await controller(case)
    name, y = await _create(case, client)
    line = await status_of(client, name)
    if line.get("Name") != name:
        case.skip(f"no object of class Box could be created: {line}")
    return client, name, y


@once("world.silent", "CONTROL answers nothing but GetSTA", "3.14")
async def silent(case: Case) -> None:
    """Create, AbsMove and Kill have no reply."""
    client, name, y = await _created(case)
    lines = await client.outcome(
        f"CONTROL {{Type AbsMove}} {{Name {name}}} {{Location 1,{y},{_HIGH}}} {{Rotation 0,0,0}}",
        f"CONTROL {{Type Kill}} {{Name {name}}}",
        "CONTROL {Type NoSuchType}",
        "CONTROL",
    )
    case.expect_silence(lines, "AbsMove, Kill and unknown CONTROL")


@once("world.no-controller", "CONTROL needs a world controller", "6, no. 167")
async def nocontroller(case: Case) -> None:
    """CONTROL is ignored on a connection of a robot."""
    robot = await case.spawn()
    lines = await robot.client.outcome("CONTROL {Type GetSTA}")
    found = [line for line in lines if line.head == "STA" and "Size" in line.text]
    case.expect_silence(found, "CONTROL of a robot")


@once("world.moves", "Objects are created, moved and killed", "6, no. 168")
async def moves(case: Case) -> None:
    """After Create, AbsMove and RelMove GetSTA tells the new place; after Kill a bare `STA`."""
    client, name, y = await _created(case)
    await client.send(
        f"CONTROL {{Type AbsMove}} {{Name {name}}} {{Location 2,{y},{_HIGH}}} {{Rotation 0,0,0}}",
        f"CONTROL {{Type RelMove}} {{Name {name}}} {{Location 1,0,0}} {{Rotation 0,0,0}}",
    )

    places: list[tuple[float, ...]] = []

    async def moved() -> bool:
        places.append(at := (await status_of(client, name)).numbers("Location"))
        return len(at) == 3 and math.dist(at, (3.0, y, _HIGH)) < 0.05

    there = await case.soon(moved, 3.0)
    case.expect(
        there, f"Location of {name} is {places[-1]} after AbsMove and RelMove, not 3,{y},{_HIGH}"
    )
    await client.send(f"CONTROL {{Type Kill}} {{Name {name}}}")
    case.expect(
        await case.soon(partial(_gone, client, name), 3.0),
        f"Name {name} is listed 3 s after Kill, not gone",
    )


@once("world.form", "GetSTA has balanced braces", "6, no. 171", Severity.SHOULD)
async def form(case: Case) -> None:
    """GetSTA tells Name, Size, Location, Memory, Rotation, each in braces of its own, sizes above
    zero."""
    client, name, _ = await _created(case)
    line = await status_of(client, name)
    case.expect(
        line.text.count("{") == line.text.count("}"), f"braces of GetSTA do not match: {line}"
    )
    case.expect_names(line, ("Name", "Size", "Location", "Memory", "Rotation"))
    case.expect(
        all(size > 0.0 for size in line.numbers("Size")),
        f"Size is {line.get('Size')}, not above 0: {line}",
    )


@once("world.same-name", "A name is taken once", "6, no. 169")
async def same_name(case: Case) -> None:
    """Creating an existing name leaves the first object untouched."""
    client, name, y = await _created(case)
    await client.send(
        f"CONTROL {{Type Create}} {{ClassName Box}} {{Name {name}}} {{Location 9,{y},{_HIGH}}}"
    )
    await client.listen(0.3)
    line = await status_of(client, name)
    case.expect(
        abs(line.numbers("Location")[0]) < 0.1,
        f"Location of {name} is {line.get('Location')} after Create of the same name at x 9, not "
        f"at x 0 as before: {line}",
    )


@once("world.name-again", "A name is free after Kill", "3.14", Severity.SHOULD)
async def name_again(case: Case) -> None:
    """After Kill an object of the same name can be created, also somewhere else, and again."""
    client, name, y = await _created(case)
    for x in (3.0, 6.0):
        await client.send(f"CONTROL {{Type Kill}} {{Name {name}}}")
        gone = await case.soon(partial(_gone, client, name), 3.0)
        case.need(gone, "Kill removes nothing")
        await _create(case, client, x, name=name, y=y)
        line = await status_of(client, name)
        at = line.numbers("Location")
        case.expect(
            line.get("Name") == name and len(at) == 3 and abs(at[0] - x) < 0.1,
            f"Name {name} is not created at {x:g},{y:g},{_HIGH:g} after Kill of an object of that "
            f"name: GetSTA tells {line.text} (protocol reference 3.14: refused if the name exists)",
        )


@once("world.kill-all", "KillAll with a box", "6, no. 170", exclusive=True)
async def kill_all(case: Case) -> None:
    """KillAll with a box removes only objects strictly inside, whichever corner comes first, on all
    axes; permanent ones stay, also without a box."""
    client, inside, y = await _created(case)
    others = {"outside the box along x": (await _create(case, client, x=5.0, y=y))[0]}
    others["outside the box along y"], _ = await _create(case, client, y=y + 3.0)
    others["outside the box along z"], _ = await _create(case, client, y=y, z=_HIGH - 3.0)
    permanent, _ = await _create(case, client, x=0.8, y=y, permanent=True)
    for name in (*others.values(), permanent):
        line = await status_of(client, name)
        case.need(line.get("Name") == name, f"an object beside others is not created: {line}")
    corners = f"{{MinPos 2,{y + 1},{_HIGH + 1}}} {{MaxPos -1,{y - 1},{_HIGH - 1}}}"
    await client.send(f"CONTROL {{Type KillAll}} {corners}")
    inside_gone = await case.soon(partial(_gone, client, inside), 3.0)
    case.expect(
        inside_gone,
        f"Name {inside} is listed after KillAll with {corners}, not gone: the object was inside "
        "the box",
    )
    for where, name in {**others, "inside the box and Permanent": permanent}.items():
        line = await status_of(client, name)
        case.expect(
            line.get("Name") == name,
            f"Name {name} is gone after KillAll with {corners}, not still listed: the object was "
            f"{where} (protocol reference 3.14)",
        )
    await client.send("CONTROL {Type KillAll}")
    for name in others.values():
        gone = await case.soon(partial(_gone, client, name), 3.0)
        case.expect(gone, f"Name {name} is listed after KillAll without a box, not gone")
    line = await status_of(client, permanent)
    case.expect(
        line.get("Name") == permanent,
        f"Name {permanent} is gone after KillAll, not still listed: it was created with Permanent "
        "true (protocol reference 3.14)",
    )


@once("world.cleans-up", "Objects leave with their controller", "6, no. 172", Severity.SHOULD)
async def cleans_up(case: Case) -> None:
    """Closing the world controller's connection removes its objects."""
    client, name, _ = await _created(case)
    client.close()
    other = await controller(case)
    gone = await case.soon(partial(_gone, other, name), 3.0)
    case.expect(
        gone, f"Name {name} is listed 3 s after the connection of its controller ended, not gone"
    )


_CLASS = "USARAvatarNewMale"


@dataclass
class _Walk:
    """STA lines under each order, and where the avatar was put."""

    place: Place
    orders: dict[str, list[Line]]
    goals: dict[str, tuple[float, float]]


async def _walk(case: Case) -> _Walk:
    found = await case.shared("an avatar's walk", _take_a_walk, dialect="")
    if isinstance(found, NotApplicable):
        raise found
    return found


async def _take_a_walk(case: Case) -> _Walk | NotApplicable:
    try:
        async with open_floor(case) as lot:
            return await _order(case, lot)
    except NotApplicable as error:
        return error


async def _order(case: Case, lot: Place) -> _Walk:
    client = await case.connect()
    await client.send(
        f"INIT {{ClassName USARAvatar.{_CLASS}}} {{Name {case.new_name()}}} {lot.coordinates}"
    )
    first = await client.maybe(lambda line: line.head == "STA", PATIENCE)
    if first is None:
        return NotApplicable(f"no {_CLASS} can be spawned")  # type: ignore[return-value]
    walk = _Walk(lot, {}, {})

    def aimed(name: str, command: str, goal: tuple[float, float]) -> str:
        x, y = (a + b for a, b in zip(lot.location[:2], goal, strict=True))
        walk.goals[name] = (x, y)
        return command.replace("<goal>", f"{{Location {x:.2f},{y:.2f}}}")

    async def order(name: str, command: str, goal: tuple[float, float], seconds: float) -> None:
        await client.send(aimed(name, command, goal))
        await client.outcome(seconds=0.1)
        walk.orders[name] = await _watch(client, seconds)

    here = (0.0, 0.0)
    await order("stands", "MOVE {Action Pause}", here, 0.5)
    await order("walks", "MOVE {Type Walk_Forward} {Action New} <goal>", (7.0, 3.5), 2.2)
    await order("pauses", "MOVE {Action Pause}", here, 1.0)
    await order("resumes", "MOVE {Action Resume}", (7.0, 3.5), 1.0)
    await order("runs", "MOVE {Type Run} {Action New} <goal>", (-5.0, -6.0), 2.4)
    await order("backs", "MOVE {Type Walk_Backward} {Action New} <goal>", (4.0, -6.0), 2.4)
    # In one piece: the second order comes before the first one is done, however slow the machine.
    # The first place is 3 m off every straight way from where it can be by now to the second.
    goes = aimed("goes", "MOVE {Type Run} {Action New} <goal>", (-1.0, 1.0))
    both = f"{goes}\r\nMOVE {{Type Run}} {{Action Append}} <goal>"
    await order("appends", both, (1.0, -3.0), 9.2)
    return walk


async def _watch(client: ControlClient, seconds: float) -> list[Line]:
    return [line for line in await client.listen(seconds) if line.head == "STA"]


def _place(line: Line) -> tuple[float, ...]:
    return line.numbers("Location")


def _speed(lines: list[Line]) -> float:
    """m/s over the later half."""
    first, last = lines[len(lines) // 2], lines[-1]
    return math.dist(_place(first)[:2], _place(last)[:2]) / max(last.time - first.time, 1e-3)


def _heading(lines: list[Line]) -> float:
    """rad, where it goes over the later half."""
    (ax, ay, _), (bx, by, _) = _place(lines[len(lines) // 2]), _place(lines[-1])
    return math.atan2(by - ay, bx - ax)


def _towards(lines: list[Line], goal: tuple[float, float]) -> float:
    x, y, _ = _place(lines[len(lines) // 2])
    return math.atan2(goal[1] - y, goal[0] - x)


@once("avatar.walks", "Avatars walk to the Location", "3.13", Severity.SHOULD)
async def walks(case: Case) -> None:
    """An avatar goes straight to the Location of MOVE, walking, running or backwards, and Location
    of STA tells so on both axes; running is faster than walking, both are what people do."""
    walk = await _walk(case)
    for order in ("walks", "runs", "backs"):
        lines = walk.orders[order]
        case.need(
            len(lines) > 5,
            f"the avatar sends only {len(lines)} STA lines as it {order}, more than 5 are needed",
        )
        speed = _speed(lines)
        case.expect(
            0.3 < speed < 7.0,
            f"Location of STA changes by {speed:.2f} m/s as it {order}, not by 0.3 to 7 m/s",
        )
        off = turned(_towards(lines, walk.goals[order]), _heading(lines))
        case.expect(
            abs(off) < 0.2,
            f"Location of STA shows that it {order} {off:.2f} rad to the right of where it "
            "should, not less than 0.2 rad",
        )
    speeds = [_speed(walk.orders[order]) for order in ("walks", "runs")]
    case.expect(
        speeds[1] > 1.2 * speeds[0],
        f"running is {speeds[1]:.2f} m/s, not more than 1.2 times the {speeds[0]:.2f} m/s of "
        "walking: Type Run",
    )


@once("avatar.faces", "Avatars face where they go", "3.13 and 4.4", Severity.SHOULD)
async def faces(case: Case) -> None:
    """The yaw of an avatar's Orientation is where it goes, turned about for Walk_Backward."""
    walk = await _walk(case)
    for order, about in (("walks", 0.0), ("runs", 0.0), ("backs", math.pi)):
        lines = walk.orders[order]
        yaw = lines[-1].numbers("Orientation")[2]
        off = turned(_heading(lines) + about, yaw)
        case.expect(
            abs(off) < 0.25,
            f"yaw of Orientation is {off:.2f} rad off the way as it {order}, not less than 0.25 "
            "rad",
        )


@once("avatar.status", "Walking tells whether it walks", "3.13 and 4.4", Severity.SHOULD)
async def status(case: Case) -> None:
    """Walking of STA is True while an avatar goes and False while it stands; Pause stops it on the
    spot, Resume lets it go on to the same place."""
    walk = await _walk(case)
    for order, wanted in (
        ("stands", "False"), ("walks", "True"), ("pauses", "False"), ("resumes", "True"),
        ("runs", "True"), ("appends", "False"),
    ):  # fmt: skip
        found = walk.orders[order][-1].get("Walking")
        case.expect(found == wanted, f"Walking is {found} after the order {order!r}, not {wanted}")
    still = _speed(walk.orders["pauses"])
    case.expect(
        still < 0.05,
        f"Location of STA changes by {still:.2f} m/s while it pauses, not by less than 0.05 m/s",
    )
    lines = walk.orders["resumes"]
    off = turned(_towards(lines, walk.goals["resumes"]), _heading(lines))
    case.expect(
        abs(off) < 0.3,
        f"Location of STA goes {off:.2f} rad aside of its way after Resume, not less than 0.3 rad",
    )


@once("avatar.appends", "Append comes after", "3.13", Severity.SHOULD)
async def appends(case: Case) -> None:
    """MOVE with Action Append is done after what was ordered before: an avatar comes by the first
    Location and ends at the second, standing on the floor."""
    walk = await _walk(case)
    lines = walk.orders["appends"]
    first, last = walk.goals["goes"], walk.goals["appends"]
    nearest = min(math.dist(_place(line)[:2], first) for line in lines)
    case.expect(
        nearest < 0.4,
        f"Location of STA comes no nearer than {nearest:.2f} m to the first place, not within 0.4 "
        "m",
    )
    off = math.dist(_place(lines[-1])[:2], last)
    case.expect(
        off < 0.3, f"Location of STA ends {off:.2f} m from the place of Append, not within 0.3 m"
    )
