"""The howto adds a robot, and what it says of the keys is true."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from robot_files import table, write

from usarsim_server.errors import RobotDescriptionError
from usarsim_server.robots.loader import load_robot
from usarsim_server.robots.mjcf import build_spec
from usarsim_server.robots.roster import load_roster

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
