"""A chassis on a free joint, as laws of motion see and push it.

Plain numbers instead of arrays: a law runs in every step, and for three components NumPy is
several times slower.
"""

from __future__ import annotations

import mujoco

from usarsim_server.simulation.frames import Vector

__all__ = ["FreeBody", "Motion", "cross", "dot"]

Motion = tuple[tuple[Vector, Vector, Vector], Vector, Vector]
"""The axes of the body in the world (ahead, to the left, up), the velocity of its origin in the
world (m/s), its turning rate in its own frame (rad/s)."""


class FreeBody:
    """One robot's chassis with everything on it.

    Attributes:
        mass: kg.
        inertia: about the axes of the body through its origin, joints at home, kg m^2.
    """

    def __init__(self, model: mujoco.MjModel, base: str) -> None:
        """Find it.

        Args:
            model: compiled.
            base: name of the chassis.
        """
        self._body = body = int(model.body(base).id)
        dof = int(model.body_dofadr[body])
        coordinates = int(model.jnt_qposadr[model.body_jntadr[body]])
        self._dofs = slice(dof, dof + 6)
        self._place = slice(coordinates, coordinates + 3)
        self._quaternion = slice(coordinates + 3, coordinates + 7)
        self.mass = float(model.body_subtreemass[body])
        a, b, c = model.dof_M0[dof + 3 : dof + 6].tolist()
        self.inertia: Vector = (a, b, c)

    def look(self, data: mujoco.MjData) -> Motion:
        """How it stands and moves."""
        w, x, y, z = data.qpos[self._quaternion].tolist()
        vx, vy, vz, p, q, r = data.qvel[self._dofs].tolist()
        axes = (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
            (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
            (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
        )
        return axes, (vx, vy, vz), (p, q, r)

    def place(self, data: mujoco.MjData) -> Vector:
        """Where its origin is, m."""
        x, y, z = data.qpos[self._place].tolist()
        return x, y, z

    def push(self, data: mujoco.MjData, motion: Motion, force: Vector, torque: Vector) -> None:
        """Push it until told otherwise.

        Args:
            data: positions are up to date.
            motion: from `look`.
            force: acts in the mass centre, N, in the world.
            torque: N m, in the frame of the body.
        """
        cx, cy, cz = data.subtree_com[self._body].tolist()
        ox, oy, oz = data.xpos[self._body].tolist()
        moment = cross((cx - ox, cy - oy, cz - oz), force)
        a, b, c = motion[0]
        data.qfrc_applied[self._dofs] = (
            *force,
            torque[0] + dot(a, moment),
            torque[1] + dot(b, moment),
            torque[2] + dot(c, moment),
        )

    def release(self, data: mujoco.MjData) -> None:
        """Let go of it."""
        data.qfrc_applied[self._dofs] = 0.0


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def dot(a: Vector, b: Vector) -> float:
    """The scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
