"""A robot of the grid that does what it is told from outside, and what it can be told to do."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.frontiers import find_frontiers
from usarsim_exploration.known_map import WALL
from usarsim_exploration.planning import Path
from usarsim_exploration.strategy import Plan, Strategy, View

HEADINGS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""Columns and rows of the eight directions: right, then clockwise by 45 degrees."""
FRONTIERS = 8
"""Frontiers that a robot chooses among."""
FAR = 100.0
"""m beyond which lengths and places of frontiers are told as if they were there."""


@dataclass
class Puppet(Strategy):
    """Does what it was told for the step.

    Attributes:
        plan: where to drive. turn: rad, where it looks instead if it cannot.
    """

    plan: Plan = field(default_factory=lambda: Plan([]))
    turn: float | None = None

    def decide(self, view: View) -> Plan:
        """What it was told."""
        if self.turn is not None and not self.plan.path:
            view.heading = self.turn
        return self.plan


def straight(view: View, heading: int) -> tuple[Plan, float]:
    """As far as a robot gets in a step in one of the eight directions, before walls that it knows.

    Returns:
        The plan, and the direction, rad.
    """
    right, down = HEADINGS[heading]
    path: Path = []
    column, row = view.cell
    for _ in range(math.ceil(view.speed / math.hypot(right, down))):
        ahead, left, across = (column + right, row + down), (column, row + down), (
            column + right, row,
        )  # fmt: skip
        if any(_is_wall(view, one) for one in (ahead, left, across)):
            break
        path.append(ahead)
        column, row = ahead
    return Plan(path), math.atan2(down, right)


def _is_wall(view: View, cell: Cell) -> bool:
    rows, columns = view.known.bits.shape
    column, row = cell
    if not (0 <= column < columns and 0 <= row < rows):
        return True
    return bool(view.known.bits[row, column] & WALL)


class Choice:
    """The frontiers that a robot may go to now.

    Attributes:
        cells: of the eight largest that a way leads to, the nearest first.
        table: (8, 5) what is told of them, see `frontier_space`; rows of zeros behind the last.
    """

    def __init__(self, view: View, cell: float) -> None:
        """cell: width of one, m."""
        found = find_frontiers(view.known)
        places = np.array([one.centre for one in found], np.int64).reshape(-1, 2)
        ways = view.planner.field(view.cell).distances(places)
        near = [
            (way, one.size, one.centre)
            for way, one in zip(ways.tolist(), found, strict=True)
            if way < math.inf
        ][:FRONTIERS]
        near.sort(key=lambda one: (one[0], one[2]))
        self.cells = [centre for _, _, centre in near]
        self.table: NDArray[np.float32] = np.zeros((FRONTIERS, 5), np.float32)
        for row, (way, size, centre) in zip(self.table, near, strict=False):
            right, down = centre[0] - view.cell[0], centre[1] - view.cell[1]
            row[0] = 1.0
            row[1:] = np.clip(np.array([way, size, right, down]) * cell, -FAR, FAR)

    @property
    def mask(self) -> NDArray[np.int8]:
        """(8,) 1: may be chosen."""
        return self.table[:, 0].astype(np.int8)

    def plan(self, view: View, number: int) -> Plan:
        """The way to one of them; none where there is none of that number."""
        if number >= len(self.cells):
            return Plan([])
        goal = self.cells[number]
        return Plan(view.planner.path(view.cell, goal) or [], goal=goal)


def behind(view: View) -> float:
    """The direction opposite to the robot's, one of the eight, rad."""
    right, down = -round(math.cos(view.heading)), -round(math.sin(view.heading))
    return math.atan2(down, right)


def frontier_space() -> spaces.Box:
    """(8, 5) float32: there is one; length of the way, size, right and down of here, m."""
    low = np.array([0.0, 0.0, 0.0, -FAR, -FAR], np.float32)
    high = np.array([1.0, FAR, FAR, FAR, FAR], np.float32)
    return spaces.Box(np.tile(low, (FRONTIERS, 1)), np.tile(high, (FRONTIERS, 1)), dtype=np.float32)
