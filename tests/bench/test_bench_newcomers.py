"""Robots that come and go: what is counted as a disturbance, and what as left behind."""

from __future__ import annotations

import pytest
from bench_fakes import FakeServer, StandIn

from usarsim_bench import memory
from usarsim_bench.admission import disturbance
from usarsim_bench.crowd import Crowd
from usarsim_bench.memory import churn
from usarsim_bench.server import BenchError, Usage

EVEN = [n * 0.1 for n in range(100)]


def late(times: list[float], number: int, by: float) -> list[float]:
    """The same moments, one of them later."""
    return [time + by if n == number else time for n, time in enumerate(times)]


class TestDisturbance:
    @pytest.mark.parametrize(
        ("recorded", "span", "gap"),
        [
            # Streams that keep their periods are not disturbed, whatever their periods are.
            ([{"STA": EVEN, "Sonar F1": EVEN[::2]}, {"STA": EVEN[::5]}], (3.0, 5.0), 0.0),
            # One late line of one sensor of one robot is enough.
            (
                [{"STA": EVEN, "Sonar F1": late(EVEN, 40, 0.07)}, {"STA": late(EVEN, 41, 0.02)}],
                (3.0, 5.0),
                0.07,
            ),
            # What happened at another newcomer's arrival is not counted twice.
            ([{"STA": late(EVEN, 40, 0.07)}], (5.0, 7.0), 0.0),
            # A stream of one line a second that misses a line is a second late.
            ([{"STA": [0.0, 1.0, 2.0, 3.0, 5.0, 6.0, 7.0]}], (3.5, 5.5), 1.0),
        ],
    )
    def test_is_that_of_the_most_disturbed_stream(
        self, recorded: list[dict[str, list[float]]], span: tuple[float, float], gap: float
    ) -> None:
        """The longest silence of any stream beyond its own period, within the span."""
        assert disturbance(recorded, *span) == pytest.approx(gap, abs=1e-9)

    def test_needs_lines(self) -> None:
        """A stream with one line has no period, and nobody there cannot be disturbed."""
        with pytest.raises(BenchError, match="too few lines of STA"):
            disturbance([{"STA": [1.0]}], 0.0, 2.0)
        with pytest.raises(BenchError, match="nobody"):
            disturbance([], 0.0, 2.0)


class TestChurn:
    def test_keeps_the_number_of_robots(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """For each that leaves one comes, of the classes in turn by chance."""
        monkeypatch.setattr(memory, "PAUSE", 0.05)
        with FakeServer() as server, Crowd(server.port, 0, keep=False) as crowd:
            first = [crowd.join() for _ in range(3)]
            crowd.wait_until_speaking()
            turnover = churn(StandIn(), crowd, 1.0, seed=1)  # type: ignore[arg-type]
            assert len(crowd.controllers) == 3
            assert any(one not in crowd.controllers for one in first)
            inits = server.commands("INIT", 3 + turnover.spawned)
            assert len(inits) == 3 + turnover.spawned
            assert {line.split(".")[1].split("}")[0] for line in inits} == set(memory.CLASSES)
        assert turnover.spawned >= 5
        assert turnover.silent == 0

    def test_memory_is_looked_at_each_time(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Samples are times since it began and bytes, one for each that came."""
        monkeypatch.setattr(memory, "PAUSE", 0.05)
        with FakeServer() as server, Crowd(server.port, 0, keep=False) as crowd:
            crowd.join()
            crowd.wait_until_speaking()
            turnover = churn(StandIn(), crowd, 0.5, seed=1)  # type: ignore[arg-type]
        times, values = zip(*turnover.resident, strict=True)
        assert list(times) == sorted(times)
        assert times[0] < 0.5
        assert list(values) == [1000 * n for n in range(1, turnover.spawned + 1)]

    def test_silent_robots_are_counted(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A newcomer that never says anything is found out, once it has had the time to."""
        monkeypatch.setattr(memory, "PAUSE", 0.05)
        monkeypatch.setattr(memory, "SPEAKING", 90.0)
        with FakeServer() as server, Crowd(server.port, 0, keep=False) as crowd:
            crowd.join()
            crowd.wait_until_speaking()
            server.mute.add("R2")
            turnover = churn(StandIn(), crowd, 0.1, seed=1)  # type: ignore[arg-type]
            assert turnover.silent == 0
            monkeypatch.setattr(memory, "SPEAKING", 0.2)
            crowd.run(0.3)
            assert churn(StandIn(), crowd, 0.1, seed=1).silent == 1  # type: ignore[arg-type]


class TestTrend:
    def test_is_that_of_the_second_half(self) -> None:
        """While classes still get their slots memory may grow; afterwards it may not."""
        growing = [(float(n), 1000.0 * min(n, 50)) for n in range(100)]
        assert memory.slope(growing, 100.0) == pytest.approx(0.0)
        leaking = [(float(n), 1000.0 * min(n, 50) + 3.0 * n) for n in range(100)]
        assert memory.slope(leaking, 100.0) == pytest.approx(3.0)

    def test_needs_two_looks(self) -> None:
        """In a very short run there is no trend."""
        assert memory.slope([(0.0, 5.0), (0.9, 7.0)], 1.0) == 0.0


class TestGivingBack:
    def test_waits_until_everything_is_back(self) -> None:
        """It looks again as long as threads or descriptors are missing."""

        class Shrinking(StandIn):
            def usage(self) -> Usage:
                look = super().usage()
                return Usage(0.0, 0.0, 0, max(5, 8 - look.threads), 12 - self.looks, 0.0, 0.0)

        server = Shrinking()
        left = memory._wait_until_back(server, Usage(0.0, 0.0, 0, 5, 9, 0.0, 0.0))  # type: ignore[arg-type]
        assert (left.threads, left.descriptors) == (5, 9)
        assert server.looks == 3

    def test_gives_up_in_the_end(self) -> None:
        """What never comes back is reported as it is."""
        late_look = Usage(1e12, 0.0, 0, 6, 9, 0.0, 0.0)

        class Stuck(StandIn):
            def usage(self) -> Usage:
                return late_look

        empty = Usage(0.0, 0.0, 0, 5, 9, 0.0, 0.0)
        assert memory._wait_until_back(Stuck(), empty) is late_look  # type: ignore[arg-type]
