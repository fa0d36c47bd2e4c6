"""Ways of moving as functions of time: a walk to and fro, an arm that waves."""

from __future__ import annotations

import math
from collections.abc import Callable

from usarsim_server.simulation.frames import Pose, Vector, quaternion_from_rpy
from usarsim_server.worlds.life import Walk, Wave

__all__ = ["swinging", "walking"]

Way = Callable[[float], Pose]


def walking(start: Vector, walk: Walk) -> Way:
    """To and fro between two places, facing ahead, turning round to the left at both ends.

    Args:
        start: where the walk begins at time 0, m.
        walk: the rest of it.
    """
    x, y, z = start
    dx, dy, dz = (end - begin for end, begin in zip(walk.to, start, strict=True))
    leg = math.dist(start, walk.to) / walk.speed
    half = leg + walk.pause
    heading = math.atan2(dy, dx)

    def pose(time: float) -> Pose:
        lap, phase = divmod(time, half)
        outward = lap % 2 == 0
        done = min(phase / leg, 1.0)
        share = done if outward else 1.0 - done
        turned = max(0.0, phase - leg) / walk.pause
        yaw = heading + math.pi * (turned if outward else 1.0 + turned)
        place = (x + dx * share, y + dy * share, z + dz * share)
        return Pose(place, quaternion_from_rpy(0.0, 0.0, yaw))

    return pose


def swinging(joint: Pose, wave: Wave) -> Way:
    """Like a pendulum about the x axis of a fixed pose; the z axis first swings toward -y."""

    def pose(time: float) -> Pose:
        angle = wave.angle * math.sin(math.tau * time / wave.period)
        swing = (math.cos(angle / 2), math.sin(angle / 2), 0.0, 0.0)
        return joint @ Pose((0.0, 0.0, 0.0), swing)

    return pose
