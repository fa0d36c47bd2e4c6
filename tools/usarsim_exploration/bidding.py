"""Who goes to which frontier: each robot bids for itself and for the teammates it knows of.

Every robot runs the same auction on what it knows, so robots that know the same come to the same
result without a word (exploration reference 8).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.frontiers import Frontier, leftovers, passages
from usarsim_exploration.known_map import FREE, KNOWN, SAFE, WALL
from usarsim_exploration.planning import Field, Path
from usarsim_exploration.strategy import BASE, View
from usarsim_exploration.walking import into_unknown

CONSIDERED = 6
"""The best so many frontiers are bid for (exploration 2)."""
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


@dataclass(frozen=True, slots=True, eq=False)
class TeamWays:
    """How far each robot of a team has it to each aim, as one of them can tell by its own map.

    Attributes:
        row: of the robot itself.
        lengths: (robots, aims), cells; robots in the order of their numbers; infinite where
            no way is known.
    """

    row: int
    lengths: NDArray[np.float64]


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
    _entered: set[Cell] = field(default_factory=set)

    def choose(self, view: View, aims: Sequence[Aim]) -> Aim | None:
        """Which of some frontiers is the robot's; None: there is none for it.

        A bid is size x 1e8 / d^4, d the length of the robot's own way. For others it is the
        straight distance, and the way when they would win by that (exploration 8).
        """
        if not aims:
            return None
        places = {mate.number: mate.cell for mate in view.explorers(self.memory)}
        places[view.number] = view.cell
        numbers = sorted(places)
        cells, goals = [places[number] for number in numbers], [aim.cell for aim in aims]
        sizes = np.array([aim.frontier.size for aim in aims]) * 1e8
        own = numbers.index(view.number)
        apart = np.array(cells)[:, None] - np.array(goals)
        ways = np.hypot(apart[..., 0], apart[..., 1])  # at least so long
        ways[own] = [aim.distance for aim in aims]
        exact = np.zeros(ways.shape, np.bool_)
        exact[own] = True
        by_goal = len(cells) > len(goals)  # floods from the fewer ends of the ways
        starts, ends = (goals, np.array(cells)) if by_goal else (cells, np.array(goals))
        if by_goal:  # no way is shorter than what it saves; none leads to who is out of reach
            here = view.planner.field(view.cell).distances(ends)
            ways = np.maximum(ways, np.abs(here[:, None] - ways[own]))

        def measure(robot: int, goal: int) -> None:
            """Find out a way, and what the same flood tells of others."""
            start, end = (goal, robot) if by_goal else (robot, goal)
            found = view.planner.distances(starts[start], ends, end)
            line = ways[:, goal] if by_goal else ways[robot]
            known = exact[:, goal] if by_goal else exact[robot]
            line[~known] = np.maximum(line, found)[~known]
            known |= found < found[end]
            known[end] = True

        index = self._auction(sizes, ways, exact, own, measure)
        return aims[int(_bids(sizes, ways[own]).argmax()) if index is None else index]

    def _auction(
        self,
        sizes: NDArray[np.float64],
        ways: NDArray[np.float64],
        exact: NDArray[np.bool_],
        own: int,
        measure: Callable[[int, int], None],
    ) -> int | None:
        """The best bid of all wins, and leaves with its frontier; equal ones by number.

        Args:
            sizes: (frontiers,). ways: (robots, frontiers), at most as long as the true ones.
            exact: which are the true ones. own: row of whom we ask for.
            measure: makes the way of a robot to a frontier, and maybe others, exact.
        """
        waiting = np.ones(len(ways), np.bool_)
        while True:
            free = np.ones(len(sizes), np.bool_)
            while (left := _bids(sizes, ways) * (waiting[:, None] & free)).any():
                robot, index = divmod(int(left.argmax()), len(sizes))
                if not exact[robot, index]:
                    measure(robot, index)
                elif robot == own:
                    return index
                else:
                    waiting[robot] = free[index] = False
            if not self.keep_assigning:
                return None

    def aims(
        self, view: View, frontiers: list[Frontier], considered: int = CONSIDERED
    ) -> list[Aim]:
        """Those worth a bid: the best by size over straight distance of all that can be reached.

        Where none can, those of one and two cells, if the rules of the run have them: first those
        of passages; those beside wide space, where as a rule a wall has not been seen whole, only
        when the base lacks nothing that the robot could bring it.
        """
        if view.rules.mresim:
            found = [one for one in map(partial(self._aim, view), frontiers) if one is not None]
            return _best(view, found)[:considered]
        found = self._reached(view, frontiers)
        if not found and view.rules.narrow:
            found = self._reached(view, passages(view.known))
            if not found and (BASE in view.linked or not view.known.undelivered):
                found = self._reached(view, leftovers(view.known))
        return found[:considered]

    def _reached(self, view: View, frontiers: list[Frontier]) -> list[Aim]:
        """Frontiers that can be reached, the best by size over straight distance first."""
        here = view.planner.field(view.cell)
        found = []
        for one in frontiers:
            cell = self._goal(here, one)
            if cell is None:
                continue
            found.append(Aim(one, cell, here.distance(cell)))
        return _best(view, found)

    def _aim(self, view: View, one: Frontier) -> Aim | None:
        """The middle of a frontier, by MRESim's rules, if it can be reached."""
        here, (column, row) = view.planner.field(view.cell), one.centre
        if view.known.bits[row, column] & KNOWN == 0:  # beside it
            cells = one.outline[here.distances(one.outline) < np.inf]
            if not len(cells):
                return None
            column, row = cells[((cells - one.centre) ** 2).sum(axis=1).argmin()].tolist()
        far = here.distance((column, row))
        return Aim(one, (column, row), far) if far < np.inf else None

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
        """What to do at a frontier that is there still: turn to it, then drive into it, once each.

        Returns:
            A step back and forth, so that the scanner faces the unknown; a cell of the unknown;
            None: this was done, and no robot needs to come here again.
        """
        column, row = view.cell
        if view.cell not in self._looked:
            self._looked.add(view.cell)
            back = _away_from_the_unknown(view)
            if back is not None:
                return [back, view.cell]
        if view.rules.short and view.cell not in self._entered:
            self._entered.add(view.cell)
            far = view.speed if view.reach < view.speed else 1.0
            if way := into_unknown(view, view.cell, view.heading, far):
                return way
        self.fruitless.add(view.cell)
        around = np.abs(aim.frontier.outline - (column, row)).max(axis=1) <= _NEAR * view.scale
        self.fruitless.update((int(c), int(r)) for c, r in aim.frontier.outline[around])
        return None

    # -- what teammates are told --------------------------------------------------------------

    def letter(self) -> dict[str, Any]:
        """What the robot has found to lead nowhere."""
        return {"unreachable": sorted(self.unreachable), "fruitless": sorted(self.fruitless)}

    def hear(self, letters: Iterable[Mapping[str, Any]]) -> None:
        """Take over what teammates found."""
        for letter in letters:
            if cells := letter.get("unreachable"):
                self.unreachable.update(cells)
            if cells := letter.get("fruitless"):
                self.fruitless.update(cells)


def team_ways(view: View, aims: Sequence[Aim], memory: int) -> TeamWays:
    """Lengths of the ways of a robot, and of the teammates that it remembers, to some frontiers.

    One flood from each option or from each teammate, whichever are fewer.
    """
    mates = {mate.number: mate.cell for mate in view.explorers(memory)}
    numbers = sorted({view.number, *mates})
    goals = [one.cell for one in aims]
    lengths = np.empty((len(numbers), len(goals)))
    cells = [mates[number] for number in numbers if number != view.number]
    if len(goals) < len(cells):
        others = np.stack([_lengths(view, goal, cells) for goal in goals], axis=1)
    else:
        others = np.array([_lengths(view, cell, goals) for cell in cells])
    own = numbers.index(view.number)
    if cells:
        lengths[np.arange(len(numbers)) != own] = others
    lengths[own] = [one.distance for one in aims]
    return TeamWays(own, lengths)


def _lengths(view: View, start: Cell, goals: Sequence[Cell]) -> NDArray[np.float64]:
    return view.planner.distances(start, np.array(goals))


def _best(view: View, aims: list[Aim]) -> list[Aim]:
    """By size over straight distance."""
    column, row = view.cell

    def value(aim: Aim) -> float:
        away = float(np.hypot(aim.cell[0] - column, aim.cell[1] - row))
        return -aim.frontier.size / max(away, 1.0)

    return sorted(aims, key=value)


def _bids(sizes: NDArray[np.float64], ways: NDArray[np.float64]) -> NDArray[np.float64]:
    """What frontiers are worth to who has such ways to them."""
    found: NDArray[np.float64] = sizes / np.maximum(ways, 1.0) ** 4
    return found


def _away_from_the_unknown(view: View) -> Cell | None:
    """The free neighbour, straight, that is farthest from the unknown ones."""
    bits = view.known.bits
    rows, columns = bits.shape
    column, row = view.cell
    top, left = max(row - 1, 0), max(column - 1, 0)
    around = bits[top : row + 2, left : column + 2]
    unknown = np.argwhere(around & KNOWN == 0)
    if not len(unknown):
        unknown = np.argwhere(around & (WALL | SAFE) == WALL)
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
