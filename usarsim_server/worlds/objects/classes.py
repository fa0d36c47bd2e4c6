"""Classes of objects that a world controller can create, as plain values, and their file.

`worlds/objects.toml` holds the shipped classes; an `objects.toml` in a world folder adds classes
for that world, or replaces shipped ones (docs/world-controller.md).
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from usarsim_server import errors
from usarsim_server.errors import WorldError
from usarsim_server.simulation.frames import Pose, Vector, quaternion_from_rpy
from usarsim_server.tables import read_toml
from usarsim_server.worlds.tables import Table

__all__ = [
    "SHAPES",
    "SHEET",
    "Material",
    "ObjectCatalog",
    "ObjectClass",
    "Part",
    "load_objects",
]

SHEET = "objects.toml"

SHAPES = ("box", "sphere", "cylinder", "cone", "wedge")
"""Cylinder and cone stand on end; a wedge rises along its x axis from the edge at -x."""

Color = Vector

_SMALLEST, _LARGEST = 1e-3, 100.0  # m
_LIGHTEST, _HEAVIEST = 1e-3, 1e5  # kg


@dataclass(frozen=True, slots=True)
class Material:
    """A name for looks, and for sensors that judge by names: colour and opacity (0 to 1)."""

    name: str
    color: Color
    opacity: float = 1.0


@dataclass(frozen=True, slots=True)
class Part:
    """A convex piece of an object.

    Attributes:
        shape: one of `SHAPES`.
        size: extents (m) along its own axes.
        pose: of its centre, in the frame of the object.
        color: None for the colour of the object.
    """

    shape: str
    size: Vector
    pose: Pose = Pose()  # noqa: RUF009 - immutable
    color: Color | None = None


@dataclass(frozen=True, slots=True)
class ObjectClass:
    """One class; its origin is the middle of its bounding box.

    Attributes:
        name: as clients call it, without package.
        parts: what it is made of.
        size: extents (m) of the bounding box.
        mass: kg.
        color: red, green, blue.
        friction: sliding friction; of two things that touch the larger counts.
        rolling: length (m) of rolling resistance; 0 for things that do not roll.
        aliases: further names.
    """

    name: str
    parts: tuple[Part, ...]
    size: Vector
    mass: float
    color: Color
    friction: float = 0.5
    rolling: float = 0.0
    aliases: tuple[str, ...] = ()


class ObjectCatalog:
    """All classes and materials by name, whatever the case."""

    def __init__(self, classes: Iterable[ObjectClass], materials: Iterable[Material]) -> None:
        """Collect classes; a later one replaces an earlier one, alias or not."""
        self._classes: dict[str, ObjectClass] = {}
        self._names: dict[str, ObjectClass] = {}
        for one in classes:
            self._classes[one.name.lower()] = one
            for name in (one.name, *one.aliases):
                self._names[name.lower()] = one
        self._materials = {material.name.lower(): material for material in materials}

    def find(self, name: str) -> ObjectClass | None:
        """The class of this name or alias; None if there is none."""
        return self._names.get(name.strip().lower())

    def material(self, name: str) -> Material | None:
        """The material of this name; None if there is none."""
        return self._materials.get(name.strip().lower())

    @property
    def classes(self) -> tuple[ObjectClass, ...]:
        """All classes, in the order of their names."""
        return tuple(self._classes[name] for name in sorted(self._classes))


def load_objects(sheets: Iterable[Path]) -> ObjectCatalog:
    """Read the files that exist; classes of later ones replace those of earlier ones.

    Raises:
        WorldError: naming file, key, what is wrong and what to write instead.
    """
    classes: list[ObjectClass] = []
    materials: list[Material] = []
    for sheet in sheets:
        if os.path.lexists(sheet):
            table = Table(sheet, read_toml(sheet, WorldError, "object"))
            found = [_material(entry) for entry in table.tables("material")]
            materials += found
            own = [_object_class(entry) for entry in table.tables("object")]
            table.finish()
            _check_unique(sheet, own)
            classes += own
    return ObjectCatalog(classes, materials)


def _material(table: Table) -> Material:
    material = Material(
        name=table.word("name"),
        color=_color(table, None) or (0.5, 0.5, 0.5),
        opacity=table.number("opacity", default=1.0, low=0.0, high=1.0),
    )
    table.finish()
    return material


def _object_class(table: Table) -> ObjectClass:
    name = table.word("name")
    aliases = table.words("aliases", default=())
    parts = tuple(_part(entry) for entry in table.tables("part"))
    if parts and table.has("shape"):
        raise table.error("shape", "stands beside [[object.part]]", "keep one of the two")
    parts = parts or (_shape(table),)
    middle, size = _bounding_box(parts)
    found = ObjectClass(
        name=name,
        parts=tuple(
            replace(part, pose=Pose(_minus(part.pose.position, middle), part.pose.quaternion))
            for part in parts
        ),
        size=size,
        mass=table.number("mass", default=_weight(parts), low=_LIGHTEST, high=_HEAVIEST),
        color=_color(table, (0.6, 0.6, 0.6)) or (0.6, 0.6, 0.6),
        friction=table.number("friction", default=0.5, low=0.0, high=5.0),
        rolling=table.number("rolling", default=0.0, low=0.0, high=1.0),
        aliases=aliases,
    )
    table.finish()
    return found


def _part(table: Table) -> Part:
    part = replace(
        _shape(table),
        pose=Pose(
            table.vector("position", default=(0.0, 0.0, 0.0)),
            quaternion_from_rpy(
                *map(math.radians, table.vector("rotation_degrees", default=(0.0, 0.0, 0.0)))
            ),
        ),
        color=_color(table, None),
    )
    table.finish()
    return part


def _shape(table: Table) -> Part:
    shape = table.choice("shape", SHAPES)
    size = table.vector("size")
    if not all(_SMALLEST <= extent <= _LARGEST for extent in size):
        raise table.error(
            "size", f"{size} is out of range", f"write extents from {_SMALLEST} to {_LARGEST} m"
        )
    return Part(shape, size)


def _color(table: Table, default: Color | None) -> Color | None:
    if not table.has("color") and default is None:
        return None
    color = table.vector("color", default=default)
    if not all(0.0 <= channel <= 1.0 for channel in color):
        raise table.error("color", f"{color} is out of range", "write numbers from 0 to 1")
    return color


def _bounding_box(parts: Iterable[Part]) -> tuple[Vector, Vector]:
    """Middle and extents of the box around all parts."""
    lower, upper = [math.inf] * 3, [-math.inf] * 3
    for part in parts:
        turn = abs(part.pose.matrix())
        half = turn @ [extent / 2.0 for extent in part.size]
        for axis in range(3):
            lower[axis] = min(lower[axis], part.pose.position[axis] - float(half[axis]))
            upper[axis] = max(upper[axis], part.pose.position[axis] + float(half[axis]))
    middle = [(low + high) / 2.0 for low, high in zip(lower, upper, strict=True)]
    size = [round(high - low, 9) for low, high in zip(lower, upper, strict=True)]
    return (middle[0], middle[1], middle[2]), (size[0], size[1], size[2])


DENSITY = 100.0
"""kg/m^3 of a class that names no mass: a box of cardboard with something in it."""


def _weight(parts: Iterable[Part]) -> float:
    return max(_LIGHTEST, min(_HEAVIEST, DENSITY * sum(math.prod(part.size) for part in parts)))


def _minus(one: Vector, other: Vector) -> Vector:
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]


def _check_unique(sheet: Path, classes: Iterable[ObjectClass]) -> None:
    seen: dict[str, str] = {}
    for one in classes:
        for name in (one.name, *one.aliases):
            other = seen.setdefault(name.lower(), name)
            if other is not name:
                problem = f"{name!r} stands there twice"
                cure = "give every class its own names; capitals make no difference"
                raise WorldError(errors.at(sheet, problem, cure, where=f"[[object]] {one.name}"))
