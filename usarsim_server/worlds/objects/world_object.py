"""One object of a world controller, and the wish for one, as plain values."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.simulation.movers import Way
from usarsim_server.worlds.objects.classes import Material, ObjectClass
from usarsim_server.worlds.objects.models import object_size
from usarsim_server.worlds.objects.paths import Fall, Path, Spin, motion

__all__ = ["Creation", "Physics", "WorldObject"]


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
