"""Robots that wander about for ever: what the demo shows to somebody who has just arrived.

Each is an ordinary controller with a connection of its own. It drives by its laser: ahead while
there is room, else to the side where there is more; where it gets nowhere it backs off.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import random

import numpy as np
from numpy.typing import NDArray

from usarsim_client import Robot, connect, readings

Array = NDArray[np.float64]

ROOM = 0.9
"""m ahead that it wants to be free."""
SPEED = 3.0
"""Wheel speed, rad/s."""
_STUCK = 2.0  # s without getting anywhere after which it backs off
_BACK = 1.0  # s of that
_SPIN = 0.7  # s of turning after it, for each time that it was stuck in a row
_MOST_SPIN = 1.4  # s
_AGAIN = 15.0  # s within which it is stuck at one place
_LEAST = 0.35  # m of room that it needs at least
_GO = 0.5  # s of driving on after that, whatever the laser sees
_AWAY = 0.15  # m that count as getting somewhere
_SEEN = 0.08  # m by which what it sees changes on average where it gets somewhere


class Wanderer:
    """Decides; knows no socket. seed: of the side to which it turns when it is stuck."""

    def __init__(self, seed: int = 0) -> None:
        self._random = random.Random(seed)
        self._turn = 0.0
        self._since = -math.inf
        self._place: tuple[float, float] | None = None
        self._ranges: Array | None = None
        self._stuck_at = -math.inf
        self._tries = 0

    def steer(
        self, scan: readings.LaserScan, place: tuple[float, float] | None
    ) -> tuple[float, float]:
        """Speeds of the left and the right wheels, rad/s, for what it sees and where it is.

        Args:
            scan: what it sees. place: x, y (m); None where nothing tells: then it gets somewhere
                while it drives straight on and what it sees changes.
        """
        time, bearings = scan.time, scan.bearings  # right positive
        if self._got_on(scan, place) or self._since == -math.inf:
            self._since, self._place, self._ranges = time, place, scan.ranges
        elif time - self._since > _STUCK:
            again = time - self._stuck_at < _AGAIN
            self._stuck_at, self._tries = time, self._tries + 1 if again else 1
            freer = self._freer(scan)
            self._turn = freer if self._tries % 3 else self._random.choice((-0.5, 0.5))
            self._since = time + _BACK + self._spin + _GO
        passed = time - self._stuck_at
        if passed < _BACK:
            return -SPEED * (0.7 + self._turn), -SPEED * (0.7 - self._turn)
        if passed < _BACK + self._spin:
            return self._turn * SPEED, -self._turn * SPEED
        if passed < _BACK + self._spin + _GO:
            return SPEED, SPEED
        # Where it was stuck a moment ago it is content with less.
        room = ROOM if passed > _AGAIN else max(_LEAST, ROOM / (1 + self._tries))
        if scan.ranges[abs(bearings) < 0.5].min(initial=math.inf) > room:
            self._turn = 0.0
            return SPEED, SPEED
        if not self._turn:  # keeps turning to the side that it chose, or corners would hold it
            self._turn = self._freer(scan)
        return self._turn * SPEED, -self._turn * SPEED

    def _freer(self, scan: readings.LaserScan) -> float:
        """The side where there is more room: a half to the right, or minus a half."""
        right, left = (scan.ranges[side * scan.bearings > 0.3].mean() for side in (1, -1))
        return 0.5 if right > left else -0.5

    @property
    def _spin(self) -> float:
        return min(_MOST_SPIN, _SPIN * self._tries)

    def _got_on(self, scan: readings.LaserScan, place: tuple[float, float] | None) -> bool:
        if scan.time < self._since:  # it frees itself, or the world began anew
            return scan.time < self._stuck_at
        if place is not None and self._place is not None:
            return math.dist(place, self._place) > _AWAY
        if self._turn or self._ranges is None or len(self._ranges) != len(scan.ranges):
            return False
        return float(np.abs(scan.ranges - self._ranges).mean()) > _SEEN


async def wander(robot: Robot, seed: int) -> None:
    """Drive until the server ends."""
    wanderer = Wanderer(seed)
    async for scan in robot.scans():
        pose = robot.newest(readings.GroundTruth)
        place = None if pose is None else (pose.location[0], pose.location[1])
        left, right = wanderer.steer(scan, place)
        await robot.drive(left=left, right=right)


async def main() -> None:
    """Read the options, come into the world, wander."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--robot", action="append", default=[], metavar="CLASS=NAME")
    options = parser.parse_args()
    async with connect("127.0.0.1", options.port) as server, asyncio.TaskGroup() as group:
        # The last places: the first ones are those of who comes to drive.
        starts: list[str | None] = [one.tag for one in reversed(await server.start_poses())]
        for seed, text in enumerate(options.robot):
            kind, _, name = text.partition("=")
            robot = await server.spawn(
                kind, name, start=starts[seed % len(starts)] if starts else None
            )
            group.create_task(wander(robot, seed))
    raise SystemExit("the server has ended")


if __name__ == "__main__":
    asyncio.run(main())
