"""What a team's own programs hand in: a list of victims and a map, as the competition had them.

They leave `NAME_victim.txt` (and `NAME_victim_info.txt`), `NAME_map.tiff` and `NAME_map.tfw` in a
folder. When the trial is over these are moved into that of the run and told to the referee, so that
the run can be scored again from its logs alone.
"""

from __future__ import annotations

import contextlib
import io
import math
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image, UnidentifiedImageError

from usarsim_mission.errors import MissionError
from usarsim_mission.grid import FREE, LARGEST, UNKNOWN, WALL, Grid
from usarsim_mission.hand_in import (
    FREE_WHITE,
    SEARCHED_GREEN,
    UNKNOWN_BLUE,
    VICTIM_RED,
    WALL_BLACK,
    Reported,
    read_victims,
)
from usarsim_server.base.errors import at
from usarsim_server.base.files import read_regular, reason

Frame = Literal["usarsim", "world"]
"""y to the right, as robots tell places, or to the left, as world files do."""
FOLDER = "handed-in"
"""Within that of the run."""
_FORMATS = ("TIFF", "PNG", "BMP", "GIF", "JPEG")  # others may run what is in them
_VICTIMS, _INFO, _MAP, _PLACE = "_victim.txt", "_victim_info.txt", "_map.tiff", "_map.tfw"
_MOST = 1000
_COLOURS = {
    UNKNOWN_BLUE: UNKNOWN,
    WALL_BLACK: WALL,
    SEARCHED_GREEN: FREE,
    FREE_WHITE: FREE,
    VICTIM_RED: FREE,
}


def refuse_old(folder: Path) -> None:
    """Make sure that nothing lies there already: it would count for this run.

    Raises:
        MissionError: something does.
    """
    for path in _files(folder):
        problem = "lies where this run's hand-in is to be"
        raise MissionError(at(path, problem, "move it away"))


def take(folder: Path, run: Path, frame: Frame) -> Iterator[tuple[str, dict[str, Any]]]:
    """Move what was handed in into the folder of a run.

    Yields:
        Kind and facts of the records that say it, in MuJoCo's frame.

    Raises:
        MissionError: a file is not what it should be; what came before it counts.
    """
    target = run / FOLDER
    try:
        for path in _files(folder):
            target.mkdir(exist_ok=True)
            shutil.move(path, target / path.name)
    except OSError as error:
        cure = "check its rights"
        raise MissionError(at(folder, f"cannot be moved: {reason(error)}", cure)) from None
    side = -1.0 if frame == "usarsim" else 1.0
    for path in sorted(target.glob(f"*{_MAP}")):
        yield "map", _turned(read_map(path), frame).packed()
    victims = [one for path in sorted(target.glob(f"*{_VICTIMS}")) for one in _reported(path)]
    if victims:
        rows = [
            {"number": number, "place": [one.x, side * one.y, 0.0], "status": one.status}
            for number, one in enumerate(victims[:_MOST], start=1)
        ]
        yield "hand_in", {"victims": rows}


def read_map(path: Path) -> Grid:
    """A map in the colours of the competition, with its world file, as it was drawn: y up.

    Raises:
        MissionError: it is none.
    """
    place = path.with_name(path.name.removesuffix(_MAP) + _PLACE)
    try:
        words = read_regular(place).decode("ascii", "replace").split()
        cell, skew, turn, down, x, y = map(float, words)
        if not (cell > 0.0 and down == -cell and skew == turn == 0.0 and math.isfinite(x + y)):
            raise ValueError
    except OSError as error:
        cure = "hand it in beside the map"
        raise MissionError(at(place, f"cannot be read: {reason(error)}", cure)) from None
    except ValueError:
        cure = "write side of a cell, 0, 0, minus that, x and y of the first pixel's middle"
        raise MissionError(at(place, "is no world file of such a map", cure)) from None
    try:
        with Image.open(io.BytesIO(read_regular(path, 256 << 20)), formats=_FORMATS) as picture:
            if max(picture.size) > LARGEST:
                raise MissionError(at(path, "is too large", f"use {LARGEST} pixels a side"))
            pixels = np.asarray(picture.convert("RGB"), np.int32)
    except Image.DecompressionBombError:
        raise MissionError(at(path, "is too large", f"use {LARGEST} pixels a side")) from None
    except (OSError, UnidentifiedImageError, ValueError) as error:
        raise MissionError(at(path, f"is no picture: {error}", "write a TIFF")) from None
    known = np.array(list(_COLOURS), np.int32)
    rows, columns = pixels.shape[0], pixels.shape[1]
    cells = np.zeros((rows, columns), np.uint8)
    nearest = np.full((rows, columns), np.iinfo(np.int32).max, np.int32)
    for colour, kind in zip(known, _COLOURS.values(), strict=True):
        gap = np.square(pixels - colour).sum(axis=2, dtype=np.int32)
        cells[gap < nearest] = kind
        nearest = np.minimum(nearest, gap)
    corner = y - (rows - 0.5) * cell
    return Grid(x - cell / 2.0, corner, cell, np.flipud(cells))


def _files(folder: Path) -> list[Path]:
    """All that belongs to a hand-in, in order."""
    ends = (_VICTIMS, _INFO, _MAP, _PLACE)
    return sorted(path for end in ends for path in folder.glob(f"*{end}") if path.is_file())


def _turned(grid: Grid, frame: Frame) -> Grid:
    if frame == "world":
        return grid
    high = grid.y + grid.cells.shape[0] * grid.cell
    return Grid(grid.x, -high, grid.cell, np.flipud(grid.cells))


def _reported(path: Path) -> list[Reported]:
    """The victims of a list, with what a second list says of them."""
    try:
        victims = read_victims(read_regular(path).decode("utf-8-sig", "replace"))
    except OSError as error:
        raise MissionError(
            at(path, f"cannot be read: {reason(error)}", "check its rights")
        ) from None
    except ValueError as error:
        cure = "write Victim1, x, y, 0, VICTIM, 1 for each, and END"
        raise MissionError(at(path, str(error), cure)) from None
    if not all(math.isfinite(one.x + one.y) for one in victims):
        raise MissionError(at(path, "a place is no number", "write metres"))
    info = path.with_name(path.name.removesuffix(_VICTIMS) + _INFO)
    told: dict[str, str] = {}
    with contextlib.suppress(OSError):
        for line in read_regular(info).decode("utf-8-sig", "replace").splitlines():
            name, _, status = line.partition(",")
            told[name.strip()] = status.strip().strip('"')
    return [
        Reported(one.number, one.x, one.y, told.get(f"Victim{one.number}", "")) for one in victims
    ]
