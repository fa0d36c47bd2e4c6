"""Random walk: mostly straight ahead, sometimes a little to a side (exploration reference 12.1).

What every other strategy has to beat. A robot that knows no frontier any more goes home.
"""

from __future__ import annotations

from dataclasses import dataclass

from usarsim_exploration.exploring import go_home
from usarsim_exploration.frontiers import find_frontiers, passages
from usarsim_exploration.strategy import Plan, Strategy, View, register
from usarsim_exploration.walking import CLEAR, stroll
from usarsim_exploration.walking import draw_turn as draw_turn
from usarsim_server.base.fields import field


@register("random-walk")
@dataclass
class RandomWalk(Strategy):
    """Steps as long as the speed, clear of walls."""

    clearance: float = field(
        default=CLEAR,
        low=1.0,
        high=100.0,
        unit="cells",
        help="from known walls; 1 after 50 failures",
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
        course = view.heading if self._course is None else self._course
        path, self._course = stroll(view, course, self.clearance)
        return Plan(path)
