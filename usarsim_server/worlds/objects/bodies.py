"""Classes of objects that a world controller can create: their file, and their bodies at any scale.

`worlds/objects.toml` holds the shipped classes; an `objects.toml` in a world folder adds classes
for that world, or replaces shipped ones (docs/world-controller.md).

A piece that stays what it is when it is stretched (a box along its axes, a ball into an
ellipsoid) is one of MuJoCo's own shapes; everything else becomes a convex mesh.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from usarsim_server.base import errors
from usarsim_server.base.errors import WorldError
from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import read_toml
from usarsim_server.simulation.frames import Array, Pose, Vector, quaternion_from_rpy
from usarsim_server.simulation.model import RobotModel

SHEET = "objects.toml"

SHAPES = ("box", "sphere", "cylinder", "cone", "wedge")
"""Cylinder and cone stand on end; a wedge rises along its x axis from the edge at -x."""

Color = Vector

_SMALLEST, _LARGEST = 1e-3, 100.0  # m
_LIGHTEST, _HEAVIEST = 1e-3, 1e5  # kg


@dataclass(frozen=True, slots=True)
class Material:
    """A name for looks, and for sensors that judge by names."""

    name: str = field(parse=Table.word, expects="a name", help="what Create's Material may name")
    color: Color = field(default=(0.5, 0.5, 0.5), low=0.0, high=1.0, help="red, green, blue")
    opacity: float = field(default=1.0, low=0.0, high=1.0, help="0: nothing is seen of it")


@dataclass(frozen=True, slots=True)
class Part:
    """A convex piece of an object."""

    shape: str = field(choices=SHAPES, help="cylinder and cone stand on end, a wedge rises along x")
    size: Vector = field(
        unit="m", low=_SMALLEST, high=_LARGEST, help="full extents along its own axes"
    )
    pose: Pose = Pose()  # noqa: RUF009 - immutable
    """Of its centre, in the frame of the object."""
    color: Color | None = field(
        default=None, low=0.0, high=1.0, help="red, green, blue; else that of the object"
    )


@dataclass(frozen=True, slots=True)
class ObjectClass:
    """One class; its origin is the middle of its bounding box."""

    parts: tuple[Part, ...]  # what it is made of
    size: Vector  # extents (m) of the bounding box
    mass: float  # kg
    name: str = field(
        parse=Table.word, expects="a name", help="as clients call it, without package"
    )
    color: Color = field(default=(0.6, 0.6, 0.6), low=0.0, high=1.0, help="red, green, blue")
    friction: float = field(
        default=0.5, low=0.0, high=5.0, help="sliding; the larger of two counts"
    )
    rolling: float = field(default=0.0, low=0.0, high=1.0, help="m, resistance of what rolls")
    aliases: tuple[str, ...] = field(
        default=(), parse=Table.words, expects="a list of names", help="further names"
    )


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
            table = Table(read_toml(sheet, WorldError, "object"), sheet, WorldError)
            materials += table.all("material", Material)
            own = table.all("object", _object_class)
            table.finish()
            _check_unique(sheet, own)
            classes += own
    return ObjectCatalog(classes, materials)


def _read_turned(table: Table) -> Pose:
    """Position and `rotation_degrees`, either of which may be absent."""
    turn = table.vector("rotation_degrees", (0.0, 0.0, 0.0))
    return Pose(
        table.vector("position", (0.0, 0.0, 0.0)), quaternion_from_rpy(*map(math.radians, turn))
    )


def _object_class(table: Table) -> ObjectClass:
    parts = table.all("part", lambda part: part.read(Part, pose=_read_turned(part)))
    if parts and table.has("shape"):
        raise table.error("shape", "stands beside [[object.part]]", "keep one of the two")
    parts = parts or (table.read(Part, color=None),)
    middle, size = _bounding_box(parts)
    return table.read(
        ObjectClass,
        parts=tuple(
            replace(part, pose=Pose(_minus(part.pose.position, middle), part.pose.quaternion))
            for part in parts
        ),
        size=size,
        mass=table.number("mass", _weight(parts), low=_LIGHTEST, high=_HEAVIEST),
    )


def _bounding_box(parts: Sequence[Part]) -> tuple[Vector, Vector]:
    """Middle and extents of the box around all parts."""
    halves = [abs(part.pose.matrix()) @ (np.array(part.size) / 2.0) for part in parts]
    places = [np.array(part.pose.position) for part in parts]
    lower = np.min([place - half for place, half in zip(places, halves, strict=True)], axis=0)
    upper = np.max([place + half for place, half in zip(places, halves, strict=True)], axis=0)
    x, y, z = ((lower + upper) / 2.0).tolist()
    a, b, c = (round(extent, 9) for extent in (upper - lower).tolist())
    return (x, y, z), (a, b, c)


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


LARGEST_RIGID = 5.0
"""m: a rigid body that is larger would touch its neighbours where free slots are parked."""

SEGMENTS = 32
"""Corners of a round piece that has become a mesh."""
RINGS = 8

CONTACT_SOLREF = (0.02, 1.0)
CONTACT_SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)
"""As robots and scenery have them (robots reference 4.10)."""


def object_size(kind: ObjectClass, scale: Vector) -> Vector:
    """Extents (m) of an object of a class at a scale."""
    x, y, z = (extent * factor for extent, factor in zip(kind.size, scale, strict=True))
    return x, y, z


def object_model(
    kind: ObjectClass, scale: Vector, rigid: bool, material: Material | None = None
) -> RobotModel:
    """The body of an object of a class as the simulation wants it.

    Args:
        kind, scale: the class, and factors along its axes, all above 0.
        rigid: forces move it; otherwise it stays where it is put, or goes its own way.
        material: looks that replace the class's own.
    """
    look = "" if material is None else material.name.lower()
    key = f"object:{kind.name}:{','.join(map(repr, scale))}:{look}:{'rigid' if rigid else 'placed'}"
    return RobotModel(
        key=key,
        build=_builder(kind, scale, rigid, material),
        driven=(),
        rest_height=object_size(kind, scale)[2] / 2.0,
        kinematic=not rigid,
        robot=False,
    )


def _builder(
    kind: ObjectClass, scale: Vector, rigid: bool, material: Material | None
) -> Callable[[], mujoco.MjSpec]:
    def build() -> mujoco.MjSpec:
        spec = mujoco.MjSpec()
        base = spec.worldbody.add_body(name="base", mocap=not rigid)
        if rigid:
            base.add_freejoint(name="free")
        if material is not None:
            spec.add_material(name=material.name, rgba=[*material.color, material.opacity])
        volumes = [_volume(part) for part in kind.parts]
        mass = kind.mass * math.prod(scale)
        for number, part in enumerate(kind.parts):
            geom = _add_part(spec, base, part, scale, f"part{number}")
            geom.mass = mass * volumes[number] / sum(volumes)
            _finish(geom, kind, part, material)
        return spec

    return build


def _finish(geom: mujoco.MjsGeom, kind: ObjectClass, part: Part, material: Material | None) -> None:
    geom.friction = [kind.friction, 0.005 + kind.rolling, 0.0001 + kind.rolling]
    # Rolling resistance needs all six dimensions of a contact.
    geom.condim = 6 if kind.rolling else 3
    geom.solref, geom.solimp = CONTACT_SOLREF, CONTACT_SOLIMP
    if material is None:
        geom.rgba = [*(part.color or kind.color), 1.0]
    else:
        geom.material = material.name


def _add_part(
    spec: mujoco.MjSpec, base: mujoco.MjsBody, part: Part, scale: Vector, name: str
) -> mujoco.MjsGeom:
    size, factors = np.array(part.size), np.array(scale)
    kind = _own_shape(part, factors)
    if kind is None:
        points = _points(part) @ part.pose.matrix().T + np.array(part.pose.position)
        spec.add_mesh(name=name, uservert=(points * factors).ravel())
        return base.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
    half = size * factors / 2.0
    return base.add_geom(
        type=kind,
        size=[half[0], half[2], 0.0] if kind == mujoco.mjtGeom.mjGEOM_CYLINDER else half,
        pos=np.array(part.pose.position) * factors,
        quat=part.pose.quaternion,
    )


def _own_shape(part: Part, factors: Array) -> int | None:
    """MuJoCo's shape for a piece at a scale; None if only a mesh will do."""
    types = mujoco.mjtGeom
    even = np.allclose(factors, factors[0], rtol=1e-9)
    straight = abs(part.pose.quaternion[0]) > 1.0 - 1e-12
    if not (even or straight):
        return None
    size = np.array(part.size) * factors
    match part.shape:
        case "box":
            return int(types.mjGEOM_BOX)
        case "sphere":
            round_ = np.allclose(size, size[0], rtol=1e-9)
            return int(types.mjGEOM_SPHERE if round_ else types.mjGEOM_ELLIPSOID)
        case "cylinder" if math.isclose(size[0], size[1], rel_tol=1e-9):
            return int(types.mjGEOM_CYLINDER)
    return None


def _points(part: Part) -> Array:
    """Corners (n, 3) of a piece about its centre."""
    half = np.array(part.size) / 2.0
    angles = np.linspace(0.0, math.tau, SEGMENTS, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    match part.shape:
        case "box":
            unit = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
        case "wedge":
            unit = np.array(
                [[x, y, z] for x, z in ((-1, -1), (1, -1), (1, 1)) for y in (-1, 1)], dtype=float
            )
        case "cylinder":
            unit = np.concatenate([_lift(ring, -1.0), _lift(ring, 1.0)])
        case "cone":
            unit = np.concatenate([_lift(ring, -1.0), [[0.0, 0.0, 1.0]]])
        case _:
            heights = np.linspace(-math.pi / 2, math.pi / 2, RINGS + 1)[1:-1]
            rings = [_lift(ring * math.cos(height), math.sin(height)) for height in heights]
            unit = np.concatenate([*rings, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])
    return unit * half


def _lift(ring: Array, height: float) -> Array:
    return np.column_stack([ring, np.full(len(ring), height)])


def _volume(part: Part) -> float:
    """m^3, unscaled."""
    share = {"box": 1.0, "sphere": math.pi / 6, "cylinder": math.pi / 4, "cone": math.pi / 12}
    return math.prod(part.size) * share.get(part.shape, 0.5)
