"""Next best view: drive to where the most of the unknown will be seen for the way.

The worth of a place is the unknown area in sight times e^(-decay x way) (Gonzalez-Banos & Latombe,
"Navigation strategies for exploring indoor environments", IJRR 2002); what a teammate will see from
where it goes is worth nothing (Burgard et al., "Coordinated multi-robot exploration", T-RO 2005).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.bidding import Aim
from usarsim_exploration.exploring import Seeker
from usarsim_exploration.gain import Outlook
from usarsim_exploration.strategy import View, register
from usarsim_server.base.fields import field


@register("next-best-view")
@dataclass
class NextBestView(Seeker):
    """Expected information for the way, with the map as it is or as it is predicted."""

    parts = True

    decay: float = field(
        default=0.03, low=0.0, high=10.0, unit="1/cell",
        help="how fast the worth of a view falls with the way there",
    )  # fmt: skip
    predict: int = field(
        default=0, low=0, high=1000, unit="cells",
        help="walls are thought to go on across unknown gaps of so many; 0: no prediction",
    )  # fmt: skip

    def due(self, view: View) -> bool:
        """Robots take turns, so that each knows where those before it go."""
        return (view.step + view.number) % self.replan == 0

    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """The best view that nobody else will have."""
        outlook = Outlook(view.known, view.reach, self.predict)
        cells = np.array([aim.cell for aim in aims])
        mates = view.explorers(self.memory)
        goals = [mate.goal for mate in mates if mate.goal is not None]
        if goals:
            outlook.promise(np.array(goals))
        for mate in mates:  # at the start all plan at once: by number
            if mate.goal is None and mate.number < view.number and mate.number in view.linked:
                away = np.hypot(*(cells - mate.cell).T)
                best = int(self._worth(outlook.gains(cells), away).argmax())
                outlook.promise(cells[best : best + 1])
        away = np.array([aim.distance for aim in aims])
        return aims[int(self._worth(outlook.gains(cells), away).argmax())]

    def guess(self, view: View, aims: Sequence[Aim]) -> None:
        """Nothing: who chooses by number knows what those before it see."""

    def _worth(self, gains: NDArray[np.float64], away: NDArray[np.float64]) -> NDArray[np.float64]:
        worth: NDArray[np.float64] = (1.0 + gains) * np.exp(-self.decay * away)
        return worth
