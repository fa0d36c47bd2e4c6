"""Reads occupancy grids: map server YAML with a picture, a picture alone, MRESim's text form.

Occupied cells become walls on level ground. Cells of a picture are as large as the YAML file or
the user says (`--scale` cells per metre); what is only assumed is reported. On the wire x counts to
the right and y down in a picture without YAML, from its upper left corner, as MRESim counts cells
(exploration reference 3.1 to 3.3). `shades` says what pixels mean, `inside` where robots may start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from usarsim_maps.files import read_text
from usarsim_maps.grids.grid import free_places, pooled, rectangles, wall_mesh
from usarsim_maps.grids.inside import inside
from usarsim_maps.grids.shades import (
    MAX_CELLS,
    MODES,
    Cells,
    Mode,
    map_server_cells,
    picture_cells,
    read_shades,
)
from usarsim_maps.meshes.mesh_files import Pictures
from usarsim_maps.reader import Context, Reader, need, register
from usarsim_maps.scene import Mask, Material, Part, Plane, Scene, SceneObject, Source
from usarsim_maps.units import reflect
from usarsim_server.base.errors import MapImportError, at
from usarsim_server.base.files import ALLOW, is_regular
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.worlds.description import StartPose

Value: TypeAlias = str | list[str]

MAX_TEXT_BYTES = 256 << 20
MAX_YAML_BYTES = 1 << 20
MAX_YAML_LINES = 10_000
MAX_WALLS = 20_000
"""Boxes; a map with more is made coarser until it has fewer."""

PICTURES = (".png", ".pgm", ".bmp", ".gif", ".jpg", ".jpeg")

WALL_HEIGHT = 2.0
CELLS_PER_METRE = 13.0
"""Of maps that do not say: MRESim's only statement about scale (exploration reference 1)."""

OCCUPIED, FREE = 0.65, 0.196
"""Thresholds of the map server where the YAML file has none."""

STARTS = 4
HOVER = 0.25
ROOM = 0.5
"""m around a start pose that are free."""

WALL = Material("wall", (0.72, 0.72, 0.70, 1.0))
FLOOR = Material("floor", (0.45, 0.47, 0.50, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class GridMap:
    """A map as read."""

    walls: Mask  # cells, row 0 at the lowest y; some may be neither
    free: Mask
    doubtful: Mask  # free cells that may be unknown
    size: float  # of a cell, m
    corner: Pose  # pose of the lower left corner
    wanted: tuple[float, float] | None  # a place that is probably free, m from that corner
    title: str  # of the format
    assumed: bool  # the size was not stated
    files: tuple[Path, ...]  # that were read


@register("occupancy")
class OccupancyReader(Reader):
    """Walls of one height."""

    title = "Occupancy grid"
    extensions = (".yaml", ".yml", *PICTURES, ".txt")
    meshes = False

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`; an error names the line."""
        grid = load_grid(source, context)
        walls, size = grid.walls, grid.size
        if not walls.any():
            cure = "check occupied_thresh and negate, or whether walls are dark in the picture"
            raise MapImportError(at(source, "there is not one wall in this map", cure))
        found = rectangles(walls)
        while len(found) > MAX_WALLS:
            walls, size = pooled(walls), size * 2.0
            found = rectangles(walls)
            text = f"too many walls; its cells were joined to cells of {size:.3g} m"
            context.findings.warn(source.name, text)
        height = context.options.wall_height or WALL_HEIGHT
        mesh = wall_mesh(found, size, height, WALL.name)
        findings = context.findings
        findings.count("occupied cell", int(grid.walls.sum()))
        findings.count("free cell", int(grid.free.sum()))
        findings.fact("walls", len(found))
        findings.fact("wall height", float(height))
        extent = max(grid.walls.shape) * grid.size
        floor = Part(Plane((2.0 * extent, 2.0 * extent)), materials={0: FLOOR.name})
        scene = Scene(
            source=Source(
                source,
                grid.title,
                units_per_metre=1.0 / grid.size,
                assumed=grid.assumed,
                stated=not grid.assumed and context.options.scale is None,
                whole_map=True,
                files=grid.files,
            ),
            objects=(
                SceneObject("floor", (floor,), Pose(grid.corner.position), kind="floor"),
                SceneObject("walls", (Part(mesh),), grid.corner, kind="walls"),
            ),
            materials={WALL.name: WALL, FLOOR.name: FLOOR},
            starts=tuple(_starts(grid)),
            starts_made=True,
        )
        return reflect(scene) if context.options.mirror else scene


def _starts(grid: GridMap) -> list[StartPose]:
    """Start poses in free places, inside if there is an inside; none if there is no room."""
    places: list[tuple[float, float]] = []
    for allowed in (inside(grid.free & ~grid.doubtful), inside(grid.free), grid.free):
        for room in (ROOM, 0.6 * ROOM):
            places = places or free_places(grid.free, allowed, grid.size, grid.wanted, room, STARTS)
    starts = []
    for number, (x, y) in enumerate(places, start=1):
        pose = grid.corner @ Pose((x, y, HOVER))
        starts.append(StartPose(f"RobotStart{number}", pose))
    return starts


def load_grid(source: Path, context: Context) -> GridMap:
    """Cells of a map in any of the forms.

    Raises:
        MapImportError: naming the file, what is wrong, and the cure.
    """
    suffix = source.suffix.lower()
    if suffix in (".yaml", ".yml"):
        return _from_yaml(source, context, None)
    if suffix == ".txt":
        walls = read_digits(source)
        cells = Cells(walls, ~walls, np.zeros_like(walls))
        return _plain(source, cells, "MRESim text", context)
    for other in (".yaml", ".yml"):
        beside = source.with_suffix(other)
        if is_regular(beside) and context.admit(beside, source):
            context.findings.warn(source.name, f"its scale and place are those of {beside.name}")
            return _from_yaml(beside, context, source)
    return _plain(source, picture_cells(read_shades(source)), "occupancy picture", context)


def _plain(source: Path, cells: Cells, title: str, context: Context) -> GridMap:
    """A grid that says nothing about scale: its upper left corner is the origin."""
    size = 1.0 / (context.options.scale or CELLS_PER_METRE)
    corner = Pose((0.0, -cells.walls.shape[0] * size, 0.0))
    assumed = context.options.scale is None
    return _grid(cells, size, corner, None, title, assumed, (source,), context)


def _grid(
    cells: Cells,
    size: float,
    corner: Pose,
    wanted: tuple[float, float] | None,
    title: str,
    assumed: bool,
    files: tuple[Path, ...],
    context: Context,
) -> GridMap:
    """A map with its lowest row first; what is to be said of its cells is reported."""
    for note in cells.notes:
        context.findings.warn(files[-1].name, note)
    masks = cells.walls[::-1], cells.free[::-1], cells.doubtful[::-1]
    return GridMap(*masks, size, corner, wanted, title, assumed, files)


# ---- YAML ------------------------------------------------------------------------------------


def _from_yaml(path: Path, context: Context, picture: Path | None) -> GridMap:
    table = read_yaml(path, read_text(path, MAX_YAML_BYTES))
    name = table.get("image", "")
    if not isinstance(name, str) or not name:
        cure = "give the YAML file that the map server saved"
        raise MapImportError(at(path, "no image is named", cure, where="image"))
    found = picture or _beside(path, name) or Pictures(path, context).find(name)
    refusal = None if found is None else context.confined().refusal(found, path)
    if refusal is not None:
        raise MapImportError(at(path, refusal, ALLOW, where="image"))
    if found is None or not is_regular(found):
        cure = "keep picture and YAML file together"
        raise MapImportError(at(path, f"the picture {name!r:.80} is missing", cure, where="image"))
    size = _number(path, table, "resolution", None)
    if not 1e-4 < size < 1e3:
        cure = "write metres per pixel, such as 0.05"
        raise MapImportError(at(path, f"{size:g} m per pixel", cure, where="resolution"))
    if context.options.scale is not None:
        size = 1.0 / context.options.scale
    x, y, yaw = _origin(path, table)
    wall = _number(path, table, "occupied_thresh", OCCUPIED)
    open_ = _number(path, table, "free_thresh", FREE)
    shades = read_shades(found)
    cells = map_server_cells(shades, _mode(path, table), _flag(path, table), wall, open_)
    corner = Pose((x, y, 0.0), quaternion_from_rpy(0.0, 0.0, yaw))
    start = (corner.inverse() @ Pose()).position[:2]
    return _grid(cells, size, corner, start, "occupancy grid", False, (path, found), context)


def read_yaml(path: Path, text: str) -> dict[str, Value]:
    """Keys of the outermost level; values stay texts, and what is nested deeper is empty.

    Backslashes are those of paths, in quotes too. A `MapImportError` names the line that makes no
    sense.
    """
    yaml = need("yaml", path, "grid maps")
    lines = text.replace("\\", "/").expandtabs().split("\n")
    if len(lines) > MAX_YAML_LINES:
        raise MapImportError(at(path, f"{len(lines)} lines", "give the YAML file of a map"))
    number = next((place for place, line in enumerate(lines) if line.strip()), 0)
    try:
        # Its base loader makes texts, lists and tables of whatever a tag asks for.
        found = yaml.load("\n".join(lines), Loader=yaml.BaseLoader)
    except yaml.MarkedYAMLError as error:
        begun = isinstance(error, yaml.scanner.ScannerError) or "flow" in (error.context or "")
        mark = (error.context_mark if begun else None) or error.problem_mark
        found, number = "", number if mark is None else mark.line
    except yaml.reader.ReaderError as error:
        found, number = "", "\n".join(lines).count("\n", 0, error.position)
    if not isinstance(found, dict | None):
        number = min(number, len(lines) - 1)
        problem = f"{lines[number].strip()[:60]!r} is not understood"
        cure = "write lines such as `resolution: 0.05`"
        raise MapImportError(at(path, problem, cure, where=f"line {number + 1}"))
    return {key: _texts(value) for key, value in (found or {}).items()}


def _texts(value: object) -> Value:
    if isinstance(value, list):
        return [item if isinstance(item, str) else "" for item in value]
    return value if isinstance(value, str) else ""


def _beside(path: Path, name: str) -> Path | None:
    """The picture where the YAML file says."""
    found = path.parent / name
    return found if is_regular(found) else None


def _text_of(table: dict[str, Value], key: str) -> str:
    value = table.get(key, "")
    return value.lower() if isinstance(value, str) else ""


def _number(path: Path, table: dict[str, Value], key: str, default: float | None) -> float:
    value = table.get(key)
    if value is None and default is not None:
        return default
    try:
        number = float(value) if isinstance(value, str) else math.nan
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        problem = "the number is missing" if value is None else f"{value!r:.60} is no number"
        raise MapImportError(at(path, problem, f"write a line such as `{key}: 0.05`", where=key))
    return number


def _mode(path: Path, table: dict[str, Value]) -> Mode:
    word = _text_of(table, "mode") or "trinary"
    for mode in MODES:
        if word == mode:
            return mode
    problem, cure = f"{word!r:.60} is no mode of map servers", f"write one of {', '.join(MODES)}"
    raise MapImportError(at(path, problem, cure, where="mode"))


def _flag(path: Path, table: dict[str, Value]) -> bool:
    return _text_of(table, "negate") in ("1", "true", "yes", "on")


def _origin(path: Path, table: dict[str, Value]) -> tuple[float, float, float]:
    value = table.get("origin", ["0", "0", "0"])
    try:
        numbers = [float(word) for word in value] if isinstance(value, list) else []
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(abs(number) < 1e6 for number in numbers):
        cure = "write the lower left corner, such as [-10.0, -10.0, 0.0]"
        raise MapImportError(at(path, f"{value!r:.60} is no place", cure, where="origin"))
    return numbers[0], numbers[1], numbers[2] if len(numbers) > 2 else 0.0


# ---- cells -----------------------------------------------------------------------------------


def read_digits(path: Path) -> Mask:
    """Rows, columns, then a line of 0 and 1 per row."""
    lines = read_text(path, MAX_TEXT_BYTES).split("\n")

    def wrong(number: int, problem: str) -> MapImportError:
        cure = "write rows, columns, then lines of 0 (free) and 1 (wall)"
        return MapImportError(at(path, problem, cure, where=f"line {number}"))

    sizes = []
    for number in (1, 2):
        word = lines[number - 1].strip() if len(lines) >= number else ""
        if not (word.isascii() and word.isdigit() and len(word) < 9 and int(word) > 0):
            raise wrong(
                number, f"{word[:40]!r} is no number of {'rows' if number == 1 else 'columns'}"
            )
        sizes.append(int(word))
    rows, columns = sizes
    if rows * columns > MAX_CELLS:
        raise wrong(1, f"{rows} x {columns} cells are too many")
    body = lines[2 : 2 + rows]
    if len(body) < rows or (len(body) == rows and not body[-1].strip()):
        raise wrong(
            len(lines), f"{rows} rows are announced, {len([b for b in body if b])} are there"
        )
    if any(line.strip() for line in lines[2 + rows :]):
        raise wrong(3 + rows, "more rows than are announced")
    cells = np.zeros((rows, columns), dtype=bool)
    for index, line in enumerate(body):
        line = line.strip()
        if len(line) != columns or line.strip("01"):
            raise wrong(index + 3, f"a row of {len(line)} signs instead of {columns} digits 0 or 1")
        cells[index] = np.frombuffer(line.encode(), np.uint8) == ord("1")
    return cells
