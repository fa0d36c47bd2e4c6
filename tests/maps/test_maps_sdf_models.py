"""Gazebo models: where they are, what moves, how they look (worlds 29, 49, 76)."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import pytest
from built_worlds import build_world
from mesh_samples import dae, dae_wedge, read
from PIL import Image
from sdf_samples import BOX, load, model, only, sdf, shape, world, write, write_model

from usarsim_maps.findings import Findings
from usarsim_maps.gazebo.files import model_name
from usarsim_maps.gazebo.looks import named_color, read_script
from usarsim_maps.scene import LightKind, Material, Plane


class TestModels:
    """Finding and moving them."""

    def test_built_in_models(self, tmp_path: Path, findings: Findings) -> None:
        """sun and ground_plane are there without files; other missing ones are named
        (worlds 49)."""
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
        """Models that are not static can be pushed, with their masses (worlds 29)."""
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

    def test_joints(self, tmp_path: Path, findings: Findings) -> None:
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
        """In the built world a movable box falls onto the floor and a static one hangs
        (worlds 29)."""
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
            body = dae_wedge().replace("<triangles ", '<triangles material="s" ')
            write(tmp_path, dae(body, bound, more=looks.format(red)), f"{name}.dae")
            text += model(name, shape(f"<mesh><uri>{name}.dae</uri></mesh>"))
        scene = load(tmp_path, text)
        names = []
        for thing in scene.objects:
            mesh = thing.parts[0].shape
            names.append(thing.parts[0].materials.get(0, mesh.materials[0]))
        assert [scene.materials[name].color[0] for name in names] == [1.0, 0.5]

    def test_lights(self, tmp_path: Path) -> None:
        """Point and spot lights keep place, direction, colour and reach (worlds 76)."""
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
