"""Conditions of a trial: what they change of a mission, and what operators may do by them."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from usarsim_mission.errors import MissionError
from usarsim_mission.match.conditions import Conditions
from usarsim_mission.scenario.policies import POLICY_GROUP, policies
from usarsim_mission.scenario.reader import parse_scenario
from usarsim_mission.scenario.resolving import stage

_MISSION = """
schema = "usar-mission/1"
title = "Three robots"
world = "empty"
[[robot]]
name = "R1"
position = [0.0, 0.0, 0.25]
unattended = "patrol"
route = [[0.0, 0.0], [3.0, 0.0]]
[[robot]]
name = "R2"
position = [0.0, 2.0, 0.25]
[[robot]]
name = "R3"
position = [0.0, 4.0, 0.25]
[[event]]
name = "R3 fails"
at = 5.0
do = "robot_fails"
robot = "R3"
[[event]]
name = "the end"
at = 200.0
do = "message"
text = "Come back"
"""


def test_policies_are_those_of_the_console() -> None:
    """Files name the same policies as the console has, which what judges a study may not import."""
    console = pytest.importorskip("usarsim_operator.policies")
    assert list(policies()) == console.names()
    assert console.GROUP == POLICY_GROUP


def test_conditions_change_the_robots(tmp_path: Path) -> None:
    """The first so many robots, with one policy: in the log of the mission, too."""
    staged = stage(parse_scenario(_MISSION, tmp_path / "three.toml"))
    assert Conditions(tmp_path).applied(staged) is staged
    two = Conditions(tmp_path, robots=2, unattended="explore").applied(staged)
    assert [(one.entry.name, one.entry.unattended) for one in two.robots] == [
        ("R1", "explore"),
        ("R2", "explore"),
    ]
    again = parse_scenario(two.mission_text(), tmp_path / "again.toml")
    assert again.robots == tuple(one.entry for one in two.robots) == two.scenario.robots
    assert "robot" in tomllib.loads(staged.mission_text())
    one = Conditions(tmp_path, robots=1, unattended="patrol").applied(staged)
    events = parse_scenario(one.mission_text(), tmp_path / "one.toml").events
    assert [event.name for event in events] == ["the end"]
    content = {**(staged.scenario.content or {}), "time_limit": 100.0}
    short = replace(staged, scenario=replace(staged.scenario, time_limit=100.0, content=content))
    events = parse_scenario(short.mission_text(), tmp_path / "short.toml").events
    assert [event.name for event in events] == ["R3 fails"]
    assert one.robots[0].entry.route == ((0.0, 0.0), (3.0, 0.0))


@pytest.mark.parametrize(
    ("conditions", "why"),
    [
        ({"robots": 4}, "has 3 robots, not 4"),
        ({"robots": 0}, "has 3 robots, not 0"),
        ({"split": {"R1": 1, "R9": 2}}, "split: no robot is called R9"),
        ({"robots": 1, "split": {"R2": 2}}, "split: no robot is called R2"),
        ({"device": "mouse"}, "there is no device mouse"),
        ({"unattended": "patrol"}, "R2 is to patrol and has no route"),
    ],
)
def test_conditions_that_cannot_be(tmp_path: Path, conditions: dict[str, object], why: str) -> None:
    staged = stage(parse_scenario(_MISSION, tmp_path / "three.toml"))
    with pytest.raises(MissionError, match=why):
        Conditions(tmp_path, **conditions).applied(staged)  # type: ignore[arg-type]


def test_operators_of_conditions(tmp_path: Path) -> None:
    """The device, whose robot it is; robots of a trial are fixed."""
    allowance = Conditions(tmp_path, device="keyboard", split={"R1": 1, "R2": 2}).allowance
    assert (allowance.device, allowance.split, allowance.fixed) == (
        "keyboard",
        {"R1": 1, "R2": 2},
        True,
    )
    assert Conditions(tmp_path).allowance.device == "any"
