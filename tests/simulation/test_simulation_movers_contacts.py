"""What moving bodies and conveyor belts do to what touches them."""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from sim_fakes import (
    ROBOT,
    Geom,
    add_box,
    add_crate,
    engine_with,
    floor,
    pose_at,
    run,
    simulation,
    whole_state,
)

from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.simulation.movers import Mover
from usarsim_server.simulation.simulation import Simulation

Way = Callable[[float], Pose]


def stage(shape: int, size: tuple[float, ...], place: Vector, *crates: Vector) -> Engine:
    """A mocap body `m` of one geom on a floor, and cubes of 0.3 m, at rest."""

    def build() -> mujoco.MjSpec:
        spec = floor()()
        body = spec.worldbody.add_body(name="m", mocap=True, pos=place)
        body.add_geom(type=shape, size=size, friction=[1.0, 0.005, 0.0001])
        for number, at in enumerate(crates):
            add_crate(spec, f"crate{number}", at)
        return spec

    engine = engine_with(scenery=build)
    run(engine, 0.4)
    return engine


def go(engine: Engine, way: Way, seconds: float) -> None:
    """Let the body go a way that begins at time 0, from now on."""
    start = engine.time
    engine.set_movers([Mover("m", lambda time: way(max(0.0, time - start)))])
    run(engine, seconds)


def where(engine: Engine, body: str) -> np.ndarray:
    """Position of a body."""
    return engine.snapshot().xpos[engine.world.model.body(body).id]


def test_what_lies_on_a_moving_body_is_carried() -> None:
    """A crate on a platform at 0.5 m/s keeps its place on it but for the slip of the start."""
    engine = stage(Geom.mjGEOM_BOX, (1.0, 1.0, 0.1), (0.0, 0.0, 0.1), (0.0, 0.0, 0.35))
    go(engine, lambda time: Pose((0.5 * time, 0.0, 0.1)), 2.0)
    # Friction 1 takes 0.5^2 / (2 g) = 1.3 cm to bring the crate up to speed.
    assert where(engine, "crate0")[0] == pytest.approx(1.0 - 0.0127, abs=0.004)
    assert where(engine, "crate0")[2] == pytest.approx(0.35, abs=0.002)


def test_what_lies_on_a_turning_body_goes_round() -> None:
    """A crate half a metre off the middle of a turntable goes round with it and turns with it."""
    engine = stage(Geom.mjGEOM_CYLINDER, (1.0, 0.1, 0.0), (0.0, 0.0, 0.1), (0.5, 0.0, 0.35))
    go(engine, lambda t: Pose((0.0, 0.0, 0.1), (math.cos(t / 2), 0.0, 0.0, math.sin(t / 2))), 2.0)
    x, y, _ = where(engine, "crate0")
    assert math.atan2(y, x) == pytest.approx(2.0, abs=0.05)
    assert math.hypot(x, y) == pytest.approx(0.5, abs=0.02)
    w, _, _, z = engine.snapshot().xquat[engine.world.model.body("crate0").id]
    assert 2 * math.atan2(z, w) == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("speed", [0.2, 1.0, 2.0])
def test_what_is_pushed_does_not_sink_in(speed: float) -> None:
    """A crate before a wall that moves is less than 2 mm inside it, whatever the speed."""
    engine = stage(Geom.mjGEOM_BOX, (0.2, 0.5, 0.3), (0.0, 0.0, 0.3), (0.5, 0.0, 0.15))
    go(engine, lambda time: Pose((speed * time, 0.0, 0.3)), 1.5)
    gap = where(engine, "crate0")[0] - 0.15 - (where(engine, "m")[0] + 0.2)
    assert -0.002 < gap < 0.03 * speed


def test_a_lift_carries_upward() -> None:
    """A crate on a platform that rises stays on it, neither pressed in nor thrown up."""
    engine = stage(Geom.mjGEOM_BOX, (1.0, 1.0, 0.1), (0.0, 0.0, 0.1), (0.0, 0.0, 0.35))
    go(engine, lambda time: Pose((0.0, 0.0, 0.1 + 0.3 * time)), 2.0)
    assert where(engine, "crate0")[2] == pytest.approx(0.7 + 0.25, abs=0.003)


def test_a_jump_drags_nothing_along() -> None:
    """A body that is suddenly elsewhere leaves what lay on it where it was."""
    engine = stage(Geom.mjGEOM_BOX, (1.0, 1.0, 0.1), (0.0, 0.0, 0.1), (0.0, 0.0, 0.35))
    go(engine, lambda time: Pose((0.9 if time > 0.1 else 0.0, 0.0, 0.1)), 0.5)
    assert where(engine, "crate0")[:2] == pytest.approx([0.0, 0.0], abs=1e-3)


def test_bodies_that_stand_still_change_nothing() -> None:
    """A mover that does not move gives the very same physics as none."""
    states = []
    for still in (False, True):
        engine = stage(Geom.mjGEOM_BOX, (1.0, 1.0, 0.1), (0.0, 0.0, 0.1), (0.3, 0.2, 0.5))
        if still:
            go(engine, lambda time: Pose((0.0, 0.0, 0.1)), 1.0)
        else:
            run(engine, 1.0)
        states.append(engine.data.qpos.copy())
    assert np.array_equal(*states)


def test_a_robot_rides_along() -> None:
    """A robot that stands on a moving platform is carried with it."""

    def build() -> mujoco.MjSpec:
        spec = floor()()
        body = spec.worldbody.add_body(name="m", mocap=True, pos=(0.0, 0.0, 0.1))
        body.add_geom(type=Geom.mjGEOM_BOX, size=[1, 1, 0.1], friction=[1.0, 0.005, 0.0001])
        return spec

    engine = engine_with((0.0, 0.0, 0.31), scenery=build)
    engine.drive(0, np.zeros(4))
    run(engine, 0.6)
    before = whole_state(engine, 0)[:3]
    go(engine, lambda time: Pose((0.0, 0.4 * time, 0.1)), 2.0)
    moved = whole_state(engine, 0)[:3] - before
    assert moved == pytest.approx([0.0, 0.8, 0.0], abs=0.03)


class TestBelts:
    """Conveyors."""

    @staticmethod
    def world() -> Simulation:
        """Two belts that obey together and one of its own, a crate on each."""

        def scene() -> mujoco.MjSpec:
            spec = floor()()
            for n, name in enumerate(("line:1", "line:2", "other")):
                belt = add_box(spec, name, (0.0, 2.0 * n, 0.1), (4.0, 0.5, 0.1))
                belt.surfacevel = [0.3, 0.0, 0.0, 0.0, 0.0, 0.0]
                add_crate(spec, f"crate{n}", (0.0, 2.0 * n, 0.35))
            add_box(spec, "still", (0.0, -3.0, 0.1), (4.0, 0.5, 0.1))
            return spec

        return simulation(scene)

    @staticmethod
    def crates(world: Simulation) -> list[float]:
        """How far the crates are along x."""
        return world.look().qpos[0:21:7].tolist()

    def test_belts_carry_at_the_speed_of_the_scene(self) -> None:
        """A crate on a belt goes with it."""
        world = self.world()
        world.run_until(3.0)
        assert self.crates(world) == pytest.approx([0.9] * 3, abs=0.03)

    def test_a_tag_scales_its_belts(self) -> None:
        """Factor 2 doubles, -1 turns round, 0 stops; other belts are left alone."""
        world = self.world()
        assert world.run_belts("LINE", 2.0) == 2
        assert world.run_belts("other", 0.0) == 1
        world.run_until(2.0)
        assert self.crates(world) == pytest.approx([1.2, 1.2, 0.0], abs=0.05)
        before = self.crates(world)
        assert world.run_belts("line", -1.0) == 2
        world.run_until(4.0)
        moved = np.array(self.crates(world)) - before
        assert moved == pytest.approx([-0.6, -0.6, 0.0], abs=0.08)

    def test_a_sleeping_crate_is_woken_by_its_belt(self) -> None:
        """What fell asleep on a belt that stood goes on when the belt does."""
        world = self.world()
        world.run_belts("other", 0.0)
        world.run_until(6.0)
        world.run_belts("other", 1.0)
        before = self.crates(world)[2]
        world.run_until(8.0)
        assert self.crates(world)[2] - before == pytest.approx(0.6, abs=0.03)

    @pytest.mark.parametrize("tag", ["nothing", "", "still", "line:", "floor"])
    def test_unknown_tags_do_nothing(self, tag: str) -> None:
        """Only geoms with a moving surface are belts."""
        assert self.world().run_belts(tag, 2.0) == 0

    def test_belts_keep_their_speed_in_a_larger_model(self) -> None:
        """A robot that comes later changes nothing."""
        world = self.world()
        world.run_belts("line:1", 3.0)
        world.spawn(ROBOT, pose_at(0.0, -6.0))
        before = self.crates(world)
        world.run_until(world.look().time + 2.0)
        moved = np.array(self.crates(world)) - before
        assert moved == pytest.approx([1.8, 0.6, 0.6], abs=0.06)
