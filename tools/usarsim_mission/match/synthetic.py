"""Operators that are programs: they look at one robot after another and mark whom they see.

What a person would see in a robot's picture is what is true of it: who is before its camera, how
far off its axis, and whether something is in between. How well the person does it are parameters:
how long each robot is looked at, how far one recognises somebody, how long that takes, how often it
fails, and how far off the mark is. All that is drawn comes from a seed. What follows goes through
the gateway as the texts of a page.

Robots are also told to keep clear of the people that any of their cameras sees, whether or not the
operator looks at that picture. Where a victim counts only while a robot is near, each robot is told
to stay with somebody whom it sees and with whom no other stays, until it has lost them; one that
stays with somebody who walks leaves them for somebody who does not.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from usarsim_client import frames
from usarsim_client.scene import TruthRow
from usarsim_client.truth import View
from usarsim_mission.scoring import VictimRules
from usarsim_operator.ground import PERSON
from usarsim_server.base.fields import field

LOW = 0.6
"""m: who has the pelvis lower than this sits or lies."""
REACH = (0.5, PERSON)
"""m from the pelvis to hands and feet of who stands, and of who does not."""
_MOVED = 0.2  # m after which robots are told anew
_LOST = 20.0  # simulated s without a sight after which a robot stays with somebody no more
_SURELY = 0.8  # of the distance at which somebody is recognised, or counts, within which it stays

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

    def __init__(
        self,
        skill: Skill,
        robots: list[str],
        seed: int,
        rules: VictimRules = VictimRules(),  # noqa: B008 - it is frozen
    ) -> None:
        """Look at robots in this order; rules: what makes a victim found."""
        self._skill, self._robots = skill, robots
        self._within = _within(skill, rules)
        self._pairs = rules.pairs
        self._follows: dict[str, tuple[str, float]] = {}
        self._walk: set[str] = set()
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
        yield from self._stay_near(row, seen)
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
                if before is not None:
                    self._walk.add(one.name)
                place = [round(part, 3) for part in frames.flip(one.pos)]
                radius = REACH[one.pos[2] < LOW]
                yield {"type": "avoid", "name": one.name, "place": place, "radius": radius}

    def _stay_near(self, row: TruthRow, seen: list[View]) -> Iterator[Text]:
        """With whom robots stay from now on."""
        if self._within is None:
            return
        sights = {(view.robot, view.victim) for view in seen}
        for robot, (victim, since) in list(self._follows.items()):
            if (robot, victim) in sights:
                self._follows[robot] = victim, row.time
            elif row.time - since > _LOST:
                del self._follows[robot]
                yield {"type": "follow", "robot": robot, "name": None, "within": 0.0}
        for view in sorted(seen, key=lambda one: one.distance):
            with_whom, _ = self._follows.get(view.robot, (None, 0.0))
            surer = with_whom in self._walk and view.victim not in self._walk
            if (with_whom is None or surer) and not self._has_company(row, view.victim):
                self._follows[view.robot] = view.victim, row.time
                said = {"robot": view.robot, "name": view.victim}
                yield {"type": "follow", **said, "within": self._within}

    def _has_company(self, row: TruthRow, victim: str) -> bool:
        """Whether a robot that stays makes somebody count already."""
        if victim in {name for name, _ in self._follows.values()}:
            return True
        x, y, _ = next(one.pos for one in row.victims if one.name == victim)
        return not self._pairs and any(
            math.dist((x, y), robot.pos[:2]) <= (self._within or 0.0)
            for robot in row.robots
            if robot.name in self._follows
        )

    def _mark(self, row: TruthRow, robot: str, victim: str) -> Text:
        x, y, z = next(one.pos for one in row.victims if one.name == victim)
        dx, dy = (self._random.gauss(0.0, self._skill.error) for _ in range(2))
        place = frames.flip((x + dx, y + dy, z))
        return {"type": "mark", "robot": robot, "place": [round(one, 3) for one in place]}


def _within(skill: Skill, rules: VictimRules) -> float | None:
    """m within which robots stay of victims; None where a victim stays found without them."""
    if rules.sticky or rules.credit == "mark":
        return None
    near = _SURELY * skill.range
    if rules.credit == "view":
        return near
    # In pairs a robot may count for the victim of another. At a third of the radius that one then
    # reaches the victim which is left over.
    return min(near, rules.radius * (1.0 / 3.0 if rules.pairs else _SURELY))
