"""The how-to pages of robots and families work as written; `usarsim robots --check` shows an author
what he made.
"""

from __future__ import annotations

import copy
import math
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from robot_files import SENSOR, table, write

from usarsim_doctor.robots_command import check
from usarsim_server.actuators.effectors import effector_types
from usarsim_server.errors import RobotDescriptionError
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.catalog import load_catalog, load_robot
from usarsim_server.robots.families import base
from usarsim_server.robots.families import base as registry
from usarsim_server.robots.families.base import families
from usarsim_server.robots.mjcf import build_spec
from usarsim_server.testing import Rehearsal

PAGE = Path(__file__).parents[2] / "docs" / "robot-files.md"
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
    catalog = load_catalog([tmp_path])
    robot = catalog.find("USARBot.Rover")
    assert robot is not None
    assert [item.name for item in robot.items] == ["Scanner1", "F1"]
    assert robot.rest_height == pytest.approx(0.12)
    assert catalog.find("minirover") is not None
    assert build_spec(robot).compile().body_mass.sum() == pytest.approx(robot.report.mass)


def test_variant_example_is_a_fast_p3at(tmp_path: Path) -> None:
    """The variant of the page replaces P3AT by a fast one."""
    (tmp_path / "P3AT.toml").write_text(BLOCKS[1], encoding="utf-8")
    robot = load_catalog([tmp_path]).find("P3AT")
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
        arm, hand = client.take("ASTA")[-1], stage.assembly.robots.vehicles[0].body.look()
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
        state = stage.robot_state()
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
        state = stage.robot_state()
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
        state = stage.robot_state()
        assert state.pose.position[2] == pytest.approx(0.23, abs=0.01)
        assert state.pose.rotate((0.0, 0.0, 1.0))[2] > 0.99
        client.send("SET {Type Joint} {Name Hip} {Opcode Angle} {Params 0.1}")
        client.send("DRIVE {Name Ankle} {Value -0.1}", "ACT {Name Neck} {Link 0} {Value 0.7}")
        stage.run(2.0)
        state = stage.robot_state()
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


DOCS = Path(__file__).parents[2] / "docs"
HOWTO_PAGE = (DOCS / "howto" / "family.md").read_text(encoding="utf-8")
FAMILIES = (DOCS / "families.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """Code blocks of the page."""
    return re.findall(rf"```{language}\n(.*?)```", HOWTO_PAGE, re.DOTALL)


@pytest.fixture
def twist(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The example's family, registered for the length of a test."""
    registry.families()
    monkeypatch.setattr(registry.TYPES, "_types", dict(registry.TYPES._types))
    names: dict[str, Any] = {"__name__": "twist_of_the_page"}
    exec(blocks("python")[0], names)
    return registry.register_family("twist")(names["Twist"])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The folder of the example's robot file."""
    (tmp_path / "TwistP2DX.toml").write_text(blocks("toml")[1], encoding="utf-8")
    return tmp_path


def test_a_new_family_is_a_kind_of_robot_files(twist: Any, folder: Path) -> None:
    """One file is enough: robot files may name the family, and inherit the rest."""
    robot = load_robot(folder / "TwistP2DX.toml")
    assert "twist" in registry.families()
    assert type(robot.family) is twist
    assert robot.kind == "twist"
    assert robot.report.steering_type == "SkidSteered"
    # Another law, so other slots than those of P2DX.
    assert robot.model == "TwistP2DX"


@pytest.mark.usefixtures("twist")
def test_the_example_stands_nonsense(folder: Path) -> None:
    """Absent members keep their value, nonsense counts as absent, wheels keep their limit."""
    from machine_fakes import Driver

    driver = Driver(load_robot(folder / "TwistP2DX.toml"))
    assert driver.send(linear_velocity=0.195)
    assert driver.machine.wheels == pytest.approx([2.0, 2.0])
    driver.obey(Drive(linear_velocity=float("nan"), rotational_velocity=1e9))
    assert driver.machine.wheels == pytest.approx([5.4, -5.4])
    assert not driver.send(left=1.0, right=1.0)
    assert "{Type GroundVehicle}" in driver.machine.description.family.configuration(
        driver.machine.description, Dialect.UT2004
    )


def test_the_table_names_what_a_family_may_say() -> None:
    """Every public member of a family is in the table of the page, and nothing else."""
    said = set()
    for row in re.findall(r"^\| (`[^|]*`) \|", FAMILIES, re.MULTILINE):
        said |= set(re.findall(r"`(\w+)", row))
    members = {name for name in vars(base.Family) if not name.startswith("_")}
    assert said == members


def test_what_is_wrong_is_told_before_anything_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A key that only the sensor itself refuses is found first, too."""
    path = write(tmp_path, "Bad", table(sensor=[{**SENSOR, "beem_angle": 1.0}]))
    with pytest.raises(RobotDescriptionError, match="beem_angle: unknown key of a Sonar"):
        check(path, [], None)
    assert capsys.readouterr().out == ""


def test_sensors_speak_beside_conf_geo_and_sta(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each sensor has a line in both dialects."""
    path = write(tmp_path, "Good", table(caster=[], wheel=table()["wheel"] + rear()))
    check(path, [], None)
    said = capsys.readouterr().out
    for head in ("CONF {", "GEO {", "STA {"):
        assert f"\n{head}" in said
    assert "{Type Sonar} {Name F1 Range 5.0000}" in said
    assert "{Type Sonar} {Name F1} {Range 5.0000}" in said


def rear() -> list[dict[str, object]]:
    """Two more wheels, so that it stands."""
    wheels = [{**one, "name": f"Rear{one['name']}"} for one in table()["wheel"]]
    for one in wheels:
        one["position"] = [-0.3, one["position"][1], one["position"][2]]
    return wheels
