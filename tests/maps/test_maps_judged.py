"""Our mesh readers against trimesh and pycollada: the same extents, the same number of triangles.

Files are made by those libraries where they can write a format, else by hand, from things that
turn, lean, mirror and share meshes. Neither library has any code in common with our readers.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from pathlib import Path

import collada
import numpy as np
import pytest
import trimesh
from collada import geometry, scene, source
from gltf_samples import glb
from mesh_samples import read, whole
from numpy.typing import NDArray

from usarsim_maps.units import axis_matrix

Array = NDArray[np.float64]
Thing = tuple[Array, NDArray[np.int64], Array]
"""Points, triangles, and (4, 4) where the mesh stands."""

SEEDS = range(6)

pytestmark = pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # of pycollada


def things(seed: int) -> list[Thing]:
    """A few solids of random size, each somewhere; every other one twice, mirrored."""
    random = np.random.default_rng(seed)
    found = []
    for number in range(random.integers(1, 6)):
        made = (
            trimesh.creation.box(random.uniform(0.2, 4.0, 3))
            if number % 2
            else trimesh.creation.icosphere(subdivisions=1, radius=random.uniform(0.2, 3.0))
        )
        points = np.asarray(made.vertices) * random.uniform(0.5, 2.0, 3)
        place = trimesh.transformations.random_rotation_matrix(random.random(3))
        place[:3, 3] = random.uniform(-20.0, 20.0, 3)
        found.append((points, np.asarray(made.faces), place))
        if number % 2:
            mirrored = place @ np.diag([-1.5, 1.0, 0.5, 1.0])
            mirrored[:3, 3] += 3.0
            found.append((points, np.asarray(made.faces), mirrored))
    return found


def one(seed: int) -> trimesh.Trimesh:
    """All of it in one mesh, for formats without nodes."""
    parts = []
    for points, triangles, place in things(seed):
        part = trimesh.Trimesh(points, triangles, process=False)
        parts.append(part.apply_transform(place))
    return trimesh.util.concatenate(parts)


def exported(kind: str, **options: object) -> Callable[[int], bytes]:
    """Written by trimesh."""

    def make(seed: int) -> bytes:
        content = one(seed).export(file_type=kind, **options)
        return content if isinstance(content, bytes) else content.encode()

    return make


def threemf(seed: int) -> bytes:
    """Written by trimesh, with nodes."""
    made = trimesh.Scene()
    for points, triangles, place in things(seed):
        made.add_geometry(trimesh.Trimesh(points, triangles, process=False), transform=place)
    content: bytes = made.export(file_type="3mf")
    return content


def obj(seed: int) -> bytes:
    """Faces of three and of four corners, one object for each thing."""
    lines, count = [], 0
    for number, (points, triangles, place) in enumerate(things(seed)):
        lines.append(f"o thing{number}")
        moved = points @ place[:3, :3].T + place[:3, 3]
        lines += ["v {:.9g} {:.9g} {:.9g}".format(*point) for point in moved]
        lines += ["f {} {} {}".format(*row) for row in triangles + count + 1]
        count += len(points)
    lines += ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0", "o sheet"]
    lines.append("f {} {} {} {}".format(*range(count + 1, count + 5)))
    return ("\n".join(lines) + "\n").encode()


def gltf(seed: int) -> bytes:
    """Nodes with matrices, inside a node that leans; buffers side by side."""
    blob, views, accessors, meshes, nodes = b"", [], [], [], []
    for points, triangles, place in things(seed):
        for values, kind, form in ((points.astype("<f4"), 5126, "VEC3"),
                                   (triangles.astype("<u4"), 5125, "SCALAR")):  # fmt: skip
            content = values.tobytes()
            views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(content)})
            count = len(values) if form == "VEC3" else values.size
            fact = {"bufferView": len(views) - 1, "componentType": kind, "count": count,
                    "type": form}  # fmt: skip
            if form == "VEC3":
                fact |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
            accessors.append(fact)
            blob += content
        last = len(accessors)
        primitive = {"attributes": {"POSITION": last - 2}, "indices": last - 1}
        meshes.append({"primitives": [primitive]})
        nodes.append({"mesh": len(meshes) - 1, "matrix": place.T.ravel().tolist()})
    half = math.sqrt(0.5)
    parent = {"children": list(range(len(nodes))), "rotation": [half, 0, 0, half],
              "translation": [1, 2, 3], "scale": [2, 1, 1]}  # fmt: skip
    return glb(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [len(nodes)]}],
            "nodes": [*nodes, parent],
            "meshes": meshes,
            "accessors": accessors,
            "bufferViews": views,
        },
        blob,
    )


def dae(up: str, metres: float) -> Callable[[int], bytes]:
    """Written by pycollada: triangles and polylists, nodes inside nodes."""

    def make(seed: int) -> bytes:
        document = collada.Collada()
        document.assetInfo.upaxis = up
        document.assetInfo.unitmeter = metres
        document.assetInfo.unitname = "own"
        inner = []
        for number, (points, triangles, place) in enumerate(things(seed)):
            array = source.FloatSource(f"p{number}", points.ravel(), ("X", "Y", "Z"))
            shape = geometry.Geometry(document, f"g{number}", f"g{number}", [array])
            inputs = source.InputList()
            inputs.addInput(0, "VERTEX", f"#p{number}")
            if number % 2:
                rows = shape.createTriangleSet(triangles.ravel(), inputs, "m")
            else:
                counts = np.full(len(triangles), 3)
                rows = shape.createPolylist(triangles.ravel(), counts, inputs, "m")
            shape.primitives.append(rows)
            document.geometries.append(shape)
            matrix = scene.MatrixTransform(place.ravel())
            inner.append(
                scene.Node(f"n{number}", [scene.GeometryNode(shape, [])], transforms=[matrix])
            )
        turn = scene.RotateTransform(0.0, 1.0, 0.0, 37.0)
        outer = scene.Node("outer", inner, [scene.TranslateTransform(3.0, 2.0, 1.0), turn])
        whole_scene = scene.Scene("s", [outer])
        document.scenes.append(whole_scene)
        document.scene = whole_scene
        stream = io.BytesIO()
        document.write(stream)
        return stream.getvalue()

    return make


FILES = {
    "binary.stl": (exported("stl"), "Z", 1.0),
    "text.stl": (exported("stl_ascii"), "Z", 1.0),
    "binary.ply": (exported("ply"), "Z", 1.0),
    "text.ply": (exported("ply", encoding="ascii"), "Z", 1.0),
    "map.off": (exported("off"), "Z", 1.0),
    "map.3mf": (threemf, "Z", 0.001),
    "map.obj": (obj, "Y", 1.0),
    "map.glb": (gltf, "Y", 1.0),
    "inches.dae": (dae(collada.asset.UP_AXIS.Z_UP, 0.0254), "Z", 0.0254),
    "upright.dae": (dae(collada.asset.UP_AXIS.Y_UP, 1.0), "Y", 1.0),
    "sideways.dae": (dae(collada.asset.UP_AXIS.X_UP, 0.01), "X", 0.01),
}
"""Writer, axis upwards and metres per unit by name of the file."""


def judged(path: Path) -> tuple[Array, int]:
    """Corners of the bounding box in the file's own frame and units, and triangles."""
    if path.suffix == ".dae":
        triangles = []
        document = collada.Collada(str(path))
        for bound in document.scene.objects("geometry"):
            for rows in bound.primitives():
                rows = rows.triangleset() if hasattr(rows, "triangleset") else rows
                triangles.append(np.asarray(rows.vertex)[np.asarray(rows.vertex_index)])
        points = np.concatenate(triangles)
        return points.reshape(-1, 3), len(points)
    found = trimesh.load_scene(path, process=False).to_geometry()
    return np.asarray(found.vertices)[np.asarray(found.faces)].reshape(-1, 3), len(found.faces)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", FILES)
def test_same_extents_and_triangles(tmp_path: Path, name: str, seed: int) -> None:
    """Ours in metres and with z up is theirs, turned and scaled."""
    make, up, metres = FILES[name]
    path = tmp_path / name
    path.write_bytes(make(seed))
    points, count = judged(path)
    mesh = whole(read(path))
    assert len(mesh.triangles) == count
    ours = mesh.vertices[mesh.triangles].reshape(-1, 3)
    theirs = points @ axis_matrix(up).T * metres
    reach = np.ptp(theirs, axis=0).max()
    assert ours.min(axis=0) == pytest.approx(theirs.min(axis=0), abs=1e-5 * reach)
    assert ours.max(axis=0) == pytest.approx(theirs.max(axis=0), abs=1e-5 * reach)


def test_the_judge_would_notice(tmp_path: Path) -> None:
    """A file read with the wrong axis has other extents."""
    path = tmp_path / "map.obj"
    path.write_bytes(obj(0))
    points, _ = judged(path)
    wrong = whole(read(path, up="Z"))
    right = whole(read(path))
    theirs = np.ptp(points @ axis_matrix("Y").T, axis=0)
    assert np.ptp(right.vertices, axis=0) == pytest.approx(theirs, rel=1e-4)
    assert np.ptp(wrong.vertices, axis=0) != pytest.approx(theirs, rel=1e-2)
