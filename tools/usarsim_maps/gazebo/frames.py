"""Poses in SDF: numbers, and the names that they are relative to (worlds reference 8, item 48)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.xml_text import Document, Node

Array = NDArray[np.float64]


def rpy_matrix(position: Array, roll: float, pitch: float, yaw: float) -> Array:
    """Matrix (4, 4) of a place and Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    matrix[:3, 3] = position
    return matrix


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
        return _from_quaternion(values, unit)
    angles = values[3:] if len(values) == 6 else np.zeros(3)
    if flag(node.get("degrees"), False):
        angles = np.radians(angles)
    return rpy_matrix(values[:3] * unit, *angles.tolist())


def _from_quaternion(values: Array, unit: float) -> Array:
    x, y, z, w = values[3:] / max(float(np.linalg.norm(values[3:])), 1e-12)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = values[:3] * unit
    return matrix


def flag(text: str, default: bool) -> bool:
    """A truth value as SDF writes it: `true`, `1`, `false`, `0`."""
    word = text.strip().lower()
    return default if not word else word in ("true", "1", "yes")


@dataclass(slots=True)
class Scope:
    """The names that poses of one model, or of the world, may be relative to.

    Attributes:
        document: the file.
        owner: `model` or `world` element.
        unit: metres per unit of the file.
        findings: told about names that are not there.
    """

    document: Document
    owner: Node
    unit: float
    findings: Findings
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
        """Where a named thing is in the frame of the owner.

        Raises:
            MapImportError: names refer to each other in a circle.
        """
        return self._find(name, ())

    def place(self, node: Node, default: str = "") -> Array:
        """Where a thing with a `pose` is, by `relative_to`, or by default."""
        return self._place(node, default, ())

    def _place(self, node: Node, default: str, above: tuple[str, ...]) -> Array:
        pose = node.child("pose")
        reference = "" if pose is None else (pose.get("relative_to") or pose.get("frame"))
        base = self._find(reference or default, above)
        answer: Array = base @ matrix_from(self.document, pose, self.unit)
        return answer

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
            self.findings.warn(name[:80], "a frame of this name is not there; that of the model")
            return np.eye(4)
        node, default = found
        self._known[name] = matrix = self._place(node, default, (*above, name))
        return matrix
