"""Operators that are programs: they look at one robot after another and mark whom they see.

What a person would see in a robot's picture is what is true of it: who is before its camera, how
far off its axis, and whether something is in between. How well the person does it are parameters:
how long each robot is looked at, how far one recognises somebody, how long that takes, how often it
fails, and how far off the mark is. All that is drawn comes from a seed. What follows goes through
the gateway as the texts of a page.

Robots are also told to keep clear of the people that any of their cameras sees, whether or not the
operator looks at that picture.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from usarsim_client import frames
from usarsim_client.scene import TruthRow
from usarsim_operator.ground import PERSON
from usarsim_server.base.fields import field

LOW = 0.6
"""m: who has the pelvis lower than this sits or lies."""
REACH = (0.5, PERSON)
"""m from the pelvis to hands and feet of who stands, and of who does not."""
_MOVED = 0.2  # m after which robots are told anew

Text = Mapping[str, Any]
"""What a page says, without its clock."""


@dataclass(frozen=True, slots=True)
class Skill:
    """How an operator is."""

    dwell: float = field(default=6.0, unit="s", above=0.0, help="that each robot is looked at")
    reaction: float = field(
        default=1.5, unit="s", low=0.0, help="that somebody is in sight before the mark"
    )
    range: float = field(default=6.0, unit="m", above=0.0, help="at which somebody is recognised")
    half_angle_degrees: float = field(
        default=30.0, low=1.0, high=60.0, help="off the middle of the picture"
    )
    miss: float = field(
        default=0.1, low=0.0, high=1.0, help="share of sights in which nobody is recognised"
    )
    error: float = field(default=0.2, unit="m", low=0.0, help="of a mark, standard deviation")


class SyntheticOperator:
    """Decides; knows no gateway."""

    def __init__(self, skill: Skill, robots: list[str], seed: int) -> None:
        """Look at robots in this order."""
        self._skill, self._robots = skill, robots
        self._random = random.Random(seed)
        self._chosen, self._since = -1, -math.inf
        self._sights: dict[str, float] = {}
        self._blind: set[str] = set()
        self._marked: set[str] = set()
        self._clear: dict[str, tuple[float, ...]] = {}

    def see(self, row: TruthRow) -> Iterator[Text]:
        """What is said after what is true at an instant."""
        skill = self._skill
        if row.time - self._since >= skill.dwell and self._robots:
            self._chosen = (self._chosen + 1) % len(self._robots)
            self._since = row.time
            self._sights.clear()
            self._blind.clear()
            yield {"type": "select", "robot": self._robots[self._chosen]}
        robot = self._robots[self._chosen]
        half = math.radians(skill.half_angle_degrees)
        seen = [
            view
            for view in row.views
            if view.clear and view.angle <= half and view.distance <= skill.range
        ]
        yield from self._keep_clear(row, {view.victim for view in seen})
        there = {view.victim for view in seen if view.robot == robot}
        for victim in [one for one in self._sights if one not in there]:
            del self._sights[victim]
        for victim in sorted(there - self._marked):
            if victim not in self._sights:
                self._sights[victim] = row.time
                if self._random.random() < skill.miss:
                    self._blind.add(victim)
            since = row.time - self._sights[victim]
            if victim not in self._blind and since >= skill.reaction - 1e-9:
                self._marked.add(victim)
                yield self._mark(row, robot, victim)

    def _keep_clear(self, row: TruthRow, seen: set[str]) -> Iterator[Text]:
        """Of whom a robot sees, where they are now."""
        for one in row.victims:
            before = self._clear.get(one.name)
            if one.name in seen and (before is None or math.dist(before, one.pos) > _MOVED):
                self._clear[one.name] = tuple(one.pos)
                place = [round(part, 3) for part in frames.flip(one.pos)]
                radius = REACH[one.pos[2] < LOW]
                yield {"type": "avoid", "name": one.name, "place": place, "radius": radius}

    def _mark(self, row: TruthRow, robot: str, victim: str) -> Text:
        x, y, z = next(one.pos for one in row.victims if one.name == victim)
        dx, dy = (self._random.gauss(0.0, self._skill.error) for _ in range(2))
        place = frames.flip((x + dx, y + dy, z))
        return {"type": "mark", "robot": robot, "place": [round(one, 3) for one in place]}
