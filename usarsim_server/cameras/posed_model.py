"""The world as renderers need it: one compiled model, posed as in one snapshot."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.cameras.view import CameraView
from usarsim_server.simulation.frames import Pose, pose_of, rotation_matrix
from usarsim_server.simulation.layout import RobotLayout
from usarsim_server.simulation.model import CompiledWorld
from usarsim_server.simulation.movers import mocap_bodies, pose_as
from usarsim_server.simulation.raw import copied
from usarsim_server.simulation.snapshot import Snapshot

HIDDEN_GROUP = 5
"""Geom group of what is parked. Pictures show groups 0, 1 and 2, as MuJoCo's own viewer does."""


class Stage:
    """A private copy of one model generation, for one thread.

    Attributes:
        model: nothing sleeps in it; parked robots and things are in `HIDDEN_GROUP`.
        data: poses of the snapshot shown last; lights included.
        groups: (ngeom,) groups of the geoms while nothing is parked.
    """

    def __init__(self, world: CompiledWorld) -> None:
        self.generation = world.generation
        self.model: mujoco.MjModel = copied(world.model)
        self.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        self._layouts = world.layouts
        self.groups = self.model.geom_group.copy()
        self._mocap = mocap_bodies(self.model)
        self._snapshot: Snapshot | None = None
        self._fronts: dict[int, Pose] = {}

    def show(self, snapshot: Snapshot) -> None:
        """Pose everything as in a snapshot of this generation."""
        if snapshot is self._snapshot:
            return
        model, data = self.model, self.data
        pose_as(data, snapshot, self._mocap)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        present = {layout.slot for layout in snapshot.layouts.values()}
        for layout in self._layouts:
            shown = self.groups[layout.geoms] if layout.slot in present else HIDDEN_GROUP
            model.geom_group[layout.geoms] = shown
        self._snapshot = snapshot

    def visible(self) -> NDArray[np.bool_]:
        """Which geoms (ngeom,) are drawn at all."""
        material = self.model.geom_matid
        alpha = self.model.geom_rgba[:, 3].copy()
        alpha[material >= 0] = self.model.mat_rgba[material[material >= 0], 3]
        seen: NDArray[np.bool_] = (self.model.geom_group <= 2) & (alpha > 0.0)
        return seen

    def place(self, view: CameraView) -> Pose | None:
        """Where a camera is in the snapshot shown last; None if its robot is not there."""
        if view.robot is None:
            return view.pose
        layout = self._layout(view.robot)
        if layout is None:
            return None
        body = layout.base if view.link is None else layout.links.get(view.link.lower())
        return None if body is None else self._pose(body) @ view.pose

    def lamps(self, lit: Callable[[int], bool]) -> tuple[Pose, ...]:
        """Headlights in the snapshot shown last, of robots that are `lit`, by their numbers.

        A headlight shines along x from its pose in the world.
        """
        layouts = {} if self._snapshot is None else self._snapshot.layouts
        return tuple(
            self._pose(layout.base) @ self._front(layout)
            for robot, layout in layouts.items()
            if lit(robot)
        )

    def _layout(self, robot: int) -> RobotLayout | None:
        return None if self._snapshot is None else self._snapshot.layouts.get(robot)

    def _pose(self, body: int) -> Pose:
        return pose_of(self.data.xpos[body], self.data.xquat[body])

    def _front(self, layout: RobotLayout) -> Pose:
        if layout.slot not in self._fronts:
            self._fronts[layout.slot] = lamp_place(self.model, layout)
        return self._fronts[layout.slot]


def lamp_place(model: mujoco.MjModel, layout: RobotLayout) -> Pose:
    """Middle of the foremost edge of a chassis, where its headlight is, in its frame."""
    ahead, height = 0.0, 0.0
    for geom in layout.geoms:
        if model.geom_bodyid[geom] != layout.base:
            continue
        ahead_row = rotation_matrix(model.geom_quat[geom])[0]
        middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        reach = float(np.abs(ahead_row) @ half)
        front = float(model.geom_pos[geom, 0] + ahead_row @ middle) + reach
        if front > ahead:
            ahead, height = front, float(model.geom_pos[geom, 2])
    return Pose((ahead + 0.01, 0.0, height))
