"""Objects into the scene: fixed ones as geoms of the world, movable ones as bodies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from usarsim_maps.build.contact import collide
from usarsim_maps.build.cut_outs import CutOuts
from usarsim_maps.build.emitter import FELT, SEEN, Emitter, attributes, place
from usarsim_maps.build.level import GRIP, SMOOTH
from usarsim_maps.build.looks import Look, looks_of_mesh
from usarsim_maps.build.pieces import (
    BoxPiece,
    Convex,
    FieldPiece,
    Piece,
    Pushed,
    RoundPiece,
    bounding_box_piece,
    moved,
    volumes,
)
from usarsim_maps.build.sheet import NameBook
from usarsim_maps.build.soup import Soup, clean
from usarsim_maps.findings import Findings
from usarsim_maps.geometry import points_of, size_of
from usarsim_maps.scene import Array, Box, Collision, Mesh, Part, Plane, Scene, SceneObject
from usarsim_maps.units import matrix_of_pose, take_apart
from usarsim_server.base.errors import MapImportError, at
from usarsim_server.simulation.frames import Pose
from usarsim_server.worlds.description import NamedObject

DENSITY = 200.0
"""kg/m^3 of movable things without a mass: furniture is mostly air."""

LIGHTEST, HEAVIEST = 0.01, 1e5
"""kg: limits of what is believed."""


@dataclass(slots=True)
class _Baked:
    """A mesh with a linear map applied: shared by all its copies."""

    mesh: Mesh
    linear: Array
    soup: Soup
    slots: list[int] = field(default_factory=list)
    pieces: dict[tuple[object, ...], list[Piece]] = field(default_factory=dict)


class ObjectBuilder:
    """Puts the objects of one scene into an emitter."""

    def __init__(self, scene: Scene, emitter: Emitter, names: NameBook, findings: Findings) -> None:
        self.things: list[NamedObject] = []  # that were built, with the names of the map
        self._scene = scene
        self._emitter = emitter
        self._names = names
        self._findings = findings
        self._baked: dict[tuple[object, ...], _Baked] = {}
        self._cut_outs = CutOuts(emitter.finishes, findings)
        self._boxes = self._fields = self._pieces = self._dropped = 0

    def add(self, thing: SceneObject) -> None:
        """One object; `MapImportError` if a mesh refers to vertices that are not there."""
        if not thing.parts:
            return
        name = self._names.take(thing.name)
        lines = self._movable(thing, name) if thing.movable else list(self._fixed(thing, name))
        self._emitter.add_world(lines)
        self.things.append(
            NamedObject(name, thing.name, thing.tag, thing.kind, movable=thing.movable)
        )

    def finish(self) -> None:
        """Note the totals."""
        facts = {
            "object pieces": self._pieces,
            "object pieces that are boxes": self._boxes,
            "object pieces that are height fields": self._fields,
            "triangles dropped": self._dropped,
        }
        for fact, value in facts.items():
            if value:
                self._findings.fact(fact, value)

    # ---- fixed things ----------------------------------------------------------------------

    def _fixed(self, thing: SceneObject, name: str) -> Iterator[str]:
        labels = _labels(name, self._names)
        base = matrix_of_pose(thing.pose)
        for part in thing.parts:
            pose, linear = take_apart(base @ part.matrix)
            if not isinstance(part.shape, Mesh):
                yield from self._primitive(part, pose, linear, labels, thing)
                continue
            baked = self._bake(part.shape, linear, part)
            if part.visible:
                yield from self._show(baked, part, pose, labels)
            up = pose.inverse().rotate((0.0, 0.0, 1.0))
            for piece in self._solid(baked, part, np.array(up), thing):
                self._count(piece)
                friction = thing.friction
                if friction is None:
                    friction = _friction(piece, pose)
                self._emitter.add_solid(
                    piece, pose, friction, self._names.take(f"{thing.name}.solid")
                )

    # ---- movable things --------------------------------------------------------------------

    def _movable(self, thing: SceneObject, name: str) -> list[str]:
        seen: list[str] = []
        felt: list[Pushed] = []
        for part in thing.parts:
            pose, linear = take_apart(part.matrix)
            if isinstance(part.shape, Mesh):
                baked = self._bake(part.shape, linear, part)
                if part.visible:
                    seen += self._show(baked, part, pose, None)
                up = (thing.pose @ pose).inverse().rotate((0.0, 0.0, 1.0))
                pieces = self._solid(baked, part, np.array(up), thing)
                felt += [moved(p, pose) for p in pieces if not isinstance(p, FieldPiece)]
            elif isinstance(part.shape, Plane):
                self._findings.warn(thing.name, "an endless plane cannot move; it was left out")
            else:
                if part.visible:
                    seen += self._shape(part, pose, linear, None, {**SEEN, "mass": 0})
                if part.collision is not Collision.NONE:
                    felt.append(_piece(part.shape, linear, pose))
        if not felt:
            felt = [self._stand_in(thing)]
        self._pieces += len(felt)
        self._boxes += sum(isinstance(piece, BoxPiece) for piece in felt)
        sizes = np.maximum(volumes(felt), 1e-9)
        mass = thing.mass if thing.mass else float(sizes.sum()) * DENSITY
        mass = min(max(mass, LIGHTEST), HEAVIEST)
        friction = SMOOTH if thing.friction is None else thing.friction
        shares = (sizes / sizes.sum() * mass).tolist()
        return [
            f"<body{attributes({'name': name, **place(thing.pose)})}>",
            "<freejoint/>",
            *seen,
            *(
                self._emitter.body_piece(piece, friction, share)
                for piece, share in zip(felt, shares, strict=True)
            ),
            "</body>",
        ]

    def _stand_in(self, thing: SceneObject) -> Convex:
        self._findings.warn(thing.name, "a movable thing without solid parts got a box")
        points = [p for part in thing.parts for p in [points_of(part)] if len(p)]
        return bounding_box_piece(np.concatenate(points) if points else np.eye(3) * 0.1)

    # ---- shared ----------------------------------------------------------------------------

    def _bake(self, mesh: Mesh, linear: Array, part: Part) -> _Baked:
        names = mesh.materials or ("",)
        materials = [part.materials.get(slot, name) for slot, name in enumerate(names)]
        holes = tuple(name for name in materials if self._cut_outs.has_holes(name))
        key = (id(mesh), linear.tobytes(), *(materials if holes else ()))
        baked = self._baked.get(key)
        if baked is not None:
            return baked
        triangles = mesh.triangles
        with np.errstate(all="ignore"):
            vertices = mesh.vertices @ linear.T
        try:
            soup = clean(
                vertices,
                triangles[:, ::-1] if np.linalg.det(linear) < 0.0 else triangles,
            )
        except ValueError as error:
            path = self._scene.source.path
            cure = "export the mesh again"
            raise MapImportError(at(path, str(error), cure, where=f"mesh {mesh.name}")) from None
        baked = _Baked(mesh, linear, soup)
        self._dropped += soup.dropped
        looks: list[Look] = []
        for slot, look in looks_of_mesh(mesh, linear):
            baked.slots.append(slot)
            material = materials[slot] if 0 <= slot < len(materials) else look.material
            looks.append(self._cut_outs.cut(look, material))
        if looks:
            self._emitter.mesh_files(baked, mesh.name, looks)
        self._baked[key] = baked
        return baked

    def _show(
        self, baked: _Baked, part: Part, pose: Pose, labels: Iterator[str] | None
    ) -> list[str]:
        count = self._emitter.shown(baked)
        if not count:
            return []
        other = {
            number: part.materials[slot]
            for number, slot in enumerate(baked.slots)
            if slot in part.materials
        }
        names: Sequence[str | None] = [next(labels) if labels else None for _ in range(count)]
        return self._emitter.show(baked, pose, names, other, massless=labels is None)

    def _solid(self, baked: _Baked, part: Part, up: Array, thing: SceneObject) -> list[Piece]:
        key = (part.collision, thing.movable, *np.round(up, 2).tolist())
        if key not in baked.pieces:
            baked.pieces[key] = collide(
                baked.soup,
                part.collision,
                up,
                hulls=tuple(np.asarray(hull) @ baked.linear.T for hull in baked.mesh.hulls),
                movable=thing.movable,
                name=thing.name,
                findings=self._findings,
            )
        return baked.pieces[key]

    def _count(self, piece: Piece) -> None:
        self._pieces += 1
        self._boxes += isinstance(piece, BoxPiece)
        self._fields += isinstance(piece, FieldPiece)

    def _primitive(
        self, part: Part, pose: Pose, linear: Array, labels: Iterator[str], thing: SceneObject
    ) -> list[str]:
        """One geom that is seen, felt or both."""
        solid = part.collision is not Collision.NONE
        if not part.visible and not solid:
            return []
        values: dict[str, object] = {}
        if not solid:
            values = dict(SEEN)
        elif not part.visible:
            values = dict(FELT)
        if solid:
            values["friction"] = GRIP if thing.friction is None else thing.friction
            self._pieces += 1
            self._boxes += isinstance(part.shape, Box)
        return self._shape(part, pose, linear, labels, values)

    def _shape(
        self,
        part: Part,
        pose: Pose,
        linear: Array,
        labels: Iterator[str] | None,
        values: dict[str, object],
    ) -> list[str]:
        if "rgba" not in values:
            finish = self._emitter.finishes[part.materials.get(0, "")]
            values = {"material": finish.name, **values}
        kind, size = size_of(part.shape, linear)
        head = {"name": next(labels) if labels else None, "type": kind, "size": size}
        return [f"<geom{attributes({**head, **place(pose), **values})}/>"]


def _piece(shape: object, linear: Array, pose: Pose) -> Pushed:
    """The piece that is a shape other than a mesh or plane, scaled by a linear map (3, 3)."""
    kind, size = size_of(shape, linear)
    if isinstance(shape, Box):
        return BoxPiece(pose, (size[0], size[1], size[2]))
    return RoundPiece(kind, size, pose)


def _labels(name: str, names: NameBook) -> Iterator[str]:
    """The name of the object, then names derived from it."""
    yield name
    while True:
        yield names.take(f"{name}.part")


def _friction(piece: Piece, pose: Pose) -> float:
    """A wall is smooth: a piece that is thin along a level direction and higher than wide."""
    if isinstance(piece, BoxPiece):
        turn = (pose @ piece.pose).matrix()
        thin = int(np.argmin(piece.half))
        return SMOOTH if abs(turn[2, thin]) < 0.3 and piece.half[thin] < 0.1 else GRIP
    return GRIP


def materials_of_objects(objects: Sequence[SceneObject]) -> Iterator[str]:
    """Names of materials that objects use."""
    for thing in objects:
        for part in thing.parts:
            yield from part.materials.values()
            if isinstance(part.shape, Mesh):
                yield from part.shape.materials
    yield ""
