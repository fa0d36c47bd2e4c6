"""The step loops are compared on the same scene, and bare means bare."""

from __future__ import annotations

import json
import time

import mujoco
import numpy as np
import pytest

from usarsim_bench import stepping
from usarsim_bench import stepping as instrument
from usarsim_bench.figures import Plan
from usarsim_bench.server import BenchError
from usarsim_bench.stepping import HALVES, Stopwatch, main, measure
from usarsim_server.worlds.loader import find_world, load_world


@pytest.fixture
def scene() -> instrument._Scene:
    """Two robots on the empty floor."""
    return instrument._Scene(load_world(find_world("empty")), 2, seed=1)


class TestStopwatch:
    def test_adds_up_the_time_of_its_functions(self) -> None:
        """Computing counts, and so does every call."""
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

    def test_waiting_does_not_count(self) -> None:
        """Time in which other programs run is not the function's."""
        watch = Stopwatch()
        watch.timed(lambda: time.sleep(0.1))()
        assert watch.seconds < 0.05

    def test_passes_arguments_and_results(self) -> None:
        """A timed function does what it did."""
        assert Stopwatch().timed(divmod)(17, 5) == (3, 2)

    def test_reset(self) -> None:
        """A reset watch has counted nothing, its own calibration included."""
        watch = Stopwatch()
        assert (watch.calls, watch.seconds) == (0, 0.0)
        watch.timed(len)("abc")
        watch.reset()
        assert (watch.calls, watch.seconds) == (0, 0.0)


class TestScene:
    def test_twins_stay_together(self, scene: instrument._Scene) -> None:
        """Timing MuJoCo's halves does not change what the engine does."""
        for _ in range(3):
            scene.turn()
        assert np.array_equal(scene._engine.data.qpos, scene._twin.data.qpos)
        assert np.array_equal(scene._engine.data.qvel, scene._twin.data.qvel)

    def test_parted_twins_are_noticed(self, scene: instrument._Scene) -> None:
        """Rates of different states are not compared."""
        scene._twin.data.qpos[0] += 0.001
        with pytest.raises(RuntimeError, match="parted"):
            scene.advance()

    def test_an_engine_that_steps_otherwise_is_noticed(
        self, scene: instrument._Scene, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """If the engine no longer calls the functions that are timed, there is no figure."""
        monkeypatch.setattr(instrument, "HALVES", ("mj_step1", "mj_inverse"))
        with pytest.raises(RuntimeError, match="two halves"):
            scene.advance()

    def test_mujoco_is_as_before_afterwards(self, scene: instrument._Scene) -> None:
        """The timed functions are the original ones again, also after an error."""
        before = [getattr(mujoco, name) for name in HALVES]
        inside: list[object] = []

        def fail() -> None:
            with instrument.halves_timed(Stopwatch()):
                inside.extend(getattr(mujoco, name) for name in HALVES)
                raise ZeroDivisionError

        with pytest.raises(ZeroDivisionError):
            fail()
        assert not set(inside) & set(before)
        assert [getattr(mujoco, name) for name in HALVES] == before

    def test_robots_drive_in_all_loops(self, scene: instrument._Scene) -> None:
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
        self, scene: instrument._Scene, monkeypatch: pytest.MonkeyPatch
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
        assert result.steps == instrument.REPETITION_CHUNKS * instrument.CHUNK_STEPS
        assert result.contacts == pytest.approx(8.0, abs=0.5)
        # With one repetition the medians are the values themselves.
        assert result.to_bare == pytest.approx(result.engine / result.bare)
        assert result.to_mujoco == pytest.approx(result.engine / result.mujoco)
        assert min(result.engine, result.bare, result.mujoco) > 0.0

    def test_seconds_give_repetitions(self) -> None:
        """A longer measurement has more repetitions of the same length."""
        repetition = instrument.REPETITION_CHUNKS * instrument.CHUNK_STEPS
        assert measure("empty", 1, seconds=1.0).steps == 2 * repetition

    def test_prints_a_line_for_each_size(self, capsys: pytest.CaptureFixture[str]) -> None:
        """The program's output is one JSON object per number of robots."""
        assert main(["--world", "empty", "--robots", "1", "2", "--seconds", "0.1"]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert [json.loads(line)["robots"] for line in lines] == [1, 2]


class TestTool:
    def test_worlds_are_measured_once_each(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """The bare floor comes along unless it is the world asked for."""
        asked: list[tuple[str, tuple[int, ...], float]] = []

        def scenes(world: str, sizes: tuple[int, ...], seconds: float, seed: int) -> list[object]:
            asked.append((world, sizes, seconds))
            return []

        monkeypatch.setattr(stepping, "_scenes", scenes)
        stepping.measure_stepping(Plan(world="arena"))
        stepping.measure_stepping(Plan(world="empty", robots=2, seconds=3.0))
        assert asked == [
            ("empty", (1, 4, 16), 10.0),
            ("arena", (1, 4, 16), 10.0),
            ("empty", (2,), 3.0),
        ]

    def test_an_instrument_that_fails_says_why(self) -> None:
        """The error ends with what the instrument said."""
        with pytest.raises(BenchError, match="no such world"):
            stepping.measure_stepping(Plan(world="nowhere-at-all", robots=1, seconds=0.1))
