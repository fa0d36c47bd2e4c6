"""Machines on legs (protocol reference 3.4.6, 3.4.7, 4.4; robots reference 1.7)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from machine_fakes import ROBOTS, UDK, UT, Driver
from robot_files import write

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.families.legged import Legged
from usarsim_server.robots.mjcf import build_spec
from usarsim_server.sessions.robots import Vehicle
from usarsim_server.simulation.snapshot import RobotBody
from usarsim_server.testing import Rehearsal, RehearsedClient

NAO = ROBOTS["Nao"]
LEGGED = sorted(name for name, robot in ROBOTS.items() if robot.kind == "legged")

RANGES = {
    "HeadYaw": (-2.086, 2.086),
    "HeadPitch": (-0.672, 0.515),
    "LShoulderPitch": (-2.086, 2.086),
    "RShoulderPitch": (-2.086, 2.086),
    "LShoulderRoll": (0.0087, 1.649),
    "RShoulderRoll": (-1.649, -0.0087),
    "LElbowYaw": (-2.086, 2.086),
    "RElbowYaw": (-2.086, 2.086),
    "LElbowRoll": (-1.56, -0.0087),
    "RElbowRoll": (-0.0087, 1.56),
    "LHipYawPitch": (-1.1452, 0.7407),
    "RHipYawPitch": (-1.1452, 0.7407),
    "LHipRoll": (-0.3794, 0.7905),
    "RHipRoll": (-0.7382, 0.4147),
    "LHipPitch": (-1.772, 0.4855),
    "RHipPitch": (-1.772, 0.4855),
    "LKneePitch": (-0.1029, 2.12),
    "RKneePitch": (-0.1029, 2.12),
    "LAnklePitch": (-1.185, 0.9844),
    "RAnklePitch": (-1.1861, 0.932),
    "LAnkleRoll": (-0.7689, 0.3978),
    "RAnkleRoll": (-0.3887, 0.7859),
}
"""Of Nao, rad (robots reference 1.7)."""


# -- figures ---------------------------------------------------------------------------------------


def test_figures_of_nao() -> None:
    """Ranges, forces, damping, masses and the status period are those of robots 1.7."""
    links = {link.joint: link for link in NAO.links}
    assert {name: link.limits for name, link in links.items()} == RANGES
    for name, link in links.items():
        force = 1 if "Head" in name else 8 if "Shoulder" in name or "Elbow" in name else 16
        assert (link.max_torque, link.damping) == (force, 0.05), name
    assert sum(shape.mass for shape in NAO.shapes) == pytest.approx(1.03948)
    by_body = {link.body: link.mass for link in NAO.links}
    assert by_body["Head"] == pytest.approx(0.52065)
    assert by_body["LUpperArm"] == by_body["RUpperArm"] == pytest.approx(0.12309)
    assert NAO.family.status_period(UDK) == 0.01
    assert [item.type for item in NAO.items] == ["GroundTruth", "Sonar", "Sonar", "Accelerometer"]
    assert [camera.name for camera in NAO.cameras] == ["CameraTop", "CameraBottom"]


def test_the_right_hip_follows_the_left_one() -> None:
    """RHipYawPitch has no drive of its own (robots 11)."""
    followers = {link.joint: link.follows for link in NAO.links if link.follows}
    assert followers == {"RHipYawPitch": "LHipYawPitch"}


@pytest.mark.parametrize("name", LEGGED)
def test_legged_machines_are_made_of_joints(name: str) -> None:
    """They have no wheels, all joints are bare ones with limits, and STA tells of them."""
    robot = ROBOTS[name]
    assert not robot.wheels
    assert all(link.limits is not None for link in robot.links)
    assert not any(actuator.package for actuator in robot.actuators)
    assert isinstance(robot.family, Legged)
    build_spec(robot).compile()
    line = robot.family.configuration(robot, UT)
    assert f"{{Type LeggedRobot}} {{Name {name}}}" in line
    assert "{SteeringType FourLegs}" in line if name == "ERS" else "{SteeringType TwoLegs}" in line


def test_status_of_both_eras() -> None:
    """All joints in model order; LeggedVehicle in `udk`, LeggedRobot with a lamp in `ut2004`."""
    joints = {"HeadYaw": 0.0, "HeadPitch": -0.12}
    line = Driver(NAO, UDK).status(joints, 99999)
    assert line.endswith(
        "{Battery 99999} {Type LeggedVehicle} {HeadYaw 0.0000} {HeadPitch -0.1200}"
    )
    line = Driver(NAO, UT).status(joints)
    assert line.startswith("STA {Type LeggedRobot} {Time 12.50} {HeadYaw 0.0000}")
    assert line.endswith("{LightToggle False} {LightIntensity 0} {Battery 1200} {View -1}")


@pytest.mark.parametrize("dialect", Dialect)
def test_drive_is_refused(dialect: Dialect) -> None:
    """Wheels, wings and propellers are not for legs; only the lamp obeys (robots 48)."""
    driver = Driver(NAO, dialect)
    assert not driver.send(left=1.0, right=1.0)
    assert not driver.send(speed=1.0, front_steer=0.2, rear_steer=0.2, normalized=True)
    assert not driver.send(linear_velocity=1.0, propeller=3.0, light=True)
    driver.drive_controller.stop()
    assert driver.machine.orders == 0
    assert driver.drive_controller.light


@pytest.mark.parametrize(
    ("table", "error"),
    [
        ({"steering_type": "NoLegs"}, "steering_type: 'NoLegs'"),
        ({"status_period": 0.0}, "status_period: 0"),
        ({"legs": 4}, "legs: unknown key"),
    ],
)
def test_mistakes(tmp_path: Path, table: dict[str, object], error: str) -> None:
    """A mistake in `[legs]` names table, key and cure."""
    shape = {"kind": "box", "size": [0.1, 0.1, 0.1], "mass": 1.0}
    robot = {"kind": "legged", "dialect": "udk", "shape": [shape], "legs": table}
    with pytest.raises(RobotDescriptionError, match=error) as caught:
        load_robot(write(tmp_path, "Dog", robot))
    assert "Dog.toml: [legs]" in str(caught.value)


def test_legs_are_inherited(tmp_path: Path) -> None:
    """A variant of Nao keeps its status period."""
    robot = load_robot(write(tmp_path, "Nao2", {"extends": "Nao", "battery": {"life": 60}}))
    assert robot.family == NAO.family
    assert robot.model == NAO.model


# -- in the world ----------------------------------------------------------------------------------


Spawn = Callable[[str], tuple[RehearsedClient, Vehicle]]


@pytest.fixture(scope="module")
def stage() -> Iterator[Rehearsal]:
    """An empty world."""
    with Rehearsal(world="empty") as rehearsal:
        yield rehearsal


@pytest.fixture
def spawn(stage: Rehearsal) -> Iterator[Spawn]:
    """Puts robots into the world; they leave after the test."""
    clients: list[RehearsedClient] = []

    def make(init: str) -> tuple[RehearsedClient, Vehicle]:
        client = stage.connect()
        clients.append(client)
        client.send(f"INIT {{ClassName {init}}} {{Location 0,0,-0.4}}")
        return client, stage.assembly.robots.vehicles[-1]

    yield make
    for client in clients:
        client.close()
    stage.run(0.05)


def look(vehicle: Vehicle) -> RobotBody:
    """Its present state."""
    state = vehicle.body.look()
    assert state is not None
    return state


def test_every_joint_obeys_its_limits(stage: Rehearsal, spawn: Spawn) -> None:
    """Told to go far beyond either end, every joint of Nao stops at its limit (robots 11,
    protocol 160)."""
    client, vehicle = spawn("Nao")
    for sign in (1.0, -1.0):
        # The floor is in the way of legs, so only the others have to get to their ends.
        client.send(
            f"SET {{Type Joint}} {{Name AllJoints}} {{Opcode Angle}} {{Params {sign * 99}}}"
        )
        stage.run(1.5)
        state = look(vehicle)
        for name, (low, high) in RANGES.items():
            position = state.joint_position(name)
            assert low - 0.02 <= position <= high + 0.02, name
        for name in ("HeadYaw", "HeadPitch", "LElbowRoll", "RElbowRoll"):
            end = RANGES[name][1 if sign > 0.0 else 0]
            assert state.joint_position(name) == pytest.approx(end, abs=0.02), name


def test_the_right_hip_goes_along(stage: Rehearsal, spawn: Spawn) -> None:
    """RHipYawPitch takes the position of LHipYawPitch, and no orders of its own (robots 11)."""
    client, vehicle = spawn("USARBot.Nao")
    client.send("SET {Type Joint} {Name LHipYawPitch} {Opcode Angle} {Params -0.3}")
    client.send("SET {Type Joint} {Name RHipYawPitch} {Opcode Angle} {Params 0.7}")
    stage.run(1.0)
    state = look(vehicle)
    for name in ("LHipYawPitch", "RHipYawPitch"):
        assert state.joint_position(name) == pytest.approx(-0.3, abs=0.02)


def test_it_stands_and_drive_does_not_move_it(stage: Rehearsal, spawn: Spawn) -> None:
    """Nao stands upright on its own; DRIVE with sides moves neither body nor joints (robots 48)."""
    client, vehicle = spawn("Nao")
    stage.run(1.5)
    before = look(vehicle)
    assert before.pose.rotate((0.0, 0.0, 1.0))[2] > 0.99
    client.send("DRIVE {Left 5} {Right 5}", "DRIVE {Speed 5} {FrontSteer 0} {RearSteer 0}")
    client.send("DRIVE {LinearVelocity 1}")
    stage.run(1.5)
    after = look(vehicle)
    assert after.pose.position == pytest.approx(before.pose.position, abs=0.002)
    for name in RANGES:
        assert after.joint_position(name) == pytest.approx(before.joint_position(name), abs=0.002)


def test_status_lines_come_every_hundredth_of_a_second(stage: Rehearsal, spawn: Spawn) -> None:
    """Nao's STA tells all joints in model order 100 times per second (robots 1.7)."""
    client, _ = spawn("Nao")
    stage.run(0.5)
    client.take()
    stage.run(1.0)
    lines = client.take("STA")
    # Steps are 4 ms long, so some intervals are 8 ms and some 12 ms.
    assert 95 <= len(lines) <= 101
    names = [part.split()[0] for part in lines[-1].split("{")[1:]]
    assert names[3:] == list({link.joint: 0 for link in NAO.links})


@pytest.mark.parametrize("name", [one for one in LEGGED if one != "Nao"])
def test_the_others_stand_too(stage: Rehearsal, spawn: Spawn, name: str) -> None:
    """ERS and QRIO stand where they are put, and a joint goes where it is told (protocol 155)."""
    client, vehicle = spawn(name)
    stage.run(1.5)
    assert look(vehicle).pose.rotate((0.0, 0.0, 1.0))[2] > 0.98
    joint = next(iter(vehicle.description.links)).joint
    low, high = next(iter(vehicle.description.links)).limits or (-0.2, 0.2)
    wanted = low + 0.6 * (high - low)
    client.send(f"DRIVE {{Name {joint}}} {{Value {wanted}}}")
    stage.run(3.0)
    assert look(vehicle).joint_position(joint) == pytest.approx(wanted, abs=0.03)
