"""Reads a world folder: `world.toml` and, beside it, `scene.xml` (docs/worlds.md).

The reader is strict. A key it does not know is more likely a slip than a wish, so it says so
instead of going on without; what other rooms need of a world stands in the free table `[extra]`.

Which worlds there are, and where a world named by the user lies.
"""

from __future__ import annotations

import difflib
import math
import os
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from usarsim_server.base import errors
from usarsim_server.base.errors import WorldError
from usarsim_server.base.files import COPY, Folders, data_directory, is_regular
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import read_toml
from usarsim_server.simulation.frames import flip_point
from usarsim_server.worlds.description import (
    LOWER,
    UPPER,
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
from usarsim_server.worlds.polygons import read_polygon
from usarsim_server.worlds.smoke import read_smoke
from usarsim_server.worlds.surfaces import read_surface

SHEET = "world.toml"
SCENE = "scene.xml"


FROM_BASE = {
    "level": ("level",),
    "title": ("title",),
    "description": ("description",),
    "bounds": ("lower", "upper"),
    "start": ("starts",),
    "victim": ("victims",),
    "zone": ("zones",),
    "path_node": ("path_nodes",),
    "origin": ("origin",),
    "north_degrees": ("north",),
    "time_limit": ("time_limit",),
    "extra": ("extra",),
    "rfid": ("tags",),
    "sound": ("sounds",),
    "false_alarm": ("false_alarms",),
    "smoke": ("smoke",),
    "surface": ("surfaces",),
    "object": ("objects",),
}
"""Keys, and the attributes that a world has from the one that it extends where a key is absent."""
MACHINES = ("door", "belt", "lift", "obstacle")
LONGEST_CHAIN = 8
"""Worlds that extend one another."""


def load_world(folder: Path, *, depth: int = 0) -> WorldDescription:
    """Read and check a world folder.

    Args:
        folder: holds `world.toml`, and `scene.xml` unless it extends another world; its name is
            the world's name.
        depth: how many worlds extend this one.

    Raises:
        WorldError: naming file, key, what is wrong and what to write instead.
    """
    folder = folder.resolve()
    sheet = folder / SHEET
    if not os.path.lexists(sheet):
        _missing(sheet, "the facts of the world")
    if not Folders([folder]).admit(sheet):
        raise WorldError(errors.at(sheet, "is a link that leads out of its folder", COPY))
    table = Table(read_toml(sheet, WorldError, "start"), sheet, WorldError)
    base = _base(table, folder, depth) if table.has("extends") else None
    scene = folder / SCENE
    if not os.path.lexists(scene):
        if base is None:
            _missing(scene, "its geometry (MJCF)")
        else:
            scene = base.scene
    bounds = table.table("bounds")
    lower, upper = bounds.vector("lower", LOWER), bounds.vector("upper", UPPER)
    check_corners(bounds, lower, upper)
    bounds.finish()
    starts = table.all("start", StartPose)
    if not starts and (base is None or table.has("start")):
        raise table.error("start", "there is no start pose", "add a [[start]] table with a tag")
    world = WorldDescription(
        name=folder.name,
        level=table.word("level", "_".join(folder.name.split())),
        title=table.text("title", base.title if base else None),
        description=table.text("description", "", lines=True),
        folder=folder,
        scene=scene,
        starts=starts,
        victims=table.all("victim", _victim),
        zones=table.all("zone", _zone),
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
    if base is not None:
        world = _completed(table, world, base)
    table.finish()
    _check_starts(table, world)
    _check_names(table, world)
    return world


def _missing(path: Path, holds: str) -> NoReturn:
    cure = f"a world folder has a {path.name} with {holds}"
    raise WorldError(errors.at(path, "file is missing", cure))


def _base(table: Table, folder: Path, depth: int) -> WorldDescription:
    """The world that one extends: a name, or a folder seen from this one."""
    if depth >= LONGEST_CHAIN:
        problem = f"more than {LONGEST_CHAIN} worlds extend one another"
        raise table.error("extends", problem, "extend one that stands on its own")
    name = table.text("extends")
    if len(Path(name).parts) > 1:
        name = str(folder / os.path.expanduser(name))
    try:
        return load_world(find_world(name), depth=depth + 1)
    except WorldError as error:
        problem, advice = errors.problem_and_advice(str(error))
        raise table.error("extends", problem, advice or "name another world") from error


def _completed(table: Table, world: WorldDescription, base: WorldDescription) -> WorldDescription:
    """A world with everything from its base that its own file does not say."""
    absent = [names for key, names in FROM_BASE.items() if not table.has(key)]
    if not any(map(table.has, MACHINES)):
        absent.append(("machinery",))
    inherited = {name: getattr(base, name) for names in absent for name in names}
    return replace(world, **inherited)


def _check_starts(table: Table, world: WorldDescription) -> None:
    lower, upper = world.lower, world.upper
    for number, start in enumerate(world.starts, start=1):
        limits = zip(lower, start.pose.position, upper, strict=True)
        if not all(low <= value <= high for low, value, high in limits):
            raise table.error(
                f"[[start]] {number} ({start.tag})",
                f"position {start.pose.position} lies outside the bounds {lower} to {upper}",
                "move the start or widen [bounds]",
            )


def _victim(table: Table) -> Victim:
    victim = table.read(Victim)
    traits_of(victim, table.place)
    return victim


def _zone(table: Table) -> Zone:
    if not table.has("polygon"):
        return table.read(Zone)
    for key in ("x", "y"):
        if table.has(key):
            raise table.error(key, "stands beside polygon", "keep one of the two")
    polygon = read_polygon(table, "polygon")
    x, y = ((min(axis), max(axis)) for axis in zip(*polygon, strict=True))
    return table.read(Zone, x=x, y=y, polygon=polygon)


def _object(table: Table) -> NamedObject:
    thing = table.read(NamedObject)
    return thing if thing.original else replace(thing, original=thing.name)


def _north(table: Table) -> float:
    """Wire-frame yaw of map north; the file counts degrees anticlockwise from +x."""
    angle = math.radians(table.number("north_degrees", 0.0))
    x, y, _ = flip_point((math.cos(angle), math.sin(angle), 0.0))
    return math.atan2(y, x) if angle else 0.0


def _check_names(table: Table, world: WorldDescription) -> None:
    for kind, key, things in (
        ("start", "tag", world.starts),
        ("victim", "name", world.victims),
        ("zone", "name", world.zones),
        ("path_node", "tag", world.path_nodes),
        ("surface", "name", world.surfaces),
        ("smoke", "name", (*world.smoke.volumes, *world.smoke.puffs)),
        ("rfid", "id", world.tags),
    ):
        seen: dict[str, int] = {}
        for number, name in enumerate((str(getattr(one, key)) for one in things), start=1):
            first = seen.setdefault(name.lower(), number)
            if first != number:
                raise table.error(
                    f"[[{kind}]] {number}: {key}",
                    f"{name!r} is already the {key} of number {first}",
                    f"give every [[{kind}]] its own {key}; capitals make no difference",
                )
    _check_victims_tags(table, world)
    tags = {node.tag for node in world.path_nodes}
    for number, node in enumerate(world.path_nodes, start=1):
        for neighbour in node.neighbours:
            if neighbour not in tags:
                raise table.error(
                    f"[[path_node]] {number} ({node.tag}): neighbours",
                    f"neighbour {neighbour!r} is no path node",
                    "write the tag of another [[path_node]]",
                )


def _check_victims_tags(table: Table, world: WorldDescription) -> None:
    taken = {tag.id: "an [[rfid]]" for tag in world.tags}
    for number, victim in enumerate(world.victims, start=1):
        tag = traits_of(victim).tag
        if isinstance(tag, bool):
            continue
        if tag in taken:
            raise table.error(
                f"[[victim]] {number}: properties: rfid",
                f"{tag} is already the id of {taken[tag]}",
                "write another number, or rfid = true",
            )
        taken[tag] = f"victim {victim.name}"


DEFAULT_WORLD = "arena"
"""The world of a server that was told nothing."""


def find_world(name_or_path: str) -> Path:
    """Return the folder of a world.

    Args:
        name_or_path: path of a world folder (anything with a separator, or a folder that holds
            a `world.toml`), or the name of a shipped world, in any case.

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
    by_lower = {folder.name.lower(): folder for folder in _shipped()}
    found = by_lower.get(name_or_path.lower())
    if found is None:
        close = difflib.get_close_matches(name_or_path.lower(), by_lower, n=1)
        hint = f"did you mean {by_lower[close[0]].name}? " if close else ""
        names = ", ".join(folder.name for folder in by_lower.values()) or "none"
        raise WorldError(f"{name_or_path}: no such world (cure: {hint}known worlds: {names})")
    return found


def list_worlds() -> list[WorldDescription]:
    """Load all shipped worlds, sorted by name.

    Raises:
        WorldError: if one of them is broken.
    """
    return [load_world(folder) for folder in _shipped()]


def _shipped() -> list[Path]:
    """World folders that come with the server, sorted by name."""
    directory = data_directory("worlds")
    folders = sorted(directory.iterdir()) if directory.is_dir() else []
    return [folder for folder in folders if is_regular(folder / SHEET)]
