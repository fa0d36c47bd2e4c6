"""Containing divergence: one body that goes mad must not take the world along.

MuJoCo would reset the whole world when one body diverges. Here a batch of steps that ends in
nonsense is taken back, the body whose absence lets it succeed is found by trial, and only that
one is put away.

The box of a world, in which machines stay that nothing else would stop: aircraft, submarines.

The box travels in the compiled model, as numbers of a name of their own, so that laws of motion
find it in every generation of the model. Near an edge the speed towards it is limited to what a
machine can take away on the way that is left; whoever got outside is brought back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import mujoco
import numpy as np

from usarsim_server.errors import UsarsimError
from usarsim_server.simulation.frames import Vector

SPEED_LIMIT = 1000.0
"""m/s and rad/s: a body that is faster has diverged."""


class Patient(Protocol):
    """A world whose last batch of steps can be taken back and tried again."""

    @property
    def data(self) -> mujoco.MjData:
        """Its live state."""

    def restore(self) -> None:
        """Go back to the state before the batch."""

    def run(self, steps: int) -> None:
        """Step, whatever comes of it."""

    def put_away(self, tree: int) -> None:
        """Put a kinematic tree, at rest, where it does no harm."""


def is_sound(data: mujoco.MjData) -> bool:
    """Whether a state is one that bodies can be in."""
    qvel = data.qvel
    if qvel.size and not (qvel.max() < SPEED_LIMIT and qvel.min() > -SPEED_LIMIT):
        return False
    return bool(np.isfinite(data.qpos).all())


def culprits(patient: Patient, steps: int) -> Sequence[int]:
    """Repeat a batch that failed without the kinematic trees that make it fail.

    Returns:
        The trees that were put away; none if the batch succeeded this time.

    Raises:
        UsarsimError: if the world diverges whatever is put away.
    """
    patient.restore()
    for _ in range(steps):
        patient.run(1)
        if not is_sound(patient.data):
            break
    else:
        return []  # whatever it was, it is gone
    suspects = _suspects(patient.data)
    everything = list(range(patient.data.model.ntree))
    trials = [[tree] for tree in suspects]
    trials += [suspects[:count] for count in range(2, len(suspects) + 1)]
    for trees in (*trials, everything):
        if _goes_without(patient, trees, steps):
            return trees
    raise UsarsimError("the physics of the world diverges, with robots and without")


def _suspects(data: mujoco.MjData) -> list[int]:
    """Kinematic trees in a bad state, the likeliest origin first.

    A value that is not finite spreads through the constraint solver within the step, but not
    through the accelerations before constraints; a finite one spreads by contact at most.
    """
    model = data.model
    speed = np.nan_to_num(np.abs(data.qvel), nan=SPEED_LIMIT, posinf=np.finfo(float).max)
    speed[~np.isfinite(data.qacc_smooth)] = np.inf
    worst = np.zeros(model.ntree)
    np.maximum.at(worst, model.dof_treeid, speed)
    order = [int(tree) for tree in np.argsort(-worst, kind="stable")]
    return [tree for tree in order if worst[tree] >= SPEED_LIMIT] or order


def _goes_without(patient: Patient, trees: Sequence[int], steps: int) -> bool:
    """Take the last batch back and repeat it with some trees put away."""
    patient.restore()
    for tree in trees:
        patient.put_away(tree)
    patient.run(steps)
    return is_sound(patient.data)


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
