"""A team beside attackers: what is counted, and that the attackers do attack."""

from __future__ import annotations

import socket
import threading
import time
from pathlib import Path

import pytest
from bench_fakes import FakeServer
from bench_runs import measured

from usarsim_tools.bench import attackers as module
from usarsim_tools.bench import hostile
from usarsim_tools.bench.attackers import Attackers, Damage, attack
from usarsim_tools.bench.errors import BenchError
from usarsim_tools.bench.hostile import Tally, intervals


def status(time: float) -> bytes:
    """A line that bears a time."""
    return b"STA {Type GroundVehicle} {Time %.2f} {Battery 1}\r\n" % time


ODOMETRY = b"SEN {Type Odometry} {Name Odo} {Pose 1,2,3}\r\n"
EVEN = [(10.0 + 0.1 * n, status(0.1 * n) + ODOMETRY * (n % 2)) for n in range(100)]


class TestIntervals:
    def test_are_those_of_simulated_time(self) -> None:
        """Lines without a time are dated by the line before; the wall clock does not matter."""
        slow = [(3.0 * moment, data) for moment, data in EVEN]
        for chunks in (EVEN, slow):
            assert intervals(chunks) == pytest.approx({"STA": 0.1, "Odometry Odo": 0.2})

    def test_need_lines(self) -> None:
        """Nobody, and a stream of one line."""
        with pytest.raises(BenchError, match="nobody"):
            intervals([])
        with pytest.raises(BenchError, match="too few lines of STA"):
            intervals(EVEN[:1])


class TestTally:
    def tally(self, chunks: list[tuple[float, bytes]], pieces: int = 1) -> Tally:
        """The tally of ten seconds, fed in so many portions."""
        tally = Tally(10.0, {"STA": 0.1})
        size = max(1, len(chunks) // pieces)
        for start in range(0, len(chunks), size):
            tally.digest(chunks[start : start + size])
        tally.end(20.0)
        return tally

    def test_an_even_stream_has_its_rate(self) -> None:
        """A hundred lines of ten seconds are what is due, and no silence is longer than usual."""
        stream = self.tally(EVEN).streams["STA"]
        assert stream.rate(10.0) == pytest.approx(1.0)
        assert stream.gap == pytest.approx(0.1)

    def test_lines_that_are_left_out_are_missed(self) -> None:
        """Nine of ten lines, and a silence of two periods."""
        stream = self.tally([one for n, one in enumerate(EVEN) if n % 10]).streams["STA"]
        assert stream.rate(10.0) == pytest.approx(0.9)
        assert stream.gap == pytest.approx(0.2)

    def test_a_stream_that_dies_is_found(self) -> None:
        """Half of the lines, and silence until the end."""
        stream = self.tally(EVEN[:50]).streams["STA"]
        assert stream.rate(10.0) == pytest.approx(0.5)
        assert stream.gap == pytest.approx(5.1)

    def test_lines_cut_between_two_portions_count_once(self) -> None:
        """However the bytes come in."""
        whole = b"".join(data for _, data in EVEN)
        cut = [(11.0 + place / 1e4, whole[place : place + 7]) for place in range(0, len(whole), 7)]
        assert self.tally(cut, pieces=40).streams["STA"].count == 100

    def test_what_came_before_does_not_count(self) -> None:
        """Lines that waited when the span began."""
        early = [(moment - 5.0, data) for moment, data in EVEN]
        assert self.tally(early).streams["STA"].count == 50


class TestAttackers:
    def test_do_what_they_are_for(self) -> None:
        """One has a robot, one sends garbage, one drips, one comes again and again."""
        ended, damage = threading.Event(), Damage()
        with FakeServer() as server:
            thread = threading.Thread(target=attack, args=(server.port, ended, damage))
            thread.start()
            assert server.commands("INIT", 1) == ["INIT {ClassName USARBot.P3AT} {Name Deaf}"]
            assert len(server.commands("GETSTARTPOSES", 5)) >= 5
            assert server.commands("DRIVE {Left 1} {x", 1)
            deadline = time.monotonic() + 20.0
            while damage.drips == 0 and time.monotonic() < deadline:
                time.sleep(0.05)
            ended.set()
            thread.join(20.0)
            assert not thread.is_alive()
        assert damage.garbage > module._PIECE
        assert damage.reconnects >= 5
        assert damage.drips >= 1
        assert damage.seconds > 0.0

    def test_are_called_back(self) -> None:
        """They run in a process of their own and tell what they did."""
        with FakeServer() as server, Attackers(server.port) as attackers:
            server.commands("GETSTARTPOSES", 1)
            damage = attackers.stop()
        assert damage.reconnects >= 1
        attackers.close()

    def test_without_a_server_they_get_nowhere(self) -> None:
        """Nobody listens: they say so and do not fail."""
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        ended = threading.Event()
        threading.Timer(0.3, ended.set).start()
        damage = Damage()
        attack(port, ended, damage)
        assert damage.garbage == damage.reconnects == 0
        assert damage.refused > 0


def test_measurement(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two robots beside all attackers: figures are there, with their aims."""
    monkeypatch.setattr(hostile, "SETTLE", 0.3)
    figures = measured(tmp_path, "hostile", 2.5)
    assert figures["Worst rate of any stream, part of nominal"]["aim"] == ">= 0.95"
    assert figures["Growth of memory"]["aim"] == "< 50"
    assert figures["Garbage taken"]["value"] > 0.0
    assert figures["Reconnects"]["value"] > 0.0
    assert figures["Processor use of the server"]["value"] > 0.0
