"""The howto adds a robot, and what it says of the keys is true."""

from __future__ import annotations

import copy
import math
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from robot_files import table, write

from usarsim_server.actuators.effector import effector_types
from usarsim_server.errors import RobotDescriptionError
from usarsim_server.robots.catalog import load_robot, load_roster
from usarsim_server.robots.families.base import families
from usarsim_server.robots.mjcf import build_spec
from usarsim_server.testing import Rehearsal

PAGE = Path(__file__).parents[2] / "docs" / "robots-howto.md"
TEXT = PAGE.read_text(encoding="utf-8")
BLOCKS = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
(XML,) = re.findall(r"```xml\n(.*?)```", TEXT, re.DOTALL)


def block(kind: str) -> str:
    """The first example of the page of this kind."""
    return next(str(one) for one in BLOCKS if f'kind = "{kind}"' in one)


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
        arm, hand = client.take("ASTA")[-1], stage.assembly.fleet.vehicles[0].body.look()
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
    known = set(str(caught.value).split("known keys: ")[1].rstrip(")").split(", "))
    tables = {"shape", "wheel", "caster", "drive", "report", "sensor", "camera"}
    tables |= {"actuator", "effector", "joints", "package"}
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
    known = set(str(caught.value).split("known keys: ")[1].rstrip(")").split(", "))
    assert section(title) == known


def example(kind: str) -> dict[str, Any]:
    """The first example of the page of this kind, as a table."""
    return tomllib.loads(block(kind))


def submarine() -> dict[str, Any]:
    """A robot of a kind that the page has no example of."""
    piece = {"kind": "box", "size": [1.0, 0.2, 0.2], "mass": 30.0}
    return {"kind": "underwater", "dialect": "udk", "shape": [piece]}


@pytest.mark.parametrize(
    ("title", "place", "robot"),
    [
        ("`[steering]`", ("steering",), example("ackerman")),
        ("`[flight]`", ("flight",), example("aerial")),
        ("`[vessel]`", ("vessel",), submarine()),
        ("`[legs]`", ("legs",), example("legged")),
        ("`[joints]`", ("joints",), example("legged")),
        ("`[joints.NAME]`", ("joints", "Ankle"), example("legged")),
        ("`[[package]]`", ("package", 0), example("legged")),
        ("`[[track]]`", ("track", 0), example("tracked")),
        ("`[[track.roller]]`", ("track", 0, "roller", 0), example("tracked")),
    ],
)
def test_tables_of_families_list_exactly_the_known_keys(
    tmp_path: Path, title: str, place: tuple[str | int, ...], robot: dict[str, Any]
) -> None:
    """The tables about single families and model files have exactly the keys that are known."""
    (tmp_path / "Hopper.xml").write_text(XML, encoding="utf-8")
    probe = "zzzzzzzzzzzz"
    spot: Any = copy.deepcopy(robot)
    whole = spot
    for step in place:
        spot = spot.setdefault(step, {}) if isinstance(step, str) else spot[step]
    spot[probe] = 1
    with pytest.raises(RobotDescriptionError, match=probe) as caught:
        load_robot(write(tmp_path, "Test", whole))
    known = set(str(caught.value).split("known keys: ")[1].rstrip(")").split(", "))
    joints = {"Hip", "Ankle", "Pan"}  # `[joints]` has tables named after them
    assert section(title) == known - joints


def test_kinds_are_all_described() -> None:
    """The page names every family, in the table of keys and in that of kinds."""
    described = section("Kinds")
    assert described == set(families())
    row = next(line for line in TEXT.splitlines() if line.startswith("| `kind` | `skid_steer`"))
    assert set(re.findall(r"`(\w+)`", row.split("|")[2])) == set(families())


def test_car_example_drives_a_circle(tmp_path: Path) -> None:
    """TOML alone: the car of the page drives on the circle of its wheel base and angle."""
    (tmp_path / "Cart.toml").write_text(block("ackerman"), encoding="utf-8")
    with Rehearsal(world="empty", robots=[tmp_path]) as stage:
        client = stage.connect()
        client.send("INIT {ClassName Cart} {Location 0,0,-0.1}")
        client.send("DRIVE {Speed 5} {FrontSteer 0.3}")
        stage.run(3.0)
        state = stage.assembly.fleet.vehicles[0].body.look()
        assert state is not None
        x, y, _ = state.pose.inverse().rotate(state.linear_velocity)
        turning = state.angular_velocity[2]
        # Speed of the middle of the rear axle over the turning rate.
        assert x / turning == pytest.approx(-0.36 / math.tan(0.3), rel=0.02)
        assert y / turning == pytest.approx(0.18, rel=0.05)


def test_aircraft_example_flies(tmp_path: Path) -> None:
    """TOML alone: the quadrotor of the page takes off and flies at its 4 m/s."""
    (tmp_path / "Wasp.toml").write_text(block("aerial"), encoding="utf-8")
    with Rehearsal(world="empty", robots=[tmp_path]) as stage:
        client = stage.connect()
        client.send("INIT {ClassName Wasp} {Location 0,0,-0.05}")
        stage.run(0.5)
        client.send("DRIVE {AltitudeVelocity 1}")
        stage.run(2.0)
        client.send("DRIVE {AltitudeVelocity 0} {LinearVelocity 100} {Normalized true}")
        stage.run(2.0)
        state = stage.assembly.fleet.vehicles[0].body.look()
        assert state is not None
        assert state.pose.position[2] > 1.5
        assert state.linear_velocity[0] == pytest.approx(4.0, abs=0.1)
        assert state.linear_velocity[2] == pytest.approx(0.0, abs=0.2)


def test_model_file_example_stands_and_moves(tmp_path: Path) -> None:
    """TOML and MJCF: the hopper of the page stands, bends its leg, and has a neck of a package."""
    (tmp_path / "Hopper.xml").write_text(XML, encoding="utf-8")
    (tmp_path / "Hopper.toml").write_text(block("legged"), encoding="utf-8")
    with Rehearsal(world="empty", robots=[tmp_path]) as stage:
        client = stage.connect()
        client.send("INIT {ClassName Hopper} {Location 0,0,-0.24}")
        stage.run(1.0)
        vehicle = stage.assembly.fleet.vehicles[0]
        state = vehicle.body.look()
        assert state is not None
        assert state.pose.position[2] == pytest.approx(0.23, abs=0.01)
        assert state.pose.rotate((0.0, 0.0, 1.0))[2] > 0.99
        client.send("SET {Type Joint} {Name Hip} {Opcode Angle} {Params 0.1}")
        client.send("DRIVE {Name Ankle} {Value -0.1}", "ACT {Name Neck} {Link 0} {Value 0.7}")
        stage.run(2.0)
        state = vehicle.body.look()
        assert state is not None
        places = [state.joint_position(name) for name in ("Hip", "Ankle", "Pan")]
        assert places == pytest.approx([0.1, -0.1, 0.7], abs=0.01)
        (status,) = client.take("STA")[-1:]
        assert re.search(r"\{Hip 0\.(1|0999)", status)
        assert "{Pan" not in status


def test_effector_types_are_all_described() -> None:
    """The page names every effector type that a robot file may name, but not their aliases."""
    body = TEXT.split("### `[[effector]]`", 1)[1].split("\n#", 1)[0]
    described = set(re.findall(r"^\| `([A-Z]\w+)` \|", body, re.MULTILINE))
    assert described == {"Gripper", "VacuumGripper", "ToolChanger"}
    assert described <= set(effector_types())
