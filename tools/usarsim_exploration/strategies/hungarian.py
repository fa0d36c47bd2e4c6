"""Hungarian assignment: robots share the frontiers out so that all their ways together are short.

Each robot solves the same problem on what it knows (Kuhn, "The Hungarian method for the assignment
problem", Naval Research Logistics 1955; by scipy).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.bidding import Aim, team_ways
from usarsim_exploration.errors import scipy
from usarsim_exploration.exploring import Seeker
from usarsim_exploration.strategy import View, register

_NO_WAY = 1e6
"""Cells that a way counts which is not known; longer than any."""


def assign(lengths: NDArray[np.float64]) -> NDArray[np.int64]:
    """The column of each row, with the least sum; columns are given out evenly.

    Args:
        lengths: (robots, frontiers), at least one of each; infinite where there is no way.
    """
    count, columns = lengths.shape
    rounds = -(-count // columns)
    costs = np.minimum(lengths, _NO_WAY)
    # a frontier is given to a second robot only when each has one
    again = np.concatenate([costs + 10 * _NO_WAY * turn for turn in range(rounds)], axis=1)
    _, chosen = scipy("optimize").linear_sum_assignment(again)
    found: NDArray[np.int64] = chosen % columns
    return found


@register("hungarian")
@dataclass
class Hungarian(Seeker):
    """The least sum of ways."""

    def __post_init__(self) -> None:
        super().__post_init__()
        scipy("optimize")  # now: it takes longer than any step

    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """Its own share; the nearest if no way leads there."""
        aims = sorted(aims, key=lambda one: one.cell)
        known = team_ways(view, aims, self.memory)
        return aims[int(assign(known.lengths)[known.row])]
