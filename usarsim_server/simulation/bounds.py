"""The box of a world, in which machines stay that nothing else would stop: aircraft, submarines.

The box travels in the compiled model, as numbers of a name of their own, so that laws of motion
find it in every generation of the model. Near an edge the speed towards it is limited to what a
machine can take away on the way that is left; whoever got outside is brought back.
"""

from __future__ import annotations

import math

import mujoco

from usarsim_server.simulation.frames import Vector

__all__ = ["Bounds", "add_bounds"]

_NAME = "usarsim:bounds"
_BOTTOM = 0.5
"""m above the lower edge where machines are held: what falls below that edge is gone."""
_SHARE = 0.25
"""Of the way that is left per time constant: the edge is reached without going beyond it."""


def add_bounds(spec: mujoco.MjSpec, lower: Vector, upper: Vector) -> None:
    """Write the box of a world, by two corners (m), into its scene."""
    x, y, z = lower
    spec.add_numeric(name=_NAME, data=[x, y, min(z + _BOTTOM, upper[2]), *upper])


class Bounds:
    """The box of the world that a model was compiled from; endless if the model knows none."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Look it up."""
        names = [model.numeric(number).name for number in range(model.nnumeric)]
        values = model.numeric(_NAME).data.tolist() if _NAME in names else []
        self._edges = tuple(zip(values[:3], values[3:], strict=True))

    def hold(self, velocity: Vector, place: Vector, response: float, braking: float) -> Vector:
        """A velocity (m/s) as far as it does not lead out of the box.

        Args:
            velocity: wanted.
            place: of the machine, m.
            response: time constant with which it changes its velocity, s.
            braking: m/s^2 that it can give.
        """
        if not self._edges:
            return velocity
        rate = _SHARE / response
        x, y, z = (
            max(-_most(at - low, rate, braking), min(_most(high - at, rate, braking), speed))
            for speed, at, (low, high) in zip(velocity, place, self._edges, strict=True)
        )
        return x, y, z


def _most(way: float, rate: float, braking: float) -> float:
    """Most speed (m/s) towards an edge with this way left; negative, that is back, beyond it."""
    return math.copysign(min(rate * abs(way), math.sqrt(braking * abs(way))), way)
