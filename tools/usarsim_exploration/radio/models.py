"""What an author of a radio model needs: `Radio`, `register`; and how a scenario names one.

A model is a frozen dataclass that says whether two radios hear each other; its declared fields are
its keys in the `[radio]` table of a scenario.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cache
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.kernels import crossings
from usarsim_exploration.messages import FRAME
from usarsim_server.base.fields import field
from usarsim_server.base.plugins import PluginTypes
from usarsim_server.base.tables import Table

GROUP = "usarsim.radios"
"""Entry point group for models of other packages."""
DEFAULT = "path-loss"
_FEW = 64
"""So many pairs are asked one by one."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Radio(ABC):
    """How a team talks; holds no state."""

    counts_walls: ClassVar[bool] = False
    """Whether it matters what stands between."""

    bandwidth: int = field(
        default=0, low=0, high=10**12, unit="bytes/step", help="of each radio; 0: no limit"
    )
    latency: int = field(
        default=0, low=0, high=10_000, unit="steps", help="of each link, from sender to taker"
    )
    loss: float = field(
        default=0.0, low=0.0, high=0.9, help=f"probability that a frame of {FRAME} bytes gets lost"
    )

    @property
    def shaped(self) -> bool:
        """Whether messages take time, so that each hop of a chain is a step."""
        return bool(self.bandwidth or self.latency or self.loss)

    @property
    def wall_cells(self) -> bool:
        """Whether each cell of a wall counts, not each wall."""
        return False

    @classmethod
    def read(cls, table: Table) -> Self:
        """The model with the keys of a table; the caller finishes it."""
        return table.read(cls)

    @abstractmethod
    def hears(self, distance: float, reach: float, walls: int, cell: float) -> bool:
        """Whether two radios hear each other; if so, nearer ones and with fewer walls, too.

        Args:
            distance: cells. reach: range of the pair, cells. walls: on the line between.
            cell: width of one, m.
        """

    def reach(self, one: Floats, other: Floats) -> Floats:
        """Ranges of pairs from those of their radios, cells; 0 where one is silent."""
        return np.minimum(one, other)

    def expected(self, reach: float) -> tuple[Radio, float]:
        """The model and the range (cells) that a robot with such a radio reckons with."""
        return self, reach

    def linked(
        self, away: Floats, reach: Floats, walls: NDArray[np.int64], cell: float
    ) -> NDArray[np.bool_]:
        """`hears` of many pairs, arrays of one length each.

        Of pairs with the same walls and range the farthest that hear each other are found by
        bisection, so thousands of pairs cost a few dozen questions.
        """
        if len(away) <= _FEW:
            asked = zip(away.tolist(), reach.tolist(), walls.tolist(), strict=True)
            return np.array([self.hears(*one, cell) for one in asked], np.bool_)
        found = np.zeros(len(away), np.bool_)
        kinds, which = np.unique(np.stack([walls, reach], axis=1), axis=0, return_inverse=True)
        for number, (between, far) in enumerate(kinds.tolist()):
            pairs = np.flatnonzero(which.reshape(-1) == number)
            lengths = np.unique(away[pairs])
            low, high = 0, len(lengths)
            while low < high:
                middle = (low + high) // 2
                if self.hears(float(lengths[middle]), far, int(between), cell):
                    low = middle + 1
                else:
                    high = middle
            if low:
                found[pairs] = away[pairs] <= lengths[low - 1]
        return found

    def direct(
        self, step: int, environment: Environment, cells: list[Cell], ranges: list[float]
    ) -> NDArray[np.bool_]:
        """The true links of a team without help of others, (n, n), in a step.

        Args:
            cells: where each robot is. ranges: of each radio, cells; 0: it is silent.
        """
        count = len(cells)
        found = np.zeros((count, count), np.bool_)
        one, other = _pairs(count)
        away, walls = self._between(environment, cells, one, other)
        far = np.array(ranges, np.float64)
        on = (far[one] > 0) & (far[other] > 0)
        reach = self.reach(far[one], far[other])
        on &= self.linked(away, np.where(on, reach, 1.0), walls, environment.cell)
        found[one, other] = found[other, one] = on
        return found

    def frame_loss(self, distance: float, reach: float, walls: int, cell: float) -> float:
        """Probability that a frame gets lost on a link; see `hears`."""
        return self.loss

    def losses(
        self,
        environment: Environment,
        cells: list[Cell],
        ranges: list[float],
        direct: NDArray[np.bool_],
    ) -> Floats:
        """`frame_loss` of all links of a team, (n, n); see `direct`."""
        found = np.zeros(direct.shape)
        one, other = np.nonzero(np.triu(direct))
        away, walls = self._between(environment, cells, one, other)
        far = np.array(ranges, np.float64)
        reach = self.reach(far[one], far[other])
        for index, (a, b) in enumerate(zip(one.tolist(), other.tolist(), strict=True)):
            found[a, b] = found[b, a] = self.frame_loss(
                float(away[index]), float(reach[index]), int(walls[index]), environment.cell
            )
        return found

    def _between(
        self,
        environment: Environment,
        cells: list[Cell],
        one: NDArray[np.int64],
        other: NDArray[np.int64],
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Distances of pairs, and the walls between; see `hears`."""
        places = np.array(cells, np.int64)
        pairs = np.concatenate([places[one], places[other]], axis=1)
        away = np.hypot(*(pairs[:, :2] - pairs[:, 2:]).T)
        walls = np.zeros(len(pairs), np.int64)
        if self.counts_walls:
            counted = crossings(environment.walls * np.uint8(2), pairs)
            walls = counted[:, int(self.wall_cells)]
        return away, walls


@dataclass(frozen=True)
class Ranged(Radio):
    """Ends at the range of the pair."""

    sum_of_ranges: bool = field(
        default=False, help="a pair reaches as far as both ranges together (MRESim), not the less"
    )

    def reach(self, one: Floats, other: Floats) -> Floats:
        """The smaller range, or the sum."""
        return one + other if self.sum_of_ranges else np.minimum(one, other)


@cache
def _pairs(count: int) -> tuple[NDArray[np.int64], ...]:
    """Of numbers below `count`, each pair once."""
    return np.triu_indices(count, 1)


TYPES: PluginTypes[Radio] = PluginTypes(
    "radio model", Radio, ("usarsim_exploration.radio.families",), GROUP
)

register = TYPES.register
"""Class decorator: make a model available under these names."""

radio_names = TYPES.names
"""All names that a scenario may write, sorted."""


def create_radio(table: Table) -> Radio:
    """The model of a `[radio]` table; the caller finishes that.

    Raises:
        UsarsimError: there is no such model, or one of its keys cannot be used.
    """
    name = table.choice("model", radio_names(), DEFAULT, any_case=True)
    return TYPES.find(name, "model").read(table)
