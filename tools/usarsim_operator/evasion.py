"""Gets robots out of the way of people who walk: they do not stop for a robot."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import repeat

from usarsim_operator.navigation import UNKNOWN, WALL, Grid, Place
from usarsim_operator.view import View

Powers = tuple[float, float]
"""Of the left and the right wheels, -1 to 1."""

_CLOSE = 5.0  # m at which who walks matters
_ENOUGH = 0.25  # m from who walks to the middle of a robot, beside how far they reach
_BODY = 0.25  # m around its middle in which no wall is
_SOON, _AHEAD = 2.5, 4.0  # s in which it would meet them, and for which ways are compared
_STEP = 0.25  # s between two places of a way
_LATER = 2.0, 4.0, 6.0, 8.0  # s after the end of a way at which nobody is to come there
_FAST, _TURNS = 0.7, 2.0  # m/s, and rad/s, of a robot at full power
_WAYS = tuple(
    (math.radians(degrees), ahead)
    for degrees in (0.0, 40.0, -40.0, 80.0, -80.0)
    for ahead in (0.0, -1.0, 1.0)
)
"""How far it turns, rad, and how it goes on."""


def evade(view: View, wanted: Powers) -> Powers:
    """What the wheels get: what they are to get, unless somebody would walk into the robot.

    Then it goes the way on which they leave it most room, now and later.
    """
    here, now = view.pose[:2], view.time
    walkers = [
        one for one in view.ground.walkers(now) if math.dist(one.place, here) < _CLOSE + one.radius
    ]
    if not walkers:
        return wanted
    grid = Grid(view.map.cells(), view.map.corner)
    still = (*view.ground.still(now), *view.ground.others(view.robot))

    def shut(place: Place, since: Place) -> bool:
        part, around = grid.disc(place, _BODY)
        if grid.cells[grid.cell(place)] == UNKNOWN or (around & (grid.cells[part] == WALL)).any():
            return True
        return any(
            math.dist(place, one.place) < min(one.radius + _ENOUGH, math.dist(since, one.place))
            for one in still
        )

    def room(way: Iterator[Powers], most: float) -> tuple[float, float]:
        """The least while it goes, and the least at its end later on."""
        (x, y, yaw), least = view.pose, math.inf
        for count in range(round(most / _STEP)):
            left, right = next(way)
            yaw += _TURNS * (left - right) / 2.0 * _STEP
            far = _FAST * (left + right) / 2.0 * _STEP
            there = x + far * math.cos(yaw), y + far * math.sin(yaw)
            if far and not shut(there, (x, y)):
                x, y = there
            least = min(least, left_to((x, y), (count + 1) * _STEP))
        return least, min(left_to((x, y), most + later) for later in _LATER)

    def left_to(place: Place, after: float) -> float:
        discs = (one.disc(after) for one in walkers)
        return min(math.dist(place, one.place) - one.radius for one in discs)

    if room(repeat(wanted), _SOON)[0] >= _ENOUGH:
        return wanted

    def worth(way: tuple[float, float]) -> float:
        """Of a way; those that turn and go less come first among equals."""
        return sum(min(one, _ENOUGH) for one in room(_powers(*way), _AHEAD))

    return next(_powers(*max(_WAYS, key=worth)))


def _powers(turn: float, ahead: float) -> Iterator[Powers]:
    """Turn on the spot by so many rad, then go on."""
    yield from repeat(
        (math.copysign(1.0, turn), -math.copysign(1.0, turn)),
        round(abs(turn) / (_TURNS * _STEP)),
    )
    yield from repeat((ahead, ahead))
