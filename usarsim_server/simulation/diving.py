"""Diving: a body in balance with the water, driven by a propeller and steered by planes.

Every machine of this law is under water wherever it is, as the original's submarine was driven in
flooded maps. Forces: thrust that grows with the square of the propeller's speed (open water
propeller theory with a constant coefficient), drag that grows with the square of the speed along
each axis of the hull, lift of rudder and stern planes proportional to their angle and the square
of the speed ahead, and a righting moment, because the weight hangs below the buoyancy.
The hull is trimmed: thrust and drag act in the mass centre. The edges of the world's box hold it
back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from usarsim_server.simulation.frames import Array, Vector
from usarsim_server.simulation.motion_laws import Bounds, FreeBody, Law, dot

CHANNELS = 3
"""Command: propeller (rad/s, positive drives ahead), angle of the rudder that turns to the left and
of the stern planes that turn the nose down (rad)."""

WATER = 1000.0
"""kg/m^3."""
EDGE_RESPONSE = 0.2
"""s: time constant with which the edge of the world takes away speed."""
EDGE_BRAKING = 2.0
"""m/s^2: so hard is it braked before the edge of the world."""
SLOW = 0.05
"""m/s and rad/s added to the speed in the drag: without it nothing would ever come to rest."""


@dataclass(frozen=True, slots=True)
class Hull:
    """A hull in water."""

    diameter: float = 0.3  # of the propeller, m
    thrust: float = 0.3
    """Thrust coefficient K_T: force is K_T rho n^2 d^4 with n in turns per second."""
    drag: Vector = (0.04, 1.0, 1.0)
    """Drag coefficient times area ahead, sideways and up and down, m^2."""
    turning_drag: Vector = (60.0, 250.0, 250.0)  # N m s^2 about the three axes
    plane: float = 0.06  # lift slope times area of rudder or stern planes, m^2 per rad
    arm: float = 0.9  # m from the middle of the hull back to the planes
    righting: float = 60.0  # N m per unit of the sine of the tilt
    response: float = 0.5  # s in which propeller and planes reach what they are told


class Diving(Law):
    """The law of one submarine."""

    def __init__(self, model: mujoco.MjModel, base: str, hull: Hull) -> None:
        """Find the chassis, which hangs on a free joint, by its name."""
        self._body = FreeBody(model, base)
        self._bounds = Bounds(model)
        self._hull = hull
        step = float(model.opt.timestep)
        # A step of drag can stop a body, but not throw it back.
        self._most = self._body.mass / step
        self._most_turning = [moment / step for moment in self._body.inertia]
        self._share = min(1.0, step / hull.response)
        self._reached = [0.0] * CHANNELS
        """What propeller, rudder and planes do at present."""

    def push(self, model: mujoco.MjModel, data: mujoco.MjData, command: Array) -> None:
        for channel, wanted in enumerate(command.tolist()):
            self._reached[channel] += self._share * (wanted - self._reached[channel])
        motion = self._body.look(data)
        axes, velocity, spin = motion
        speed = [dot(axis, velocity) for axis in axes]
        along = [
            -min(0.5 * WATER * area * (abs(one) + SLOW), self._most) * one
            for area, one in zip(self._hull.drag, speed, strict=True)
        ]
        along[0] += self._thrust()
        held = self._bounds.hold(velocity, self._body.place(data), EDGE_RESPONSE, EDGE_BRAKING)
        hold = self._body.mass / EDGE_RESPONSE
        x, y, z = (
            along[0] * axes[0][i] + along[1] * axes[1][i] + along[2] * axes[2][i] for i in range(3)
        )
        force = (
            x + hold * (held[0] - velocity[0]),
            y + hold * (held[1] - velocity[1]),
            z + hold * (held[2] - velocity[2]),
        )
        # Astern the water meets the planes from behind, and they turn the hull the other way.
        steering = 0.5 * WATER * speed[0] * abs(speed[0]) * self._hull.plane * self._hull.arm
        _, rudder, planes = self._reached
        roll, pitch, yaw = self._damping(spin)
        # The vertical in the frame of the hull; up x vertical turns the hull upright.
        ahead, left = axes[0][2], axes[1][2]
        righting = self._hull.righting
        torque = (
            roll - righting * left,
            pitch + righting * ahead + steering * planes,
            yaw + steering * rudder,
        )
        self._body.push(data, motion, force, torque)

    def _thrust(self) -> float:
        turns = self._reached[0] / (2.0 * math.pi)
        return self._hull.thrust * WATER * turns * abs(turns) * self._hull.diameter**4

    def _damping(self, spin: Vector) -> Vector:
        a, b, c = (
            -min(drag * (abs(rate) + SLOW), most) * rate
            for drag, rate, most in zip(
                self._hull.turning_drag, spin, self._most_turning, strict=True
            )
        )
        return a, b, c

    def release(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._body.release(data)
        self._reached = [0.0] * CHANNELS

    def state(self) -> Array:
        return np.array(self._reached)

    def restore(self, state: Array) -> None:
        self._reached = state.tolist()
