"""The howto adds a robot, and what it says of the keys is true."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from robot_files import table, write

from usarsim_server.actuators.registry import effector_types
from usarsim_server.errors import RobotDescriptionError
from usarsim_server.robots.loader import load_robot
from usarsim_server.robots.mjcf import build_spec
from usarsim_server.robots.roster import load_roster
from usarsim_server.testing import Rehearsal

PAGE = Path(__file__).parents[2] / "docs" / "robots-howto.md"
TEXT = PAGE.read_text(encoding="utf-8")
BLOCKS = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)


def section(title: str) -> set[str]:
    """Keys in the table of a section."""
    body = TEXT.split(f"### {title}", 1)[1].split("\n#", 1)[0]
    cells = re.findall(r"^\| (`[^|]*`) \|", body, re.MULTILINE)
    return {key for cell in cells for key in re.findall(r"`(\w+)`", cell)}


def test_example_is_a_robot(tmp_path: Path) -> None:
    """The example of the page is a robot that can be found under its names and built."""
    (tmp_path / "Rover.toml").write_text(BLOCKS[0], encoding="utf-8")
    roster = load_roster([tmp_path])
    robot = roster.find("USARBot.Rover")
    assert robot is not None
    assert [item.name for item in robot.items] == ["Scanner1", "F1"]
    assert robot.rest_height == pytest.approx(0.12)
    assert roster.find("minirover") is not None
    assert build_spec(robot).compile().body_mass.sum() == pytest.approx(robot.report.mass)


def test_variant_example_is_a_fast_p3at(tmp_path: Path) -> None:
    """The variant of the page replaces P3AT by a fast one."""
    (tmp_path / "P3AT.toml").write_text(BLOCKS[1], encoding="utf-8")
    robot = load_roster([tmp_path]).find("P3AT")
    assert robot is not None
    assert robot.drive.max_wheel_speed == 8.17


def test_arm_example_moves_and_holds(tmp_path: Path) -> None:
    """The armed rover of the page has an arm of two links and a gripper, and stands upright."""
    (tmp_path / "Rover.toml").write_text(BLOCKS[0], encoding="utf-8")
    (tmp_path / "ArmedRover.toml").write_text(BLOCKS[2], encoding="utf-8")
    with Rehearsal(world="empty", robots=[tmp_path]) as stage:
        client = stage.connect()
        client.send("INIT {ClassName ArmedRover} {Location 0,0,-0.2} {Dialect udk}")
        client.send("MISPKG {Name Arm} {Link 1} {Value 0.5}", "DRIVE {Name Arm_Joint2} {Value 0.2}")
        client.send("SET {Type Gripper} {Name Hand} {Opcode CLOSE}")
        stage.run(8.0)
        arm, hand = client.take("ASTA")[-1], stage.assembly.fleet.vehicles[0].look()
        assert re.search(r"\{Link 1\} \{Value 0\.(4999|5)\d*\} \{Link 2\} \{Value 0\.(1999|2)", arm)
        assert hand is not None
        assert hand.hand("Hand").closed
        assert hand.pose.rotate((0.0, 0.0, 1.0))[2] > 0.999
        client.send("MULTIDRIVE {Arm_Joint1 -0.5}")
        client.send("SET {Type Joint} {Name Arm_Joint2} {Opcode Angle} {Params 0.1}")
        stage.run(8.0)
        arm = client.take("ASTA")[-1]
        assert re.search(r"\{Value -0\.(4999|5)\d*\} \{Link 2\} \{Value 0\.(1|0999)", arm)


@pytest.mark.parametrize(
    ("title", "key"),
    [
        ("Top level", None),
        ("`[[shape]]`", "shape"),
        ("`[[wheel]]`", "wheel"),
        ("`[[caster]]`", "caster"),
        ("`[drive]`", "drive"),
        ("`[battery]`", "battery"),
        ("`[report]`", "report"),
    ],
)
def test_tables_list_exactly_the_known_keys(tmp_path: Path, title: str, key: str | None) -> None:
    """Each table of the page has exactly the keys that the loader knows."""
    robot = table()
    probe = "zzzzzzzzzzzz"
    if key is None:
        robot[probe] = 1
    elif title.startswith("`[["):
        robot[key][0][probe] = 1
    else:
        robot.setdefault(key, {})[probe] = 1
    with pytest.raises(RobotDescriptionError, match=probe) as caught:
        load_robot(write(tmp_path, "Test", robot))
    known = set(str(caught.value).split("known are: ")[1].rstrip(")").split(", "))
    tables = {"shape", "wheel", "caster", "drive", "report", "sensor", "camera"}
    tables |= {"actuator", "effector"}
    assert section(title) == (known - tables if key is None else known)


@pytest.mark.parametrize(
    ("title", "nested"), [("`[[actuator]]`", False), ("`[[actuator.link]]`", True)]
)
def test_tables_of_arms_list_exactly_the_known_keys(
    tmp_path: Path, title: str, nested: bool
) -> None:
    """The tables about actuators have exactly the keys that the loader knows."""
    probe = "zzzzzzzzzzzz"
    piece = {"kind": "box", "size": [0.1, 0.1, 0.1], "mass": 1.0}
    link: dict[str, object] = {"shape": [piece]}
    actuator: dict[str, object] = {"name": "Arm", "link": [link]}
    (link if nested else actuator)[probe] = 1
    with pytest.raises(RobotDescriptionError, match=probe) as caught:
        load_robot(write(tmp_path, "Test", table(actuator=[actuator])))
    known = set(str(caught.value).split("known are: ")[1].rstrip(")").split(", "))
    assert section(title) == known


def test_effector_types_are_all_described() -> None:
    """The page names every effector type that a robot file may name, but not their aliases."""
    body = TEXT.split("### `[[effector]]`", 1)[1].split("\n#", 1)[0]
    described = set(re.findall(r"^\| `([A-Z]\w+)` \|", body, re.MULTILINE))
    assert described == {"Gripper", "VacuumGripper", "ToolChanger"}
    assert described <= set(effector_types())
