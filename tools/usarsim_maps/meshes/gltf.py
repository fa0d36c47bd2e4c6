"""Reads glTF 2.0, as `.gltf` with its files and as `.glb` (worlds reference 2.4, item 41).

Y is up and lengths are metres by definition. Custom properties that Blender exports as `extras`
count on nodes: `tag`, `movable`, `mass`, `friction`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usarsim_maps.meshes.gltf_data import DRACO, DracoPrimitive, GltfFile, Item, load_gltf
from usarsim_maps.meshes.mesh_files import Axes, Pictures, SceneBuilder, axes_of
from usarsim_maps.meshes.polygons import MeshBuilder
from usarsim_maps.reader import Context, Reader, register
from usarsim_maps.scene import Array, Integers, LightKind, Material, Mesh, Part, Scene, SceneObject
from usarsim_maps.units import affine, srgb
from usarsim_server.errors import MapImportError, at
from usarsim_server.simulation.frames import Pose

MAX_OBJECTS = 100_000

UNDERSTOOD = {
    "KHR_lights_punctual", "KHR_materials_emissive_strength", "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness", "KHR_materials_specular", "KHR_materials_transmission",
    "KHR_materials_unlit", "KHR_materials_volume", "KHR_mesh_quantization",
    "KHR_texture_transform", "EXT_mesh_gpu_instancing", DRACO,
}  # fmt: skip
"""Extensions that a file may require."""

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

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`."""
        file = load_gltf(source, context.confined())
        missing = sorted(set(file.words("extensionsRequired")) - UNDERSTOOD)
        if missing:
            cure = "export without compression and without this extension"
            raise MapImportError(at(source, f"the file requires {missing[0]}", cure))
        axes = axes_of(context.options, "Y")
        return _GltfScene(file, context, axes).filled()


class _GltfScene(SceneBuilder):
    """A scene being filled."""

    def __init__(self, file: GltfFile, context: Context, axes: Axes) -> None:
        super().__init__(file.path, context, axes)
        self._file = file
        self._materials = finish_materials(file, self.pictures)

    def filled(self) -> Scene:
        """Everything that the default scene shows."""
        for item, matrix in self._nodes():
            for whole in self._instances(item, matrix):
                self._node(item, whole)
                if len(self.objects) > MAX_OBJECTS:
                    raise item.error(f"more than {MAX_OBJECTS} objects", "split the map")
        if self._file.items("skins"):
            self.findings.warn(self.path.name, "figures with bones are shown as modelled")
        materials = {material.name: material for material, _ in self._materials}
        return self.scene("glTF", materials, self._file.files)

    # ---- nodes -----------------------------------------------------------------------------

    def _nodes(self) -> Iterator[tuple[Item, Array]]:
        """Every node of the default scene once, with its matrix; parents first."""
        nodes, scenes = self._file.items("nodes"), self._file.items("scenes")
        roots = list(range(len(nodes)))
        if scenes:
            first = self._file.root.index("scene", scenes) or 0
            roots = scenes[first].indices("nodes", nodes)
        elif nodes:
            inner = {child for node in nodes for child in node.indices("children", nodes)}
            roots = [number for number in roots if number not in inner]
        todo = [(number, np.eye(4)) for number in reversed(roots)]
        seen: set[int] = set()
        while todo:
            number, parent = todo.pop()
            node = nodes[number]
            if number in seen:
                raise node.error("a node has two parents, or is its own", "export the map again")
            seen.add(number)
            own = _matrix(node)
            if own is None:
                text = f"{node.place} has no place; left out with all in it"
                self.findings.warn(self.path.name, text)
                continue
            matrix = parent @ own
            yield node, matrix
            children = node.indices("children", nodes)
            todo.extend((child, matrix) for child in reversed(children))

    def _instances(self, node: Item, matrix: Array) -> Iterator[Array]:
        """The matrices of a node: one, or those of its instances."""
        instancing = node.item("extensions").item("EXT_mesh_gpu_instancing")
        if not instancing.value:
            yield matrix
            return
        attributes = instancing.item("attributes")
        columns = {
            word: self._file.accessor(attributes.index(word, self._file.items("accessors")))
            for word in ("TRANSLATION", "ROTATION", "SCALE")
            if word in attributes.value
        }
        count = min((len(column) for column in columns.values()), default=0)
        if count > MAX_OBJECTS:
            raise node.error(f"{count} instances", "split the map")
        for row in range(count):
            yield matrix @ _compose(
                columns["TRANSLATION"][row] if "TRANSLATION" in columns else np.zeros(3),
                columns["ROTATION"][row] if "ROTATION" in columns else np.array([0.0, 0, 0, 1]),
                columns["SCALE"][row] if "SCALE" in columns else np.ones(3),
            )

    def _node(self, node: Item, matrix: Array) -> None:
        name = node.text("name") or f"node{node.number}"
        extras = node.item("extras")
        number = node.index("mesh", self._file.items("meshes"))
        if number is not None:
            meshes = self._file.items("meshes")
            mesh = self.mesh(number, lambda: self._build(meshes[number]))
            if mesh is None:
                return
            self.findings.count("mesh node")
            pose, local = self.axes.place(matrix)
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
            return
        lights = self._file.root.item("extensions").item("KHR_lights_punctual").items("lights")
        light = node.item("extensions").item("KHR_lights_punctual").index("light", lights)
        if light is not None:
            self._light(lights[light], name, matrix)
            return
        self.mark(name, matrix, extras.text("tag"))

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

    # ---- meshes ----------------------------------------------------------------------------

    def _build(self, item: Item) -> Mesh | None:
        whole = MeshBuilder(self.path)
        for primitive in item.items("primitives"):
            found = self._primitive(primitive)
            if found is None:
                continue
            vertices, triangles, texture, material = found
            whole.add(
                vertices, triangles, None if texture is None else texture[triangles], [material]
            )
        return whole.mesh(item.text("name") or f"mesh{item.number}")

    def _primitive(self, item: Item) -> tuple[Array, Integers, Array | None, str] | None:
        """Vertices, triangles, texture coordinates per vertex, material; None for lines."""
        mode = item.value.get("mode", 4)
        attributes, accessors = item.item("attributes"), self._file.items("accessors")
        place = attributes.index("POSITION", accessors)
        if mode not in (4, 5, 6) or place is None:
            self.findings.skip("points and lines")
            return None
        packed = None
        if DRACO in item.item("extensions").value:
            packed = DracoPrimitive(self._file, item)
        vertices = self._values("POSITION", place, packed)
        if vertices.shape[1] != 3:
            raise item.error("positions that are no triples")
        indices = item.index("indices", accessors)
        if packed is not None:
            chain, mode = packed.chain, 4
        elif indices is None:
            chain = np.arange(len(vertices))
        else:
            chain = self._file.accessor(indices)[:, 0].astype(np.int64)
        if len(chain) and not 0 <= chain.min() <= chain.max() < len(vertices):
            raise item.error(f"index {chain.max()} of {len(vertices)} vertices")
        name, texture = "", None
        try:
            slot = item.index("material", self._materials)
            if slot is not None:
                material, mapping = self._materials[slot]
                name = material.name
                channel = f"TEXCOORD_{mapping.channel}"
                uv = attributes.index(channel, accessors)
                if uv is not None and (material.texture or material.image):
                    texture = mapping.apply(self._values(channel, uv, packed)[:, :2])
                    if len(texture) != len(vertices):
                        raise item.error("texture coordinates are not as many as vertices")
        except MapImportError as error:  # a surface without its looks is a surface
            self.findings.warn(self.path.name, f"{error}; its looks were left out")
            texture = None
        return vertices, _triangles(chain, int(mode)), texture, name

    def _values(self, name: str, accessor: int, packed: DracoPrimitive | None) -> Array:
        """An attribute, from its accessor or from the compressed buffer."""
        if packed is not None:
            return packed.attribute(name, accessor)
        return self._file.accessor(accessor)


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


# ---- materials -----------------------------------------------------------------------------

REPEAT, MIRRORED = 10497, 33648


@dataclass(frozen=True, slots=True)
class Mapping:
    """How a material uses texture coordinates."""

    channel: int = 0  # number of the set of coordinates
    offset: tuple[float, float] = (0.0, 0.0)  # of KHR_texture_transform
    scale: tuple[float, float] = (1.0, 1.0)
    rotation: float = 0.0  # rad, anticlockwise in the picture

    def apply(self, uvs: Array) -> Array:
        """Coordinates (n, 2) with v upwards; in the file v counts downwards."""
        c, s = math.cos(self.rotation), math.sin(self.rotation)
        scaled = uvs * np.array(self.scale)
        turned = scaled @ np.array([[c, s], [-s, c]]).T + np.array(self.offset)
        return np.asarray(turned * np.array([1.0, -1.0]) + np.array([0.0, 1.0]))


def finish_materials(file: GltfFile, pictures: Pictures) -> list[tuple[Material, Mapping]]:
    """All materials in the order of the file; names are made unique.

    A picture that cannot be had is a finding.
    """
    taken: set[str] = set()
    answer = []
    for item in file.items("materials"):
        name = item.text("name") or "material"
        if name in taken:
            name = f"{name}-{item.number}"
        taken.add(name)
        answer.append(_material(file, item, name, pictures))
    return answer


def _material(
    file: GltfFile, item: Item, name: str, pictures: Pictures
) -> tuple[Material, Mapping]:
    findings = pictures.context.findings
    base, color, picture = item.item("pbrMetallicRoughness"), "baseColorFactor", "baseColorTexture"
    older = item.item("extensions").item("KHR_materials_pbrSpecularGlossiness")
    if older.value:
        base, color, picture = older, "diffuseFactor", "diffuseTexture"
    r, g, b, a = np.clip(base.vector(color, (1.0, 1.0, 1.0, 1.0), findings), 0.0, 1.0).tolist()
    if item.text("alphaMode") != "BLEND":
        a = 1.0
    passed = item.item("extensions").item("KHR_materials_transmission")
    a = min(a, 1.0 - 0.8 * (passed.positive("transmissionFactor") or 0.0))
    material = Material(name, (srgb(r), srgb(g), srgb(b), max(0.0, a)))
    texture = base.item(picture)
    try:
        number = texture.index("index", file.items("textures"))
        if number is not None:
            return _textured(file, material, file.items("textures")[number], texture, pictures)
    except MapImportError as error:
        findings.warn(file.path.name, f"{error}; the picture of {name!r} was left out")
    return material, Mapping()


def _textured(
    file: GltfFile, material: Material, entry: Item, use: Item, pictures: Pictures
) -> tuple[Material, Mapping]:
    source = entry.index("source", file.items("images"))
    for word in ("EXT_texture_webp", "MSFT_texture_dds"):
        if source is None:
            source = entry.item("extensions").item(word).index("source", file.items("images"))
    if source is None:
        return material, Mapping()
    image = file.items("images")[source]
    sampler = entry.index("sampler", file.items("samplers"))
    repeat = True
    if sampler is not None:
        wrap = file.items("samplers")[sampler].number_of("wrapS", REPEAT)
        repeat = wrap in (REPEAT, MIRRORED)
    path, content = None, None
    uri = image.text("uri")
    view = image.index("bufferView", file.items("bufferViews"))
    if uri.startswith("data:"):
        content = file.resource(image, uri)
    elif uri:
        path = pictures.find(uri)
    elif view is not None:
        content = file.view(view)
    change = use.item("extensions").item("KHR_texture_transform")
    findings = pictures.context.findings
    u, v = change.vector("offset", (0.0, 0.0), findings)
    su, sv = change.vector("scale", (1.0, 1.0), findings)
    mapping = Mapping(
        channel=change.number_of("texCoord", use.number_of("texCoord", 0)),
        offset=(u, v),
        scale=(su, sv),
        rotation=change.number_or("rotation", 0.0),
    )
    return Material(material.name, material.color, path, content, repeat), mapping
