"""What happened in a run, as arrays by step and robot: all that measures and pictures read.

A `Recorder` notes the state of a `Cycle` after each step. It counts known cells against the truth
itself, and does not trust the counters of the cycle. Row 0 of every array is the start, after the
first scans and the first exchange; column 0 of those by robot is the base.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.cycle import BASE, Body, Cycle
from usarsim_exploration.environment import Cell
from usarsim_exploration.idleness import Idleness
from usarsim_exploration.known_map import FREE

Counts = NDArray[np.int64]
Words = NDArray[np.str_]
NOWHERE = (-1, -1)
"""Goal of a robot that has none."""
RETURNING = ("return", "wait", "give")
"""Beginnings of the states in which a robot carries what it found, or waits to hand it over."""

_MOVES = (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)
_DIGITS = {move: str(digit) for digit, move in enumerate(_MOVES)}


@dataclass(frozen=True, eq=False)
class History:
    """One run, as it is so far. Shapes: steps + 1 rows, bodies columns; lengths in cells.

    Attributes:
        names: of the bodies, the base first.
        free: cells of the world that are free, by step, for doors move. reachable: of these, how
            many the base can be reached from.
        free_team, free_base: cells, truly free, that anybody has ever known, or the base knows.
        known_team, known_base: of these, those that count for shares of the reachable ones.
        by_rules: number of the rules of the run.
        cells_sent, bytes_sent: entries of maps, and bytes of all messages, so far.
        cell: (rows, bodies, 2) where each was. heading: rad. distance: driven so far.
        found, first: cells that the scans of the step found, and of these what nobody knew.
        area: cells, truly free, that each knows. believed: cells that it takes for free.
        at_base: of these, how many it thinks that the base knows or somebody else carries there.
        own: of these, how many it has to bring there itself.
        role, state: words. goal: (rows, bodies, 2), or `NOWHERE`.
        moves: of the step, a digit for each cell: 0 to the right, 2 down, 4 left, 6 up, odd ones
            between; an `x` before the one that met a wall.
        works: it has not failed. linked_base: over any chain.
        latency: steps since the newest that is known of the base.
        idle: steps for which it has stood though it could have found something (`Idleness`).
        links: for each row the (n, 2) pairs that hear each other directly, the smaller one first.
        reality: measures that only robots of a server have, by name; empty on the grid, and in
            histories that were read from logs.
    """

    names: tuple[str, ...]
    by_rules: int
    free: Counts
    reachable: Counts
    free_team: Counts
    free_base: Counts
    known_team: Counts
    known_base: Counts
    cells_sent: Counts
    bytes_sent: Counts
    cell: Counts
    heading: NDArray[np.float64]
    distance: NDArray[np.float64]
    found: Counts
    first: Counts
    area: Counts
    believed: Counts
    at_base: Counts
    own: Counts
    role: Words
    state: Words
    goal: Counts
    moves: Words
    works: NDArray[np.bool_]
    linked_base: NDArray[np.bool_]
    latency: Counts
    idle: Counts
    links: tuple[Counts, ...]
    reality: Mapping[str, float | None] = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """How many were made."""
        return len(self.free_team) - 1

    @property
    def robots(self) -> int:
        """How many there are, without the base."""
        return len(self.names) - 1

    @property
    def sensing(self) -> NDArray[np.bool_]:
        """Where a robot found what nobody knew (exploration reference 13.1)."""
        found: NDArray[np.bool_] = self.first > 0
        return found

    @property
    def double_sensing(self) -> NDArray[np.bool_]:
        """Where a robot found what was new to it, but not all of it new to the team."""
        found: NDArray[np.bool_] = self.found > self.first
        return found

    @property
    def not_sensing(self) -> NDArray[np.bool_]:
        """Where a robot that works found nothing new."""
        found: NDArray[np.bool_] = (self.found == 0) & self.works
        return found

    @property
    def returning(self) -> NDArray[np.bool_]:
        """Where a robot carried what it found, or waited to hand it over."""
        begins = [np.char.startswith(self.state, word) for word in RETURNING]
        found: NDArray[np.bool_] = np.logical_or.reduce(begins) & self.works
        return found

    @property
    def role_swaps(self) -> Counts:
        """Swaps of roles so far, by row; in each of them two robots change theirs."""
        changed = np.count_nonzero(self.role[1:] != self.role[:-1], axis=1)
        return np.concatenate([[0], np.cumsum(changed) // 2])

    def message_latencies(self) -> tuple[Counts, Counts]:
        """Sums over the past steps k of when a body first heard of the base's step k, minus k.

        Returns:
            Largest value and sum so far, both (rows, bodies). What was not heard yet counts
            nothing; a body has heard of steps up to row - `latency` (exploration 13.1).
        """
        rows = np.arange(self.steps + 1)[:, None]
        newest = rows - self.latency
        before = np.concatenate([np.full((1, newest.shape[1]), -1), newest[:-1]])
        news = newest - before
        # what was heard in a row waited latency, latency + 1, ..., latency + news - 1 steps
        longest = np.where(news > 0, self.latency + news - 1, 0)
        total = news * self.latency + news * (news - 1) // 2
        return np.maximum.accumulate(longest, axis=0), np.cumsum(total, axis=0)


def digits(start: Cell, moves: Sequence[Cell], end: Cell) -> str:
    """Moves of a step as `History.moves`; the last one was in vain if it does not lead to `end`."""
    text, here = "", start
    for cell in moves:
        digit = _DIGITS.get((cell[0] - here[0], cell[1] - here[1]), "")
        text += digit if cell != moves[-1] or cell == end else f"x{digit}"
        here = cell
    return text


def cells(start: Cell, text: str) -> list[Cell]:
    """The opposite of `digits`."""
    found, here = [], start
    for digit in text.replace("x", ""):
        right, down = _MOVES[int(digit)]
        here = here[0] + right, here[1] + down
        found.append(here)
    return found


class Recorder:
    """Notes a run, step by step."""

    def __init__(self, cycle: Cycle) -> None:
        """The start is noted at once; call `note` after each `advance`."""
        self._cycle = cycle
        self._team = np.zeros(cycle.environment.shape, np.bool_)
        self._area = [0] * len(cycle.bodies)
        self._known = [0] * len(cycle.bodies)
        self._changes = cycle.changes
        self._survey()
        self._cells = [body.view.cell for body in cycle.bodies]
        self._idleness = Idleness(len(cycle.bodies))
        self._rows: list[tuple[int, ...]] = []
        self._bodies: list[list[tuple[object, ...]]] = []
        self._links: list[Counts] = []
        self.note()

    @property
    def free(self) -> int:
        """Free cells of the world."""
        if not self._cycle.rules.shares:  # counted when it was first asked for
            return self._cycle.environment.free
        return self._rows[-1][0]

    @property
    def reachable(self) -> int:
        """Of these, those that the base can be reached from."""
        return self._rows[-1][1]

    @property
    def free_team(self) -> int:
        """Truly free cells that anybody has known so far."""
        return self._rows[-1][2]

    @property
    def free_base(self) -> int:
        """Truly free cells that the base knows."""
        return self._rows[-1][3]

    @property
    def known_team(self) -> int:
        """Of those of the team, what counts for its share of the reachable cells."""
        return self._rows[-1][4]

    @property
    def known_base(self) -> int:
        """The same of the base."""
        return self._rows[-1][5]

    @property
    def known(self) -> tuple[int, ...]:
        """The same of each, the base first."""
        return tuple(self._known)

    def _survey(self) -> None:
        """Find out what is free and reachable now; all maps are judged anew."""
        world, base = self._cycle.environment, self._cycle.bodies[BASE].view.base
        self._truth = world.walls == 0
        reachable = world.reachable(base)
        self._free, self._reachable = (
            int(np.count_nonzero(cells)) for cells in (self._truth, reachable)
        )
        self._counted = reachable if self._cycle.rules.shares else self._truth
        self._versions = [-1] * len(self._cycle.bodies)

    def note(self) -> None:
        """Note the state after a step."""
        cycle = self._cycle
        if cycle.changes != self._changes and cycle.rules.shares:
            self._changes = cycle.changes
            self._survey()
        for number, body in enumerate(cycle.bodies):
            known = body.view.known
            if known.version != self._versions[number]:
                self._versions[number] = known.version
                seen = (known.bits & FREE).view(np.bool_) & self._truth  # FREE is 1
                self._area[number] = int(np.count_nonzero(seen))
                self._known[number] = int(np.count_nonzero(seen & self._counted))
                self._team |= seen
        counts = (np.count_nonzero(self._team & one) for one in (self._truth, self._counted))
        team, counted = map(int, counts)
        self._rows.append(
            (self._free, self._reachable, team, self._area[BASE], counted, self._known[BASE],
             cycle.cells_sent, cycle.bytes_sent)
        )  # fmt: skip
        linked = cycle.links.closed[BASE]
        self._bodies.append(
            [
                self._body(number, body, bool(linked[number]))
                for number, body in enumerate(cycle.bodies)
            ]
        )
        self._links.append(np.argwhere(np.triu(cycle.links.direct, 1)))

    def _body(self, number: int, body: Body, linked: bool) -> tuple[object, ...]:
        view, known = body.view, body.view.known
        seen = (body.found, body.first) if body.works else (0, 0)
        moves = digits(self._cells[number], body.moves, view.cell) if body.works else ""
        moved = view.cell != self._cells[number]
        idle = self._idleness.count(number, body, self._cycle.environment, moved=moved)
        self._cells[number] = view.cell
        return (
            view.cell, view.heading, body.distance, *seen, self._area[number], known.free,
            known.at_base + known.relayed, known.undelivered, view.role, body.state,
            body.goal or NOWHERE, moves, body.works, linked, self._cycle.step - body.base_step,
            idle,
        )  # fmt: skip

    def history(self) -> History:
        """All that was noted so far."""
        columns = range(len(self._bodies[0][0]))
        arrays: list[Any] = [
            *np.array(self._rows, np.int64).T,
            *(np.array([[one[n] for one in row] for row in self._bodies]) for n in columns),
            tuple(self._links),
        ]
        if not self._cycle.rules.shares:
            arrays[0][:] = self.free
        names = tuple(body.member.name for body in self._cycle.bodies)
        return History(names, self._cycle.rules.number, *arrays)
