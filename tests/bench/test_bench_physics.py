"""The physics thread against bare MuJoCo: what is counted, and that comparing changes nothing."""

from __future__ import annotations

import math
import time
from types import SimpleNamespace

import numpy as np
import pytest

from usarsim_bench import physics as instrument
from usarsim_bench import stepping
from usarsim_bench.physics import BareSteps, Bystander, compared, physics_figures, within
from usarsim_bench.server import BenchError
from usarsim_bench.stepping import ROBOT_CLASS, Stopwatch
from usarsim_server.robots.catalog import load_roster
from usarsim_server.simulation.engine import Engine
from usarsim_server.worlds.loader import find_world, load_world


@pytest.fixture(scope="module")
def engine() -> Engine:
    """Two robots that have driven for a moment."""
    description = load_roster(()).find(ROBOT_CLASS)
    assert description is not None
    made = stepping._engine(load_world(find_world("empty")), description, 2)
    for robot, speed in enumerate((1.0, -0.5)):
        made.drive(robot, np.full(4, speed))
    made.advance(100)
    return made


class TestBystander:
    @pytest.fixture
    def clock(self, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
        """A processor clock that only goes when it is told to."""
        hand = SimpleNamespace(now=0.0)
        monkeypatch.setattr(time, "thread_time", lambda: hand.now)
        return hand

    def test_counts_the_whole_thread_between_two_pauses(self, clock: SimpleNamespace) -> None:
        """What is spent outside the steps counts, too; pauses and what follows them do not."""
        watch = Stopwatch()
        engine = SimpleNamespace(active={0: 0, 1: 1}, data=SimpleNamespace(ncon=8))
        pauses: list[float] = []

        def bare(_: object) -> float:
            pauses.append(clock.now)
            clock.now += 5.0
            return 0.001

        bystander = Bystander(bare, watch)
        part = watch.timed(lambda: setattr(clock, "now", clock.now + 0.004))
        for _ in range(200):
            clock.now += 0.001  # snapshots, waking, waiting
            part()
            bystander.stepped(engine, 2, 0.004)  # type: ignore[arg-type]
        assert len(bystander.turns) == len(pauses) == 2
        for turn in bystander.turns:
            assert turn.thread == pytest.approx(0.0025)
            assert turn.engine == pytest.approx(0.002)
            assert turn.mujoco == pytest.approx(0.002)
            assert (turn.bare, turn.robots, turn.contacts) == (0.001, 2, 8)

    def test_nothing_is_counted_while_it_settles(self, clock: SimpleNamespace) -> None:
        """The first steps, and those after a pause, are left out however dear they are."""
        bystander = Bystander(lambda _: 0.001, Stopwatch())
        engine = SimpleNamespace(active={}, data=SimpleNamespace(ncon=0))
        for number in range(instrument.SETTLE_STEPS + instrument.COUNTED_STEPS):
            clock.now += 1.0 if number < instrument.SETTLE_STEPS else 0.001
            bystander.stepped(engine, 1, 0.0)  # type: ignore[arg-type]
        (turn,) = bystander.turns
        assert turn.thread == pytest.approx(0.001)
        assert turn.mujoco == 0.0


class TestBareSteps:
    def test_the_engine_stays_as_it_is(self, engine: Engine) -> None:
        """Comparing moves nothing: not the state, not the commands."""
        before = [engine.data.qpos.copy(), engine.data.qvel.copy(), engine.wheel_targets(0)]
        assert BareSteps(20.0).spend(engine) > 0.0
        after = [engine.data.qpos, engine.data.qvel, engine.wheel_targets(0)]
        assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))

    def test_robots_drive_there_as_they_do_here(self, engine: Engine) -> None:
        """The bare scene starts where the engine is, and its wheels turn at the same speeds."""
        bare = BareSteps(20.0)
        bare.spend(engine)
        assert bare._data is not None
        moved = (instrument.WARM_STEPS + instrument.BARE_STEPS) * engine.timestep
        assert bare._data.time == pytest.approx(engine.data.time + moved)
        for robot, speed in enumerate((1.0, -0.5)):
            wheels = bare._data.qvel[engine.world.layouts[robot].wheel_dof]
            assert wheels == pytest.approx(np.full(4, speed), abs=0.1)


class TestCompared:
    def test_every_engine_is_watched_and_works_on(
        self, monkeypatch: pytest.MonkeyPatch, engine: Engine
    ) -> None:
        """Steps are made as before, turns are taken, and the engine is the old one afterwards."""
        monkeypatch.setattr(instrument, "SETTLE_STEPS", 2)
        monkeypatch.setattr(instrument, "COUNTED_STEPS", 6)
        original = Engine.advance
        steps = engine.steps
        with compared() as bystander:
            for _ in range(8):
                assert engine.advance(2) == []
        assert Engine.advance is original
        assert engine.steps == steps + 16
        assert bystander.turns
        for turn in bystander.turns:
            assert turn.robots == 2
            assert turn.thread >= turn.engine > turn.mujoco > 0.0
            assert turn.bare > 0.0


def turn(moment: float, robots: int = 2, thread: float = 0.003) -> dict[str, float]:
    """A turn as the file has it."""
    return {
        "moment": moment,
        "robots": robots,
        "thread": thread,
        "engine": 0.0022,
        "mujoco": 0.0015,
        "bare": 0.002,
        "contacts": 8,
    }


class TestFigures:
    def test_turns_of_the_whole_team_within_the_span(self) -> None:
        """While robots are still coming nothing is compared."""
        turns = [turn(1.0), turn(2.0), turn(3.0, robots=1), turn(4.0)]
        assert [one["moment"] for one in within(turns, 2, 1.5, 4.5)] == [2.0, 4.0]
        with pytest.raises(BenchError, match="not compared"):
            within(turns, 3, 0.0, 9.0)

    def test_ratios_are_medians_of_turns(self) -> None:
        """One turn that was disturbed does not move them."""
        turns = [turn(1.0, thread=0.0021), turn(2.0, thread=0.0021), turn(3.0, thread=0.9)]
        figures = {one.name: one for one in physics_figures(2, turns)}
        ratio = figures["2 robots: physics thread / bare mj_step"]
        assert ratio.value == pytest.approx(1.05)
        assert ratio.met is True
        assert figures["2 robots: its step loop alone / bare mj_step"].value == pytest.approx(1.1)
        assert figures["2 robots: physics thread / MuJoCo's part of it"].value == pytest.approx(1.4)
        assert figures["2 robots: bare mj_step"].value == pytest.approx(2000.0)
        assert all(math.isfinite(one.value) for one in figures.values())

    def test_an_engine_that_steps_otherwise(self) -> None:
        """Where MuJoCo's part is not known no ratio is made up."""
        turns = [turn(1.0) | {"mujoco": 0.0}]
        assert not [one for one in physics_figures(2, turns) if "MuJoCo's part" in one.name]
