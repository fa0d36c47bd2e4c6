"""Gazebo worlds: shapes, meshes, poses, bad files (worlds reference 8 and 13, item 48)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from built_worlds import build_world
from mesh_samples import WEDGE, dae, dae_wedge, read, refusal, volume, whole
from PIL import Image
from sdf_samples import (
    BOX,
    MESH,
    load,
    matrix,
    model,
    only,
    sdf,
    shape,
    world,
    write,
    write_model,
)

from usarsim_maps.findings import Findings
from usarsim_maps.gazebo import models as gazebo_models
from usarsim_maps.scene import Box, Capsule, Collision, Cylinder, Plane, Sphere
from usarsim_server.simulation.frames import rpy_from_quaternion


class TestShapes:
    """Geometries."""

    def test_primitives(self, tmp_path: Path) -> None:
        """Boxes, balls, cylinders, capsules and planes are what they are."""
        shapes = {
            "<box><size>1 2 3</size></box>": Box((1.0, 2.0, 3.0)),
            "<sphere><radius>0.5</radius></sphere>": Sphere(0.5),
            "<cylinder><radius>0.5</radius><length>2</length></cylinder>": Cylinder(0.5, 2.0),
            "<capsule><radius>0.5</radius><length>2</length></capsule>": Capsule(0.5, 2.0),
            "<plane><size>8 9</size></plane>": Plane((8.0, 9.0)),
        }
        for text, expected in shapes.items():
            thing = only(load(tmp_path, model("m", shape(text))))
            (part,) = thing.parts
            assert part.shape == expected
            assert part.visible
            assert part.collision is Collision.AUTO

    def test_scale_of_the_user(self, tmp_path: Path) -> None:
        """Poses and sizes shrink together."""
        inner = model("m", shape("<box><size>1 2 3</size></box>", "10 0 0 0 0 0"))
        thing = only(load(tmp_path, inner, scale=10.0))
        assert thing.parts[0].shape == Box((0.1, 0.2, 0.30000000000000004))
        assert matrix(thing)[:3, 3] == pytest.approx([1.0, 0.0, 0.0])

    def test_ellipsoid_cone_and_polyline(self, tmp_path: Path) -> None:
        """Rarer shapes become meshes of their volume, facing outwards."""
        volumes = {
            "<ellipsoid><radii>1 2 3</radii></ellipsoid>": 8.0 * math.pi,
            "<cone><radius>1</radius><length>3</length></cone>": math.pi,
            "<polyline><height>2</height><point>0 0</point><point>0 2</point><point>1 1</point>"
            "<point>2 2</point><point>2 0</point></polyline>": 6.0,
        }
        for text, expected in volumes.items():
            found = volume(whole(load(tmp_path, model("m", shape(text)))))
            assert found == pytest.approx(expected, rel=0.08), text

    def test_a_tilted_plane(self, tmp_path: Path) -> None:
        """The normal of a plane turns it."""
        text = "<plane><normal>1 0 0</normal><size>1 1</size></plane>"
        thing = only(load(tmp_path, model("m", shape(text))))
        assert matrix(thing)[:3, 2] == pytest.approx([1.0, 0.0, 0.0])

    def test_collision_apart_from_visual(self, tmp_path: Path) -> None:
        """Where they differ, one is only seen and the other only felt (worlds 9.4)."""
        inner = (
            '<visual name="v"><geometry><box><size>1 1 1</size></box></geometry></visual>'
            '<collision name="c"><geometry><box><size>1 1 2</size></box></geometry></collision>'
        )
        seen, felt = only(load(tmp_path, model("m", inner))).parts
        assert (seen.visible, seen.collision) == (True, Collision.NONE)
        assert (felt.visible, felt.collision) == (False, Collision.AUTO)

    def test_a_plane_is_one_part(self, tmp_path: Path) -> None:
        """The drawn size of a ground plane differs from that of its collision as a rule."""
        inner = (
            '<visual name="v"><geometry><plane><size>5 5</size></plane></geometry></visual>'
            '<collision name="c"><geometry><plane><normal>0 0 1</normal><size>100 100</size>'
            "</plane></geometry></collision>"
        )
        (part,) = only(load(tmp_path, model("m", inner))).parts
        assert part.shape == Plane((5.0, 5.0))
        assert part.collision is Collision.AUTO

    def test_height_map(self, tmp_path: Path, findings: Findings) -> None:
        """A picture becomes terrain: its top edge is at the highest y, white at full height."""
        Image.fromarray(np.array([[255, 0, 0], [0, 0, 0], [0, 0, 51]], np.uint8)).save(
            tmp_path / "hill.png"
        )
        text = (
            "<heightmap><uri>file://hill.png</uri><size>4 4 10</size><pos>0 0 1</pos></heightmap>"
        )
        scene = load(tmp_path, model("hill", shape(text)), findings)
        (field,) = scene.heightfields
        assert field.heights[2].tolist() == [10.0, 0.0, 0.0]
        assert field.heights[0].tolist() == [0.0, 0.0, 2.0]
        assert field.pose.position == (-2.0, -2.0, 1.0)
        assert field.spacing == (2.0, 2.0)


class TestMeshes:
    """Mesh files (worlds 43, 48)."""

    def inner(self, scale: str = "1 1 1", uri: str = "model://thing/meshes/w.dae") -> str:
        """A model with a mesh."""
        return model("m", shape(f"<mesh><uri>{uri}</uri><scale>{scale}</scale></mesh>"))

    def folder(self, tmp_path: Path) -> Path:
        """A model with a mesh file."""
        write(tmp_path, MESH, "thing/meshes/w.dae")
        return tmp_path

    def test_scale_per_axis_and_negative(self, tmp_path: Path) -> None:
        """Scales may differ by axis and reflect; faces look outwards (worlds 48)."""
        mesh = whole(load(self.folder(tmp_path), self.inner("2 -1 0.5")))
        assert volume(mesh) == pytest.approx(1.0)
        assert mesh.vertices.min(axis=0) == pytest.approx([0.0, -1.0, 0.0])
        assert mesh.vertices.max(axis=0) == pytest.approx([4.0, 0.0, 1.5])

    def test_the_unit_counts_and_the_axes_do_not(self, tmp_path: Path) -> None:
        """Gazebo applies a mesh's unit and ignores its up axis (worlds 7)."""
        asset = '<unit meter="0.1"/><up_axis>Y_UP</up_axis>'
        write(tmp_path, dae(dae_wedge(), asset=asset), "thing/meshes/w.dae")
        mesh = whole(load(tmp_path, self.inner()))
        assert mesh.vertices.max(axis=0) == pytest.approx(WEDGE.max(axis=0) / 10.0)

    def test_copies_share_the_mesh(self, tmp_path: Path) -> None:
        """A mesh file is read once for all models."""
        text = self.inner() + self.inner().replace('name="m"', 'name="n"')
        one, other = load(self.folder(tmp_path), text).objects
        assert one.parts[0].shape is other.parts[0].shape

    def test_submesh(self, tmp_path: Path) -> None:
        """A named part of a mesh file, centred on request."""
        nodes = (
            '<node name="A"><instance_geometry url="#g"/></node>'
            '<node name="B"><translate>9 0 0</translate><instance_geometry url="#g"/></node>'
        )
        write(tmp_path, dae(dae_wedge(), nodes), "thing/meshes/w.dae")
        part = "<submesh><name>B</name><center>true</center></submesh>"
        text = self.inner().replace("<scale>", part + "<scale>")
        mesh = whole(load(tmp_path, text))
        assert len(mesh.triangles) == 4
        assert mesh.vertices.max(axis=0) == pytest.approx(WEDGE.max(axis=0) / 2.0)

    @pytest.mark.parametrize("uri", ["model://gone/w.dae", "model://thing/meshes/w.blend"])
    def test_missing_and_unknown(self, tmp_path: Path, uri: str, findings: Findings) -> None:
        """A mesh that cannot be had is a finding; placeholders stand in on request (worlds 70)."""
        write(tmp_path, "nothing", "thing/meshes/w.blend")
        text = self.inner(uri=uri) + model("other", BOX)
        assert only(load(tmp_path, text, findings)).name == "other"
        assert findings.missing_list() or findings.warnings()
        assert len(load(tmp_path, text, placeholders=True).objects) == 2

    def test_a_broken_mesh_is_a_warning(self, tmp_path: Path, findings: Findings) -> None:
        """One bad mesh does not stop a world; the warning names file and line."""
        write(tmp_path, MESH[:500], "thing/meshes/w.dae")
        assert len(load(tmp_path, self.inner() + model("b", BOX), findings).objects) == 1
        assert any("w.dae: line" in warning.text for warning in findings.warnings())

    def test_lost_capitals(self, tmp_path: Path) -> None:
        """Capitals of folders and files do not matter."""
        text = self.inner(uri="model://THING/Meshes/W.DAE")
        assert volume(whole(load(self.folder(tmp_path), text))) == pytest.approx(1.0)

    def test_no_way_out_of_a_model(self, tmp_path: Path, findings: Findings) -> None:
        """`..` in a model URI leads nowhere."""
        load(self.folder(tmp_path), self.inner(uri="model://thing/../thing/meshes/w.dae")
             + model("b", BOX), findings)  # fmt: skip
        assert findings.missing_list()


class TestPoses:
    """Frames (worlds 48)."""

    def test_model_link_and_shape(self, tmp_path: Path) -> None:
        """Poses compose from model over link to shape; angles are roll, pitch, yaw."""
        inner = (
            '<model name="m"><static>1</static><pose>10 0 0 0 0 1.5707963267948966</pose>'
            '<link name="l"><pose>1 0 0 0 0 0</pose>'
            + shape("<box><size>1 1 1</size></box>", "0 0 2 0.5 0 0")
            + "</link></model>"
        )
        thing = only(load(tmp_path, inner))
        found = matrix(thing)
        assert found[:3, 3] == pytest.approx([10.0, 1.0, 2.0])
        assert thing.pose.position == pytest.approx((10.0, 0.0, 0.0))
        turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ np.array(
            [[1, 0, 0], [0, math.cos(0.5), -math.sin(0.5)], [0, math.sin(0.5), math.cos(0.5)]]
        )
        assert np.allclose(found[:3, :3], turn)

    def test_nested_includes(self, tmp_path: Path) -> None:
        """Includes in models in includes compose; an include's pose replaces the model's own."""
        write_model(tmp_path, "leg", sdf(
            '<model name="leg"><pose>99 0 0 0 0 0</pose><link name="l">' + BOX + "</link></model>"
        ))  # fmt: skip
        write_model(tmp_path, "table", sdf(
            '<model name="table"><static>true</static><include><uri>model://leg</uri>'
            "<pose>0 1 0 0 0 0</pose><name>left</name></include>"
            "<include><uri>model://leg</uri></include></model>"
        ))  # fmt: skip
        scene = load(
            tmp_path,
            "<include><uri>model://table</uri><name>T</name>"
            "<pose>5 0 0 0 0 3.141592653589793</pose></include>",
        )
        assert [thing.name for thing in scene.objects] == ["T::left", "T::leg"]
        left, other = scene.objects
        assert left.pose.position == pytest.approx((5.0, -1.0, 0.0))
        assert other.pose.position == pytest.approx((5.0 - 99.0, 0.0, 0.0))

    def test_frames_by_name(self, tmp_path: Path) -> None:
        """relative_to and attached_to are followed; so is placement_frame."""
        inner = (
            '<model name="m" placement_frame="corner"><static>1</static><pose>1 0 0 0 0 0</pose>'
            '<frame name="corner" attached_to="base"><pose>0 5 0 0 0 0</pose></frame>'
            '<link name="base"><pose>0 0 1 0 0 0</pose></link>'
            '<link name="l"><pose relative_to="corner">0 0 3 0 0 0</pose>' + BOX + "</link></model>"
        )
        assert matrix(only(load(tmp_path, inner)))[:3, 3] == pytest.approx([1.0, 0.0, 3.0])

    def test_degrees_and_quaternions(self, tmp_path: Path) -> None:
        """Other ways to write rotations."""
        for pose in (
            '<pose degrees="true">0 0 0 0 0 90</pose>',
            '<pose rotation_format="quat_xyzw">0 0 0 0 0 1 1</pose>',
        ):
            inner = model("m", BOX).replace("<static>", pose + "<static>")
            angles = rpy_from_quaternion(only(load(tmp_path, inner)).pose.quaternion)
            assert angles == pytest.approx((0.0, 0.0, math.pi / 2))

    def test_saved_state(self, tmp_path: Path) -> None:
        """Poses of a saved state override those of the models (worlds 8)."""
        state = (
            '<state world_name="default"><model name="m"><pose>7 8 9 0 0 0</pose></model></state>'
        )
        thing = only(load(tmp_path, model("m", BOX) + state))
        assert thing.pose.position == pytest.approx((7.0, 8.0, 9.0))

    def test_mirror_and_axes(self, tmp_path: Path) -> None:
        """--mirror reflects the world, --up turns it."""
        inner = model("m", shape("<box><size>1 1 1</size></box>", "1 2 3 0 0 0"))
        assert matrix(only(load(tmp_path, inner, mirror=True)))[:3, 3] == pytest.approx([1, -2, 3])
        assert matrix(only(load(tmp_path, inner, up="Y")))[:3, 3] == pytest.approx([1, -3, 2])


class TestBadFiles:
    """Errors."""

    @pytest.mark.parametrize(
        ("text", "told"),
        [
            (world("<model name='m'>"), "line "),
            (world(model("m", BOX))[:200], "line "),
            ("<house/>", "<house> is no Gazebo world"),
            ("<!DOCTYPE a [<!ENTITY b 'c'>]>" + world(""), "entities"),
            (world(""), "no geometry"),
        ],
    )
    def test_what_is_wrong(self, tmp_path: Path, text: str, told: str) -> None:
        """Errors name file and line (worlds 73)."""
        path = write(tmp_path, text)

        def run() -> object:
            return build_world(tmp_path, read(path))

        message = refusal(run)
        assert "map.world" in message
        assert told in message

    def test_includes_in_a_circle(self, tmp_path: Path) -> None:
        """A model that includes itself, at once or through another, is refused."""
        include = "<include><uri>model://{}</uri></include>"
        write_model(tmp_path, "a", sdf(f'<model name="a">{include.format("b")}</model>'))
        write_model(tmp_path, "b", sdf(f'<model name="b">{include.format("a")}</model>'))
        message = refusal(lambda: load(tmp_path, include.format("a")))
        assert "includes itself" in message

    def test_frames_in_a_circle(self, tmp_path: Path) -> None:
        """Frames that refer to each other are refused."""
        inner = (
            '<model name="m"><frame name="a"><pose relative_to="b"/></frame>'
            '<frame name="b" attached_to="a"/><link name="l"><pose relative_to="a">0 0 0 0 0 0'
            f"</pose>{BOX}</link></model>"
        )
        assert "refer to each other" in refusal(lambda: load(tmp_path, inner))

    def test_too_many_models(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Includes that double at every level end in an error, not in a full memory."""
        monkeypatch.setattr(gazebo_models, "MAX_MODELS", 500)
        for k in range(12):
            twice = f"<include><uri>model://m{k + 1}</uri></include>" * 2
            write_model(tmp_path, f"m{k}", sdf(f'<model name="m{k}">{twice}</model>'))
        message = refusal(lambda: load(tmp_path, "<include><uri>model://m0</uri></include>"))
        assert "more than 500 models" in message
