"""What moves as one piece: the visible geoms of a body, of what is fixed to it, of its wheels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from usarsim_server.simulation.frames import Array, rotation_matrix
from usarsim_server.simulation.mailbox import yield_interpreter

BODIES_AT_A_TIME = 32
"""Bodies between two pauses."""
EXACT = 1e-6
"""m by which a geom may be off the axis, and deviation of a unit vector from it."""


@dataclass(frozen=True, slots=True, eq=False)
class RigidGroup:
    """Geoms that look rigid, in the frame of one body.

    Bodies without joints of their own are one piece with their parents. So is a wheel: a body that
    turns about an axis around which all its visible geoms are round looks the same however far it
    has turned. Rays then need not look at each wheel of each robot.

    Attributes:
        body: the body.
        geoms: g geom ids.
        places: (g, 3) m. turns: (g, 3, 3) rotation matrices.
    """

    body: int
    geoms: tuple[int, ...]
    places: Array
    turns: Array


def rigid_groups(
    model: mujoco.MjModel, visible: Callable[[int], bool], first: int = 1
) -> list[RigidGroup]:
    """The groups of everything that moves, in the order of their bodies; none is empty.

    Args:
        model: of the world.
        visible: tells of a geom id whether the geom counts.
        first: of the bodies that are looked at, which begins a tree, and all behind it.
    """
    carriers: dict[int, tuple[int, Array, Array]] = {}
    turning: set[int] = set()
    found: dict[int, list[tuple[int, Array, Array]]] = {}
    for body in range(first, model.nbody):
        if model.body_weldid[body] == 0:
            continue
        begin, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
        geoms = [geom for geom in range(begin, begin + count) if visible(geom)]
        parent = int(model.body_parentid[body])
        carriers[body] = body, np.zeros(3), np.eye(3)
        rigid = model.body_jntnum[body] == 0 and model.body_mocapid[body] < 0
        wheel = not rigid and _is_round(model, body, geoms)
        if parent in carriers and parent not in turning and (rigid or wheel):
            carrier, place, turn = carriers[parent]
            place = place + turn @ model.body_pos[body]
            carriers[body] = carrier, place, turn @ rotation_matrix(model.body_quat[body])
            if wheel:
                turning.add(body)
        carrier, place, turn = carriers[body]
        if body % BODIES_AT_A_TIME == 0:
            yield_interpreter()
        for geom in geoms:
            own = turn @ rotation_matrix(model.geom_quat[geom])
            found.setdefault(carrier, []).append((geom, place + turn @ model.geom_pos[geom], own))
    return [
        RigidGroup(
            body,
            tuple(geom for geom, _, _ in parts),
            np.array([place for _, place, _ in parts]),
            np.array([turn for _, _, turn in parts]),
        )
        for body, parts in sorted(found.items())
    ]


def _is_round(model: mujoco.MjModel, body: int, geoms: list[int]) -> bool:
    """Whether a body turns on one hinge about which all its visible geoms are round."""
    if model.body_jntnum[body] != 1:
        return False
    joint = int(model.body_jntadr[body])
    if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
        return False
    anchor, axis = model.jnt_pos[joint], model.jnt_axis[joint]
    return all(_is_round_about(model, geom, anchor, axis) for geom in geoms)


def _is_round_about(model: mujoco.MjModel, geom: int, anchor: Array, axis: Array) -> bool:
    offset = model.geom_pos[geom] - anchor
    if float(np.linalg.norm(offset - (offset @ axis) * axis)) > EXACT:
        return False
    kinds, kind, size = mujoco.mjtGeom, int(model.geom_type[geom]), model.geom_size[geom]
    along = np.abs(rotation_matrix(model.geom_quat[geom]).T @ axis)
    if kind == kinds.mjGEOM_SPHERE:
        return True
    if kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        return bool(along[2] > 1.0 - EXACT)
    if kind == kinds.mjGEOM_ELLIPSOID:
        main = int(along.argmax())
        across = np.delete(size, main)
        return bool(along[main] > 1.0 - EXACT and abs(across[0] - across[1]) < EXACT)
    return False
