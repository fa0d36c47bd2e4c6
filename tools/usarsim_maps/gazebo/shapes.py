"""Visuals and collisions of an SDF link as parts (worlds reference 8 and 9.4).

Shapes that are none of the scene's own, ellipsoids, cones and polylines, become meshes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from usarsim_maps.gazebo.elements import (
    COLLISION,
    CONTACT,
    FRICTION,
    GEOMETRY,
    INERTIAL,
    LINK,
    MESH,
    SURFACE,
    VISUAL,
    Elements,
)
from usarsim_maps.gazebo.files import GazeboFiles
from usarsim_maps.gazebo.frames import frame_of, matrix_from
from usarsim_maps.gazebo.looks import Looks
from usarsim_maps.gazebo.models import Link
from usarsim_maps.gazebo.polylines import Outline, extruded
from usarsim_maps.geometry import points_of
from usarsim_maps.meshes.polygons import half_circle, lathe, merge_meshes
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
from usarsim_server.base.errors import MapImportError

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


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """A visual or a collision."""

    key: tuple[object, ...]
    shape: Shape
    matrix: Array  # (4, 4) in the frame of the link
    collision: Collision  # how it is felt
    material: str | None = None  # name of a visual's own material
    opacity: float = 1.0  # of a visual
    stands_in: bool = False  # for a mesh that cannot be had


@dataclass(slots=True)
class Shapes:
    """Makes parts; every mesh file is read once."""

    files: GazeboFiles  # finds meshes
    looks: Looks  # takes materials
    unit: float  # metres per unit of the world
    _elements: Elements = field(init=False)
    _scenes: dict[Path, Scene | None] = field(default_factory=dict)
    _meshes: dict[tuple[Path, str, bool], Mesh | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Count what is left out in the findings of the import."""
        self._elements = Elements(self.files.context.findings)

    def parts(self, link: Link, name: str) -> Iterator[Part]:
        """Parts of a link in its frame; what is seen and felt in the same shape is one part.

        Where visuals cannot be had the shapes of the collisions are seen, and where collisions
        cannot be had the shapes of the visuals are felt; a warning about `name` tells it.
        """
        self._elements.count(link.node, LINK, link.node.get("name"))
        seen, lost_looks = self._pieces(link, "visual")
        felt, lost_solids = self._pieces(link, "collision")
        looks = self._uncovered(felt, seen) if lost_looks else []
        solids = self._uncovered(seen, felt) if lost_solids else []
        if looks:
            self._warn(name, "a visual cannot be had; the shape of its collision is seen instead")
            # What is lost may still say how it looked.
            material, opacity = self.looks.of_visual(link.document, lost_looks[0])
            seen = [piece for piece in seen if not piece.stands_in]
            seen += [replace(piece, material=material, opacity=opacity) for piece in looks]
        if solids:
            self._warn(name, "a collision cannot be had; the shape of its visual is felt instead")
            felt = [piece for piece in felt if not piece.stands_in] + solids
        for piece in seen:
            twin = next((other for other in felt if _same(piece, other)), None)
            if twin is not None:
                felt.remove(twin)
            yield Part(
                piece.shape,
                piece.matrix,
                collision=Collision.NONE if twin is None else twin.collision,
                materials=self.looks.by_slot(piece.shape, piece.material, piece.opacity),
            )
        for piece in felt:
            yield Part(piece.shape, piece.matrix, visible=False, collision=piece.collision)

    def _pieces(self, link: Link, tag: str) -> tuple[list[_Piece], list[Node]]:
        """Visuals or collisions of a link, and those elements whose shape cannot be had."""
        pieces, lost = [], []
        for node in link.node.all(tag):
            if tag == "visual":
                self._elements.count(node, VISUAL, node.get("name"))
            elif not self._is_felt(node):
                continue
            piece = self._piece(link, node)
            if piece is None or piece.stands_in:
                geometry = node.child("geometry")
                kinds = [] if geometry is None else [child.tag for child in geometry.children]
                lost += [node] if kinds and kinds[0] not in ("empty", "heightmap") else []
            if piece is not None and tag == "visual":
                material, opacity = self.looks.of_visual(link.document, node)
                piece = replace(piece, material=material, opacity=opacity)
            pieces += [] if piece is None else [piece]
        return pieces, lost

    def _is_felt(self, collision: Node) -> bool:
        """Whether a collision collides; what else it says is counted."""
        name = collision.get("name")
        self._elements.count(collision, COLLISION, name)
        for path, table in (
            (("surface",), SURFACE),
            (("surface", "friction"), FRICTION),
            (("surface", "contact"), CONTACT),
        ):
            node = collision.child(*path)
            if node is not None:
                self._elements.count(node, table, name)
        mask = collision.word("surface", "contact", "collide_bitmask").lower()
        return mask not in ("0", "0x0", "0x00")

    def _uncovered(self, pieces: list[_Piece], others: list[_Piece]) -> list[_Piece]:
        """Pieces where no other one is: the middle of neither lies in the other's box."""
        there = [_box(other) for other in others if not other.stands_in]
        found = []
        for piece in pieces:
            if piece.stands_in:
                continue
            low, high = _box(piece)
            middle = (low + high) / 2.0
            covered = any(
                bool(((middle >= a) & (middle <= b)).all())
                or bool((((a + b) / 2.0 >= low) & ((a + b) / 2.0 <= high)).all())
                for a, b in there
            )
            found += [] if covered else [piece]
        return found

    def _warn(self, name: str, text: str) -> None:
        self.files.context.findings.warn(name, text)

    def friction(self, document: Document, link: Node) -> float | None:
        """Sliding friction of the first collision that has one."""
        for collision in link.all("collision"):
            value = document.number(collision.child("surface", "friction", "ode", "mu"), far=np.inf)
            if value is not None and value >= 0.0:
                return min(value, STEEPEST_FRICTION)
        return None

    def mass(self, document: Document, link: Node) -> float | None:
        """kg; None if the link does not say."""
        inertial = link.child("inertial")
        if inertial is not None:
            self._elements.count(inertial, INERTIAL, link.get("name"))
        value = document.number(link.child("inertial", "mass"))
        return value if value is not None and value > 0.0 else None

    # ---- geometries ------------------------------------------------------------------------

    def _piece(self, link: Link, node: Node) -> _Piece | None:
        """The shape of a visual or collision; None if there is none, or it cannot be had."""
        document, geometry = link.document, node.child("geometry")
        if geometry is None or not geometry.children:
            return None
        self._elements.count(geometry, GEOMETRY, node.get("name"))
        kind = geometry.children[0]
        for more in geometry.children[1:]:
            if kind.tag != "polyline" or more.tag != "polyline":
                self._elements.leave(f"geometry {more.tag}", node.get("name"))
        place = self._place(link, node)
        matrix = affine(place[:3, :3], place[:3, 3] * link.scale)
        if kind.tag == "mesh":
            self._elements.count(kind, MESH, node.get("name"))
            mesh = self._mesh(document, kind)
            if mesh is None:
                if not self.files.context.options.placeholders:
                    return None
                return _Piece(_key(geometry), PLACEHOLDER, matrix, Collision.AUTO, stands_in=True)
            scale = self._scale(document, kind) * self.unit * link.scale
            collision = {
                "convex_hull": Collision.HULL,
                "convex_decomposition": Collision.HULLS,
            }.get(kind.get("optimization"), Collision.AUTO)
            return _Piece(_key(geometry), mesh, matrix @ affine(np.diag(scale)), collision)
        shape = self._primitive(document, kind, geometry)
        if shape is None:
            return None
        if isinstance(shape, Plane):
            matrix = matrix @ self._tilt(document, kind)
        elif isinstance(shape, Mesh):
            matrix = matrix @ affine(np.diag(link.scale))
        else:
            shape = _sized(shape, np.abs(link.scale))
        return _Piece(_key(geometry), shape, matrix, Collision.AUTO)

    def _place(self, link: Link, node: Node) -> Array:
        """Pose of a visual or collision in its link."""
        pose = node.child("pose")
        matrix = matrix_from(link.document, pose, self.unit)
        reference = frame_of(pose)
        if not reference or reference == link.item.name:
            return matrix
        home = link.item.home
        own = np.linalg.inv(link.scope.place(link.item))
        return np.asarray(own @ link.scope.matrix(reference, home) @ matrix)

    def _primitive(self, document: Document, kind: Node, geometry: Node) -> Shape | None:
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
                return self._polylines(document, geometry)
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

    def _polylines(self, document: Document, geometry: Node) -> Mesh | None:
        """Prisms over the points that make sense, with holes where outlines lie in others."""
        outlines = []
        for kind in geometry.all("polyline"):
            points = [found for node in kind.all("point")
                      if (found := document.vector(node, 2)) is not None]  # fmt: skip
            if len(points) < 3:
                document.note(kind, "a polyline without three points was left out")
                continue
            height = document.number(kind.child("height"))
            high = max(1e-6, abs(1.0 if height is None else height)) * self.unit
            outlines.append(Outline(np.array(points) * self.unit, high))
        return extruded(outlines)

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
        """A mesh file, as Gazebo reads it: its unit counts, its axes do not (worlds 7).

        Those of FBX count, for most of its files have y up and hold what stands upright.
        """
        if path in self._scenes:
            return self._scenes[path]
        context = self.files.context
        scene: Scene | None = None
        if path.suffix.lower() not in mesh_extensions():
            context.findings.warn(path.name, "this kind of mesh is not read; export it as glTF")
        else:
            kind = path.suffix.lower()
            own = kind in (".dae", ".fbx", ".glb", ".gltf")
            options = ImportOptions(
                scale=None if own else 1.0,
                up=None if kind == ".fbx" else "Z",
                assets=context.options.assets,
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


def _box(piece: _Piece) -> tuple[Array, Array]:
    """Lower and upper corner in the frame of the link; endless for a plane."""
    points = points_of(Part(piece.shape, piece.matrix))
    if not len(points):
        return np.full(3, -np.inf), np.full(3, np.inf)
    return points.min(axis=0), points.max(axis=0)


def _sized(shape: Shape, scale: Array) -> Shape:
    """A shape other than a mesh or plane as Gazebo scales it: round ones stay round."""
    x, y, z = scale.tolist()
    match shape:
        case Box(size):
            return Box((size[0] * x, size[1] * y, size[2] * z))
        case Sphere(radius):
            return Sphere(radius * max(x, y, z))
        case Cylinder(radius, length):
            return Cylinder(radius * max(x, y), length * z)
        case Capsule(radius, length):
            return Capsule(radius * max(x, y), length * z)
    return shape
