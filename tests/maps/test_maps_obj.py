"""Wavefront OBJ (worlds reference 2.4 and 13)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mesh_samples import (
    FACES,
    WEDGE,
    WEDGE_PLACES,
    area,
    obj,
    places,
    read,
    refusal,
    survives,
    volume,
    whole,
    writer,
)
from PIL import Image

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.polygons import triangulate, triangulate_one
from usarsim_maps.scene import Collision, Scene

write = writer("map.obj")


class TestFrame:
    """Axes, units, winding."""

    def test_z_up_and_mirror(self, tmp_path: Path) -> None:
        """Options exchange the axes, or reflect; faces look outwards all the same."""
        rows = [f"v {x:g} {y:g} {z:g}" for x, y, z in WEDGE]
        faces = ["f " + " ".join(str(i + 1) for i in face) for face in FACES]
        path = write(tmp_path, "\n".join(rows + faces))
        assert places(whole(read(path, up="Z"))) == WEDGE_PLACES
        mirrored = whole(read(path, up="Z", mirror=True))
        expected = sorted((WEDGE * [1, -1, 1] + 0.0).tolist())
        assert places(mirrored) == expected
        assert volume(mirrored) == pytest.approx(1.0)


class TestText:
    """What lines may look like."""

    def test_line_ends_and_joined_lines(self, tmp_path: Path) -> None:
        """CRLF, comments, joined lines, a missing last newline change nothing."""
        plain = whole(read(write(tmp_path, obj())))
        text = obj("# nothing").replace("f 1 3 2", "f 1 \\\n3 2 # why").replace("\n", "\r\n")
        other = whole(read(write(tmp_path, text.rstrip(), "other.obj")))
        assert np.array_equal(plain.vertices, other.vertices)
        assert np.array_equal(plain.triangles, other.triangles)

    def test_negative_indices(self, tmp_path: Path) -> None:
        """Minus one is the latest vertex."""
        text = "v 0 0 0\nv 1 0 0\nv 1 0 -1\nv 0 0 -1\nf -4 -3 -2 -1\n"
        mesh = whole(read(write(tmp_path, text)))
        assert len(mesh.triangles) == 2
        assert area(mesh) == pytest.approx(1.0)

    def test_a_concave_polygon(self, tmp_path: Path) -> None:
        """An L of six corners keeps its area of three squares, not the area of a fan."""
        corners = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
        text = "\n".join(f"v {x} 0 {-y}" for x, y in corners) + "\nf 2 3 4 5 6 1\n"
        mesh = whole(read(write(tmp_path, text)))
        assert len(mesh.triangles) == 4
        assert area(mesh) == pytest.approx(3.0)
        normals = np.cross(
            mesh.vertices[mesh.triangles[:, 1]] - mesh.vertices[mesh.triangles[:, 0]],
            mesh.vertices[mesh.triangles[:, 2]] - mesh.vertices[mesh.triangles[:, 0]],
        )
        assert (normals[:, 2] > 0.0).all()

    def test_lines_and_points_are_no_faces(self, tmp_path: Path) -> None:
        """A file of lines only is refused, and says why."""
        text = refusal(lambda: read(write(tmp_path, "v 0 0 0\nv 1 0 0\nl 1 2\np 1\n")))
        assert "no faces" in text


class TestObjects:
    """Names."""

    def test_every_o_is_an_object(self, tmp_path: Path) -> None:
        """Objects keep their names and their own vertices; groups inside do not split them."""
        text = "o floor\n" + obj() + "g part\nf 1 2 3\no wall 2\nf 1 2 4\n"
        scene = read(write(tmp_path, text))
        assert [thing.name for thing in scene.objects] == ["floor", "wall 2"]
        wall = scene.objects[1].parts[0].shape
        assert len(wall.vertices) == 3

    def test_groups_without_objects(self, tmp_path: Path) -> None:
        """Where there is no `o`, every `g` is an object, also if it comes twice."""
        text = "g a\n" + obj() + "g b\nf 1 2 3\ng a\nf 2 3 4\n"
        scene = read(write(tmp_path, text))
        names = [thing.name for thing in scene.objects]
        assert sorted(names) == ["a", "b"]
        shape = scene.objects[names.index("a")].parts[0].shape
        assert len(shape.triangles) == 5

    def test_collision_hulls_by_name(self, tmp_path: Path) -> None:
        """UCX_Chair_01 is not seen and is the only thing to bump into at Chair."""
        text = "o Chair\n" + obj() + "o UCX_Chair_01\nf 1 2 3\nf 1 2 4\no Table\nf 2 3 4\n"
        chair, hull, table = read(write(tmp_path, text)).objects
        assert chair.parts[0].collision is Collision.NONE
        assert chair.parts[0].visible
        assert hull.parts[0].collision is Collision.HULL
        assert not hull.parts[0].visible
        assert table.parts[0].collision is Collision.AUTO


class TestMaterials:
    """Libraries and pictures."""

    def textured(self, folder: Path) -> Path:
        """A quad with a picture whose name is written in other capitals and has a blank."""
        pictures = folder / "Textures"
        pictures.mkdir()
        Image.new("RGB", (2, 2), (255, 0, 0)).save(pictures / "Brick Wall.PNG")
        library = (
            "newmtl brick\nKd 0 0 0\nmap_Kd -s 1 1 1 -clamp off C:\\art\\brick wall.png\n"
            "newmtl glass\nKd 0.1 0.2 0.3\nd 0.5\n"
        )
        write(folder, library, "Looks.mtl")
        text = (
            "mtllib looks.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n"
            "vt 0 1\nusemtl brick\nf 1/1 2/2 3/3 4/4\nusemtl glass\nf 1 2 3\n"
        )
        return write(folder, text)

    def test_pictures_and_colours(self, tmp_path: Path, findings: Findings) -> None:
        """Pictures are found whatever their capitals; black under a picture becomes white."""
        scene = read(self.textured(tmp_path), findings)
        brick, glass = scene.materials["brick"], scene.materials["glass"]
        assert brick.texture == tmp_path / "Textures" / "Brick Wall.PNG"
        assert brick.color[:3] == (1.0, 1.0, 1.0)
        assert glass.color == (0.1, 0.2, 0.3, 0.5)
        assert not findings.missing_list()
        assert tmp_path / "Looks.mtl" in scene.source.files
        assert tmp_path / "Textures" / "Brick Wall.PNG" in scene.source.files

    def test_texture_coordinates(self, tmp_path: Path) -> None:
        """Coordinates belong to their corners, v upwards."""
        mesh = whole(read(self.textured(tmp_path)))
        for triangle, uvs, slot in zip(mesh.triangles, mesh.uvs, mesh.slots, strict=True):
            if mesh.materials[slot] == "brick":
                corners = mesh.vertices[triangle]
                assert np.allclose(uvs, corners[:, [0, 2]])

    def test_missing_library_and_picture(self, tmp_path: Path, findings: Findings) -> None:
        """What is missing is a finding, not an error (worlds 70)."""
        scene = read(write(tmp_path, obj(head="mtllib gone.mtl\nusemtl paint")), findings)
        assert findings.missing_list() == [("file", "gone.mtl", 1)]
        assert "paint" in scene.materials


def coloured(rows: list[str], head: str = "") -> str:
    """Two triangles of six vertices with what stands behind their places."""
    spots = [(0, 0, 0), (1, 0, 0), (0, 0, -1), (5, 0, 0), (6, 0, 0), (5, 0, -1)]
    lines = [f"v {x} {y} {z} {row}" for (x, y, z), row in zip(spots, rows, strict=True)]
    return "\n".join([head, *lines, "f 1 2 3", "f 4 5 6", ""])


def colors_of(scene: Scene) -> list[tuple[float, ...]]:
    """Colours of the triangles of the only mesh, rounded."""
    mesh = scene.objects[0].parts[0].shape
    names = [mesh.materials[slot] for slot in mesh.slots]
    return [tuple(round(part, 2) for part in scene.materials[name].color) for name in names]


class TestVertexColors:
    """Colours behind the places of vertices."""

    @pytest.mark.parametrize(
        ("red", "half"),
        [
            ("1 0 0", "0 0.5 0"),
            ("1.0 0.0 0.0 1.0", "0 0.5 0 1.0"),
            ("255 0 0", "0 127.5 0"),
            ("1,0 0,0 0,0", "0,0 0,5 0,0"),
        ],
    )
    def test_of_two_triangles(self, tmp_path: Path, red: str, half: str) -> None:
        """As fractions or as bytes, with an opacity or without."""
        scene = read(write(tmp_path, coloured([red] * 3 + [half] * 3)))
        assert colors_of(scene) == [(1.0, 0.0, 0.0, 1.0), (0.0, 0.5, 0.0, 1.0)]

    def test_with_a_library(self, tmp_path: Path) -> None:
        """They multiply the colour of the material; a picture stays."""
        Image.new("RGB", (2, 2)).save(tmp_path / "a.png")
        write(tmp_path, "newmtl m\nKd 1 0.5 0.5\nd 0.5\nnewmtl p\nmap_Kd a.png\n", "a.mtl")
        rows = ["1 1 0"] * 3 + ["1 1 1"] * 3
        scene = read(write(tmp_path, coloured(rows, "mtllib a.mtl\nusemtl m")))
        assert colors_of(scene) == [(1.0, 0.5, 0.0, 0.5), (1.0, 0.5, 0.5, 0.5)]
        assert scene.objects[0].parts[0].shape.materials[1] == "m"
        scene = read(write(tmp_path, coloured(rows, "mtllib a.mtl\nusemtl p")))
        names = scene.objects[0].parts[0].shape.materials
        assert {scene.materials[name].texture for name in names} == {tmp_path / "a.png"}

    def test_of_some_vertices(self, tmp_path: Path) -> None:
        """Those without one are white; weights and words are no colours."""
        scene = read(write(tmp_path, coloured(["1 0 0"] * 3 + ["1.0"] * 3)))
        assert colors_of(scene)[1] == (1.0, 1.0, 1.0, 1.0)
        scene = read(write(tmp_path, coloured(["a b c"] * 6)))
        assert scene.objects[0].parts[0].shape.materials == ("",)

    def test_of_a_scan(self, tmp_path: Path) -> None:
        """Thousands of colours become at most 64 materials."""
        rows = [f"v {k} {k % 7} {k % 5} {k / 999} {(k * 7 % 999) / 999} 0.5" for k in range(999)]
        faces = [f"f {k} {k + 1} {k + 2}" for k in range(1, 997)]
        scene = read(write(tmp_path, "\n".join(rows + faces)))
        assert 8 < len(scene.objects[0].parts[0].shape.materials) <= 64


def test_statements_that_have_no_effect(tmp_path: Path, findings: Findings) -> None:
    """Are counted by their kinds, those of libraries too."""
    write(tmp_path, "newmtl m\nKa 1 1 1\nKd 1 0 0\nmap_Bump b.png\nKa 0 0 0\n", "a.mtl")
    text = obj(head="mtllib a.mtl\nusemtl m") + "s 1\nvn 0 0 1\nl 1 2\ncurv 0 1 1 2\nvn 0 1 0\n"
    read(write(tmp_path, text), findings)
    assert findings.skipped_names == {
        "OBJ statement": ["s", "vn", "l", "curv"], "MTL statement": ["Ka", "map_Bump"],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("line", "name", "bright"),
    [
        ("map_d holes.png", "holes.png", False),
        ("MAP_D -imfchan l holes.png", "holes.png", True),
        ("map_d -s 1 1 1 -imfchan m holes.png", "holes.png", False),
    ],
)
def test_holes_of_a_library(tmp_path: Path, line: str, name: str, bright: bool) -> None:
    """`map_d` is the opacity of a material, in its alpha channel or in its brightness."""
    Image.new("L", (2, 2)).save(tmp_path / "holes.png")
    write(tmp_path, f"newmtl m\n{line}\n", "a.mtl")
    scene = read(write(tmp_path, obj(head="mtllib a.mtl\nusemtl m")))
    opacity = scene.materials["m"].opacity
    assert opacity is not None
    assert (opacity.picture, opacity.bright) == (tmp_path / name, bright)
    assert tmp_path / name in scene.source.files


def test_numbers_without_end(tmp_path: Path) -> None:
    """Vertices that are not finite are left to the builder, which drops their triangles."""
    text = "v 0 0 0\nv 1e999 0 0\nv nan 1 0\nv 1 0 1\nf 1 2 3\nf 1 2 3 4\nf 1 4 1\n"
    survives(tmp_path, "map.obj", text.encode())


NUMBERS = st.sampled_from([0.0, 1.0, -1.0, 0.5, 1e-9, 1e11, 1e13, 1e300, math.inf, math.nan])


@settings(max_examples=200, deadline=None)
@given(
    st.lists(arrays(float, st.tuples(st.integers(0, 7), st.just(3)), elements=NUMBERS), max_size=3)
)
def test_any_polygon(rings: list[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]) -> None:
    """What encloses nothing, crosses itself or is at no place gives triangles of its corners."""
    outline, *holes = rings or [np.zeros((0, 3))]
    with np.errstate(all="ignore"):
        found = triangulate_one(outline, holes)
        every, owners = triangulate(outline, np.array([len(outline)]))
    assert not len(found) or 0 <= found.min() <= found.max() < sum(map(len, rings))
    assert not len(every) or 0 <= every.min() <= every.max() < len(outline)
    assert not owners.any()
