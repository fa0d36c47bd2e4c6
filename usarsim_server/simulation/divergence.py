"""Containing divergence: one body that goes mad must not take the world along.

MuJoCo would reset the whole world when one body diverges. Here a batch of steps that ends in
nonsense is taken back, the body whose absence lets it succeed is found by trial, and only that
one is put away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import mujoco
import numpy as np

from usarsim_server.base.errors import UsarsimError
from usarsim_server.simulation.parts import Parts

SPEED_LIMIT = 1000.0
"""m/s and rad/s: a body that is faster has diverged."""


class Patient(Protocol):
    """A world whose last batch of steps can be taken back and tried again."""

    @property
    def data(self) -> mujoco.MjData:
        """Its live state."""

    def restore(self) -> None:
        """Go back to the state before the batch."""

    def run(self, steps: int) -> bool:
        """Step, whatever comes of it; whether the state is sound afterwards, see `is_sound`."""

    def put_away(self, tree: int) -> None:
        """Put a kinematic tree, at rest, where it does no harm."""


class Before:
    """The state before a batch of steps, of one model generation."""

    def __init__(self, data: mujoco.MjData, parts: Parts) -> None:
        """Keep nothing yet."""
        self._data, self._parts = data, parts
        # Of the same memory as long as the state lives; to ask for them every time is dearer.
        self._arrays = data.qpos, data.qvel, data.qacc_warmstart
        self.keep()

    def keep(self) -> None:
        """This is the state to go back to."""
        self._kept = [array.copy() for array in self._arrays]
        self._others = self._parts.state(self._data)

    def restore(self) -> None:
        """Go back to it."""
        for array, kept in zip(self._arrays, self._kept, strict=True):
            array[:] = kept
        self._parts.restore(self._data, self._others)


def is_sound(data: mujoco.MjData) -> bool:
    """Whether a state is one that bodies can be in."""
    qvel, qpos = data.qvel, data.qpos
    # Two short sums tell it nearly always: a vector is as long as its longest part, or longer.
    if qvel.dot(qvel) < SPEED_LIMIT**2 and qpos.dot(qpos) < np.inf:
        return True
    if qvel.size and not (qvel.max() < SPEED_LIMIT and qvel.min() > -SPEED_LIMIT):
        return False
    return bool(np.isfinite(qpos).all())


def culprits(patient: Patient, steps: int) -> Sequence[int]:
    """Repeat a batch that failed without the kinematic trees that make it fail.

    Returns:
        The trees that were put away; none if the batch succeeded this time.

    Raises:
        UsarsimError: if the world diverges whatever is put away.
    """
    patient.restore()
    for _ in range(steps):
        if not patient.run(1):
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
    return patient.run(steps)
