"""Leagues: ranks, ties, what is missing, runs that were cut off, the files that are written."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from whole_run import begin, play

from usarsim_mission.errors import MissionError
from usarsim_mission.league.gathering import gather
from usarsim_mission.league.standings import League, rank
from usarsim_mission.league.writing import write_league
from usarsim_mission.plan import Plan, PlannedTeam, write_plan
from usarsim_mission.scoring import VARIABLES
from usarsim_server import cli

SEEDS = {"A": (30.0, 50.0, 40.0), "B": (50.0, 10.0, 30.0), "C": (40.0, 50.0, 30.0)}
"""Points of three teams in three matches: means 40, 30, 40; A and C are equal."""


def _run(folder: Path, team: str, seed: int, points: float, **more: Any) -> Path:
    """A folder as far as a league reads it."""
    folder.mkdir(parents=True)
    session = {"seq": 0, "t_wall": 0.0, "t_sim": 0.0, "kind": "session", "team": team}
    (folder / "events.jsonl").write_text(json.dumps(session) + "\n")
    (folder / "scoring.toml").write_text(
        f'schema = "usar-score/1"\nname = "{more.get("rules", "ours")}"\n'
    )
    result = {
        "mission": "maze",
        "seed": seed,
        "rules": "ours",
        "total": points,
        "time_limit": 60.0,
        "values": dict.fromkeys(VARIABLES, 1.0),
        "ended": {"why": "time", "began": 1.0, "t_sim": 61.0},
    }
    (folder / "score.json").write_text(json.dumps({**result, **more}))
    return folder


def _season(folder: Path) -> Path:
    for team, points in SEEDS.items():
        for seed, one in enumerate(points):
            _run(folder / f"{team}-{seed}", team, seed, one)
    return folder


def _told(league: League) -> list[tuple[int | None, str, float | None]]:
    return [(row.rank, row.team, row.score) for row in league.standings]


def test_equals_share_a_rank_and_the_next_is_skipped(tmp_path: Path) -> None:
    """Means of points; a match of whose best one is one of several is won."""
    league = rank(gather([_season(tmp_path)]))
    assert _told(league) == [(1, "A", 40.0), (1, "C", 40.0), (3, "B", 30.0)]
    a, c, b = league.standings
    assert (a.won, c.won, b.won) == (2, 1, 1)
    assert (a.deviation, b.deviation) == (10.0, 20.0)
    assert [one.place for one in c.entries.values()] == [2, 1, 2]
    assert league.by == "points"


def test_what_is_missing_is_not_zero(tmp_path: Path) -> None:
    """A team without a match has no rank, however good its mean; `common` leaves the match out."""
    shutil.rmtree(_season(tmp_path) / "A-0")
    gathered = gather([tmp_path])
    league = rank(gathered)
    assert _told(league) == [(1, "C", 40.0), (2, "B", 30.0), (None, "A", 45.0)]
    common = rank(gathered, common=True)
    assert _told(common) == [(1, "A", 45.0), (2, "C", 40.0), (3, "B", 20.0)]
    assert [match.seed for match in common.dropped] == [0]


def test_missions_of_different_rules_are_compared_by_places(tmp_path: Path) -> None:
    for team, small, large in (("A", 0.1, 900.0), ("B", 0.2, 800.0), ("C", 0.2, 700.0)):
        _run(tmp_path / f"{team}-s", team, 1, small)
        rules = {"rules": "theirs", "mission": "hall"}
        _run(tmp_path / f"{team}-l", team, 1, large, **rules)
    league = rank(gather([tmp_path]))
    assert (league.by, set(league.rules)) == ("places", {"theirs", "ours"})
    assert _told(league) == [(1, "B", 1.5), (2, "A", 2.0), (2, "C", 2.0)]


@pytest.mark.parametrize(
    ("why", "flaw"),
    [
        (None, "it was cut off"),
        ("error", "it ended by an error"),
        ("aborted", "it was aborted"),
        ("boredom", "ended by boredom"),
    ],
)
def test_a_run_that_is_not_whole_is_told_and_does_not_count(
    tmp_path: Path, why: str | None, flaw: str
) -> None:
    """O-45: unless that is asked for; one that was repeated counts as it was then."""
    ended = {"ended": {"why": why, "began": 1.0, "t_sim": None}}
    _run(tmp_path / "A-1", "A", 1, 70.0, **ended)
    _run(tmp_path / "B-1", "B", 1, 60.0)
    gathered = gather([tmp_path])
    assert _told(rank(gathered)) == [(1, "B", 60.0), (None, "A", None)]
    (entry,) = rank(gathered).standings[1].entries.values()
    assert [run.points for run in entry.apart] == [70.0]
    assert entry.apart[0].flaw == flaw
    assert _told(rank(gathered, flawed=True)) == [(1, "A", 70.0), (2, "B", 60.0)]
    _run(tmp_path / "again", "A", 1, 20.0)
    assert _told(rank(gather([tmp_path]))) == [(1, "B", 60.0), (2, "A", 20.0)]


def test_a_planned_run_that_nobody_played_is_missing(tmp_path: Path) -> None:
    teams = (PlannedTeam("A", "1"), PlannedTeam("D", "2"))
    _run(tmp_path / "A-1", "A", 1, 5.0)
    write_plan(tmp_path, Plan("maze", "0", teams=teams, seeds=(1, 2)))
    league = rank(gather([tmp_path]))
    assert [(row.team, row.played, len(row.entries)) for row in league.standings] == [
        ("A", 1, 2),
        ("D", 0, 2),
    ]
    assert {row.rank for row in league.standings} == {None}


def test_a_killed_run_is_scored_from_its_logs(tmp_path: Path) -> None:
    """O-45, O-47: no `score.json`, the last line cut off; points until then, and a flaw."""
    run = begin(tmp_path / "killed")
    play(run)
    run.log.flush()
    events = tmp_path / "killed" / "events.jsonl"
    lines = events.read_bytes().splitlines(keepends=True)
    end = next(at for at, line in enumerate(lines) if b'"trial_end"' in line)
    events.write_bytes(b"".join(lines[:end])[:-20])
    (played,) = gather([tmp_path]).runs
    assert (played.flaw, played.ended, played.values["VF"]) == ("it was cut off", None, 2.0)
    assert played.points > 0.0


def test_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All four, with the same numbers; runs given twice count once; names are no markup."""
    folder = _season(tmp_path / "runs")
    shutil.rmtree(folder / "B-2")
    _run(folder / "x", "<b>", 0, 1.0)
    out = tmp_path / "out"
    assert cli.main(["mission", "league", str(folder), str(folder / "A-0"), f"--out={out}"]) == 0
    told = capsys.readouterr().out
    assert "MEAN POINTS" in told
    assert str(out / "league.html") in told
    league = json.loads((out / "league.json").read_text())
    assert [(one["rank"], one["team"], one["missing"]) for one in league["teams"]] == [
        (1, "A", 0),
        (1, "C", 0),
        (None, "B", 1),
        (None, "<b>", 2),
    ]
    assert league["teams"][2]["matches"][2]["points"] is None
    assert league["teams"][0]["matches"][0]["runs"] == ["../runs/A-0"]
    with (out / "league.csv").open() as file:
        assert [row["score"] for row in csv.DictReader(file)] == ["40.0", "40.0", "30.0", "1.0"]
    with (out / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    assert [(row["team"], row["points"]) for row in rows if row["flaw"] == "missing"] == [
        ("<b>", ""),
        ("<b>", ""),
        ("B", ""),
    ]
    page = (out / "league.html").read_text()
    assert "&lt;b&gt;" in page
    assert "http" not in page


def test_runs_that_do_not_compare_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Other limits, other rules; but rules that say the same in other words are the same."""
    _run(tmp_path / "c" / "c", "C", 1, 5.0)
    other = tmp_path / "c" / "d"
    scoring = _run(other, "D", 1, 5.0) / "scoring.toml"
    rules = scoring.read_text()
    scoring.write_text(f"{rules}[victims]\nsticky = true\n")
    assert len(gather([tmp_path / "c"]).runs) == 2
    scoring.write_text(f"{rules}[victims]\nsticky = false\n")
    with pytest.raises(MissionError, match="has other rules than"):
        gather([tmp_path / "c"])
    shutil.rmtree(tmp_path / "c")
    _run(tmp_path / "a", "A", 1, 5.0)
    _run(tmp_path / "b", "B", 1, 5.0, time_limit=30.0)
    assert cli.main(["mission", "league", str(tmp_path)]) == 2
    assert "has another time limit than" in capsys.readouterr().err
    with pytest.raises(MissionError, match="has no run"):
        gather([tmp_path / "nowhere"])
    (tmp_path / "b" / "score.json").write_text('{"ended": 3}')
    with pytest.raises(MissionError, match="is no result of a run"):
        gather([tmp_path])


def test_scored_again(played: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """O-47: `--again` finds points that do not follow from the logs."""
    folder = tmp_path / "run"
    shutil.copytree(played, folder)
    assert cli.main(["mission", "league", "--again", str(folder)]) == 0
    result = json.loads((folder / "score.json").read_text())
    (folder / "score.json").write_text(json.dumps({**result, "total": 1e3}))
    assert cli.main(["mission", "league", "--again", str(folder)]) == 1
    assert "score.json: total: 1000" in capsys.readouterr().err


def test_an_empty_league_is_written(tmp_path: Path) -> None:
    """Nothing that all teams have in common: a page all the same."""
    _run(tmp_path / "a", "A", 1, 5.0)
    _run(tmp_path / "b", "B", 2, 5.0)
    league = rank(gather([tmp_path]), common=True)
    assert {row.rank for row in league.standings} == {None}
    assert len(write_league(league, tmp_path / "out")) == 4
