"""People made of primitive shapes, in the parts that victim sensors tell apart.

A victim is one body without joints, `victim:<name>`, fixed in the world and solid. Its geoms are
called `victim:<name>:<Part>...` where the part is one of `PARTS`, the seven groups that a
victim sensor reports (robots reference 2.9), and the rest tells side and piece (`LegUpperLeft`).
Of a victim that moves, the body, or the body `victim:<name>/forearm`, is a mocap body.

Ways of moving as functions of time: a walk to and fro, an arm that waves.
"""

from __future__ import annotations

import hashlib
import math
import random
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import mujoco
import numpy as np

from usarsim_server.simulation.frames import Pose, Quaternion, Vector, quaternion_from_rpy
from usarsim_server.simulation.movers import Mover
from usarsim_server.worlds.description import PARTS, Victim
from usarsim_server.worlds.life import Walk, Wave, traits_of

Way = Callable[[float], Pose]


def walking(start: Vector, walk: Walk) -> Way:
    """To and fro from a place (m) at time 0, facing ahead, turning to the left at both ends."""
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


PELVIS_HEIGHT = {"standing": 0.93, "sitting": 0.12, "lying": 0.12}
"""Height of the reference point above what the victim stands, sits or lies on, m."""

_GEOM_NAME = re.compile(rf"victim:(?P<name>.+):(?P<part>{'|'.join(PARTS)})[A-Za-z]*")

Color = tuple[float, float, float]
T = TypeVar("T")

# Lengths of an adult of 1.70 m, m: hip, knee, ankle and sole add up to the pelvis height.
_HIP = (0.0, 0.09, -0.03)
_THIGH, _CALF, _ANKLE = 0.43, 0.41, 0.06
_UPPER_ARM, _FOREARM, _PALM = 0.28, 0.25, 0.07
_CHEST, _NECK, _HEAD = 0.28, 0.46, 0.64  # distances from the pelvis along the spine

_SKIN: tuple[Color, ...] = (
    (0.94, 0.78, 0.66),
    (0.87, 0.67, 0.52),
    (0.72, 0.51, 0.37),
    (0.55, 0.37, 0.26),
    (0.38, 0.25, 0.18),
)
_SHIRT: tuple[Color, ...] = (
    (0.72, 0.16, 0.15),
    (0.16, 0.36, 0.62),
    (0.20, 0.50, 0.32),
    (0.88, 0.70, 0.22),
    (0.86, 0.86, 0.84),
    (0.45, 0.27, 0.53),
    (0.85, 0.42, 0.16),
    (0.25, 0.52, 0.55),
)
_TROUSERS: tuple[Color, ...] = (
    (0.16, 0.20, 0.32),
    (0.22, 0.22, 0.24),
    (0.38, 0.32, 0.24),
    (0.30, 0.36, 0.44),
)
_HAIR: tuple[Color, ...] = (
    (0.10, 0.08, 0.07),
    (0.28, 0.18, 0.11),
    (0.55, 0.40, 0.20),
    (0.55, 0.53, 0.50),
)
_SHOES: Color = (0.12, 0.11, 0.11)


@dataclass(frozen=True, slots=True)
class _Arm:
    """Directions from shoulder to elbow and from elbow to hand, of the left arm."""

    upper: Vector
    fore: Vector


@dataclass(frozen=True, slots=True)
class _Leg:
    """Directions hip to knee, knee to ankle, heel to toes, of the left leg."""

    thigh: Vector
    calf: Vector
    foot: Vector


@dataclass(frozen=True, slots=True)
class _Posture:
    """Directions in the victim's frame (x forward, y left, z up); limbs come in variants."""

    spine: Vector
    face: Vector
    arms: tuple[_Arm, ...]
    legs: tuple[_Leg, ...]


_STANDING = _Posture(
    spine=(0.02, 0.0, 1.0),
    face=(1.0, 0.0, 0.0),
    arms=(
        _Arm((-0.05, 0.22, -1.0), (0.25, 0.08, -1.0)),
        _Arm((0.05, 0.28, -1.0), (0.9, -0.25, -0.25)),
        _Arm((0.2, 0.75, 0.65), (0.1, -0.15, 1.0)),
    ),
    legs=(
        _Leg((0.03, 0.08, -1.0), (-0.03, 0.03, -1.0), (1.0, 0.2, 0.0)),
        _Leg((0.09, 0.10, -1.0), (-0.09, 0.05, -1.0), (1.0, 0.35, 0.0)),
    ),
)
_SITTING = _Posture(
    spine=(-0.16, 0.0, 1.0),
    face=(1.0, 0.0, 0.1),
    arms=(
        _Arm((-0.5, 0.45, -0.85), (-0.6, 0.3, -0.7)),
        _Arm((0.45, 0.22, -0.9), (1.0, -0.2, 0.15)),
        _Arm((0.25, 0.3, -1.0), (0.9, -0.55, -0.1)),
    ),
    legs=(
        _Leg((1.0, 0.2, 0.05), (1.0, 0.1, -0.08), (0.25, 0.2, 1.0)),
        _Leg((0.85, 0.22, 0.52), (0.75, 0.05, -0.54), (1.0, 0.1, 0.05)),
    ),
)
_LYING = _Posture(
    spine=(-1.0, 0.0, 0.0),
    face=(0.0, 0.0, 1.0),
    arms=(
        _Arm((0.85, 0.45, -0.14), (0.95, 0.2, -0.06)),
        _Arm((-0.1, 1.0, -0.14), (-0.9, 0.35, -0.06)),
        _Arm((0.8, 0.55, -0.12), (0.45, -0.75, 0.42)),
    ),
    legs=(
        _Leg((1.0, 0.16, -0.02), (1.0, 0.1, -0.02), (0.25, 0.45, 1.0)),
        _Leg((0.72, 0.3, 0.55), (0.7, 0.05, -0.62), (1.0, 0.2, 0.1)),
        _Leg((0.85, 0.5, -0.02), (0.9, -0.4, -0.08), (0.5, 0.85, 0.35)),
    ),
)
_POSTURES = {"standing": _STANDING, "sitting": _SITTING, "lying": _LYING}
_WAVING = _Arm((0.15, 0.95, 0.05), (0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True)
class _Looks:
    skin: Color
    shirt: Color
    trousers: Color
    hair: Color
    female: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Figure:
    """One body being filled with geoms."""

    body: mujoco.MjsBody
    prefix: str
    scale: float = 1.0

    def limb(self, piece: str, start: Vector, end: Vector, radius: float, color: Color) -> None:
        self.body.add_geom(
            name=f"{self.prefix}:{piece}",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[value * self.scale for value in (*start, *end)],
            size=[radius * self.scale, 0.0, 0.0],
            rgba=[*color, 1.0],
        )

    def egg(
        self, piece: str, center: Vector, axes: Vector, up: Vector, front: Vector, color: Color
    ) -> None:
        self.body.add_geom(
            name=f"{self.prefix}:{piece}",
            type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
            pos=[value * self.scale for value in center],
            quat=_upright(up, front),
            size=[value * self.scale for value in axes],
            rgba=[*color, 1.0],
        )


def part_of(geom_name: str) -> tuple[str, str] | None:
    """Victim's name and body part of a geom name; None if the geom is no part of a victim."""
    match = _GEOM_NAME.fullmatch(geom_name)
    return (match["name"], match["part"]) if match else None


def add_victim(spec: mujoco.MjSpec, victim: Victim) -> tuple[Mover, ...]:
    """Add one person to a scene.

    Looks and the lie of the limbs are drawn from the name, so they are the same in every run.
    The property `figure` chooses between `male` and `female`; `motion` makes the person move.

    Returns:
        What moves the person; nothing if it keeps still.

    Raises:
        KeyError: if the posture is not one of `POSTURES`.
        WorldError: if a known property cannot be used.
    """
    motion = traits_of(victim).motion
    way = walking(victim.pose.position, motion) if isinstance(motion, Walk) else None
    posture = _POSTURES[victim.posture]
    draw = random.Random(int.from_bytes(hashlib.sha256(victim.name.encode()).digest()[:8], "big"))
    looks = _Looks(
        skin=_pick(draw, _SKIN),
        shirt=_pick(draw, _SHIRT),
        trousers=_pick(draw, _TROUSERS),
        hair=_pick(draw, _HAIR),
        female=victim.properties.get("figure") == "female",
    )
    name = f"victim:{victim.name}"
    body = _add_body(spec, name, way(0.0) if way else victim.pose, way is not None)
    figure = _Figure(body, name, victim.scale)
    _add_trunk(figure, posture, looks)
    movers = [Mover(name, way)] if way else []
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        _add_leg(figure, _pick(draw, posture.legs), side, sign, looks)
        arm = _pick(draw, posture.arms)
        if isinstance(motion, Wave) and side == "Right":
            movers.append(_add_waving_arm(spec, figure, posture, victim.pose, motion, looks))
        else:
            _add_arm(figure, posture, arm, side, sign, looks)
    return tuple(movers)


def _add_body(spec: mujoco.MjSpec, name: str, pose: Pose, mocap: bool) -> mujoco.MjsBody:
    return spec.worldbody.add_body(name=name, pos=pose.position, quat=pose.quaternion, mocap=mocap)


def _add_trunk(figure: _Figure, posture: _Posture, looks: _Looks) -> None:
    up, front = _unit(posture.spine), _unit(posture.face)
    width = 0.88 if looks.female else 1.0
    chest, neck, head = (_along((0, 0, 0), up, at) for at in (_CHEST, _NECK, _HEAD))
    figure.egg("Pelvis", (0, 0, 0), (0.115, 0.165, 0.12), up, front, looks.trousers)
    belly = _along((0, 0, 0), up, 0.12)
    figure.egg("ChestLower", belly, (0.105, 0.15 * width, 0.17), up, front, looks.shirt)
    figure.egg("Chest", chest, (0.118, 0.175 * width, 0.20), up, front, looks.shirt)
    left, right = (_shoulder(posture, sign * (width - 0.12)) for sign in (1.0, -1.0))
    figure.limb("ChestShoulders", left, right, 0.058, looks.shirt)
    figure.limb("HeadNeck", neck, _along(neck, up, 0.12), 0.048, looks.skin)
    figure.egg("Head", head, (0.093, 0.077, 0.118), up, front, looks.skin)
    crown = _along(_along(head, up, 0.028), front, -0.016)
    figure.egg("HeadHair", crown, (0.095, 0.084, 0.105), up, front, looks.hair)
    if looks.female:
        nape = _along(_along(head, up, -0.07), front, -0.045)
        figure.egg("HeadHairLong", nape, (0.06, 0.085, 0.13), up, front, looks.hair)


def _add_leg(figure: _Figure, leg: _Leg, side: str, sign: float, looks: _Looks) -> None:
    hip = _mirrored(_HIP, sign)
    knee = _along(hip, _side(leg.thigh, sign), _THIGH)
    ankle = _along(knee, _side(leg.calf, sign), _CALF)
    foot = _side(leg.foot, sign)
    sole = _along(ankle, _side(leg.calf, sign), _ANKLE - 0.04)
    figure.limb(f"LegUpper{side}", hip, knee, 0.076, looks.trousers)
    figure.limb(f"LegLower{side}", knee, ankle, 0.055, looks.trousers)
    figure.limb(f"Foot{side}", _along(sole, foot, -0.04), _along(sole, foot, 0.15), 0.04, _SHOES)


def _add_arm(
    figure: _Figure, posture: _Posture, arm: _Arm, side: str, sign: float, looks: _Looks
) -> None:
    elbow = _add_upper_arm(figure, posture, arm, side, sign, looks)
    _add_forearm(figure, elbow, _side(arm.fore, sign), side, looks)


def _add_waving_arm(
    spec: mujoco.MjSpec,
    figure: _Figure,
    posture: _Posture,
    pose: Pose,
    wave: Wave,
    looks: _Looks,
) -> Mover:
    """The right arm raised, its forearm a body of its own with the origin in the elbow."""
    elbow = _add_upper_arm(figure, posture, _WAVING, "Right", -1.0, looks)
    x, y, z = (value * figure.scale for value in elbow)
    way = swinging(pose @ Pose((x, y, z)), wave)
    name = f"{figure.prefix}/forearm"
    body = _add_body(spec, name, way(0.0), mocap=True)
    forearm = _Figure(body, figure.prefix, figure.scale)
    _add_forearm(forearm, (0.0, 0.0, 0.0), _side(_WAVING.fore, -1.0), "Right", looks)
    return Mover(name, way)


def _add_upper_arm(
    figure: _Figure, posture: _Posture, arm: _Arm, side: str, sign: float, looks: _Looks
) -> Vector:
    """Returns the elbow."""
    shoulder = _shoulder(posture, sign * (0.9 if looks.female else 1.0))
    elbow = _along(shoulder, _side(arm.upper, sign), _UPPER_ARM)
    figure.limb(f"ArmUpper{side}", shoulder, elbow, 0.05, looks.shirt)
    return elbow


def _add_forearm(figure: _Figure, elbow: Vector, fore: Vector, side: str, looks: _Looks) -> None:
    wrist = _along(elbow, fore, _FOREARM)
    figure.limb(f"ArmLower{side}", elbow, wrist, 0.038, looks.skin)
    across = (0.0, 0.0, 1.0) if abs(fore[2]) < 0.8 else (1.0, 0.0, 0.0)
    palm = _along(wrist, fore, _PALM)
    figure.egg(f"Hand{side}", palm, (0.022, 0.042, 0.085), fore, across, looks.skin)


def _shoulder(posture: _Posture, sign: float) -> Vector:
    spine = _unit(posture.spine)
    x, y, z = _along((0.0, 0.0, 0.0), spine, _NECK - 0.035)
    return (x, y + 0.195 * sign, z)


def _pick(draw: random.Random, choices: tuple[T, ...]) -> T:
    return choices[int(draw.random() * len(choices))]


def _unit(vector: Vector) -> Vector:
    length = math.sqrt(sum(part * part for part in vector))
    return (vector[0] / length, vector[1] / length, vector[2] / length)


def _mirrored(vector: Vector, sign: float) -> Vector:
    return (vector[0], vector[1] * sign, vector[2])


def _side(direction: Vector, sign: float) -> Vector:
    return _unit(_mirrored(direction, sign))


def _along(start: Vector, direction: Vector, distance: float) -> Vector:
    return (
        start[0] + direction[0] * distance,
        start[1] + direction[1] * distance,
        start[2] + direction[2] * distance,
    )


def _upright(up: Vector, front: Vector) -> Quaternion:
    """Orientation whose z axis is `up` and whose x axis is `front`, made square to it."""
    z = np.array(up)
    x = np.array(front) - np.dot(front, z) * z
    x /= np.linalg.norm(x)
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.column_stack([x, np.cross(z, x), z]).ravel())
    w, i, j, k = quaternion.tolist()
    return (w, i, j, k)
