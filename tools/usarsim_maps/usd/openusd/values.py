"""Values of a stage as plain Python: attributes, matrices, and what the physics schemas say.

Physics: what collides, what moves, what it weighs.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import Usd, UsdPhysics

from usarsim_maps.meshes.mesh_files import collision_of
from usarsim_maps.scene import Array, Collision

NOW = Usd.TimeCode.EarliestTime()
"""Animated values are taken at their first moment."""


APPROXIMATIONS = {
    "boundingCube": Collision.BOX,
    "boundingSphere": Collision.SPHERE,
    "convexHull": Collision.HULL,
}
"""Others (none, convexDecomposition, meshSimplification, sdf) are left to the builder."""


def matrix(value: Any) -> Array:
    """(4, 4) for column vectors; the library's are for rows."""
    return np.asarray(np.array(value, dtype=float).T)


def array(attribute: Any, *shape: int) -> Array | None:
    """A list of numbers, its first axis of any length; None if there is none of that shape."""
    return numbers(attribute.Get(NOW) if attribute else None, *shape)


def numbers(value: Any, *shape: int) -> Array | None:
    """A value as a list of numbers; None if it is none of that shape.

    Damaged and careless files give attributes values of any type.
    """
    if value is None:
        return None
    try:
        found: Array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        return None
    if found.size == 0:
        found = found.reshape(0, *shape)
    return found if found.shape[1:] == shape and found.ndim == len(shape) + 1 else None


def number(attribute: Any, default: float) -> float:
    """A finite number."""
    value = attribute.Get(NOW) if attribute else None
    if isinstance(value, (int, float)) and math.isfinite(value):
        return float(value)
    return default


def text(prim: Any, name: str) -> str:
    """A string or token of an attribute by name; empty by default."""
    attribute = prim.GetAttribute(name)
    value = attribute.Get(NOW) if attribute else None
    return str(value) if isinstance(value, str) else ""


# ---- physics ---------------------------------------------------------------------------------


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
