"""Doors, belts, lifts and obstacles as bodies of a scene.

What goes its own way is a placed body; a door that is pushed open hangs in a hinge with a spring;
a belt is a piece of the scenery whose surface moves. Nothing of that touches the fixed scenery, so
a leaf may slide into a wall and a platform may fill its shaft.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import mujoco

from usarsim_server.base import errors
from usarsim_server.base.errors import WorldError
from usarsim_server.simulation.frames import Pose, Vector, quaternion_from_rpy
from usarsim_server.worlds.machinery.machinery import Belt, Door, Lift, Machinery, Obstacle, Spring

SUBSTANCES = {
    "wood": (0.72, 0.54, 0.36, 1.0),
    "metal": (0.55, 0.57, 0.60, 1.0),
    "steel": (0.62, 0.64, 0.67, 1.0),
    "glass": (0.70, 0.82, 0.88, 0.35),
    "plastic": (0.85, 0.55, 0.15, 1.0),
    "rubber": (0.16, 0.16, 0.17, 1.0),
    "concrete": (0.62, 0.62, 0.62, 1.0),
    "cardboard": (0.76, 0.58, 0.38, 1.0),
}
"""Colours of substances that the scene has no material for."""

GAP = 0.01
"""m between a leaf and what is around it."""
GRIP = 1.0
"""Friction of what one stands on: as of floors, so that wheels decide."""
SMOOTH = 0.5
"""Friction of what one runs into: as of walls."""
POLISH = 0.2
"""Friction of a leaf that is pushed open, whatever pushes it; else driven wheels climb it."""


@dataclass(frozen=True, slots=True)
class Leaf:
    """One leaf of a door."""

    body: str  # name of its body
    frame: Pose  # pose of the body in the world while the door is closed
    middle: Vector  # of the leaf, in the frame of its body, m
    half: Vector  # half its extents, m
    sign: float  # 1 if it slides along y, or turns to the left, when it opens; otherwise -1
    sliding: bool  # whether it slides

    def at(self, opening: float) -> Pose:
        """Pose of its body when the door is open so far (m or rad)."""
        if self.sliding:
            return self.frame @ Pose((0.0, self.sign * opening, 0.0))
        turn = quaternion_from_rpy(0.0, 0.0, self.sign * opening)
        return self.frame @ Pose((0.0, 0.0, 0.0), turn)


def leaves_of(door: Door) -> tuple[Leaf, ...]:
    """The leaves of a door, the left one first."""
    width = door.width / door.leaves
    half = (door.thickness / 2.0, width / 2.0 - GAP / 2.0, (door.height - GAP) / 2.0)
    rise = GAP + half[2]
    if door.leaves == 1:
        return (_leaf(door, door.name, door.left, half, rise, 0.0),)
    return tuple(
        _leaf(door, f"{door.name}_{side}", side == "left", half, rise, sign * width / 2.0)
        for side, sign in (("left", 1.0), ("right", -1.0))
    )


def _leaf(door: Door, body: str, left: bool, half: Vector, rise: float, middle: float) -> Leaf:
    """A leaf in the left or right half of its doorway, or the whole of it."""
    side = 1.0 if left else -1.0
    if door.sliding:
        frame = door.pose @ Pose((0.0, middle, 0.0))
        return Leaf(body, frame, (0.0, 0.0, rise), half, side, sliding=True)
    reach = door.width / door.leaves / 2.0
    frame = door.pose @ Pose((0.0, middle + side * reach, 0.0))
    return Leaf(body, frame, (0.0, -side * reach, rise), half, side, sliding=False)


def add_machinery(spec: mujoco.MjSpec, machinery: Machinery, folder: Path, scene: str) -> None:
    """Put all machinery of a world into its scene.

    Args:
        spec: of the scene.
        machinery: of the world.
        folder: of the world, for errors.
        scene: name of the scene's file, for errors.

    Raises:
        WorldError: if the scene has a body or geom of that name already, or if nobody knows what
            a material looks like.
        ValueError: if MuJoCo refuses something else.
    """
    place = _Place(spec, folder, scene)
    for number, door in enumerate(machinery.doors, start=1):
        material = place.material(door.material, f"[[door]] {number}")
        for leaf in leaves_of(door):
            place.check_name(leaf.body, f"[[door]] {number}")
            _add_leaf(spec, door, leaf, material)
    for number, belt in enumerate(machinery.belts, start=1):
        material = place.material(belt.material, f"[[belt]] {number}")
        place.check_name(belt.geom, f"[[belt]] {number}")
        _add_belt(spec, belt, material)
    for number, lift in enumerate(machinery.lifts, start=1):
        material = place.material(lift.material, f"[[lift]] {number}")
        place.check_name(lift.name, f"[[lift]] {number}")
        _add_lift(spec, lift, material)
    for number, obstacle in enumerate(machinery.obstacles, start=1):
        material = place.material(obstacle.material, f"[[obstacle]] {number}")
        place.check_name(obstacle.name, f"[[obstacle]] {number}")
        _add_obstacle(spec, obstacle, material)


def _add_leaf(spec: mujoco.MjSpec, door: Door, leaf: Leaf, material: str) -> None:
    spring = door.mechanism if isinstance(door.mechanism, Spring) else None
    body = _add_body(spec, leaf.body, leaf.frame, placed=spring is None)
    geom = body.add_geom(
        name=leaf.body,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=leaf.middle,
        size=leaf.half,
        material=material,
        friction=[SMOOTH, 0.005, 0.0001],
    )
    if spring is None:
        return
    geom.mass = spring.mass
    geom.friction = [POLISH, 0.005, 0.0001]
    geom.priority = 1
    # MuJoCo puts to sleep what stands still, even if a spring is about to move it.
    body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_NEVER
    far = leaf.sign * door.travel
    if spec.compiler.degree:
        far = math.degrees(far)
    body.add_joint(
        name=leaf.body,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=(0.0, 0.0, 1.0),
        limited=True,
        range=(-abs(far), abs(far)) if spring.both_ways else (min(0.0, far), max(0.0, far)),
        stiffness=spring.stiffness,
        damping=spring.damping,
    )


def _add_belt(spec: mujoco.MjSpec, belt: Belt, material: str) -> None:
    length, width, thickness = belt.size
    middle = belt.pose @ Pose((0.0, 0.0, -thickness / 2.0))
    spec.worldbody.add_geom(
        name=belt.geom,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=middle.position,
        quat=middle.quaternion,
        size=(length / 2.0, width / 2.0, thickness / 2.0),
        material=material,
        friction=[belt.friction, 0.005, 0.0001],
    ).surfacevel = [belt.speed, 0.0, 0.0, 0.0, 0.0, 0.0]


def _add_lift(spec: mujoco.MjSpec, lift: Lift, material: str) -> None:
    turn = quaternion_from_rpy(0.0, 0.0, lift.yaw)
    length, width, thickness = lift.size
    _add_body(spec, lift.name, Pose(lift.stops[0], turn), placed=True).add_geom(
        name=lift.name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=(0.0, 0.0, -thickness / 2.0),
        size=(length / 2.0, width / 2.0, thickness / 2.0),
        material=material,
        friction=[GRIP, 0.005, 0.0001],
    )


def _add_obstacle(spec: mujoco.MjSpec, obstacle: Obstacle, material: str) -> None:
    yaw = obstacle.yaw
    if obstacle.ahead:
        (x, y, _), (there_x, there_y, _) = obstacle.points[:2]
        yaw = math.atan2(there_y - y, there_x - x)
    turn = quaternion_from_rpy(0.0, 0.0, yaw)
    x, y, z = (edge / 2.0 for edge in obstacle.size)
    types = mujoco.mjtGeom
    shapes = {
        "box": (types.mjGEOM_BOX, (x, y, z)),
        "cylinder": (types.mjGEOM_CYLINDER, (max(x, y), z, 0.0)),
        "sphere": (types.mjGEOM_ELLIPSOID, (x, y, z)),
    }
    kind, size = shapes[obstacle.shape]
    _add_body(spec, obstacle.name, Pose(obstacle.points[0], turn), placed=True).add_geom(
        name=obstacle.name,
        type=kind,
        pos=(0.0, 0.0, z),
        size=size,
        material=material,
        friction=[SMOOTH, 0.005, 0.0001],
    )


def _add_body(spec: mujoco.MjSpec, name: str, pose: Pose, *, placed: bool) -> mujoco.MjsBody:
    body = spec.worldbody.add_body(name=name, pos=pose.position, quat=pose.quaternion, mocap=placed)
    spec.add_exclude(bodyname1="world", bodyname2=name)
    return body


@dataclass(frozen=True, slots=True)
class _Place:
    """A scene that machinery is put into."""

    spec: mujoco.MjSpec
    folder: Path  # of the world
    scene: str  # name of its file

    def check_name(self, name: str, place: str) -> None:
        """Refuse a name that something in the scene has."""
        spec = self.spec
        if spec.body(name) is None and spec.geom(name) is None and spec.joint(name) is None:
            return
        problem = f"{name!r} is already the name of something in {self.scene}"
        raise self._refusal(problem, "write another name", f"{place}: name")

    def material(self, name: str, place: str) -> str:
        """The name of a material, which is added if the scene has none but it is known."""
        spec = self.spec
        if spec.material(name) is None:
            if name not in SUBSTANCES:
                known = sorted({*SUBSTANCES, *(one.name for one in spec.materials if one.name)})
                cure = f"write one of {', '.join(known)}, or add the material to {self.scene}"
                problem = f"nobody knows what {name!r} looks like"
                raise self._refusal(problem, cure, f"{place}: material")
            spec.add_material(name=name, rgba=SUBSTANCES[name])
        return name

    def _refusal(self, problem: str, cure: str, where: str) -> WorldError:
        return WorldError(errors.at(self.folder / "world.toml", problem, cure, where=where))
