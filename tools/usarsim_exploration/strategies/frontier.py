"""Frontier-based: spread over the frontiers, go home when there are none (exploration 8 and
12.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_exploration.bidding import CONSIDERED, Aim, Bidding
from usarsim_exploration.exploring import Seeker
from usarsim_exploration.frontiers import Frontier, frontiers_of
from usarsim_exploration.mresim import planning
from usarsim_exploration.strategy import View, register
from usarsim_server.base.fields import field


@register("frontier")
@dataclass
class FrontierStrategy(Seeker):
    """Greedy frontier exploration; home when everything is known."""

    considered: int = field(
        default=CONSIDERED, low=1, high=1000, help="best frontiers to choose from"
    )
    keep_assigning: bool = field(
        default=True, help="robots without a frontier bid again for those that were assigned"
    )
    uncertain: bool = field(
        default=False, help="cells that are not certain yet are of frontiers, too (MRESim)"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self._bidding = Bidding(self.memory, self.keep_assigning)

    def frontiers(self, view: View) -> list[Frontier]:
        """By its own rule, or MRESim's."""
        if view.rules.mresim:
            return planning.find_frontiers(view.known)
        return frontiers_of(view, uncertain=self.uncertain)

    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """What it wins in the auction."""
        return self._bidding.choose(view, aims)
