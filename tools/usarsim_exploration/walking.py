"""Walking without a plan: straight lines of cells, and how far walls are from where a robot is."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.known_map import FREE, KNOWN, WALL, KnownMap
from usarsim_exploration.planning import Path

if TYPE_CHECKING:
    from usarsim_exploration.strategy import View

CLEAR = 3.0
"""Cells from known walls that random steps keep."""
TURNS = np.deg2rad(np.repeat([-45.0, -22.5, 0.0, 22.5, 45.0], [1, 2, 20, 2, 1]))
"""Tickets of the draw, rad."""
_TRIES = 100
_MOVES = ((1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1))
_SHORTEST = 3
"""Cells of a step that is tried at least."""


def line(start: Cell, goal: Cell) -> Path:
    """Neighbouring cells from one cell straight to another, without the first."""
    right, down = goal[0] - start[0], goal[1] - start[1]
    parts = max(abs(right), abs(down))
    return [
        (start[0] + round(right * part / parts), start[1] + round(down * part / parts))
        for part in range(1, parts + 1)
    ]


def through(start: Cell, places: Iterable[Cell]) -> Path:
    """Neighbouring cells from one cell straight to places in turn, without the first."""
    found: Path = []
    for place in places:
        if place != start:
            found += line(start, place)
            start = place
    return found


def stroll(view: View, course: float, clearance: float = CLEAR) -> tuple[Path, float]:
    """A random step, as long as the speed at most, and its course.

    The first of up to 100 draws that meets no known wall. Turns of failed draws add up, so that a
    robot before a wall turns away from it.

    Args:
        course: rad, from which turns are drawn. clearance: from known walls, cells; 1 after 50
            failures.
    """
    length = max(_SHORTEST, int(view.speed))
    around = Surroundings(view.known, view.cell, length + int(clearance) + 2)
    for attempt in range(_TRIES):
        course += draw_turn(view.random)
        right, down = length * math.cos(course), length * math.sin(course)
        path = line(view.cell, (view.cell[0] + round(right), view.cell[1] + round(down)))
        need = clearance if attempt < _TRIES // 2 else 1.0
        if path and around.room(path[-1]) >= need and around.passable(view.cell, path):
            return path, course
        shortest = 1 if view.rules.narrow and attempt >= _TRIES // 2 else _SHORTEST
        length = max(length - 1, shortest)
    return [], course


def onward(view: View, path: Path) -> Path:
    """A path, and from its end on into the unknown for what is left of its last step.

    Only of a robot that sees less than it drives in a step: else it would spend most steps on the
    few cells to the end of what it sees.
    """
    if not path or not view.rules.short or view.reach >= view.speed:
        return path
    cells = [view.cell, *path]
    far = sum(map(math.dist, cells, path))
    course = math.atan2(path[-1][1] - cells[-2][1], path[-1][0] - cells[-2][0])
    return path + into_unknown(view, path[-1], course, -far % view.speed)


def into_unknown(view: View, start: Cell, course: float, far: float) -> Path:
    """The straight way through unknown cells on which most is seen; none: there is none.

    Args:
        start: beside the unknown. course: rad, which of equal ways is nearest to. far: cells.
    """
    bits, found, most = view.known.bits, list[Cell](), 0
    beside = max(1, min(view.reach, int(far)))

    def at(column: int, row: int) -> int:
        inside = 0 <= column < bits.shape[1] and 0 <= row < bits.shape[0]
        return int(bits[row, column]) & KNOWN if inside else WALL

    def turned(move: Cell) -> float:
        return abs(math.remainder(math.atan2(move[1], move[0]) - course, math.tau))

    for right, down in sorted(_MOVES, key=turned):
        way, news, (column, row) = list[Cell](), 0, start
        for _ in range(int(far / math.hypot(right, down) + 1e-9)):
            walls = (at(column + right, row) | at(column, row + down)) & WALL
            column, row = column + right, row + down
            if walls or at(column, row):
                break
            way.append((column, row))
            news += 1 + sum(
                not at(column - side * down, row + side * right) for side in (-beside, beside)
            )
        if news > most:
            found, most = way, news
    return found


def draw_turn(random: np.random.Generator) -> float:
    """By how much to turn, rad."""
    return float(TURNS[random.integers(len(TURNS))])


class Surroundings:
    """The known map around a robot.

    Attributes:
        clearance: distance of each cell to the nearest known wall, as far as `reach`; cells.
    """

    def __init__(self, known: KnownMap, cell: Cell, reach: int) -> None:
        """reach: cells to each side that will be asked for."""
        rows, columns = known.bits.shape
        self._left, self._top = max(cell[0] - reach, 0), max(cell[1] - reach, 0)
        right, bottom = min(cell[0] + reach + 1, columns), min(cell[1] + reach + 1, rows)
        bits = known.bits[self._top : bottom, self._left : right]
        self._free = bits & (FREE | WALL) == FREE
        self._open = bits & WALL == 0
        padded = np.pad(self._open.astype(np.uint8), 1, constant_values=1)
        # beyond the edge of the world there is nothing to drive on
        padded[0] = self._top > 0
        padded[-1] = bottom < rows
        padded[:, 0] &= self._left > 0
        padded[:, -1] &= right < columns
        away = cv2.distanceTransform(padded, cv2.DIST_L2, 5)[1:-1, 1:-1]
        self.clearance: NDArray[np.float32] = away.astype(np.float32, copy=False)

    def _at(self, cell: Cell) -> tuple[int, int] | None:
        row, column = cell[1] - self._top, cell[0] - self._left
        inside = 0 <= row < self._open.shape[0] and 0 <= column < self._open.shape[1]
        return (row, column) if inside else None

    def room(self, cell: Cell) -> float:
        """Distance to the nearest known wall, cells; 0 on one, and out of reach."""
        at = self._at(cell)
        return 0.0 if at is None else float(self.clearance[at])

    def is_free(self, cell: Cell) -> bool:
        """Whether a cell is known to be free."""
        at = self._at(cell)
        return at is not None and bool(self._free[at])

    def passable(self, start: Cell, path: Path) -> bool:
        """Whether a path of neighbours meets no known wall and cuts no corner."""
        for cell in path:
            for one in (cell, (cell[0], start[1]), (start[0], cell[1])):
                at = self._at(one)
                if at is None or not self._open[at]:
                    return False
            start = cell
        return True
