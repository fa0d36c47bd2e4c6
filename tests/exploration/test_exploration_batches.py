"""Batches: they go on, come to the same on any number of workers, and can be verified."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_world import ROOMS, text_map

from usarsim_batch.tasks import differences
from usarsim_exploration.batches import playing
from usarsim_exploration.batches.batch_file import SUITES, Batch, find_batch, read_batch
from usarsim_exploration.batches.playing import play
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.worlds import DRAWS, Draw, draw_places, find
from usarsim_exploration.worlds.world import clearance
from usarsim_server import cli
from usarsim_server.base.toml import toml_text

FAILING = """\
import os
from dataclasses import dataclass
from usarsim_exploration.strategies.frontier import FrontierStrategy
@dataclass
class Fails(FrontierStrategy):
    def decide(self, view):
        if view.step == 3 and view.random.random() < 0.5:
            raise ValueError("no idea")
        return super().decide(view)
"""


def batch_file(folder: Path, **more: object) -> Path:
    """Runs of a few steps in a small world."""
    (folder / "rooms.txt").write_text(text_map(ROOMS))
    (folder / "fails.py").write_text(FAILING)
    content: dict[str, object] = {
        "environments": ["rooms.txt"],
        "teams": [1, {"label": "slow", "robots": 2, "speed": 1.0}],
        "strategies": ["frontier", "ratio"],
        "radios": ["circle"],
        "seeds": 2,
        "team": {"base": "drawn", "speed": 2.0, "reach": 8, "radio": 6.0},
        "end": {"steps": 12},
    }
    path = folder / "batch.toml"
    path.write_text(toml_text(content | more))
    return path


def bench(path: Path, out: Path, *options: str) -> tuple[int, dict[str, Any]]:
    """Exit code and results of `explore bench`."""
    code = cli.main(["explore", "bench", str(path), "--out", str(out), *options])
    return code, json.loads((out / "result.json").read_text())


def test_a_batch_of_ten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """E-76: means, deviations, a row for each run; a run that fails stops no other."""
    path = batch_file(tmp_path, strategies=["frontier", "fails.py:Fails"], teams=[1], seeds=5)
    code, found = bench(path, tmp_path / "out", "--jobs", "0")
    rows = found["runs"]
    failed = [row for row in rows if "error" in row]
    assert code == 1
    assert len(rows) == 10
    assert 0 < len(failed) < 5
    assert {row["error"] for row in failed} == {"ValueError: no idea"}
    told = capsys.readouterr().out.splitlines()
    well = [row["measures"]["distance"] for row in rows if row["strategy"] == "frontier"]
    assert f"{np.mean(well):.4g} ± {np.std(well, ddof=1):.3g} (5)" in told[1]
    assert told[-1].startswith(f"{tmp_path}/out/result.json: 10 runs, {len(failed)} failed")
    timing = (tmp_path / "out" / "timing.csv").read_text().splitlines()
    assert len(timing) == 1 + 10 - len(failed)


@pytest.mark.parametrize(("base", "one"), [([3, 3], True), ("drawn", False)])
def test_seeds_that_draw_nothing_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], base: object, one: bool
) -> None:
    """Runs from fixed starts are the same for each seed: one sample."""
    kit = {"base": base, "speed": 2.0, "reach": 8, "radio": 6.0}
    path = batch_file(tmp_path, team=kit, teams=[1], strategies=["frontier"], seeds=3)
    bench(path, tmp_path / "out", "--jobs", "0")
    told = "rooms.txt/1/frontier/circle: 3 seeds gave the same run, so they are one sample"
    assert (told in capsys.readouterr().out) is one


def test_results_have_the_promised_form(tmp_path: Path) -> None:
    """EXP-20: what a report reads: keys, measures of run.json, curves to the end of the run."""
    _, found = bench(batch_file(tmp_path), tmp_path / "out", "--jobs", "0")
    assert found["format"] == "usarsim-explore-batch/1"
    keys = [
        tuple(row[key] for key in ("environment", "robots", "strategy", "radio", "seed"))
        for row in found["runs"]
    ]
    assert keys == sorted(keys)
    row = found["runs"][0]
    assert keys[0] == ("rooms.txt", 1, "frontier", "circle", 1)
    assert row["ended"] == {"reason": "steps", "step": 12}
    assert row["curves"]["steps"] == [0, 5, 10, 15]
    for who in ("team", "base"):
        last = row["measures"][f"{who}_percent_reachable"] / 100
        assert row["curves"][who][-1] == pytest.approx(last, abs=1e-5)
    assert found["runs"][-1]["team"] == "slow"
    assert len(row["digest"]) == 64


def test_any_number_of_workers(tmp_path: Path) -> None:
    """E-20, EXP-06: the same rows in other processes; the run of one that dies has failed."""
    source = FAILING.replace("view.random.random() < 0.5", "True")
    path = batch_file(tmp_path, strategies=["market", "fails.py:Fails"], teams=[2])
    (tmp_path / "fails.py").write_text(source.replace('raise ValueError("no idea")', "os._exit(3)"))
    code, found = bench(path, tmp_path / "out", "--jobs", "2")
    assert code == 1
    rows = found["runs"]
    assert [row.get("error") for row in rows] == ["its process ended with code 3"] * 2 + [None] * 2
    here = [play(job).row for job in find_batch(str(path)).jobs() if job.strategy == "market"]
    assert rows[2:] == here


def test_goes_on_after_an_interruption(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is over is not run again; Ctrl-C says so; another batch is refused."""
    path = batch_file(tmp_path)
    _, whole = bench(path, tmp_path / "whole", "--jobs", "0")
    jobs = []

    def interrupted(job: Any) -> Any:
        if len(jobs) == 3:
            raise KeyboardInterrupt
        jobs.append(job.key)
        return play(job)

    monkeypatch.setattr(playing, "play", interrupted)
    command = ["explore", "bench", str(path), "--out", str(tmp_path / "out"), "--jobs", "0"]
    assert cli.main(command) == 130
    assert "3 of 8 runs are kept" in capsys.readouterr().out
    assert not (tmp_path / "out" / "result.json").exists()
    torn = tmp_path / "out" / "runs" / f"{jobs[0].replace('/', ',')}.json"
    torn.write_text(torn.read_text()[:100])
    monkeypatch.setattr(playing, "play", lambda job: jobs.append(job.key) or play(job))
    assert cli.main(command) == 0
    assert len(jobs) == 3 + 6
    assert json.loads((tmp_path / "out" / "result.json").read_text()) == whole
    batch_file(tmp_path, seeds=3)
    assert cli.main(command) == 2
    assert "holds runs of another batch: seeds changed (name" in capsys.readouterr().err


def test_verify(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """EXP-21: equal; a forged number is found by a rerun of its run; what is left out is missed."""
    path = batch_file(tmp_path)
    _, found = bench(path, tmp_path / "out", "--jobs", "0")
    result = tmp_path / "out" / "result.json"
    command = ["explore", "verify", str(result), "--jobs", "0", "--files", str(tmp_path)]
    capsys.readouterr()
    assert cli.main([*command, "--part", "25%"]) == 0
    assert "2 of 8 runs again, drawn by --seed " in (told := capsys.readouterr().out)
    assert "2 equal, 0 not\n" in told
    assert "forged alone would be missed with a chance of 75.0%; of 6 forged ones" in told
    key = "rooms.txt/slow/ratio/circle/2"
    found["runs"][-1]["curves"]["base"][1] += 0.001
    result.write_text(json.dumps(found))
    assert cli.main([*command, "--run", key]) == 1
    assert f"{key}: curves.base[1] is 0." in capsys.readouterr().err
    found["runs"][-1] = found["runs"][0]
    result.write_text(json.dumps(found))
    assert cli.main([*command, "--run", "rooms.txt/1/frontier/circle/1"]) == 1
    told = capsys.readouterr().out
    assert f"{key}: is missing" in told
    assert "rooms.txt/1/frontier/circle/1: is no run of this batch, or there twice" in told
    (tmp_path / "rooms.txt").write_text(text_map(ROOMS.replace("##....#", "......#")))
    assert cli.main(command) == 2
    assert "environments (rooms.txt): is no longer the same" in capsys.readouterr().err


def test_a_run_of_a_batch_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By its key; the picture is that of the same run alone."""
    bench(batch_file(tmp_path, seeds=1, teams=[1]), tmp_path / "out", "--jobs", "0")
    command = ["explore", "show", str(tmp_path / "out/result.json"), "--files", str(tmp_path)]
    key, picture = "rooms.txt/1/ratio/circle/1", tmp_path / "one.png"
    assert cli.main([*command, "--run", key, "--out", str(picture)]) == 0
    options = ["--set", "team.base=drawn", "--set", "team.speed=2", "--set", "team.reach=8"]
    alone = ["explore", "run", "--world", str(tmp_path / "rooms.txt"), "--robots", "1", *options]
    alone += ["--strategy", "ratio", "--radio", "circle", "--set", "team.radio=6", "--steps", "12"]
    assert cli.main([*alone, "--out", str(tmp_path / "alone")]) == 0
    other = tmp_path / "other.png"
    assert cli.main(["explore", "show", str(tmp_path / "alone"), "--out", str(other)]) == 0
    assert picture.read_bytes() == other.read_bytes()
    assert cli.main([*command, "--run", f"{key}0", "--out", str(picture)]) == 2
    assert f"there is no run '{key}0' (did you mean '{key}'?)" in capsys.readouterr().err


def test_differences() -> None:
    """EXP-21: a number is not another one, nor absent, nor of another kind."""
    one = {"a": [1, 2], "b": None, "c": 3}
    assert list(differences(one, one)) == []
    other = {"a": [1, 2.5], "b": 0, "c": 3.0}
    assert [place for place, *_ in differences(one, other)] == ["a[1]", "b", "c"]


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"seed": 1}, "seed: unknown key (write seeds = [1])"),
        ({"strategies": ["fronteer"]}, "strategies (fronteer): [strategy]"),
        ({"strategies": []}, "strategies: [] is not a list with at least one entry"),
        ({"teams": [1, {"robots": 1}]}, "teams: two are called '1'"),
        ({"teams": [{"robots": 1, "sped": 2}]}, "teams (1): [team]: sped: unknown key"),
        ({"radios": [{"model": "circle", "label": "a/b"}]}, "cannot name files"),
        ({"seeds": [1, 1]}, "seeds: a seed is there twice"),
        ({"end": {"step": 3}}, "[end]: step: unknown key"),
    ],
)
def test_what_is_wrong_with_a_file(
    more: dict[str, object], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, exit code 2, and no folder of results."""
    path = batch_file(tmp_path, **more)
    out = tmp_path / "out"
    assert cli.main(["explore", "bench", str(path), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.startswith(f"error: {path}: ")
    assert error.count("\n") == 1
    assert not out.exists()


def test_shipped_batches() -> None:
    """EXP-22: the full one has 3,840 runs per strategy; all read as what they resolve to."""
    assert set(SUITES) >= {"full", "quick"}
    assert len(find_batch("full").only(["ratio"]).jobs()) == 12 * 4 * 4 * 20
    for name in SUITES:
        batch: Batch = find_batch(name)
        again = read_batch(batch.resolved(), batch.path)
        assert [job.key for job in again.jobs()] == [job.key for job in batch.jobs()]
    with pytest.raises(ExplorationError, match="did you mean 'quick'"):
        find_batch("quik")


@pytest.mark.parametrize("where", DRAWS)
def test_places_that_the_seed_draws(where: Draw) -> None:
    """EXP-18: free cells of the largest part, others for other seeds, where they should be."""
    world = find("lab")
    reachable = world.environment.reachable(world.base)
    clear = clearance(world.environment.walls)
    drawn = [draw_places(world.environment, world.title, where, seed) for seed in range(20)]
    assert len({one.base for one in drawn}) > 15
    for one in drawn:
        rooms = [clear[row, column] for column, row in (one.base, *one.starts)]
        assert all(reachable[row, column] for column, row in (one.base, *one.starts))
        if where == "drawn at a wall":
            assert rooms == [1] * len(rooms)
        else:
            assert min(rooms) >= 4
    assert drawn[3].base == draw_places(world.environment, "", where, 3).base
