"""Staying within reach: which part of a way keeps the links that a robot must not lose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.kernels.steps import FAR
from usarsim_exploration.planning import Field, Path
from usarsim_exploration.strategy import View

UNKNOWN = 3
"""Unknown cells that may lie on the line of a link that is counted upon; robots start with their
back to the base, so a few of its surroundings are."""


def links(
    view: View, cells: Sequence[Cell], others: Sequence[Cell], slack: float = 0.0
) -> NDArray[np.bool_]:
    """Which links can be counted upon, (cells, others).

    Args:
        view: of the robot. cells, others: the ends. slack: see `RadioEstimate.reaches`.
    """
    if not cells or not others:
        return np.zeros((len(cells), len(others)), np.bool_)
    one = np.repeat(np.array(cells, np.int64), len(others), axis=0)
    other = np.tile(np.array(others, np.int64), (len(cells), 1))
    pairs = np.concatenate([one, other], axis=1)
    found = view.radio.reaches(pairs, slack=slack, unknown=UNKNOWN)
    return found.reshape(len(cells), len(others))


def held(view: View, cells: Sequence[Cell], others: Sequence[Cell]) -> NDArray[np.bool_]:
    """Which cells have a link to any of some others that can be counted upon, (cells,)."""
    return np.asarray(links(view, cells, others).any(axis=1), np.bool_)


def leading(path: Path, good: NDArray[np.bool_]) -> Path:
    """The part of a path before the first cell that is not good."""
    return path if good.all() else path[: int(good.argmin())]


def way_within(view: View, goal: Cell, others: Sequence[Cell]) -> Path:
    """The way to a goal over held cells only, or to that one of them that is nearest to it.

    It judges every known cell, so it is for whom the shortest way is barred.
    """
    free = np.argwhere(view.planner.passable)[:, ::-1]
    good = np.zeros(len(free), np.bool_)
    for cell in others:
        pairs = np.concatenate([free, np.broadcast_to(cell, free.shape)], axis=1)
        good |= view.radio.reaches(pairs, unknown=UNKNOWN)
    within = np.zeros_like(view.planner.passable)
    within[free[good, 1], free[good, 0]] = 1
    field = Field(within, [view.cell], within.size)
    costs = view.planner.field(goal).costs
    away = np.where(field.costs != FAR, costs, FAR)
    row, column = divmod(int(away.argmin()), away.shape[1])
    return field.path((column, row)) or []
