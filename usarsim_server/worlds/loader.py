"""Reads a world folder: `world.toml` and, beside it, `scene.xml` (docs/worlds.md).

The reader is strict. A key it does not know is more likely a slip than a wish, so it says so
instead of going on without; what other rooms need of a world stands in the free table `[extra]`.

Which worlds there are, and where a world named by the user lies.
"""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from usarsim_server import errors
from usarsim_server.errors import WorldError
from usarsim_server.files import data_directory, is_regular
from usarsim_server.simulation.frames import (
    Pose,
    Vector,
    flip_point,
)
from usarsim_server.tables import Table
from usarsim_server.toml import read_toml
from usarsim_server.worlds.description import (
    GeographicOrigin,
    NamedObject,
    PathNode,
    RfidTag,
    StartPose,
    Victim,
    WorldDescription,
    Zone,
)
from usarsim_server.worlds.life import check_corners, read_false_alarm, read_sound, traits_of
from usarsim_server.worlds.machinery.machinery import read_machinery
from usarsim_server.worlds.smoke import read_smoke, read_surface

SHEET = "world.toml"
SCENE = "scene.xml"

_LOWER: Vector = (-1000.0, -1000.0, -50.0)
_UPPER: Vector = (1000.0, 1000.0, 200.0)
"""Bounds of a world that names none, as in `WorldDescription`."""


def load_world(folder: Path) -> WorldDescription:
    """Read and check a world folder.

    Args:
        folder: holds `world.toml` and `scene.xml`; its name is the world's name.

    Raises:
        WorldError: naming file, key, what is wrong and what to write instead.
    """
    folder = folder.resolve()
    sheet = folder / SHEET
    scene = folder / SCENE
    for path, holds in ((sheet, "the facts of the world"), (scene, "its geometry (MJCF)")):
        if not os.path.lexists(path):
            raise WorldError(
                errors.at(path, "file is missing", f"a world folder has a {path.name} with {holds}")
            )
    table = Table(read_toml(sheet, WorldError, "start"), sheet, WorldError)
    bounds = table.table("bounds")
    lower, upper = bounds.vector("lower", _LOWER), bounds.vector("upper", _UPPER)
    check_corners(bounds, lower, upper)
    bounds.finish()
    starts = table.all("start", StartPose)
    if not starts:
        raise table.error("start", "there is no start pose", "add a [[start]] table with a tag")
    for number, start in enumerate(starts, start=1):
        _check_inside(table, f"[[start]] {number} ({start.tag})", start.pose, lower, upper)
    world = WorldDescription(
        name=folder.name,
        level=table.word("level", "_".join(folder.name.split())),
        title=table.text("title"),
        description=table.text("description", "", lines=True),
        folder=folder,
        scene=scene,
        starts=starts,
        victims=table.all("victim", _victim),
        zones=table.all("zone", Zone),
        path_nodes=table.all("path_node", PathNode),
        origin=table.one("origin", GeographicOrigin),
        north=_north(table),
        time_limit=table.count("time_limit", 20, low=0, high=1_000_000),
        lower=lower,
        upper=upper,
        extra=table.free("extra"),
        tags=table.all("rfid", RfidTag),
        sounds=table.all("sound", read_sound),
        false_alarms=table.all("false_alarm", read_false_alarm),
        smoke=read_smoke(table.tables("smoke")),
        surfaces=table.all("surface", read_surface),
        objects=table.all("object", _object),
        machinery=read_machinery(table),
    )
    table.finish()
    _check_names(table, world)
    return world


def _victim(table: Table) -> Victim:
    victim = table.read(Victim)
    traits_of(victim, table.place)
    return victim


def _object(table: Table) -> NamedObject:
    thing = table.read(NamedObject)
    return thing if thing.original else replace(thing, original=thing.name)


def _north(table: Table) -> float:
    """Wire-frame yaw of map north; the file counts degrees anticlockwise from +x."""
    angle = math.radians(table.number("north_degrees", 0.0))
    x, y, _ = flip_point((math.cos(angle), math.sin(angle), 0.0))
    return math.atan2(y, x) if angle else 0.0


def _check_inside(table: Table, where: str, pose: Pose, lower: Vector, upper: Vector) -> None:
    limits = zip(lower, pose.position, upper, strict=True)
    if not all(low <= value <= high for low, value, high in limits):
        problem = f"position {pose.position} lies outside the bounds {lower} to {upper}"
        raise WorldError(
            errors.at(table.path, problem, "move the start or widen [bounds]", where=where)
        )


def _check_names(table: Table, world: WorldDescription) -> None:
    _check_unique(table, "start", "tag", (start.tag for start in world.starts))
    _check_unique(table, "victim", "name", (victim.name for victim in world.victims))
    _check_unique(table, "zone", "name", (zone.name for zone in world.zones))
    _check_unique(table, "path_node", "tag", (node.tag for node in world.path_nodes))
    _check_unique(table, "surface", "name", (surface.name for surface in world.surfaces))
    smoke = [volume.name for volume in world.smoke.volumes]
    _check_unique(table, "smoke", "name", smoke + [puff.name for puff in world.smoke.puffs])
    _check_unique(table, "rfid", "id", (str(tag.id) for tag in world.tags))
    _check_victims_tags(table, world)
    tags = {node.tag for node in world.path_nodes}
    for number, node in enumerate(world.path_nodes, start=1):
        for neighbour in node.neighbours:
            if neighbour not in tags:
                raise WorldError(
                    errors.at(
                        table.path,
                        f"neighbour {neighbour!r} is no path node",
                        "write the tag of another [[path_node]]",
                        where=f"[[path_node]] {number} ({node.tag}): neighbours",
                    )
                )


def _check_victims_tags(table: Table, world: WorldDescription) -> None:
    taken = {tag.id: "an [[rfid]]" for tag in world.tags}
    for number, victim in enumerate(world.victims, start=1):
        tag = traits_of(victim).tag
        if isinstance(tag, bool):
            continue
        if tag in taken:
            raise WorldError(
                errors.at(
                    table.path,
                    f"{tag} is already the id of {taken[tag]}",
                    "write another number, or rfid = true",
                    where=f"[[victim]] {number}: properties: rfid",
                )
            )
        taken[tag] = f"victim {victim.name}"


def _check_unique(table: Table, kind: str, key: str, names: Iterable[str]) -> None:
    seen: dict[str, int] = {}
    for number, name in enumerate(names, start=1):
        first = seen.setdefault(name.lower(), number)
        if first != number:
            raise WorldError(
                errors.at(
                    table.path,
                    f"{name!r} is already the {key} of number {first}",
                    f"give every [[{kind}]] its own {key}; capitals make no difference",
                    where=f"[[{kind}]] {number}: {key}",
                )
            )


DEFAULT_WORLD = "arena"
"""The world of a server that was told nothing."""


def find_world(name_or_path: str, extra: Sequence[Path] = ()) -> Path:
    """Return the folder of a world.

    Args:
        name_or_path: path of a world folder (anything with a separator, or a folder that holds
            a `world.toml`), or a world's name, in any case.
        extra: folders of worlds that are searched before the shipped ones.

    Raises:
        WorldError: if there is none; the message lists the names that would do.
    """
    path = Path(name_or_path).expanduser()
    if is_regular(path / SHEET):
        return path
    if len(path.parts) != 1 or path.is_absolute():
        raise WorldError(
            f"{name_or_path}: not a world folder (cure: name a folder that holds {SHEET}; "
            "docs/worlds.md says how to make one)"
        )
    known = {folder.name: folder for folder in reversed(list(_folders(extra)))}
    by_lower = {name.lower(): folder for name, folder in known.items()}
    found = known.get(name_or_path) or by_lower.get(name_or_path.lower())
    if found is None:
        close = difflib.get_close_matches(name_or_path.lower(), by_lower, n=1)
        hint = f"did you mean {by_lower[close[0]].name}? " if close else ""
        names = ", ".join(sorted(known)) or "none"
        raise WorldError(f"{name_or_path}: no such world (cure: {hint}known worlds: {names})")
    return found


def list_worlds(extra: Sequence[Path] = ()) -> list[WorldDescription]:
    """Load all worlds of the extra folders and the shipped ones, sorted by name.

    A world in an extra folder hides a shipped one of the same name.

    Raises:
        WorldError: if one of them is broken.
    """
    known = {folder.name: folder for folder in reversed(list(_folders(extra)))}
    return [load_world(known[name]) for name in sorted(known)]


def _folders(extra: Sequence[Path]) -> Iterator[Path]:
    """World folders in order of precedence."""
    for directory in (*extra, data_directory("worlds")):
        if directory.is_dir():
            yield from (
                folder for folder in sorted(directory.iterdir()) if is_regular(folder / SHEET)
            )
