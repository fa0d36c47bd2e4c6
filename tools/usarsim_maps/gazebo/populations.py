"""Populations of a Gazebo world: copies of one model in a box or a cylinder.

The container's middle is at the population's pose and turns with it; the copies do not turn.
Gazebo draws lots that differ from run to run. Here the name of the population is the seed, so the
same file gives the same world.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator

import numpy as np

from usarsim_maps.gazebo.frames import matrix_from
from usarsim_maps.meshes.xml_text import Document, Node
from usarsim_maps.numbers import read_whole
from usarsim_maps.scene import Array

GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
"""rad between neighbours on the spiral that fills a circle evenly (Vogel's model of sunflowers)."""


def population(document: Document, node: Node, most: int) -> Iterator[Node]:
    """The copies, as `model` or `include` elements with their names and poses.

    A population that makes no sense is noted and gives nothing; one of more than `most` copies is
    a `MapImportError`.
    """
    model = node.child("model") or node.child("include")
    places = _places(document, node, most)
    if model is None:
        document.note(node, "a population without a model was left out")
        return
    if places is None:
        return
    base = matrix_from(document, node.child("pose"), 1.0)
    name = model.get("name") or model.word("name") or node.get("name") or "model"
    for number, place in enumerate(places @ base[:3, :3].T + base[:3, 3]):
        yield _copy(model, f"{name}_clone_{number}", place)


def _copy(model: Node, name: str, place: Array) -> Node:
    """A model or an include under another name at a place (3,)."""
    copy = Node(model.tag, model.attributes | {"name": name}, model.line)
    pose = Node("pose", {}, model.line)
    pose.text = " ".join(repr(value) for value in place.tolist()) + " 0 0 0"
    own = [child for child in model.children if child.tag not in ("pose", "name")]
    copy.children = [pose, *own]
    if model.tag == "include":
        label = Node("name", {}, model.line)
        label.text = name
        copy.children.append(label)
    return copy


def _places(document: Document, node: Node, most: int) -> Array | None:
    """Places (n, 3) in the frame of the container; None, and a note, if they make no sense."""
    distribution = node.child("distribution")
    kind = "random" if distribution is None else distribution.word("type", default="random")
    if kind == "grid" and distribution is not None:
        rows, columns = (_whole(document, distribution, name) for name in ("rows", "cols"))
        step = document.vector(distribution.child("step"), 3)
        if rows is None or columns is None or step is None:
            document.note(node, "a population on a grid needs rows, cols and step; left out")
            return None
        _check(document, node, rows * columns, most)
        across = (np.arange(columns) - (columns - 1) / 2.0) * step[0]
        along = (np.arange(rows) - (rows - 1) / 2.0) * step[1]
        x, y = np.meshgrid(across, along)
        return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    count = _whole(document, node, "model_count")
    if count is None:
        document.note(node, "a population without model_count was left out")
        return None
    _check(document, node, count, most)
    box = document.vector(node.child("box", "size"), 3)
    radius = document.number(node.child("cylinder", "radius"))
    length = document.number(node.child("cylinder", "length"))
    lots = random.Random(f"{node.get('name')}\0{kind}")
    if box is not None:
        return _in_box(document, node, kind, count, np.abs(box), lots)
    if radius is not None and length is not None:
        return _in_cylinder(document, node, kind, count, abs(radius), abs(length), lots)
    document.note(node, "a population needs a box with a size, or a cylinder; left out")
    return None


def _in_box(
    document: Document, node: Node, kind: str, count: int, size: Array, lots: random.Random
) -> Array | None:
    places = np.zeros((count, 3))
    match kind:
        case "random":
            drawn = [[lots.random() for _ in range(3)] for _ in range(count)]
            places = (np.array(drawn) - 0.5) * size
        case "uniform":
            places[:, :2] = _rows(count, float(size[0]), float(size[1]))
        case "linear-x" | "linear-y" | "linear-z":
            axis = "xyz".index(kind[-1])
            # As in Gazebo the first copy is at the lower end, and none at the upper one.
            places[:, axis] = (np.arange(count) / count - 0.5) * size[axis]
        case _:
            _unknown(document, node, kind)
            return None
    return places


def _in_cylinder(
    document: Document, node: Node, kind: str, count: int, radius: float, length: float,
    lots: random.Random,
) -> Array | None:  # fmt: skip
    match kind:
        case "random":
            drawn = np.array([[lots.random() for _ in range(3)] for _ in range(count)])
            angle, far = np.asarray(math.tau * drawn[:, 0]), np.asarray(radius * drawn[:, 1])
            high = np.asarray(drawn[:, 2] - 0.5)
        case "uniform":
            number = np.arange(count)
            angle = np.asarray(GOLDEN * number)
            far = np.asarray(radius * np.sqrt((number + 0.5) / count))
            high = np.zeros(count)
        case _:
            _unknown(document, node, kind)
            return None
    return np.column_stack([far * np.cos(angle), far * np.sin(angle), high * length])


def _rows(count: int, wide: float, deep: float) -> Array:
    """So many places (n, 2) spread evenly over a rectangle around the origin, row by row."""
    lines = min(count, max(1, round(math.sqrt(count * deep / max(wide, 1e-9)))))
    places = []
    for line in range(lines):
        inside = count * (line + 1) // lines - count * line // lines
        y = ((line + 0.5) / lines - 0.5) * deep
        places += [(((k + 0.5) / inside - 0.5) * wide, y) for k in range(inside)]
    return np.array(places)


def _whole(document: Document, node: Node, name: str) -> int | None:
    """A whole number of one or more; None if it is missing or makes no sense."""
    try:
        value = read_whole(node.word(name))
    except (ValueError, OverflowError):
        return None
    return value if value >= 1 else None


def _check(document: Document, node: Node, count: int, most: int) -> None:
    if count > most:
        problem = f"a population of {count} models is more than {most}"
        raise document.error(node, problem, "lower model_count, or rows and cols")


def _unknown(document: Document, node: Node, kind: str) -> None:
    document.note(node, f"a population that is spread {kind[:40]!r} there is not; left out")
