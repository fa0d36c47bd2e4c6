"""STL (worlds reference 2.4 and 13)."""

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
    damages,
    places,
    read,
    refusal,
    survives,
    volume,
    whole,
)

from usarsim_maps.scene import Mesh


def binary(title: bytes = b"made by hand") -> bytes:
    """The wedge."""
    facets = b"".join(
        np.concatenate([np.zeros(3), WEDGE[face].ravel()]).astype("<f4").tobytes() + b"\0\0"
        for face in FACES
    )
    return title.ljust(80, b" ") + struct.pack("<I", len(FACES)) + facets


def text(name: str = "wedge", new_line: str = "\n") -> str:
    """The wedge."""
    lines = [f"solid {name}"]
    for face in FACES:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex {:g} {:g} {:g}".format(*WEDGE[i]) for i in face]
        lines += ["endloop", "endfacet"]
    return new_line.join([*lines, f"endsolid {name}", ""])


def write(folder: Path, content: bytes, name: str = "map.stl") -> Path:
    """A file."""
    path = folder / name
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    "content",
    [binary(), binary(b"solid but binary"), text().encode(), text(new_line="\r\n").encode()],
)
class TestForms:
    """Binary and text."""

    def test_the_wedge(self, tmp_path: Path, content: bytes) -> None:
        """All forms give the same mesh, z up, unmirrored, faces outwards (items 9, 10, 42)."""
        scene = read(write(tmp_path, content))
        mesh = whole(scene)
        assert places(mesh) == WEDGE_PLACES
        assert len(mesh.triangles) == 4
        assert volume(mesh) == pytest.approx(1.0)
        assert scene.source.assumed

    def test_scale_and_up(self, tmp_path: Path, content: bytes) -> None:
        """Millimetres and y up on request; then nothing is assumed."""
        scene = read(write(tmp_path, content), scale=1000.0, up="Y")
        expected = sorted((np.round(WEDGE[:, [0, 2, 1]] * [1, -1, 1] / 1000.0, 6) + 0.0).tolist())
        assert places(whole(scene)) == expected
        assert not scene.source.assumed


class TestText:
    """Several solids."""

    def test_every_solid_is_an_object(self, tmp_path: Path) -> None:
        """Names are kept; shared corners are stored once."""
        scene = read(write(tmp_path, (text("floor one") + text("roof")).encode()))
        assert [thing.name for thing in scene.objects] == ["floor one", "roof"]
        shape = scene.objects[0].parts[0].shape
        assert isinstance(shape, Mesh)
        assert len(shape.vertices) == 4


class TestBadFiles:
    """Errors."""

    def test_absurd_count(self, tmp_path: Path) -> None:
        """A header that promises 200 GB is refused before memory is taken."""
        content = b" " * 80 + struct.pack("<I", 0xFFFFFFFF) + b"\0" * 500
        message = refusal(lambda: read(write(tmp_path, content)))
        assert "4294967295 triangles are announced, 10 are there" in message

    def test_cut_text(self, tmp_path: Path) -> None:
        """A file cut between two facets is noticed, too."""
        content = text()[: text().index("endsolid")].encode()
        assert "the file ends" in refusal(lambda: read(write(tmp_path, content)))

    @pytest.mark.parametrize(
        ("old", "new", "where"),
        [("vertex 2 0 0", "vertex 2 zero 0", "line 6"), ("vertex 2 0 0\n", "", "line 7")],
    )
    def test_line_numbers(self, tmp_path: Path, old: str, new: str, where: str) -> None:
        """Errors name file and line (item 73)."""
        content = text().replace(old, new, 1).encode()
        message = refusal(lambda: read(write(tmp_path, content)))
        assert f"map.stl: {where}:" in message

    @pytest.mark.parametrize("content", [b"", b"solid", b"solid x\nendsolid x\n", b"hello"])
    def test_nothing_inside(self, tmp_path: Path, content: bytes) -> None:
        """Files without triangles are refused."""
        assert "map.stl" in refusal(lambda: read(write(tmp_path, content)))

    @settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture],
              deadline=None)  # fmt: skip
    @given(st.data())
    def test_damaged_files(self, tmp_path: Path, data: st.DataObject) -> None:
        """Whatever is wrong with a file, it is read or refused in one line."""
        content = data.draw(st.sampled_from([binary(), text().encode()]))
        survives(tmp_path, "map.stl", data.draw(damages(content)))
