"""Laws of motion: whom they hold for, what they remember, what makes them forget."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from law_fakes import (
    Counter,
    aircraft,
    command,
    engine_of,
    place,
    submarine,
    velocity,
)
from sim_fakes import ROBOT, floor, pose_at, run

from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import IDENTITY
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.motion_laws import LawModel, Laws


@pytest.fixture
def model() -> mujoco.MjModel:
    """Three bodies on free joints, each the base of a slot."""
    spec = mujoco.MjSpec()
    for number in range(3):
        body = spec.worldbody.add_body(name=f"{number}:base", pos=[number, 0, 0])
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1] * 3, mass=1.0)
    return spec.compile()


def laws_of(model: mujoco.MjModel, *counts: int) -> tuple[Laws, list[Counter]]:
    """Slots with so many counters each, of two channels."""
    made: list[Counter] = []

    def make(model: mujoco.MjModel, prefix: str) -> Counter:
        made.append(Counter(model, prefix))
        return made[-1]

    one = LawModel(make, 2)
    return Laws(model, [(f"{n}:", (one,) * count) for n, count in enumerate(counts)]), made


def step(laws: Laws, data: mujoco.MjData) -> None:
    laws.before(data)
    laws.between(data)


def test_laws_hold_for_occupied_slots_only(model: mujoco.MjModel) -> None:
    """A law is obeyed from the moment its slot is taken until it is left."""
    laws, (one, other) = laws_of(model, 1, 1)
    data = mujoco.MjData(model)
    step(laws, data)
    laws.occupy(1)
    step(laws, data)
    step(laws, data)
    assert (one.memory[0], other.memory[0]) == (0, 2)
    laws.release(1, data)
    step(laws, data)
    assert other.memory[0] == 0  # forgotten, and asked no more


def test_a_command_is_cut_in_pieces_for_the_laws_of_a_slot(model: mujoco.MjModel) -> None:
    """Every law of a slot gets the numbers of its own, in order; other slots get nothing."""
    laws, made = laws_of(model, 1, 2)
    for slot in (0, 1):
        laws.occupy(slot)
    laws.command(1, np.array([1.0, 2.0, 30.0, 40.0]))
    step(laws, mujoco.MjData(model))
    assert [one.memory[1] for one in made] == [0.0, 3.0, 70.0]
    assert laws.drives(1)
    assert not laws.drives(0)


@pytest.mark.parametrize("values", [[1.0], [1.0, 2.0, 3.0], [[1.0, 2.0]]])
def test_commands_that_do_not_fit_change_nothing(model: mujoco.MjModel, values: object) -> None:
    """A wrong count is refused, and the old command stays."""
    laws, (counter, _) = laws_of(model, 1, 1)
    laws.occupy(0)
    laws.command(0, np.array([1.0, 1.0]))
    with pytest.raises(ValueError, match="does not fit"):
        laws.command(0, np.array(values))
    step(laws, mujoco.MjData(model))
    assert counter.memory[1] == 2.0


def test_leaving_clears_the_command(model: mujoco.MjModel) -> None:
    """Who takes a slot next starts without a command."""
    laws, (counter,) = laws_of(model, 1)
    data = mujoco.MjData(model)
    laws.occupy(0)
    laws.command(0, np.array([5.0, 5.0]))
    laws.release(0, data)
    laws.occupy(0)
    step(laws, data)
    assert counter.memory[1] == 0.0


def test_being_put_elsewhere_keeps_the_command(model: mujoco.MjModel) -> None:
    """A teleported machine forgets its state but not what it was told."""
    laws, (counter,) = laws_of(model, 1)
    data = mujoco.MjData(model)
    laws.occupy(0)
    laws.command(0, np.array([5.0, 5.0]))
    step(laws, data)
    laws.place(0, data, IDENTITY)
    assert counter.memory.tolist() == [0.0, 0.0]
    step(laws, data)
    assert counter.memory.tolist() == [1.0, 10.0]


def test_state_goes_back_and_forth(model: mujoco.MjModel) -> None:
    """Restoring brings back commands, memories, and which slots are taken."""
    laws, (one, other) = laws_of(model, 1, 1)
    data = mujoco.MjData(model)
    laws.occupy(0)
    laws.command(0, np.array([1.0, 0.0]))
    step(laws, data)
    kept = laws.state(data)
    laws.release(0, data)
    laws.occupy(1)
    laws.command(1, np.array([7.0, 0.0]))
    step(laws, data)
    laws.restore(data, kept)
    step(laws, data)
    assert one.memory.tolist() == [2.0, 1.0]
    assert other.memory.tolist() == [0.0, 0.0]
    assert not laws.drives(1)


def test_a_larger_generation_inherits_what_is_taken(model: mujoco.MjModel) -> None:
    """Growth carries over commands and memories of taken slots and adds idle ones."""
    small, (counter,) = laws_of(model, 1)
    data = mujoco.MjData(model)
    small.occupy(0)
    small.command(0, np.array([1.0, 2.0]))
    step(small, data)
    large, (same, new) = laws_of(model, 1, 1)
    large.inherit(small, (), data, data)
    step(large, data)
    assert same.memory.tolist() == [2.0, 3.0]
    assert new.memory.tolist() == [0.0, 0.0]
    assert counter.memory[0] == 1.0


# -- in the engine ---------------------------------------------------------------------------------


def test_flight_goes_on_while_the_world_grows() -> None:
    """An aircraft that tilts and a submarine on its way do not notice that others come."""
    quiet = engine_of(aircraft(), submarine())
    grown = engine_of(aircraft(), submarine())
    for engine in (quiet, grown):
        command(engine, 1.0, 0.0, 0.5, 0.3, 0.2, 0.3, 0.0, robot=0)
        command(engine, 30.0, 0.2, 0.0, robot=1, seconds=0.4)  # in the middle of ramps
    grown.adopt(grown.grow([ROBOT, aircraft()]))
    assert len(grown.world.slots) == 4
    for engine in (quiet, grown):
        run(engine, 1.0)
    for robot in (0, 1):
        np.testing.assert_allclose(place(grown, robot), place(quiet, robot), atol=1e-6)
        np.testing.assert_allclose(velocity(grown, robot), velocity(quiet, robot), atol=1e-6)
    assert velocity(grown)[2] == pytest.approx(0.5, abs=0.02)


def test_teleport_keeps_the_order_to_climb() -> None:
    """An aircraft that is put elsewhere is at rest there, level, and then does as it was told."""
    engine = engine_of(aircraft())
    command(engine, 0.0, 0.0, 1.0, 0.0, 0.0, 0.4, 0.0, seconds=1.0)
    assert engine.teleport(0, pose_at(5.0, 5.0, 4.0))
    np.testing.assert_array_equal(velocity(engine), np.zeros(3))
    np.testing.assert_allclose(place(engine), (5.0, 5.0, 4.0))
    assert not engine.data.qfrc_applied.any()
    run(engine, 1.5)
    assert velocity(engine)[2] == pytest.approx(1.0, abs=0.02)


def test_a_divergence_elsewhere_leaves_flight_alone() -> None:
    """When a batch is taken back because of a rogue, aircraft repeat it to the letter."""
    quiet, spoiled = (engine_of(aircraft(), aircraft()) for _ in range(2))
    for engine in (quiet, spoiled):
        command(engine, 1.0, 0.0, 0.5, 0.3, 0.1, 0.3, 0.0, seconds=0.3)
    spoiled.data.qvel[spoiled.world.layouts[1].dof] = np.nan
    assert spoiled.advance(2) == [1]
    quiet.advance(2)
    for engine in (quiet, spoiled):
        run(engine, 0.5)
    np.testing.assert_allclose(place(spoiled), place(quiet), atol=1e-9)
    assert np.isfinite(spoiled.data.qfrc_applied).all()


@pytest.mark.parametrize(
    ("field", "value"),
    [("qpos", np.inf), ("qpos", np.nan), ("qvel", np.inf), ("qvel", np.nan), ("qvel", 1e300)],
)
def test_an_aircraft_that_diverges_leaves_no_force_behind(field: str, value: float) -> None:
    """Its slot is parked at rest and can be taken again."""
    engine = engine_of(aircraft(), aircraft())
    command(engine, 1.0, 0.0, 0.5, 0.3, 0.1, 0.3, 0.0, seconds=0.3)
    dof = engine.world.layouts[0].dof
    layout = engine.world.layouts[0]
    if field == "qpos":
        engine.data.qpos[layout.qpos] = value
    else:
        engine.data.qvel[layout.dof + 4] = value
    assert engine.advance(2) == [0]
    assert not engine.data.qfrc_applied[dof : dof + 6].any()
    engine.occupy(7, 0, pose_at(0.0, 0.0, 2.0))
    assert run(engine, 1.0) == []
    np.testing.assert_allclose(place(engine, 7), (0.0, 0.0, 2.0), atol=1e-3)


def test_what_is_told_to_move_never_sleeps() -> None:
    """An aircraft pressed against a wall stays awake, and leaves when the wall does."""
    spec = floor()()
    gate = spec.worldbody.add_body(name="gate", mocap=True, pos=[0.6, 0.0, 2.0])
    gate.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 1.0, 1.0])
    engine = Engine(spec.copy, PhysicsOptions(), [aircraft()])
    engine.occupy(0, 0, pose_at(0.0, 0.0, 2.0))
    command(engine, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, seconds=4.0)
    assert abs(velocity(engine)[0]) < 1e-3
    engine.data.mocap_pos[0] = (0.6, 9.0, 2.0)
    run(engine, 1.0)
    assert velocity(engine)[0] == pytest.approx(0.5, abs=0.02)
