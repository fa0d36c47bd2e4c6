"""A raster of the floor: what robots have mapped, or what is true."""

from __future__ import annotations

import base64
import binascii
import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

UNKNOWN, FREE, WALL = 0, 1, 2
LARGEST = 5000
"""Cells of a side."""


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Cells of the floor, rows along y, columns along x, in the frame of MuJoCo.

    Attributes:
        x: of the corner of the first cell, m; the least one.
        y: of the same corner, m.
        cell: side of a cell, m.
        cells: (rows, columns) of `UNKNOWN`, `FREE` and `WALL`, uint8.
    """

    x: float
    y: float
    cell: float
    cells: NDArray[np.uint8]

    def packed(self) -> dict[str, object]:
        """Plain values, as `world.json` and the record `map` keep them."""
        rows, columns = self.cells.shape
        data = zlib.compress(np.ascontiguousarray(self.cells, np.uint8).tobytes(), 9)
        return {
            "x": self.x,
            "y": self.y,
            "cell": self.cell,
            "rows": rows,
            "columns": columns,
            "cells": base64.b64encode(data).decode(),
        }

    @classmethod
    def unpacked(cls, plain: Mapping[str, object]) -> Grid:
        """The opposite of `packed`.

        Raises:
            ValueError: something is missing or cannot be.
        """
        x, y, cell = (_number(plain, key) for key in ("x", "y", "cell"))
        rows, columns = (int(_number(plain, key)) for key in ("rows", "columns"))
        if cell <= 0.0 or not (1 <= rows <= LARGEST and 1 <= columns <= LARGEST):
            raise ValueError(f"a grid of {rows} by {columns} cells of {cell} m cannot be")
        unpacker = zlib.decompressobj()
        try:
            data = base64.b64decode(str(plain.get("cells", "")), validate=True)
            values = unpacker.decompress(data, rows * columns + 1)
        except (binascii.Error, zlib.error, ValueError):
            raise ValueError("the cells of the grid are damaged") from None
        if len(values) != rows * columns:
            raise ValueError(f"the grid has not {rows} by {columns} cells")
        cells = np.frombuffer(values, np.uint8).reshape(rows, columns)
        if cells.max() > WALL:
            raise ValueError("cells of the grid are not 0, 1 or 2")
        return cls(x, y, cell, cells)

    def at(self, x: float, y: float) -> int:
        """What is at a place, m; unknown outside."""
        row, column = self.index(x, y)
        rows, columns = self.cells.shape
        inside = 0 <= row < rows and 0 <= column < columns
        return int(self.cells[row, column]) if inside else UNKNOWN

    def index(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of a place, m; they may lie outside."""
        return math.floor((y - self.y) / self.cell), math.floor((x - self.x) / self.cell)


def _number(plain: Mapping[str, object], key: str) -> float:
    value = plain.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"the grid has no {key}")
    return value
