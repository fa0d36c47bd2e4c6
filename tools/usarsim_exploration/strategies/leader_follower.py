"""Leader and followers: a chain from the base to the robot with the highest number, which explores.

Each follower drives towards the next one of the chain, or to a post that the leader has named where
that is not enough to get to a frontier. Nobody makes a move after which a neighbour could be out of
reach, wherever that one moves in the same step, so under a circle no link ever breaks (exploration
reference 12.6, where robots step back only when one is broken).

When nobody can move, all gather at the base, link by link, before the leader tries once more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from usarsim_exploration.bidding import Bidding
from usarsim_exploration.environment import Cell
from usarsim_exploration.frontiers import frontiers_of
from usarsim_exploration.planning import Path
from usarsim_exploration.relays import chain, ways_within
from usarsim_exploration.strategy import (
    BASE,
    Letter,
    Plan,
    Strategy,
    Teammate,
    View,
    register,
    straight,
)
from usarsim_exploration.tether import leading, links, sees_base, turn_to_base
from usarsim_server.base.fields import field

NEWS = 1.05
"""So many times the free cells have to be known until what was beyond the chain is asked again."""
GATHERED = 10.0
"""Cells from the base at which the leader begins anew."""
SETTLED = 3
"""Steps after which a robot that has not moved will not either, as long as nobody else does."""

LOCKED = 4
"""So often the leader fails in one place until all come to the base: the chain cannot move."""


@register("leader-follower")
@dataclass
class LeaderFollower(Strategy):
    """The chain is in the order of numbers."""

    replan: int = field(default=10, low=1, high=10_000, unit="steps", help="between two ways")
    memory: int = field(
        default=100, low=1, high=10**6, unit="steps", help="after which a silent robot is given up"
    )
    patience: int = field(
        default=20, low=1, high=10_000, unit="steps",
        help="for which the leader waits for its followers before it tries another frontier",
    )  # fmt: skip
    spacing: float = field(
        default=10.0, low=0.0, high=1000.0, unit="cells",
        help="frontiers nearer to one that was out of reach are, too",
    )  # fmt: skip

    def __post_init__(self) -> None:
        self._bidding = Bidding()
        self._way: Path = []
        self._planned = -(10**9)
        self._waited = self._still = 0
        self._given_up: set[Cell] = set()
        self._tried: set[Cell] = set()
        self._beyond: dict[Cell, int] = {}
        """Frontiers that no chain got to, and how many free cells were known then."""
        self._goal: Cell | None = None
        self._home = self._gathers = self._turned = self._lost = False
        self._posts: list[Cell] = []
        self._failed: Cell | None = None
        """Where the leader failed last."""
        self._fails = 0
        """How often there, after the first time."""
        self._called, self._since = 0, -1
        """Free cells known when all were last called to the base; since when they are, or -1."""

    def decide(self, view: View) -> Plan | None:
        """As much of the way as keeps both neighbours."""
        if not self._turned:
            turn = turn_to_base(view)
            self._turned = not turn or sees_base(view)
            if turn:
                return Plan(turn, "turn")
        parent, child = self._neighbours(view)
        if parent not in view.linked:  # back to where it was, then to the base
            self._planned = -(10**9)
            there = view.teammates[parent].cell
            self._lost = self._lost or view.cell == there
            there = view.base if self._lost else there
            return Plan(view.planner.path(view.cell, there) or [], "return", there)
        self._lost = False
        if view.cell in self._way:
            self._way = self._way[self._way.index(view.cell) + 1 :]
        old = view.step - self._planned >= self.replan
        if old or view.blocked or (not self._way and not self._home):
            self._planned = view.step
            if child is None:
                self._lead(view)
            else:
                self._follow(view, child)
        near = [view.teammates[parent]] + ([child] if child and child.number in view.linked else [])
        part = self._way[: math.ceil(view.speed) + 1]
        for mate in near:
            bound = mate.number == BASE or (mate is near[0] and self._still > SETTLED)
            slack = 0.0 if bound else mate.speed
            part = leading(part, links(view, part, [mate.cell], slack)[:, 0]) if part else part
        loose = self._since >= 0 or not view.radio.certain
        stuck = self._gathers and self._still > SETTLED and loose
        if (self._home or stuck) and not part:  # nobody waits for ever on the way home
            part = self._way[: math.ceil(view.speed) + 1]
        self._still = 0 if part else self._still + 1
        self._waited = self._waited + 1 if self._way and not part else 0
        if child is None and self._goal is not None and self._is_held(view):
            self._fail(view)
        stands = child is not None and not part and not self._gathers  # for those behind it
        state = "relay" if stands else "lead" if child is None else "follow"
        if self._gathers and not part and not self._is_away(view, view.cell) and self._come(view):
            state = "wait"
        return Plan(part, "return" if self._home else state, self._goal, home=self._home)

    def _fail(self, view: View) -> None:
        """The leader does not get there: it tries again from the base; then it gives that up."""
        self._waited, self._planned = 0, -(10**9)
        self._fails = self._fails + 1 if self._failed == view.cell else 0
        self._failed = view.cell
        if self._fails >= LOCKED:
            if view.known.free <= self._called:  # to no avail, the last time
                self._given_up.add(self._goal or view.base)
            self._fails = 0
            self._called, self._since, self._gathers = view.known.free, view.step, True
        elif self._gathers or not self._posts or self._goal in self._tried:
            self._gathers = False
            self._given_up.add(self._goal or view.base)
        else:
            self._gathers = True
            self._tried.add(self._goal or view.base)

    def _is_held(self, view: View) -> bool:
        """Whether the leader has waited in vain, or waits for a chain that does not move either."""
        if self._waited <= SETTLED:
            return False
        chain = [mate for number, mate in view.teammates.items() if number in view.linked]
        still = all(mate.letter.get("still", SETTLED) >= SETTLED for mate in chain)
        return still or self._waited > self.patience

    def _neighbours(self, view: View) -> tuple[int, Teammate | None]:
        """Number of the next one towards the base, and the next one away from it, if there is."""
        there = [
            mate
            for _, mate in sorted(view.teammates.items())
            if mate.number != BASE and view.step - max(mate.heard, 0) <= self.memory
        ]
        parent = max((mate.number for mate in there if mate.number < view.number), default=BASE)
        return parent, next((mate for mate in there if mate.number > view.number), None)

    def _lead(self, view: View) -> None:
        """To the nearest frontier that is not out of reach of the chain; home if there is none."""
        if self._gathers and (self._is_away(view, view.cell) or self._calls(view)):
            self._go(view, view.base)
            return
        self._gathers, self._since = False, -1
        frontiers = frontiers_of(view)
        while True:
            beyond = [cell for cell, free in self._beyond.items() if view.known.free < NEWS * free]
            aims = [
                aim
                for aim in self._bidding.aims(view, frontiers, 64)
                if all(straight(aim.cell, one) >= self.spacing for one in self._given_up)
                and all(straight(aim.cell, one) >= self.spacing for one in beyond)
            ]
            if not aims:
                self._go(view, view.base, home=True)
                return
            aim = min(aims, key=lambda one: one.distance)
            if not self._post(view, aim.cell):
                self._beyond[aim.cell] = view.known.free
                continue
            self._go(view, aim.cell)
            if not self._way:
                self._way = self._bidding.look(view, aim) or []
            if self._way:
                return

    def _calls(self, view: View) -> bool:
        """Whether all were called to the base, and some are still on their way."""
        mates = [mate for number, mate in view.teammates.items() if number in view.linked]
        late = view.step - self._since > self.memory
        return self._since >= 0 and not late and any(self._is_away(view, one.cell) for one in mates)

    def _come(self, view: View) -> bool:
        """Whether somebody is still on the way to the base."""
        mates = [mate for number, mate in view.teammates.items() if number in view.linked]
        return any(
            self._is_away(view, mate.cell) and mate.letter.get("still", 0) <= SETTLED
            for mate in mates
        )

    def _is_away(self, view: View, cell: Cell) -> bool:
        return straight(cell, view.base) > GATHERED

    def _post(self, view: View, goal: Cell) -> bool:
        """Name a post for each follower, as few as it takes; False: there are too few of them."""
        if goal == self._goal:
            return True
        followers = sum(number in view.linked for number in view.teammates if number != BASE)
        if not followers:
            return bool(ways_within(view, [goal], [view.base]))
        slack = 2.0 * view.speed
        posts = chain(view, [view.base], [goal], [1.0], followers, slack)
        if posts is None:
            posts = chain(view, [view.base], [goal], [1.0], followers)
        self._posts = posts or []
        return posts is not None

    def _follow(self, view: View, child: Teammate) -> None:
        """To its post or to the next one of the chain; home if the leader goes there."""
        mates = view.teammates.values()
        recent = [mate for mate in mates if view.step - max(mate.heard, 0) <= self.memory]
        told = max(recent, key=lambda mate: mate.number, default=child).letter
        posts, place = told.get("posts", ()), self._place(view)
        home, self._gathers = bool(child.letter.get("home")), bool(told.get("gathers"))
        if home or self._gathers:
            self._go(view, view.base, home)
        elif place < len(posts):
            self._go(view, posts[place])
        else:
            self._go(view, child.cell)
            self._way = self._way[:-1]

    def _place(self, view: View) -> int:
        """How many of the chain are nearer to the base."""
        return sum(0 < number < view.number for number in view.linked)

    def _go(self, view: View, goal: Cell, home: bool = False) -> None:
        self._goal, self._home = goal, home
        self._way = view.planner.path(view.cell, goal) or []
        if self._still > SETTLED and view.radio.certain:  # that way leads out of reach at once
            parent, _ = self._neighbours(view)
            anchor = view.teammates[parent].cell
            self._way = ways_within(view, [goal], [anchor]).get(goal, self._way)

    def letter(self, view: View) -> Letter:
        """Whether nothing is left to find, how long it has not moved, and what the leader wants."""
        wanted = {"posts": self._posts, "gathers": self._gathers}
        return {"home": self._home, "still": self._still, **wanted}
