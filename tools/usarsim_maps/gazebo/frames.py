"""Names in a Gazebo model or world, and the places that they mean.

A pose is numbers and the name of a frame that they are relative to. A name may step into models:
`kiosk::shelf::plate` is the link `plate` of the model `shelf` in the model `kiosk`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from usarsim_maps.meshes.xml_text import Document, Node
from usarsim_maps.scene import Array
from usarsim_maps.units import affine, matrix_of_pose
from usarsim_server.simulation.frames import Pose

WORLD = "world"
"""What a joint calls the world."""

_OWN = ("", "__model__")
"""Names of the frame of the model itself."""

_ROOT = (WORLD, "__root__")


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


def frame_of(pose: Node | None) -> str:
    """The name that a `pose` element is relative to, empty if it names none."""
    return "" if pose is None else pose.get("relative_to") or pose.get("frame")


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """What an element `model` or `include` stands for: a model, a light, an actor, or a world."""

    document: Document  # the file that it is described in
    node: Node  # `model`, `light`, `actor` or `world`
    name: str
    static: bool | None = None  # what an include says; None: the model says it
    uri: str = ""  # the name of the model that an include means
    above: tuple[Path, ...] = ()  # files that include it


@dataclass(frozen=True, slots=True, eq=False)
class Item:
    """An element of a model or world: its own child, or one that a merged include brings."""

    node: Node
    document: Document  # the file of the element
    home: str = ""  # frame of its poses by default: the owner's, or that of a merged include
    name: str = ""
    entry: Entry | None = None  # of `model` and `include`; None: it was not found
    merged: bool = False  # the frame of a merged include, whose elements are items of their own


class Scope:
    """The names that poses in one model, or in the world, may be relative to."""

    def __init__(
        self,
        document: Document,
        owner: Node,
        unit: float,
        items: Iterable[Item],
        inside: InnerScope,
    ) -> None:
        """Take the items of a `model` or `world` element.

        Args:
            document: the file of the element.
            owner: the element.
            unit: metres per unit of the file.
            items: all of them, those of merged includes and the frames of these included.
            inside: finds the scope of a model in it.
        """
        self.items = tuple(items)
        self._document = document
        self._owner = owner
        self._unit = unit
        self._inside = inside
        self._known: dict[str, Array] = {}
        self._named: dict[str, Item] = {}
        for item in self.items:
            if item.name and item.node.tag in ("link", "model", "include", "frame", "joint"):
                self._named.setdefault(item.name, item)

    def all(self, tag: str) -> Iterator[Item]:
        """Items with a tag."""
        return (item for item in self.items if item.node.tag == tag)

    def matrix(self, name: str, home: str = "") -> Array:
        """Matrix (4, 4) of a named thing in the frame of the owner.

        Names that mean the model itself mean the frame `home`. Frames that refer to each other are
        a `MapImportError`; a name that is not there is a finding, and means `home`.
        """
        return self._find(name, home, ())

    def place(self, item: Item, default: str = "") -> Array:
        """Where an item is in the frame of the owner: its pose, relative to what that names.

        A pose without such a name is relative to the frame `default`, or to the item's home.
        """
        return self._place(item, default, ())

    def link(self, name: str, home: str = "") -> str:
        """The link that a name means, as its path below the owner; `world` stays what it is.

        A frame or joint means the link that it is attached to, a model its canonical link; empty
        if there is none.
        """
        return self._link(name, home, 0)

    # ---- places ----------------------------------------------------------------------------

    def _place(self, item: Item, default: str, above: tuple[str, ...]) -> Array:
        entry = item.entry
        if entry is not None:
            return self._place_model(item, entry, above)
        pose = item.node.child("pose")
        base = self._find(frame_of(pose) or default, item.home, above)
        return np.asarray(base @ matrix_from(item.document, pose, self._unit))

    def _place_model(self, item: Item, entry: Entry, above: tuple[str, ...]) -> Array:
        """Where a model is: an include's pose replaces that of the model's file."""
        node, pose = item.node, item.node.child("pose")
        if node is entry.node or pose is not None:
            base = self._find(frame_of(pose), item.home, above)
            matrix = base @ matrix_from(item.document, pose, self._unit)
        else:
            base = self._find("", item.home, above)
            matrix = base @ matrix_from(entry.document, entry.node.child("pose"), self._unit)
        frame = entry.node.get("placement_frame")
        if node is not entry.node:
            frame = node.word("placement_frame") or frame
        if frame and entry.node.tag == "model":
            matrix = matrix @ np.linalg.inv(self._inside(entry).matrix(frame))
        return np.asarray(matrix)

    def _find(self, name: str, home: str, above: tuple[str, ...]) -> Array:
        if name in _ROOT or (name in _OWN and not home):
            return np.eye(4)
        if name in _OWN:
            name = home
        if name in self._known:
            return self._known[name]
        if name in above:
            problem = f"frames {name!r} and {above[-1]!r} refer to each other"
            raise self._document.error(self._owner, problem, "correct relative_to and attached_to")
        item = self._named.get(name)
        if item is not None:
            default = ""
            if item.node.tag == "frame":
                default = item.node.get("attached_to")
            elif item.node.tag == "joint":
                default = item.node.word("child")
            matrix = self._place(item, default, (*above, name))
        else:
            step = self._step(name)
            if step is None:
                self._document.findings.warn(
                    name[:80], "a frame of this name is not there; that of the model"
                )
                return self._find("", home, above)
            head, inner, rest = step
            matrix = self._find(head, home, (*above, name)) @ inner.matrix(rest)
        self._known[name] = matrix
        return matrix

    def _step(self, name: str) -> tuple[str, Scope, str] | None:
        """The model that a name with `::` begins with, its scope, and the rest of the name."""
        parts = name.split("::")
        for count in range(len(parts) - 1, 0, -1):
            head = "::".join(parts[:count])
            item = self._named.get(head)
            if item is not None and item.entry is not None and item.entry.node.tag == "model":
                return head, self._inside(item.entry), "::".join(parts[count:])
        return None

    # ---- links -----------------------------------------------------------------------------

    def _link(self, name: str, home: str, depth: int) -> str:
        if name == WORLD or depth > len(self._named) + 1:
            return name if name == WORLD else ""
        item = self._named.get(home if name in _OWN else name)
        if item is None:
            if name in _OWN:
                return self._canonical()
            step = self._step(name)
            return "" if step is None else _joined(step[0], step[1].link(step[2]))
        match item.node.tag:
            case "link":
                return item.name
            case "frame":
                return self._link(item.node.get("attached_to"), item.home, depth + 1)
            case "joint":
                return self._link(item.node.word("child"), item.home, depth + 1)
        if item.entry is None:
            return ""
        if item.merged:
            return self._canonical(item.entry.node.get("canonical_link"), item.name)
        if item.entry.node.tag != "model":
            return ""
        return _joined(item.name, self._inside(item.entry).link(""))

    def _canonical(self, named: str = "", home: str = "") -> str:
        """The canonical link: the named one, else the first, else that of the first model."""
        named = named or self._owner.get("canonical_link")
        if named:
            return self._link(named, home, 0)
        for item in self.all("link"):
            return item.name
        for item in self.items:
            if item.node.tag in ("model", "include") and item.entry is not None and item.name:
                return self._link(item.name, item.home, 0)
        return ""


InnerScope: TypeAlias = Callable[[Entry], Scope]


def _joined(head: str, link: str) -> str:
    return f"{head}::{link}" if link and link != WORLD else ""
