"""Shipped worlds, built once for all tests of this room."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.loader import find_world, load_world
from usarsim_server.worlds.scene import build_scene

NAMES = ("arena", "empty", "office", "plant", "proving_ground", "smoke_corridor")


@dataclass(frozen=True)
class Built:
    """One shipped world with a model that also holds a probe, out of the way at first.

    The probe is a free body that a test puts anywhere to look for contacts; nothing is stepped.
    """

    world: WorldDescription
    model: mujoco.MjModel
    data: mujoco.MjData
    movable: tuple[str, ...]

    def height(self, x: float, y: float, above: float = 50.0) -> float:
        """Height of the highest surface under a point that can be touched, m."""
        geom = np.zeros(1, np.int32)
        start = np.array([x, y, above])
        down = np.array([0.0, 0.0, -1.0])
        probe = self.model.body("probe").id
        way = mujoco.mj_ray(self.model, self.data, start, down, None, 1, probe, geom, None)
        return above - float(way)

    def touched(self, x: float, y: float, z: float, yaw: float = 0.0) -> set[str]:
        """Names of geoms that the probe touches when its centre is here."""
        self.data.qpos[-7:] = (x, y, z, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2))
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        probe = self.model.geom("probe").id
        pairs = self.data.contact.geom[: self.data.ncon]
        return {
            self.model.geom(int(a if b == probe else b)).name
            for a, b in pairs
            if probe in (int(a), int(b))
        }

    def geoms(self, prefix: str) -> list[int]:
        """Ids of the geoms whose name is the prefix and a number."""
        names = ((geom, self.model.geom(geom).name) for geom in range(self.model.ngeom))
        return [geom for geom, name in names if name.rpartition("_")[0] == prefix]


def movable_bodies(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Names of the bodies that can be pushed: those with a free joint, in file order."""
    free = mujoco.mjtJoint.mjJNT_FREE
    return tuple(b.name for b in spec.bodies if any(joint.type == free for joint in b.joints))


@cache
def build(name: str, size: tuple[float, float, float] = (0.6, 0.6, 0.3)) -> Built:
    """Build a shipped world with a box probe of this full size."""
    world = load_world(find_world(name))
    spec = build_scene(world)
    movable = movable_bodies(spec)
    body = spec.worldbody.add_body(name="probe", pos=[0.0, 0.0, 900.0])
    body.add_freejoint()
    body.add_geom(name="probe", type=mujoco.mjtGeom.mjGEOM_BOX, size=[edge / 2 for edge in size])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return Built(world, model, data, movable)
