"""ASE meshes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mesh_samples import ASE, faces_out, read, whole, writer

from usarsim_maps.scene import Collision

write = writer("map.ase")


def test_a_mesh_is_read(tmp_path: Path) -> None:
    """Vertices in metres, faces outwards, texture coordinates per corner, picture by name."""
    (tmp_path / "stone.TGA").write_bytes(b"x")
    scene = read(write(tmp_path, ASE))
    mesh = whole(scene)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), (1, 2, 1))
    assert faces_out(mesh)
    assert mesh.uvs[0].tolist() == [[0, 0], [0, 0], [1, 0.5]]
    assert mesh.materials == ("Stone",)
    assert scene.materials["Stone"].texture == tmp_path / "stone.TGA"


def test_scale_axis_and_mirror_are_obeyed(tmp_path: Path) -> None:
    """Options win; a mirrored mesh still looks outwards."""
    mesh = whole(read(write(tmp_path, ASE), scale=125.0, mirror=True))
    np.testing.assert_allclose(mesh.vertices.min(axis=0), (0, -4, 0))
    assert faces_out(mesh)
    upright = whole(read(write(tmp_path, ASE), up="Y"))
    np.testing.assert_allclose(upright.vertices.max(axis=0), (1, 0, 2))
    assert faces_out(upright)


def test_collision_pieces_are_recognised(tmp_path: Path) -> None:
    """Objects named MCDCX or UCX_ are only felt, as hulls."""
    both = ASE + ASE[ASE.index("*GEOMOBJECT") :].replace("Pyramid", "MCDCX_1")
    seen, felt = read(write(tmp_path, both)).objects
    assert seen.parts[0].visible
    assert not felt.parts[0].visible
    assert felt.parts[0].collision is Collision.HULL
