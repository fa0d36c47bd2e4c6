"""Submarines and DRIVE (protocol reference 3.4.5, 4.4; robots reference 5.2 #49)."""

from __future__ import annotations

import math
from collections.abc import Iterator
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
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.underwater import Underwater
from usarsim_server.robots.mjcf import build_spec
from usarsim_server.simulation.frames import rpy_from_quaternion
from usarsim_server.testing import Rehearsal

SUBMARINE = ROBOTS["Submarine"]
SHAPE = {"kind": "capsule", "size": [0.2, 1.0], "mass": 200.0, "rotation": [0, 1.5708, 0]}


def law(driver: Driver) -> list[float]:
    """Propeller, rudder to the left, planes nose down."""
    assert driver.machine.law is not None
    return [float(value) + 0.0 for value in driver.machine.law]


def vessel(folder: Path, **table: Any) -> RobotDescription:
    """A submarine with this `[vessel]` table."""
    robot = {"kind": "underwater", "dialect": "ut2004", "shape": [SHAPE], "vessel": table}
    return load_robot(write(folder, "Boat", robot))


@pytest.mark.parametrize("dialect", Dialect)
def test_members_keep_their_values(dialect: Dialect) -> None:
    """Every member is optional; one that is absent, or nonsense, keeps its value."""
    driver = Driver(SUBMARINE, dialect)
    assert driver.send(propeller=10.0)
    assert driver.send(rudder=0.2)
    assert driver.send(stern_plane=-0.1)
    assert law(driver) == pytest.approx([10.0, -0.2, -0.1])
    driver.send(propeller=math.nan, rudder=0.0)
    assert law(driver) == pytest.approx([10.0, 0.0, -0.1])


@pytest.mark.parametrize("dialect", Dialect)
def test_limits_and_percent(tmp_path: Path, dialect: Dialect) -> None:
    """Propeller in rad/s or percent of 60, angles in radians always; all stop at their limits."""
    driver = Driver(vessel(tmp_path, max_propeller=60.0), dialect)
    driver.send(propeller=50.0, rudder=0.3, normalized=True)
    assert law(driver)[:2] == pytest.approx([30.0, -0.3])
    driver.send(propeller=20.0)
    assert law(driver)[0] == 20.0
    for huge in (1e300, math.inf):
        driver.send(propeller=-huge, rudder=huge, stern_plane=-huge, normalized=True)
        assert law(driver) == pytest.approx([-60.0, -0.6, -0.6])


@pytest.mark.parametrize("dialect", Dialect)
def test_other_families_do_nothing(dialect: Dialect) -> None:
    """It ignores DRIVE keys of other families (robots 49)."""
    driver = Driver(SUBMARINE, dialect)
    assert not driver.send(left=1.0, right=1.0, speed=1.0, front_steer=0.1, rear_steer=0.1)
    assert not driver.send(linear_velocity=1.0, altitude_velocity=1.0, light=True)
    assert driver.drive_controller.light


@pytest.mark.parametrize(("rudder", "planes"), [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_signs_are_a_matter_of_the_file(tmp_path: Path, rudder: int, planes: int) -> None:
    """No source tells the signs, so `rudder_sense` and `stern_plane_sense` choose them."""
    driver = Driver(vessel(tmp_path, rudder_sense=rudder, stern_plane_sense=planes))
    driver.send(propeller=1.0, rudder=0.2, stern_plane=0.1)
    assert law(driver) == pytest.approx([1.0, -0.2 * rudder, 0.1 * planes])
    # STA repeats what the client said.
    assert "{RudderAngle 0.2000} {SternPlaneAngle 0.1000}" in driver.status()


@settings(max_examples=100)
@given(st.lists(wild_drives, max_size=5), st.sampled_from(Dialect))
def test_no_command_leaves_the_limits(drives: list[Drive], dialect: Dialect) -> None:
    """Whatever is sent, the law gets finite numbers within the limits."""
    driver = Driver(SUBMARINE, dialect)
    for drive in drives:
        driver.obey(drive)
    if driver.machine.law is not None:
        family = SUBMARINE.family
        assert isinstance(family, Underwater)
        limits = [family.max_propeller, family.max_rudder, family.max_stern_plane]
        assert np.all(np.abs(driver.machine.law) <= limits)


def test_reports() -> None:
    """STA is that of a NauticVehicle; CONF and GEO say what it is."""
    line = Driver(SUBMARINE).status()
    assert line.startswith("STA {Type NauticVehicle} {Time 12.50} {RudderAngle 0.0000}")
    family = SUBMARINE.family
    assert "{SteeringType VariableDepth}" in family.configuration(SUBMARINE, UT)
    assert "{Dimensions 2.1000,0.6000,0.8100}" in family.geometry(SUBMARINE, UT)
    assert "{Type NauticVehicle}" in family.geometry(SUBMARINE, UDK)


def test_without_power_the_propeller_stops() -> None:
    """The planes stay where they are."""
    driver = Driver(SUBMARINE)
    driver.send(propeller=10.0, rudder=0.2)
    driver.drive_controller.stop()
    assert law(driver) == pytest.approx([0.0, -0.2, 0.0])


def test_water_carries_it() -> None:
    """Weight and buoyancy are in balance (robots 1.11)."""
    model = build_spec(SUBMARINE).compile()
    assert model.body_gravcomp[model.body("base").id] == 1.0
    assert SUBMARINE.report.mass == 300.0


@pytest.mark.parametrize(
    ("table", "error"),
    [
        ({"rudder_sense": 0}, "rudder_sense: is 0"),
        ({"rudder_sense": 0.5}, "rudder_sense: 0.5"),
        ({"max_rudder": 3.0}, "max_rudder: 3"),
        ({"drag_area": [1.0, 1.0]}, r"drag_area: \[1.0, 1.0\] is not 3 numbers"),
        ({"drag_area": [-1.0, 1.0, 1.0]}, "drag_area: -1"),
        ({"max_speed": 3.0}, "max_speed: unknown key"),
    ],
)
def test_mistakes(tmp_path: Path, table: dict[str, Any], error: str) -> None:
    """A mistake in `[vessel]` names table, key and cure."""
    with pytest.raises(RobotDescriptionError, match=error) as caught:
        vessel(tmp_path, **table)
    assert "Boat.toml: [vessel]" in str(caught.value)


def test_vessel_is_inherited_key_by_key(tmp_path: Path) -> None:
    """A variant changes one figure and keeps the others."""
    vessel(tmp_path, max_propeller=30.0, drag_area=[0.1, 2.0, 2.0])
    robot = load_robot(write(tmp_path, "Other", {"extends": "Boat", "vessel": {"plane_arm": 2.0}}))
    family = robot.family
    assert isinstance(family, Underwater)
    assert (family.max_propeller, family.drag_area, family.plane_arm) == (
        30.0,
        (0.1, 2.0, 2.0),
        2.0,
    )
    assert robot.model == "Other"


# -- in the world ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stage() -> Iterator[Rehearsal]:
    """An empty world with a submarine 20 m above the floor."""
    with Rehearsal(world="empty") as rehearsal:
        yield rehearsal


def test_it_holds_depth_and_steers(stage: Rehearsal) -> None:
    """It holds depth at zero input (robots 49), drives, turns right and dives as it is told."""
    client = stage.connect()
    client.send("INIT {ClassName USARBot.Submarine} {Location 0,0,-20}")

    client.send("DRIVE {Left 5} {Right 5}", "DRIVE {AltitudeVelocity 1}")
    stage.run(3.0)
    assert stage.robot_state().pose.position == pytest.approx((0.0, 0.0, 20.0), abs=1e-3)
    client.send("DRIVE {Propeller 100} {Normalized true}")
    stage.run(8.0)
    assert stage.robot_state().linear_velocity[0] > 0.8
    assert stage.robot_state().pose.position[2] == pytest.approx(20.0, abs=0.01)
    client.send("DRIVE {Rudder 0.3} {SternPlane 0.2}")
    stage.run(4.0)
    _, pitch, yaw = rpy_from_quaternion(stage.robot_state().pose.quaternion)
    assert yaw < -0.1  # to the right
    assert pitch > 0.05  # nose down
    assert stage.robot_state().pose.position[2] < 20.0
    (line,) = client.take("STA {Type NauticVehicle}")[-1:]
    assert "{RudderAngle 0.3000} {SternPlaneAngle 0.2000}" in line
    client.close()
