"""Every class of the catalog: figures of the reference, and what they do in the world."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from robot_files import table, write
from sharing import shipped_robots

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.catalog import load_catalog
from usarsim_server.robots.families.base import families
from usarsim_server.sessions.robots import robot_model
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose, wire_from_pose
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.testing import Rehearsal, RehearsedClient

ROSTER = shipped_robots()
ROBOTS = {robot.name: robot for robot in ROSTER.descriptions()}
FLOATS = ("aerial", "underwater")
STATIC = sorted(name for name, robot in ROBOTS.items() if robot.kind == "static")
GROUND = sorted(
    robot.model
    for robot in ROBOTS.values()
    if robot.model == robot.name and robot.kind not in (*FLOATS, "static")
)

NAMES = """P2AT StereoP2AT P2AT_ATLANTA P2DX OmniP2AT OmniP2DX P3AT P3DX ATRVJr ATRV ATRV2 Zerg
Tarantula TarantulaSIED Talon TeleMax Kenaf kenaf Soryu Rugbot Kurt2D KURT2D Kurt3D Kurt Element
Matilda SegwayRMPFifty UnitLoader MDS Nomad Lisa Hummer HMMWV SnowStorm Sedan Cooper ForkLift
Submarine Passarola AirRobot AIRRobot ARDrone ERS QRIO Nao BasicSkidRobot CasterSkidRobot Kiva4Wheel
BasicAckermanRobot FrontAckerman KR60 KR3 KR5 KR6 FanucM16 Fanuc_M16iB20 Fanuc_Robot_And_Rail
KUKA_LWR_BOT TwoLink Forklift GripperBase HandBot KinectBot KRobot crawler_robot quadrotor
turtlebot pioneer2dx_with_sensors pioneer3at_with_sensors"""
"""Classes of robots reference 1.1, with spellings that occur."""

KINDS = {
    "ackerman": "BasicAckermanRobot Cooper ForkLift FrontAckerman Hummer Sedan SnowStorm",
    "aerial": "AirRobot ARDrone Passarola quadrotor",
    "underwater": "Submarine",
    "legged": "ERS Nao QRIO",
    "omni": "Lisa",
    "tracked": "Kenaf Matilda Rugbot Soryu Talon Tarantula TeleMax crawler_robot",
    "static": "KR60 KR3 KR5 KR6 FanucM16 Fanuc_M16iB20 Fanuc_Robot_And_Rail KUKA_LWR_BOT TwoLink"
    " ForkliftUDK GripperBase HandBot KinectBot",
}


# -- roster ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES.split())
def test_every_class_of_the_reference_is_there(name: str) -> None:
    """Class names and aliases of robots 1.1 are found in any case, with a package (robots 1, 2,
    3)."""
    robot = ROSTER.find(f"USARBot.{name}")
    assert robot is not None
    for spelling in (name.lower(), name.upper()):
        if spelling.lower() != "forklift":
            other = ROSTER.find(spelling)
            assert other is not None
            assert other.model == robot.model


@pytest.mark.parametrize("kind", KINDS)
def test_kinds(kind: str) -> None:
    """Classes belong to the families of robots 1.1, and every family has one."""
    for name in KINDS[kind].split():
        assert ROBOTS[name].kind == kind
    assert set(KINDS) <= set(families())


def test_two_fork_lifts() -> None:
    """ForkLift is the UT2004 truck, Forklift the UDK platform; other spellings mean the truck."""
    truck, platform = ROSTER.find("USARBot.ForkLift"), ROSTER.find("USARBot.Forklift")
    other = ROSTER.find("FORKLIFT")
    assert truck is not None
    assert platform is not None
    assert other is not None
    assert (truck.kind, platform.kind, other.kind) == ("ackerman", "static", "ackerman")
    assert platform.name == "Forklift"


def test_exact_aliases(tmp_path: Path) -> None:
    """They win in their own spelling, follow a class that is replaced, and are unique."""
    write(tmp_path, "Rover", table(exact_aliases=["p2AT"]))
    catalog = load_catalog([tmp_path])
    for name, model in (("p2AT", "Rover"), ("P2AT", "P2AT"), ("p2at", "P2AT")):
        robot = catalog.find(f"USARBot.{name}")
        assert robot is not None
        assert robot.model == model
    write(tmp_path / "own", "ForkliftUDK", table())
    robot = load_catalog([tmp_path / "own"]).find("Forklift")
    assert robot is not None
    assert (robot.name, robot.kind) == ("Forklift", "differential")
    write(tmp_path, "Other", table(exact_aliases=["p2AT"]))
    with pytest.raises(RobotDescriptionError, match="'p2AT' is also an exact alias in"):
        load_catalog([tmp_path])
    write(tmp_path, "Other", table(exact_aliases=["a b"]))
    with pytest.raises(RobotDescriptionError, match="exact_aliases: has 'a b'"):
        load_catalog([tmp_path])


# -- figures ---------------------------------------------------------------------------------------

UDK_WHEELED = {
    "BasicSkidRobot": (1.152, 0.6, 0.128, 1.4),
    "CasterSkidRobot": (1.152, 0.684, 0.128, 1.5),
    "Kiva4Wheel": (0.648, 0.864, 0.098, 1.8),
    "BasicAckermanRobot": (1.152, 0.6, 0.128, 1.4),
    "FrontAckerman": (0.452, 0.956, 0.128, 0.56),
}
"""Track, base, declared radius, announced wheel limit (robots reference 1.2, 1.4); where there are
two driven wheels, the base is that to the casters."""


@pytest.mark.parametrize("name", UDK_WHEELED)
def test_figures_of_udk_vehicles(name: str) -> None:
    """Track, base, radius and limit, torque 50000; Dimensions repeat them (robots 1.2, 1.4
    and 7).

    The track is that from the left front to the right rear wheel.
    """
    robot = ROBOTS[name]
    report = robot.report
    found = (report.track_width, report.wheel_base, report.wheel_radius, report.max_speed)
    assert found == UDK_WHEELED[name]
    assert report.dimensions == (report.wheel_base, report.track_width, 0.0)
    assert report.max_torque == 50000
    assert robot.dialect is Dialect.UDK
    line = robot.family.geometry(robot, Dialect.UDK)
    assert f"{{WheelSeparation {report.track_width:.4f}}}" in line


def test_masses_of_udk_vehicles() -> None:
    """BasicSkidRobot 14 kg, CasterSkidRobot 13 kg, Kiva4Wheel the sum of its parts (robots 7)."""
    assert ROBOTS["BasicSkidRobot"].report.mass == pytest.approx(14.0)
    assert ROBOTS["CasterSkidRobot"].report.mass == pytest.approx(13.0)
    kiva = ROBOTS["Kiva4Wheel"]
    total = sum(shape.mass for shape in kiva.shapes) + sum(wheel.mass for wheel in kiva.wheels)
    total += sum(caster.mass for caster in kiva.casters) + sum(link.mass for link in kiva.links)
    assert kiva.report.mass == pytest.approx(total + kiva.effectors[0].mass)
    assert sum(shape.mass for shape in kiva.shapes) == 12.0


def place(name: str, link: str) -> tuple[float, ...]:
    """Where a link's joint is when the robot appears, wire frame."""
    return wire_from_pose(ROBOTS[name].home_pose(link))[0]


def test_places_of_udk_parts() -> None:
    """Casters, grippers and arms hang where robots 1.2, 1.4 and 1.9 have them; z up is negative
    (robots 15)."""
    (caster,) = ROBOTS["CasterSkidRobot"].casters
    assert caster.position == pytest.approx((0.384, 0.0, -0.136))
    kiva = ROBOTS["Kiva4Wheel"]
    assert {tuple(map(abs, one.position)) for one in kiva.casters} == {(0.432, 0.0, 0.24)}
    tops = {one.name: wire_from_pose(one.pose)[0] for one in kiva.actuators}
    assert tops["kivaTop"] == pytest.approx((0, 0, -0.21))
    arms = {one.name: wire_from_pose(one.pose)[0] for one in ROBOTS["BasicAckermanRobot"].actuators}
    assert arms["ForkliftArm"] == pytest.approx((1, 0, 0))
    for name, number, where in (
        ("BasicSkidRobot", 0, (-1, 0, 0)),
        ("KR6", 0, (1.68, 0.092, -1.62)),
        ("GripperBase", 0, (1.68, 0.092, -1.62)),
        ("Fanuc_M16iB20", 0, (1.075, 0, -1.256)),
        ("Fanuc_Robot_And_Rail", 1, (2.57, -0.26, -1.3)),
        ("Fanuc_Robot_And_Rail", 2, (2.57, -0.26, -1.9)),
        ("Fanuc_Robot_And_Rail", 3, (2.57, -0.26, -2.5)),
    ):
        robot = ROBOTS[name]
        item = robot.effectors[number].item
        found = robot.home_pose(item.link) @ item.pose
        assert wire_from_pose(found)[0] == pytest.approx(where, abs=2e-3), name


LINKS = {
    "Fanuc_M16iB20": [
        ((-2.967, 2.967), 100),
        ((-1.571, 2.793), 100),
        ((-2.967, 4.538), 50),
        ((-3.491, 3.491), 50),
        ((-3.491, 3.491), 25),
        ((-7.854, 7.854), 10),
    ],
    "ForkliftUDK": [((-0.2, 0.2), 50), ((-0.3, 0.3), 50)],
    "KinectBot": [((-0.2618, 0.2618), 600)],
    "TwoLink": [((-2.967, 2.967), 50000)],
}
"""Ranges and forces of arms (robots reference 1.9)."""


@pytest.mark.parametrize("name", LINKS)
def test_ranges_of_arms(name: str) -> None:
    """Arm platforms have the ranges and forces of robots 1.9 (robots 12)."""
    (arm,) = ROBOTS[name].actuators
    assert [(link.limits, link.max_torque) for link in arm.links] == LINKS[name]


def test_ranges_of_other_arms() -> None:
    """The rail, the KUKA arm and the forks (robots 1.9, 12)."""
    rail, arm = ROBOTS["Fanuc_Robot_And_Rail"].actuators
    assert [(one.limits, one.max_torque, one.damping) for one in rail.links] == [
        ((-1.5, 1.5), 30, 10)
    ]
    assert rail.links[0].type.value == "Prismatic"
    assert [(one.limits, one.max_torque) for one in arm.links] == LINKS["Fanuc_M16iB20"]
    assert arm.mount == rail.links[0].body
    (kuka,) = ROBOTS["KUKA_LWR_BOT"].actuators
    assert len(kuka.links) == 7
    assert {(one.max_torque, one.damping) for one in kuka.links} == {(700, 100)}
    for link in kuka.links:
        assert link.limits == pytest.approx((-math.pi, math.pi), abs=1e-4)
    heights = [place("KUKA_LWR_BOT", link.body)[2] for link in kuka.links]
    assert heights == pytest.approx([-0.12, -0.31, -0.52, -0.71, -0.92, -1.1, -1.155])
    for name in ("KR6", "GripperBase", "BasicSkidRobot"):
        fingers = ROBOTS[name].effectors[0].fingers
        assert [(one.limits, one.max_torque, one.damping) for one in fingers] == [
            ((-0.5, 0.5), 1000, 200)
        ] * 2


STARTING = {
    "ATRVJr": (50, 1.0),
    "Talon": (52, 1.8),
    "TeleMax": (75, 1.1),
    "Tarantula": (15, 0.5),
    "Zerg": (5, 0.5),
    "Kurt2D": (15.6, 4.0),
    "Kurt3D": (22.6, 4.0),
    "Rugbot": (35, 0.7),
    "Soryu": (9.5, 0.37),
    "Sedan": (1400, 30.0),
    "Cooper": (1100, 30.0),
    "Hummer": (3000, 20.0),
    "Lisa": (25, 0.5),
    "Matilda": (28, 0.9),
    "SegwayRMPFifty": (34, 3.6),
    "ERS": (1.6, None),
    "QRIO": (7.3, None),
}
"""Mass (kg) and top speed (m/s) of robots 1.11."""


@pytest.mark.parametrize("name", STARTING)
def test_starting_values(name: str) -> None:
    """Robots without recoverable numbers have the masses and speeds that robots 1.11 starts
    from."""
    robot, (mass, speed) = ROBOTS[name], STARTING[name]
    assert robot.report.mass == pytest.approx(mass, rel=0.06)
    if speed is not None:
        top = robot.drive.max_wheel_speed * robot.report.wheel_radius
        assert top == pytest.approx(speed, rel=0.02)


def test_captured_figures() -> None:
    """Sizes of Zerg, ATRVJr and P2DX come from clients and captures (robots 1.6)."""
    zerg, atrv = ROBOTS["Zerg"].report, ROBOTS["ATRVJr"].report
    assert (zerg.wheel_radius, zerg.track_width) == (0.0606, 0.19)
    assert zerg.dimensions[:2] == (0.3, 0.3)
    assert (atrv.wheel_radius, atrv.track_width, atrv.wheel_base) == (0.1922, 0.512, 0.388)
    assert atrv.dimensions == (0.7744, 0.6318, 0.5754)
    assert atrv.center_of_gravity == (0.0, 0.0, -0.1)
    sonars = [item for item in ROBOTS["ATRVJr"].items if item.type == "Sonar"]
    front = [wire_from_pose(item.pose) for item in sonars[:5]]
    assert [place[0] for place, _ in front] == pytest.approx([0.335, 0.340, 0.347, 0.340, 0.335])
    yaws = [math.degrees(rotation[2]) for _, rotation in front]
    assert yaws == pytest.approx([-30, -15, 0, 15, 30], abs=1e-3)
    assert len(sonars) == 17
    ring = [wire_from_pose(item.pose) for item in ROBOTS["Nomad"].items if item.type == "Sonar"]
    assert len(ring) == 16
    for number, ((x, y, z), (_, _, yaw)) in enumerate(ring):
        assert (math.hypot(x, y), z) == pytest.approx((0.19, -0.26), abs=1e-3)
        # From the front to the left and round.
        assert math.remainder(yaw + number * math.tau / 16, math.tau) == pytest.approx(0, abs=1e-5)


# -- in the physics --------------------------------------------------------------------------------


def _floor() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], friction=[1, 0.005, 0]
    )
    return spec


@pytest.mark.parametrize("name", GROUND)
def test_dropped_from_a_metre_it_stands(name: str) -> None:
    """It rests within 1 cm of its rest height after 3 s, upright, and bounces < 5 cm
    (robots 17)."""
    robot = ROBOTS[name]
    engine = Engine(_floor, PhysicsOptions(), [robot_model(robot)])
    engine.occupy(0, 0, Pose((0.0, 0.0, robot.rest_height + 1.0)))
    heights = []
    for _ in range(375):
        assert engine.advance(2) == []
        heights.append(engine.pose(0).position[2])
    landed = next(n for n, height in enumerate(heights) if height < robot.rest_height)
    assert max(heights[landed:]) < robot.rest_height + 0.05
    assert heights[-1] == pytest.approx(robot.rest_height, abs=0.01)
    assert engine.pose(0).rotate((0.0, 0.0, 1.0))[2] > 0.999
    assert np.hypot(*engine.pose(0).position[:2]) < 0.02
    dof = engine.world.layouts[0].dof
    assert np.abs(engine.data.qvel[dof : dof + 6]).max() < 0.01


# -- in the world ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def platforms() -> Iterator[tuple[Rehearsal, dict[str, RehearsedClient]]]:
    """All static platforms in one world, 6 m apart."""
    with Rehearsal(world="empty", max_robots=32) as stage:
        clients = {}
        for number, name in enumerate(STATIC):
            clients[name] = client = stage.connect()
            client.send(f"INIT {{ClassName {name}}} {{Name {name}}} {{Location {6 * number},0,0}}")
        yield stage, clients


def test_platforms_stand(platforms: tuple[Rehearsal, dict[str, RehearsedClient]]) -> None:
    """Neither DRIVE nor gravity nor a truck that drives into it moves a platform (robots 13)."""
    stage, clients = platforms
    stage.run(0.5)
    before = {name: stage.robot_state(name).pose.position for name in STATIC}
    for client in clients.values():
        client.send("DRIVE {Left 5} {Right 5}", "DRIVE {Speed 5} {FrontSteer 0} {RearSteer 0}")
        client.send("DRIVE {LinearVelocity 1} {AltitudeVelocity 1}")
    x = 6 * STATIC.index("KR60")
    truck = stage.connect()
    truck.send(f"INIT {{ClassName Zerg}} {{Name Ram}} {{Location {x - 2},0,-0.1}}")
    truck.send("DRIVE {Left 100} {Right 100} {Normalized true}")
    stage.run(4.0)
    ram = stage.robot_state("Ram")
    assert x - 1.8 < ram.pose.position[0] < x
    assert abs(ram.linear_velocity[0]) < 0.05
    for name in STATIC:
        assert stage.robot_state(name).pose.position == pytest.approx(before[name], abs=1e-3), name
    truck.close()


def test_arms_list_their_links_from_one(
    platforms: tuple[Rehearsal, dict[str, RehearsedClient]],
) -> None:
    """ASTA names every link of every arm in chain order, counted from 1 (robots 12)."""
    stage, clients = platforms
    stage.run(0.5)
    checked = 0
    for name, client in clients.items():
        lines = client.take("ASTA")
        for actuator in ROBOTS[name].actuators:
            line = next(one for one in lines if f"{{Name {actuator.name}}}" in one)
            numbers = [int(number) for number in re.findall(r"\{Link (\d+)\}", line)]
            assert numbers == list(range(1, len(actuator.links) + 1)), name
            checked += 1
    assert checked >= 10


def test_an_unknown_class_leaves_the_connection_usable() -> None:
    """INIT of a class that nobody described is an error; the next INIT succeeds (robots 1)."""
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send("INIT {ClassName USARBot.NoSuchRobot} {Location 0,0,-1}")
        assert not stage.assembly.robots.vehicles
        client.send("INIT {ClassName USARBot.Lisa} {Location 0,0,-0.2}")
        (vehicle,) = stage.assembly.robots.vehicles
        assert vehicle.description.name == "Lisa"


@pytest.mark.parametrize("name", ["Sedan", "Lisa", "SegwayRMPFifty", "Kenaf", "Nao"])
def test_an_overturned_robot_rights_itself_in_ut2004_only(name: str) -> None:
    """`Flip true` sets it on its wheels or feet in `ut2004` and does nothing in `udk` (robots 50).

    It is harmless for a robot that stands (protocol 153).
    """
    robot = ROBOTS[name]
    with Rehearsal(world="empty") as stage:
        for dialect, y in (("ut2004", 0), ("udk", 20)):
            client = stage.connect()
            height = max(robot.report.dimensions[2], 0.5)
            client.send(
                f"INIT {{ClassName {name}}} {{Name {dialect}}} {{Dialect {dialect}}}"
                f" {{Location 0,{y},{-height}}} {{Rotation 3.1416,0,0.5}}"
            )
            stage.run(2.0)
            assert stage.robot_state(dialect).pose.rotate((0.0, 0.0, 1.0))[2] < 0.5
            before = stage.robot_state(dialect).pose.position
            for _ in range(2):  # the second one finds it standing
                client.send("DRIVE {Flip True}")
                stage.run(1.5)
            state = stage.robot_state(dialect)
            assert (state.pose.rotate((0.0, 0.0, 1.0))[2] > 0.99) == (dialect == "ut2004")
            assert math.dist(state.pose.position[:2], before[:2]) < 0.1
            if dialect == "ut2004":
                assert state.pose.position[2] == pytest.approx(robot.rest_height, abs=0.02)


def test_classes_come_one_after_the_other() -> None:
    """One client after the other spawns a class of another family, from 2 m (robots 1.1)."""
    names = ["Hummer", "AirRobot", "Submarine", "QRIO", "Lisa", "Talon", "KR6", "Zerg"]
    with Rehearsal(world="empty") as stage:
        for name, number in zip(names, itertools.count()):
            client = stage.connect()
            client.send(f"INIT {{ClassName USARBot.{name}}} {{Location {8 * number},0,-2}}")
            stage.run(0.6)
            assert client.take("STA"), name
        assert len(stage.assembly.robots.vehicles) == len(names)
