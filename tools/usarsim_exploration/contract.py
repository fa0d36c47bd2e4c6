"""Whether a strategy keeps to its view: no truth, no clock, no chance but its own, no secret talk.

A team runs in a small world while every call of the strategy is watched. Then the world is changed
where nobody has looked, and all decisions have to be the same; and where one robot has not looked
while no radio works, and that robot's decisions have to be the same (reference E-83). Variables of
modules and classes, which all robots share, have to stay as they were.
"""

from __future__ import annotations

import copy
import gc
import random
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from types import FrameType
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.cycle import Cycle, Member, set_up
from usarsim_exploration.environment import Environment
from usarsim_exploration.known_map import KNOWN
from usarsim_exploration.radio import Circle
from usarsim_exploration.shared_state import LIBRARIES, Shared, changes
from usarsim_exploration.strategy import Letter, Plan, Strategy, View

STEPS = 24
SEED = 20
T = TypeVar("T")
Decision = tuple[int, int, object]
"""Step, robot and plan."""

_CLOCKS = frozenset({"time", "datetime"})
_SPIES = frozenset({"gc", "sys"})
_HARMLESS = frozenset({"getsizeof", "intern", "getrecursionlimit"})
_MARGIN = np.ones((7, 7), np.uint8)
"""Around what is known, where rays may have passed."""
_GIVEN = tuple(one.name for one in fields(View) if one.name not in ("known", "planner", "radio"))
"""What a strategy finds in its view and may not change."""


@dataclass
class _Watch:
    """What was seen of a strategy.

    Attributes:
        watching: whether calls are looked at, which takes time. shared: what all robots can reach;
            None: it is not looked at.
        decisions: all plans, in order. breaches: what it did that it may not do.
    """

    watching: bool
    shared: Shared | None = None
    decisions: list[Decision] = field(default_factory=list)
    breaches: dict[str, None] = field(default_factory=dict)

    def call(self, view: View, what: Callable[[View], T]) -> T:
        """Call a method of a strategy."""
        if self.shared is not None:
            told = self.shared.values()
            found = what(view)
            for name in changes(told, self.shared.values()):
                self.breaches[f"keeps what other robots can read ({name})"] = None
            return found
        if not self.watching:
            return what(view)
        before = _snapshot(view)
        chance = _chance()
        collecting = gc.isenabled()
        gc.disable()  # what others hung on collections is no call of the strategy
        profiler = sys.getprofile()
        sys.setprofile(self._profile)
        try:
            return what(view)
        finally:
            sys.setprofile(profiler)
            if collecting:
                gc.enable()
            if _chance() != chance:
                self.breaches["draws from a global generator of random numbers"] = None
            for name, value in _snapshot(view).items():
                if value != before[name]:
                    self.breaches[f"changes view.{name}"] = None

    def _profile(self, frame: FrameType, event: str, called: Any) -> None:
        caller = str(frame.f_globals.get("__name__", ""))
        if event != "c_call" or caller == __name__ or caller.partition(".")[0] in LIBRARIES:
            return
        owner = getattr(called, "__self__", None)
        module = getattr(called, "__module__", None) or getattr(owner, "__module__", None)
        module = getattr(owner, "__name__", "") if module is None else module
        name = getattr(called, "__name__", "")
        if module in _CLOCKS and name in _NOW:
            self.breaches[f"reads a clock ({module}.{name})"] = None
        elif module in _SPIES and name not in _HARMLESS:
            self.breaches[f"looks into the interpreter ({module}.{name})"] = None
        elif isinstance(owner, random.Random):
            self.breaches["draws from a global generator of random numbers"] = None


_NOW = frozenset(
    {
        "time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns",
        "process_time", "process_time_ns", "thread_time", "clock_gettime", "localtime", "gmtime",
        "now", "utcnow", "today",
    }
)  # fmt: skip


class _Watched(Strategy):
    """A strategy whose calls are noted; robots have copies of it, but one watch."""

    def __init__(self, inner: Strategy, watch: _Watch) -> None:
        self._inner, self._watch = inner, watch

    def __deepcopy__(self, memo: dict[int, Any]) -> _Watched:
        twin = copy.deepcopy(self._inner, memo)
        if twin is self._inner:
            self._watch.breaches["is one object for all robots (__deepcopy__)"] = None
        return _Watched(twin, self._watch)

    def decide(self, view: View) -> Plan | None:
        plan = self._watch.call(view, self._inner.decide)
        told = plan and (tuple(plan.path), plan.state, plan.goal, plan.home)
        self._watch.decisions.append((view.step, view.number, told))
        return plan

    def letter(self, view: View) -> Letter:
        return self._watch.call(view, self._inner.letter)

    def hear(self, view: View) -> None:
        self._watch.call(view, self._inner.hear)


def check(strategy: Strategy, steps: int = STEPS) -> list[str]:
    """What a strategy does that it may not do; nothing, if it keeps to the contract.

    Args:
        strategy: as it would be given to a run. steps: of each of the five runs.
    """
    world = _world()
    # the first run imports what it needs, too; a second one would find what was kept already there
    first, _ = _run(strategy, world, steps, linked=True, shared=Shared(type(strategy)))
    plain = first.decisions
    watch, cycle = _run(strategy, world, steps, linked=True, watching=True)
    breaches = list(first.breaches | watch.breaches)
    if watch.decisions != plain:
        breaches.append("does not do the same again with the same seed")
    seen = [body.view.known.bits & KNOWN != 0 for body in cycle.bodies]
    other = _elsewhere(world, np.logical_or.reduce(seen))
    if _run(strategy, other, steps, linked=True)[0].decisions != plain:
        breaches.append("knows what nobody has seen: it depends on the true world")
    alone, cycle = _run(strategy, world, steps, linked=False)
    other = _elsewhere(world, cycle.bodies[1].view.known.bits & KNOWN != 0)
    again, _ = _run(strategy, other, steps, linked=False)
    if _of(again.decisions, 1) != _of(alone.decisions, 1):
        breaches.append("knows what only others have seen, though no radio works")
    return breaches


def _run(
    strategy: Strategy, world: Environment, steps: int, *, linked: bool, watching: bool = False,
    shared: Shared | None = None,
) -> tuple[_Watch, Cycle]:  # fmt: skip
    reach = 1000.0 if linked else 0.0
    cells = ((8, 8), (10, 8), (52, 30))
    team = [
        Member(f"R{number}", "explorer" if number else "base", cell, speed=3.0,
               reach=12 if number else 0, radio_range=reach)
        for number, cell in enumerate(cells)
    ]  # fmt: skip
    watch = _Watch(watching, shared)
    cycle = set_up(world, team, _Watched(strategy, watch), Circle(), SEED)
    for _ in range(steps):
        cycle.advance()
    return watch, cycle


def _of(decisions: list[Decision], number: int) -> list[Decision]:
    return [one for one in decisions if one[1] == number]


def _world() -> Environment:
    """Two halls, and a door between."""
    walls = np.zeros((40, 62), np.uint8)
    walls[[0, -1]] = walls[:, [0, -1]] = walls[:, 31] = 1
    walls[18:23, 31] = 0
    walls[12:16, 14:20] = walls[24:28, 40:48] = 1
    return Environment("contract", walls)


def _elsewhere(world: Environment, seen: NDArray[np.bool_]) -> Environment:
    """Another world, the same where it was seen and close to that."""
    same = cv2.dilate(seen.astype(np.uint8), _MARGIN) != 0
    same[28:33, 50:55] = True  # where the second robot starts
    noise = np.random.default_rng(SEED).random(world.walls.shape) < 0.3
    return Environment(world.name, np.where(same, world.walls, noise).astype(np.uint8))


def _chance() -> object:
    """State of the global generators."""
    numbers = np.random.get_state(legacy=False)["state"]
    return random.getstate(), numbers["key"].tobytes(), numbers["pos"]


def _snapshot(view: View) -> dict[str, object]:
    found: dict[str, object] = {name: getattr(view, name) for name in _GIVEN if name != "random"}
    found["path"] = tuple(view.path)
    mates = sorted(view.teammates.items())
    found["teammates"] = [(number, mate.cell, mate.heard, mate.state) for number, mate in mates]
    found["known"] = (view.known.bits & KNOWN).tobytes()
    return found
