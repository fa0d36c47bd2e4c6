"""Reads glTF 2.0, as `.gltf` with its files and as `.glb` (worlds reference 2.4, item 41).

Y is up and lengths are metres by definition. Custom properties that Blender exports as `extras`
count on nodes: `tag`, `movable`, `mass`, `friction`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from usarsim_maps.meshes.figures import morphed, skinned
from usarsim_maps.meshes.gltf_data import DRACO, DracoPrimitive, GltfFile, Item, load_gltf
from usarsim_maps.meshes.gltf_materials import finish_materials
from usarsim_maps.meshes.gltf_support import (
    EXTENSIONS,
    MODES,
    OBJECTS,
    note_extensions,
)
from usarsim_maps.meshes.mesh_files import Axes, SceneBuilder, axes_of
from usarsim_maps.meshes.polygons import MeshBuilder
from usarsim_maps.meshes.vertex_colors import WHITE, shaded
from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import Array, Integers, LightKind, Material, Mesh, Part, Scene, SceneObject
from usarsim_maps.support import Support, SupportTable
from usarsim_maps.units import affine, shown
from usarsim_server.base.errors import MapImportError
from usarsim_server.simulation.frames import Pose

MAX_OBJECTS = 100_000

MAX_SETS = 8
"""Sets of four joints that hold a vertex."""

REST = {
    "translation": (0.0, 0.0, 0.0),
    "rotation": (0.0, 0.0, 0.0, 1.0),
    "scale": (1.0, 1.0, 1.0),
}
"""Transformation of a node that says nothing."""

ORDINARY_LAMP = 20.0
"""cd: what counts as brightness 1; Blender writes a 100 W lamp as some 54 cd."""


@register("gltf")
class GltfReader(Reader):
    """One object for every node with a mesh."""

    title = "glTF"
    extensions = (".glb", ".gltf")
    head = re.compile(rb'(?s)\AglTF|\A[\xef\xbb\xbf \t\r\n]*\{(?=.*"asset")(?=.*"version")')
    support: ClassVar[Mapping[str, SupportTable]] = {
        "glTF extensions": EXTENSIONS,
        "glTF objects": OBJECTS,
    }

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`."""
        file = load_gltf(source, context.confined())
        note_extensions(file, context.findings)
        axes = axes_of(context.options, "Y")
        return _GltfScene(file, context, axes).filled()


@dataclass(frozen=True, slots=True)
class _GltfNode:
    """A node of the scene that is shown."""

    item: Item
    matrix: Array  # (4, 4) into the file's frame
    hidden: bool  # KHR_node_visibility of it or of a node above says so


@dataclass(frozen=True, slots=True, eq=False)
class _GltfSkin:
    """A skeleton in its rest pose."""

    matrices: Array  # (j, 4, 4), see `figures.skinned`
    place: Array  # (4, 4) where the skeleton stands


class _GltfScene(SceneBuilder):
    """A scene being filled."""

    def __init__(self, file: GltfFile, context: Context, axes: Axes) -> None:
        super().__init__(file.path, context, axes)
        self._file = file
        self._materials = finish_materials(file, self.pictures)
        self._known = {material.name: material for material, _ in self._materials}
        self._places: dict[int, Array] = {}
        self._skins: dict[int, _GltfSkin] = {}

    def filled(self) -> Scene:
        """Everything that the default scene shows."""
        nodes = list(self._nodes())
        self._places = {node.item.number: node.matrix for node in nodes}
        for node in nodes:
            for matrix in self._instances(node):
                self._node(node, matrix)
                if len(self.objects) > MAX_OBJECTS:
                    cure = "split the map"
                    raise node.item.error(f"more than {MAX_OBJECTS} objects", cure)
        for animation in self._file.items("animations"):
            self.findings.skip("animation", animation.text("name"))
        return self.scene("glTF", self._known, self._file.files)

    # ---- nodes -----------------------------------------------------------------------------

    def _nodes(self) -> Iterator[_GltfNode]:
        """Every node of the default scene once; parents first, of levels of detail the finest."""
        nodes, scenes = self._file.items("nodes"), self._file.items("scenes")
        roots = list(range(len(nodes)))
        if scenes:
            first = self._file.root.index("scene", scenes) or 0
            roots = scenes[first].indices("nodes", nodes)
            for scene in scenes[:first] + scenes[first + 1 :]:
                self.findings.skip("scene", scene.text("name"))
        elif nodes:
            inner = {child for node in nodes for child in node.indices("children", nodes)}
            roots = [number for number in roots if number not in inner]
        coarser = {
            number
            for node in nodes
            for number in node.item("extensions").item("MSFT_lod").indices("ids", nodes)
        }
        todo = [(number, np.eye(4), False) for number in reversed(roots)]
        seen: set[int] = set()
        while todo:
            number, parent, hidden = todo.pop()
            node = nodes[number]
            if number in coarser:
                continue
            if number in seen:
                raise node.error("a node has two parents, or is its own", "export the map again")
            seen.add(number)
            own = _matrix(node)
            if own is None:
                text = f"{node.place} has no place; left out with all in it"
                self.findings.warn(self.path.name, text)
                continue
            matrix = parent @ own
            seen_of = node.item("extensions").item("KHR_node_visibility").value
            hidden = hidden or seen_of.get("visible") is False
            yield _GltfNode(node, matrix, hidden)
            children = node.indices("children", nodes)
            todo.extend((child, matrix, hidden) for child in reversed(children))

    def _place(self, number: int) -> Array:
        """Matrix of any node; also of one outside of the default scene, as joints may be."""
        if number in self._places:
            return self._places[number]
        nodes = self._file.items("nodes")
        matrix, way = np.eye(4), [number]
        while way[-1] in self._above and len(way) <= len(nodes):
            way.append(self._above[way[-1]])
        for step in way:
            own = _matrix(nodes[step])
            if own is None:
                raise nodes[step].error("no place")
            matrix = own @ matrix
        self._places[number] = matrix
        return matrix

    @cached_property
    def _above(self) -> dict[int, int]:
        """The parent of each node that has one."""
        nodes = self._file.items("nodes")
        return {c: node.number for node in nodes for c in node.indices("children", nodes)}

    def _instances(self, node: _GltfNode) -> Iterator[Array]:
        """The matrices of a node: one, or those of its instances."""
        instancing = node.item.item("extensions").item("EXT_mesh_gpu_instancing")
        attributes = instancing.item("attributes")
        accessors = self._file.items("accessors")
        columns = {
            word: self._file.accessor(attributes.index(word, accessors))
            for word in ("TRANSLATION", "ROTATION", "SCALE")
            if word in attributes.value
        }
        if not columns or node.item.value.get("skin") is not None:
            yield node.matrix
            return
        count = min(len(column) for column in columns.values())
        if count > MAX_OBJECTS:
            raise node.item.error(f"{count} instances", "split the map")
        for row in range(count):
            yield node.matrix @ _compose(
                columns["TRANSLATION"][row] if "TRANSLATION" in columns else np.zeros(3),
                columns["ROTATION"][row] if "ROTATION" in columns else np.array([0.0, 0, 0, 1]),
                columns["SCALE"][row] if "SCALE" in columns else np.ones(3),
            )

    def _node(self, node: _GltfNode, matrix: Array) -> None:
        item = node.item
        name = item.text("name") or f"node{item.number}"
        number = item.index("mesh", self._file.items("meshes"))
        lights = self._file.root.item("extensions").item("KHR_lights_punctual").items("lights")
        light = item.item("extensions").item("KHR_lights_punctual").index("light", lights)
        camera = item.index("camera", self._file.items("cameras"))
        if camera is not None:
            self.findings.skip("camera", name)
        if node.hidden and (number is not None or light is not None):
            self.findings.skip("hidden node", name)
            return
        if number is not None:
            self._show(item, name, number, matrix)
        if light is not None:
            self._light(lights[light], name, matrix)
        if number is None and light is None and camera is None:
            self.mark(name, matrix, item.item("extras").text("tag"))

    def _show(self, node: Item, name: str, number: int, matrix: Array) -> None:
        """An object for a node with a mesh."""
        item = self._file.items("meshes")[number]
        extras = node.item("extras")
        weights = tuple(_weights(node) or _weights(item))
        skin, mesh = None, None
        slot = node.index("skin", self._file.items("skins"))
        if slot is not None:
            try:
                skin = self._skin(slot)
                mesh = self.mesh((number, weights, slot), lambda: self._build(item, weights, skin))
            except MapImportError as error:
                self.findings.warn(self.path.name, f"{error}; {name} stands as it was modelled")
                skin = None
        if skin is None:
            mesh = self.mesh((number, weights), lambda: self._build(item, weights, None))
        if mesh is None:
            return
        self.findings.count("mesh node")
        if skin is None:
            pose, local = self.axes.place(matrix)
        else:
            # Joints alone say where a skin is: its node's matrix does not count.
            pose, local = self.axes.place(skin.place, np.eye(4))
        self.objects.append(
            SceneObject(
                name=name,
                parts=(Part(mesh, local),),
                pose=pose,
                tag=extras.text("tag"),
                kind=extras.text("class") or "node",
                movable=bool(extras.value.get("movable")) is True,
                mass=extras.positive("mass"),
                friction=extras.positive("friction"),
            )
        )

    def _light(self, light: Item, name: str, matrix: Array) -> None:
        kinds = {"directional": LightKind.DIRECTIONAL, "spot": LightKind.SPOT}
        kind = kinds.get(light.text("type"), LightKind.POINT)
        strength = light.number_or("intensity", 1.0)
        if kind is not LightKind.DIRECTIONAL:
            strength /= ORDINARY_LAMP
        self.light(
            name,
            kind,
            matrix,
            light.vector("color", (1.0, 1.0, 1.0), self.findings),
            brightness=min(10.0, max(0.0, strength)),
            reach=max(0.0, light.number_or("range", 0.0)) / self.axes.units_per_metre,
            cone=float(np.degrees(light.item("spot").number_or("outerConeAngle", np.pi / 4.0))),
        )

    def _skin(self, number: int) -> _GltfSkin:
        """A skeleton as its nodes stand; a `MapImportError` if it cannot be had."""
        if number not in self._skins:
            item = self._file.items("skins")[number]
            nodes = self._file.items("nodes")
            joints = item.indices("joints", nodes)
            if not joints:
                raise item.error("a skin without joints")
            matrices = np.array([self._place(joint) for joint in joints])
            binds = item.index("inverseBindMatrices", self._file.items("accessors"))
            if binds is not None:
                found = self._file.accessor(binds)
                if found.shape[1] != 16 or len(found) < len(joints):
                    raise item.error("inverse bind matrices that are not as many as joints")
                # Matrices stand in the file column by column.
                matrices = matrices @ found[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
            root = item.index("skeleton", nodes)
            place = self._place(joints[0] if root is None else root)
            self._skins[number] = _GltfSkin(matrices, affine(offset=place[:3, 3]))
        return self._skins[number]

    # ---- meshes ----------------------------------------------------------------------------

    def _build(self, item: Item, weights: Sequence[float], skin: _GltfSkin | None) -> Mesh | None:
        whole = MeshBuilder(self.path)
        name = item.text("name") or f"mesh{item.number}"
        for primitive in item.items("primitives"):
            mode = primitive.number_of("mode", 4)
            word = MODES[mode] if mode < len(MODES) else f"primitive of mode {mode}"
            if OBJECTS.get(word) is not Support.READ:
                self.findings.skip(word, name)
                continue
            self._primitive(primitive, MODES.index(word), weights, skin, whole)
        return whole.mesh(name)

    def _primitive(
        self,
        item: Item,
        mode: int,
        weights: Sequence[float],
        skin: _GltfSkin | None,
        whole: MeshBuilder,
    ) -> None:
        """Add the triangles of a primitive to a mesh."""
        attributes, accessors = item.item("attributes"), self._file.items("accessors")
        place = attributes.index("POSITION", accessors)
        if place is None:
            self.findings.skip("primitive without positions")
            return
        packed = self._packed(item)
        vertices = self._values("POSITION", place, packed)
        if vertices.shape[1] != 3:
            raise item.error("positions that are no triples")
        vertices = self._bent(item, vertices, weights, skin, packed)
        indices = item.index("indices", accessors)
        if packed is not None:
            triangles = packed.chain.reshape(-1, 3)
        elif indices is None:
            triangles = _triangles(np.arange(len(vertices)), mode)
        else:
            chain = self._file.accessor(indices)[:, 0].astype(np.int64)
            last = self._file.greatest(indices)
            runs = np.split(chain, np.flatnonzero(chain == last)) if mode != 4 else [chain]
            triangles = np.concatenate([_triangles(run[run != last], mode) for run in runs])
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
            raise item.error(f"index {triangles.max()} of {len(vertices)} vertices")
        material, texture = self._looks(item, len(vertices), packed)
        materials, slots = self._shaded(item, material, triangles, len(vertices), packed)
        uvs = None if texture is None else texture[triangles]
        whole.add(vertices, triangles, uvs, materials, slots)

    def _packed(self, item: Item) -> DracoPrimitive | None:
        """The compressed buffer of a primitive that has one.

        Where the file has plain numbers, too, they stand in for a library that is not installed.
        """
        if DRACO not in item.item("extensions").value:
            return None
        try:
            return DracoPrimitive(self._file, item)
        except MapImportError:
            if DRACO in self._file.words("extensionsRequired"):
                raise
            return None

    def _bent(
        self,
        item: Item,
        vertices: Array,
        weights: Sequence[float],
        skin: _GltfSkin | None,
        packed: DracoPrimitive | None,
    ) -> Array:
        """Vertices (n, 3) as morph targets and joints bend them."""
        attributes, accessors = item.item("attributes"), self._file.items("accessors")
        changes, used = [], []
        for target, weight in zip(item.items("targets"), weights, strict=False):
            number = target.index("POSITION", accessors)
            if number is None or not weight:
                continue
            change = self._file.accessor(number)
            if change.shape != vertices.shape:
                raise target.error("a morph target of other vertices")
            changes.append(change)
            used.append(weight)
        vertices = morphed(vertices, changes, used)
        if skin is None:
            return vertices
        joints, shares = [], []
        for number in range(MAX_SETS):
            words = f"JOINTS_{number}", f"WEIGHTS_{number}"
            found = [attributes.index(word, accessors) for word in words]
            if found[0] is None or found[1] is None:
                break
            joints.append(self._values(words[0], found[0], packed).astype(np.int64))
            shares.append(self._values(words[1], found[1], packed))
        if not joints or any(len(v) != len(vertices) for v in (*joints, *shares)):
            raise item.error("joints and weights are not as many as vertices")
        held = np.concatenate(joints, axis=1), np.concatenate(shares, axis=1)
        if held[0].shape != held[1].shape:
            raise item.error("weights are not as many as joints")
        try:
            return skinned(vertices, *held, skin.matrices)
        except ValueError as error:
            raise item.error(str(error)) from None

    def _looks(
        self, item: Item, count: int, packed: DracoPrimitive | None
    ) -> tuple[Material | None, Array | None]:
        """Material of a primitive and texture coordinates (n, 2) of its vertices; None without."""
        attributes, accessors = item.item("attributes"), self._file.items("accessors")
        material = None
        try:
            slot = item.index("material", self._materials)
            if slot is None:
                return None, None
            material, mapping = self._materials[slot]
            channel = f"TEXCOORD_{mapping.channel}"
            uv = attributes.index(channel, accessors)
            if uv is None or not (material.texture or material.image):
                return material, None
            texture = mapping.apply(self._values(channel, uv, packed)[:, :2])
            if len(texture) != count:
                raise item.error("texture coordinates are not as many as vertices")
            return material, texture
        except MapImportError as error:  # a surface without its looks is a surface
            self.findings.warn(self.path.name, f"{error}; its looks were left out")
            return material, None

    def _shaded(
        self,
        item: Item,
        material: Material | None,
        triangles: Integers,
        count: int,
        packed: DracoPrimitive | None,
    ) -> tuple[list[str], Integers | None]:
        """Names of materials, and their numbers by triangle: one, or its shades by COLOR_0."""
        names = [material.name if material else ""]
        attributes, accessors = item.item("attributes"), self._file.items("accessors")
        try:
            number = attributes.index("COLOR_0", accessors)
            if number is None or not len(triangles):
                return names, None
            colors = self._values("COLOR_0", number, packed)
            if len(colors) != count or colors.shape[1] not in (3, 4):
                raise item.error("colours are not as many as vertices")
        except MapImportError as error:
            self.findings.warn(self.path.name, f"{error}; colours of vertices were left out")
            return names, None
        most = float(np.nanmax(colors, initial=0.0))
        if most > 1.0:  # whole numbers that do not say that they are normalized
            colors = colors / (255.0 if most <= 255.0 else 65535.0)
        slot = None if material is None else item.index("material", self._materials)
        if slot is None or not self._materials[slot][1].blend:
            colors = colors[:, :3]
        rgb = shown(np.nan_to_num(np.clip(colors[:, :3], 0.0, 1.0)))
        colors = np.column_stack([rgb, colors[:, 3:]])
        shades, slots = shaded(colors[triangles].mean(axis=1), material or WHITE)
        self._known |= {shade.name: shade for shade in shades}
        return [shade.name for shade in shades], slots

    def _values(self, name: str, accessor: int, packed: DracoPrimitive | None) -> Array:
        """An attribute, from its accessor or from the compressed buffer."""
        if packed is not None and packed.has(name):
            return packed.attribute(name, accessor)
        return self._file.accessor(accessor)


def _weights(item: Item) -> list[float]:
    """Weights of the morph targets of a node or mesh; those that make no sense are zero."""
    found = item.value.get("weights")
    if not isinstance(found, list):
        return []
    return [
        float(weight)
        if isinstance(weight, int | float) and not isinstance(weight, bool) and abs(weight) < 1e6
        else 0.0
        for weight in found
    ]


def _triangles(chain: Integers, mode: int) -> Integers:
    """Triangles (m, 3) of a list, strip or fan of indices."""
    if mode == 4:
        return chain[: len(chain) // 3 * 3].reshape(-1, 3)
    if len(chain) < 3:
        return np.zeros((0, 3), dtype=np.int64)
    if mode == 6:
        first = np.full(len(chain) - 2, chain[0])
        return np.column_stack([first, chain[1:-1], chain[2:]])
    found = np.column_stack([chain[:-2], chain[1:-1], chain[2:]])
    found[1::2] = found[1::2][:, [1, 0, 2]]
    return found


def _matrix(node: Item) -> Array | None:
    """Matrix (4, 4) of a node in its parent; None if a number makes no sense."""
    if node.value.get("matrix") is not None:
        found = node.floats("matrix", 16)
        return None if found is None else found.reshape(4, 4).T
    parts = []
    for key, default in REST.items():
        part = node.floats(key, len(default)) if key in node.value else np.array(default)
        if part is None:
            return None
        parts.append(part)
    return _compose(*parts)


def _compose(translation: Array, rotation: Array, scale: Array) -> Array:
    """Translation, rotation (x, y, z, w) and scale as a matrix."""
    x, y, z, w = rotation / max(float(np.linalg.norm(rotation)), 1e-12)
    return affine(Pose(quaternion=(w, x, y, z)).matrix() * scale, translation)
