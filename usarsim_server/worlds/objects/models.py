"""From a class of objects to a body in the physics, at any scale.

A piece that stays what it is when it is stretched (a box along its axes, a ball into an
ellipsoid) is one of MuJoCo's own shapes; everything else becomes a convex mesh.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Vector
from usarsim_server.simulation.model import RobotModel
from usarsim_server.worlds.objects.classes import Material, ObjectClass, Part

__all__ = ["LARGEST_RIGID", "object_model", "object_size"]

Array = NDArray[np.float64]

LARGEST_RIGID = 5.0
"""m: a rigid body that is larger would touch its neighbours where free slots are parked."""

SEGMENTS = 32
"""Corners of a round piece that has become a mesh."""
RINGS = 8

CONTACT_SOLREF = (0.02, 1.0)
CONTACT_SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)
"""As robots and scenery have them (robots reference 4.10)."""


def object_size(kind: ObjectClass, scale: Vector) -> Vector:
    """Extents (m) of an object of a class at a scale."""
    x, y, z = (extent * factor for extent, factor in zip(kind.size, scale, strict=True))
    return x, y, z


def object_model(
    kind: ObjectClass, scale: Vector, rigid: bool, material: Material | None = None
) -> RobotModel:
    """The body of an object as the simulation wants it.

    Args:
        kind: its class.
        scale: factors along the axes of the class, all above 0.
        rigid: forces move it; otherwise it stays where it is put, or goes its own way.
        material: looks that replace the class's own.
    """
    look = "" if material is None else material.name.lower()
    key = f"object:{kind.name}:{','.join(map(repr, scale))}:{look}:{'rigid' if rigid else 'placed'}"
    return RobotModel(
        key=key,
        build=_builder(kind, scale, rigid, material),
        driven=(),
        rest_height=object_size(kind, scale)[2] / 2.0,
        kinematic=not rigid,
        robot=False,
    )


def _builder(
    kind: ObjectClass, scale: Vector, rigid: bool, material: Material | None
) -> Callable[[], mujoco.MjSpec]:
    def build() -> mujoco.MjSpec:
        spec = mujoco.MjSpec()
        base = spec.worldbody.add_body(name="base", mocap=not rigid)
        if rigid:
            base.add_freejoint(name="free")
        if material is not None:
            spec.add_material(name=material.name, rgba=[*material.color, material.opacity])
        volumes = [_volume(part) for part in kind.parts]
        mass = kind.mass * math.prod(scale)
        for number, part in enumerate(kind.parts):
            geom = _add_part(spec, base, part, scale, f"part{number}")
            geom.mass = mass * volumes[number] / sum(volumes)
            _finish(geom, kind, part, material)
        return spec

    return build


def _finish(geom: mujoco.MjsGeom, kind: ObjectClass, part: Part, material: Material | None) -> None:
    geom.friction = [kind.friction, 0.005 + kind.rolling, 0.0001 + kind.rolling]
    # Rolling resistance needs all six dimensions of a contact.
    geom.condim = 6 if kind.rolling else 3
    geom.solref, geom.solimp = CONTACT_SOLREF, CONTACT_SOLIMP
    if material is None:
        geom.rgba = [*(part.color or kind.color), 1.0]
    else:
        geom.material = material.name


def _add_part(
    spec: mujoco.MjSpec, base: mujoco.MjsBody, part: Part, scale: Vector, name: str
) -> mujoco.MjsGeom:
    size, factors = np.array(part.size), np.array(scale)
    kind = _own_shape(part, factors)
    if kind is None:
        points = _points(part) @ part.pose.matrix().T + np.array(part.pose.position)
        spec.add_mesh(name=name, uservert=(points * factors).ravel())
        return base.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
    half = size * factors / 2.0
    return base.add_geom(
        type=kind,
        size=[half[0], half[2], 0.0] if kind == mujoco.mjtGeom.mjGEOM_CYLINDER else half,
        pos=np.array(part.pose.position) * factors,
        quat=part.pose.quaternion,
    )


def _own_shape(part: Part, factors: Array) -> int | None:
    """MuJoCo's shape for a piece at a scale; None if only a mesh will do."""
    types = mujoco.mjtGeom
    even = np.allclose(factors, factors[0], rtol=1e-9)
    straight = abs(part.pose.quaternion[0]) > 1.0 - 1e-12
    if not (even or straight):
        return None
    size = np.array(part.size) * factors
    match part.shape:
        case "box":
            return int(types.mjGEOM_BOX)
        case "sphere":
            round_ = np.allclose(size, size[0], rtol=1e-9)
            return int(types.mjGEOM_SPHERE if round_ else types.mjGEOM_ELLIPSOID)
        case "cylinder" if math.isclose(size[0], size[1], rel_tol=1e-9):
            return int(types.mjGEOM_CYLINDER)
    return None


def _points(part: Part) -> Array:
    """Corners (n, 3) of a piece about its centre."""
    half = np.array(part.size) / 2.0
    angles = np.linspace(0.0, math.tau, SEGMENTS, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    match part.shape:
        case "box":
            unit = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
        case "wedge":
            unit = np.array(
                [[x, y, z] for x, z in ((-1, -1), (1, -1), (1, 1)) for y in (-1, 1)], dtype=float
            )
        case "cylinder":
            unit = np.concatenate([_lift(ring, -1.0), _lift(ring, 1.0)])
        case "cone":
            unit = np.concatenate([_lift(ring, -1.0), [[0.0, 0.0, 1.0]]])
        case _:
            heights = np.linspace(-math.pi / 2, math.pi / 2, RINGS + 1)[1:-1]
            rings = [_lift(ring * math.cos(height), math.sin(height)) for height in heights]
            unit = np.concatenate([*rings, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])
    points: Array = unit * half
    return points


def _lift(ring: Array, height: float) -> Array:
    return np.column_stack([ring, np.full(len(ring), height)])


def _volume(part: Part) -> float:
    """m^3, unscaled."""
    share = {"box": 1.0, "sphere": math.pi / 6, "cylinder": math.pi / 4, "cone": math.pi / 12}
    return math.prod(part.size) * share.get(part.shape, 0.5)
