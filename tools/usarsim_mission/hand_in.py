"""The files that are handed in after a run: map, victims and paths, for maps and sheets.

They are made from the logs of a run (`HandIn`). Or a team's own programs leave some of them,
`NAME_victim.txt` (and `NAME_victim_info.txt`), `NAME_map.tiff` and `NAME_map.tfw`, in a folder.
When the trial is over these are moved into that of the run and told to the referee
(`take_handed_in`), so that the run can be scored again from its logs alone.

As stations of the competition wrote them, all in the frame of the map, m, x to the right and y up:

* `NAME_map.tiff`: unknown blue, wall black, searched green, other free white, victims a red cross;
  `NAME_map_prob.tiff`: the same in grey. Each with a world file `.tfw`: side of a cell, 0, 0, minus
  that, and the middle of the first cell.
* `NAME_map_geo.tiff`: the colours as a GeoTIFF, whose place stands in its tags.
* `NAME_victim.txt`: a line `Victim1, x, y, 0, VICTIM, 1` for each and `END`; `NAME_victim_info.txt`
  tells their status.
* `NAME_victim` and `NAME_path`, `.mif` and `.mid`: points and one coloured line per robot for
  MapInfo and its likes.
* `NAME.png` and `NAME.yaml`: the grid as ROS has maps.
"""

from __future__ import annotations

import contextlib
import io
import math
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, TiffImagePlugin, TiffTags, UnidentifiedImageError

from usarsim_mission.errors import MissionError, RunLogError
from usarsim_mission.grid import FREE, LARGEST, UNKNOWN, WALL, Grid
from usarsim_mission.model import Point
from usarsim_mission.referee import Referee
from usarsim_server.base.errors import at
from usarsim_server.base.files import read_regular, reason, write_bytes

UNKNOWN_BLUE, WALL_BLACK, SEARCHED_GREEN, FREE_WHITE, VICTIM_RED = (
    (0, 0, 255),
    (0, 0, 0),
    (0, 255, 0),
    (255, 255, 255),
    (255, 0, 0),
)
ARM = 0.5
"""m of an arm of a victim's cross."""
PATH_COLOURS = (0xE6194B, 0x3C64D2, 0x2D9632, 0xC87800, 0x8C28AA, 0x1EA0AA, 0xB4A000, 0x787878)
"""RGB of the lines of robots, in turn."""

_GREY = {UNKNOWN: 205, FREE: 254, WALL: 0}
"""As ROS has them."""
_PIXEL_SCALE, _TIE_POINT, _GEO_KEYS, _GEO_TEXTS = 33550, 33922, 34735, 34737
_CITATION = "USARSim world frame, m|"
MAP_FOLDER = "map"
"""Within that of the run: files that are made from its logs."""
_PATH_STEP = 0.1
"""m between two places of a path."""
Frame = Literal["usarsim", "world"]
"""y to the right, as robots tell places, or to the left, as world files do."""
HANDED_IN = "handed-in"
"""Within that of the run."""
_FORMATS = ("TIFF", "PNG", "BMP", "GIF", "JPEG")  # others may run what is in them
_VICTIMS, _INFO, _MAP, _WORLD = "_victim.txt", "_victim_info.txt", "_map.tiff", "_map.tfw"
_MOST_VICTIMS = 1000
_COLOURS = {
    UNKNOWN_BLUE: UNKNOWN,
    WALL_BLACK: WALL,
    SEARCHED_GREEN: FREE,
    FREE_WHITE: FREE,
    VICTIM_RED: FREE,
}


@dataclass(frozen=True, slots=True)
class Reported:
    """A victim as it is reported: number, place in m, and what was said of it."""

    number: int
    x: float
    y: float
    status: str = ""


def write_hand_in(
    folder: Path,
    name: str,
    grid: Grid,
    victims: Sequence[Reported],
    paths: Mapping[str, Sequence[Point]],
    searched: NDArray[np.bool_] | None = None,
) -> list[Path]:
    """Write all of them.

    Args:
        folder: is made if it is not there.
        name: that the files begin with.
        grid: the map.
        victims: that were reported.
        paths: places of robots by name, m.
        searched: (rows, columns) cells of the grid in which no victim can be overlooked.

    Returns:
        The files.

    Raises:
        RunLogError: one cannot be written.
    """
    colours = coloured(grid, victims, searched)
    grey = np.flipud(_shades(grid))
    world_file = _world_file(grid).encode()
    points = [(one.x, one.y) for one in victims]
    files = {
        f"{name}_map.tiff": _image(colours, "TIFF"),
        f"{name}_map.tfw": world_file,
        f"{name}_map_prob.tiff": _image(grey, "TIFF"),
        f"{name}_map_prob.tfw": world_file,
        f"{name}_map_geo.tiff": geotiff(colours, grid),
        f"{name}_victim.txt": victim_text(victims).encode(),
        f"{name}_victim_info.txt": "".join(
            f"Victim{one.number}, {_field(one.status)}\n" for one in victims
        ).encode(),
        f"{name}_victim.mif": _mif(grid, _points(points)).encode(),
        f"{name}_victim.mid": _mid(f"Victim{one.number}" for one in victims).encode(),
        f"{name}_path.mif": _mif(grid, _lines(list(paths.values()))).encode(),
        f"{name}_path.mid": _mid(paths).encode(),
        f"{name}.png": _image(grey, "PNG"),
        f"{name}.yaml": _yaml(f"{name}.png", grid).encode(),
    }
    for file, data in files.items():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write_bytes(folder / file, data)
        except OSError as error:
            cure = "name a folder that can be written"
            problem = f"cannot be written: {reason(error)}"
            raise RunLogError(at(folder / file, problem, cure)) from error
    return [folder / file for file in files]


def coloured(
    grid: Grid, victims: Sequence[Reported], searched: NDArray[np.bool_] | None = None
) -> NDArray[np.uint8]:
    """The map in its colours, (rows, columns, 3), the greatest y first."""
    found = np.empty((*grid.cells.shape, 3), np.uint8)
    found[:] = UNKNOWN_BLUE
    found[grid.cells == FREE] = FREE_WHITE
    if searched is not None:
        found[(grid.cells == FREE) & searched] = SEARCHED_GREEN
    found[grid.cells == WALL] = WALL_BLACK
    rows, columns = grid.cells.shape
    arm = round(ARM / grid.cell)
    for one in victims:
        row, column = grid.index(one.x, one.y)
        across = slice(max(column - arm, 0), max(column + arm + 1, 0))
        along = slice(max(row - arm, 0), max(row + arm + 1, 0))
        if 0 <= row < rows:
            found[row, across] = VICTIM_RED
        if 0 <= column < columns:
            found[along, column] = VICTIM_RED
    return np.flipud(found)


def geotiff(pixels: NDArray[np.uint8], grid: Grid) -> bytes:
    """A picture of a grid, the greatest y first, as a GeoTIFF in a plane frame of its own, m."""
    top = grid.y + grid.cells.shape[0] * grid.cell
    keys = (
        *(1, 1, 0, 5),  # version, revision, minor, count; then key, tag, count, value
        *(1024, 0, 1, 1),  # model: projected
        *(1025, 0, 1, 1),  # a pixel is an area: places are those of its corner
        *(1026, _GEO_TEXTS, len(_CITATION), 0),
        *(3072, 0, 1, 32767),  # a frame of one's own
        *(3076, 0, 1, 9001),  # metre
    )
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, kind, value in (
        (_PIXEL_SCALE, TiffTags.DOUBLE, (grid.cell, grid.cell, 0.0)),
        (_TIE_POINT, TiffTags.DOUBLE, (0.0, 0.0, 0.0, grid.x, top, 0.0)),
        (_GEO_KEYS, TiffTags.SHORT, keys),
        (_GEO_TEXTS, TiffTags.ASCII, _CITATION),
    ):
        tags.tagtype[tag] = kind
        tags[tag] = value
    return _image(pixels, "TIFF", tiffinfo=tags)


def victim_text(victims: Sequence[Reported]) -> str:
    """The list of victims."""
    lines = [f"Victim{one.number}, {one.x:.3f}, {one.y:.3f}, 0, VICTIM, 1\n" for one in victims]
    return "".join([*lines, "END\n"])


def read_victims(text: str) -> list[Reported]:
    """The victims of such a list.

    Raises:
        ValueError: it is none; names the line.
    """
    found: list[Reported] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() == "END":
            return found
        parts = [part.strip() for part in line.split(",")]
        try:
            name, x, y, _, kind, _ = parts
            if kind != "VICTIM":
                raise ValueError
            found.append(Reported(int(name.removeprefix("Victim")), float(x), float(y)))
        except ValueError:
            raise ValueError(f"line {number} tells of no victim") from None
    raise ValueError("END is missing")


def _shades(grid: Grid) -> NDArray[np.uint8]:
    shades = np.array([_GREY[value] for value in (UNKNOWN, FREE, WALL)], np.uint8)
    found: NDArray[np.uint8] = shades[grid.cells]
    return found


def _image(pixels: NDArray[np.uint8], kind: str, **options: object) -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(file, kind, **options)
    return file.getvalue()


def _world_file(grid: Grid) -> str:
    x = grid.x + grid.cell / 2.0
    y = grid.y + (grid.cells.shape[0] - 0.5) * grid.cell
    return "".join(f"{value:.10g}\n" for value in (grid.cell, 0.0, 0.0, -grid.cell, x, y))


def _yaml(image: str, grid: Grid) -> str:
    return (
        f"image: {image}\nresolution: {grid.cell:.10g}\n"
        f"origin: [{grid.x:.10g}, {grid.y:.10g}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def _mif(grid: Grid, objects: Iterator[str]) -> str:
    """Geometry; its frame is plane and bounded by the map."""
    rows, columns = grid.cells.shape
    x, y = grid.x + columns * grid.cell, grid.y + rows * grid.cell
    head = (
        'Version 300\nCharset "Neutral"\nDelimiter ","\n'
        f'CoordSys NonEarth Units "m" Bounds ({grid.x:.3f}, {grid.y:.3f}) ({x:.3f}, {y:.3f})\n'
        "Columns 2\n  ID Integer\n  Name Char(64)\nData\n\n"
    )
    return head + "".join(objects)


def _points(places: Sequence[Point]) -> Iterator[str]:
    for x, y in places:
        yield f"Point {x:.3f} {y:.3f}\n    Symbol (35,16711680,12)\n"


def _lines(paths: Sequence[Sequence[Point]]) -> Iterator[str]:
    for number, path in enumerate(paths):
        if len(path) < 2:  # a line needs two ends
            yield "None\n"
            continue
        places = "".join(f"{x:.3f} {y:.3f}\n" for x, y in path)
        colour = PATH_COLOURS[number % len(PATH_COLOURS)]
        yield f"Pline {len(path)}\n{places}    Pen (2,2,{colour})\n"


def _mid(names: Iterator[str] | Mapping[str, object]) -> str:
    """The columns ID and Name, a line per object."""
    return "".join(f'{number},"{_field(name)}"\n' for number, name in enumerate(names, start=1))


def _field(text: str) -> str:
    """Text without what separates fields and lines."""
    return "".join("_" if c in '",;' or not c.isprintable() else c for c in text)


class HandIn:
    """Collects what is handed in."""

    def __init__(self) -> None:
        self._grid: Grid | None = None
        self._paths: dict[str, list[Point]] = {}

    def take(self, record: Mapping[str, Any], referee: Referee) -> None:
        """A record, which the referee has been told."""
        if record["kind"] == "map":
            self._grid = Grid.unpacked(record)
        for robot in referee.visits.robots.values() if record["kind"] == "truth" else ():
            path, pos = self._paths.setdefault(robot.name, []), robot.pos
            if pos is not None and (not path or math.dist(path[-1], pos[:2]) >= _PATH_STEP):
                path.append((pos[0], pos[1]))

    def write(self, folder: Path, name: str, referee: Referee) -> list[Path]:
        """Write the files.

        Args:
            folder: of the run. name: of the mission. referee: who has been told all.

        Returns:
            The files; none if the run has no map.

        Raises:
            RunLogError: a file cannot be written.
        """
        grid = self._grid
        if grid is None:
            return []
        places = [(one, one.place) for one in referee.marks.standing() if one.place is not None]
        victims = [
            Reported(number, place[0], place[1], mark.status)
            for number, (mark, place) in enumerate(places, start=1)
        ]
        base = "".join(c if c.isalnum() or c in "-_" else "_" for c in name) or "run"
        searched = _searched(grid, referee.area.seen())
        return write_hand_in(folder / MAP_FOLDER, base, grid, victims, self._paths, searched)


def _searched(grid: Grid, seen: Grid | None) -> NDArray[np.bool_] | None:
    """Which cells of a map have been seen, by the raster of another grid."""
    if seen is None:
        return None
    rows, columns = grid.cells.shape
    row = np.floor((grid.y + (np.arange(rows) + 0.5) * grid.cell - seen.y) / seen.cell).astype(int)
    column = np.floor((grid.x + (np.arange(columns) + 0.5) * grid.cell - seen.x) / seen.cell)
    column = column.astype(int)
    good_row = (row >= 0) & (row < seen.cells.shape[0])
    good_column = (column >= 0) & (column < seen.cells.shape[1])
    found = np.zeros(grid.cells.shape, np.bool_)
    inside = np.ix_(good_row, good_column)
    found[inside] = seen.cells[np.ix_(row[good_row], column[good_column])] == FREE
    return found


def refuse_old_hand_in(folder: Path) -> None:
    """Make sure that nothing lies there already: it would count for this run.

    Raises:
        MissionError: something does.
    """
    for path in _files(folder):
        problem = "lies where this run's hand-in is to be"
        raise MissionError(at(path, problem, "move it away"))


def take_handed_in(folder: Path, run: Path, frame: Frame) -> Iterator[tuple[str, dict[str, Any]]]:
    """Move what was handed in into the folder of a run.

    Yields:
        Kind and facts of the records that say it, in MuJoCo's frame.

    Raises:
        MissionError: a file is not what it should be; what came before it counts.
    """
    target = run / HANDED_IN
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
            for number, one in enumerate(victims[:_MOST_VICTIMS], start=1)
        ]
        yield "hand_in", {"victims": rows}


def read_map(path: Path) -> Grid:
    """A map in the colours of the competition, with its world file, as it was drawn: y up.

    Raises:
        MissionError: it is none.
    """
    place = path.with_name(path.name.removesuffix(_MAP) + _WORLD)
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
    ends = (_VICTIMS, _INFO, _MAP, _WORLD)
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
