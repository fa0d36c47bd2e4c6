"""Runs a scenario: events, a step of the cycle, a note in the history, until an end rule holds.

Nothing here reads a clock or a file, so the same scenario gives the same history, bit by bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from usarsim_exploration.cycle import Cycle, set_up
from usarsim_exploration.ending import Reason
from usarsim_exploration.events import Fate
from usarsim_exploration.history import History, Recorder
from usarsim_exploration.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Result:
    """A run that came to its end.

    Attributes:
        scenario: what was run. history: what happened. ended: why it ended.
        events: (step, what happened) of those that came.
        cycle: as it was at the end, with all maps.
    """

    scenario: Scenario
    history: History
    ended: Reason
    events: tuple[tuple[int, str], ...]
    cycle: Cycle


class Run:
    """A run that can be looked at between any two steps.

    Whoever drives it may pause (not ask for the next step), make single steps, or begin again.

    Attributes:
        scenario: what is run. cycle: as it is now. recorder: what happened so far.
        ended: why it is over; None: it goes on. events: (step, what happened).
    """

    def __init__(
        self, scenario: Scenario, begin: Callable[[str], None] = lambda phase: None
    ) -> None:
        """The start: robots have scanned once and spoken once.

        Args:
            begin: told what begins, as the cycle tells, and `record`.
        """
        self.scenario = scenario
        self._begin = begin
        self.reset()

    def reset(self) -> None:
        """Begin again; the same will happen."""
        one = self.scenario
        world = one.world.environment
        self.cycle: Cycle = set_up(
            replace(world, walls=world.walls.copy()),  # doors move walls
            one.team,
            one.strategy,
            one.radio,
            one.basics.seed,
            links_before=one.basics.links == "before",
        )
        self.cycle.begin = self._begin
        self.recorder = Recorder(self.cycle)
        self.events: list[tuple[int, str]] = []
        self._fate = Fate(one.events)
        self.ended: Reason | None = one.end.reason(self.cycle, self.recorder)

    def step(self) -> bool:
        """Make one step, unless the run is over; whether it goes on."""
        if self.ended is None:
            told = self._fate.strike(self.cycle)
            self.cycle.advance()
            self.events += [(self.cycle.step, one) for one in told]
            self._begin("record")
            self.recorder.note()
            self.ended = self.scenario.end.reason(self.cycle, self.recorder)
        return self.ended is None

    def result(self) -> Result:
        """What came of it; the run has to be over."""
        assert self.ended is not None
        history = self.recorder.history()
        return Result(self.scenario, history, self.ended, tuple(self.events), self.cycle)


def run(scenario: Scenario) -> Result:
    """Run a scenario to its end."""
    one = Run(scenario)
    while one.step():
        pass
    return one.result()
