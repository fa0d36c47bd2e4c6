"""Batches: seeds of a list, plans that do not mix, runs that fail, an interruption, going on."""

from __future__ import annotations

import argparse
import contextlib
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_mission.commands.run import seeds_of
from usarsim_mission.errors import MissionError
from usarsim_mission.match.batch import is_whole, put_aside
from usarsim_mission.plan import PLAN, Plan, PlannedTeam, folder_name, read_plan, write_plan
from usarsim_server import cli

_MISSION = """
schema = "usar-mission/1"
title = "A short way"
world = "empty"
time_limit = 3
scoring = "usar-mj-1"
[[robot]]
name = "R1"
class = "P3AT_real"
position = [0.0, 0.0, 0.25]
[[victim]]
name = "MaleVictim_0"
position = [9.0, 0.3, 0.12]
"""


@given(st.lists(st.tuples(st.integers(0, 10**9), st.integers(0, 50)), min_size=1, max_size=5))
def test_seeds_of_a_list(spans: list[tuple[int, int]]) -> None:
    """Spans hold both of their ends."""
    text = ", ".join(f"{first}-{first + more}" if more else str(first) for first, more in spans)
    assert seeds_of(text) == tuple(
        seed for first, more in spans for seed in range(first, first + more + 1)
    )


@pytest.mark.parametrize("text", ["", "a", "3-1", "1-", "-1", "1,,2", "0-99999", "1-2-3", "٣"])
def test_what_is_no_list_of_seeds(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="is no seed"):
        seeds_of(text)


@given(st.text(max_size=40))
def test_a_team_s_folder_stays_where_it_belongs(name: str) -> None:
    """No name leads out of the folder of the batch, or hides there."""
    made = folder_name(name)
    assert Path(made).name == made
    assert not made.startswith(".")


def test_a_plan_grows_and_does_not_mix(tmp_path: Path) -> None:
    """Further teams and seeds are added; another mission, or another file of a team, is refused."""
    a, b = PlannedTeam("A", "1"), PlannedTeam("B", "2")
    write_plan(tmp_path, Plan("maze", "0", teams=(a,), seeds=(1, 2)))
    both = write_plan(tmp_path, Plan("maze", "0", teams=(b, a), seeds=(2, 3)))
    assert read_plan(tmp_path) == both == Plan("maze", "0", teams=(a, b), seeds=(1, 2, 3))
    for other, why in (
        (Plan("hall", "0", teams=(a,)), "another mission"),
        (Plan("maze", "9", teams=(a,)), "this mission as it was"),
        (Plan("maze", "0", teams=(PlannedTeam("A", "3"),)), "team A from another file"),
    ):
        with pytest.raises(MissionError, match=f"{why}.*name another folder"):
            write_plan(tmp_path, other)
    (tmp_path / PLAN).write_text("[]")
    with pytest.raises(MissionError, match="is no plan"):
        read_plan(tmp_path)


def test_what_is_left_of_a_run_is_kept_aside(tmp_path: Path) -> None:
    run = tmp_path / "A-1"
    assert put_aside(run) is None
    for number in (1, 2):
        run.mkdir()
        (run / "events.jsonl").touch()
        assert not is_whole(run)
        assert put_aside(run) == tmp_path / f"A-1.void-{number}"
        assert not run.exists()


def _team(folder: Path, name: str, text: str) -> str:
    (folder / f"{name}.toml").write_text(f"name = {json.dumps(name)}\n{text}\n")
    return f"--team={folder / name}.toml"


def _wait_for(path: Path, text: str, process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline and process.poll() is None:
        with contextlib.suppress(FileNotFoundError):
            if text in path.read_text():
                return
        time.sleep(0.1)
    raise AssertionError(f"no {text} in {path}")


@pytest.mark.slow
def test_a_batch_is_interrupted_and_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """O-45: a team that cannot start does not keep the next run back; Ctrl-C lets that write its
    score, and the same command plays what is missing. The exit codes tell."""
    mission, out = tmp_path / "short.toml", tmp_path / "out"
    mission.write_text(_MISSION)
    ahead = _team(tmp_path, "Ahead", 'policy = "hold"')
    broken = _team(tmp_path, "Broken", 'command = ["./nothing"]')
    words = [sys.executable, "-m", "usarsim_server", "mission", "run", str(mission), "--seeds=1"]
    words += [f"--out={out}", ahead]
    first = subprocess.Popen(
        [*words[:-1], broken, ahead, "--speed=0.1"], text=True, stderr=subprocess.PIPE
    )
    _wait_for(out / "Ahead-1" / "events.jsonl", "trial_start", first)
    first.send_signal(signal.SIGINT)
    _, said = first.communicate(timeout=100)
    assert first.returncode == 1
    assert f"{out / 'Broken-1'}: it did not begin: error: ./nothing: cannot" in said
    assert f"{out / 'Ahead-1'}: was not played" in said
    assert json.loads((out / "Ahead-1" / "score.json").read_text())["ended"]["why"] is None
    assert "not whole" in (out / "Ahead-1" / "report.html").read_text()
    again = subprocess.run([*words, "--speed=max", "--jobs=2"], text=True, capture_output=True)
    assert again.returncode == 0, again.stderr
    assert "BATCH short 1 of 1 played, 0 failed" in again.stdout
    assert is_whole(out / "Ahead-1")
    aside = out / "Ahead-1.void-1"
    assert cli.main(["mission", "score", str(aside), "--write"]) == 0
    assert f"{aside}: not whole: it was aborted" in capsys.readouterr().err
    assert "it was aborted (the run was cut off)" in (aside / "report.html").read_text()
    league = json.loads((out / "league.json").read_text())
    assert [(one["team"], one["rank"]) for one in league["teams"]] == [
        ("Ahead", 1),
        ("Broken", None),
    ]
    assert cli.main(["mission", "run", str(mission), ahead, "--seeds=1", f"--out={out}"]) == 0
    assert "1 of 1 are done already" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("teams", "more", "why"),
    [
        (["wait = true"], ["--jobs=2"], "controllers that you start"),
        (["console = true"], ["--jobs=2", "--console-port=8080"], "several consoles"),
        (["wait = true", "wait = true"], [], "two teams are called"),
        (['command = ["./go"]\nhand_in = "out"'], ["--jobs=2"], "runs hand in to one folder"),
    ],
)
def test_what_a_batch_cannot_be(
    tmp_path: Path, teams: list[str], more: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = []
    for number, text in enumerate(teams):
        (tmp_path / f"{number}.toml").write_text(f'name = "T"\n{text}\n')
        paths.append(f"--team={tmp_path / str(number)}.toml")
    words = ["mission", "run", "rsarsim", *paths, "--seeds=1-2", f"--out={tmp_path / 'out'}"]
    assert cli.main([*words, *more]) == 2
    assert why in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
