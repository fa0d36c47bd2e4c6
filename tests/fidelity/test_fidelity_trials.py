"""All acceptance trials of the table, and what shows that they can say no."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest
from lanes import SLOW
from motion import theory, worlds
from motion.fidelity import TIMESTEPS
from motion.manoeuvres import circle, ideal_radius, turn_in_place
from motion.stage import Stage, turned, yaw_of
from motion.table import TRIALS, Trial
from motion.terrain import (
    LANE,
    PUSHING,
    RUN,
    TRACKED,
    Lane,
    cross,
    drive_lanes,
    flipper_error,
    posture,
    spin,
)
from motion.workshop import Workshop

STEP = 0.004
CLIMBERS = TRACKED[:4]


def timesteps(trial: Trial, robot: str) -> tuple[float, ...]:
    """The server's own, and others where robots reference 3.3 asks for several and time allows."""
    tests = set(trial.tests)
    if tests & {"V22", "#39"} or (tests & {"V24", "V25"} and robot in {"AirRobot", "Sedan"}):
        return TIMESTEPS
    return (STEP, 0.002) if tests & {"V4", "V17", "V18"} else (STEP,)


def named(number: int, trial: Trial, robot: str) -> str:
    """What a trial of a robot is called."""
    return f"{number}-{'-'.join(trial.tests)}-{robot}"


@pytest.mark.parametrize(
    ("trial", "robot", "steps"),
    [
        pytest.param(
            trial,
            trial.robots[0],
            (STEP,),
            id=named(number, trial, trial.robots[0]),
            marks=SLOW if "#59" in trial.tests else (),
        )
        for number, trial in enumerate(TRIALS)
    ]
    + [
        pytest.param(trial, robot, steps, id=f"{named(number, trial, robot)}-all", marks=SLOW)
        for number, trial in enumerate(TRIALS)
        for robot in trial.robots
        if (steps := timesteps(trial, robot)) != (STEP,) or robot != trial.robots[0]
    ],
)
def test_trial(shop: Workshop, trial: Trial, robot: str, steps: tuple[float, ...]) -> None:
    """Every quantity lies in its band."""
    for result in trial.run(shop, robot, steps):
        assert result.passed, (result.quantity, result.timestep, result.value)


def test_slopes_of_the_table_are_those_of_friction() -> None:
    """V15: three degrees below and above the angle of friction; V22: as far as Coulomb says."""
    for trial in TRIALS:
        (quantity, *_) = trial.quantities
        if quantity.test == "V15":
            limit = math.degrees(theory.slope_limit(trial.given["friction"]))
            assert abs(trial.given["degrees"] - limit) == pytest.approx(3.0, abs=0.05)
            assert (quantity.low > 0.0) == (trial.given["degrees"] < limit)
        if quantity.test == "V22":
            way = 1e3 * theory.sliding_distance(1.0, trial.given["friction"])
            assert (quantity.low, quantity.high) == pytest.approx((0.95 * way, 1.05 * way), abs=0.1)


def flat(shop: Workshop, robot: str) -> Stage:
    """A robot on level ground."""
    return shop.stage(worlds.flat(), robot, STEP)


@pytest.mark.parametrize("robot", ["P2AT", "P3AT", "P2DX"])
def test_left_faster_is_clockwise(shop: Workshop, robot: str) -> None:
    """Robots 34: with the left side faster a robot turns clockwise seen from above, and the yaw
    that it reports increases."""
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
    """Robots 36, 37: normalized 100 is the wheel limit, 50 half of it, more is clamped."""
    with flat(shop, robot) as stage:
        stage.settle()
        for percent, expected in ((100, limit), (50, limit / 2), (200, limit), (-300, -limit)):
            stage.client.send(f"DRIVE {{Left {percent}}} {{Right {percent}}} {{Normalized True}}")
            stage.run(2.0)
            assert stage.state.wheel_speeds == pytest.approx([expected] * 4, rel=0.01)


def test_the_tests_see_what_compensation_is_for(
    shop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without contact compensation V4 and V10 fail: the robot hops and turns too slowly."""
    monkeypatch.setattr("usarsim_server.simulation.ground.compensate", lambda *_: None)
    monkeypatch.setattr("usarsim_server.simulation.growth.native_steps", lambda *_: None)
    with flat(shop, "P3AT_real") as stage:
        turn = turn_in_place(stage, 6.0, 3.0)
    assert turn.hop > 0.0005
    assert turn.contact < 0.99
    assert turn.ratio < 0.652 - 0.02  # of edges, theory


@pytest.mark.parametrize("robot", ["Sedan", "FrontAckerman"])
def test_full_lock(shop: Workshop, robot: str) -> None:
    """Robots 41: an angle far beyond the range is that of the range, and the turn is still true."""
    with shop.stage(worlds.flat(), robot, STEP) as stage:
        limit = 0.5236 if robot == "Sedan" else 0.5
        found = circle(stage, 3.0, 2.0)
        assert found.radius == pytest.approx(ideal_radius(stage.robot, limit), rel=0.02)
        assert not found.own


def test_weak_flipper_drops_the_load(shop: Workshop) -> None:
    """Robots 46: the load is real: a flipper of the 7 N m of the original's force limit lets it
    sink."""
    robot = shop.describe("Kenaf")
    (flippers,) = robot.actuators
    links = tuple(replace(link, max_torque=7.0) for link in flippers.links)
    weak = replace(robot, model="Weak", actuators=(replace(flippers, links=links),))
    assert flipper_error(shop, weak, "FRFlipper", -0.5, STEP) > 0.1


def stair_lane(shop: Workshop, name: str, belts: float | None = None) -> Lane:
    """A robot whose client raises the front flippers by 0.7 rad; at top speed unless said."""
    robot = shop.describe(name)
    up = 0.7 if name == "crawler_robot" else -0.7
    joints = {link.joint for link in robot.links}
    angles = {joint: up for joint in ("FRFlipper", "FLFlipper") if joint in joints}
    angles |= {joint: 0.0 for joint in ("RRFlipper", "RLFlipper") if joint in joints}
    top = robot.drive.max_wheel_speed
    return Lane(robot, top if belts is None else belts / robot.driven_wheels[0].radius, angles)


@pytest.mark.slow
def test_all_classes_on_stairs(shop: Workshop) -> None:
    """Robots 57, V21: four classes climb six steps at 0.3 m/s and at their top speed; the others
    are stopped by the first one, and none turns over."""
    lanes = [stair_lane(shop, name, RUN) for name in TRACKED]
    lanes += [stair_lane(shop, name) for name in CLIMBERS]
    scene = worlds.stairs(half_width=LANE * len(lanes))
    for lane, run in zip(lanes, drive_lanes(shop, scene, lanes, STEP, 14.0), strict=True):
        assert math.degrees(run.tilt) < 60.0, lane.robot.name
        if lane.robot.name in CLIMBERS:
            assert run.rise > 6 * 0.18 - 0.05, lane.robot.name
        else:
            assert run.rise < 0.18, lane.robot.name


def test_strong_drive_lifts_the_robot_at_a_wall(shop: Workshop) -> None:
    """Robots 59: it is the thrust of the drive that is limited: with ten times the torque Kenaf and
    Tarantula end on their backs."""
    lanes = []
    for name in ("Kenaf", "Tarantula"):
        robot = shop.describe(name)
        drive = replace(robot.drive, wheel_torque=10.0 * robot.drive.wheel_torque)
        strong = replace(robot, model=f"Strong{name}", drive=drive)
        lanes.append(Lane(strong, robot.drive.max_wheel_speed))
    for run in drive_lanes(shop, worlds.wall(), lanes, STEP, PUSHING):
        assert math.degrees(run.tilt) > 80.0


def test_stairs_stop_a_robot_without_flippers(shop: Workshop) -> None:
    """V21: with flippers turned back over its hull the same robot gets no further than one step."""
    with shop.stage(worlds.stairs(), "Kenaf", STEP) as stage:
        posture(stage, dict.fromkeys(("FRFlipper", "FLFlipper"), -2.6))
        posture(stage, dict.fromkeys(("RRFlipper", "RLFlipper"), 2.6))
        run = cross(stage, spin(stage), 8.0)
    assert run.x < worlds.FIELD_START + 0.28


@pytest.mark.parametrize("front", [0.2, 0.4, 0.8])
def test_single_step(shop: Workshop, front: float) -> None:
    """Robots reference 4.7: a step of 10 cm is climbed with front flippers at 0.2 to 0.8 rad."""
    with shop.stage(worlds.step(0.10), "Kenaf", STEP) as stage:
        posture(stage, {"FRFlipper": -front, "FLFlipper": -front})
        run = cross(stage, spin(stage), 10.0, worlds.FIELD_START + 1.0)
    assert run.rise == pytest.approx(0.10, abs=0.001)
