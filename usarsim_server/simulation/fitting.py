"""Whether a thing fits where somebody wants to put it.

Robots are moved to the nearest free place (see `placement.py`); a thing stays away if its place
is blocked. Contacts do not tell: between things that are placed, and between them and the
scenery, there are none. So distances between geoms are measured.
"""

from __future__ import annotations

import math
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.errors import SpawnError
from usarsim_server.simulation.courtesy import breathe
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.simulation.model import CompiledWorld, put, root_qpos
from usarsim_server.simulation.movers import mocap_bodies
from usarsim_server.simulation.objects import geom_names
from usarsim_server.simulation.snapshot import Snapshot

__all__ = ["TOLERATED", "Fitting"]

Array = NDArray[np.float64]

TOLERATED = 0.02
"""m of overlap that does not count; robots are judged by the same."""
CLEARANCE = 0.001
"""m above an endless floor that a thing is lifted to."""
CAPSULE_END = 2.0 / 3.0
"""Radii by which a cylinder is longer than the straight part of a capsule of the same volume."""
NUDGE = 1e-3
"""m: where two geoms have one centre the distance is measured with one of them moved by this."""


class Fitting:
    """Judges places in one model generation; used by one thread at a time."""

    def __init__(self, world: CompiledWorld, lower: Vector, upper: Vector) -> None:
        self._world = world
        self._lower, self._upper = lower, upper

    def admit(self, pose: Pose) -> None:
        """Refuse what no thing can be put at, whatever its shape; needs no slot.

        Raises:
            SpawnError: if the pose is not finite, or beyond the walls or the roof of the world.
        """
        if not all(math.isfinite(value) for value in (*pose.position, *pose.quaternion)):
            raise SpawnError("the pose is not finite")
        x, y, z = pose.position
        self._check_inside(Pose((x, y, max(z, self._lower[2])), pose.quaternion))

    def check(self, snapshot: Snapshot, slot: int, pose: Pose) -> Pose:
        """The pose, lifted out of an endless floor if need be.

        Args:
            snapshot: the world as it is.
            slot: holds the thing; wherever it is now does not count.
            pose: wanted pose of its origin.

        Raises:
            SpawnError: if the pose is not finite or outside the world, or if something is there.
        """
        self.admit(pose)
        self._show(snapshot, slot, pose)
        own = self._solid[np.isin(self._solid, self._world.layouts[slot].geoms)]
        depth = self._depth_in_floors(own)
        if depth > TOLERATED:
            x, y, z = pose.position
            pose = Pose((x, y, z + depth + CLEARANCE), pose.quaternion)
            self._show(snapshot, slot, pose)
        self._check_inside(pose)
        for geom in own:
            breathe()
            for other in self._near(geom, own):
                if self._distance(geom, other) < -TOLERATED:
                    name = geom_names(self._model)[other] or "something nameless"
                    raise SpawnError(f"the place is blocked by {name}")
        return pose

    @cached_property
    def _model(self) -> mujoco.MjModel:
        model: mujoco.MjModel = self._world.model.__copy__()
        # A capsule whose axis is inside a box counts as touching it only (MuJoCo 3.17).
        capsules = model.geom_type == mujoco.mjtGeom.mjGEOM_CAPSULE
        model.geom_type[capsules] = mujoco.mjtGeom.mjGEOM_CYLINDER
        model.geom_size[capsules, 1] += CAPSULE_END * model.geom_size[capsules, 0]
        return model

    @cached_property
    def _data(self) -> mujoco.MjData:
        return mujoco.MjData(self._model)

    @cached_property
    def _solid(self) -> NDArray[np.intp]:
        """Geoms that things can bump into."""
        model = self._model
        return np.flatnonzero((model.geom_contype | model.geom_conaffinity) != 0)

    def _show(self, snapshot: Snapshot, slot: int, pose: Pose) -> None:
        mocap = mocap_bodies(self._model)
        self._data.qpos[:] = snapshot.qpos
        self._data.mocap_pos[:] = snapshot.xpos[mocap]
        self._data.mocap_quat[:] = snapshot.xquat[mocap]
        put(self._world, self._data, slot, root_qpos(pose))
        mujoco.mj_kinematics(self._model, self._data)

    def _check_inside(self, pose: Pose) -> None:
        limits = zip(self._lower, pose.position, self._upper, strict=True)
        if not all(low <= value <= high for low, value, high in limits):
            x, y, z = pose.position
            raise SpawnError(f"the place ({x:g}, {y:g}, {z:g}) is outside the world")

    def _depth_in_floors(self, own: NDArray[np.intp]) -> float:
        """How far (m) a thing has to rise to be above all level endless floors."""
        model, data = self._model, self._data
        depth = 0.0
        for plane in self._solid[model.geom_type[self._solid] == mujoco.mjtGeom.mjGEOM_PLANE]:
            if data.geom_xmat[plane][8] < 1.0 - 1e-6:
                continue
            for geom in own:
                depth = max(depth, -self._distance(geom, plane))
        return depth

    def _near(self, geom: int, own: NDArray[np.intp]) -> NDArray[np.intp]:
        """Solid geoms of others whose bounding sphere touches that of a geom."""
        model, data = self._model, self._data
        others = self._solid[~np.isin(self._solid, own)]
        offset = data.geom_xpos[others] - data.geom_xpos[geom]
        gap = np.linalg.norm(offset, axis=1) - model.geom_rbound[others]
        for index in np.flatnonzero(model.geom_type[others] == mujoco.mjtGeom.mjGEOM_PLANE):
            gap[index] = abs(offset[index] @ data.geom_xmat[others[index]].reshape(3, 3)[:, 2])
        near: NDArray[np.intp] = others[gap < model.geom_rbound[geom]]
        return near

    def _distance(self, geom: int, other: int) -> float:
        """Distance between two geoms, m; negative: how deep they overlap."""
        model, data = self._model, self._data
        nearest = np.zeros(6)
        reach = 0.5
        distance = mujoco.mj_geomDistance(model, data, geom, other, reach, nearest)
        if distance >= 0.0 and np.allclose(data.geom_xpos[geom], data.geom_xpos[other], atol=1e-4):
            kept = data.geom_xpos[geom].copy()
            data.geom_xpos[geom] += NUDGE * np.array([1.0, 0.7, 0.4])
            distance = mujoco.mj_geomDistance(model, data, geom, other, reach, nearest)
            data.geom_xpos[geom] = kept
        return float(distance)
