"""Robots keep off what is around them, and get to where they can turn."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from usarsim_exploration.known_map import FREE, SAFE, WALL
from usarsim_exploration.levels.rover import Rover
from usarsim_exploration.levels.swerving import Swerve
from usarsim_exploration.localisation.surfaces import Floats
from usarsim_exploration.measures.contacts import HALF

PERIOD = 0.2


def wall(*corners: tuple[float, float]) -> Floats:
    """Points of a line, 2 cm apart."""
    lines = []
    for one, other in itertools.pairwise(corners):
        count = math.ceil(math.dist(one, other) / 0.02) + 1
        lines.append(np.linspace(one, other, count))
    return np.vstack(lines)


def seen(things: Floats, x: float, y: float, heading: float) -> Floats:
    """As the robot sees them, as far as that goes."""
    cosine, sine = math.cos(heading), math.sin(heading)
    away = (things - (x, y)) @ np.array([[cosine, -sine], [sine, cosine]])
    found: Floats = away[np.hypot(*away.T) < 0.85]
    return found


def turn(things: Floats, want: float, seconds: float) -> tuple[float, float]:
    """rad that a robot with lazy wheels has turned in so many s, and m that it stayed away."""
    swerve = Swerve(1, PERIOD)
    x = y = heading = 0.0
    speed = rate = 0.0
    least = math.inf
    for tick in range(round(seconds / 0.02)):
        if tick % 10 == 0:
            to_do = swerve.swerve(0.0, want, seen(things, x, y, heading))
        speed += 0.1 * (to_do[0] - speed)
        rate += 0.1 * (to_do[1] - rate)
        heading += 0.02 * rate
        x, y = x + 0.02 * speed * math.cos(heading), y + 0.02 * speed * math.sin(heading)
        inside = np.abs(seen(things, x, y, heading)) - HALF
        least = min(least, float(inside.max(axis=1).min(initial=math.inf)))
        if abs(heading) > math.pi / 2:
            break
    return abs(heading), least


def test_who_has_room_drives_as_it_wants() -> None:
    """Nothing is near, or nothing that it would touch."""
    swerve = Swerve(1, PERIOD)
    assert swerve.swerve(0.5, 1.0, np.empty((0, 2))) == (0.5, 1.0)
    beside = wall((-1.0, 0.5), (1.0, 0.5))
    assert Swerve(1, PERIOD).swerve(0.5, 0.0, seen(beside, 0.0, 0.0, 0.0)) == (0.5, 0.0)
    around = wall((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5))
    turned, least = turn(around, 2.0, 3.0)
    assert turned > math.pi / 2
    assert least > 0.04


@pytest.mark.parametrize("want", [2.0, -2.0])
def test_beside_a_wall_it_first_gets_to_where_it_can_turn(want: float) -> None:
    """Half its diagonal is 0.42 m: on the spot a corner would run into the wall."""
    turned, least = turn(wall((-3.0, 0.36), (3.0, 0.36)), want, 8.0)
    assert turned > math.pi / 2
    assert least > 0.01


def test_behind_it_something_counts_as_well() -> None:
    """It does not back into a wall, nor swing its tail at it."""
    behind = wall((-0.4, -0.5), (-0.4, 0.5))
    speed, _ = Swerve(1, PERIOD).swerve(-0.2, 0.4, seen(behind, 0.0, 0.0, 0.0))
    assert speed > -0.11
    turned, least = turn(behind, 2.0, 6.0)
    assert turned > math.pi / 2
    assert least > 0.01


def test_it_knows_how_fast_it_is() -> None:
    """Half a second ahead is free for one that stands, not for one that is fast already."""
    ahead = seen(wall((0.62, -0.5), (0.62, 0.5)), 0.0, 0.0, 0.0)
    stands, drives = Swerve(1, PERIOD), Swerve(1, PERIOD)
    for _ in range(5):
        drives.swerve(0.6, 0.0, np.empty((0, 2)))
    assert stands.swerve(0.6, 0.0, ahead) == (0.6, 0.0)
    assert drives.swerve(0.6, 0.0, ahead)[0] < 0.6


def test_who_is_held_for_long_squeezes_through() -> None:
    """As nobody else makes room; the first robots do so first."""
    cage = wall((-0.35, -0.32), (0.35, -0.32), (0.35, 0.32), (-0.35, 0.32), (-0.35, -0.32))
    waited = []
    for number in (1, 4):
        swerve = Swerve(number, PERIOD)
        ticks = 0
        while swerve.swerve(0.0, 2.0, cage) == (0.0, 0.0):
            ticks += 1
            assert ticks < 50
        assert swerve.swerve(0.0, 2.0, cage) == (0.0, 0.7)
        waited.append(ticks)
    assert 10 < waited[0] < waited[1]


def test_it_sees_ahead_by_its_scan_and_behind_by_its_map() -> None:
    """What the scan looks through is not there; what is no wall of the map may come nearer."""
    bits = np.full((40, 40), FREE | SAFE, np.uint8)
    bits[:, 15] = bits[:, 25] = WALL | SAFE  # from 1.5 m and 2.5 m on
    rover: Any = SimpleNamespace(
        pose=(2.0, 2.0, 0.0),
        others=[(0.0, 0.0, 0.3)],
        body=SimpleNamespace(view=SimpleNamespace(known=SimpleNamespace(bits=bits))),
    )
    angles = np.radians(np.arange(-90, 91))
    scan = np.column_stack([0.2 + 3.0 * np.cos(angles), 3.0 * np.sin(angles)])
    scan[90] = 0.75, 0.0
    around = Rover._around(rover, scan, (0.2, 0.0, 0.0), 0.1)
    assert around[around[:, 0] > 0.0].tolist() == [[pytest.approx(0.67), 0.0]]
    behind = around[around[:, 0] < 0.0]
    assert behind[:, 0].max() == pytest.approx(-0.37)
    assert len(behind) > 20
    scan[90] = 0.55, 0.0
    around = Rover._around(rover, scan, (0.2, 0.0, 0.0), 0.1)
    assert around[around[:, 0] > 0.0].tolist() == [[pytest.approx(0.55), 0.0]]
    rover.pose = 2.0, -9.0, 0.0  # who goes by odometry alone may believe that
    assert len(Rover._around(rover, scan, (0.2, 0.0, 0.0), 0.1)) == 1
