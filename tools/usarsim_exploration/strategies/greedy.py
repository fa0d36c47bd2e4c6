"""Greedy by gain over cost: much frontier for a short way, whatever others do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_exploration.bidding import Aim
from usarsim_exploration.exploring import Seeker
from usarsim_exploration.strategy import View, register
from usarsim_server.base.fields import field


@register("greedy")
@dataclass
class Greedy(Seeker):
    """The greatest size of a frontier over the length of the way to it, to a power."""

    parts = True

    power: float = field(
        default=1.0, low=0.0, high=10.0, help="of the length; 0: the largest frontier, however far"
    )

    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """The best; of equal ones the nearest."""
        return max(aims, key=lambda one: one.frontier.size / max(one.distance, 1.0) ** self.power)
