"""Finds runs in folders and tells of each what a league has to know.

Numbers are those of `score.json`. A run without it was killed: it is scored from its logs. Whether
a run is whole its end tells, and one that is not has a flaw: it was cut off, or ended by an error.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usarsim_mission.errors import MissionError, RunLogError
from usarsim_mission.plan import Plan, read_plan
from usarsim_mission.rescoring import live_result, rescore
from usarsim_mission.runlog import EVENTS, SCORE, RunFolder
from usarsim_mission.scoring import VARIABLES, Rules
from usarsim_server.base.errors import UsarsimError, at

WHOLE = ("time", "operator", "all_found")
"""How a run ends that is whole."""
_FLAWS = {"error": "it ended by an error", "aborted": "it was aborted"}


@dataclass(frozen=True, slots=True)
class Match:
    """What all teams play alike: a seed of a mission."""

    mission: str
    seed: int

    def __str__(self) -> str:
        return f"{self.mission}, seed {self.seed}"


@dataclass(frozen=True, slots=True)
class Played:
    """One run.

    Attributes:
        points: its total. values: of all variables of the rules.
        ended: why; None if it was cut off. lasted: s of simulated time of the trial; None then.
        flaw: why it is not whole, in words; empty if it is.
    """

    team: str
    match: Match
    rules: str
    time_limit: float
    points: float
    values: Mapping[str, float]
    ended: str | None
    lasted: float | None
    folder: Path
    flaw: str = ""


@dataclass(frozen=True, slots=True)
class Gathered:
    """All runs, and what was planned and has none.

    Attributes:
        teams: in the order in which they were met. differences: of those that were scored again.
    """

    runs: tuple[Played, ...]
    teams: tuple[str, ...]
    matches: tuple[Match, ...]
    differences: tuple[str, ...] = ()


def gather(folders: Iterable[Path], *, again: bool = False) -> Gathered:
    """All runs at or below folders.

    Args:
        folders: of runs, or of folders of runs; what a batch planned counts, too.
        again: score each run again from its logs instead of trusting its `score.json`.

    Raises:
        MissionError: there is none, one cannot be read, or two of one match do not compare.
    """
    paths, plans = _found(folders)
    differences: list[str] = []
    runs = [_played(path, again, differences) for path in paths]
    _same_terms(runs)
    teams = [team.name for plan in plans for team in plan.teams]
    matches = [Match(plan.mission, seed) for plan in plans for seed in plan.seeds]
    teams += [run.team for run in runs]
    matches += [run.match for run in runs]
    ordered = sorted(dict.fromkeys(matches), key=lambda one: (one.mission, one.seed))
    return Gathered(
        tuple(runs), tuple(dict.fromkeys(teams)), tuple(ordered), tuple(differences)
    )  # fmt: skip


def flaw_of(result: Mapping[str, Any]) -> str:
    """Why a run is not whole, in words; empty if it is.

    Args:
        result: what its `score.json` tells.
    """
    ended = result["ended"]
    if ended["began"] is None:
        return "it did not begin"
    if ended["why"] is None:
        return "it was cut off"
    return "" if ended["why"] in WHOLE else _FLAWS.get(ended["why"], f"ended by {ended['why']}")


def _found(folders: Iterable[Path]) -> tuple[list[Path], list[Plan]]:
    """Folders of runs, each once, and plans of batches."""
    paths: dict[Path, Path] = {}
    plans: list[Plan] = []
    for folder in folders:
        before = len(paths), len(plans)
        for where, below, files in os.walk(folder):
            here = Path(where)
            below.sort()
            if EVENTS in files:
                paths.setdefault(here.resolve(), here)
                below.clear()
            elif (plan := read_plan(here)) is not None:
                plans.append(plan)
        if (len(paths), len(plans)) == before and not (folder / EVENTS).exists():
            raise MissionError(at(folder, "has no run", "name folders that `mission run` made"))
    return list(paths.values()), plans


def _played(path: Path, again: bool, differences: list[str]) -> Played:
    result = None if again else live_result(path / SCORE)
    if result is None:
        scored = rescore(path)
        result = scored.result
        differences += [f"{path}: {one}" for one in scored.differences]
    try:
        ended, values = result["ended"], result["values"]
        began, over = ended["began"], ended["t_sim"]
        return Played(
            _team(path),
            Match(str(result["mission"]), int(result["seed"])),
            str(result["rules"]),
            float(result["time_limit"]),
            float(result["total"]),
            {name: float(values[name]) for name in VARIABLES},
            ended["why"],
            None if began is None or over is None else float(over) - float(began),
            path,
            flaw_of(result),
        )
    except (KeyError, TypeError, ValueError):
        cure = "write it anew by usarsim mission score --write"
        raise RunLogError(at(path / SCORE, "is no result of a run", cure)) from None


def _team(path: Path) -> str:
    """Who played, as the log says; else the name of the folder."""
    try:
        first = next(RunFolder(path).records(), {})
    except UsarsimError:
        first = {}
    name = first.get("team") if first.get("kind") == "session" else None
    return name if isinstance(name, str) and name else path.name


def _same_terms(runs: Iterable[Played]) -> None:
    """Refuse runs of one match by different rules or limits: their points do not compare."""
    terms: dict[Match, tuple[tuple[Rules, float], Path]] = {}
    for run in runs:
        mine = RunFolder(run.folder).rules(), run.time_limit
        theirs, other = terms.setdefault(run.match, (mine, run.folder))
        if mine != theirs:
            what = "rules" if mine[0] != theirs[0] else "time limit"
            problem = f"has another {what} than {other}, and both are {run.match}"
            raise MissionError(at(run.folder, problem.replace("another rules", "other rules"),
                                  "leave one of them out"))  # fmt: skip
