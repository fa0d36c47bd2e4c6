"""Start poses and people of Gazebo worlds (worlds reference 3 and 13, item 50)."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from built_worlds import build_world
from mesh_samples import read
from sdf_samples import BOX, PLUGIN, load, model, sdf, shape, world, write, write_model

from usarsim_maps.findings import Findings
from usarsim_maps.gazebo.places import person_words, read_placement
from usarsim_server.simulation.frames import rpy_from_quaternion


class TestPlaces:
    """Start poses and people (worlds 50)."""

    def test_start_poses(self, tmp_path: Path) -> None:
        """Elements of the plug-in are start poses in the simulation's frame (worlds 50)."""
        first, second = load(tmp_path, PLUGIN + model("m", BOX)).starts
        assert first.tag == "Gate"
        assert first.pose.position == (1.5, -2.0, 0.3)
        assert rpy_from_quaternion(first.pose.quaternion)[2] == pytest.approx(3.14)
        assert (second.tag, second.pose.position) == ("Roof", (1.0, 2.0, 3.0))

    def test_on_the_wire(self, tmp_path: Path) -> None:
        """Clients are told the same place with y and z turned round (worlds 27, 50)."""
        scene = load(tmp_path, PLUGIN + "<include><uri>model://ground_plane</uri></include>")
        start = build_world(tmp_path, scene).description.starts[0]
        assert start.tag == "Gate"
        assert start.pose.position == pytest.approx((1.5, -2.0, 0.3))

    def test_starts_in_a_comment(self, tmp_path: Path, findings: Findings) -> None:
        """A plug-in that was switched off still tells the starts, with a warning."""
        scene = load(tmp_path, f"<!-- {PLUGIN} -->" + model("m", BOX), findings)
        assert [start.tag for start in scene.starts] == ["Gate", "Roof"]
        assert "comment" in findings.warnings()[0].text

    def test_a_start_without_sense(self, tmp_path: Path, findings: Findings) -> None:
        """What is no start pose is a warning."""
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
        assert [start.tag for start in two.starts] == ["StartPoint1", "StartPoint2"]
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
        found = victim.name, victim.properties["figure"], victim.posture
        assert found == ("V1", "female", posture)
        assert not [t for t in scene.objects if t.name == "V1"]
        if posture == "lying":
            # Rolled by a quarter turn the head is at -y, the feet at +y.
            yaw = rpy_from_quaternion(victim.pose.quaternion)[2]
            assert yaw == pytest.approx(math.pi / 2, abs=0.01)
        assert build_world(tmp_path, scene).description.victims[0].name == "V1"

    def test_a_figure_alone_is_a_map(self, tmp_path: Path) -> None:
        """Who imports the model of a person alone gets its shape, which a world would replace."""
        figure = shape("<box><size>0.5 0.3 1.7</size></box>", "0 0 0.85 0 0 0")
        path = write_model(tmp_path, "victim", sdf(model("victimWoman", figure)))
        scene = read(path)
        assert not scene.victims
        assert [thing.name for thing in scene.objects] == ["victimWoman"]
