"""What strategies that go from frontier to frontier share: when to plan, a frontier, going home.

A robot keeps to a frontier while that is there, unless another one is nearer than half of what is
left of the way. So each change halves the way, and no two frontiers can call it back and forth
for ever: it always gets to one (exploration reference, EXP-18).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from usarsim_exploration.bidding import Aim, Bidding
from usarsim_exploration.environment import Cell
from usarsim_exploration.frontiers import Frontier, frontiers_of
from usarsim_exploration.known_map import KNOWN, SAFE, WALL
from usarsim_exploration.mresim.planning import DONE, FIRST, NEVER_DONE
from usarsim_exploration.planning import Field, Path
from usarsim_exploration.strategy import Letter, Plan, Strategy, Teammate, View, straight
from usarsim_exploration.walking import onward, stroll
from usarsim_server.base.fields import field

NEAR = 4
"""Cells from where a frontier was, within which another one is taken for the same."""
TOGETHER = 0.5
"""Steps' ways between two robots that are taken to be in one place: what is equally far for both
is so for a while, whoever is some cells ahead."""


@dataclass
class Seeker(Strategy):
    """Drives to the frontier that `choose` names, and home when there is none.

    Attributes:
        aim: where it drives to; None: nowhere, or home.
    """

    parts: ClassVar[bool] = False
    """Whether robots with equal ways would choose alike; those in one cell then share out."""

    replan: int = field(default=15, low=1, high=10_000, unit="steps", help="between two plans")
    memory: int = field(
        default=500, low=0, high=10**6, unit="steps",
        help="for which a silent teammate is thought to go on",
    )  # fmt: skip
    considered: int = field(default=16, low=1, high=1000, help="best frontiers to choose from")

    def __post_init__(self) -> None:
        self._bidding = Bidding(self.memory)
        self._planned = self._version = -1
        self.aim: Cell | None = None
        self._failed, self._heard = False, -1

    @abstractmethod
    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """Which frontier next; None: leave them all to others, and go home.

        Args:
            view: of the robot.
            aims: at least one, the best by size over distance first.
        """

    def frontiers(self, view: View) -> list[Frontier]:
        """All that the robot knows of."""
        return frontiers_of(view)

    def aims(self, view: View) -> list[Aim]:
        """The best of the frontiers that can be reached."""
        return self._bidding.aims(view, self.frontiers(view), self.considered)

    def due(self, view: View) -> bool:
        """Whether to plan though a path is left."""
        return view.step - self._planned >= self.replan

    def decide(self, view: View) -> Plan | None:
        """Plan when it is due, or when the path is used up and something is new."""
        if view.rules.mresim:
            return self._by_mresim(view)
        if view.path and not view.blocked and not self.due(view):
            return None
        if not view.path and not view.blocked and self._version == view.known.version:
            return None
        self._planned, self._version = view.step, view.known.version
        frontiers = self.frontiers(view)
        while (aim := self.pick(view, frontiers)) is not None:
            path = view.planner.path(view.cell, aim.cell) or self._bidding.look(view, aim)
            if path:
                self._version, self.aim = -1, aim.cell
                return Plan(onward(view, path), goal=self.aim)
        self.aim = None
        return go_home(view)

    def _by_mresim(self, view: View) -> Plan | None:
        """Random first steps and after each that failed; plan anew whenever anybody was heard."""
        if view.step <= FIRST or view.blocked or self._failed:
            self._failed, self._planned = False, view.step
            return self._stroll(view)
        contact = self._heard == view.step - 1
        if len(view.path) >= 2 and not contact and not self.due(view):
            return None
        self._planned = view.step
        frontiers = self.frontiers(view)
        if view.known.free >= DONE * view.area:
            frontiers = []
        aim = self.pick(view, frontiers)
        if aim is None and view.step > NEVER_DONE:
            self.aim = None
            return go_home(view)
        if aim is None or any(view.cell == mate.cell for mate in view.teammates.values()):
            return self._stroll(view)
        self.aim = aim.cell
        path = view.planner.path(view.cell, aim.cell) or []
        self._failed = not path
        return Plan(path, goal=self.aim)

    def _stroll(self, view: View) -> Plan:
        """A random step."""
        path, _ = stroll(view, view.heading)
        return Plan(path)

    def pick(self, view: View, frontiers: list[Frontier]) -> Aim | None:
        """The frontier that was aimed at, if it holds against the one to choose now; else that."""
        aims = self._bidding.aims(view, frontiers, self.considered)
        mates = self.companions(view) if self.parts else []
        other = self.choose(view, self._left(view, aims, mates)) if aims else None
        if view.rules.mresim:
            return other
        if other is None or self.aim is None or self.aim in self._bidding.fruitless:
            return other
        if any(mate.goal is not None and _same(mate.goal, self.aim, view.scale) for mate in mates):
            return other
        left = view.planner.field(view.cell).distance(self.aim)
        if 0.0 < left <= 2.0 * other.distance:
            for one in frontiers:
                if np.abs(one.outline - self.aim).max(axis=1).min() <= NEAR * view.scale:
                    return Aim(one, self.aim, left)
        return other

    def guess(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """What a companion takes that has not told its goal; None: nothing that is known."""
        return self.choose(view, aims)

    def beside(self, view: View) -> list[Teammate]:
        """Explorers that are where this robot is, by number: ways are as long for all of them."""
        if not view.rules.ties:
            return []
        mates = (view.teammates[number] for number in sorted(view.linked))
        near = TOGETHER * view.speed
        return [
            one for one in mates if one.role == "explorer" and straight(one.cell, view.cell) < near
        ]

    def companions(self, view: View) -> list[Teammate]:
        """Those of them that choose before this robot."""
        return [one for one in self.beside(view) if one.number < view.number]

    def _left(self, view: View, aims: list[Aim], mates: Sequence[Teammate]) -> list[Aim]:
        """Aims that no companion takes; all, if they take all.

        A companion goes where it said that it goes, or takes what this robot would choose: it has
        the same ways.
        """
        left = list(aims)
        for mate in mates:
            if not left:
                left = list(aims)
            goal = mate.goal
            held = (one for one in left if goal is not None and _same(goal, one.cell, view.scale))
            taken = next(held, None) or self.guess(view, left)
            if taken is not None:
                left.remove(taken)
        return left or list(aims)

    def letter(self, view: View) -> Letter:
        """Frontiers that lead nowhere."""
        return self._bidding.letter()

    def hear(self, view: View) -> None:
        """Frontiers that others know to lead nowhere."""
        self._heard = view.step
        self._bidding.hear(view.teammates[number].letter for number in sorted(view.linked))


def _same(one: Cell, other: Cell, scale: float) -> bool:
    """Whether two cells are near enough to be of one frontier."""
    return max(abs(one[0] - other[0]), abs(one[1] - other[1])) <= NEAR * scale


def go_home(view: View) -> Plan:
    """Nothing is left to find: to the base, which then learns of it."""
    return Plan(way_to(view, view.base), "return", view.base, home=True)


def way_to(view: View, goal: Cell) -> Path:
    """The way through known free space; or through walls that were only supposed, not measured.

    Scans suppose walls between points that they measured, now and then across a door that the robot
    came through (exploration 6.3). Empty: there is no way, or the robot is there.
    """
    way = view.planner.path(view.cell, goal)
    if way is None:
        bits = view.known.bits
        certain = bits & (WALL | SAFE) == WALL | SAFE
        passable = (bits & KNOWN != 0) & ~certain
        way = Field(passable.astype(np.uint8), [view.cell], bits.size).path(goal)
    return way or []
