"""Commands are timed on their way without being changed; threads are known by their names."""

from __future__ import annotations

import json
import random
import threading
import time
from pathlib import Path

import pytest
from bench_fakes import FakeServer

from usarsim_bench import latency, threads
from usarsim_bench.crowd import Controller
from usarsim_bench.latency import STATIONS, CodedDriver, code, delays, instrumented
from usarsim_bench.server import BenchError
from usarsim_server.sessions.session import Session
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.simulation import BodyHandle
from usarsim_server.testing import PATIENCE, Rehearsal, eventually

METHODS = (
    (Session, "submit"),
    (BodyHandle, "drive"),
    (Engine, "drive"),
    (Engine, "advance"),
)


class TestDelays:
    def test_are_those_from_sending_to_passing(self) -> None:
        """Moments are subtracted by command, in whatever order they were passed."""
        assert delays({1: 10.0, 2: 11.0}, [(2, 11.5), (1, 10.25)]) == [0.25, 0.5]

    def test_unknown_and_lost_commands_are_left_out(self) -> None:
        """What was not sent within the measurement, or never passed, has no delay."""
        assert delays({1: 10.0, 2: 11.0}, [(9, 10.5), (2, 12.0)]) == [1.0]

    def test_first_passing_counts(self) -> None:
        """A station passed twice was reached the first time."""
        assert delays({1: 10.0}, [(1, 10.5), (1, 12.0)]) == [0.5]


class TestCodes:
    def test_every_speed_on_the_wire_gives_its_code_back(self) -> None:
        """The instrument reads the number that the client wrote, for every number there is."""
        for number in range(latency._LEAST, latency._MOST + 1):
            assert code(-float(f"{number * 1e-5:.5f}")) == number

    def test_driver_uses_each_code_once(self) -> None:
        """No two commands are alike, and each is known by the time at which it was sent."""
        driver = CodedDriver()
        with FakeServer() as server:
            controller = Controller(server.port, "R1")
            start = time.perf_counter()
            for _ in range(50):
                driver(controller, random.Random(1))
            stop = time.perf_counter()
            controller.socket.close()
        assert len(driver.sent) == 50
        assert all(start <= moment <= stop for moment in driver.sent.values())

    def test_driver_ends_with_its_codes(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Rather than using a code twice it says that there are no more."""
        monkeypatch.setattr(latency, "_MOST", latency._LEAST + 1)
        driver = CodedDriver()
        with FakeServer() as server:
            controller = Controller(server.port, "R1")
            driver(controller, random.Random(1))
            driver(controller, random.Random(1))
            with pytest.raises(BenchError, match="cannot be told apart"):
                driver(controller, random.Random(1))
            controller.socket.close()


class TestInstrument:
    def test_stations_are_passed_in_order(self) -> None:
        """A command is received, decided, given to the wheels and used by a step, in that order."""
        with instrumented() as record, Rehearsal(world="empty") as rehearsal:
            client = rehearsal.connect()
            client.send("INIT {ClassName USARBot.P3AT} {Location 0,0,-0.2}")
            sent = time.perf_counter()
            client.send("DRIVE {Left 0.51234} {Right -0.51234}")
            rehearsal.run(0.1)
        moments = [dict(record[station])[51234] for station in STATIONS]
        assert moments == sorted(moments)
        assert sent <= moments[0]

    def test_robot_is_driven_all_the_same(self) -> None:
        """The stopwatches change nothing: the wheels get what was commanded."""
        with instrumented(), Rehearsal(world="empty") as rehearsal:
            client = rehearsal.connect()
            client.send("INIT {ClassName USARBot.P3AT} {Location 0,0,-0.2}")
            client.send("DRIVE {Left 0.5} {Right 0.5}")
            targets = rehearsal.assembly.simulation.body(0).wheel_targets()
        assert targets.tolist() == [0.5] * 4

    def test_commands_without_speeds_are_not_recorded(self) -> None:
        """Lines of other kinds, and DRIVE for the headlight alone, pass unseen."""
        with instrumented() as record, Rehearsal(world="empty") as rehearsal:
            client = rehearsal.connect()
            client.send("INIT {ClassName USARBot.P3AT} {Location 0,0,-0.2}")
            client.send("DRIVE {Light True}", "GETSTARTPOSES", "nonsense")
            rehearsal.run(0.1)
        assert record == {station: [] for station in STATIONS}

    def test_everything_is_as_before_afterwards(self) -> None:
        """The methods are the original ones again, also after an error."""
        before = [getattr(owner, name) for owner, name in METHODS]
        inside: list[object] = []

        def fail() -> None:
            with instrumented():
                inside.extend(getattr(owner, name) for owner, name in METHODS)
                raise ZeroDivisionError

        with pytest.raises(ZeroDivisionError):
            fail()
        assert not set(inside) & set(before)
        assert [getattr(owner, name) for owner, name in METHODS] == before

    def test_record_is_written_when_the_command_ends(self, tmp_path: Path) -> None:
        """Any subcommand can be run; its exit code is passed on and the file is there."""
        file = tmp_path / "record.json"
        assert latency.main([str(file), "worlds"]) == 0
        assert json.loads(file.read_text()) == {station: [] for station in STATIONS}


def test_a_thread_is_known_by_its_name() -> None:
    """What a thread called physics does counts as physics, and as nothing else."""
    begin, stop = threads.look(), threading.Event()

    def work() -> None:
        until = time.thread_time() + 0.2
        while time.thread_time() < until:
            pass
        stop.wait(PATIENCE)

    worker = threading.Thread(target=work, name="physics", daemon=True)
    worker.start()
    assert eventually(lambda: threads.look().spent["physics"] >= begin.spent["physics"] + 0.19)
    seen = threads.look()
    stop.set()
    worker.join(PATIENCE)
    assert seen.spent["drawing"] == begin.spent["drawing"]
    assert seen.moment > begin.moment


def test_a_run_leaves_its_looks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The subcommand gets its own words, its exit code is kept, and the file holds the looks."""
    seen: list[list[str]] = []

    def serve(words: list[str]) -> int:
        seen.append(words)
        assert eventually(lambda: len(taken) >= 2)
        return 3

    taken: list[threads.Look] = []
    look = threads.look

    def note() -> threads.Look:
        taken.append(look())
        return taken[-1]

    monkeypatch.setattr(threads, "PERIOD", 0.01)
    monkeypatch.setattr(threads, "look", note)
    monkeypatch.setattr(threads, "usarsim", serve)
    file = tmp_path / "looks.json"
    assert threads.main([str(file), "serve", "--port", "0"]) == 3
    assert seen == [["serve", "--port", "0"]]
    looks = json.loads(file.read_text())
    assert len(looks) >= 2
    assert [one["moment"] for one in looks] == sorted(one["moment"] for one in looks)
    assert {"physics", "reports", "sockets", "drawing", "encoding", "others"} == set(
        looks[0]["spent"]
    )
