"""Nearest frontier: each robot drives to the one with the shortest way, whatever others do.

The strategy that others are compared with (Yamauchi, "Frontier-based exploration using multiple
robots", AGENTS 1998).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_exploration.bidding import Aim
from usarsim_exploration.exploring import Seeker
from usarsim_exploration.strategy import View, register


@register("nearest")
@dataclass
class Nearest(Seeker):
    """The shortest way first."""

    parts = True

    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """The least distance."""
        return min(aims, key=lambda one: one.distance)
