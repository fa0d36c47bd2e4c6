"""Hovering and flying: a body that holds the velocity and the tilt that it is told.

The original imposed velocity and orientation on its aircraft and had no gravity for them (robots
reference 1.5, 4.8). Here a force and a torque of limited size do the same, so that an aircraft
meets walls and other robots as a body, leaves a wall as soon as it is told to, and carries no
integrator that could wind up. The model balances the weight (`gravcomp`).
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.laws import Law, lever_moment

__all__ = ["CHANNELS", "FlightLimits", "VelocityHold"]

Array = NDArray[np.float64]

CHANNELS = 7
"""Command: velocity ahead, to the left and up in the yaw frame (m/s), yaw rate to the left (rad/s),
wanted roll to the right and pitch nose down (rad), and 1 where the rotors stand still."""

ATTITUDE_RATE = 20.0
"""1/s: turning rate per radian of attitude error."""
RATE_GAIN = 60.0
"""1/s: turning acceleration per rad/s of error; 0.3 per step of 5 ms, well damped with the rate."""


@dataclass(frozen=True, slots=True)
class FlightLimits:
    """How an aircraft answers.

    Attributes:
        response: time constant of the velocity, s.
        max_acceleration: m/s^2 that the rotors can give beyond the weight.
        tilt_rate: rad/s at which the body tilts.
        max_turning: rad/s^2 that they can give.
    """

    response: float = 0.2
    max_acceleration: float = 10.0
    tilt_rate: float = 0.672
    max_turning: float = 400.0


class VelocityHold(Law):
    """The law of one aircraft."""

    def __init__(self, model: mujoco.MjModel, base: str, limits: FlightLimits) -> None:
        """Find mass and inertia of the body with everything on it, its joints at home.

        Args:
            model: compiled.
            base: name of the chassis, which hangs on a free joint.
            limits: see there.
        """
        self._body = body = int(model.body(base).id)
        self._dof = int(model.body_dofadr[body])
        self._qpos = int(model.jnt_qposadr[model.body_jntadr[body]])
        self._limits = limits
        self._step = float(model.opt.timestep)
        self._mass = float(model.body_subtreemass[body])
        self._inertia = model.dof_M0[self._dof + 3 : self._dof + 6].copy()
        self._tilt = np.zeros(2)

    def push(self, model: mujoco.MjModel, data: mujoco.MjData, command: Array) -> None:
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, data.qpos[self._qpos + 3 : self._qpos + 7])
        frame = rotation.reshape(3, 3)
        forces = data.qfrc_applied[self._dof : self._dof + 6]
        if command[6]:
            forces[:3] = self._mass * model.opt.gravity
            forces[3:] = lever_moment(data, self._body, frame, forces[:3])
            return
        yaw = np.arctan2(frame[1, 0], frame[0, 0])
        ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        left = np.array([-ahead[1], ahead[0], 0.0])
        wanted = command[0] * ahead + command[1] * left
        wanted[2] = command[2]
        forces[:3] = self._mass * self._accelerate(wanted - data.qvel[self._dof : self._dof + 3])
        forces[3:] = lever_moment(data, self._body, frame, forces[:3])
        forces[3:] += self._inertia * self._turn(
            frame, data.qvel[self._dof + 3 : self._dof + 6], ahead, left, command
        )

    def _accelerate(self, missing: Array) -> Array:
        """Acceleration (m/s^2) that removes a velocity error, limited as a whole."""
        wanted: Array = missing / self._limits.response
        size = float(np.linalg.norm(wanted))
        return wanted * min(1.0, self._limits.max_acceleration / size) if size else wanted

    def _turn(self, frame: Array, spin: Array, ahead: Array, left: Array, command: Array) -> Array:
        """Turning acceleration (rad/s^2, body frame) towards the wanted tilt and yaw rate."""
        most = self._limits.tilt_rate * self._step
        self._tilt += np.clip(command[4:6] - self._tilt, -most, most)
        roll, pitch = self._tilt
        up = np.array([0.0, 0.0, 1.0])
        nose = np.cos(pitch) * ahead - np.sin(pitch) * up
        side = np.cos(roll) * left + np.sin(roll) * np.cross(nose, left)
        top = np.cross(nose, side)
        # The error as a rotation vector in the world, without its part about the vertical axis,
        # which belongs to the yaw rate alone.
        error = 0.5 * (np.cross(frame[:, 0], nose) + np.cross(frame[:, 2], top))
        error[2] = 0.0
        rate = frame.T @ (ATTITUDE_RATE * error + command[3] * up)
        wanted: Array = RATE_GAIN * (rate - spin)
        limit = self._limits.max_turning
        return np.clip(wanted, -limit, limit)

    def release(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.qfrc_applied[self._dof : self._dof + 6] = 0.0
        self._tilt[:] = 0.0

    def state(self) -> Array:
        return self._tilt.copy()

    def restore(self, state: Array) -> None:
        self._tilt[:] = state
