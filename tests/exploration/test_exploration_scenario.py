"""Scenarios: what a file may say, and one error for what it may not."""

import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_world import small

from usarsim_exploration.run_folder import portable
from usarsim_exploration.scenario import merge, read
from usarsim_exploration.strategy_file import split
from usarsim_server import cli
from usarsim_server.base.errors import UsarsimError

MINE = """
from dataclasses import dataclass
from usarsim_exploration.strategy import Plan, Strategy, View
from usarsim_server.base.fields import field

@dataclass
class Still(Strategy):
    patience: int = field(default=3, low=1, high=9, help="steps")
    formation = "chain"

    def decide(self, view: View) -> Plan:
        return Plan([], "wait", home=view.step >= self.patience)
"""


def test_robots_of_their_own(tmp_path: Path) -> None:
    """E-10: speed, field of view and ranges for each robot; what is absent is the team's."""
    robots = [
        {"name": "Fast", "speed": 4.5, "view": 90.0, "start": [5, 6], "heading": 90.0},
        {"reach": 3, "radio": 9.0, "role": "relay", "parent": "Fast", "child": "Fast"},
    ]
    tables = {"robot": robots, "team": {"base": [2, 2], "speed": 2.0, "base_radio": 7.0}}
    base, fast, other = small(tmp_path, tables=tables).team
    assert (base.name, base.cell, base.radio_range, base.reach) == ("Base", (2, 2), 7.0, 0)
    assert (fast.speed, fast.view, fast.cell) == (4.5, math.pi / 2, (5, 6))
    assert fast.heading == math.pi / 2
    assert (fast.reach, fast.radio_range, fast.parent) == (100, 200.0, 0)
    assert (other.name, other.speed, other.reach, other.radio_range) == ("R2", 2.0, 3, 9.0)
    assert (other.role, other.parent, other.child) == ("relay", 1, 1)


def test_formations(tmp_path: Path) -> None:
    """Who reports to whom."""
    found = {}
    for formation in ("explorers", "pairs", "chain"):
        options = f"team.formation={formation}", "team.robots=3"
        team = small(tmp_path, *options).team[1:]
        found[formation] = [(one.role[:1], one.parent, one.child) for one in team]
    assert found["explorers"] == [("e", 0, None)] * 3
    assert found["pairs"] == [("r", 0, 2), ("e", 1, None), ("e", 0, None)]
    assert found["chain"] == [("r", 0, 2), ("r", 1, 3), ("e", 2, None)]


def test_a_strategy_out_of_a_file(tmp_path: Path) -> None:
    """`FILE.py:CLASS`; its parameters are keys, its formation the team's, its file goes along."""
    (tmp_path / "mine.py").write_text(MINE)
    arguments = ["--strategy", "mine.py:Still", "--set", "strategy.patience=2"]
    scenario = small(tmp_path, "strategy.name=mine.py:Still", "strategy.patience=2")
    assert [one.role for one in scenario.team] == ["base", "relay", "explorer"]
    out = tmp_path / "out"
    file = str(tmp_path / "small.toml")
    assert cli.main(["explore", "run", file, *arguments, "--out", str(out)]) == 0
    assert (out / "mine.py").read_text() == MINE
    assert 'name = "mine.py:Still"\npatience = 2' in (out / "scenario.toml").read_text()
    assert cli.main(["explore", "run", str(out / "scenario.toml")]) == 0


@pytest.mark.parametrize(
    ("option", "told"),
    [
        ("team.sped=3", "[team]: sped: unknown key (did you mean speed?"),
        ("team.robots=0", "[team]: robots: 0 is out of range"),
        ("team.robots=many", "[team]: robots: 'many' is not a whole number"),
        ("team.base=[0, 0]", "[team]: base: [0, 0] is a wall or outside"),
        ("team.base=[90, 2]", "[team]: base: [90, 2] is a wall or outside"),
        ("seed=-1", "seed: -1 is out of range"),
        ("strategy.name=fronteer", "[strategy]: name: 'fronteer' is not known (did you mean front"),
        ("strategy.replan=0", "[strategy]: replan: 0 is out of range"),
        ("strategy.colour=3", "[strategy]: colour: unknown key"),
        ("radio.model=smoke", "[radio]: model: 'smoke' is not known"),
        ("radio.walls=2", "[radio]: walls: unknown key"),
        ("end.base=0", "[end]: base: 0 is out of range"),
        ("environment.name=nowhere", "nowhere: no such"),
        ("environment.generator=igloo", "[environment]: generator: 'igloo' is not known"),
        ("environment.generator=maze", "name: means nothing beside a generator"),
        ("environment.rooms=40", "[environment]: rooms: unknown key"),
        ("environment.name=other.png", "other.png: no such"),
        ("strategy.name=other.py:Mine", "other.py: no such file (write FILE.py:CLASS)"),
        ("robots=4", "robots: unknown key (write it in [team])"),
        ("nothing", "options: 'nothing' sets nothing (write TABLE.KEY=VALUE"),
        ("seed.low=1", "options: 'seed' is no table"),
    ],
)
def test_wrong_options(tmp_path: Path, option: str, told: str) -> None:
    """One error that names place and cure."""
    with pytest.raises(UsarsimError) as caught:
        small(tmp_path, "seed=1", option)
    assert told in str(caught.value)
    assert str(caught.value).endswith(")")


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        ({"robot": [{"start": [0, 0]}, {}]}, "[[robot]] 1: start: [0, 0] is a wall or outside"),
        ({"robot": [{"name": "A"}, {"name": "A"}]}, "[[robot]] 2 (A): name: 'A' is taken"),
        ({"robot": [{"parent": "R7"}, {}]}, "[[robot]] 1: parent: 'R7' is not known"),
        ({"robot": [{"role": "base"}, {}]}, "[[robot]] 1: role: 'base' is not known"),
        ({"robot": [{"colour": 1}, {}]}, "[[robot]] 1: colour: unknown key"),
        ({"robot": [{}], "team": {"robots": 2}}, "robots: 2 are announced, 1 are described"),
        ({"event": [{"kind": "loss", "step": 1}]}, "[[event]] 1: robot: is missing"),
        ({"event": [{"kind": "loss", "step": 1, "robot": "X"}]}, "robot: 'X' is not known"),
        ({"event": [{"kind": "close", "step": 1}]}, "[[event]] 1: cells: is missing"),
        ({"event": [{"kind": "close", "step": 1, "cells": [5, 5, 4, 5]}]}, "is no rectangle"),
        ({"event": [{"kind": "close", "step": 1, "cells": [5, 5, 30, 5]}]}, "is no rectangle"),
        ({"event": [{"kind": "loss", "step": 0, "robot": "R1"}]}, "step: 0 is out of range"),
        ({"weather": {"rain": 1}}, "weather: unknown key"),
    ],
)
def test_wrong_tables(tmp_path: Path, tables: dict[str, object], told: str) -> None:
    """E-09: a start in a wall and the like are told before the run."""
    with pytest.raises(UsarsimError) as caught:
        small(tmp_path, tables=tables)
    assert str(caught.value).startswith(str(tmp_path / "small.toml"))
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("class A", "line 1: SyntaxError"),
        ("x = 1\ny = x / 0", "line 2: ZeroDivisionError"),
        ("x = 1", "there is no strategy 'Still'"),
        (MINE.replace("@dataclass\n", ""), "it is no dataclass"),
    ],
)
def test_strategy_files_that_are_none(tmp_path: Path, text: str, told: str) -> None:
    """Named with file and line."""
    (tmp_path / "mine.py").write_text(text)
    with pytest.raises(UsarsimError) as caught:
        small(tmp_path, "strategy.name=mine.py:Still")
    assert str(caught.value).startswith(f"{tmp_path / 'mine.py'}: ")
    assert told in str(caught.value)


def test_nothing_is_written_for_a_wrong_scenario(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2 and one line."""
    out = tmp_path / "out"
    assert cli.main(["explore", "run", "--world", "ofice", "--out", str(out)]) == 2
    assert not out.exists()
    told = capsys.readouterr().err
    assert "did you mean 'office'?" in told
    assert told.count("\n") == 1
    (tmp_path / "file").touch()
    small(tmp_path)
    run = ["explore", "run", str(tmp_path / "small.toml"), "--out", str(tmp_path / "file" / "x")]
    assert cli.main(run) == 2
    assert "cannot be made: Not a directory" in capsys.readouterr().err


def test_a_generated_world() -> None:
    """The same seed, the same cells; another one, others; the recipe is what results tell."""
    one, same, other = (
        read({"environment": {"generator": "maze", "columns": 120, "rows": 110, "seed": seed}})
        for seed in (5, 5, 6)
    )
    assert one.world.environment.shape == (110, 120)
    assert (one.world.environment.walls == same.world.environment.walls).all()
    assert (one.world.environment.walls != other.world.environment.walls).any()
    assert one.world.environment.name == "maze-5"
    assert portable(one)["environment"] == one.content["environment"]


def test_a_scenario_needs_a_world() -> None:
    """The one key without default."""
    with pytest.raises(UsarsimError, match=r"options: .environment.: name: is missing"):
        read({})


@settings(max_examples=20, deadline=None)
@given(st.text(max_size=30), st.text(max_size=30))
def test_any_option(key: str, value: str) -> None:
    """Options are read or refused; what is written before stays."""
    before = {"team": {"robots": 2}, "seed": 1}
    try:
        found = merge(before, [f"{key}={value}"])
    except UsarsimError:
        found = merge(before, [])
    assert set(found) >= set(before)
    assert before == {"team": {"robots": 2}, "seed": 1}
    split(key)
