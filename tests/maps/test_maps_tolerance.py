"""One bad number does not refuse a map: what is read all the same, and what the report says."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_samples import gltf
from mesh_samples import (
    FACES,
    TRIANGLES,
    VERTEX,
    WEDGE,
    dae,
    dae_geometry,
    dae_source,
    dae_wedge,
    obj,
    ply_text,
    read,
    refused,
    stl_text,
    told,
    whole,
)
from sdf_samples import write
from t3d_maps import actor, level, room, start

from usarsim_maps.convert import Request, import_map
from usarsim_maps.findings import Findings
from usarsim_maps.reader import Context
from usarsim_maps.scene import Light, Scene

LIGHT = (
    '<library_lights><light id="L"><technique_common><point>{}</point></technique_common></light>'
    "</library_lights>"
)
SHOWN = '<node name="n"><instance_geometry url="#g"/></node>'


class TestCollada:
    """COLLADA files."""

    @pytest.mark.parametrize(
        "step", ["<matrix>nan 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix>", "<matrix>1 2 3</matrix>",
                 "<translate>1 x 0</translate>", "<rotate>0 0 1 inf</rotate>"]
    )  # fmt: skip
    def test_nodes_of_exporters(self, tmp_path: Path, step: str, findings: Findings) -> None:
        """A node whose place makes no sense is left out, with all in it."""
        camera = f'<node name="Cam">{step}<node name="PlayerStart_1"/></node>'
        text = dae(dae_wedge(), SHOWN + camera)
        scene = read(write(tmp_path, text, "map.dae"), findings)
        assert [thing.name for thing in scene.objects] == ["n"]
        assert not scene.starts
        assert "map.dae: line 6: node 'Cam' has no place" in told(findings)

    def test_lights(self, tmp_path: Path) -> None:
        """Colour and angle of a lamp have defaults."""
        lamp = LIGHT.format("<color>a b c</color><falloff_angle>x</falloff_angle>")
        nodes = SHOWN + '<node name="X"><instance_light url="#L"/></node>'
        text = dae(dae_wedge(), nodes, more=lamp)
        (light,) = read(write(tmp_path, text, "map.dae")).lights
        assert (light.color, light.cone) == ((1.0, 1.0, 1.0), 45.0)

    def textured(self, uvs: str, corners: str) -> str:
        """The wedge with texture coordinates, if they can be had."""
        inputs = VERTEX + '<input semantic="TEXCOORD" source="#g-t" offset="1"/>'
        triangles = f'<triangles count="4">{inputs}<p>{corners}</p></triangles>'
        points = " ".join(f"{value:g}" for value in WEDGE.ravel())
        return dae(dae_geometry(triangles, points, uvs))

    def test_texture_coordinates_that_are_not_there(self, tmp_path: Path) -> None:
        """Indices out of range take the first ones; the mesh is whole."""
        uvs = dae_source("g-t", "0.5 0.5 1 0 1 1", 2)
        corners = " ".join(f"{v} {9 if k == 5 else -1 if k == 7 else k % 3}"
                           for k, v in enumerate(FACES.ravel()))  # fmt: skip
        findings = Findings()
        mesh = whole(read(write(tmp_path, self.textured(uvs, corners), "map.dae"), findings))
        assert len(mesh.triangles) == 4
        assert mesh.uvs.reshape(-1, 2)[[5, 7]].tolist() == [[0.5, 0.5]] * 2
        assert "2 corners have texture coordinates that are not there" in told(findings)

    @pytest.mark.parametrize("uvs", ["", dae_source("g-t", "0 x 1 0 1 1", 2)])
    def test_texture_coordinates_that_cannot_be_had(self, tmp_path: Path, uvs: str) -> None:
        """Without their source, or with one of words, the mesh has none."""
        findings = Findings()
        text = self.textured(uvs, " ".join(f"{v} 0" for v in FACES.ravel()))
        assert len(whole(read(write(tmp_path, text, "map.dae"), findings)).triangles) == 4
        assert "its pictures are left out" in told(findings)

    def test_decimal_commas(self, tmp_path: Path) -> None:
        """In units and in lists whose count is told."""
        text = dae(
            dae_geometry(TRIANGLES, "0 0 0 2,5 0,0 0,0 0 1 0 0 0 3"),
            asset='<unit meter="0,5"/><up_axis>Z_UP</up_axis>',
        )
        mesh = whole(read(write(tmp_path, text, "map.dae")))
        assert mesh.vertices.max(axis=0) == pytest.approx([1.25, 0.5, 1.5])

    def test_indices_as_floats(self, tmp_path: Path) -> None:
        """`0.0 2.0` are whole numbers, `0.5` is none."""
        text = dae(dae_wedge())
        assert "<p>0 2 1 " in text
        good = text.replace("<p>0 2 1 ", "<p>0.0 2.0 1.0 ")
        assert len(whole(read(write(tmp_path, good, "a.dae"))).triangles) == 4
        assert "line 5" in refused(write(tmp_path, good.replace("2.0", "2.5"), "b.dae"))


def changed(change: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """The wedge as glTF with another node, changed."""
    value = gltf(
        scenes=[{"nodes": [0, 1]}],
        nodes=[{"name": "n", "mesh": 0}, {"name": "other"}],
        materials=[{"name": "red", "pbrMetallicRoughness": {}}],
    )
    change(value)
    return value


class TestGltf:
    """glTF files; Python writes NaN into JSON, and so do exporters."""

    @pytest.mark.parametrize(
        "change",
        [
            {"translation": [float("nan"), 0, 0]},
            {"rotation": [0, 0, 1]},
            {"scale": ["x", 1, 1]},
            {"matrix": [1, 2, 3]},
            {"matrix": [float("inf")] * 16},
        ],
    )
    def test_nodes_of_exporters(self, tmp_path: Path, change: dict[str, Any]) -> None:
        """A node whose place makes no sense is left out; if it was the only one, that is told."""
        findings = Findings()
        text = changed(lambda value: value["nodes"][1].update(change))
        scene = read(write(tmp_path, text, "map.gltf"), findings)
        assert [thing.name for thing in scene.objects] == ["n"]
        assert "nodes[1] has no place" in told(findings)
        text = changed(lambda value: value["nodes"][0].update(change))
        assert not read(write(tmp_path, text, "map.gltf")).objects

    def test_colours_and_lights(self, tmp_path: Path, findings: Findings) -> None:
        """Colours have defaults."""

        def change(value: dict[str, Any]) -> None:
            value["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1, None, 0, 1]
            lights = [{"type": "point", "color": [1, float("nan"), 1], "intensity": "x"}]
            value["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
            value["nodes"][1]["extensions"] = {"KHR_lights_punctual": {"light": 0}}

        scene = read(write(tmp_path, changed(change), "map.gltf"), findings)
        assert scene.materials["red"].color == pytest.approx((1.0, 1.0, 1.0, 1.0))
        assert scene.lights[0].color == (1.0, 1.0, 1.0)
        assert told(findings).count("makes no sense; left out") == 2

    @pytest.mark.parametrize(
        "change",
        [
            lambda v: v["materials"][0]["pbrMetallicRoughness"].update(
                baseColorTexture={"index": 9}
            ),
            lambda v: v.update(textures=[{"source": 7}]),
            lambda v: v.update(images=[{"bufferView": 9}]),
            lambda v: v["meshes"][0]["primitives"][0].update(material=5),
            lambda v: v["meshes"][0]["primitives"][0]["attributes"].update(TEXCOORD_0=8),
            lambda v: v["meshes"][0]["primitives"][0]["attributes"].update(TEXCOORD_0=2),
        ],
    )
    def test_looks_that_are_not_there(
        self, tmp_path: Path, change: Callable[[dict[str, Any]], None]
    ) -> None:
        """Indices of textures, pictures, materials out of range cost the looks, not the mesh."""

        def textured(value: dict[str, Any]) -> None:
            red = {"baseColorTexture": {"index": 0}}
            value["materials"][0]["pbrMetallicRoughness"] = red
            value["textures"] = [{"source": 0}]
            value["images"] = [{"bufferView": 1, "mimeType": "image/png"}]
            change(value)

        findings = Findings()
        scene = read(write(tmp_path, changed(textured), "map.gltf"), findings)
        assert len(whole(scene).triangles) == 4
        assert "left out" in told(findings)


OBJ = obj("vt 0.5 0.5")
PLY = ply_text().decode()
STL = stl_text()
NO_FACET = (
    "facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1.#QNAN 0 0\nvertex 0 1 0\n"
    "endloop\nendfacet\nendsolid"
)


class TestMeshFiles:
    """OBJ, PLY, STL."""

    def test_texture_coordinates_of_obj_that_are_not_there(self, tmp_path: Path) -> None:
        """Corners with indices out of range have none; counted in the report."""
        findings = Findings()
        text = OBJ.replace("f 1 3 2", "f 1/1 3/9 2/-1").replace("f 1 2 4", "f 1/-7 2/0 4/1")
        mesh = whole(read(write(tmp_path, text, "map.obj"), findings))
        assert len(mesh.triangles) == 4
        assert "3 corners have texture coordinates that are not there" in told(findings)

    @pytest.mark.parametrize(
        ("text", "name"),
        [
            (OBJ.replace("v 2 0 -0", "v 2,5 0,0 0,0"), "map.obj"),
            (PLY.replace("2 0 0\n", "2,5 0,0 0,0\n"), "map.ply"),
            (STL.replace("2 0 0", "2,5 0,0 0,0"), "map.stl"),
        ],
    )
    def test_decimal_commas(self, tmp_path: Path, text: str, name: str) -> None:
        """In these formats only space separates, so a comma is that of a decimal number."""
        found = whole(read(write(tmp_path, text, name)))
        assert found.vertices.max(axis=0) == pytest.approx([2.5, 1.0, 3.0])

    @pytest.mark.parametrize(
        ("text", "name"),
        [
            (OBJ + "v -1.#IND00 1.#QNAN nan(ind)\nvt -1.#IND00 0\nf 1 2 5\n", "map.obj"),
            (PLY.replace("vertex 4", "vertex 5").replace("face 4", "face 5").replace(
                "0 0 3\n", "0 0 3\n-1.#IND 0 0\n") + "7 3 0 1 4\n", "map.ply"),
            (STL.replace("endsolid", NO_FACET), "map.stl"),
        ],
    )  # fmt: skip
    def test_values_that_are_none(self, tmp_path: Path, text: str, name: str) -> None:
        """What C prints for none is NaN: the triangle goes, the mesh stays."""
        report = import_map(Request(write(tmp_path, text, name))).report
        assert sorted(report.extents or ()) == pytest.approx([1.0, 2.0, 3.0])
        assert report.totals["triangles dropped"] == 1

    @pytest.mark.parametrize(
        ("old", "new"),
        [
            ("3 0 2 1", "3.0 0.0 2.0 1.0"),
            ("vertex 4", "vertex 4.0"),
            ("list uchar int", "list float float"),
            ("list uchar int", "list double double"),
        ],
    )
    def test_floats_where_ply_says_int(self, tmp_path: Path, old: str, new: str) -> None:
        """Counts and indices may be floats, if they are whole."""
        assert old in PLY
        found = whole(read(write(tmp_path, PLY.replace(old, new), "map.ply")))
        assert len(found.triangles) == 4
        refused(write(tmp_path, PLY.replace("3 0 2 1", "3.5 0.0 2.0 1.0"), "b.ply"))

    @pytest.mark.parametrize("count", [3.0, float("nan"), float("inf"), -1.0, 1e30])
    def test_float_counts_of_binary_ply(self, tmp_path: Path, count: float) -> None:
        """Lengths of lists as floats are read; those that make no sense are refused."""
        head = PLY.partition("end_header")[0].replace("ascii", "binary_little_endian")
        head = head.replace("list uchar int", "list float float") + "end_header\n"
        body = b"".join(struct.pack("<ffd", *point) for point in WEDGE.tolist())
        body += b"".join(struct.pack("<B4f", 7, count, *face) for face in FACES.tolist())
        path = tmp_path / "map.ply"
        path.write_bytes(head.encode() + body)
        if count == 3.0:
            assert len(whole(read(path)).triangles) == 4
        else:
            assert "map.ply" in refused(path)


class TestUnreal:
    """T3D; the engine reads a number as far as it goes."""

    def scene(self, folder: Path, *actors: str) -> Scene:
        """A room with actors."""
        return read(write(folder, level(room(), *actors), "map.t3d"))

    def test_a_lamp_of_bad_numbers(self, tmp_path: Path) -> None:
        """What makes no sense is as if it were not there."""
        bad = "Radius=-1.#IND\nBrightness=nan\nDrawScale=1.#QNAN\nLightColor=(B=x,G=1.#INF,R=255)"
        found, plain = (
            self.scene(tmp_path, actor("PointLight", "L", (0, 0, 100), text))
            for text in (bad, "LightColor=(R=255)")
        )
        assert found.lights == plain.lights
        assert isinstance(found.lights[0], Light)

    def test_decimal_commas(self, tmp_path: Path) -> None:
        """In `(X=100,5,Y=20)` and `DrawScale=1,5` a comma can be nothing else."""
        text = start("S", (0, 0, 60)).replace("(X=0,Y=0,Z=60)", "(X=250,5,Y=20,25,Z=60,0)")
        scene = self.scene(tmp_path, text, actor("MaleVictim", "V", (0, 0, 0), "DrawScale=1,5"))
        assert scene.starts[0].pose.position == pytest.approx((1.002, -0.081, 0.24))
        assert scene.victims[0].scale == pytest.approx(1.5)

    def test_ase(self, tmp_path: Path) -> None:
        """Modellers write `-1.#IND` for places and texture places that they do not know."""
        text = (
            "*3DSMAX_ASCIIEXPORT 200\n*GEOMOBJECT {\n*MESH {\n*MESH_VERTEX_LIST {\n"
            "*MESH_VERTEX 0 0 0 0\n*MESH_VERTEX 1 500 0 0\n*MESH_VERTEX 2 0 500 0\n"
            "*MESH_VERTEX 3 -1.#IND00 1.#QNAN 0\n}\n*MESH_TVERTLIST {\n"
            "*MESH_TVERT 0 -1.#IND00 0 0\n}\n*MESH_FACE_LIST {\n*MESH_FACE 0: A: 0 B: 1 C: 2\n"
            "*MESH_FACE 1: A: 0 B: 1 C: 3\n}\n}\n}\n"
        )
        report = import_map(Request(write(tmp_path, text, "map.ase"))).report
        assert report.extents == pytest.approx((2.0, 2.0, 0.0))
        assert report.totals["triangles dropped"] == 1

    def test_a_corner_that_is_none(self, tmp_path: Path, findings: Findings) -> None:
        """A polygon with such a corner is left out, its brush is there."""
        text = room().replace("+00500.000000", "1.#QNAN", 1)
        scene = read(write(tmp_path, level(text, start("S", (0, 0, 60))), "map.t3d"), findings)
        assert len(scene.brushes[0].polygons) == 5
        assert "a broken polygon was left out" in told(findings)


STAGE = '#usda 1.0\n(\n upAxis = "Z"\n metersPerUnit = {}\n)\ndef Cube "Box"\n{{\n}}\n{}\n'


class TestUsd:
    """Stages."""

    def test_lights_bodies_and_cameras(
        self, tmp_path: Path, capfd: pytest.CaptureFixture[str]
    ) -> None:
        """A lamp at no place is left out, a colour or a mass that is none has its default."""
        pytest.importorskip("pxr", reason="usd-core is not installed: pip install usd-core")
        place = (
            "double3 xformOp:translate = ({}, 0, 1)\n"
            'uniform token[] xformOpOrder = ["xformOp:translate"]\n'
        )
        nowhere = place.format("nan")
        more = (
            f'def SphereLight "Lost" {{\n{nowhere}}}\ndef Xform "Cam" {{\n{nowhere}}}\n'
            'def SphereLight "L" {\nfloat inputs:intensity = nan\n'
            "color3f inputs:color = (nan, 1, 1)\n}\n"
            'def Cube "B" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])\n'
            f"{{\nfloat physics:mass = nan\n{place.format(5)}}}\n"
        )
        findings = Findings()
        with warnings.catch_warnings(record=True) as noise:
            warnings.simplefilter("always")
            scene = read(write(tmp_path, STAGE.format(1, more), "map.usda"), findings)
        assert not noise
        assert [light.name for light in scene.lights] == ["L"]
        assert np.isfinite([*scene.lights[0].color, scene.lights[0].brightness]).all()
        assert {thing.name: thing.mass for thing in scene.objects} == {"Box": None, "B": None}
        assert "Lost: a light at no place was left out" in told(findings)
        assert capfd.readouterr() == ("", "")

    def test_an_operation_of_another_type(self, tmp_path: Path) -> None:
        """A thing that is moved by what is no place is left out; the others are there."""
        pytest.importorskip("pxr", reason="usd-core is not installed: pip install usd-core")
        more = (
            'def Cube "Odd" {\nstring xformOp:translate = "far"\n'
            'uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
        )
        scene = read(write(tmp_path, STAGE.format(1, more), "map.usda"))
        assert [thing.name for thing in scene.objects] == ["Box"]

    def test_units_of_single_precision(self, tmp_path: Path) -> None:
        """`metersPerUnit` stored as a float, which the library itself refuses."""
        pytest.importorskip("pxr", reason="usd-core is not installed: pip install usd-core")
        from pxr import Sdf

        text = write(tmp_path, STAGE.format(0.5, ""), "text.usda")
        path = tmp_path / "map.usdc"
        Sdf.Layer.FindOrOpen(str(text)).Export(str(path))
        double, single = (struct.pack("<fHBB", 0.5, 0, kind, 0x40) for kind in (9, 8))
        content = path.read_bytes()
        assert content.count(double) == 1
        path.write_bytes(content.replace(double, single))
        scene = read(path)
        assert scene.source.units_per_metre == 2.0
        assert not scene.source.assumed

    def test_a_hundredth_of_single_precision(self) -> None:
        """Seven digits of 0.01 are 0.01."""
        from usarsim_maps.usd.usd import _unit

        assert _unit(float(np.float32(0.01)), Path("a"), Context()) == 0.01
        assert _unit(0.0254, Path("a"), Context()) == 0.0254
        assert _unit(1, Path("a"), Context()) == 1.0
