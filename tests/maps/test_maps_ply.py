"""PLY and STL (worlds reference 2.4 and 13)."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from mesh_samples import (
    PLY_HEAD,
    WEDGE_PLACES,
    area,
    places,
    ply_binary,
    ply_text,
    read,
    refused,
    stl_binary,
    stl_text,
    whole,
    writer,
)
from PIL import Image

from usarsim_maps.findings import Findings

write = writer("map.ply")


def test_uneven_faces(tmp_path: Path) -> None:
    """A quad and a triangle in a binary file, whose rows differ in length."""
    head = PLY_HEAD.format(order="binary_little_endian").replace("face 4", "face 2")
    head = head.replace("property uchar material\n", "")
    content = head.encode()
    for point in [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]:
        content += struct.pack("<ffd", *point)
    content += struct.pack("<B4i", 4, 0, 1, 2, 3) + struct.pack("<B3i", 3, 0, 1, 2)
    mesh = whole(read(write(tmp_path, content)))
    assert len(mesh.triangles) == 3
    assert area(mesh) == pytest.approx(1.5)


def test_picture(tmp_path: Path) -> None:
    """A TextureFile with coordinates per vertex becomes the material, v upwards."""
    Image.new("RGB", (2, 2)).save(tmp_path / "scan.png")
    head = (
        "ply\nformat ascii 1.0\ncomment TextureFile Scan.PNG\nelement vertex 3\n"
        "property float x\nproperty float y\nproperty float z\nproperty float s\n"
        "property float t\nelement face 1\nproperty list uchar uint vertex_index\nend_header\n"
    )
    text = head + "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
    scene = read(write(tmp_path, text.encode()))
    mesh = whole(scene)
    assert scene.materials["scan"].texture == tmp_path / "scan.png"
    assert np.allclose(mesh.uvs[0], mesh.vertices[mesh.triangles[0]][:, :2])


def test_coloured_vertices(tmp_path: Path) -> None:
    """Colours of scans become materials of rounded colours."""
    head = (
        "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\n"
        "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
        "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = "".join(f"{k} {k % 2} {k % 3} 255 0 0\n" for k in range(3))
    rows += "".join(f"{k} {k % 2} {k % 3} 0 0 250\n" for k in range(3, 6))
    scene = read(write(tmp_path, (head + rows + "3 0 1 2\n3 3 4 5\n").encode()))
    assert {m.color for m in scene.materials.values()} == {(1, 0, 0, 1), (0, 0, 1, 1)}


def test_strips(tmp_path: Path) -> None:
    """Triangle strips, restarted by -1, alternate their winding."""
    head = (
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    )
    text = head + "0 0 0\n1 0 0\n0 1 0\n1 1 0\n8 0 1 2 3 -1 0 1 2\n"
    mesh = whole(read(write(tmp_path, text.encode())))
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0.0).all()
    assert len(mesh.triangles) == 3


@pytest.mark.parametrize("content", [ply_text(), ply_binary("<"), ply_binary(">")])
def test_absurd_counts(tmp_path: Path, content: bytes) -> None:
    """Headers that promise billions of rows are refused before memory is taken."""
    for element in (b"element vertex 4", b"element face 4"):
        many = content.replace(element, element[:-1] + b"99999999999")
        assert "the file ends" in refused(write(tmp_path, many))


def test_solids(tmp_path: Path) -> None:
    """Names of solids in STL are kept; shared corners are stored once."""
    scene = read(write(tmp_path, stl_text("floor one") + stl_text("roof"), "map.stl"))
    assert [thing.name for thing in scene.objects] == ["floor one", "roof"]
    shape = scene.objects[0].parts[0].shape
    assert len(shape.vertices) == 4


TAIL = b"\0\1\2\3 made by a scanner"


@pytest.mark.parametrize("title", [b"solid part1", b"  SOLID", b"exported by a CAD"])
@pytest.mark.parametrize("tail", [b"", b"\0", TAIL, b"endsolid", b"facet normal 0 0 0\nendsolid"])
def test_binary_stl(tmp_path: Path, title: bytes, tail: bytes) -> None:
    """Whatever its header begins with, and whatever stands behind its last facet."""
    mesh = whole(read(write(tmp_path, stl_binary(title) + tail, "map.stl")))
    assert places(mesh) == WEDGE_PLACES
    assert len(mesh.triangles) == 4


def test_binary_stl_that_is_cut_off(tmp_path: Path) -> None:
    """Is told as what it is, also if its header begins with `solid`."""
    message = refused(write(tmp_path, stl_binary(b"solid part1")[:-60], "map.stl"))
    assert "4 triangles are announced, 2 are there" in message


def test_attributes_of_facets(tmp_path: Path, findings: Findings) -> None:
    """Colours that some programs keep there are counted."""
    content = bytearray(stl_binary())
    content[84 + 48 : 84 + 50] = b"\x1f\x80"
    read(write(tmp_path, bytes(content), "map.stl"), findings)
    assert findings.skipped == {"attribute of a facet": 1}
