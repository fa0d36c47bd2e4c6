"""Lengths of robots are metres: one room at three widths of a cell is explored alike."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from usarsim_exploration.environment import Cell
from usarsim_exploration.frontiers import frontiers_of
from usarsim_exploration.known_map import FREE
from usarsim_exploration.levels.route import unknown_at
from usarsim_exploration.running import Run, run
from usarsim_exploration.scenario import Scenario, read

CASE = Path(__file__).parent / "cases" / "23"
MAPS = {"m10.yaml": 1, "m05.yaml": 2, "m025.yaml": 4}
"""Of two rooms, 10 m x 6 m; and cells that are as long as 0.1 m."""


def scenario(folder: Path, name: str, backend: str, base: tuple[float, float] | None) -> Scenario:
    """Two robots that drive 1 m a step, see 10 m and are heard 20 m away."""
    path, many = CASE / name, MAPS[name]
    if not path.exists():  # twice as many cells each way
        picture = cv2.imread(str(CASE / "m05.pgm"), cv2.IMREAD_UNCHANGED)
        assert picture is not None
        cv2.imwrite(str(folder / "m025.pgm"), np.kron(picture, np.ones((2, 2), np.uint8)))
        text = (CASE / "m05.yaml").read_text().replace("m05", "m025")
        path = folder / name
        path.write_text(text.replace("resolution: 0.05", "resolution: 0.025"))
    team: dict[str, object] = {
        "robots": 2, "speed": 10 * many, "reach": 100 * many, "radio": 200 * many
    }  # fmt: skip
    if base is not None:
        team["base"] = [int(one * 10 * many) for one in base]
    content = {"backend": backend, "environment": {"name": str(path)}, "team": team}
    return read(content | {"end": {"steps": 60}})


@pytest.mark.parametrize(
    ("backend", "base"),
    [
        ("grid", None),
        ("discs", None),
        ("discs", (3.5, 4.5)),
        ("discs", (7.5, 3.0)),
        pytest.param("server", None, marks=pytest.mark.slow),
    ],
)
def test_one_room_at_three_widths_of_a_cell(
    backend: str, base: tuple[float, float] | None, tmp_path: Path
) -> None:
    """It takes as many steps, within one."""
    results = [run(scenario(tmp_path, name, backend, base)) for name in MAPS]
    assert [one.ended for one in results] == ["base knows"] * 3
    steps = [one.history.steps for one in results]
    assert max(steps) - min(steps) <= 1
    assert max(steps) <= 7


def test_what_is_a_frontier_and_near_is_metres(tmp_path: Path) -> None:
    """A robot with a body leaves alone what is less than 0.3 m; points count cells."""
    sizes = {}
    for name, backend in (("m10.yaml", "discs"), ("m025.yaml", "discs"), ("m025.yaml", "grid")):
        one = Run(scenario(tmp_path, name, backend, None))
        view = one.cycle.bodies[1].view
        view.known.bits[:] = 0
        view.known.bits[10, 10:16] = FREE  # 10 cells around
        sizes[name, backend] = view.scale, len(frontiers_of(view))
    assert sizes["m10.yaml", "discs"] == (1.0, 1)
    assert sizes["m025.yaml", "discs"] == (4.0, 0)
    assert sizes["m025.yaml", "grid"] == (1.0, 1)


@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_a_robot_that_arrives_looks_at_what_is_unknown(scale: float) -> None:
    """Within half a metre; where all is known, as it came."""
    bits = np.zeros((100, 100), np.uint8)
    bits[:, 30:] = FREE
    cell: Cell = (30, 50)
    assert abs(math.remainder(unknown_at(bits, cell, scale, 0.0) - math.pi, math.tau)) < 0.1
    assert unknown_at(bits, (60, 50), scale, 0.7) == 0.7
