"""Where a world comes from that somebody names: the catalogue, a file or a world folder."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from usarsim_exploration.worlds.catalogue import SHIPPED
from usarsim_exploration.worlds.pictures import MAP_SERVERS, PICTURES, Rules, load_world
from usarsim_exploration.worlds.world import World
from usarsim_server.base.errors import WorldError, at
from usarsim_server.base.files import is_regular
from usarsim_server.base.tables import suggest

_DEFAULT = Rules()


def names() -> list[str]:
    """Of the environments that come with the benchmark."""
    return sorted(SHIPPED)


def find(name_or_path: str, rules: Rules = _DEFAULT) -> World:
    """A world by its name, or from a file.

    Args:
        name_or_path: one of `names`; a picture, a text file, the YAML file of a ROS map; a world
            folder or the name of one that the server ships, which is cut at the height of a
            scanner.
        rules: for files.

    Raises:
        WorldError: there is none, or it cannot be used.
    """
    if name_or_path in SHIPPED:
        return _shipped(name_or_path)
    # only now: they bring MuJoCo, 20 MiB that shipped environments do without
    from usarsim_exploration.worlds.slicing import slice_world
    from usarsim_server.worlds.loader import SHEET

    path = Path(name_or_path).expanduser()
    if is_regular(path / SHEET):
        return slice_world(path, rules)
    if not is_regular(path):
        return slice_world(_shipped_folder(path), rules)
    if path.suffix.lower() not in (*PICTURES, *MAP_SERVERS, ".txt"):
        cure = f"give a file that ends in {', '.join(PICTURES)}, .yaml or .txt"
        raise WorldError(at(path, "neither picture nor text", cure))
    return load_world(path, rules)


def _shipped_folder(path: Path) -> Path:
    """Of a world that the server ships."""
    if len(path.parts) != 1:
        cure = f"give a map, a world folder, or one of {', '.join(names())}"
        raise WorldError(at(path, "no such file or world folder", cure))
    from usarsim_server.worlds.loader import find_world

    try:
        return find_world(path.name)
    except WorldError:
        cure = suggest(path.name, names())
        raise WorldError(at(path, "no such environment", cure)) from None


@lru_cache(maxsize=16)
def _shipped(name: str) -> World:
    return SHIPPED[name].make(name)
