"""The level of discs: cells as on the grid, but robots take room, and time to turn.

Robots drive along a strategy's path as far as they fit, keep off walls, go around each other or
wait, and turn on the spot while they scan, as those of a server do. Cells, poses and scans are
exact as on the grid. So a run with physics differs from one of discs by what only physics has:
slip, errors of pose, collisions, getting stuck.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from dataclasses import field as attribute
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.levels.driver import FACING, SHARP
from usarsim_exploration.levels.grid import GridLevel, felt
from usarsim_exploration.levels.route import SNAP, gathering, rest_of, route, unknown_at
from usarsim_exploration.levels.rover import disc_cells
from usarsim_exploration.localisation.poses import wrap
from usarsim_exploration.planning import Path
from usarsim_exploration.walking import through
from usarsim_server.base.fields import field

if TYPE_CHECKING:
    from usarsim_exploration.cycle import Body, Cycle

_TURN = math.pi / 16
"""rad between two scans of a robot that turns; headings are whole numbers of it."""
_LOOKAHEAD = 4
"""Cells of 0.1 m, as all of these, on the way to where a robot heads."""
_SEES = 30
"""Cells within which robots see each other, and plan their way around."""
_ASTIR = 3.0
"""Cells from a place within which a robot has got nowhere."""
_WIDTH = 6.0
"""Cells of a robot's width."""
_SQUEEZE = 3
"""Steps that two robots wait for each other, then they get past all the same: a server's robots
back off and turn meanwhile."""


@dataclass(frozen=True)
class Discs:
    """Keys of `[discs]`; they mean nothing to other levels."""

    width: float | None = field(
        default=None, low=0.1, high=1000.0, unit="cells", help="of all robots; 0.6 m"
    )
    turn: float = field(
        default=150.0, low=10.0, high=100000.0, unit="degrees a step",
        help="how far a robot turns on the spot, if it does nothing else",
    )  # fmt: skip

    def wide(self, scale: float) -> float:
        """Width of robots, cells. scale: cells that are as long as 0.1 m."""
        return _WIDTH * scale if self.width is None else self.width


@dataclass(slots=True, eq=False)
class _Disc:
    """A robot: where it is, the way before it, and what it did in this step.

    Attributes:
        whole: the way leads to the end of the strategy's path. credit: cells that it may still
            drive in this part of a step. anchor, waited: a place, and the steps for which it has
            got nowhere from there, though it has a path. hit: the wall that it drove into.
        cells, headings: from where it scanned. facing: rad, at the end of its way.
    """

    body: Body
    cell: Cell
    heading: float
    way: Path = attribute(default_factory=list)
    whole: bool = True
    credit: float = 0.0
    anchor: Cell = (0, 0)
    waited: int = 0
    moved: bool = False
    hit: Cell | None = None
    facing: float | None = None
    cells: list[Cell] = attribute(default_factory=list)
    headings: list[float] = attribute(default_factory=list)


class DiscLevel(GridLevel):
    """Computes on the cells of the true world, with robots of some width."""

    def __init__(self, discs: Discs, scale: float = 1.0) -> None:
        """Robots that have not moved.

        Args:
            discs: how wide robots are, and how fast they turn.
            scale: cells that are as long as 0.1 m.
        """
        self._scale, self._turn = scale, math.radians(discs.turn)
        self._width = discs.wide(scale)
        self._shape = disc_cells(self._width / 2)
        self._discs: list[_Disc] = []

    def look(self, cycle: Cycle) -> None:
        """The first scans."""
        super().look(cycle)
        self._discs = [
            _Disc(body, body.view.cell, _whole_turns(body.view.heading)) for body in cycle.bodies
        ]

    def move(self, cycle: Cycle) -> None:
        """All decide, then all drive at once, a cell or less at a time."""
        moving = [self._discs[body.view.number] for body in cycle.acting()]
        for disc in moving:
            cycle.decide(disc.body)
            self._set_out(cycle, disc)
        parts = math.ceil(max((disc.body.view.speed for disc in moving), default=0.0))
        for _ in range(parts):
            for disc in moving:
                self._advance(cycle, disc, disc.body.view.speed / parts)
        for disc in moving:
            self._settle(cycle, disc)
            disc.body.view.planner.forget()

    def _set_out(self, cycle: Cycle, disc: _Disc) -> None:
        """Make the way for this step out of what is left of the path."""
        view = disc.body.view
        disc.cells, disc.headings = [], []
        disc.moved, disc.hit, disc.facing, disc.credit = False, None, None, 0.0
        if not view.path:
            disc.way, disc.waited = [], 0
            return
        if math.dist(disc.anchor, disc.cell) > _ASTIR * self._scale:
            disc.anchor, disc.waited = disc.cell, 0
        others: list[NDArray[np.int64]] = [np.empty((0, 2), np.int64)]
        if disc.waited < _SQUEEZE:
            others += [
                one.cell + self._shape
                for one in self._discs
                if one is not disc and math.dist(one.cell, disc.cell) < _SEES * self._scale
            ]
        snap = SNAP
        if view.path[-1] == view.base:
            snap = gathering(len(self._discs) - 1)
        disc.way, disc.whole = route(
            view.known.bits, disc.cell, view.path, (self._width + 1) / 2, np.concatenate(others),
            snap, self._scale,
        )  # fmt: skip
        if disc.whole and cycle.rules.starts and disc.waited < _SQUEEZE:
            end, along = view.path[-1], disc.heading
            disc.facing = unknown_at(view.known.bits, end, self._scale, along)

    def _advance(self, cycle: Cycle, disc: _Disc, credit: float) -> None:
        """Turn and drive for a part of a step; what is left of that is of use for the next one."""
        disc.credit += credit
        while disc.way and disc.hit is None:
            far = max(1, round(_LOOKAHEAD * self._scale))
            ahead = disc.way[min(far, len(disc.way)) - 1]
            towards = math.atan2(ahead[1] - disc.cell[1], ahead[0] - disc.cell[0])
            beside = wrap(towards - disc.heading)
            there, turns = disc.way[0], abs(beside) > SHARP
            price = (
                disc.body.view.speed * _TURN / self._turn if turns else math.dist(disc.cell, there)
            )
            if price > disc.credit + 1e-9:
                return
            if turns:
                disc.heading = _whole_turns(disc.heading + math.copysign(_TURN, beside))
            elif not cycle.environment.may_move(disc.cell, there):
                disc.hit = there
                return
            elif not self._has_room(disc, there):
                disc.credit = 0.0
                return
            else:
                disc.cell, disc.heading, disc.moved = there, _whole_turns(towards), True
                disc.body.distance += price
                del disc.way[0]
            disc.credit -= price
            disc.cells.append(disc.cell)
            disc.headings.append(disc.heading)
        self._face(disc)

    def _face(self, disc: _Disc) -> None:
        """Turn to the unknown at the end of a way."""
        price = disc.body.view.speed * _TURN / self._turn
        while self._turns(disc) and price <= disc.credit + 1e-9:
            assert disc.facing is not None
            beside = wrap(disc.facing - disc.heading)
            disc.heading = _whole_turns(disc.heading + math.copysign(_TURN, beside))
            disc.credit -= price
            disc.cells.append(disc.cell)
            disc.headings.append(disc.heading)

    @staticmethod
    def _turns(disc: _Disc) -> bool:
        """Whether it is at the end of its way, and does not see yet what it came for."""
        if disc.way or disc.facing is None or disc.hit is not None:
            return False
        return abs(wrap(disc.facing - disc.heading)) > FACING

    def _has_room(self, disc: _Disc, there: Cell) -> bool:
        """Whether a robot comes too near to nobody; it may get away from who is too near."""
        return disc.waited >= _SQUEEZE or all(
            math.dist(one.cell, there) >= min(self._width, math.dist(one.cell, disc.cell) + 0.1)
            for one in self._discs
            if one is not disc
        )

    def _settle(self, cycle: Cycle, disc: _Disc) -> None:
        """Scan, and tell the strategy where the robot is and what is left of its path."""
        body, view = disc.body, disc.body.view
        here, acted = disc.cell, bool(disc.cells)
        stands = bool(view.path) and not acted
        view.blocked = disc.hit is not None or (stands and not disc.way and not disc.whole)
        disc.waited += bool(view.path)
        turns = self._turns(disc)
        if view.path and not disc.way and disc.whole and not view.blocked and not turns:
            here, view.path = view.path[-1], []  # as near as it fits
        elif view.path:
            view.path = rest_of(view.path, here)
        body.moves = through(view.cell, [*disc.cells, here])
        view.cell, view.heading = here, disc.heading
        cells, headings = disc.cells or [disc.cell], disc.headings or [disc.heading]
        self._scan(cycle, body, cells, headings, disc.moved)
        if disc.hit is not None:
            body.moves.append(disc.hit)
            for wall in felt(cycle.environment, disc.cell, disc.hit):
                view.known.bump(cycle.step, wall)
        if view.blocked:
            view.path = []


def _whole_turns(heading: float) -> float:
    """The nearest heading that a scan is made with; the scanner has a table for each."""
    return round(wrap(heading) / _TURN) * _TURN
