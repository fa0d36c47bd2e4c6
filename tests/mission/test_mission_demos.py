"""The demonstrations of shipped missions, their first seconds; `make missions` plays them whole."""

from __future__ import annotations

from pathlib import Path

import pytest
from demo_missions import SEEDS, judge

from usarsim_mission.match.drawn import Drawn
from usarsim_mission.runlog import RunFolder
from usarsim_mission.scenario.reader import shipped_missions
from usarsim_server.cli import main


@pytest.mark.parametrize(
    "mission", ["arena-search", pytest.param("rsarsim", marks=pytest.mark.slow)]
)
def test_a_demonstration_begins_well(tmp_path: Path, mission: str) -> None:
    """Robots see some of the world, touch nobody, and none stands without a reason."""
    out = tmp_path / "run"
    words = [mission, "--demo", "--seed=1", "--time-limit=8", f"--out={out}"]
    assert main(["mission", "run", *words]) == 0
    row = judge(mission, out)
    assert row.misses == []
    assert row.points > 5.0 or mission == "rsarsim"  # which pays for victims alone
    assert (row.mission, row.seed) == (mission, 1)
    drawn = Drawn()
    for record in RunFolder(out).records():
        drawn.take(record)
    assert min(robot.way for robot in drawn.robots.values()) > 1.0  # all of them drive


def test_all_with_a_world_are_judged() -> None:
    """Every shipped mission but the slalom, which has no victims, and the map that its user
    brings."""
    shipped = {path.stem for path in shipped_missions()}
    assert set(SEEDS) == shipped - {"slalom", "competition-map"}
