"""MinPos: to the frontier that fewest teammates have a shorter way to.

So robots spread into all directions instead of racing for what is near (Bautin et al., "MinPos: A
novel frontier allocation algorithm for multi-robot exploration", ICIRA 2012).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_exploration.bidding import Aim, team_ways
from usarsim_exploration.exploring import Seeker
from usarsim_exploration.strategy import View, register


@register("minpos")
@dataclass
class MinPos(Seeker):
    """The lowest rank; of equal ones the nearest."""

    parts = True

    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """Rank of a frontier: how many teammates are nearer to it."""
        known = team_ways(view, aims, self.memory)
        own = known.lengths[known.row]
        ranks = (known.lengths < own).sum(axis=0)
        return aims[min(range(len(own)), key=lambda index: (ranks[index], own[index]))]
