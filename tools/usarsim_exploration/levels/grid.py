"""The level without physics: robots drive from cell to cell as far as their speed allows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.noise import disturb
from usarsim_exploration.post import Carry
from usarsim_exploration.radio import Links, find_links

if TYPE_CHECKING:
    from usarsim_exploration.cycle import Body, Cycle


class Level(Protocol):
    """Who moves robots, makes their scans, and says which links exist."""

    @property
    def carry(self) -> Carry | None:
        """Brings messages over links; None: they need nobody for that."""

    def look(self, cycle: Cycle) -> None:
        """The first scans of all, before the first step."""

    def move(self, cycle: Cycle) -> None:
        """All robots that work decide (`cycle.decide`), drive for a step, and scan on the way."""

    def links(self, cycle: Cycle) -> Links:
        """Who hears whom now."""

    def reality(self, cycle: Cycle) -> dict[str, float | None]:
        """Measures that only robots of a server have; nothing on the grid."""

    def close(self) -> float:
        """End it; processor s that others have used for it."""


class GridLevel:
    """Computes on the cells of the true world."""

    carry: Carry | None = None

    def look(self, cycle: Cycle) -> None:
        """The first scans."""
        for body in cycle.bodies:
            if body.works:
                self._scan(cycle, body, [body.view.cell], [body.view.heading], False)

    def move(self, cycle: Cycle) -> None:
        """Each robot drives as far as its speed allows, and scans at every cell."""
        for body in cycle.acting():
            cycle.decide(body)
            self._drive(cycle, body)
            body.view.planner.forget()

    def links(self, cycle: Cycle) -> Links:
        """By the radio model and the true walls."""
        cells = [body.view.cell for body in cycle.bodies]
        ranges = [
            body.member.radio_range if body.works and not body.silent else 0.0
            for body in cycle.bodies
        ]
        return find_links(cycle.radio, cycle.environment, cells, ranges, cycle.step)

    def reality(self, cycle: Cycle) -> dict[str, float | None]:
        """Nothing."""
        return {}

    def close(self) -> float:
        """There is nothing to end."""
        return 0.0

    def _drive(self, cycle: Cycle, body: Body) -> None:
        view, environment = body.view, cycle.environment
        driven, headings, budget = list[Cell](), list[float](), view.speed + body.saved
        blocked, met, here = None, list[Cell](), view.cell
        for there in view.path:
            right, down = there[0] - here[0], there[1] - here[1]
            price = math.hypot(right, down)
            if price > budget + 1e-9:
                break
            if not environment.may_move(here, there):
                blocked, met = there, felt(environment, here, there)
                break
            budget -= price
            body.distance += price
            here = there
            driven.append(here)
            headings.append(math.atan2(down, right))
        if driven:
            view.cell, view.heading = here, headings[-1]
            del view.path[: len(driven)]
        # who is slower than a diagonal saves for it; else nobody drives more than the speed
        body.saved = budget if view.path and not driven and blocked is None else 0.0
        view.blocked = blocked is not None
        body.moves = driven if blocked is None else [*driven, blocked]
        cells = driven or [view.cell]
        self._scan(cycle, body, cells, headings or [view.heading], bool(driven))
        if blocked is not None:
            for cell in met:
                view.known.bump(cycle.step, cell)
            view.path.clear()

    @staticmethod
    def _scan(
        cycle: Cycle, body: Body, cells: Sequence[Cell], headings: Sequence[float], driven: bool
    ) -> None:
        if body.scanner is None:
            return
        known, member = body.view.known, body.member
        if member.noise:
            scans = body.scanner.scan(cells, headings)
            shape = cycle.environment.shape
            scans = disturb(
                scans, member.noise, member.reach, shape, body.random, rounded=cycle.rules.sight
            )
            found = known.take_in(cycle.step, scans, driven)
            if body.evidence is not None:
                for number in range(len(cells)):
                    body.evidence.correct(known, cycle.step, scans, number)
        else:
            found = known.look(cycle.step, body.scanner, cells, headings, driven)
        cycle.count(body, found)


def felt(environment: Environment, start: Cell, goal: Cell) -> list[Cell]:
    """The walls that keep a robot from a neighbour."""
    rows, columns = environment.shape
    return [
        (column, row)
        for column, row in dict.fromkeys((goal, (goal[0], start[1]), (start[0], goal[1])))
        if 0 <= column < columns
        and 0 <= row < rows
        and max(abs(column - start[0]), abs(row - start[1])) == 1
        and environment.walls[row, column]
    ]
