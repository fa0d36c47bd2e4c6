"""Bodies that go their own way: poses by time, pushing, growth, rays, spawning."""

from __future__ import annotations

import math
from collections.abc import Callable
from unittest.mock import Mock

import mujoco
import numpy as np
import pytest
from sim_fakes import (
    RADIUS,
    ROBOT,
    Geom,
    base_qpos,
    engine_with,
    floor,
    pose_at,
    robot_model,
    run,
    simulation,
    whole_state,
)

from usarsim_server.simulation import movers
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.movers import Mover, mocap_bodies
from usarsim_server.simulation.rays.cast import cast
from usarsim_server.simulation.rays.moving import DynamicGeometry
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.simulation.rays.scenery import StaticGeometry

AHEAD = np.array([[1.0, 0.0, 0.0]])


def square(*names: str) -> Callable[[], mujoco.MjSpec]:
    """A floor with pillars of 0.4 x 0.4 x 1 m that can be moved, side by side at y = 0, 3, ..."""

    def build() -> mujoco.MjSpec:
        spec = floor()()
        for number, name in enumerate(names):
            body = spec.worldbody.add_body(name=name, mocap=True, pos=(3.0, 3.0 * number, 0.5))
            body.add_geom(name=f"{name}:1", type=Geom.mjGEOM_BOX, size=[0.2, 0.2, 0.5])
        fixed = spec.worldbody.add_body(name="fixed", pos=(0.0, -9.0, 0.0))
        fixed.add_geom(type=Geom.mjGEOM_SPHERE, size=[0.1, 0.0, 0.0])
        return spec

    return build


def going(speed: float, start: float = 3.0, y: float = 0.0) -> Callable[[float], Pose]:
    """Along x at a speed."""
    return lambda time: Pose((start + speed * time, y, 0.5))


def turning(time: float) -> Pose:
    """Round and round on the spot, once in 2 pi s."""
    return Pose((3.0, 0.0, 0.5), (math.cos(time / 2), 0.0, 0.0, math.sin(time / 2)))


def place(engine: Engine, body: str) -> np.ndarray:
    """Position of a body in a snapshot."""
    return engine.snapshot().xpos[engine.world.model.body(body).id]


def test_a_body_is_where_its_function_says() -> None:
    """Position and orientation in a snapshot are those of the snapshot's time."""
    engine = engine_with(scenery=square("a", "b"))
    engine.set_movers([Mover("a", going(0.5)), Mover("b", turning)])
    for _ in range(4):
        engine.advance(25)
        snapshot = engine.snapshot()
        a, b = (engine.world.model.body(name).id for name in ("a", "b"))
        assert snapshot.xpos[a] == pytest.approx([3.0 + 0.5 * snapshot.time, 0.0, 0.5], abs=1e-9)
        assert snapshot.xquat[b] == pytest.approx(turning(snapshot.time).quaternion, abs=1e-9)


def test_the_batches_make_no_difference() -> None:
    """Whether the physics advances by one step or by many, a pushed robot goes the same way."""
    states = []
    for batch in (1, 5, 50):
        engine = engine_with((3.5, 0.0), scenery=square("a"))
        engine.set_movers([Mover("a", going(0.4))])
        for _ in range(200 // batch):
            engine.advance(batch)
        states.append(whole_state(engine, 0))
    assert states[0][0] > 3.6
    assert np.array_equal(states[0], states[1])
    assert np.array_equal(states[0], states[2])


def test_a_sleeping_robot_is_woken_and_pushed() -> None:
    """What walks into a parked robot shoves it along, and is not stopped by it."""
    engine = engine_with((1.0, 0.0), scenery=square("a"))
    run(engine, 3.0)
    assert (engine.data.tree_asleep >= 0).all()
    at_rest = base_qpos(engine, 0)
    start = engine.time
    engine.set_movers([Mover("a", lambda time: going(-0.5)(time - start))])
    run(engine, 4.0)
    assert place(engine, "a")[0] == pytest.approx(1.0, abs=1e-6)
    moved = at_rest[0] - base_qpos(engine, 0)[0]
    assert 0.2 < moved < 0.6
    assert base_qpos(engine, 0)[2] == pytest.approx(at_rest[2], abs=0.02)


def test_movers_can_be_replaced() -> None:
    """A body without a mover stays where it was left; a new one takes over at once."""
    engine = engine_with(scenery=square("a"))
    engine.set_movers([Mover("a", going(1.0))])
    run(engine, 0.4)
    engine.set_movers([])
    assert engine.movers == ()
    run(engine, 0.4)
    assert place(engine, "a")[0] == pytest.approx(3.4 - 0.004, abs=0.005)
    engine.set_movers([Mover("a", going(0.0, start=-2.0))])
    assert place(engine, "a")[0] == -2.0


@pytest.mark.parametrize(
    ("body", "problem"), [("nobody", "does not exist"), ("fixed", "is no mocap body")]
)
def test_only_mocap_bodies_can_be_moved(body: str, problem: str) -> None:
    """A wrong name is refused with the reason, and the movers so far go on."""
    engine = engine_with(scenery=square("a"))
    kept = Mover("a", going(1.0))
    engine.set_movers([kept])
    with pytest.raises(ValueError, match=f"{body}.*{problem}"):
        engine.set_movers([Mover(body, going(1.0))])
    assert engine.movers == (kept,)


def test_growth_keeps_the_movers() -> None:
    """In a model with more slots the bodies are where they were, and go on."""
    engine = engine_with((0.0, 0.0), scenery=square("a", "b"))
    engine.set_movers([Mover("a", going(0.5))])
    run(engine, 1.0)
    engine.set_movers([Mover("b", going(0.5, y=3.0))])
    run(engine, 1.0)
    before = place(engine, "a"), place(engine, "b")
    engine.adopt(engine.grow([robot_model("other")]))
    assert np.array_equal(place(engine, "a"), before[0])
    assert place(engine, "b") == pytest.approx(before[1], abs=1e-12)
    run(engine, 1.0)
    assert place(engine, "b")[0] == pytest.approx(3.0 + 0.5 * engine.time, abs=1e-9)


def test_divergence_beside_a_mover_is_contained_as_ever() -> None:
    """A batch that is taken back moves the bodies back too."""
    rogue = robot_model("rogue", damping=-2.0, torque=0.1)
    engine = Engine(square("a"), PhysicsOptions(), [rogue])
    engine.occupy(0, 0, pose_at(0.0, 0.0))
    engine.set_movers([Mover("a", going(0.1))])
    engine.drive(0, np.full(4, 5.0))
    lost: list[int] = []
    while not lost and engine.time < 20.0:
        lost = engine.advance(5)
    assert lost == [0]
    assert place(engine, "a")[0] == pytest.approx(3.0 + 0.1 * engine.time, abs=1e-9)


def test_rays_see_a_moving_body_where_it_is() -> None:
    """It is no part of the fixed scenery: a ray meets it at the snapshot's place and no other."""
    engine = engine_with(scenery=square("a"))
    static, dynamic = StaticGeometry(engine.world), DynamicGeometry(engine.world)
    engine.set_movers([Mover("a", going(1.0))])
    fan = RayFan(np.array([0.0, 0.0, 0.5]), AHEAD, 20.0)
    snapshots = [engine.snapshot()]
    run(engine, 2.0)
    snapshots.append(engine.snapshot())
    found = [cast([fan], shot, None, static, dynamic)[0].distances[0] for shot in snapshots]
    assert found == pytest.approx([2.8, 4.8], abs=1e-5)
    away = RayFan(np.array([0.0, 3.0, 0.5]), AHEAD, 20.0)
    assert np.isinf(cast([away], snapshots[1], None, static, dynamic)[0].distances[0])


def test_mocap_bodies_come_in_the_order_of_their_poses() -> None:
    """The table leads from `mocap_pos` to the bodies of a snapshot."""
    engine = engine_with(scenery=square("a", "b", "c"))
    names = [engine.world.model.body(body).name for body in mocap_bodies(engine.world.model)]
    assert names == ["a", "b", "c"]
    assert np.array_equal(
        engine.data.mocap_pos, engine.snapshot().xpos[mocap_bodies(engine.world.model)]
    )


def test_nobody_spawns_inside_a_moving_body() -> None:
    """A place is free or blocked by where the body is now, not where the scenery has it."""
    world = simulation(square("a"))
    world.set_movers([Mover("a", going(0.0, start=-5.0))])
    _, placed = world.spawn(ROBOT, pose_at(3.0, 0.0))
    assert placed.position[:2] == (3.0, 0.0)
    _, placed = world.spawn(ROBOT, pose_at(-5.0, 0.0))
    assert math.dist(placed.position[:2], (-5.0, 0.0)) > 0.1
    assert placed.position[2] == pytest.approx(RADIUS, abs=0.05)
    world.stop()


def test_movers_are_set_through_the_facade() -> None:
    """They take effect at once; a wrong one is refused."""
    world = simulation(square("a"))
    world.set_movers([Mover("a", going(1.0))])
    world.run_until(1.0)
    facts = world.object_facts("a", world.look())
    assert facts is not None
    assert facts.pose.position == pytest.approx((4.0, 0.0, 0.5), abs=1e-9)
    with pytest.raises(ValueError, match="does not exist"):
        world.set_movers([Mover("nobody", going(1.0))])
    world.stop()


@pytest.mark.parametrize("speed", [0.5, 4.0, 18.0])
def test_what_comes_from_afar_pushes_as_if_it_were_looked_for_in_every_batch(
    monkeypatch: pytest.MonkeyPatch, speed: float
) -> None:
    """How near things are is asked no more often than they can come near, which is early enough."""
    states, looks = [], []
    for longest in (movers.LONGEST, 0.0):
        monkeypatch.setattr(movers, "LONGEST", longest)
        engine = engine_with((0.0, 0.0), scenery=square("a"))
        engine.set_movers([Mover("a", going(-speed, start=6.0))])
        looked = Mock(wraps=engine.parts.moving._clearance)
        monkeypatch.setattr(engine.parts.moving, "_clearance", looked)
        for _ in range(round(7.0 / speed / engine.timestep / 5)):
            engine.advance(5)
        states.append(whole_state(engine, 0))
        looks.append(looked.call_count)
    assert states[0][0] < -0.05
    assert np.array_equal(*states)
    assert looks[0] < looks[1]


def test_a_robot_that_is_put_beside_a_body_is_seen_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """However far away everything was at the last look."""
    monkeypatch.setattr(movers, "LONGEST", 1.0)
    states = []
    for steps in (5, 1):
        engine = engine_with((60.0, 0.0), scenery=square("a"))
        engine.set_movers([Mover("a", going(-2.0))])
        for _ in range(2):
            engine.advance(5)
        engine.teleport(0, pose_at(2.2, 0.0))
        for _ in range(100 // steps):
            engine.advance(steps)
        states.append(whole_state(engine, 0))
    assert states[0][0] < 2.1
    assert np.array_equal(*states)
