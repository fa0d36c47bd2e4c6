"""Studies before their first participant: power of planted effects, and faults of protocols."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

pytest.importorskip("scipy")

from usarsim_server.cli import main
from usarsim_study.scripted.simulation import Driven, Plan, faults, power
from usarsim_study.study_file import read_study

STUDY = """\
title = "Slalom by two devices"
seed = 3
participants = 8
primary = "victims_found"
[[condition]]
name = "keyboard"
device = "keyboard"
[[condition]]
name = "gamepad"
device = "gamepad"
[[layout]]
name = "A"
mission = "slalom"
[training]
mission = "slalom"
[[form]]
name = "workload"
kind = "nasa-tlx-weighted"
when = "after_trial"
[[form]]
name = "which"
kind = "preference"
when = "after"
"""


def made(folder: Path, more: str = "") -> Path:
    path = folder / "study.toml"
    path.write_text(STUDY + more)
    return path


def pool(effect: float) -> list[Driven]:
    """Sixteen participants, the second condition better by so many victims or by one more."""
    return [
        Driven(number, trial, name, "A", 9, {"victims_found": 3.0 + number % 4 + more})
        for number in range(1, 17)
        for trial, (name, more) in enumerate(
            (("keyboard", 0.0), ("gamepad", effect + number % 2)), start=1
        )
    ]


def test_a_planted_effect_is_found_and_none_is_not(tmp_path: Path) -> None:
    """HRI-02, HRI-13: with conditions exchanged at random 5 % reject at most, but for chance."""
    study = read_study(made(tmp_path))
    assert power(study, pool(1.0), 8, 300, 1, exchange=False).share > 0.95
    null = power(study, pool(1.0), 8, 2000, 1, exchange=True)
    assert null.share < 0.065
    assert power(study, pool(1.0), 8, 10, 1, exchange=False).dz == pytest.approx(2.9, abs=0.1)


def test_faults_are_found_before_the_first_participant(tmp_path: Path) -> None:
    """Probes after the end, measures that are missing, floors, and layouts that differ."""
    path = made(tmp_path, '[[probe]]\nat = 90\nquestion = "moving"\n')
    study = read_study(path)
    rows = [
        Driven(number, trial, name, layout, 2, {"victims_found": value, "trial_time": 60.0})
        for number in range(1, 9)
        for trial, (name, layout, value) in enumerate(
            (("keyboard", "A", 0.0), ("gamepad", "B", None if number == 8 else 1.0)), start=1
        )
    ]
    found = "\n".join(faults(Plan(path, 0.0, 60.0), study, rows))
    for text in ("probe 1: at 90 s", "missing in 1 of 16", "nobody is found in 50 %", "unequal"):
        assert text in found
    assert "training" not in found


def test_the_command_drives_and_tells(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Quick: four participants in the slalom; the training is passed, everybody is found."""
    path = str(made(tmp_path))
    options = ["--pool", "4", "--repeats", "50", "--jobs", "1"]
    assert main(["study", "simulate", path, *options]) == 1
    out = capsys.readouterr().out
    assert re.search(r"^FAULT everybody is found in \d+ %", out, re.MULTILINE)
    assert "not passed" not in out
    assert main(["study", "simulate", path, "--advantage", "9"]) == 2
    assert "--advantage: must be from 0 to 1.5" in capsys.readouterr().err
