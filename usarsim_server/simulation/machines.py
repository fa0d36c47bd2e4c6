"""Machines: bodies that go their own way by decisions, such as a door that opens for whoever comes.

A machine decides at fixed simulated times, between two halves of a step, by what it sees then; in
between its bodies follow functions of time like those of every other mover. So runs repeat
whatever the batches in which the physics advances. Used by the physics thread alone, between the
two halves of a step, when all poses are up to date.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.simulation.model import CompiledWorld
from usarsim_server.simulation.movers import Mover
from usarsim_server.simulation.parts import Part


@dataclass(frozen=True, slots=True)
class Zone:
    """A box: the pose of its middle in the world, and half its extents along its own axes, m."""

    pose: Pose
    half: Vector


class Presence:
    """What moves in a world, as one machine sees it, in one model generation.

    Whoever *goes by itself* is a robot, a person or something a client has put into the world;
    what is *loose* is that, and every free body of the scene beside. Bodies that hang in joints
    of the scene, such as a door that is pushed open, are neither.
    """

    def __init__(self, world: CompiledWorld, own: Collection[str], fixtures: Collection[str]):
        """Sort the bodies of a model.

        Those of `own`, the machine that looks, are not seen, nor `fixtures`, which belong to the
        building.
        """
        model = world.model
        hidden = {model.body(name).id for name in (*own, *fixtures)}
        slots = {body for layout in world.layouts for body in layout.bodies}
        free = model.jnt_bodyid[model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)].tolist()
        placed = np.flatnonzero(model.body_mocapid >= 0).tolist()
        # One body for the robot, person or thing that a body is a part of; robots in all
        # generations the same.
        owner = model.body_rootid.astype(np.intp)
        for layout in world.layouts:
            owner[list(layout.bodies)] = -1 - layout.slot
        roots = model.body_rootid[model.geom_bodyid]
        touches = (model.geom_contype | model.geom_conaffinity) != 0
        seen = touches & ~np.isin(roots, list(hidden))
        going = np.isin(model.geom_bodyid, list(slots)) | np.isin(roots, placed)
        loose = going | np.isin(roots, free)
        self._geoms = np.flatnonzero(seen & loose)
        self._going = going[self._geoms]
        self._owners = owner[model.geom_bodyid[self._geoms]]
        self._middle = model.geom_aabb[self._geoms, :3]
        self._half = model.geom_aabb[self._geoms, 3:]
        self._data: mujoco.MjData | None = None

    def look(self, data: mujoco.MjData) -> None:
        """Take the poses of this moment; to be called before anything is asked."""
        self._data = data

    def touching(self, zone: Zone, *, going: bool = False) -> frozenset[int]:
        """Who is in a zone, wholly or in part; `going`: only who goes by itself, else all loose.

        The numbers stand for robots, people and things; they are of use for comparisons only.
        """
        overlap, _ = self._compare(zone)
        if going:
            overlap &= self._going
        return frozenset(self._owners[overlap].tolist())

    def within(self, zone: Zone) -> frozenset[int]:
        """Who is in a zone with every part."""
        overlap, inside = self._compare(zone)
        found = set(self._owners[overlap].tolist())
        return frozenset(found - set(self._owners[~inside].tolist()))

    def _compare(self, zone: Zone) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which geoms overlap a zone, and which are inside, by boxes along the zone's axes."""
        assert self._data is not None
        turn = zone.pose.matrix()
        frames = self._data.geom_xmat[self._geoms].reshape(-1, 3, 3)
        middle = self._data.geom_xpos[self._geoms] + np.einsum("nij,nj->ni", frames, self._middle)
        middle = (middle - np.array(zone.pose.position)) @ turn
        half = np.einsum("nij,nj->ni", np.abs(turn.T @ frames), self._half)
        away, reach = np.abs(middle), np.array(zone.half)
        return (away < half + reach).all(axis=1), (away + half <= reach).all(axis=1)


DECISION_INTERVAL = 0.05
"""s of simulated time, to the nearest step, between two decisions of a machine."""


class Machine(ABC):
    """Something that decides how its bodies go on.

    Attributes:
        movers: place its bodies as decided last. A decision changes the ways from its own moment
            on, without a jump.
        building: it is a part of the building, like a door; others are seen by machines.
    """

    movers: tuple[Mover, ...] = ()
    building = True
    _decision: Any
    """The last one; immutable, and all that the machine remembers."""

    @abstractmethod
    def decide(self, time: float, presence: Presence) -> None:
        """Decide at a time: simulated s since the world began, or was put back.

        Called by the physics thread; must return at once.
        """

    def state(self) -> object:
        """What has been decided."""
        return self._decision

    def restore(self, state: object) -> None:
        """Go back to an earlier decision."""
        self._decision = state


class Machines(Part):
    """All machines of a world."""

    def __init__(self, world: CompiledWorld) -> None:
        self._world = world
        self._machines: tuple[Machine, ...] = ()
        self._presences: tuple[Presence, ...] = ()
        self._first: tuple[object, ...] = ()
        """What they had decided when they came."""
        self._epoch = 0.0
        self._every = max(1, round(DECISION_INTERVAL / float(world.model.opt.timestep)))

    def replace(self, machines: Sequence[Machine]) -> None:
        """Replace all machines.

        Raises:
            KeyError: if one of their bodies does not exist; the old ones stay.
        """
        bodies = [tuple(mover.body for mover in machine.movers) for machine in machines]
        pairs = zip(machines, bodies, strict=True)
        fixtures = [body for machine, own in pairs if machine.building for body in own]
        self._presences = tuple(Presence(self._world, own, fixtures) for own in bodies)
        self._machines = tuple(machines)
        self._first = tuple(machine.state() for machine in machines)

    def restart(self, time: float) -> None:
        """Let all machines begin anew at a simulated time (s), as if the world began then."""
        self._epoch = time
        for machine, first in zip(self._machines, self._first, strict=True):
            machine.restore(first)

    def between(self, data: mujoco.MjData) -> None:
        """Let all machines decide if it is time."""
        if not self._machines:
            return
        if round(data.time / data.model.opt.timestep) % self._every:
            return
        for machine, presence in zip(self._machines, self._presences, strict=True):
            presence.look(data)
            machine.decide(data.time - self._epoch, presence)

    def rests(self) -> bool:
        return not self._machines

    def state(self, data: mujoco.MjData) -> tuple[object, ...]:
        """What all have decided, for `restore`."""
        return tuple(machine.state() for machine in self._machines)

    def restore(self, data: mujoco.MjData, state: tuple[object, ...]) -> None:
        """Go back to earlier decisions."""
        for machine, one in zip(self._machines, state, strict=True):
            machine.restore(one)

    def inherit(
        self, older: Machines, slots: Sequence[int], data: mujoco.MjData, old: mujoco.MjData
    ) -> None:
        """Go on with the same machines, whose bodies have other numbers now."""
        self.replace(older._machines)
        self._first, self._epoch = older._first, older._epoch
