"""The full frame while it is being painted, and the frames that are published from it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_server.cameras.view import Frame, Grid, Region

__all__ = ["EMPTY", "Atlas"]

EMPTY = (0, 0, 0)
"""Colour of a tile without a camera."""


class Atlas:
    """Tiles side by side; belongs to the rendering thread, its frames to everybody.

    A frame is a copy, made when there is something new: readers keep frames as long as they like,
    and nobody waits for anybody. A copy of 1280 x 960 pixels takes about 0.4 ms.
    """

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        self._pixels = np.empty((grid.height, grid.width, 3), np.uint8)
        self._pixels[:] = EMPTY
        self._shows: list[int | None] = [None] * grid.tiles
        self._time = 0.0
        self._changed: set[int] = set()
        self.frame = self._copy(0)

    @property
    def shows(self) -> tuple[int | None, ...]:
        """Key of the camera whose picture is in each tile; None: the tile is empty."""
        return tuple(self._shows)

    def paint(self, tile: int, key: int, picture: NDArray[np.uint8], time: float) -> None:
        """Put a picture into a tile.

        Args:
            tile: its number.
            key: of the camera that saw it.
            picture: (height, width, 3); what the tile has beyond it is empty.
            time: simulated s at which it was seen.
        """
        part, (height, width, _) = self._part(tile), picture.shape
        part[height:], part[:height, width:] = EMPTY, EMPTY
        part[:height, :width] = picture
        self._shows[tile] = key
        self._time = max(self._time, time)
        self._changed.add(tile)

    def wipe(self, tile: int, key: int | None = None) -> None:
        """Empty a tile; a key stands for a camera that sees nothing at present."""
        self._part(tile)[:] = EMPTY
        self._shows[tile] = key
        self._changed.add(tile)

    def publish(self) -> tuple[Frame, frozenset[int]] | None:
        """A new frame and the tiles that are new in it; None if nothing has changed."""
        if not self._changed:
            return None
        changed, self._changed = frozenset(self._changed), set()
        self.frame = self._copy(self.frame.number + 1)
        return self.frame, changed

    def _part(self, tile: int) -> NDArray[np.uint8]:
        region: Region = self._grid.region(tile)
        return self._pixels[region.y : region.y + region.height, region.x : region.x + region.width]

    def _copy(self, number: int) -> Frame:
        pixels = self._pixels.copy()
        pixels.flags.writeable = False
        return Frame(number, self._time, pixels)
