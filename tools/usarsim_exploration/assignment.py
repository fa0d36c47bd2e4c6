"""How far each robot of a team has it to each frontier, as one of them can tell by its own map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.bidding import Aim
from usarsim_exploration.environment import Cell
from usarsim_exploration.strategy import View


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """Lengths of ways.

    Attributes:
        row: of the robot itself.
        lengths: (robots, aims), cells; robots in the order of their numbers; infinite where
            no way is known.
    """

    row: int
    lengths: NDArray[np.float64]


def ways(view: View, aims: Sequence[Aim], memory: int) -> Ways:
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
    return Ways(own, lengths)


def _lengths(view: View, start: Cell, goals: Sequence[Cell]) -> NDArray[np.float64]:
    return view.planner.distances(start, np.array(goals))
