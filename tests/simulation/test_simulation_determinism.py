"""Equal commands at equal times give equal runs (V26, robots 115)."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from sim_fakes import (
    ROBOT,
    ROGUE,
    Watcher,
    in_parallel,
    populated,
    pose_at,
    simulation,
    straight,
    turn,
    watched,
    yard,
)

from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.simulation.snapshot import Snapshot


class Driver(Watcher):
    """A listener that steers its robot by what it sees, and keeps a hash of everything."""

    def __init__(self, world: Simulation, robot: int, period: float, phase: int) -> None:
        super().__init__(period)
        self._world, self._robot, self._phase = world, robot, phase
        self.digest = hashlib.sha256()

    def wake(self, snapshot: Snapshot) -> None:
        """Look around, keep it, and choose the next command by it."""
        super().wake(snapshot)
        state = self._world.body(self._robot).state(snapshot)
        assert state is not None
        fan = RayFan(np.array(state.pose.position), state.pose.matrix()[:, :1].T.copy(), 20.0)
        (hits,) = self._world.cast([fan], snapshot, self._robot)
        for array in (snapshot.qpos, snapshot.qvel, snapshot.xpos, hits.distances):
            self.digest.update(array.tobytes())
        ahead = float(hits.distances[0])
        count = len(self.snapshots) + self._phase
        targets = turn(2.0) if ahead < 1.0 or count % 7 == 0 else straight(1.0 + 0.3 * (count % 5))
        self._world.body(self._robot).drive(targets)


def play() -> str:
    """A run of three robots, one of which comes and goes; returns a hash of all that was seen."""
    world = simulation(yard)
    drivers = []
    world.settle()
    for number in range(2):
        robot, _ = world.spawn(ROBOT, pose_at(0.0, 1.2 * number, 0.12))
        drivers.append(Driver(world, robot, 0.1 + 0.03 * number, number))
        world.body(robot).attach(drivers[-1])
    world.run_until(1.0)
    third, _ = world.spawn(ROBOT, pose_at(-1.5, 0.5, 0.3, yaw=1.0))  # the model grows
    drivers.append(Driver(world, third, 0.05, 2))
    world.body(third).attach(drivers[-1])
    world.run_until(2.0)
    world.body(0).teleport(pose_at(0.0, 3.0))
    world.remove(third)
    world.run_until(3.0)
    total = hashlib.sha256()
    for driver in drivers:
        total.update(driver.digest.digest())
    total.update(world.look().qpos.tobytes())
    return total.hexdigest()


class TestSameBits:
    """V26: two runs with the same commands are equal to the bit."""

    def test_twice_in_one_process(self) -> None:
        """A run repeated in the same process is identical, growth and removal included."""
        assert play() == play()

    def test_in_parallel_threads(self) -> None:
        """Two worlds that run side by side do not disturb each other."""
        alone = play()
        found: list[str] = []
        in_parallel(lambda number: found.append(play()), 0, 1)
        assert found == [alone, alone]

    def test_in_another_process(self) -> None:
        """The same run in a fresh interpreter with another hash seed is identical."""
        here = Path(__file__)
        root = here.parents[2]
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(root), str(here.parent)]),
            "PYTHONHASHSEED": "4711",
        }
        answer = subprocess.run(
            [sys.executable, "-c", f"import {here.stem} as t; print(t.play())"],
            capture_output=True,
            text=True,
            env=environment,
            check=True,
            cwd=here.parent,
        )
        assert answer.stdout.strip() == play()

    def test_other_commands_give_other_runs(self) -> None:
        """The hash notices a difference: the tests above can fail."""
        ends = []
        for speed in (2.0, 2.0 + 1e-12):
            world, robot = populated()
            world.body(robot).drive(straight(speed))
            world.run_until(0.5)
            ends.append(world.look().qpos.tobytes())
        assert ends[0] != ends[1]

    def test_batches_do_not_matter(self) -> None:
        """How often somebody looks does not change what happens."""
        ends = []
        for period in (0.004, 0.052, 10.0):
            world, robot = populated(yard)
            world.body(robot).attach(Watcher(period))
            world.body(robot).drive(straight(3.0))
            world.run_until(1.0)
            ends.append(world.look().qpos)
        np.testing.assert_array_equal(ends[0], ends[1])
        np.testing.assert_array_equal(ends[0], ends[2])

    def test_containing_a_culprit_is_repeatable(self) -> None:
        """A run in which a robot tears itself apart ends the same way twice."""
        ends = []
        for _ in range(2):
            world = simulation()
            rogue, _ = world.spawn(ROGUE, pose_at(0.0, 0.0))
            robot, _ = world.spawn(ROBOT, pose_at(0.0, 1.5))
            watcher = watched(world, rogue, 0.1)
            world.body(rogue).drive(straight(5.0))
            world.body(robot).drive(straight(2.0))
            world.run_until(1.0)
            assert watcher.reasons == ["its state became non-finite"]
            ends.append(world.look().qpos)
        np.testing.assert_array_equal(ends[0], ends[1])
