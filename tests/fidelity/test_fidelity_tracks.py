"""Tracked robots: robots reference 3.3 V19, V21; 5.2, 5.3 #39, #46, #47, #57, #59, #61, #62."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from usarsim_bench.fidelity import worlds
from usarsim_bench.fidelity.lanes import LANE, Lane, drive_lanes
from usarsim_bench.fidelity.terrain import FIELD_END, cross
from usarsim_bench.fidelity.trials_tracks import (
    BEYOND,
    CLIMBERS,
    PUSHING,
    REFERENCE_RATIOS,
    RUN,
    TRACKED,
    belt_ratio,
    climb_stairs,
    cross_field,
    flipper_error,
    ground_speed,
    posture,
    spin,
    stand_up,
    tilts_at_wall,
)
from usarsim_bench.fidelity.workshop import Workshop

STEP = 0.004


@pytest.mark.parametrize("robot", REFERENCE_RATIOS)
def test_belt_speed(shop: Workshop, robot: str) -> None:
    """#47: belts that run at 0.300 m/s move the robot at 0.300 m/s."""
    with shop.stage(worlds.flat(), robot, STEP) as stage:
        assert ground_speed(stage, 2.0) == pytest.approx(0.300, rel=0.003)


@pytest.mark.parametrize("robot", REFERENCE_RATIOS)
def test_turn_ratio(shop: Workshop, robot: str) -> None:
    """#39: the turn ratio is the stored one, within 0.02 at every time step, and nothing hops."""
    ratios = []
    for timestep in (0.001, 0.002, 0.004, 0.005):
        with shop.stage(worlds.flat(), robot, timestep) as stage:
            ratio, hop = belt_ratio(stage, 1.0)
        ratios.append(ratio)
        assert hop < 0.0005
    assert ratios == pytest.approx([REFERENCE_RATIOS[robot]] * 4, abs=0.01)


@pytest.mark.parametrize("robot", REFERENCE_RATIOS)
def test_flipper_holds_a_load(shop: Workshop, robot: str) -> None:
    """#46: a raised flipper holds its angle within 0.1 rad with 5 kg on its tip."""
    assert flipper_error(shop, shop.describe(robot), "FRFlipper", -0.5, STEP) < 0.1


def test_weak_flipper_drops_the_load(shop: Workshop) -> None:
    """#46: the load is real: a flipper of the 7 N m of the original's force limit lets it sink."""
    robot = shop.describe("Kenaf")
    (flippers,) = robot.actuators
    links = tuple(replace(link, max_torque=7.0) for link in flippers.links)
    weak = replace(robot, model="Weak", actuators=(replace(flippers, links=links),))
    assert flipper_error(shop, weak, "FRFlipper", -0.5, STEP) > 0.1


@pytest.mark.parametrize("robot", REFERENCE_RATIOS)
def test_standing_on_flippers(shop: Workshop, robot: str) -> None:
    """#46: lowered flippers lift the robot off its belts and hold it."""
    with shop.stage(worlds.flat(), robot, STEP) as stage:
        error, rise = stand_up(stage)
    assert error < 0.1
    assert rise > 0.05


@pytest.mark.parametrize("seed", range(4))
def test_low_step_field(shop: Workshop, seed: int) -> None:
    """#56, #61, #62, V19: Kenaf crosses a field of posts up to 6 cm on course, without a flip, a
    jump, a warning or a flipper that touches its own chassis."""
    run = cross_field(shop, "Kenaf", seed, STEP)
    assert run.x > FIELD_END + BEYOND
    assert abs(run.y) < 0.6
    assert math.degrees(run.tilt) < 60.0
    assert run.jump < 0.1
    assert not run.own
    assert run.warnings == 0


def test_stairs(shop: Workshop) -> None:
    """#57, V21: Kenaf climbs six steps of 18 x 28 cm with its front flippers raised."""
    run = climb_stairs(shop, STEP)
    assert run.rise == pytest.approx(6 * 0.18, abs=0.005)
    assert math.degrees(run.tilt) < 60.0
    assert not run.own
    assert run.warnings == 0


def stair_lane(shop: Workshop, name: str, belts: float | None = None) -> Lane:
    """A robot whose client raises the front flippers by 0.7 rad; at top speed unless said."""
    robot = shop.describe(name)
    up = 0.7 if name == "crawler_robot" else -0.7
    joints = {link.joint for link in robot.links}
    angles = {joint: up for joint in ("FRFlipper", "FLFlipper") if joint in joints}
    angles |= {joint: 0.0 for joint in ("RRFlipper", "RLFlipper") if joint in joints}
    top = robot.drive.max_wheel_speed
    return Lane(robot, top if belts is None else belts / robot.driven_wheels[0].radius, angles)


def test_all_classes_on_stairs(shop: Workshop) -> None:
    """#57, V21: four classes climb six steps at 0.3 m/s and at their top speed; the others are
    stopped by the first one, and none turns over."""
    lanes = [stair_lane(shop, name, RUN) for name in TRACKED]
    lanes += [stair_lane(shop, name) for name in CLIMBERS]
    scene = worlds.stairs(half_width=LANE * len(lanes))
    for lane, run in zip(lanes, drive_lanes(shop, scene, lanes, STEP, 14.0), strict=True):
        assert math.degrees(run.tilt) < 60.0, lane.robot.name
        if lane.robot.name in CLIMBERS:
            assert run.rise > 6 * 0.18 - 0.05, lane.robot.name
        else:
            assert run.rise < 0.18, lane.robot.name


def test_wall_stops_all_classes(shop: Workshop) -> None:
    """#59: at a wall no class pitches beyond 30 degrees, at top speed, at 30 %, backwards."""
    for name, tilt in tilts_at_wall(shop, STEP).items():
        assert math.degrees(tilt) < 30.0, name


def test_strong_drive_lifts_the_robot_at_a_wall(shop: Workshop) -> None:
    """#59: it is the thrust of the drive that is limited: with ten times the torque Kenaf and
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
