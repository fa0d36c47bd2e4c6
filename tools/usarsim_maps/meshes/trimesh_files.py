"""Reads the mesh formats that have no reader of their own here, by the library trimesh.

The library is optional: `pip install "usarsim-server[meshes]"`. Formats that people model maps in
(COLLADA, glTF, OBJ and others) have readers of their own, which keep what trimesh drops: units,
textures, names with a meaning, and most of a damaged file.
"""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np

from usarsim_maps.archives import read_archive
from usarsim_maps.meshes.mesh_files import Axes, axes_of, with_hulls
from usarsim_maps.meshes.polygons import check_count, make_mesh
from usarsim_maps.meshes.vertex_colors import shaded
from usarsim_maps.reader import Context, Reader, need, register
from usarsim_maps.scene import Material, Mesh, Part, Scene, SceneObject
from usarsim_server.base.errors import MapImportError, at

CURE = "the file is damaged, or written in a way that trimesh does not know; export it as glTF"


@register("trimesh")
class TrimeshReader(Reader):
    """One object for every node with triangles."""

    title = "trimesh"
    extensions = (".3mf", ".off", ".xaml")
    head = re.compile(rb"\A\s*C?OFF(\s|\Z)")

    def read(self, source: Path, context: Context) -> Scene:
        """See `Reader.read`."""
        kind = source.suffix.lower().removeprefix(".") or "off"
        need("lxml.etree", source, "these files")
        need("networkx", source, "these files")
        trimesh = need("trimesh", source, f"{kind.upper()} files")
        content = read_archive(source, CURE)
        try:
            found = trimesh.load_scene(io.BytesIO(content), file_type=kind, process=False)
            unit = 1.0 if found.units is None else _metres(trimesh, found.units)
            nodes = [(name, *found.graph[name]) for name in found.graph.nodes_geometry]
        except MemoryError:
            raise
        except Exception as error:  # each of its readers raises what it likes
            text = " ".join(f"trimesh cannot read it: {error}".split())[:200]
            raise MapImportError(at(source, text, CURE)) from None
        axes = axes_of(context.options, "Z", unit, stated=found.units is not None)
        return _scene(source, context, axes, found.geometry, nodes)


def _metres(trimesh: Any, units: str) -> float:
    """Metres in a unit by its name, such as `millimeter`."""
    return float(trimesh.units.unit_conversion(units, "meters"))


def _scene(
    source: Path,
    context: Context,
    axes: Axes,
    geometry: dict[str, Any],
    nodes: list[tuple[str, Any, str]],
) -> Scene:
    meshes: dict[str, Mesh | None] = {}
    materials: dict[str, Material] = {}
    objects = []
    count = 0
    for name, matrix, key in nodes:
        if key not in meshes:
            made = geometry[key]
            faces = np.asarray(getattr(made, "faces", ()), np.int64).reshape(-1, 3)
            count += len(faces)
            check_count(source, count)
            meshes[key] = None if not len(faces) else _mesh(key, made, faces, materials)
        mesh = meshes[key]
        if mesh is None:
            context.findings.skip("points and lines", name)
            continue
        pose, local = axes.place(np.asarray(matrix, float))
        objects.append(SceneObject(name, (Part(mesh, local),), pose=pose, kind="mesh"))
    if not objects:
        raise MapImportError(at(source, "there are no triangles in this file", CURE))
    context.findings.count("mesh", len(objects))
    return Scene(
        source=axes.source(source, source.suffix.removeprefix(".").upper()),
        objects=with_hulls(objects),
        materials=materials,
    )


def _mesh(name: str, made: Any, faces: Any, materials: dict[str, Material]) -> Mesh:
    """A mesh in the colours of its faces, if it has some, else in the one that most of it has."""
    names: list[str] = []
    slots = None
    if made.visual.kind in ("face", "vertex"):
        colors = np.asarray(made.visual.face_colors, float).reshape(-1, 4) / 255.0
        if len(colors) == len(faces):
            shades, slots = shaded(colors)
            materials |= {shade.name: shade for shade in shades}
            names = [shade.name for shade in shades]
    elif made.visual.defined:
        r, g, b, a = (float(part) for part in made.visual.main_color)
        word = "#" + "".join(f"{int(part):02x}" for part in (r, g, b, a))
        materials.setdefault(word, Material(word, (r / 255.0, g / 255.0, b / 255.0, a / 255.0)))
        names.append(word)
    points = np.asarray(made.vertices, float)
    return make_mesh(name, points, faces, slots=slots, materials=names)
