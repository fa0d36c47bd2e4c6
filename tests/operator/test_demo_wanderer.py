"""The demo's wanderer gets on wherever it is put, in simulated time on a drawn plan."""

from __future__ import annotations

import math

import pytest
from lanes import slow_but
from toy_world import FAR, Plan, Toy

from usarsim_client import readings
from usarsim_client.decoder import decode
from usarsim_operator.wanderer import SPEED, Wanderer

LONGEST = 10.0
"""Simulated s that it may stand."""
LENGTH = 60.0
"""Simulated s of each try."""
NEAR = 0.1
"""m within which it counts as standing."""

ROOMS = Plan(
    """
    ###########
    #....#....#
    #....#....#
    #.........#
    #....#....#
    ###.####.##
    #.........#
    #..#......#
    ###########
    """
)
NICHE = Plan(
    """
    #######
    #.....#
    ##.#..#
    ##.##.#
    #######
    """,
    10,
)
GLASS = "glass"
"""Walls that its laser does not see."""


def longest_stand(plan: Plan, x: float, y: float, yaw: float, sees: str, seed: int) -> float:
    """s that it stood at most; sees: `all`, `no pose`, or walls of `glass`."""
    toy, wanderer = Toy(plan, x, y, yaw), Wanderer(seed)
    since = last = (0.0, x, y)
    most = 0.0
    while toy.time < LENGTH:
        line = toy.scan_line()
        if sees == GLASS:
            head, _, rest = line.partition("{Range ")
            count = rest.count(",") + 1
            line = f"{head}{{Range {','.join([str(FAR)] * count)}}}"
        (scan,) = decode(line.encode(), toy.time)
        assert isinstance(scan, readings.LaserScan)
        place = None if sees == "no pose" else (toy.x, toy.y)
        left, right = wanderer.steer(scan, place)
        toy.left, toy.right = left / SPEED, right / SPEED
        toy.step()
        last = (toy.time, toy.x, toy.y)
        if math.dist(last[1:], since[1:]) > NEAR:
            since = last
        most = max(most, last[0] - since[0])
    return most


@pytest.mark.parametrize("sees", ["all", "no pose", GLASS])
@pytest.mark.parametrize("seed", slow_but((1).__eq__, [1, 2]))
@pytest.mark.parametrize(
    ("plan", "x", "y", "yaw"),
    [
        (ROOMS, 1.0, 1.0, 0.5),
        (ROOMS, 4.5, 3.3, -1.6),
        (NICHE, 2.5, 3.2, 1.57),
        (NICHE, 5.4, 3.4, 0.8),
    ],
    ids=["room", "corner", "niche", "alley"],
)
def test_it_never_stands_for_long(
    plan: Plan, x: float, y: float, yaw: float, sees: str, seed: int
) -> None:
    """At walls, in corners and niches, with and without a place, and where its laser is blind."""
    assert longest_stand(plan, x, y, yaw, sees, seed) <= LONGEST
