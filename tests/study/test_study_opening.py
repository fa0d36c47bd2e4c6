"""Before a session: the command, the folder that is filled, what is refused before anybody sits."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from desk_pages import STUDY, write_study

from usarsim_mission.match.conditions import Conditions
from usarsim_server import cli
from usarsim_server.base.errors import UsarsimError
from usarsim_study.assignment import Cell
from usarsim_study.session.opening import next_participant, open_folder
from usarsim_study.session.staging import Options, prepare
from usarsim_study.session.steps import Task
from usarsim_study.study_file import find_study, read_study


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What cannot be is one error with its cure, and exit code 2."""
    study = str(write_study(tmp_path / "a"))
    other = tmp_path / "b" / "study.toml"
    other.parent.mkdir()
    other.write_text(STUDY.replace("seed = 5", "seed = 6"))
    for options, problem in (
        (["rsarsim"], "name a folder: --out DIR"),
        ([study, "--out", str(other.parent)], "holds another study"),
        ([study, "--speed", "0"], "--speed: must be a number greater than 0, or max"),
        ([study, "--host", "0.0.0.0"], "name the address by which participants reach"),
        ([study, "--trial-seconds", "0"], "--trial-seconds: must be more than 0"),
        ([study, "--port", "0", "--participant", "B2"], "participant B2 is not there"),
    ):
        assert cli.main(["study", "run", *options]) == 2
        assert problem in capsys.readouterr().err


def test_files_of_a_study_come_along(tmp_path: Path) -> None:
    """A study that is run elsewhere takes its missions and texts with it."""
    home = tmp_path / "home"
    write_study(home)
    (home / "rules.toml").write_text('schema = "usar-score/1"\nname = "mine"\ntotal = "VC"\n')
    mission = (home / "one.toml").read_text().replace("time", 'scoring = "rules.toml"\ntime', 1)
    (home / "one.toml").write_text(mission)
    folder = open_folder(str(home / "study.toml"), tmp_path / "out")
    assert (folder.path / "consent.txt").read_text().startswith("You may")
    assert str(home / "rules.toml") in (folder.path / "one.toml").read_text()
    assert open_folder(str(home / "study.toml"), tmp_path / "out").path == folder.path


def test_a_study_that_has_begun_goes_on_when_its_shipped_file_was_changed(tmp_path: Path) -> None:
    """Named by the shipped study it is refused, and the cure leads on with its own file."""
    path = find_study("rsarsim")
    earlier = path.read_text().replace("Ask whenever something is unclear.", "")
    assert earlier != path.read_text()
    (tmp_path / "study.toml").write_text(earlier)
    code = open_folder(str(tmp_path), None).admit("2026-01-31").code
    with pytest.raises(UsarsimError, match="holds another study") as caught:
        open_folder("rsarsim", tmp_path)
    cure = re.search(r"study run (.+);", str(caught.value))
    assert cure is not None
    with next_participant(open_folder(cure[1], None)) as found:
        assert found.code == code
    assert (tmp_path / "study.toml").read_text() == earlier


@pytest.mark.parametrize(
    ("written", "problem", "cure"),
    [
        ('consent = "gone.txt"', "line 5: consent: gone.txt is not there", "name a text file"),
        (
            'name = "plain"\nrobots = 3',
            "line 8: [[condition]] 1 (plain): robots: one.toml has 2 robots, not 3",
            "a smaller number",
        ),
        (
            'name = "plain"\nimpair = "bad.toml"',
            "line 8: [[condition]] 1 (plain): impair",
            "bad.toml",
        ),
        (
            '[training]\nmission = "one.toml"\nvictims = 2\n[[layout]]',
            "line 12: [training]: victims: one.toml has 1 victims, not 2",
            "a smaller number",
        ),
    ],
)
def test_what_would_break_the_first_session(
    tmp_path: Path, written: str, problem: str, cure: str
) -> None:
    """Nothing begins that a file which is missing or wrong would end (HRI-01)."""
    before = {"consent": 'consent = "consent.txt"', "name": 'name = "plain"'}
    before["[training]"] = "[[layout]]"
    old = before[written.replace("\n", " ").split(" ")[0]]
    write_study(tmp_path, STUDY.replace(old, written, 1))
    with pytest.raises(UsarsimError) as caught:
        open_folder(str(tmp_path / "study.toml"), None)
    assert problem in str(caught.value)
    assert cure in str(caught.value)
    assert not (tmp_path / "allocation.csv").exists()


def test_what_a_condition_changes(tmp_path: Path) -> None:
    """Robots, links, the device, and whose robot it is, as a trial gets them."""
    link = "[link]\ndelay_ms = 200\n"
    more = 'robots = 1\nunattended = "explore"\nimpair = "bad.toml"\ndevice = "gamepad"'
    text = STUDY.replace('name = "plain"', f'name = "plain"\n{more}')
    text = text.replace('name = "delayed"', 'name = "delayed"\noperators = "split"')
    study = read_study(write_study(tmp_path, text))
    (tmp_path / "bad.toml").write_text(link)
    told = Conditions(tmp_path / "run", operators=2)
    task, options = Task("trial", 1, cell=Cell("plain", "B")), Options(seconds=3.0)
    staged, conditions = prepare(study, tmp_path, task, told, options)
    assert [one.entry.name for one in staged.robots] == ["R1"]
    assert staged.robots[0].entry.unattended == "explore"
    assert (staged.scenario.seed, staged.scenario.time_limit) == (4, 3.0)
    assert (conditions.device, conditions.impair) == ("gamepad", tmp_path / "bad.toml")
    assert conditions.split is None
    task = Task("trial", 2, cell=Cell("delayed", "A"))
    staged, conditions = prepare(study, tmp_path, task, told, Options(seconds=9.0))
    assert (len(staged.robots), staged.scenario.time_limit) == (2, 4.0)
    assert conditions.split == {"R1": 1, "R2": 2}
