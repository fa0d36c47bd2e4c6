"""One object of a world controller, and the wish for one, as plain values.

What is below: the drop of an object to whatever it would land on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from usarsim_server.errors import SpawnError
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.simulation.movers import Way
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.worlds.objects.bodies import Material, ObjectClass, object_size
from usarsim_server.worlds.objects.paths import Fall, Path, Spin, motion


class Physics(Enum):
    """What becomes of an object where it was put (protocol reference 3.14)."""

    NONE = "none"
    """It stays there, in the air too."""
    RIGID = "rigidbody"
    """Forces move it."""
    FALLING = "falling"
    """It falls straight down until something is below, and stays there."""
    GROUND = "ground"
    """It is set down at once on whatever is below, and stays there."""


@dataclass(frozen=True, slots=True)
class Creation:
    """A wish for an object.

    Attributes:
        class_name: of the catalogue. name: None for any.
        pose: of its middle.
        scale: factors along its axes.
        physics, material, memory, permanent: see `WorldObject`.
    """

    class_name: str
    name: str | None
    pose: Pose
    scale: Vector = (1.0, 1.0, 1.0)
    physics: Physics = Physics.NONE
    material: str | None = None
    memory: str = ""
    permanent: bool = False


@dataclass(frozen=True, slots=True)
class WorldObject:
    """One object.

    Attributes:
        name: unique among the objects of the world, whatever the case.
        kind: its class. scale: factors along its axes. material: None for the looks of the class.
        physics: see there.
        memory: text that clients keep with it.
        permanent: spared when all objects are removed.
        owner: whoever created it.
        body: its number in the simulation.
        pose: where it was put last, or where its present motion began.
        path, spin, fall: how it moves from there.
        placed: it has a body that forces do not move at present.
    """

    name: str
    kind: ObjectClass
    scale: Vector
    material: Material | None
    physics: Physics
    memory: str
    permanent: bool
    owner: object
    body: int
    pose: Pose
    path: Path = Path()  # noqa: RUF009 - immutable
    spin: Spin | None = None
    fall: Fall | None = None
    placed: bool = True

    @property
    def size(self) -> Vector:
        """Extents along its axes, m."""
        return object_size(self.kind, self.scale)

    @property
    def moves(self) -> bool:
        """Whether it goes its own way."""
        return bool(self.path.points) or self.spin is not None or self.fall is not None

    def way(self) -> Way:
        """Its pose as a function of simulated time."""
        pose, path, spin, fall = self.pose, self.path, self.spin, self.fall
        return lambda time: motion(pose, path, spin, fall, time)


GRID = 7
"""Rays along each side of an object's outline."""
INSET = 1e-3
"""m by which the outermost rays are inside, so that they pass what the object only touches."""
FARTHEST = 1000.0


def drop_below(simulation: Simulation, pose: Pose, size: Vector, body: int | None = None) -> float:
    """How far (m) an object can be lowered until something is below; negative: it has to rise.

    The object counts as its bounding box, and only what is below its middle counts.

    Args:
        simulation: the world.
        pose: of its middle.
        size: extents along its own axes, m.
        body: its number if it is in the world already.

    Raises:
        SpawnError: if there is nothing below.
    """
    half = np.abs(pose.matrix()) @ (np.array(size) / 2.0)
    x, y = (np.linspace(-1.0, 1.0, GRID) * max(0.0, extent - INSET) for extent in half[:2])
    across, along = np.meshgrid(x, y)
    offsets = np.column_stack([across.ravel(), along.ravel(), np.zeros(GRID * GRID)])
    fan = RayFan(
        np.array(pose.position) + offsets, np.tile([0.0, 0.0, -1.0], (len(offsets), 1)), FARTHEST
    )
    hits = simulation.cast([fan], simulation.look(), body)[0]
    nearest = float(hits.distances.min())
    if not math.isfinite(nearest):
        raise SpawnError("there is nothing below")
    return nearest - float(half[2])
