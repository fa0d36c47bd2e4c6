"""Reads X3D and VRML 2 (VRML97): the same nodes in two syntaxes (ISO/IEC 19775-1).

Y is up and lengths are metres by definition, unless the head has a `unit` of its own. Names are
those of DEF. What moves, asks or draws by itself (scripts, routes, prototypes) is left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np

from usarsim_maps.files import AssetIndex, read_head
from usarsim_maps.findings import Findings
from usarsim_maps.meshes.mesh_files import (
    Axes,
    SceneBuilder,
    axes_of,
)
from usarsim_maps.meshes.vrml_text import read_vrml
from usarsim_maps.meshes.x3d_shapes import make_geometry
from usarsim_maps.meshes.xml_text import Document, Node, read_xml
from usarsim_maps.numbers import read_number, read_numbers
from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import Array, Material, Mesh, Opacity, Part, Scene, SceneObject
from usarsim_maps.support import Support, SupportTable, support_table
from usarsim_maps.units import affine, axis_turn
from usarsim_server.base.errors import MapImportError, at

MAX_DEPTH = 200
MAX_OBJECTS = 100_000
MAX_NODES = 1_000_000
"""Nodes that are looked at; those used several times count each time."""

MAX_FILES = 1000
CURE = "export it again, or as glTF"

GROUPS = {
    "Anchor", "Billboard", "CADAssembly", "CADFace", "CADLayer", "CADPart", "Collision", "Group",
    "HAnimHumanoid", "HAnimJoint", "HAnimSegment", "Scene", "StaticGroup", "X3D",
}  # fmt: skip
"""Nodes whose children are simply there."""

NODES = support_table(
    read=" ".join(GROUPS)
    + """
        Appearance Box Color ColorRGBA Cone Coordinate CoordinateDouble Cylinder ElevationGrid
        ImageTexture IndexedFaceSet IndexedQuadSet IndexedTriangleFanSet IndexedTriangleSet
        IndexedTriangleStripSet Inline LOD Material PhysicalMaterial QuadSet Shape Sphere Switch
        TextureCoordinate Transform TriangleFanSet TriangleSet TriangleStripSet UnlitMaterial unit
    """,
    left_out="""
        Arc2D ArcClose2D AudioClip Background Circle2D DirectionalLight Disk2D EnvironmentLight
        ExternProtoDeclare Extrusion Fog GeoElevationGrid GeoLocation GeoTransform
        HAnimDisplacer HAnimSite IndexedLineSet LineSet MovieTexture MultiTexture
        NavigationInfo NurbsPatchSurface NurbsSweptSurface OrientationInterpolator
        ParticleSystem PixelTexture PointLight PointSet Polyline2D Polypoint2D
        PositionInterpolator ProtoDeclare ProtoInstance ROUTE Rectangle2D RigidBody Script Sound
        SpotLight Text TextureBackground TextureTransform TimeSensor TouchSensor TriangleSet2D
        Viewpoint WorldInfo
    """,
)
"""Nodes of X3D and VRML 2, and statements of the first."""

_STRINGS = re.compile(r'"((?:[^"\\]|\\.)*)"')


@register("x3d")
class X3dReader(Reader):
    """One object for every shape."""

    title = "X3D and VRML"
    extensions = (".wrl", ".vrml", ".x3d", ".x3dv")
    head = re.compile(rb"\A#(VRML|X3D)|<X3D")
    support: ClassVar[Mapping[str, SupportTable]] = {"X3D and VRML nodes": NODES}

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`."""
        document = _load(source, context.findings)
        return _X3dScene(document, context, axes_of(context.options, "Y", _unit(document))).filled()


def _load(path: Path, findings: Findings) -> Document:
    classic = not read_head(path).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")
    if classic:
        return replace(read_vrml(path), findings=findings)
    return read_xml(path, tolerant=True, findings=findings)


def _unit(document: Document) -> float:
    """Metres per unit of length, as the head says."""
    for node in document.root.walk():
        if node.tag == "unit" and node.get("category") == "length":
            try:
                factor = read_number(node.get("conversionFactor", "1"))
            except ValueError:
                factor = 0.0
            if not 1e-9 < factor < 1e9:
                raise document.error(node, "a unit of length without meaning", CURE)
            return factor
    return 1.0


def _defined(document: Document) -> dict[str, Node]:
    """The nodes of a file that have a name."""
    names: dict[str, Node] = {}
    for node in document.root.walk():
        if node.get("DEF") and not node.get("USE"):
            names.setdefault(node.get("DEF"), node)
    return names


class _X3dScene(SceneBuilder):
    """A scene being filled."""

    def __init__(self, document: Document, context: Context, axes: Axes) -> None:
        super().__init__(document.path, context, axes)
        self._document = document
        self._context = context
        self._names = _defined(document)
        self._materials: dict[str, Material] = {}
        self._looks: dict[int, str] = {}
        self._shades: dict[str, Material] = {}  # plain ones in the colours of vertices
        self._visited = 0
        self._index: AssetIndex | None = None
        self._documents = [document]  # all stay: what is cached goes by the identity of nodes

    def filled(self) -> Scene:
        """Everything that the file shows."""
        self._node(self._document.root, np.eye(4), "", 0)
        if not self.objects:
            problem = "there are no faces in this file"
            raise MapImportError(at(self._document.path, problem, CURE))
        return self.scene("X3D", self._materials, [one.path for one in self._documents])

    def _meant(self, node: Node) -> Node:
        """The node itself, or the one that it uses once more."""
        word = node.get("USE")
        if not word:
            return node
        found = self._names.get(word)
        if found is None:
            raise self._document.error(node, f"USE of {word[:40]!r}, which is not defined", CURE)
        return found

    def _child(self, node: Node, *tags: str) -> Node | None:
        """The first child of one of these kinds."""
        for child in node.children:
            found = self._meant(child)
            if found.tag in tags:
                return found
        return None

    def _node(self, node: Node, parent: Array, above: str, depth: int) -> None:
        if depth > MAX_DEPTH:
            raise self._document.error(node, "nodes contain each other, or are nested too deeply")
        self._visited += 1
        if self._visited > MAX_NODES:
            raise self._document.error(node, f"more than {MAX_NODES} nodes", "split the map")
        node = self._meant(node)
        name = node.get("DEF") or above
        if node.tag == "Transform":
            matrix = parent @ self._matrix(node)
            self._children(node, matrix, name, depth)
            if not node.children and node.get("DEF"):
                self.mark(name, matrix)
        elif node.tag in GROUPS:
            self._children(node, parent, name, depth)
        elif node.tag == "LOD":
            self._one(node, 0, parent, name, depth)
        elif node.tag == "Switch":
            self._one(node, int(self._numbers(node, "whichChoice", (-1,))[0]), parent, name, depth)
        elif node.tag == "Shape":
            self._shape(node, parent, name)
        elif node.tag == "Inline":
            self._inline(node, parent, name, depth)
        else:
            self.findings.skip(node.tag, node.get("DEF") or node.get("name"))

    def _children(self, node: Node, matrix: Array, name: str, depth: int) -> None:
        for child in node.children:
            if child.tag not in ("head", "unit", "MetadataString", "MetadataSet"):
                self._node(child, matrix, name, depth + 1)

    def _one(self, node: Node, number: int, matrix: Array, name: str, depth: int) -> None:
        """One of the children, if there are so many."""
        if 0 <= number < len(node.children):
            self._node(node.children[number], matrix, name, depth + 1)

    def _inline(self, node: Node, matrix: Array, name: str, depth: int) -> None:
        """Another file, shown here; its names are its own."""
        if self._index is None:
            self._index = self._context.index(self._document.path)
        urls = list(_strings(node.get("url")))
        found = next(filter(None, (self._index.find(u, X3dReader.extensions) for u in urls)), None)
        if found is None or found.suffix.lower() not in X3dReader.extensions:
            self.findings.missing("file", " ".join(urls)[:200])
            return
        if len(self._documents) >= MAX_FILES:
            raise self._document.error(node, f"more than {MAX_FILES} files", "split the map")
        outer = self._document, self._names
        self._document = _load(found, self.findings)
        self._documents.append(self._document)
        self._names = _defined(self._document)
        self._node(self._document.root, matrix, name, depth + 1)
        self._document, self._names = outer

    def _shape(self, node: Node, matrix: Array, name: str) -> None:
        if len(self.objects) >= MAX_OBJECTS:
            raise self._document.error(node, f"more than {MAX_OBJECTS} shapes", "split the map")
        geometry = self._geometry(node)
        if geometry is None:
            return
        find = partial(self._child, geometry)

        def make() -> Mesh | None:
            made = make_geometry(self._document, geometry, find)
            if made is None:
                return None
            self._shades |= {shade.name: shade for shade in made.shades}
            return made.mesh

        mesh = self.mesh(id(geometry), make)
        if mesh is None:
            self.findings.skip(geometry.tag, geometry.get("DEF") or name)
            return
        pose, local = self.axes.place(matrix)
        look = self._look(self._child(node, "Appearance"))
        materials = {0: look} if look else {}
        if mesh.materials:
            materials = {k: self._shade(look, word) for k, word in enumerate(mesh.materials)}
        part = Part(mesh, local, materials=materials)
        word = node.get("DEF") or name or geometry.get("DEF") or geometry.tag
        self.findings.count("shape")
        self.objects.append(SceneObject(word, (part,), pose=pose, kind="shape"))

    def _geometry(self, shape: Node) -> Node | None:
        """What a shape shows: the child that is no appearance and no description."""
        for child in shape.children:
            found = self._meant(child)
            if found.tag != "Appearance" and not found.tag.startswith("Metadata"):
                return found
        return None

    def _shade(self, look: str, word: str) -> str:
        """A material in the colour of vertices, which replaces its own but not its picture."""
        shade, base = self._shades[word], self._materials.get(look)
        if base is not None and base.texture is not None:
            return look
        if base is not None:
            color = (*shade.color[:3], shade.color[3] * base.color[3])
            shade = replace(base, name=f"{look}_{word}", color=color)
        self._materials[shade.name] = shade
        return shade.name

    def _look(self, appearance: Node | None) -> str:
        """The name of the material of an appearance."""
        if appearance is None:
            return ""
        if id(appearance) not in self._looks:
            material = self._child(appearance, "Material", "UnlitMaterial", "PhysicalMaterial")
            texture = self._child(appearance, "ImageTexture")
            color, opacity = (0.8, 0.8, 0.8, 1.0), None
            for child in appearance.children:
                if NODES.get(self._meant(child).tag) is Support.LEFT_OUT:
                    self.findings.skip(self._meant(child).tag, appearance.get("DEF"))
            if material is not None:
                word = {"Material": "diffuseColor", "UnlitMaterial": "emissiveColor"}.get(
                    material.tag, "baseColor"
                )
                r, g, b = self._numbers(material, word, (0.8, 0.8, 0.8))
                (clear,) = self._numbers(material, "transparency", (0.0,))
                color = (r, g, b, 1.0 - clear)
            picture = None
            if texture is not None:
                found = (self.pictures.find(url) for url in _strings(texture.get("url")))
                picture = next((path for path in found if path is not None), None)
                color = (1.0, 1.0, 1.0, color[3])
                mode = appearance.get("alphaMode").strip('"').upper()
                if mode == "MASK":
                    (cutoff,) = self._numbers(appearance, "alphaCutoff", (0.5,))
                    opacity = Opacity(cutoff=cutoff)
                elif mode != "OPAQUE":
                    opacity = Opacity(blend=True)
            name = appearance.get("DEF") or (material.get("DEF") if material is not None else "")
            name = name or f"material{len(self._looks)}"
            while name in self._materials:
                name += "-2"
            self._materials[name] = Material(name, color, picture, opacity=opacity)
            self._looks[id(appearance)] = name
        return self._looks[id(appearance)]

    def _matrix(self, node: Node) -> Array:
        """T C R SR S -SR -C, as the standard has it for Transform."""
        center = affine(offset=self._numbers(node, "center", (0.0, 0.0, 0.0)))
        back = affine(offset=-center[:3, 3])
        turn = _turned(self._numbers(node, "rotation", (0.0, 0.0, 1.0, 0.0)))
        skew = _turned(self._numbers(node, "scaleOrientation", (0.0, 0.0, 1.0, 0.0)))
        scale = np.diag([*self._numbers(node, "scale", (1.0, 1.0, 1.0)), 1.0])
        place = affine(offset=self._numbers(node, "translation", (0.0, 0.0, 0.0)))
        return np.asarray(place @ center @ turn @ skew @ scale @ skew.T @ back)

    def _numbers(self, node: Node, field: str, default: tuple[float, ...]) -> list[float]:
        """So many numbers of a field as its default has, which stands for what makes no sense."""
        text = node.get(field)
        if not text:
            return list(default)
        try:
            values = read_numbers(text, len(default))[: len(default)]
        except ValueError:
            values = []
        if len(values) != len(default) or not all(abs(value) < 1e12 for value in values):
            self._document.note(node, f"{field} {text[:60]!r} makes no sense; left out")
            return list(default)
        return values


def _turned(rotation: list[float]) -> Array:
    return affine(axis_turn(np.array(rotation[:3]), rotation[3]))


def _strings(text: str) -> Iterator[str]:
    """The texts of a field; one without quotes is one text."""
    found = _STRINGS.findall(text)
    yield from found if found or not text.strip() else [text.strip()]
