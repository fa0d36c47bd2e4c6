"""What the physics schemas of a stage say: what collides, what moves, what it weighs."""

from __future__ import annotations

import math
from typing import Any

from pxr import UsdPhysics

from usarsim_maps.meshes.mesh_files import collision_of
from usarsim_maps.scene import Collision
from usarsim_maps.usd.openusd.stage import NOW, number, text

APPROXIMATIONS = {
    "boundingCube": Collision.BOX,
    "boundingSphere": Collision.SPHERE,
    "convexHull": Collision.HULL,
}
"""Others (none, convexDecomposition, meshSimplification, sdf) are left to the builder."""


def collision(prim: Any) -> Collision:
    """How a visible shape is solid; without any schema it is (item 37).

    The schemas may be applied to the shape or to what it lies in.
    """
    owner = _collider(prim)
    if owner is None:
        return Collision.AUTO
    enabled = UsdPhysics.CollisionAPI(owner).GetCollisionEnabledAttr().Get(NOW)
    if enabled is False:
        return Collision.NONE
    for here in _upwards(prim):
        word = text(here, "physics:approximation")
        if word:
            return APPROXIMATIONS.get(word, Collision.AUTO)
    return Collision.AUTO


def is_collider(prim: Any) -> bool:
    """Whether a shape that is only a guide is a collision shape: by schema or by name."""
    name = prim.GetName().lower()
    return _collider(prim) is not None or collision_of(name) is not None or "collision" in name


def is_moved(prim: Any) -> bool:
    """Whether it is a rigid body that physics moves (item 29)."""
    if not prim.HasAPI(UsdPhysics.RigidBodyAPI):
        return False
    body = UsdPhysics.RigidBodyAPI(prim)
    held = body.GetKinematicEnabledAttr().Get(NOW) is True
    return body.GetRigidBodyEnabledAttr().Get(NOW) is not False and not held


def mass_of(prim: Any, kilograms_per_unit: float) -> float | None:
    """Mass of a body, kg; None if it is not given, which zero means too."""
    if not prim.HasAPI(UsdPhysics.MassAPI):
        return None
    mass = number(UsdPhysics.MassAPI(prim).GetMassAttr(), 0.0) * kilograms_per_unit
    return mass if mass > 0.0 and math.isfinite(mass) else None


def _collider(prim: Any) -> Any | None:
    return next((here for here in _upwards(prim) if here.HasAPI(UsdPhysics.CollisionAPI)), None)


def _upwards(prim: Any) -> list[Any]:
    """A prim and what it lies in."""
    answer = []
    while prim and not prim.IsPseudoRoot():
        answer.append(prim)
        prim = prim.GetParent()
    return answer
