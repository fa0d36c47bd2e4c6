"""Robots without a server: points that turn and roll over the floor, to try a study beforehand.

They have no mass and no wheels that slip; a wall stops them. What cameras show is what can be seen
over the plan of the building. A trial of ten minutes takes a fraction of a second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from usarsim_client.truth import Contact, TrueRobot, TrueVictim, TruthRow, View
from usarsim_mission.grid import FREE, WALL
from usarsim_mission.model import World

FASTEST = 1.1
"""m/s at full power."""
TRACK = 0.38
"""m between the wheels, slip of turning included."""
REACH = 8.0
"""m beyond which no victim is told of: nobody recognises one there."""
SECTOR = math.radians(60.0)
_CELL = 0.2  # m in which a sight is taken to be the same


@dataclass(slots=True)
class _Robot:
    x: float
    y: float
    yaw: float
    forward: float = 0.0
    turn: float = 0.0
    speed: float = 0.0
    touches: bool = False


class KinematicWorld:
    """The world of one trial."""

    def __init__(self, world: World) -> None:
        """Robots stand at their starts.

        Raises:
            ValueError: the floor of the world is not known.
        """
        if world.floor is None:
            raise ValueError("the floor of this world is not known")
        self._grid, self._victims = world.floor, world.victims
        self._robots = {one.name: _Robot(*one.pos[:2], one.yaw) for one in world.starts}
        self._sights: dict[tuple[int, int, str], bool] = {}
        self._still = tuple(TrueVictim(one.name, one.pos) for one in world.victims)

    def drive(self, robot: str, forward: float, turn: float) -> None:
        """Hold keys or stick so; -1 to 1, turn to the right."""
        self._robots[robot].forward, self._robots[robot].turn = forward, turn

    def step(self, duration: float) -> None:
        """Let time go on by so many s."""
        for one in self._robots.values():
            one.touches, one.speed = False, 0.0
            if not (one.forward or one.turn):
                continue
            one.yaw -= 2.0 * one.turn * FASTEST / TRACK * duration
            x = one.x + one.forward * FASTEST * duration * math.cos(one.yaw)
            y = one.y + one.forward * FASTEST * duration * math.sin(one.yaw)
            if self._grid.at(x, y) == FREE:
                one.x, one.y, one.speed = x, y, one.forward * FASTEST
            else:
                one.touches = True

    def row(self, time: float) -> TruthRow:
        """What is true now."""
        robots, views = [], []
        for name, one in self._robots.items():
            half = one.yaw / 2.0
            velocity = one.speed * math.cos(one.yaw), one.speed * math.sin(one.yaw), 0.0
            touched = (Contact("world", "wall", time),) if one.touches else ()
            robots.append(
                TrueRobot(
                    name, (one.x, one.y, 0.2), (math.cos(half), 0.0, 0.0, math.sin(half)),
                    velocity, (0.0, 0.0, 0.0), None, touched,
                )
            )  # fmt: skip
            views += self._views(name, one)
        return TruthRow({}, time, "", tuple(robots), self._still, tuple(views))

    def _views(self, name: str, one: _Robot) -> list[View]:
        found = []
        for victim in self._victims:
            dx, dy = victim.pos[0] - one.x, victim.pos[1] - one.y
            distance = math.hypot(dx, dy)
            if distance > REACH:
                continue
            angle = abs(math.remainder(math.atan2(dy, dx) - one.yaw, math.tau))
            if angle <= SECTOR:
                clear = self._sees(one, victim.name, victim.pos[0], victim.pos[1])
                found.append(View(name, victim.name, angle, distance, clear))
        return found

    def _sees(self, one: _Robot, victim: str, x: float, y: float) -> bool:
        key = int(one.x // _CELL), int(one.y // _CELL), victim
        if key not in self._sights:
            grid = self._grid
            steps = max(2, int(math.hypot(x - one.x, y - one.y) / (grid.cell / 2.0)))
            rows = ((np.linspace(one.y, y, steps) - grid.y) // grid.cell).astype(int)
            columns = ((np.linspace(one.x, x, steps) - grid.x) // grid.cell).astype(int)
            rows = np.clip(rows, 0, grid.cells.shape[0] - 1)
            columns = np.clip(columns, 0, grid.cells.shape[1] - 1)
            walls = grid.cells[rows, columns] == WALL
            self._sights[key] = not bool(walls[: -round(0.5 / (grid.cell / 2.0))].any())
        return self._sights[key]
