"""Large teams: how they gather, which sizes have aims, what a size that fails does."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from bench_fakes import FakeServer

from usarsim_bench import swarm
from usarsim_bench.crowd import Crowd
from usarsim_bench.figures import Plan
from usarsim_bench.server import BenchError, Load
from usarsim_bench.swarm import measure_swarm, swarm_figures
from usarsim_bench.team import TeamTrial, gather


def trial(robots: int, factor: float) -> TeamTrial:
    """A trial with a factor and a processor use of 1.3 cores."""
    return TeamTrial(robots, factor, factor, Load(1.3, 0.1, 0.2), 100.0, 3e6, 2**30, 5.0, 7.0)


Asked = list[tuple[int, float]]


@pytest.fixture
def pretend(monkeypatch: pytest.MonkeyPatch) -> Callable[[dict[int, float]], Asked]:
    """Makes teams of given sizes have given factors; others fail. Returns what was tried."""

    def install(factors: dict[int, float]) -> Asked:
        tried: Asked = []

        def fake(plan: Plan, robots: int, seconds: float) -> TeamTrial:
            tried.append((robots, seconds))
            if robots not in factors:
                raise BenchError("the server died: Traceback\n  nobody cares\nMemoryError")
            return trial(robots, factors[robots])

        monkeypatch.setattr(swarm, "_trial", fake)
        return tried

    return install


Pretend = Callable[[dict[int, float]], Asked]


class TestGathering:
    @pytest.mark.parametrize(("together", "rounds"), [(1, 5), (2, 3), (8, 1)])
    def test_so_many_come_at_a_time(
        self, monkeypatch: pytest.MonkeyPatch, together: int, rounds: int
    ) -> None:
        """Nobody comes before those who asked last are there; classes are taken in turn."""
        waited: list[int] = []
        with FakeServer() as server, Crowd(server.port, 0) as crowd:
            wait = crowd.wait_until_speaking

            def watch(newcomers: list[object]) -> None:
                waited.append(len(newcomers))
                wait(newcomers)  # type: ignore[arg-type]

            monkeypatch.setattr(crowd, "wait_until_speaking", watch)
            gather(crowd, 5, ("P3AT", "P2AT"), together)
            assert len(waited) == rounds
            assert sum(waited) == 5
            assert all(one.speaking for one in crowd.controllers)
            classes = [one.robot_class for one in crowd.controllers]
        assert classes == ["P3AT", "P2AT", "P3AT", "P2AT", "P3AT"]


class TestFigures:
    def test_aims_of_the_usual_size(self) -> None:
        """Time kept and processor use are judged."""
        figures = {one.name: one for one in swarm_figures(trial(64, 0.9995))}
        assert figures["64 robots: real-time factor, lowest of all"].met is True
        assert figures["64 robots: processor use of the server"].met is False
        assert figures["64 robots: data sent"].value == 3.0
        assert figures["64 robots: memory of the server"].value == 1024.0
        assert figures["64 robots: processor use of other programs"].value == 0.2

    def test_the_stretch_has_none(self) -> None:
        """A larger team informs, it cannot miss anything."""
        assert all(one.aim is None for one in swarm_figures(trial(128, 0.5)))


class TestMeasuring:
    def test_both_sizes(self, pretend: Pretend) -> None:
        """The usual size and the stretch, a minute each."""
        tried = pretend({64: 1.0, 128: 0.9})
        section = measure_swarm(Plan())
        assert tried == [(64, 60.0), (128, 60.0)]
        assert len({one.name for one in section.figures}) == len(section.figures)

    def test_a_stretch_that_fails_does_not_keep_the_rest_back(self, pretend: Pretend) -> None:
        """The reason is told in one line, the figures of the usual size are there."""
        pretend({64: 1.0})
        section = measure_swarm(Plan())
        assert "128 robots could not be measured: MemoryError." in section.setting
        assert "nobody cares" not in section.setting
        assert section.figures[0].name.startswith("64 robots")

    def test_the_usual_size_must_not_fail(self, pretend: Pretend) -> None:
        """Without it there is nothing to tell."""
        pretend({128: 1.0})
        with pytest.raises(BenchError, match="the server died"):
            measure_swarm(Plan())

    def test_given_size_and_brevity(self, pretend: Pretend) -> None:
        """A size asked for is the only one; a brief look leaves the stretch out."""
        tried = pretend({5: 1.0, 64: 1.0})
        measure_swarm(Plan(robots=5, seconds=3.0))
        measure_swarm(Plan(seconds=3.0, brief=True))
        assert tried == [(5, 3.0), (64, 3.0)]
