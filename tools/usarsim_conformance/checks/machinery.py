"""Belts, doors and path nodes of the kit's own stage."""

from __future__ import annotations

import math

from usarsim_client import Line as WireLine
from usarsim_client import actor
from usarsim_conformance.case import PATIENCE, Case
from usarsim_conformance.control import ControlClient
from usarsim_conformance.excursions import bearer, spawn_far
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place
from usarsim_conformance.registry import Severity, once
from usarsim_conformance.side_lines import LineClient
from usarsim_conformance.stage import facts, need_stage, one_of, spot
from usarsim_conformance.walls import controller, create, status_of

_BOX = 0.4
"""m, side of what lies on the belt."""
_STARTS = 1.5
"""s in which a box has come to the speed of the belt below it."""
_RIDES = 4.0
"""s over which its speed is measured."""


async def _ride(case: Case, truth: LineClient, name: str) -> float:
    """Speed of an object along x, m/s, by the truth port."""
    told = []
    for wait in (_STARTS, _RIDES):
        await case.clock.sleep(wait)
        line = await truth.ask(f"{{class USARPhysObj.Cube}} {{name {name}}}")
        found = actor(WireLine(line.encode("latin-1")))
        case.need(found is not None, f"the truth port does not list {name}")
        assert found is not None
        case.expect(
            await truth.line() == "{End}",
            f"the truth port lists more than one object of the name {name}, not 1",
        )
        told.append(found)
    one, other = told
    case.need(
        other.time > one.time,
        f"Time of the truth port is {one.time} and then {other.time}, not more",
    )
    return (other.location[0] - one.location[0]) / (other.time - one.time)


@once("world.belt", "Belts carry at their speed", "3.14", Severity.SHOULD)
async def belt(case: Case) -> None:
    """A box on a conveyor belt moves at the belt's speed within 5 percent, by the Time and Location
    of the truth port; CONTROL Conveyor scales that speed, backwards for a negative Speed, and 0
    stops it."""
    need_stage(case, "a conveyor belt")
    if "truth" not in case.target.ports:
        case.skip("not judged: no port of truth was named, which tells where the box is, and when")
    world, truth = await controller(case), await LineClient.open(case, "truth")
    x, y, z = spot("belt", "KitBelt")
    speed = one_of("belt", "KitBelt")["speed"]
    # From the middle a box reaches neither end, however long the orders take.
    start = Place(None, (x, y, z - _BOX / 2.0 - 0.03))
    name = await create(case, world, start, (_BOX,) * 3, " {Physics RigidBody}")
    try:
        for scale in (1.0, -2.0, 0.0):
            if scale != 1.0:
                await world.send(f"CONTROL {{Type Conveyor}} {{Name KitBelt}} {{Speed {scale:g}}}")
                await status_of(world, "NoSuchObject")  # the order has been worked off then
            found, wanted = await _ride(case, truth, name), scale * speed
            case.expect(
                abs(found - wanted) <= max(0.05 * abs(wanted), 0.01),
                f"x of Location of a box on the belt changes by {found:.3f} m/s under Conveyor "
                f"Speed {scale:g}, not by {wanted:.3f}: the belt's own speed is {speed:g} m/s (file"
                " of the world; protocol reference 3.14: Speed scales it)",
            )
    finally:
        await world.send("CONTROL {Type Conveyor} {Name KitBelt} {Speed 1}")


@once("world.door", "Doors open from both sides", "docs/worlds.md: doors")
async def door(case: Case) -> None:
    """A door that opens for whoever comes lets a robot look through, from whichever side it comes
    nearer than the range of 2 m; before a robot that stands 4 m away it is shut."""
    need_stage(case, "a door that opens for whoever comes")
    class_name = await bearer(case, "RangeScanner", "GroundTruth", fixed="RangeScanner")
    x, y, _ = spot("door", "gate")
    high = case.survey.places[0].location[2]
    for side, away in ((-1.0, 4.0), (-1.0, 1.5), (1.0, 1.5)):
        yaw = 0.0 if side < 0.0 else math.pi
        place = Place(None, (x + side * away, y, high), (0.0, 0.0, yaw))
        robot = await spawn_far(case, class_name, place)
        await robot.run(3.5)
        ranges = (await robot.sensor("RangeScanner")).numbers("Range")
        robot.close()
        case.need(
            len(ranges) > 2, f"the RangeScanner tells only {len(ranges)} ranges, 3 are needed"
        )
        ahead = ranges[len(ranges) // 2]
        is_open = ahead > away + 1.0
        case.expect(
            is_open == (away < 2.0),
            f"Range straight ahead is {ahead:.2f} m, {away:g} m before the door on its "
            f"{'near' if side < 0.0 else 'far'} side (x {'below' if side < 0.0 else 'above'} "
            f"{x:g}): it is {'open' if is_open else 'shut'}, and should be "
            f"{'open' if away < 2.0 else 'shut'} (file of the world: it opens for whoever is "
            "nearer than 2 m, on both sides)",
        )
        await case.clock.sleep(4.0)  # it stays open for 2 s, and takes 3 to close


_NODES = ("KitCorner", "KitNorth")


@once("avatar.path-node", "Avatars go to path nodes", "3.13, 3.3 and 4.2", Severity.SHOULD)
async def path_node(case: Case) -> None:
    """After GOTO an avatar stands at the Location that GETPATHNODES tells of the node, within 0.3
    m, and has come by the node before it, since a block hides the goal from where it began."""
    need_stage(case, "path nodes")
    client = await case.connect()
    high = case.survey.places[0].location[2]
    x, y, _ = spot("path_node", "KitWest")
    await client.send(
        "INIT {ClassName USARAvatar.USARAvatarNewMale} "
        f"{{Name {case.new_name()}}} {{Location {x:.2f},{y:.2f},{high:.2f}}}"
    )
    if await client.maybe(lambda line: line.head == "STA", PATIENCE) is None:
        case.skip("no USARAvatarNewMale can be spawned")
    told = await _nodes(case, client)
    heard = await client.outcome(f"GOTO {{Name {_NODES[-1]}}}", seconds=13.0)
    lines = [line for line in heard if line.head == "STA"]
    case.need(
        len(lines) > 20, f"the avatar sends only {len(lines)} STA lines, more than 20 are needed"
    )
    way = [line.numbers("Location") for line in lines]
    case.expect(
        lines[-1].get("Walking") != "True",
        f"Walking is True 13 s after GOTO of a path node 10 m away, not False: Location {way[-1]}",
    )
    for node, places in zip(_NODES, (way, way[-1:]), strict=True):
        off = min(math.dist(place[:2], told[node][:2]) for place in places)
        doing = "comes by" if node != _NODES[-1] else "stands at"
        case.expect(
            off < 0.3,
            f"Location of the avatar that {doing} {node} is {off:.2f} m off {told[node]}, which "
            "GETPATHNODES tells, not 0.3 m at most (protocol reference 3.13: GOTO)",
        )


async def _nodes(case: Case, client: ControlClient) -> dict[str, tuple[float, ...]]:
    """Places of the path nodes, by tag; those of the file of the world."""
    line = await client.ask(
        "GETPATHNODES", lambda line: line.head == "NFO" and "PathNodes" in line.names
    )
    found = _listed(line)
    for node in facts()["path_node"]:
        wanted = spot("path_node", node["tag"])
        where = found.get(node["tag"], ())
        case.expect(
            len(where) == 3 and math.dist(where, wanted) < 0.01,
            f"Location of the path node {node['tag']} is {where or 'absent'}, not {wanted} (file "
            f"of the world): {line}",
        )
    return found


def _listed(line: Line) -> dict[str, tuple[float, ...]]:
    words = " ".join(f"{name} {value}" for name, value in line.segments[1:]).split()
    return {
        tag: tuple(float(part) for part in place.split(","))
        for tag, place in zip(words[0::3], words[1::3], strict=False)
    }
