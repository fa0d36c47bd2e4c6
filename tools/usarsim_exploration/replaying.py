"""Runs a log again: robots go where they went, scan and speak; nobody decides anything.

With the scenario of the log the same history comes out, bit by bit, from the agent log alone. With
another radio one sees what that would have told the base. A radio that carries only so many bytes
is the exception: what strategies wrote in their letters is not in the log.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.history import NOWHERE, History, cells
from usarsim_exploration.planning import Field
from usarsim_exploration.running import Result, Run
from usarsim_exploration.scenario import Scenario
from usarsim_exploration.strategy import Plan, Role, Strategy, View
from usarsim_server.base.errors import at
from usarsim_server.base.toml import read_text

_ANY_SPEED = 1e6
_NUMBER = re.compile(r"-?[0-9]{1,9}(\.0*)?")
_CURE = "give the log of a run of this scenario"
_ROLES: dict[str, Role] = {"explorer": "explorer", "relay": "relay", "basestation": "base"}


@dataclass(frozen=True, slots=True)
class Entry:
    """What one robot did in one step.

    Attributes:
        path: cells that it drove to, and the one it tried in vain.
    """

    path: tuple[Cell, ...]
    goal: Cell | None
    role: Role
    state: str


@dataclass(frozen=True)
class Log:
    """What all robots did.

    Attributes:
        starts: cells at the start, the base first.
        entries: by step, from the first one on, and robot, without the base.
    """

    starts: tuple[Cell, ...]
    entries: tuple[tuple[Entry, ...], ...]


@dataclass
class _Again(Strategy):
    """Does what the log says."""

    log: Log

    def decide(self, view: View) -> Plan | None:
        """The cells of this step."""
        entry = self.log.entries[view.step - 1][view.number - 1]
        view.role = entry.role
        return Plan(list(entry.path), entry.state, entry.goal)

    def __deepcopy__(self, memo: object) -> _Again:
        return self


def log_of(history: History) -> Log:
    """The log of one of our runs."""
    places, goals = history.cell.tolist(), history.goal.tolist()
    steps = []
    for step in range(1, history.steps + 1):
        steps.append(
            tuple(
                Entry(
                    tuple(cells(_cell(places[step - 1][number]), str(history.moves[step, number]))),
                    None if tuple(goals[step][number]) == NOWHERE else _cell(goals[step][number]),
                    str(history.role[step, number]),  # type: ignore[arg-type]
                    str(history.state[step, number]),
                )
                for number in range(1, history.robots + 1)
            )
        )
    return Log(tuple(map(_cell, places[0])), tuple(steps))


def replay(
    scenario: Scenario, log: Log, begin: Callable[[str], None] = lambda phase: None
) -> Result:
    """Run a log in its scenario, to the last step of the log.

    Args:
        scenario, log: of one run. begin: see `Run`.

    Raises:
        ExplorationError: team and log do not fit.
    """
    one = again(scenario, log, begin)
    for _ in log.entries:
        one.step()
    one.ended = one.ended or "steps"
    return replace(one.result(), scenario=scenario)


def again(scenario: Scenario, log: Log, begin: Callable[[str], None] = lambda phase: None) -> Run:
    """A run whose robots do what a log says, as many steps as it has.

    Args:
        scenario, log: of one run. begin: see `Run`.

    Raises:
        ExplorationError: team and log do not fit.
    """
    if len(log.starts) != len(scenario.team):
        problem = f"the log has {len(log.starts) - 1} robots, the team {len(scenario.team) - 1}"
        raise ExplorationError(f"{scenario.world.environment.name}: {problem} ({_CURE})")
    team = tuple(
        replace(member, cell=cell, speed=_ANY_SPEED)
        for member, cell in zip(scenario.team, log.starts, strict=True)
    )
    end = replace(scenario.end, steps=max(len(log.entries), 1), base=None, home=False)
    basics = replace(scenario.basics, backend="grid")
    same = replace(scenario, team=team, strategy=_Again(log), end=end, basics=basics)
    return Run(same, begin)


def read_mresim_log(path: Path, environment: Environment) -> Log:
    """An agent log of MRESim: the step, then 6 or 7 values for each robot, the base first.

    It says where robots were after each step, not how they came there: they drive straight, or the
    shortest way there is, and scan at each cell (exploration reference 12.7 and 13.3).

    Raises:
        ExplorationError: naming the line, what is wrong, and the cure.
    """
    starts: tuple[Cell, ...] = ()
    found: list[tuple[Entry, ...]] = []
    here: list[Cell] = []
    for number, line in enumerate(read_text(path, ExplorationError).splitlines(), 1):
        values = line.split()
        if not values:
            continue
        robots = _robots(values, f"line {number}", path)
        places = [one[0] for one in robots]
        for place in places:
            if not environment.is_free(place):
                problem = f"{list(place)} is a wall or outside"
                raise ExplorationError(at(path, problem, _CURE, where=f"line {number}"))
        if not starts:
            starts, here = tuple(places), places
            continue
        if len(places) != len(starts):
            problem = f"{len(places)} robots after {len(starts)}"
            raise ExplorationError(at(path, problem, _CURE, where=f"line {number}"))
        found.append(
            tuple(
                Entry(tuple(_way(environment, before, place)), goal, role, state)
                for before, (place, goal, role, state) in list(zip(here, robots, strict=True))[1:]
            )
        )
        here = places
    if not starts:
        raise ExplorationError(at(path, "there is no step", _CURE))
    return Log(starts, tuple(found))


def _robots(values: list[str], where: str, path: Path) -> list[tuple[Cell, Cell, Role, str]]:
    """Cell, goal, role and state of all robots of a line."""
    count = len(values) - 1
    wide = next((n for n in (7, 6) if count and count % n == 0 and _fits(values[1:], n)), None)
    if wide is None or not values[0].isdigit():
        problem = f"{count} values after the step are not 6 or 7 for each robot"
        raise ExplorationError(at(path, problem, _CURE, where=where))
    rows = [values[first : first + wide] for first in range(1, len(values), wide)]
    return [
        ((_whole(x), _whole(y)), (_whole(gx), _whole(gy)), _ROLES[role.lower()], state)
        for x, y, gx, gy, role, state, *_ in rows
    ]


def _fits(values: list[str], wide: int) -> bool:
    """Whether the values repeat as four whole numbers, a role, a state."""
    rows = [values[first : first + wide] for first in range(0, len(values), wide)]
    return all(
        row[4].lower() in _ROLES and all(_NUMBER.fullmatch(one) for one in row[:4]) for row in rows
    )


def _whole(text: str) -> int:
    """A whole number, also one that Java wrote as it writes doubles (`50.0`)."""
    return int(text.partition(".")[0])


def _way(environment: Environment, start: Cell, goal: Cell) -> Sequence[Cell]:
    """Cells from one to another, without the first: straight, or round what is between."""
    steps = max(abs(goal[0] - start[0]), abs(goal[1] - start[1]))
    along = np.arange(1, steps + 1) / max(steps, 1)
    straight = np.floor(np.array(start) + along[:, None] * np.subtract(goal, start) + 0.5)
    line = [_cell(one) for one in straight.astype(int).tolist()]
    if all(_may(environment, a, b) for a, b in pairwise([start, *line])):
        return line
    way = Field((environment.walls == 0).astype(np.uint8), [start], environment.walls.size)
    return way.path(goal) or []


def _may(environment: Environment, start: Cell, goal: Cell) -> bool:
    free = environment.is_free
    return free(goal) and free((goal[0], start[1])) and free((start[0], goal[1]))


def _cell(place: Sequence[int]) -> Cell:
    return int(place[0]), int(place[1])
