"""Diving: a body in balance with the water, driven by a propeller and steered by planes.

Every machine of this law is under water wherever it is, as the original's submarine was driven in
flooded maps. Forces: thrust that grows with the square of the propeller's speed (open water
propeller theory with a constant coefficient), drag that grows with the square of the speed along
each axis of the hull, lift of rudder and stern planes proportional to their angle and the square
of the speed ahead, and a righting moment, because the weight hangs below the buoyancy.
The hull is trimmed: thrust and drag act in the mass centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Vector
from usarsim_server.simulation.laws import Law, lever_moment

__all__ = ["CHANNELS", "Diving", "Hull"]

Array = NDArray[np.float64]

CHANNELS = 3
"""Command: propeller (rad/s, positive drives ahead), angle of the rudder that turns to the left and
of the stern planes that turn the nose down (rad)."""

WATER = 1000.0
"""kg/m^3."""
SLOW = 0.05
"""m/s and rad/s added to the speed in the drag: without it nothing would ever come to rest."""


@dataclass(frozen=True, slots=True)
class Hull:
    """A hull in water.

    Attributes:
        diameter: of the propeller, m.
        thrust: thrust coefficient K_T: force is K_T rho n^2 d^4 with n in turns per second.
        drag: drag coefficient times area ahead, sideways and up and down, m^2.
        turning_drag: N m s^2 about the three axes.
        plane: lift slope times area of rudder or stern planes, m^2 per rad.
        arm: m from the middle of the hull back to the planes.
        righting: N m per unit of the sine of the tilt.
        response: s in which propeller and planes reach what they are told.
    """

    diameter: float = 0.3
    thrust: float = 0.3
    drag: Vector = (0.04, 1.0, 1.0)
    turning_drag: Vector = (60.0, 250.0, 250.0)
    plane: float = 0.06
    arm: float = 0.9
    righting: float = 60.0
    response: float = 0.5


class Diving(Law):
    """The law of one submarine."""

    def __init__(self, model: mujoco.MjModel, base: str, hull: Hull) -> None:
        """Find the chassis, which hangs on a free joint.

        Args:
            model: compiled.
            base: name of the chassis.
            hull: see there.
        """
        self._body = body = int(model.body(base).id)
        self._dof = int(model.body_dofadr[body])
        self._qpos = int(model.jnt_qposadr[model.body_jntadr[body]])
        self._hull = hull
        self._mass = float(model.body_subtreemass[body])
        self._inertia = model.dof_M0[self._dof + 3 : self._dof + 6].copy()
        self._step = float(model.opt.timestep)
        self._share = float(model.opt.timestep) / hull.response
        self._reached = np.zeros(CHANNELS)

    def push(self, model: mujoco.MjModel, data: mujoco.MjData, command: Array) -> None:
        hull = self._hull
        self._reached += min(1.0, self._share) * (command - self._reached)
        propeller, rudder, planes = self._reached
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, data.qpos[self._qpos + 3 : self._qpos + 7])
        frame = rotation.reshape(3, 3)
        speed = frame.T @ data.qvel[self._dof : self._dof + 3]
        spin = data.qvel[self._dof + 3 : self._dof + 6]
        turns = propeller / (2.0 * np.pi)
        drag = 0.5 * WATER * np.array(hull.drag) * (np.abs(speed) + SLOW)
        turning_drag = np.array(hull.turning_drag) * (np.abs(spin) + SLOW)
        # A step of drag can stop a body, but not throw it back.
        force = -np.minimum(drag, self._mass / self._step) * speed
        force[0] += hull.thrust * WATER * turns * abs(turns) * hull.diameter**4
        torque = -np.minimum(turning_drag, self._inertia / self._step) * spin
        # Astern the water meets the planes from behind, and they turn the hull the other way.
        pressure = 0.5 * WATER * speed[0] * abs(speed[0])
        torque[1] += pressure * hull.plane * hull.arm * planes
        torque[2] += pressure * hull.plane * hull.arm * rudder
        torque += hull.righting * np.cross((0.0, 0.0, 1.0), frame[2])
        forces = data.qfrc_applied[self._dof : self._dof + 6]
        forces[:3] = frame @ force
        forces[3:] = torque + lever_moment(data, self._body, frame, forces[:3])

    def release(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_applied[self._dof : self._dof + 6] = 0.0
        self._reached[:] = 0.0

    def state(self) -> Array:
        return self._reached.copy()

    def restore(self, state: Array) -> None:
        self._reached[:] = state
