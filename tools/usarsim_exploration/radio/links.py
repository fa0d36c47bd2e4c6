"""The links of a team in a step, directly and over chains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.radio.models import Radio


@dataclass(slots=True)
class Links:
    """Who hears whom in a step.

    Attributes:
        direct: (n, n) without help of others.
        closed: (n, n) over any chain.
    """

    direct: NDArray[np.bool_]
    closed: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        closed = self.direct.copy()
        closed.flat[:: len(closed) + 1] = True
        while True:
            further = closed @ closed
            if (further == closed).all():
                break
            closed = further
        self.closed = closed

    def hops(self) -> int:
        """How many hops the longest of the shortest chains has; at least 1."""
        reached, step = self.direct | np.eye(len(self.direct), dtype=np.bool_), 1
        further = reached
        while (further != self.closed).any():
            further, step = further @ reached, step + 1
        return step

    def groups(self) -> list[list[int]]:
        """Who can talk to whom, each once, in order; nobody alone."""
        found, seen = [], set[int]()
        for one in range(len(self.closed)):
            if one not in seen:
                group = np.flatnonzero(self.closed[one]).tolist()
                seen.update(group)
                if len(group) > 1:
                    found.append(group)
        return found


def find_links(
    radio: Radio,
    environment: Environment,
    cells: Sequence[Cell],
    ranges: Sequence[float],
    step: int = 0,
) -> Links:
    """The true links of a team.

    Args:
        cells: where each robot is. ranges: of each radio, cells; 0: it is silent. step: now.
    """
    return Links(radio.direct(step, environment, list(cells), list(ranges)))
