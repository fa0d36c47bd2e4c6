"""Robots that wander about for ever: what the demo shows to somebody who has just arrived.

Each is an ordinary controller with a connection of its own. It drives by its laser: ahead while
there is room, else to the side where there is more; where it gets nowhere it backs off.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import random

from usarsim_client import Robot, connect, readings

ROOM = 0.9
"""m ahead that it wants to be free."""
SPEED = 3.0
"""Wheel speed, rad/s."""
_STUCK = 4.0  # s without getting anywhere after which it backs off
_BACK = 1.5  # s of that


class Wanderer:
    """Decides; knows no socket. seed: of the side to which it turns when it is stuck."""

    def __init__(self, seed: int = 0) -> None:
        self._random = random.Random(seed)
        self._turn = 0.0
        self._from: tuple[float, float, float] | None = None
        self._back = -math.inf

    def steer(
        self, scan: readings.LaserScan, place: tuple[float, float] | None
    ) -> tuple[float, float]:
        """Speeds of the left and the right wheels, rad/s, for what it sees and where it is."""
        time, bearings = scan.time, scan.bearings  # right positive
        if place is not None:
            if self._from is None or math.dist(place, self._from[:2]) > 0.15:
                self._from = *place, time
            elif time - self._from[2] > _STUCK:
                self._back, self._turn = time + _BACK, self._random.choice((-0.5, 0.5))
                self._from = *place, time
        if time < self._back:
            return -SPEED * (0.7 + self._turn), -SPEED * (0.7 - self._turn)
        if scan.ranges[abs(bearings) < 0.5].min(initial=math.inf) > ROOM:
            self._turn = 0.0
            return SPEED, SPEED
        if not self._turn:  # keeps turning to the side that it chose, or corners would hold it
            right, left = (scan.ranges[side * bearings > 0.3].mean() for side in (1, -1))
            self._turn = 0.5 if right > left else -0.5
        return self._turn * SPEED, -self._turn * SPEED


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
