"""Slopes, steps, gaps, step fields, walls: robots reference 5.3 and 3.3 V14 to V22."""

from __future__ import annotations

import math

import pytest

from usarsim_bench.fidelity import worlds
from usarsim_bench.fidelity.terrain import (
    FIELD_END,
    Crossing,
    climb,
    creep,
    cross,
    push_crate,
    push_wall,
    slide_block,
)
from usarsim_bench.fidelity.workshop import Workshop
from usarsim_bench.fidelity.worlds import FIELD_START, PLATFORM
from usarsim_server.simulation.frames import Pose

STEP = 0.004
STEPS = (0.004, 0.002)
SKID = ("P3AT_real", "P3AT_fast", "P2AT")
SPIN = 3.0


def climbed(shop: Workshop, robot: str, degrees: float, friction: float) -> float:
    """Way up a slope in 3 s, m."""
    pose = worlds.on_slope(degrees, shop.rest_height(robot))
    with shop.stage(worlds.slope(degrees, friction), robot, STEP, pose) as stage:
        return climb(stage, SPIN, 3.0)


@pytest.mark.parametrize("robot", SKID)
def test_grade(shop: Workshop, robot: str) -> None:
    """#51, V14: a grade of 35 percent (19.3 deg) is climbed at friction 0.8."""
    assert climbed(shop, robot, 19.3, 0.8) > 0.6


@pytest.mark.parametrize("friction", [0.4, 0.6, 0.8])
@pytest.mark.parametrize("robot", ["P3AT_real", "P2AT"])
def test_slope_limit(shop: Workshop, robot: str, friction: float) -> None:
    """#52, V15: 3 deg below the friction angle a robot climbs, 3 deg above it does not."""
    limit = math.degrees(math.atan(friction))
    assert climbed(shop, robot, limit - 3.0, friction) > 0.3
    if limit + 3.0 < 40.0:
        assert climbed(shop, robot, limit + 3.0, friction) < 0.0


@pytest.mark.parametrize("robot", [*SKID, "P2DX", "P3AT_brakeless"])
def test_parking(shop: Workshop, robot: str) -> None:
    """#53, V16: told to stand still on 15 deg a robot creeps by less than 6 mm/s, with and without
    its parking brake."""
    pose = worlds.on_slope(15.0, shop.rest_height(robot))
    with shop.stage(worlds.slope(15.0, 1.0), robot, STEP, pose) as stage:
        assert creep(stage, 6.0) < 0.006


@pytest.mark.parametrize(
    ("robot", "height", "timestep"),
    [
        *(("P3AT_strong", height, timestep) for height in (0.06, 0.08) for timestep in STEPS),
        ("P3AT_real", 0.08, STEP),
        ("P3AT_fast", 0.06, STEP),
        ("P2AT", 0.06, STEP),
    ],
)
def test_step(shop: Workshop, robot: str, height: float, timestep: float) -> None:
    """#54, V17: a square step of 6 cm is climbed, by the real 3-AT one of 8 cm, too."""
    with shop.stage(worlds.step(height), robot, timestep) as stage:
        run = cross(stage, SPIN, 8.0, FIELD_START + 1.0)
    assert run.rise == pytest.approx(height, abs=0.001)
    assert run.x > FIELD_START + 0.9


def test_step_that_is_too_high(shop: Workshop) -> None:
    """V17: a step higher than a wheel's centre stops the robot in front of it."""
    with shop.stage(worlds.step(0.15), "P3AT_real", STEP) as stage:
        run = cross(stage, SPIN, 6.0, FIELD_START + 1.0)
    assert run.x < FIELD_START
    assert run.rise < 0.1


def over_gap(shop: Workshop, robot: str, width: float, timestep: float) -> Crossing:
    pose = Pose((0.0, 0.0, PLATFORM + shop.rest_height(robot)))
    with shop.stage(worlds.gap(width), robot, timestep, pose) as stage:
        return cross(stage, SPIN, 8.0, FIELD_START + width + 0.5)


@pytest.mark.parametrize("timestep", STEPS)
@pytest.mark.parametrize("robot", SKID)
def test_gap(shop: Workshop, robot: str, timestep: float) -> None:
    """#55, V18: a gap of 15 cm is crossed."""
    run = over_gap(shop, robot, 0.15, timestep)
    assert run.x > FIELD_START + 0.15 + 0.3
    assert run.rise == pytest.approx(0.0, abs=0.001)


@pytest.mark.parametrize("timestep", STEPS)
def test_gap_that_is_too_wide(shop: Workshop, timestep: float) -> None:
    """#55, V18: a gap of 20 cm is not crossed by the real 3-AT."""
    assert over_gap(shop, "P3AT_real", 0.20, timestep).x < FIELD_START + 0.20 + 0.3


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("robot", ["P3AT_real", "P2AT"])
def test_low_step_field(shop: Workshop, robot: str, seed: int) -> None:
    """#56, #61, #62, V19: a step field of posts up to 6 cm is crossed, without a flip, a jump, a
    warning or a part that touches another."""
    heights = worlds.symmetric_heights(seed, [n / 100 for n in range(7)])
    with shop.stage(worlds.step_field(f"low{seed}", heights), robot, STEP) as stage:
        run = cross(stage, SPIN, 20.0, FIELD_END + 0.3)
    assert run.x > FIELD_END + 0.3
    assert abs(run.y) < 0.6
    assert math.degrees(run.tilt) < 60.0
    assert run.jump < 0.1
    assert not run.own
    assert run.warnings == 0


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("robot", SKID)
def test_cubic_step_field(shop: Workshop, robot: str, seed: int) -> None:
    """#56, V20: on posts of 0, 5 and 10 cm nothing sinks in by 15 mm and nothing is warned of."""
    heights = worlds.symmetric_heights(seed, [0.0, 0.05, 0.10])
    with shop.stage(worlds.step_field(f"cubic{seed}", heights), robot, STEP) as stage:
        run = cross(stage, SPIN, 8.0, FIELD_END + 0.3)
    assert 0.0 < run.depth < 0.015
    assert run.jump < 0.1
    assert run.warnings == 0


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.004, 0.005])
@pytest.mark.parametrize("friction", [0.3, 0.5, 1.0])
def test_sliding_block(shop: Workshop, friction: float, timestep: float) -> None:
    """#58, V22: a block of 1 m/s slides as far as Coulomb friction says within 5 percent."""
    way, _ = slide_block(shop.world(worlds.sliding_block(friction)), timestep, 1.0)
    assert way == pytest.approx(1.0 / (2 * friction * 9.81), rel=0.05)


@pytest.mark.parametrize(
    "robot", [*SKID, "P2DX", "P3DX", "pioneer3at_with_sensors", "pioneer2dx_with_sensors"]
)
def test_wall(shop: Workshop, robot: str) -> None:
    """#59: driven into a wall at full speed a robot stops, sinks in by less than 1 cm and does not
    climb it, although its wheels go on pushing."""
    with shop.stage(worlds.wall(), robot, STEP) as stage:
        run = push_wall(stage, stage.robot.drive.max_wheel_speed)
    assert 0.0 < run.depth < 0.01
    assert run.rise < 0.01
    assert run.speed < 0.01
    assert FIELD_START - 0.4 < run.x < FIELD_START


@pytest.mark.parametrize("robot", ["P3AT_real", "P2AT"])
def test_crate(shop: Workshop, robot: str) -> None:
    """#60: a crate of 2 kg that is pushed for 5 m is still in front of the robot."""
    with shop.stage(worlds.crate(2.0), robot, STEP) as stage:
        moved, ahead, aside = push_crate(stage, 5.0, 5.0)
    assert moved >= 5.0
    assert 0.3 < ahead < 0.6
    assert abs(aside) < 0.2
