"""Materials of COLLADA: from a material through its effect to a colour or a picture."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from usarsim_maps.meshes.mesh_files import Pictures
from usarsim_maps.meshes.xml_text import Document, Node
from usarsim_maps.numbers import read_numbers
from usarsim_maps.scene import Color, Material

__all__ = ["read_materials"]

SHADERS = ("phong", "lambert", "blinn", "constant")
GREY: Color = (0.7, 0.7, 0.7, 1.0)


def read_materials(
    document: Document, ids: Mapping[str, Node], pictures: Pictures
) -> dict[str, Material]:
    """All materials by their ids, which is what geometry binds to.

    A material that makes no sense becomes neutral grey.
    """
    answer = {}
    for library in document.root.all("library_materials"):
        for node in library.all("material"):
            name = node.get("id") or node.get("name")
            if name:
                answer[name] = _material(name, node, ids, pictures)
    return answer


def _material(name: str, node: Node, ids: Mapping[str, Node], pictures: Pictures) -> Material:
    instance = node.child("instance_effect")
    effect = None if instance is None else ids.get(instance.get("url").removeprefix("#"))
    profile = None if effect is None else effect.child("profile_COMMON")
    technique = None if profile is None else profile.child("technique")
    if effect is None or profile is None or technique is None:
        return Material(name)
    shader = next((child for child in technique.children if child.tag in SHADERS), None)
    if shader is None:
        return Material(name)
    color = GREY
    look = shader.child("diffuse") or shader.child("emission")
    if look is None:
        return Material(name, (*color[:3], _opacity(shader)))
    plain, texture = look.child("color"), look.child("texture")
    if plain is not None:
        color = _color(plain) or GREY
    if texture is None:
        return Material(name, (*color[:3], min(color[3], _opacity(shader)) or 1.0))
    image = _image(texture.get("texture"), [technique, profile, effect], ids)
    found = pictures.find(image) if image else None
    opacity = _opacity(shader)
    return Material(name, (1.0, 1.0, 1.0, opacity), found) if found else Material(name)


def _color(node: Node) -> Color | None:
    values = _numbers(node)
    if len(values) < 3:
        return None
    r, g, b = (min(1.0, max(0.0, value)) for value in values[:3])
    return r, g, b, min(1.0, max(0.0, values[3])) if len(values) > 3 else 1.0


def _numbers(node: Node) -> list[float]:
    try:
        values = read_numbers(node.text, 1, 3, 4)
    except ValueError:
        return []
    return values if np.isfinite(values).all() else []


def _opacity(shader: Node) -> float:
    """Opacity, where it is believable: exporters disagree about which end is opaque."""
    value = shader.child("transparency", "float")
    numbers = [] if value is None else _numbers(value)
    if len(numbers) == 1 and 0.05 <= numbers[0] <= 0.95:
        mode = shader.child("transparent")
        zero = mode is not None and mode.get("opaque").endswith("ZERO")
        return 1.0 - numbers[0] if zero else numbers[0]
    return 1.0


def _image(name: str, places: list[Node], ids: Mapping[str, Node]) -> str:
    """File behind a texture: sampler, surface, image; or the image at once."""
    parameters = {
        parameter.get("sid"): parameter
        for place in reversed(places)
        for parameter in place.all("newparam")
    }
    for _ in range(4):
        parameter = parameters.get(name)
        if parameter is None:
            break
        sampler = parameter.child("sampler2D")
        if sampler is not None:
            instance = sampler.child("instance_image")
            name = sampler.word("source") if instance is None else instance.get("url")
        else:
            name = parameter.word("surface", "init_from")
    image = ids.get(name.strip().removeprefix("#"))
    if image is None or image.tag != "image":
        return ""
    found = image.child("init_from")
    if found is None:
        return ""
    return found.word("ref") or found.text
