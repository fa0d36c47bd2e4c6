"""Gazebo worlds and models (worlds reference 8 and 13, items 29, 48 to 50)."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from built_worlds import build_world
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_samples import WEDGE, damages, read, refusal, survives, volume, whole
from numpy.typing import NDArray
from PIL import Image
from test_importers_collada import document as dae
from test_importers_collada import wedge

from usarsim_server.importers import gazebo_models
from usarsim_server.importers.findings import Findings
from usarsim_server.importers.gazebo_files import model_name
from usarsim_server.importers.gazebo_looks import named_color, read_script
from usarsim_server.importers.gazebo_places import person_words, read_placement
from usarsim_server.importers.scene import (
    Box,
    Capsule,
    Collision,
    Cylinder,
    LightKind,
    Material,
    Mesh,
    Plane,
    Scene,
    SceneObject,
    Sphere,
)
from usarsim_server.simulation.frames import rpy_from_quaternion

Array = NDArray[np.float64]

MESH = dae(wedge(), asset="<up_axis>Z_UP</up_axis>")


def sdf(inner: str, version: str = "1.6") -> str:
    """A file."""
    return f'<?xml version="1.0"?>\n<sdf version="{version}">\n{inner}\n</sdf>\n'


def world(inner: str) -> str:
    """A world."""
    return sdf(f'<world name="default">\n{inner}\n</world>')


def shape(geometry: str, pose: str = "", more: str = "") -> str:
    """A visual and a collision of one shape."""
    place = f"<pose>{pose}</pose>" if pose else ""
    return (
        f'<visual name="v">{place}<geometry>{geometry}</geometry>{more}</visual>'
        f'<collision name="c">{place}<geometry>{geometry}</geometry></collision>'
    )


BOX = shape("<box><size>1 2 3</size></box>")


def model(name: str, inner: str, static: bool = True) -> str:
    """A model of one link."""
    return (
        f'<model name="{name}"><static>{str(static).lower()}</static>'
        f'<link name="link">{inner}</link></model>'
    )


def write(folder: Path, text: str, name: str = "map.world") -> Path:
    """A file, with the folders above it."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def write_model(folder: Path, name: str, text: str, config: bool = True) -> Path:
    """A model's folder."""
    if config:
        manifest = f'<model><name>{name}</name><sdf version="1.5">model.sdf</sdf></model>'
        write(folder, manifest, f"{name}/model.config")
    return write(folder, text, f"{name}/model.sdf")


def load(folder: Path, inner: str, findings: Findings | None = None, **options: object) -> Scene:
    """A world of elements."""
    return read(write(folder, world(inner)), findings, **options)


def only(scene: Scene) -> SceneObject:
    """The one object."""
    assert len(scene.objects) == 1
    return scene.objects[0]


def matrix(thing: SceneObject, part: int = 0) -> Array:
    """Where a part is in the world."""
    base = np.eye(4)
    base[:3, :3] = thing.pose.matrix()
    base[:3, 3] = thing.pose.position
    answer: Array = base @ thing.parts[part].matrix
    return answer


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
        """Where they differ, one is only seen and the other only felt (reference 9.4)."""
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

    def test_height_map(self, tmp_path: Path) -> None:
        """A picture becomes terrain: its top edge is at the highest y, white at full height."""
        Image.fromarray(np.array([[255, 0, 0], [0, 0, 0], [0, 0, 51]], np.uint8)).save(
            tmp_path / "hill.png"
        )
        text = (
            "<heightmap><uri>file://hill.png</uri><size>4 4 10</size><pos>0 0 1</pos></heightmap>"
        )
        findings = Findings()
        scene = load(tmp_path, model("hill", shape(text)), findings)
        (field,) = scene.heightfields
        assert field.heights[2].tolist() == [10.0, 0.0, 0.0]
        assert field.heights[0].tolist() == [0.0, 0.0, 2.0]
        assert field.pose.position == (-2.0, -2.0, 1.0)
        assert field.spacing == (2.0, 2.0)


class TestMeshes:
    """Mesh files (items 43, 48)."""

    def inner(self, scale: str = "1 1 1", uri: str = "model://thing/meshes/w.dae") -> str:
        """A model with a mesh."""
        return model("m", shape(f"<mesh><uri>{uri}</uri><scale>{scale}</scale></mesh>"))

    def folder(self, tmp_path: Path) -> Path:
        """A model with a mesh file."""
        write(tmp_path, MESH, "thing/meshes/w.dae")
        return tmp_path

    def test_scale_per_axis_and_negative(self, tmp_path: Path) -> None:
        """Scales may differ by axis and reflect; faces look outwards (item 48)."""
        mesh = whole(load(self.folder(tmp_path), self.inner("2 -1 0.5")))
        assert volume(mesh) == pytest.approx(1.0)
        assert mesh.vertices.min(axis=0) == pytest.approx([0.0, -1.0, 0.0])
        assert mesh.vertices.max(axis=0) == pytest.approx([4.0, 0.0, 1.5])

    def test_the_unit_counts_and_the_axes_do_not(self, tmp_path: Path) -> None:
        """Gazebo applies a mesh's unit and ignores its up axis (reference 7)."""
        asset = '<unit meter="0.1"/><up_axis>Y_UP</up_axis>'
        write(tmp_path, dae(wedge(), asset=asset), "thing/meshes/w.dae")
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
        write(tmp_path, dae(wedge(), nodes), "thing/meshes/w.dae")
        part = "<submesh><name>B</name><center>true</center></submesh>"
        text = self.inner().replace("<scale>", part + "<scale>")
        mesh = whole(load(tmp_path, text))
        assert len(mesh.triangles) == 4
        assert mesh.vertices.max(axis=0) == pytest.approx(WEDGE.max(axis=0) / 2.0)

    @pytest.mark.parametrize("uri", ["model://gone/w.dae", "model://thing/meshes/w.blend"])
    def test_missing_and_unknown(self, tmp_path: Path, uri: str) -> None:
        """A mesh that cannot be had is a finding; placeholders stand in on request (item 70)."""
        write(tmp_path, "nothing", "thing/meshes/w.blend")
        findings = Findings()
        text = self.inner(uri=uri) + model("other", BOX)
        assert only(load(tmp_path, text, findings)).name == "other"
        assert findings.missing_list() or findings.warnings()
        assert len(load(tmp_path, text, placeholders=True).objects) == 2

    def test_a_broken_mesh_is_a_warning(self, tmp_path: Path) -> None:
        """One bad mesh does not stop a world; the warning names file and line."""
        write(tmp_path, MESH[:500], "thing/meshes/w.dae")
        findings = Findings()
        assert len(load(tmp_path, self.inner() + model("b", BOX), findings).objects) == 1
        assert any("w.dae: line" in warning.text for warning in findings.warnings())

    def test_lost_capitals(self, tmp_path: Path) -> None:
        """Capitals of folders and files do not matter."""
        text = self.inner(uri="model://THING/Meshes/W.DAE")
        assert volume(whole(load(self.folder(tmp_path), text))) == pytest.approx(1.0)

    def test_no_way_out_of_a_model(self, tmp_path: Path) -> None:
        """`..` in a model URI leads nowhere."""
        findings = Findings()
        load(self.folder(tmp_path), self.inner(uri="model://thing/../thing/meshes/w.dae")
             + model("b", BOX), findings)  # fmt: skip
        assert findings.missing_list()


class TestPoses:
    """Frames (item 48)."""

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
        """Poses of a saved state override those of the models (reference 8)."""
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


class TestModels:
    """Finding and moving them."""

    def test_built_in_models(self, tmp_path: Path) -> None:
        """sun and ground_plane are there without files; other missing ones are named (item 49)."""
        findings = Findings()
        uris = ("sun", "ground_plane", "fountain", "fountain")
        scene = load(
            tmp_path, "".join(f"<include><uri>model://{u}</uri></include>" for u in uris), findings
        )
        assert isinstance(only(scene).parts[0].shape, Plane)
        assert scene.lights[0].kind is LightKind.DIRECTIONAL
        assert findings.missing_list() == [("model", "model://fountain", 2)]

    def test_where_models_are_found(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Beside the world, in models/, deep in --assets, in GAZEBO_MODEL_PATH."""
        text = sdf(model("m", BOX))
        write_model(tmp_path / "map" / "models", "inside", text)
        write_model(tmp_path / "assets" / "league" / "2016", "deep", text)
        write_model(tmp_path / "path", "elsewhere", text, config=False)
        monkeypatch.setenv("GAZEBO_MODEL_PATH", f"/nowhere:{tmp_path / 'path'}")
        names = ("inside", "deep", "elsewhere")
        inner = "".join(f"<include><uri>model://{n}</uri></include>" for n in names)
        findings = Findings()
        scene = read(
            write(tmp_path, world(inner), "map/map.world"), findings, assets=(tmp_path / "assets",)
        )
        assert len(scene.objects) == 3
        assert not findings.missing_list()
        assert tmp_path / "path" / "elsewhere" / "model.sdf" in scene.source.files

    def test_the_newest_version(self, tmp_path: Path) -> None:
        """Of several SDF files in a model.config the newest is taken."""
        write(tmp_path, sdf(model("old", BOX)), "thing/a.sdf")
        write(tmp_path, sdf(model("new", BOX)), "thing/b.sdf")
        config = '<model><sdf version="1.10">b.sdf</sdf><sdf version="1.9">a.sdf</sdf></model>'
        manifest = write(tmp_path, config, "thing/model.config")
        scene = load(tmp_path, "<include><uri>model://thing</uri></include>")
        assert only(scene).name == "new"
        assert only(read(manifest)).name == "new"

    @pytest.mark.parametrize(
        ("uri", "name"),
        [
            ("model://a/b.dae", "a"),
            ("https://fuel.gazebosim.org/1.0/OpenRobotics/models/Rescue Randy/2", "Rescue Randy"),
            ("http://x.org/1.0/u/models/Car/tip/files/meshes/c.dae", "Car"),
            ("../models/tree", "tree"),
            ("things/tree/model.sdf", "tree"),
        ],
    )
    def test_names_of_uris(self, uri: str, name: str) -> None:
        """The model that a URI means."""
        assert model_name(uri) == name

    def test_static_and_movable(self, tmp_path: Path) -> None:
        """Models that are not static can be pushed, with their masses (item 29)."""
        inertial = "<inertial><mass>2.5</mass></inertial>"
        text = model("wall", BOX) + model("crate", inertial + BOX, static=False)
        wall, crate = load(tmp_path, text).objects
        assert not wall.movable
        assert crate.movable
        assert crate.mass == 2.5

    def test_an_include_makes_static(self, tmp_path: Path) -> None:
        """<static> of the include wins over the model's."""
        write_model(tmp_path, "crate", sdf(model("crate", BOX, static=False)))
        text = "<include><uri>model://crate</uri><static>{}</static></include>"
        assert not only(load(tmp_path, text.format(1))).movable
        assert only(load(tmp_path, text.format(0))).movable

    def test_joints(self, tmp_path: Path) -> None:
        """Joined links are one body, loose ones are their own, those joined to the world stay."""
        links = "".join(
            f'<link name="l{k}"><pose>{k} 0 0 0 0 0</pose>{BOX}<inertial><mass>1</mass></inertial>'
            "</link>"
            for k in range(4)
        )
        joints = (
            '<joint name="a" type="revolute"><parent>l0</parent><child>l1</child></joint>'
            '<joint name="b" type="fixed"><parent>world</parent><child>l3</child></joint>'
        )
        findings = Findings()
        scene = load(tmp_path, f'<model name="m">{links}{joints}</model>', findings)
        found = {t.name: (t.movable, t.mass, len(t.parts)) for t in scene.objects}
        assert found == {
            "m::l0": (True, 2.0, 2),
            "m::l2": (True, 1.0, 1),
            "m::l3": (False, None, 1),
        }
        assert "stiff" in findings.warnings()[0].text

    def test_friction(self, tmp_path: Path) -> None:
        """mu is kept, within reason."""
        for mu, expected in ((0.3, 0.3), (1e15, 2.0)):
            surface = f"<surface><friction><ode><mu>{mu}</mu></ode></friction></surface>"
            text = model("m", BOX.replace("</collision>", surface + "</collision>"))
            assert only(load(tmp_path, text)).friction == expected

    def test_pushing(self, tmp_path: Path) -> None:
        """In the built world a movable box falls onto the floor and a static one hangs (29)."""
        ground = "<include><uri>model://ground_plane</uri></include>"
        place = "<pose>{} 0 5 0 0 0</pose>"
        loose = model("loose", BOX, static=False).replace("<link", place.format(0) + "<link", 1)
        fixed = model("fixed", BOX).replace("<link", place.format(8) + "<link", 1)
        built = build_world(tmp_path, load(tmp_path, ground + loose + fixed))
        data = mujoco.MjData(built.model)
        for _ in range(1500):
            mujoco.mj_step(built.model, data)
        assert data.body("loose").xpos[2] == pytest.approx(1.5, abs=0.02)
        assert data.geom("fixed").xpos[2] == 5.0
        assert {t.name: t.movable for t in built.description.objects} == {
            "ground_plane": False,
            "loose": True,
            "fixed": False,
        }


class TestLooks:
    """Colours, pictures, scripts."""

    def material(self, folder: Path, text: str) -> Material:
        """The material of a box."""
        visual = shape("<box><size>1 1 1</size></box>", more=text)
        scene = load(folder, model("m", visual))
        return scene.materials[only(scene).parts[0].materials[0]]

    def test_colour_and_transparency(self, tmp_path: Path) -> None:
        """diffuse is the colour, transparency takes from its opacity."""
        text = (
            "<material><ambient>0 0 0 1</ambient><diffuse>0.1 0.2 0.3 1</diffuse></material>"
            "<transparency>0.25</transparency>"
        )
        assert self.material(tmp_path, text).color == (0.1, 0.2, 0.3, 0.75)

    def test_gazebos_own_names(self, tmp_path: Path) -> None:
        """Names of gazebo.material have their colours; unknown ones are grey."""
        script = "<material><script><name>Gazebo/{}</name></script></material>"
        assert self.material(tmp_path, script.format("SkyBlue")).color[2] > 0.6
        assert named_color("Gazebo/RedTransparent") == (1.0, 0.0, 0.0, 0.5)
        assert named_color("My/Own") == (0.7, 0.7, 0.7, 1.0)

    def test_scripts_of_models(self, tmp_path: Path) -> None:
        """A script's picture is found in the model's textures."""
        text = (
            "material Shop/Wood { technique { pass { diffuse 0 0 0 1\n"
            "texture_unit { texture Plank.png } } } }"
        )
        write(tmp_path, text, "shop/materials/scripts/shop.material")
        (tmp_path / "shop/materials/textures").mkdir()
        Image.new("RGB", (2, 2)).save(tmp_path / "shop/materials/textures/plank.png")
        script = (
            "<material><script><uri>model://shop/materials/scripts</uri>"
            "<uri>model://shop/materials/textures</uri><name>Shop/Wood</name></script></material>"
        )
        found = self.material(tmp_path, script)
        assert found.texture == tmp_path / "shop/materials/textures/plank.png"
        assert found.color == (1.0, 1.0, 1.0, 1.0)

    def test_scripts_inherit(self) -> None:
        """A material may begin as a copy of another; comments do not count."""
        text = (
            "// material No\nmaterial A\n{\n diffuse 1 0 0 /* texture no.png */\n}\n"
            "material B : A\n{\n  texture_unit\n {\n texture b.png\n }\n}\n"
        )
        assert read_script(text) == {"A": ((1, 0, 0, 1), ""), "B": ((1, 0, 0, 1), "b.png")}

    def test_equal_names_of_materials(self, tmp_path: Path) -> None:
        """Materials of two mesh files with one name stay two."""
        looks = (
            '<library_effects><effect id="fx"><profile_COMMON><technique><phong><diffuse><color>'
            "{} 0 0 1</color></diffuse></phong></technique></profile_COMMON></effect>"
            '</library_effects><library_materials><material id="paint"><instance_effect url="#fx"/>'
            "</material></library_materials>"
        )
        bound = (
            '<node><instance_geometry url="#g"><bind_material><technique_common>'
            '<instance_material symbol="s" target="#paint"/></technique_common></bind_material>'
            "</instance_geometry></node>"
        )
        text = ""
        for name, red in (("a", "1"), ("b", "0.5")):
            body = wedge().replace("<triangles ", '<triangles material="s" ')
            write(tmp_path, dae(body, bound, more=looks.format(red)), f"{name}.dae")
            text += model(name, shape(f"<mesh><uri>{name}.dae</uri></mesh>"))
        scene = load(tmp_path, text)
        names = []
        for thing in scene.objects:
            mesh = thing.parts[0].shape
            assert isinstance(mesh, Mesh)
            names.append(thing.parts[0].materials.get(0, mesh.materials[0]))
        assert [scene.materials[name].color[0] for name in names] == [1.0, 0.5]

    def test_lights(self, tmp_path: Path) -> None:
        """Point and spot lights keep place, direction, colour and reach (item 76)."""
        text = (
            '<light type="spot" name="S"><pose>1 2 3 0 1.5707963267948966 0</pose>'
            "<diffuse>0.5 0.25 0 1</diffuse><direction>0 0 -1</direction>"
            "<attenuation><range>12</range></attenuation><spot><outer_angle>1</outer_angle></spot>"
            "</light>"
        )
        (light,) = load(tmp_path, text + model("m", BOX)).lights
        assert light.kind is LightKind.SPOT
        assert light.position == (1.0, 2.0, 3.0)
        assert light.direction == pytest.approx((-1.0, 0.0, 0.0))
        assert light.color == (1.0, 0.5, 0.0)
        assert light.brightness == 0.5
        assert light.reach == 12.0
        assert light.cone == pytest.approx(math.degrees(0.5))

    def test_many_suns(self, tmp_path: Path) -> None:
        """Suns that add up to more than white are dimmed together; one from each side is not."""
        sun = '<light type="directional" name="s{}"><diffuse>1 1 1 1</diffuse><direction>{}' \
              "</direction></light>"  # fmt: skip
        above = "".join(sun.format(k, "0 0 -1") for k in range(5))
        lights = load(tmp_path, above + model("m", BOX)).lights
        assert sum(light.brightness for light in lights) == pytest.approx(0.6)
        around = "".join(sun.format(k, way) for k, way in enumerate(("1 0 0", "-1 0 0", "0 0 -1")))
        lights = load(tmp_path, around + model("m", BOX)).lights
        assert [light.brightness for light in lights] == pytest.approx([0.6] * 3)


class TestPlaces:
    """Start poses and people (item 50)."""

    PLUGIN = (
        '<plugin name="USARGazebo" filename="x.so"><StartPose_1>Gate 1.5,-2,0.3  0,0,3.14'
        "</StartPose_1><StartPose_2>Roof 1,2,3</StartPose_2></plugin>"
    )

    def test_start_poses(self, tmp_path: Path) -> None:
        """Elements of the plug-in are start poses in the simulation's frame (item 50)."""
        first, second = load(tmp_path, self.PLUGIN + model("m", BOX)).starts
        assert first.name == "Gate"
        assert first.pose.position == (1.5, -2.0, 0.3)
        assert rpy_from_quaternion(first.pose.quaternion)[2] == pytest.approx(3.14)
        assert (second.name, second.pose.position) == ("Roof", (1.0, 2.0, 3.0))

    def test_on_the_wire(self, tmp_path: Path) -> None:
        """Clients are told the same place with y and z turned round (items 27, 50)."""
        scene = load(tmp_path, self.PLUGIN + "<include><uri>model://ground_plane</uri></include>")
        start = build_world(tmp_path, scene).description.starts[0]
        assert start.tag == "Gate"
        assert start.pose.position == pytest.approx((1.5, -2.0, 0.3))

    def test_starts_in_a_comment(self, tmp_path: Path) -> None:
        """A plug-in that was switched off still tells the starts, with a warning."""
        findings = Findings()
        scene = load(tmp_path, f"<!-- {self.PLUGIN} -->" + model("m", BOX), findings)
        assert [start.name for start in scene.starts] == ["Gate", "Roof"]
        assert "comment" in findings.warnings()[0].text

    def test_a_start_without_sense(self, tmp_path: Path) -> None:
        """What is no start pose is a warning."""
        findings = Findings()
        text = "<plugin name='p'><StartPose_1>Gate here</StartPose_1></plugin>"
        assert not load(tmp_path, text + model("m", BOX), findings).starts
        assert "no start pose" in findings.warnings()[0].text

    FILE = (
        "# Day 1\n * Map_hall.world\n\n  Victim1 : 5 6 0 1.57 0 0\n"
        "  StartPoint1 :  1.0 -2.0 0.3 (first)\n"
        "# Day 2\n * Map_yard.world\n  Victim1 : -5, 6, 0, 1.57, 0, 0\n"
        "  StartPoint1 : 2 2 0.3 0 0 1.57\n  StartPoint2 : 3 2 0.3 0 0 0 (base)\n"
    )

    def test_placement_file(self, tmp_path: Path) -> None:
        """Sections of a text file beside the worlds: titles, starts, victims."""
        one, two = read_placement(write(tmp_path, self.FILE, "_Placement.txt"))
        assert (one.title, two.title) == ("Day 1", "Day 2")
        assert one.starts[0].pose.position == (1.0, -2.0, 0.3)
        assert [start.name for start in two.starts] == ["StartPoint1", "StartPoint2"]
        assert two.victims[0].pose.position == (-5.0, 6.0, 0.0)

    def test_the_section_by_title(self, tmp_path: Path) -> None:
        """The section whose title ends the world's name gives starts and victims."""
        write(tmp_path, self.FILE, "_Placement.txt")
        path = write(tmp_path, world(model("m", BOX)), "Finals_Day2.world")
        scene = read(path)
        assert len(scene.starts) == 2
        assert scene.victims[0].pose.position[0] == -5.0

    def test_the_section_by_victims(self, tmp_path: Path) -> None:
        """Where no title fits, victims at the same places tell the section; else none is taken."""
        write(tmp_path, self.FILE, "_Placement.txt")
        person = (
            "<include><uri>model://victim</uri><name>V1</name><pose>{} 6 0 0 0 0</pose></include>"
        )
        scene = load(tmp_path, person.format(5) + model("m", BOX))
        assert scene.starts[0].pose.position == (1.0, -2.0, 0.3)
        assert [victim.name for victim in scene.victims] == ["V1"]
        assert not load(tmp_path, person.format(50) + model("m", BOX)).starts

    @pytest.mark.parametrize(
        ("words", "expected"),
        [
            (("victimWoman",), (True, "female", None)),
            (("Rescue Randy Sitting",), (True, "male", "sitting")),
            (("person_standing",), (True, "male", "standing")),
            (("Wall", "model3"), (False, "male", None)),
            (("humanoid_shelf",), (False, "male", None)),
        ],
    )
    def test_names_of_people(
        self, words: tuple[str, ...], expected: tuple[bool, str, str | None]
    ) -> None:
        """Models are people by whole words in their names."""
        assert person_words(*words) == expected

    @pytest.mark.parametrize(("roll", "posture"), [(0.0, "standing"), (1.5708, "lying")])
    def test_people(self, tmp_path: Path, roll: float, posture: str) -> None:
        """A figure 1.7 m high stands; turned over it lies; it is a victim, not an object."""
        figure = shape("<box><size>0.4 0.3 1.7</size></box>", "0 0 0.85 0 0 0")
        write_model(tmp_path, "victim", sdf(model("victimWoman", figure)))
        text = (
            f"<include><uri>model://victim</uri><name>V1</name><pose>3 4 0.2 {roll} 0 0</pose>"
            "</include><include><uri>model://ground_plane</uri></include>"
        )
        scene = load(tmp_path, text)
        (victim,) = scene.victims
        assert (victim.name, victim.figure, victim.posture) == ("V1", "female", posture)
        assert not [t for t in scene.objects if t.name == "V1"]
        if posture == "lying":
            # Rolled by a quarter turn the head is at -y, the feet at +y.
            yaw = rpy_from_quaternion(victim.pose.quaternion)[2]
            assert yaw == pytest.approx(math.pi / 2, abs=0.01)
        assert build_world(tmp_path, scene).description.victims[0].name == "V1"


class TestBadFiles:
    """Errors."""

    @pytest.mark.parametrize(
        ("text", "told"),
        [
            (world("<model name='m'>"), "line "),
            (world(model("m", BOX))[:200], "line "),
            (world(model("m", BOX).replace("1 2 3", "1 2")), "size '1 2' of a box"),
            (world(model("m", BOX).replace("1 2 3", "1 2 z")), "line 4"),
            (world(model("m", shape("<sphere/>"))), "a sphere without radius"),
            (world("<model name='m'><pose>1 2</pose></model>"), "a pose of 2 numbers"),
            (world("<model name='m'><pose>1 2 inf 0 0 0</pose></model>"), "is no pose"),
            ("<robot/>", "<robot> is no Gazebo world"),
            ("<!DOCTYPE a [<!ENTITY b 'c'>]>" + world(""), "entities"),
            (world(""), "no geometry"),
        ],
    )
    def test_what_is_wrong(self, tmp_path: Path, text: str, told: str) -> None:
        """Errors name file and line (item 73)."""
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

    @settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture],
              deadline=None)  # fmt: skip
    @given(st.data())
    def test_damaged_files(self, tmp_path: Path, data: st.DataObject) -> None:
        """Whatever is wrong with a file, it is read or refused in one line."""
        inner = model("m", BOX, static=False) + TestPlaces.PLUGIN
        inner += '<light type="point" name="l"><pose>0 0 1 0 0 0</pose></light>'
        inner += model("n", shape("<mesh><uri>w.dae</uri><scale>1 2 3</scale></mesh>"))
        write(tmp_path, MESH, "w.dae")
        survives(tmp_path, "map.world", data.draw(damages(world(inner).encode())))
