"""Joints and hands of all robots, as the engine deals with them: one thing that has a state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.articulation import HandState, JointOrder
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.hands import Hands, HandsState
from usarsim_server.simulation.joints import JointServos, JointsState
from usarsim_server.simulation.model import CompiledWorld

Array = NDArray[np.float64]
LimbsState = tuple[JointsState, HandsState]


class Limbs:
    """Joint servos and hands of one model generation; used by the physics thread."""

    def __init__(self, world: CompiledWorld) -> None:
        self._joints = JointServos(world)
        self._hands = Hands(world)

    # -- orders ------------------------------------------------------------------------------

    def command(self, slot: int, orders: Mapping[str, JointOrder]) -> None:
        """Give orders to joints of a slot, see `JointServos.command`."""
        self._joints.command(slot, orders)

    def operate(self, data: mujoco.MjData, slot: int, hand: str, close: bool) -> bool:
        """Close or open a hand of a slot, see `Hands.operate`."""
        return self._hands.operate(data, slot, hand, close)

    # -- coming and going --------------------------------------------------------------------

    def release(self, slot: int) -> None:
        """Forget all orders to the joints of a slot."""
        self._joints.release(slot)

    def place(self, data: mujoco.MjData, slot: int, coordinates: Array) -> None:
        """The root of a slot has got new coordinates (7,): tools and anchor follow it."""
        x, y, z, w, i, j, k = coordinates.tolist()
        self._hands.place(data, slot, Pose((x, y, z), (w, i, j, k)))

    def drop(self, data: mujoco.MjData, tree: int) -> None:
        """A movable thing is about to be put elsewhere: let go of it."""
        self._hands.drop(data, tree)

    # -- stepping ----------------------------------------------------------------------------

    def update(self, data: mujoco.MjData) -> None:
        """Before every step."""
        self._joints.update(data.qpos)
        busy = self._joints.busy()
        if busy.size:
            # Zero, but not byte by byte: what sleeps wakes (see `engine.WAKE`).
            data.qvel[busy[data.qvel[busy] == 0.0]] = -0.0

    def apply(self, data: mujoco.MjData) -> None:
        """Between the two halves of every step."""
        self._joints.apply(data)

    def feel(self, data: mujoco.MjData) -> None:
        """After every few steps."""
        self._joints.feel(data)
        self._hands.update(data)

    # -- state -------------------------------------------------------------------------------

    def state(self, data: mujoco.MjData) -> LimbsState:
        """A copy of everything that changes, for `restore`."""
        return self._joints.state(), self._hands.state(data)

    def restore(self, data: mujoco.MjData, state: LimbsState) -> None:
        """Go back to a copied state of this generation."""
        joints, hands = state
        self._joints.restore(joints)
        self._hands.restore(data, hands)

    def inherit(
        self, data: mujoco.MjData, older: Limbs, old: mujoco.MjData, slots: Sequence[int]
    ) -> None:
        """Take over slots, which are the same there and here, from another generation."""
        self._joints.inherit(older._joints, slots)
        self._hands.inherit(data, older._hands, old, slots)

    def torques(self) -> Array:
        """Forces of the joint drives by velocity index, see `JointServos.torques`."""
        return self._joints.torques()

    def hands(self) -> dict[int, dict[str, HandState]]:
        """What all hands are doing, by slot and name."""
        return {slot: self._hands.states(slot) for slot in self._hands.slots()}
