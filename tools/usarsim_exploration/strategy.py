"""What an author of a strategy needs: `View`, `Plan`, `Strategy`, `register`.

A strategy is one file: a dataclass whose fields are its parameters, with `decide`. Every robot gets
a copy of its own. All it may know is in its `View`: what this robot has seen, heard and
agreed upon. There is no way from there to the true world, a clock, or another robot.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from usarsim_exploration.environment import Cell
from usarsim_exploration.known_map import KnownMap
from usarsim_exploration.planning import Path, Planner
from usarsim_exploration.radio import RadioEstimate
from usarsim_exploration.rules import TODAY, RunRules
from usarsim_server.base.plugins import PluginTypes
from usarsim_server.base.tables import Table

GROUP = "usarsim.strategies"
"""Entry point group for strategies of other packages."""

BASE = 0
"""Number of the base."""
Role = Literal["base", "explorer", "relay"]
Formation = Literal["explorers", "pairs", "chain"]
"""All report to the base; relay and explorer in turn; one behind the other, the last explores."""
Letter = Mapping[str, Any]
"""What a strategy adds to each message; plain values."""


@dataclass(frozen=True, slots=True)
class Teammate:
    """What a robot knows of another one, from its last messages; all who heard it hold the same.

    Attributes:
        number, name, role, speed: who it is. speed: cells per step.
        cell, state, goal: where it was, what it did, where it wanted to go.
        heard: step of the newest that is known of it; -1: nothing yet.
        letter: of its strategy. size: of that in a message, bytes.
    """

    number: int
    name: str
    role: Role
    speed: float
    cell: Cell
    state: str = "start"
    goal: Cell | None = None
    heard: int = -1
    letter: Letter = field(default_factory=dict)
    size: int = 0


@dataclass(slots=True)
class View:
    """What one robot knows; a strategy reads it, and changes nothing but `known.mark`.

    Attributes:
        number, name, role: who this is; role may change while a run goes on.
        parent, child: numbers of whom it reports to and collects from; None: nobody.
        speed: cells per step. reach: of its scanner, cells.
        base: where the base is. step: now.
        cell, heading: where it is, rad.
        path: what is left of its plan. blocked: the last move met a wall that was not known.
        known: its map. planner: ways through that. radio: what links it expects.
        teammates: by number, without itself; the base is 0.
        linked: numbers that it hears now, over any chain.
        random: its own generator.
        rules: of the run. area: free cells of the world, which MRESim tells its robots; else 0.
        width: of its scanner's field of view, rad. scale: cells that are as long as 0.1 m where
            robots have bodies, so that lengths are metres; else 1.
    """

    number: int
    name: str
    role: Role
    parent: int | None
    child: int | None
    speed: float
    reach: int
    base: Cell
    cell: Cell
    heading: float
    known: KnownMap
    planner: Planner
    radio: RadioEstimate
    random: np.random.Generator
    teammates: dict[int, Teammate] = field(default_factory=dict)
    linked: frozenset[int] = frozenset()
    path: Path = field(default_factory=list)
    blocked: bool = False
    step: int = 0
    rules: RunRules = TODAY
    area: int = 0
    width: float = math.pi
    scale: float = 1.0

    @property
    def across(self) -> float:
        """How much of a frontier it sees in a step, cells; infinite by rules without it."""
        if not self.rules.short:
            return math.inf
        return max(2.0 * self.reach, self.speed)

    def explorers(self, memory: int) -> list[Teammate]:
        """Teammates that explore and were heard within so many steps."""
        return [
            one
            for one in self.teammates.values()
            if one.role == "explorer" and one.heard >= 0 and self.step - one.heard < memory
        ]


@dataclass(frozen=True, slots=True)
class Plan:
    """What a robot does from now on.

    Attributes:
        path: neighbouring cells to drive through; empty: it stays.
        state: a word for logs and pictures, `explore`, `return`, `wait` and the like.
        goal: where this leads in the end; default the last cell of the path.
        home: the strategy has nothing more to find.
    """

    path: Path
    state: str = "explore"
    goal: Cell | None = None
    home: bool = False


class Strategy(ABC):
    """Decides for one robot; see docs/howto/strategy.md."""

    formation: ClassVar[Formation] = "explorers"
    """What a team is like whose scenario does not say it."""

    @abstractmethod
    def decide(self, view: View) -> Plan | None:
        """Asked once a step before the robot moves; None: go on along the path that is left."""

    def letter(self, view: View) -> Letter:
        """What the robot's messages of this step say beside map, place and plan."""
        return {}

    def hear(self, view: View) -> None:  # noqa: B027 (most strategies need none)
        """Called after each exchange, when `view.teammates` and `view.known` are the new ones."""


TYPES: PluginTypes[Strategy] = PluginTypes(
    "strategy", Strategy, ("usarsim_exploration.strategies",), GROUP
)

register = TYPES.register
"""Class decorator: make a strategy available under these names."""


def create_strategy(name: str, table: Table, place: str) -> Strategy:
    """A strategy with the parameters of a table; the caller finishes that.

    Raises:
        UsarsimError: there is no such strategy, or a parameter cannot be used.
    """
    found: Strategy = table.read(TYPES.find(name, place))
    return found


def straight(one: Cell, other: Cell) -> float:
    """Distance of two cells, cells."""
    return math.hypot(one[0] - other[0], one[1] - other[1])
