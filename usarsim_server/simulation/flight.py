"""Hovering and flying: a body that holds the velocity and the tilt that it is told.

The original imposed velocity and orientation on its aircraft and had no gravity for them (robots
reference 1.5, 4.8). Here a force and a torque of limited size do the same, so that an aircraft
meets walls and other robots as a body, leaves a wall as soon as it is told to, and carries no
integrator that could wind up. The model balances the weight (`gravcomp`). It stays in the box of
the world.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from usarsim_server.simulation.frames import Array, Vector
from usarsim_server.simulation.motion_laws import Bounds, FreeBody, Law, Motion, cross, dot

CHANNELS = 7
"""Command: velocity ahead, to the left and up in the yaw frame (m/s), yaw rate to the left (rad/s),
wanted roll to the right and pitch nose down (rad), and 1 where the rotors stand still."""

ATTITUDE_RATE = 20.0
"""1/s: turning rate per radian of attitude error."""
RATE_GAIN = 60.0
"""1/s: turning acceleration per rad/s of error; 0.3 per step of 5 ms, well damped with the rate."""


@dataclass(frozen=True, slots=True)
class FlightLimits:
    """How an aircraft answers."""

    response: float = 0.2  # time constant of the velocity, s
    max_acceleration: float = 10.0  # m/s^2 that the rotors can give beyond the weight
    tilt_rate: float = 0.672  # rad/s at which the body tilts
    max_turning: float = 400.0  # rad/s^2 that they can give


class VelocityHold(Law):
    """The law of one aircraft."""

    def __init__(self, model: mujoco.MjModel, base: str, limits: FlightLimits) -> None:
        """Find its chassis, which hangs on a free joint, by its name."""
        self._body = FreeBody(model, base)
        self._bounds = Bounds(model)
        self._limits = limits
        self._most = limits.tilt_rate * float(model.opt.timestep)
        self._roll = self._pitch = 0.0
        """Tilt that is held at present, rad."""

    def push(self, model: mujoco.MjModel, data: mujoco.MjData, command: Array) -> None:
        body = self._body
        motion = body.look(data)
        forward, sideways, up, yaw_rate, roll, pitch, dead = command.tolist()
        if dead:
            x, y, z = model.opt.gravity.tolist()
            weight = (body.mass * x, body.mass * y, body.mass * z)
            body.push(data, motion, weight, (0.0, 0.0, 0.0))
            return
        (nose, _, _), velocity, _ = motion
        yaw = math.atan2(nose[1], nose[0])
        cosine, sine = math.cos(yaw), math.sin(yaw)
        limits = self._limits
        wanted = self._bounds.hold(
            (forward * cosine - sideways * sine, forward * sine + sideways * cosine, up),
            body.place(data),
            limits.response,
            limits.max_acceleration,
        )
        missing = (
            wanted[0] - velocity[0],
            wanted[1] - velocity[1],
            wanted[2] - velocity[2],
        )
        self._roll += _within(roll - self._roll, self._most)
        self._pitch += _within(pitch - self._pitch, self._most)
        torque = self._torque(motion, (cosine, sine, 0.0), yaw_rate)
        body.push(data, motion, self._force(missing), torque)

    def _force(self, missing: Vector) -> Vector:
        """The force (N) that removes a velocity error, limited as a whole."""
        limits = self._limits
        size = math.hypot(*missing) / limits.response
        share = min(1.0, limits.max_acceleration / size) if size else 0.0
        factor = self._body.mass * share / limits.response
        return factor * missing[0], factor * missing[1], factor * missing[2]

    def _torque(self, motion: Motion, ahead: Vector, yaw_rate: float) -> Vector:
        """The torque (N m, body frame) towards the wanted tilt and yaw rate."""
        axes, _, spin = motion
        roll, pitch = self._roll, self._pitch
        # The wanted axes: heading as it is, then pitch, then roll.
        low, level = math.sin(pitch), math.cos(pitch)
        nose = (level * ahead[0], level * ahead[1], -low)
        upward = (low * ahead[0], low * ahead[1], level)
        left = (-ahead[1], ahead[0], 0.0)
        cosine, sine = math.cos(roll), math.sin(roll)
        top = (
            cosine * upward[0] - sine * left[0],
            cosine * upward[1] - sine * left[1],
            cosine * upward[2],
        )
        # The error as a rotation vector in the world, without its part about the vertical axis,
        # which belongs to the yaw rate alone.
        by_nose, by_top = cross(axes[0], nose), cross(axes[2], top)
        gain = 0.5 * ATTITUDE_RATE
        rate = (gain * (by_nose[0] + by_top[0]), gain * (by_nose[1] + by_top[1]), yaw_rate)
        limit, inertia = self._limits.max_turning, self._body.inertia
        return (
            inertia[0] * _within(RATE_GAIN * (dot(axes[0], rate) - spin[0]), limit),
            inertia[1] * _within(RATE_GAIN * (dot(axes[1], rate) - spin[1]), limit),
            inertia[2] * _within(RATE_GAIN * (dot(axes[2], rate) - spin[2]), limit),
        )

    def release(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._body.release(data)
        self._roll = self._pitch = 0.0

    def state(self) -> Array:
        return np.array((self._roll, self._pitch))

    def restore(self, state: Array) -> None:
        self._roll, self._pitch = state.tolist()


def _within(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
