"""Aircraft and DRIVE (protocol reference 3.4.4, 4.4; robots reference 1.5)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_fakes import ROBOTS, UDK, UT, Driver, wild_drives
from robot_files import write

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.families.aerial import FASTEST, Aerial
from usarsim_server.robots.mjcf import build_spec
from usarsim_server.simulation.frames import rpy_from_quaternion
from usarsim_server.simulation.snapshot import RobotBody
from usarsim_server.testing import Rehearsal, RehearsedClient

AIR, BLIMP = ROBOTS["AirRobot"], ROBOTS["Passarola"]
TILT = math.radians(25.0)


def law(driver: Driver) -> list[float]:
    """Velocity ahead, left, up, yaw rate to the left, roll to the right, pitch down, dead."""
    assert driver.machine.law is not None
    return [float(value) + 0.0 for value in driver.machine.law]


# -- DRIVE -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("dialect", Dialect)
def test_signs_of_the_wire(dialect: Dialect) -> None:
    """Up, ahead, to the right and clockwise are positive on the wire (protocol 151)."""
    driver = Driver(AIR, dialect)
    driver.send(
        altitude_velocity=1.0, linear_velocity=0.5, lateral_velocity=0.3, rotational_velocity=0.2
    )
    ahead, left, up, yaw, roll, pitch, dead = law(driver)
    assert (ahead, left, up, dead) == pytest.approx((0.5, -0.3, 1.0, 0.0))
    assert yaw < 0.0
    assert (roll, pitch) == pytest.approx((TILT, TILT), abs=1e-5)


@pytest.mark.parametrize(("dialect", "value"), [(UDK, 90.0), (UT, math.pi / 2.0)])
def test_rotation_is_in_degrees_in_udk(dialect: Dialect, value: float) -> None:
    """RotationalVelocity: degrees per second in `udk`, rad/s in `ut2004` (robots 44,
    protocol 152)."""
    driver = Driver(AIR, dialect)
    driver.send(rotational_velocity=value)
    assert law(driver)[3] == pytest.approx(-math.pi / 2.0)


@pytest.mark.parametrize("dialect", Dialect)
def test_absent_members_keep_their_values(dialect: Dialect) -> None:
    """Every member is optional (protocol reference 3.4.4)."""
    driver = Driver(AIR, dialect)
    driver.send(altitude_velocity=1.0)
    driver.send(linear_velocity=0.5)
    assert law(driver)[:3] == pytest.approx((0.5, 0.0, 1.0))
    driver.send(altitude_velocity=0.0)
    assert law(driver)[:3] == pytest.approx((0.5, 0.0, 0.0))


@pytest.mark.parametrize("dialect", Dialect)
def test_percent_holds_for_one_command(dialect: Dialect) -> None:
    """Normalized is percent of 2 m/s and 100 deg/s, in both eras for its own command only
    (protocol 3.4)."""
    driver = Driver(AIR, dialect)
    driver.send(
        altitude_velocity=50.0,
        linear_velocity=200.0,
        lateral_velocity=-100.0,
        rotational_velocity=50.0,
        normalized=True,
    )
    assert law(driver)[:4] == pytest.approx((2.0, 2.0, 1.0, -math.radians(50.0)), abs=1e-5)
    driver.send(linear_velocity=1.0)
    assert law(driver)[:3] == pytest.approx((1.0, 2.0, 1.0))


@pytest.mark.parametrize("dialect", Dialect)
def test_more_than_the_limit_is_flown_without_percent(dialect: Dialect) -> None:
    """The original did not limit a command in m/s; only nonsense is cut off."""
    driver = Driver(AIR, dialect)
    driver.send(linear_velocity=5.0)
    assert law(driver)[0] == 5.0
    driver.send(linear_velocity=-math.inf, altitude_velocity=1e300)
    assert law(driver)[0] == -FASTEST
    assert law(driver)[2] == FASTEST
    assert not driver.send(linear_velocity=math.nan)


@pytest.mark.parametrize(("speed", "pitch"), [(0.01, TILT), (2.0, TILT), (-1.0, -TILT), (0.0, 0.0)])
def test_tilt_does_not_depend_on_speed(speed: float, pitch: float) -> None:
    """25 deg nose down for any way ahead, nose up for any way back, level for none (robots 1.5)."""
    driver = Driver(AIR, UDK)
    driver.send(linear_velocity=speed)
    assert law(driver)[5] == pytest.approx(pitch, abs=1e-5)
    driver.send(lateral_velocity=speed)
    assert law(driver)[4] == pytest.approx(pitch, abs=1e-5)


def test_angles_are_a_matter_of_udk() -> None:
    """PitchAngle and RollAngle are degrees, or percent of 25 deg, in `udk`, else nothing."""
    driver = Driver(AIR, UDK)
    assert driver.send(pitch_angle=-10.0, roll_angle=5.0)
    assert law(driver)[4:6] == pytest.approx((math.radians(5.0), math.radians(10.0)))
    assert driver.send(pitch_angle=100.0, normalized=True)
    assert law(driver)[5] == pytest.approx(-TILT, abs=1e-5)
    assert driver.send(pitch_angle=1e9)
    assert law(driver)[5] == pytest.approx(-math.radians(80.0))
    assert not Driver(AIR, UT).send(pitch_angle=-10.0, roll_angle=5.0)


@pytest.mark.parametrize("dialect", Dialect)
def test_other_families_do_nothing(dialect: Dialect) -> None:
    """Members of ground vehicles and propeller visuals do not reach the rotors."""
    driver = Driver(AIR, dialect)
    assert not driver.send(left=1.0, right=1.0, speed=1.0, front_steer=0.1, rear_steer=0.1)
    assert not driver.send(spin1=50.0, spin2=50.0, propeller=3.0, light=True)
    assert driver.drive_controller.light


@settings(max_examples=150)
@given(st.lists(wild_drives, max_size=6), st.sampled_from(Dialect))
def test_commands_are_always_finite(drives: list[Drive], dialect: Dialect) -> None:
    """Whatever is sent, the law gets finite numbers of sane size."""
    driver = Driver(AIR, dialect)
    for drive in drives:
        driver.obey(drive)
    if driver.machine.law is not None:
        assert np.all(np.abs(driver.machine.law) <= FASTEST)


def test_without_power_rotors_stop_and_blimps_stay() -> None:
    """A dead quadrotor falls, a dead blimp drifts to a halt."""
    for robot, dead in ((AIR, 1.0), (BLIMP, 0.0)):
        driver = Driver(robot)
        driver.send(linear_velocity=1.0, rotational_velocity=0.5)
        driver.drive_controller.stop()
        assert law(driver) == [0.0] * 6 + [dead]


# -- reports and files -----------------------------------------------------------------------------


def test_figures_of_the_air_robot() -> None:
    """CONF exposes 2 m/s three times, 100 deg/s and 25 deg (robots 10, robots reference 1.5)."""
    line = AIR.family.configuration(AIR, UDK)
    for part in (
        "{SteeringType RotaryWing}",
        "{MaxLinearVelocity 2.0000}",
        "{MaxLateralVelocity 2.0000}",
        "{MaxAltitudeVelocity 2.0000}",
    ):
        assert part in line
    values = {
        key: float(line.split(f"{{{key} ")[1].split("}")[0])
        for key in ("MaxRotationalVelocity", "MaxTilt")
    }
    assert values == pytest.approx({"MaxRotationalVelocity": 100.0, "MaxTilt": 25.0}, abs=2e-3)
    line = AIR.family.configuration(AIR, UT)
    assert float(line.split("{MaxRotationalVelocity ")[1].split("}")[0]) == pytest.approx(
        math.radians(100.0), abs=2e-4
    )
    family = AIR.family
    assert isinstance(family, Aerial)
    assert math.degrees(family.tilt_rate) == pytest.approx(38.5, abs=0.05)


def test_status() -> None:
    """STA says AerialVehicle right after the head in `ut2004` (protocol 87); no joint is told
    of."""
    assert Driver(AIR, UT).status().startswith("STA {Type AerialVehicle} {Time 12.5")
    assert "cam" not in Driver(AIR, UDK).status()


def test_what_lies_loose_keeps_its_weight(tmp_path: Path) -> None:
    """Rotors carry everything on the robot, but not a tool that lies beside it."""
    piece = {"kind": "box", "size": [0.1, 0.1, 0.1], "mass": 0.5}
    robot = load_robot(
        write(
            tmp_path,
            "Carrier",
            {
                "kind": "aerial",
                "dialect": "udk",
                "shape": [piece],
                "actuator": [{"name": "Arm", "link": [{"shape": [piece]}]}],
                "effector": [
                    {"type": "ToolChanger", "name": "Changer", "mount": "Arm_Link1"},
                    {"type": "Gripper", "name": "Tool", "detached": True, "shape": [piece]},
                ],
            },
        )
    )
    model = build_spec(robot).compile()
    carried = {
        name: float(model.body_gravcomp[model.body(name).id])
        for name in ("base", "Arm_Link1", "Changer", "Tool")
    }
    assert carried == {"base": 1.0, "Arm_Link1": 1.0, "Changer": 1.0, "Tool": 0.0}


@pytest.mark.parametrize(
    ("table", "error"),
    [
        ({"tilt": 2.0}, "tilt: 2"),
        ({"max_linear_velocity": 0}, "max_linear_velocity: 0"),
        ({"max_speed": 1.0}, "max_speed: unknown key"),
        ({"falls": 1}, "falls: 1 is not true or false"),
        ({"response": 0.0}, "response: 0"),
        ({"max_rotational_velocity": "fast"}, "max_rotational_velocity: 'fast' is not a number"),
    ],
)
def test_mistakes(tmp_path: Path, table: dict[str, Any], error: str) -> None:
    """A mistake in `[flight]` names table, key and cure."""
    shape = {"kind": "box", "size": [0.1, 0.1, 0.1], "mass": 1.0}
    robot = {"kind": "aerial", "dialect": "udk", "shape": [shape], "flight": table}
    with pytest.raises(RobotDescriptionError, match=error) as caught:
        load_robot(write(tmp_path, "Kite", robot))
    assert "Kite.toml: [flight]" in str(caught.value)


def test_flight_is_inherited_key_by_key() -> None:
    """The quadrotor flies as the AirRobot does."""
    assert ROBOTS["quadrotor"].family == AIR.family


# -- in the world ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def world() -> Iterator[Rehearsal]:
    """An empty world."""
    with Rehearsal(world="empty") as rehearsal:
        yield rehearsal


class RobotRole:
    """An aircraft at 2 m, and looks at it in the wire frame."""

    def __init__(self, stage: Rehearsal, init: str) -> None:
        self.stage = stage
        self.client: RehearsedClient = stage.connect()
        self.client.send(f"INIT {{ClassName {init}}} {{Location 0,0,-2}}")
        self.vehicle = stage.assembly.robots.vehicles[-1]
        stage.run(0.3)

    def fly(self, command: str, seconds: float) -> RobotBody:
        """Send a DRIVE and look after a while."""
        self.client.send(f"DRIVE {command}")
        self.stage.run(seconds)
        return self.state

    @property
    def state(self) -> RobotBody:
        """Where it is."""
        state = self.vehicle.body.look()
        assert state is not None
        return state

    @property
    def attitude(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw of the wire, deg."""
        roll, pitch, yaw = rpy_from_quaternion(self.state.pose.quaternion)
        return math.degrees(roll), -math.degrees(pitch), -math.degrees(yaw)


Hire = Callable[[str], RobotRole]


@pytest.fixture
def hire(world: Rehearsal) -> Iterator[Hire]:
    """Puts aircraft into the world; they leave after the test."""
    hired: list[RobotRole] = []

    def make(init: str) -> RobotRole:
        hired.append(RobotRole(world, init))
        return hired[-1]

    yield make
    for role in hired:
        role.client.close()
    world.run(0.05)


def test_hover_speed_and_turning(hire: Hire) -> None:
    """AirRobot hovers (V23), flies 2 m/s and turns 100 deg/s (V24); yaw keeps height
    (robots 42)."""
    role = hire("USARBot.AirRobot} {Dialect udk")
    start = np.array(role.state.pose.position)
    hover = role.fly("{LinearVelocity 0}", 5.0)
    assert abs(hover.linear_velocity[2]) < 0.01
    assert np.linalg.norm(np.array(hover.pose.position) - start) < 0.02
    fast = role.fly("{LinearVelocity 2}", 3.0)
    assert fast.linear_velocity == pytest.approx((2.0, 0.0, 0.0), abs=0.05)
    height = fast.pose.position[2]
    turning = role.fly("{LinearVelocity 0} {RotationalVelocity 100}", 3.0)
    assert math.degrees(turning.angular_velocity[2]) == pytest.approx(-100.0, rel=0.02)
    assert turning.pose.position[2] == pytest.approx(height, abs=0.02)


def test_pitch_of_forward_flight(hire: Hire) -> None:
    """Pitch goes to -25 deg for forward, +25 for backward, 0 for hover, in 0.65 s (robots 43)."""
    role = hire("AirRobot")
    role.fly("{LinearVelocity 1}", 0.4)
    assert -18.0 < role.attitude[1] < -9.0
    role.stage.run(0.4)
    assert role.attitude[1] == pytest.approx(-25.0, abs=1.5)
    role.fly("{LinearVelocity 0}", 1.0)
    assert role.attitude[1] == pytest.approx(0.0, abs=1.0)
    role.fly("{LinearVelocity -1}", 1.2)
    assert role.attitude[1] == pytest.approx(25.0, abs=1.0)
    role.fly("{LinearVelocity 0} {LateralVelocity 1}", 2.0)
    assert role.attitude[0] == pytest.approx(25.0, abs=1.0)
    assert role.state.linear_velocity[1] == pytest.approx(-1.0, abs=0.03)  # to the right


@pytest.mark.parametrize(("dialect", "value"), [("udk", "90"), ("ut2004", "1.5708")])
def test_quarter_turn_per_second(hire: Hire, dialect: str, value: str) -> None:
    """RotationalVelocity 90 in `udk` and 1.5708 in `ut2004`: a quarter turn clockwise
    (robots 44)."""
    role = hire(f"AirRobot}} {{Dialect {dialect}")
    turning = role.fly(f"{{RotationalVelocity {value}}}", 1.0)
    assert math.degrees(turning.angular_velocity[2]) == pytest.approx(-90.0, abs=1.0)


def test_two_items_of_one_name(hire: Hire) -> None:
    """AirRobot's two GPS are both mounted and both report (robots 16)."""
    role = hire("AirRobot")
    names = [(sensor.wire_type, sensor.name) for sensor in role.vehicle.sensors]
    assert [kind for kind, name in names if name == "GPS"] == ["GPS", "AltitudeSensor"]
    role.client.take()
    role.stage.run(2.0)
    lines = role.client.take("SEN")
    assert any("{Type GPS}" in line for line in lines)
    assert any("{Type AltitudeSensor}" in line for line in lines)


def test_a_dead_battery_drops_it(hire: Hire) -> None:
    """When the battery is empty the rotors stop; it falls, lies, and takes no more orders
    (protocol 162)."""
    role = hire("AirRobot} {Battery 2")
    role.fly("{AltitudeVelocity 0.5}", 1.0)
    assert role.state.pose.position[2] > 2.2
    role.stage.run(4.0)
    assert role.state.pose.position[2] == pytest.approx(0.12, abs=0.03)
    role.fly("{AltitudeVelocity 2}", 1.0)
    assert role.state.pose.position[2] < 0.2
    assert "{Battery 0}" in role.client.take("STA")[-1]


def test_it_leaves_a_wall_when_told_to(tmp_path: Path) -> None:
    """AirRobot flown into a wall stays outside of it, and comes away at once (robots 45)."""
    from motion import worlds

    folder = worlds.write_world(tmp_path, worlds.wall())
    with Rehearsal(world=str(folder)) as own:
        client = own.connect()
        client.send("INIT {ClassName AirRobot} {Location 0,0,-0.6}")
        client.send("DRIVE {LinearVelocity 1.5}")
        own.run(4.0)
        held = own.robot_state()
        assert held.pose.position[0] < worlds.FIELD_START - 0.3
        client.send("DRIVE {LinearVelocity -1}")
        own.run(1.5)
        free = own.robot_state()
        assert free.pose.position[0] < held.pose.position[0] - 0.8
        assert free.linear_velocity[0] == pytest.approx(-1.0, abs=0.05)


def test_flight_goes_on_when_others_come(hire: Hire) -> None:
    """Another class appears while it climbs: the world grows, the climb goes on."""
    role = hire("AirRobot")
    role.fly("{AltitudeVelocity 1} {RotationalVelocity 28.6479}", 1.0)
    other = role.stage.connect()
    other.send("INIT {ClassName Zerg} {Location 5,5,-0.2}")
    role.stage.run(1.0)
    assert role.state.linear_velocity[2] == pytest.approx(1.0, abs=0.02)
    assert role.state.angular_velocity[2] == pytest.approx(-0.5, abs=0.01)
    other.close()


def test_a_blimp_hangs_in_the_air_without_power(hire: Hire) -> None:
    """Passarola with an empty battery comes to rest where it is."""
    role = hire("Passarola} {Battery 1")
    role.fly("{LinearVelocity 1}", 1.0)
    height = role.state.pose.position[2]
    role.stage.run(15.0)
    assert np.linalg.norm(role.state.linear_velocity) < 0.01
    assert role.state.pose.position[2] == pytest.approx(height, abs=0.05)
