"""Environments in pictures and as text, in MRESim's forms (exploration reference 3.1 and 3.2).

MRESim's rules (`compat`) differ from what a picture shows: a cell is a wall exactly where the first
sample of the pixel is 0, and what is smaller than its world of 800 x 600 stands in the middle of
free space.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Environment
from usarsim_maps.files import open_picture
from usarsim_server.errors import WorldError, at
from usarsim_server.files import replacing, write_text

CANVAS = (800, 600)
"""Columns and rows of MRESim's world."""
LARGEST = (2000, 2000)
CELL = 0.1
"""m that a cell is wide of maps that do not say it."""
COMPAT_CELL = 1 / 13
"""m that one of MRESim's is wide (exploration reference 1)."""
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
    """

    compat: bool = False
    canvas: tuple[int, int] | None = None
    limit: tuple[int, int] = LARGEST
    cell: float | None = None


def load_map(path: Path, rules: Rules) -> Environment:
    """Read a picture, or the text form, which ends in `txt`.

    Raises:
        WorldError: naming the file, what is wrong, and the cure.
    """
    if path.suffix.lower() == ".txt":
        # only now: it brings MuJoCo, 20 MiB that shipped environments do without
        from usarsim_maps.grids.occupancy import read_digits

        walls = read_digits(path)
    else:
        walls = _picture(path, rules.compat)
    cell = rules.cell or (COMPAT_CELL if rules.compat else CELL)
    return Environment(path.stem, fit(walls, path, rules), cell)


def fit(walls: NDArray[np.bool_], path: Path, rules: Rules) -> NDArray[np.uint8]:
    """Refuse what is too large; put the rest where the rules say."""
    rows, columns = walls.shape
    canvas = CANVAS if rules.compat else rules.canvas
    limit = CANVAS if rules.compat and rules.limit == LARGEST else rules.limit
    for most in (limit, canvas or limit):
        if columns > most[0] or rows > most[1]:
            problem = f"{columns} x {rows} cells are more than {most[0]} x {most[1]}"
            raise WorldError(at(path, problem, "reduce the map, or allow larger ones"))
    if canvas is None:
        return walls.astype(np.uint8)
    left, top = (canvas[0] - columns) // 2, (canvas[1] - rows) // 2
    found = np.full((canvas[1], canvas[0]), 0 if rules.compat else 1, np.uint8)
    found[top : top + rows, left : left + columns] = walls
    return found


def _picture(path: Path, compat: bool) -> NDArray[np.bool_]:
    """Walls; in our own rules these are the pixels darker than half."""
    with open_picture(path, str(path)) as image:
        if not compat and not image.mode.startswith(("I", "F")):
            image = image.convert("L")
        samples = np.array(image)
    first = samples if samples.ndim == 2 else samples[:, :, 0]
    if compat:
        return np.asarray(first == 0)
    half = 0.5 if samples.dtype == bool else 128 if samples.max(initial=0) < 256 else 32768
    return np.asarray(first < half)


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
