"""Sweeps: what they run, what comes of it, how long they would take, and which runs differ."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from usarsim_batch.engines import Here
from usarsim_batch.sweep.dry import estimate
from usarsim_batch.sweep.plan import SweepTask, read_plan
from usarsim_batch.tasks import Played
from usarsim_server import cli
from usarsim_server.base.toml import toml_text

EXAMPLE = Path(__file__).parents[2] / "examples" / "sweep"
DRIVER = (EXAMPLE / "drive.py").read_text(encoding="utf-8")
PLAN: dict[str, object] = {
    "serve": {"world": "empty", "lockstep": True, "camera_rate": 5},
    "controller": [
        {"command": ["{python}", "drive.py", "{port}", "{gain}", "{robot}", "{out}"]},
    ],
    "grid": {"gain": [0.1, 3.0]},
}  # fmt: skip


def plan_file(folder: Path, **more: object) -> Path:
    """A sweep in a folder, with its controller."""
    (folder / "drive.py").write_text(DRIVER)
    path = folder / "sweep.toml"
    path.write_text(toml_text({**PLAN, **more}))
    return path


def test_a_sweep(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """BAT-01, BAT-06, BAT-07, BAT-09: servers on ports of their own, side by side; results, exit
    codes, logs; what each was played with; and which runs of two folders differ."""
    path, out = plan_file(tmp_path), tmp_path / "out"
    command = ["sweep", str(path), "--out", str(out)]
    assert cli.main([*command, "--jobs", "2", "--watch", "json"]) == 0
    told = capsys.readouterr()
    lines = [json.loads(line) for line in told.out.splitlines()]
    assert [line["over"] for line in lines] == [1, 2]
    assert {"run", "per_minute", "rest_s", "failed"} <= set(lines[0])
    assert "2 runs, 0 failed, 1 with an exit code other than 0" in told.err
    rows = json.loads((out / "result.json").read_text())["runs"]
    assert [row["parameters"]["gain"] for row in rows] == [0.1, 3.0]
    assert [(row["ended"], row["exits"]) for row in rows] == [
        ("controllers", [1]), ("controllers", [0]),
    ]  # fmt: skip
    assert rows[0]["result"]["robot"] == "R1"
    assert 0 < rows[0]["result"]["way"] < 0.1 < rows[1]["result"]["way"]
    table = (out / "results.csv").read_text().splitlines()
    assert table[0] == "run,seed,ended,exits,error,gain,result.way,result.robot"
    assert (out / "files/000001/controller-1.log").read_text().endswith(" m in 2 s\n")
    about = json.loads((out / "runs/000001.json").read_text())["about"]
    assert {"version", "commit", "libraries", "processor", "plan"} <= set(about)
    before = (out / "result.json").read_bytes()
    assert cli.main(command) == 0
    assert "2 of 2 runs are there" in capsys.readouterr().err
    assert (out / "result.json").read_bytes() == before

    other = tmp_path / "other"
    shutil.copytree(out, other)
    run = other / "runs/000002.json"
    run.write_text(run.read_text().replace('"exits": [0]', '"exits": [4]').replace("0.1.0", "9"))
    assert cli.main(["sweep", "diff", str(out), str(out)]) == 0
    assert cli.main(["sweep", "diff", str(out), str(other)]) == 1
    said = capsys.readouterr().out
    assert "gain=3.0 seed=1: exits[0] is 0, then 4" in said
    assert "played with version: '0.1.0', then '9'" in said
    plan_file(tmp_path, title="another")
    (tmp_path / "drive.py").write_text(DRIVER + "\n")
    assert cli.main(command) == 2
    assert "holds runs of another batch: title, files changed" in capsys.readouterr().err


def test_what_fails_and_what_ends(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """BAT-01, BAT-04: no program, one that is killed, a time that is over; each with its log."""
    words = {"label": "sleeps", "code": "print('here', flush=True); import time; time.sleep(99)"}
    kill = {"label": "dies", "code": "print('here'); import os; os.abort()"}
    path = plan_file(
        tmp_path, grid={}, list=[words, kill], end={"simulated": 0.5, "wall": 60.0},
        serve={"world": "empty"},
        controller=[{"command": ["{python}", "-uc", "{code}"]}, {"command": ["true", "{label}"]}],
    )  # fmt: skip
    assert cli.main(["sweep", str(path), "--out", str(tmp_path / "out"), "--jobs", "2"]) == 1
    told = capsys.readouterr().err
    assert "000002: controller 1 was ended by signal 6" in told
    assert "controller-1: here" in told
    rows = json.loads((tmp_path / "out/result.json").read_text())["runs"]
    assert rows[0]["ended"] == "simulated"
    assert rows[0]["exits"] == [None, 0]


def test_points(tmp_path: Path) -> None:
    """BAT-01: a grid, a list and draws, each with each and with each seed."""
    path = plan_file(
        tmp_path, seeds=[3, 9], list=[{"world": "arena"}, {"world": "empty", "timestep": 0.002}],
        random={"count": 5, "of": {"tick": {"low": 0.1, "high": 1.0, "log": True}}},
    )  # fmt: skip
    assert len(read_plan(EXAMPLE / "sweep.toml").tasks(tmp_path)) == 8
    tasks = read_plan(path).tasks(tmp_path / "out")
    assert len(tasks) == 2 * (2 * 2 * 5)
    assert len({(str(task.parameters), task.seed) for task in tasks}) == len(tasks)
    assert {task.seed for task in tasks} == {3, 9}
    assert all(0.1 <= float(task.parameters["tick"]) < 1.0 for task in tasks)
    options = tasks[-1].options
    assert {"--world=empty", "--timestep=0.002", "--seed=9", "--port=0"} <= set(options)
    again = read_plan(path).tasks(tmp_path / "out")
    assert [task.parameters for task in again] == [task.parameters for task in tasks]


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"serve": {"wrld": "a"}}, "[serve]: wrld: is no option of `usarsim serve` (did you mean"),
        ({"serve": {"port": 3000}}, "[serve]: port: ports come from the system"),
        ({"serve": {"timestep": 9.0}}, "[serve]: --timestep: 9.0 is out of range"),
        ({"grid": {"gain": 3}}, "[grid]: gain: 3 is not a list"),
        ({"grid": {"gain": [1], "gian": [1]}}, "gian: is no option of `usarsim serve`, and in no"),
        ({"grid": {}}, "controller: nothing is called {gain}"),
        ({"grid": {"gain": [1], "port": [1]}}, "port: is not for a sweep to say"),
        ({"controller": []}, "controller: is missing"),
        ({"random": {"count": 2, "of": {"tick": {"low": 2, "high": 1}}}}, "high: 1 is out of"),
        ({"end": {"sim": 3}}, "[end]: sim: unknown key"),
    ],
)
def test_what_is_wrong_with_a_file(
    more: dict[str, object], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, exit code 2, and no folder of results."""
    path = plan_file(tmp_path, **more)
    assert cli.main(["sweep", str(path), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.startswith(f"error: {path}: ")
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_an_estimate_is_measured(tmp_path: Path) -> None:
    """BAT-01: hours of a sweep whose runs take different times, less than 30 % off."""
    path = plan_file(tmp_path, seeds=40)

    def play(task: SweepTask) -> Played:
        return Played(task.facts(), {"wall_s": takes(task)})

    def takes(task: SweepTask) -> float:
        return 100 + 20 * float(task.parameters["gain"]) + task.seed % 5

    plan = read_plan(path)
    true = sum(map(takes, plan.tasks(tmp_path))) / 4 / 3600
    said = estimate(play, plan, Here(), 4)
    assert f"{path}: 80 runs, about " in said
    assert float(said.split("about ")[1].split()[0]) == pytest.approx(true, rel=0.3)


@pytest.mark.slow
def test_slurm_by_its_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """BAT-02: the tasks of the script, run by a shell, come to the bytes that processes come to."""
    path = tmp_path / "batch.toml"
    path.write_text('environments = ["office"]\nteams = [1]\nseeds = 4\n[end]\nsteps = 3\n')
    out = tmp_path / "out"
    command = ["explore", "bench", str(path), "--out"]
    slurm = [*command, str(out), "--cluster", "slurm://", "--jobs", "2"]
    assert cli.main(slurm) == 0
    script = out / "slurm.sh"
    assert f"plays 4 runs: sbatch {script}" in capsys.readouterr().out
    assert not (out / "result.json").exists()
    text = script.read_text()
    assert "--array=0,1 " in text
    told = {**os.environ, "SLURM_ARRAY_TASK_ID": "0"}
    subprocess.run(["sh", str(script)], env=told, check=True, capture_output=True)
    assert cli.main(slurm) == 0
    assert "--array=1 " in script.read_text()
    assert cli.main([*command, str(out), "--jobs", "0", "--part", "1/2"]) == 0
    assert not (out / "result.json").exists()
    assert cli.main(slurm) == 0
    assert cli.main([*command, str(tmp_path / "here"), "--jobs", "0"]) == 0
    assert (out / "result.json").read_bytes() == (tmp_path / "here/result.json").read_bytes()
