"""A walk through a stage: shapes into objects, names into starts, lamps into lights."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Kind, Tf, Usd, UsdGeom

from usarsim_maps.meshes.mesh_files import Axes, SceneBuilder, collision_of
from usarsim_maps.meshes.polygons import check_count
from usarsim_maps.reader import Context
from usarsim_maps.scene import Array, Collision, Mesh, Part, Scene, SceneObject, Shape
from usarsim_maps.units import affine, matrix_of_pose
from usarsim_maps.usd.openusd.figures import Figures
from usarsim_maps.usd.openusd.lights import LIGHTS, light_of
from usarsim_maps.usd.openusd.materials import Finishes
from usarsim_maps.usd.openusd.meshes import MeshReader
from usarsim_maps.usd.openusd.physics import (
    collision,
    friction_of,
    is_collider,
    is_moved,
    mass_of,
)
from usarsim_maps.usd.openusd.primvars import NO_DISPLAY, Display, displays
from usarsim_maps.usd.openusd.shapes import SHAPES, shape_of
from usarsim_maps.usd.openusd.stage import has_samples
from usarsim_maps.usd.openusd.values import StageValues, matrix, shown_moment
from usarsim_maps.usd.schemas import API_SCHEMAS, PRIM_TYPES, PURPOSES, is_read
from usarsim_server.base.errors import MapImportError, at

MAX_PARTS = 200_000
"""Shapes of one stage, every copy counted."""

FARTHEST = 1e9
"""Coordinates beyond this are nonsense, in whatever units."""

MAX_DEPTH = 4
"""Instancers within instancers."""

VISIBLE = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
PROTOTYPES = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)
"""Prototypes of instancers need not be defined: exporters hide them that way."""

NETWORKS = ("Material", "NodeGraph", "Shader")
"""Types of prims below which nothing has a place."""

MARKER = re.compile(
    r"(playerstart|robotstart|startpose|startpoint|pathnode|(fe)?malevictim|victim)"
)
FOLDER = re.compile(r"(playerstart|robotstart|startpose|startpoint|pathnode|victim)s")
"""Names of markers, and of what only holds some; digits and underscores do not count."""

KINDS = {"start": "PlayerStart", "path_node": "PathNode", "victim": "Victim"}
"""Values of the custom attribute `usarsim:kind`."""


@dataclass(frozen=True, slots=True, eq=False)
class _Instance:
    """The copy that the walk is in: what is put before matrices, and after names."""

    prefix: Array
    suffix: str = ""
    depth: int = 0
    purpose: str = "default"  # of what has none of its own
    display: Display = NO_DISPLAY  # of what has no colour of its own


@dataclass(slots=True, eq=False)
class _Thing:
    """An object being collected; its shapes with matrix, whether only felt, and how."""

    prim: Any
    place: Array
    name: str
    suffix: str
    movable: bool
    display: Display
    shapes: list[tuple[Any, Array, bool, Collision]] = field(default_factory=list)


class StageReader(SceneBuilder):
    """Reads one stage into a scene."""

    def __init__(self, stage: Any, source: Path, context: Context, axes: Axes) -> None:
        super().__init__(source, context, axes)
        self._stage = stage
        self._progress = context.progress
        self._values = StageValues(shown_moment(stage))
        self._transforms = UsdGeom.XformCache(self._values.time)
        self._finishes = Finishes(self.pictures, context.findings, self._values)
        figures = Figures(context.findings, self._values, self._transforms)
        self._reader = MeshReader(self._finishes, context.findings, self._values, figures)
        self._animated = has_samples(stage)
        self._things: dict[str, _Thing] = {}
        self._guided: set[str] = set()
        self._parts = 0
        self._kilograms = _kilograms(stage)

    def filled(self, title: str, files: list[Path]) -> Scene:
        """Everything that is seen or felt."""
        self._walk(self._stage.GetPseudoRoot(), VISIBLE, _Instance(np.eye(4)))
        for number, thing in enumerate(self._things.values()):
            if number % 100 == 0:
                self._progress("objects", number / len(self._things))
            made = self._object(thing)
            if made is not None:
                self.objects.append(made)
        scene = self.scene(title, self._finishes.materials, files)
        return replace(scene, objects=tuple(self.objects))  # shapes know which of them are hulls

    # ---- the walk --------------------------------------------------------------------------

    def _walk(self, root: Any, predicate: Any, place: _Instance) -> None:
        walk = iter(Usd.PrimRange(root, predicate))
        for prim in walk:
            if prim.IsPseudoRoot():
                continue
            if not self._enter(prim, place):
                walk.PruneChildren()

    def _enter(self, prim: Any, place: _Instance) -> bool:
        """Take in one prim; whether to go on below it."""
        kind, name = str(prim.GetTypeName()), prim.GetName()
        if self._is_hidden(prim):
            shapes = sum(_is_shape(below) for below in Usd.PrimRange(prim, VISIBLE))
            self.findings.skip("invisible", name, max(1, shapes))
            return False
        self._tell(prim)
        if kind and not is_read(PRIM_TYPES, kind):
            self.findings.skip(kind, name)
            return True
        if kind in NETWORKS:
            return False
        if kind == "PointInstancer":
            self._instancer(prim, place)
            return False
        if not (_is_shape(prim) or kind in LIGHTS):
            return not self._marker(prim, place)
        purpose = self._purpose(prim, place)
        if not is_read(PURPOSES, purpose):
            self.findings.skip(purpose, name)
        elif kind in LIGHTS:
            self._light(prim, place)
        else:
            self._shape(prim, place, guide=purpose == UsdGeom.Tokens.guide)
        return True

    def _is_hidden(self, prim: Any) -> bool:
        """Whether a prim, and with it all below it, is not to be seen."""
        image = UsdGeom.Imageable(prim)
        if not image:
            return False
        if self._values.value(image.GetVisibilityAttr()) == UsdGeom.Tokens.invisible:
            return True
        only_rendered = self._values.text(prim, "renderVisibility")
        return bool(only_rendered == UsdGeom.Tokens.invisible)

    def _purpose(self, prim: Any, place: _Instance) -> str:
        """The purpose of a shape: its own, else that of the nearest prim above that has one."""
        found = UsdGeom.Imageable(prim).ComputePurposeInfo()
        return str(found.purpose) if found.isInheritable else place.purpose

    def _tell(self, prim: Any) -> None:
        """Count what is applied to a prim and has no effect in the world."""
        for schema in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
            base = str(schema).partition(":")[0]
            if not is_read(API_SCHEMAS, base):
                self.findings.skip(base, prim.GetName())
        if self._animated and UsdGeom.Xformable(prim).TransformMightBeTimeVarying():
            self.findings.skip("animation", prim.GetName())

    def _light(self, prim: Any, place: _Instance) -> None:
        here = self._matrix(prim, place)
        if not (np.abs(here) < FARTHEST).all():
            self.findings.warn(prim.GetName(), "a light at no place was left out")
            return
        self.findings.count(prim.GetTypeName())
        self.lights.append(light_of(prim, here, self.axes, self._values))

    def _matrix(self, prim: Any, place: _Instance) -> Array:
        """Whoever asks looks whether it is a place."""
        try:
            local = matrix(self._transforms.GetLocalToWorldTransform(prim))
        except Tf.ErrorException:  # an operation with a value of another type
            local = np.full((4, 4), np.nan)
        with np.errstate(invalid="ignore"):
            answer: Array = place.prefix @ local
        return answer

    def _instancer(self, prim: Any, place: _Instance) -> None:
        """All copies of an instancer, each at its place (worlds 32)."""
        instancer = UsdGeom.PointInstancer(prim)
        if place.depth >= MAX_DEPTH:
            self.findings.warn(prim.GetName(), "instancers within instancers are too deep")
            return
        targets = [self._stage.GetPrimAtPath(p) for p in instancer.GetPrototypesRel().GetTargets()]
        chosen = self._values.array(instancer.GetProtoIndicesAttr())
        how = UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
        time = self._values.time
        transforms = instancer.ComputeInstanceTransformsAtTime(time, time, *how)
        if chosen is None or transforms is None or len(transforms) != len(chosen):
            self.findings.warn(prim.GetName(), "an instancer without sound places was left out")
            return
        if len(chosen) > MAX_PARTS:
            raise self._too_many(len(chosen))
        mask = instancer.ComputeMaskAtTime(time) or [True] * len(chosen)
        self.findings.count("PointInstancer")
        outer = self._matrix(prim, place)
        purpose = self._purpose(prim, place)
        shades = displays(prim, len(chosen), place.display, self._values)
        for number, (index, transform, shown) in enumerate(
            zip(chosen, transforms, mask, strict=True)
        ):
            if not shown:
                self.findings.skip("invisible", prim.GetName())
                continue
            if not 0 <= index < len(targets) or not targets[int(index)]:
                self.findings.warn(prim.GetName(), "copies of what is not there were left out")
                continue
            target = targets[int(index)]
            own = matrix(self._transforms.GetLocalToWorldTransform(target))
            if abs(np.linalg.det(own)) < 1e-18:
                continue
            within, _ = self._transforms.GetLocalTransformation(target)
            prefix = outer @ matrix(transform) @ matrix(within) @ np.linalg.inv(own)
            suffix = f"{place.suffix}_{number}"
            copy = _Instance(prefix, suffix, place.depth + 1, purpose, shades[number])
            self._walk(target, PROTOTYPES, copy)

    # ---- shapes ----------------------------------------------------------------------------

    def _shape(self, prim: Any, place: _Instance, *, guide: bool) -> None:
        if guide and not is_collider(prim):
            self.findings.skip("guide that does not collide", prim.GetName())
            return
        self._parts += 1
        if self._parts > MAX_PARTS:
            raise self._too_many(self._parts)
        self.findings.count(prim.GetTypeName())
        owner = _owner(prim, self._values)
        key = f"{owner.GetPath()}{place.suffix}"
        if key not in self._things:
            name = f"{owner.GetName()}{place.suffix}"
            moved = is_moved(owner, self._values)
            self._things[key] = _Thing(
                owner, self._matrix(owner, place), name, place.suffix, moved, place.display
            )
        felt = collision(prim, self._values)
        announced = collision_of(prim.GetName())
        if announced is not None:
            guide, felt = True, announced
        if guide:
            self._guided.add(f"{prim.GetParent().GetPath()}{place.suffix}")
        self._things[key].shapes.append((prim, self._matrix(prim, place), guide, felt))

    def _too_many(self, count: int) -> MapImportError:
        problem = f"{count} shapes are more than {MAX_PARTS}"
        return MapImportError(at(self.path, problem, "export the map in smaller parts"))

    def _object(self, thing: _Thing) -> SceneObject | None:
        if not (np.abs(thing.place) < FARTHEST).all():
            self.findings.warn(thing.name, "a thing at no place was left out")
            return None
        pose, _ = self.axes.place(thing.place)
        back = matrix_of_pose(pose.inverse())
        whole = affine(self.axes.linear)
        parts = []
        friction = None
        for prim, place, guide, felt in thing.shapes:
            local = back @ whole @ place
            if not (np.abs(local) < FARTHEST).all():
                self.findings.warn(prim.GetName(), "a shape at no place was left out")
                continue
            found = self._build(prim, local, thing.display)
            if found is None:
                continue
            shape, local, material = found
            # Only collision shapes are felt where there are some beside a shape (worlds 35).
            beside = f"{prim.GetParent().GetPath()}{thing.suffix}" in self._guided
            solid = Collision.NONE if beside and not guide else felt
            names = {0: material} if material else {}
            parts.append(Part(shape, local, not guide, solid, names))
            if friction is None:
                friction = friction_of(prim, self._values)
        if not parts:
            return None
        return SceneObject(
            name=thing.name,
            parts=tuple(parts),
            pose=pose,
            tag=self._values.text(thing.prim, "usarsim:tag"),
            kind=_kind(thing.prim),
            movable=thing.movable,
            mass=mass_of(thing.prim, self._values, self._kilograms),
            friction=friction,
        )

    def _build(self, prim: Any, local: Array, display: Display) -> tuple[Shape, Array, str] | None:
        """A shape, its matrix, and the name of its material unless the shape knows its own."""
        if prim.GetTypeName() == "Mesh":
            mesh = self._reader.read(prim, display)
            check_count(self.path, self._reader.triangles)
            return None if mesh is None else (mesh, local, "")
        found = shape_of(prim, local, self._values)
        if found is None:
            self.findings.warn(prim.GetName(), "a shape without any size was left out")
            return None
        shape, place = found
        material = self._finishes.on_shape(prim, self._finishes.of(prim), display).name
        if isinstance(shape, Mesh):
            return replace(shape, materials=(material,)), place, ""
        return shape, place, material

    # ---- names with a meaning --------------------------------------------------------------

    def _marker(self, prim: Any, place: _Instance) -> bool:
        """Whether a prim is a start, a path node or a victim (worlds 38)."""
        kind = KINDS.get(self._values.text(prim, "usarsim:kind")) or _kind_by_name(prim)
        if not kind:
            return False
        name = f"{prim.GetName()}{place.suffix}"
        here = self._matrix(prim, place)
        if not (np.abs(here) < FARTHEST).all():
            self.findings.warn(name, "a thing at no place was left out")
            return True
        tag = (
            self._values.text(prim, "usarsim:tag")
            or self._values.text(prim, "userProperties:tag")
            or name
        )
        return self.mark(kind, here, tag)


def _kind_by_name(prim: Any) -> str:
    """What a prim's name, or that of the folder it is in, says it is; empty: nothing."""
    if prim.GetTypeName() not in ("Xform", ""):
        return ""
    plain = _letters(prim)
    if FOLDER.fullmatch(plain) and prim.GetChildren():
        return ""
    folder = _letters(prim.GetParent())
    if FOLDER.fullmatch(folder):
        return folder[:-1]
    if not MARKER.match(plain) or (_has_shapes(prim) and not MARKER.fullmatch(plain)):
        return ""
    return plain


def _letters(prim: Any) -> str:
    return re.sub(r"[^a-z]", "", prim.GetName().lower())


def _owner(prim: Any, values: StageValues) -> Any:
    """The prim that is the object of a shape.

    A rigid body owns what is in it; else an instance or a model of the kind `component`; else the
    nearest prim that brings in another file; else the shape itself, or what holds it alone.
    """
    chosen = model = None
    for here in _chain(prim):
        if is_moved(here, values):
            return here
        if here.IsInstance() or Usd.ModelAPI(here).GetKind() == Kind.Tokens.component:
            model = here
        elif chosen is None and (here.HasAuthoredReferences() or here.HasAuthoredPayloads()):
            chosen = here
    chosen = model or chosen or prim
    if chosen == prim or "component" in chosen.GetName().lower():
        parent = chosen.GetParent()
        if parent in _chain(chosen) and parent.GetTypeName() == "Xform" and _holds_one(parent):
            return parent
    return chosen


def _chain(prim: Any) -> list[Any]:
    """A prim and its ancestors, without the root of the stage and the prim that holds all."""
    top = prim.GetStage().GetDefaultPrim()
    answer = []
    while prim and not prim.IsPseudoRoot() and prim != top:
        answer.append(prim)
        prim = prim.GetParent()
    return answer


def _holds_one(prim: Any) -> bool:
    """Whether a prim holds a single thing, collision shapes and materials not counted."""
    count = 0
    for child in prim.GetFilteredChildren(VISIBLE):
        image = UsdGeom.Imageable(child)
        guide = image and image.ComputePurpose() == UsdGeom.Tokens.guide
        count += (
            bool(UsdGeom.Xformable(child)) and not guide and collision_of(child.GetName()) is None
        )
    return count == 1


def _has_shapes(prim: Any) -> bool:
    return any(_is_shape(below) for below in Usd.PrimRange(prim, VISIBLE))


def _is_shape(prim: Any) -> bool:
    return prim.GetTypeName() == "Mesh" or prim.GetTypeName() in SHAPES


def _kind(prim: Any) -> str:
    """The class in Unreal if the exporter has told it, else the type of the prim."""
    unreal = prim.GetAssetInfo().get("unreal", {})
    kind = unreal.get("assetType", "") if isinstance(unreal, dict) else ""
    return str(kind) or str(prim.GetTypeName()) or "prim"


def _kilograms(stage: Any) -> float:
    value = stage.GetMetadata("kilogramsPerUnit")
    return float(value) if isinstance(value, float) and 0.0 < value < 1e9 else 1.0
