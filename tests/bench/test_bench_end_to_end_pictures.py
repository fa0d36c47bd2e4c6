"""The measurements of cameras run through, with real servers and tiny parameters."""

from __future__ import annotations

from pathlib import Path

import pytest
from bench_runs import measured

from usarsim_bench import team
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.testing import Rehearsal


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
