"""Wheels driven and steered one by one (protocol reference 3.4.3, 3.4.6)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_fakes import UDK, UT, Driver, wild_drives

from usarsim_server.protocol.requests import Drive, WheelTarget
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.catalog import load_roster
from usarsim_server.testing import Rehearsal

LISA = next(robot for robot in load_roster().descriptions() if robot.name == "Lisa")
LIMIT = 8.33
ROLLS = math.nan
"""Speed of a wheel that has not been named yet."""


def wheels(*groups: tuple[int, float | None, float | None]) -> dict[str, object]:
    """Members of a wheel by wheel command."""
    return {"wheels": tuple(WheelTarget(*group) for group in groups)}


@pytest.mark.parametrize("dialect", Dialect)
def test_named_wheels_only(dialect: Dialect) -> None:
    """A group drives and steers the wheel that it names, the others keep what they had (150)."""
    driver = Driver(LISA, dialect)
    assert driver.send(**wheels((0, 1.0, 0.5), (2, 2.0, None)))
    assert driver.machine.wheels == pytest.approx([1.0, ROLLS, 2.0, ROLLS], nan_ok=True)
    assert driver.machine.positions == pytest.approx({"LeftFSteer": 0.5})
    assert driver.send(**wheels((2, None, -0.3)))
    assert driver.machine.wheels == pytest.approx([1.0, ROLLS, 2.0, ROLLS], nan_ok=True)
    assert driver.machine.positions == pytest.approx({"LeftFSteer": 0.5, "LeftRSteer": -0.3})
    assert driver.send(**wheels((3, -1.0, None)))
    assert driver.machine.wheels == pytest.approx([1.0, ROLLS, 2.0, -1.0], nan_ok=True)


def test_numbers_out_of_range_are_ignored() -> None:
    """Groups of wheels that do not exist change nothing, and do not disturb the others."""
    driver = Driver(LISA)
    assert not driver.send(**wheels((4, 1.0, 1.0), (-1, 1.0, 1.0), (10**9, 1.0, 1.0)))
    assert driver.send(**wheels((99, 1.0, 1.0), (1, 1.5, None)))
    assert driver.machine.wheels == pytest.approx([ROLLS, 1.5, ROLLS, ROLLS], nan_ok=True)


def test_percent_and_limits() -> None:
    """Normalized scales speeds, not angles; both stop at their limits; nonsense is not sent."""
    driver = Driver(LISA)
    driver.send(
        **wheels((0, 50.0, 0.5), (1, 1e9, 99.0), (2, -math.inf, -math.inf)), normalized=True
    )
    expected = [LIMIT / 2, LIMIT, -LIMIT, ROLLS]
    assert driver.machine.wheels == pytest.approx(expected, nan_ok=True)
    assert driver.machine.positions["LeftFSteer"] == pytest.approx(0.5)
    assert driver.machine.positions["RightFSteer"] == pytest.approx(3.1416)
    assert driver.machine.positions["LeftRSteer"] == pytest.approx(-3.1416)
    assert not driver.send(**wheels((0, math.nan, math.nan)))


def test_percent_sticks_in_udk_only() -> None:
    """As for other ground vehicles (protocol reference 3.4)."""
    for dialect, speed in ((UDK, LIMIT / 10), (UT, 10.0 if LIMIT > 10 else LIMIT)):
        driver = Driver(LISA, dialect)
        driver.send(**wheels((0, 50.0, None)), normalized=True)
        driver.send(**wheels((0, 10.0, None)))
        assert driver.machine.wheels is not None
        assert driver.machine.wheels[0] == pytest.approx(speed)


def test_single_joint_form() -> None:
    """DRIVE {Name wheel}: Steer 1 is its steering axis, order 1 its spin (3.4.6)."""
    driver = Driver(LISA)
    assert driver.send(name="rightfwheel", value=0.4, steer=1)
    assert driver.machine.positions == pytest.approx({"RightFSteer": 0.4})
    assert driver.send(name="RightFWheel", value=2.0, order=1)
    assert driver.machine.wheels == pytest.approx([ROLLS, 2.0, ROLLS, ROLLS], nan_ok=True)
    assert not driver.send(name="RightFWheel", value=2.0)  # a wheel takes no angle
    assert not driver.send(name="Nobody", value=2.0, order=1)


@pytest.mark.parametrize("dialect", Dialect)
def test_other_families_do_nothing(dialect: Dialect) -> None:
    """Sides, cars and aircraft are not meant."""
    driver = Driver(LISA, dialect)
    assert not driver.send(left=1.0, right=1.0, speed=1.0, front_steer=0.1, rear_steer=0.1)
    assert not driver.send(light=True)
    assert driver.conduct.light


def test_stop() -> None:
    """Without power all wheels stand."""
    driver = Driver(LISA)
    driver.send(**wheels((0, 1.0, 0.5)))
    driver.conduct.stop()
    assert driver.machine.wheels == pytest.approx([0.0] * 4)


@settings(max_examples=100)
@given(st.lists(wild_drives, max_size=5), st.sampled_from(Dialect))
def test_no_command_leaves_the_limits(drives: list[Drive], dialect: Dialect) -> None:
    """Whatever is sent, speeds and angles are within the limits."""
    driver = Driver(LISA, dialect)
    for drive in drives:
        driver.obey(drive)
    if driver.machine.wheels is not None:
        assert not np.any(np.abs(driver.machine.wheels) > LIMIT)
    assert all(abs(position) <= 3.1416 for position in driver.machine.positions.values())


def test_reports() -> None:
    """CONF says OmniDrive; STA has no steering of its own."""
    assert "{SteeringType OmniDrive}" in LISA.family.configuration(LISA, UT)
    line = Driver(LISA).status({"LeftFSteer": 0.5})
    assert "{FrontSteer 0.0000} {RearSteer 0.0000}" in line
    assert "LeftFSteer" not in line


@pytest.mark.parametrize("driven", [(0, 1), (2, 3), (0, 3), (0,)])
def test_some_wheels_are_enough(driven: tuple[int, ...]) -> None:
    """150: clients drive wheels 0 and 1 only; the others roll along instead of holding it back.

    A stop, and a speed of zero, brake the wheels that are told so.
    """
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send("INIT {ClassName USARBot.Lisa} {Location 0,0,-0.1}")
        client.send("DRIVE " + "".join(f"{{WheelNumber {n}}} {{WheelSpeed 4}} " for n in driven))
        vehicle = stage.assembly.fleet.vehicles[0]
        stage.run(2.0)
        state = vehicle.body.look()
        assert state is not None
        assert state.linear_velocity[0] == pytest.approx(4.0 * 0.06, rel=0.01)
        assert state.wheel_speeds == pytest.approx([4.0] * 4, rel=0.01)
        client.send("DRIVE " + "".join(f"{{WheelNumber {n}}} {{WheelSpeed 0}} " for n in range(4)))
        stage.run(1.0)
        state = vehicle.body.look()
        assert state is not None
        assert abs(state.linear_velocity[0]) < 1e-3


def test_it_goes_sideways() -> None:
    """All wheels turned by a quarter and rolling, Lisa drives to the right without turning."""
    with Rehearsal(world="empty") as stage:
        client = stage.connect()
        client.send("INIT {ClassName USARBot.Lisa} {Location 0,0,-0.1}")
        turned = "".join(f"{{WheelNumber {n}}} {{WheelSteer 1.5708}} " for n in range(4))
        client.send(f"DRIVE {turned}")
        stage.run(2.0)
        rolling = "".join(f"{{WheelNumber {n}}} {{WheelSpeed 4}} " for n in range(4))
        client.send(f"DRIVE {rolling}")
        vehicle = stage.assembly.fleet.vehicles[0]
        stage.run(1.0)
        before = vehicle.body.look()
        stage.run(1.0)
        after = vehicle.body.look()
        assert before is not None
        assert after is not None
        (x0, y0, _), (x1, y1, _) = before.pose.position, after.pose.position
        assert y1 - y0 == pytest.approx(-4.0 * 0.06, rel=0.03)
        assert abs(x1 - x0) < 0.005
        assert abs(after.angular_velocity[2]) < 0.01
