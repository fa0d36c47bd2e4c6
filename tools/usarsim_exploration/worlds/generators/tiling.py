"""Floor plans: regions side by side, a wall between any two, and doors that join them all.

A region is a number painted into a raster; 0 is wall. Wherever two regions have nothing but a wall
between them a door is possible. Random ones of these make a spanning tree, so that everything can
be reached; then some more are opened, which make loops.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.worlds.generators.clutter import scatter
from usarsim_exploration.worlds.generators.shape import WALL, Drawing, Shape


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Cells from (left, top) to (right, bottom), the latter two not included."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def width(self) -> int:
        """Cells."""
        return self.right - self.left

    @property
    def height(self) -> int:
        """Cells."""
        return self.bottom - self.top

    @property
    def middle(self) -> tuple[int, int]:
        """The cell in the middle."""
        return (self.left + self.right) // 2, (self.top + self.bottom) // 2

    def inset(self, cells: int) -> Rectangle:
        """Smaller on all four sides."""
        return Rectangle(
            self.left + cells, self.top + cells, self.right - cells, self.bottom - cells
        )


@dataclass(frozen=True, slots=True)
class _Gap:
    """A place for a door: a wall's first row or column, and where along it there is room."""

    upright: bool
    at: int
    low: int
    high: int


class Tiling:
    """A floor plan in the making."""

    def __init__(self, shape: Shape, random: np.random.Generator) -> None:
        """All is wall."""
        self.shape, self.random = shape, random
        self.regions = np.zeros((shape.rows, shape.columns), np.int32)
        self._count = 0
        self._halls: set[int] = set()

    @property
    def whole(self) -> Rectangle:
        """All but the outer walls."""
        return Rectangle(0, 0, self.shape.columns, self.shape.rows).inset(WALL)

    def paint(self, *parts: Rectangle, hall: bool = False) -> None:
        """Make a region of rectangles; a hall is a region that doors lead to first, such as a
        corridor."""
        self._count += 1
        if hall:
            self._halls.add(self._count)
        for part in parts:
            self.regions[part.top : part.bottom, part.left : part.right] = self._count

    def erase(self, part: Rectangle) -> None:
        """Make wall of it."""
        self.regions[part.top : part.bottom, part.left : part.right] = 0

    def rooms(self, part: Rectangle, side: int | None = None) -> None:
        """Fill a rectangle with rooms of about the side that the shape asks for."""
        for room in self.split(part, side or self.shape.rooms):
            self.paint(room)

    def split(self, part: Rectangle, side: int) -> list[Rectangle]:
        """Cut a rectangle across its longer side, again and again, with walls between."""
        length = max(part.width, part.height)
        if length < 1.6 * side + WALL:
            return [part]
        share = 0.35 + 0.3 * self.random.random()
        if length < 2.6 * side:
            share = 0.45 + 0.1 * self.random.random()
        cut = int(length * share)
        left, top, right, bottom = part.left, part.top, part.right, part.bottom
        if part.width >= part.height:
            one = Rectangle(left, top, left + cut, bottom)
            other = Rectangle(left + cut + WALL, top, right, bottom)
        else:
            one = Rectangle(left, top, right, top + cut)
            other = Rectangle(left, top + cut + WALL, right, bottom)
        return self.split(one, side) + self.split(other, side)

    def finish(self, base: tuple[int, int]) -> Drawing:
        """Doors and clutter."""
        walls = (self.regions == 0).astype(np.uint8)
        joined = list(range(self._count + 1))

        def root(region: int) -> int:
            while joined[region] != region:
                region = joined[region]
            return region

        borders = self._borders()
        pairs = sorted(borders)
        order = self.random.permutation(len(pairs))
        keys = [(not self._halls & set(pairs[i]), rank) for rank, i in enumerate(order)]
        spare = []
        for _, rank in sorted(keys):
            pair = pairs[order[rank]]
            one, other = map(root, pair)
            if one != other:
                joined[one] = other
                self._open(walls, borders[pair])
            else:
                spare.append(pair)
        for pair in spare:
            if self.random.random() < self.shape.loops:
                self._open(walls, borders[pair])
        rooms = (self.regions > 0) & ~np.isin(self.regions, sorted(self._halls))
        scatter(walls, rooms, self.shape.clutter, self.random)
        return Drawing(walls, base)

    def _borders(self) -> dict[tuple[int, int], list[_Gap]]:
        """Of each two regions the places where a door fits between them."""
        found: dict[tuple[int, int], list[_Gap]] = {}
        for upright, regions in ((True, self.regions), (False, self.regions.T)):
            one, other = regions[:, : -WALL - 1], regions[:, WALL + 1 :]
            meets = (one > 0) & (other > 0) & (one != other)
            for wall in range(1, WALL + 1):
                meets &= regions[:, wall : wall + one.shape[1]] == 0
            for at in np.flatnonzero(meets.any(axis=0)).tolist():
                rows = np.flatnonzero(meets[:, at])
                both = np.stack([one[rows, at], other[rows, at]], axis=1)
                ends = (np.diff(rows) != 1) | (np.diff(both, axis=0) != 0).any(axis=1)
                begins = [0, *(np.flatnonzero(ends) + 1).tolist(), len(rows)]
                for first, last in pairwise(begins):
                    low, high = int(rows[first]), int(rows[last - 1]) + 1
                    if high - low >= self.shape.doors + 2:
                        a, b = sorted(map(int, both[first]))
                        found.setdefault((a, b), []).append(_Gap(upright, at + 1, low, high))
        return found

    def _open(self, walls: NDArray[np.uint8], gaps: list[_Gap]) -> None:
        """A door somewhere along one of the gaps."""
        gap = gaps[int(self.random.integers(len(gaps)))]
        width = self.shape.doors
        low = int(self.random.integers(gap.low + 1, gap.high - width))
        along, across = slice(low, low + width), slice(gap.at, gap.at + WALL)
        walls[(along, across) if gap.upright else (across, along)] = 0
