"""What a robot does while nobody drives it: stand, hold its heading, patrol, explore, search.

A policy gets what the robot knows and tells its wheels; it has no socket and no clock. Another one
is a class of an installed package that an entry point of the group `usarsim.policies` names.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from importlib.metadata import entry_points
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_client import readings
from usarsim_operator.evasion import Powers, evade
from usarsim_operator.ground import Disc, Followed
from usarsim_operator.navigation import (
    FAR,
    WALL,
    Cells,
    Costs,
    Grid,
    Place,
    Steps,
    distances,
    space,
    way,
)
from usarsim_operator.occupancy import CELL
from usarsim_operator.view import View

GROUP = "usarsim.policies"
RADIUS = 0.35
"""m that the middle of a robot keeps from walls."""
CRUISE = 1.0
"""Of full power, straight on."""

_CLOSE = 0.4  # m from a place that count as being there
_AHEAD = 0.6  # m along the way to the point that it steers for
_ROOM = 0.45  # m ahead of the scanner below which it holds its heading no more
_NEAR = 0.3  # m ahead of the scanner below which it does not go on
_HALF = 0.29  # m to either side of the scanner in which something is ahead, and not beside
_TURNING = 0.8  # m of way that a rad of turning is worth
_PLAN = 3.0  # simulated s after which a way is looked for anew
_WAIT = 1.0  # simulated s after which one is looked for where there was none
_STUCK = 1.2  # simulated s without getting anywhere
_MOVED = 0.06, 0.12  # m or rad that count as getting somewhere
_PUSH = 0.8  # simulated s times power ahead without getting anywhere
_LEAST = 0.3  # power that turns on the spot, and rad that are worth it
_IDLE = 0.6, 0.25  # simulated s for which it drives by less than this power, and is stuck, too
_SLOW = 6.0, 0.5  # simulated s in which it comes this many m on, or it is stuck, too
_FELT = 0.5  # m from its middle to what stopped it
_STEPS_BACK, _STEP_BACK, _AS_WIDE = 100, 0.2, 0.15  # places of the way it came, m apart, m around
_REMEMBERED = ((300.0, 0.6), (300.0, 0.4), (20.0, 0.4), (0.0, 0.4))
"""Simulated s after which what was felt counts no more, and m around it where its middle does not
go; if shut in by it, the next."""
_MOST_OF = 0.8  # of the floor that it gets to without keeping clear of where somebody was
_ROOMY = 8.0  # m2 that it gets to at least, or it is shut in
_BESIDE = 0.8  # rad to either side in which what it has begun to climb goes on
_BACK = 1.5  # simulated s of backing off
_DOWN = 2.2  # simulated s of it where it has begun to climb
_LEANS = 0.1  # rad from upright at which it has begun to climb onto something
_RISES, _JUMPS, _RISEN = 0.05, 1.0, 0.03  # m/s from and to which, and m by which, a lift has it
_LEVEL = 0.05  # rad from upright at which it does not climb by itself
_CAREFUL = 1.2, 0.7  # m from what was felt to its middle at which it has this power ahead at most
_CLEAR = 0.38  # m from its middle to what it must not touch, beside how far that reaches
_SWING = 0.33  # m from its middle to what its corners may touch while it turns on the spot
_NEXT = 0.3  # m: as far on it looks whether it would touch somebody
_STRIDE = 8  # cells between two places that are worth another look
_NEW = 1.5  # m to the nearest of them
_OLDEST = 600.0  # simulated s since the last look that are worth something
_PACE = 0.3  # m/s on the way there
_GIVEN_UP, _WIDELY = 0.7, 1.5  # m around a frontier that is given up
_RETRY = 120.0  # simulated s after which it tries again what it has given up
_IN_SIGHT = 0.6  # m around somebody in which what the map has for a wall may be they
_HELD = 0.3  # m within which it is still where it was stuck before
_IN_ITS_WAY = "somebody, or another robot, is in its way"
_FREEING = (None, (-CRUISE, -CRUISE), (CRUISE, CRUISE))
"""What is tried in turn while it is stuck at one place: to back off in a curve, then straight, as
wheels that hang over something low turn freely, then to get over it."""


class Policy(ABC):
    """Drives one robot.

    Attributes:
        name: what people call it. goal: where it goes; None if nowhere.
        why: why it stands, in words; empty while it goes on.
    """

    name = ""
    goal: Place | None = None
    why = ""

    @property
    def carried(self) -> bool:
        """Whether a lift has it."""
        return False

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
    at_rest: Powers = (0.0, 0.0)
    """What the wheels get while there is nowhere to go."""

    def __init__(self) -> None:
        self._way: list[Place] = []
        self._due = -math.inf
        self._anchor: View | None = None
        self._track: deque[tuple[float, Place]] = deque()
        self._back = -math.inf
        self._side = 0.3
        self._unseen = False
        self._caught, self._tries, self._freeing = (math.inf, math.inf), 0, (0.0, 0.0)
        self._told: Powers = (0.0, 0.0)
        self._pushed = math.inf
        self._push: tuple[float, Place, float] = (0.0, (math.inf, math.inf), 0.0)
        self._came: deque[Place] = deque(maxlen=_STEPS_BACK)
        self._before: View | None = None
        self._carried = 0.0

    def resume(self) -> None:
        """Looks for its way anew."""
        self._way, self._due, self._anchor, self.goal = [], -math.inf, None, None
        self._track.clear()

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
        """Along the way, unless that would touch somebody, or a wall behind.

        What is wedged in cannot be choosy about walls.
        """
        if self._is_carried(view):
            self.resume()
            self._told, self.why = (0.0, 0.0), "the floor under it has risen"
            return self._told
        left, right = self._wanted(view)
        ahead = left + right
        off = math.copysign(_NEXT, ahead)
        meets = bool(ahead) and _meets(view, off)
        if meets:
            self.why = _IN_ITS_WAY
        if meets or (ahead < 0.0 and not self._tries and _backs_into_wall(view, off)):
            self._back = -math.inf
            self._due = min(self._due, view.time + _WAIT)
            turn = (left - right) / 2.0 or math.copysign(0.5, self._side)
            left, right = turn, -turn
        if abs(left - right) > _LEAST and (off := _way_out(view)):
            left = right = math.copysign(_LEAST, off)
        evades = evade(view, (left, right))
        if evades != (left, right):
            self.why, self._back, self._due = _IN_ITS_WAY, -math.inf, view.time
        self._told = evades
        return self._told

    @property
    def carried(self) -> bool:
        """Whether the floor under it has risen, as that of a lift does."""
        return self._carried > _RISEN

    def _is_carried(self, view: View) -> bool:
        """Whether it is, from now on; where that happened no robot goes any more.

        Nothing tells where the floor ends: it stands until that is down again.
        """
        before, self._before, was = self._before, view, self.carried
        if before is None:
            return False
        rise, took = view.height - before.height, view.time - before.time
        level = max(map(abs, (*view.lean, *before.lean))) < _LEVEL
        if was or (level and _RISES * took < rise < _JUMPS * took):
            self._carried += rise
        else:
            self._carried = 0.0
        if self.carried and not was:
            view.ground.rise(view.pose[:2])
        return self.carried

    def _wanted(self, view: View) -> Powers:
        here = view.pose[:2]
        leans = math.hypot(*view.lean) > _LEANS
        if not leans and (not self._came or math.dist(here, self._came[-1]) > _STEP_BACK):
            self._came.append(here)
        if view.time < self._back:
            return self._freeing
        if self._is_stuck(view) or leans:
            self._unseen = self._feel(view) or leans
            self.blocked(view)
            self._tries = self._tries + 1 if math.dist(here, self._caught) < _HELD else 0
            self.why = "it is caught on something and tries to get free"
            self._caught, self._side = here, -self._side
            self._freeing = self._free_by(leans)
            self._back, self._due = view.time + (_DOWN if leans else _BACK), -math.inf
            self._track.clear()
            return 0.0, 0.0
        arrived = self.goal is not None and math.dist(here, self.goal) < _CLOSE
        if arrived or view.time >= self._due:
            self._due = view.time + _PLAN
            self._plan(view, arrived)
        if self.goal is None:
            self._anchor = None
            self._track.clear()
            self._due = min(self._due, view.time + _WAIT)
            return self._rest(view)
        self.why = ""
        return self._follow(view)

    def _free_by(self, leans: bool) -> Powers:
        """Powers of the next try to get away from where it is caught."""
        curve = -CRUISE * (0.6 + self._side), -CRUISE * (0.6 - self._side)
        if leans:  # the way it came
            ahead = sum(self._told) >= 0.0
            came = (-CRUISE, -CRUISE) if ahead else (CRUISE, CRUISE)
            return (came, came, curve, (-came[0], -came[1]))[self._tries % 4]
        return _FREEING[self._tries % len(_FREEING)] or curve

    def _feel(self, view: View) -> bool:
        """What scanners do not see is felt: before it, and where it leans, uphill.

        Returns:
            Whether something was.
        """
        x, y, yaw = view.pose
        off = _FELT if sum(self._told) >= 0.0 else -_FELT
        felt = x + off * math.cos(yaw), y + off * math.sin(yaw)
        seen = off > 0.0 and _free(view.scan) < _FELT  # such as the frame of a door
        unseen = not seen and not _walls(view, felt, RADIUS)
        if unseen:
            view.ground.feel(view.time, felt)
        roll, pitch = view.lean
        if math.hypot(roll, pitch) > _LEANS:
            uphill = yaw + math.atan2(-roll, pitch)
            for side in (0.0, _BESIDE, -_BESIDE):
                toward = uphill + side
                place = x + _FELT * math.cos(toward), y + _FELT * math.sin(toward)
                view.ground.feel(view.time, place)
        return unseen

    def _rest(self, view: View) -> Powers:
        """What the wheels get while there is nowhere to go: it looks at whom it follows."""
        if (followed := view.ground.followed(view.robot, view.time)) is None:
            return self.at_rest
        x, y, yaw = view.pose
        aim = math.atan2(followed.place[1] - y, followed.place[0] - x)
        error = math.remainder(aim - yaw, math.tau)
        return _steer(error, 0.0) if abs(error) > _LEAST else (0.0, 0.0)

    def _approach(
        self, here: Place, grid: Grid, passable: Cells, followed: Followed, within: float
    ) -> None:
        """Go to the nearest place within so many m of somebody from which it sees them."""
        steps = distances(passable, grid.cell(here))
        part, around = grid.disc(followed.place, within)
        rows, columns = np.nonzero(around & (steps[part] < FAR))
        cells = rows + part[0].start, columns + part[1].start
        far = np.where(grid.sees(cells, followed.place, _IN_SIGHT), steps[cells], FAR)
        self.goal, self._way = None, []
        self.why = f"no way leads to {followed.name}, near whom it is to stay"
        if far.size and far.min() < FAR:
            best = int(np.argmin(far))
            self.go_to(grid, steps, (int(cells[0][best]), int(cells[1][best])))

    def _plan(self, view: View, arrived: bool) -> None:
        """Choose where to go; shut in by what it has felt, it tries that again.

        Who follows somebody and is near enough stays.
        """
        here = view.pose[:2]
        grid = Grid(view.map.cells(), view.map.corner)
        followed = view.ground.followed(view.robot, view.time)
        if followed is not None and _is_with(grid, here, followed):
            self.goal, self._way = None, []
            self.why = f"it is to stay near {followed.name}"
            return
        free = grid.passable(here, RADIUS, unknown=self.unknown)
        ground = view.ground
        for disc in (*ground.people(view.time), *ground.others(view.robot), *ground.risen()):
            room = math.dist(here, disc.place) - 0.1  # who is inside may leave, and come no nearer
            if room > 0.0:
                grid.leave_out(free, disc.place, min(disc.radius + _CLEAR, room))
        clear, cell = free.copy(), grid.cell(here)
        for disc in ground.left():
            grid.leave_out(clear, disc.place, disc.radius + _CLEAR)
        clear[cell] = free[cell] = True
        covered = float(np.count_nonzero(free & ~clear)) * CELL**2
        if space(clear, cell) + covered > _MOST_OF * space(free, cell):
            free = clear  # else it would be shut off by who is not there
        for remembered, around in _REMEMBERED:
            passable = free.copy()
            for place in view.ground.felt(view.time - remembered):
                grid.leave_out(passable, place, around)
            for place in self._came:  # where it has driven, it can drive
                part, there = grid.disc(place, _AS_WIDE)
                passable[part] |= there & free[part]
            passable[grid.cell(here)] = True
            if remembered and space(passable, grid.cell(here)) < _ROOMY:
                continue
            if followed is None:
                self.choose(view, grid, passable)
            else:
                self._approach(here, grid, passable, followed, followed.within - _CLOSE)
            if self.goal is not None:
                return

    def _is_stuck(self, view: View) -> bool:
        """Whether it wants to get on and has not for a while."""
        last, here = self._anchor, view.pose[:2]
        moved = last is None or (
            math.dist(here, last.pose[:2]) > _MOVED[0]
            or abs(math.remainder(view.pose[2] - last.pose[2], math.tau)) > _MOVED[1]
        )
        if self.goal is None:
            self._anchor, self._pushed = view, math.inf
            return False
        if max(map(abs, self._told)) > _IDLE[1] or self._pushed > view.time:
            self._pushed = view.time
        elif view.time - self._pushed > _IDLE[0]:  # something is before it where its way leads
            self._pushed = math.inf
            return True
        self._track.append((view.time, here))
        while self._track[0][0] < view.time - _SLOW[0]:
            self._track.popleft()
            if all(math.dist(here, place) < _SLOW[1] for _, place in self._track):
                return True  # it turns to and fro
        if self._pushes_on(view):
            return True
        if moved:
            self._anchor = view
            return False
        assert last is not None
        if view.time - last.time <= _STUCK:
            return False
        self._anchor = view
        return True

    def _pushes_on(self, view: View) -> bool:
        """Whether it has pushed ahead for long and stayed; it may turn to and fro meanwhile."""
        here, (since, place, pushed) = view.pose[:2], self._push
        if math.dist(here, place) > _MOVED[0]:
            place, pushed = here, 0.0
        else:
            pushed += max(0.0, sum(self._told) / 2.0) * min(view.time - since, _STUCK)
        stuck = pushed > _PUSH
        self._push = view.time, place, 0.0 if stuck else pushed
        return stuck

    def _follow(self, view: View) -> Powers:
        x, y, yaw = view.pose
        nearest = min(range(len(self._way)), key=lambda one: math.dist((x, y), self._way[one]))
        ahead = min(nearest + round(_AHEAD / CELL), len(self._way) - 1)
        aim = self._way[ahead]
        error = math.remainder(math.atan2(aim[1] - y, aim[0] - x) - yaw, math.tau)
        free = _free(view.scan)
        speed = CRUISE * min(max((free - _NEAR) / 0.8, 0.0), 1.0)
        felt = view.ground.felt(view.time - _REMEMBERED[0][0])
        if any(math.dist((x, y), place) < _CAREFUL[0] for place in felt):
            speed = min(speed, _CAREFUL[1])  # at full speed it would be on it before it leans
        return _steer(error, speed)


class Explore(_Traveller):
    """Goes to where the known ends: the nearest frontier that no other robot goes to."""

    name = "explore"

    def __init__(self) -> None:
        super().__init__()
        self._given_up: deque[tuple[float, Place, float]] = deque()

    def blocked(self, view: View) -> None:
        """That frontier cannot be reached; behind what it only feels, those beside it neither."""
        if self.goal is not None:
            climbs = self._unseen or math.hypot(*view.lean) > _LEANS / 3.0
            self._given_up.append((view.time, self.goal, _WIDELY if climbs else _GIVEN_UP))
        self.goal = None

    def choose(self, view: View, grid: Grid, passable: Cells) -> None:
        """The nearest one; one where it already stands shows nothing new and is given up."""
        here = view.pose[:2]
        if self.goal is not None and math.dist(here, self.goal) < _CLOSE:
            self._given_up.append((view.time, self.goal, _GIVEN_UP))
        while self._given_up and view.time - self._given_up[0][0] > _RETRY:
            self._given_up.popleft()
        worth = grid.near(grid.frontier(), 0.5) >= 5
        for _, place, radius in self._given_up:
            grid.leave_out(worth, place, radius)
        cells = np.nonzero(worth)
        if not len(cells[0]):
            self.goal, self._way, self.why = None, [], "all floor that it knows a way to is seen"
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
            self.why = "no way leads to what is not seen yet"


class Search(Explore):
    """Explores; where nothing is left to explore it goes to where no robot was for longest."""

    name = "search"
    at_rest = (0.3, -0.3)  # it looks around: where it came from may be free

    def __init__(self) -> None:
        super().__init__()
        self._again: Place | None = None

    def blocked(self, view: View) -> None:
        """Neither a frontier nor a place to look at again can be reached."""
        super().blocked(view)
        if self._again is not None:
            view.ground.visit(self._again, view.time)
        self._again = None

    def choose(self, view: View, grid: Grid, passable: Cells) -> None:
        """A frontier, or else a place that is worth another look: the same until it is there."""
        super().choose(view, grid, passable)
        if self.goal is not None:
            self._again = None
            return
        here, again = view.pose[:2], self._again
        steps = distances(passable, grid.cell(here))
        if again is not None:
            if math.dist(here, again) > _CLOSE:
                self.go_to(grid, steps, grid.cell(again))
                if self.goal is not None:
                    return
            view.ground.visit(again, view.time)  # it need not stand on it, or no way leads there
        rows, columns = np.nonzero(steps[::_STRIDE, ::_STRIDE] < FAR)
        best, chosen = -math.inf, None
        for row, column in zip(
            (rows * _STRIDE).tolist(), (columns * _STRIDE).tolist(), strict=True
        ):
            place, far = grid.place(row, column), CELL * float(steps[row, column])
            if far < _NEW or any(math.dist(place, one) < 2.5 for one in view.goals.values()):
                continue
            worth = min(view.time - view.ground.visited(place), _OLDEST) - far / _PACE
            if worth > best:
                best, chosen = worth, (row, column)
        if chosen is None:
            self._again, self.why = None, "it is shut in"
        else:
            self.go_to(grid, steps, chosen)
            self._again = self.goal


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
    own: dict[str, type[Policy]] = {one.name: one for one in (Stop, Hold, Explore, Search)}
    if name in own:
        return own[name]()
    for entry in entry_points(group=GROUP):
        if entry.name == name:
            found: Policy = entry.load()()
            return found
    raise ValueError(f"there is no policy {name} (known: {', '.join(names())})")


def names() -> list[str]:
    """All policies, those of other packages included."""
    own = [one.name for one in (Stop, Hold, Patrol, Explore, Search)]
    return own + sorted(one.name for one in entry_points(group=GROUP))


def _meets(view: View, off: float) -> bool:
    """Whether so many m on, or back, it would come too near to somebody."""
    x, y, yaw = view.pose
    there = x + off * math.cos(yaw), y + off * math.sin(yaw)

    def nears(disc: Disc) -> bool:
        far = math.dist(there, disc.place)
        return far < disc.radius + _CLEAR and far < math.dist((x, y), disc.place)

    return any(map(nears, (*view.ground.people(view.time), *view.ground.others(view.robot))))


def _is_with(grid: Grid, here: Place, followed: Followed) -> bool:
    """Whether it is near enough to whom it follows, and sees them."""
    row, column = grid.cell(here)
    cell = np.array([row]), np.array([column])
    near = math.dist(here, followed.place) <= followed.within
    return near and bool(grid.sees(cell, followed.place, _IN_SIGHT)[0])


def _way_out(view: View) -> float:
    """m on, or back, that lead away from somebody too near to turn beside; 0 if there is nobody.

    Robots slide and swing as they stop, so one may come nearer than ways lead.
    """
    x, y, yaw = view.pose
    near = [
        disc
        for disc in view.ground.people(view.time)
        if math.dist((x, y), disc.place) < disc.radius + _SWING
    ]
    for off in (_NEXT, -_NEXT):
        there = x + off * math.cos(yaw), y + off * math.sin(yaw)
        away = all(math.dist(there, one.place) > math.dist((x, y), one.place) for one in near)
        shut = _free(view.scan) < _NEXT if off > 0.0 else _backs_into_wall(view, off)
        if near and away and not shut and not _meets(view, off):
            return off
    return 0.0


def _backs_into_wall(view: View, off: float) -> bool:
    """Whether there is a wall where it would be; what leans has to get down all the same."""
    if math.hypot(*view.lean) > _LEANS:
        return False
    x, y, yaw = view.pose
    return _walls(view, (x + 1.3 * off * math.cos(yaw), y + 1.3 * off * math.sin(yaw)), 0.15)


def _walls(view: View, place: Place, radius: float) -> bool:
    """Whether the map has a wall around a place."""
    grid = Grid(view.map.cells(), view.map.corner)
    part, around = grid.disc(place, radius)
    return bool((around & (grid.cells[part] == WALL)).any())


def _free(scan: readings.LaserScan | None) -> float:
    """m ahead of the scanner in which there is nothing, as wide as the robot; infinite without."""
    if scan is None:
        return math.inf
    across = np.abs(scan.ranges * np.sin(scan.bearings))
    ahead = (across < _HALF) & (np.abs(scan.bearings) < 1.3)
    return float(np.nanmin(np.where(ahead, scan.ranges * np.cos(scan.bearings), np.inf)))


def _steer(error: float, speed: float) -> Powers:
    """Powers that turn by an error of the heading (rad, clockwise) while going on."""
    turn = min(max(1.2 * error, -0.9), 0.9)
    speed *= max(0.0, 1.0 - abs(error) / 0.8)
    if abs(speed) < _LEAST < abs(error):  # what turns on the spot has to overcome its tyres
        turn = math.copysign(max(abs(turn), _LEAST), turn)
    most = max(1.0, abs(speed + turn), abs(speed - turn))
    return (speed + turn) / most, (speed - turn) / most
