"""Many trials in one process: the gateway holds no more after each (HRI-20)."""

from __future__ import annotations

import asyncio
import gc
import shutil
from pathlib import Path

import psutil
import pytest

from usarsim_mission.match.team import DEMO
from usarsim_mission.match.trial import Conditions, Trial
from usarsim_mission.scenario.reader import parse_scenario
from usarsim_mission.scenario.resolving import stage

_MISSION = """
schema = "usar-mission/1"
title = "A room"
world = "empty"
time_limit = 2

[[robot]]
name = "R1"
class = "P3AT"
position = [0.0, 0.0, 0.0]
unattended = "explore"

[[victim]]
name = "MaleVictim_0"
position = [3.0, 1.0, 0.12]
"""


@pytest.mark.slow
def test_trials_leave_nothing_behind(tmp_path: Path) -> None:
    """No object, no descriptor, no thread and no memory of a trial is there after the next one."""
    process = psutil.Process()
    held: list[tuple[int, int, int]] = []
    resident: list[float] = []
    for number in range(3):
        folder = tmp_path / "run"
        staged = stage(parse_scenario(_MISSION, tmp_path / "room.toml"), seed=number)
        result = asyncio.run(Trial(staged, DEMO, Conditions(folder, "max")).run())
        assert result["ended"]["why"] == "time"
        shutil.rmtree(folder)
        del staged, result
        gc.collect()
        held.append((len(gc.get_objects()), process.num_fds(), process.num_threads()))
        resident.append(process.memory_info().rss / 1e6)
    # What is loaded once is there after the first.
    (objects, *rest), (objects_again, *rest_again) = held[1:]
    assert objects_again < objects + 50, held
    assert rest_again == rest, held
    assert resident[2] < resident[1] + 10.0, resident
