"""The models of a Gazebo world: includes, nesting, joints (worlds reference 8; items 48, 49).

Poses are numbers, and the names that they are relative to.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from usarsim_maps.findings import Findings
from usarsim_maps.gazebo.files import GazeboFiles, model_name
from usarsim_maps.gazebo.places import Person, person_words
from usarsim_maps.meshes.xml_text import Document, Node, read_xml
from usarsim_maps.scene import Array
from usarsim_maps.units import affine, matrix_of_pose
from usarsim_server.errors import MapImportError
from usarsim_server.simulation.frames import Pose

BUILTIN = ("sun", "ground_plane")
"""Models that Gazebo brings along."""

MAX_MODELS = 20_000
MAX_DEPTH = 30


def _rpy_matrix(position: Array, roll: float, pitch: float, yaw: float) -> Array:
    """Matrix (4, 4) of a place and Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    turn = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return affine(np.array(turn), position)


def matrix_from(document: Document, node: Node | None, unit: float) -> Array:
    """Matrix (4, 4) of a `pose` element; lengths times `unit`.

    Where there is no element, or none that makes sense, nothing moves: that is the default of SDF.
    """
    found = sound_matrix(document, node, unit)
    return np.eye(4) if found is None else found


def sound_matrix(document: Document, node: Node | None, unit: float) -> Array | None:
    """Matrix of a `pose` element; None if it is missing or, which is noted, makes no sense.

    Angles may be left out.
    """
    if node is None or not node.text:
        return None
    quaternion = node.get("rotation_format") == "quat_xyzw"
    values = document.vector(node, *((7,) if quaternion else (3, 6)))
    if values is None:
        return None
    if quaternion:
        x, y, z, w = values[3:] / max(float(np.linalg.norm(values[3:])), 1e-12)
        px, py, pz = values[:3] * unit
        return matrix_of_pose(Pose((px, py, pz), (w, x, y, z)))
    angles = values[3:] if len(values) == 6 else np.zeros(3)
    if flag(node.get("degrees"), False):
        angles = np.radians(angles)
    return _rpy_matrix(values[:3] * unit, *angles.tolist())


def flag(text: str, default: bool) -> bool:
    """A truth value as SDF writes it: `true`, `1`, `false`, `0`."""
    word = text.strip().lower()
    return default if not word else word in ("true", "1", "yes")


@dataclass(slots=True)
class Scope:
    """The names that poses of one model, or of the world, may be relative to."""

    document: Document  # the file
    owner: Node  # `model` or `world` element
    unit: float  # metres per unit of the file
    _nodes: dict[str, tuple[Node, str]] = field(default_factory=dict)
    _known: dict[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Collect links, frames, joints and models."""
        for node in self.owner.children:
            match node.tag:
                case "link" | "model":
                    entry = node.get("name"), ""
                case "frame":
                    entry = node.get("name"), node.get("attached_to")
                case "joint":
                    entry = node.get("name"), node.word("child")
                case "include":
                    entry = node.word("name") or node.word("uri").rstrip("/").rpartition("/")[2], ""
                case _:
                    continue
            if entry[0]:
                self._nodes.setdefault(entry[0], (node, entry[1]))

    def matrix(self, name: str) -> Array:
        """Where a named thing is in the frame of the owner; a circle is a `MapImportError`."""
        return self._find(name, ())

    def place(self, node: Node, default: str = "") -> Array:
        """Where a thing with a `pose` is, by `relative_to`, or by default."""
        return self._place(node, default, ())

    def _place(self, node: Node, default: str, above: tuple[str, ...]) -> Array:
        pose = node.child("pose")
        reference = "" if pose is None else (pose.get("relative_to") or pose.get("frame"))
        base = self._find(reference or default, above)
        return np.asarray(base @ matrix_from(self.document, pose, self.unit))

    def _find(self, name: str, above: tuple[str, ...]) -> Array:
        if name in ("", "__model__", "world", "__root__"):
            return np.eye(4)
        if name in self._known:
            return self._known[name]
        if name in above:
            problem = f"frames {name!r} and {above[-1]!r} refer to each other"
            raise self.document.error(self.owner, problem, "correct relative_to and attached_to")
        found = self._nodes.get(name)
        if found is None:
            self.document.findings.warn(
                name[:80], "a frame of this name is not there; that of the model"
            )
            return np.eye(4)
        node, default = found
        self._known[name] = matrix = self._place(node, default, (*above, name))
        return matrix


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A link: its matrix (4, 4) in the world, its element, the names around it."""

    name: str
    matrix: Array
    node: Node
    document: Document
    scope: Scope


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """Links that stay together: a static model, or a rigid part of a moving one."""

    name: str  # of the model, with the models around it (`outer::inner`)
    matrix: Array  # (4, 4) in the world
    links: tuple[Link, ...]  # what it is made of
    static: bool  # it does not move
    person: Person | None = None  # it is somebody


@dataclass(frozen=True, slots=True)
class _Entry:
    """A model element, wherever it stands, and what includes say about it."""

    document: Document
    node: Node
    name: str
    static: bool | None
    uri: str = ""


@dataclass(slots=True)
class _Assembly:
    """Links and joints of a moving model with all that is nested in it."""

    links: list[Link] = field(default_factory=list)
    joints: list[tuple[str, str, str]] = field(default_factory=list)


class Models:
    """Expands a world."""

    def __init__(self, files: GazeboFiles, unit: float) -> None:
        self.names: list[str] = []  # of all models that were used
        # of the world and of models, with file and matrix
        self.lights: list[tuple[Document, Node, Array]] = []
        self.builtin: list[tuple[str, Array]] = []  # names and matrices of Gazebo's own models
        # names and matrices of models that were not found
        self.missing: list[tuple[str, Array]] = []
        self._files = files
        self._findings: Findings = files.context.findings
        self._unit = unit
        self._documents: dict[Path, Document | None] = {}
        self._bodies: list[Body] = []
        self._alone: Node | None = None
        self._count = 0

    def world(self, document: Document, owner: Node, saved: Mapping[str, Array]) -> list[Body]:
        """All bodies below a `world` element, or below the root of a model file.

        Poses of models in a saved state win. Includes that go in a circle, or are too many, are a
        `MapImportError`.
        """
        scope = Scope(document, owner, self._unit)
        if owner is document.root and len(list(owner.all("model"))) == 1:
            self._alone = owner.child("model")
        for node in owner.children:
            match node.tag:
                case "light":
                    self.lights.append((document, node, scope.place(node)))
                case "model" | "include":
                    self._enter(document, node, np.eye(4), scope, "", None, (), None, saved)
        return self._bodies

    # ---- includes --------------------------------------------------------------------------

    def _enter(
        self,
        document: Document,
        node: Node,
        parent: Array,
        scope: Scope,
        prefix: str,
        static: bool | None,
        above: tuple[Path, ...],
        assembly: _Assembly | None,
        saved: Mapping[str, Array] | None = None,
    ) -> None:
        """A model element or an include, in a world or in another model."""
        self._count += 1
        if self._count > MAX_MODELS or len(above) > MAX_DEPTH:
            problem = f"more than {MAX_MODELS} models, or nested deeper than {MAX_DEPTH}"
            raise document.error(node, problem, "split the world")
        if node.tag == "model":
            entry = _Entry(document, node, node.get("name") or "model", None)
        else:
            found = self._included(document, node, parent, scope, above)
            if found is None:
                return
            entry = found
            above = (*above, entry.document.path)
        matrix = parent @ self._placed(entry, node, scope)
        if saved and entry.name in saved:
            matrix = saved[entry.name]
        self._model(entry, matrix, prefix, static, above, assembly)

    def _included(
        self, document: Document, node: Node, parent: Array, scope: Scope, above: tuple[Path, ...]
    ) -> _Entry | None:
        """The model that an include means; None, and a finding, if it is not there."""
        uri = node.word("uri")
        name = model_name(uri)
        path = self._files.model(uri, document.path)
        given = node.word("name")
        static = flag(node.word("static"), False) if node.child("static") is not None else None
        if path is None:
            if name.lower() in BUILTIN:
                self.builtin.append((name.lower(), parent @ scope.place(node)))
            elif person_words(name)[0]:
                self._findings.missing("person", uri[:200])
                self._person(given or name, parent @ scope.place(node), (), name, given)
            else:
                self._findings.missing("model", uri[:200])
                self.missing.append((given or name, parent @ scope.place(node)))
            return None
        if path in above or path == document.path:
            problem = f"{path.name} of model {name!r} includes itself"
            raise document.error(node, problem, "break the circle of includes")
        inner = self._load(path)
        if inner is None:
            return None
        model = inner.root.child("model") or inner.root.child("world", "model")
        if model is None:
            light = inner.root.child("light")
            if light is not None:
                place_of = scope.place(node) @ matrix_from(inner, light.child("pose"), self._unit)
                self.lights.append((inner, light, parent @ place_of))
            else:
                self._findings.warn(path.name, "there is no model in this file")
            return None
        self.names.append(name)
        return _Entry(inner, model, given or model.get("name") or name, static, name)

    def _load(self, path: Path) -> Document | None:
        if path not in self._documents:
            try:
                self._documents[path] = read_xml(path, findings=self._findings)
            except MapImportError as error:
                self._findings.warn(path.name, str(error))
                self._documents[path] = None
        return self._documents[path]

    def _placed(self, entry: _Entry, node: Node, scope: Scope) -> Array:
        """Where a model is in what is around it; the include's pose replaces the model's own."""
        own = Scope(entry.document, entry.node, self._unit)
        if node is entry.node:
            matrix = scope.place(node)
            frame = entry.node.get("placement_frame")
        elif node.child("pose") is not None:
            matrix = scope.place(node)
            frame = node.word("placement_frame") or entry.node.get("placement_frame")
        else:
            matrix = matrix_from(entry.document, entry.node.child("pose"), self._unit)
            frame = node.word("placement_frame") or entry.node.get("placement_frame")
        if frame:
            matrix = matrix @ np.linalg.inv(own.matrix(frame))
        return matrix

    # ---- models ----------------------------------------------------------------------------

    def _model(
        self,
        entry: _Entry,
        matrix: Array,
        prefix: str,
        static: bool | None,
        above: tuple[Path, ...],
        assembly: _Assembly | None,
    ) -> None:
        """Links of a model and of the models in it."""
        node, document = entry.node, entry.document
        name = f"{prefix}::{entry.name}" if prefix else entry.name
        scope = Scope(document, node, self._unit)
        own = flag(node.word("static"), False) if entry.static is None else entry.static
        fixed = bool(static) or own
        whole = _Assembly() if assembly is None or fixed else assembly
        relative = "" if whole is not assembly else name.partition("::")[2] + "::"
        links = [
            Link(relative + link.get("name"), matrix @ scope.place(link), link, document, scope)
            for link in node.all("link")
        ]
        somebody = person_words(entry.uri, node.get("name"), entry.name)
        if somebody[0] and node is not self._alone:  # who imports a figure wants to see just that
            self._person(name, matrix, links, entry.uri, node.get("name"), entry.name)
            return
        whole.links += links
        whole.joints += [
            (relative + j.word("parent"), relative + j.word("child"), j.get("type"))
            if j.word("parent") != "world"
            else ("world", relative + j.word("child"), j.get("type"))
            for j in node.all("joint")
        ]
        if fixed:
            self._bodies.append(Body(name, matrix, tuple(links), static=True))
        for child in node.children:
            match child.tag:
                case "model" | "include":
                    self._enter(
                        document, child, matrix, scope, name, fixed, above,
                        None if fixed else whole,
                    )  # fmt: skip
                case "light":
                    self.lights.append((document, child, matrix @ scope.place(child)))
        if not fixed and whole is not assembly:
            self._moving(name, matrix, whole)

    def _person(self, name: str, matrix: Array, links: Iterable[Link], *words: str) -> None:
        more = [
            node.text
            for link in links
            for visual in link.node.all("visual")
            for node in [visual.child("geometry", "mesh", "uri")]
            if node is not None
        ]
        _, figure, posture = person_words(*words, *more)
        self._bodies.append(Body(name, matrix, tuple(links), True, Person(figure, posture)))

    def _moving(self, name: str, matrix: Array, whole: _Assembly) -> None:
        """Bodies of a moving model: links that joints connect stay as they are to each other."""
        owner: dict[str, str] = {link.name: link.name for link in whole.links}

        def find(link: str) -> str:
            while owner[link] != link:
                link = owner[link]
            return link

        anchored: set[str] = set()
        stiff = 0
        for parent, child, kind in whole.joints:
            stiff += kind != "fixed"
            if child not in owner:
                continue
            if parent == "world":
                anchored.add(child)
            elif parent in owner:
                owner[find(child)] = find(parent)
        if stiff:
            self._findings.warn(name, "joints of models are stiff here; its parts do not turn")
        groups: dict[str, list[Link]] = {}
        for link in whole.links:
            groups.setdefault(find(link.name), []).append(link)
        fixed = {find(link) for link in anchored}
        for root, links in groups.items():
            static = root in fixed or any(
                flag(link.node.word("kinematic"), False) for link in links
            )
            label = name if len(groups) == 1 else f"{name}::{links[0].name}"
            place = matrix if static else links[0].matrix
            self._bodies.append(Body(label, place, tuple(links), static))
