"""Poses in the plane: x and y, m, and heading, rad."""

from __future__ import annotations

import math

Pose = tuple[float, float, float]
"""x, y, m; heading, rad."""
Disc = tuple[float, float, float]
"""Something round that is no wall, such as another robot: x, y and radius, m."""


def compose(pose: Pose, motion: Pose) -> Pose:
    """Where a motion leads from a pose; the motion is as the pose sees it."""
    x, y, heading = pose
    cosine, sine = math.cos(heading), math.sin(heading)
    return (
        x + cosine * motion[0] - sine * motion[1],
        y + sine * motion[0] + cosine * motion[1],
        wrap(heading + motion[2]),
    )


def relative(pose: Pose, other: Pose) -> Pose:
    """The motion from a pose to another one, as the first one sees it: undoes `compose`."""
    x, y = other[0] - pose[0], other[1] - pose[1]
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    return cosine * x + sine * y, cosine * y - sine * x, wrap(other[2] - pose[2])


def wrap(angle: float) -> float:
    """The same direction, rad, in (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)
