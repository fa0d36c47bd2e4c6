"""Driving on level ground: robots reference 5.2 and 3.3 V1 to V13, V26, V27.

Bands are those of the reference; the bench runs the same manoeuvres longer and at more time steps.
"""

from __future__ import annotations

import math
import re

import pytest

from usarsim_bench.fidelity import worlds
from usarsim_bench.fidelity.manoeuvres import (
    drive_arc,
    drive_straight,
    rest,
    stop,
    turn_in_place,
    watch_straight,
)
from usarsim_bench.fidelity.stage import Stage, turned, yaw_of
from usarsim_bench.fidelity.trials_flat import run_script
from usarsim_bench.fidelity.workshop import Workshop
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy

STEP = 0.004
STEPS = (0.004, 0.002)
SKID = ("P3AT_real", "P3AT_fast", "P2AT")
# Theory of robots reference 3.2 for wheels that touch at points, and along the edges of their
# tread; the UDK class has narrower tyres than the table there.
RATIOS = {"P3AT_real": (0.652, 0.687), "P3AT_fast": (0.650, 0.678), "P2AT": (0.706, 0.727)}


def flat(shop: Workshop, robot: str, timestep: float = STEP, pose: Pose | None = None) -> Stage:
    return shop.stage(worlds.flat(), robot, timestep, pose)


@pytest.mark.parametrize(
    ("robot", "speed"),
    [
        *((robot, speed) for robot in ("P3AT_real", "P3AT_fast") for speed in (1.0, 3.0, 6.0)),
        *((robot, speed) for robot in ("P2AT", "P2DX") for speed in (1.0, 3.0, 5.38)),
    ],
)
def test_straight_speed(shop: Workshop, robot: str, speed: float) -> None:
    """#20, V1: ground speed is 0.990 to 1.005 of wheel speed times wheel radius."""
    with flat(shop, robot) as stage:
        run = drive_straight(stage, speed, 4.0)
    assert 0.990 <= run.ratio <= 1.005
    assert run.speed == pytest.approx(run.ratio * speed * stage.robot.report.wheel_radius)


@pytest.mark.parametrize("robot", [*SKID, "P2DX"])
def test_straight_drift(shop: Workshop, robot: str) -> None:
    """#21, V2: on 5 m a robot leaves its line by less than 5 mm and its heading by 0.1 deg."""
    start = Pose((1.0, -2.0, 0.2), quaternion_from_rpy(0.0, 0.0, 0.7))
    with flat(shop, robot, pose=start) as stage:
        radius = stage.robot.report.wheel_radius
        run = drive_straight(stage, 5.0, 5.2 / (5.0 * radius))
        way = math.dist((1.0, -2.0), stage.state.pose.position[:2])
    assert way > 5.0
    assert run.lateral < 0.005
    assert math.degrees(run.yaw) < 0.1


@pytest.mark.parametrize(
    ("robot", "low", "high"),
    [("P2AT", 0.68, 0.71), ("P3AT", 0.126, 0.128), ("P3AT_fast", 0.79, 0.805)],
)
def test_top_speed(shop: Workshop, robot: str, low: float, high: float) -> None:
    """#22, #23, V3: at 100 percent P2AT does 0.70 m/s, P3AT 0.127 m/s, or 0.80 m/s if set so."""
    with flat(shop, robot) as stage:
        start = stage.settle()
        stage.client.send("DRIVE {Left 100} {Right 100} {Normalized true}")
        run = watch_straight(stage, start, 1.0, 5.0)
    assert low <= run.speed <= high


@pytest.mark.parametrize("timestep", STEPS)
@pytest.mark.parametrize("robot", SKID)
def test_turn_in_place(shop: Workshop, robot: str, timestep: float) -> None:
    """#24, V4: a skid-steered robot turns as much slower than a differential one as theory says."""
    edges, points = RATIOS[robot]
    assert edges - 0.02 <= shop.turn(robot, timestep, 3.0).ratio <= points + 0.02


def test_effective_track_of_the_real_3_at(shop: Workshop) -> None:
    """#25, V5: the real 3-AT turns like a differential robot of 0.56 to 0.62 m track."""
    assert 0.56 <= shop.turn("P3AT_real", STEP, 3.0).track <= 0.62


def test_effective_track_of_the_3_dx(shop: Workshop) -> None:
    """#26, V6: the 3-DX turns like a differential robot of 0.325 to 0.375 m track."""
    assert 0.325 <= shop.turn("P3DX", STEP, 2.0).track <= 0.375


@pytest.mark.parametrize("robot", SKID)
def test_speed_independence(shop: Workshop, robot: str) -> None:
    """#27, V7: the turn ratio is the same at 1, 3 and 6 rad/s within 0.02."""
    ratios = [shop.turn(robot, STEP, speed).ratio for speed in (1.0, 3.0, 6.0)]
    assert max(ratios) - min(ratios) < 0.02


@pytest.mark.parametrize("robot", ["P3AT_real", "P2AT"])
def test_friction_independence(shop: Workshop, robot: str) -> None:
    """#28, V8: the turn ratio is the same at friction 0.3, 0.5 and 1 within 0.02."""
    ratios = [shop.turn(robot, STEP, 3.0, friction).ratio for friction in (0.3, 0.5, 1.0)]
    assert max(ratios) - min(ratios) < 0.02


@pytest.mark.parametrize("robot", SKID)
def test_timestep_independence(shop: Workshop, robot: str) -> None:
    """#29, V9: the turn ratio is the same at 4 and 2 ms within 0.02."""
    ratios = [shop.turn(robot, timestep, 3.0).ratio for timestep in STEPS]
    assert abs(ratios[0] - ratios[1]) < 0.02


@pytest.mark.parametrize("robot", SKID)
def test_no_hopping(shop: Workshop, robot: str) -> None:
    """#30, #31, V10: turning at 6 rad/s the body moves up and down by less than 0.5 mm and every
    wheel is on the ground in more than 99 percent of the steps."""
    turn = shop.turn(robot, STEP, 6.0)
    assert turn.hop < 0.0005
    assert turn.contact > 0.99


@pytest.mark.parametrize("robot", SKID)
def test_no_contact_with_itself(shop: Workshop, robot: str) -> None:
    """#61: no two parts of a turning robot ever touch each other."""
    assert not shop.turn(robot, STEP, 6.0).own


@pytest.mark.parametrize(("left", "right"), [(2.0, 4.0), (0.0, 4.0), (3.0, 4.0)])
def test_arcs(shop: Workshop, left: float, right: float) -> None:
    """#32, V11: on an arc the 3-AT yaws at 0.45 to 0.70 of the differential rate."""
    with flat(shop, "P3AT_real") as stage:
        run = drive_arc(stage, left, right, 3.0)
    assert 0.45 <= run.ratio <= 0.70


@pytest.mark.parametrize("robot", [*SKID, "P2DX"])
def test_stopping(shop: Workshop, robot: str) -> None:
    """#33, V13: from 0.33 m/s a robot stops within 3 cm, and not as if nailed to the floor."""
    with flat(shop, robot) as stage:
        way = stop(stage, 0.33)
        assert stage.state.linear_velocity[0] == pytest.approx(0.0, abs=1e-3)
    assert 0.002 < way < 0.03


@pytest.mark.parametrize("robot", ["P2AT", "P3AT", "P2DX"])
def test_left_faster_is_clockwise(shop: Workshop, robot: str) -> None:
    """#34: with the left side faster a robot turns clockwise seen from above, and the yaw that it
    reports increases."""
    with flat(shop, robot) as stage:
        before = yaw_of(stage.settle())
        first = reported_yaw(stage)
        stage.drive(1.2, 0.4)
        stage.run(2.0)
        assert turned(before, yaw_of(stage.state)) < -0.1
        assert reported_yaw(stage) - first > 0.1


def reported_yaw(stage: Stage) -> float:
    """Yaw of the last ground truth line, rad."""
    lines = [line for line in stage.client.lines if "GroundTruth" in line]
    found = re.search(r"\{Orientation [^,]+,[^,]+,([^,}]+)\}", lines[-1])
    assert found is not None
    return float(found[1])


@pytest.mark.parametrize(("robot", "limit"), [("P2AT", 5.385), ("P3AT", 1.3)])
def test_normalized(shop: Workshop, robot: str, limit: float) -> None:
    """#36, #37: normalized 100 is the wheel limit, 50 half of it, more is clamped."""
    with flat(shop, robot) as stage:
        stage.settle()
        for percent, expected in ((100, limit), (50, limit / 2), (200, limit), (-300, -limit)):
            stage.client.send(f"DRIVE {{Left {percent}}} {{Right {percent}}} {{Normalized True}}")
            stage.run(2.0)
            assert stage.state.wheel_speeds == pytest.approx([expected] * 4, rel=0.01)


def test_pivot_of_a_robot_with_caster(shop: Workshop) -> None:
    """#38: turning on the spot, P2DX keeps the middle of its axle within 2 cm for a whole turn."""
    with flat(shop, "P2DX") as stage:
        turn = turn_in_place(stage, 3.0, 4.0)
    assert abs(turn.rate) * 4.0 > math.tau
    assert turn.drift < 0.02


@pytest.mark.parametrize("robot", SKID)
def test_odometry_over_rotates(shop: Workshop, robot: str) -> None:
    """#80, V27: odometry exaggerates turns in place by the inverse of the turn ratio."""
    turn = shop.turn(robot, STEP, 3.0)
    assert turn.odometry > 1.3
    assert turn.odometry * turn.grip == pytest.approx(1.0, rel=0.03)


@pytest.mark.parametrize("robot", ["P3AT_real", "P2AT"])
def test_agreement_of_time_steps(shop: Workshop, robot: str) -> None:
    """#120: speed, turning and arcs at 4 and 2 ms agree within 3 percent."""
    found = []
    for timestep in STEPS:
        with flat(shop, robot, timestep) as stage:
            speed = drive_straight(stage, 3.0, 4.0).speed
        with flat(shop, robot, timestep) as stage:
            arc = drive_arc(stage, 0.0, 4.0, 2.0).rate
        found.append((speed, arc, shop.turn(robot, timestep, 3.0).rate))
    assert found[0] == pytest.approx(found[1], rel=0.03)


def test_equal_scripts_give_equal_runs(shop: Workshop) -> None:
    """#115, V26: equal commands and seed give the same states and the same lines bit for bit."""
    first, second = run_script(shop, STEP, 6.0), run_script(shop, STEP, 6.0)
    assert len(first) > 500
    assert first == second


@pytest.mark.parametrize("robot", [*SKID, "P3AT", "P2DX"])
def test_rest(shop: Workshop, robot: str) -> None:
    """#63, #64: a robot that nobody commands moves less than 1 mm and 0.1 deg in 60 s, and sinks
    into the floor by less than 1 mm."""
    with flat(shop, robot) as stage:
        found = rest(stage, 60.0)
    assert found.moved < 0.001
    assert math.degrees(found.rotated) < 0.1
    assert 0.0 < found.depth < 0.001


def test_the_tests_see_what_compensation_is_for(
    shop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without contact compensation V4 and V10 fail: the robot hops and turns too slowly."""
    monkeypatch.setattr("usarsim_server.simulation.engine.compensate", lambda data: None)
    with flat(shop, "P3AT_real") as stage:
        turn = turn_in_place(stage, 6.0, 3.0)
    assert turn.hop > 0.0005
    assert turn.contact < 0.99
    assert turn.ratio < RATIOS["P3AT_real"][0] - 0.02
