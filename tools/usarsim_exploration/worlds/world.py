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
from usarsim_maps.grids.inside import largest_part
from usarsim_server.base.errors import WorldError, at

Draw = Literal["drawn", "drawn at a wall", "drawn in the open"]
DRAWS: tuple[Draw, ...] = get_args(Draw)
"""How the seed may draw places."""
STARTS = 16
_ROOMS = ((8, 4), (4, 2), (2, 1), (1, 1))
"""Cells between two starts, and from a start to a wall: as much as there is room for. Where robots
have bodies, lengths of `TENTH` m stand for these."""
TENTH = 0.1
"""m."""


@dataclass(frozen=True, eq=False)
class World:
    """An environment and where runs begin in it.

    Attributes:
        environment: true. title: for people.
        base: cell of the base. starts: of robots, the nearest to the base first.
        notes: what a user should know about how the map was read.
    """

    environment: Environment
    title: str
    base: Cell
    starts: tuple[Cell, ...]
    notes: tuple[str, ...] = ()

    @cached_property
    def digest(self) -> str:
        """SHA-256 of size and cells, base and starts: worlds that are the same have the same."""
        found = hashlib.sha256(repr((self.environment.shape, self.base, self.starts)).encode())
        found.update(np.packbits(self.environment.walls != 0).tobytes())
        return found.hexdigest()


def settle(
    environment: Environment,
    title: str,
    wanted: Cell | None = None,
    *,
    anywhere: bool = False,
    scale: float = 1.0,
) -> World:
    """Find a place for the base and for the robots.

    The base stands inside, in the connected part of the free space with most of the inside, on the
    cell with enough room that is nearest to the wanted one; default where there is most room.
    Starts follow in order of the way from there, inside too. A map without an inside is all inside.

    Args:
        environment: to explore. title: of the world.
        wanted: cell near which the base stands.
        anywhere: all free cells count as inside. scale: see `start_around`.

    Raises:
        WorldError: there is no free cell.
    """
    part = _main_part(environment, environment.walls == 0 if anywhere else environment.inside)
    clear = np.where(part, clearance(environment.walls), 0)
    room = min(_cells(_ROOMS[0][1], scale), int(clear[part].max()))
    if wanted is None:
        base = _cell(np.where(part, -clear, 1))
    else:
        rows, columns = np.indices(part.shape)
        away = (rows - wanted[1]) ** 2 + (columns - wanted[0]) ** 2
        base = _cell(np.where(part & (clear >= room), away, away.max() + 1))
    return World(environment, title, base, _starts(environment, clear, base, scale))


def start_around(environment: Environment, base: Cell, scale: float = 1.0) -> tuple[Cell, ...]:
    """Places for robots from which the base can be reached, inside if it is.

    Args:
        environment: to explore. base: a free cell.
        scale: cells that stand for one of the distances that starts keep.
    """
    part = environment.reachable(base)
    if environment.inside[base[1], base[0]]:
        part &= environment.inside
    clear = np.where(part, clearance(environment.walls), 0)
    return _starts(environment, clear, base, scale)


def scale_of(cell: float) -> float:
    """Cells of a width, m, that are as long as `TENTH`."""
    return TENTH / cell


def _cells(length: int, scale: float) -> int:
    """Cells, at least one, that are as long as so many when `scale` of them are one."""
    return max(1, round(length * scale))


def draw_places(
    environment: Environment, title: str, where: Draw, seed: int, scale: float = 1.0
) -> World:
    """The same for the same seed, whoever explores; places are inside, as those of `settle`.

    Args:
        environment: to explore. title: of the world.
        where: with room around; on cells beside walls; or among the tenth of the cells that have
            the longest way to a wall. seed: of the base's place; robots start near it.
        scale: see `start_around`.

    Raises:
        WorldError: there is no free cell.
    """
    part = _main_part(environment, environment.inside)
    clear = np.where(part, clearance(environment.walls), 0)
    if where == "drawn at a wall":
        allowed = part & (clear == 1)
    elif where == "drawn in the open":
        allowed = part & (clear >= np.quantile(clear[part], 0.9))
    else:
        room = min(_cells(_ROOMS[0][1], scale), int(clear[part].max()))
        allowed = part & (clear >= room)
    cells = np.argwhere(allowed)
    random = np.random.Generator(np.random.PCG64([seed, len(cells)]))
    row, column = cells[random.integers(len(cells))].tolist()
    if where == "drawn at a wall":  # robots, too
        clear = np.where(allowed, _cells(_ROOMS[0][1], scale), 0)
    base = column, row
    return World(environment, title, base, _starts(environment, clear, base, scale))


def _main_part(environment: Environment, inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The inside of the connected part of the free space that has most of the inside."""
    part = largest_part(environment.walls == 0, inside)
    if not part.any():
        cure = "walls are black and 1, free cells white and 0"
        raise WorldError(at(environment.name, "there is no free cell", cure))
    return part & inside


def clearance(walls: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Whole cells from each cell to the nearest wall or the edge of the world, rounded down."""
    padded = np.pad((walls == 0).astype(np.uint8), 1)
    away = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(away[1:-1, 1:-1] + 1e-3, np.int64)


def _cell(costs: NDArray[np.int64]) -> Cell:
    """The cheapest cell, the first of equals."""
    row, column = divmod(int(np.argmin(costs)), costs.shape[1])
    return column, row


def _starts(
    environment: Environment, clear: NDArray[np.int64], base: Cell, scale: float
) -> tuple[Cell, ...]:
    free = (environment.walls == 0).astype(np.uint8)
    costs, _ = flood(free, np.array([base], np.int64), free.size, EVERYWHERE)
    order = np.argsort(costs, axis=None, kind="stable")[1:]
    order = order[costs.reshape(-1)[order] < np.iinfo(costs.dtype).max]
    found: list[Cell] = []
    for rooms in _ROOMS:
        apart, room = (_cells(length, scale) for length in rooms)
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
