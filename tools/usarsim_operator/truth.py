"""Where robots of other controllers truly are, by the scene port: for those who may see it.

Such a robot reports to its own controller only. Its row in the `state` of instructors and viewers
gets its pose from here, in the frame of the wire; operators are never told.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_client import frames
from usarsim_client.scene import Poses, Present
from usarsim_operator.world_clock import age
from usarsim_server.protocol.values import Vector

SOURCE = "Truth"
"""`pose_source` of such a pose."""


@dataclass(slots=True)
class _Seen:
    time: float  # simulated s
    place: Vector  # m
    speed: float  # m/s


class Truth:
    """The newest true poses.

    Attributes:
        time: simulated s of them; 0 before the first.
    """

    def __init__(self) -> None:
        self.time = 0.0
        self._poses: Poses | None = None
        self._came = -math.inf
        self._seen: dict[str, _Seen] = {}

    def take(self, poses: Poses, clock: float) -> None:
        """Keep poses; clock: s of the world's clock."""
        self.time, self._poses, self._came = poses.time, poses, clock

    def forget(self, robot: str) -> None:
        """A robot has left."""
        self._seen.pop(robot, None)

    def row(self, robot: str, present: Present | None, clock: float) -> dict[str, object] | None:
        """What `state` says of where a robot is; None if it is not known.

        Args:
            robot: its name. present: who is there. clock: s of the world's clock.
        """
        poses = self._poses
        if poses is None or present is None or poses.generation != present.generation:
            return None
        row = poses.of(present.find(robot))
        if row is None:
            return None
        place, turned = wire_pose(row)
        return {
            "pose": [round(part, 4) for part in (*place, *turned)],
            "pose_source": SOURCE,
            "pose_age": round(age(self._came, clock), 3),
            "speed": round(self._speed(robot, place, poses.time), 3),
        }

    def _speed(self, robot: str, place: Vector, time: float) -> float:
        seen = self._seen.setdefault(robot, _Seen(time, place, 0.0))
        if time < seen.time:  # the world began anew
            seen.speed = 0.0
        elif (passed := time - seen.time) > 1e-3:
            seen.speed += 0.5 * (math.dist(place, seen.place) / passed - seen.speed)
        seen.time, seen.place = time, place
        return seen.speed


def wire_pose(row: NDArray[np.float32]) -> tuple[Vector, Vector]:
    """Place (m) and roll, pitch, yaw (rad) on the wire of a pose (7,) of the scene port."""
    x, y, z, a, b, c, d = (float(one) for one in row)
    roll = math.atan2(2.0 * (a * b + c * d), 1.0 - 2.0 * (b * b + c * c))
    pitch = math.asin(min(1.0, max(-1.0, 2.0 * (a * c - d * b))))
    yaw = math.atan2(2.0 * (a * d + b * c), 1.0 - 2.0 * (c * c + d * d))
    return frames.flip((x, y, z)), frames.flip((roll, pitch, yaw))
