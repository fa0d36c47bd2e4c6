"""One body that goes mad must not take the world along."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from sim_fakes import (
    ROBOT,
    ROGUE,
    base_qpos,
    crate,
    engine_with,
    floor,
    furnished,
    pose_at,
    robot_model,
    run,
    straight,
    turn,
    whole_state,
    yard,
)

from usarsim_server.base.errors import UsarsimError
from usarsim_server.simulation.divergence import SPEED_LIMIT
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.model import PhysicsOptions


def busy_engine() -> Engine:
    """Three robots on their way, crates and a door."""
    engine = engine_with((0.0, 0.0), (0.0, 2.0), (0.0, 4.0), scenery=yard, spare=1)
    for robot, targets in enumerate((straight(2.0), turn(2.0), straight(-1.0))):
        engine.drive(robot, targets)
    run(engine, 0.4)
    return engine


def spoil(engine: Engine, robot: int, field: str, value: float) -> None:
    """Write nonsense into the state of one robot."""
    layout = engine.world.layouts[engine.active[robot]]
    places = {
        "qvel": layout.dof,
        "qpos": layout.qpos,
        "wheel": layout.wheel_dof[1],
        "angle": layout.wheel_qpos[1],
    }
    array = engine.data.qpos if field in ("qpos", "angle") else engine.data.qvel
    array[places[field]] = value


NONSENSE = [
    ("qvel", np.nan),
    ("qvel", np.inf),
    ("qvel", 1e30),
    ("qvel", 2.0 * SPEED_LIMIT),
    ("qpos", np.nan),
    ("wheel", np.nan),
    ("wheel", -1e6),
    ("angle", np.nan),
]


class TestCulprit:
    """Who leaves, and who does not notice."""

    @pytest.mark.parametrize(("field", "value"), NONSENSE)
    def test_only_the_culprit_leaves(self, field: str, value: float) -> None:
        """Whatever goes mad in one robot, that robot leaves and no other."""
        engine = busy_engine()
        spoil(engine, 1, field, value)
        assert engine.advance(2) == [1]
        assert set(engine.active) == {0, 2}
        assert run(engine, 0.5) == []

    @pytest.mark.parametrize(("field", "value"), NONSENSE)
    def test_the_others_go_on(self, field: str, value: float) -> None:
        """The others move as they would have moved had nobody gone mad, to rounding."""
        quiet, spoiled = busy_engine(), busy_engine()
        spoil(spoiled, 1, field, value)
        run(spoiled, 0.4)
        run(quiet, 0.4)
        assert spoiled.time == quiet.time
        for robot in (0, 2):
            np.testing.assert_allclose(
                whole_state(spoiled, robot), whole_state(quiet, robot), atol=1e-9
            )
        for thing in ("crate0", "crate1", "door"):
            np.testing.assert_allclose(
                spoiled.data.body(thing).xpos, quiet.data.body(thing).xpos, atol=1e-9
            )

    def test_time_goes_on_and_never_back(self) -> None:
        """Every call advances simulated time by its steps, divergence or not (robots 67)."""
        engine = busy_engine()
        for robot in (0, 1, 2):
            spoil(engine, robot, "qvel", np.nan)
            before = engine.time
            assert engine.advance(5) == [robot]
            assert engine.time == pytest.approx(before + 5 * engine.timestep)
            assert engine.data.time == pytest.approx(engine.time)

    def test_two_culprits_at_once(self) -> None:
        """Two robots that go mad in the same step both leave, the third stays."""
        engine = busy_engine()
        spoil(engine, 0, "qvel", np.nan)
        spoil(engine, 2, "qpos", np.nan)
        assert sorted(engine.advance(2)) == [0, 2]
        assert set(engine.active) == {1}

    def test_the_slot_can_be_used_again(self) -> None:
        """A new robot in the slot of a mad one is sane."""
        engine = busy_engine()
        spoil(engine, 1, "qvel", np.nan)
        engine.advance(2)
        slot = engine.free_slot(ROBOT.key)
        assert slot == 1
        engine.occupy(9, slot, pose_at(0.0, 2.0))
        engine.drive(9, straight(3.0))
        assert run(engine, 1.0) == []
        assert base_qpos(engine, 9)[0] > 0.2

    def test_a_robot_that_tears_itself_apart(self) -> None:
        """A badly described robot that blows up by itself leaves; its neighbours stay."""
        engine = Engine(floor(), PhysicsOptions(), [ROGUE, ROBOT, ROGUE])
        for robot in range(3):
            engine.occupy(robot, robot, pose_at(0.0, 1.0 * robot))
        engine.drive(1, straight(2.0))
        engine.drive(2, straight(5.0))
        assert run(engine, 1.0) == [2]
        assert base_qpos(engine, 1)[0] > 0.1
        assert set(engine.active) == {0, 1}

    def test_a_culprit_in_a_crowd(self) -> None:
        """A robot that blows up while it touches others leaves; those around it stay sane."""
        engine = Engine(floor(), PhysicsOptions(), [ROBOT, ROGUE, ROBOT])
        for robot in range(3):
            engine.occupy(robot, robot, pose_at(0.49 * robot, 0.0))
        for robot in range(3):
            engine.drive(robot, straight(3.0))
        assert run(engine, 2.0) == [1]
        assert set(engine.active) == {0, 2}
        assert np.isfinite(engine.data.qpos).all()
        assert np.abs(engine.data.qvel).max() < 20.0


class TestMovables:
    """Crates and doors."""

    @pytest.mark.parametrize("value", [np.nan, 1e9])
    @pytest.mark.parametrize("name", ["crate1", "door"])
    def test_returns_to_its_place(
        self, name: str, value: float, caplog: pytest.LogCaptureFixture
    ) -> None:
        """A movable object that goes mad is put back where the world has it; no robot leaves."""
        engine = busy_engine()
        body = engine.world.model.body(name)
        joint = engine.world.model.joint(body.jntadr[0])
        rest = engine.world.model.qpos0[joint.qposadr[0] :][: 7 if name == "crate1" else 1]
        with caplog.at_level(logging.WARNING, "usarsim"):
            engine.data.qpos[joint.qposadr[0]] += 0.4
            engine.data.qvel[joint.dofadr[0]] = value
            assert engine.advance(2) == []
        now = engine.data.qpos[joint.qposadr[0] :][: len(rest)]
        np.testing.assert_allclose(now, rest, atol=1e-3)
        assert set(engine.active) == {0, 1, 2}
        assert "movable" in caplog.text

    def test_others_stay_where_they_are(self) -> None:
        """Only the mad one is put back: a crate that was pushed stays where it was pushed to."""
        engine = busy_engine()
        model, data = engine.world.model, engine.data
        data.joint(model.body("crate0").jntadr[0]).qpos[0] = 1.0
        run(engine, 0.2)
        data.qvel[model.joint(model.body("crate1").jntadr[0]).dofadr[0]] = np.nan
        engine.advance(2)
        assert engine.snapshot().xpos[model.body("crate0").id][0] == pytest.approx(1.0, abs=1e-3)


class TestRare:
    """Corners."""

    def test_a_parked_robot_is_put_back(self) -> None:
        """Nonsense in a free slot is no robot's fault and does not last."""
        engine = busy_engine()
        layout = engine.world.layouts[3]
        engine.data.qvel[layout.dof] = np.nan
        assert engine.advance(2) == []
        place = engine.data.qpos[layout.qpos : layout.qpos + 2]
        np.testing.assert_allclose(place, engine.world.parking[3, :2], atol=1e-6)
        assert set(engine.active) == {0, 1, 2}

    def test_commands_of_the_failed_turn_are_kept(self) -> None:
        """A command that arrives just before another robot goes mad is obeyed all the same."""
        quiet, spoiled = busy_engine(), busy_engine()
        for engine in (quiet, spoiled):
            engine.drive(0, straight(6.0))
        spoil(spoiled, 1, "qvel", np.nan)
        run(quiet, 0.2)
        run(spoiled, 0.2)
        np.testing.assert_array_equal(spoiled.wheel_targets(0), straight(6.0))
        # The solver stops a little earlier or later in another company.
        np.testing.assert_allclose(whole_state(spoiled, 0), whole_state(quiet, 0), atol=1e-7)

    def test_a_world_that_cannot_stand_is_an_error(self) -> None:
        """If the world diverges with every robot and object put away, the engine says so."""
        scenery = furnished(crate("crate", (0.0, 0.0, 0.15)))
        engine = engine_with((2.0, 0.0), scenery=scenery)
        engine.data.xfrc_applied[engine.world.model.body("crate").id, 0] = 1e12
        with pytest.raises(UsarsimError, match="diverges"):
            run(engine, 0.1)

    def test_fast_is_not_mad(self) -> None:
        """Wheels that spin as fast as any real wheel are no divergence."""
        engine = engine_with((0.0, 0.0), model=robot_model(torque=0.0))
        engine.drive(0, straight(300.0))
        assert run(engine, 2.0) == []

    def test_same_madness_same_outcome(self) -> None:
        """Containment is deterministic: two equal runs end in equal bits."""
        states = []
        for _ in range(2):
            engine = busy_engine()
            spoil(engine, 2, "wheel", np.nan)
            lost = run(engine, 0.3)
            states.append((lost, engine.data.qpos.copy(), engine.data.qvel.copy()))
        assert states[0][0] == states[1][0] == [2]
        np.testing.assert_array_equal(states[0][1], states[1][1])
        np.testing.assert_array_equal(states[0][2], states[1][2])
