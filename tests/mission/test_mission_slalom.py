"""The mission in which participants of studies are trained: a robot drives through it."""

from __future__ import annotations

import json
from pathlib import Path

from usarsim_mission.match.synthetic import Skill
from usarsim_mission.match.team import Team
from usarsim_mission.match.trial import Conditions, Trial
from usarsim_mission.scenario.reader import find_mission, parse_scenario
from usarsim_mission.scenario.resolving import stage

_ROUTE = (
    "[[1.0, 0.0], [2.4, 1.25], [4.6, -1.25], [6.8, 1.25], [9.0, -1.25], [10.4, -1.1], [11.2, 0.0]]"
)


async def test_through_all_gates(tmp_path: Path) -> None:
    """Four gates in their order without a contact, then both people; each gate is in the log, and
    operators are told where they are."""
    path = find_mission("slalom")
    start = 'start = "RobotStart1"\n'
    drives = f'{start}unattended = "patrol"\nroute = {_ROUTE}\n'
    text = path.read_text(encoding="utf-8")
    scenario = parse_scenario(text.replace(start, drives), path)
    skill = Skill(half_angle_degrees=60.0, reaction=0.3, miss=0.0, error=0.1)
    team = Team("Patrol", synthetic=skill)
    trial = Trial(stage(scenario), team, Conditions(tmp_path / "run", "max"))
    result = await trial.run()
    assert result["ended"]["why"] == "all_found"
    assert result["values"]["K"] == 0
    assert result["values"]["VF"] == 2
    lines = (tmp_path / "run" / "events.jsonl").read_text(encoding="utf-8").splitlines()
    records = [json.loads(line) for line in lines]
    gates = [one["zone"] for one in records if one["kind"] == "zone" and one["enter"]]
    assert gates == ["gate 1", "gate 2", "gate 3", "gate 4"]
    told = [one["text"] for one in records if one["kind"] == "inject"]
    assert told == ["Two gates to go", "Two people are here: mark both"]
