"""Every measurement runs through, with real servers and tiny parameters.

No figure is judged here: machines that run tests are busy. What is checked is that figures are
there, finite, and of the right kind.
"""

from __future__ import annotations

import json
import math
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from usarsim_bench import admission, latency, memory, physics, sensors, soak, soak_visitors, team
from usarsim_bench import admission as spawn
from usarsim_bench import swarm as jitter
from usarsim_bench import swarm as lockstep
from usarsim_bench.server import BenchError, Server
from usarsim_bench.soak import Stream, flatness
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cli import main
from usarsim_server.testing import Rehearsal


def measured(folder: Path, name: str, seconds: float, robots: int = 2) -> dict[str, dict[str, Any]]:
    """Figures of one measurement by name, as the JSON file has them."""
    file = folder / f"{name}.json"
    words = ["--robots", str(robots), "--seconds", str(seconds), "--world", "empty"]
    assert main(["bench", name, *words, "--json", str(file)]) == 0
    sections = json.loads(file.read_text())["sections"]
    assert [section["key"] for section in sections] == [name]
    figures = {figure["name"]: figure for figure in sections[0]["figures"]}
    assert len(figures) == len(sections[0]["figures"])
    assert all(math.isfinite(figure["value"]) for figure in figures.values())
    return figures


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


@pytest.fixture(autouse=True)
def _hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(team, "SETTLE", 0.5)
    monkeypatch.setattr(team, "WINDOW", 0.3)


def test_watched(tmp_path: Path) -> None:
    """Every camera is watched, and its pictures change while its robot drives."""
    figures = measured(tmp_path, "watched", 5.0)
    assert figures["Real-time factor, lowest of all robots"]["aim"] == ">= 0.999"
    assert figures["Pictures of a camera, fewest"]["value"] > 0.0
    assert figures["New pictures of all cameras"]["value"] >= 0.0


def test_delivery(tmp_path: Path) -> None:
    """Pictures arrive; where there is OpenGL they are compared with those of a loop."""
    figures = measured(tmp_path, "delivery", 5.0, robots=1)
    assert figures["Server: pictures of all cameras"]["value"] > 0.0
    ratio = figures.get("Delivered / rendered by the loop")
    if ratio is None:
        with Rehearsal(world="empty") as rehearsal:
            painter = Painter(rehearsal.assembly.simulation.compiled, PainterOptions())
            assert painter.renderer == "rays"
            painter.close()
    else:
        assert ratio["aim"] == ">= 0.85"
        assert ratio["value"] > 0.0


@pytest.fixture(autouse=True)
def _teams_hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (admission, jitter, lockstep, physics, team):
        monkeypatch.setattr(module, "SETTLE", 0.3)
    monkeypatch.setattr(admission, "PAUSE", 0.2)
    monkeypatch.setattr(admission, "WATCHED", 0.6)
    monkeypatch.setattr(team, "WINDOW", 0.3)


def test_swarm(tmp_path: Path) -> None:
    """A size asked for has its figures, and the aims of a large team."""
    figures = measured(tmp_path, "swarm", 1.8)
    assert figures["2 robots: real-time factor, lowest of all robots"]["aim"] == ">= 0.999"
    assert figures["2 robots: processor use of the server"]["aim"] == "<= 1.2"
    assert figures["2 robots: lines sent"]["value"] > 0


def test_admission(tmp_path: Path) -> None:
    """Everybody is served, those who are there first and those who come later."""
    figures = measured(tmp_path, "admission", 1.0)
    assert figures["2 INITs at once: all served after"]["aim"] == "< 3"
    assert figures["2 INITs at once: all served after"]["value"] > 0.0
    assert figures["INIT to first SEN, 2 robots running, median"]["value"] > 0.0
    assert figures["Others late meanwhile, longest of all newcomers"]["aim"] == "< 20"
    assert figures["Newcomers"]["value"] == 2


def test_jitter(tmp_path: Path) -> None:
    """Periods are measured against both clocks."""
    figures = measured(tmp_path, "jitter", 1.5)
    assert figures["Error of a period, 99th percentile"]["aim"] == "< 5"
    assert figures["Periods measured"]["value"] >= 1


def test_lockstep(tmp_path: Path) -> None:
    """Simulated time passes as fast as it can."""
    figures = measured(tmp_path, "lockstep", 1.0)
    assert figures["Simulated seconds per second"]["aim"] == ">= 6"
    assert figures["Simulated seconds per second"]["value"] > 0.0
    assert figures["Lines sent"]["value"] > 0


def test_physics(tmp_path: Path) -> None:
    """Some turns are taken while the server runs, and every part of the thread has a figure."""
    figures = measured(tmp_path, "physics", 2.0)
    ratio = figures["2 robots: physics thread / bare mj_step"]
    assert ratio["aim"] == "<= 1.1"
    assert ratio["value"] > 0.0
    assert figures["2 robots: its step loop alone / bare mj_step"]["value"] > 0.0
    assert figures["2 robots: physics thread / MuJoCo's part of it"]["value"] > 0.0
    assert figures["2 robots: turns"]["value"] >= 1


def status(*times: float) -> bytes:
    """STA lines that tell these times."""
    return b"".join(b"STA {Type GroundVehicle} {Time %.4f} {x y}\r\n" % time for time in times)


class TestStream:
    """Lines are missed by the time that they themselves tell."""

    def test_nothing_is_missing(self) -> None:
        """However the lines are cut into pieces."""
        stream, data = Stream(), status(*(0.1 * n for n in range(60)))
        for begin in range(0, len(data), 7):
            stream.digest(data[begin : begin + 7])
        assert (stream.lines, stream.missing) == (60, 0)

    def test_what_is_missing_is_counted(self) -> None:
        """Two lines that never came."""
        times = [0.1 * n for n in range(60) if n not in (40, 50)]
        stream = Stream()
        stream.digest(status(*times) + b"SEN {Time 9} {Type x}\r\n")
        assert (stream.lines, stream.missing) == (58, 2)


class TestFlatness:
    """Memory at the end by memory after the warming up."""

    def test_growth(self) -> None:
        """What was before the warming up does not count."""
        samples = [(float(t), 100.0 if t < 20 else 200.0 + t) for t in range(120)]
        assert flatness(samples, 20.0) == pytest.approx((200 + 114.5) / (200 + 24.5))

    def test_too_short(self) -> None:
        """No verdict from nothing."""
        assert math.isnan(flatness([(0.0, 1.0)], 0.0))


def test_a_very_short_soak(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots come and speak, radio links carry, nothing is missing, everything is given back."""
    monkeypatch.setattr(soak, "SETTLE", 0.2)
    monkeypatch.setattr(soak_visitors, "GUESTS", 3)
    monkeypatch.setattr(soak_visitors, "STAY", 3.0)
    monkeypatch.setattr(soak_visitors, "RADIO_EVERY", 1.0)
    monkeypatch.setattr(soak_visitors, "all_classes", lambda: ["P2AT", "P3AT", "ERS"])
    monkeypatch.setattr(soak, "all_classes", lambda: ["P2AT", "P3AT", "ERS"])
    figures = measured(tmp_path, "soak", 8.0)
    assert figures["Visits of robots"]["value"] >= 3
    assert figures["Classes that were there"]["value"] >= 1
    assert figures["Status lines of those who stay"]["value"] > 0
    assert figures["Memory when everybody has gone"]["value"] > 0
    assert figures["... of them missing in simulated time"]["aim"] == "<= 0"
    assert figures["... by that of the empty server"]["aim"] is None
