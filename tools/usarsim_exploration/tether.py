"""Staying within reach: which part of a way keeps the links that a robot must not lose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.planning import Path
from usarsim_exploration.strategy import View, straight
from usarsim_exploration.walking import line

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
    return view.radio.reaches(np.array(cells), np.array(others), slack=slack, unknown=UNKNOWN)


def held(
    view: View, cells: Sequence[Cell] | NDArray[np.int64], others: Sequence[Cell]
) -> NDArray[np.bool_]:
    """Which cells have a link to any of some others that can be counted upon, (cells,)."""
    if not len(cells) or not len(others):
        return np.zeros(len(cells), np.bool_)
    there, anchors = np.array(cells, np.int64), np.array(others, np.int64)
    away = np.hypot(*(anchors[:, None] - there[[0, -1]]).transpose(2, 0, 1)).sum(axis=1)
    nearest = np.argsort(away, kind="stable")  # they hold most of it
    return view.radio.held(there, anchors[nearest], UNKNOWN)


def leading(path: Path, good: NDArray[np.bool_]) -> Path:
    """The part of a path before the first cell that is not good."""
    return path if good.all() else path[: int(good.argmin())]


def sees_base(view: View) -> bool:
    """Whether a turn is enough to see the base; by rules without short ranges it always is."""
    return not view.rules.short or straight(view.cell, view.base) <= view.reach


def turn_to_base(view: View) -> Path:
    """A step away from the base and back, to see it; empty: there is no room, or it is known.

    Robots may start with their back to it, and links through the unknown are not counted on. A
    robot that does not see so far drives straight there, until something is in the way.
    """
    if view.planner.field(view.cell).reaches(view.base):
        return []
    if not sees_base(view):
        return [] if view.blocked else line(view.cell, view.base)
    column, row = view.cell
    off = column - view.base[0], row - view.base[1]
    beside = sorted(((0, -1), (0, 1), (-1, 0), (1, 0)), key=lambda one: -np.dot(one, off))
    for right, down in beside:
        cell = column + right, row + down
        if view.planner.path(view.cell, cell):
            return [cell, view.cell]
    return []
