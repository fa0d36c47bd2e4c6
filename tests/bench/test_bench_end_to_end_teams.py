"""The measurements of large teams run through, with real servers and tiny parameters.

No figure is judged here: machines that run tests are busy. What is checked is that figures are
there, finite, and of the right kind.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from bench_runs import measured

from usarsim_bench import admission, physics, team
from usarsim_bench import swarm as jitter
from usarsim_bench import swarm as lockstep


@pytest.fixture(autouse=True)
def _hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (admission, jitter, lockstep, physics, team):
        monkeypatch.setattr(module, "SETTLE", 0.3)
    monkeypatch.setattr(admission, "PAUSE", 0.2)
    monkeypatch.setattr(admission, "WATCHED", 0.6)
    monkeypatch.setattr(team, "WINDOW", 0.3)


def test_swarm(tmp_path: Path) -> None:
    """A size asked for has its figures, and the aims of a large team."""
    figures = measured(tmp_path, "swarm", 1.8)
    assert figures["2 robots: real-time factor, lowest of all"]["aim"] == ">= 0.999"
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
