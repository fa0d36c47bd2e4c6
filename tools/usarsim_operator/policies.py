"""What a robot does while nobody drives it: stand, hold its heading, patrol, explore.

A policy gets what the robot knows and tells its wheels; it has no socket and no clock. Another one
is a class of an installed package that an entry point of the group `usarsim.policies` names.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_client import readings
from usarsim_operator.navigation import (
    FAR,
    Cells,
    Costs,
    Grid,
    Place,
    Steps,
    distances,
    way,
)
from usarsim_operator.occupancy import CELL, OccupancyMap

GROUP = "usarsim.policies"
RADIUS = 0.35
"""m that the middle of a robot keeps from walls."""
CRUISE = 1.0
"""Of full power, straight on."""

_CLOSE = 0.4  # m from a place that count as being there
_AHEAD = 0.6  # m along the way to the point that it steers for
_ROOM = 0.45  # m ahead of the scanner below which it does not go on
_TURNING = 0.8  # m of way that a rad of turning is worth
_PLAN = 3.0  # simulated s after which a way is looked for anew
_WAIT = 1.0  # simulated s after which one is looked for where there was none
_STUCK = 2.5  # simulated s without getting anywhere
_FELT = 0.5  # m from its middle to what stopped it
_AROUND = 0.3  # m around that, where its middle does not go
_MOST_FELT = 60
_REMEMBERED = 30.0  # simulated s
_BACK = 1.5  # simulated s of backing off
_HELD = 0.3  # m within which it is still where it was stuck before
_FREEING = (None, (-CRUISE, -CRUISE), (CRUISE, CRUISE))
"""What is tried in turn while it is stuck at one place: to back off in a curve, then straight, as
wheels that hang over something low turn freely, then to get over it."""


@dataclass(frozen=True, slots=True)
class View:
    """What a robot knows; the protocol's frame, y to the right.

    Attributes:
        time: simulated s. pose: x, y (m), yaw (rad, clockwise).
        scan: its newest flat scan; None if it has none.
        map: of all robots. goals: places that others go to, by robot.
    """

    time: float
    pose: tuple[float, float, float]
    scan: readings.LaserScan | None
    map: OccupancyMap
    goals: Mapping[str, Place]


Powers = tuple[float, float]
"""Of the left and the right wheels, -1 to 1."""


class Policy(ABC):
    """Drives one robot.

    Attributes:
        name: what people call it. goal: where it goes; None if nowhere.
    """

    name = ""
    goal: Place | None = None

    @abstractmethod
    def powers(self, view: View) -> Powers:
        """What the wheels get now."""

    def resume(self) -> None:  # noqa: B027 - most have no plan
        """Somebody else has driven meanwhile: what was planned no longer holds."""


class Stop(Policy):
    """Stands."""

    name = "stop"

    def powers(self, view: View) -> Powers:
        """Nothing."""
        return 0.0, 0.0


class Hold(Policy):
    """Goes straight on by the heading that it has when it begins, until something is near."""

    name = "hold"

    def __init__(self) -> None:
        self._heading = math.nan

    def resume(self) -> None:
        """Holds the heading that it has now."""
        self._heading = math.nan

    def powers(self, view: View) -> Powers:
        """Straight on, or nothing where there is no room."""
        if math.isnan(self._heading):
            self._heading = view.pose[2]
        if _free(view.scan) < 2.0 * _ROOM:
            return 0.0, 0.0
        return _steer(math.remainder(self._heading - view.pose[2], math.tau), 0.5)


class _Traveller(Policy):
    """Follows ways over the map; backs off where it gets nowhere."""

    unknown = False
    """Whether ways lead over what nobody has seen."""

    def __init__(self) -> None:
        self._way: list[Place] = []
        self._due = -math.inf
        self._anchor: View | None = None
        self._back = -math.inf
        self._side = 0.3
        self._caught, self._tries, self._freeing = (math.inf, math.inf), 0, (0.0, 0.0)
        self._felt: deque[tuple[float, Place]] = deque(maxlen=_MOST_FELT)

    def resume(self) -> None:
        """Looks for its way anew."""
        self._way, self._due, self._anchor, self.goal = [], -math.inf, None, None

    @abstractmethod
    def choose(self, view: View, grid: Grid, passable: Cells) -> None:
        """Set `goal`, by `go_to`."""

    def blocked(self, view: View) -> None:
        """It cannot get to its goal."""

    def go_to(self, grid: Grid, steps: Steps, cell: tuple[int, int]) -> None:
        """Make a cell the goal."""
        self._way = [grid.place(*one) for one in way(steps, cell)]
        self.goal = self._way[-1] if self._way else None

    def powers(self, view: View) -> Powers:
        """Along the way."""
        here = view.pose[:2]
        if view.time < self._back:
            return self._freeing
        if self._is_stuck(view):
            x, y, yaw = view.pose  # what scanners do not see is felt
            felt = x + _FELT * math.cos(yaw), y + _FELT * math.sin(yaw)
            self._felt.append((view.time, felt))
            self.blocked(view)
            self._tries = self._tries + 1 if math.dist(here, self._caught) < _HELD else 0
            self._caught, self._side = here, -self._side
            curve = -CRUISE * (0.6 + self._side), -CRUISE * (0.6 - self._side)
            self._freeing = _FREEING[self._tries % len(_FREEING)] or curve
            self._back, self._due = view.time + _BACK, -math.inf
            return 0.0, 0.0
        arrived = self.goal is not None and math.dist(here, self.goal) < _CLOSE
        if arrived or view.time >= self._due:
            self._due = view.time + _PLAN
            grid = Grid(view.map.cells(), view.map.corner)
            for recalled in (self._felt, deque[tuple[float, Place]]()):  # shut in, it tries again
                passable = grid.passable(here, RADIUS, unknown=self.unknown)
                for when, place in recalled:
                    if view.time - when <= _REMEMBERED:
                        grid.leave_out(passable, place, _AROUND)
                passable[grid.cell(here)] = True
                self.choose(view, grid, passable)
                if self.goal is not None or not recalled:
                    break
        if self.goal is None:
            self._anchor = None
            self._due = min(self._due, view.time + _WAIT)
            return 0.0, 0.0
        return self._follow(view)

    def _is_stuck(self, view: View) -> bool:
        """Whether it wants to get on and has not for a while."""
        last = self._anchor
        moved = last is None or (
            math.dist(view.pose[:2], last.pose[:2]) > 0.15
            or abs(math.remainder(view.pose[2] - last.pose[2], math.tau)) > 0.3
        )
        if moved or self.goal is None:
            self._anchor = view
            return False
        assert last is not None
        if view.time - last.time <= _STUCK:
            return False
        self._anchor = view
        return True

    def _follow(self, view: View) -> Powers:
        x, y, yaw = view.pose
        nearest = min(range(len(self._way)), key=lambda one: math.dist((x, y), self._way[one]))
        ahead = min(nearest + round(_AHEAD / CELL), len(self._way) - 1)
        aim = self._way[ahead]
        error = math.remainder(math.atan2(aim[1] - y, aim[0] - x) - yaw, math.tau)
        free = _free(view.scan)
        speed = CRUISE * min(max((free - _ROOM) / 0.8, 0.0), 1.0)
        return _steer(error, speed)


class Explore(_Traveller):
    """Goes to where the known ends: the nearest frontier that no other robot goes to."""

    name = "explore"

    def __init__(self) -> None:
        super().__init__()
        self._given_up: list[Place] = []

    def blocked(self, view: View) -> None:
        """That frontier cannot be reached."""
        if self.goal is not None:
            self._given_up.append(self.goal)
        self.goal = None

    def choose(self, view: View, grid: Grid, passable: Cells) -> None:
        """The nearest one; one where it already stands shows nothing new and is given up."""
        here = view.pose[:2]
        if self.goal is not None and math.dist(here, self.goal) < _CLOSE:
            self._given_up.append(self.goal)
        worth = grid.near(grid.frontier(), 0.5) >= 5
        for place in self._given_up:
            grid.leave_out(worth, place, 0.7)
        cells = np.nonzero(worth)
        if not len(cells[0]):
            self.goal, self._way = None, []
            return
        turning = _TURNING * grid.turns(cells, view.pose)
        dearer = [(grid.within(cells, here, 2.0 * _CLOSE), 5.0)]  # it sees those by leaving
        dearer += [(grid.within(cells, place, 2.5), 6.0) for place in view.goals.values()]

        def cost_of(steps: NDArray[np.integer[Any]]) -> Costs:
            found: Costs = CELL * steps + turning
            for which, by in dearer:
                found[which] += by
            return found

        more = np.full(worth.shape, np.inf)
        more[cells] = cost_of(np.zeros(turning.shape, np.int32))
        steps = distances(passable, grid.cell(here), more)
        cost = np.where(steps[cells] < FAR, cost_of(steps[cells]), np.inf)
        best = int(np.argmin(cost))
        if math.isfinite(cost[best]):
            self.go_to(grid, steps, (int(cells[0][best]), int(cells[1][best])))
        else:
            self.goal, self._way = None, []


class Patrol(_Traveller):
    """Goes along places, to the end and back, for ever."""

    name = "patrol"
    unknown = True

    def __init__(self, route: Sequence[Place]) -> None:
        """route: at least two places.

        Raises:
            ValueError: if there are fewer.
        """
        super().__init__()
        if len(route) < 2:
            raise ValueError("a patrol needs a route of two places or more")
        self._route, self._next, self._step = list(route), 0, 1

    def _turn(self) -> None:
        if not 0 <= self._next + self._step < len(self._route):
            self._step = -self._step
        self._next += self._step

    def blocked(self, view: View) -> None:
        """Goes on with the next place."""
        self._turn()

    def choose(self, view: View, grid: Grid, passable: Cells) -> None:
        """The next place, or the one after it where it is there already."""
        if math.dist(view.pose[:2], self._route[self._next]) < _CLOSE:
            self._turn()
        place = self._route[self._next]
        inside = grid.place(*grid.cell(place))
        steps = distances(passable, grid.cell(view.pose[:2]))
        self.go_to(grid, steps, grid.cell(place))
        if not self._way or math.dist(inside, place) > CELL:  # not on the map: straight there
            self._way, self.goal = [view.pose[:2], place], place


def make(name: str, route: Sequence[Place]) -> Policy:
    """A new policy.

    Args:
        name: of it. route: of a patrol.

    Raises:
        ValueError: if there is none of that name, or the route is too short.
    """
    if name == Patrol.name:
        return Patrol(route)
    own: dict[str, type[Policy]] = {one.name: one for one in (Stop, Hold, Explore)}
    if name in own:
        return own[name]()
    for entry in entry_points(group=GROUP):
        if entry.name == name:
            found: Policy = entry.load()()
            return found
    raise ValueError(f"there is no policy {name} (known: {', '.join(names())})")


def names() -> list[str]:
    """All policies, those of other packages included."""
    own = [one.name for one in (Stop, Hold, Patrol, Explore)]
    return own + sorted(one.name for one in entry_points(group=GROUP))


def _free(scan: readings.LaserScan | None) -> float:
    """m ahead of the scanner in which there is nothing, as wide as the robot; infinite without."""
    if scan is None:
        return math.inf
    across = np.abs(scan.ranges * np.sin(scan.bearings))
    ahead = (across < RADIUS) & (np.abs(scan.bearings) < 1.3)
    return float(np.nanmin(np.where(ahead, scan.ranges * np.cos(scan.bearings), np.inf)))


def _steer(error: float, speed: float) -> Powers:
    """Powers that turn by an error of the heading (rad, clockwise) while going on."""
    turn = min(max(1.2 * error, -0.9), 0.9)
    speed *= max(0.0, 1.0 - abs(error) / 0.8)
    most = max(1.0, abs(speed + turn), abs(speed - turn))
    return (speed + turn) / most, (speed - turn) / most
