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

from usarsim_bench import (
    admission,
    groundtruth,
    latency,
    memory,
    physics,
    relay,
    sensors,
    soak,
    soak_visitors,
    swarm,
    team,
)
from usarsim_bench.server import BenchError, Server
from usarsim_bench.soak import flatness
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cli import main
from usarsim_server.testing import Rehearsal


def measured(folder: Path, name: str, seconds: float, robots: int = 2) -> dict[str, dict[str, Any]]:
    """Figures of one measurement by name, as the JSON file has them."""
    file = folder / f"{name}.json"

    def run(seconds: float) -> int:
        words = ["--robots", str(robots), "--seconds", str(seconds), "--world", "empty"]
        return main(["bench", name, *words, "--json", str(file)])

    # On a machine that is too busy for a short measurement a longer one has samples enough.
    assert run(seconds) == 0 or run(4.0 * seconds) == 0
    sections = json.loads(file.read_text())["sections"]
    assert [section["key"] for section in sections] == [name]
    figures = {figure["name"]: figure for figure in sections[0]["figures"]}
    assert len(figures) == len(sections[0]["figures"])
    assert all(math.isfinite(figure["value"]) for figure in figures.values())
    return figures


@pytest.fixture(autouse=True)
def _hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing settles for long, and one new class is enough."""
    for module in (admission, groundtruth, latency, memory, physics, relay, swarm, team):
        monkeypatch.setattr(module, "SETTLE", 0.3)
    monkeypatch.setattr(team, "WINDOW", 0.3)
    monkeypatch.setattr(admission, "NEW_CLASSES", ("P2AT",))
    monkeypatch.setattr(admission, "PAUSE", 0.2)
    monkeypatch.setattr(admission, "WATCHED", 0.6)


@pytest.mark.slow
class TestMeasurements:
    def test_largest(self, tmp_path: Path) -> None:
        """A single size has figures of its own, and no aim."""
        figures = measured(tmp_path, "largest", 1.0)
        assert figures["Largest team in real time"]["value"] in (0, 2)
        assert figures["Largest team in real time"]["aim"] is None
        assert "2 robots: real-time factor" in figures

    def test_latency(self, tmp_path: Path) -> None:
        """Commands are found again at every station, and later at each.

        On a busy machine a newer command may overtake one before a step of the world uses it.
        """
        figures = measured(tmp_path, "latency", 1.8)
        assert figures["Commands measured"]["value"] >= 1
        assert figures["Commands lost"]["value"] < figures["Commands measured"]["value"]
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
        figures = measured(tmp_path, "memory", 1.0)
        assert figures["Robots that came"]["value"] >= 2
        assert figures["Memory with 2 robots"]["value"] > figures["Memory without robots"]["value"]
        assert {"Threads left behind", "Descriptors left behind"} <= set(figures)

    def test_sensors(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Robots with all sensors stream and send depth images; lasers send whole scans."""
        monkeypatch.setattr(sensors, "IMAGE_CHANCE", 1.0)
        figures = measured(tmp_path, "sensors", 2.0)
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
                server.close()

    def test_that_ends_as_told(self) -> None:
        """It ends without an error, and a second time is none either."""
        server = Server("empty", 1)
        assert server.usage().resident > 0
        server.close()
        server.close()


@pytest.mark.slow
def test_relay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two robots and a base: the data arrived."""
    monkeypatch.setattr(relay, "PINGS", 5)
    figures = measured(tmp_path, "relay", 1.5)
    assert figures["Part that arrived"]["value"] == 1.0
    assert figures["Throughput of one link"]["value"] > 0.0
    assert figures["Data carried"]["value"] > 0.0


@pytest.mark.slow
def test_delivery(tmp_path: Path) -> None:
    """Pictures arrive; where there is OpenGL they are compared with those of a loop."""
    figures = measured(tmp_path, "delivery", 2.0, robots=1)
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


FIGURES: dict[str, tuple[float, dict[str, str | None]]] = {
    "team": (
        1.8,
        {
            "Real-time factor, lowest of all robots": ">= 0.999",
            "Lines sent": None,
            "Processor use of the server": "< 1.2",
            "Memory of the server": None,
        },
    ),
    "watched": (
        1.8,
        {
            "Real-time factor, lowest of all robots": ">= 0.999",
            "Pictures of a camera, fewest": ">= 4.5",
        },
    ),
    "swarm": (
        1.8,
        {
            "2 robots: real-time factor, lowest of all robots": ">= 0.999",
            "2 robots: processor use of the server": "<= 1.2",
            "2 robots: lines sent": None,
        },
    ),
    "admission": (
        1.0,
        {
            "2 INITs at once: all served after": "< 3",
            "INIT to first SEN, 2 robots running, median": None,
            "Newcomers": None,
        },
    ),
    "jitter": (1.5, {"Error of a period, 99th percentile": "< 5", "Periods measured": None}),
    "lockstep": (1.0, {"Simulated seconds per second": ">= 6", "Lines sent": None}),
    "physics": (
        2.0,
        {
            "2 robots: physics thread / bare mj_step": "<= 1.25",
            "2 robots: its step loop alone / bare mj_step": None,
            "2 robots: physics thread / MuJoCo's part of it": None,
            "2 robots: turns": None,
        },
    ),
    "stepping": (
        0.5,
        {
            "empty, 2 robots: engine / bare mj_step": ">= 0.8",
            "empty, 2 robots: engine": None,
            "empty, 2 robots: contacts, engine": None,
        },
    ),
    "groundtruth": (
        1.5,
        {
            "GETPOS to its answer, median": "< 10",
            "GETOBS to its answer, median": "< 10",
            "GETOBS answered": None,
        },
    ),
    "rays": (
        0.2,
        {"2 robots: server / bare Embree": None, "2 robots: rays in the batch": None},
    ),
}
"""Length of some measurements, and aims of some figures, all of which are above zero."""


@pytest.mark.slow
@pytest.mark.parametrize("name", FIGURES)
def test_figures_and_aims(tmp_path: Path, name: str) -> None:
    """What is judged has its aim, and something was measured."""
    seconds, aims = FIGURES[name]
    figures = measured(tmp_path, name, seconds)
    assert {figure: figures[figure]["aim"] for figure in aims} == aims
    assert all(figures[figure]["value"] > 0.0 for figure in aims)


class TestFlatness:
    """Memory at the end by memory after the warming up."""

    def test_growth(self) -> None:
        """What was before the warming up does not count."""
        samples = [(float(t), 100.0 if t < 20 else 200.0 + t) for t in range(120)]
        assert flatness(samples, 20.0) == pytest.approx((200 + 114.5) / (200 + 24.5))

    def test_too_short(self) -> None:
        """No verdict from nothing."""
        assert math.isnan(flatness([(0.0, 1.0)], 0.0))


@pytest.mark.slow
def test_a_very_short_soak(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots come and speak, radio links carry, nothing is missing, everything is given back."""
    monkeypatch.setattr(soak, "SETTLE", 1.0)
    monkeypatch.setattr(soak_visitors, "GUESTS", 3)
    monkeypatch.setattr(soak_visitors, "STAY", 3.0)
    monkeypatch.setattr(soak_visitors, "RADIO_EVERY", 1.0)
    monkeypatch.setattr(soak, "all_classes", lambda: ["P2AT", "P3AT", "ERS"])
    figures = measured(tmp_path, "soak", 4.0)
    assert figures["Visits of robots"]["value"] >= 3
    assert figures["Classes that were there"]["value"] >= 1
    assert figures["Status lines of those who stay"]["value"] > 0
    assert figures["Memory when everybody has gone"]["value"] > 0
    assert figures["... of them missing in simulated time"]["aim"] == "<= 0"
    assert figures["... by that with the first robot"]["aim"] is None
