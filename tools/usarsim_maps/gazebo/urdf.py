"""URDF robots as SDF models: a robot description may stand wherever Gazebo wants a model.

Links are placed by the joints that lead to them, as in Gazebo: `pose` relative to the joint, whose
pose is relative to its parent link. Lengths are metres, angles roll, pitch and yaw in rad.
"""

from __future__ import annotations

from collections.abc import Iterator

from usarsim_maps.findings import Findings
from usarsim_maps.gazebo.elements import (
    URDF_GAZEBO,
    URDF_GEOMETRY,
    URDF_INERTIAL,
    URDF_JOINT,
    URDF_LINK,
    URDF_MATERIAL,
    URDF_ROBOT,
    URDF_SHAPE,
    Elements,
)
from usarsim_maps.gazebo.frames import WORLD
from usarsim_maps.meshes.xml_text import Document, Node
from usarsim_maps.support import Support
from usarsim_server.base.errors import MapImportError

XACRO = {"arg", "if", "include", "insert_block", "macro", "property", "unless"}
"""Elements of xacro, a language that URDF files are made with."""

SIZES = {
    "box": ("size",),
    "capsule": ("radius", "length"),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
}
"""Attributes of shapes that are elements in SDF."""


def model_of(document: Document, findings: Findings) -> Document:
    """The SDF document of a file whose root is `robot`; findings are told what is left out.

    Files that still have to go through xacro, and those in which a link has two parents, are a
    `MapImportError`.
    """
    return _Robot(document, findings).document()


class _Robot:
    """A robot on its way into SDF."""

    def __init__(self, document: Document, findings: Findings) -> None:
        self._document = document
        self._elements = Elements(findings)
        self._root = document.root
        self._materials = _described_materials(self._root)
        self._extras: dict[str, list[Node]] = {}
        for node in self._root.all("gazebo"):
            self._extras.setdefault(node.get("reference"), []).append(node)

    def document(self) -> Document:
        self._refuse_xacro()
        root = self._root
        self._elements.count(root, URDF_ROBOT)
        parents: dict[str, Node] = {}
        for joint in root.all("joint"):
            child = _attribute(joint, "child", "link")
            if child in parents:
                problem = f"link {child!r} is the child of two joints"
                raise self._document.error(joint, problem, "give each link one parent")
            parents[child] = joint
        model = _made("model", root, name=root.get("name") or "robot")
        for extra in root.all("gazebo"):
            self._elements.count(extra, URDF_GAZEBO, extra.get("reference"))
        for extra in self._extras.get("", []):
            if extra.child("static") is not None:
                model.children.append(_made("static", extra, extra.word("static")))
        for link in root.all("link"):
            if link.get("name") != WORLD:
                model.children.append(self._link(link, parents.get(link.get("name"))))
        for joint in root.all("joint"):
            model.children.append(self._joint(joint))
        sdf = _made("sdf", root)
        sdf.children.append(model)
        return Document(self._document.path, sdf, (), self._document.findings)

    def _refuse_xacro(self) -> None:
        for node in self._root.walk():
            written = any("${" in value or "$(" in value for value in node.attributes.values())
            if written or (node.tag in XACRO and node.tag not in URDF_ROBOT):
                raise xacro_refusal(self._document, node)

    def _link(self, link: Node, joint: Node | None) -> Node:
        name = link.get("name")
        made = _made("link", link, name=name)
        self._elements.count(link, URDF_LINK, name)
        if joint is not None:
            pose = _made("pose", link, "0 0 0 0 0 0")
            pose.attributes["relative_to"] = joint.get("name")
            made.children.append(pose)
        extras = self._extras.get(name, [])
        inertial = link.child("inertial")
        if inertial is not None:
            self._elements.count(inertial, URDF_INERTIAL)
            mass = _made("mass", inertial, _attribute(inertial, "mass", "value"))
            made.children.append(_holding("inertial", inertial, mass))
        for shape in (*link.all("visual"), *link.all("collision")):
            made.children.append(self._shape(shape, extras))
        return made

    def _shape(self, shape: Node, extras: list[Node]) -> Node:
        made = _made(shape.tag, shape, name=shape.get("name"))
        self._elements.count(shape, URDF_SHAPE, shape.get("name"))
        made.children.append(_pose(shape))
        geometry = shape.child("geometry")
        if geometry is not None:
            self._elements.count(geometry, URDF_GEOMETRY)
            parts = [
                _geometry(child)
                for child in geometry.children
                if URDF_GEOMETRY.get(child.tag) is Support.READ
            ]
            made.children.append(_holding("geometry", geometry, *parts))
        if shape.tag == "visual":
            made.children += self._material(shape, extras)
            return made
        for extra in extras:
            if extra.child("mu1") is not None:
                mu = _made("mu", extra, extra.word("mu1"))
                for tag in ("ode", "friction", "surface"):
                    mu = _holding(tag, extra, mu)
                made.children.append(mu)
        return made

    def _material(self, visual: Node, extras: list[Node]) -> Iterator[Node]:
        """The material of a visual: Gazebo's own name, if one is given, wins."""
        for extra in extras:
            if extra.word("material"):
                script = _holding("script", extra, _made("name", extra, extra.word("material")))
                yield _holding("material", extra, script)
                return
        own = visual.child("material")
        if own is None:
            return
        named = self._materials.get(own.get("name"))
        source = own if own.children or named is None else named
        self._elements.count(source, URDF_MATERIAL, own.get("name"))
        made = _made("material", source)
        color = _attribute(source, "color", "rgba")
        if color:
            made.children.append(_made("diffuse", source, color))
        picture = _attribute(source, "texture", "filename")
        if picture:
            albedo = _made("albedo_map", source, picture)
            made.children.append(_holding("pbr", source, _holding("metal", source, albedo)))
        yield made

    def _joint(self, joint: Node) -> Node:
        made = _made("joint", joint, name=joint.get("name"))
        made.attributes["type"] = joint.get("type")
        self._elements.count(joint, URDF_JOINT, joint.get("name"))
        parent = _attribute(joint, "parent", "link")
        pose = _pose(joint)
        pose.attributes["relative_to"] = parent
        made.children += [
            pose,
            _made("parent", joint, parent),
            _made("child", joint, _attribute(joint, "child", "link")),
        ]
        return made


def xacro_refusal(document: Document, node: Node) -> MapImportError:
    """The error for a file that is written in xacro."""
    name = document.path.name
    stem = name.removesuffix(".xacro").removesuffix(".urdf")
    made = f"{stem}.urdf" if f"{stem}.urdf" != name else f"{stem}-plain.urdf"
    cure = f"run: xacro {name} -o {made}"
    return document.error(node, "this file is written in xacro", cure)


def _described_materials(root: Node) -> dict[str, Node]:
    """Materials by name: those of the robot, and those that a visual describes.

    Any other visual may name them, too.
    """
    visuals = [visual for link in root.all("link") for visual in link.all("visual")]
    found: dict[str, Node] = {}
    for owner in (root, *visuals):
        for material in owner.all("material"):
            if material.children:
                found.setdefault(material.get("name"), material)
    return found


def _geometry(shape: Node) -> Node:
    """A shape with its attributes as elements."""
    if shape.tag == "mesh":
        parts = [_made("uri", shape, shape.get("filename"))]
        if shape.get("scale"):
            parts.append(_made("scale", shape, shape.get("scale")))
        return _holding("mesh", shape, *parts)
    sizes = [_made(name, shape, shape.get(name)) for name in SIZES[shape.tag]]
    return _holding(shape.tag, shape, *(size for size in sizes if size.text))


def _pose(node: Node) -> Node:
    """The `origin` of an element as a pose; what is not there is zero."""
    xyz, rpy = (_attribute(node, "origin", name) or "0 0 0" for name in ("xyz", "rpy"))
    return _made("pose", node.child("origin") or node, f"{xyz} {rpy}")


def _attribute(node: Node, tag: str, attribute: str) -> str:
    """An attribute of a child, empty if there is none."""
    child = node.child(tag)
    return "" if child is None else child.get(attribute).strip()


def _made(tag: str, source: Node, text: str = "", name: str = "") -> Node:
    """A new element at the line of another one."""
    node = Node(tag, {"name": name} if name else {}, source.line)
    node.text = text.strip()
    return node


def _holding(tag: str, source: Node, *children: Node) -> Node:
    """A new element with children."""
    node = _made(tag, source)
    node.children += children
    return node
