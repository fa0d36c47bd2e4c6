"""PLY (worlds reference 2.4 and 13)."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_samples import (
    FACES,
    WEDGE,
    WEDGE_PLACES,
    area,
    damages,
    places,
    read,
    refusal,
    refused,
    survives,
    volume,
    whole,
)
from PIL import Image

HEAD = (
    "ply\nformat {order} 1.0\ncomment by hand\nelement vertex 4\nproperty float x\n"
    "property float y\nproperty double z\nelement face 4\nproperty uchar material\n"
    "property list uchar int vertex_indices\nend_header\n"
)


def ascii_wedge() -> bytes:
    """The wedge as text."""
    rows = ["{:g} {:g} {:g}".format(*point) for point in WEDGE]
    rows += ["7 3 {} {} {}".format(*face) for face in FACES]
    return (HEAD.format(order="ascii") + "\n".join(rows) + "\n").encode()


def binary_wedge(order: str) -> bytes:
    """The wedge as bytes, `<` or `>`."""
    word = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    content = HEAD.format(order=word).encode()
    for x, y, z in WEDGE.tolist():
        content += struct.pack(order + "ffd", x, y, z)
    for face in FACES.tolist():
        content += struct.pack(order + "BB3i", 7, 3, *face)
    return content


FORMS = [ascii_wedge(), binary_wedge("<"), binary_wedge(">"),
         ascii_wedge().replace(b"\n", b"\r\n")]  # fmt: skip


def write(folder: Path, content: bytes, name: str = "map.ply") -> Path:
    """A file."""
    path = folder / name
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("content", FORMS)
def test_all_forms(tmp_path: Path, content: bytes) -> None:
    """Text and both byte orders give the same mesh, z up, faces outwards (items 9, 10)."""
    scene = read(write(tmp_path, content))
    mesh = whole(scene)
    assert places(mesh) == WEDGE_PLACES
    assert len(mesh.triangles) == 4
    assert volume(mesh) == pytest.approx(1.0)
    assert scene.source.assumed
    assert volume(whole(read(write(tmp_path, content), scale=2.0))) == pytest.approx(1 / 8)


def test_uneven_faces(tmp_path: Path) -> None:
    """A quad and a triangle in a binary file, whose rows differ in length."""
    head = HEAD.format(order="binary_little_endian").replace("face 4", "face 2")
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
    assert mesh.uvs is not None
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


class TestBadFiles:
    """Errors."""

    @pytest.mark.parametrize("content", FORMS[:3])
    def test_absurd_counts(self, tmp_path: Path, content: bytes) -> None:
        """Headers that promise billions of rows are refused before memory is taken."""
        for element in (b"element vertex 4", b"element face 4"):
            many = content.replace(element, element[:-1] + b"99999999999")
            assert "the file ends" in refused(write(tmp_path, many))

    def test_points_alone(self, tmp_path: Path) -> None:
        """A point cloud is refused with advice."""
        content = ascii_wedge().replace(b"element face 4", b"element face 0")
        assert "points alone are not solid" in refusal(lambda: read(write(tmp_path, content)))

    @pytest.mark.parametrize(
        ("old", "new", "told"),
        [
            (b"format ascii", b"format utf8", "line 2"),
            (b"property float x", b"property quad x", "line 5"),
            (b"property float x\n", b"", "no vertices with x, y and z"),
            (b"3 0 2 1", b"3 0 2 9", "none of the 4 vertices"),
            (b"3 0 2 1", b"3 0 2 one", "face"),
            (b"end_header", b"", "no header"),
        ],
    )
    def test_what_is_wrong(self, tmp_path: Path, old: bytes, new: bytes, told: str) -> None:
        """Errors name file and place (item 73)."""
        content = ascii_wedge()
        assert old in content
        message = refusal(lambda: read(write(tmp_path, content.replace(old, new, 1))))
        assert "map.ply" in message
        assert told in message

    @settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture],
              deadline=None)  # fmt: skip
    @given(st.data())
    def test_damaged_files(self, tmp_path: Path, data: st.DataObject) -> None:
        """Whatever is wrong with a file, it is read or refused in one line."""
        survives(tmp_path, "map.ply", data.draw(damages(data.draw(st.sampled_from(FORMS)))))
