"""Who goes to which frontier: each robot bids for itself and for the teammates it knows of.

Every robot runs the same auction on what it knows, so robots that know the same come to the same
result without a word (exploration reference 8).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.frontiers import Frontier
from usarsim_exploration.known_map import FREE, KNOWN, WALL
from usarsim_exploration.planning import Field, Path
from usarsim_exploration.strategy import View

CONSIDERED = 6
"""The best so many frontiers are bid for (reference 2)."""
_NEAR = 2
"""Cells around one that was looked from in vain, in which no other one is tried."""


@dataclass(frozen=True, slots=True, eq=False)
class Aim:
    """A frontier that a robot can go to.

    Attributes:
        frontier: which.
        cell: of its outline, where to drive to.
        distance: length of the way, cells.
    """

    frontier: Frontier
    cell: Cell
    distance: float


@dataclass
class Bidding:
    """Chooses a frontier for a robot, as its teammates would choose for it.

    Attributes:
        memory: steps for which a silent teammate still bids.
        keep_assigning: who gets no frontier bids again, against those who got none either, for all
            of them; else it takes what is best for itself.
        unreachable: centres of frontiers to which no way leads yet.
        fruitless: cells from where nothing more was to be seen, though a frontier is there.
    """

    memory: int = 500
    keep_assigning: bool = True
    unreachable: set[Cell] = field(default_factory=set)
    fruitless: set[Cell] = field(default_factory=set)
    _looked: set[Cell] = field(default_factory=set)

    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """Which of some frontiers is the robot's; None: there is none for it.

        A bid is size x 1e8 / d^4, d the length of the robot's own way. For others it is the
        straight distance, and the way when they would win by that (reference 8).
        """
        if not aims:
            return None
        places = {mate.number: mate.cell for mate in view.explorers(self.memory)}
        numbers = sorted({view.number, *places})
        places[view.number] = view.cell
        cells = np.array([places[number] for number in numbers])
        goals = np.array([aim.cell for aim in aims])
        sizes = np.array([aim.frontier.size for aim in aims]) * 1e8
        away = np.hypot(*(cells[:, None] - goals[None]).transpose(2, 0, 1))
        own = numbers.index(view.number)
        away[own] = [aim.distance for aim in aims]

        @cache
        def from_goals() -> NDArray[np.float64]:
            ways = [view.planner.distances(aim.cell, cells) for aim in aims]
            return np.stack(ways, axis=1)

        def measured(row: int) -> NDArray[np.float64]:
            if len(numbers) > len(goals):  # floods from the fewer ends of the ways
                ways = from_goals()[row]
            else:
                ways = view.planner.distances(places[numbers[row]], goals)
            found: NDArray[np.float64] = sizes / np.maximum(ways, 1.0) ** 4
            return found

        bids = sizes / np.maximum(away, 1.0) ** 4
        index = self._auction(bids, own, measured)
        return aims[int(bids[own].argmax()) if index is None else index]

    def _auction(
        self, bids: NDArray[np.float64], own: int, measured: Callable[[int], NDArray[np.float64]]
    ) -> int | None:
        """The best bid of all wins, and leaves with its frontier; equal ones by number.

        Args:
            bids: (robots, frontiers), at least as high as the true ones. own: row of whom we ask
                for. measured: the true bids of a row.
        """
        waiting, exact = np.ones(len(bids), np.bool_), {own}
        while True:
            left = bids * waiting[:, None]
            while left.any():
                winner, index = divmod(int(left.argmax()), len(bids[0]))
                if winner == own:
                    return index
                if winner not in exact:
                    exact.add(winner)
                    bids[winner] = measured(winner)
                    left[winner] = np.where(left[winner] > 0.0, bids[winner], 0.0)
                    continue
                left[winner], left[:, index], waiting[winner] = 0.0, 0.0, False
            if not self.keep_assigning:
                return None

    def aims(
        self, view: View, frontiers: list[Frontier], considered: int = CONSIDERED
    ) -> list[Aim]:
        """Those worth a bid: the best by size over straight distance of all that can be reached."""
        here = view.planner.field(view.cell)
        found = []
        for one in frontiers:
            cell = self._goal(here, one)
            if cell is None:
                continue
            found.append(Aim(one, cell, here.distance(cell)))
        column, row = view.cell
        found.sort(
            key=lambda aim: (
                -aim.frontier.size
                / max(float(np.hypot(aim.cell[0] - column, aim.cell[1] - row)), 1.0)
            )
        )
        return found[:considered]

    def _goal(self, here: Field, one: Frontier) -> Cell | None:
        """The centre of a frontier, or the nearest cell to it that can be driven to."""
        centre = one.centre
        if centre not in self.fruitless and here.reaches(centre):
            self.unreachable.discard(centre)
            return centre
        cells = one.openings
        cells = cells[here.distances(cells) < np.inf]
        if not len(cells):
            self.unreachable.add(centre)
            return None
        away = ((cells - centre) ** 2).sum(axis=1)
        for index in np.argsort(away, kind="stable").tolist():
            cell = int(cells[index, 0]), int(cells[index, 1])
            if cell not in self.fruitless:
                return cell
        return None

    def look(self, view: View, aim: Aim) -> Path | None:
        """What to do at a frontier that is there still: turn to it once, then leave it.

        Returns:
            A step back and forth, so that the scanner faces the unknown; None: this was done,
            and no robot needs to come here again.
        """
        column, row = view.cell
        if view.cell not in self._looked:
            self._looked.add(view.cell)
            back = _away_from_the_unknown(view)
            if back is not None:
                return [back, view.cell]
        self.fruitless.add(view.cell)
        around = np.abs(aim.frontier.outline - (column, row)).max(axis=1) <= _NEAR
        self.fruitless.update((int(c), int(r)) for c, r in aim.frontier.outline[around])
        return None

    # -- what teammates are told --------------------------------------------------------------

    def letter(self) -> dict[str, Any]:
        """What the robot has found to lead nowhere."""
        return {"unreachable": sorted(self.unreachable), "fruitless": sorted(self.fruitless)}

    def hear(self, letters: Iterable[Mapping[str, Any]]) -> None:
        """Take over what teammates found."""
        for letter in letters:
            self.unreachable.update(letter.get("unreachable", ()))
            self.fruitless.update(letter.get("fruitless", ()))


def _away_from_the_unknown(view: View) -> Cell | None:
    """The free neighbour, straight, that is farthest from the unknown ones."""
    bits = view.known.bits
    rows, columns = bits.shape
    column, row = view.cell
    top, left = max(row - 1, 0), max(column - 1, 0)
    unknown = np.argwhere(bits[top : row + 2, left : column + 2] & KNOWN == 0)
    if not len(unknown):
        return None
    down, right = unknown.mean(axis=0) + np.array([top - row, left - column])
    free = [
        (right * c + down * r, (column + c, row + r))
        for c, r in ((1, 0), (0, 1), (-1, 0), (0, -1))
        if 0 <= column + c < columns
        and 0 <= row + r < rows
        and bits[row + r, column + c] & (FREE | WALL) == FREE
    ]
    return min(free)[1] if free else None
