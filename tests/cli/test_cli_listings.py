"""`usarsim worlds` and `usarsim robots`: listings and details, in the frame of the wire."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from usarsim_doctor import robots_command as robots
from usarsim_server.cli import common, main, worlds
from usarsim_server.files import data_directory
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import (
    BatteryDescription,
    DriveDescription,
    ItemDescription,
    RobotDescription,
    RobotReport,
)
from usarsim_server.robots.families.wheeled import SkidSteer
from usarsim_server.simulation.frames import pose_from_wire
from usarsim_server.simulation.ground import Surface
from usarsim_server.worlds.description import (
    Smoke,
    SmokePuff,
    SmokeVolume,
    StartPose,
    Victim,
    WorldDescription,
    Zone,
)

YARD = WorldDescription(
    name="yard",
    level="DM-Yard",
    title="A yard",
    description="Mud.\nMore mud.\n\nA fence.",
    folder=Path("/worlds/yard"),
    scene=Path("/worlds/yard/scene.xml"),
    starts=(
        StartPose("RobotStart1", pose_from_wire((1.25, -0.5, -0.2), (0, 0, math.pi / 2))),
        StartPose("RobotStart2", pose_from_wire((4, 2, 0))),
    ),
    victims=(Victim("Ada", pose_from_wire((3, 1, -0.9)), "sitting", "Injured"),),
    zones=(Zone("mud", "red", (-2.0, 6.0), (1.0, 5.0)),),
    time_limit=0,
)

ROVER = RobotDescription(
    name="Rover",
    model="Rover",
    kind="skid_steer",
    dialect=Dialect.UDK,
    description="A rover",
    shapes=(),
    wheels=(),
    casters=(),
    rest_height=0.2,
    drive=DriveDescription(max_wheel_speed=5.0),
    battery=BatteryDescription(life=1200.0),
    report=RobotReport(0.13, 0.47, 0.29, 14.0, "SkidSteered", (1, 1, 1), (0, 0, 0), 5.0, 60.0),
    items=(
        ItemDescription(
            "SICK",
            "lms200",
            None,
            pose_from_wire((0.2085, 0, -0.2), (0, 0, -math.pi / 2)),
            {"fov": 3.14159, "scanned": True},
        ),
        ItemDescription("Encoder", "ECLeft", "LeftFWheel", pose_from_wire((0, 0, 0))),
    ),
    source=Path("/robots/Rover.toml"),
    family=SkidSteer(),
)


def squeezed(text: str) -> list[str]:
    """Lines with runs of blanks made one, so that a test does not depend on widths."""
    return [" ".join(line.split()) for line in text.splitlines()]


# Worlds


def test_worlds_are_listed_with_name_starts_victims_and_title() -> None:
    """One line per world, sorted by name in any case."""
    other = WorldDescription("Arena", "a", "An arena", "", Path("/a"), Path("/a/s"), ())
    assert squeezed(worlds.listing([YARD, other])) == [
        "NAME STARTS VICTIMS TITLE",
        "Arena 0 0 An arena",
        "yard 2 1 A yard",
    ]


def test_world_details_are_in_the_wire_frame() -> None:
    """Start poses and victims are written as INIT takes them; limits of zones stay ordered."""
    lines = squeezed("\n".join(worlds.details(YARD)))
    assert "RobotStart1 1.25,-0.5,-0.2 0,0,1.5708" in lines
    assert "RobotStart2 4,2,0 0,0,0" in lines
    assert "Ada sitting Injured 3,1,-0.9" in lines
    assert "mud red -2 to 6 -5 to -1" in lines
    assert "level DM-Yard" in lines
    assert "time limit none" in lines
    assert "Mud. More mud." in lines


def test_smoke_and_ground_are_described() -> None:
    """Regional, local and global smoke with density and place, patches with what they do."""
    box = SmokeVolume("kitchen", "box", pose_from_wire((1, 2, -1.5)), (2.0, 2.0, 2.0), 0.4)
    puff = SmokePuff("fire", (3.0, -1.0, 1.0), (1.0, 1.0, 2.0), 60, 0.1, 1)
    mud = Surface("bog", "mud", (0.0, 2.0), (1.0, 5.0), (-0.1, 0.1), 0.4, 15.0, 0.02)
    world = replace(YARD, smoke=Smoke((box,), (puff,), haze=0.02), surfaces=(mud,))
    lines = squeezed("\n".join(worlds.details(world)))
    assert "kitchen regional 0.4 1,2,-1.5" in lines
    assert "fire local 3,1,-1" in lines
    assert "global 0.02 everywhere" in [line.strip() for line in lines]
    assert "bog mud 0.4 15.0 0.02 0 to 2 -5 to -1" in lines


def test_empty_world_has_no_empty_tables() -> None:
    """What a world does not have is left out."""
    bare = WorldDescription("bare", "bare", "Bare", "", Path("/b"), Path("/b/s"), ())
    text = "\n".join(worlds.details(bare))
    assert not any(
        head in text for head in ("START ", "VICTIM ", "ZONE ", "SMOKE ", "GROUND ", "MACHINE ")
    )
    assert "20 min" in text


def test_machines_are_listed_where_they_begin(capsys) -> None:
    """`usarsim worlds plant` names doors, belts, lifts and obstacles, places in the wire frame."""
    assert main(["worlds", "plant"]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "gate sliding door by itself -3,-2,0" in lines
    assert "flap hinged door when pushed -3,3.2,0" in lines
    assert "line belt 0.3 m/s 0.3,-5.2,-0.6" in lines
    assert "lift lift with a load 4.9,-2,-0.02" in lines
    assert "sweeper obstacle ring -1.2,0.9,0" in lines


def test_shipped_worlds_are_listed_and_described(capsys) -> None:
    """`usarsim worlds` shows the arena, `usarsim worlds arena` its first start pose."""
    assert main(["worlds"]) == 0
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert names[0] == "NAME"
    assert "arena" in names
    assert main(["worlds", "arena"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("arena: ")
    assert "RobotStart1" in out


def test_unknown_world_is_an_error(capsys) -> None:
    """A misspelt name is one error line that helps."""
    assert main(["worlds", "arenaa"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert "arena" in captured.err.replace("arenaa", "")


# Robots


def test_robots_are_listed_with_class_era_kind_and_description() -> None:
    """One line per class."""
    assert squeezed(robots.listing([ROVER])) == [
        "CLASS ERA KIND DESCRIPTION",
        "Rover udk skid_steer A rover",
    ]


def test_robot_details_show_body_and_sensors_in_the_wire_frame() -> None:
    """Sizes and limits with units, and each sensor with its mount as GEO would print it."""
    lines = squeezed("\n".join(robots.details(ROVER)))
    assert "wheel radius 0.13 m" in lines
    assert "track width 0.47 m" in lines
    assert "wheel speed at most 5 rad/s, 0.65 m/s on the ground" in lines
    assert "battery 1200 s" in lines
    assert "lms200 SICK - 0.2085,0,-0.2 0,0,-1.5708 fov=3.14159 scanned=True" in lines
    assert "ECLeft Encoder LeftFWheel 0,0,0 0,0,0" in lines


def test_shipped_robots_are_listed_and_described(capsys) -> None:
    """`usarsim robots` shows P3AT, its details the numbers that CONF and GEO announce."""
    assert main(["robots"]) == 0
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert {"P2AT", "P3AT"} <= set(names)
    assert main(["robots", "USARBot.p3at"]) == 0
    lines = squeezed(capsys.readouterr().out)
    assert lines[0].startswith("P3AT: ")
    assert "mass 11.9 kg" in lines  # robots reference, protocol 5
    assert any(line.startswith("lms200 ") for line in lines)


def test_arms_and_effectors_are_described(capsys) -> None:
    """Details of an arm list joints with limits, speed and torque, and what it takes hold with."""
    assert main(["robots", "KR60"]) == 0
    lines = squeezed(capsys.readouterr().out)
    assert "KR60Arm KR60Arm_Link2 KR60Arm_Joint2 revolute -2.356,0.61 1.571 1500" in lines
    assert "toolchange ToolChanger KR60Arm_Link6" in lines
    assert "KR60gripper VacuumGripper loose" in lines
    assert "kind static" in lines
    assert not any("wheel" in line for line in lines)
    assert main(["robots", "P2AT"]) == 0
    pan = "CameraPanTilt CameraPanTilt_Link1 CameraPanTilt_Joint1 revolute none 0.1745 20"
    assert pan in squeezed(capsys.readouterr().out)


def test_unknown_robot_is_an_error_with_the_nearest_name(capsys) -> None:
    """A misspelt class is one error line that names the right one, or all."""
    assert main(["robots", "USARBot.P3TA"]) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err.count("\n")) == ("", 1)
    assert "did you mean P3AT?" in captured.err
    assert main(["robots", "zzzzzz"]) == 2
    assert "known: " in capsys.readouterr().err


def test_robots_of_further_folders_are_listed(tmp_path: Path, capsys) -> None:
    """`--robots DIR` shows what `serve --robots DIR` would offer."""
    text = (data_directory("robots") / "P3AT.toml").read_text().replace('"P3AT"', '"LabRover"')
    (tmp_path / "LabRover.toml").write_text(text)
    assert main(["robots", "--robots", str(tmp_path)]) == 0
    assert any(line.startswith("LabRover ") for line in capsys.readouterr().out.splitlines())
    assert main(["robots", "--robots", str(tmp_path / "none")]) == 2


# Tables


def test_table_aligns_words_left_and_numbers_right() -> None:
    """Columns are as wide as their widest cell; lines have no trailing blanks."""
    assert common.table(("NAME", "N", "TITLE"), [("a", 5, "x"), ("long name", 12, "")]) == (
        "NAME        N  TITLE\na           5  x\nlong name  12"
    )


def test_table_without_rows_is_its_heads() -> None:
    """Nothing to list still says what would be listed."""
    assert common.table(("NAME", "N"), []) == "NAME  N"


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (1.0, 2, "1"),
        (-0.001, 2, "0"),
        (1.25, 2, "1.25"),
        (100.0, 0, "100"),
        (-3.10, 2, "-3.1"),
        (1.5708, 4, "1.5708"),
    ],
)
def test_numbers_have_no_useless_zeros(value: float, digits: int, text: str) -> None:
    """Trailing zeros and negative zeros are dropped, other digits stay."""
    assert common.number(value, digits) == text


def test_facts_align_their_values() -> None:
    """One fact per line."""
    assert common.facts([("a", 1), ("long", "x")]) == "a     1\nlong  x"


def test_paragraphs_stay_apart() -> None:
    """Lines of a paragraph are joined, blank lines kept."""
    assert common.paragraph("one\ntwo\n\nthree") == "one two\n\nthree"
