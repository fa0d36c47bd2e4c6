"""Cars, aircraft, submarines: robots reference 3.3 V23 to V25, 5.2 #40 to #43 and #49."""

from __future__ import annotations

import math

import pytest

from usarsim_bench.fidelity import worlds
from usarsim_bench.fidelity.stage import turned, yaw_of
from usarsim_bench.fidelity.trials_machines import (
    ALOFT,
    CARS,
    PULLED,
    STEER,
    dive,
    drive_circle,
    fly,
    hover,
    ideal_radius,
    tilting,
)
from usarsim_bench.fidelity.workshop import Workshop
from usarsim_server.simulation.frames import Pose

STEP = 0.004


@pytest.mark.parametrize("robot", CARS)
@pytest.mark.parametrize("steer", [STEER, -STEER])
def test_ackermann_radius(shop: Workshop, robot: str, steer: float) -> None:
    """V25, #40: a car goes on the circle of its base and angle, to the side it is told.

    #41: nothing of it touches anything else of it.
    """
    with shop.stage(worlds.flat(), robot, STEP) as stage:
        found = drive_circle(stage, steer, 2.0)
        assert found.radius == pytest.approx(ideal_radius(stage.robot, steer), rel=0.02)
        # To the right in front is to the left behind.
        assert found.clockwise == ((steer > 0.0) != (robot == "BasicAckermanRobot"))
        assert not found.own


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_ackermann_radius_at_other_steps(shop: Workshop, timestep: float) -> None:
    """V25 does not depend on the time step."""
    with shop.stage(worlds.flat(), "Sedan", timestep) as stage:
        found = drive_circle(stage, STEER, 1.0)
        assert found.radius == pytest.approx(ideal_radius(stage.robot, STEER), rel=0.02)


@pytest.mark.parametrize("robot", [one for one in CARS if one not in PULLED])
def test_literal_radius_is_larger(shop: Workshop, robot: str) -> None:
    """#40: with the original's rule the wheels fight each other, and the circle is larger."""
    with shop.stage(worlds.flat(), f"{robot}_literal", STEP) as stage:
        found = drive_circle(stage, STEER, 2.0)
        assert found.radius > 1.005 * ideal_radius(stage.robot, STEER)


@pytest.mark.parametrize("robot", ["Sedan", "FrontAckerman"])
def test_full_lock(shop: Workshop, robot: str) -> None:
    """#41: an angle far beyond the range is that of the range, and the turn is still true."""
    with shop.stage(worlds.flat(), robot, STEP) as stage:
        limit = 0.5236 if robot == "Sedan" else 0.5
        found = drive_circle(stage, 3.0, 2.0)
        assert found.radius == pytest.approx(ideal_radius(stage.robot, limit), rel=0.02)
        assert not found.own


@pytest.mark.parametrize("robot", ["AirRobot", "quadrotor", "Passarola"])
def test_hover(shop: Workshop, robot: str) -> None:
    """V23, #42: told to stand still it stays where it is."""
    with shop.stage(worlds.flat(), robot, STEP, ALOFT) as stage:
        fastest, drift = hover(stage, 3.0)
    assert fastest < 0.01
    assert drift < 0.006


@pytest.mark.parametrize("timestep", [0.001, 0.002, STEP, 0.005])
def test_speed_and_yaw_rate(shop: Workshop, timestep: float) -> None:
    """V24, #42: 2 m/s within 5 %, 100 deg/s within 2 %, height within 2 cm while turning."""
    with shop.stage(worlds.flat(), "AirRobot", timestep, ALOFT) as stage:
        found = fly(stage)
    assert found.speed == pytest.approx(2.0, rel=0.05)
    assert math.degrees(found.rate) == pytest.approx(100.0, rel=0.02)
    assert found.rise < 0.02


@pytest.mark.parametrize(("speed", "pitch"), [(1.0, -25.0), (-1.0, 25.0)])
def test_pitch(shop: Workshop, speed: float, pitch: float) -> None:
    """#43: nose down ahead, nose up astern, in about 0.65 s."""
    with shop.stage(worlds.flat(), "AirRobot", STEP, ALOFT) as stage:
        found, seconds = tilting(stage, speed)
    assert math.degrees(found) == pytest.approx(pitch, abs=0.5)
    assert 0.5 < seconds < 0.8


def test_depth(shop: Workshop) -> None:
    """#49: a submarine stays where it is, whatever is sent to other kinds of machines."""
    with shop.stage(worlds.flat(), "Submarine", STEP, ALOFT) as stage:
        assert dive(stage, 5.0) < 0.01


@pytest.mark.parametrize(
    "robot", ["CasterSkidRobot", "Kiva4Wheel", "turtlebot_with_sensors", "Nomad", "SegwayRMPFifty"]
)
def test_turn_about_the_driven_axle(shop: Workshop, robot: str) -> None:
    """#38: a caster vehicle turns about the centre of its driven axle: below 2 cm per turn."""
    with shop.stage(worlds.flat(), robot, STEP) as stage:
        report = stage.robot.report
        spin = min(3.0, stage.robot.drive.max_wheel_speed)
        period = math.tau * report.track_width / (2.0 * spin * report.wheel_radius)
        axle = stage.robot.driven_wheels[0].position[0], 0.0, 0.0
        stage.settle()
        stage.drive(-spin, spin)
        stage.run(1.0)
        middle = (stage.state.pose @ Pose(axle)).position
        turned_angle, last = 0.0, stage.state
        for _ in range(20):
            stage.run(period / 20.0)
            turned_angle += turned(yaw_of(last), yaw_of(stage.state))
            last = stage.state
            assert math.dist((last.pose @ Pose(axle)).position, middle) < 0.02
        assert turned_angle == pytest.approx(math.tau, rel=0.1)
