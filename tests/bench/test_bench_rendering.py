"""The measurement of camera pictures: the instrument measures, what it says becomes figures."""

from __future__ import annotations

import json
import math
import subprocess

import numpy as np
import pytest

from usarsim_bench import rendering as instrument
from usarsim_bench.figures import Plan
from usarsim_bench.rendering import BareRenderer, measure_rendering
from usarsim_bench.server import BenchError
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.simulation.frames import Pose

COSTS: dict[str, float | str] = {
    "renderer": "egl",
    "robots": 4,
    "bare": 6.0,
    "tile": 6.5,
    "smoky": 8.0,
    "lit": 14.0,
    "rays": 25.0,
    "jpeg": 0.5,
    "depth_rendered": 6.0,
    "depth_rays": 15.0,
    "to_bare": 0.92,
}
WATCHED = {"cameras": 4, "pictures": 60.0, "age": 0.02, "oldest": 0.04, "factor": 0.9995}


def answer_with(
    monkeypatch: pytest.MonkeyPatch, output: str, code: int = 0, error: str = ""
) -> list[list[str]]:
    """Let something stand for the instrument; returns the commands that it is given."""
    commands: list[list[str]] = []

    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        commands.append(command)
        return subprocess.CompletedProcess(command, code, output, error)

    monkeypatch.setattr(subprocess, "run", run)
    return commands


def test_figures_of_the_section(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each cost and each number of watched cameras has its figures; seconds become ms."""
    commands = answer_with(monkeypatch, f"{json.dumps(COSTS)}\n{json.dumps(WATCHED)}\n")
    section = measure_rendering(Plan(robots=2, seconds=3.0, world="office"))
    figures = {figure.name: figure for figure in section.figures}
    assert figures["bare mujoco.Renderer / tile"].met is True
    assert figures["tile by rays"].value == 25.0
    assert figures["4 watched: age when handed out, median"].value == pytest.approx(20.0)
    assert figures["4 watched: real-time factor"].met is True
    assert "egl" in section.setting
    (command,) = commands
    assert command[command.index("--world") + 1] == "office"
    assert command[command.index("--robots") + 1] == "2"
    assert command[command.index("--seconds") + 1] == "3.0"


def test_a_failure_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """If the instrument fails the report says why."""
    answer_with(monkeypatch, "", 1, "no such world")
    with pytest.raises(BenchError, match="no such world"):
        measure_rendering(Plan())


def test_bare_and_server_draw_the_same() -> None:
    """What is compared with the server is the same picture, drawn by MuJoCo's own class."""
    assembly = instrument._assembly("empty", 2, float("inf"))
    try:
        assembly.simulation.run_until(0.1)
        snapshot = assembly.simulation.look()
        painter = Painter(assembly.simulation.compiled, PainterOptions())
        if painter.renderer == "rays":
            pytest.skip("no OpenGL library on this machine")
        eye = painter.place(assembly.board.views[0], snapshot, 320, 240)
        assert eye is not None
        compiled = assembly.simulation.compiled(snapshot)
        with BareRenderer(painter.renderer, compiled, snapshot, eye) as bare:
            theirs = bare.draw(eye).astype(int)
        ours = painter.tile(eye, snapshot).astype(int)
        painter.close()
    finally:
        assembly.stop()
    assert np.abs(ours - theirs).mean() < 1.0


def test_watched_cameras_are_counted() -> None:
    """In a short run cameras are rendered, no faster than their rate, and frames have an age."""
    watched = instrument.measure_watched("empty", 1, 2, 0.5)
    assert watched.cameras == 2
    assert 0.0 < watched.pictures < 40.0
    assert math.isfinite(watched.age)
    assert watched.oldest >= watched.age


def test_extra_cameras_stand_on_robots() -> None:
    """Where a team has too few cameras further ones are mounted on its robots."""
    assembly = instrument._assembly("empty", 2, float("inf"), cameras=6)
    try:
        views = assembly.board.views
        assert len(views) == 6
        assert [view.tile for view in views] == list(range(6))
        assert {view.robot for view in views} == {one.robot for one in assembly.fleet.vehicles}
        assert all(isinstance(view.pose, Pose) for view in views)
    finally:
        assembly.stop()
