"""One robot alone in a world: what it touches, and how far it leans."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from usarsim_server.robots.description import RobotDescription
from usarsim_server.sessions.robots import robot_model
from usarsim_server.simulation.model import PhysicsOptions, compile_world
from usarsim_server.simulation.snapshot import RobotBody, Snapshot
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.scene import build_scene


@dataclass(frozen=True, slots=True)
class Contacts:
    """What one robot touches at one instant."""

    wheels: int  # number of its driven wheels that touch anything
    depth: float  # deepest overlap of the robot with anything else, m
    own: bool  # whether two of its own parts touch each other


class ContactProbe:
    """Finds contacts in snapshots, with a model of its own that never steps."""

    def __init__(self, world: WorldDescription, robot: RobotDescription) -> None:
        """Compile the world with one robot of a class, as the simulation does."""
        compiled = compile_world(
            lambda: build_scene(world), (robot_model(robot),), PhysicsOptions(), generation=0
        )
        self.model = compiled.model
        # Awake, so that contacts of resting bodies are found too.
        self.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self._data = mujoco.MjData(self.model)
        layout = compiled.layouts[0]
        self._robot = np.zeros(self.model.ngeom, dtype=bool)
        self._robot[layout.geoms] = True
        self._wheels = np.full(self.model.ngeom, -1)
        for number, dof in enumerate(layout.wheel_dof):
            body = self.model.dof_bodyid[dof]
            self._wheels[self.model.geom_bodyid == body] = number

    def look(self, snapshot: Snapshot) -> Contacts:
        """The contacts of the robot in a snapshot of the same world with that robot alone."""
        data = self._data
        data.qpos[:] = snapshot.qpos
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_collision(self.model, data)
        touching = data.contact.dist <= 0.0
        pairs = data.contact.geom[touching]
        members = self._robot[pairs].sum(axis=1)
        wheels = self._wheels[pairs]
        distances = data.contact.dist[touching][members == 1]
        return Contacts(
            wheels=len(set(wheels[wheels >= 0].tolist())),
            depth=float(-distances.min()) if distances.size else 0.0,
            own=bool((members == 2).any()),
        )


def tilt(state: RobotBody) -> float:
    """Angle (rad) between the robot's own z axis and the vertical."""
    return math.acos(max(-1.0, min(1.0, state.pose.rotate((0.0, 0.0, 1.0))[2])))
