"""The files that a team hands in after a run: map, victims and paths, for maps and sheets.

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

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, TiffImagePlugin, TiffTags

from usarsim_mission.errors import RunLogError
from usarsim_mission.grid import FREE, UNKNOWN, WALL, Grid
from usarsim_mission.model import Point
from usarsim_server.base.errors import at
from usarsim_server.base.files import reason, write_bytes

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
