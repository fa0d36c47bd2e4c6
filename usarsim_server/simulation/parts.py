"""What works on the bodies of a world beside MuJoCo: wheels, joints, laws of motion, hands, ground.

All of it has one interface, so the engine need not know who has to be asked when.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mujoco

from usarsim_server.simulation.frames import Pose

MOST_AT_REST = 5
"""Steps of the longest batch that may be made in one call."""


class Part:
    """Something that takes part in every step of one model generation; physics thread.

    Whatever a part does not override does nothing, and costs nothing in a step.

    Attributes:
        empty: it has nothing in this generation that it could work on or that changes: it is asked
            about slots only.
    """

    empty = False

    # -- stepping, in the order of the calls -------------------------------------------------

    def begin(self, data: mujoco.MjData) -> None:
        """Before a batch of steps."""

    def before(self, data: mujoco.MjData) -> None:
        """Before the first half of every step, which finds the contacts."""

    def between(self, data: mujoco.MjData) -> None:
        """Between the halves: positions, velocities and constraint rows are up to date."""

    def after(self, data: mujoco.MjData) -> None:
        """After every step: its forces are known."""

    def end(self, data: mujoco.MjData) -> None:
        """After a batch of steps."""

    def rests(self) -> bool:
        """Whether it has nothing to do before, between and after the steps of the batch that has
        begun, of `MOST_AT_REST` at most."""
        return False

    # -- slots -------------------------------------------------------------------------------

    def occupy(self, slot: int) -> None:
        """A robot or thing takes a slot."""

    def release(self, slot: int, data: mujoco.MjData) -> None:
        """Forget all orders to a slot: it is taken, left or put away."""

    def place(self, slot: int, data: mujoco.MjData, pose: Pose) -> None:
        """The root of a slot has been put to a pose, at rest."""

    def drop(self, tree: int, data: mujoco.MjData) -> None:
        """A kinematic tree is about to be put elsewhere."""

    def drives(self, slot: int) -> bool:
        """Whether a slot is told to move, so that it must not sleep however slow it is."""
        return False

    # -- state -------------------------------------------------------------------------------

    def state(self, data: mujoco.MjData) -> Any:
        """A copy of everything that changes, for `restore`."""

    def restore(self, data: mujoco.MjData, state: Any) -> None:
        """Go back to a copied state of this generation."""

    def inherit(
        self, older: Any, slots: Sequence[int], data: mujoco.MjData, old: mujoco.MjData
    ) -> None:
        """Take over from the same part of an older generation, whose state is `old`.

        `slots` are those that are the same there and here.
        """


Hook = Callable[[mujoco.MjData], None]


class Parts:
    """Some parts that are asked one after the other, always in the same order."""

    def __init__(self, *parts: Part) -> None:
        self._all = parts
        self._filled = tuple(one for one in parts if not one.empty)
        self._begin = self._hooks("begin")
        self.before = self._hooks("before")
        self.between = self._hooks("between")
        self.after = self._hooks("after")
        self._end = self._hooks("end")
        """Of the parts that do anything there; loops over these are in the hot path."""
        self._driving = tuple(one for one in self._filled if _does(one, "drives"))
        self._changing = tuple(one for one in self._filled if _does(one, "state"))

    def _hooks(self, name: str) -> tuple[Hook, ...]:
        return tuple(getattr(one, name) for one in self._filled if _does(one, name))

    def stepping(self, but: tuple[type[Part], ...]) -> tuple[Part, ...]:
        """Those that do anything before, between or after steps, without those of some kinds."""
        steps = ("before", "between", "after")
        busy = (one for one in self._filled if any(_does(one, name) for name in steps))
        return tuple(one for one in busy if not isinstance(one, but))

    def begin(self, data: mujoco.MjData) -> None:
        """See `Part.begin`."""
        for hook in self._begin:
            hook(data)

    def end(self, data: mujoco.MjData) -> None:
        """See `Part.end`."""
        for hook in self._end:
            hook(data)

    def occupy(self, slot: int) -> None:
        """See `Part.occupy`."""
        for one in self._all:
            one.occupy(slot)

    def release(self, slot: int, data: mujoco.MjData) -> None:
        """See `Part.release`."""
        for one in self._all:
            one.release(slot, data)

    def place(self, slot: int, data: mujoco.MjData, pose: Pose) -> None:
        """See `Part.place`."""
        for one in self._all:
            one.place(slot, data, pose)

    def drop(self, tree: int, data: mujoco.MjData) -> None:
        """See `Part.drop`."""
        for one in self._all:
            one.drop(tree, data)

    def drives(self, slot: int) -> bool:
        """Whether any part is told to move a slot."""
        return any(one.drives(slot) for one in self._driving)

    def state(self, data: mujoco.MjData) -> tuple[Any, ...]:
        """A copy of everything that changes, for `restore`."""
        return tuple([one.state(data) for one in self._changing])

    def restore(self, data: mujoco.MjData, state: tuple[Any, ...]) -> None:
        """Go back to a copied state of this generation."""
        for one, kept in zip(self._changing, state, strict=True):
            one.restore(data, kept)

    def inherit(
        self, older: Parts, slots: Sequence[int], data: mujoco.MjData, old: mujoco.MjData
    ) -> None:
        """See `Part.inherit`."""
        for one, former in zip(self._all, older._all, strict=True):
            one.inherit(former, slots, data, old)


def _does(part: Part, name: str) -> bool:
    return getattr(type(part), name) is not getattr(Part, name)
