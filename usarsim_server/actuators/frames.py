"""Frames of links as clients know them (protocol reference 4.7).

GEO announces every link by a frame whose z axis is the axis of its joint, as captured messages
show: a pan axis that points upwards is `{Orientation 3.1415,0.0000,0.0000}` on the body, a tilt
axis that points to the right is `1.5707,0.0000,0.0000` on the pan. What is mounted on a link is
announced in another frame, the link's own, which is parallel to the body while the joints are at
zero; captured poses of cameras on such links have no rotation.
"""

from __future__ import annotations

import math

from usarsim_server.robots.description import ActuatorDescription, LinkDescription
from usarsim_server.simulation.frames import (
    IDENTITY,
    Pose,
    Vector,
    flip_point,
    flip_quaternion,
    quaternion_from_rpy,
    wire_from_pose,
)

__all__ = ["announced_link", "joint_frame"]


def joint_frame(link: LinkDescription) -> Pose:
    """The announced frame of a link, seen from the link's own frame.

    It is turned about x, and only if the axis has a part along x also about the new y.
    """
    x, y, z = flip_point(link.axis)
    roll = math.atan2(-y, z) if y or z else 0.0
    if roll <= -math.pi:
        roll = math.pi
    pitch = math.asin(min(1.0, max(-1.0, x)))
    about_x = Pose(quaternion=flip_quaternion(quaternion_from_rpy(roll, 0.0, 0.0)))
    about_y = Pose(quaternion=flip_quaternion(quaternion_from_rpy(0.0, pitch, 0.0)))
    return about_x @ about_y


def announced_link(
    actuator: ActuatorDescription, index: int, base: Pose = IDENTITY
) -> tuple[Vector, Vector]:
    """Wire location (m) and rotation (rad) of a link relative to its parent, joints at zero.

    Args:
        actuator: the chain.
        index: of the link, from 0.
        base: what links without a parent are relative to is here, seen from the base.
    """
    link = actuator.links[index]
    origin = base if link.parent is None else joint_frame(actuator.links[link.parent])
    return wire_from_pose(origin.inverse() @ link.pose @ joint_frame(link))
