"""Logs of a run: written, cut off, on a full disk, and scored again (O-47, O-55)."""

from __future__ import annotations

import csv
import errno
import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from whole_run import Clock, begin, play

from usarsim_mission import runlog
from usarsim_mission.errors import RunLogError
from usarsim_mission.rescoring import rescore
from usarsim_mission.runlog import EVENTS, TRUTH, RunFolder
from usarsim_mission.scoring import find_rules
from usarsim_server.cli import main


def copy(played: Path, folder: Path) -> Path:
    shutil.copytree(played, folder)
    return folder


def test_records_have_one_numbering_over_both_files(played: Path) -> None:
    records = list(RunFolder(played).records())
    assert [one["seq"] for one in records] == list(range(len(records)))
    assert sum(one["kind"] == "truth" for one in records) == 250
    truth = (played / TRUTH).read_text().splitlines()
    assert all(json.loads(line)["kind"] == "truth" for line in truth)
    assert "NaN" not in (played / TRUTH).read_text()
    assert not (played / ".reserve").exists()


def test_scored_again_a_run_has_the_same_score(
    played: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """O-47: every verdict in the log, and score.json, from the logs alone."""
    live = json.loads((played / "score.json").read_text())
    values = live["values"]
    assert (values["VF"], values["VC"], values["FM"], values["K"]) == (2, 1, 1, 1)
    assert values["A"] > 0.9
    assert values["M"] == 1.0
    assert live["ended"] == {"why": "operator", "t_sim": 25.0, "began": 0.0}
    found = rescore(played)
    assert (found.differences, found.damage) == ([], [])
    assert found.result == live
    assert main(["mission", "score", str(played), "--json"]) == 0
    assert capsys.readouterr().out == (played / "score.json").read_text()
    assert main(["mission", "score", str(played)]) == 0
    assert "equals score.json" in capsys.readouterr().out


def test_where_the_score_differs_is_told(
    played: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """O-47: a log whose mark was moved, a verdict that was changed, a score that was."""
    folder = copy(played, tmp_path / "run")
    lines = (folder / EVENTS).read_text().splitlines()
    found = next(n for n, line in enumerate(lines) if '"kind":"found"' in line)
    lines[found] = lines[found].replace("Anna", "Carl")
    score = json.loads((folder / "score.json").read_text())
    score["values"]["VC"] = 2
    (folder / "score.json").write_text(json.dumps(score))
    (folder / EVENTS).write_text("\n".join(lines) + "\n")
    number = json.loads(lines[found])["seq"]
    assert rescore(folder).differences == [
        f'record {number}: victim: "Carl" in the log, "Anna" now',
        "score.json: values: VC: 2 in the log, 1.0 now",
    ]
    assert main(["mission", "score", str(folder)]) == 1
    said = capsys.readouterr()
    assert "differs from what was told live" in said.out
    assert f'record {number}: victim: "Carl"' in said.err


def test_a_verdict_that_is_missing_or_made_up_is_told(played: Path, tmp_path: Path) -> None:
    """O-47."""
    folder = copy(played, tmp_path / "run")
    lines = (folder / EVENTS).read_text().splitlines()
    wrong = next(n for n, line in enumerate(lines) if '"kind":"wrong"' in line)
    record = json.loads(lines[wrong])
    lines[wrong] = json.dumps({**record, "kind": "bumper"})
    (folder / EVENTS).write_text("\n".join(lines) + "\n")
    (told,) = rescore(folder).differences
    assert told == f"before record {record['seq']}: the log has no wrong (3) at 17 s"
    lines[wrong] = json.dumps({**record, "kind": "lost", "robot": "R1", "why": "x"})
    (folder / EVENTS).write_text("\n".join(lines) + "\n")
    assert any("kind" in told for told in rescore(folder).differences)


def test_two_runs_of_the_same_inputs_have_the_same_credits_and_score(
    played: Path, tmp_path: Path
) -> None:
    """O-55: to the byte."""
    run = begin(tmp_path / "again")
    play(run)
    run.close()
    for name in (EVENTS, TRUTH, "score.json", "state.csv", "world.json", "scoring.toml"):
        assert (tmp_path / "again" / name).read_bytes() == (played / name).read_bytes()


def test_a_file_cut_off_in_its_last_line_is_read_up_to_there(
    played: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = copy(played, tmp_path / "run")
    (folder / "score.json").unlink()
    data = (folder / TRUTH).read_bytes()
    (folder / TRUTH).write_bytes(data[:-20])
    found = rescore(folder)
    assert found.damage == ["truth.jsonl: the last line is cut off", "1 records are missing"]
    assert found.result["values"]["VF"] == 2
    assert main(["mission", "score", str(folder)]) == 0
    assert "the last line is cut off" in capsys.readouterr().err


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(0.0, 1.0), st.booleans())
def test_wherever_it_is_cut_it_is_read_up_to_there(
    played: Path, tmp_path: Path, share: float, truth: bool
) -> None:
    run = RunFolder(played)
    name = TRUTH if truth else EVENTS
    data = (played / name).read_bytes()
    cut = data[: round(share * len(data))]
    folder = tmp_path / "cut"
    folder.mkdir(exist_ok=True)
    for other in (EVENTS, TRUTH):
        (folder / other).write_bytes(cut if other == name else (played / other).read_bytes())
    part = RunFolder(folder)
    kept = [one for one in part.records() if (one["kind"] == "truth") == truth]
    assert len(kept) == cut.count(b"\n")
    assert bool(part.cut) == (not cut.endswith(b"\n") and cut != b"")
    whole = [one for one in run.records() if (one["kind"] == "truth") == truth]
    assert kept == whole[: len(kept)]


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda lines: [lines[0], "{", *lines[1:]], "line 2: is no record"),
        (lambda lines: [lines[0], "[]", *lines[1:]], "line 2: is no record"),
        (lambda lines: [lines[1], lines[0], *lines[2:]], "line 2: the number goes back"),
        (lambda lines: ['{"seq":2,"kind":"x"}', *lines[2:]], "two records have number 2"),
    ],
)
def test_damage_in_the_middle_is_refused(
    played: Path, tmp_path: Path, change: Any, problem: str
) -> None:
    folder = copy(played, tmp_path / "run")
    lines = (folder / EVENTS).read_text().splitlines()
    (folder / EVENTS).write_text("\n".join(change(lines)) + "\n")
    with pytest.raises(RunLogError) as refusal:
        rescore(folder)
    assert problem in str(refusal.value)


def test_what_is_no_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mission", "score", str(tmp_path)]) == 2
    assert "is no run (name the folder of a run" in capsys.readouterr().err


def test_a_folder_with_logs_is_not_written_over(played: Path) -> None:
    before = (played / "mission.toml").read_bytes()
    with pytest.raises(RunLogError, match="has the logs of another run"):
        begin(played)
    assert (played / "mission.toml").read_bytes() == before


def test_lines_are_written_once_a_second_and_answers_at_once(tmp_path: Path) -> None:
    clock = Clock()
    run = begin(tmp_path / "run", clock)
    events = tmp_path / "run" / EVENTS
    run.tell("session", 0.0, robots=[])
    lines = events.read_text().count("\n")
    clock.now += 0.5
    run.tell("select", 0.5, page=1, robot="R1")
    assert events.read_text().count("\n") == lines
    clock.now += 0.5
    run.tell("select", 0.9, page=1, robot="R2")
    assert events.read_text().count("\n") == lines + 2
    run.tell("form", 0.9, answers={"mental": 55})
    assert events.read_text().count("\n") == lines + 3
    assert json.loads(events.read_text().splitlines()[-1])["t_wall"] == 1.0


class FullDisk:
    """Takes so many bytes, and no more until there is room again."""

    def __init__(self, room: int) -> None:
        self.room = room

    def write(self, file: int, data: bytearray) -> int:
        if self.room <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        done = _WRITE(file, data[: self.room])
        self.room -= done
        return done


_WRITE = os.write


def test_a_full_disk_ends_the_trial_and_loses_nothing_once_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It fails in the middle of a line; the reserve is given up, all that was told is kept."""
    run = begin(tmp_path / "run")
    disk = FullDisk(30_000)
    monkeypatch.setattr(runlog.os, "write", disk.write)
    play(run)
    assert run.log.trouble == "No space left on device"
    assert not (tmp_path / "run" / ".reserve").exists()
    disk.room = 1 << 30
    result = run.close()
    assert result["ended"]["why"] == "error"
    records = list(RunFolder(tmp_path / "run").records())
    assert [one["seq"] for one in records] == list(range(len(records)))
    (end,) = [one for one in records if one.get("why") == "error"]
    assert end["text"] == "the logs cannot be written: No space left on device"
    found = rescore(tmp_path / "run")
    assert (found.differences, found.damage, found.result) == ([], [], result)


def test_a_disk_that_stays_full_is_an_error_and_events_come_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = begin(tmp_path / "run")
    disk = FullDisk(30_000)
    monkeypatch.setattr(runlog.os, "write", disk.write)
    play(run)
    disk.room = 4_000
    run.tell("form", 25.0, answers={"mental": 55})
    with pytest.raises(RunLogError, match="could not be written: No space left on device"):
        run.close()
    events = (tmp_path / "run" / EVENTS).read_text()
    assert '"answers":{"mental":55}' in events
    assert list(RunFolder(tmp_path / "run").records())
    assert json.loads((tmp_path / "run" / "score.json").read_text())["ended"]["why"] == "error"


def test_state_is_derived_from_both_logs(played: Path) -> None:
    with (played / "state.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 250
    assert rows[0] == {
        "t_sim": "0.1",
        "robot": "R1",
        "x": "1.1",
        "y": "1.0",
        "z": "0.1",
        "roll": "0.0",
        "pitch": "0.0",
        "yaw": "0.0",
        "vx": "1.0",
        "vy": "0.0",
        "vz": "0.0",
        "yaw_rate": "0.0",
        "mode": "stopped",
        "zone": "cellar",
        "signal": "",
        "linked": "1",
        "battery": "0.9",
        "area_team": rows[0]["area_team"],
        "area_base": rows[0]["area_base"],
    }
    assert rows[59]["z"] == ""
    assert (rows[100]["zone"], rows[100]["mode"]) == ("hall", "teleoperated")
    assert float(rows[-1]["area_team"]) > float(rows[0]["area_team"]) > 0.0


def test_rules_survive_their_file(played: Path) -> None:
    assert RunFolder(played).rules() == find_rules("usar-mj-1")[1]
    for name in ("rsarsim", "robocup-2006", "usarsim-scorekeeper"):
        rules = find_rules(name)[1]
        path = played.parent / f"{name}.toml"
        path.write_text(runlog.toml_text(runlog.plain(rules)))
        assert find_rules(str(path))[1] == rules
