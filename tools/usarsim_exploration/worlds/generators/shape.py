"""What a user may say about a generated environment, and what a generator draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_server.base.fields import field

WALL = 2
"""Cells that a wall between two rooms is thick."""
CORRIDOR = 20
"""Cells that a corridor is wide."""
CELL = 0.1
"""m that a cell is wide."""
PASSABLE = 8
"""Cells between two obstacles that a robot can still drive between, in the physics too."""


@dataclass(frozen=True, slots=True)
class Shape:
    """How large and how crowded an environment is; every generator takes what it has use for."""

    columns: int = field(default=400, low=100, high=2000, unit="cells", help="width")
    rows: int = field(default=300, low=100, high=2000, unit="cells", help="height")
    rooms: int = field(
        default=40, low=10, high=400, unit="cells", help="mean side of rooms, chambers and blocks"
    )
    doors: int = field(default=10, low=PASSABLE, high=40, unit="cells", help="width of doors")
    loops: float = field(
        default=0.2, low=0.0, high=1.0, help="part of the doors and ways that are not necessary"
    )
    clutter: float = field(default=0.1, low=0.0, high=1.0, help="how much stands in rooms")


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """What a generator makes.

    Attributes:
        walls: (rows, columns) 1 where a wall is, else 0.
        base: about where the base should stand.
    """

    walls: NDArray[np.uint8]
    base: Cell
