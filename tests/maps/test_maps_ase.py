"""ASE meshes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from usarsim_maps.reader import Context, ImportOptions, read_scene
from usarsim_maps.scene import Collision, Mesh, Scene
from usarsim_server.errors import MapImportError

PYRAMID = """*3DSMAX_ASCIIEXPORT\t200
*MATERIAL_LIST {
\t*MATERIAL_COUNT 1
\t*MATERIAL 0 {
\t\t*MATERIAL_NAME "Stone"
\t\t*MAP_DIFFUSE {
\t\t\t*BITMAP "C:\\\\art\\\\Stone.tga"
\t\t}
\t}
}
*GEOMOBJECT {
\t*NODE_NAME "Pyramid"
\t*MESH {
\t\t*MESH_NUMVERTEX 4
\t\t*MESH_VERTEX_LIST {
\t\t\t*MESH_VERTEX 0 0.0 0.0 0.0
\t\t\t*MESH_VERTEX 1 250.0 0.0 0.0
\t\t\t*MESH_VERTEX 2 0.0 500.0 0.0
\t\t\t*MESH_VERTEX 3 0.0 0.0 250.0
\t\t}
\t\t*MESH_FACE_LIST {
\t\t\t*MESH_FACE 0: A: 0 B: 2 C: 1 AB: 1 BC: 1 CA: 1 *MESH_SMOOTHING 1 *MESH_MTLID 0
\t\t\t*MESH_FACE 1: A: 0 B: 1 C: 3 AB: 1 BC: 1 CA: 1 *MESH_SMOOTHING 1 *MESH_MTLID 0
\t\t\t*MESH_FACE 2: A: 0 B: 3 C: 2 AB: 1 BC: 1 CA: 1 *MESH_SMOOTHING 1 *MESH_MTLID 0
\t\t\t*MESH_FACE 3: A: 1 B: 2 C: 3 AB: 1 BC: 1 CA: 1 *MESH_SMOOTHING 1 *MESH_MTLID 0
\t\t}
\t\t*MESH_TVERTLIST {
\t\t\t*MESH_TVERT 0 0.0 0.0 0.0
\t\t\t*MESH_TVERT 1 1.0 0.5 0.0
\t\t}
\t\t*MESH_TFACELIST {
\t\t\t*MESH_TFACE 0 0 0 1
\t\t\t*MESH_TFACE 1 0 1 0
\t\t\t*MESH_TFACE 2 0 0 0
\t\t\t*MESH_TFACE 3 1 1 1
\t\t}
\t}
\t*MATERIAL_REF 0
}
"""


def read(folder: Path, text: str, **options: object) -> Scene:
    """The scene in a text."""
    (folder / "mesh.ase").write_text(text)
    return read_scene(folder / "mesh.ase", Context(ImportOptions(**options)))  # type: ignore[arg-type]


def mesh_of(scene: Scene, index: int = 0) -> Mesh:
    """The mesh of an object."""
    shape = scene.objects[index].parts[0].shape
    assert isinstance(shape, Mesh)
    return shape


def outward(mesh: Mesh) -> bool:
    """Whether all faces look away from the middle."""
    corners = mesh.vertices[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    away = corners.mean(axis=1) - mesh.vertices.mean(axis=0)
    return bool((np.einsum("ij,ij->i", normals, away) > 0).all())


def test_a_mesh_is_read(tmp_path: Path) -> None:
    """Vertices in metres, faces outwards, texture coordinates per corner, picture by name."""
    (tmp_path / "stone.TGA").write_bytes(b"x")
    scene = read(tmp_path, PYRAMID)
    mesh = mesh_of(scene)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), (1, 2, 1))
    assert outward(mesh)
    assert mesh.uvs is not None
    assert mesh.uvs[0].tolist() == [[0, 0], [0, 0], [1, 0.5]]
    assert mesh.materials == ("Stone",)
    assert scene.materials["Stone"].texture == tmp_path / "stone.TGA"


def test_scale_axis_and_mirror_are_obeyed(tmp_path: Path) -> None:
    """Options win; a mirrored mesh still looks outwards."""
    mesh = mesh_of(read(tmp_path, PYRAMID, scale=125.0, mirror=True))
    np.testing.assert_allclose(mesh.vertices.min(axis=0), (0, -4, 0))
    assert outward(mesh)
    upright = mesh_of(read(tmp_path, PYRAMID, up="Y"))
    np.testing.assert_allclose(upright.vertices.max(axis=0), (1, 0, 2))
    assert outward(upright)


def test_collision_pieces_are_recognised(tmp_path: Path) -> None:
    """Objects named MCDCX or UCX_ are only felt, as hulls."""
    both = PYRAMID + PYRAMID[PYRAMID.index("*GEOMOBJECT") :].replace("Pyramid", "MCDCX_1")
    seen, felt = read(tmp_path, both).objects
    assert seen.parts[0].visible
    assert not felt.parts[0].visible
    assert felt.parts[0].collision is Collision.HULL


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("*MESH_VERTEX 1 250.0 0.0 0.0", "*MESH_VERTEX 1 250.0", "fewer than 4 numbers"),
        ("*MESH_VERTEX 1 250.0", "*MESH_VERTEX 2e99 250.0", "number without meaning"),
        ("A: 0 B: 2 C: 1", "A: 0 B: x C: 1", "is no face"),
        ("A: 0 B: 2 C: 1", "A: 0 B: 2 C: 9", "vertex 9, which is not there"),
    ],
)
def test_damage_is_told(tmp_path: Path, old: str, new: str, told: str) -> None:
    """The error names the file, and what is wrong in it."""
    with pytest.raises(MapImportError, match=rf"mesh\.ase.*{re.escape(told)}"):
        read(tmp_path, PYRAMID.replace(old, new))


def test_a_cut_file_is_told(tmp_path: Path) -> None:
    """A file that ends inside a block is refused."""
    with pytest.raises(MapImportError, match="ends inside a block"):
        read(tmp_path, PYRAMID[:700])


@given(st.data())
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_any_damage_is_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    """Lines lost, doubled or garbled give a mesh or one clear error."""
    lines = PYRAMID.splitlines()
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(lines) - 1))
        lines[place] = data.draw(
            st.sampled_from(["", "}", "{", lines[place][:-3], "*MESH_FACE 9:"])
        )
    try:
        scene = read(tmp_path, "\n".join(lines))
    except MapImportError as error:
        told = str(error)
    else:
        told = scene.objects[0].name
    assert told
