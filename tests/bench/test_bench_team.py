"""Teams: figures come from the right lines, and sizes are tried until one is too large."""

from __future__ import annotations

import math

import pytest
from bench_fakes import FakeServer, Pretend, StandIn, by_name

from usarsim_bench import memory, team
from usarsim_bench.crowd import Crowd
from usarsim_bench.figures import Figure, Plan, Section
from usarsim_bench.server import BenchError, Load, Usage
from usarsim_bench.suite import take
from usarsim_bench.team import TeamTrial, load_figures, measure_largest, measure_team


@pytest.fixture(autouse=True)
def _hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(team, "SETTLE", 0.1)
    monkeypatch.setattr(team, "WINDOW", 0.3)


def try_fake(server: FakeServer, robots: int, seconds: float) -> TeamTrial:
    """A trial of a pretending server."""
    with Crowd(server.port, 0) as crowd:
        return team.try_team(StandIn(), crowd, robots, seconds)  # type: ignore[arg-type]


class TestTryTeam:
    @pytest.mark.parametrize("pace", [0.5, 1.0])
    def test_factor_is_that_of_the_simulated_clock(self, pace: float) -> None:
        """What STA lines tell, over when they came: the fake's clock runs at a known pace."""
        with FakeServer(pace=pace) as server:
            trial = try_fake(server, 2, 1.5)
        assert trial.factor == pytest.approx(pace, rel=0.05)
        assert trial.worst <= trial.factor * 1.05
        assert trial.robots == 2

    def test_lines_and_bytes_of_all_robots_are_counted(self) -> None:
        """STA and scan alternate, so that the mean length of a line is known."""
        with FakeServer() as server:
            trial = try_fake(server, 2, 1.0)
        assert trial.lines > 0.0
        assert 50.0 < trial.octets / trial.lines < 90.0

    def test_use_is_that_between_the_looks(self) -> None:
        """Processor use is taken over the measurement; memory at its end."""

        class Busy(StandIn):
            def usage(self) -> Usage:
                look = super().usage()
                return Usage(look.wall, 0.7 * look.wall, look.resident, 1, 1, 0.0, 0.0)

        with FakeServer() as server, Crowd(server.port, 0) as crowd:
            trial = team.try_team(Busy(), crowd, 1, 0.6)  # type: ignore[arg-type]
        assert trial.load.process == pytest.approx(0.7)
        assert trial.resident == 2000

    def test_is_of_the_class_asked_for(self) -> None:
        """All robots are of one class, and the trial says when they were watched."""
        with FakeServer() as server, Crowd(server.port, 0) as crowd:
            trial = team.try_team(StandIn(), crowd, 2, 0.6, "Gadget")  # type: ignore[arg-type]
            inits = server.commands("INIT")
        assert len(inits) == 2
        assert all("{ClassName USARBot.Gadget}" in line for line in inits)
        assert 0.6 <= trial.stop - trial.start < 5.0

    def test_a_robot_that_goes_silent_is_named(self) -> None:
        """A stream that stops is an error, not a good figure of the others."""
        with FakeServer() as server, Crowd(server.port, 0) as crowd:

            class Silencing(StandIn):
                def usage(self) -> Usage:
                    if self.looks == 0:
                        server.silence()
                    return super().usage()

            with pytest.raises(BenchError, match="too few STA lines for R1"):
                team.try_team(Silencing(), crowd, 1, 0.6)  # type: ignore[arg-type]


class TestLargest:
    def test_is_the_last_that_kept_time(self, pretend: Pretend) -> None:
        """Sizes grow until one is too large; larger ones are not tried."""
        tried = pretend(team, "try_team", {16: 1.0, 24: 0.999, 32: 0.991, 48: 0.98, 64: 1.0})
        figures = by_name(measure_largest(Plan()))
        assert tried == [(16, 15.0), (24, 15.0), (32, 15.0), (48, 15.0)]
        assert figures["Largest team in real time"].value == 32
        assert figures["Largest team in real time"].met
        assert figures["48 robots: real-time factor"].value == 0.98

    @pytest.mark.parametrize(
        ("factors", "size", "met"), [({16: 0.9}, 0, False), ({16: 0.99, 24: 0.9899}, 16, True)]
    )
    def test_at_the_limit(
        self, pretend: Pretend, factors: dict[int, float], size: int, met: bool
    ) -> None:
        """A factor of 0.99 is real time; where the smallest size is too large it is 0."""
        pretend(team, "try_team", factors)
        figure = by_name(measure_largest(Plan()))["Largest team in real time"]
        assert (figure.value, figure.met) == (size, met)

    def test_given_size_and_time(self, pretend: Pretend) -> None:
        """A size asked for is the only one tried, and judged by no aim."""
        tried = pretend(team, "try_team", {5: 1.0})
        figure = by_name(measure_largest(Plan(robots=5, seconds=3.0)))["Largest team in real time"]
        assert tried == [(5, 3.0)]
        assert (figure.value, figure.met) == (5, None)


class TestTeam:
    def test_figures_and_aims(self, pretend: Pretend) -> None:
        """The lowest factor and the processor use are judged."""
        tried = pretend(team, "try_team", {16: 0.9985})
        figures = by_name(measure_team(Plan()))
        assert tried == [(16, 60.0)]
        assert figures["Real-time factor, lowest of all robots"].met is False
        assert figures["Processor use of the server"].met is True
        assert figures["Memory of the server"].value == 1.0
        assert figures["Data sent"].value == 10.0

    def test_says_what_goes_on(self, pretend: Pretend) -> None:
        """A long measurement announces itself."""
        pretend(team, "try_team", {3: 1.0})
        said: list[str] = []
        measure_team(Plan(robots=3, seconds=7.0, say=said.append))
        assert said == ["team: 3 robots for 7 s"]


def test_clients_and_others_are_told() -> None:
    """What else kept the machine busy stands beside the figures."""
    assert [figure.value for figure in load_figures(Load(1.0, 0.25, 0.5))] == [0.25, 0.5]


class TestSuite:
    def test_takes_what_is_asked_in_that_order(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Each measurement gets the plan; sections come in the order asked for."""
        seen: list[tuple[str, Plan]] = []

        for module, key in ((memory, "memory"), (team, "team")):

            def measure(plan: Plan, key: str = key) -> Section:
                seen.append((key, plan))
                return Section(key, key, "", (Figure("Nothing", math.pi),))

            monkeypatch.setattr(module, f"measure_{key}", measure)
        plan = Plan(robots=2)
        report = take(("memory", "team"), plan, "9.9")
        assert [section.key for section in report.sections] == ["memory", "team"]
        assert seen == [("memory", plan), ("team", plan)]
        assert report.machine.packages["usarsim-server"] == "9.9"
        assert report.taken.tzinfo is not None

    def test_one_that_fails_does_not_keep_the_others_back(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The reason takes the place of its figures; what follows is measured."""

        def fail(plan: Plan) -> Section:
            raise BenchError("no luck")

        def succeed(plan: Plan) -> Section:
            return Section("b", "B", "", (Figure("Nothing", 1.0),))

        monkeypatch.setattr(memory, "measure_memory", fail)
        monkeypatch.setattr(team, "measure_team", succeed)
        report = take(("memory", "team"), Plan(), "0")
        assert [section.failure for section in report.sections] == ["no luck", None]
        assert report.sections[0].title.startswith("Memory of 64 robots")
        assert report.failed == ["memory"]
