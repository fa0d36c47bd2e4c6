"""Bodies that go their own way: placed by a function of simulated time, not moved by forces.

People who wave or walk, avatars, objects that a controller shoves around. In the model they are
mocap bodies: they push what they meet and nothing pushes them back. Their poses are a pure
function of time, so runs repeat whatever the batches in which the physics advances.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Pose

__all__ = ["Mover", "MovingBodies", "carry_over", "mocap_bodies"]


@dataclass(frozen=True, slots=True)
class Mover:
    """The way of one body.

    Attributes:
        body: name of a mocap body of the scenery.
        pose: its pose in the world at a simulated time (s). Called before every physics step, by
            the physics thread and by others: cheap, without side effects, always finite.
    """

    body: str
    pose: Callable[[float], Pose]


class MovingBodies:
    """Movers together with the places of their bodies in one model generation."""

    def __init__(self, model: mujoco.MjModel, movers: Sequence[Mover]) -> None:
        """Look up the bodies.

        Raises:
            ValueError: if a body does not exist or is no mocap body.
        """
        self.movers = tuple(movers)
        self._ways = [(_mocap_id(model, mover.body), mover.pose) for mover in movers]

    def apply(self, data: mujoco.MjData, time: float) -> None:
        """Put all bodies where they are at a time."""
        for index, pose_at in self._ways:
            pose = pose_at(time)
            data.mocap_pos[index] = pose.position
            data.mocap_quat[index] = pose.quaternion


def mocap_bodies(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Body ids of all mocap bodies, in the order of `mocap_pos` and `mocap_quat`.

    A snapshot has the poses of bodies; this tells which of them to copy into another `MjData`.
    """
    bodies = np.flatnonzero(model.body_mocapid >= 0)
    return bodies[np.argsort(model.body_mocapid[bodies])]


def carry_over(
    old_model: mujoco.MjModel, old: mujoco.MjData, new_model: mujoco.MjModel, new: mujoco.MjData
) -> None:
    """Put the mocap bodies of a grown model where their namesakes are in the old one."""
    for body in mocap_bodies(old_model):
        twin = _mocap_id(new_model, old_model.body(body).name)
        index = old_model.body_mocapid[body]
        new.mocap_pos[twin] = old.mocap_pos[index]
        new.mocap_quat[twin] = old.mocap_quat[index]


def _mocap_id(model: mujoco.MjModel, name: str) -> int:
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    index = int(model.body_mocapid[body]) if body >= 0 else -1
    if index < 0:
        what = "is no mocap body" if body >= 0 else "does not exist"
        raise ValueError(f"body {name!r} cannot be moved: it {what}")
    return index
