"""The instruments of the profile: readings of sensors, and threads of a server."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path

import pytest

from usarsim_bench.instruments import readings, teams, threads
from usarsim_bench.instruments.readings import measure
from usarsim_server.testing import PATIENCE, eventually


def test_every_reading_has_a_cost() -> None:
    """Each kind of sensor is there once, with its rays, and its parts add up; dearest first."""
    found = measure("arena", robots=2, rounds=1)
    by_type = {one.type: one for one in found}
    assert len(by_type) == len(found)
    assert {"SICK", "Hokuyo", "Sonar", "INS", "Odometry", "GroundTruth", "GPS"} <= set(by_type)
    assert (by_type["SICK"].count, by_type["Hokuyo"].count) == (181, 228)
    assert by_type["Sonar"].count == 17
    assert by_type["Odometry"].count == 0
    for one in found:
        assert one.whole == pytest.approx(one.rays + one.cast + one.text)
        assert one.text > 0.0
        assert one.alone > 0.0
    assert [one.whole for one in found] == sorted((one.whole for one in found), reverse=True)


def test_readings_are_told_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    """One object per type, with all of its parts."""
    assert readings.main(["--world", "empty", "--robots", "1", "--rounds", "1"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {"type", "count", "rays", "cast", "text", "alone", "whole"} == set(rows[0])
    assert "SICK" in {row["type"] for row in rows}


def test_a_thread_is_known_by_its_name() -> None:
    """What a thread called physics does counts as physics, and as nothing else."""
    begin, stop = threads.look(), threading.Event()

    def work() -> None:
        until = time.thread_time() + 0.2
        while time.thread_time() < until:
            pass
        stop.wait(PATIENCE)

    worker = threading.Thread(target=work, name="physics", daemon=True)
    worker.start()
    assert eventually(lambda: threads.look().spent["physics"] >= begin.spent["physics"] + 0.19)
    seen = threads.look()
    stop.set()
    worker.join(PATIENCE)
    assert seen.spent["drawing"] == begin.spent["drawing"]
    assert seen.moment > begin.moment


def test_a_run_leaves_its_looks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The subcommand gets its own words, its exit code is kept, and the file holds the looks."""
    seen: list[list[str]] = []

    def serve(words: list[str]) -> int:
        seen.append(words)
        assert eventually(lambda: len(taken) >= 2)
        return 3

    taken: list[threads.Look] = []
    look = threads.look

    def note() -> threads.Look:
        taken.append(look())
        return taken[-1]

    monkeypatch.setattr(threads, "PERIOD", 0.01)
    monkeypatch.setattr(threads, "look", note)
    monkeypatch.setattr(threads, "usarsim", serve)
    file = tmp_path / "looks.json"
    assert threads.main([str(file), "serve", "--port", "0"]) == 3
    assert seen == [["serve", "--port", "0"]]
    looks = json.loads(file.read_text())
    assert len(looks) >= 2
    assert [one["moment"] for one in looks] == sorted(one["moment"] for one in looks)
    assert {"physics", "reports", "sockets", "drawing", "encoding", "others"} == set(
        looks[0]["spent"]
    )


def test_teams_in_turns(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every team is measured, in order; steps and reports apart."""
    (tmp_path / "Bare.toml").write_text('extends = "P3AT"\nwithout = ["lms200", "GndTruth"]\n')
    work = {"world": "empty", "classes": str(tmp_path), "robots": 2}
    works = [{**work, "robot_class": name} for name in ("P3AT", "Bare")]
    works.append({**work, "robot_class": "P3AT", "timestep": 0.01, "room": 4})
    file = tmp_path / "works.json"
    file.write_text(json.dumps({"works": works, "turns": 2, "seed": 1}))
    assert teams.main([str(file)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [set(one) for one in told] == [{"physics", "reports"}] * 3
    assert all(one["physics"] > 0.0 and one["reports"] > 0.0 for one in told)
