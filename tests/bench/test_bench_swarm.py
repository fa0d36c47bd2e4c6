"""Teams of scouts: how they gather, arrive, keep time and are watched, and what a size that fails
does.
"""

from __future__ import annotations

import pytest
from bench_fakes import FakeServer, Pretend, a_trial, by_name

from usarsim_bench import admission, swarm
from usarsim_bench.admission import Visits, admission_figures, waits
from usarsim_bench.camera_client import ViewerTrial
from usarsim_bench.cameras import TILE_SIZE, grid, tiles_of, watched_figures
from usarsim_bench.crowd import Controller, Crowd
from usarsim_bench.figures import Plan
from usarsim_bench.recording import Sample, first_reading, period_errors, sensor_samples
from usarsim_bench.robot_files import LASER_NAME, SCOUT
from usarsim_bench.server import BenchError
from usarsim_bench.swarm import jitter_figures, measure_swarm, slowest, swarm_figures
from usarsim_bench.team import gather


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
        figures = by_name(swarm_figures(a_trial(64, 0.9995, cores=1.3)))
        assert figures["64 robots: real-time factor, lowest of all robots"].met is True
        assert figures["64 robots: processor use of the server"].met is False
        assert figures["64 robots: data sent"].value == 10.0
        assert figures["64 robots: memory of the server"].value == 1.0
        assert figures["64 robots: processor use of other programs"].value == 0.2

    def test_the_stretch_has_none(self) -> None:
        """A larger team informs, it cannot miss anything."""
        assert all(one.aim is None for one in swarm_figures(a_trial(128, 0.5)))


class TestMeasuring:
    def test_both_sizes(self, pretend: Pretend) -> None:
        """The usual size and the stretch, a minute each."""
        tried = pretend(swarm, "_trial", {64: 1.0, 128: 0.9})
        section = measure_swarm(Plan())
        assert tried == [(64, 60.0), (128, 60.0)]
        assert len({one.name for one in section.figures}) == len(section.figures)

    def test_a_stretch_that_fails_does_not_keep_the_rest_back(self, pretend: Pretend) -> None:
        """The reason is told in one line, the figures of the usual size are there."""
        pretend(swarm, "_trial", {64: 1.0})
        section = measure_swarm(Plan())
        assert "128 robots could not be measured: MemoryError." in section.setting
        assert "nobody cares" not in section.setting
        assert section.figures[0].name.startswith("64 robots")

    def test_the_usual_size_must_not_fail(self, pretend: Pretend) -> None:
        """Without it there is nothing to tell."""
        pretend(swarm, "_trial", {128: 1.0})
        with pytest.raises(BenchError, match="the server died"):
            measure_swarm(Plan())

    def test_given_size_and_brevity(self, pretend: Pretend) -> None:
        """A size asked for is the only one; a brief look leaves the stretch out."""
        tried = pretend(swarm, "_trial", {5: 1.0, 64: 1.0})
        measure_swarm(Plan(robots=5, seconds=3.0))
        measure_swarm(Plan(seconds=3.0, brief=True))
        assert tried == [(5, 3.0), (64, 3.0)]


LATENCY = 0.003


def stream(count: int, late: dict[int, float] | None = None) -> list[Sample]:
    """Lines of 10 Hz, all equally late but some."""
    late = late or {}
    return [(0.1 * n + LATENCY + late.get(n, 0.0), 0.1 * n) for n in range(count)]


class TestPeriods:
    def test_errors_have_no_sign(self) -> None:
        """A late line spoils the period before it and the one behind it."""
        assert period_errors([0.0, 0.1, 0.23, 0.3], 0.1) == pytest.approx([0.0, 0.03, 0.03])

    def test_one_moment_has_no_period(self) -> None:
        """There is nothing between fewer than two."""
        assert period_errors([1.0], 0.1) == []


class TestSamples:
    @pytest.mark.parametrize(
        "line",
        [
            b"SEN {Time 63.40} {Type RangeScanner} {Name lms200} {Resolution 0.1} {Range 1}",
            b"SEN {Time 63.40}{Type RangeScanner}{Name lms200}{Range 1}",
            b"SEN {Time 63.40} {Type Sonar} {Name lms200 Range 1.98}",
        ],
    )
    def test_of_the_sensor_asked_for(self, line: bytes) -> None:
        """In whatever way the dialect prints them (protocol reference 4.5)."""
        other = b"SEN {Time 63.40} {Type RangeScanner} {Name Other} {Range 1}"
        untimed = b"SEN {Type Odometry} {Name lms200} {Pose 1,2,3}"
        data = b"\r\n".join([other, line, untimed, b""])
        assert sensor_samples([(7.0, data)], "lms200") == [(7.0, 63.40)]


class TestFiguresOfJitter:
    def test_an_even_stream_has_no_error(self) -> None:
        """A constant delay is no jitter."""
        figures = by_name(jitter_figures([stream(50), stream(30)]))
        tail = figures["Error of a period, 99th percentile"]
        assert tail.value == pytest.approx(0.0, abs=1e-6)
        assert tail.met is True
        assert figures["Error of a period in simulated time, longest"].met is True
        assert figures["Periods measured"].value == 49 + 29

    def test_late_lines_are_found(self) -> None:
        """Enough of them move the percentile; a single robot's are not hidden by the others."""
        shaken = stream(100, dict.fromkeys(range(10, 60, 10), 0.02))
        figures = by_name(jitter_figures([stream(400), shaken]))
        worst = figures["Error of a period, 99th percentile of the worst robot"]
        assert worst.value == pytest.approx(20.0)
        assert figures["Error of a period, longest"].value == pytest.approx(20.0)
        assert figures["Error of a period, 99th percentile"].met is False
        assert figures["Error of a period, median"].value == pytest.approx(0.0, abs=1e-6)
        assert figures["Error of a period in simulated time, longest"].met is True

    def test_a_report_left_out_is_an_error_in_both(self) -> None:
        """A gap of two periods is one whole period wrong."""
        samples = stream(20)
        del samples[7]
        figures = by_name(jitter_figures([samples]))
        assert figures["Error of a period, longest"].value == pytest.approx(100.0)
        simulated = figures["Error of a period in simulated time, longest"]
        assert simulated.value == pytest.approx(100.0)
        assert simulated.met is False

    @pytest.mark.parametrize("recorded", [[], [stream(20), stream(1)]])
    def test_needs_lines(self, recorded: list[list[Sample]]) -> None:
        """A robot without a laser line is an error, not a good figure of the others."""
        with pytest.raises(BenchError, match=LASER_NAME):
            jitter_figures(recorded)


def test_is_that_of_the_slowest_robot() -> None:
    """Simulated over wall time, of the robot that got on least."""
    fast = [(10.0 + n * 0.1, n * 0.8) for n in range(11)]
    slow = [(10.0 + n * 0.1, n * 0.7) for n in range(11)]
    assert slowest([fast, slow, fast]) == pytest.approx(7.0)


def test_needs_lines_of_everybody() -> None:
    """A robot that says nothing is an error."""
    with pytest.raises(BenchError, match="too few STA lines"):
        slowest([[(0.0, 0.0), (1.0, 6.0)], [(0.0, 0.0)]])


@pytest.mark.parametrize(
    ("cameras", "columns", "rows"), [(1, 1, 1), (2, 2, 1), (6, 6, 1), (7, 6, 2), (24, 6, 4)]
)
def test_every_camera_has_a_tile(cameras: int, columns: int, rows: int) -> None:
    """The grid has room for all, and no two viewers look at the same place."""
    assert grid(cameras) == (columns, rows)
    tiles = tiles_of(cameras)
    assert len(set(tiles)) == len(tiles) == cameras
    width, height = TILE_SIZE
    for x, y, w, h in tiles:
        assert (w, h) == TILE_SIZE
        assert x % width == y % height == 0
        assert x + w <= columns * width
        assert y + h <= rows * height


def seen(pictures: float, news: float, wait: float) -> ViewerTrial:
    """What a viewer got."""
    return ViewerTrial(pictures, news, wait, 2.0 * wait, 3.0 * wait, 1e4)


def test_the_worst_viewer_counts() -> None:
    """One client that is kept waiting is not hidden by the others."""
    viewers = [seen(5.0, 4.9, 0.01), seen(4.0, 3.0, 0.05), seen(5.0, 4.8, 0.02)]
    figures = by_name(watched_figures(a_trial(3, 0.9995), viewers))
    assert figures["Real-time factor, lowest of all robots"].met is True
    fewest = figures["Pictures of a camera, fewest"]
    assert (fewest.value, fewest.met) == (4.0, False)
    news = figures["New pictures of a camera, median"]
    assert (news.value, news.met) == (4.8, True)
    assert figures["New pictures of all cameras"].value == pytest.approx(12.7)
    assert figures["Time to answer, median"].value == pytest.approx(20.0)
    assert figures["Time to answer, largest 99th percentile"].value == pytest.approx(100.0)


EVEN = [n * 0.1 for n in range(200)]


class TestWaits:
    def test_the_first_sensor_line_counts(self) -> None:
        """STA and CONF are no readings, and a line counts when its end is there."""
        chunks = [
            (1.0, b"STA {Time 1}\r\nCONF {Type SEN }\r\nSEN {Ty"),
            (2.5, b"pe X} {Name Y}\r\n"),
        ]
        assert first_reading(chunks) == 2.5
        assert first_reading(chunks[:1]) is None

    def test_are_counted_from_each_ones_init(self) -> None:
        """Who asked later is not charged for the time before."""
        with FakeServer() as server:
            pair = [Controller(server.port, name) for name in ("A", "B")]
            for controller, joined, read in zip(pair, (10.0, 11.0), (10.5, 13.0), strict=True):
                controller.joined = joined
                controller.chunks = [(read, b"SEN {Type X} {Name Y}\r\n")]
            assert waits(pair) == [0.5, 2.0]
            pair[1].chunks = []
            with pytest.raises(BenchError, match="no sensor line after INIT for B"):
                waits(pair)


class TestVisiting:
    def test_all_at_once(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Every INIT is sent before anything is read; each has had a sensor line afterwards."""
        monkeypatch.setattr(admission, "PAUSE", 0.2)
        with FakeServer() as server, Crowd(server.port, 0) as crowd:
            team = admission._storm(crowd, 3)
            assert all(f"USARBot.{SCOUT}" in line for line in server.commands("INIT", 3))
            assert max(one.joined for one in team) < min(one.chunks[0][0] for one in team)
            assert all(wait > 0.0 for wait in waits(team))

    def test_one_by_one(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Newcomers leave again; for each there is a span before it in which nobody came."""
        monkeypatch.setattr(admission, "PAUSE", 0.1)
        monkeypatch.setattr(admission, "WATCHED", 0.2)
        with FakeServer() as server, Crowd(server.port, 0) as crowd:
            admission._storm(crowd, 2)
            visits = admission._visits(crowd, 3)
            assert len(crowd.controllers) == 2
        assert len(visits.waits) == len(visits.busy) == len(visits.quiet) == 3
        for quiet, busy in zip(visits.quiet, visits.busy, strict=True):
            assert quiet[1] <= busy[0]
            assert busy[1] - busy[0] == pytest.approx(0.2)


class TestFiguresOfAdmission:
    def test_the_worst_newcomer_counts(self) -> None:
        """Waits are judged by the longest; a late line by the newcomer that it belongs to."""
        late = [moment + 0.05 if number == 50 else moment for number, moment in enumerate(EVEN)]
        visits = Visits([0.28, 0.31, 0.29], [(4.5, 5.5), (7.5, 8.5)], [(1.5, 2.5), (10.5, 11.5)])
        storm = [0.5, 0.6, 2.0]
        figures = by_name(admission_figures(24, storm, 2.1, visits, [{"STA": late}]))
        assert figures["24 INITs at once: all served after"].met is True
        assert figures["24 INITs at once: INIT to first SEN, median"].value == 0.6
        longest = figures["INIT to first SEN, 24 robots running, longest"]
        assert longest.value == pytest.approx(310.0)
        assert longest.met is False
        others = figures["Others late meanwhile, longest of all newcomers"]
        assert others.value == pytest.approx(50.0)
        assert others.met is False
        assert figures["Others late meanwhile, median newcomer"].value == pytest.approx(25.0)
        quiet = figures["Others late while nobody comes, longest"]
        assert quiet.value == pytest.approx(0.0, abs=1e-6)
        assert quiet.aim is None
        assert figures["Newcomers"].value == 3
