"""Controllers of COLLADA: morphs by their weights, skins on their joints in the rest pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from usarsim_maps.meshes.collada_mesh import read_points, source_values, whole_number
from usarsim_maps.meshes.figures import morphed, skinned
from usarsim_maps.meshes.xml_text import Document, Node
from usarsim_maps.scene import Array, Integers

FAR = 1e12
"""Larger numbers in matrices have no meaning."""

MOST_JOINTS = 64
"""Joints that may hold one vertex."""


class ColladaFigure:
    """A geometry and the controllers that bend it, as one node of the scene shows it.

    Controllers that make no sense are a `MapImportError`, which names the line.
    """

    def __init__(
        self,
        document: Document,
        ids: Mapping[str, Node],
        controllers: Sequence[Node],
        joints: Sequence[Mapping[str, Array]] | None,
    ) -> None:
        """Find out what the controllers need.

        Args:
            document: the file.
            ids: its elements by their `id`.
            controllers: `skin` and `morph` elements, the innermost first.
            joints: matrices (4, 4) of nodes in the file's frame by `sid` and `id`, of those below
                each node in which joints are looked for; None: skins stand as they were modelled.
        """
        self._document = document
        self._ids = ids
        self._controllers = controllers
        self._joints = joints or ()
        self.place: Array | None = None  # of the first joint: points are in the file's frame
        self.key = tuple(map(id, (*controllers, *self._joints)))
        self._skins: dict[int, tuple[Integers, Array, Array]] = {}
        for controller in controllers:
            if joints is None or controller.tag != "skin":
                continue
            if controller.child("vertex_weights") is not None:
                self._skins[id(controller)] = self._skin(controller)

    def bend(self, points: Array) -> Array:
        """Points (n, 3) of the geometry as the controllers leave them."""
        for controller in self._controllers:
            if controller.tag == "morph":
                points = self._morph(controller, points)
                continue
            bind = self._document.vector(controller.child("bind_shape_matrix"), 16, far=FAR)
            if bind is not None:
                matrix = bind.reshape(4, 4)
                points = points @ matrix[:3, :3].T + matrix[:3, 3]
            if id(controller) in self._skins:
                joints, weights, matrices = self._skins[id(controller)]
                if len(joints) != len(points):
                    problem = f"weights of {len(joints)} vertices for {len(points)}"
                    raise self._document.error(controller, problem)
                try:
                    points = skinned(points, joints, weights, matrices)
                except ValueError as error:
                    raise self._document.error(controller, str(error)) from None
        return points

    def _morph(self, morph: Node, points: Array) -> Array:
        targets = morph.child("targets")
        inputs = {} if targets is None else {n.get("semantic"): n for n in targets.all("input")}
        shapes, shares = inputs.get("MORPH_TARGET"), inputs.get("MORPH_WEIGHT")
        if shapes is None or shares is None:
            return points
        weights = source_values(self._document, self._ids, shares).reshape(-1)
        weights = np.nan_to_num(weights)
        changes = []
        for name in self._words(shapes)[: len(weights)]:
            shape = self._ids.get(name)
            found = None if shape is None else read_points(self._document, self._ids, shape)
            if found is None or found.shape != points.shape:
                raise self._document.error(morph, f"a morph into {name[:60]!r}, of other vertices")
            changes.append(found)
        weights = weights[: len(changes)]
        if morph.get("method", "NORMALIZED") == "NORMALIZED":
            changes = [change - points for change in changes]
        return morphed(points, changes, weights.tolist())

    def _skin(self, skin: Node) -> tuple[Integers, Array, Array]:
        """Joints and weights by vertex, and a matrix for each joint: see `figures.skinned`."""
        document = self._document
        listed = skin.child("joints")
        inputs = {} if listed is None else {n.get("semantic"): n for n in listed.all("input")}
        names, binds = inputs.get("JOINT"), inputs.get("INV_BIND_MATRIX")
        if names is None or binds is None:
            raise document.error(skin, "a skin without joints")
        words = self._words(names)
        matrices = source_values(document, self._ids, binds).reshape(-1)
        if len(matrices) != 16 * len(words):
            raise document.error(skin, "inverse bind matrices that are not as many as joints")
        places = [self._joint(skin, word) for word in words]
        if places:
            self.place = places[0]
        held = skin.child("vertex_weights")
        assert held is not None
        joints, weights = self._weights(held)
        return joints, weights, np.array(places) @ matrices.reshape(-1, 4, 4)

    def _weights(self, held: Node) -> tuple[Integers, Array]:
        """Joints and weights (n, k) by vertex."""
        document = self._document
        inputs = {node.get("semantic"): node for node in held.all("input")}
        sizes, chain = held.child("vcount"), held.child("v")
        if "JOINT" not in inputs or "WEIGHT" not in inputs or sizes is None or chain is None:
            raise document.error(held, "weights without joints")
        counts, numbers = document.integers(sizes), document.integers(chain)
        offsets = {key: whole_number(document, node, "offset", 0) for key, node in inputs.items()}
        stride = max(offsets.values()) + 1
        most = int(counts.max(initial=0))
        if counts.min(initial=0) < 0 or most > MOST_JOINTS:
            raise document.error(sizes, f"{most} joints hold one vertex")
        if int(counts.sum()) * stride > len(numbers):
            raise document.error(chain, f"{len(numbers)} numbers for {counts.sum()} joints")
        rows = numbers[: int(counts.sum()) * stride].reshape(-1, stride)
        values = source_values(document, self._ids, inputs["WEIGHT"]).reshape(-1)
        chosen = rows[:, offsets["WEIGHT"]]
        if len(chosen) and not 0 <= chosen.min() <= chosen.max() < len(values):
            raise document.error(chain, f"weight {chosen.max()} of {len(values)}")
        owner = np.repeat(np.arange(len(counts)), counts)
        column = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        joints = np.zeros((len(counts), most), dtype=np.int64)
        weights = np.zeros((len(counts), most))
        # Minus one is the shape as it is bound, which no joint holds.
        free = rows[:, offsets["JOINT"]] < 0
        joints[owner, column] = np.where(free, 0, rows[:, offsets["JOINT"]])
        weights[owner, column] = np.where(free, 0.0, values[chosen])
        return joints, weights

    def _joint(self, skin: Node, name: str) -> Array:
        """Matrix of a joint by its `sid`, or by its `id`."""
        for places in self._joints:
            if name in places:
                return places[name]
        raise self._document.error(skin, f"joint {name[:60]!r} is not in the scene")

    def _words(self, entry: Node) -> list[str]:
        """Names of the source that an input names."""
        source = self._ids.get(entry.get("source").removeprefix("#"))
        arrays = () if source is None else source.children
        found = next((n for n in arrays if n.tag in ("Name_array", "IDREF_array")), None)
        return [] if found is None else found.text.split()
