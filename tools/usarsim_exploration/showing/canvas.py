"""What overlays draw with: a picture whose cells are squares of some pixels, and a few strokes.

Nothing is smoothed, so an overlay changes its own pixels and no others, and the same scene gives
the same bytes.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.showing.scene import Cells, Figure, Scene

Picture = NDArray[np.uint8]
"""(rows, columns, 3) red green blue."""
Colour = tuple[int, int, int]
_WIDE = 1200
_LARGEST = 16
"""Pixels: of a picture about, and of a cell at most."""


def scale_of(columns: int) -> int:
    """Pixels per cell of a world of so many columns."""
    return min(max(round(_WIDE / columns), 1), _LARGEST)


class Canvas:
    """A picture of a scene that grows.

    Attributes:
        scene: of what. robot: whose map and plans are shown; None: the team's.
        bits: that map. cells: one pixel per cell, to be painted first. scale: pixels per cell.
        picture: what strokes go to, after `enlarge`.
    """

    def __init__(self, scene: Scene, robot: int | None, background: Colour) -> None:
        self.scene, self.robot = scene, robot
        self.bits = scene.known(robot)
        self.scale = scale_of(self.bits.shape[1])
        self.cells: Picture = np.full((*self.bits.shape, 3), background, np.uint8)
        self.picture = self.cells

    def enlarge(self) -> None:
        """Cells are painted; strokes follow."""
        self.picture = self.cells.repeat(self.scale, axis=0).repeat(self.scale, axis=1)

    @property
    def numbers(self) -> Sequence[int]:
        """Of whom plans are shown; all, the base first, or one."""
        return range(len(self.scene.figures)) if self.robot is None else [self.robot]

    @property
    def figures(self) -> list[Figure]:
        """The same, as figures."""
        return [self.scene.figures[number] for number in self.numbers]

    def pixels(self, cells: Cells | NDArray[np.int32] | Sequence[Cell]) -> NDArray[np.int32]:
        """(n, 2) middles of cells."""
        found = np.asarray(cells, np.int64).reshape(-1, 2) * self.scale + self.scale // 2
        return found.astype(np.int32)

    def point(self, cell: Cell) -> Cell:
        """The middle of a cell."""
        column, row = self.pixels([cell])[0].tolist()
        return column, row

    def way(
        self, cells: Cells | NDArray[np.int32] | Sequence[Cell], colour: Colour,
        width: int = 1, *, closed: bool = False,
    ) -> None:  # fmt: skip
        """Lines from cell to cell."""
        cv2.polylines(self.picture, [self.pixels(cells)], closed, colour, width, cv2.LINE_8)

    def dots(self, cells: Cells | Sequence[Cell], colour: Colour, radius: int = 2) -> None:
        """Small discs; radius in pixels."""
        for column, row in self.pixels(cells).tolist():
            cv2.circle(self.picture, (column, row), radius, colour, -1, cv2.LINE_8)

    def ring(self, cell: Cell, colour: Colour, radius: int) -> None:
        """A circle; radius in pixels."""
        cv2.circle(self.picture, self.point(cell), radius, colour, 2, cv2.LINE_8)

    def mark(self, cell: Cell, colour: Colour, kind: int, size: int = 12) -> None:
        """A sign of OpenCV's; size in pixels."""
        cv2.drawMarker(self.picture, self.point(cell), colour, kind, size, 2, cv2.LINE_8)

    def text(self, cell: Cell, words: str, colour: Colour, aside: int = 8) -> None:
        """Words right above a cell, so many pixels aside."""
        column, row = self.point(cell)
        place = column + aside, row - aside
        cv2.putText(self.picture, words, place, cv2.FONT_HERSHEY_PLAIN, 1.0, colour, 1, cv2.LINE_8)
