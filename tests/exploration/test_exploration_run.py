"""Runs: how they end, that they repeat, what happens from outside, and their files."""

import hashlib
import json
import math
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from small_world import ROOMS, SEALED, small

from usarsim_exploration import run_folder
from usarsim_exploration.ending import End
from usarsim_exploration.environment import Cell
from usarsim_exploration.events import Event, Fate, change
from usarsim_exploration.known_map import FELT, FREE, SAFE, WALL
from usarsim_exploration.log_files import (
    ROBOT_COLUMNS,
    SHARE_COLUMNS,
    TEAM_COLUMNS,
    agents_csv,
    read_history,
)
from usarsim_exploration.log_files import steps_csv as data_log
from usarsim_exploration.measures import measure
from usarsim_exploration.rules import TODAY
from usarsim_exploration.running import Run, run
from usarsim_exploration.scenario import load
from usarsim_exploration.strategy import Plan, Strategy, View
from usarsim_server import cli


def test_ends_by_steps(tmp_path: Path) -> None:
    """E-17: no rule held before."""
    result = run(small(tmp_path, "end.steps=7", "end.base=off"))
    assert (result.ended, result.history.steps) == ("steps", 7)


def test_ends_when_the_base_knows(tmp_path: Path) -> None:
    """E-17: 60 %, and not a step later than that."""
    result = run(small(tmp_path, "end.base=60"))
    known = 100 * result.history.known_base / result.history.reachable
    assert result.ended == "base knows"
    assert known[-1] >= 60 > known[-2]


def test_ends_when_all_are_home(tmp_path: Path) -> None:
    """E-17: nothing more to find, and no way left to drive."""
    result = run(small(tmp_path, "end.base=off"))
    assert result.ended == "all home"
    assert result.history.steps < 200
    assert result.history.linked_base[-1].all()


def test_who_meets_a_wall_is_not_home_yet(tmp_path: Path) -> None:
    """E-17: on the way home the path is gone for a step, and the run goes on."""
    one = Run(small(tmp_path, "end.base=off"))
    for body in one.cycle.bodies:
        body.home, body.view.blocked, body.found = True, True, 0
    assert one.scenario.end.reason(one.cycle, one.recorder, Fate(())) is None
    one.cycle.bodies[1].view.blocked = one.cycle.bodies[2].view.blocked = False
    assert one.scenario.end.reason(one.cycle, one.recorder, Fate(())) == "all home"


def test_reachable_cells_and_all(tmp_path: Path) -> None:
    """E-18: with a sealed room the share of reachable cells ends the run, that of all does not."""
    options = "end.base=90", "end.home=false", "end.steps=60", "team.base=[20, 3]"
    ours = run(small(tmp_path, *options, picture=SEALED))
    assert ours.ended == "base knows"
    theirs = run(small(tmp_path, *options, "end.of=all", picture=SEALED))
    assert theirs.ended == "steps"
    assert theirs.history.known_base[-1] >= 0.9 * theirs.history.reachable[-1]


def test_links_before_or_after_the_moves(tmp_path: Path) -> None:
    """E-19: who parts in this step still talks if links are those of before."""
    heard = {}
    for links in ("after", "before"):
        one = Run(small(tmp_path, f"links={links}", "team.speed=20", "end.base=off"))
        while one.cycle.links.closed.all():
            one.step()
        heard[links] = one.cycle.step
    assert heard["before"] == heard["after"] + 1


def test_the_same_again(tmp_path: Path) -> None:
    """E-20, EXP-06: equal scenarios give equal bytes; another seed may not be told apart."""
    texts = set()
    for _ in range(2):
        result = run(small(tmp_path))
        texts.add(
            json.dumps(run_folder.facts(result))
            + data_log(result.history)
            + agents_csv(result.history)
        )
    assert len(texts) == 1


@pytest.mark.parametrize(("rules", "digest"), [(1, "5815d3b8d02516b1"), (2, "401354eecd9fade1")])
def test_the_same_on_any_python(tmp_path: Path, rules: int, digest: str) -> None:
    """EXP-06: what Python 3.11 and 3.13 gave by the rules of each number, which never change."""
    options = "strategy.name=nearest", "radio.model=path-loss", f"rules={rules}"
    history = run(small(tmp_path, *options)).history
    text = agents_csv(history) + data_log(history)
    assert hashlib.sha256(text.encode()).hexdigest()[:16] == digest


def test_the_same_in_another_process(tmp_path: Path) -> None:
    """EXP-06: with other hashes of texts, so in another order of sets."""
    small(tmp_path, "seed=1")
    arguments = ["explore", "run", str(tmp_path / "small.toml"), "--strategy", "market", "--out"]
    assert cli.main([*arguments, str(tmp_path / "one")]) == 0
    command = [sys.executable, "-m", "usarsim_server", *arguments, str(tmp_path / "two")]
    subprocess.run(command, check=True, env={**os.environ, "PYTHONHASHSEED": "1"})
    for name in ("run.json", "agents.csv", "steps.csv"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_single_steps_and_reset(tmp_path: Path) -> None:
    """E-21: somebody who looks between steps, goes on, and begins again changes nothing."""
    whole = run(small(tmp_path))
    one = Run(small(tmp_path))
    for _ in range(5):
        one.step()
    assert agents_csv(one.recorder.history()) in agents_csv(whole.history)
    one.reset()
    assert one.recorder.history().steps == 0
    while one.step():
        one.recorder.history()
    assert not one.step()
    assert agents_csv(one.result().history) == agents_csv(whole.history)
    assert data_log(one.result().history) == data_log(whole.history)


def test_a_robot_fails(tmp_path: Path) -> None:
    """E-82, EXP-17: the other one finishes; results name who was lost, and when."""
    loss = {"step": 5, "kind": "loss", "robot": "R2"}
    result = run(small(tmp_path, "end.base=off", tables={"event": [loss]}))
    facts = run_folder.facts(result)
    assert result.ended == "all home"
    assert facts["events"] == [{"step": 5, "event": "loss R2"}]
    assert facts["measures"]["lost"] == ["R2"]  # type: ignore[index]
    assert result.history.works[:5, 2].all()
    assert not result.history.works[5:, 2].any()
    assert (result.history.cell[5:, 2] == result.history.cell[5, 2]).all()
    assert not result.history.linked_base[5:, 2].any()
    assert result.history.known_team[-1] >= 0.9 * result.history.reachable[-1]


def test_an_empty_battery(tmp_path: Path) -> None:
    """EXP-17: it stops in the step in which the battery is empty; nobody left ends the run."""
    events = [{"step": 1, "kind": "battery", "robot": f"R{n}", "distance": 6.0} for n in (1, 2)]
    result = run(small(tmp_path, tables={"event": events}))
    assert result.ended == "all lost"
    assert (result.history.distance[-1, 1:] < 6 + 2).all()
    assert (result.history.distance[-1, 1:] >= 6).all()
    assert sorted(what for _, what in result.events)[2:] == ["empty R1", "empty R2"]


def test_a_door_closes_and_opens(tmp_path: Path) -> None:
    """EXP-17: behind a closed door nobody finds anything; behind an open one they do."""
    door = {"kind": "close", "cells": [13, 4, 13, 6], "step": 1}
    shut = run(small(tmp_path, "end.base=off", tables={"event": [door]}))
    assert shut.ended in ("all home", "steps")
    assert (shut.history.cell[:, 1:, 0] < 13).all()
    again = {"kind": "open", "cells": [13, 4, 13, 6], "step": 2}
    options = "end.base=off", "end.home=false", "end.steps=40"
    both = run(small(tmp_path, *options, tables={"event": [door, again]}))
    assert (both.history.cell[:, 1:, 0] > 13).any()
    assert small(tmp_path).world.environment.walls[5, 13] == 0  # a run changes its own copy


@dataclass
class Across(Strategy):
    """Drives to a cell, by the ways that it knows."""

    goal: Cell

    def decide(self, view: View) -> Plan | None:
        """A new plan where the old one met something."""
        return None if view.path else Plan(view.planner.path(view.cell, self.goal) or [])


@pytest.mark.parametrize("radio", [{}, {"bandwidth": 5000}])
def test_a_closed_door_is_not_talked_away(tmp_path: Path, radio: dict[str, object]) -> None:
    """EXP-17, E-16: who felt that a door is closed is not told by others that it is open."""
    picture = ROOMS.replace(
        "#............#...............#\n" * 2, "#............................#\n" * 2, 1
    )
    scenario = small(tmp_path, "team.radio=99", picture=picture, tables={"radio": radio})
    one = Run(replace(scenario, strategy=Across((20, 6)), end=End(steps=40, base=None)))
    free = np.where(one.cycle.environment.walls == 0, FREE | SAFE, WALL).astype(np.uint8)
    for body in one.cycle.bodies:
        known = body.view.known
        known.write(0, np.arange(free.size), free.reshape(-1))
    change(one.cycle.environment, Event(1, "close", cells=(13, 4, 13, 6)))
    while one.step():
        pass
    assert one.cycle.links.closed.all()
    assert [body.view.cell for body in one.cycle.bodies[1:]] == [(20, 6)] * 2
    felt = [body.view.known.bits[4:7, 13] & FELT != 0 for body in one.cycle.bodies]
    assert felt[0].any()
    assert (felt[0] == felt[1]).all()
    assert (felt[0] == felt[2]).all()


def test_files_of_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """EXP-01, E-73, E-75: one line, all files; the scenario in there gives the same results."""
    small(tmp_path)
    arguments = ["explore", "run", str(tmp_path / "small.toml"), "--seed", "3"]
    assert cli.main([*arguments, "--out", str(tmp_path / "one")]) == 0
    assert "small" not in (line := capsys.readouterr().out)
    assert line.startswith("rooms, 2 robots, frontier, seed 3: base knows after")
    assert line.count("\n") == 1
    again = ["explore", "run", str(tmp_path / "one" / "scenario.toml")]
    assert cli.main([*again, "--out", str(tmp_path / "two")]) == 0
    for name in ("run.json", "steps.csv", "agents.csv", "scenario.toml", "map.png"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    told = json.loads((tmp_path / "one" / "run.json").read_text())
    assert str(tmp_path) not in json.dumps(told)
    assert told["measures"]["team_t90"] <= told["measures"]["base_t90"] <= told["ended"]["step"]
    assert told["environment"]["free"] == ROOMS.count(".")
    heads, *rows = (tmp_path / "one" / "steps.csv").read_text().splitlines()
    columns = len(TEAM_COLUMNS + SHARE_COLUMNS) + 2 * len(ROBOT_COLUMNS)
    assert len(heads.split(",")) == 22 + 10 * 2 == columns
    assert len(rows) == told["ended"]["step"] + 1
    timing = json.loads((tmp_path / "one" / "timing.json").read_text())
    assert set(timing["phases"]) == {"set up", "plan", "sense", "communicate", "record"}
    assert math.isclose(
        sum(one["processor_s"] for one in timing["phases"].values()), timing["processor_s"]
    )
    picture = cv2.imread(str(tmp_path / "one" / "map.png"))
    assert picture.shape == (12 * 16 + 18, 30 * 16, 3)


def test_logs_hold_the_whole_history(tmp_path: Path) -> None:
    """E-72: positions, roles, states and all else come back; measures too."""
    result = run(small(tmp_path, tables={"event": [{"step": 5, "kind": "loss", "robot": "R2"}]}))
    run_folder.write(result, tmp_path / "out", {})
    read = read_history(tmp_path / "out", TODAY, 0)
    for name, value in vars(result.history).items():
        if isinstance(value, np.ndarray):
            assert (getattr(read, name) == value).all(), name
            assert getattr(read, name).dtype.kind == value.dtype.kind, name
    assert all(map(np.array_equal, read.links, result.history.links))
    assert measure(read) == measure(result.history)


def test_time_steps_in_the_data_log(tmp_path: Path) -> None:
    """E-73: sums of the data log against a count by hand."""
    history = run(small(tmp_path)).history
    lines = [line.split(",") for line in data_log(history).splitlines()]
    column = lines[0].index("R2_double_sensing")
    hand = 0
    for step in range(history.steps + 1):
        hand += int(history.found[step, 2] > history.first[step, 2])
        assert lines[step + 1][column] == str(hand)
    assert lines[-1][lines[0].index("robot_steps")] == str(2 * (history.steps + 1))


def test_the_scenario_of_a_run_is_one(tmp_path: Path) -> None:
    """What is written to the folder reads as the same scenario."""
    result = run(small(tmp_path, "end.steps=2", "end.base=off"))
    run_folder.write(result, tmp_path / "out", {})
    again = load(tmp_path / "out" / "scenario.toml")
    assert again.team == result.scenario.team
    assert again.end == result.scenario.end
    assert again.strategy == result.scenario.strategy


BARE = """import sys
sys.modules["scipy"] = sys.modules["numba"] = None
from usarsim_server import cli
sys.exit(cli.main(["explore", "run", sys.argv[1], "--strategy", "frontier"])
         or cli.main(["explore", "run", sys.argv[1], "--strategy", "hungarian"]))
"""


def test_most_strategies_need_no_extra(tmp_path: Path) -> None:
    """Without numba and scipy the frontier strategy runs, and another one says what to install."""
    small(tmp_path)
    command = [sys.executable, "-c", BARE, str(tmp_path / "small.toml")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert done.returncode == 2
    assert "2 robots, frontier, seed 1: base knows after" in done.stdout
    assert 'scipy is not installed (pip install "usarsim-server[exploration]")' in done.stderr
    assert "Traceback" not in done.stderr


def test_without_an_environment(capsys: pytest.CaptureFixture[str]) -> None:
    """A run of nothing names the option that is missing, not a key of a file."""
    assert cli.main(["explore", "run", "--strategy", "frontier"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: there is nothing to explore (add --world NAME")
