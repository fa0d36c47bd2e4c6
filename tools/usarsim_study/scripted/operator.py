"""Decides what an operator does next; knows no gateway, no page and no clock but simulated time.

The operator looks at one robot after another. It drives the chosen one to the nearest floor where
nobody has been, and marks whom it recognises in the picture: what a person would see there is what
is true of it. Robots that drive by themselves it only watches, and its eyes run over the pictures
of the others meanwhile, one after the other: whoever is in one of them makes it choose that robot.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from usarsim_client.truth import TrueRobot, TruthRow
from usarsim_study.scripted.floor import NEAR, Floor, Place
from usarsim_study.scripted.skill import Device, Skill


@dataclass(frozen=True, slots=True)
class Choose:
    """Look at another robot."""

    robot: str


@dataclass(frozen=True, slots=True)
class Drive:
    """Hold keys or stick so until further notice. forward, turn: -1 to 1, turn to the right."""

    robot: str
    forward: float
    turn: float


@dataclass(frozen=True, slots=True)
class Mark:
    """Say where a victim lies. place: x, y, z in MuJoCo's frame, m."""

    robot: str
    victim: str
    place: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Press:
    """A button.

    Attributes:
        what: `camera off`, `camera on`, `laser off`, `laser on`, `estop`, `estop_reset`,
            `mark_edit`, `mark_delete`, `acknowledge`. robot: the chosen one.
    """

    what: str
    robot: str


Act = Choose | Drive | Mark | Press

TRIES = (
    (1.0, "laser off"),
    (2.0, "laser on"),
    (3.0, "estop"),
    (4.0, "estop_reset"),
    (12.0, "acknowledge"),
)
"""Buttons that somebody tries at the beginning, s after it. `ahead` is none: for the rest of the
time until the next one the operator drives straight on, whatever is there."""

_AROUND = 1.2  # m of way around a robot on which nobody is missed
_NAMED = 1.5  # m around a place that was named
_DETOUR = 1.25  # times as far as the crow flies: there is a wall between
_ARRIVED = 0.5  # m
_AHEAD = 0.5  # m along the way to the point that is steered for
_ALONE = 3.0  # m around the goals of the other robots
_APART = 5.0  # m that such a goal seems to be further away
_ON_THE_SPOT = 0.6  # rad off the way from which on one turns on the spot
_STRAIGHT = 0.12  # rad off the way up to which one drives straight on
_STUCK = 3.0  # s without getting anywhere
_BACK = 1.5  # s of backing off
_GLANCE = 1.0  # s for which eyes rest on the picture of another robot
_MARKS = 4  # times that a mark is tried while its victim is in sight


class ScriptedOperator:
    """One operator in one trial.

    Attributes:
        goals: where robots are on their way to.
    """

    def __init__(
        self,
        skill: Skill,
        device: Device,
        floor: Floor,
        robots: Sequence[str],
        seed: int,
        watched: frozenset[str] = frozenset(),
        tries: Sequence[tuple[float, str]] = (),
    ) -> None:
        """Begin with the first robot.

        Args:
            skill: of the operator.
            device: that it holds.
            floor: its plan of the building.
            robots: that it looks after, in order.
            seed: of all that it draws.
            watched: those of them that drive by themselves.
            tries: buttons to press, by s since the beginning.
        """
        self._skill, self._floor = skill.holding(device), floor
        self._robots, self._watched = robots, watched
        self._speed, self._turn = skill.speed(device), skill.turn
        self._random = random.Random(seed)
        self._place, self._until = -1, -math.inf
        self._ready = 0.0
        self._held = 0.0, 0.0
        self._searched = np.zeros(len(floor), np.bool_)
        self._sights: dict[str, float] = {}
        self._blind: set[str] = set()
        self._marked: set[str] = set()
        self.goals: dict[str, Place] = {}
        self._way: list[Place] = []
        self._anchor = 0.0, 0.0, 0.0, 0.0  # s, x, y, yaw
        self._back, self._side = -math.inf, 1.0
        self._looked: dict[str, tuple[int, int]] = {}
        self._failed: dict[str, int] = {}
        self._time = math.nan
        self._eyes, self._rests = 0, -math.inf  # at the picture of which robot, until when
        self._tries, self._begun, self._heedless = list(tries), math.nan, False

    def is_told(self, places: Sequence[Place]) -> None:
        """Somebody has said where to go: elsewhere nothing has to be searched."""
        self._searched |= ~self._floor.within(list(places), _NAMED)

    def joins(self, other: ScriptedOperator) -> None:
        """Know what another one knows: what is searched, and who goes where."""
        self._searched, self.goals = other._searched, other.goals

    @property
    def robot(self) -> str:
        """The chosen one."""
        return self._robots[self._place]

    def see(self, row: TruthRow) -> Iterator[Act]:
        """What is done after what is true at an instant."""
        self._time = row.time
        if math.isnan(self._begun):
            self._begun = row.time
        if row.time >= self._until:
            yield from self._next_robot(row.time)
        elif (caught := self._catches_the_eye(row)) is not None:
            yield from self._turn_to(caught, row.time)
        while self._tries and row.time - self._begun >= self._tries[0][0] - 1e-9:
            what = self._tries.pop(0)[1]
            self._heedless = what == "ahead"
            if not self._heedless:
                yield Press(what, self.robot)
            if what.startswith("estop"):  # nobody drives on before the reset
                self._ready = math.inf if what == "estop" else row.time + self._skill.reaction
        yield from self._mark(row)
        true = next((one for one in row.robots if one.name == self.robot), None)
        if true is None or self.robot in self._watched:
            return
        waits = row.time < self._ready or (self._wonders and not self._heedless)
        wish = (0.0, 0.0) if waits else self._wish(row.time, true)
        if wish != self._held:
            self._held = wish
            yield Drive(self.robot, *wish)

    @property
    def _wonders(self) -> bool:
        """Whether there is somebody in the picture, and one stops to look."""
        return any(one not in self._blind and one not in self._marked for one in self._sights)

    def fails(self, victim: str) -> None:
        """A mark could not be made: the map does not reach there yet, it grows once a second.

        It is tried again after another reaction, or later, when the victim comes into sight anew.
        """
        self._marked.discard(victim)
        self._failed[victim] = self._failed.get(victim, 0) + 1
        if self._failed[victim] % _MARKS:
            self._sights[victim] = self._time
        else:
            self._blind.add(victim)

    # -- attention ----------------------------------------------------------------------------

    def _next_robot(self, time: float) -> Iterator[Act]:
        step = 1
        if len(self._robots) > 2 and self._random.random() < self._skill.neglect:
            step = 2
        yield from self._turn_to((self._place + step) % len(self._robots), time)

    def _turn_to(self, place: int, time: float) -> Iterator[Act]:
        if self._held != (0.0, 0.0):
            self._held = 0.0, 0.0
            yield Drive(self.robot, 0.0, 0.0)
        first = self._place < 0
        self._place = 0 if first else place
        self._until = time + self._skill.dwell * self._random.uniform(0.7, 1.3)
        self._ready = max(self._ready, time + self._skill.reaction)
        self._way, self._back = [], -math.inf
        self._sights.clear()
        self._blind.clear()
        if first or len(self._robots) > 1:
            yield Choose(self.robot)

    def _catches_the_eye(self, row: TruthRow) -> int | None:
        """The place of a robot that drives by itself, with somebody to be marked in its picture."""
        if self._wonders:
            return None
        if row.time >= self._rests:
            self._rests, self._eyes = row.time + _GLANCE, (self._eyes + 1) % len(self._robots)
        robot = self._robots[self._eyes]
        if self._eyes == self._place or robot not in self._watched:
            return None
        return self._eyes if self._in_picture(row, robot) - self._marked else None

    def _in_picture(self, row: TruthRow, robot: str) -> set[str]:
        """Victims that can be recognised there."""
        return {
            view.victim
            for view in row.views
            if view.robot == robot and view.clear
            and view.angle <= self._skill.half_angle and view.distance <= self._skill.range
        }  # fmt: skip

    def _mark(self, row: TruthRow) -> Iterator[Act]:
        skill = self._skill
        there = self._in_picture(row, self.robot)
        for victim in [one for one in self._sights if one not in there]:
            del self._sights[victim]
        for victim in sorted(there - self._marked):
            if victim not in self._sights:
                self._sights[victim] = row.time
                (self._blind.add if self._random.random() < skill.miss else self._blind.discard)(
                    victim
                )
            if victim in self._blind or row.time - self._sights[victim] < skill.reaction - 1e-9:
                continue
            self._marked.add(victim)
            if self._held != (0.0, 0.0):
                self._held = 0.0, 0.0
                yield Drive(self.robot, 0.0, 0.0)
            self._ready = max(self._ready, row.time + skill.reaction)
            x, y, z = next(one.pos for one in row.victims if one.name == victim)
            dx, dy = (self._random.gauss(0.0, skill.error) for _ in range(2))
            yield Mark(self.robot, victim, (x + dx, y + dy, z))

    # -- driving ------------------------------------------------------------------------------

    def _wish(self, time: float, true: TrueRobot) -> tuple[float, float]:
        """What keys or stick say: forward and turn (right), each none or that of the skill."""
        if self._heedless:
            return self._speed, 0.0
        x, y, yaw = true.pos[0], true.pos[1], _yaw(true.quat)
        node = self._floor.node(x, y)
        self._look(node, x, y, yaw)
        if time < self._back:
            return -self._speed, self._side * self._turn
        if self._is_stuck(time, x, y, yaw):
            self._back, self._side = time + _BACK, -self._side
            self._give_up()
            return -self._speed, self._side * self._turn
        goal = self.goals.get(self.robot)
        arrived = goal is None or math.dist(goal, (x, y)) < _ARRIVED
        if not self._way or arrived or self._searched[self._floor.node(*self._way[-1])]:
            self._plan(node)
        if not self._way:
            return 0.0, 0.0
        aim = self._aim((x, y))
        off = math.remainder(math.atan2(aim[1] - y, aim[0] - x) - yaw, math.tau)
        turn = 0.0 if abs(off) <= _STRAIGHT else -math.copysign(self._turn, off)
        return (0.0 if abs(off) > _ON_THE_SPOT else self._speed), turn

    def _look(self, node: int, x: float, y: float, yaw: float) -> None:
        """Floor in the picture that is near enough, and around the robot, is searched."""
        looks = node, round(yaw / 0.2)
        if self._looked.get(self.robot) == looks:
            return
        self._looked[self.robot] = looks
        skill, floor = self._skill, self._floor
        far = floor.ways(node, NEAR).far
        near = np.flatnonzero(np.isfinite(far))
        away = floor.places[near] - (x, y)
        crow = np.hypot(away[:, 0], away[:, 1])
        off = np.arctan2(away[:, 1], away[:, 0]) - yaw
        ahead = np.abs((off + math.pi) % math.tau - math.pi) <= skill.half_angle
        seen = ahead & (crow <= skill.range - 1.0) & (far[near] <= _DETOUR * crow)
        self._searched[near[seen | (far[near] <= _AROUND)]] = True

    def _plan(self, node: int) -> None:
        """To the nearest floor that nobody has searched."""
        self._way = []
        others = [place for name, place in self.goals.items() if name != self.robot]
        apart = _APART * self._floor.within(others, _ALONE)
        for limit in (NEAR, math.inf):
            ways = self._floor.ways(node, limit)
            cost = np.where(self._searched, math.inf, ways.far) + apart
            goal = int(np.argmin(cost))
            if math.isfinite(cost[goal]):
                places = self._floor.places[ways.to(goal)]
                self._way = [(float(x), float(y)) for x, y in places]
                self.goals[self.robot] = self._way[-1]
                return
        self.goals.pop(self.robot, None)

    def _give_up(self) -> None:
        """The goal cannot be reached: nobody looks for a way there again."""
        if self._way:
            self._searched |= self._floor.within([self._way[-1]], 0.5)
        self._way = []

    def _aim(self, here: Place) -> Place:
        """A point on the way, a bit ahead; what lies behind is forgotten."""
        away = [math.dist(here, place) for place in self._way[:20]]
        del self._way[: away.index(min(away))]
        return next((one for one in self._way if math.dist(here, one) >= _AHEAD), self._way[-1])

    def _is_stuck(self, time: float, x: float, y: float, yaw: float) -> bool:
        since, x0, y0, yaw0 = self._anchor
        moved = (
            math.hypot(x - x0, y - y0) > 0.1
            or abs(math.remainder(yaw - yaw0, math.tau)) > 0.25
            or self._held == (0.0, 0.0)
        )
        if moved or time - since > _STUCK:
            self._anchor = time, x, y, yaw
        return not moved and time - since > _STUCK


def _yaw(quat: tuple[float, float, float, float]) -> float:
    w, x, y, z = quat
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
