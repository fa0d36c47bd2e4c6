"""Scripted runs: what a referee is told, line by line."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from usarsim_mission.grid import FREE, WALL, Grid
from usarsim_mission.model import Fan, Mission, Start, Victim, World, Zone
from usarsim_mission.records import Record
from usarsim_mission.referee import Referee
from usarsim_mission.scoring import Rules, VictimRules

Places = Mapping[str, tuple[float, float] | tuple[float, float, float]]

YELLOW = Zone("cellar", "yellow", ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)))
ORANGE = Zone("hall", "orange", ((10.0, 0.0), (20.0, 0.0), (20.0, 10.0), (10.0, 10.0)))
RED = Zone("yard", "red", ((20.0, 0.0), (30.0, 0.0), (30.0, 10.0), (20.0, 10.0)))

ANNA = Victim("Anna", (5.0, 5.0, 0.2), "conscious")
BEN = Victim("Ben", (15.0, 5.0, 0.2), "unconscious")
CARL = Victim("Carl", (25.0, 5.0, 0.2), "dead")

WORLD = World("three rooms", victims=(ANNA, BEN, CARL), zones=(YELLOW, ORANGE, RED))
"""A yellow, an orange and a red room in a row along x, 10 m each, a victim in each middle."""

OPEN = World("open", victims=(ANNA, BEN))
"""Two victims, no zones."""


def rules(total: str | None = "VC", **changes: Any) -> Rules:
    """Rules, with other rules of victims."""
    found = Rules("scripted", total=total)
    return dataclasses.replace(found, victims=VictimRules(**changes))


def corridor(length: float = 20.0, cell: float = 0.1) -> Grid:
    """A corridor along x, 2 m wide, with walls of one cell."""
    cells = np.full((round(2.0 / cell) + 2, round(length / cell) + 2), WALL, np.uint8)
    cells[1:-1, 1:-1] = FREE
    return Grid(-cell, -cell, cell, cells)


def sick(name: str, range: float = 20.0, fov: float = math.tau) -> Start:
    """A robot with a scanner."""
    return Start(name, "P3AT", sensors=(Fan(range, fov),))


class Script:
    """A run that is told to a referee.

    Attributes:
        out: all that it has derived.
        said: all that it was told.
    """

    def __init__(
        self, world: World = WORLD, using: Rules | None = None, mission: Mission | None = None
    ) -> None:
        self.referee = Referee(mission or Mission(), rules() if using is None else using, world)
        self.out: list[Record] = []
        self.said: list[Record] = []
        self.time = 0.0

    def tell(self, kind: str, at: float | None = None, **facts: Any) -> list[Record]:
        """Something happens, now or at a time."""
        self.time = self.time if at is None else at
        record = {"seq": len(self.said), "t_sim": self.time, "kind": kind, **facts}
        self.said.append(record)
        found = self.referee.feed(record)
        self.out += found
        return found

    def start(self, limit: float | None = 600.0, **places: Any) -> Script:
        """The trial begins with robots at places."""
        self.tell("session", robots=[{"name": name, "class": "P3AT"} for name in places])
        if places:
            self.row(**places)
        self.tell("trial_start", limit=limit)
        return self

    def row(
        self,
        at: float | None = None,
        views: Iterable[Mapping[str, Any]] = (),
        contacts: Mapping[str, list[Mapping[str, Any]]] | None = None,
        quats: Mapping[str, list[float]] | None = None,
        **places: tuple[float, ...],
    ) -> list[Record]:
        """A row of the truth with robots at places."""
        robots = [
            {
                "name": name,
                "pos": [*place, 0.2][:3],
                "quat": (quats or {}).get(name, [1.0, 0.0, 0.0, 0.0]),
                "contacts": (contacts or {}).get(name, []),
            }
            for name, place in places.items()
        ]
        return self.tell("truth", at, robots=robots, victims=[], views=list(views))

    def go(
        self, name: str, begin: tuple[float, float], end: tuple[float, float], speed: float = 1.0
    ) -> list[Record]:
        """A robot goes straight, ten rows a second."""
        out: list[Record] = []
        steps = max(1, math.ceil(math.dist(begin, end) / speed * 10.0))
        for step in range(1, steps + 1):
            x, y = (a + (b - a) * step / steps for a, b in zip(begin, end, strict=True))
            out += self.row(round(self.time + 0.1, 6), **{name: (x, y)})
        return out

    def drive(self, robot: str, source: str = "operator", power: float = 0.5) -> None:
        """A robot is told to move."""
        self.tell("command", robot=robot, source=source, left=power, right=power)

    def mark(self, number: int, x: float, y: float, robot: str = "R1", **more: Any) -> list[Record]:
        """A mark is set."""
        return self.tell("mark_set", mark=number, robot=robot, place=[x, y, 0.0], **more)

    def of(self, *kinds: str) -> list[Record]:
        """What was derived of some kinds."""
        return [one for one in self.out if one["kind"] in kinds]

    def values(self) -> dict[str, float]:
        """All variables, as they are now."""
        self.referee._count(self.time)
        found: dict[str, float] = self.referee.score["values"]
        return found
