"""How strong a signal from one place arrives everywhere else on a level: a table of cells.

Pictures of coverage: cells coloured by signal strength, walls, source and a scale.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TextIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from usarsim_server.csv_files import CsvWriter
from usarsim_server.protocol.values import Vector
from usarsim_server.radio.models import Propagation
from usarsim_server.radio.network import ObstacleCounter
from usarsim_server.simulation.frames import flip_point
from usarsim_server.simulation.rays.query import RayFan, RayHits

CastScenery = Callable[[Sequence[RayFan]], list[RayHits]]
"""Answers ray fans against what never moves: `Simulation.cast_scenery`."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Square cells on a level (simulation frame, m).

    Attributes:
        x, y: of the middle of the first cell.
        columns: cells along x. rows: cells along y.
        cell: edge of a cell.
        height: of the level.
    """

    x: float
    y: float
    columns: int
    rows: int
    cell: float
    height: float

    @classmethod
    def over(cls, low: Sequence[float], high: Sequence[float], cell: float, height: float) -> Grid:
        """A grid that covers the rectangle between two corners (x, y)."""
        columns, rows = (
            max(1, math.ceil((b - a) / cell - 1e-9)) for a, b in zip(low[:2], high[:2], strict=True)
        )
        return cls(low[0] + cell / 2, low[1] + cell / 2, columns, rows, cell, height)

    def centre(self, row: int, column: int) -> Vector:
        """Middle of a cell."""
        return self.x + column * self.cell, self.y + row * self.cell, self.height

    def centres(self) -> NDArray[np.float64]:
        """Middles of all cells, (rows, columns, 3)."""
        xs = self.x + self.cell * np.arange(self.columns)
        ys = self.y + self.cell * np.arange(self.rows)
        points = np.empty((self.rows, self.columns, 3))
        points[..., 0], points[..., 1] = np.meshgrid(xs, ys)
        points[..., 2] = self.height
        return points


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Signals of one source."""

    grid: Grid  # the cells
    source: Vector  # the place of the source
    strengths: NDArray[np.float64]  # dBm, (rows, columns)
    obstacles: NDArray[np.int64]
    """Between source and cell, (rows, columns); zero for a model that counts none."""
    cutoff: float  # dBm that a link needs

    @property
    def linked(self) -> NDArray[np.bool_]:
        """Where a link is up, (rows, columns)."""
        return self.strengths >= self.cutoff

    def write_csv(self, file: TextIO) -> None:
        """One line a cell: place in the wire frame (m), dBm, obstacles, 1 where a link is up."""
        rows = CsvWriter(file)
        rows.row(["x", "y", "z", "strength", "obstacles", "linked"])
        linked = self.linked
        for row in range(self.grid.rows):
            for column in range(self.grid.columns):
                x, y, z = (round(value, 4) + 0.0 for value in self._place(row, column))
                strength = f"{self.strengths[row, column]:.6g}"
                cell = (row, column)
                rows.row([x, y, z, strength, self.obstacles[cell], int(linked[cell])])

    def _place(self, row: int, column: int) -> Vector:
        return flip_point(self.grid.centre(row, column))


def survey(model: Propagation, obstacles: ObstacleCounter, source: Vector, grid: Grid) -> Coverage:
    """Ask the model about every cell, as the wireless simulation would.

    Args:
        model: propagation.
        obstacles: counts what stands between.
        source: place of the source (simulation frame, m).
        grid: the cells.
    """
    strengths = np.empty((grid.rows, grid.columns))
    counts = np.zeros((grid.rows, grid.columns), np.int64)
    for row in range(grid.rows):
        for column in range(grid.columns):
            place = grid.centre(row, column)
            if model.counts_obstacles:
                counts[row, column] = obstacles.count(source, place)
            distance = math.dist(source, place)
            strengths[row, column] = model.strength(distance, int(counts[row, column]))
    return Coverage(grid, source, strengths, counts, model.cutoff)


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """Borders between cells that something solid crosses."""

    along_x: NDArray[np.bool_]  # (rows, columns - 1), between a cell and the next one in x
    along_y: NDArray[np.bool_]  # (rows - 1, columns), between a cell and the next one in y


def find_walls(cast: CastScenery, grid: Grid) -> Walls:
    """Look from the middle of every cell to those of its neighbours."""
    centres = grid.centres()

    def blocked(starts: NDArray[np.float64], way: Vector) -> NDArray[np.bool_]:
        shape = starts.shape[:2]
        if not starts.size:
            return np.zeros(shape, np.bool_)
        origins = starts.reshape(-1, 3)
        directions = np.broadcast_to(np.array(way), origins.shape)
        (hits,) = cast([RayFan(origins, directions, grid.cell)])
        return np.isfinite(hits.distances).reshape(shape)

    return Walls(blocked(centres[:, :-1], (1.0, 0.0, 0.0)), blocked(centres[:-1], (0.0, 1.0, 0.0)))


Pixels = NDArray[np.uint8]

WIDTH = 960
"""Pixels that the longer side is to have, about."""
FOOT = 46
"""Pixels below the map, for the scale."""
WALL = (20, 20, 20)
SOURCE = (215, 30, 30)
SILENCE = (190, 190, 190)
"""Where no link is up."""
_INK, _PAPER = (0, 0, 0), (255, 255, 255)

# From the cutoff to the strongest: the anchors of viridis (matplotlib, CC0), evenly spaced.
_SCALE = np.array(
    [(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)], np.float64
)


def color_of(strengths: NDArray[np.float64], low: float, high: float) -> Pixels:
    """Colours (..., 3) of strengths (dBm) on a scale from `low` to `high`; grey below it."""
    known = np.nan_to_num(strengths, nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    part = np.clip((known - low) / max(high - low, 1e-9), 0.0, 1.0) * (len(_SCALE) - 1)
    below = np.minimum(part.astype(np.intp), len(_SCALE) - 2)
    mix = (part - below)[..., None]
    colors = _SCALE[below] * (1.0 - mix) + _SCALE[below + 1] * mix
    colors[known < low] = SILENCE
    rounded: Pixels = colors.round().astype(np.uint8)
    return rounded


def pixels_per_cell(coverage: Coverage) -> int:
    """Edge of a cell in pixels."""
    return max(1, WIDTH // max(coverage.grid.columns, coverage.grid.rows))


def draw_coverage(coverage: Coverage, walls: Walls, title: str) -> Image.Image:
    """Draw a map as seen from above, x of the wire to the right, y of the wire downwards.

    Args:
        coverage: strengths of the cells.
        walls: between them.
        title: stands below the map.
    """
    size = pixels_per_cell(coverage)
    finite = coverage.strengths[np.isfinite(coverage.strengths)]
    high = float(finite.max()) if finite.size else coverage.cutoff
    high = max(high, coverage.cutoff + 1.0)
    # Rows grow with y to the left of x, so the last one is on top.
    cells = color_of(coverage.strengths, coverage.cutoff, high)[::-1]
    field = np.repeat(np.repeat(cells, size, axis=0), size, axis=1)
    height, width = field.shape[:2]
    image = Image.new("RGB", (max(width, 320), height + FOOT), _PAPER)
    image.paste(Image.fromarray(field), (0, 0))
    draw = ImageDraw.Draw(image)
    _draw_walls(draw, walls, size, coverage.grid.rows)
    _draw_source(draw, coverage, size)
    _draw_foot(image, height, coverage.cutoff, high, title)
    return image


def _draw_walls(draw: ImageDraw.ImageDraw, walls: Walls, size: int, rows: int) -> None:
    thick = max(1, size // 3)
    for row, column in np.argwhere(walls.along_x).tolist():
        x, y = (column + 1) * size, (rows - 1 - row) * size
        draw.line([(x, y), (x, y + size)], WALL, thick)
    for row, column in np.argwhere(walls.along_y).tolist():
        x, y = column * size, (rows - 1 - row) * size
        draw.line([(x, y), (x + size, y)], WALL, thick)


def _draw_source(draw: ImageDraw.ImageDraw, coverage: Coverage, size: int) -> None:
    grid = coverage.grid
    x = ((coverage.source[0] - grid.x) / grid.cell + 0.5) * size
    y = (grid.rows - ((coverage.source[1] - grid.y) / grid.cell + 0.5)) * size
    draw.ellipse([x - 6, y - 6, x + 6, y + 6], SOURCE, _PAPER, 2)


def _draw_foot(image: Image.Image, top: int, low: float, high: float, title: str) -> None:
    draw, font = ImageDraw.Draw(image), ImageFont.load_default()
    bar = color_of(np.linspace(low, high, 180), low, high)
    image.paste(Image.fromarray(np.repeat(bar[None], 12, axis=0)), (70, top + 8))
    draw.rectangle([8, top + 8, 22, top + 19], SILENCE, _INK)
    draw.text((28, top + 8), "none", _INK, font)
    draw.text((70, top + 24), f"{low:.4g} dBm", _INK, font)
    draw.text((215, top + 24), f"{high:.4g}", _INK, font)
    draw.text((270, top + 8), title, _INK, font)
