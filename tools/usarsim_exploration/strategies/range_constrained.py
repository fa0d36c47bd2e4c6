"""Range constrained: nobody leaves the reach of the base, directly or over relays that stand still.

Robots go only to frontiers to which every cell of the way can count on a link to an anchor: the
base, or a robot that has parked. When there are none, one robot parks as far towards the next
frontier as it can, and the others explore around it; when they find nothing more, it goes on
(exploration reference 12.2, where MRESim does nothing).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.bidding import Aim, Bidding
from usarsim_exploration.environment import Cell
from usarsim_exploration.exploring import go_home
from usarsim_exploration.frontiers import frontiers_of
from usarsim_exploration.planning import Field, Path
from usarsim_exploration.relays import LOOK, chain, ways_within, within
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
from usarsim_exploration.tether import held, leading, sees_base, turn_to_base
from usarsim_server.base.fields import field

SLACK = 2.0
"""Cells by which links of places for relays are shorter than those that are counted upon: what is
seen later may show one more wall."""
_SETTLED = 3
"""Steps after which others have planned with a new relay."""


@register("range-constrained")
@dataclass
class RangeConstrained(Strategy):
    """Explores on a leash."""

    replan: int = field(default=5, low=1, high=10_000, unit="steps", help="between two plans")
    considered: int = field(default=16, low=1, high=1000, help="best frontiers to choose from")
    spacing: float = field(
        default=10.0, low=0.0, high=1000.0, unit="cells",
        help="frontiers nearer to one that a relay stood for have had theirs",
    )  # fmt: skip

    patience: int = field(
        default=150, low=1, high=10**6, unit="steps",
        help="for which nothing new is found before all go home",
    )  # fmt: skip

    def __post_init__(self) -> None:
        self._free = self._news = 0
        self._over = self._turned = False
        self._bidding = Bidding()
        self._planned = -1
        self._anchors: list[Cell] = []
        self._parked: int | None = None
        """Since when it stands as a relay."""
        self._leaving = self._idle = self._stuck = False
        self._judged: tuple[object, ...] = ()
        self._masks: dict[tuple[int, tuple[Cell, ...]], NDArray[np.uint8]] = {}
        self._asked: tuple[list[Cell], int] = [], 0
        """With which anchors, and when, it last found no frontier in reach."""
        self._since = 0
        """Since when others can count on it."""
        self._task: Cell | None = None
        """The frontier that it is the relay for, or will be."""
        self._served: set[tuple[Cell, tuple[Cell, ...]]] = set()
        """Frontiers that had a relay in vain, and who stood then beside it."""

    def decide(self, view: View) -> Plan | None:
        """Hold the place of a relay, or plan when it is time or when anchors have changed."""
        if view.known.free != self._free:
            self._free, self._news, self._over = view.known.free, view.step, False
        if not self._turned:
            turn = turn_to_base(view)
            self._turned = not turn or sees_base(view)
            if turn:
                return Plan(turn, "turn")
        if self._over or view.step - self._news > self.patience:
            return self._end(view)
        if BASE not in view.linked:
            return self._back(view)
        if self._parked is not None:
            if not self._may_leave(view):
                return Plan([], "relay", self._task)
            self._parked = None
        anchors = self._anchors_of(view)
        again = anchors != self._anchors or view.blocked or not view.path
        if not again and view.step - self._planned < self.replan:
            return None
        known = view.known.version, tuple(anchors), tuple(_said(mate) for mate in _mates(view))
        if self._stuck and known == self._judged and not view.path:
            return Plan([], "wait", view.base, home=self._is_over(view))
        self._planned, self._anchors, self._judged = view.step, anchors, known
        return self._plan(view)

    # -- relays -------------------------------------------------------------------------------

    def _anchors_of(self, view: View) -> list[Cell]:
        parked = [mate.cell for mate in _mates(view) if _told(mate, "parked") is not None]
        return [view.base, *parked]

    def _may_leave(self, view: View) -> bool:
        """Said a step before, so that nobody counts on it; and only if nobody hangs on it."""
        mates = _mates(view)
        free = [mate for mate in mates if _told(mate, "parked") is None]
        order = self._parked or 0, view.number
        later = [mate for mate in mates if (_told(mate, "parked") or -1, mate.number) > order]
        done = all(_told(mate, "stuck") for mate in free) and not later
        if view.step - self._since < _SETTLED or not done or not self._is_free(view, free):
            if self._leaving:
                self._leaving, self._since = False, view.step
            return False
        if not self._leaving:
            self._leaving = True
            return False
        self._leaving = False
        if self._task is not None:
            self._served.add((self._task, tuple(sorted(self._anchors_of(view)))))
        self._task = None
        return True

    def _is_free(self, view: View, others: list[Teammate]) -> bool:
        """Whether all others and it itself get home in reach of the rest."""
        rest = self._anchors_of(view)
        mask = self._mask(view, rest)
        home = Field(mask, [view.base], mask.size)
        way = view.planner.path(view.cell, view.base) or []
        leaves = any(home.reaches(cell) for cell in [view.cell, *way[: int(view.speed)]])
        there = [one.cell for one in others]
        return leaves and all(map(home.reaches, there)) and bool(held(view, there, rest).all())

    def _relay(self, view: View, aims: list[Aim]) -> Plan | None:
        """Park where a frontier comes in reach that had none yet, if others are left to explore.

        With several relays if need be: this is the first of them.
        """
        mates = _mates(view)
        free = [one for one in mates if not (_parked(one) or _told(one, "over"))]
        beside = tuple(sorted(self._anchors))
        vain = [cell for cell, others in self._served if others == beside]
        open_ = [
            aim for aim in aims if all(straight(aim.cell, one) >= self.spacing for one in vain)
        ]
        while free and open_:
            goals, worth = [aim.cell for aim in open_], [aim.frontier.size for aim in open_]
            places = chain(view, self._anchors, goals, worth, len(free), SLACK)
            if places is None:
                return None
            task = min(goals, key=lambda goal: straight(goal, places[-1]))
            path = self._way(view, places[0])
            if path or view.cell == places[0]:
                self._task = task
                if not path:
                    self._parked = self._since = view.step
                return Plan(path, "relay", task)
            self._served.add((task, beside))  # the lattice was wrong
            open_ = [aim for aim in open_ if straight(aim.cell, task) >= self.spacing]
        return None

    def _way(self, view: View, goal: Cell) -> Path:
        """To a place without losing the link on the way; empty: there is none."""
        path = view.planner.path(view.cell, goal) or []
        return path if self._is_held(view, path) else self._ways(view, [goal]).get(goal, [])

    def _ways(self, view: View, goals: list[Cell]) -> dict[Cell, Path]:
        """Ways to goals over held cells, for whom the shortest ones are barred."""
        return ways_within(view, goals, self._anchors, self._mask(view, self._anchors))

    # -- everybody ----------------------------------------------------------------------------

    def _plan(self, view: View) -> Plan:
        """To a frontier in reach; else as a relay; else wait for those who do either."""
        said = self._idle or self._task is not None
        self._idle = self._stuck = False
        if self._task is not None and not view.path and not view.blocked:  # the relay has arrived
            self._parked = self._since = view.step
            return Plan([], "relay", self._task)
        if self._task is not None and self._is_held(view, view.path):
            return Plan(view.path, "relay", self._task)
        self._task = None
        frontiers = frontiers_of(view)
        aims = self._bidding.aims(view, frontiers, self.considered)
        asked, since = self._asked
        if not said or asked != self._anchors or view.step - since >= self.replan:
            plan = self._explore(view, aims)
            if plan is not None:
                return plan
            self._asked = list(self._anchors), view.step
        self._idle = True
        mates = _mates(view)
        if not said or any(mate.state == "relay" and not _parked(mate) for mate in mates):
            return Plan([], "wait", view.cell)
        first = next((mate for mate in mates if _told(mate, "idle")), None)
        if first is None or first.number > view.number:
            plan = self._relay(view, aims)
            if plan is not None:
                self._idle = False
                return plan
        elif not _told(first, "stuck"):
            return Plan([], "wait", view.cell)
        self._stuck = True
        return self._retreat(view)

    def _explore(self, view: View, aims: list[Aim]) -> Plan | None:
        """To the frontier that it wins, of those that it gets to in reach."""
        whole = {aim.cell: view.planner.path(view.cell, aim.cell) or [] for aim in aims}
        ways = {
            cell: self._leash(view, path)
            for cell, path in whole.items()
            if self._is_held(view, path[: max(len(path) - LOOK, 0)])
        }
        if not ways:
            ways = self._ways(view, [aim.cell for aim in aims])
        near = [aim for aim in aims if aim.cell in ways]
        while (aim := self._bidding.choose(view, near)) is not None:
            path = ways.get(aim.cell) or self._bidding.look(view, aim)
            if path and self._is_held(view, path):
                return Plan(path, goal=aim.cell)
            near.remove(aim)
        return None

    def _is_held(self, view: View, path: Path) -> bool:
        last = not path or held(view, path[-1:], self._anchors).all()
        return bool(last and held(view, path, self._anchors).all())

    def _retreat(self, view: View) -> Plan:
        """As far as the relay that parked last is not needed; without one, home."""
        path = self._way(view, view.base)
        if not path:  # the link is better than it could count upon
            path = view.planner.path(view.cell, view.base) or []
        parked = [mate for mate in _mates(view) if _parked(mate)]
        if parked and path:
            last = max(parked, key=lambda mate: (_told(mate, "parked") or 0, mate.number))
            others = [cell for cell in self._anchors if cell != last.cell]
            barred = np.flatnonzero(~held(view, [view.cell, *path], others))
            path = path[: int(barred[-1]) + 1] if len(barred) else []
        state = "return" if path or view.cell == view.base else "wait"
        return Plan(path, state, view.base, home=self._is_over(view))

    def _mask(self, view: View, anchors: list[Cell]) -> NDArray[np.uint8]:
        """Where anchors hold it, nearly; kept until the map changes."""
        key = view.known.version, tuple(anchors)
        if key not in self._masks:
            self._masks = {one: mask for one, mask in self._masks.items() if one[0] == key[0]}
            self._masks[key] = within(view, anchors)
        return self._masks[key]

    def _is_over(self, view: View) -> bool:
        """Whether nobody has anything left to find, and no relay stands."""
        stuck = all(_told(mate, "stuck") for mate in _mates(view))
        return len(self._anchors) == 1 and self._stuck and stuck

    def _leash(self, view: View, path: Path) -> Path:
        return leading(path, held(view, path, self._anchors)) if path else path

    def _end(self, view: View) -> Plan | None:
        """Nothing new for long: home, with no link to hold; who hears of news begins anew."""
        if self._over and not view.blocked:
            return None
        self._over, self._leaving, self._parked, self._task = True, False, None, None
        return go_home(view)

    def _back(self, view: View) -> Plan | None:
        """The link was lost after all: back until it is there again."""
        self._parked, self._task, self._leaving = None, None, False
        self._planned = -self.replan
        if view.path and not view.blocked and view.path[-1] == view.base:
            return None
        return Plan(view.planner.path(view.cell, view.base) or [], "return", view.base)

    def letter(self, view: View) -> Letter:
        """Whether it is a relay, has nothing to do or goes home; which frontiers had a relay."""
        return {
            **self._bidding.letter(),
            "parked": None if self._leaving else self._parked,
            "idle": self._idle,
            "stuck": self._stuck or self._over,
            "over": self._over,
            "served": sorted(self._served),
        }

    def hear(self, view: View) -> None:
        """What others know to lead nowhere, and what had its relay."""
        letters = [view.teammates[number].letter for number in sorted(view.linked)]
        self._bidding.hear(letters)
        for letter in letters:
            told = letter.get("served", ())
            self._served.update((tuple(cell), tuple(others)) for cell, others in told)


def _mates(view: View) -> list[Teammate]:
    return [view.teammates[number] for number in sorted(view.linked) if number != BASE]


def _parked(mate: Teammate) -> bool:
    return mate.letter.get("parked") is not None


def _said(mate: Teammate) -> tuple[object, ...]:
    """What of a mate decides whether somebody may become a relay."""
    driving = mate.state == "relay" and not _parked(mate)
    return driving, _told(mate, "idle"), _told(mate, "stuck")


def _told(mate: Teammate, key: str) -> int | None:
    found: int | None = mate.letter.get(key)
    return found
