"""What a Gazebo world is put together of: frames, merged includes, states, populations, URDF."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from mesh_samples import read, refusal, told, volume
from sdf_samples import BOX, load, matrix, model, only, sdf, shape, write, write_model

from usarsim_maps.findings import Findings
from usarsim_maps.gazebo import models as gazebo_models
from usarsim_maps.gazebo.files import address_of
from usarsim_maps.gazebo.polylines import Outline, extruded
from usarsim_maps.scene import Array, Box, Capsule, Cylinder, Mesh, Scene, Sphere


def places(scene: Scene) -> dict[str, list[float]]:
    """Where the first part of each object is."""
    return {
        thing.name: [round(value, 6) + 0.0 for value in matrix(thing)[:3, 3].tolist()]
        for thing in scene.objects
    }


class TestFrames:
    """Names that poses are relative to."""

    def test_a_circle_through_models(self, tmp_path: Path) -> None:
        """Poses that are relative to each other through `::` are refused."""
        text = (
            '<model name="a"><pose relative_to="b::l">0 0 0</pose><link name="l"/></model>'
            '<model name="b"><pose relative_to="a::l">0 0 0</pose><link name="l"/></model>'
        )
        assert "refer to each other" in refusal(lambda: load(tmp_path, text))

    def test_a_name_that_is_not_there(self, tmp_path: Path, findings: Findings) -> None:
        """A name in a model that does not have it is a finding."""
        text = (
            model("a", BOX) + '<model name="b"><static>1</static><pose relative_to="a::gone">1 2 3'
            f'</pose><link name="l">{BOX}</link></model>'
        )
        assert places(load(tmp_path, text, findings))["b"] == [1.0, 2.0, 3.0]
        assert "gone: a frame of this name is not there" in told(findings)

    def test_joints_by_frames_and_models(self, tmp_path: Path) -> None:
        """Ends of joints may be frames, nested models and links in them."""
        inner = (
            f'<model name="arm"><link name="l">{BOX}</link></model>'
            f'<model name="hand"><link name="l">{BOX}</link></model>'
            f'<link name="base">{BOX}</link><frame name="socket" attached_to="base"/>'
            '<joint name="a" type="fixed"><parent>socket</parent><child>arm</child></joint>'
            '<joint name="b" type="fixed"><parent>arm::l</parent><child>hand::l</child></joint>'
        )
        thing = only(load(tmp_path, f'<model name="m">{inner}</model>'))
        assert (thing.name, len(thing.parts)) == ("m", 3)

    def test_joints_of_the_world(self, tmp_path: Path) -> None:
        """Models that a joint of the world connects are one body; one joined to it stands."""
        joints = (
            '<joint name="a" type="fixed"><parent>one</parent><child>two::link</child></joint>'
            '<joint name="b" type="fixed"><parent>world</parent><child>three</child></joint>'
            '<joint name="c" type="fixed"><parent>floor</parent><child>four</child></joint>'
        )
        names = ("one", "two", "three", "four", "five")
        text = "".join(model(name, BOX, static=False) for name in names) + model("floor", BOX)
        scene = load(tmp_path, text + joints)
        found = {thing.name: (thing.movable, len(thing.parts)) for thing in scene.objects}
        assert found == {
            "one": (True, 2),
            "three": (False, 1),
            "four": (False, 1),
            "five": (True, 1),
            "floor": (False, 1),
        }


class TestIncludes:
    """Merged and other includes."""

    def test_merges_in_merges(self, tmp_path: Path) -> None:
        """A merged model may merge another one; `__model__` is the include's own frame."""
        write_model(tmp_path, "leg", sdf(
            f'<model name="leg"><link name="shin"><pose relative_to="__model__">0 0 1</pose>{BOX}'
            "</link></model>"
        ))  # fmt: skip
        write_model(tmp_path, "body", sdf(
            '<model name="body"><include merge="true"><uri>model://leg</uri><pose>0 1 0</pose>'
            f'</include><link name="trunk">{BOX}</link><joint name="hip" type="fixed">'
            "<parent>trunk</parent><child>shin</child></joint></model>"
        ))  # fmt: skip
        text = (
            '<model name="m"><pose>5 0 0</pose><include merge="true"><uri>model://body</uri>'
            "<pose>1 0 0</pose></include></model>"
        )
        thing = only(load(tmp_path, text))
        corners = sorted(matrix(thing, k)[:3, 3].tolist() for k in range(2))
        assert corners == [[6.0, 0.0, 0.0], [6.0, 1.0, 1.0]]

    def test_the_frame_that_a_merge_places(self, tmp_path: Path) -> None:
        """placement_frame counts for merged includes, too."""
        write_model(tmp_path, "leg", sdf(
            f'<model name="leg"><link name="shin"><pose>0 0 1</pose>{BOX}</link></model>'
        ))  # fmt: skip
        text = (
            '<model name="m"><include merge="true"><uri>model://leg</uri><pose>1 0 0</pose>'
            "<placement_frame>shin</placement_frame></include></model>"
        )
        assert places(load(tmp_path, text)) == {"m": [1.0, 0.0, 0.0]}

    def test_links_do_not_merge_into_a_world(self, tmp_path: Path, findings: Findings) -> None:
        """A world has no links: such a model stays a model, with a note."""
        write_model(tmp_path, "box", sdf(model("box", BOX)))
        text = '<include merge="true"><uri>model://box</uri><pose>1 0 0</pose></include>'
        assert places(load(tmp_path, text, findings)) == {"box": [1.0, 0.0, 0.0]}
        assert "cannot be merged into a world" in told(findings)

    def test_merges_in_a_circle(self, tmp_path: Path) -> None:
        """They are refused as other includes are."""
        text = '<model name="a"><include merge="true"><uri>model://a</uri></include></model>'
        write_model(tmp_path, "a", sdf(text))
        message = refusal(lambda: load(tmp_path, "<include><uri>model://a</uri></include>"))
        assert "includes itself" in message

    def test_actors_and_files_without_models(self, tmp_path: Path, findings: Findings) -> None:
        """What an include leads to and is not read is counted."""
        write_model(tmp_path, "walker", sdf('<actor name="walker"/>'))
        write_model(tmp_path, "empty", sdf(""))
        text = "".join(f"<include><uri>model://{u}</uri></include>" for u in ("walker", "empty"))
        load(tmp_path, text + model("m", BOX), findings)
        assert findings.skipped == {"actor": 1, "include": 1}

    @pytest.mark.parametrize(
        ("uri", "owner", "name", "version", "path"),
        [
            ("https://fuel.gazebosim.org/1.0/Open/models/A B/2", "Open", "A B", "2", ""),
            ("https://fuel.gazebosim.org/1.0/o/models/A%20B/tip/files/m.dae", "o", "A B", "tip",
             "m.dae"),
            ("HTTPS://app.gazebosim.org/O/fuel/models/Sun/", "O", "Sun", "", ""),
            ("https://fuel.gazebosim.org/1.0/O/models/Sun?x=1", "O", "Sun", "", ""),
            ("http://models.gazebosim.org/sun/model.sdf", "", "sun", "", "model.sdf"),
            ("model://a b/c", "", "a b", "", "c"),
            ("c/d.sdf", "", "", "", "c/d.sdf"),
        ],
    )  # fmt: skip
    def test_addresses(self, uri: str, owner: str, name: str, version: str, path: str) -> None:
        """The parts of an address."""
        found = address_of(uri)
        assert (found.owner, found.name, found.version, found.path) == (owner, name, version, path)


class TestStates:
    """Saved worlds."""

    @pytest.mark.parametrize(
        ("text", "expected"),
        [
            ("<sphere><radius>1</radius></sphere>", Sphere(4.0)),
            ("<cylinder><radius>1</radius><length>1</length></cylinder>", Cylinder(3.0, 4.0)),
            ("<capsule><radius>1</radius><length>1</length></capsule>", Capsule(3.0, 4.0)),
            ("<box><size>1 1 1</size></box>", Box((2.0, 3.0, 4.0))),
        ],
    )
    def test_scales(self, tmp_path: Path, text: str, expected: object) -> None:
        """Round shapes stay round, and ways between shapes grow."""
        state = '<state><model name="m"><scale>2 3 4</scale></model></state>'
        thing = only(load(tmp_path, model("m", shape(text, "1 1 1 0 0 0")) + state))
        assert thing.parts[0].shape == expected
        assert matrix(thing)[:3, 3] == pytest.approx([2.0, 3.0, 4.0])

    def test_scales_of_meshes(self, tmp_path: Path) -> None:
        """A mesh is stretched."""
        text = "<ellipsoid><radii>1 1 1</radii></ellipsoid>"
        state = '<state><model name="m"><scale>2 3 4</scale></model></state>'
        thing = only(load(tmp_path, model("m", shape(text)) + state))
        assert np.diag(thing.parts[0].matrix)[:3] == pytest.approx([2.0, 3.0, 4.0])

    def test_links_of_flattened_models(self, tmp_path: Path) -> None:
        """Old versions write links of nested models as `inner::link`."""
        inner = f'<model name="in"><link name="l">{BOX}</link></model>'
        text = (
            f'<model name="out"><static>1</static>{inner}</model><state><model name="out">'
            '<pose>1 0 0 0 0 0</pose><link name="in::l"><pose>7 8 9 0 0 0</pose></link></model>'
            "</state>"
        )
        assert places(load(tmp_path, text)) == {"out::in": [7.0, 8.0, 9.0]}

    def test_lights(self, tmp_path: Path) -> None:
        """Lights of the world and of links have their places; those that were deleted are gone."""
        lamp = '<light name="{}" type="point"><pose>0 0 1 0 0 0</pose></light>'
        text = (
            model("m", lamp.format("inner") + BOX) + lamp.format("outer") + lamp.format("gone")
            + "<state><deletions><name>gone</name></deletions>"
            '<light name="outer"><pose>1 2 3 0 0 0</pose></light>'
            '<light name="m::link::inner"><pose>4 5 6 0 0 0</pose></light></state>'
        )  # fmt: skip
        lights = {light.name: light.position for light in load(tmp_path, text).lights}
        assert lights == {"outer": (1.0, 2.0, 3.0), "inner": (4.0, 5.0, 6.0)}

    def test_insertions_that_are_there(self, tmp_path: Path) -> None:
        """A model that was inserted, and then saved with the world, is there once."""
        text = model("m", BOX)
        state = f"<state><insertions>{text}{model('n', BOX)}</insertions></state>"
        assert list(places(load(tmp_path, text + state))) == ["m", "n"]

    def test_a_light_that_is_off(self, tmp_path: Path) -> None:
        """It gives no light."""
        text = '<light name="l" type="point"><light_on>false</light_on></light>' + model("m", BOX)
        assert [light.brightness for light in load(tmp_path, text).lights] == [0.0]


class TestPopulations:
    """Copies of models."""

    def population(self, container: str, distribution: str, count: int, pose: str = "") -> str:
        """A population of boxes."""
        place = pose or "1 2 3 0 0 0"
        return (
            f'<population name="p">{model("c", BOX)}<pose>{place}</pose>{container}'
            f"<model_count>{count}</model_count><distribution>{distribution}</distribution>"
            "</population>"
        )

    def points(self, tmp_path: Path, *words: object) -> Array:
        """Where the copies are."""
        scene = load(tmp_path, self.population(*words))  # type: ignore[arg-type]
        names = [thing.name for thing in scene.objects]
        assert names == [f"c_clone_{k}" for k in range(len(names))]
        return np.array([matrix(thing)[:3, 3] for thing in scene.objects])

    @pytest.mark.parametrize("kind", ["random", "uniform"])
    @pytest.mark.parametrize(
        "container",
        ["<box><size>8 4 2</size></box>",
         "<cylinder><radius>3</radius><length>2</length></cylinder>"],
    )  # fmt: skip
    def test_spread(self, tmp_path: Path, container: str, kind: str) -> None:
        """All are inside the container, apart, and at the same places each time."""
        words = (container, f"<type>{kind}</type>", 40)
        found = self.points(tmp_path, *words)
        assert np.array_equal(found, self.points(tmp_path, *words))
        away = found - [1.0, 2.0, 3.0]
        assert len(found) == 40
        if "box" in container:
            assert (np.abs(away) <= [4.0, 2.0, 1.0]).all()
        else:
            assert (np.hypot(away[:, 0], away[:, 1]) <= 3.0).all()
        distances = np.linalg.norm(found[:, None] - found[None], axis=2) + np.eye(40) * 9.0
        assert distances.min() > (0.5 if kind == "uniform" else 0.0)

    @pytest.mark.parametrize("axis", range(3))
    def test_lines(self, tmp_path: Path, axis: int) -> None:
        """Evenly along an axis of the box, from its lower end."""
        kind = f"<type>linear-{'xyz'[axis]}</type>"
        found = self.points(tmp_path, "<box><size>8 4 2</size></box>", kind, 4)
        size = (8.0, 4.0, 2.0)[axis]
        expected = np.tile([1.0, 2.0, 3.0], (4, 1))
        expected[:, axis] += np.array([-0.5, -0.25, 0.0, 0.25]) * size
        assert found == pytest.approx(expected)

    def test_a_turned_grid(self, tmp_path: Path) -> None:
        """The grid turns with the pose about its middle; it needs no container."""
        grid = "<type>grid</type><rows>1</rows><cols>3</cols><step>2 1 0</step>"
        found = self.points(tmp_path, "", grid, 1, f"1 2 0 0 0 {math.pi / 2}")
        assert found == pytest.approx(np.array([[1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [1.0, 4.0, 0.0]]))

    def test_included_models(self, tmp_path: Path) -> None:
        """What is copied may be an include, and may hold one."""
        write_model(tmp_path, "can", sdf(model("can", BOX)))
        include = "<include><uri>model://can</uri></include>"
        for inner in (include, f'<model name="c">{include}</model>'):
            text = (
                f'<population name="p">{inner}<pose>0 0 0</pose><distribution><type>grid</type>'
                "<rows>2</rows><cols>2</cols><step>3 3 0</step></distribution></population>"
            )
            assert len(load(tmp_path, text).objects) == 4

    @pytest.mark.parametrize(
        "words",
        [
            ("<box><size>8 4 2</size></box>", "<type>odd</type>", 4),
            ("", "<type>random</type>", 4),
            ("<box><size>8 4 2</size></box>", "<type>random</type>", 0),
            ("", "<type>grid</type><rows>x</rows><cols>1</cols><step>1 1 1</step>", 4),
            (
                "<cylinder><radius>3</radius><length>2</length></cylinder>",
                "<type>linear-x</type>",
                4,
            ),
        ],
    )
    def test_what_makes_no_sense(
        self, tmp_path: Path, words: tuple[str, str, int], findings: Findings
    ) -> None:
        """It is noted with its line and counted."""
        load(tmp_path, self.population(*words) + model("m", BOX), findings)
        assert findings.skipped == {"population": 1}
        assert "map.world: line " in told(findings)

    def test_too_many(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Populations count as models: beyond the bound the world is refused."""
        monkeypatch.setattr(gazebo_models, "MAX_MODELS", 20)
        box = "<box><size>1 1 1</size></box>"
        for text in (
            self.population(box, "<type>random</type>", 21),
            self.population(box, "<type>random</type>", 15) * 2,
            self.population(
                "", f"<type>grid</type><rows>{10**9}</rows><cols>9</cols><step>1 1 1</step>", 1
            ),
        ):
            assert "more than 20" in refusal(lambda text=text: load(tmp_path, text))


class TestUrdf:
    """Robot descriptions."""

    def test_links_that_joints_move(self, tmp_path: Path, findings: Findings) -> None:
        """In a world links are one body, placed by their joints' origins."""
        link = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
        text = (
            f'<robot name="r"><link name="a">{link}</link><link name="b">{link}</link>'
            '<joint name="j" type="continuous"><parent link="a"/><child link="b"/>'
            '<origin xyz="0 0 2" rpy="0 0 1.5707963267948966"/></joint></robot>'
        )
        write(tmp_path, text, "r.urdf")
        scene = load(tmp_path, "<include><uri>r.urdf</uri><pose>1 0 0</pose></include>", findings)
        thing = only(scene)
        assert thing.name == "r"
        assert thing.movable
        assert [matrix(thing, k)[:3, 3].tolist() for k in range(2)] == [[1, 0, 0], [1, 0, 2]]
        assert "stiff" in told(findings)

    def test_static_by_gazebo(self, tmp_path: Path) -> None:
        """`<gazebo><static>` makes it fixed."""
        link = '<link name="a"><visual><geometry><sphere radius="1"/></geometry></visual></link>'
        text = f'<robot name="r">{link}<gazebo><static>true</static></gazebo></robot>'
        write(tmp_path, text, "r.urdf")
        thing = only(load(tmp_path, "<include><uri>r.urdf</uri></include>"))
        assert not thing.movable
        assert thing.parts[0].shape == Sphere(1.0)

    def test_a_folder_with_a_robot(self, tmp_path: Path) -> None:
        """A model's folder may hold nothing but a URDF file; SDF has precedence."""
        link = '<link name="a"><visual><geometry><sphere radius="1"/></geometry></visual></link>'
        write(tmp_path, f'<robot name="r">{link}</robot>', "thing/robot.urdf")
        text = "<include><uri>model://thing</uri></include>"
        assert only(load(tmp_path, text)).name == "r"
        write(tmp_path, sdf(model("s", BOX)), "thing/other.sdf")
        assert only(load(tmp_path, text)).name == "s"

    def test_two_parents(self, tmp_path: Path) -> None:
        """A link with two parents is refused, with its line."""
        joint = '<joint name="{}" type="fixed"><parent link="a"/><child link="b"/></joint>'
        joints = f"{joint.format(1)}\n{joint.format(2)}"
        text = f'<robot><link name="a"/>\n<link name="b"/>\n{joints}</robot>'
        message = refusal(lambda: read(write(tmp_path, text, "r.urdf")))
        assert "r.urdf: line 4: link 'b' is the child of two joints" in message

    def test_links_in_a_circle(self, tmp_path: Path) -> None:
        """Joints that go in a circle are refused."""
        joint = '<joint name="{0}{1}" type="fixed"><parent link="{0}"/><child link="{1}"/></joint>'
        text = (
            '<robot><link name="a"/><link name="b"/>'
            + joint.format("a", "b")
            + joint.format("b", "a")
        )
        message = refusal(lambda: read(write(tmp_path, text + "</robot>", "r.urdf")))
        assert "refer to each other" in message

    def test_xacro_in_a_world(self, tmp_path: Path, findings: Findings) -> None:
        """There it is a note and counted; the world is imported without it."""
        write(tmp_path, '<robot><link name="${name}"/></robot>', "r.urdf")
        load(tmp_path, "<include><uri>r.urdf</uri></include>" + model("m", BOX), findings)
        assert findings.skipped == {"include": 1}
        assert "this file is written in xacro (run: xacro r.urdf -o r-plain.urdf)" in told(findings)


class TestPolylines:
    """Outlines in outlines."""

    SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])

    @pytest.mark.parametrize(
        ("sizes", "expected"),
        [
            ((3.0, 2.0), 20.0),
            ((2.0, 3.0), 20.0),
            ((1.0, 3.0, 2.0), 24.0),
            ((3.0, 3.0), 36.0),
            ((4.0, 3.0, 2.0, 1.0), 64.0 - 36.0 + 16.0 - 4.0),
        ],
    )
    def test_volumes(self, sizes: tuple[float, ...], expected: float) -> None:
        """Volumes, seen and felt, whatever the order; the same outline twice counts once."""
        mesh = extruded([Outline(self.SQUARE * size, 1.0) for size in sizes])
        assert isinstance(mesh, Mesh)
        assert volume(mesh) == pytest.approx(expected)
        felt = sum(self.hull_volume(hull) for hull in mesh.hulls)
        assert felt == pytest.approx(expected)

    def hull_volume(self, points: Array) -> float:
        """Of a convex prism: corners below, then above."""
        half = len(points) // 2
        return abs(Outline(points[:half, :2], 1.0).area) * float(np.ptp(points[:, 2]))

    def test_holes_that_touch(self) -> None:
        """A hole that touches its outline, and outlines side by side, are what they look like."""
        notch = Outline(self.SQUARE * 0.5 + np.array([0.5, 0.0]), 1.0)
        mesh = extruded([Outline(self.SQUARE, 1.0), notch])
        assert mesh is not None
        assert volume(mesh) == pytest.approx(3.0)
        beside = Outline(self.SQUARE + np.array([2.0, 0.0]), 1.0)
        mesh = extruded([Outline(self.SQUARE, 1.0), beside])
        assert mesh is not None
        assert volume(mesh) == pytest.approx(8.0)

    def test_nothing(self) -> None:
        """Outlines without an area are nothing."""
        assert extruded([Outline(np.zeros((3, 2)), 1.0)]) is None
        assert extruded([]) is None
