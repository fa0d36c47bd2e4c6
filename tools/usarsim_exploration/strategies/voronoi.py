"""Voronoi: each robot explores the part of known space that is nearest to it by way.

The parts follow the robots, so those who stand together are driven apart (Hu et al., "Voronoi-based
multi-robot autonomous exploration in unknown environments", IEEE T-VT 2020). A robot without a
frontier of its own helps where its way is the least longer than that of whoever is nearest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.bidding import Aim
from usarsim_exploration.environment import Cell
from usarsim_exploration.exploring import Seeker
from usarsim_exploration.strategy import View, register
from usarsim_server.base.fields import field


@register("voronoi")
@dataclass
class Voronoi(Seeker):
    """Explores its own part, the best gain for the way first."""

    parts = True

    gain: float = field(
        default=0.5, low=0.0, high=4.0,
        help="power of a frontier's size in its worth: 0 takes the nearest",
    )  # fmt: skip

    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """The best of its part; else of the others those where it comes least too late."""
        cells = np.array([aim.cell for aim in aims])
        away = np.array([aim.distance for aim in aims])
        late = np.maximum(lateness(view, cells, away, self.memory), 0.0)
        size = np.array([aim.frontier.size for aim in aims])
        worth = size**self.gain / np.maximum(away, 1.0)
        best = np.lexsort((-worth, late))
        return aims[int(best[0])]


def lateness(
    view: View, cells: NDArray[np.int64], away: NDArray[np.float64], memory: int
) -> NDArray[np.float64]:
    """How much longer a robot's way to cells is than that of whoever else is nearest, cells.

    At most 0 in its own part; where two are equally near, the one with the lower number has it.

    Args:
        view: of the robot. cells: (n, 2). away: (n,) its own ways.
        memory: steps for which a silent teammate counts.
    """
    mates = view.explorers(memory)
    late = np.full(len(cells), -np.inf)
    for lower in (True, False):
        starts: list[Cell] = [mate.cell for mate in mates if (mate.number < view.number) is lower]
        if starts:
            behind = away - view.planner.field(*starts).distances(cells)
            late = np.maximum(late, np.where(behind == 0.0, 1e-9 if lower else 0.0, behind))
    return late
