"""Logs run again: the same history out of the agent log; MRESim's logs of both forms."""

from dataclasses import replace
from pathlib import Path

import pytest
from small_world import ROOMS, small

from usarsim_exploration import run_folder
from usarsim_exploration.history import cells, digits
from usarsim_exploration.log_files import agents_csv, read_history, steps_csv
from usarsim_exploration.radio import Circle
from usarsim_exploration.replaying import log_of, read_mresim_log, replay
from usarsim_exploration.running import run
from usarsim_server import cli
from usarsim_server.base.errors import UsarsimError


def test_a_run_out_of_its_log(tmp_path: Path) -> None:
    """E-72: positions, roles, states, maps, links: all the same; also bumps, loss and doors."""
    events = [
        {"step": 3, "kind": "close", "cells": [9, 4, 9, 9]},
        {"step": 8, "kind": "loss", "robot": "R2"},
        {"step": 20, "kind": "open", "cells": [9, 4, 9, 9]},
    ]
    scenario = small(tmp_path, "end.base=off", tables={"event": events})
    result = run(scenario)
    run_folder.write(result, tmp_path / "out", {})
    read = read_history(tmp_path / "out", scenario.rules, 0)
    again = replay(scenario, log_of(read))
    assert agents_csv(again.history) == agents_csv(result.history)
    assert again.history.free_base.tolist() == result.history.free_base.tolist()


def test_the_command_tells_differences(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A log that was changed is told by line and column."""
    out = tmp_path / "out"
    run_folder.write(run(small(tmp_path, "end.steps=9", "end.base=off")), out, {})
    assert cli.main(["explore", "replay", str(out)]) == 0
    assert capsys.readouterr().out.endswith(f"{out}: the same\n")
    log = (out / "agents.csv").read_text()
    (out / "agents.csv").write_text(log.replace(",explore,", ",rest,").replace(",R2,", ",R3,"))
    assert cli.main(["explore", "replay", str(out)]) == 1
    assert "agents.csv, line 4: name is R3, not R2" in capsys.readouterr().out
    assert cli.main(["explore", "replay", str(out), "--radio", "sight", "--out", str(out)]) == 0


def test_another_radio(tmp_path: Path) -> None:
    """A replay answers what a better radio would have told the base."""
    scenario = small(tmp_path, "end.base=off", "team.radio=2")
    result = run(scenario)
    far = tuple(replace(one, radio_range=100.0) for one in scenario.team)
    again = replay(replace(scenario, team=far, radio=Circle()), log_of(result.history))
    assert (again.history.cell == result.history.cell).all()
    assert (again.history.free_base == again.history.free_team).all()
    assert again.history.free_base.sum() > result.history.free_base.sum()
    assert steps_csv(again.history) != steps_csv(result.history)


@pytest.mark.parametrize("goal", ["20 5", "20.0 5.0", "20.0 5"])
@pytest.mark.parametrize("spare", ["", " 17"])
def test_logs_of_mresim(tmp_path: Path, spare: str, goal: str) -> None:
    """E-72: 6 and 7 values for each robot, goals as Java writes them; ways lead round walls."""
    places = [((3, 3), (4, 3)), ((8, 3), (4, 5)), ((12, 3), (4, 6)), ((14, 3), (4, 6))]
    lines = []
    for step, (one, other) in enumerate(places):
        robots = (("BaseStation", (3, 3)), ("Explorer", one), ("Relay", other))
        state = "Explore" if step else "Initial"
        lines.append(
            f"{step} " + " ".join(f"{x} {y} {goal} {r} {state}{spare}" for r, (x, y) in robots)
        )
    (tmp_path / "loc.txt").write_text("\n".join(lines) + "\n")
    scenario = small(tmp_path)
    log = read_mresim_log(tmp_path / "loc.txt", scenario.world.environment)
    history = replay(scenario, log).history
    assert history.steps == 3
    for step, (one, other) in enumerate(places):
        assert tuple(history.cell[step, 1]) == one
        assert tuple(history.cell[step, 2]) == other
    assert history.role[-1].tolist() == ["base", "explorer", "relay"]
    assert history.state[1:, 1].tolist() == ["Explore"] * 3
    assert history.goal[1, 1].tolist() == [20, 5]
    assert history.distance[-1, 1] > 5 + 4 + 2  # through the door
    assert history.area[-1, 1] > 100


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("0 3 3 1 1 BaseStation", "line 1: 5 values after the step are not 6 or 7"),
        ("0 3 3 1 1 Chef Initial", "line 1: 6 values"),
        ("x 3 3 1 1 BaseStation Initial", "line 1: 6 values"),
        ("0 3 3 1.5 1 BaseStation Initial", "line 1: 6 values"),
        ("0 0 0 1 1 BaseStation Initial", "line 1: [0, 0] is a wall or outside"),
        ("", "there is no step"),
    ],
)
def test_logs_that_are_none(tmp_path: Path, line: str, told: str) -> None:
    """Line and cure."""
    (tmp_path / "loc.txt").write_text(line)
    with pytest.raises(UsarsimError) as caught:
        read_mresim_log(tmp_path / "loc.txt", small(tmp_path).world.environment)
    assert told in str(caught.value)


def test_a_log_of_another_team(tmp_path: Path) -> None:
    """The numbers of both are told."""
    log = log_of(run(small(tmp_path, "end.steps=2")).history)
    with pytest.raises(UsarsimError, match="the log has 2 robots, the team 3"):
        replay(small(tmp_path, "team.robots=3"), log)


def test_digits_of_moves() -> None:
    """Each digit leads where it came from."""
    way = [(5, 4), (6, 5), (6, 6), (5, 7), (4, 7), (3, 6), (3, 5), (4, 4)]
    assert digits((4, 4), way, (4, 4)) == "01234567"
    assert cells((4, 4), "01234567") == way
    assert digits((4, 4), way, (3, 5)) == "0123456x7"
    assert digits((4, 4), [(9, 9)], (4, 4)) == "x"
    assert ROOMS.count("\n") == 12
