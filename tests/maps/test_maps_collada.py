"""COLLADA, tolerantly (worlds reference 7 and 13, items 43 to 47)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from mesh_samples import (
    DAE_LOOKS,
    FACES,
    VERTEX,
    WEDGE,
    WEDGE_PLACES,
    area,
    dae,
    dae_bound,
    dae_geometry,
    dae_source,
    dae_textured,
    dae_wedge,
    places,
    read,
    refusal,
    upright,
    volume,
    whole,
    writer,
)
from PIL import Image

from usarsim_maps.findings import Findings
from usarsim_maps.meshes import collada, collada_mesh, xml_text
from usarsim_maps.scene import LightKind
from usarsim_server.simulation.frames import rpy_from_quaternion

write = writer("map.dae")


class TestAsset:
    """Units and axes (worlds 43)."""

    @pytest.mark.parametrize("unit", [1.0, 0.0254, 8.375])
    def test_unit(self, tmp_path: Path, unit: float) -> None:
        """The unit scales the mesh, once."""
        asset = f'<unit name="u" meter="{unit}"/><up_axis>Z_UP</up_axis>'
        scene = read(write(tmp_path, dae(dae_wedge(), asset=asset)))
        assert volume(whole(scene)) == pytest.approx(unit**3)
        assert scene.source.units_per_metre == pytest.approx(1.0 / unit)
        assert not scene.source.assumed

    def test_scale_replaces_the_unit(self, tmp_path: Path) -> None:
        """What the user says wins over the file."""
        asset = '<unit meter="0.01"/><up_axis>Z_UP</up_axis>'
        mesh = whole(read(write(tmp_path, dae(dae_wedge(), asset=asset)), scale=2.0))
        assert volume(mesh) == pytest.approx(1 / 8)

    def test_axes(self, tmp_path: Path) -> None:
        """Y_UP, which is the default, X_UP and Z_UP of one thing coincide (worlds 9, 10)."""
        lying = WEDGE[:, [2, 0, 1]] * np.array([1.0, -1.0, -1.0])  # (x, y, z) with x up
        for asset, points in (
            ("<up_axis>Z_UP</up_axis>", WEDGE),
            ("<up_axis>Y_UP</up_axis>", upright(WEDGE)),
            ("", upright(WEDGE)),
            ("<up_axis>X_UP</up_axis>", lying),
        ):
            mesh = whole(read(write(tmp_path, dae(dae_wedge(points), asset=asset))))
            assert places(mesh) == WEDGE_PLACES, asset
            assert volume(mesh) == pytest.approx(1.0)

    def test_a_unit_without_meaning(self, tmp_path: Path, findings: Findings) -> None:
        """It is taken for a metre, with a warning."""
        asset = '<unit meter="centimetre"/><up_axis>Z_UP</up_axis>'
        assert volume(whole(read(write(tmp_path, dae(dae_wedge(), asset=asset)), findings))) == 1
        assert "1 m was taken" in findings.warnings()[0].text


class TestTolerance:
    """What exporters got wrong."""

    def test_invalid_utf8_in_an_id(self, tmp_path: Path) -> None:
        """Bytes that are no UTF-8 inside ids do not matter (worlds 44)."""
        text = dae(dae_wedge()).encode().replace(b'"g', b'"g\xff\x83').replace(b"#g", b"#g\xff\x83")
        assert volume(whole(read(write(tmp_path, text)))) == pytest.approx(1.0)

    def test_less_than_in_an_attribute(self, tmp_path: Path) -> None:
        """`<` and a stray `&` inside an attribute's value do not matter (worlds 45)."""
        text = dae(dae_wedge()).replace('name="n"', 'name="a <b> & c"')
        scene = read(write(tmp_path, text))
        assert scene.objects[0].name == "a <b> & c"

    def test_control_characters(self, tmp_path: Path) -> None:
        """Control characters are dropped."""
        text = dae(dae_wedge()).replace('name="n"', 'name="a\x01b"')
        assert read(write(tmp_path, text)).objects[0].name == "ab"

    def test_a_shift_jis_file(self, tmp_path: Path) -> None:
        """Another declared encoding is obeyed."""
        text = dae(dae_wedge()).replace("utf-8", "Shift_JIS").replace('name="n"', 'name="壁"')
        assert read(write(tmp_path, text.encode("shift_jis"))).objects[0].name == "壁"

    def test_utf16_with_mark(self, tmp_path: Path) -> None:
        """UTF-16 is read, whatever the declaration."""
        assert len(read(write(tmp_path, dae(dae_wedge()).encode("utf-16"))).objects) == 1


class TestPrimitives:
    """Kinds of faces (worlds 46)."""

    def test_polygons_with_a_hole(self, tmp_path: Path) -> None:
        """A square of 4 m with a hole of 2 m: eight triangles, 12 square metres."""
        points = "0 0 0 4 0 0 4 4 0 0 4 0 1 1 0 3 1 0 3 3 0 1 3 0"
        faces = f'<polygons count="1">{VERTEX}<ph><p>0 1 2 3</p><h>4 5 6 7</h></ph></polygons>'
        mesh = whole(read(write(tmp_path, dae(dae_geometry(faces, points)))))
        assert len(mesh.triangles) == 8
        assert area(mesh) == pytest.approx(12.0)
        middles = mesh.vertices[mesh.triangles].mean(axis=1)
        assert not ((middles[:, :2] > 1.0) & (middles[:, :2] < 3.0)).all(axis=1).any()

    def test_two_holes(self, tmp_path: Path) -> None:
        """Two windows in one wall."""
        points = "0 0 0 8 0 0 8 0 4 0 0 4 1 0 1 3 0 1 3 0 3 1 0 3 5 0 1 7 0 1 7 0 3 5 0 3"
        faces = (
            f'<polygons count="1">{VERTEX}<ph><p>0 1 2 3</p><h>4 5 6 7</h><h>8 9 10 11</h></ph>'
            "</polygons>"
        )
        mesh = whole(read(write(tmp_path, dae(dae_geometry(faces, points)))))
        assert len(mesh.triangles) == 14
        assert area(mesh) == pytest.approx(24.0)

    def test_polylist_with_five_corners(self, tmp_path: Path) -> None:
        """A house front of five corners and a quad."""
        points = "0 0 0 2 0 0 2 2 0 1 3 0 0 2 0"
        faces = (
            f'<polylist count="2">{VERTEX}<vcount>5 4</vcount><p>0 1 2 3 4 0 1 2 4</p></polylist>'
        )
        mesh = whole(read(write(tmp_path, dae(dae_geometry(faces, points)))))
        assert len(mesh.triangles) == 5
        assert area(mesh) == pytest.approx(5.0 + 4.0)

    @pytest.mark.parametrize(
        ("tag", "chain"),
        [("tristrips", "0 1 3 2"), ("trifans", "0 1 2 3"), ("polygons", "0 1 2 3")],
    )
    def test_strips_and_fans(self, tmp_path: Path, tag: str, chain: str) -> None:
        """The unit square in each form: two triangles, area one, facing up."""
        faces = f'<{tag} count="1">{VERTEX}<p>{chain}</p></{tag}>'
        mesh = whole(read(write(tmp_path, dae(dae_geometry(faces)))))
        a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
        assert len(mesh.triangles) == 2
        assert np.cross(b - a, c - a)[:, 2] == pytest.approx(1.0)

    def test_inputs_with_their_own_offsets(self, tmp_path: Path) -> None:
        """Normals and texture coordinates may stand between the vertices' indices."""
        more = dae_source("g-n", "0 0 1") + dae_source("g-t", "0 0 1 0 1 1 0 1", 2)
        inputs = (
            '<input semantic="VERTEX" source="#g-v" offset="1"/>'
            '<input semantic="NORMAL" source="#g-n" offset="0"/>'
            '<input semantic="TEXCOORD" source="#g-t" offset="2" set="0"/>'
        )
        faces = (
            f'<triangles count="2">{inputs}<p>0 0 0 0 1 1 0 2 2 0 0 0 0 2 2 0 3 3</p></triangles>'
        )
        mesh = whole(read(write(tmp_path, dae(dae_geometry(faces, more=more)))))
        assert np.allclose(mesh.uvs, mesh.vertices[mesh.triangles][:, :, :2])
        assert area(mesh) == pytest.approx(1.0)


class TestNodes:
    """The tree of nodes."""

    def test_order_of_transformations(self, tmp_path: Path) -> None:
        """They act in the order in which they stand, parents first."""
        nodes = (
            '<node name="outer"><translate>10 0 0</translate><rotate>0 0 1 90</rotate>'
            '<node name="inner"><scale>2 1 1</scale><translate>1 0 0</translate>'
            '<instance_geometry url="#g"/></node></node>'
        )
        (thing,) = read(write(tmp_path, dae(dae_wedge(), nodes))).objects
        assert thing.name == "inner"
        assert thing.pose.position == pytest.approx((10.0, 2.0, 0.0))
        assert rpy_from_quaternion(thing.pose.quaternion)[2] == pytest.approx(math.pi / 2)
        mesh = whole(read(write(tmp_path, dae(dae_wedge(), nodes))))
        assert mesh.vertices.min(axis=0) == pytest.approx([9.0, 2.0, 0.0])
        assert mesh.vertices.max(axis=0) == pytest.approx([10.0, 6.0, 3.0])

    def test_instances_of_nodes_share_the_mesh(self, tmp_path: Path) -> None:
        """instance_node places a part of the library several times."""
        library = (
            '<library_nodes><node id="part"><instance_geometry url="#g"/></node></library_nodes>'
        )
        nodes = "".join(
            f'<node name="n{k}"><translate>{k} 0 0</translate><instance_node url="#part"/></node>'
            for k in range(3)
        )
        things = read(write(tmp_path, dae(dae_wedge(), nodes, more=library))).objects
        assert [thing.pose.position[0] for thing in things] == [0.0, 1.0, 2.0]
        assert len({id(thing.parts[0].shape) for thing in things}) == 1

    def test_a_controller_shows_its_bind_mesh(self, tmp_path: Path) -> None:
        """A skinned figure stands as it was modelled, bind matrix included."""
        bind = "1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1"
        library = (
            '<library_controllers><controller id="c"><skin source="#g">'
            f"<bind_shape_matrix>{bind}</bind_shape_matrix></skin></controller>"
            "</library_controllers>"
        )
        nodes = '<node name="n"><instance_controller url="#c"/></node>'
        mesh = whole(read(write(tmp_path, dae(dae_wedge(), nodes, more=library))))
        assert mesh.vertices[:, 0].min() == pytest.approx(5.0)

    def test_a_file_without_scene(self, tmp_path: Path) -> None:
        """Geometry without a scene is shown as it is."""
        text = dae(dae_wedge())
        text = text[: text.index("<library_visual")] + "</COLLADA>"
        assert volume(whole(read(write(tmp_path, text)))) == pytest.approx(1.0)

    def test_markers_and_lights(self, tmp_path: Path) -> None:
        """Empty nodes may be starts; lights keep place, direction and colour (worlds 76)."""
        more = (
            '<library_lights><light id="sun"><technique_common><directional><color>2 1 0</color>'
            "</directional></technique_common></light></library_lights>"
        )
        nodes = (
            '<node name="n"><instance_geometry url="#g"/></node>'
            '<node name="PlayerStart_2"><translate>1 2 3</translate>'
            "<rotate>0 0 1 90</rotate></node>"
            '<node name="Sun"><rotate>1 0 0 90</rotate><instance_light url="#sun"/></node>'
        )
        scene = read(write(tmp_path, dae(dae_wedge(), nodes, more=more)))
        assert scene.starts[0].tag == "PlayerStart_2"
        assert scene.starts[0].pose.position == pytest.approx((1.0, 2.0, 3.0))
        assert scene.lights[0].kind is LightKind.DIRECTIONAL
        assert scene.lights[0].direction == pytest.approx((0.0, 1.0, 0.0))
        assert scene.lights[0].color == (1.0, 0.5, 0.0)


class TestMaterials:
    """From a symbol to a picture."""

    @pytest.mark.parametrize(
        "written", ["wall%20one.jpg", "file:///C:/lost/Wall One.JPG", "..\\old\\WALL ONE.jpg"]
    )
    def test_lost_folders_and_blanks(self, tmp_path: Path, written: str) -> None:
        """Pictures are found beside the model, whatever folder and capitals are written."""
        folder = tmp_path / "materials" / "textures"
        folder.mkdir(parents=True)
        Image.new("RGB", (2, 2)).save(folder / "Wall One.jpg")
        (tmp_path / "meshes").mkdir()
        path = write(tmp_path, dae_textured(written, "brick"), "meshes/map.dae")
        scene = read(path, assets=(tmp_path,))
        assert scene.materials["brick"].texture == folder / "Wall One.jpg"
        assert scene.objects[0].parts[0].materials == {0: "brick"}
        assert folder / "Wall One.jpg" in scene.source.files

    def test_colour(self, tmp_path: Path) -> None:
        """A plain colour needs no picture; a picture that is nowhere keeps its name."""
        scene = read(write(tmp_path, dae_textured("gone.png", "paint")))
        assert scene.materials["paint"].color == (0.1, 0.2, 0.3, 1.0)
        assert scene.materials["brick"].texture == tmp_path / "gone.png"


class TestBadFiles:
    """Errors."""

    def test_nodes_in_each_other(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Cycles and trees that double at every level are refused."""
        monkeypatch.setattr(collada, "MAX_NODES", 1000)
        nodes = '<node id="a"><instance_node url="#a"/></node>'
        message = refusal(lambda: read(write(tmp_path, dae(dae_wedge(), nodes))))
        assert "nodes contain each other" in message
        library = "".join(
            f'<node id="n{k}">' + f'<instance_node url="#n{k + 1}"/>' * 2 + "</node>"
            for k in range(40)
        )
        library += '<node id="n40"><instance_geometry url="#g"/></node>'
        text = dae(
            dae_wedge(),
            '<node><instance_node url="#n0"/></node>',
            more=f"<library_nodes>{library}</library_nodes>",
        )
        assert "more than 1000 nodes" in refusal(lambda: read(write(tmp_path, text)))

    def test_depth(self, tmp_path: Path) -> None:
        """Absurd nesting is refused, not a crash."""
        text = dae(dae_wedge(), "<node>" * 5000 + "</node>" * 5000)
        assert "deeply nested" in refusal(lambda: read(write(tmp_path, text)))


def test_only_declared_packages() -> None:
    """The reader imports nothing beyond numpy and the standard library (worlds 47)."""
    for module in (collada, collada_mesh, xml_text):
        names = {
            value.__name__.partition(".")[0]
            for value in vars(module).values()
            if type(value) is type(np)
        }
        assert names <= {"numpy", "re", "xml", "pyexpat"}


class TestFigures:
    """Controllers: skins and morphs."""

    BIND = "1 0 0 0 0 1 0 0 0 0 1 5 0 0 0 1"
    """The shape is 5 m higher when it is bound."""

    def skin(self, names: str = "Name_array", source: str = "#g") -> str:
        """The wedge on two joints that stand at x = 7, bound 5 m above the ground at x = 0."""
        inverse = "1 0 0 0 0 1 0 0 0 0 1 -5 0 0 0 1 " * 2
        joints = f'<source id="j"><{names} id="ja" count="2">hips head</{names}></source>'
        weights = dae_source("w", "1 0.5 0.25", 1)
        held = (
            '<joints><input semantic="JOINT" source="#j"/>'
            '<input semantic="INV_BIND_MATRIX" source="#b"/></joints>'
            '<vertex_weights count="4"><input semantic="JOINT" source="#j" offset="0"/>'
            '<input semantic="WEIGHT" source="#w" offset="1"/><vcount>1 2 1 0</vcount>'
            "<v>0 0 0 1 1 1 1 2</v></vertex_weights>"
        )
        return (
            f'<controller id="c"><skin source="{source}">'
            f"<bind_shape_matrix>{self.BIND}</bind_shape_matrix>"
            f"{joints}{dae_source('b', inverse, 16)}{weights}{held}</skin></controller>"
        )

    def morph(self, method: str, shares: str = "0.5 0") -> str:
        """The wedge half way to one that is 2 m higher, and not to one elsewhere."""
        targets = '<source id="t"><IDREF_array id="ta" count="2">h k</IDREF_array></source>'
        return (
            f'<controller id="m"><morph source="#g" method="{method}">{targets}'
            f"{dae_source('shares', shares, 1)}"
            '<targets><input semantic="MORPH_TARGET" source="#t"/>'
            '<input semantic="MORPH_WEIGHT" source="#shares"/></targets></morph></controller>'
        )

    def file(self, folder: Path, controllers: str, shown: str = "c", nodes: str = "") -> Path:
        """All three shapes, and a node far away that shows the controller."""
        shapes = [dae_wedge()]
        for name, shift in (("h", [0, 0, 2]), ("k", [900, 0, 0])):
            points = " ".join(f"{value:g}" for value in (WEDGE + np.array(shift)).ravel())
            shapes.append(dae_geometry("", points, name=name))
        joints = nodes or (
            '<node id="hips" sid="hips"><translate>7 0 0</translate>'
            '<node id="head" sid="head"/></node>'
        )
        figure = (
            '<node name="Figure"><translate>500 0 0</translate>'
            f'<instance_controller url="#{shown}"/></node>'
        )
        more = f"<library_controllers>{controllers}</library_controllers>"
        return write(folder, dae("".join(shapes), figure + joints, more=more))

    @pytest.mark.parametrize("names", ["Name_array", "IDREF_array"])
    def test_a_skin(self, tmp_path: Path, findings: Findings, names: str) -> None:
        """Joints say where it is: not its node, and not the matrix of its binding alone."""
        scene = read(self.file(tmp_path, self.skin(names)), findings)
        assert places(whole(scene)) == sorted((WEDGE + np.array([7.0, 0.0, 0.0])).tolist())
        assert scene.objects[0].name == "Figure"
        assert scene.objects[0].pose.position == pytest.approx((7.0, 0.0, 0.0))
        assert not findings.warnings()

    @pytest.mark.parametrize(
        ("method", "shares", "height"),
        [("NORMALIZED", "0.5 0", 1.0), ("RELATIVE", "0 0", 0.0), ("NORMALIZED", "2", 4.0)],
    )
    def test_a_morph(self, tmp_path: Path, method: str, shares: str, height: float) -> None:
        """By its weights, between the shapes or by adding them."""
        path = self.file(tmp_path, self.morph(method, shares), "m")
        mesh = whole(read(path))
        assert mesh.vertices.min(axis=0) == pytest.approx([500.0, 0.0, height])

    def test_a_relative_morph_adds(self, tmp_path: Path) -> None:
        """The targets themselves, not how they differ."""
        mesh = whole(read(self.file(tmp_path, self.morph("RELATIVE", "1 0"), "m")))
        assert mesh.vertices[:, 2].max() == pytest.approx(3.0 + 5.0)

    def test_a_skin_of_a_morph(self, tmp_path: Path) -> None:
        """First one, then the other."""
        both = self.morph("NORMALIZED") + self.skin(source="#m")
        mesh = whole(read(self.file(tmp_path, both)))
        assert mesh.vertices.min(axis=0) == pytest.approx([7.0, 0.0, 1.0])

    @pytest.mark.parametrize(
        ("old", "new"),
        [
            ("hips head", "hips tail"),
            ("1 2 1 0", "1 2"),
            ("<v>0 0 0 1", "<v>0 0 9 1"),
            ("1 2</v>", "1 9</v>"),
        ],
    )
    def test_joints_that_cannot_be_had(
        self, tmp_path: Path, findings: Findings, old: str, new: str
    ) -> None:
        """The figure stands as it was modelled, at its node, and the report says so."""
        scene = read(self.file(tmp_path, self.skin().replace(old, new, 1)), findings)
        assert whole(scene).vertices.min(axis=0) == pytest.approx([500.0, 0.0, 5.0])
        (note,) = findings.warnings()
        assert "Figure stands as it was modelled" in note.text


class TestVertexColors:
    """COLOR inputs."""

    def file(self, folder: Path, color: str, looks: str = "") -> Path:
        """The wedge with a red and a blue vertex, all others white."""
        colors = dae_source("col", "1 0 0 1 0 0 1 1 1 1 1 1", 4)
        entry = '<input semantic="COLOR" source="#col" offset="1"/>'
        corners = " ".join(f"{v} {color}" for v in FACES.ravel())
        shape = f'<triangles count="4" material="sym">{VERTEX}{entry}<p>{corners}</p></triangles>'
        points = " ".join(f"{value:g}" for value in WEDGE.ravel())
        return write(
            folder, dae(dae_geometry(shape, points, colors), dae_bound("paint"), more=looks)
        )

    @pytest.mark.parametrize(
        ("color", "rgb"), [("0", (1, 0, 0)), ("1", (0, 0, 1)), ("2", (1, 1, 1))]
    )
    def test_without_material(self, tmp_path: Path, color: str, rgb: tuple[float, ...]) -> None:
        """They are the colour."""
        scene = read(self.file(tmp_path, color))
        part = scene.objects[0].parts[0]
        assert {scene.materials[name].color[:3] for name in part.materials.values()} == {rgb}

    def test_with_material(self, tmp_path: Path) -> None:
        """They multiply that which the node binds."""
        scene = read(self.file(tmp_path, "0", DAE_LOOKS.format(file="a.png")))
        (name,) = scene.objects[0].parts[0].materials.values()
        assert scene.materials[name].color == pytest.approx((0.1, 0.0, 0.0, 1.0))


CLEAR = {
    "Blender writes the fourth number alone": (
        '<transparent opaque="A_ONE"><color>0 0 0 0.3</color></transparent>', 0.3),
    "A_ONE is the default, and both numbers count": (
        "<transparent><color>1 1 1 0.5</color></transparent>"
        "<transparency><float>0.5</float></transparency>", 0.25),
    "SketchUp writes a factor": (
        '<transparent opaque="A_ONE"><color>1 1 1 1</color></transparent>'
        "<transparency><float>0.02</float></transparency>", 0.02),
    "RGB_ZERO is clear where it is bright": (
        '<transparent opaque="RGB_ZERO"><color>0.25 0.25 0.25 1</color></transparent>'
        "<transparency><float>1</float></transparency>", 0.75),
    "green is brighter than blue": (
        '<transparent opaque="RGB_ZERO"><color>0 1 0 1</color></transparent>', 0.28484),
    "RGB_ONE": (
        '<transparent opaque="RGB_ONE"><color>0.25 0.25 0.25 0</color></transparent>', 0.25),
    "A_ZERO": ('<transparent opaque="A_ZERO"><color>0 0 0 0.25</color></transparent>', 0.75),
    "a factor alone": ("<transparency><float>0.4</float></transparency>", 0.4),
    "opaque by a factor": (
        '<transparent opaque="RGB_ZERO"><color>1 1 1 1</color></transparent>'
        "<transparency><float>0</float></transparency>", 1.0),
    "nothing": ("", 1.0),
    "no number": ("<transparency><float>much</float></transparency>", 1.0),
}  # fmt: skip


@pytest.mark.parametrize("case", CLEAR)
def test_opacity(tmp_path: Path, case: str) -> None:
    """It is `transparent` times `transparency`, by the mode that the file names."""
    text, opacity = CLEAR[case]
    looks = DAE_LOOKS.format(file="a.png").replace("</lambert>", f"{text}</lambert>")
    shape = dae_wedge().replace("<triangles ", '<triangles material="sym" ')
    materials = read(write(tmp_path, dae(shape, dae_bound("paint"), more=looks))).materials
    assert materials["paint"].color == pytest.approx((0.1, 0.2, 0.3, opacity), abs=1e-6)


def test_names_of_materials(tmp_path: Path) -> None:
    """They are those for people, unless two materials have the same; then ids tell them apart."""
    shape = dae_wedge().replace("<triangles ", '<triangles material="sym" ')
    for other, told in (("Wall", "Window Glass"), ("Window Glass", "paint")):
        looks = DAE_LOOKS.format(file="a.png")
        looks = looks.replace('id="paint"', 'id="paint" name="Window Glass"')
        looks = looks.replace('id="brick"', f'id="brick" name="{other}"')
        scene = read(write(tmp_path, dae(shape, dae_bound("paint"), more=looks)))
        assert list(scene.objects[0].parts[0].materials.values()) == [told]
        assert scene.materials[told].color[:3] == pytest.approx((0.1, 0.2, 0.3))


def test_holes_by_a_picture(tmp_path: Path) -> None:
    """`transparent` names the picture of the surface or another, and which end is clear."""
    looks = DAE_LOOKS.replace(
        "</phong>",
        '<transparent opaque="RGB_ZERO"><texture texture="samp"/></transparent></phong>',
    )
    shape = dae_wedge().replace("<triangles ", '<triangles material="sym" ')
    text = dae(shape, dae_bound("brick"), more=looks.format(file="a.png"))
    opacity = read(write(tmp_path, text)).materials["brick"].opacity
    assert opacity is not None
    assert (opacity.picture, opacity.bright, opacity.inverse) == (None, True, True)


def test_what_is_left_out(tmp_path: Path, findings: Findings) -> None:
    """Elements that show nothing here are counted, with their names."""
    more = (
        '<library_animations><animation id="walk"/></library_animations>'
        '<library_cameras><camera id="eye"/></library_cameras>'
        '<library_physics_scenes><physics_scene id="fall"/></library_physics_scenes>'
    )
    shapes = dae_wedge() + '<geometry id="curve"><spline/></geometry>'
    shapes = shapes.replace("</mesh>", '<lines count="0"/></mesh>')
    nodes = (
        '<node name="n"><instance_geometry url="#g"/><instance_geometry url="#curve"/></node>'
        '<node name="bent"><skew>45 0 0 1 1 0 0</skew></node>'
    )
    read(write(tmp_path, dae(shapes, nodes, more=more)), findings)
    assert findings.skipped_names == {
        "animation": ["walk"], "camera": ["eye"], "physics_scene": ["fall"], "lines": ["g"],
        "spline": ["curve"], "skew": ["bent"],
    }  # fmt: skip
