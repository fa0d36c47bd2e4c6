"""Newcomers: from INIT to the first sensor line, and how late the others get."""

from __future__ import annotations

import pytest
from bench_fakes import FakeServer

from usarsim_bench import admission
from usarsim_bench.admission import Visits, admission_figures, waits
from usarsim_bench.crowd import Controller, Crowd
from usarsim_bench.recording import first_reading
from usarsim_bench.robot_files import SCOUT
from usarsim_bench.server import BenchError

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


class TestFigures:
    def test_the_worst_newcomer_counts(self) -> None:
        """Waits are judged by the longest; a late line by the newcomer that it belongs to."""
        late = [moment + 0.05 if number == 50 else moment for number, moment in enumerate(EVEN)]
        visits = Visits([0.28, 0.31, 0.29], [(4.5, 5.5), (7.5, 8.5)], [(1.5, 2.5), (10.5, 11.5)])
        figures = {
            one.name: one
            for one in admission_figures(24, [0.5, 0.6, 2.0], 2.1, visits, [{"STA": late}])
        }
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
