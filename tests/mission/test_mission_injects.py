"""Injects of a trial, by its scenario and by a program, at a real server."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

from usarsim_client.scene import TruthRow
from usarsim_mission.match.team import Team
from usarsim_mission.match.trial import Conditions, Trial
from usarsim_mission.scenario.reader import parse_scenario
from usarsim_mission.scenario.resolving import stage

_MISSION = """
schema = "usar-mission/1"
title = "Somebody calls"
world = "empty"
time_limit = 4
[[robot]]
name = "R1"
class = "RescueP2AT"
position = [0.0, 0.0, 0.25]
[[victim]]
name = "Anna"
position = [3.0, 2.0, 0.12]
[[event]]
name = "help"
at = 0.55
do = "victim_calls"
victim = "Anna"
text = "Somebody calls"
[[event]]
name = "fault"
at = 1.0
do = "robot_fails"
robot = "R1"
lasts = 1.0
[[event]]
name = "late"
when = "first_input"
after = 0.5
do = "link_drops"
robot = "R1"
lasts = 0.5
[[event]]
name = "nobody"
at = 3.0
do = "victim_calls"
victim = "Anna"
"""


async def _run(folder: Path) -> list[dict[str, Any]]:
    tasks: list[asyncio.Task[str]] = []

    async def act(row: TruthRow) -> None:
        if row.time >= 2.2 and not tasks:
            tasks.append(asyncio.create_task(trial.inject("message", text="Go on", name="hint")))

    staged = stage(parse_scenario(_MISSION, folder / "calls.toml"))
    conditions = Conditions(folder / "run", "max", meanwhile=act)
    trial = Trial(staged, Team("Nobody", policy="stop"), conditions)
    await trial.run()
    assert [await task for task in tasks] == [""]
    lines = (folder / "run" / "events.jsonl").read_text().splitlines()
    return [json.loads(line) for line in lines]


async def test_injects_of_a_trial(tmp_path: Path) -> None:
    """HRI-17: each within 0.1 simulated s, in the log with its line of the scenario; a victim that
    is made to call is heard by the robot's microphone and by nobody before."""
    records = await _run(tmp_path)
    start = next(one["t_sim"] for one in records if one["kind"] == "trial_start")
    first = next(one["t_sim"] for one in records if one["kind"] == "input") - start
    injects = [one for one in records if one["kind"] == "inject"]
    found = [(one["name"], one["do"], one["t_sim"] - start) for one in injects]
    due = [
        ("help", "victim_calls", 0.55),
        ("fault", "robot_fails", 1.0),
        ("fault", "robot_recovers", 2.0),
        ("hint", "message", first),
        ("late", "link_drops", first + 0.5),
        ("nobody", "victim_calls", 3.0),
        ("late", "link_returns", first + 1.0),
    ]
    assert [one[:2] for one in found] == [one[:2] for one in due]
    assert all(0.0 <= a[2] - b[2] + 1e-6 <= 0.1 + 2e-6 for a, b in zip(found, due, strict=True))
    assert all(one["done"] for one in injects)
    help_ = (
        'name = "help", do = "victim_calls", at = 0.55, victim = "Anna", text = "Somebody calls"'
    )
    assert (injects[0]["line"], injects[0]["by"]) == (help_, "the mission")
    assert (injects[3]["line"], injects[3]["by"]) == ("", "Experimenter")
    heard = [one for one in records if one["kind"] == "sound"]
    assert 0.55 <= heard[0]["t_sim"] - start <= 0.55 + 0.4
    assert heard[0]["robot"] == "R1"
    assert 55.0 < heard[0]["loudness"] < 65.0  # 70 dB at 1 m, 3.6 m away
    states = [(one["kind"], one.get("on"), one.get("state")) for one in records]
    assert states.index(("enable", False, None)) < states.index(("enable", True, None))
    assert ("link", None, "lost") in states
