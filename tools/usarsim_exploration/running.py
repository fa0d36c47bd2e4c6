"""Runs a scenario: events, a step of the cycle, a note in the history, until an end rule holds.

Nothing here reads a clock or a file, so the same scenario gives the same history, bit by bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

from usarsim_exploration.cycle import Cycle, set_up
from usarsim_exploration.ending import Reason
from usarsim_exploration.events import Event, Fate, late
from usarsim_exploration.history import History, Recorder
from usarsim_exploration.levels.discs import DiscLevel
from usarsim_exploration.levels.grid import GridLevel, Level
from usarsim_exploration.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Result:
    """A run that came to its end.

    Attributes:
        scenario: what was run. history: what happened. ended: why it ended.
        events: (step, what happened) of those that came.
        cycle: as it was at the end, with all maps.
        unawaited: events to come that would have opened more, which the end did not wait for.
        error: why it failed, if it did.
    """

    scenario: Scenario
    history: History
    ended: Reason
    events: tuple[tuple[int, str], ...]
    cycle: Cycle
    unawaited: tuple[Event, ...] = ()
    error: str = ""


class Run:
    """A run that can be looked at between any two steps.

    Whoever drives it may pause (not ask for the next step), make single steps, or begin again.

    Attributes:
        scenario: what is run. cycle: as it is now. recorder: what happened so far.
        ended: why it is over; None: it goes on. events: (step, what happened).
    """

    def __init__(
        self,
        scenario: Scenario,
        begin: Callable[[str], None] = lambda phase: None,
        connect: str = "",
    ) -> None:
        """The start: robots have scanned once and spoken once.

        Args:
            begin: told what begins, as the cycle tells, and `record`.
            connect: address of the server of the level `server`; empty: it starts its own.
        """
        self.scenario = scenario
        self._begin, self._connect = begin, connect
        self._level: Level | None = None
        self.reset()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> float:
        """End what runs beside; processor s that it has used. The cycle stays to be looked at."""
        return self._level.close() if self._level is not None else 0.0

    def reset(self) -> None:
        """Begin again; the same will happen."""
        one = self.scenario
        self.close()
        self._level = self._new_level()
        world = one.world.environment
        try:
            self.cycle: Cycle = set_up(
                replace(world, walls=world.walls.copy()),  # doors move walls
                one.team,
                one.strategy,
                one.radio,
                one.basics.seed,
                links_before=one.basics.links == "before",
                level=self._level,
                late=late(one.events),
                rules=one.rules,
                scale=one.scale if one.basics.backend != "grid" else 1.0,
            )
        except BaseException:
            self.close()
            raise
        self.cycle.begin = self._begin
        self.recorder = Recorder(self.cycle)
        self.events: list[tuple[int, str]] = []
        self._fate = Fate(one.events)
        self._error = ""
        self.ended: Reason | None = one.end.reason(self.cycle, self.recorder, self._fate)

    def _new_level(self) -> Level:
        if self.scenario.basics.backend == "grid":
            return GridLevel()
        if self.scenario.basics.backend == "discs":
            return DiscLevel(self.scenario.discs, self.scenario.scale)
        from usarsim_exploration.opening import open_level  # it needs MuJoCo and sockets

        return open_level(self.scenario, self._connect)

    def step(self) -> bool:
        """Make one step, unless the run is over; whether it goes on."""
        if self.ended is None:
            told = self._fate.strike(self.cycle)
            self.cycle.advance()
            self.events += [(self.cycle.step, one) for one in told]
            self._begin("record")
            self.recorder.note()
            self.ended = self.scenario.end.reason(self.cycle, self.recorder, self._fate)
        return self.ended is None

    def fail(self, error: str) -> None:
        """It cannot go on, for that reason; what was recorded holds."""
        self.ended, self._error = "failed", error

    def result(self) -> Result:
        """What came of it; the run has to be over."""
        assert self.ended is not None
        reality = self.cycle.level.reality(self.cycle)
        history = replace(self.recorder.history(), reality=reality)
        events = tuple(self.events)
        met = self.ended in ("base knows", "all home") and self.scenario.rules.shares
        unawaited = tuple(self._fate.opening(self.cycle)) if met else ()
        return Result(
            self.scenario, history, self.ended, events, self.cycle, unawaited, self._error
        )


def run(scenario: Scenario, begin: Callable[[str], None] = lambda phase: None) -> Result:
    """Run a scenario to its end. begin: see `Run`."""
    with Run(scenario, begin) as one:
        while one.step():
            pass
        return one.result()
