"""Materials of glTF: colour, picture and its place, holes by the opacity of a picture."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from usarsim_maps.meshes.gltf_data import GltfFile, Item
from usarsim_maps.meshes.gltf_support import OBJECTS
from usarsim_maps.meshes.mesh_files import Pictures
from usarsim_maps.scene import Array, Material, Opacity
from usarsim_maps.support import Support
from usarsim_maps.units import srgb
from usarsim_server.base.errors import MapImportError

REPEAT, MIRRORED = 10497, 33648


@dataclass(frozen=True, slots=True)
class Mapping:
    """How a material uses what vertices have."""

    channel: int = 0  # number of the set of coordinates
    offset: tuple[float, float] = (0.0, 0.0)  # of KHR_texture_transform
    scale: tuple[float, float] = (1.0, 1.0)
    rotation: float = 0.0  # rad, anticlockwise in the picture
    blend: bool = False  # the opacity of vertices counts

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
    mode, opacity = item.text("alphaMode"), None
    if mode == "BLEND":
        opacity = Opacity(blend=True)
    elif mode == "MASK":
        # The factor multiplies the picture's opacity, and nothing is drawn half.
        opacity = Opacity(cutoff=item.number_or("alphaCutoff", 0.5) / max(a, 1e-6))
    if mode != "BLEND":
        a = 1.0
    for owner in (item, base):
        for key in owner.value:
            if OBJECTS.get(key) is Support.LEFT_OUT:
                findings.skip(key, name)
    passed = item.item("extensions").item("KHR_materials_transmission")
    a = min(a, 1.0 - 0.8 * (passed.positive("transmissionFactor") or 0.0))
    material = Material(name, (srgb(r), srgb(g), srgb(b), max(0.0, a)), opacity=opacity)
    texture = base.item(picture)
    try:
        number = texture.index("index", file.items("textures"))
        if number is not None:
            return _textured(file, material, file.items("textures")[number], texture, pictures)
    except MapImportError as error:
        findings.warn(file.path.name, f"{error}; the picture of {name!r} was left out")
    return replace(material, opacity=None), Mapping(blend=mode == "BLEND")


def _textured(
    file: GltfFile, material: Material, entry: Item, use: Item, pictures: Pictures
) -> tuple[Material, Mapping]:
    images = file.items("images")
    source = entry.index("source", images)
    for word in ("EXT_texture_webp", "MSFT_texture_dds"):
        if source is None:
            source = entry.item("extensions").item(word).index("source", images)
    if source is None:
        unread = [own.index("source", images) for own in _inside(entry.item("extensions"))]
        for number in unread:
            if number is not None:
                found = images[number]
                name = found.text("name") or found.text("uri")[:80] or found.place
                pictures.context.findings.skip("picture of an unknown kind", name)
        blend = material.opacity is not None and material.opacity.blend
        return replace(material, opacity=None), Mapping(blend=blend)
    image = images[source]
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
        blend=material.opacity is not None and material.opacity.blend,
    )
    return replace(material, texture=path, image=content, repeat=repeat), mapping


def _inside(item: Item) -> list[Item]:
    """The objects inside an object."""
    return [item.item(key) for key in item.value]
