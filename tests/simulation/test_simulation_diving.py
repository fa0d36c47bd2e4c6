"""Propeller, rudder, stern planes (protocol reference 3.4.5, robots reference 5.2 #49)."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from law_fakes import axes, command, engine_of, place, spin, submarine, velocity
from sim_fakes import floor, run

from usarsim_server.simulation.diving import SLOW, WATER, Hull
from usarsim_server.simulation.motion_laws import add_bounds

STEPS = (0.001, 0.002, 0.004, 0.005)


def heading(values: np.ndarray) -> float:
    """Of a matrix of axes, rad, positive to the left."""
    return math.atan2(values[1, 0], values[0, 0])


def test_it_holds_its_depth() -> None:
    """Without a command it neither sinks nor rises nor turns (robots 49)."""
    engine = engine_of(submarine())
    run(engine, 5.0)
    np.testing.assert_allclose(place(engine), (0.0, 0.0, 2.0), atol=1e-6)
    assert axes(engine)[2, 2] == pytest.approx(1.0)


@pytest.mark.parametrize("timestep", STEPS)
def test_its_speed_is_where_thrust_and_drag_are_equal(timestep: float) -> None:
    """K_T rho n^2 d^4 = rho / 2 C_D A v (v + slow), at every time step."""
    hull = Hull()
    engine = engine_of(submarine(hull), timestep=timestep)
    command(engine, 40.0, 0.0, 0.0, seconds=25.0)
    speed = velocity(engine)[0]
    turns = 40.0 / (2.0 * math.pi)
    thrust = hull.thrust * WATER * turns**2 * hull.diameter**4
    assert 0.5 * WATER * hull.drag[0] * speed * (speed + SLOW) == pytest.approx(thrust, rel=0.02)


def test_it_stays_in_the_world() -> None:
    """At full speed against the edge of the world's box it stops there, and can turn back."""

    def boxed() -> mujoco.MjSpec:
        spec = floor()()
        add_bounds(spec, (-8.0, -8.0, -1.0), (8.0, 8.0, 5.0))
        return spec

    engine = engine_of(submarine(), scenery=boxed)
    command(engine, 40.0, 0.0, 0.0, seconds=40.0)
    assert place(engine)[0] == pytest.approx(8.0, abs=0.4)
    assert abs(velocity(engine)[0]) < 0.01
    command(engine, -40.0, 0.0, 0.0, seconds=8.0)
    assert place(engine)[0] < 6.0


def test_it_coasts_to_a_halt() -> None:
    """With the propeller at rest the water slows it down, and never pushes it back."""
    engine = engine_of(submarine())
    command(engine, 40.0, 0.0, 0.0, seconds=8.0)
    fast = velocity(engine)[0]
    assert fast > 0.5
    command(engine, 0.0, 0.0, 0.0, seconds=60.0)
    assert 0.0 <= velocity(engine)[0] < 0.15 * fast


@pytest.mark.parametrize("astern", [False, True])
def test_signs_of_the_planes(astern: bool) -> None:
    """Ahead, a positive rudder turns left and positive planes turn the nose down; astern not."""
    for rudder, planes in ((0.4, 0.0), (0.0, 0.2)):
        engine = engine_of(submarine(), height=50.0)
        command(engine, -40.0 if astern else 40.0, rudder, planes, seconds=6.0)
        sign = -1.0 if astern else 1.0
        left, down = heading(axes(engine)), -math.asin(axes(engine)[2, 0])
        if rudder:
            assert sign * left > 0.05
            assert abs(down) < 0.01
        else:
            assert sign * down > 0.01
            assert abs(left) < 0.01


def test_planes_do_nothing_without_speed() -> None:
    """A rudder steers by the water that flows past it."""
    engine = engine_of(submarine())
    command(engine, 0.0, 0.6, 0.6, seconds=5.0)
    assert np.abs(spin(engine)).max() < 1e-9


def test_it_rights_itself() -> None:
    """Rolled over and let go it swings back upright."""
    engine = engine_of(submarine())
    start = engine.world.layouts[0].qpos
    engine.data.qpos[start + 3 : start + 7] = (math.cos(0.6), math.sin(0.6), 0.0, 0.0)
    run(engine, 60.0)
    assert axes(engine)[2, 2] > 0.99


def test_propeller_and_planes_take_their_time() -> None:
    """Nothing jumps: after one time constant two thirds of an order are carried out."""
    engine = engine_of(submarine(Hull(response=2.0)))
    command(engine, 40.0, 0.0, 0.0, seconds=0.2)
    slow = velocity(engine)[0]
    engine = engine_of(submarine(Hull(response=0.02)))
    command(engine, 40.0, 0.0, 0.0, seconds=0.2)
    assert slow < 0.1 * velocity(engine)[0]


@settings(max_examples=25)
@given(
    st.tuples(*[st.floats(0.0, 1000.0)] * 3),
    st.tuples(*[st.floats(0.0, 1e6)] * 3),
    st.floats(0.5, 1000.0),
    st.tuples(st.floats(-60.0, 60.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
    st.sampled_from([0.001, 0.005]),
)
def test_drag_never_throws_it_back(
    drag: tuple[float, float, float],
    turning: tuple[float, float, float],
    mass: float,
    order: tuple[float, float, float],
    timestep: float,
) -> None:
    """However large the drag and small the mass, a hull that moves is slowed, not shaken apart."""
    hull = Hull(drag=drag, turning_drag=turning, plane=0.0, thrust=0.0, righting=0.0)
    engine = engine_of(submarine(hull, mass), timestep=timestep, height=50.0)
    dof = engine.world.layouts[0].dof
    engine.data.qvel[dof : dof + 6] = (5.0, -5.0, 5.0, 2.0, -2.0, 2.0)
    command(engine, *order)
    speed = np.linalg.norm(velocity(engine))
    for _ in range(20):
        assert engine.advance(2) == []
        now = np.linalg.norm(velocity(engine))
        assert now <= speed * 1.001 + 1e-9
        speed = now
