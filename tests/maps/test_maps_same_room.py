"""One room in six formats: walls, floor and a pillar are in the same places (worlds 9)."""

from __future__ import annotations

import base64
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from built_worlds import World, build_world, cuboid_mesh
from gltf_samples import gltf as gltf_document
from mesh_samples import dae, dae_geometry, read, write
from numpy.typing import NDArray
from PIL import Image
from sdf_samples import model, shape, world
from t3d_maps import brush, level, start

from usarsim_maps.findings import Findings
from usarsim_maps.scene import Mesh
from usarsim_server.simulation.frames import Vector

Array = NDArray[np.float64]

LOW, HIGH = (-2.0, -1.5, 0.0), (4.0, 2.5, 2.5)
"""m: corners of the room, inside."""

PILLAR = (2.0, -1.0, 0.0), (3.0, -0.5, 2.5)
"""Far from the middle: a reflection, or an exchange of axes, would show."""

EYES: list[Vector] = [(0.0, 0.0, 1.0), (-1.7, -1.2, 0.4), (3.7, 2.2, 1.8), (3.5, -0.75, 1.0)]

Writer = Callable[[Path], Path]


def t3d(folder: Path) -> Path:
    """Unreal text: a room cut out of the solid, a block added; y is reversed, 250 units a metre."""

    def corners(low: Vector, high: Vector) -> tuple[Vector, Vector]:
        return (
            (low[0] * 250, -high[1] * 250, low[2] * 250),
            (high[0] * 250, -low[1] * 250, high[2] * 250),
        )

    text = level(
        brush("Room", *corners(LOW, HIGH), "CSG_Subtract"),
        brush("Pillar", *corners(*PILLAR)),
        start("Here", (0, 0, 60)),
    )
    return write(folder, text, "room.t3d")


def obj(folder: Path) -> Path:
    """Wavefront, y upwards, as most programs export it."""
    lines, count = [], 0
    for mesh in meshes():
        lines += [f"v {x} {z} {-y}" for x, y, z in mesh.vertices.tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (mesh.triangles + count + 1).tolist()]
        count += len(mesh.vertices)
    return write(folder, "\n".join(lines) + "\n", "room.obj")


def gltf(folder: Path) -> Path:
    """glTF 2.0 with its buffer inside."""
    room, pillar = meshes()
    vertices = np.concatenate([room.vertices, pillar.vertices])[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
    triangles = np.concatenate([room.triangles, pillar.triangles + len(room.vertices)])
    points, indices = vertices.astype("<f4").tobytes(), triangles.astype("<u4").tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(points + indices).decode()
    document = gltf_document(
        meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        accessors=[
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": triangles.size, "type": "SCALAR"},
        ],
        bufferViews=[
            {"buffer": 0, "byteOffset": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(indices)},
        ],
        buffers=[{"byteLength": len(points) + len(indices), "uri": uri}],
    )
    return write(folder, document, "room.gltf")


def collada(folder: Path) -> Path:
    """COLLADA in inches, z upwards."""
    geometries = nodes = ""
    for name, mesh in zip(("room", "pillar"), meshes(), strict=True):
        points = " ".join(f"{value / 0.0254:.9g}" for value in mesh.vertices.ravel().tolist())
        vertex = f'<input semantic="VERTEX" source="#{name}-v" offset="0"/>'
        indices = " ".join(map(str, mesh.triangles.ravel().tolist()))
        count = len(mesh.triangles)
        triangles = f'<triangles count="{count}">{vertex}<p>{indices}</p></triangles>'
        geometries += dae_geometry(triangles, points, name=name)
        nodes += f'<node><instance_geometry url="#{name}"/></node>'
    asset = '<unit name="inch" meter="0.0254"/><up_axis>Z_UP</up_axis>'
    return write(folder, dae(geometries, nodes, asset), "room.dae")


def sdf(folder: Path) -> Path:
    """A Gazebo world: six walls and the pillar as boxes of a static model."""
    parts = []
    for low, high in (*shell(), PILLAR):
        middle = " ".join(f"{(a + b) / 2:g}" for a, b in zip(low, high, strict=True))
        size = " ".join(f"{b - a:g}" for a, b in zip(low, high, strict=True))
        parts.append(shape(f"<box><size>{size}</size></box>", f"{middle} 0 0 0"))
    return write(folder, world(model("room", "".join(parts))), "room.world")


def occupancy(folder: Path) -> Path:
    """A map as map_server saves it: 5 cm cells, black is occupied, the first row is the last y."""
    edge, origin = 0.05, (-2.5, -2.0)
    pixels = np.zeros((100, 140), np.uint8)

    def paint(low: Vector, high: Vector, value: int) -> None:
        x = [round((v - origin[0]) / edge) for v in (low[0], high[0])]
        y = [round((v - origin[1]) / edge) for v in (low[1], high[1])]
        pixels[y[0] : y[1], x[0] : x[1]] = value

    paint(LOW, HIGH, 254)
    paint(*PILLAR, 0)
    Image.fromarray(pixels[::-1]).save(folder / "room.pgm")
    text = f"image: room.pgm\nresolution: {edge}\norigin: [{origin[0]}, {origin[1]}, 0.0]\n"
    return write(
        folder, text + "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n", "room.yaml"
    )


FORMATS: dict[str, Writer] = {
    "t3d": t3d,
    "obj": obj,
    "gltf": gltf,
    "collada": collada,
    "sdf": sdf,
    "occupancy": occupancy,
}


@pytest.mark.parametrize("name", FORMATS)
def test_the_same_room_in_every_format(tmp_path: Path, name: str, findings: Findings) -> None:
    """Rays meet walls, floor and pillar where they are, to 1 mm; so do collisions (worlds 9)."""
    built = build_world(tmp_path, read(FORMATS[name](tmp_path), findings), findings)
    ways = fan()
    for eye in EYES:
        expected = distances(eye, ways)
        np.testing.assert_allclose(built.rays(eye, ways), expected, atol=1e-3, err_msg=f"{eye}")
        np.testing.assert_allclose(felt(built, eye, ways), expected, atol=1e-3, err_msg=f"{eye}")


def test_the_truth_is_asymmetric() -> None:
    """Reflected or turned, the room would look different from the eyes that are used."""
    ways = fan()
    seen = distances(EYES[0], ways)
    mirrored = distances(EYES[0], ways * [1.0, -1.0, 1.0])
    turned = distances(EYES[0], ways[:, [1, 0, 2]])
    assert np.abs(seen - mirrored).max() > 0.5
    assert np.abs(seen - turned).max() > 0.5


def fan() -> Array:
    """Level beams all around that avoid the corners, and one down; ceilings are not common."""
    angles = np.radians(np.arange(0.0, 360.0, 7.3)) + 0.013
    level_ways = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)
    return np.concatenate([level_ways, [[0.0, 0.0, -1.0]]])


def distances(eye: Vector, ways: Array) -> Array:
    """The truth: out of the room's box, or into the pillar's."""
    found = []
    for way in ways:
        inside = slab(eye, way, LOW, HIGH)[1]
        enter, leave = slab(eye, way, *PILLAR)
        found.append(enter if 0.0 < enter < leave else inside)
    return np.array(found)


def felt(world: World, eye: Vector, ways: Array) -> Array:
    """Distances to what is solid, be it seen or not, by MuJoCo's own rays."""
    model = world.model
    hollow = (model.geom_contype | model.geom_conaffinity) == 0
    model.geom_group[:] = np.where(hollow, 2, 3)
    return world.solid_rays(eye, ways)


def slab(eye: Vector, way: Array, low: Vector, high: Vector) -> tuple[float, float]:
    """Distances at which a ray enters and leaves a box."""
    enter, leave = -math.inf, math.inf
    for start_, step, a, b in zip(eye, way.tolist(), low, high, strict=True):
        if abs(step) < 1e-12:
            if not a < start_ < b:
                return math.inf, -math.inf
            continue
        first, second = sorted(((a - start_) / step, (b - start_) / step))
        enter, leave = max(enter, first), min(leave, second)
    return enter, leave


def meshes() -> tuple[Mesh, Mesh]:
    """The room, which looks inwards, and the pillar."""
    return cuboid_mesh(LOW, HIGH, inward=True), cuboid_mesh(*PILLAR)


def shell(thick: float = 0.2) -> list[tuple[Vector, Vector]]:
    """Boxes around the room."""
    (a, b, c), (d, e, f) = LOW, HIGH
    t = thick
    return [
        ((a - t, b - t, c), (a, e + t, f)),
        ((d, b - t, c), (d + t, e + t, f)),
        ((a, b - t, c), (d, b, f)),
        ((a, e, c), (d, e + t, f)),
        ((a - t, b - t, c - t), (d + t, e + t, c)),
        ((a - t, b - t, f), (d + t, e + t, f + t)),
    ]
