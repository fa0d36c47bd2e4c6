"""Every measurement for developers runs through, with real servers and tiny parameters.

No figure is judged here: machines that run tests are busy.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from benchmarks import (
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
from benchmarks.__main__ import main
from benchmarks.suite import MEASUREMENTS

pytestmark = pytest.mark.slow

ARGUMENTS = {
    "console": ("con-02",),
    "hostile": ("--attack", "drip"),
    "import": ("--seconds", "2"),
    "mission": ("--seconds", "2"),
    "soak": ("--robots", "2", "--minutes", "0.1", "--world", "empty"),
}
"""Of those that would take long; the others get two seconds and two robots."""


@pytest.fixture(autouse=True)
def _hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Teams settle for a moment only, and one new class is enough."""
    for module in (admission, groundtruth, latency, memory, physics, relay, soak, swarm, team):
        monkeypatch.setattr(module, "SETTLE", 0.5)
    monkeypatch.setattr(team, "WINDOW", 0.3)
    monkeypatch.setattr(admission, "NEW_CLASSES", ("P2AT",))
    monkeypatch.setattr(soak_visitors, "GUESTS", 3)
    monkeypatch.setattr(soak, "all_classes", lambda: ["P2AT", "P3AT", "ERS"])
    monkeypatch.setattr(sensors, "all_classes", lambda: ["P2AT", "P3AT"], raising=False)


@pytest.mark.parametrize("name", MEASUREMENTS)
def test_it_runs_through(name: str, tmp_path: Path) -> None:
    file = tmp_path / "report.json"

    usual = ("--robots", "2", "--seconds", "2", "--world", "empty")
    assert main([name, *ARGUMENTS.get(name, usual), "--json", str(file)]) == 0
    (section,) = json.loads(file.read_text())["sections"]
    assert section["key"] == name
    assert all(
        one["value"] is not None and math.isfinite(one["value"]) for one in section["figures"]
    )
