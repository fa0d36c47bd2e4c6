"""Patches of water, mud, sand and ice: grip, drag and sinking in, against closed formulas."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from sim_fakes import (
    HALF_TRACK,
    RADIUS,
    ROBOT,
    Geom,
    Scenery,
    base_qpos,
    base_qvel,
    drive,
    engine_with,
    floor,
    pose_at,
    run,
    straight,
    whole_state,
)

from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.ground import EDGE_SLOPE, Surface
from usarsim_server.simulation.model import PhysicsOptions

G = 9.81
MASS = 12.0
"""kg of the test robot."""
SPOT = pose_at(3.0, 1.0)


def patch(**changes: Any) -> Surface:
    """A patch from x = 1 to 5 m that grips like the floor and does nothing else."""
    plain = Surface("patch", "custom", (1.0, 5.0), (-2.0, 2.0), (-0.1, 0.1), friction=1.0)
    return replace(plain, **changes)


def thing(kind: Any, size: list[float], height: float, **geom: Any) -> Scenery:
    """A floor with one loose body at x = 0, its centre at a height."""

    def build() -> mujoco.MjSpec:
        spec = floor()()
        body = spec.worldbody.add_body(name="thing", pos=[0.0, 0.0, height])
        body.add_freejoint()
        body.add_geom(type=kind, size=size, **geom)
        return spec

    return build


def block(mass: float = 4.0, **geom: Any) -> Scenery:
    """A flat box, 0.4 m by 0.4 m."""
    values = {"friction": [0.5, 0.005, 0.0001], **geom}
    return thing(Geom.mjGEOM_BOX, [0.2, 0.2, 0.05], 0.05, mass=mass, **values)


def sliding(
    scenery: Scenery, *surfaces: Surface, x: float, speed: float, timestep: float = 0.004
) -> Engine:
    """An engine with one loose body at x that moves along x."""
    engine = Engine(scenery, PhysicsOptions(timestep=timestep, surfaces=surfaces))
    engine.data.qpos[0] = x
    engine.data.qvel[0] = speed
    return engine


def braking(engine: Engine) -> float:
    """Deceleration (m/s^2) of the first free body along x over 0.16 s."""
    run(engine, 0.04)
    before = engine.data.qvel[0]
    run(engine, 0.16)
    return float(before - engine.data.qvel[0]) / 0.16


def driven(speed: float, seconds: float, **ground: Any) -> Engine:
    """An engine with a robot that has driven on a wide patch, its wheels at a speed (rad/s)."""
    engine = engine_with((2.0, 0.0), surfaces=(patch(**{"x": (-9, 9), **ground}),))
    run(engine, 0.4)
    engine.drive(0, straight(speed))
    run(engine, seconds)
    return engine


def wheel_speeds(engine: Engine) -> np.ndarray:
    """Of the first robot, rad/s."""
    return engine.data.qvel[engine.world.layouts[0].wheel_dof]


# -- grip ------------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [0.05, 0.1, 0.4, 0.8])
def test_a_block_slides_with_the_friction_of_the_patch(friction: float) -> None:
    """Deceleration is mu g within 2.5 %, whatever block (0.5) and floor (1.0) have."""
    engine = sliding(block(), patch(x=(-9.0, 9.0), friction=friction), x=0.0, speed=2.0)
    assert braking(engine) == pytest.approx(friction * G, rel=0.025)


def test_a_patch_is_like_a_floor_of_that_friction() -> None:
    """A robot turning on a patch moves as on a floor and wheels with that coefficient."""

    def slippery() -> mujoco.MjSpec:
        spec = floor()()
        # Priority: the floor's friction counts, not the larger one.
        spec.geom("floor").priority = 1
        spec.geom("floor").friction = [0.3, 0.0015, 0.00003]
        return spec

    states = []
    for scenery, surfaces in ((slippery, ()), (floor(), (patch(x=(-9, 9), friction=0.3),))):
        engine = engine_with((0.0, 0.0), scenery=scenery, surfaces=surfaces)
        run(engine, 0.4)
        drive(engine, np.array([-3.0, -3.0, 4.0, 4.0]), 2.0)
        states.append(whole_state(engine, 0))
    assert states[1] == pytest.approx(states[0], abs=1e-6)
    assert abs(base_qpos(engine, 0)[6]) > 0.2


@pytest.mark.parametrize(("friction", "climbs"), [(0.1, False), (0.15, False), (0.25, True)])
def test_ice_on_a_slope_of_ten_degrees(friction: float, climbs: bool) -> None:
    """A robot climbs only where mu exceeds tan 10 degrees = 0.176 (robots reference 3.3 V15)."""
    slope = math.radians(10.0)
    ice = patch(x=(-20.0, 20.0), z=(-5.0, 5.0), friction=friction)
    engine = engine_with((0.0, 0.0), scenery=floor(slope=slope), surfaces=(ice,))
    half = slope / 2
    turn = (math.cos(half), 0.0, -math.sin(half), 0.0)
    engine.data.qpos[engine.world.layouts[0].qpos + 2 :][:5] = (RADIUS / math.cos(slope), *turn)
    drive(engine, straight(4.0), 3.0)
    way = base_qpos(engine, 0)[0]
    assert way > 0.3 if climbs else way < 0.0


@pytest.mark.parametrize("dimension", [1, 3])
def test_frictionless_casters_stay_so(dimension: int) -> None:
    """A ball that has no friction keeps its speed on a patch that grips."""
    engine = sliding(
        smooth_ball(0.1, dimension), patch(x=(-9.0, 9.0), friction=0.8), x=0.0, speed=1.0
    )
    run(engine, 1.0)
    assert engine.data.qvel[0] == pytest.approx(1.0, abs=2e-4)


def test_a_fast_body_feels_the_patch_from_its_edge() -> None:
    """At 10 m/s and three steps per batch nothing is missed: speed as from mu g after the edge."""
    engine = sliding(
        block(friction=[0.02, 0.0, 0.0], priority=1), patch(friction=1.5), x=0.0, speed=10.0
    )
    while engine.data.qpos[0] < 3.0:
        engine.advance(3)
    # The block enters with its front half, so it brakes with half its weight for 0.4 m.
    expected = math.sqrt(100.0 - 2 * 1.5 * G * (engine.data.qpos[0] - 1.0))
    assert engine.data.qvel[0] == pytest.approx(expected, rel=0.02)


def test_the_later_of_overlapping_patches_counts() -> None:
    """An ice rink with a dry spot in it."""
    ice, dry = patch(x=(-9.0, 9.0), friction=0.05), patch(x=(-9.0, 9.0), friction=0.5)
    for surfaces, friction in (((ice, dry), 0.5), ((dry, ice), 0.05)):
        engine = sliding(block(), *surfaces, x=0.0, speed=2.0)
        assert braking(engine) == pytest.approx(friction * G, rel=0.02)


def test_heights_and_walls_are_told_apart() -> None:
    """A patch on the floor does not reach onto a platform 0.3 m above it, nor is a wall ice."""

    def platform() -> mujoco.MjSpec:
        spec = block()()
        spec.body("thing").pos = [0.0, 0.0, 0.35]
        spec.worldbody.add_geom(
            type=Geom.mjGEOM_BOX, size=[9, 9, 0.15], pos=[0, 0, 0.15], friction=[0.5, 0, 0]
        )
        return spec

    engine = sliding(platform, patch(x=(-9.0, 9.0), friction=0.05), x=0.0, speed=2.0)
    assert braking(engine) == pytest.approx(0.5 * G, rel=0.02)


def test_a_wall_inside_a_patch_keeps_its_friction() -> None:
    """A block held against a wall by a force of twice its weight hangs at mu 0.6, not at 0.1."""

    def wall() -> mujoco.MjSpec:
        spec = thing(Geom.mjGEOM_BOX, [0.1, 0.2, 0.2], 0.6, mass=2.0, friction=[0.6, 0, 0])()
        spec.worldbody.add_geom(
            type=Geom.mjGEOM_BOX, size=[0.1, 2, 2], pos=[0.2, 0, 1], friction=[0.6, 0, 0]
        )
        return spec

    for walled in (patch(x=(-9, 9), z=(-0.1, 3.0), friction=0.1), patch(x=(7, 9))):
        engine = sliding(wall, walled, x=0.0, speed=0.0)
        thing_id = engine.world.model.body("thing").id
        for _ in range(100):
            engine.data.xfrc_applied[thing_id, 0] = 2 * 2.0 * G
            engine.advance(1)
        assert engine.data.qpos[2] == pytest.approx(0.6, abs=0.02)


# -- drag ------------------------------------------------------------------------------------


@pytest.mark.parametrize("drag", [2.0, 8.0, 400.0, 6000.0])
@pytest.mark.parametrize("timestep", [0.002, 0.004])
def test_water_slows_a_gliding_block_exponentially(drag: float, timestep: float) -> None:
    """v(t) = v0 exp(-c t / m) without friction; a very strong drag stops it and never reverses."""
    water = patch(x=(-9.0, 9.0), friction=0.0, drag=drag)
    engine = sliding(block(), water, x=0.0, speed=1.5, timestep=timestep)
    speeds = []
    for _ in range(round(0.5 / timestep)):
        engine.advance(1)
        speeds.append(float(engine.data.qvel[0]))
    expected = 1.5 * math.exp(-drag * 0.5 / 4.0)
    assert speeds[-1] == pytest.approx(expected, rel=0.01, abs=1e-3)
    assert min(speeds) > -1e-6


def test_a_robot_in_mud_is_as_fast_as_its_grip_allows() -> None:
    """Wheels spin at the commanded speed, the robot goes mu m g / (4 c), within 2 %."""
    engine = driven(5.0, 2.0, friction=0.3, drag=100.0)
    assert base_qvel(engine, 0)[0] == pytest.approx(0.3 * MASS * G / 400.0, rel=0.02)
    assert wheel_speeds(engine) == pytest.approx([5.0] * 4, rel=0.02)


def test_a_robot_that_does_not_slip_keeps_its_speed() -> None:
    """Drag below the limit of the grip costs torque, not speed: 0.55 m/s within 3 %."""
    engine = driven(5.0, 2.0, friction=0.8, drag=20.0)
    assert base_qvel(engine, 0)[0] == pytest.approx(5.0 * RADIUS, rel=0.03)


def test_mud_on_one_side_turns_the_robot_that_way() -> None:
    """The left wheels in mud: yaw to the left."""
    left = patch(x=(-9.0, 9.0), y=(HALF_TRACK / 2, 3.0), friction=0.3, drag=100.0)
    engine = engine_with((2.0, 0.0), surfaces=(left,))
    drive(engine, straight(4.0), 1.5)
    assert base_qpos(engine, 0)[6] > 0.1


def test_forces_end_with_the_step() -> None:
    """Between batches no force is left on any body, in a patch or after it."""
    engine = sliding(block(), patch(drag=20.0, sinkage=0.02), x=0.9, speed=6.0)
    was = engine.data.qvel[0]
    for _ in range(300):
        engine.advance(1)
        assert not engine.data.xfrc_applied.any()
    assert engine.data.qvel[0] < was - 3.0


# -- sinking in ------------------------------------------------------------------------------


@pytest.mark.parametrize("sinkage", [0.01, 0.02, 0.05])
def test_a_robot_stands_as_deep_as_the_patch_says(sinkage: float) -> None:
    """The reference point of a standing robot is lower by the sinkage within 1 mm."""
    heights = []
    for depth in (0.0, sinkage):
        engine = engine_with((3.0, 0.0), surfaces=(patch(sinkage=depth),))
        run(engine, 1.0)
        heights.append(base_qpos(engine, 0)[2])
    assert heights[0] - heights[1] == pytest.approx(sinkage, abs=1e-3)


@pytest.mark.parametrize("mass", [0.5, 40.0])
def test_light_and_heavy_bodies_sink_in_alike(mass: float) -> None:
    """Sinkage is a property of the patch: a block of any mass sinks by 2 cm within 1 mm."""
    engine = sliding(block(mass), patch(sinkage=0.02), x=3.0, speed=0.0)
    run(engine, 1.0)
    assert engine.data.qpos[2] == pytest.approx(0.05 - 0.02, abs=1e-3)


def test_a_robot_goes_in_and_out_without_a_hop() -> None:
    """Through 4 m of sand: never higher than on the floor by 1 mm, level and as high at the end."""
    engine = engine_with((0.0, 0.0), surfaces=(patch(friction=0.7, sinkage=0.02),))
    run(engine, 0.4)
    level = base_qpos(engine, 0)[2]
    engine.drive(0, straight(9.0))
    highest = lowest = level
    while base_qpos(engine, 0)[0] < 6.0:
        engine.advance(2)
        highest = max(highest, base_qpos(engine, 0)[2])
        lowest = min(lowest, base_qpos(engine, 0)[2])
        assert engine.time < 15.0
    assert highest < level + 0.001
    assert lowest == pytest.approx(level - 0.02, abs=2e-3)
    assert base_qpos(engine, 0)[2] == pytest.approx(level, abs=1e-3)


def smooth_ball(radius: float, dimension: int = 1) -> Scenery:
    """A ball without friction on the floor."""
    smooth = {"mass": 3.0, "condim": dimension, "priority": 1, "friction": [0, 0, 0]}
    return thing(Geom.mjGEOM_SPHERE, [radius, 0, 0], radius, **smooth)


def rolling_loss(sinkage: float, diameter: float, length: float) -> float:
    """Integral of sqrt(z / d) over a way through a patch, m."""
    ramp = sinkage / EDGE_SLOPE
    on_ramps = 2 * (2 / 3) * math.sqrt(EDGE_SLOPE / diameter) * ramp**1.5
    return on_ramps + math.sqrt(sinkage / diameter) * (length - 2 * ramp)


@pytest.mark.parametrize("timestep", [0.002, 0.004])
def test_crossing_costs_what_pushing_the_ground_costs(timestep: float) -> None:
    """A slow, frictionless ball loses 2 g times the integral of sqrt(z/d) of its v^2, within 8 %.

    So the way down into the patch and the way up out of it (2 g h = 0.39) cancel.
    """
    ball = smooth_ball(5.0)
    sand = patch(x=(1.0, 2.0), sinkage=0.02)
    engine = sliding(ball, sand, x=0.9, speed=1.2, timestep=timestep)
    while engine.data.qpos[0] < 2.1 and engine.time < 10.0:
        engine.advance(1)
    lost = 1.44 - float(engine.data.qvel[0]) ** 2
    assert lost == pytest.approx(2 * G * rolling_loss(0.02, 10.0, 1.0), rel=0.08)


@pytest.mark.parametrize("speed", [1.5, 3.0, 6.0])
def test_nobody_leaves_a_patch_with_more_energy(speed: float) -> None:
    """The edge throws a body up with little more than slope times speed, and it pays in the end."""
    engine = sliding(smooth_ball(5.0), patch(x=(1.0, 2.0), sinkage=0.03), x=0.9, speed=speed)
    engine.advance(1)
    energy = []
    while engine.data.qpos[0] < 2.3 and len(energy) < 1000:
        engine.advance(1)
        moving = float(engine.data.qvel[:3] @ engine.data.qvel[:3])
        energy.append(0.5 * moving + G * float(engine.data.qpos[2]))
    assert max(energy) <= energy[0] + (EDGE_SLOPE * speed) ** 2
    assert energy[-1] < energy[0]


def test_deep_mud_holds_a_robot() -> None:
    """Where sqrt(z/d) exceeds mu the wheels spin and the robot hardly moves; with grip it does."""
    assert math.sqrt(0.05 / (2 * RADIUS)) > 0.4
    ways = []
    for friction in (0.4, 0.7):
        engine = driven(4.0, 3.0, x=(1.0, 5.0), friction=friction, sinkage=0.05)
        assert (wheel_speeds(engine) > 3.5).all()
        ways.append(base_qpos(engine, 0)[0] - 2.0)
    assert ways[0] < 0.11
    assert ways[1] > 0.8


def test_a_robot_parked_at_the_edge_stays() -> None:
    """With brakes set on the slope at the edge it creeps less than 1 mm in 3 s."""
    engine = engine_with((1.0, 0.0), surfaces=(patch(friction=0.5, sinkage=0.03),))
    drive(engine, straight(0.0), 1.5)
    before = base_qpos(engine, 0)
    run(engine, 3.0)
    assert base_qpos(engine, 0)[:3] == pytest.approx(before[:3], abs=1e-3)


def test_a_ball_at_the_edge_rolls_in() -> None:
    """The edge slopes: what nobody holds goes to where it is deep, if that is steep enough."""
    engine = sliding(smooth_ball(2.0), patch(sinkage=0.03), x=1.02, speed=0.0)
    run(engine, 1.0)
    assert engine.data.qpos[0] > 1.05


def test_a_robot_falls_asleep_in_mud() -> None:
    """Nothing keeps a standing robot awake, so it costs nothing."""
    engine = engine_with((3.0, 0.0), surfaces=(patch(friction=0.4, drag=20.0, sinkage=0.02),))
    run(engine, 3.0)
    assert engine.data.ntree_awake == 0
    drive(engine, straight(4.0), 1.0)
    assert base_qpos(engine, 0)[0] > 3.1


# -- the world around it ---------------------------------------------------------------------


def test_far_from_all_patches_nothing_changes() -> None:
    """Runs with and without a patch elsewhere are equal bit for bit."""
    states = []
    for surfaces in ((), (patch(x=(20.0, 30.0), friction=0.1, drag=50.0, sinkage=0.05),)):
        engine = engine_with((0.0, 0.0), surfaces=surfaces)
        drive(engine, np.array([3.0, 3.0, 4.0, 4.0]), 1.0)
        states.append(whole_state(engine, 0))
    assert (states[0] == states[1]).all()


def test_runs_repeat_whatever_the_batches() -> None:
    """Through a patch by one step and by five steps at a time: equal bit for bit."""
    states = []
    for batch in (1, 5):
        surfaces = (patch(friction=0.5, drag=10.0, sinkage=0.02),)
        engine = engine_with((0.6, 0.0), surfaces=surfaces)
        engine.drive(0, np.array([4.0, 4.0, 6.0, 6.0]))
        for _ in range(500 // batch):
            engine.advance(batch)
        states.append(whole_state(engine, 0))
    assert (states[0] == states[1]).all()


def test_patches_outlive_the_growth_of_the_model() -> None:
    """A model with more slots has the same patches, for old robots and new ones."""
    engine = engine_with((2.0, -1.0), surfaces=(patch(sinkage=0.03),))
    run(engine, 0.4)
    engine.adopt(engine.grow([ROBOT]))
    engine.occupy(1, 1, SPOT)
    run(engine, 1.0)
    for robot in (0, 1):
        assert base_qpos(engine, robot)[2] == pytest.approx(RADIUS - 0.03, abs=1.5e-3)


def test_a_teleported_robot_is_in_the_patch_at_once() -> None:
    """The first batch after a jump from far away already knows where the robot is."""
    moved = engine_with((200.0, 0.0), surfaces=(patch(friction=0.3, sinkage=0.02),))
    moved.teleport(0, SPOT)
    moved.advance(5)
    there = engine_with((3.0, 1.0), surfaces=(patch(friction=0.3, sinkage=0.02),))
    there.advance(5)
    assert base_qpos(moved, 0) == pytest.approx(base_qpos(there, 0), abs=1e-12)


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e100])
@pytest.mark.parametrize("array", ["qpos", "qvel"])
def test_a_robot_that_diverges_in_mud_leaves_alone(array: str, value: float) -> None:
    """A patch changes nothing about containment: the other robot in it drives on."""
    mud = patch(x=(-9.0, 9.0), friction=0.6, drag=10.0, sinkage=0.02)
    engine = engine_with((0.0, 0.0), (0.0, 1.5), surfaces=(mud,))
    for robot in (0, 1):
        engine.drive(robot, straight(4.0))
    run(engine, 0.4)
    layout = engine.world.layouts[1]
    getattr(engine.data, array)[layout.dof if array == "qvel" else layout.qpos] = value
    assert engine.advance(2) == [1]
    run(engine, 1.0)
    assert base_qpos(engine, 0)[0] > 0.3
    assert not engine.data.xfrc_applied.any()


def test_a_world_of_patches_without_anything_loose() -> None:
    """Patches in an empty world are no obstacle to stepping."""
    engine = Engine(floor(), PhysicsOptions(surfaces=(patch(),)))
    assert engine.advance(3) == []
