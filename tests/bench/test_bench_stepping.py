"""Step loops and the physics thread are compared on the same scene, and bare means bare."""

from __future__ import annotations

import math
import time
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from usarsim_bench import physics, stepping
from usarsim_bench.figures import Plan
from usarsim_bench.physics import (
    BareSteps,
    Bystander,
    compared,
    growth_figures,
    physics_figures,
    within,
)
from usarsim_bench.server import BenchError
from usarsim_bench.stepping import HALVES, ROBOT_CLASS, Stepping, Stopwatch, measure
from usarsim_server.robots.catalog import load_catalog
from usarsim_server.simulation.engine import Engine
from usarsim_server.worlds.loader import find_world, load_world


@pytest.fixture
def scene() -> stepping._Scene:
    """Two robots on the empty floor."""
    return stepping._Scene(load_world(find_world("empty")), 2, seed=1)


class TestStopwatch:
    def test_adds_up_the_processor_time_of_its_functions(self) -> None:
        """Computing counts, waiting does not; a timed function does what it did."""
        watch = Stopwatch()

        def work() -> None:
            stop = time.thread_time() + 0.01
            while time.thread_time() < stop:
                pass

        timed = watch.timed(work)
        timed()
        timed()
        assert watch.calls == 2
        assert watch.seconds >= 0.019
        idle = Stopwatch()
        idle.timed(lambda: time.sleep(0.1))()
        assert idle.seconds < 0.05
        assert Stopwatch().timed(divmod)(17, 5) == (3, 2)

    def test_reset(self) -> None:
        """A reset watch has counted nothing, its own calibration included."""
        watch = Stopwatch()
        assert (watch.calls, watch.seconds) == (0, 0.0)
        watch.timed(len)("abc")
        watch.reset()
        assert (watch.calls, watch.seconds) == (0, 0.0)


class TestScene:
    def test_twins_stay_together(self, scene: stepping._Scene) -> None:
        """Timing MuJoCo's halves does not change what the engine does."""
        for _ in range(3):
            scene.turn()
        assert np.array_equal(scene._engine.data.qpos, scene._twin.data.qpos)
        assert np.array_equal(scene._engine.data.qvel, scene._twin.data.qvel)

    def test_parted_twins_are_noticed(self, scene: stepping._Scene) -> None:
        """Rates of different states are not compared."""
        scene._twin.data.qpos[0] += 0.001
        with pytest.raises(RuntimeError, match="parted"):
            scene.advance()

    def test_an_engine_that_steps_otherwise_is_noticed(
        self, scene: stepping._Scene, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """If the engine no longer calls the functions that are timed, there is no figure."""
        monkeypatch.setattr(stepping, "HALVES", ("mj_step1", "mj_inverse"))
        with pytest.raises(RuntimeError, match="two halves"):
            scene.advance()

    def test_mujoco_is_as_before_afterwards(self, scene: stepping._Scene) -> None:
        """The timed functions are the original ones again, also after an error."""
        before = [getattr(mujoco, name) for name in HALVES]
        inside: list[object] = []

        def fail() -> None:
            with stepping.calls_timed(Stopwatch(), stepping.HALVES):
                inside.extend(getattr(mujoco, name) for name in HALVES)
                raise ZeroDivisionError

        with pytest.raises(ZeroDivisionError):
            fail()
        assert not set(inside) & set(before)
        assert [getattr(mujoco, name) for name in HALVES] == before

    def test_robots_drive_in_all_loops(self, scene: stepping._Scene) -> None:
        """Engine and bare loop move the robots alike: what is compared is the same work."""
        for robot, (left, right) in enumerate([(1.0, 1.0), (0.5, 1.0)]):
            targets = np.where(scene._left, left, right)
            scene._engine.drive(robot, targets)
            scene._twin.drive(robot, targets)
            actuators = scene._engine.world.layouts[robot].wheel_actuators
            scene._bare.ctrl[actuators] = targets
        ctrl = scene._bare.ctrl.copy()
        mujoco.mj_copyData(scene._bare, scene._engine.world.model, scene._engine.data)
        scene._bare.ctrl[:] = ctrl
        start = scene._engine.data.qpos.copy()
        for _ in range(20):
            scene.advance()
            scene._step_bare()
        for layout in scene._engine.world.layouts:
            place = slice(layout.qpos, layout.qpos + 2)
            ways = [
                float(np.linalg.norm(data.qpos[place] - start[place]))
                for data in (scene._engine.data, scene._bare)
            ]
            # Two seconds at 0.75 to 1 rad/s on wheels of 0.098 m.
            assert ways == pytest.approx([0.165] * 2, abs=0.045)
            speeds = scene._bare.qvel[layout.wheel_dof]
            assert speeds == pytest.approx(scene._engine.data.qvel[layout.wheel_dof], abs=0.2)

    def test_bare_loop_begins_each_turn_where_the_engine_is(
        self, scene: stepping._Scene, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """However far it went its own way, the next repetition starts from the engine's state."""
        scene.turn()
        scene._bare.qpos[:] += 1.0
        begun: list[bool] = []

        def look() -> float:
            begun.append(np.array_equal(scene._bare.qpos, scene._engine.data.qpos))
            return 0.0

        scene._turns = 0  # the bare loop goes first in odd turns
        monkeypatch.setattr(scene, "_step_bare", look)
        scene.turn()
        assert begun[0]


class TestMeasure:
    def test_figures_fit_together(self) -> None:
        """All robots stand on four wheels in the engine, and every rate is one."""
        result = measure("empty", 2, seconds=0.4, seed=3)
        assert (result.world, result.robots) == ("empty", 2)
        assert result.steps == stepping.REPETITION_CHUNKS * stepping.CHUNK_STEPS
        assert result.contacts == pytest.approx(8.0, abs=0.5)
        # With one repetition the medians are the values themselves.
        assert result.to_bare == pytest.approx(result.engine / result.bare)
        assert result.to_mujoco == pytest.approx(result.engine / result.mujoco)
        assert min(result.engine, result.bare, result.mujoco) > 0.0

    def test_seconds_give_repetitions(self) -> None:
        """A longer measurement has more repetitions of the same length."""
        repetition = stepping.REPETITION_CHUNKS * stepping.CHUNK_STEPS
        assert measure("empty", 1, seconds=1.0).steps == 2 * repetition


class TestTool:
    def test_worlds_are_measured_once_each(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """The bare floor comes along unless it is the world asked for."""
        asked: list[tuple[str, int, float]] = []

        def apart(_: object, world: str, robots: int, seconds: float, seed: int) -> Stepping:
            asked.append((world, robots, seconds))
            return Stepping(world, robots, 1, 1.0, 1.0, 1.0, 8.0, 8.0, 1.0, 1.0)

        monkeypatch.setattr(stepping, "run_apart", apart)
        stepping.measure_stepping(Plan(world="arena"))
        stepping.measure_stepping(Plan(world="empty", robots=2, seconds=3.0))
        usual = [(world, robots, 10.0) for world in ("empty", "arena") for robots in (1, 4, 16)]
        assert asked == [*usual, ("empty", 2, 3.0)]

    def test_a_process_that_fails_says_why(self) -> None:
        """The error ends with what it said."""
        with pytest.raises(BenchError, match="no such world"):
            stepping.measure_stepping(Plan(world="nowhere-at-all", robots=1, seconds=0.1))


@pytest.fixture(scope="module")
def engine() -> Engine:
    """Two robots that have driven for a moment."""
    description = load_catalog(()).find(ROBOT_CLASS)
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
        for number in range(physics.SETTLE_STEPS + physics.COUNTED_STEPS):
            clock.now += 1.0 if number < physics.SETTLE_STEPS else 0.001
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
        moved = (physics.WARM_STEPS + physics.BARE_STEPS) * engine.timestep
        assert bare._data.time == pytest.approx(engine.data.time + moved)
        for robot, speed in enumerate((1.0, -0.5)):
            wheels = bare._data.qvel[engine.world.layouts[robot].wheel_dof]
            assert wheels == pytest.approx(np.full(4, speed), abs=0.1)


class TestCompared:
    def test_every_engine_is_watched_and_works_on(
        self, monkeypatch: pytest.MonkeyPatch, engine: Engine
    ) -> None:
        """Steps are made as before, turns are taken, and the engine is the old one afterwards."""
        monkeypatch.setattr(physics, "SETTLE_STEPS", 2)
        monkeypatch.setattr(physics, "COUNTED_STEPS", 6)
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
        "server": 0.005,
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
        assert figures["2 robots: all of the server / bare mj_step"].value == pytest.approx(2.5)
        assert all(math.isfinite(one.value) for one in figures.values())

    def test_a_robot_among_many_against_one_alone(self) -> None:
        """64 robots that cost 64 times what one costs are 1.0."""
        (figure,) = growth_figures({1: 2e-5, 64: 1.92e-3})
        assert figure.name == "64 robots: bare mj_step / 64 times that of one robot"
        assert figure.value == pytest.approx(1.5)
        assert figure.met is False
        assert growth_figures({64: 1.0}) == []

    def test_an_engine_that_steps_otherwise(self) -> None:
        """Where MuJoCo's part is not known no ratio is made up."""
        turns = [turn(1.0) | {"mujoco": 0.0}]
        assert not [one for one in physics_figures(2, turns) if "MuJoCo's part" in one.name]
