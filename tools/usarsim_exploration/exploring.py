"""What strategies that go from frontier to frontier share: when to plan, a frontier, going home."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usarsim_exploration.bidding import Aim, Bidding
from usarsim_exploration.environment import Cell
from usarsim_exploration.frontiers import find_frontiers
from usarsim_exploration.known_map import KNOWN, SAFE, WALL
from usarsim_exploration.planning import Field, Path
from usarsim_exploration.strategies.frontier import FrontierStrategy
from usarsim_exploration.strategy import Letter, Plan, Strategy, View
from usarsim_server.fields import field

NEAR = 4
"""Cells from where a frontier was, within which another one is taken for the same."""


@dataclass
class Seeker(Strategy):
    """Drives to the frontier that `choose` names, and home when there is none."""

    replan: int = field(default=15, low=1, high=10_000, unit="steps", help="between two plans")
    memory: int = field(
        default=500, low=0, high=10**6, unit="steps",
        help="for which a silent teammate is thought to go on",
    )  # fmt: skip
    considered: int = field(default=16, low=1, high=1000, help="best frontiers to choose from")

    def __post_init__(self) -> None:
        self._bidding = Bidding(self.memory)
        self._planned = self._version = -1

    @abstractmethod
    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """Which frontier next; None: leave them all to others, and go home.

        Args:
            view: of the robot.
            aims: at least one, the best by size over distance first.
        """

    def aims(self, view: View) -> list[Aim]:
        """The frontiers that can be reached."""
        return self._bidding.aims(view, find_frontiers(view.known), self.considered)

    def due(self, view: View) -> bool:
        """Whether to plan though a path is left."""
        return view.step - self._planned >= self.replan

    def decide(self, view: View) -> Plan | None:
        """Plan when it is due, or when the path is used up and something is new."""
        if view.path and not view.blocked and not self.due(view):
            return None
        if not view.path and not view.blocked and self._version == view.known.version:
            return None
        self._planned, self._version = view.step, view.known.version
        while aims := self.aims(view):
            aim = self.choose(view, aims)
            if aim is None:
                break
            path = view.planner.path(view.cell, aim.cell) or self._bidding.look(view, aim)
            if path:
                self._version = -1
                return Plan(path, goal=aim.cell)
        return go_home(view)

    def letter(self, view: View) -> Letter:
        """Frontiers that lead nowhere."""
        return self._bidding.letter()

    def hear(self, view: View) -> None:
        """Frontiers that others know to lead nowhere."""
        self._bidding.hear(view.teammates[number].letter for number in sorted(view.linked))


@dataclass
class Committed(FrontierStrategy):
    """Frontier-based, and keeps to a frontier while that is there.

    Robots whose bids change as they drive would turn round again and again; that costs those most
    who have to be elsewhere at a time.

    Attributes:
        aim: where this robot drives to.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        self.aim: Cell | None = None

    def decide(self, view: View) -> Plan | None:
        """The way to the same frontier, or another one when it has gone."""
        due = not view.path or view.blocked or view.step - self._planned >= self.replan
        if due and self.aim is not None and self._is_open(view, self.aim):
            path = view.planner.path(view.cell, self.aim)
            if path:
                self._planned, self._version = view.step, -1
                return Plan(path, goal=self.aim)
        plan = super().decide(view)
        if plan is not None:
            self.aim = None if plan.home else plan.goal
        return plan

    def _is_open(self, view: View, cell: Cell) -> bool:
        """Whether there is still a frontier about a cell."""
        return any(
            np.abs(one.outline - cell).max(axis=1).min() <= NEAR
            for one in find_frontiers(view.known, uncertain=self.uncertain)
        )


def go_home(view: View) -> Plan:
    """Nothing is left to find: to the base, which then learns of it."""
    return Plan(way_to(view, view.base), "return", view.base, home=True)


def way_to(view: View, goal: Cell) -> Path:
    """The way through known free space; or through walls that were only supposed, not measured.

    Scans suppose walls between points that they measured, now and then across a door that the robot
    came through (reference 6.3). Empty: there is no way, or the robot is there.
    """
    way = view.planner.path(view.cell, goal)
    if way is None:
        bits = view.known.bits
        certain = bits & (WALL | SAFE) == WALL | SAFE
        passable = (bits & KNOWN != 0) & ~certain
        way = Field(passable.astype(np.uint8), [view.cell], bits.size).path(goal)
    return way or []
