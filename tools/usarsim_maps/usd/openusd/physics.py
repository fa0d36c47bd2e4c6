"""What the physics schemas of a stage say: what collides, what moves, what it weighs."""

from __future__ import annotations

import math
from typing import Any

from pxr import UsdPhysics, UsdShade

from usarsim_maps.meshes.mesh_files import collision_of
from usarsim_maps.scene import Collision
from usarsim_maps.usd.openusd.values import StageValues, upwards

APPROXIMATIONS = {
    "boundingCube": Collision.BOX,
    "boundingSphere": Collision.SPHERE,
    "convexHull": Collision.HULL,
}
"""Others (none, convexDecomposition, meshSimplification, sdf) are left to the builder."""


def collision(prim: Any, values: StageValues) -> Collision:
    """How a visible shape is solid; without any schema it is (worlds 37).

    The schemas may be applied to the shape or to what it lies in.
    """
    owner = _collider(prim)
    if owner is None:
        return Collision.AUTO
    if values.value(UsdPhysics.CollisionAPI(owner).GetCollisionEnabledAttr()) is False:
        return Collision.NONE
    for here in upwards(prim):
        word = values.text(here, "physics:approximation")
        if word:
            return APPROXIMATIONS.get(word, Collision.AUTO)
    return Collision.AUTO


def is_collider(prim: Any) -> bool:
    """Whether a shape that is only a guide is a collision shape: by schema or by name."""
    name = prim.GetName().lower()
    return _collider(prim) is not None or collision_of(name) is not None or "collision" in name


def is_moved(prim: Any, values: StageValues) -> bool:
    """Whether it is a rigid body that physics moves (worlds 29)."""
    if not prim.HasAPI(UsdPhysics.RigidBodyAPI):
        return False
    body = UsdPhysics.RigidBodyAPI(prim)
    held = values.value(body.GetKinematicEnabledAttr()) is True
    return values.value(body.GetRigidBodyEnabledAttr()) is not False and not held


def mass_of(prim: Any, values: StageValues, kilograms_per_unit: float) -> float | None:
    """Mass of a body, kg; None if it is not given, which zero means too."""
    if not prim.HasAPI(UsdPhysics.MassAPI):
        return None
    mass = values.number(UsdPhysics.MassAPI(prim).GetMassAttr(), 0.0) * kilograms_per_unit
    return mass if mass > 0.0 and math.isfinite(mass) else None


def friction_of(prim: Any, values: StageValues) -> float | None:
    """Sliding friction of the physics material of a shape; None if it has none."""
    found = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")[0]
    if not found:
        return None
    for name in ("physics:dynamicFriction", "physics:staticFriction"):
        attribute = found.GetPrim().GetAttribute(name)
        value = values.value(attribute) if attribute and attribute.HasAuthoredValue() else None
        if isinstance(value, float) and 0.0 <= value < 100.0:
            return value
    return None


def _collider(prim: Any) -> Any | None:
    return next((here for here in upwards(prim) if here.HasAPI(UsdPhysics.CollisionAPI)), None)
