"""The yardsticks and instruments of the acceptance tests can be trusted, and can say no."""

from __future__ import annotations

import logging
import math
from pathlib import Path

import pytest
from motion import theory, worlds
from motion.manoeuvres import rest, watch_straight
from motion.stage import StageError, turned, yaw_of
from motion.terrain import creep, cross
from motion.workshop import VARIANTS, Workshop

from usarsim_doctor.test_drive import tilt
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.worlds.loader import load_world

STEP = 0.004


@pytest.mark.parametrize(
    ("half_base", "half_track", "half_width", "points", "edges"),
    [
        (0.1331, 0.197, 0.0475, 0.687, 0.652),
        (0.124, 0.18, 0.0370, 0.678, 0.653),
        (0.1442, 0.2356, 0.040, 0.727, 0.706),
        (0.0, 0.165, 0.0, 1.0, 1.0),
    ],
)
def test_turn_ratios(
    half_base: float, half_track: float, half_width: float, points: float, edges: float
) -> None:
    """Theory gives the turn ratios that robots reference 3.2 tabulates."""
    assert theory.turn_ratio_points(half_base, half_track) == pytest.approx(points, abs=0.001)
    found = theory.turn_ratio_edges(half_base, half_track, half_width)
    assert found == pytest.approx(edges, abs=0.001)


def test_edges_without_width_are_points() -> None:
    """A tread without width turns like a wheel that touches at a point; a wide one turns less."""
    points = theory.turn_ratio_points(0.13, 0.2)
    assert theory.turn_ratio_edges(0.13, 0.2, 0.0) == pytest.approx(points, abs=1e-6)
    assert theory.turn_ratio_edges(0.13, 0.2, 0.03) < points - 0.005


@pytest.mark.parametrize(("friction", "way"), [(0.3, 0.1699), (0.5, 0.1019), (1.0, 0.0510)])
def test_sliding_distance(friction: float, way: float) -> None:
    """Coulomb friction stops 1 m/s on the ways of robots reference 3.2."""
    assert theory.sliding_distance(1.0, friction) == pytest.approx(way, abs=1e-4)


def test_slope_limit() -> None:
    """The steepest slopes are those of robots reference 3.2."""
    limits = [math.degrees(theory.slope_limit(friction)) for friction in (0.4, 0.6, 0.8, 1.0)]
    assert limits == pytest.approx([21.8, 31.0, 38.7, 45.0], abs=0.05)


def test_variants_differ_in_their_drive_only(shop: Workshop) -> None:
    """A special robot weighs and measures as much as its parent."""
    for name, (parent, drive) in VARIANTS.items():
        with shop.stage(worlds.flat(), name, STEP) as stage:
            variant = stage.robot
        with shop.stage(worlds.flat(), parent, STEP) as stage:
            assert variant.wheels == stage.robot.wheels
            assert variant.shapes == stage.robot.shapes
            assert variant.drive != stage.robot.drive
        for key, value in drive.items():
            assert getattr(variant.drive, key) == value


@pytest.mark.parametrize(("friction", "slides"), [(0.3, True), (0.7, False)])
def test_ground_has_the_friction_it_was_given(
    shop: Workshop, friction: float, slides: bool
) -> None:
    """Slippery ground is slippery for wheels of friction 1: parked on 25 deg a robot slides."""
    pose = worlds.on_slope(25.0, shop.describe("P3AT_real").rest_height)
    with shop.stage(worlds.slope(25.0, friction), "P3AT_real", STEP, pose) as stage:
        assert (creep(stage, 2.0) > 0.1) is slides


def test_scenes_are_worlds(tmp_path: Path) -> None:
    """Every test scene is a world folder that the world reader accepts."""
    heights = worlds.symmetric_heights(0, [0.0, 0.05, 0.1])
    scenes = [
        worlds.flat(0.3),
        worlds.slope(20.0, 0.5),
        worlds.step(0.06),
        worlds.gap(0.15),
        worlds.step_field("cubic", heights),
        worlds.wall(),
        worlds.crate(2.0),
        worlds.sliding_block(0.5),
    ]
    loaded = [load_world(worlds.write_world(tmp_path, scene)) for scene in scenes]
    assert len({world.name for world in loaded}) == len(scenes)


def test_step_fields_look_the_same_from_both_ends() -> None:
    """A half turn maps a step field onto itself; another seed gives another field."""
    heights = worlds.symmetric_heights(1, [0.0, 0.05, 0.10])
    assert len(heights) == len(heights[0]) == 12
    assert heights == tuple(tuple(reversed(row)) for row in reversed(heights))
    assert {height for row in heights for height in row} == {0.0, 0.05, 0.10}
    assert heights != worlds.symmetric_heights(2, [0.0, 0.05, 0.10])


def test_stage_puts_the_robot_where_it_is_told(shop: Workshop) -> None:
    """A pose goes through INIT's text and comes out of the physics unchanged."""
    pose = Pose((1.25, -2.5, 0.6), quaternion_from_rpy(0.1, -0.2, 0.75))
    with shop.stage(worlds.flat(), "P2AT", STEP, pose) as stage:
        assert stage.state.pose.position == pytest.approx(pose.position, abs=1e-6)
        assert stage.state.pose.quaternion == pytest.approx(pose.quaternion, abs=1e-6)
        assert yaw_of(stage.state) == pytest.approx(0.75, abs=1e-6)
        assert tilt(stage.state) == pytest.approx(math.acos(math.cos(0.1) * math.cos(0.2)))


def test_turned_takes_the_short_way() -> None:
    """A change of heading across the back is small, and has a sign."""
    assert turned(math.pi - 0.1, -math.pi + 0.1) == pytest.approx(0.2)
    assert turned(-math.pi + 0.1, math.pi - 0.1) == pytest.approx(-0.2)


def test_unknown_robot(shop: Workshop) -> None:
    """A stage for a class that does not exist says so."""
    with pytest.raises(StageError, match="no robot class NoSuchRobot"):
        shop.stage(worlds.flat(), "NoSuchRobot", STEP)


def test_lost_robot(shop: Workshop) -> None:
    """A robot that is taken out of the world ends the test instead of standing still in it."""
    with shop.stage(worlds.flat(), "P3DX", STEP) as stage:
        stage.settle()
        stage.client.close()
        with pytest.raises(StageError, match="lost"):
            list(stage.steps(0.1))


def test_probe_counts_wheels(shop: Workshop) -> None:
    """A robot in the air touches nothing, at rest all wheels touch the floor, barely sunk in."""
    above = Pose((0.0, 0.0, 1.0))
    with shop.stage(worlds.flat(), "P2AT", STEP, above) as stage:
        probe = stage.probe()
        assert probe.look(stage.state.snapshot).wheels == 0
        assert probe.look(stage.state.snapshot).depth == 0.0
        stage.run(2.0)
        down = probe.look(stage.state.snapshot)
    assert down.wheels == 4
    assert 0.0 < down.depth < 0.001
    assert not down.own
    with shop.stage(worlds.flat(), "P2DX", STEP) as stage:
        stage.settle()
        assert stage.probe().look(stage.state.snapshot).wheels == 2, "a caster is no driven wheel"


def test_warnings_are_heard(shop: Workshop) -> None:
    """Warnings of the physics are collected, and no longer once the stage is closed."""
    with shop.stage(worlds.flat(), "P3DX", STEP) as stage:
        logging.getLogger("usarsim.simulation").warning("Nan, Inf or huge value in QACC")
        assert stage.warnings == ["Nan, Inf or huge value in QACC"]
    logging.getLogger("usarsim.simulation").warning("later")
    assert len(stage.warnings) == 1


def test_straight_sees_a_curve(shop: Workshop) -> None:
    """A robot whose sides differ by five percent fails V2: the measurement is not blind."""
    with shop.stage(worlds.flat(), "P3AT_real", STEP) as stage:
        start = stage.settle()
        stage.drive(4.0, 4.2)
        run = watch_straight(stage, start, 4.1, 4.0)
    assert run.lateral > 0.005
    assert math.degrees(run.yaw) > 0.1


def test_rest_sees_a_slide(shop: Workshop) -> None:
    """A robot on a slope too steep for its ground fails #64."""
    pose = worlds.on_slope(20.0, shop.describe("P2AT").rest_height)
    with shop.stage(worlds.slope(20.0, 0.3), "P2AT", STEP, pose) as stage:
        assert rest(stage, 1.0).moved > 0.05


def test_crossing_ends_at_its_goal(shop: Workshop) -> None:
    """A drive over an obstacle ends beyond its goal, long before its time is up."""
    with shop.stage(worlds.flat(), "P2AT", STEP) as stage:
        run = cross(stage, 4.0, 30.0, 0.5)
        assert stage.state.time < 4.0
    assert 0.5 < run.x < 0.51
    assert run.jump < 0.01
