"""A look into the finished scene: where floors are, what is blocked, how large it all is."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np

from usarsim_server.errors import MapImportError, at
from usarsim_server.simulation.frames import Vector

__all__ = ["BALL", "Probe"]

_MEBI = 1 << 20
BALL = "probe:ball"
"""Geom and body of the ball with which free space is looked for."""
NUDGE = np.array([1e-3, 0.7e-3, 0.4e-3])
"""m: a ball whose centre is exactly that of a box counts as not touching it (MuJoCo 3.17)."""


class Probe:
    """The compiled scenery of a world folder, movable things where the map has them.

    Attributes:
        model: compiled.
        seconds: not timed here; compile once and ask many things.
    """

    def __init__(self, scene: Path, source: Path) -> None:
        """Compile.

        Raises:
            MapImportError: MuJoCo refuses the scene.
        """
        try:
            spec = mujoco.MjSpec.from_file(str(scene))
            ball = spec.worldbody.add_body(name=BALL, pos=[0.0, 0.0, 1e4])
            ball.add_freejoint()  # what cannot move does not touch what cannot move
            ball.add_geom(name=BALL, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0.0, 0.0])
            self.model: mujoco.MjModel = spec.compile()
        except ValueError as error:
            text = " ".join(str(error).split()).removeprefix("Error: ")
            cure = "report this map; --sidecar can exclude the object that is named"
            raise MapImportError(at(source, f"MuJoCo refuses the result: {text}", cure)) from error
        model = self.model
        self._data = mujoco.MjData(model)
        mujoco.mj_forward(model, self._data)
        self._ball_geom = model.geom(BALL).id
        self._rays: mujoco.MjModel = model.__copy__()
        hollow = (model.geom_contype | model.geom_conaffinity) == 0
        hollow[self._ball_geom] = True
        self._rays.geom_rgba[hollow, 3] = 0.0
        self._rays.geom_matid[hollow] = -1

    @property
    def memory(self) -> float:
        """MiB of the compiled model."""
        return float(self.model.nbuffer) / _MEBI

    @property
    def has_ground(self) -> bool:
        """Whether anything solid is fixed in the world (worlds reference 11)."""
        model = self.model
        solid = (model.geom_contype | model.geom_conaffinity) != 0
        return bool((solid & (model.body_weldid[model.geom_bodyid] == 0)).any())

    def way(self, start: Vector, direction: Vector) -> float:
        """m to the next solid surface in a direction; inf if there is none."""
        geom = np.zeros(1, dtype=np.int32)
        way = mujoco.mj_ray(
            self._rays,
            self._data,
            np.array(start),
            np.array(direction),
            None,
            1,
            -1,
            geom,
            None,
        )
        return float(way) if geom[0] >= 0 else math.inf

    def height(self, point: Vector) -> float:
        """m from a point down to the floor; inf if there is none."""
        return self.way(point, (0.0, 0.0, -1.0))

    def headroom(self, point: Vector) -> float:
        """m from a point up to the ceiling."""
        return self.way(point, (0.0, 0.0, 1.0))

    def overlap(self, point: Vector, radius: float = 0.1) -> float:
        """m by which a ball at a point would be inside something solid; 0 if it is free."""
        data, model, geom = self._data, self.model, self._ball_geom
        body = model.body(BALL).id
        place = int(model.joint(model.body_jntadr[body]).qposadr[0])
        model.geom_size[geom, 0] = model.geom_rbound[geom] = radius
        model.geom_aabb[geom, 3:] = model.bvh_aabb[model.body_bvhadr[body], 3:] = radius
        data.qpos[place : place + 3] = np.array(point) + NUDGE
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        own = (data.contact.geom == geom).any(axis=1)
        return max(0.0, -float(data.contact.dist[own].min())) if own.any() else 0.0
