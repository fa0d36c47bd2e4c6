"""Matches: team files, synthetic operators, what a gateway's log becomes, reports, a whole run."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from usarsim_client.truth import truth_row
from usarsim_mission.errors import MissionError
from usarsim_mission.match.injects import Injects
from usarsim_mission.match.scribe import Scribe
from usarsim_mission.match.synthetic import Skill, SyntheticOperator
from usarsim_mission.match.team import read_team
from usarsim_mission.scenario.description import Event
from usarsim_mission.scoring import VictimRules
from usarsim_server.cli import main

_MISSION = """
schema = "usar-mission/1"
title = "One victim ahead"
world = "empty"
time_limit = 40
scoring = "usar-mj-1"
ends_when_all_credited = true
[[robot]]
name = "R1"
class = "P3AT_real"
position = [0.0, 0.0, 0.25]
[[event]]
name = "hello"
at = 2.0
do = "message"
text = "Begin"
[[event]]
name = "silence"
at = 3.0
do = "link_drops"
robot = "R1"
lasts = 3.0
[[victim]]
name = "MaleVictim_0"
position = [9.0, 0.3, 0.12]
"""
_TEAM = """
name = "Straight on"
policy = "hold"
[synthetic]
dwell = 3.0
reaction = 1.0
miss = 0.0
error = 0.1
"""


def _team(folder: Path, text: str) -> Path:
    path = folder / "team.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ('name = "A"', "0 ways to drive"),
        ('name = "A"\nwait = true\npolicy = "explore"', "2 ways to drive"),
        ('name = "A"\npolcy = "explore"', "did you mean policy"),
        ('name = "A"\ncommand = ["run", "{prot}"]', "{prot}"),
        ('name = "A"\nwait = true\n[synthetic]', "stands without policy"),
        ('name = "A', "is not valid TOML"),
        (
            'name = "A"\npolicy = "serch"',
            "line 2: policy: 'serch' is not known (did you",
        ),
        ('name = "A"\nwait = true\nfolder = "gone"', "line 3: folder: 'gone' is no folder"),
        ('name = "A"\nwait = true\n[environment]\n"A=B" = 1', "'A=B' is no name of a variable"),
        ('name = "A"\nwait = true\n[environment]\nA = [1]', "A: [1] is no value of a variable"),
        ("name = " + "[" * 100_000, "nested too deeply"),
        ("name = 1" + "0" * 100_000, "is not valid TOML"),
    ],
)
def test_what_a_team_cannot_be(tmp_path: Path, text: str, why: str) -> None:
    path = _team(tmp_path, text)
    with pytest.raises(MissionError) as found:
        read_team(path)
    assert why in str(found.value)
    assert str(path) in str(found.value)


def test_a_team_file_with_a_byte_order_mark(tmp_path: Path) -> None:
    """Notepad's mark is skipped; UTF-16 is one error."""
    path = tmp_path / "team.toml"
    path.write_bytes('\ufeffname = "Bär"\r\npolicy = "hold"\r\n'.encode())
    assert read_team(path).name == "Bär"
    path.write_bytes('name = "Bär"\n'.encode("utf-16"))
    with pytest.raises(MissionError, match=r"is in UTF-16 \(save the file as UTF-8\)"):
        read_team(path)


def test_a_patrol_needs_routes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A team that patrols a mission without routes is refused before a server is started."""
    path = _team(tmp_path, 'name = "A"\npolicy = "patrol"\n')
    words = ["arena-search", f"--team={path}", f"--out={tmp_path / 'out'}"]
    assert main(["mission", "run", *words]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"error: {path}: policy: ")
    assert "is to patrol and has no route in the mission (add route" in told
    assert not (tmp_path / "out").exists()


def _row(time: float, *views: tuple[str, str, float, float, bool]) -> Any:
    names = ("robot", "victim", "angle", "distance", "clear")
    victims = [{"name": name, "pos": [4.0, 1.0, 0.1]} for name in ("Ada", "Ben")]
    seen = [dict(zip(names, view, strict=True)) for view in views]
    return truth_row({"time": time, "robots": [], "victims": victims, "views": seen})


def _say(
    operator: SyntheticOperator, rows: list[Any], *, avoid: bool = False
) -> list[tuple[float, Any]]:
    """What it says, either of what robots keep clear of or else."""
    said = [(row.time, said) for row in rows for said in operator.see(row)]
    return [one for one in said if (one[1]["type"] == "avoid") == avoid]


def test_robots_keep_clear_of_whom_a_camera_sees() -> None:
    """Once each, also of whom a robot sees that nobody looks at; not behind a wall."""
    views = ("R2", "Ada", 0.1, 3.0, True), ("R1", "Ben", 0.1, 3.0, False)
    rows = [_row(0.1 * one, *views) for one in range(20)]
    said = _say(SyntheticOperator(Skill(), ["R1", "R2"], 7), rows, avoid=True)
    where = {"place": [4.0, -1.0, -0.1], "radius": 0.95}  # the wire's frame; Ada lies
    assert said == [(0.0, {"type": "avoid", "name": "Ada", **where})]


_NEAR = VictimRules(credit="proximity", radius=10.0, sticky=False)


@pytest.mark.parametrize(
    ("rules", "within"),
    [
        (VictimRules(), None),  # a mark stays
        (replace(_NEAR, sticky=True), None),
        (replace(_NEAR, credit="mark"), None),
        (_NEAR, 4.8),  # it has to recognise them
        (replace(_NEAR, radius=2.0), 1.6),
        (replace(_NEAR, pairs=True), 3.333),
        (replace(_NEAR, credit="view"), 4.8),
    ],
)
def test_who_counts_only_while_a_robot_is_near(rules: VictimRules, within: float | None) -> None:
    """The robot that sees somebody is told to stay, one for each, if the rules ask for it; after
    20 s without a sight it is told to stay no more."""
    both = ("R1", "Ada", 0.1, 3.0, True), ("R2", "Ada", 0.1, 4.0, True)
    operator = SyntheticOperator(Skill(miss=1.0), ["R1", "R2"], 7, rules)
    rows = [_row(0.5 * one, *(both if one < 20 else ())) for one in range(80)]
    said = [(time, one) for time, one in _say(operator, rows) if one["type"] != "select"]
    assert {one["robot"] for _, one in said} == ({"R1"} if within else set())
    if within:
        (_, stays), (time, leaves) = said
        assert (stays["name"], stays["within"]) == ("Ada", pytest.approx(within, abs=1e-3))
        assert (time, leaves["name"]) == (30.0, None)  # last seen at 9.5


def test_who_stays_put_is_surer_than_who_walks() -> None:
    """A robot that stays with somebody who walks leaves them for who does not, and not back."""
    operator = SyntheticOperator(Skill(), ["R1"], 7, _NEAR)
    ada, ben = ("R1", "Ada", 0.1, 3.0, True), ("R1", "Ben", 0.1, 4.0, True)
    told = []
    for count in range(30):
        row = _row(0.5 * count, ada, *([ben] if count > 15 else []))
        walks = {"name": "Ada", "pos": [4.0 + 0.3 * count, 1.0, 0.9]}
        row = truth_row({**row.fields, "victims": [walks, row.fields["victims"][1]]})
        told += [one for one in _say(operator, [row]) if one[1]["type"] == "follow"]
    assert [(time, one["name"]) for time, one in told] == [(0.0, "Ada"), (8.0, "Ben")]


def test_in_pairs_each_robot_stays_with_somebody_else() -> None:
    """Where one robot makes several count, the next one searches on; in pairs it stays, too."""
    views = ("R1", "Ada", 0.1, 3.0, True), ("R2", "Ben", 0.1, 4.0, True)
    for pairs in (True, False):
        operator = SyntheticOperator(Skill(), ["R1", "R2"], 7, replace(_NEAR, pairs=pairs))
        row = _row(0.0, *views)
        pose = {"pos": [2.0, 1.0, 0.1], "quat": [1.0, 0.0, 0.0, 0.0], "linear": [0.0] * 3}
        robot = {"name": "R1", **pose, "angular": [0.0] * 3, "battery": None, "contacts": []}
        row = truth_row({**row.fields, "robots": [robot]})
        told = [one for _, one in _say(operator, [row]) if one["type"] == "follow"]
        with_whom = [(one["robot"], one["name"]) for one in told]
        assert with_whom == [("R1", "Ada"), ("R2", "Ben")][: 1 + pairs]


def test_a_synthetic_operator_sees_what_its_robot_shows() -> None:
    """Only the chosen robot's picture counts; a sight that ends too soon is no mark."""
    skill = Skill(dwell=3.0, reaction=1.0, miss=0.0, error=0.0)
    operator = SyntheticOperator(skill, ["R1", "R2"], 7)
    times = [round(0.1 * one, 1) for one in range(60)]
    ada, ben = ("R2", "Ada", 0.1, 3.0, True), ("R1", "Ben", 0.1, 3.0, True)
    rows = [_row(time, ada, *([ben] if time < 0.8 else [])) for time in times]
    said = _say(operator, rows)
    assert [(time, one["type"], one["robot"]) for time, one in said] == [
        (0.0, "select", "R1"),
        (3.0, "select", "R2"),
        (4.0, "mark", "R2"),
    ]
    assert said[-1][1]["place"] == [4.0, -1.0, -0.1]  # the wire's frame


@pytest.mark.parametrize(
    "view",
    [
        ("R1", "Ada", 0.6, 3.0, True),  # 34 degrees off
        ("R1", "Ada", 0.1, 7.0, True),
        ("R1", "Ada", 0.1, 3.0, False),
    ],
)
def test_a_synthetic_operator_does_not_see(view: Any) -> None:
    """Beside the picture, too far, behind a wall."""
    operator = SyntheticOperator(Skill(miss=0.0), ["R1"], 7)
    said = _say(operator, [_row(0.1 * one, view) for one in range(50)])
    assert [one["type"] for _, one in said] == ["select"]


def test_misses_and_errors_come_of_the_seed() -> None:
    """The share of sights in which nobody is recognised; equal seeds say the same."""
    view = "R1", "Ada", 0.1, 3.0, True
    rows = [_row(0.1 * one, view) for one in range(40)]
    skill = Skill(dwell=100.0, miss=0.3, error=0.5)
    marked = [_say(SyntheticOperator(skill, ["R1"], seed), rows) for seed in range(300)]
    missed = sum(len(said) == 1 for said in marked)
    assert 60 < missed < 120
    assert _say(SyntheticOperator(skill, ["R1"], 4), rows) == marked[4]


def test_injects_are_due() -> None:
    """HRI-17: at a time, or so long after the n-th time that something happened; some end."""
    fails = Event("fails", "robot_fails", at=5.0, robot="R1", lasts=2.0)
    late = Event("late", "message", when="enters", of="red", count=2, after=1.0, text="out")
    injects = Injects((fails, late))
    injects.begin(100.0)
    happened = []
    for step in range(100):
        time = 100.0 + 0.1 * step
        if step in (10, 30, 50):
            for enter in (True, False):
                crossing = {"kind": "zone", "t_sim": time, "zone": "red", "enter": enter}
                injects.hear(crossing)
        happened += [(round(time, 1), event.name, event.do) for event in injects.due(time)]
    assert happened == [
        (104.0, "late", "message"),
        (105.0, "fails", "robot_fails"),
    ]


def test_the_scribe_turns_places_and_words() -> None:
    told: list[tuple[str, dict[str, Any]]] = []
    scribe = Scribe(lambda kind, **facts: told.append((kind, facts)))
    scribe.note("mark_set", {"mark": 1, "robot": "R", "place": [1.0, 2.0, -0.5], "by": "Ada"})
    scribe.event(
        {"robot": "R", "kind": "mode", "value": {"mode": "operator", "policy": "stop"}, "time": 1.0}
    )
    scribe.event({"robot": "", "kind": "estop", "value": "Ada", "time": 1.0})
    scribe.event({"robot": "R", "kind": "wheel", "value": 1.0, "time": 1.0})
    assert told == [
        ("mark_set", {"mark": 1, "robot": "R", "place": [1.0, -2.0, 0.5], "by": "Ada"}),
        ("mode", {"robot": "R", "mode": "teleoperated", "policy": "stop", "by": ""}),
        ("estop", {"on": True, "by": "Ada"}),
    ]


def _lines(path: Path) -> list[dict[str, Any]]:
    """Records of a log, but for what clocks on the wall said."""
    records = [json.loads(line) for line in path.read_text().splitlines()]
    clocks = "t_wall", "gateway_clock"
    return [{key: one[key] for key in one if key not in clocks} for one in records]


@pytest.mark.slow
def test_a_whole_run(tmp_path: Path) -> None:
    """O-44, O-47: from the command to score, report and archive; scored again it is the same."""
    mission = tmp_path / "ahead.toml"
    mission.write_text(_MISSION)
    out = tmp_path / "run"
    program = [sys.executable, "-m", "usarsim_server", "mission"]
    words = [str(mission), f"--team={_team(tmp_path, _TEAM)}", f"--out={out}", "--speed=max"]
    done = subprocess.run([*program, "run", *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    result = json.loads((out / "score.json").read_text())
    assert result["ended"]["why"] == "all_found", done.stdout
    assert result["values"]["VC"] == result["values"]["LO"] == 1
    assert result["victims"][0]["robot"] == "R1"
    again = subprocess.run([*program, "score", str(out), "--json"], capture_output=True, text=True)
    assert again.returncode == 0, again.stderr
    assert json.loads(again.stdout) == result
    report = (out / "report.html").read_text()
    assert "One victim ahead" in report
    assert "<polyline" in report
    assert "http" not in report.replace("http://www.w3.org", "")
    with zipfile.ZipFile(out / "run.zip") as file:
        assert {"events.jsonl", "truth.jsonl", "world.json", "score.json", "report.html"} <= set(
            file.namelist()
        )
    kinds = [json.loads(line)["kind"] for line in (out / "events.jsonl").read_text().splitlines()]
    assert {"session", "trial_start", "trial_end", "mode", "command", "select", "mark_set"} <= set(
        kinds
    )
    assert kinds.count("inject") == 3
    words[2] = f"--out={tmp_path / 'again'}"
    done = subprocess.run([*program, "run", *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for name in ("events.jsonl", "truth.jsonl"):  # O-55: the same world to the letter
        assert _lines(out / name) == _lines(tmp_path / "again" / name)
    scenery = (out / "scene.json.gz").read_bytes()
    assert scenery == (tmp_path / "again" / "scene.json.gz").read_bytes()
    refused = subprocess.run([*program, "run", *words], capture_output=True, text=True)
    assert refused.returncode == 2
    assert "name another folder" in refused.stderr
