"""What happens to a run from outside: robots fail or come late, radios are out, doors close.

Events of `[[event]]` come between two steps, before the robots decide. Robots are not told; they
find out by their scanners, by a move that is blocked, or by silence (exploration 16).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from usarsim_exploration.cycle import BASE, Cycle
from usarsim_exploration.environment import Environment
from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table


@dataclass(frozen=True)
class Event:
    """One `[[event]]`.

    Attributes:
        number: of the robot; 0 if it concerns none.
    """

    step: int = field(low=1, high=1_000_000, help="before which it happens")
    kind: Literal["loss", "battery", "join", "outage", "close", "open"] = field(
        help="a robot fails, with its radio; a robot has so much left to drive, then fails; a "
        "robot is switched on; a radio is out; walls appear in a rectangle; walls vanish from one"
    )
    robot: str = field(
        default="", help="name, of loss, battery, join and outage; outage without: all radios"
    )
    steps: int = field(
        default=0, low=0, high=1_000_000, shown="to the end", help="how long, of outage"
    )
    distance: float = field(
        default=0.0, low=0.0, high=1e9, unit="cells", help="left to drive, of battery"
    )
    cells: tuple[int, int, int, int] | None = field(
        default=None,
        low=0,
        help="left, top, right and bottom, both ends included, of close and open",
    )
    number: int = 0

    @property
    def text(self) -> str:
        """In a few words, for results."""
        where = self.robot or " ".join(map(str, self.cells or ())) or "of all"
        return f"{self.kind} {where}"


def read_events(table: Table, names: list[str], environment: Environment) -> tuple[Event, ...]:
    """The events of a scenario, in order of steps.

    Args:
        table: of the whole scenario. names: of the team, the base first.

    Raises:
        ExplorationError: naming the event, what is wrong with it, and the cure.
    """
    found = []
    for inner in table.tables("event"):
        event = inner.read(Event)
        if event.steps and event.kind != "outage":
            raise inner.error("steps", f"means nothing to {event.kind}", "remove it")
        if event.kind in ("loss", "battery", "join", "outage"):
            number = 0
            if event.robot or event.kind != "outage":
                number = names.index(inner.choice("robot", names[1:]))
            event = inner.read(Event, number=number)
            if event.cells is not None:
                raise inner.error("cells", f"means nothing to {event.kind}", "remove it")
        else:
            rows, columns = environment.shape
            cells = inner.numbers("cells", (4,), event.cells)
            left, top, right, bottom = cells
            if not (left <= right < columns and top <= bottom < rows):
                problem = f"{list(event.cells or ())} is no rectangle of the world"
                cure = f"write [left, top, right, bottom] within {columns} x {rows} cells"
                raise inner.error("cells", problem, cure)
            if event.robot:
                raise inner.error("robot", f"means nothing to {event.kind}", "remove it")
        inner.finish()
        found.append(event)
    return tuple(sorted(found, key=lambda one: one.step))


def change(environment: Environment, event: Event) -> None:
    """Let walls of a rectangle appear or vanish."""
    assert event.cells is not None
    left, top, right, bottom = event.cells
    environment.walls[top : bottom + 1, left : right + 1] = event.kind == "close"


def late(events: tuple[Event, ...]) -> frozenset[int]:
    """Numbers of robots that are switched on only by an event."""
    return frozenset(one.number for one in events if one.kind == "join")


class Fate:
    """Lets the events of a run happen."""

    def __init__(self, events: tuple[Event, ...]) -> None:
        """In order of steps."""
        self._events = events
        self._next = 0
        self._batteries: dict[int, float] = {}
        self._outages: list[tuple[int, Event]] = []  # step from which on it is over

    def strike(self, cycle: Cycle) -> list[str]:
        """Let happen what is due before the next step; what that was, in words."""
        told = []
        for until, event in self._outages:
            if until == cycle.step + 1:
                told.append(f"end of {event.text}")
        self._outages = [one for one in self._outages if one[0] != cycle.step + 1]
        while self._next < len(self._events) and self._events[self._next].step <= cycle.step + 1:
            event = self._events[self._next]
            self._next += 1
            told.append(event.text)
            if event.kind == "loss":
                cycle.bodies[event.number].works = False
            elif event.kind == "join":
                body = cycle.bodies[event.number]
                body.works, body.asleep = True, False
            elif event.kind == "outage":
                self._outages.append((event.step + event.steps if event.steps else -1, event))
            elif event.kind == "battery":
                left = cycle.bodies[event.number].distance + event.distance
                self._batteries[event.number] = left
            else:
                self._move_walls(cycle, event)
        for number, last in sorted(self._batteries.items()):
            body = cycle.bodies[number]
            if body.works and body.distance >= last:
                body.works = False
                told.append(f"empty {body.member.name}")
        for number, body in enumerate(cycle.bodies):
            out = [until for until, event in self._outages if event.number in (0, number)]  # 0: all
            body.silent, body.heard_again = bool(out), bool(out) and -1 not in out
        return told

    def opening(self, cycle: Cycle) -> list[Event]:
        """Events to come after which more can be reached from the base than now."""
        left = [one for one in self._events[self._next :] if one.kind in ("close", "open")]
        if not any(one.kind == "open" for one in left):
            return []
        base = cycle.bodies[BASE].view.base
        world = replace(cycle.environment, walls=cycle.environment.walls.copy())
        most, found = np.count_nonzero(world.reachable(base)), []
        for event in left:
            change(world, event)
            world.walls[base[1], base[0]] = 0
            reached = np.count_nonzero(world.reachable(base))
            if event.kind == "open" and reached > most:
                most = reached
                found.append(event)
        return found

    @staticmethod
    def _move_walls(cycle: Cycle, event: Event) -> None:
        """Cells under robots stay free: doors do not crush anybody."""
        change(cycle.environment, event)
        cycle.changes += 1
        for body in cycle.bodies:
            column, row = body.view.cell
            cycle.environment.walls[row, column] = 0
            if body.scanner is not None:
                body.scanner.look_again(cycle.environment)
