"""Holding a velocity in the air (robots reference 1.5, 3.3 and 4.8; V23, V24)."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from law_fakes import aircraft, axes, command, engine_of, place, spin, velocity
from sim_fakes import box, furnished, pose_at, run

from usarsim_server.simulation.flight import FlightLimits
from usarsim_server.simulation.motion_laws import add_bounds

STEPS = (0.001, 0.002, 0.004, 0.005)
LEVEL = (0.0, 0.0, 0.0)


@pytest.mark.parametrize("timestep", STEPS)
@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (0.05, -0.03, 0.08)])
def test_it_hovers(timestep: float, offset: tuple[float, float, float]) -> None:
    """V23: without a command it stays where it is, wherever its mass centre lies."""
    engine = engine_of(aircraft(offset=offset), timestep=timestep)
    run(engine, 2.0)
    assert np.abs(velocity(engine)).max() < 1e-3
    assert np.linalg.norm(place(engine) - (0.0, 0.0, 2.0)) < 0.004
    assert axes(engine)[2, 2] > 0.99999


@pytest.mark.parametrize("timestep", STEPS)
def test_it_reaches_what_it_is_told(timestep: float) -> None:
    """V24: 2 m/s ahead within 5 %, 100 deg/s within 2 %, the same at every time step."""
    engine = engine_of(aircraft(), timestep=timestep)
    command(engine, 2.0, 0.0, 0.0, 0.0, 0.0, math.radians(25.0), 0.0, seconds=2.5)
    assert velocity(engine) == pytest.approx((2.0, 0.0, 0.0), abs=0.02)
    command(engine, 0.0, 0.0, 0.0, math.radians(100.0), *LEVEL, seconds=2.5)
    assert math.degrees(spin(engine)[2]) == pytest.approx(100.0, rel=0.01)


def boxed() -> mujoco.MjSpec:
    """A world of 5 m to every side, from 1 m below to 4 m above, without a floor."""
    spec = mujoco.MjSpec()
    add_bounds(spec, (-5.0, -5.0, -1.0), (5.0, 5.0, 4.0))
    return spec


@pytest.mark.parametrize(
    ("values", "aim"),
    [
        ((2.0, 0.0, 0.0), (5.0, 0.0, 2.0)),
        ((-100.0, 0.0, 0.0), (-5.0, 0.0, 2.0)),
        ((1.0, -1.0, 0.0), (5.0, -5.0, 2.0)),
        ((0.0, 0.0, 100.0), (0.0, 0.0, 4.0)),
        ((0.0, 0.0, -100.0), (0.0, 0.0, -0.5)),
    ],
)
def test_it_stays_in_the_world(
    values: tuple[float, float, float], aim: tuple[float, float, float]
) -> None:
    """However fast it is told to leave the box of the world, it stops at the edge and obeys."""
    engine = engine_of(aircraft(), scenery=boxed)
    command(engine, *values, *LEVEL, 0.0, seconds=12.0)
    np.testing.assert_allclose(place(engine), aim, atol=0.05)
    command(engine, *(-0.5 * np.sign(values)), *LEVEL, 0.0, seconds=2.0)
    assert np.linalg.norm(place(engine) - aim) > 0.5


def test_it_comes_back_into_the_world() -> None:
    """One that was pushed out of the box returns by itself."""
    engine = engine_of(aircraft(), scenery=boxed)
    engine.teleport(0, pose_at(9.0, 0.0, 2.0))
    run(engine, 8.0)
    np.testing.assert_allclose(place(engine), (5.0, 0.0, 2.0), atol=0.05)


@pytest.mark.parametrize(
    ("values", "direction"),
    [((1.0, 0.0, 0.0), 0), ((0.0, 1.0, 0.0), 1), ((0.0, 0.0, 1.0), 2)],
)
def test_velocities_are_in_the_yaw_frame(values: tuple[float, ...], direction: int) -> None:
    """Ahead and to the left turn with the machine, up does not; tilt does not matter."""
    engine = engine_of(aircraft())
    command(engine, 0.0, 0.0, 0.0, 1.0, *LEVEL, seconds=2.0)
    command(engine, *values, 0.0, 0.3, 0.3, 0.0, seconds=3.0)
    yaw = math.atan2(axes(engine)[1, 0], axes(engine)[0, 0])
    ahead = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    wanted = (ahead, np.array([-ahead[1], ahead[0], 0.0]), np.array([0.0, 0.0, 1.0]))[direction]
    assert velocity(engine) == pytest.approx(wanted, abs=0.02)


def test_it_tilts_at_its_rate() -> None:
    """A tilt of 25 deg is reached in about 0.65 s and does not lag behind much (robots 43)."""
    engine = engine_of(aircraft())
    tilt = math.radians(25.0)
    command(engine, 1.0, 0.0, 0.0, 0.0, 0.0, tilt, 0.0, seconds=0.32)
    halfway = math.asin(-axes(engine)[2, 0])
    assert 0.3 * tilt < halfway < 0.6 * tilt
    run(engine, 0.48)
    assert math.asin(-axes(engine)[2, 0]) == pytest.approx(tilt, rel=0.1)
    run(engine, 1.0)
    assert math.asin(-axes(engine)[2, 0]) == pytest.approx(tilt, rel=0.01)
    assert axes(engine)[2, 1] == pytest.approx(0.0, abs=1e-3)  # no roll


def test_signs_of_tilt() -> None:
    """Positive roll lowers the right side, positive pitch the nose."""
    engine = engine_of(aircraft())
    command(engine, *LEVEL, 0.0, 0.3, 0.0, 0.0, seconds=2.0)
    assert axes(engine)[2, 1] == pytest.approx(math.sin(0.3), abs=0.005)  # the left goes up
    command(engine, *LEVEL, 0.0, 0.0, 0.3, 0.0, seconds=2.0)
    assert axes(engine)[2, 0] == pytest.approx(-math.sin(0.3), abs=0.005)


def test_turning_does_not_change_the_height() -> None:
    """A yaw command changes altitude by far less than 2 cm, tilted or not (robots 42)."""
    engine = engine_of(aircraft(offset=(0.03, 0.0, 0.02)))
    command(engine, *LEVEL, 1.7, 0.2, 0.2, 0.0, seconds=4.0)
    assert place(engine)[2] == pytest.approx(2.0, abs=0.005)
    assert np.linalg.norm(place(engine)[:2]) < 0.05


def test_force_is_limited() -> None:
    """A command far beyond what it can do accelerates no faster than it can."""
    engine = engine_of(aircraft(FlightLimits(max_acceleration=4.0)))
    command(engine, 100.0, 0.0, 0.0, 0.0, *LEVEL, seconds=1.0)
    assert velocity(engine)[0] == pytest.approx(4.0, rel=0.02)


def test_without_power_it_falls_and_lies() -> None:
    """Dead rotors let it drop like a stone, by gravity as the world has it, and rest."""
    engine = engine_of(aircraft(), height=3.0)
    command(engine, 1.0, 0.0, 0.0, 0.0, *LEVEL, seconds=1.0)
    before = place(engine)[2]
    command(engine, *LEVEL, 0.0, 0.0, 0.0, 1.0, seconds=0.4)
    gravity = -engine.world.model.opt.gravity[2]
    assert before - place(engine)[2] == pytest.approx(gravity * 0.4**2 / 2.0, rel=0.02)
    run(engine, 3.0)
    assert place(engine)[2] == pytest.approx(0.05, abs=0.01)
    assert np.abs(velocity(engine)).max() < 0.02


def test_it_does_not_stick_to_a_wall() -> None:
    """Driven into a wall it is stopped, and leaves at once when told to (robots 45)."""
    build = furnished(box("wall", (1.0, 0.0, 2.0), (0.1, 3.0, 2.0)))
    engine = engine_of(aircraft(), scenery=build)
    command(engine, 2.0, 0.0, 0.0, 0.0, 0.0, 0.4, 0.0, seconds=4.0)
    assert place(engine)[0] < 0.75
    assert np.linalg.norm(velocity(engine)) < 0.1
    assert place(engine)[2] == pytest.approx(2.0, abs=0.1)
    before = place(engine)[0]
    command(engine, -1.0, 0.0, 0.0, 0.0, 0.0, -0.4, 0.0, seconds=1.5)
    assert velocity(engine)[0] == pytest.approx(-1.0, abs=0.05)
    assert place(engine)[0] < before - 0.8


def test_it_rights_itself() -> None:
    """Thrown upside down in the air it comes back level and stops."""
    engine = engine_of(aircraft())
    start = engine.world.layouts[0].qpos
    engine.data.qpos[start + 3 : start + 7] = (0.1, 0.99, 0.05, 0.0)
    engine.data.qvel[engine.world.layouts[0].dof + 3] = 5.0
    run(engine, 4.0)
    assert axes(engine)[2, 2] > 0.999
    assert np.abs(velocity(engine)).max() < 0.01


numbers = st.floats(-100.0, 100.0)


@settings(max_examples=25)
@given(
    st.lists(st.tuples(numbers, numbers, numbers, numbers, numbers, numbers), max_size=3),
    st.sampled_from([0.001, 0.005]),
)
def test_no_command_tears_it_apart(commands: list[tuple[float, ...]], timestep: float) -> None:
    """Whatever it is told, it stays in the world with finite speed."""
    engine = engine_of(aircraft(), height=100.0, timestep=timestep)
    for one in commands:
        command(engine, *one, 0.0)
        for _ in range(30):
            assert engine.advance(2) == []
    assert np.abs(velocity(engine)).max() < 110.0
    assert np.abs(spin(engine)).max() < 150.0
