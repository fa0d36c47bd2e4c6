"""Frontier-based with periodic return: the base hears news after 10 steps, 20, 30 and so on.

MRESim offers this and does nothing; the rule is that of the exploration reference, 12.2.
"""

from __future__ import annotations

from dataclasses import dataclass

from usarsim_exploration.exploring import way_to
from usarsim_exploration.strategies.frontier import FrontierStrategy
from usarsim_exploration.strategy import BASE, Plan, View, register
from usarsim_server.base.fields import field


@dataclass
class Returning(FrontierStrategy):
    """Explores frontiers, and drives to the base when `turns_back` says so.

    Attributes:
        returning: it is on its way.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        self.returning = self._called = False

    def turns_back(self, view: View) -> bool:
        """Whether to return now; asked before each step of exploring."""
        raise NotImplementedError

    def arrived(self, view: View) -> None:
        """The base was heard after a return."""

    def decide(self, view: View) -> Plan | None:
        """Return until the base is heard, else explore."""
        if self.returning and (BASE in view.linked or view.cell == view.base):
            self.arrived(view)
            self.resume()
        if not self.returning and (self._called or self.turns_back(view)):
            self.returning, self._called = True, False
        elif not self.returning:
            return super().decide(view)
        elif view.path and not view.blocked:
            return None
        return Plan(way_to(view, view.base), "return", view.base)

    def turn_back(self) -> None:
        """Return from the next step on."""
        self._called = True

    def resume(self) -> None:
        """Explore, with a new plan."""
        self.returning = self._called = False
        self._planned, self._version = -(10**9), -1


@register("periodic")
@dataclass
class Periodic(Returning):
    """Explores for a time that grows with each return."""

    first: int = field(default=10, low=1, high=10**6, unit="steps", help="before the first return")
    growth: int = field(
        default=10, low=0, high=10**6, unit="steps", help="by which each next time is longer"
    )

    outward: bool = field(
        default=True, help="the time runs on the way out, too; else only with something to tell"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self._time, self._since = self.first, 0

    def turns_back(self, view: View) -> bool:
        """When the time is up; if the base hears already, the next time begins."""
        if not self.outward and BASE not in view.linked and not view.known.undelivered:
            self._since += 1
        if view.step - self._since <= self._time:
            return False
        if BASE in view.linked:
            self.arrived(view)
            return False
        return True

    def arrived(self, view: View) -> None:
        """The next time begins."""
        self._time += self.growth
        self._since = view.step - 1
