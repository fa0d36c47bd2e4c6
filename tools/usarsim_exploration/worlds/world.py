"""A world to explore: the truth, where the base stands and where robots start."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.kernels import flood
from usarsim_exploration.kernels.steps import EVERYWHERE
from usarsim_server.errors import WorldError, at

Draw = Literal["drawn", "drawn at a wall", "drawn in the open"]
DRAWS: tuple[Draw, ...] = get_args(Draw)
"""How the seed may draw places."""
STARTS = 16
_ROOMS = ((8, 4), (4, 2), (2, 1), (1, 1))
"""Cells between two starts, and from a start to a wall: as much as there is room for."""


@dataclass(frozen=True, eq=False)
class World:
    """An environment and where runs begin in it.

    Attributes:
        environment: true. title: for people.
        base: cell of the base. starts: of robots, the nearest to the base first.
    """

    environment: Environment
    title: str
    base: Cell
    starts: tuple[Cell, ...]

    @cached_property
    def digest(self) -> str:
        """SHA-256 of size and cells, base and starts: worlds that are the same have the same."""
        found = hashlib.sha256(repr((self.environment.shape, self.base, self.starts)).encode())
        found.update(np.packbits(self.environment.walls != 0).tobytes())
        return found.hexdigest()


def settle(environment: Environment, title: str, wanted: Cell | None = None) -> World:
    """Find a place for the base and for the robots.

    The base stands in the largest connected part of the free space, on the cell with enough room
    that is nearest to the wanted one; default where there is most room. Starts follow in order of
    the way from there.

    Raises:
        WorldError: there is no free cell.
    """
    part = _largest_part(environment)
    clear = clearance(environment.walls)
    room = min(_ROOMS[0][1], int(clear[part].max()))
    if wanted is None:
        base = _cell(np.where(part, -clear, 1))
    else:
        rows, columns = np.indices(part.shape)
        away = (rows - wanted[1]) ** 2 + (columns - wanted[0]) ** 2
        base = _cell(np.where(part & (clear >= room), away, away.max() + 1))
    return World(environment, title, base, _starts(environment, clear, base))


def draw_places(environment: Environment, title: str, where: Draw, seed: int) -> World:
    """The same for the same seed, whoever explores; places are in the largest connected part.

    Args:
        environment: to explore. title: of the world.
        where: with room around; on cells beside walls; or among the tenth of the cells that have
            the longest way to a wall. seed: of the base's place; robots start near it.

    Raises:
        WorldError: there is no free cell.
    """
    part = _largest_part(environment)
    clear = clearance(environment.walls)
    if where == "drawn at a wall":
        allowed = part & (clear == 1)
    elif where == "drawn in the open":
        allowed = part & (clear >= np.quantile(clear[part], 0.9))
    else:
        allowed = part & (clear >= min(_ROOMS[0][1], int(clear[part].max())))
    cells = np.argwhere(allowed)
    random = np.random.Generator(np.random.PCG64([seed, len(cells)]))
    row, column = cells[random.integers(len(cells))].tolist()
    if where == "drawn at a wall":  # robots, too
        clear = np.where(allowed, _ROOMS[0][1], 0)
    base = column, row
    return World(environment, title, base, _starts(environment, clear, base))


def _largest_part(environment: Environment) -> NDArray[np.bool_]:
    """Where the largest connected part of the free space is."""
    free = (environment.walls == 0).astype(np.uint8)
    count, labels, facts, _ = cv2.connectedComponentsWithStats(free, connectivity=4)
    if count < 2:
        cure = "walls are black and 1, free cells white and 0"
        raise WorldError(at(environment.name, "there is no free cell", cure))
    found: NDArray[np.bool_] = labels == 1 + int(np.argmax(facts[1:, cv2.CC_STAT_AREA]))
    return found


def clearance(walls: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Whole cells from each cell to the nearest wall or the edge of the world, rounded down."""
    padded = np.pad((walls == 0).astype(np.uint8), 1)
    away = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(away[1:-1, 1:-1] + 1e-3, np.int64)


def _cell(costs: NDArray[np.int64]) -> Cell:
    """The cheapest cell, the first of equals."""
    row, column = divmod(int(np.argmin(costs)), costs.shape[1])
    return column, row


def _starts(environment: Environment, clear: NDArray[np.int64], base: Cell) -> tuple[Cell, ...]:
    free = (environment.walls == 0).astype(np.uint8)
    costs, _ = flood(free, np.array([base], np.int64), free.size, EVERYWHERE)
    order = np.argsort(costs, axis=None, kind="stable")[1:]
    order = order[costs.reshape(-1)[order] < np.iinfo(costs.dtype).max]
    found: list[Cell] = []
    for apart, room in _ROOMS:
        open_ = clear >= room
        found = []
        for taken in (base,):
            _take(open_, taken, apart)
        for flat in order:  # few of them are looked at: no list of all
            row, column = divmod(int(flat), free.shape[1])
            if not open_[row, column]:
                continue
            found.append((column, row))
            if len(found) == STARTS:
                return tuple(found)
            _take(open_, (column, row), apart)
    return tuple(found)


def _take(open_: NDArray[np.bool_], cell: Cell, apart: int) -> None:
    """Nobody else starts within so many cells."""
    column, row = cell
    reach = apart - 1
    open_[max(row - reach, 0) : row + apart, max(column - reach, 0) : column + apart] = False
