"""Joints of URDF and MJCF files that others carry along, and the speeds that such files say."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from model_texts import body, inertial, mjcf, urdf

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.robots.coupling import coupled_position, coupled_speed, farthest, moved
from usarsim_server.robots.description import RobotDescription
from usarsim_server.testing import Rehearsal, RehearsedClient

CLAW = Path(__file__).parent / "claw"
SCENE = '<mujoco><worldbody><geom type="plane" size="0 0 1"/></worldbody></mujoco>'
SHEET = 'title = "Flat"\ndescription = "A floor."\n[[start]]\ntag = "S"\nposition = [0, 0, 0.3]\n'

numbers = st.floats(-2.0, 2.0)


def finger(name: str, limit: str = "", mimic: str = "", kind: str = "revolute") -> str:
    """A link of a URDF file with its joint on the trunk."""
    return f"""<link name="{name}_link">{inertial(0.1)}</link>
<joint name="{name}" type="{kind}"><parent link="trunk"/><child link="{name}_link"/>
<origin xyz="0.2 0 0.1"/><axis xyz="0 0 1"/>
<limit lower="-0.8" upper="0.8" effort="5" {limit}/>{mimic}</joint>"""


def mimic(joint: str, more: str = "") -> str:
    """The element that couples a joint."""
    return f'<mimic joint="{joint}" {more}/>'


def joints(robot: RobotDescription) -> dict[str, tuple[str | None, tuple[float, ...] | None]]:
    """What each joint follows, and how."""
    return {link.joint: (link.follows, link.coupling) for link in robot.links}


class Hand:
    """A robot of a test in a world, its package called Hand or Claw."""

    def __init__(self, stage: Rehearsal, name: str) -> None:
        self._stage, self._client = stage, stage.connect()
        self.send(f"INIT {{ClassName USARBot.{name}}} {{Name R}} {{Location 0,0,-0.3}}", 1.0)

    def send(self, line: str, seconds: float = 4.0) -> None:
        """Send a line and wait."""
        self._client.send(line)
        self._stage.run(seconds)

    def ask(self, line: str) -> str:
        """The first line that comes back and is no status."""
        self._client.take()
        self.send(line, 0.1)
        return next(one for one in self._client.take() if one.startswith(("CONF", "GEO")))

    def places(self, *names: str) -> list[float]:
        """Positions of joints now."""
        state = self._stage.robot_state(-1)
        return [state.joint_position(name) for name in names]

    @property
    def client(self) -> RehearsedClient:
        """Its connection."""
        return self._client


def stage(folder: Path, robots: Path, timestep: float = 0.002) -> Rehearsal:
    """A flat world with robots of a folder."""
    (folder / "flat").mkdir()
    (folder / "flat" / "scene.xml").write_text(SCENE)
    (folder / "flat" / "world.toml").write_text(SHEET)
    return Rehearsal(world=str(folder / "flat"), robots=(robots,), timestep=timestep)


@pytest.fixture
def claw(tmp_path: Path) -> Iterator[Hand]:
    """Two fingers, the right one mimics the left one with -1."""
    with stage(tmp_path, CLAW) as one:
        yield Hand(one, "Claw")


class TestClaw:
    """A gripper in a world."""

    def test_the_second_finger_goes_the_other_way(self, claw: Hand) -> None:
        """At the end, and on the way, at the speed of the file."""
        claw.send("MISPKG {Name Claw} {Link 1} {Value 0.5}", 0.5)
        left, right = claw.places("left_finger", "right_finger")
        assert left == pytest.approx(0.5 * 0.5, abs=0.02)
        assert right == pytest.approx(-left, abs=1e-4)
        claw.send("", 2.0)
        assert claw.places("left_finger", "right_finger") == pytest.approx([0.5, -0.5], abs=1e-3)

    def test_it_takes_no_orders_of_its_own(self, claw: Hand) -> None:
        """By name, by its package or with all joints; those of speed and torque are followed."""
        claw.send("DRIVE {Name right_finger} {Value 0.4}")
        assert claw.places("right_finger") == pytest.approx([0.0], abs=1e-3)
        claw.send("SET {Type Joint} {Name AllJoints} {Opcode Angle} {Params 0.3}")
        assert claw.places("left_finger", "right_finger") == pytest.approx([0.3, -0.3], abs=1e-3)
        for order in ("{Value 0.2} {Order 1}", "{Value -3} {Order 2}"):
            claw.send(f"MISPKG {{Name Claw}} {{Link 1}} {order}", 1.0)
            left, right = claw.places("left_finger", "right_finger")
            assert abs(left - 0.3) > 0.1
            assert right == pytest.approx(-left, abs=1e-3)

    def test_what_is_told(self, claw: Hand) -> None:
        """The package, its link and its speed in CONF; the second finger in STA."""
        assert claw.ask("GETCONF {Type MisPkg}") == (
            "CONF {Type MisPkg} {Name Claw} {Link 1} {JointType Revolute} {MaxRotationSpeed 0.500} "
            "{MaxTorque 5.0000} {MinRange -0.8000} {MaxRange 0.8000}"
        )
        claw.send("MISPKG {Name Claw} {Link 1} {Value 0.5}")
        status = [line for line in claw.client.take() if line.startswith("STA")][-1]
        found = re.search(r"\{right_finger ([-.\d]+)\}", status)
        assert found is not None
        assert float(found[1]) == pytest.approx(-0.5, abs=1e-3)


@pytest.mark.parametrize("timestep", [0.001, 0.004])
def test_chains_slides_and_offsets_in_a_world(tmp_path: Path, timestep: float) -> None:
    """Whatever follows stands where its polynomial says, also while the leader goes there."""
    links = (
        finger("c", 'velocity="1"', mimic("b", 'multiplier="0.5" offset="0.1"'))
        + finger("a", 'velocity="1"')
        + finger("b", 'velocity="1"', mimic("a", 'multiplier="-1.2"'))
        + finger("rack", 'velocity="1"', mimic("a", 'multiplier="0.05" offset="0.02"'), "prismatic")
    )
    body(tmp_path / "bots", urdf(links), "hand.urdf", package=[{"name": "Hand", "joints": ["a"]}])
    with stage(tmp_path, tmp_path / "bots", timestep) as one:
        hand = Hand(one, "Walker")
        assert hand.places("a", "b", "c", "rack") == pytest.approx([0, 0, 0.1, 0.02], abs=1e-3)
        hand.send("MISPKG {Name Hand} {Link 1} {Value 0.6}", 0.4)
        for seconds in (0.0, 0.1, 2.0):
            hand.send("", seconds)
            a, b, c, rack = hand.places("a", "b", "c", "rack")
            assert [b, c, rack] == pytest.approx(
                [-1.2 * a, 0.1 - 0.6 * a, 0.02 + 0.05 * a], abs=1e-3
            )
        assert a == pytest.approx(0.6, abs=1e-3)
        # b stops at 0.8: a goes no farther than that allows.
        hand.send("MISPKG {Name Hand} {Link 1} {Value -0.75}")
        assert hand.places("a", "b") == pytest.approx([-0.8 / 1.2, 0.8], abs=2e-3)


def test_a_file_of_mujoco(tmp_path: Path) -> None:
    """Polynomials of `<equality>` count from the reference positions; one may hold a joint."""
    part = '<body name="{0}L" pos="0 0 {1}"><joint name="{0}" axis="0 0 1" range="-1 1" {2}/>' \
           '<geom size="0.02" mass="0.1"/></body>'  # fmt: skip
    inside = part.format("a", 0.1, 'ref="0.2"') + part.format("b", 0.2, 'ref="-0.1"')
    inside += part.format("fixed", 0.3, "")
    text = mjcf(inside).replace(
        "</mujoco>",
        '<equality><joint joint1="b" joint2="a" polycoef="0.05 0.5 0.25 -0.1 0.02"/>'
        '<joint joint1="fixed" polycoef="0.4 0 0 0 0"/>'
        '<joint joint1="a" joint2="fixed" active="false"/></equality></mujoco>',
    )
    robot = body(tmp_path / "bots", text)
    found = joints(robot)
    assert found["a"] == (None, None)
    assert found["b"][0] == "a"
    assert found["fixed"] == (None, (0.4, 0.0, 0.0, 0.0, 0.0))
    with stage(tmp_path, tmp_path / "bots") as one:
        hand = Hand(one, "Walker")
        for wanted in (0.7, -0.3):
            hand.send(f"DRIVE {{Name a}} {{Value {wanted}}}")
            hand.send("DRIVE {Name fixed} {Value -0.5}", 0.5)
            x = wanted - 0.2
            b = -0.1 + 0.05 + 0.5 * x + 0.25 * x**2 - 0.1 * x**3 + 0.02 * x**4
            assert hand.places("a", "b", "fixed") == pytest.approx([wanted, b, 0.4], abs=2e-3)


def test_a_follower_is_carried(tmp_path: Path) -> None:
    """What stops the leader stops what follows, and a stiffness of 0 frees both."""
    links = finger("a", 'velocity="1"') + finger("b", 'velocity="1"', mimic("a"))
    body(tmp_path / "bots", urdf(links), "hand.urdf", package=[{"name": "Hand", "joints": ["a"]}])
    with stage(tmp_path, tmp_path / "bots") as one:
        hand = Hand(one, "Walker")
        hand.send("SET {Type Joint} {Name a} {Opcode Stiffness} {Params 0}", 0.1)
        hand.send("MISPKG {Name Hand} {Link 1} {Value 0.6}", 1.0)
        a, b = hand.places("a", "b")
        assert abs(a) < 0.05
        assert b == pytest.approx(a, abs=1e-3)


class TestDescriptions:
    """What is read."""

    @pytest.mark.parametrize(
        ("said", "speed"),
        [
            ('velocity="0.5"', 0.5),
            ("velocity='2.5'", 2.5),
            ('velocity="1e9"', 1e4),
            ('velocity="0"', 1.571),
            ('velocity="-1"', 1.571),
            ("", 1.571),
        ],
    )
    def test_speeds(self, tmp_path: Path, said: str, speed: float) -> None:
        """`velocity` of a URDF joint; exporters write 0 where they know none."""
        text = urdf(finger("a", said))
        (link,) = body(tmp_path, text, "a.urdf").links
        assert link.max_speed == speed

    def test_speeds_belong_to_their_joints(self, tmp_path: Path) -> None:
        """Joints of transmissions and comments are none; the robot file has the last word."""
        extra = (
            '<transmission name="t"><joint name="b"><limit velocity="9"/></joint></transmission>'
            '<!-- <joint name="a"><limit velocity="8"/></joint> -->'
        )
        text = urdf(finger("a", 'velocity="0.5"') + finger("b", 'velocity="0.7"') + finger("c"))
        keys = {"max_speed": 3.0, "b": {"max_speed": 0.2}}
        robot = body(tmp_path, text.replace("</robot>", extra + "</robot>"), "a.urdf", joints=keys)
        assert [link.max_speed for link in robot.links] == [0.5, 0.2, 3.0]

    def test_mimic(self, tmp_path: Path) -> None:
        """Multiplier 1 and offset 0 where they are not said; names as the wire can have them."""
        links = finger("lead-er") + finger("b", "", mimic("lead-er"))
        links += finger("c", "", mimic("lead-er", 'multiplier="-2" offset="0.25"'))
        robot = body(tmp_path, urdf(links), "a.urdf")
        assert joints(robot) == {
            "lead_er": (None, None),
            "b": ("lead_er", (0.0, 1.0, 0.0, 0.0, 0.0)),
            "c": ("lead_er", (0.25, -2.0, 0.0, 0.0, 0.0)),
        }
        assert [link.home for link in robot.links] == [0.0, 0.0, 0.25]

    def test_the_robot_file_has_the_last_word(self, tmp_path: Path) -> None:
        """Homes are those of leaders; `follows` replaces the coupling."""
        text = urdf(finger("a") + finger("b", "", mimic("a", 'multiplier="-1"')) + finger("c"))
        robot = body(tmp_path / "x", text, "a.urdf", joints={"a": {"home": 0.3}})
        assert [link.home for link in robot.links] == [0.3, -0.3, 0.0]
        robot = body(tmp_path / "y", text, "a.urdf", joints={"b": {"follows": "c"}})
        assert joints(robot)["b"] == ("c", None)
        with pytest.raises(RobotDescriptionError, match="b: home: is that of a coupled joint"):
            body(tmp_path / "z", text, "a.urdf", joints={"b": {"home": 0.3}})

    @pytest.mark.parametrize(
        ("links", "error"),
        [
            (finger("a", "", mimic("b")) + finger("b", "", mimic("a")), "is coupled to itself"),
            (finger("a", "", mimic("a")), "coupled to itself|MuJoCo cannot use it"),
        ],
    )
    def test_rings(self, tmp_path: Path, links: str, error: str) -> None:
        """One line, no robot."""
        with pytest.raises(RobotDescriptionError, match=error):
            body(tmp_path, urdf(links), "a.urdf")

    def test_a_leader_that_is_not_there(self, tmp_path: Path) -> None:
        """The joint keeps its own drive; MuJoCo warns in the log."""
        robot = body(tmp_path, urdf(finger("a", "", mimic("gone"))), "a.urdf")
        assert joints(robot) == {"a": (None, None)}

    def test_two_leaders(self, tmp_path: Path) -> None:
        """A joint cannot follow two."""
        text = mjcf().replace(
            "</mujoco>",
            '<equality><joint joint1="Knee" joint2="Hip"/><joint joint1="Knee"/></equality>'
            "</mujoco>",
        )
        with pytest.raises(RobotDescriptionError, match="'Knee' is coupled to two others"):
            body(tmp_path, text)


class TestPolynomials:
    """The arithmetic."""

    @given(st.tuples(*[numbers] * 5), numbers, numbers, numbers)
    def test_other_origins(
        self, coefficients: tuple[float, ...], leader: float, follower: float, x: float
    ) -> None:
        """P(x + a) + b."""
        a, b, c, d, e = coefficients
        found = coupled_position(moved(coefficients, leader, follower), x)
        wanted = coupled_position((a, b, c, d, e), x + leader) + follower
        assert found == pytest.approx(wanted, abs=1e-9, rel=1e-9)

    def test_speed(self) -> None:
        """The slope times the leader's."""
        assert coupled_speed((0.1, 2.0, 3.0, 0.0, 0.0), 0.5, 0.1) == pytest.approx(0.5)

    def test_farthest(self) -> None:
        """The wanted place, the last one that is allowed, or home."""
        assert farthest(0.4, 0.0, lambda place: place <= 0.5) == 0.4
        assert farthest(2.0, 0.0, lambda place: place <= 0.5) == pytest.approx(0.5)
        assert farthest(-2.0, 0.1, lambda place: place > 5.0) == 0.1
        assert np.isfinite(farthest(1e300, 0.0, lambda place: place < 1.0))
