"""Worlds, robot files and plug-ins: counted, and the broken ones named."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from usarsim_server.data import data_directory
from usarsim_server.doctor.checks.installation import (
    judge_plugin,
    judge_robots,
    judge_worlds,
)
from usarsim_server.doctor.checks.server import judge_server
from usarsim_server.doctor.isolation import Outcome
from usarsim_server.doctor.registry import Mark
from usarsim_server.doctor.worker import server as try_server
from usarsim_server.settings import Settings


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A folder with one good robot, which extends a shipped one, and two broken ones."""
    (tmp_path / "Good.toml").write_text('extends = "P3AT"\n')
    (tmp_path / "Bad.toml").write_text('extends = "P3AT"\ncolour = 3\n')
    (tmp_path / "Torn.toml").write_text('extends = "P3AT\n')
    return tmp_path


def test_all_broken_robot_files_are_named(own: Path) -> None:
    """Each has a line of its own, though the server would stop at the first; good ones count."""
    count, *broken = judge_robots([data_directory("robots"), own])
    assert [finding.subject for finding in broken] == ["Bad.toml", "Torn.toml"]
    assert {finding.mark for finding in broken} == {Mark.PROBLEM}
    assert "unknown key 'colour'" in broken[0].text
    assert "known are: name, extends" in (broken[0].advice or "")
    shipped = len(list(data_directory("robots").glob("*.toml")))
    assert count.values == {"shipped": shipped, "own": 1, "broken": 2}
    assert count.mark is Mark.OK


def test_two_robots_with_one_name_are_found_out(tmp_path: Path) -> None:
    """Files that are good for themselves may still claim the same alias."""
    for name in ("One", "Two"):
        (tmp_path / f"{name}.toml").write_text('extends = "P3AT"\naliases = ["Mine"]\n')
    _, clash = judge_robots([data_directory("robots"), tmp_path])
    assert clash.mark is Mark.PROBLEM
    assert "'Mine' is also a name in" in clash.text


def test_worlds_are_counted_and_broken_ones_named(tmp_path: Path) -> None:
    """A world that cannot be read costs a warning, none at all is a problem."""
    [fine] = judge_worlds(data_directory("worlds"))
    assert "arena" in fine.text
    [none] = judge_worlds(tmp_path)
    assert none.mark is Mark.PROBLEM
    (tmp_path / "yard").mkdir()
    (tmp_path / "yard/world.toml").write_text("")
    _, broken = judge_worlds(tmp_path)
    assert (broken.subject, broken.mark) == ("yard", Mark.WARNING)
    assert "scene.xml: file is missing" in broken.text


def test_plug_ins_that_cannot_be_loaded_are_warnings() -> None:
    """A plug-in of another package is loaded; whatever it raises stands in one line."""
    group = "usarsim_server.sensors"
    fine = judge_plugin(EntryPoint("Json", "json:loads", group))
    assert (fine.mark, fine.subject) == (Mark.OK, "plug-in Json")
    gone = judge_plugin(EntryPoint("Gone", "json:no_such_thing", group))
    assert gone.mark is Mark.WARNING
    assert "json:no_such_thing cannot be loaded: AttributeError" in gone.text


def test_the_server_is_put_together_and_own_robots_are_tried(tmp_path: Path) -> None:
    """A robot whose sensor does not exist is found out before any client asks for it."""
    (tmp_path / "Good.toml").write_text('extends = "P3AT"\n')
    (tmp_path / "Odd.toml").write_text(
        'extends = "P3AT"\nsensor = [{ type = "Sonnar", name = "S" }]\n'
    )
    settings = Settings(world="empty", robots=(tmp_path,))
    start, good, odd = judge_server(Outcome(try_server(settings, "")))
    assert start.mark is Mark.OK
    assert start.text.endswith("with the world empty")
    assert good.text == "1 of your own can be put into the world"
    assert (odd.subject, odd.mark) == ("Odd", Mark.WARNING)
    assert "unknown sensor type 'Sonnar'" in odd.text
    assert (odd.advice or "").startswith("did you mean Sonar?")


def test_a_server_that_would_not_start_says_why() -> None:
    """An error for users keeps its advice; a defect says of what kind it is."""
    told = Outcome(failure="nowhere: no such world", told=True, advice="known worlds: arena")
    [finding] = judge_server(told)
    assert finding.mark is Mark.PROBLEM
    assert finding.text == "would not start: nowhere: no such world"
    assert finding.advice == "known worlds: arena"
    [defect] = judge_server(Outcome(failure="the process was ended by SIGSEGV"))
    assert defect.text == "would not start: a defect, the process was ended by SIGSEGV"
