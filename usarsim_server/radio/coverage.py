"""How strong a signal from one place arrives everywhere else on a level: a table of cells."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.values import Vector
from usarsim_server.radio.propagation import Propagation
from usarsim_server.radio.station import ObstacleCounter
from usarsim_server.simulation.frames import flip_point
from usarsim_server.simulation.rays.fans import RayFan, RayHits

__all__ = ["Coverage", "Grid", "Walls", "find_walls", "survey"]

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
    """Signals of one source.

    Attributes:
        grid: the cells.
        source: the place of the source.
        strengths: dBm, (rows, columns).
        obstacles: between source and cell, (rows, columns); zero for a model that counts none.
        cutoff: dBm that a link needs.
    """

    grid: Grid
    source: Vector
    strengths: NDArray[np.float64]
    obstacles: NDArray[np.int64]
    cutoff: float

    @property
    def linked(self) -> NDArray[np.bool_]:
        """Where a link is up, (rows, columns)."""
        return self.strengths >= self.cutoff

    def write_csv(self, file: TextIO) -> None:
        """One line a cell: place in the wire frame (m), dBm, obstacles, 1 where a link is up."""
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["x", "y", "z", "strength", "obstacles", "linked"])
        linked = self.linked
        for row in range(self.grid.rows):
            for column in range(self.grid.columns):
                x, y, z = (round(value, 4) + 0.0 for value in self._place(row, column))
                strength = f"{self.strengths[row, column]:.6g}"
                cell = (row, column)
                rows.writerow([x, y, z, strength, self.obstacles[cell], int(linked[cell])])

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
    """Borders between cells that something solid crosses.

    Attributes:
        along_x: (rows, columns - 1), between a cell and the next one in x.
        along_y: (rows - 1, columns), between a cell and the next one in y.
    """

    along_x: NDArray[np.bool_]
    along_y: NDArray[np.bool_]


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
