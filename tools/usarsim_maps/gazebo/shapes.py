"""Visuals and collisions of an SDF link as parts (worlds reference 8 and 9.4).

Shapes that are none of the scene's own, ellipsoids, cones and prisms, become meshes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from usarsim_maps.gazebo.files import GazeboFiles
from usarsim_maps.gazebo.looks import Looks
from usarsim_maps.gazebo.models import Scope, matrix_from
from usarsim_maps.meshes.polygons import half_circle, lathe, merge_meshes, triangulate_one
from usarsim_maps.meshes.xml_text import Document, Node
from usarsim_maps.reader import ImportOptions, mesh_extensions, read_scene
from usarsim_maps.scene import (
    Array,
    Box,
    Capsule,
    Collision,
    Cylinder,
    Mesh,
    Part,
    Plane,
    Scene,
    Shape,
    Sphere,
)
from usarsim_maps.units import affine
from usarsim_server.errors import MapImportError

PLACEHOLDER = Box((0.5, 0.5, 0.5))

SIZES = {
    "box": {"size": 3},
    "ellipsoid": {"radii": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "cone": {"radius": 1, "length": 1},
}
"""Elements that say how large a shape is, and how many numbers each holds."""

STEEPEST_FRICTION = 2.0
"""Worlds write 100 and more for `it does not slip`."""

AROUND = 24
"""Corners of round things."""


def ball_mesh(radii: Sequence[float]) -> Mesh:
    """An ellipsoid around the origin; its hull is what collides."""
    ball = lathe("ellipsoid", half_circle(1.0, AROUND), AROUND)
    points = ball.vertices * np.array(radii)
    return replace(ball, vertices=points, hulls=(points,))


def cone_mesh(radius: float, length: float) -> Mesh:
    """A cone along z, centred, its tip upwards; its hull is what collides."""
    half = length / 2.0
    cone = lathe("cone", [(0.0, -half), (radius, -half), (0.0, half)], AROUND)
    return replace(cone, hulls=(cone.vertices,))


def prism_mesh(outline: Array, height: float) -> Mesh:
    """A polygon (n, 2) in the ground plane, extruded upwards."""
    count = len(outline)
    area = float(np.cross(
        np.column_stack([outline, np.zeros(count)]),
        np.column_stack([np.roll(outline, -1, axis=0), np.zeros(count)]),
    )[:, 2].sum())  # fmt: skip
    if area < 0.0:
        outline = outline[::-1]
    low = np.column_stack([outline, np.zeros(count)])
    high = np.column_stack([outline, np.full(count, height)])
    top = triangulate_one(high)
    faces = [(a + count, b + count, c + count) for a, b, c in top]
    faces += [(c, b, a) for a, b, c in top]
    for k in range(count):
        after = (k + 1) % count
        faces += [(k, after, after + count), (k, after + count, k + count)]
    points = np.concatenate([low, high])
    return Mesh("polyline", points, np.array(faces, dtype=np.int32).reshape(-1, 3))


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """A visual or a collision."""

    key: tuple[object, ...]
    shape: Shape
    matrix: Array
    collision: Collision


@dataclass(slots=True)
class Shapes:
    """Makes parts; every mesh file is read once."""

    files: GazeboFiles  # finds meshes
    looks: Looks  # takes materials
    unit: float  # metres per unit of the world
    _scenes: dict[Path, Scene | None] = field(default_factory=dict)
    _meshes: dict[tuple[Path, str, bool], Mesh | None] = field(default_factory=dict)

    def parts(self, document: Document, link: Node, scope: Scope) -> Iterator[Part]:
        """Parts of a link in its frame; what is seen and felt in the same shape is one part."""
        seen: list[tuple[_Piece, str | None]] = []
        for visual in link.all("visual"):
            piece = self._piece(document, visual, scope)
            if piece is not None:
                seen.append((piece, self.looks.of_visual(document, visual)))
        felt = []
        for collision in link.all("collision"):
            mask = collision.word("surface", "contact", "collide_bitmask").lower()
            if mask in ("0", "0x0", "0x00"):
                continue
            piece = self._piece(document, collision, scope)
            if piece is not None:
                felt.append(piece)
        for piece, material in seen:
            twin = next((other for other in felt if _same(piece, other)), None)
            if twin is not None:
                felt.remove(twin)
            yield Part(
                piece.shape,
                piece.matrix,
                collision=Collision.NONE if twin is None else twin.collision,
                materials=_materials(piece.shape, material),
            )
        for piece in felt:
            yield Part(piece.shape, piece.matrix, visible=False, collision=piece.collision)

    def friction(self, document: Document, link: Node) -> float | None:
        """Sliding friction of the first collision that has one."""
        for collision in link.all("collision"):
            value = document.number(collision.child("surface", "friction", "ode", "mu"), far=np.inf)
            if value is not None and value >= 0.0:
                return min(value, STEEPEST_FRICTION)
        return None

    def mass(self, document: Document, link: Node) -> float | None:
        """kg; None if the link does not say."""
        value = document.number(link.child("inertial", "mass"))
        return value if value is not None and value > 0.0 else None

    # ---- geometries ------------------------------------------------------------------------

    def _piece(self, document: Document, node: Node, scope: Scope) -> _Piece | None:
        geometry = node.child("geometry")
        if geometry is None or not geometry.children:
            return None
        kind = geometry.children[0]
        matrix = self._place(document, node, scope)
        collision = Collision.AUTO
        shape: Shape | None
        if kind.tag == "mesh":
            shape = self._mesh(document, kind)
            if shape is None:
                if not self.files.context.options.placeholders:
                    return None
                shape = PLACEHOLDER
            else:
                matrix = matrix @ affine(np.diag(self._scale(document, kind)) * self.unit)
                collision = {
                    "convex_hull": Collision.HULL,
                    "convex_decomposition": Collision.HULLS,
                }.get(kind.get("optimization"), Collision.AUTO)
        else:
            shape = self._primitive(document, kind)
            if isinstance(shape, Plane):
                matrix = matrix @ self._tilt(document, kind)
        if shape is None:
            return None
        return _Piece(_key(kind), shape, matrix, collision)

    def _place(self, document: Document, node: Node, scope: Scope) -> Array:
        """Pose of a visual or collision in its link."""
        pose = node.child("pose")
        if pose is None:
            return np.eye(4)
        reference = pose.get("relative_to")
        matrix = matrix_from(document, pose, self.unit)
        if not reference:
            return matrix
        link = scope.matrix(next((n.get("name") for n in scope.owner.all("link")
                                  if node in n.children), ""))  # fmt: skip
        return np.asarray(np.linalg.inv(link) @ scope.matrix(reference) @ matrix)

    def _primitive(self, document: Document, kind: Node) -> Shape | None:
        """A shape; None, and a finding, if its size makes no sense."""
        sizes = self._lengths(document, kind)
        match kind.tag, sizes:
            case "box", [x, y, z]:
                return Box((x, y, z))
            case "ellipsoid", [_, _, _]:
                return ball_mesh(sizes)
            case "sphere", [radius]:
                return Sphere(radius)
            case "cylinder", [radius, length]:
                return Cylinder(radius, length)
            case "capsule", [radius, length]:
                return Capsule(radius, length)
            case "cone", [radius, length]:
                return cone_mesh(radius, length)
            case "plane", _:
                size = document.vector(kind.child("size"), 2)
                x, y = (100.0, 100.0) if size is None else np.abs(size * self.unit).tolist()
                return Plane((x, y))
            case "polyline", _:
                return self._polyline(document, kind)
            case "empty" | "heightmap", _:
                return None
        if kind.tag not in SIZES:
            self.files.context.findings.skip(f"geometry {kind.tag}")
        return None

    def _lengths(self, document: Document, kind: Node) -> list[float]:
        """The lengths of a shape, m, in the order of `SIZES`; none if one makes no sense."""
        found: list[float] = []
        for name, count in SIZES.get(kind.tag, {}).items():
            node = kind.child(name)
            if node is None:
                document.note(kind, f"a {kind.tag} without {name} was left out")
            values = document.vector(node, count)
            if values is None:
                return []
            found += np.maximum(np.abs(values * self.unit), 1e-6).tolist()
        return found

    def _tilt(self, document: Document, kind: Node) -> Array:
        """Matrix that turns z into the normal of a plane."""
        normal = document.vector(kind.child("normal"), 3)
        length = 0.0 if normal is None else float(np.linalg.norm(normal))
        if normal is None or length < 1e-9:
            return np.eye(4)
        z = normal / length
        x = np.cross(z, [0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0])
        x = -x if x[0] < 0.0 else x
        x = x / np.linalg.norm(x)
        return affine(np.column_stack([x, np.cross(z, x), z]))

    def _polyline(self, document: Document, kind: Node) -> Mesh | None:
        """A prism over the points that make sense."""
        points = [found for node in kind.all("point")
                  if (found := document.vector(node, 2)) is not None]  # fmt: skip
        if len(points) < 3:
            return None
        height = document.number(kind.child("height"))
        high = max(1e-6, abs(1.0 if height is None else height)) * self.unit
        return prism_mesh(np.array(points) * self.unit, high)

    # ---- meshes ----------------------------------------------------------------------------

    def _scale(self, document: Document, kind: Node) -> Array:
        values = document.vector_or(kind.child("scale"), np.ones(3), 1, 3)
        return np.repeat(values, 3) if len(values) == 1 else values

    def _mesh(self, document: Document, kind: Node) -> Mesh | None:
        uri = kind.word("uri") or kind.word("filename") or kind.get("filename")
        path = self.files.file(uri, document.path)
        findings = self.files.context.findings
        if path is None:
            findings.missing("mesh", uri[:200])
            return None
        name, center = kind.word("submesh", "name"), kind.word("submesh", "center")
        key = (path, name, center.lower() in ("true", "1"))
        if key not in self._meshes:
            self._meshes[key] = self._part_of(path, name, key[2])
        if self._meshes[key] is None:
            findings.missing("mesh", f"{uri[:200]} {name}".strip())
        return self._meshes[key]

    def _part_of(self, path: Path, name: str, center: bool) -> Mesh | None:
        scene = self._scene(path)
        if scene is None:
            return None
        if name:
            chosen = [thing for thing in scene.objects if _named(thing.name, name)]
            chosen = chosen or [
                thing
                for thing in scene.objects
                if any(
                    isinstance(p.shape, Mesh) and _named(p.shape.name, name) for p in thing.parts
                )
            ]
            if not chosen:
                return None
            scene = replace(scene, objects=tuple(chosen))
        mesh = merge_meshes(scene, f"{path.stem}.{name}" if name else path.stem)
        if mesh is not None and center and len(mesh.triangles):
            used = mesh.vertices[np.unique(mesh.triangles)]
            middle = (used.min(axis=0) + used.max(axis=0)) / 2.0
            mesh = replace(mesh, vertices=mesh.vertices - middle)
        return mesh

    def _scene(self, path: Path) -> Scene | None:
        """A mesh file, as Gazebo reads it: its unit counts, its axes do not (reference 7)."""
        if path in self._scenes:
            return self._scenes[path]
        context = self.files.context
        scene: Scene | None = None
        if path.suffix.lower() not in mesh_extensions():
            context.findings.warn(path.name, "this kind of mesh is not read; export it as glTF")
        else:
            own = path.suffix.lower() in (".dae", ".glb", ".gltf")
            options = ImportOptions(
                scale=None if own else 1.0, up="Z", assets=context.options.assets
            )
            try:
                scene = read_scene(path, replace(context, options=options))
            except MapImportError as error:
                context.findings.warn(path.name, str(error))
            else:
                self.files.files.extend(scene.source.files)
                scene = self._entered(scene, path)
        self._scenes[path] = scene
        return scene

    def _entered(self, scene: Scene, path: Path) -> Scene:
        """The scene with its materials under the names that they have in the whole world."""
        names = {
            name: self.looks.add(material, path.stem) for name, material in scene.materials.items()
        }
        if all(name == new for name, new in names.items()):
            return scene
        objects = []
        for thing in scene.objects:
            parts = []
            for part in thing.parts:
                own = part.shape.materials if isinstance(part.shape, Mesh) else ()
                used = dict(enumerate(own)) | dict(part.materials)
                renamed = {slot: names.get(name, name) for slot, name in used.items()}
                parts.append(replace(part, materials=renamed))
            objects.append(replace(thing, parts=tuple(parts)))
        return replace(scene, objects=tuple(objects))


def _named(name: str, wanted: str) -> bool:
    """Names of submeshes, in which exporters exchange characters."""
    plain = re.sub(r"[^a-z0-9]", "", name.lower())
    return plain == re.sub(r"[^a-z0-9]", "", wanted.lower())


def _key(node: Node) -> tuple[object, ...]:
    """What makes two geometries equal; of planes size does not count, they have no end."""
    if node.tag == "plane":
        return ("plane", " ".join(node.word("normal", default="0 0 1").split()))
    inner = tuple(_key(child) for child in node.children)
    return (node.tag, " ".join(node.text.split()), inner)


def _same(one: _Piece, other: _Piece) -> bool:
    return one.key == other.key and bool(np.abs(one.matrix - other.matrix).max() < 1e-6)


def _materials(shape: Shape, material: str | None) -> dict[int, str]:
    """A material of the visual covers all slots of a mesh."""
    if material is None:
        return {}
    count = max(1, len(shape.materials)) if isinstance(shape, Mesh) else 1
    return dict.fromkeys(range(count), material)
