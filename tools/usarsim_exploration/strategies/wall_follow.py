"""Wall follow: keep a wall at the right hand; at the end of a lap, go to the nearest frontier.

The robot walks along the edge of what is at least `near` from known walls. A lap ends where it was
before, in the same direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usarsim_exploration.bidding import Aim
from usarsim_exploration.environment import Cell
from usarsim_exploration.exploring import Seeker
from usarsim_exploration.planning import Path
from usarsim_exploration.strategy import Plan, View, register
from usarsim_exploration.walking import Surroundings
from usarsim_server.base.fields import field

MOVES = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""Clockwise from the right, so that a move's number is its heading in eighths of a turn."""
_APART = 12
"""Moves after its first visit from which a place counts as visited again."""


@register("wall-follow")
@dataclass
class WallFollow(Seeker):
    """The right-hand rule."""

    parts = True

    near: float = field(
        default=2.5, low=1.0, high=100.0, unit="cells", help="least distance to the wall"
    )
    band: float = field(
        default=2.0, low=1.5, high=100.0, unit="cells",
        help="how much farther than `near` a wall may be",
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        self._visited: dict[tuple[Cell, int], int] = {}
        self._moves = 0
        self._planned_path: Path = []
        self._last: Cell | None = None
        self._seeking = self._home = False

    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """The nearest frontier."""
        return min(aims, key=lambda one: one.distance)

    def decide(self, view: View) -> Plan | None:
        """Along the wall; to the nearest frontier where that leads to nothing new."""
        if self._home or (self._seeking and view.path and not view.blocked):
            return self._seek(view)
        if not self._seeking and self._remember(view):
            return self._seek(view)
        if self.companions(view):  # they follow this wall
            return self._seek(view)
        around = Surroundings(view.known, view.cell, self._ahead(view) + int(self.near) + 3)
        if around.room(view.cell) >= self.near + self.band:
            path = self._to_wall(view, around)
        else:
            path = self._along(view, around)
        if not path or (self._seeking and self._been(view.cell, path[0])):
            return self._seek(view)
        self._seeking, self._last, self._planned_path = False, view.cell, path
        return Plan(path, "follow")

    def _ahead(self, view: View) -> int:
        return 2 * math.ceil(view.speed) + 2

    def _seek(self, view: View) -> Plan | None:
        self._seeking, self._last = True, None
        plan = super().decide(view)
        if plan is not None:
            self._home = plan.home
        return plan

    def _remember(self, view: View) -> bool:
        """Note the moves that were made along the wall; whether a lap has ended."""
        cell = self._last
        if cell is None or view.cell not in self._planned_path:
            return False
        lap = False
        for there in self._planned_path[: self._planned_path.index(view.cell) + 1]:
            key = there, _number(cell, there)
            self._moves += 1
            first = self._visited.setdefault(key, self._moves)  # the last would hide short rounds
            lap = lap or self._moves - first > _APART
            cell = there
        return lap

    def _been(self, cell: Cell, there: Cell) -> bool:
        return (there, _number(cell, there)) in self._visited

    def _along(self, view: View, around: Surroundings) -> Path:
        """Moves by the right-hand rule: sharp right first, then less and less, left last.

        None leads away from the wall, so that a right turn in the open is no move.
        """
        cell, heading = view.cell, round(view.heading / (math.pi / 4))
        wall = min(range(8), key=lambda number: around.room(_beside(cell, number)))
        if (wall - heading) % 8 not in (1, 2, 3):
            heading = wall - 2
        path: Path = []
        for _ in range(self._ahead(view)):
            for turn in (2, 1, 0, -1, -2, -3, -4, 3):
                there = _beside(cell, heading + turn)
                room = around.room(there)
                keeps = min(self.near, around.room(cell) + 0.5) <= room < self.near + self.band
                if keeps and around.is_free(there) and around.passable(cell, [there]):
                    path.append(there)
                    cell, heading = there, heading + turn
                    break
            else:
                break
        return path

    def _to_wall(self, view: View, around: Surroundings) -> Path:
        """The way to the nearest known place beside a wall; none: there is none in the map."""
        field_ = view.planner.field(view.cell)
        costs = field_.costs
        whole = Surroundings(view.known, view.cell, max(costs.shape)).clearance
        beside = (whole >= self.near) & (whole < self.near + self.band)
        where = np.where(beside, costs, np.iinfo(np.int32).max)
        row, column = divmod(int(where.argmin()), costs.shape[1])
        if not beside[row, column]:
            return []
        return field_.path((column, row)) or []


def _beside(cell: Cell, number: int) -> Cell:
    right, down = MOVES[number % 8]
    return cell[0] + right, cell[1] + down


def _number(start: Cell, there: Cell) -> int:
    return MOVES.index((there[0] - start[0], there[1] - start[1]))
