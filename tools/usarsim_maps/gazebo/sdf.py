"""Reads Gazebo worlds and models: `.world`, `.sdf`, `model.config`, `.urdf` (worlds reference 8).

Also their height maps: a grey picture whose brightest point is as high as the size says.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from usarsim_maps.files import open_picture
from usarsim_maps.findings import Findings
from usarsim_maps.gazebo.elements import HEIGHTMAP, ROOT, TABLES, Elements
from usarsim_maps.gazebo.files import GazeboFiles, gazebo_folders
from usarsim_maps.gazebo.frames import Item, matrix_from
from usarsim_maps.gazebo.looks import Looks, dimmed, light_of, sun
from usarsim_maps.gazebo.models import Body, Link, Models, is_start
from usarsim_maps.gazebo.places import commented_starts, find_placement, starts_of, victim_of
from usarsim_maps.gazebo.shapes import PLACEHOLDER, Shapes
from usarsim_maps.gazebo.urdf import model_of, xacro_refusal
from usarsim_maps.meshes.mesh_files import Pictures
from usarsim_maps.meshes.xml_text import Document, Node, read_xml
from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import (
    Array,
    Heightfield,
    Light,
    Material,
    Part,
    Plane,
    Scene,
    SceneObject,
    Source,
)
from usarsim_maps.units import affine, axis_matrix, matrix_of_pose, pose_of_matrix, reflect
from usarsim_server.base.errors import MapImportError
from usarsim_server.worlds.description import StartPose, Victim

MAX_BYTES = 256 << 20
EARTH = 9.8
LARGEST = 1025
"""Rows and columns; larger pictures are reduced."""


@dataclass(slots=True)
class Terrain:
    """Reads height maps."""

    files: GazeboFiles  # finds pictures
    looks: Looks  # takes materials
    unit: float  # metres per unit of the world

    def fields(self, link: Link, matrix: Array, name: str) -> list[Heightfield]:
        """The terrain of a link, whose matrix is (4, 4), once even if it is seen and felt."""
        for owner in (*link.node.all("collision"), *link.node.all("visual")):
            node = owner.child("geometry", "heightmap")
            if node is not None:
                Elements(link.document.findings).count(node, HEIGHTMAP, name)
                placed = matrix @ matrix_from(link.document, owner.child("pose"), self.unit)
                field = self._field(link.document, node, placed, name)
                return [] if field is None else [field]
        return []

    def _field(
        self, document: Document, node: Node, matrix: Array, name: str
    ) -> Heightfield | None:
        findings = self.files.context.findings
        uri = node.word("uri")
        path = self.files.file(uri, document.path)
        if path is None:
            findings.missing("file", uri[:200])
            return None
        rows = self._rows(path)
        if rows is None:
            return None
        size = document.vector_or(node.child("size"), np.ones(3), 3) * self.unit
        middle = document.vector_or(node.child("pos"), np.zeros(3), 3) * self.unit
        if not (size[:2] > 0.0).all():
            document.note(node, f"a height map of {size[0]:g} by {size[1]:g} m was left out")
            return None
        corner = affine(offset=middle - [size[0] / 2.0, size[1] / 2.0, 0.0])
        return Heightfield(
            name=name,
            heights=rows * size[2],
            spacing=(float(size[0] / (rows.shape[1] - 1)), float(size[1] / (rows.shape[0] - 1))),
            pose=pose_of_matrix(matrix @ corner),
            material=self._material(document, node),
        )

    def _rows(self, path: Path) -> Array | None:
        """Heights from 0 to 1; the first row is at the lowest y, the lower edge of the picture."""
        findings = self.files.context.findings
        try:
            with open_picture(path, path.name) as image:
                deep = image.mode.startswith(("I", "F"))
                grey = image.convert("F") if deep else image.convert("L").convert("F")
                if max(grey.size) > LARGEST:
                    findings.warn(path.name, f"the terrain was reduced to {LARGEST} points a side")
                    grey.thumbnail((LARGEST, LARGEST))
                rows = np.array(grey, dtype=float)[::-1]
        except MapImportError as error:
            findings.warn(path.name, str(error))
            return None
        if min(rows.shape) < 2:
            findings.warn(path.name, "a height map needs two pixels each way")
            return None
        return np.asarray(np.nan_to_num(rows) / max(float(np.nan_to_num(rows).max()), 1e-9))

    def _material(self, document: Document, node: Node) -> str:
        picture = node.word("texture", "diffuse")
        if not picture:
            return ""
        found = self.files.file(picture, document.path)
        if found is None:
            found = Pictures(document.path, self.files.context).find(picture)
        return self.looks.add(Material(Path(picture).stem, (1.0, 1.0, 1.0, 1.0), found))


@register("sdf")
class SdfReader(Reader):
    """Worlds and single models."""

    title = "Gazebo SDF"
    extensions = (".world", ".sdf", ".config", ".urdf", ".xacro")
    meshes = False
    head = re.compile(rb"<(sdf|gazebo|robot)[\s>]")
    support = TABLES

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`; an error names the line (worlds 73)."""
        document = read_xml(source, limit=MAX_BYTES, findings=context.findings)
        if source.suffix.lower() == ".xacro":
            raise xacro_refusal(document, document.root)
        folders = context.confined().with_more(gazebo_folders())
        context = replace(context, folders=folders)
        files = GazeboFiles(source, context)
        if document.root.tag == "model" and document.root.child("sdf") is not None:
            found = files.sdf(source.parent)
            if found is None or found == source:
                problem = "the model's SDF file is missing"
                raise document.error(document.root, problem, "keep the files of a model together")
            document = read_xml(found, limit=MAX_BYTES, findings=context.findings)
        if document.root.tag == "robot":
            document = model_of(document, context.findings)
        if document.root.tag not in ("sdf", "gazebo"):
            problem = f"a file of <{document.root.tag}> is no Gazebo world"
            raise document.error(document.root, problem, "give a .world, .sdf or .urdf file")
        scene = _World(source, document, files, context).scene()
        return reflect(scene) if context.options.mirror else scene


class _World:
    """A scene being filled."""

    def __init__(
        self, source: Path, document: Document, files: GazeboFiles, context: Context
    ) -> None:
        self._source = source
        self._document = document
        self._files = files
        self._context = context
        self._findings: Findings = context.findings
        self._scale = context.options.scale or 1.0
        self._unit = 1.0 / self._scale
        self._looks = Looks(files)
        self._shapes = Shapes(files, self._looks, self._unit)
        self._models = Models(files, self._unit)
        self._terrain = Terrain(files, self._looks, self._unit)
        self._heightfields: list[Heightfield] = []
        self._root = affine(axis_matrix(context.options.up or "Z"))
        self._objects: list[SceneObject] = []
        self._victims: list[Victim] = []
        self._lights: list[Light] = []

    def scene(self) -> Scene:
        """Everything in the file."""
        world = self._document.root.child("world")
        owner = self._document.root if world is None else world
        self._root_elements(world)
        bodies = self._models.world(self._document, owner)
        for number, body in enumerate(bodies):
            if number % 50 == 0:
                self._context.progress("models", number / len(bodies))
            self._body(body)
        for document, light, matrix in self._models.lights:
            self._lights.append(light_of(document, light, self._root @ matrix, self._unit))
        self._builtin()
        self._models.count_unmet()
        self._rest(owner)
        starts, victims = self._places()
        return Scene(
            source=Source(
                self._source,
                "Gazebo SDF",
                units_per_metre=self._scale,
                up=self._context.options.up or "Z",
                stated=self._context.options.scale is None,
                whole_map=world is not None,
                files=tuple(dict.fromkeys([self._source, self._document.path, *self._files.files])),
            ),
            objects=tuple(self._objects),
            heightfields=tuple(self._heightfields),
            materials=dict(self._looks.materials),
            starts=tuple(starts),
            victims=tuple(victims),
            lights=tuple(dimmed(self._lights)),
        )

    def _root_elements(self, world: Node | None) -> None:
        """Count what stands beside the world, or the models, and is left out."""
        elements = Elements(self._findings)
        if world is not None:
            for child in self._document.root.children:
                if child.tag in ("world", "model", "light") and child is not world:
                    elements.leave(child.tag, child.get("name"))
                elif not is_start(child):
                    elements.count_child(child, ROOT)

    # ---- models ----------------------------------------------------------------------------

    def _body(self, body: Body) -> None:
        """One object out of links that move together, or a victim."""
        if body.person is not None:
            self._victim(body)
            return
        self._findings.count("model" if body.static else "movable model")
        matrix = self._root @ body.matrix
        back = np.linalg.inv(body.matrix)
        parts: list[Part] = []
        masses, friction = [], None
        for link in body.links:
            local = back @ link.matrix
            for part in self._shapes.parts(link, body.name):
                parts.append(replace(part, matrix=local @ part.matrix))
            masses.append(self._shapes.mass(link.document, link.node))
            if friction is None:
                friction = self._shapes.friction(link.document, link.node)
            self._heightfields += self._terrain.fields(link, self._root @ link.matrix, body.name)
            for light in link.node.all("light"):
                self._link_light(link, light, body.name)
        if not parts:
            return
        known = [mass for mass in masses if mass is not None]
        self._objects.append(
            SceneObject(
                name=body.name,
                parts=tuple(parts),
                pose=pose_of_matrix(matrix),
                kind="model",
                movable=not body.static,
                mass=sum(known) if known and not body.static else None,
                friction=friction,
            )
        )

    def _link_light(self, link: Link, node: Node, body: str) -> None:
        item = Item(node, link.document, link.item.home)
        place = link.scope.place(item, link.item.name)
        frame = link.matrix @ np.linalg.inv(link.scope.place(link.item))
        name = "::".join((body, link.item.name, node.get("name")))
        matrix = self._models.light(name, frame @ place)
        if matrix is not None:
            self._lights.append(light_of(link.document, node, self._root @ matrix, self._unit))

    def _victim(self, body: Body) -> None:
        """A person: the server's own figure stands where the model's is."""
        assert body.person is not None
        parts = []
        for link in body.links:
            for part in self._shapes.parts(link, body.name):
                if part.visible:
                    parts.append(replace(part, matrix=self._root @ link.matrix @ part.matrix))
        self._victims.append(victim_of(body.name, body.person, self._root @ body.matrix, parts))
        self._findings.count("victim")
        self._findings.warn(
            self._source.name, "models of people are shown as the server's own figures"
        )

    # ---- the rest --------------------------------------------------------------------------

    def _builtin(self) -> None:
        """Models that are never on disk (worlds 49), and what stands in for missing ones."""
        for name, matrix in self._models.builtin:
            self._findings.count(name)
            if name == "sun":
                self._lights.append(sun())
                continue
            pose = pose_of_matrix(self._root @ matrix)
            self._objects.append(SceneObject("ground_plane", (Part(Plane()),), pose, kind="model"))
        for name, matrix in self._models.missing if self._context.options.placeholders else ():
            pose = pose_of_matrix(self._root @ matrix)
            self._objects.append(SceneObject(name, (Part(PLACEHOLDER),), pose, kind="model"))

    def _rest(self, owner: Node) -> None:
        gravity = owner.child("gravity") or owner.child("physics", "gravity")
        values = self._document.vector(gravity, 3)
        if gravity is not None and values is not None and abs(float(values[2]) + EARTH) > 0.1:
            self._findings.skip("gravity")
            self._findings.warn(
                "gravity", f"{gravity.text} m/s^2 is not kept; the server's is 9.81 downwards"
            )

    def _places(self) -> tuple[list[StartPose], list[Victim]]:
        """Start poses and victims: of the world, else of a text file beside it."""
        document, findings, victims = self._document, self._findings, self._victims
        starts = starts_of(document, self._unit)
        if not starts:
            section = find_placement(self._source, victims, self._models.names, findings)
            if section is not None:
                self._files.files.append(section.path)
                starts, victims = section.starts, victims or section.victims
        if not starts:
            starts = commented_starts(document, self._unit)
        return list(self._turned(starts)), victims

    def _turned(self, starts: list[StartPose]) -> Iterator[StartPose]:
        for start in starts:
            matrix = self._root @ matrix_of_pose(start.pose)
            yield StartPose(start.tag, pose_of_matrix(matrix))
