"""Time: the pace, patience, and listeners who get their snapshots when they want them."""

from __future__ import annotations

import math
import time
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from sim_fakes import (
    RADIUS,
    ROBOT,
    SlowWatcher,
    Start,
    Watcher,
    populated,
    pose_at,
    simulation,
    wait_until,
    watched,
)

from usarsim_server.simulation import clock
from usarsim_server.simulation.clock import AHEAD_STEPS, BATCH_STEPS, MAX_AHEAD
from usarsim_server.simulation.mailbox import Mailbox
from usarsim_server.simulation.model import RobotModel
from usarsim_server.simulation.pace import MAX_LAG, REPORT_PERIOD, Pacer, Patience

BATCH = 0.008


def drive(
    pacer: Pacer, seconds: float, cost: float, wall: float = 0.0, start: float = 0.0
) -> tuple[float, float, list[object]]:
    """Run a paced loop on pretended clocks, every batch costing so many wall seconds.

    Returns:
        Wall clock and simulated clock at the end, and all reports.
    """
    simulated, reports = start, []
    end = wall + seconds
    while wall < end:
        wait = pacer.wait(simulated, wall)
        if wait > 0.0:
            wall += wait
            continue
        simulated += BATCH
        wall += cost
        report = pacer.report(simulated, wall)
        if report is not None:
            reports.append(report)
    return wall, simulated, reports


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A wall clock of the physics that goes on only while it waits, a millisecond at a time."""
    now = [0.0]

    def wait(self: Mailbox, seconds: float, seen: int | None = None) -> None:
        time.sleep(1e-5)  # others may have the processor
        now[0] += min(seconds, 0.001)

    monkeypatch.setattr(clock, "time", SimpleNamespace(perf_counter=lambda: now[0]))
    monkeypatch.setattr(Mailbox, "wait", wait)
    return now


class TestWait:
    """When the next step is due."""

    def test_first_step_is_due_at_once(self) -> None:
        """The schedule starts with the first question, whatever the clocks read."""
        assert Pacer(1.0, 7.0).wait(7.0, 12345.6) == 0.0

    def test_waits_for_the_rest_of_the_step(self) -> None:
        """A step that was computed early waits for its time."""
        pacer = Pacer(1.0, 0.0)
        pacer.wait(0.0, 100.0)
        assert pacer.wait(0.008, 100.003) == pytest.approx(0.005)
        assert pacer.wait(0.008, 100.008) == pytest.approx(0.0, abs=1e-12)

    @pytest.mark.parametrize("speed", [0.1, 0.5, 1.0, 4.0])
    def test_speed_scales_time(self, speed: float) -> None:
        """At a factor the same simulated time takes so many times less wall time."""
        pacer = Pacer(speed, 0.0)
        pacer.wait(0.0, 0.0)
        assert pacer.wait(2.0, 1.0 / speed) == pytest.approx(1.0 / speed)

    @pytest.mark.parametrize("speed", [0.25, 1.0, 3.0])
    def test_keeps_real_time(self, speed: float) -> None:
        """With steps cheaper than they last, simulated and wall time keep their ratio."""
        wall, simulated, reports = drive(Pacer(speed, 0.0), 20.0, cost=0.2 * BATCH / speed)
        assert simulated / wall == pytest.approx(speed, rel=0.002)
        assert reports == []

    def test_catches_up_a_short_hiccup(self) -> None:
        """A pause below the limit is made good: no simulated time is lost."""
        pacer = Pacer(1.0, 0.0)
        wall, simulated, _ = drive(pacer, 1.0, cost=0.001)
        wall, simulated, _ = drive(pacer, 1.0, 0.001, wall + 0.9 * MAX_LAG, simulated)
        assert simulated == pytest.approx(wall, abs=2 * BATCH)

    def test_gives_up_a_long_pause(self) -> None:
        """Of a long pause only the limit is made good; then time runs evenly, not in a rush."""
        pacer = Pacer(1.0, 0.0)
        wall, simulated, _ = drive(pacer, 1.0, cost=0.001)
        wall, simulated, _ = drive(pacer, 1.0, 0.001, wall + 10.0, simulated)
        assert wall - simulated == pytest.approx(10.0 - MAX_LAG, abs=2 * BATCH)

    def test_never_asks_for_a_negative_wait(self) -> None:
        """A step that is late is due now."""
        pacer = Pacer(1.0, 0.0)
        pacer.wait(0.0, 0.0)
        assert [pacer.wait(0.0, 0.05 * step) for step in range(10)] == [0.0] * 10


class TestReport:
    """What the log is told."""

    def test_slow_time_is_reported_each_period(self) -> None:
        """A machine that is too slow is reported with the factor it reaches."""
        _, _, reports = drive(Pacer(1.0, 0.0), 4 * REPORT_PERIOD + 1, cost=2 * BATCH)
        assert len(reports) == 4
        for report in reports:
            assert report.slow
            assert report.asked == 1.0
            assert report.factor == pytest.approx(0.5, abs=0.01)

    def test_recovery_is_reported_once(self) -> None:
        """When time is kept again one line says so, and no more follow."""
        pacer = Pacer(1.0, 0.0)
        wall, simulated, slow = drive(pacer, REPORT_PERIOD + 1, cost=2 * BATCH)
        assert [report.slow for report in slow] == [True]
        _, _, later = drive(pacer, 5 * REPORT_PERIOD, 0.001, wall, simulated)
        assert [report.slow for report in later] in ([False], [True, False])

    def test_good_time_is_not_worth_a_word(self) -> None:
        """A world that keeps its time says nothing."""
        _, _, reports = drive(Pacer(1.0, 0.0), 3 * REPORT_PERIOD, cost=0.5 * BATCH)
        assert reports == []

    def test_slowness_is_relative_to_the_speed_asked_for(self) -> None:
        """Twice real time is slow where four times was asked for, and fine where two times was."""
        _, _, four = drive(Pacer(4.0, 0.0), REPORT_PERIOD + 1, cost=BATCH / 2)
        _, _, two = drive(Pacer(2.0, 0.0), REPORT_PERIOD + 1, cost=BATCH / 2.05)
        assert [report.slow for report in four] == [True]
        assert two == []

    def test_first_period_starts_with_the_first_step(self) -> None:
        """The clock's offset does not count as time lost."""
        _, _, reports = drive(Pacer(1.0, 50.0), 3 * REPORT_PERIOD, 0.001, wall=1e6, start=50.0)
        assert reports == []


class TestPatience:
    def test_ends_after_its_time(self) -> None:
        """From the first look on it lasts as long as it was told to, and then begins anew."""
        patience = Patience(5.0)
        assert [patience.lost(wall) for wall in (100.0, 104.9, 105.1, 105.2, 110.1, 110.3)] == [
            *(False, False, True),
            *(False, False, True),
        ]

    def test_what_comes_ends_the_waiting(self) -> None:
        """After that the clock starts again."""
        patience = Patience(5.0)
        assert not patience.lost(0.0)
        patience.relax()
        assert not patience.lost(6.0)
        assert patience.lost(11.0)

    def test_may_be_endless(self) -> None:
        """Without a limit it is never lost."""
        patience = Patience(math.inf)
        assert not patience.lost(0.0)
        assert not patience.lost(1e12)


class TestListeners:
    """Who wants snapshots gets them."""

    def test_wakes_at_the_asked_times(self) -> None:
        """Snapshots come at the first step that is not before their time, without drift."""
        world, robot = populated()
        watcher = watched(world, robot, 0.1)
        world.run_until(10.0)
        times = [snapshot.time for snapshot in watcher.snapshots]
        assert times[0] == pytest.approx(world.timestep)
        np.testing.assert_allclose(times[1:], 0.1 * np.arange(1, 101), atol=1e-9)

    def test_odd_periods_do_not_drift(self) -> None:
        """Robots 114: a period that is no multiple of the step is kept on average."""
        world, robot = populated()
        watcher = watched(world, robot, 0.033)
        world.run_until(20.0)
        times = np.array([snapshot.time for snapshot in watcher.snapshots])
        late = times - 0.033 * np.arange(len(times))
        assert late.min() > -1e-9
        assert late.max() <= world.timestep + 1e-9

    def test_two_listeners_see_the_same_instant(self) -> None:
        """Listeners that are due together get the same snapshot (protocol 68)."""
        world = simulation()
        watchers = []
        for number in range(2):
            robot, _ = world.spawn(ROBOT, pose_at(0.0, 1.0 * number))
            watchers.append(Watcher(0.1))
            world.body(robot).attach(watchers[-1])
        world.run_until(1.0)
        one, other = watchers
        assert len(one.snapshots) == len(other.snapshots) == 11
        assert all(a is b for a, b in zip(one.snapshots, other.snapshots, strict=True))

    def test_lockstep_waits_for_the_slow(self, start: Start) -> None:
        """In lockstep every snapshot is dealt with before time goes on."""
        world = start()
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        watcher = SlowWatcher(0.1, 0.005, world.attention)
        world.body(robot).attach(watcher)
        wait_until(lambda: len(watcher.done) >= 20)
        world.remove(robot)
        wait_until(lambda: robot not in world.look().layouts)
        watcher.stop()
        times = [snapshot.time for snapshot in watcher.snapshots[:20]]
        np.testing.assert_allclose(np.diff(times), 0.1, atol=world.timestep + 1e-9)
        assert watcher.done[:20] == watcher.snapshots[:20]

    @pytest.mark.parametrize("speed", [1.0, 50.0])
    def test_the_slow_hold_a_paced_world_back(self, start: Start, speed: float) -> None:
        """A listener that cannot keep up gets every snapshot, and time slows down for it."""
        world = start(speed=speed)
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        watcher = SlowWatcher(0.02, 0.03, lambda: None)
        world.body(robot).attach(watcher)
        ahead: list[float] = []
        while len(watcher.done) < 40:
            ahead.append(world.look().time - watcher.oldest)
        watcher.stop()
        times = [snapshot.time for snapshot in watcher.done]
        np.testing.assert_allclose(np.diff(times), 0.02, atol=world.timestep + 1e-9)
        assert max(ahead) < MAX_AHEAD + BATCH_STEPS * world.timestep + 1e-9

    def test_who_asks_finds_the_world_as_far_as_the_clock(
        self, start: Start, wall: list[float], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Steps are put off, but not for who looks at the world: it is two steps before or behind
        the clock at most."""
        world = start(speed=1.0)
        stepper, apart = world._stepper, list[float]()
        obey = stepper._mail.obey

        def obeys() -> None:
            apart.append(abs(stepper._pacer.present(wall[0]) - world._engine.time))
            obey()

        wait_until(lambda: world._engine.time > 0.1)
        monkeypatch.setattr(stepper._mail, "obey", obeys)
        for _ in range(60):
            world.look()
        assert len(apart) >= 30
        assert max(apart) <= AHEAD_STEPS * world.timestep + 1e-9

    def test_steps_that_nobody_asks_for_are_made_together(
        self, start: Start, wall: list[float]
    ) -> None:
        """With somebody due every 20 ms a turn has five steps, if they are quick."""
        world = start(speed=0.5)
        turns: list[int] = []
        engine = world._engine
        advance = engine.advance
        engine.advance = lambda steps: [turns.append(steps), advance(steps)][1]  # type: ignore[method-assign]
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        watched(world, robot, 0.02)
        wait_until(lambda: wall[0] > 2.0 and len(turns) > 60)
        assert turns[-40:].count(BATCH_STEPS) > 20

    def test_turns_end_as_long_before_their_time_whatever_they_make(
        self, start: Start, wall: list[float]
    ) -> None:
        """A turn of one step to a report begins later than one of five, so that both end when the
        clock stands two steps before the time of the report, and the cost of five steps behind
        that: streams are even."""
        cost = 0.0005
        world = start(speed=1.0)
        engine, stepper = world._engine, world._stepper
        ends: dict[int, list[float]] = {}
        advance = engine.advance

        def advances(steps: int) -> list[int]:
            lost = advance(steps)
            wall[0] += steps * cost
            if engine.time > 1.0 and stepper._due <= engine.time + 1e-6:
                end = wall[0] - stepper.moment(engine.time)
                ends.setdefault(steps, []).append(end)
            return lost

        engine.advance = advances  # type: ignore[method-assign]
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        watched(world, robot, 0.02)
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 3.0))
        watched(world, robot, 0.036)
        wait_until(lambda: engine.time > 2.0)
        assert len(ends) >= 4
        expected = -AHEAD_STEPS * world.timestep + BATCH_STEPS * cost
        for steps, found in ends.items():
            np.testing.assert_allclose(found, expected, atol=1e-5, err_msg=f"{steps} steps")

    def test_time_stands_still_while_nobody_is_there(self, start: Start) -> None:
        """In lockstep no time passes without listeners, also not between spawn and attach."""
        world = start()
        time.sleep(0.02)
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        time.sleep(0.02)
        assert world.look().time == 0.0
        watcher = watched(world, robot, 0.1)
        wait_until(lambda: len(watcher.snapshots) > 3)
        assert watcher.snapshots[0].time == pytest.approx(world.timestep)
        world.remove(robot)
        wait_until(lambda: robot not in world.look().layouts)
        before = world.look().time
        time.sleep(0.02)
        assert world.look().time == before

    def test_time_stands_still_during_a_spawn(self, start: Start) -> None:
        """In lockstep no time passes while a robot is being made."""
        world = start()
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 0.0))
        world.body(robot).attach(Watcher(0.1))
        moments: list[float] = []

        def build() -> mujoco.MjSpec:
            moments.append(world.look().time)
            time.sleep(0.02)
            moments.append(world.look().time)
            return ROBOT.build()

        wait_until(lambda: world.look().time > 0.5)
        world.spawn(RobotModel("slow", build, ROBOT.driven, RADIUS), pose_at(0.0, 2.0))
        assert moments[0] == moments[1] > 0.0
        wait_until(lambda: world.look().time > moments[1] + 0.5)

    def test_attach_to_a_lost_robot(self) -> None:
        """A listener of a robot that is gone is told so at once."""
        world = simulation()
        watcher = watched(world, 5, 0.1)
        world.settle()
        assert len(watcher.reasons) == 1

    def test_removal_ends_the_snapshots(self) -> None:
        """A removed robot's listener is neither woken nor told that it was lost."""
        world, robot = populated()
        watcher = watched(world, robot, 0.1)
        world.run_until(0.5)
        count = len(watcher.snapshots)
        world.remove(robot)
        world.run_until(1.0)
        assert len(watcher.snapshots) == count
        assert watcher.reasons == []
