"""A robot that wanders: ahead while there is room, otherwise to the side where there is more.

python examples/wander.py --seconds 60
"""

from __future__ import annotations

import argparse
import asyncio

from usarsim_client import Robot, connect, frames, readings

ROOM = 0.9
"""m ahead that it wants to be free."""
SPEED = 1.2
"""Wheel speed, rad/s."""


def steer(scan: readings.LaserScan) -> tuple[float, float]:
    """Speeds of the left and the right wheels for what the laser sees, rad/s."""
    bearings = scan.bearings  # right positive
    ahead = scan.ranges[abs(bearings) < 0.5]
    if ahead.min() > ROOM:
        return SPEED, SPEED
    right, left = scan.ranges[bearings > 0.3].mean(), scan.ranges[bearings < -0.3].mean()
    return (SPEED, -SPEED) if right > left else (-SPEED, SPEED)


async def wander(robot: Robot, seconds: float) -> None:
    """Drive for so many simulated seconds, and say where."""
    begun: float | None = None
    async for scan in robot.scans():
        begun = scan.time if begun is None else begun
        left, right = steer(scan)
        await robot.drive(left=left, right=right)
        pose = robot.newest(readings.GroundTruth)
        if pose is not None:
            x, y, _ = frames.flip(pose.location)  # as ROS has it: y to the left
            print(f"{scan.time:7.2f} s  x {x:6.2f} m  y {y:6.2f} m", flush=True)
        if scan.time >= begun + seconds:
            break
    await robot.stop()


async def main() -> None:
    """Read the options, come into the world, wander."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=3000)
    parser.add_argument("--robot", default="P3AT", help="class with a laser")
    parser.add_argument("--start", default="RobotStart1", help="start pose")
    parser.add_argument("--seconds", type=float, default=60.0, help="simulated")
    options = parser.parse_args()
    async with connect(options.host, options.port) as server:
        robot = await server.spawn(options.robot, "Wanderer", start=options.start)
        await wander(robot, options.seconds)


if __name__ == "__main__":
    asyncio.run(main())
