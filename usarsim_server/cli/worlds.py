"""`usarsim worlds`: what worlds there are, and what is in one of them."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from usarsim_server.cli.common import (
    Subparsers,
    add_command,
    facts,
    number,
    numbers,
    paragraph,
    table,
)
from usarsim_server.simulation.frames import Pose, flip_point, wire_from_pose
from usarsim_server.simulation.ground import Surface
from usarsim_server.worlds.description import Smoke, WorldDescription, Zone
from usarsim_server.worlds.machinery.machinery import Machinery, Spring


def add_parser(subparsers: Subparsers) -> None:
    """Add `worlds` to the command line."""
    parser = add_command(subparsers, "worlds", "list the worlds, or describe one", run)
    parser.add_argument("name", metavar="NAME|PATH", nargs="?", help="world to describe")


def run(arguments: argparse.Namespace) -> int:
    """Print the list, or the details of one world."""
    from usarsim_server.worlds.loader import find_world, list_worlds, load_world

    if arguments.name is None:
        print(listing(list_worlds()))
    else:
        print("\n\n".join(details(load_world(find_world(arguments.name)))))
    return 0


def listing(worlds: list[WorldDescription]) -> str:
    """One line per world."""
    rows = [
        (world.name, len(world.starts), len(world.victims), world.title)
        for world in sorted(worlds, key=lambda world: world.name.lower())
    ]
    return table(("NAME", "STARTS", "VICTIMS", "TITLE"), rows)


def details(world: WorldDescription) -> Iterator[str]:
    """Blocks that describe a world; places are written as INIT takes them."""
    yield f"{world.name}: {world.title}"
    if world.description:
        yield paragraph(world.description)
    yield facts(
        [
            ("folder", world.folder),
            ("level", world.level),
            ("time limit", f"{world.time_limit} min" if world.time_limit else "none"),
            ("victims", len(world.victims)),
            ("path nodes", len(world.path_nodes)),
        ]
    )
    yield "Places are in the wire frame: x forward, y right, z down, in metres and radians."
    if world.starts:
        rows = [(start.tag, *_place(start.pose)) for start in world.starts]
        yield table(("START", "LOCATION", "ROTATION"), rows)
    if world.victims:
        people = [(v.name, v.posture, v.status, _place(v.pose)[0]) for v in world.victims]
        yield table(("VICTIM", "POSTURE", "STATUS", "LOCATION"), people)
    if world.zones:
        areas = [(zone.name, zone.kind, *_limits(zone)) for zone in world.zones]
        yield table(("ZONE", "KIND", "X", "Y"), areas)
    if not world.smoke.clear:
        yield table(("SMOKE", "KIND", "DENSITY", "LOCATION"), _smoke(world.smoke))
    if world.surfaces:
        patches = [
            (s.name, s.kind, s.friction, s.drag, s.sinkage, *_limits(s)) for s in world.surfaces
        ]
        yield table(("GROUND", "KIND", "FRICTION", "DRAG", "SINKAGE", "X", "Y"), patches)
    machines = list(_machines(world.machinery))
    if machines:
        yield table(("MACHINE", "KIND", "MOVES", "LOCATION"), machines)


def _machines(machinery: Machinery) -> Iterator[tuple[str, str, str, str]]:
    for door in machinery.doors:
        kind = "sliding door" if door.sliding else "hinged door"
        moves = "when pushed" if isinstance(door.mechanism, Spring) else "by itself"
        yield door.name, kind, moves, _place(door.pose)[0]
    for belt in machinery.belts:
        yield belt.tag, "belt", f"{belt.speed:g} m/s", _place(belt.pose)[0]
    for lift in machinery.lifts:
        moves = "with a load" if lift.called else "by itself"
        yield lift.name, "lift", moves, numbers(flip_point(lift.stops[0]))
    for obstacle in machinery.obstacles:
        yield obstacle.name, "obstacle", obstacle.way, numbers(flip_point(obstacle.points[0]))


def _smoke(smoke: Smoke) -> Iterator[tuple[str, str, str, str]]:
    for volume in smoke.volumes:
        density = f"{volume.density:g}"
        yield volume.name, "regional", density, numbers(flip_point(volume.pose.position))
    for puff in smoke.puffs:
        yield puff.name, "local", "", numbers(flip_point(puff.position))
    if smoke.haze:
        yield "", "global", f"{smoke.haze:g}", "everywhere"


def _place(pose: Pose) -> tuple[str, str]:
    location, rotation = wire_from_pose(pose)
    return numbers(location), numbers(rotation, 4)


def _limits(zone: Zone | Surface) -> tuple[str, str]:
    corners = [flip_point((x, y, 0.0)) for x, y in zip(zone.x, zone.y, strict=True)]
    x, y = (sorted(corner[axis] for corner in corners) for axis in (0, 1))
    return " to ".join(map(number, x)), " to ".join(map(number, y))
