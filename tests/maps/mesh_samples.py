"""Small meshes and what is true of them, for the tests of mesh formats."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.mesh_files import merge_meshes
from usarsim_maps.reader import Context, ImportOptions, read_scene
from usarsim_maps.scene import Mesh, Scene
from usarsim_server.errors import MapImportError

Array = NDArray[np.float64]

WEDGE = np.array(
    [[0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 3]],
    dtype=float,
)
"""A corner of different lengths along x, y and z: shows any exchange or reflection of axes."""

FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.int64)
"""Anticlockwise from outside; the volume is 1."""


def volume(mesh: Mesh) -> float:
    """Enclosed volume; negative if the faces look inwards (item 10)."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def area(mesh: Mesh) -> float:
    """Of all triangles."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


def whole(scene: Scene) -> Mesh:
    """Everything in a scene as one mesh in the world's frame."""
    mesh = merge_meshes(scene, "all")
    assert mesh is not None
    return mesh


def places(mesh: Mesh) -> list[list[float]]:
    """Used vertices, rounded and sorted."""
    used = np.unique(np.round(mesh.vertices[np.unique(mesh.triangles)], 6) + 0.0, axis=0)
    found: list[list[float]] = used.tolist()
    return found


WEDGE_PLACES = sorted(WEDGE.tolist())


def read(source: Path, findings: Findings | None = None, **options: object) -> Scene:
    """Read a file with options."""
    chosen = ImportOptions(**options)  # type: ignore[arg-type]
    return read_scene(source, Context(chosen, findings or Findings()))


def upright(points: Array) -> Array:
    """Points of the simulation frame in a file whose y is up: x, z, -y."""
    answer: Array = points[:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0])
    return answer


def damages(content: bytes) -> st.SearchStrategy[bytes]:
    """The same file cut off, with bytes exchanged, or with a piece doubled."""
    size = len(content)
    place = st.integers(0, size - 1)

    def change(spots: list[tuple[int, int]]) -> bytes:
        data = bytearray(content)
        for where, value in spots:
            data[where] = value
        return bytes(data)

    def double(spot: tuple[int, int]) -> bytes:
        a, b = sorted(spot)
        return content[:b] + content[a:b] + content[b:]

    return st.one_of(
        place.map(lambda end: content[:end]),
        st.lists(st.tuples(place, st.integers(0, 255)), min_size=1, max_size=6).map(change),
        st.tuples(place, place).map(double),
    )


def survives(folder: Path, name: str, content: bytes) -> None:
    """A damaged file is read, or refused with one line that names it; nothing else happens."""
    source = folder / name
    source.write_bytes(content)
    try:
        scene = read(source)
    except MapImportError as error:
        text = str(error)
        assert name.partition(".")[0] in text
        assert "\n" not in text
        return
    for thing in scene.objects:
        for part in thing.parts:
            assert np.isfinite(part.matrix).all()
            if isinstance(part.shape, Mesh):
                triangles = part.shape.triangles
                assert not len(triangles) or triangles.max() < len(part.shape.vertices)


def refused(source: Path) -> str:
    """The message with which a file is refused."""
    return refusal(lambda: read(source))


def refusal(run: Callable[[], object]) -> str:
    """The message with which something is refused."""
    try:
        run()
    except MapImportError as error:
        return str(error)
    raise AssertionError("nothing was refused")
