"""The two logs of a run as CSV: `steps.csv` by step, `agents.csv` by step and body.

`steps.csv` has the 19 + 10 x robots columns of MRESim's data log, with names (exploration reference
13.2). Two of them said nothing there and hold traffic here: its wall clock, which would make equal
runs unequal, and its time since the last command, which is the number of the step. `agents.csv` is
the agent log: where everybody was and what they did; a run is shown again from it alone.
Both together hold a whole `History`.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.history import Counts, History
from usarsim_exploration.rules import RULES, RunRules
from usarsim_server.base.csv_files import Sheet, csv_text, read_csv
from usarsim_server.base.errors import at

STEPS, AGENTS = "steps.csv", "agents.csv"
TEAM_COLUMNS = (
    "step", "bytes_sent", "team_percent", "base_percent", "free_cells", "mean_area_share_percent",
    "cells_sent", "mean_distance", "role_swaps", "team_area", "base_area", "base_share_percent",
    "max_latency", "mean_latency", "sensing", "double_sensing", "returning", "not_sensing",
    "robot_steps",
)  # fmt: skip
SHARE_COLUMNS = "reachable_cells", "team_reachable", "base_reachable"
"""After those of the robots, where doors count: what is reachable, and what of that is known."""
ROBOT_COLUMNS = (
    "area", "own", "believed", "believed_at_base", "max_latency", "mean_latency", "sensing",
    "double_sensing", "returning", "not_sensing",
)  # fmt: skip
AGENT_COLUMNS = (
    "step", "number", "name", "x", "y", "heading", "goal_x", "goal_y", "role", "state", "moves",
    "works", "linked_base", "latency", "distance", "found", "first", "area", "own", "believed",
    "at_base", "idle", "links",
)  # fmt: skip
Floats = NDArray[np.float64]
_CURE = "write the run again with `usarsim explore run`"


def steps_csv(history: History) -> str:
    """The data log; percentages of all free cells, latencies over what was heard so far."""
    longest, total = history.message_latencies()
    robots = slice(1, None)
    rows = np.arange(history.steps + 1)
    heard = rows[:, None] - history.latency + 1
    mean = total / heard
    sums: list[NDArray[Any]] = [
        np.cumsum(one[:, robots], axis=0)
        for one in (history.sensing, history.double_sensing, history.returning, history.not_sensing)
    ]
    team = np.maximum(history.free_team, 1)
    columns: list[Iterable[object]] = [
        rows,
        history.bytes_sent,
        100 * history.free_team / history.free,
        100 * history.free_base / history.free,
        history.free,
        100 * history.area[:, robots].mean(axis=1) / team,
        history.cells_sent,
        history.distance[:, robots].mean(axis=1),
        history.role_swaps,
        history.free_team,
        history.free_base,
        100 * history.free_base / team,
        longest[:, robots].max(axis=1),
        mean[:, robots].mean(axis=1),
        *(one.sum(axis=1) for one in sums),
        np.cumsum(history.works[:, robots].sum(axis=1)),
    ]
    for robot in range(history.robots):
        by_body = history.area, history.own, history.believed, history.at_base, longest, mean
        columns += [one[:, robot + 1] for one in by_body]
        columns += [one[:, robot] for one in sums]
    heads = [*TEAM_COLUMNS]
    heads += [f"{name}_{column}" for name in history.names[1:] for column in ROBOT_COLUMNS]
    if RULES[history.by_rules].shares:
        heads += SHARE_COLUMNS
        columns += [history.reachable, history.known_team, history.known_base]
    return csv_text(heads, zip(*map(_plain, columns), strict=True))


def agents_csv(history: History) -> str:
    """The agent log: one row for each body and step; links are numbers with blanks between."""
    rows = []
    by_body = [
        _plain(one.reshape(-1))
        for one in (
            history.cell[..., 0], history.cell[..., 1], history.heading, history.goal[..., 0],
            history.goal[..., 1], history.role, history.state, history.moves,
            history.works.astype(int), history.linked_base.astype(int), history.latency,
            history.distance, history.found, history.first, history.area, history.own,
            history.believed, history.at_base, history.idle,
        )
    ]  # fmt: skip
    values = zip(*by_body, strict=True)
    for step, pairs in enumerate(history.links):
        for number, name in enumerate(history.names):
            heard = sorted(
                [b for a, b in pairs.tolist() if a == number]
                + [a for a, b in pairs.tolist() if b == number]
            )
            rows.append((step, number, name, *next(values), " ".join(map(str, heard))))
    return csv_text(AGENT_COLUMNS, rows)


def read_history(folder: Path, rules: RunRules, reachable: int) -> History:
    """The history out of both logs.

    Args:
        folder: of the run. rules: of it.
        reachable: free cells that the base can be reached from, where the logs do not say it.

    Raises:
        ExplorationError: a file cannot be read, or says what none of ours says.
    """
    steps, agents = _read(folder / STEPS), _read(folder / AGENTS)
    path = folder / AGENTS
    if not steps.rows or not agents.rows:
        raise ExplorationError(at(path, "there is no step", _CURE))
    names = list(dict.fromkeys(agents.column("name", str)))
    count = len(names)
    if len(agents.rows) != count * len(steps.rows):
        problem = f"{len(agents.rows)} rows are not {count} for each of {len(steps.rows)} steps"
        raise ExplorationError(at(path, problem, _CURE))

    def bodies(column: str, kind: Callable[[str], Any] = int) -> Any:
        return np.array(agents.column(column, kind)).reshape(-1, count)

    def team(column: str) -> Counts:
        return np.array(steps.column(column, int), np.int64)

    heard = [
        _pairs(agents.rows[first : first + count]) for first in range(0, len(agents.rows), count)
    ]
    areas = team("team_area"), team("base_area")
    shares = [team(name) for name in SHARE_COLUMNS] if rules.shares else None
    if shares is None:
        shares = [np.full(len(steps.rows), reachable), *areas]
    return History(
        tuple(names),
        rules.number,
        team("free_cells"),
        shares[0],
        areas[0],
        areas[1],
        shares[1],
        shares[2],
        team("cells_sent"),
        team("bytes_sent"),
        np.stack([bodies("x"), bodies("y")], axis=-1),
        bodies("heading", float),
        bodies("distance", float),
        bodies("found"),
        bodies("first"),
        bodies("area"),
        bodies("believed"),
        bodies("at_base"),
        bodies("own"),
        bodies("role", str),
        bodies("state", str),
        np.stack([bodies("goal_x"), bodies("goal_y")], axis=-1),
        bodies("moves", str),
        bodies("works") != 0,
        bodies("linked_base") != 0,
        bodies("latency"),
        bodies("idle"),
        tuple(heard),
    )


def read_shares(folder: Path, reachable: int) -> tuple[Floats, Floats, Floats]:
    """Parts of the reachable cells that team and base know, and the mean distance of robots.

    By step, out of the data log; distances in cells.

    Args:
        folder: of the run. reachable: how many cells are, where the log does not say it.

    Raises:
        ExplorationError: it cannot be read, or says what none of ours says.
    """
    steps = _read(folder / STEPS)
    if not steps.rows:
        raise ExplorationError(at(steps.path, "there is no step", _CURE))

    def column(name: str, kind: Callable[[str], float] = int) -> Floats:
        return np.array(steps.column(name, kind), np.float64)

    if SHARE_COLUMNS[0] in steps.rows[0]:
        whole, team, base = map(column, SHARE_COLUMNS)
    else:
        team, base = column("team_area"), column("base_area")
        whole = np.full_like(team, reachable)
    return team / whole, base / whole, column("mean_distance", float)


def first_difference(one: History, other: History) -> str | None:
    """Where the agent logs of two runs differ for the first time; None: they are equal."""
    lines = agents_csv(one).splitlines(), agents_csv(other).splitlines()
    heads = lines[0][0].split(",")
    for number, (first, second) in enumerate(zip(*lines, strict=False), 1):
        if first != second:
            pairs = zip(heads, *(next(csv.reader([line])) for line in (first, second)), strict=True)
            told = next(f"{head} is {a}, not {b}" for head, a, b in pairs if a != b)
            return f"{AGENTS}, line {number}: {told}"
    if len(lines[0]) != len(lines[1]):
        return f"{AGENTS}: {len(lines[0]) - 1} rows, not {len(lines[1]) - 1}"
    return None


class _Rows:
    """A CSV file with a header."""

    def __init__(self, table: Sheet) -> None:
        self.path, self.rows = table.path, [row for _, row in table.rows]
        self._table = table

    def column(self, name: str, kind: Callable[[str], Any]) -> list[Any]:
        """All values of a column."""
        found = []
        read = self._table.number if kind is float else kind
        for line, row in self._table.rows:
            try:
                found.append(read(row[name]))
            except (KeyError, ValueError):
                problem = f"{row.get(name)!r} is not what column {name} holds"
                raise ExplorationError(
                    at(self.path, problem, _CURE, where=f"line {line}")
                ) from None
        return found


def _read(path: Path) -> _Rows:
    return _Rows(read_csv(path, ExplorationError, _CURE))


def _pairs(rows: list[dict[str, str]]) -> Counts:
    """Links of one step."""
    found = [
        (number, int(other))
        for number, row in enumerate(rows)
        for other in (row["links"] or "").split()
        if int(other) > number
    ]
    return np.array(found, np.int64).reshape(-1, 2)


def _plain(column: Iterable[object]) -> list[object]:
    """Values of Python, whose text gives the same numbers back."""
    found: list[object] = np.asarray(column).tolist()
    return found
