"""Where a world comes from that somebody names: the catalogue, a file or a world folder.

The catalogue has the environments that come with the benchmark: kind, shape and seed of each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from usarsim_exploration.environment import Environment
from usarsim_exploration.worlds.generators import CELL, Shape, draw
from usarsim_exploration.worlds.pictures import MAP_SERVERS, PICTURES, Rules, load_world
from usarsim_exploration.worlds.world import World, settle
from usarsim_server.base.errors import WorldError, at
from usarsim_server.base.files import is_regular
from usarsim_server.base.tables import suggest

_DEFAULT = Rules()


@dataclass(frozen=True, slots=True)
class Recipe:
    """What makes an environment.

    Attributes:
        kind: of generator. title: for people. shape, seed: what it is given.
    """

    kind: str
    title: str
    shape: Shape
    seed: int = 1

    def make(self, name: str) -> World:
        """The same for the same recipe."""
        drawing = draw(self.kind, self.shape, self.seed)
        return settle(Environment(name, drawing.walls, CELL), self.title, drawing.base)


SHIPPED: Mapping[str, Recipe] = {
    "blocks": Recipe("blocks", "Corridors around blocks: many loops", Shape(400, 400)),
    "campus": Recipe("campus", "Six office buildings around a yard", Shape(800, 600, rooms=36)),
    "cave": Recipe("cave", "Cave with chambers and narrow ways", Shape(500, 400, rooms=60)),
    "flats": Recipe("flats", "Rooms that lead to rooms", Shape(300, 300, loops=0.1)),
    "hall": Recipe("hall", "Open hall with rubble", Shape(505, 304, clutter=0.15)),
    "hospital": Recipe("hospital", "Two wings, one passage between", Shape(800, 300, rooms=36)),
    "lab": Recipe("office", "Small office", Shape(200, 150, rooms=36)),
    "maze": Recipe("maze", "Maze without a loop", Shape(310, 226, loops=0.0)),
    "mine": Recipe("mine", "Crooked drifts between chambers", Shape(600, 500, clutter=0.02)),
    "office": Recipe("office", "Office with three corridors", Shape(400, 300)),
    "pillars": Recipe("pillars", "Mine of rooms and pillars", Shape(450, 350, clutter=0.02)),
    "school": Recipe("school", "School with long corridors", Shape(700, 350, rooms=60, loops=0.0)),
    "warren": Recipe("maze", "Maze with loops", Shape(450, 310, loops=0.9)),
    "warehouse": Recipe("warehouse", "Shelves, aisles and offices", Shape(600, 400)),
}
"""By name."""


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
