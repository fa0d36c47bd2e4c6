"""Smoke in films: single balls are where sensors of the server met them, and are drawn there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_film import ABOVE, RED, SCENE, Session, expected, film, kind, middle

from usarsim_operator.film.smoke import Balls
from usarsim_server.base.files import data_directory
from usarsim_server.scene.primitives import Primitives
from usarsim_server.simulation.model import PhysicsOptions, compile_world
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene
from usarsim_server.worlds.smoke import SmokeField


def test_balls_are_where_the_server_has_them() -> None:
    """Of a shipped world with clouds that rise and one that stands still, at any time."""
    world = load_world(data_directory("worlds") / "smoke_corridor")
    built = compile_world(lambda: build_scene(world), [], PhysicsOptions(), 0)
    told = json.loads(json.dumps(Primitives(built).scene(world).message["smoke"]))
    balls, field = Balls(told["clouds"]), SmokeField(world.smoke)
    assert any("places" in one for one in told["clouds"]) or any(
        "angle" in one for one in told["clouds"]
    )
    for time in (0.0, 3.7, 1234.5):
        (centres, radii), (true, sizes) = balls(time), field.particles(time)
        assert centres == pytest.approx(true, abs=2e-3)  # angles are told with four digits
        assert radii == pytest.approx(sizes)


def _cloudy(path: Path, **cloud: Any) -> Path:
    one = Session(path)
    one.say(**kind("Red", RED))
    about = {"name": "c", "pos": [2, -2, 2], "size": [1, 1, 3], "radius": 0.5, **cloud}
    one.say(**{**SCENE, "smoke": {"color": [0.4] * 3, "volumes": [], "clouds": [about]}})
    one.present("R1=Red")
    for step in range(41):
        one.poses(step / 10.0, (0.0, 0.0))
    one.writer.close()
    return path


def test_still_balls_hide_what_is_behind(tmp_path: Path) -> None:
    """One above the robot hides it; one elsewhere does not, and is seen where it is."""
    ball = lambda *place: _cloudy(tmp_path / f"{place[0]}.rec", lifetime=0, places=[place])  # noqa: E731
    hidden = film(ball(0.0, 0.0, 3.0), *ABOVE, "--speed=40")[0]
    assert middle(hidden, RED) is None
    beside = film(ball(2.0, -2.0, 1.0), *ABOVE, "--speed=40")[0]
    assert middle(beside, RED) is not None
    clear = film(_clear(tmp_path / "clear.rec"), *ABOVE, "--speed=40")[0]
    changed = np.abs(beside.astype(int) - clear).max(axis=2) > 10
    rows, columns = np.nonzero(changed)
    assert (columns.mean(), rows.mean()) == pytest.approx(expected(2.0, -2.0, 9.0), abs=3.0)
    assert len(rows) == pytest.approx(np.pi * (0.5 / 9.0 * 125.6) ** 2, rel=0.4)


def _clear(path: Path) -> Path:
    return _cloudy(path, lifetime=0, places=[[0.0, 0.0, -5.0]])  # below the ground


def test_balls_rise_with_simulated_time(tmp_path: Path) -> None:
    """Seen from the side a ball goes up by the height of its cloud in its lifetime."""
    side = ("--eye=0,8,-2", "--at=0,0,-2")
    rising = {"lifetime": 4.0, "angle": [0.0], "aside": [0.0], "pos": [0, 0, 2.5]}
    frames = film(_cloudy(tmp_path / "a.rec", **rising), *side)
    empty = film(_clear(tmp_path / "b.rec"), *side, out="e.mp4")
    heights = []
    for time in (0.8, 2.0, 3.2):
        frame, none = (one[round(10 * time)].astype(int) for one in (frames, empty))
        rows, _ = np.nonzero(np.abs(frame - none).max(axis=2) > 10)
        heights.append(float(rows.mean()))
    way = 1.2 / 4.0 * 3.0 / 8.0 * 125.6  # pixels between two of them
    assert np.diff(heights) == pytest.approx([-way, -way], abs=3.0)
