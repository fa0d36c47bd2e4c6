"""Writes a league: `league.html`, `league.json`, `league.csv` (a row per team), `runs.csv`."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from usarsim_mission.errors import MissionError
from usarsim_mission.league.page import league_page
from usarsim_mission.league.standings import Entry, League, Standing
from usarsim_mission.scoring import VARIABLES
from usarsim_server.base.csv_files import csv_text
from usarsim_server.base.errors import at
from usarsim_server.base.files import reason, write_text

HTML, JSON, CSV, RUNS = "league.html", "league.json", "league.csv", "runs.csv"
SCHEMA = "usar-league/1"
Cell = str | float | None


def write_league(league: League, folder: Path) -> list[Path]:
    """Write all files; returns them.

    Raises:
        MissionError: the folder cannot be written.
    """
    contents = {
        HTML: league_page(league, folder),
        JSON: json.dumps(as_json(league, folder), indent=1, allow_nan=False) + "\n",
        CSV: csv_text(
            _TEAM_HEADS, (_team_row(one, len(league.matches)) for one in league.standings)
        ),
        RUNS: csv_text((*_RUN_HEADS, *VARIABLES), _run_rows(league, folder)),
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in contents.items():
            write_text(folder / name, text)
    except OSError as error:
        cure = "name a folder that can be written"
        raise MissionError(at(folder, f"cannot be written: {reason(error)}", cure)) from None
    return [folder / name for name in contents]


def as_json(league: League, folder: Path) -> dict[str, Any]:
    """All of a league as JSON has it; paths are seen from a folder. What is missing is null."""
    return {
        "schema": SCHEMA,
        "by": league.by,
        "rules": list(league.rules),
        "matches": [{"mission": one.mission, "seed": one.seed} for one in league.matches],
        "dropped": [{"mission": one.mission, "seed": one.seed} for one in league.dropped],
        "teams": [
            {
                "team": one.team,
                "rank": one.rank,
                "score": one.score,
                "points": {
                    "mean": one.mean,
                    "deviation": one.deviation,
                    "least": one.least,
                    "most": one.most,
                },
                "won": one.won,
                "played": one.played,
                "missing": len(league.matches) - one.played,
                "values": dict(one.values),
                "matches": [_entry(entry, folder) for entry in one.entries.values()],
            }
            for one in league.standings
        ],
    }


def _entry(entry: Entry, folder: Path) -> dict[str, Any]:
    """What a team has in a match."""
    return {
        "points": entry.points,
        "place": entry.place,
        "runs": [_path(run.folder, folder) for run in entry.counted],
        "apart": [
            {"run": _path(run.folder, folder), "points": run.points, "why": run.flaw}
            for run in entry.apart
        ],
    }


_TEAM_HEADS = (
    "rank", "team", "score", "mean", "deviation", "least", "most", "won", "played", "missing",
)  # fmt: skip
_RUN_HEADS = (
    "mission", "seed", "team", "folder", "counts", "flaw", "points", "place", "rules",
    "time_limit", "ended", "lasted",
)  # fmt: skip


def _team_row(one: Standing, matches: int) -> Sequence[Cell]:
    spread = (one.mean, one.deviation, one.least, one.most)
    return one.rank, one.team, one.score, *spread, one.won, one.played, matches - one.played


def _run_rows(league: League, folder: Path) -> Iterable[Sequence[Cell]]:
    """A row per run, and one per match of a team that is missing."""
    for match in league.matches:
        for standing in sorted(league.standings, key=lambda one: one.team):
            entry, team = standing.entries[match], standing.team
            if not entry.counted and not entry.apart:
                empty = (None,) * (len(_RUN_HEADS) - 6 + len(VARIABLES))
                yield match.mission, match.seed, team, None, "no", "missing", *empty
            for run in (*entry.counted, *entry.apart):
                counts = run in entry.counted
                yield (
                    *(match.mission, match.seed, team, _path(run.folder, folder)),
                    *("yes" if counts else "no", run.flaw or None, run.points),
                    *(entry.place if counts else None, run.rules, run.time_limit),
                    *(run.ended, run.lasted),
                    *(run.values[name] for name in VARIABLES),
                )


def _path(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path, folder)).as_posix()
