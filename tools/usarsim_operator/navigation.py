"""Ways over a map of cells: where a robot fits, how far everything is, where the unknown begins.

All of it works on whole arrays: a wave that starts at the robot spreads by one cell a step, along
sides and over corners in turn, so that its steps come close to the true distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_operator.occupancy import CELL

UNKNOWN, FREE, WALL = 0, 1, 2

Cells = NDArray[np.bool_]
Steps = NDArray[np.int32]
Costs = NDArray[np.float64]
Some = tuple[NDArray[np.integer[Any]], ...]
"""Rows and columns of some cells."""
Part = tuple[slice, slice]
Place = tuple[float, float]
"""x, y in the protocol's frame (y to the right), m."""

FAR = np.iinfo(np.int32).max
"""Steps to where there is no way."""
_ROUNDING = 1e-6  # m


@dataclass(frozen=True, slots=True)
class Grid:
    """What is known of the floor.

    Attributes:
        cells: (rows, columns) of UNKNOWN, FREE, WALL; rows along y, columns along x.
        corner: x, y of the corner of the first cell, m.
    """

    cells: NDArray[np.uint8]
    corner: Place

    def cell(self, place: Place) -> tuple[int, int]:
        """Row and column of a place; those outside become the nearest one of the border."""
        rows, columns = self.cells.shape
        row = math.floor((place[1] - self.corner[1]) / CELL)
        column = math.floor((place[0] - self.corner[0]) / CELL)
        return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)

    def place(self, row: int, column: int) -> Place:
        """The middle of a cell."""
        return self.corner[0] + (column + 0.5) * CELL, self.corner[1] + (row + 0.5) * CELL

    def _off(self, cells: Some, place: Place) -> tuple[Costs, Costs]:
        """x and y from a place to the middles of cells, m."""
        rows, columns = (part.astype(np.float64) for part in cells)
        x = self.corner[0] + (columns + 0.5) * CELL - place[0]
        return x, self.corner[1] + (rows + 0.5) * CELL - place[1]

    def turns(self, cells: Some, pose: tuple[float, float, float]) -> NDArray[np.float64]:
        """How far a robot at x, y, yaw would turn to look at each of some cells, rad."""
        x, y = self._off(cells, pose[:2])
        off = np.arctan2(y, x) - pose[2]
        found: NDArray[np.float64] = np.abs((off + math.pi) % math.tau - math.pi)
        return found

    def within(self, cells: Some, place: Place, radius: float) -> Cells:
        """Which of some cells have their middles within `radius` m of a place."""
        x, y = self._off(cells, place)
        found: Cells = y**2 + x**2 <= radius**2
        return found

    def sees(self, cells: Some, place: Place, apart: float) -> Cells:
        """Whether no wall is between the middles of some cells and a place.

        Args:
            cells: which. place: of somebody, whom a scanner takes for a wall.
            apart: m around the place in which walls do not count.
        """
        x, y = self._off(cells, place)
        far = np.hypot(x, y)
        parts = np.linspace(0.0, 1.0, 1 + math.ceil(far.max(initial=0.0) / CELL))[:, None]
        rows, columns = (
            np.clip(((start + part * parts - low) / CELL).astype(int), 0, most - 1)
            for start, part, low, most in zip(
                place[::-1], (y, x), self.corner[::-1], self.cells.shape, strict=True
            )
        )
        between = (self.cells[rows, columns] == WALL) & (far * parts > apart)
        found: Cells = ~between.any(axis=0)
        return found

    def disc(self, place: Place, radius: float) -> tuple[Part, Cells]:
        """Which cells have their middles within `radius` m of a place.

        Returns:
            The part of the map that holds all of them, and which cells of it they are.
        """
        low = self.cell((place[0] - radius, place[1] - radius))
        high = self.cell((place[0] + radius, place[1] + radius))
        rows, columns = np.ogrid[low[0] : high[0] + 1, low[1] : high[1] + 1]
        part = slice(low[0], high[0] + 1), slice(low[1], high[1] + 1)
        return part, self.within((rows, columns), place, radius)

    def leave_out(self, cells: Cells, place: Place, radius: float) -> None:
        """Unmark the cells whose middles are within `radius` m of a place."""
        part, inside = self.disc(place, radius)
        cells[part] &= ~inside

    def near(self, which: Cells, radius: float) -> Steps:
        """How many of the marked cells are in the square of side 2 `radius` m around each cell."""
        side = 2 * round(radius / CELL) + 1
        marked, outside = which.view(np.uint8), cv2.BORDER_CONSTANT
        found = cv2.boxFilter(marked, cv2.CV_32S, (side, side), normalize=False, borderType=outside)
        return found.astype(np.int32, copy=False)

    def passable(self, start: Place, radius: float, *, unknown: bool) -> Cells:
        """Cells at which the middle of a robot may be.

        Args:
            start: where it stands; around it only walls themselves are in its way, or a robot
                beside a wall could never leave. Under it there is floor, seen or not: a scanner
                at its front has never looked there, and no way would lead from it.
            radius: how far its middle keeps from walls, m.
            unknown: whether it may go where nobody has looked.
        """
        walls = self.cells == WALL
        good: Cells = self.near(walls, radius) == 0
        part, around = self.disc(start, 1.5 * radius)
        good[part] |= around & ~walls[part]
        if not unknown:
            good &= self.cells == FREE
            part, under = self.disc(start, radius)
            good[part] |= under & ~walls[part]
        return good

    def frontier(self) -> Cells:
        """Free cells beside one that is unknown."""
        unknown = np.pad(self.cells == UNKNOWN, 1)
        beside = unknown[:-2, 1:-1] | unknown[2:, 1:-1] | unknown[1:-1, :-2] | unknown[1:-1, 2:]
        found: Cells = beside & (self.cells == FREE)
        return found


def distances(passable: Cells, start: tuple[int, int], more: Costs | None = None) -> Steps:
    """Steps from a cell to all others; the greatest number where there is no way.

    Args:
        passable: cells that may be gone through. start: row and column.
        more: what it costs to be at a cell, m, beside the way to it; infinite where nobody wants
            to be. The wave ends where all that it has not reached is dearer than the best that it
            has: those are as if there were no way.
    """
    rows, columns = passable.shape
    width = columns + 2
    room = np.pad(passable, 1).reshape(-1)
    found = np.full(room.size, FAR, np.int32)
    costs = None if more is None else np.pad(more, 1).reshape(-1)
    numbers = np.empty(room.size, np.int64)
    sides = np.array((1, -1, width, -width))
    around = np.array((*sides, width + 1, width - 1, 1 - width, -1 - width))
    wave = np.array([(start[0] + 1) * width + start[1] + 1])
    room[wave], found[wave] = False, 0
    step, best = 0, math.inf
    while len(wave):
        if costs is not None:
            best = min(best, CELL * step + float(costs[wave].min()))
            if CELL * step > best + _ROUNDING:
                break
        step += 1
        beside = (wave[:, None] + (sides if step % 2 else around)).reshape(-1)
        beside = beside[room[beside]]
        room[beside], found[beside] = False, step
        order = np.arange(len(beside))
        numbers[beside] = order  # a cell that is beside several is taken once
        wave = beside[numbers[beside] == order]
    return found.reshape(rows + 2, width)[1:-1, 1:-1]


def space(passable: Cells, start: tuple[int, int]) -> float:
    """Area that can be reached from a passable cell, m2."""
    _, labels = cv2.connectedComponents(passable.view(np.uint8), connectivity=8)
    return float(np.count_nonzero(labels == labels[start])) * CELL**2


def way(steps: Steps, goal: tuple[int, int]) -> list[tuple[int, int]]:
    """Cells from the start of the wave to a goal, downhill; empty if there is no way."""
    if steps[goal] == FAR:
        return []
    cells = [goal]
    rows, columns = steps.shape
    while steps[cells[-1]]:
        row, column = cells[-1]
        beside = [
            (row + down, column + right)
            for down, right in (
                (0, 1),
                (0, -1),
                (1, 0),
                (-1, 0),
                (1, 1),
                (1, -1),
                (-1, 1),
                (-1, -1),
            )
            if 0 <= row + down < rows and 0 <= column + right < columns
        ]
        cells.append(min(beside, key=lambda one: int(steps[one])))
    return cells[::-1]
