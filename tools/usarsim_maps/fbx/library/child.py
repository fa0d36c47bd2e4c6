"""Reads an FBX file from standard input with the library ufbx, as a program of its own.

The library's Python objects are released more often than they are taken: what drops one may crash.
So every object is kept in one list, arrays are copied, and the program leaves without tidying up.
It runs without site packages and stands alone, so that it starts fast; `answer.py` runs it and says
what the answer means.

Arguments: the folder of the library, then as JSON the limits: bytes of `memory` and of the
`answer`, `seconds` of processor time, `nodes`, `depth` and `triangles`. The answer: `MAGIC`, 8
bytes with the length of a text of JSON, the text, then all arrays one after the other.
"""

from __future__ import annotations

import gc
import json
import os
import resource
import sys
from array import array
from collections.abc import Iterable, Iterator
from typing import Any

MAGIC = b"FBX scene 1\n"

FACTS = ("tag", "class", "movable", "mass", "friction")
"""Custom properties of nodes that count."""

UNNAMED = ("anim_stacks", "constraints", "characters", "audio_clips", "cache_files", "unknowns")
"""Lists of a scene whose names are told, because nothing else is done with them."""

KEPT: list[Any] = []
"""Every object of the library, for as long as the program lives."""


def main(folder: str, limits: dict[str, int]) -> None:
    """Answer; errors of the library are a part of it."""
    restrict(limits)
    gc.disable()
    sys.path.append(folder)
    content = sys.stdin.buffer.read()
    blobs: list[bytes] = []
    try:
        import ufbx
    except ImportError as error:
        send({"unusable": str(error)}, blobs)
        return
    try:
        scene = ufbx.load_memory(
            content,
            file_format=ufbx.FileFormat.FBX,
            node_depth_limit=limits["depth"],
            evaluate_skinning=True,
            skip_mesh_parts=True,
        )
        send(_Scene(scene, blobs).told(limits), blobs)
    except (ufbx.UfbxError, MemoryError) as error:
        send({"refused": str(error) or type(error).__name__}, [])


def restrict(limits: dict[str, int]) -> None:
    """Let a damaged file cost no more memory, disk or time than a large sound one."""
    wanted = {
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_AS: limits["memory"],
        resource.RLIMIT_FSIZE: limits["answer"],
        resource.RLIMIT_CPU: limits["seconds"],
    }
    for kind, most in wanted.items():
        try:
            hard = resource.getrlimit(kind)[1]
            most = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(kind, (most, hard))
        except (ValueError, OSError):
            pass  # a system without this limit


def send(told: dict[str, Any], blobs: Iterable[bytes]) -> None:
    """Write the answer."""
    text = json.dumps(told).encode("ascii")
    out = sys.stdout.buffer
    out.write(MAGIC + len(text).to_bytes(8, "little") + text)
    for blob in blobs:
        out.write(blob)
    out.flush()


class _Scene:
    """A scene of the library, told as plain values."""

    def __init__(self, scene: Any, blobs: list[bytes]) -> None:
        self._scene = self._keep(scene)
        self._blobs = blobs

    def told(self, limits: dict[str, int]) -> dict[str, Any]:
        """All of it; or only how many nodes or triangles there are, where those are too many."""
        nodes, meshes = self._get(self._scene, "nodes"), self._get(self._scene, "meshes")
        counts = {
            "nodes": len(nodes),
            "triangles": sum(mesh.num_triangles for mesh in self._each(meshes)),
            "vertices": sum(mesh.num_vertices for mesh in self._each(meshes)),
        }
        most = {**limits, "vertices": 3 * limits["triangles"]}
        if any(count > most[name] for name, count in counts.items()):
            return {"too_many": counts}
        return {
            "settings": self._settings(),
            "nodes": [self._node(node) for node in self._each(nodes)],
            "meshes": [self._mesh(mesh) for mesh in self._all("meshes")],
            "lights": [self._light(light) for light in self._all("lights")],
            "materials": [self._material(one) for one in self._all("materials")],
            "textures": [self._texture(one) for one in self._all("textures")],
            "layers": [self._layer(one) for one in self._all("display_layers")],
            "shapes": [[one.name, one.weight] for one in self._all("blend_channels")],
            "others": {name: [self._kind(one) for one in self._all(name)] for name in UNNAMED},
            "warnings": [
                [int(one.type), one.description]
                for one in self._each(self._get(self._scene, "metadata", "warnings"))
            ],
        }

    # ---- objects that are kept -------------------------------------------------------------

    def _keep(self, thing: Any) -> Any:
        KEPT.append(thing)
        return thing

    def _get(self, owner: Any, *names: str) -> Any:
        """The attribute of an attribute of ...; None as soon as one is None."""
        for name in names:
            owner = None if owner is None else self._keep(getattr(owner, name))
        return owner

    def _each(self, things: Any) -> Iterator[Any]:
        for thing in things:
            self._keep(thing)
            yield thing

    def _all(self, name: str) -> Iterator[Any]:
        return self._each(self._get(self._scene, name))

    # ---- arrays ----------------------------------------------------------------------------

    def _blob(self, kind: str, content: bytes) -> list[Any]:
        """Where an array is in the answer: type of its values and number of bytes."""
        self._blobs.append(content)
        return [len(self._blobs) - 1, kind, len(content)]

    def _reals(self, values: Any) -> list[Any]:
        return self._blob("<f8", self._keep(memoryview(values)).tobytes())

    def _whole(self, values: Any) -> list[Any]:
        """Numbers that the library gives one by one."""
        return self._blob("<u4", array("I", values).tobytes())

    def _attribute(self, vertices: Any) -> list[Any] | None:
        """Values of a vertex attribute, and the number of the value of each corner."""
        if not vertices.exists:
            return None
        return [
            self._reals(self._get(vertices, "values")),
            self._whole(self._get(vertices, "indices")),
        ]

    # ---- parts of a scene ------------------------------------------------------------------

    def _settings(self) -> dict[str, Any]:
        settings = self._get(self._scene, "settings")
        unit = self._get(settings, "props").find_prop("UnitScaleFactor")
        metadata = self._get(self._scene, "metadata")
        return {
            "axes": [int(axis) for axis in settings.axes],
            "unit": settings.unit_meters,
            "stated": self._keep(unit) is not None,
            "version": metadata.version,
        }

    def _node(self, node: Any) -> dict[str, Any]:
        # Lamps and markers have a `type` of their own.
        found = list(self._each(self._get(node, "all_attribs")))
        attributes = [[type(one).__name__, one.typed_id] for one in found]
        parent = self._get(node, "parent")
        props = self._get(node, "props")
        facts = [self._get(one, "props") for one in (node, *found)]  # those of 6.1 are there
        inherits = self._keep(props.find_prop("Visibility Inheritance"))
        return {
            "name": node.name,
            "parent": None if parent is None else parent.typed_id,
            "attributes": attributes,
            "visible": node.visible,
            "inherits": inherits is None or inherits.value_int != 0,
            "matrix": [*map(list, node.node_to_world)],
            "geometry": [*map(list, node.geometry_to_world)],
            "materials": [one.typed_id for one in self._each(self._get(node, "materials"))],
            "facts": {name: value for one in reversed(facts) for name, value in self._facts(one)},
        }

    def _facts(self, props: Any) -> Iterator[tuple[str, Any]]:
        for name in FACTS:
            prop = self._keep(props.find_prop(name))
            if prop is not None:
                yield name, prop.value_str or prop.value_vec4.x

    def _mesh(self, mesh: Any) -> dict[str, Any]:
        bent = any(
            len(self._get(mesh, name)) > 0
            for name in ("skin_deformers", "blend_deformers", "cache_deformers")
        )
        places = self._get(mesh, "skinned_position" if bent else "vertex_position")
        holes = self._get(mesh, "face_hole")
        return {
            "name": mesh.name,
            "places": self._attribute(places),
            "faces": self._blob("<u4", self._keep(memoryview(self._get(mesh, "faces"))).tobytes()),
            "holes": self._blob("u1", self._keep(memoryview(holes)).tobytes()),
            "slots": self._whole(self._get(mesh, "face_material")),
            "uvs": self._attribute(self._get(mesh, "vertex_uv")),
            "colors": self._attribute(self._get(mesh, "vertex_color")),
            "materials": [one.typed_id for one in self._each(self._get(mesh, "materials"))],
            "local": not bent or mesh.skinned_is_local,
            "smooth": int(mesh.subdivision_display_mode) >= 2,
        }

    def _light(self, light: Any) -> dict[str, Any]:
        return {
            "kind": int(light.type),
            "color": list(light.color),
            "intensity": light.intensity,
            "direction": list(light.local_direction),
            "cone": light.outer_angle,
            "on": light.cast_light,
            "shadows": light.cast_shadows,
        }

    def _material(self, material: Any) -> dict[str, Any]:
        color = self._get(material, "pbr", "base_color")
        clear = self._get(material, "fbx", "transparency_color")
        clear_factor = self._get(material, "fbx", "transparency_factor")
        opaque = self._get(material, "pbr", "opacity")
        holes = [self._picture(one) for one in (opaque, clear, clear_factor)]
        opacity = self._keep(self._get(material, "props").find_prop("Opacity"))
        return {
            "name": material.name,
            "color": list(color.value_vec4)[:3] if color.has_value else None,
            "factor": self._real(self._get(material, "pbr", "base_factor")),
            "clear": list(clear.value_vec4)[:3] if clear.has_value else None,
            "clear_factor": self._real(clear_factor),
            "opacity": None if opacity is None else opacity.value_vec4.x,
            "pbr_opacity": self._real(opaque),
            "texture": self._picture(color),
            "holes": next((number for number in holes if number is not None), None),
        }

    def _picture(self, of: Any) -> int | None:
        """The number of the texture of a part of a material."""
        texture = self._get(of, "texture") if of.texture_enabled else None
        if texture is not None and int(texture.type) != 0:  # layers, or what a program paints
            files = list(self._each(self._get(texture, "file_textures")))
            texture = files[0] if files else None
        return None if texture is None else int(texture.typed_id)

    def _real(self, number: Any) -> float | None:
        return float(number.value_vec4.x) if number.has_value else None

    def _texture(self, texture: Any) -> dict[str, Any]:
        content = bytes(texture.content) or bytes(self._get(texture, "video", "content") or b"")
        moved = texture.has_uv_transform
        return {
            "names": [texture.relative_filename, texture.filename, texture.absolute_filename],
            "content": self._blob("u1", content) if content else None,
            "repeat": int(texture.wrap_u) == 0 or int(texture.wrap_v) == 0,
            "matrix": [*map(list, texture.uv_to_texture)] if moved else None,
        }

    def _layer(self, layer: Any) -> dict[str, Any]:
        nodes = [node.typed_id for node in self._each(self._get(layer, "nodes"))]
        return {"visible": layer.visible, "nodes": nodes}

    def _kind(self, thing: Any) -> list[str]:
        """Name of an element, and what it is where only the file knows that."""
        words = (getattr(thing, name, "") for name in ("sub_type", "super_type"))
        return [thing.name, next((word for word in words if word), "")]


if __name__ == "__main__":
    main(sys.argv[1], json.loads(sys.argv[2]))
    os._exit(0)
