"""Scenario files: what they say, what is refused, with line and cure."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mission_worlds import MISSION, ROBOT, VICTIM, ZONES, write_mission

from usarsim_mission.errors import MissionError
from usarsim_mission.scenario.description import Scenario
from usarsim_mission.scenario.reader import find_mission, parse_scenario, read_scenario
from usarsim_mission.scenario.resolving import stage
from usarsim_server.base.errors import UsarsimError

EVENT = '[[event]]\nname = "e"\n'


def read(text: str) -> Scenario:
    """A scenario that lies nowhere."""
    return parse_scenario(text, Path("m.toml"))


def test_what_a_file_says(tmp_path: Path) -> None:
    """O-01: zones as polygons and rectangles, robots, victims, events."""
    event = EVENT + 'when = "found"\nof = "Ann"\nafter = 5.0\ndo = "robot_fails"\nrobot = "R1"\n'
    scenario = read_scenario(write_mission(tmp_path, ROBOT, VICTIM, ZONES, event))
    assert (scenario.name, scenario.title) == ("test-mission", "Two rooms")
    assert scenario.robots[0].kind == "P3AT_real"
    assert scenario.victims[0].position == (3.0, -2.0, 0.12)
    west, east = scenario.zones
    assert west.corners == ((-6, -3), (0, -3), (0, 3), (-6, 3))
    assert (east.colour, len(east.corners)) == ("yellow", 4)
    assert scenario.events[0].after == 5.0
    assert (scenario.time_limit, scenario.band) == (1200.0, 1.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (MISSION.replace("/1", "/2") + ROBOT, "m.toml: line 1: schema: 'usar-mission/2' is not"),
        ("", 'm.toml: says nothing (begin with schema = "usar-mission/1", title, world and a'),
        ("# to be written\n", "m.toml: says nothing (begin with"),
        (
            MISSION + ROBOT + VICTIM + 'status = "Ded"\n',
            "status: 'Ded' is not known (did you mean Dead? write one of Alive, Injured",
        ),
        (MISSION, "m.toml: robot: there is no robot (add a [[robot]] table"),
        (MISSION + "time_limitt = 3\n" + ROBOT, "line 5: time_limitt: unknown key (did you mean "),
        (MISSION + 'reveal = ["klock"]\n' + ROBOT, "line 5: reveal: 'klock' is not known (did you"),
        (MISSION + ROBOT + 'color = "red"\n', "[[robot]] 1 (R1): color: unknown key"),
        (MISSION + ROBOT + ROBOT, "line 10: [[robot]] 2 (R1): name: 'R1' is already the name of"),
        (MISSION + ROBOT + "position = [1, 2, 3]\n", "position: stands beside start"),
        (MISSION + ROBOT + "yaw_degrees = 3\n", "yaw_degrees: stands without position"),
        (MISSION + ROBOT + 'unattended = "explor"\n', "(did you mean 'explore'?)"),
        (MISSION + ROBOT + "route = [[1, 2]]\n", "is not a list of 2 corners or more"),
        (MISSION + ROBOT + '[[victim]]\nname = "A"\n', "1 victims without a position and 0 places"),
        (MISSION + ROBOT + VICTIM + VICTIM.replace("Ann", "ann"), "'ann' is already the name"),
        (MISSION + ROBOT + ZONES + "x = [0, 1]\n", "(east): polygon: stands beside x or y"),
        (
            MISSION + ROBOT + '[[zone]]\nname = "z"\ncolour = "red"\nx = [0, 1]\n',
            "polygon: is missing (add polygon = [[x, y], ...], or x and y)",
        ),
        (
            MISSION + ROBOT + '[[zone]]\nname = "z"\ncolour = "pink"\nx = [0, 1]\ny = [0, 1]\n',
            "colour: 'pink' is not known",
        ),
        (MISSION + ROBOT + EVENT + 'do = "message"\ntext = "x"\n', "has neither `at` nor `when`"),
        (MISSION + ROBOT + EVENT + 'at = 1.0\ndo = "message"\n', "text: is missing (message wants"),
        (
            MISSION + ROBOT + EVENT + 'at = 1.0\ndo = "robot_fails"\nrobot = "R2"\n',
            "no robot is called 'R2' (write one of R1)",
        ),
        (
            MISSION + ROBOT + EVENT + 'at = 1300.0\ndo = "message"\ntext = "x"\n',
            "1300 s is after the end of the trial",
        ),
        (
            MISSION + ROBOT + EVENT + 'at = 1.0\ncount = 2\ndo = "message"\ntext = "x"\n',
            "count: belongs to `when`",
        ),
        (MISSION + "[video]\njitter_ms = 5.0\n" + ROBOT, "jitter_ms: is more than delay_ms"),
    ],
)
def test_what_is_refused(text: str, said: str) -> None:
    """One error with the line and what to write instead."""
    with pytest.raises(MissionError) as caught:
        read(text)
    assert said in str(caught.value)


@settings(max_examples=150, deadline=None)
@given(st.text(max_size=60), st.integers(0, 400))
def test_damaged_files_end_in_one_error(junk: str, where: int) -> None:
    """Whatever stands in the file, it is read or refused in one line."""
    whole = MISSION + ROBOT + VICTIM + ZONES
    said = "m.toml: "
    try:
        read(whole[:where] + junk + whole[where:])
    except UsarsimError as error:
        said = str(error)
    assert said.startswith("m.toml: ")
    assert "\n" not in said


def test_names(tmp_path: Path) -> None:
    """A path, or a shipped name in any case; a slip is shown the right one."""
    path = write_mission(tmp_path, ROBOT)
    assert find_mission(str(path)) == path
    assert find_mission("ARENA-search").name == "arena-search.toml"
    with pytest.raises(MissionError, match="did you mean arena-search"):
        find_mission("arena-serch")
    with pytest.raises(MissionError, match="no such file"):
        find_mission("nowhere/mission.toml")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (MISSION.replace("rooms", "roms") + ROBOT + VICTIM, "line 3: world: "),
        (MISSION.replace("rsarsim", "rsarsin") + ROBOT + VICTIM, "did you mean 'rsarsim'?"),
        (MISSION + ROBOT.replace("P3AT_real", "P4AT_real") + VICTIM, "no class 'P4AT_real' (did"),
        (MISSION + ROBOT.replace("West", "Wets") + VICTIM, "no start pose 'Wets' (did you mean"),
        (MISSION + ROBOT.replace('start = "West"', "") + VICTIM, "start: is missing (add start"),
        (MISSION + ROBOT + VICTIM + 'moves = "fly"\n', "moves: "),
        (MISSION + ROBOT + VICTIM + "calls = 300.0\n", "calls: "),
        (
            MISSION + ROBOT + VICTIM + EVENT + 'at = 1.0\ndo = "victim_calls"\nvictim = "Anna"\n',
            "nobody is called 'Anna' (did you mean 'Ann'?)",
        ),
        (
            MISSION.replace("world =", "keep_victims = true\nworld =")
            + ROBOT
            + VICTIM.replace("Ann", "Old"),
            "the world has a victim called 'Old'",
        ),
    ],
)
def test_names_that_nobody_has(tmp_path: Path, text: str, said: str) -> None:
    """Of worlds, presets, classes, starts, victims."""
    with pytest.raises(MissionError) as caught:
        stage(read_scenario(write_mission(tmp_path, head=text)))
    assert said in str(caught.value)
    assert ": line " in str(caught.value)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("serch.toml", "looked for {}/serch.toml; did you mean search.toml?"),
        ("deep/down/search.toml", "looked for {}/deep/down/search.toml: there is no {}/deep/down"),
        ("folder.toml", "{}/folder.toml is a folder: name a file in it"),
        ("search.toml/x.toml", "looked for {}/search.toml/x.toml: {}/search.toml is no folder"),
    ],
)
def test_a_path_that_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, said: str
) -> None:
    """It is told where a file was looked for, whole, also where the name was relative."""
    (tmp_path / "search.toml").write_text("")
    (tmp_path / "folder.toml").mkdir()
    monkeypatch.chdir(tmp_path)
    for path in (name, str(tmp_path / name)):
        with pytest.raises(MissionError) as caught:
            find_mission(path)
        assert said.format(tmp_path, tmp_path) in str(caught.value)
