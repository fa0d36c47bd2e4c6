"""Environments of map files: pictures, text, YAML files of map servers.

A file is read as `usarsim import` reads it. Only MRESim's rules (`compat`; exploration reference
3.1 and 3.2) differ from what a picture shows: a cell is a wall exactly where the first sample of
the pixel is 0, and what is smaller than its world of 800 x 600 stands in the middle of free space.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Environment
from usarsim_exploration.worlds.world import World, scale_of, settle
from usarsim_maps.files import open_picture
from usarsim_server.base.errors import WorldError, at
from usarsim_server.base.files import Folders, replacing, write_text

if TYPE_CHECKING:
    from usarsim_maps.grids.occupancy import GridMap

CANVAS = (800, 600)
"""Columns and rows of MRESim's world."""
LARGEST = (2000, 2000)
CELL = 0.1
"""m that a cell is wide of maps that do not say it."""
COMPAT_CELL = 1 / 13
"""m that one of MRESim's is wide (exploration reference 1)."""
_SMALLER = "make the map smaller, by half for example, and its cells twice as wide (`cell`)"
MAP_SERVERS = (".yaml", ".yml")
"""Endings of the files that map servers write beside a picture."""
PICTURES = (".png", ".pgm", ".bmp", ".gif", ".jpg", ".jpeg")


@dataclass(frozen=True, slots=True)
class Rules:
    """How to read a map.

    Attributes:
        compat: as MRESim does.
        canvas: columns and rows of the world in whose middle a smaller map is put, with walls
            around it; None: the world is as large as the map.
        limit: columns and rows of the largest map.
        cell: width of a cell, m; None: as the file or the form says.
        bodies: robots have some: distances that places keep are metres.
    """

    compat: bool = False
    canvas: tuple[int, int] | None = None
    limit: tuple[int, int] = LARGEST
    cell: float | None = None
    bodies: bool = False

    def scale(self, cell: float) -> float:
        """See `start_around`. cell: width of one, m."""
        return scale_of(cell) if self.bodies else 1.0


def load_world(path: Path, rules: Rules) -> World:
    """The world of a map file; the base stands near the map's origin, if that is stated and inside.

    Raises:
        WorldError: naming the file, what is wrong, and the cure.
    """
    if rules.compat and path.suffix.lower() not in MAP_SERVERS:
        environment = _as_mresim(path, rules)
        return settle(environment, path.stem, scale=rules.scale(environment.cell))
    # only now: it brings MuJoCo, 20 MiB that shipped environments do without
    from usarsim_maps.grids.occupancy import load_grid
    from usarsim_maps.reader import Context

    context = Context(folders=Folders([path.parent]))
    grid = load_grid(path, context)
    environment = _environment(path, grid, rules)
    wanted = None
    if grid.wanted is not None:
        (x, y), (rows, columns) = grid.wanted, grid.free.shape
        column, row = math.floor(x / grid.size), rows - 1 - math.floor(y / grid.size)
        if 0 <= column < columns and 0 <= row < rows:
            all_rows, all_columns = environment.shape
            wanted = column + (all_columns - columns) // 2, row + (all_rows - rows) // 2
    world = settle(environment, path.stem, wanted, scale=rules.scale(environment.cell))
    notes = tuple(f"{one.subject}: {one.text}" for one in context.findings.warnings())
    return replace(world, notes=notes)


def load_map(path: Path, rules: Rules) -> Environment:
    """The environment of a map file, see `load_world`."""
    return load_world(path, rules).environment


def _environment(path: Path, grid: GridMap, rules: Rules) -> Environment:
    """What is not known to be free is wall."""
    walls, doubtful = (fit(cells[::-1], path, rules) for cells in (~grid.free, grid.doubtful))
    cell = rules.cell or (CELL if grid.assumed else grid.size)
    return Environment(path.stem, walls, cell, doubtful != 0)


def _as_mresim(path: Path, rules: Rules) -> Environment:
    """A picture or text by MRESim's rules."""
    if path.suffix.lower() == ".txt":
        from usarsim_maps.grids.occupancy import read_digits

        walls = read_digits(path)
    else:
        with open_picture(path, str(path)) as image:
            samples = np.array(image)
        walls = np.asarray((samples if samples.ndim == 2 else samples[:, :, 0]) == 0)
    return Environment(path.stem, fit(walls, path, rules), rules.cell or COMPAT_CELL)


def fit(walls: NDArray[np.bool_], path: Path, rules: Rules) -> NDArray[np.uint8]:
    """Refuse what is too large; put the rest where the rules say."""
    rows, columns = walls.shape
    canvas = CANVAS if rules.compat else rules.canvas
    limit = CANVAS if rules.compat and rules.limit == LARGEST else rules.limit
    for most in (limit, canvas or limit):
        if columns > most[0] or rows > most[1]:
            problem = f"{columns} x {rows} cells are more than {most[0]} x {most[1]}"
            cure = "leave `compat` out, or make the map smaller" if rules.compat else _SMALLER
            raise WorldError(at(path, problem, cure))
    if canvas is None:
        return walls.astype(np.uint8)
    left, top = (canvas[0] - columns) // 2, (canvas[1] - rows) // 2
    found = np.full((canvas[1], canvas[0]), 0 if rules.compat else 1, np.uint8)
    found[top : top + rows, left : left + columns] = walls
    return found


def save_map(environment: Environment, path: Path) -> None:
    """Write a picture of black and white, or the text form if the name ends in `txt`."""
    walls = environment.walls != 0
    if path.suffix.lower() == ".txt":
        rows, columns = walls.shape
        lines = ("".join("01"[one] for one in row) for row in walls.astype(int).tolist())
        write_text(path, "\n".join([str(rows), str(columns), *lines, ""]))
        return
    from PIL import Image

    with replacing(path) as file:
        Image.fromarray(np.where(walls, 0, 255).astype(np.uint8)).convert("1").save(file, "PNG")
