"""Random walk: mostly straight ahead, sometimes a little to a side (exploration reference 12.1).

What every other strategy has to beat. A robot that knows no frontier any more goes home.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from usarsim_exploration.exploring import go_home
from usarsim_exploration.frontiers import find_frontiers, passages
from usarsim_exploration.strategy import Plan, Strategy, View, register
from usarsim_exploration.walking import Surroundings, line
from usarsim_server.fields import field

TURNS = np.deg2rad(np.repeat([-45.0, -22.5, 0.0, 22.5, 45.0], [1, 2, 20, 2, 1]))
"""Tickets of the draw, rad."""
_TRIES = 100
_SHORTEST = 3
"""Cells of a step that is tried at least."""


def draw_turn(random: np.random.Generator) -> float:
    """By how much to turn, rad."""
    return float(TURNS[random.integers(len(TURNS))])


@register("random-walk")
@dataclass
class RandomWalk(Strategy):
    """Steps as long as the speed, clear of walls."""

    clearance: float = field(
        default=3.0, low=1.0, high=100.0, unit="cells", help="from known walls; 1 after 50 failures"
    )
    look: int = field(
        default=25, low=1, high=10_000, unit="steps", help="between two looks for frontiers"
    )

    def __post_init__(self) -> None:
        self._course: float | None = None
        self._done = False

    def decide(self, view: View) -> Plan | None:
        """A new step when the last one is made."""
        if view.step % self.look == 0:
            narrow = view.rules.narrow and passages(view.known)
            self._done = not (narrow or find_frontiers(view.known))
            if self._done:
                return go_home(view)
        if self._done or (view.path and not view.blocked):
            return None
        return self._step(view)

    def _step(self, view: View) -> Plan:
        """The first of up to 100 draws that meets no known wall.

        Turns of failed draws add up, so that a robot before a wall turns away from it.
        """
        course = view.heading if self._course is None else self._course
        length = max(_SHORTEST, int(view.speed))
        around = Surroundings(view.known, view.cell, length + int(self.clearance) + 2)
        for attempt in range(_TRIES):
            course += draw_turn(view.random)
            right, down = length * math.cos(course), length * math.sin(course)
            path = line(view.cell, (view.cell[0] + round(right), view.cell[1] + round(down)))
            need = self.clearance if attempt < _TRIES // 2 else 1.0
            if path and around.room(path[-1]) >= need and around.passable(view.cell, path):
                self._course = course
                return Plan(path)
            shortest = 1 if view.rules.narrow and attempt >= _TRIES // 2 else _SHORTEST
            length = max(length - 1, shortest)
        self._course = course
        return Plan([])
