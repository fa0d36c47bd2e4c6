"""How limbs swing when somebody walks: a pure function of the way walked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.worlds.avatars.models import ADULT, LIMBS, SHIN, SOLE, THIGH, joint_of

__all__ = ["RUNNING", "STANDING", "WALKING", "Gait", "Posture", "limb_poses", "posture"]

Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Gait:
    """How far limbs swing (rad) in a kind of walking.

    Attributes:
        stride: m of way for two steps, of an adult of 1.70 m.
        thigh: to both sides. knee: bent most when the leg comes forward.
        arm: to both sides. elbow: bent all the time.
    """

    stride: float
    thigh: float
    knee: float
    arm: float
    elbow: float


STANDING = Gait(stride=1.0, thigh=0.0, knee=0.0, arm=0.0, elbow=0.0)
WALKING = Gait(stride=1.40, thigh=0.35, knee=0.75, arm=0.35, elbow=0.25)
RUNNING = Gait(stride=2.40, thigh=0.65, knee=1.35, arm=0.75, elbow=1.40)


@dataclass(frozen=True, slots=True)
class Posture:
    """Angles of the joints, rad, forward positive, and how far the hips sink.

    Attributes:
        angles: by limb, relative to what it hangs on.
        sink: m that the pelvis is lower than when the legs are straight.
    """

    angles: Mapping[str, float]
    sink: float


def posture(gait: Gait, way: float, swing: float, height: float) -> Posture:
    """The posture after a way.

    Args:
        gait: how the person walks.
        way: m walked so far, negative backwards.
        swing: how far into the gait, from 0 (standing) to 1.
        height: of the person, m.
    """
    scale = height / ADULT
    phase = math.tau * way / (gait.stride * scale)
    angles: dict[str, float] = {}
    lowest = 0.0
    for side, lag in (("left", 0.0), ("right", math.pi)):
        leg = swing * gait.thigh * math.sin(phase + lag)
        # The knee bends while the thigh comes forward, and the leg is straight while it carries.
        knee = swing * gait.knee * max(0.0, math.cos(phase + lag)) ** 2
        angles[f"thigh_{side}"] = leg
        angles[f"shin_{side}"] = -knee
        angles[f"upper_arm_{side}"] = swing * gait.arm * math.sin(phase + lag + math.pi)
        angles[f"forearm_{side}"] = swing * gait.elbow
        reach = THIGH * math.cos(leg) + (SHIN + SOLE) * math.cos(leg - knee)
        lowest = max(lowest, reach)
    return Posture(angles, scale * (THIGH + SHIN + SOLE - lowest))


def limb_poses(base: Pose, held: Posture, height: float) -> list[Pose]:
    """Poses of all bodies of an avatar in the world, the trunk first."""
    poses = [base]
    above = base
    for limb in LIMBS:
        hangs_on = base if limb.startswith(("thigh", "upper")) else above
        above = hangs_on @ Pose(joint_of(limb, height), _forward(held.angles[limb]))
        poses.append(above)
    return poses


def _forward(angle: float) -> Quaternion:
    """Turns what hangs down forward, about the -y axis."""
    return (math.cos(angle / 2.0), 0.0, -math.sin(angle / 2.0), 0.0)


def bone_rotation(angle: float) -> Vector:
    """Roll, pitch, yaw (rad, wire frame) of a limb that swings forward, relative to the body.

    A limb that hangs down and swings forward is raised: its pitch is positive.
    """
    return 0.0, angle, 0.0
