"""X3D in XML, and the classic syntax of VRML 2 (worlds reference 13)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from mesh_samples import (
    FACES,
    VRML_WEDGE,
    WEDGE,
    WEDGE_PLACES,
    X3D_FACE_SET,
    X3D_POINTS,
    X3D_WEDGE,
    places,
    read,
    refused,
    upright,
    volume,
    whole,
    writer,
    x3d,
    x3d_shape,
)
from PIL import Image

from usarsim_maps.findings import Findings

write = writer("map.x3d")


@pytest.mark.parametrize(("text", "name"), [(X3D_WEDGE, "map.x3d"), (VRML_WEDGE, "map.wrl")])
def test_names(tmp_path: Path, text: str, name: str) -> None:
    """Objects are called as their nodes are, in both syntaxes."""
    assert [thing.name for thing in read(write(tmp_path, text, name)).objects] == ["Wedge"]


def test_clockwise_faces_are_turned(tmp_path: Path) -> None:
    """`ccw` false."""
    text = X3D_WEDGE.replace("<IndexedFaceSet", '<IndexedFaceSet ccw="false"')
    assert volume(whole(read(write(tmp_path, text)))) == pytest.approx(-1.0)


@pytest.mark.parametrize(
    ("geometry", "size", "content"),
    [
        ('<Box size="1 2 3"/>', (1, 3, 2), 6.0),
        ("<Box/>", (2, 2, 2), 8.0),
        ('<Sphere radius="2"/>', (4, 4, 4), 4 / 3 * math.pi * 8),
        ('<Cylinder radius="1" height="3"/>', (2, 2, 3), 3 * math.pi),
        ('<Cone bottomRadius="1" height="3"/>', (2, 2, 3), math.pi),
    ],
)
def test_simple_shapes(
    tmp_path: Path, geometry: str, size: tuple[float, float, float], content: float
) -> None:
    """Extents and volume; round things have 32 corners."""
    mesh = whole(read(write(tmp_path, x3d(x3d_shape(geometry)))))
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx(size, rel=0.01)
    assert volume(mesh) == pytest.approx(content, rel=0.02)
    assert volume(mesh) <= content + 1e-9


def test_elevation_grid(tmp_path: Path) -> None:
    """Heights along y; rows go along z, which is away from y of the simulation."""
    grid = (
        '<ElevationGrid xDimension="3" zDimension="2" xSpacing="2" zSpacing="5"'
        ' height="0 0 0 1 2 3"/>'
    )
    mesh = whole(read(write(tmp_path, x3d(x3d_shape(grid)))))
    assert len(mesh.triangles) == 4
    assert [0.0, -5.0, 1.0] in places(mesh)
    assert [4.0, -5.0, 3.0] in places(mesh)
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0.0).all()


def test_triangle_sets(tmp_path: Path) -> None:
    """Indexed, and corner by corner."""
    index = " ".join(str(number) for number in FACES.ravel())
    inside = f'<Coordinate point="{X3D_POINTS}"/>'
    indexed = f'<IndexedTriangleSet index="{index}">{inside}</IndexedTriangleSet>'
    corners = ", ".join("{:g} {:g} {:g}".format(*p) for p in upright(WEDGE)[FACES.ravel()])
    plain = f'<TriangleSet><Coordinate point="{corners}"/></TriangleSet>'
    for geometry in (indexed, plain):
        mesh = whole(read(write(tmp_path, x3d(x3d_shape(geometry)))))
        assert places(mesh) == WEDGE_PLACES
        assert volume(mesh) == pytest.approx(1.0)


def test_polygons_are_cut(tmp_path: Path) -> None:
    """A polygon with an inward corner keeps its area; the last -1 may be missing."""
    points = "0 0 0, 2 0 0, 2 0 -2, 1 0 -0.5, 0 0 -2"
    geometry = (
        f'<IndexedFaceSet coordIndex="0 1 2 3 4"><Coordinate point="{points}"/></IndexedFaceSet>'
    )
    mesh = whole(read(write(tmp_path, x3d(x3d_shape(geometry)))))
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(2.5)


def test_transform_in_the_order_of_the_standard(tmp_path: Path) -> None:
    """Scaled first, turned about the centre, then moved; children inherit."""
    body = (
        '<Transform translation="10 0 0"><Transform center="1 0 0" rotation="0 1 0 1.5707963"'
        f' scale="2 1 1">{x3d_shape(X3D_FACE_SET)}</Transform></Transform>'
    )
    found = places(whole(read(write(tmp_path, x3d(body)))))
    # x of the file: (0, 2) about 1 by two is (-1, 3); a quarter turn about y takes x to -z.
    turned = []
    for x, y, z in upright(WEDGE):
        across = 2.0 * (x - 1.0)
        turned.append([1.0 + z + 10.0, across, y])
    assert found == pytest.approx(np.array(sorted(turned)), abs=1e-6)


def test_used_again(tmp_path: Path) -> None:
    """USE shows the same mesh at another place, and what is not defined is an error."""
    body = (
        f'<Transform DEF="One"><Group DEF="G">{x3d_shape(X3D_FACE_SET)}</Group></Transform>'
        '<Transform DEF="Two" translation="5 0 0"><Group USE="G"/></Transform>'
    )
    scene = read(write(tmp_path, x3d(body)))
    first, second = scene.objects
    assert first.parts[0].shape is second.parts[0].shape
    assert second.pose.position == pytest.approx((5.0, 0.0, 0.0))
    message = refused(write(tmp_path, x3d('<Group USE="H"/>' + x3d_shape(X3D_FACE_SET)), "bad.x3d"))
    assert "line 4" in message
    assert "'H'" in message


def test_what_contains_itself_is_refused(tmp_path: Path) -> None:
    """A group that uses itself, and groups that double themselves forty times."""
    assert "contain each other" in refused(
        write(tmp_path, x3d('<Group DEF="A"><Group USE="A"/></Group>'))
    )
    doubled = '<Group DEF="G0"/>' + "".join(
        f'<Group DEF="G{n}"><Group USE="G{n - 1}"/><Group USE="G{n - 1}"/></Group>'
        for n in range(1, 41)
    )
    assert "nodes" in refused(write(tmp_path, x3d(doubled)))


def test_switch_and_detail(tmp_path: Path) -> None:
    """A switch shows its choice, a LOD what is finest."""
    low, high = x3d_shape("<Box/>"), x3d_shape(X3D_FACE_SET)
    switch = f'<Switch whichChoice="1">{low}{high}</Switch>'
    assert places(whole(read(write(tmp_path, x3d(switch))))) == WEDGE_PLACES
    assert places(whole(read(write(tmp_path, x3d(f"<LOD>{high}{low}</LOD>"))))) == WEDGE_PLACES
    assert "no faces" in refused(write(tmp_path, x3d(switch.replace('"1"', '"-1"'))))


def test_looks(tmp_path: Path) -> None:
    """Colours, transparency and pictures."""
    Image.new("RGB", (2, 2), (9, 9, 9)).save(tmp_path / "wall.png")
    red = '<Material DEF="Red" diffuseColor="1 0 0" transparency="0.25"/>'
    plain = f"<Appearance>{red}</Appearance>"
    picture = '<Appearance><ImageTexture url=\'"gone.png" "wall.png"\'/></Appearance>'
    textured = X3D_FACE_SET.replace(
        "</IndexedFaceSet>", '<TextureCoordinate point="0 0, 1 0, 1 1, 0 1"/></IndexedFaceSet>'
    )
    scene = read(
        write(tmp_path, x3d(x3d_shape(X3D_FACE_SET, plain) + x3d_shape(textured, picture)))
    )
    first, other = scene.materials.values()
    assert first.name == "Red"
    assert first.color == pytest.approx((1.0, 0.0, 0.0, 0.75))
    assert other.texture is not None
    assert scene.objects[0].parts[0].materials == {0: "Red"}
    mesh = scene.objects[1].parts[0].shape
    assert mesh.uvs.max() == 1.0  # type: ignore[union-attr]


def test_unit_of_the_head(tmp_path: Path) -> None:
    """Millimetres, in both syntaxes."""
    head = '<unit category="length" name="millimetre" conversionFactor="0.001"/>'
    text = x3d(x3d_shape(X3D_FACE_SET), head)
    assert np.ptp(whole(read(write(tmp_path, text))).vertices) == pytest.approx(0.003)
    classic = "#X3D V3.3 utf8\nPROFILE Interchange\nUNIT length millimetre 0.001\n" + "\n".join(
        VRML_WEDGE.splitlines()[1:]
    )
    mesh = whole(read(write(tmp_path, classic, "map.x3dv")))
    assert np.ptp(mesh.vertices) == pytest.approx(0.003)


def test_markers(tmp_path: Path) -> None:
    """Empty transforms with the usual names are starts and victims."""
    body = x3d_shape(X3D_FACE_SET) + (
        '<Transform DEF="PlayerStart_1" translation="1 0.5 -2"/>'
        '<Transform DEF="MaleVictim_0" translation="3 0 0"/>'
    )
    scene = read(write(tmp_path, x3d(body)))
    assert scene.starts[0].pose.position == pytest.approx((1.0, 2.0, 0.5))
    assert scene.victims[0].pose.position == pytest.approx((3.0, 0.0, 0.0))


def test_inline_files(tmp_path: Path, findings: Findings) -> None:
    """Another file is shown where it is named; names inside are its own; missing ones are told."""
    (tmp_path / "meshes").mkdir()
    write(tmp_path / "meshes", VRML_WEDGE, "part.wrl")
    body = '<Transform translation="0 7 0"><Inline url=\'"meshes/part.wrl"\'/></Transform>'
    scene = read(write(tmp_path, x3d(body + '<Inline url="gone.wrl"/>')), findings)
    assert scene.objects[0].pose.position == pytest.approx((0.0, 0.0, 7.0))
    assert ("file", "gone.wrl", 1) in findings.missing_list()
    assert {path.name for path in scene.source.files} == {"map.x3d", "part.wrl"}


def test_a_file_that_shows_itself(tmp_path: Path) -> None:
    """Is refused."""
    assert "nested too deeply" in refused(write(tmp_path, x3d('<Inline url="map.x3d"/>')))


SQUARE = '<Coordinate point="0 0 0, 1 0 0, 1 0 -1, 0 0 -1"/>'
CORNERS = "0 0 0, 1 0 0, 1 0 -1, 0 0 -1"


@pytest.mark.parametrize(
    "geometry",
    [
        f'<IndexedTriangleStripSet index="0 1 3 2 -1">{SQUARE}</IndexedTriangleStripSet>',
        f'<IndexedTriangleStripSet index="0 1 2 -1 0 2 3 -1">{SQUARE}</IndexedTriangleStripSet>',
        f'<IndexedTriangleFanSet index="0 1 2 3">{SQUARE}</IndexedTriangleFanSet>',
        f'<TriangleFanSet fanCount="4">{SQUARE}</TriangleFanSet>',
        '<TriangleStripSet stripCount="4"><Coordinate point="0 0 0, 1 0 0, 0 0 -1, 1 0 -1"/>'
        "</TriangleStripSet>",
        f'<IndexedQuadSet index="0 1 2 3">{SQUARE}</IndexedQuadSet>',
        f"<QuadSet>{SQUARE}</QuadSet>",
    ],
)
def test_strips_fans_and_quads(tmp_path: Path, geometry: str) -> None:
    """A square metre that looks upwards, in every way of writing it."""
    mesh = whole(read(write(tmp_path, x3d(x3d_shape(geometry)))))
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a) / 2.0
    assert normals.sum(axis=0) == pytest.approx([0.0, 0.0, 1.0])


TWO = "0 1 2 -1 3 4 5 -1"
SIX = "0 0 0, 1 0 0, 0 0 -1, 5 0 0, 6 0 0, 5 0 -1"


@pytest.mark.parametrize(
    ("facts", "colors"),
    [
        ("", "<Color color='1 0 0, 1 0 0, 1 0 0, 0 0 1, 0 0 1, 0 0 1'/>"),
        ("", "<ColorRGBA color='1 0 0 1, 1 0 0 1, 1 0 0 1, 0 0 1 1, 0 0 1 1, 0 0 1 1'/>"),
        ("colorIndex='1 1 1 -1 0 0 0 -1'", "<Color color='0 0 1, 1 0 0'/>"),
        ("colorPerVertex='false'", "<Color color='1 0 0, 0 0 1'/>"),
        ("colorPerVertex='false' colorIndex='1 0'", "<Color color='0 0 1, 1 0 0'/>"),
    ],
)
def test_colors_of_vertices_and_faces(tmp_path: Path, facts: str, colors: str) -> None:
    """They replace the colour of the material, not its transparency; each has one plain colour."""
    geometry = (
        f'<IndexedFaceSet coordIndex="{TWO}" {facts}><Coordinate point="{SIX}"/>{colors}'
        "</IndexedFaceSet>"
    )
    look = '<Appearance><Material diffuseColor="0 1 0" transparency="0.5"/></Appearance>'
    for shape, opacity in ((x3d_shape(geometry), 1.0), (x3d_shape(geometry, look), 0.5)):
        scene = read(write(tmp_path, x3d(shape)))
        part = scene.objects[0].parts[0]
        found = [scene.materials[part.materials[slot]].color for slot in part.shape.slots]
        assert found == [(1.0, 0.0, 0.0, opacity), (0.0, 0.0, 1.0, opacity)]


def test_too_few_colors(tmp_path: Path) -> None:
    """A surface without its colours is a surface."""
    geometry = (
        f'<IndexedFaceSet coordIndex="{TWO}"><Coordinate point="{SIX}"/><Color color="1 0 0"/>'
        "</IndexedFaceSet>"
    )
    assert read(write(tmp_path, x3d(x3d_shape(geometry)))).objects[0].parts[0].materials == {}


@pytest.mark.parametrize(
    ("facts", "cutoff"),
    [("", 0.5), ('alphaMode="MASK" alphaCutoff="0.2"', 0.2), ('alphaMode="OPAQUE"', None)],
)
def test_holes_by_a_picture(tmp_path: Path, facts: str, cutoff: float | None) -> None:
    """The opacity of a picture counts unless the appearance says otherwise."""
    Image.new("RGBA", (2, 2)).save(tmp_path / "a.png")
    look = f'<Appearance DEF="Fence" {facts}><ImageTexture url="a.png"/></Appearance>'
    scene = read(write(tmp_path, x3d(x3d_shape(X3D_FACE_SET, look))))
    opacity = scene.materials["Fence"].opacity
    assert (opacity and opacity.cutoff) == cutoff


def test_what_is_left_out(tmp_path: Path, findings: Findings) -> None:
    """Nodes that show nothing here are counted, with their names, in both syntaxes."""
    body = (
        x3d_shape(X3D_FACE_SET, "<Appearance><PixelTexture/></Appearance>")
        + x3d_shape('<Extrusion DEF="Arch"/>')
        + '<PointLight DEF="Lamp"/><ProtoInstance name="Door"/><ROUTE/>'
    )
    read(write(tmp_path, x3d(body)), findings)
    assert findings.skipped_names == {
        "PixelTexture": [], "Extrusion": ["Arch"], "PointLight": ["Lamp"],
        "ProtoInstance": ["Door"], "ROUTE": [],
    }  # fmt: skip
    classic = Findings()
    read(write(tmp_path, VRML_WEDGE, "map.wrl"), classic)
    assert classic.skipped_names == {
        "WorldInfo": [], "ProtoDeclare": [], "Script": ["Script1"], "ROUTE": [],
    }  # fmt: skip
