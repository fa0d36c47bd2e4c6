"""Frontier-based: spread over the frontiers, go home when there are none (reference 8 and 12.2)."""

from __future__ import annotations

from dataclasses import dataclass

from usarsim_exploration.bidding import Bidding
from usarsim_exploration.frontiers import find_frontiers
from usarsim_exploration.strategy import Letter, Plan, Strategy, View, register
from usarsim_server.fields import field


@register("frontier")
@dataclass
class FrontierStrategy(Strategy):
    """Greedy frontier exploration; home when everything is known."""

    replan: int = field(default=15, low=1, high=10_000, unit="steps", help="between two plans")
    memory: int = field(default=500, low=0, high=10**6, unit="steps", help="of silent teammates")
    keep_assigning: bool = field(
        default=True, help="robots without a frontier bid again for those that were assigned"
    )
    uncertain: bool = field(
        default=False, help="cells that are not certain yet are of frontiers, too (MRESim)"
    )

    def __post_init__(self) -> None:
        self._bidding = Bidding(self.memory, self.keep_assigning)
        self._planned = self._version = -1

    def decide(self, view: View) -> Plan | None:
        """Every `replan` steps, or when the path is used up and something is new."""
        if view.path and not view.blocked and view.step - self._planned < self.replan:
            return None
        if not view.path and not view.blocked and self._version == view.known.version:
            return None
        self._planned, self._version = view.step, view.known.version
        frontiers = find_frontiers(view.known, uncertain=self.uncertain)
        while (aim := self._bidding.choose(view, frontiers)) is not None:
            path = view.planner.path(view.cell, aim.cell)
            path = path or self._bidding.look(view, aim)
            if path:
                self._version = -1
                return Plan(path, goal=aim.cell)
        home = view.planner.path(view.cell, view.base) or []
        return Plan(home, "return", view.base, home=True)

    def letter(self, view: View) -> Letter:
        """Frontiers that lead nowhere."""
        return self._bidding.letter()

    def hear(self, view: View) -> None:
        """Frontiers that others know to lead nowhere."""
        self._bidding.hear(view.teammates[number].letter for number in sorted(view.linked))
