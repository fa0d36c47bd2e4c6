"""The crowd of controllers behaves like the controllers it stands for."""

from __future__ import annotations

import gc
import random
import re
import time
from collections.abc import Iterator

import pytest
from bench_fakes import FakeServer

from benchmarks.measures import streams
from usarsim_bench import crowd as crowd_module
from usarsim_bench.crowd import Controller, Crowd, wander
from usarsim_bench.figures import BenchError
from usarsim_bench.recording import status_samples


@pytest.fixture
def server() -> Iterator[FakeServer]:
    """A pretending server."""
    with FakeServer() as running:
        yield running


@pytest.fixture
def crowd(server: FakeServer) -> Iterator[Crowd]:
    """A crowd at its door."""
    with Crowd(server.port, seed=1) as people:
        yield people


class TestJoining:
    def test_sends_init_with_the_start_poses_in_turn(
        self, server: FakeServer, crowd: Crowd
    ) -> None:
        """Robots get names of their own and the world's start poses one after the other."""
        for robot_class in ("P3AT", "P3AT", "P2DX"):
            crowd.join(robot_class)
        crowd.wait_until_speaking()
        assert sorted(server.commands("INIT")) == [
            "INIT {ClassName USARBot.P2DX} {Name R3} {Start Here}",
            "INIT {ClassName USARBot.P3AT} {Name R1} {Start Here}",
            "INIT {ClassName USARBot.P3AT} {Name R2} {Start There}",
        ]

    def test_waits_for_the_first_status(self, server: FakeServer, crowd: Crowd) -> None:
        """A robot speaks once its first STA line is there, not on the greeting."""
        controller = crowd.join()
        assert not controller.speaking
        crowd.wait_until_speaking([controller])
        assert controller.speaking
        assert status_samples(controller.chunks)

    def test_a_robot_that_stays_silent_is_named(
        self, server: FakeServer, crowd: Crowd, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """A robot that never gets into the world is an error that names it."""
        server.mute.add("R2")
        crowd.wait_until_speaking([crowd.join()])
        monkeypatch.setattr(crowd_module, "_SPEAK_TIMEOUT", 0.4)
        crowd.join()
        with pytest.raises(BenchError, match=r"no STA line after INIT for R2$"):
            crowd.wait_until_speaking()

    def test_a_world_without_start_poses(self) -> None:
        """Without start poses there is nowhere to put a team."""
        with (
            FakeServer(b"NFO {StartPoses 0}\r\n") as empty,
            pytest.raises(BenchError, match="no start poses"),
        ):
            Crowd(empty.port, seed=0)


class TestRunning:
    def test_reads_everything_with_its_time(self, server: FakeServer, crowd: Crowd) -> None:
        """Lines are stored with moments after they were sent, and streams are told apart."""
        controller = crowd.join()
        crowd.wait_until_speaking()
        start, stop = crowd.run(0.5)
        samples = status_samples(controller.chunks)
        assert len(samples) >= 2
        assert all(sent - 1e-4 <= arrived <= stop for arrived, sent in samples)  # told in 0.1 ms
        assert stop - start >= 0.5
        assert set(streams(controller.chunks)) == {"STA", "RangeScanner lms200"}

    def test_does_not_store_when_told_so(self, server: FakeServer) -> None:
        """A crowd that does not keep hears and no more."""
        with Crowd(server.port, seed=1, keep=False) as crowd:
            controller = crowd.join()
            crowd.wait_until_speaking()
            assert controller.chunks == []

    def test_drives_every_robot(self, server: FakeServer, crowd: Crowd) -> None:
        """Every robot gets commands of its own, in per cent of its top speed."""
        crowd.join()
        crowd.join()
        crowd.run(1.2)
        drives = server.commands("DRIVE")
        assert len(drives) >= 2
        for line in drives:
            speeds = re.fullmatch(
                r"DRIVE \{Left (-?[\d.]+)\} \{Right (-?[\d.]+)\} \{Normalized True\}", line
            )
            assert speeds
            assert all(abs(float(speed)) <= 100.0 for speed in speeds.groups())
        assert len(set(drives)) == len(drives)

    def test_the_seed_decides_what_is_driven(self, server: FakeServer) -> None:
        """Two crowds of one seed send the same commands in the same order."""
        told = []
        for seed in (7, 7, 8):
            server.received.clear()
            dice = random.Random(seed)
            controller = Controller(server.port, "R1")
            for _ in range(3):
                wander(controller, dice)
            told.append(server.commands("DRIVE", 3))
            controller.socket.close()
        assert told[0] == told[1] != told[2]

    def test_does_not_send_in_bursts_after_a_delay(self, server: FakeServer, crowd: Crowd) -> None:
        """Commands missed while nobody ran the crowd are not made up for."""
        moments: list[float] = []
        with Crowd(server.port, 0, lambda one, dice: moments.append(time.perf_counter())) as late:
            late.join()
            time.sleep(1.0)
            late.run(0.01)
        assert len(moments) <= 2

    def test_the_garbage_collector_rests_only_meanwhile(
        self, server: FakeServer, crowd: Crowd
    ) -> None:
        """Collection is off while it counts and on again afterwards, also after an error."""
        seen: list[bool] = []
        with Crowd(server.port, 0, lambda one, dice: seen.append(gc.isenabled())) as people:
            people.join()
            while not seen:
                people.run(0.6)
            assert gc.isenabled()
            server.hang_up()
            with pytest.raises(BenchError):
                people.run(1.0)
        assert seen
        assert not any(seen)
        assert gc.isenabled()


class TestEnding:
    def test_a_server_that_hangs_up_is_an_error(self, server: FakeServer, crowd: Crowd) -> None:
        """A lost connection ends the measurement instead of spoiling it silently."""
        crowd.join()
        crowd.wait_until_speaking()
        server.hang_up()
        with pytest.raises(BenchError, match="R1"):
            crowd.run(5.0)

    def test_who_has_left_gets_no_commands(self, server: FakeServer) -> None:
        """A controller that hung up is forgotten; the others go on."""
        driven: list[str] = []
        with Crowd(server.port, 0, lambda one, dice: driven.append(one.name)) as crowd:
            first, second = crowd.join(), crowd.join()
            crowd.wait_until_speaking()
            crowd.leave(first)
            driven.clear()
            while not driven:
                crowd.run(0.8)
            assert crowd.controllers == [second]
        assert set(driven) == {"R2"}

    def test_names_are_never_used_twice(self, server: FakeServer, crowd: Crowd) -> None:
        """A newcomer does not get the name of one who left."""
        crowd.leave(crowd.join())
        assert crowd.join().name == "R2"

    def test_closing_hangs_up_for_everybody(self, server: FakeServer) -> None:
        """No connection outlives its crowd."""
        with Crowd(server.port, 0) as crowd:
            sockets = [crowd.join().socket for _ in range(3)]
        assert [one.fileno() for one in sockets] == [-1, -1, -1]
