"""Robots that stand although they could find something; nobody but the judge of a run asks this."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.cycle import BASE, Body
from usarsim_exploration.environment import Environment
from usarsim_exploration.frontiers import find_frontiers, passages
from usarsim_exploration.known_map import KNOWN
from usarsim_exploration.strategy import View

EVERY = 10
"""Steps of a stand between two looks at the robot's map."""
WAITING = ("relay", "wait", "give", "get")
"""Beginnings of the states of robots that stand for others: parked relays, and at meetings."""
_AROUND = np.ones((3, 3), np.uint8)


class Idleness:
    """For how many steps robots have stood with a frontier left that they could drive to."""

    def __init__(self, bodies: int) -> None:
        """bodies: how many."""
        self._stood, self._idle = [-1] * bodies, [0] * bodies  # the start is no step

    def count(self, number: int, body: Body, environment: Environment, *, moved: bool) -> int:
        """Steps up to now, looked at every tenth; 0 for who moved, failed or waits for others.

        Args:
            number, body: of whom. environment: true. moved: it has, in this step.
        """
        view = body.view
        waits = view.role == "relay" or body.state.startswith(WAITING)
        if moved or waits or number == BASE or not body.works:
            self._stood[number] = self._idle[number] = 0
            return 0
        self._stood[number] += 1
        if self._stood[number] and self._stood[number] % EVERY == 0:
            left = has_frontier(view, environment)
            self._idle[number] = self._idle[number] + EVERY if left else 0
        return self._idle[number]


def has_frontier(view: View, environment: Environment) -> bool:
    """Whether a robot's map has a frontier that it can drive to, with truly free cells behind."""
    frontiers = find_frontiers(view.known) or (passages(view.known) if view.rules.narrow else [])
    if not frontiers:
        return False
    openings = np.concatenate([one.openings for one in frontiers])
    hidden = (view.known.bits & KNOWN == 0) & (environment.walls == 0)
    beside: NDArray[np.uint8] = np.asarray(cv2.dilate(hidden.astype(np.uint8), _AROUND), np.uint8)
    openings = openings[beside[openings[:, 1], openings[:, 0]] != 0]
    return bool(np.isfinite(view.planner.field(view.cell).distances(openings)).any())
