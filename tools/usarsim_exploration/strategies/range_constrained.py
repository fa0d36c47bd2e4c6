"""Range constrained: nobody leaves the reach of the base, directly or over relays that stand still.

Robots go only to frontiers to which every cell of the way can count on a link to an anchor: the
base, or a robot that has parked. When there are none, one robot parks as far towards the next
frontier as it can, and the others explore around it; when they find nothing more, it goes on
(exploration reference 12.2, where MRESim does nothing).
"""

from __future__ import annotations

from dataclasses import dataclass

from usarsim_exploration.bidding import Aim, Bidding
from usarsim_exploration.environment import Cell
from usarsim_exploration.exploring import go_home
from usarsim_exploration.frontiers import find_frontiers
from usarsim_exploration.planning import Path
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
from usarsim_exploration.tether import held, leading, way_within
from usarsim_server.fields import field

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
        default=60, low=1, high=10**6, unit="steps",
        help="for which nothing new is found before all go home",
    )  # fmt: skip

    def __post_init__(self) -> None:
        self._free = self._news = 0
        self._over = False
        self._bidding = Bidding()
        self._planned = -1
        self._anchors: list[Cell] = []
        self._parked: int | None = None
        """Since when it stands as a relay."""
        self._leaving = self._idle = self._stuck = False
        self._since = 0
        """Since when others can count on it."""
        self._task: Cell | None = None
        """The frontier that it is the relay for, or will be."""
        self._served: set[Cell] = set()

    def decide(self, view: View) -> Plan | None:
        """Hold the place of a relay, or plan when it is time or when anchors have changed."""
        if view.known.free != self._free:
            self._free, self._news = view.known.free, view.step
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
        self._planned, self._anchors = view.step, anchors
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
        without = held(view, [mate.cell for mate in free], self._anchors_of(view))
        if view.step - self._since < _SETTLED or not done or not without.all():
            if self._leaving:
                self._leaving, self._since = False, view.step
            return False
        if not self._leaving:
            self._leaving = True
            return False
        self._leaving = False
        if self._task is not None:
            self._served.add(self._task)
        self._task = None
        return True

    def _relay(self, view: View, aims: list[Aim], said: bool) -> Plan | None:
        """Park towards the nearest frontier that had no relay yet, if somebody is left to explore.

        One robot at a time, the first by number of those who have said that they have nothing to
        do, a step before.
        """
        free = [mate for mate in _mates(view) if _told(mate, "parked") is None]
        idle = [mate.number for mate in free if _told(mate, "idle")]
        if not free or any(mate.state == "relay" for mate in free):
            return None
        open_ = [
            aim
            for aim in aims
            if all(straight(aim.cell, one) >= self.spacing for one in self._served)
        ]
        for aim in sorted(open_, key=lambda one: one.distance):
            self._stuck = False
            if not said or any(number < view.number for number in idle):
                return None
            path = self._leash(view, view.planner.path(view.cell, aim.cell) or [])
            end = path[-1] if path else view.cell
            if all(straight(end, one) >= self.spacing / 2 for one in self._anchors):
                self._task = aim.cell
                if not path:
                    self._parked = self._since = view.step
                return Plan(path, "relay", aim.cell)
            self._served.add(aim.cell)
            self._stuck = True
        return None

    # -- everybody ----------------------------------------------------------------------------

    def _plan(self, view: View) -> Plan:
        """To a frontier in reach; else as a relay; else towards the base, to be free for either."""
        said = self._idle or self._task is not None
        self._idle = self._stuck = False
        if self._task is not None and not view.path and not view.blocked:  # the relay has arrived
            self._parked = self._since = view.step
            return Plan([], "relay", self._task)
        self._task = None
        frontiers = find_frontiers(view.known)
        aims = self._bidding.aims(view, frontiers, self.considered)
        ways = {aim.cell: view.planner.path(view.cell, aim.cell) or [] for aim in aims}
        near = [aim for aim in aims if self._leash(view, ways[aim.cell]) == ways[aim.cell]]
        while (aim := self._bidding.choose(view, near)) is not None:
            path = ways.get(aim.cell) or self._bidding.look(view, aim)
            if path and len(self._leash(view, path)) == len(path):
                return Plan(path, goal=aim.cell)
            near.remove(aim)
        self._idle = self._stuck = True
        plan = self._relay(view, aims, said)
        if plan is not None:
            self._idle = False
            return plan
        home = go_home(view)
        done = len(self._anchors) == 1 and all(_told(mate, "stuck") for mate in _mates(view))
        path = self._leash(view, home.path)
        if home.path and not path:
            path = way_within(view, view.base, self._anchors)
        return Plan(path, "return", view.base, home=self._stuck and done)

    def _leash(self, view: View, path: Path) -> Path:
        return leading(path, held(view, path, self._anchors)) if path else path

    def _end(self, view: View) -> Plan | None:
        """All that is in reach is known, so no link has to be held any more."""
        if self._over and not view.blocked:
            return None
        self._over, self._parked = True, None
        return go_home(view)

    def _back(self, view: View) -> Plan | None:
        """The link was lost after all: back until it is there again."""
        self._parked, self._task, self._leaving = None, None, False
        self._planned = -self.replan
        if view.path and not view.blocked and view.path[-1] == view.base:
            return None
        return Plan(view.planner.path(view.cell, view.base) or [], "return", view.base)

    def letter(self, view: View) -> Letter:
        """Whether it is a relay, whether it has nothing to do, and which frontiers had theirs."""
        return {
            **self._bidding.letter(),
            "parked": None if self._leaving else self._parked,
            "idle": self._idle,
            "stuck": self._stuck,
            "served": sorted(self._served),
        }

    def hear(self, view: View) -> None:
        """What others know to lead nowhere, and what had its relay."""
        letters = [view.teammates[number].letter for number in sorted(view.linked)]
        self._bidding.hear(letters)
        for letter in letters:
            self._served.update(letter.get("served", ()))


def _mates(view: View) -> list[Teammate]:
    return [view.teammates[number] for number in sorted(view.linked) if number != BASE]


def _told(mate: Teammate, key: str) -> int | None:
    found: int | None = mate.letter.get(key)
    return found
