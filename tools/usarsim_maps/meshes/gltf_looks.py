"""Meshes that Draco has compressed (KHR_draco_mesh_compression), by the library DracoPy.

Materials of glTF: base colour, its picture, and how the picture lies on the surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.meshes.gltf_data import GltfFile, Item
from usarsim_maps.meshes.mesh_files import Pictures
from usarsim_maps.reader import need
from usarsim_maps.scene import Material
from usarsim_server.errors import MapImportError

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

EXTENSION = "KHR_draco_mesh_compression"

NONE = 1 << 31
"""An attribute that no buffer has."""


class DracoPrimitive:
    """What is in the compressed buffer of a primitive.

    Attributes:
        chain: (3 n,) vertex numbers of its triangles.
    """

    def __init__(self, file: GltfFile, primitive: Item) -> None:
        """Decompress it.

        Raises:
            MapImportError: DracoPy is not installed, or the buffer is damaged.
        """
        draco = need("DracoPy", file.path, "meshes compressed by Draco")
        self._file = file
        self._item = primitive.item("extensions").item(EXTENSION)
        view = self._item.index("bufferView", file.items("bufferViews"))
        if view is None:
            raise self._item.error("no buffer view")
        try:
            self._mesh = draco.decode(file.view(view))
            faces = np.asarray(self._mesh.faces, np.int64)
        except Exception as error:  # a library of C++ behind several layers: it says what it likes
            raise self._item.error(f"Draco cannot decompress it: {error}"[:200]) from None
        self.chain: Integers = faces.reshape(-1)

    def attribute(self, name: str, accessor: int) -> Array:
        """Values (n, width) of `POSITION` or another attribute, in the types of its accessor.

        Raises:
            MapImportError: the buffer has no such attribute.
        """
        number = self._item.item("attributes").number_of(name, NONE)
        found = self._mesh.get_attribute_by_unique_id(number)
        if found is None:
            raise self._item.error(f"attribute {number} ({name}) is not in the compressed buffer")
        values = np.asarray(found["data"])
        return self._file.as_accessor(accessor, values)


REPEAT, MIRRORED = 10497, 33648


@dataclass(frozen=True, slots=True)
class Mapping:
    """How a material uses texture coordinates.

    Attributes:
        channel: number of the set of coordinates.
        offset, scale: of KHR_texture_transform.
        rotation: rad, anticlockwise in the picture.
    """

    channel: int = 0
    offset: tuple[float, float] = (0.0, 0.0)
    scale: tuple[float, float] = (1.0, 1.0)
    rotation: float = 0.0

    def apply(self, uvs: Array) -> Array:
        """Coordinates (n, 2) with v upwards; in the file v counts downwards."""
        c, s = math.cos(self.rotation), math.sin(self.rotation)
        scaled = uvs * np.array(self.scale)
        turned = scaled @ np.array([[c, s], [-s, c]]).T + np.array(self.offset)
        answer: Array = turned * np.array([1.0, -1.0]) + np.array([0.0, 1.0])
        return answer


def finish_materials(file: GltfFile, pictures: Pictures) -> list[tuple[Material, Mapping]]:
    """All materials in the order of the file; names are made unique.

    A picture that cannot be had is a finding.

    Raises:
        MapImportError: the list of materials is none.
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
    material = Material(name, (_srgb(r), _srgb(g), _srgb(b), max(0.0, a)))
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


def _srgb(value: float) -> float:
    """Colour factors are linear; screens are not."""
    if value <= 0.0031308:
        return 12.92 * value
    return float(1.055 * value ** (1.0 / 2.4) - 0.055)
