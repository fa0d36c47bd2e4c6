"""Every measurement runs through, with real servers and tiny parameters.

No figure is judged here: machines that run tests are busy. What is checked is that figures are
there, finite, and of the right kind.
"""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from bench_runs import measured

from usarsim_bench import admission as spawn
from usarsim_bench import latency, memory, sensors, team
from usarsim_bench.server import BenchError, Server


@pytest.fixture
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing settles, and one new class is enough."""
    for module in (team, latency, spawn, memory):
        monkeypatch.setattr(module, "SETTLE", 0.3)
    monkeypatch.setattr(spawn, "NEW_CLASSES", ("P2AT",))


@pytest.mark.usefixtures("hurried")
class TestMeasurements:
    def test_team(self, tmp_path: Path) -> None:
        """Two robots send all their lines, and somebody pays for it."""
        figures = measured(tmp_path, "team", 1.8)
        assert figures["Real-time factor, lowest of all robots"]["aim"] == ">= 0.999"
        assert figures["Lines sent"]["value"] > 0
        assert figures["Processor use of the server"]["value"] > 0.0
        assert figures["Memory of the server"]["value"] > 20.0

    def test_largest(self, tmp_path: Path) -> None:
        """A single size has figures of its own, and no aim."""
        figures = measured(tmp_path, "largest", 1.8)
        assert figures["Largest team in real time"]["value"] in (0, 2)
        assert figures["Largest team in real time"]["aim"] is None
        assert "2 robots: real-time factor" in figures

    def test_latency(self, tmp_path: Path) -> None:
        """Every command is found again at every station, and later at each."""
        figures = measured(tmp_path, "latency", 1.8)
        assert figures["Commands measured"]["value"] >= 1
        assert figures["Commands lost"]["value"] == 0
        medians = [
            figure["value"]
            for name, figure in figures.items()
            if name.startswith("...") and name.endswith("median")
        ]
        assert len(medians) == 4
        assert medians == sorted(medians)
        assert medians[0] > 0.0

    def test_spawn(self, tmp_path: Path) -> None:
        """There is a gap for each newcomer and one for comparison; the worst newcomer counts."""
        figures = measured(tmp_path, "spawn", 1.0)
        gaps = {
            name: figure["value"]
            for name, figure in figures.items()
            if name.startswith("Longest extra gap, ")
        }
        assert {name.removeprefix("Longest extra gap, ") for name in gaps} == {
            "all newcomers",
            "nobody comes, for comparison",
            "one more P3AT",
            "the first P2AT",
        }
        assert gaps["Longest extra gap, all newcomers"] == max(
            gaps["Longest extra gap, one more P3AT"], gaps["Longest extra gap, the first P2AT"]
        )
        assert figures["INIT to the newcomer's first STA line, median"]["value"] > 0.0

    def test_memory(self, tmp_path: Path) -> None:
        """Robots come and go, and it is told what the server gives back of what they took."""
        figures = measured(tmp_path, "memory", 2.0)
        assert figures["Robots that came"]["value"] >= 2
        assert figures["Memory with 2 robots"]["value"] > figures["Memory without robots"]["value"]
        assert {"Threads left behind", "Descriptors left behind"} <= set(figures)

    def test_sensors(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Robots with all sensors stream and send depth images; lasers send whole scans."""
        monkeypatch.setattr(sensors, "IMAGE_CHANCE", 1.0)
        figures = measured(tmp_path, "sensors", 4.0)
        for team_name in ("All types", "Lasers"):
            name = f"{team_name}: real-time factor, lowest of all robots"
            assert figures[name]["aim"] == ">= 0.999"
            assert figures[f"{team_name}: processor use of the server"]["value"] > 0.0
        # One for each of the types that report by themselves, and those of the P3AT.
        assert figures["All types: streams of a robot, fewest"]["value"] > 50
        assert figures["All types: depth images of all robots"]["value"] > 0.0
        scans = figures["Lasers: whole scans of a robot, fewest"]
        assert scans["aim"] == ">= 19"
        assert scans["value"] > 0.0

    def test_cameras(self, tmp_path: Path) -> None:
        """Each way of looking gets pictures; those of a robot that drives are new."""
        figures = measured(tmp_path, "cameras", 2.0)
        for look in ("One tile", "Full frame", "Full frame without pause"):
            assert figures[f"{look}: pictures"]["value"] > 0.0
            assert figures[f"{look}: new pictures"]["value"] >= 0.0
            assert figures[f"{look}: real-time factor"]["aim"] == ">= 0.999"
            median = figures[f"{look}: time to answer, median"]["value"]
            assert 0.0 < median <= figures[f"{look}: time to answer, 99th percentile"]["value"]
        assert figures["Full frame: pictures"]["aim"] == ">= 13.5"
        assert figures["Unwatched: processor use of the server"]["value"] > 0.0

    def test_stepping(self, tmp_path: Path) -> None:
        """One scene gives rates, ratios and contacts."""
        figures = measured(tmp_path, "stepping", 0.5)
        place = "empty, 2 robots: "
        assert figures[place + "engine / bare mj_step"]["aim"] == ">= 0.8"
        assert figures[place + "engine"]["value"] > 0.0
        assert figures[place + "contacts, engine"]["value"] == pytest.approx(8.0, abs=0.5)


class TestServer:
    def test_that_cannot_start(self) -> None:
        """The error is what the server said."""
        with pytest.raises(BenchError, match="did not start: error: nowhere: no such world"):
            Server("nowhere", 1)

    def test_that_dies(self) -> None:
        """A dead server is noticed by the next look, and again at the end."""
        with Server("empty", 1) as server:
            os.kill(server.pid, signal.SIGKILL)
            os.waitid(os.P_PID, server.pid, os.WEXITED | os.WNOWAIT)
            with pytest.raises(BenchError, match="the server died"):
                server.usage()
            with pytest.raises(BenchError, match="ended with code -9"):
                server.stop()

    def test_that_ends_as_told(self) -> None:
        """It ends without an error, and a second time is none either."""
        server = Server("empty", 1)
        assert server.usage().resident > 0
        server.stop()
        server.stop()
