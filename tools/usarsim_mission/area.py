"""How much of the reachable floor has been seen.

Each robot sees the sectors of its sensors as far as walls let it; so does the grid of the true
floor, by rays from the cell of the robot. The base knows what a robot saw while its link was up,
and the rest as soon as the link is up again.

The rays of all directions are made once for a range, as steps between cells: to look is to add
the robot's cell to them, and to drop all steps of a ray behind the first wall.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from usarsim_mission.grid import FREE, WALL, Grid
from usarsim_mission.model import Fan, World
from usarsim_mission.visits import Robot

Cell = TypeVar("Cell", np.uint8, np.bool_)

PERIOD = 1.0
"""s between two looks of a robot."""
_RAYS = 720
_RANGE = 50.0
"""m of a sensor that count, at most."""
_MOVED, _TURNED = 0.1, 0.05
"""m and rad from which on it is worth to look again."""


@dataclass(slots=True)
class _Look:
    """The last one of a robot, and what the base has not been told yet."""

    x: float
    y: float
    yaw: float
    untold: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))


class Area:
    """The floor of a world, and who has seen what of it."""

    def __init__(self, world: World) -> None:
        self._fans = {start.name: start.sensors for start in world.starts}
        self._kinds = {start.kind: start.sensors for start in world.starts if start.sensors}
        self._floor = world.floor
        self._looks: dict[str, _Look] = {}
        self._next = -math.inf
        fans = [fan for start in world.starts for fan in start.sensors]
        if world.floor is None or not fans:
            self._reachable = 0
            return
        reach = min(max(fan.range for fan in fans), _RANGE)
        self._steps = max(1, math.ceil(reach / world.floor.cell))
        self._cells, self._width = _padded(world.floor.cells, self._steps + 1)
        self._blocks, _ = _padded(_tight(world.floor.cells == WALL), self._steps + 1)
        self._rays = _rays(self._steps, self._width)
        self._team = np.zeros(self._cells.size, np.bool_)
        self._base = np.zeros(self._cells.size, np.bool_)
        self._reachable = int(np.count_nonzero(self._cells == FREE))

    def enrol(self, robots: Iterable[Mapping[str, object]]) -> None:
        """Robots whose names the world does not have see what others of their class do."""
        for one in robots:
            name, kind = str(one.get("name")), str(one.get("class"))
            self._fans.setdefault(name, self._kinds.get(kind, ()))

    def look(self, robots: Iterable[Robot], time: float) -> None:
        """All robots look around, unless they have done so just before."""
        if time < self._next or not self._reachable:
            return
        # Whole seconds, however the rows fall.
        self._next = math.floor(time / PERIOD + 1e-6) * PERIOD + PERIOD - 1e-6
        for robot in robots:
            if robot.pos is not None and robot.seen >= time:
                self._look(robot, robot.pos[0], robot.pos[1])

    def share(self, source: str) -> float:
        """Of the reachable floor: all that `team` has seen, or what the `base` knows; 0..1."""
        if not self._reachable:
            return 0.0
        return (
            int(np.count_nonzero(self._base if source == "base" else self._team)) / self._reachable
        )

    def seen(self) -> Grid | None:
        """What robots have seen: 1 where they have; None if no floor is known."""
        if self._floor is None or not self._reachable:
            return None
        pad, (rows, columns) = self._steps + 1, self._floor.cells.shape
        cells = self._team.reshape(-1, self._width)[pad : pad + rows, pad : pad + columns]
        return Grid(self._floor.x, self._floor.y, self._floor.cell, cells.astype(np.uint8))

    def _look(self, robot: Robot, x: float, y: float) -> None:
        last = self._looks.get(robot.name)
        if last is None:
            last = self._looks[robot.name] = _Look(math.inf, math.inf, 0.0)
        turned = abs(math.remainder(robot.yaw - last.yaw, math.tau))
        if math.hypot(x - last.x, y - last.y) >= _MOVED or turned >= _TURNED:
            last.x, last.y, last.yaw = x, y, robot.yaw
            new = self._seen(robot, x, y)
            self._team[new] = True
            last.untold = np.concatenate((last.untold, new)) if len(last.untold) else new
        if robot.linked and len(last.untold):
            self._base[last.untold] = True
            last.untold = np.empty(0, np.int64)

    def _seen(self, robot: Robot, x: float, y: float) -> NDArray[np.int64]:
        """Numbers of the reachable cells that a robot sees, without those that it knew."""
        assert self._floor is not None
        row, column = self._floor.index(x, y)
        rows, columns = self._floor.cells.shape
        if not (0 <= row < rows and 0 <= column < columns):
            return np.empty(0, np.int64)
        pad = self._steps + 1
        cell = (row + pad) * self._width + column + pad
        found = []
        for fan in self._fans.get(robot.name, ()):
            steps = min(self._steps, max(1, round(fan.range / self._floor.cell)))
            rays = self._rays[_within(fan, robot.yaw, len(self._rays)), :steps] + cell
            behind = np.logical_or.accumulate(self._blocks[rays], axis=1)
            found.append(rays[:, 1:][~behind[:, :-1]])
        if not found:
            return np.empty(0, np.int64)
        cells = np.concatenate(found)
        # What the base knows already is no news.
        return np.unique(cells[(self._cells[cells] == FREE) & ~self._base[cells]])


def _padded(cells: NDArray[Cell], pad: int) -> tuple[NDArray[Cell], int]:
    """Cells with an empty margin, flat, and the cells of a row."""
    wide = np.pad(cells, pad)
    return wide.reshape(-1), wide.shape[1]


def _tight(walls: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Walls with no gap between cells that meet at a corner, so that no ray slips through."""
    tight = walls.copy()
    tight[:-1, 1:] |= walls[:-1, :-1] & walls[1:, 1:]
    tight[:-1, :-1] |= walls[:-1, 1:] & walls[1:, :-1]
    return tight


def _rays(steps: int, width: int) -> NDArray[np.int64]:
    """(rays, steps): cells from that of the robot; ray 0 is along x, they turn to the left."""
    count = min(_RAYS, max(8, math.ceil(math.tau * steps)))
    angles = np.arange(count) * (math.tau / count)
    away = np.arange(steps)
    rows = np.rint(np.sin(angles)[:, None] * away).astype(np.int64)
    columns = np.rint(np.cos(angles)[:, None] * away).astype(np.int64)
    steps_of: NDArray[np.int64] = rows * width + columns
    return steps_of


def _within(fan: Fan, yaw: float, count: int) -> NDArray[np.int64]:
    """Numbers of the rays in a sector; of one narrower than a ray, the nearest."""
    if fan.fov >= math.tau:
        return np.arange(count)
    a_ray = math.tau / count
    first = math.ceil((yaw + fan.yaw - fan.fov / 2) / a_ray)
    last = math.floor((yaw + fan.yaw + fan.fov / 2) / a_ray)
    if last < first:
        first = last = round((yaw + fan.yaw) / a_ray)
    return np.arange(first, last + 1) % count
