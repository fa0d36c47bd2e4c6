"""The report of a run: what it tells, what of a run it draws, and of what points are made."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_mission.match import timeline
from usarsim_mission.match.drawn import Drawn, Span
from usarsim_mission.match.report import write_report
from usarsim_mission.match.standing import UNKNOWN
from usarsim_mission.runlog import RunFolder
from usarsim_mission.scoring import VARIABLES, find_rules, presets

_SVG = re.compile(r"<svg.*?</svg>", re.DOTALL)


@given(st.data())
def test_parts_add_up_to_the_points(data: st.DataObject) -> None:
    """O-51: of every preset, whatever the values."""
    values = {
        name: data.draw(st.integers(max(int(low), -50), min(int(high), 50)), label=name)
        if high > 1.0
        else data.draw(st.floats(0.0, 1.0), label=name)
        for name, ((low, high), _) in VARIABLES.items()
    }
    for name in presets():
        rules = find_rules(name)[1]
        parts = [points for _, points in rules.made_of(values)]
        assert sum(parts) == pytest.approx(rules.score(values), abs=1e-8, rel=1e-9)


def test_products_of_sums_are_multiplied_out() -> None:
    """O-51: time counts with victims only, and each part names what it is made of."""
    values = {**dict.fromkeys(VARIABLES, 0.0), "V": 2, "VC": 1, "A": 0.7, "M": 0.6, "T": 0.4}
    values |= {"C": 1, "FM": 1, "N": 1}
    parts = {
        frozenset(names): round(points, 9)
        for names, points in find_rules("usar-mj-1")[1].made_of(values)
    }
    assert parts == {
        frozenset({"VC", "V"}): 25.0,
        frozenset({"A"}): 14.0,
        frozenset({"M"}): 12.0,
        frozenset({"T", "VC", "V"}): 2.0,
        frozenset({"C"}): -5.0,
        frozenset({"FM"}): -2.0,
        frozenset({"L"}): 0.0,
    }
    values |= {"V": 10, "VF": 5, "T": 0.4, "N": 2}
    parts = [points for _, points in find_rules("usarsim-scorekeeper")[1].made_of(values)]
    assert parts == pytest.approx([6.25, 5.0])


def test_what_is_drawn(played: Path) -> None:
    """Ways are those of the truth: 25 rows of 0.1 m each make 24.9 m, but for a row without x."""
    drawn = Drawn()
    for record in RunFolder(played).records():
        drawn.take(record)
    drawn.end()
    robot = drawn.robots["R1"]
    assert robot.kind == "P3AT"
    assert robot.way == pytest.approx(24.9)
    assert robot.moving == pytest.approx(24.9)
    assert robot.touches == [(9.9, False)]
    assert drawn.marks.keys() == {"1", "2", "3"}
    assert drawn.wrong == {"3"}
    assert [victim for _, victim in drawn.found] == ["Anna", "Ben"]
    assert drawn.scores[-1][0] == drawn.last == 25.0


def test_spans_of_modes_links_and_choices() -> None:
    """What lasts ends with the next, or with the run; saying it again changes nothing."""
    drawn = Drawn()
    for time, kind, facts in (
        (0.0, "session", {"robots": [{"name": "A"}, {"name": "B"}]}),
        (1.0, "mode", {"robot": "A", "mode": "autonomous"}),
        (2.0, "select", {"robot": "A"}),
        (3.0, "mode", {"robot": "A", "mode": "autonomous"}),
        (4.0, "select", {"robot": "B"}),
        (5.0, "link", {"robot": "B", "state": "lost"}),
        (6.0, "mode", {"robot": "A", "mode": "stopped"}),
        (7.0, "link", {"robot": "B", "state": "weak"}),
        (9.0, "trial_end", {}),
    ):
        drawn.take({"t_sim": time, "kind": kind, **facts})
    drawn.end()
    a, b = drawn.robots["A"], drawn.robots["B"]
    assert a.modes == [Span("autonomous", 1.0, 6.0), Span("stopped", 6.0, 9.0)]
    assert a.chosen == [Span("chosen", 2.0, 4.0)]
    assert b.chosen == [Span("chosen", 4.0, 9.0)]
    assert b.cuts == [Span("lost", 5.0, 7.0)]


def test_why_a_robot_stood() -> None:
    """Its own account counts while it lasts, and for as long after it as standing takes: a robot
    that told why it stood once, and went on, does not say why it stands later."""
    drawn = Drawn()
    drawn.take({"t_sim": 0.0, "kind": "mode", "robot": "A", "mode": "autonomous"})
    told = {10.0: "it is shut in", 30.0: "", 100.0: "it is caught", 101.0: ""}
    for half in range(300):
        time = half / 2.0
        if time in told:
            drawn.take({"t_sim": time, "kind": "stands", "robot": "A", "why": told[time]})
        x = 0.0 if time < 50.0 else 5.0 + (time if time < 60.0 else 0.0)
        row = {"name": "A", "pos": [x, 0.0, 0.0]}
        drawn.take({"t_sim": time, "kind": "truth", "robots": [row]})
    spans = [(one.begins, one.ends, one.why) for one in drawn.robots["A"].standing.spans]
    assert spans == [
        (0.0, 39.5, "it is shut in"),
        (39.5, 49.5, UNKNOWN),
        (60.0, 99.5, UNKNOWN),
        (99.5, 110.5, "it is caught"),
        (110.5, 149.5, UNKNOWN),
    ]


def test_what_cannot_drive_does_not_stand() -> None:
    """A base that is built to stay is not told among the robots that stood; others are."""
    drawn = Drawn()
    robots = [{"name": "Base", "drives": False}, {"name": "A", "drives": True}, {"name": "B"}]
    drawn.take({"t_sim": 0.0, "kind": "session", "robots": robots})
    for half in range(60):
        rows = [{"name": one["name"], "pos": [0.0, 0.0, 0.0]} for one in robots]
        drawn.take({"t_sim": half / 2.0, "kind": "truth", "robots": rows})
    stood = {name for name, way in drawn.robots.items() if way.standing.spans}
    assert stood == {"A", "B"}


def test_a_report(played: Path, tmp_path: Path) -> None:
    """One file without network, whose pictures are well formed; names are no markup."""
    folder = tmp_path / "run"
    shutil.copytree(played, folder)
    for path in folder.glob("*.json*"):
        path.write_text(path.read_text().replace("Anna", "<i>Anna"))
    result = json.loads((folder / "score.json").read_text())
    text = write_report(folder, result).read_text()
    pictures = [ElementTree.fromstring(one) for one in _SVG.findall(text)]
    assert len(pictures) > 2
    assert "http" not in text
    assert "<i>" not in text
    assert "not whole" not in text
    assert "ended by the operator" in text
    assert "yellow zone" in text
    assert "table below" not in text  # nothing happened that it would tell
    found = pictures[0].findall(".//{*}title")
    assert {"<i>Anna", "Ben", "start of R1", "mark 3"} <= {one.text for one in found}
    assert ElementTree.parse(folder / "plan.svg").getroot().tag.endswith("svg")
    (row,) = csv.DictReader((folder / "summary.csv").open())
    assert (row["points"], row["lasted_s"]) == (str(result["total"]), "25.0")
    assert (row["flaw"], row["VF"], row["ended"]) == ("", "2", "operator")


def test_finds_stand_beside_one_another() -> None:
    """Several within seconds: each number can be read."""
    drawn = Drawn()
    for time, victim in ((10.0, "A"), (11.0, "B"), (300.0, "C")):
        drawn.take({"t_sim": time, "kind": "found", "victim": victim})
    drawn.take({"t_sim": 600.0, "kind": "score", "total": 1.0})
    picture = timeline.timeline(drawn, 0.0, {"A": 1, "B": 2, "C": 3})
    places = [float(one) for one in re.findall(r'circle cx="([0-9.]+)"', picture)]
    assert places[1] - places[0] >= 22.0
    assert places[2] == pytest.approx((88.0 + 975.0) / 2.0, abs=0.1)


def test_a_report_of_a_run_that_did_not_begin(played: Path, tmp_path: Path) -> None:
    """O-45: killed after its first record, it is drawn and flagged all the same."""
    folder = tmp_path / "run"
    shutil.copytree(played, folder)
    (folder / "truth.jsonl").unlink()
    events = folder / "events.jsonl"
    events.write_text(events.read_text().splitlines(keepends=True)[0])
    result = json.loads((folder / "score.json").read_text())
    result["ended"] = {"why": None, "t_sim": None, "began": None}
    text = write_report(folder, result).read_text()
    assert "This run is not whole:</b> it did not begin" in text
    assert "The trial did not begin" in text
    (row,) = csv.DictReader((folder / "summary.csv").open())
    assert (row["lasted_s"], row["flaw"]) == ("", "it did not begin")
