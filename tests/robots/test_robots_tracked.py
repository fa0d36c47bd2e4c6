"""Tracked robots: belts around rollers, sprockets that move them, flippers, eight classes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from machine_fakes import TRACKED, compiled, shipped, tracked
from robot_files import number

from usarsim_server.protocol.values import Dialect
from usarsim_server.sensors.base import SensorContext, create_sensor
from usarsim_server.simulation.frames import Pose
from usarsim_server.testing import Rehearsal
from usarsim_server.worlds.description import WorldDescription

FLIPPERS = ("FRFlipper", "FLFlipper", "RRFlipper", "RLFlipper")


def test_aliases() -> None:
    """Robots 2, 3: names in any case, TarantulaSIED, and colours of the crawler."""
    assert shipped("USARBot.kenaf").name == "Kenaf"
    assert shipped("TarantulaSIED").model == "Tarantula"
    assert shipped("TarantulaSIED").name == "TarantulaSIED"
    assert shipped("crawler_robot_b").model == "crawler_robot"


def test_kenaf_says_what_its_body_does() -> None:
    """Robots reference 1.3: mass 24, MaxTorque 0.15, base and separation of the main wheels, in
    both dialects; the radius of its belts, not the inherited 0.2, since clients reckon with it
    (protocol check 132)."""
    robot = shipped("Kenaf")
    family = robot.family
    for dialect in Dialect:
        geo, conf = family.geometry(robot, dialect), family.configuration(robot, dialect)
        for words in ("{Dimensions 0.4000,0.2200,0", "{WheelRadius 0.0900}"):
            assert words in geo
        assert "{WheelSeparation 0.2200} {WheelBase 0.4000}" in geo
        for words in ("{SteeringType SkidSteered}", "{Mass 24.0000}", "{MaxTorque 0.1500}"):
            assert words in conf
        assert "{MaxSpeed 6.2830}" in conf or "{MaxSpeed 6.2829}" in conf
    assert robot.dialect is Dialect.UDK


@pytest.mark.parametrize(
    ("name", "mass", "speed", "length", "width"),
    [
        ("Tarantula", 15.0, 0.5, 0.70, 0.44),
        ("TeleMax", 75.0, 1.1, 0.80, 0.40),
        ("Rugbot", 35.0, 0.7, 0.55, 0.50),
        ("Talon", 52.0, 1.8, 0.86, 0.57),
        ("Matilda", 28.0, 0.9, 0.66, 0.51),
        ("Soryu", 9.5, 0.37, 1.16, 0.122),
        ("crawler_robot", 48.0, 0.25, 0.70, 0.362),
    ],
)
def test_figures_of_the_others(
    name: str, mass: float, speed: float, length: float, width: float
) -> None:
    """Robots reference 1.11 and 1.8: mass, top speed, footprint; CONF tells the mass of the
    bodies (robots 8)."""
    robot = shipped(name)
    assert robot.report.mass == pytest.approx(mass)
    top = robot.drive.max_wheel_speed * robot.driven_wheels[0].radius
    assert top == pytest.approx(speed, rel=0.001)
    assert robot.report.dimensions[:2] == pytest.approx((length, width))
    world = compiled(robot)
    bodies = sorted(world.layouts[0].bodies)
    assert world.model.body_mass[bodies].sum() == pytest.approx(mass, rel=0.001)
    assert robot.dialect is Dialect.UT2004
    across = [track.place(robot.actuators).position[1] for track in tracked(robot).tracks]
    reach = max(
        abs(y) + track.width / 2 for y, track in zip(across, tracked(robot).tracks, strict=True)
    )
    assert 2 * reach == pytest.approx(width, abs=0.012)


@pytest.mark.parametrize("name", TRACKED)
def test_items_can_be_made(name: str) -> None:
    """Every class has a laser, INS, ground truth and a camera, and all can be made; odometry it has
    but for the crawler of the bridge, which had none."""
    robot = shipped(name)
    world = WorldDescription("test", "Test", "", "", Path(), Path("scene.xml"), ())
    types = set()
    for item in robot.items:
        sensor = create_sensor(item, SensorContext(robot, world, np.random.default_rng(0)))
        types.add(sensor.wire_type)
    assert {"RangeScanner", "INS", "GroundTruth"} <= types
    assert ("Odometry" in types) is (name != "crawler_robot")
    assert "camera" in {camera.name.lower() for camera in robot.cameras}
    assert robot.battery is not None


def test_telemax_arm_is_the_captured_one() -> None:
    """Robots reference 1.10: eleven links, torque 300, 0.17 rad/s, the first two where captured."""
    (arm,) = (one for one in shipped("TeleMax").actuators if one.package)
    assert arm.name == "TeleMaxArm"
    assert len(arm.links) == 11
    assert {(link.max_torque, link.max_speed, link.home) for link in arm.links} == {
        (300.0, 0.17, 0.0)
    }
    assert arm.links[0].limits is None
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send("INIT {ClassName TeleMax} {Location 0,0,-0.1}")
        client.take()
        client.send("GETGEO {Type MisPkg} {Name TeleMaxArm}")
        (line,) = client.take("GEO")
        assert (
            "{Link 1} {ParentLink -1} {Location 0.1789,-0.0014,-0.0905}"
            " {Orientation 3.1415,0.0000,0.0000}" in line
        )
        assert (
            "{Link 2} {ParentLink 1} {Location 0.0258,-0.0720,0.1566}"
            " {Orientation 1.5707,0.0000,0.0000}" in line
        )


@pytest.fixture(scope="module")
def crowd() -> Iterator[Rehearsal]:
    """All classes, each spawned from 1.4 m and from 2.1 m in one world, three seconds later."""
    with Rehearsal(world="empty", max_robots=2 * len(TRACKED)) as stage:
        for row, height in enumerate((1.4, 2.1)):
            for column, name in enumerate(TRACKED):
                client = stage.connect()
                client.send(
                    f"INIT {{ClassName USARBot.{name}}} {{Name {name}{row}}}"
                    f" {{Location {3 * column},{3 * row},{-height}}}"
                )
        stage.run(3.0)
        yield stage


@pytest.mark.parametrize("row", [0, 1])
@pytest.mark.parametrize("name", TRACKED)
def test_settles_from_high_up(crowd: Rehearsal, name: str, row: int) -> None:
    """Robots 17: dropped from 1.4 or 2.1 m every class stands upright at its rest height after 3
    s."""
    state = crowd.robot_state(f"{name}{row}")
    x, y, z = state.pose.position
    assert z == pytest.approx(shipped(name).rest_height, abs=0.002)
    assert state.pose.rotate((0.0, 0.0, 1.0))[2] > 0.99999
    assert (x, y) == pytest.approx((3 * TRACKED.index(name), -3 * row), abs=0.02)
    assert max(map(abs, state.linear_velocity)) < 1e-3


def test_nobody_drifts(crowd: Rehearsal) -> None:
    """Robots 64: what stands stays where it is."""
    before = {one.name: one.body.look() for one in crowd.assembly.robots.vehicles}
    crowd.run(5.0)
    for one in crowd.assembly.robots.vehicles:
        now, then = one.body.look(), before[one.name]
        assert now is not None
        assert then is not None
        assert math.dist(now.pose.position, then.pose.position) < 1e-4


def test_flippers_of_ut2004() -> None:
    """Protocol 88 and 154: MULTIDRIVE in any case; STA lists FR, FL, RR, RL between
    RearSteer and LightToggle; a missing one keeps its angle."""
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send("INIT {ClassName kenaf} {Location 0,0,-0.1} {Dialect ut2004}")
        client.send("MULTIDRIVE {FRFlipper 0.5} {FLflipper 0.5}")
        stage.run(2.0)
        line = client.take("STA")[-1]
        keys = re.findall(r"\{(\w+) ", line)
        at = keys.index("RearSteer")
        assert keys[at + 1 : at + 6] == [*FLIPPERS, "LightToggle"]
        assert [number(line, key) for key in FLIPPERS] == pytest.approx([0.5, 0.5, 0, 0], abs=0.01)
        client.send("MultiDrive {RRFlipper 1.0}")
        stage.run(2.0)
        line = client.take("STA")[-1]
        assert [number(line, key) for key in FLIPPERS] == pytest.approx(
            [0.5, 0.5, 1.0, 0], abs=0.01
        )


def test_flippers_of_udk() -> None:
    """Protocol 3.7: SET {Type Joint} moves one flipper, and so does DRIVE by its name."""
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send("INIT {ClassName Kenaf} {Location 0,0,-0.1} {Dialect udk}")
        client.send("SET {Type Joint} {Name FRFlipper} {Opcode Angle} {Params -0.6}")
        client.send("DRIVE {Name RLFlipper} {Value 0.4}")
        stage.run(2.0)
        state = stage.robot_state()
        angles = [state.joint_position(joint) for joint in FLIPPERS]
        assert angles == pytest.approx([-0.6, 0.0, 0.0, 0.4], abs=0.01)


@pytest.mark.parametrize(
    ("name", "up"),
    [
        ("Kenaf", (-1, -1, 1, 1)),
        ("Tarantula", (-1, -1, 1, 1)),
        ("TeleMax", (-1, -1, 1, 1)),
        ("Rugbot", (-1, -1)),
        ("crawler_robot", (1, 1, 1, 1)),
    ],
)
def test_which_way_is_up(name: str, up: tuple[int, ...]) -> None:
    """Clients raise front flippers with negative and rear ones with positive angles; those of the
    prototype of 2015 are all raised with positive ones."""
    robot = shipped(name)
    for joint, sign in zip(FLIPPERS[: len(up)], up, strict=True):
        found = robot.find_link(joint)
        assert found is not None
        link = found[0].links[found[1] - 1]
        ahead = 1.0 if joint[0] == "F" else -1.0
        tip = link.placed(sign * 0.5).rotate((ahead, 0.0, 0.0))
        assert tip[2] == pytest.approx(math.sin(0.5))


def test_crawler_appears_with_raised_flippers() -> None:
    """Protocol 3.5: the prototype's flippers begin at 45 degrees."""
    robot = shipped("crawler_robot")
    assert {link.home for link in robot.links} == {0.785398}


def test_drive_and_odometry() -> None:
    """Robots 22, 34: Kenaf goes at its belts' speed and turns clockwise with the left side faster;
    its odometry tells the way that it has gone."""
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send("INIT {ClassName Kenaf} {Location 0,0,-0.09}")
        stage.run(0.5)
        client.send("DRIVE {Left 3} {Right 3}")
        stage.run(4.0)
        client.send("DRIVE {Left 0} {Right 0}")
        stage.run(1.0)
        truth = client.take("SEN")
        x = location(truth)[0]
        assert x == pytest.approx(4.0 * 3 * 0.09, rel=0.03)
        odometry = re.findall(r"\{Type Odometry\}.*?\{Pose ([-\d.]+),", "\n".join(truth))
        assert float(odometry[-1]) == pytest.approx(x, rel=0.05)
        client.send("DRIVE {Left 100} {Right -100} {Normalized True}")
        stage.run(1.0)
        yaw = orientation(client.take("SEN"))[2]
        assert yaw > 0.3


def location(lines: list[str]) -> list[float]:
    return _last(lines, "Location")


def orientation(lines: list[str]) -> list[float]:
    return _last(lines, "Orientation")


def _last(lines: list[str], key: str) -> list[float]:
    line = next(one for one in reversed(lines) if "{Type GroundTruth}" in one)
    found = re.search(rf"\{{{key} ([^}}]+)\}}", line)
    assert found is not None
    return [float(word) for word in found[1].split(",")]


def test_belts_run_on_when_the_world_grows() -> None:
    """A robot that drives keeps its speed while others come, and goes on from rest afterwards."""
    with Rehearsal(world="empty", max_robots=12) as stage:
        first = stage.connect()
        first.send("INIT {ClassName Kenaf} {Location 0,0,-0.09} {Dialect ut2004}")
        first.send("DRIVE {Left 3} {Right 3}")
        stage.run(1.0)
        for n in range(9):
            stage.connect().send(f"INIT {{ClassName Kenaf}} {{Location {n},5,-0.09}}")
        stage.run(0.5)
        state = stage.robot_state()
        assert state.linear_velocity[0] == pytest.approx(0.27, abs=0.005)
        for vehicle in stage.assembly.robots.vehicles[1:]:
            resting = vehicle.body.look()
            assert resting is not None
            assert math.hypot(*resting.linear_velocity) < 1e-3


def test_soryu_bends() -> None:
    """Soryu raises its head and turns it, and the head's belts stay with it."""
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send("INIT {ClassName Soryu} {Location 0,0,-0.08}")
        client.send("MULTIDRIVE {FrontPitch 0.5} {FrontYaw 0.3}")
        stage.run(2.0)
        state = stage.robot_state()
        assert state.joint_position("FrontPitch") == pytest.approx(0.5, abs=0.01)
        head = state.link_pose("FrontBody")
        nose = head.rotate((1.0, 0.0, 0.0))
        assert nose[2] == pytest.approx(math.sin(0.5), abs=0.02)
        assert nose[1] > 0.2
        assert head.position[2] == pytest.approx(0.0725, abs=0.01)


PAGE = (Path(__file__).parents[2] / "docs" / "robot-files.md").read_text(encoding="utf-8")


def test_example_of_the_page_climbs(tmp_path: Path) -> None:
    """The crawler of the page drives, and raises its flippers as the page says."""
    blocks = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    (text,) = (block for block in blocks if 'kind = "tracked"' in block)
    (tmp_path / "Crawler.toml").write_text(text, encoding="utf-8")
    with Rehearsal(world="empty", robots=[tmp_path]) as stage:
        client = stage.connect()
        client.send("INIT {ClassName Crawler} {Location 0,0,-0.1}")
        client.send("MULTIDRIVE {FRFlipper -0.5} {FLFlipper -0.5}", "DRIVE {Left 3} {Right 3}")
        stage.run(3.0)
        state = stage.robot_state()
        assert state.pose.position[0] > 0.5
        tip = state.link_pose("FRFlipper") @ Pose((0.2, 0.0, 0.0))
        assert tip.position[2] == pytest.approx(0.08 + 0.2 * math.sin(0.5), abs=0.01)
        line = client.take("STA")[-1]
        assert number(line, "FRFlipper") == pytest.approx(-0.5, abs=0.01)
