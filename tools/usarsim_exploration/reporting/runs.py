"""What a report is about: runs out of folders of single runs and of batches.

A folder holds either `run.json` with `steps.csv` (`usarsim explore run --out`) or `result.json` of
many runs (`usarsim explore bench`). Runs are told apart by setting, strategy and seed; what else a
scenario says must be the same for all runs that are compared.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from usarsim_batch.folder import RESULT
from usarsim_exploration.batches.batch_folder import FORMAT as BATCH_FORMAT
from usarsim_exploration.batches.batch_folder import TIMING
from usarsim_exploration.ending import End, Reason
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.log_files import read_shares
from usarsim_exploration.reporting.survival import Time
from usarsim_exploration.run_folder import FORMAT as RUN_FORMAT
from usarsim_exploration.run_folder import RUN
from usarsim_server.base.csv_files import read_csv
from usarsim_server.base.errors import at
from usarsim_server.base.files import check_links, is_folder, is_regular, read_regular, reason
from usarsim_server.base.tables import Table, finite
from usarsim_server.protocol.json_text import parse_json

_LARGEST = 1 << 30
"""Bytes of a file of results; those of 3,840 runs have some 50 million."""
_LATEST = 10**9
"""Steps and robots beyond this are a mistake."""
_STOPPED = ("steps", "base knows")
"""Ends of runs that could have gone on."""
_OF_ROBOTS = ("name", "speed", "reach", "view", "radio", "start", "heading")
"""What robots have whatever the strategy; roles are the strategy's."""
_LISTS = ("environments", "teams", "radios", "strategies")
"""What a batch runs each with each."""
_NO_SCENARIO = (*_LISTS, "title", "seeds")
"""Of a batch, what is in no scenario of its runs."""
GRID, DISCS, SERVER = "grid", "discs", "server"
"""Backends; the first one is that of runs that name none."""
_AGAIN = "write it again with `usarsim explore run` or `usarsim explore bench`"
Array = NDArray[np.float64]


@dataclass(frozen=True, order=True, slots=True)
class Setting:
    """What strategies are compared in.

    Attributes:
        team: its label, if that is more than the number. backend: who moved the robots.
    """

    environment: str
    robots: int
    team: str
    radio: str
    backend: str = GRID

    def __str__(self) -> str:
        robots = "1 robot" if self.robots == 1 else f"{self.robots} robots"
        team = f"{self.team} ({robots})" if self.team else robots
        level = "" if self.backend == GRID else f", {self.backend}"
        return f"{self.environment}, {team}, {self.radio}{level}"


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """How much was known, as a part of the reachable cells, at some steps from 0 to the last.

    Attributes:
        distance: cells that all robots had driven by then; None: it is not told.
    """

    steps: Array
    team: Array
    base: Array
    distance: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One run.

    Attributes:
        source: name of the folder that it is from.
        limit: steps after which it would have been stopped.
        ended, step: why and when it ended. error: why it has no results; else empty.
        measures: by name; None: there is no such value.
        curves: None: they are not told.
        same: what must be equal in all runs of its setting, and of its strategy.
        spent: ms of processor by step; None: not told.
    """

    source: str
    setting: Setting
    strategy: str
    seed: int
    limit: int
    ended: str
    step: int
    error: str
    measures: Mapping[str, float | None]
    curves: Curves | None
    same: tuple[str, str] = ("", "")
    spent: float | None = None

    def time(self, goal: str) -> Time | None:
        """When it reached a goal, or until when it did not; None: nobody knows."""
        if goal not in self.measures:
            return None
        value = self.measures[goal]
        if value is not None:
            return Time(value)
        return Time(self.step if self.ended in _STOPPED else math.inf, reached=False)


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """A folder. digest: SHA-256 of its file of results."""

    folder: Path
    name: str
    format: str
    version: str
    digest: str
    runs: tuple[Run, ...]


def read(folders: Sequence[Path]) -> tuple[Source, ...]:
    """All runs of some folders.

    Raises:
        ExplorationError: a folder holds no results, they are damaged, or they cannot be compared.
    """
    sources = tuple(_read(folder) for folder in folders)
    seen: dict[object, tuple[str, Source]] = {}
    for source in sources:
        for run in source.runs:
            place = f"{run.setting}, {run.strategy}, seed {run.seed}"
            _new(seen, (run.setting, run.strategy, run.seed), place, source)
            for key, value, what in (
                ((run.setting, source.format), run.same[0], str(run.setting)),
                ((run.setting, run.strategy, source.format), run.same[1], run.strategy),
            ):
                before, other = seen.setdefault(key, (value, source))
                if before != value:
                    problem = f"{what} is not the same scenario as in {other.folder}"
                    raise ExplorationError(at(source.folder, problem, "report them apart"))
    return sources


def _new(seen: dict[object, tuple[str, Source]], key: object, place: str, source: Source) -> None:
    if key in seen:
        problem = f"{place}: is also in {seen[key][1].folder}"
        raise ExplorationError(at(source.folder, problem, "leave one of them out"))
    seen[key] = "", source


def _read(folder: Path) -> Source:
    if not is_folder(folder):
        raise ExplorationError(at(folder, "is no folder", "name a folder of results"))
    check_links(folder, ExplorationError)
    found = [name for name in (RUN, RESULT) if is_regular(folder / name)]
    if not found:
        cure = "name a folder that `usarsim explore run --out` or `usarsim explore bench` wrote"
        raise ExplorationError(at(folder, f"holds neither {RUN} nor {RESULT}", cure))
    if len(found) > 1:
        cure = "keep runs and batches in folders of their own"
        raise ExplorationError(at(folder, f"holds both {RUN} and {RESULT}", cure))
    path = folder / found[0]
    try:
        data = read_regular(path, _LARGEST)
        content = parse_json(data)
    except OSError as error:
        cure = "check the file and its rights"
        raise ExplorationError(at(path, f"cannot be read: {reason(error)}", cure)) from None
    except ValueError as error:
        raise ExplorationError(at(path, f"is no JSON: {error}", _AGAIN)) from None
    if not isinstance(content, dict):
        raise ExplorationError(at(path, "is no table of JSON", _AGAIN))
    table = Table(content, path, ExplorationError)
    wanted = RUN_FORMAT if found[0] == RUN else BATCH_FORMAT
    if (told := table.text("format")) != wanted:
        raise table.error("format", f"{told!r} is not {wanted!r}", _AGAIN)
    name = folder.resolve().name or str(folder)
    runs = [_single(table, folder, name)] if found[0] == RUN else _batch(table, folder, name)
    digest = hashlib.sha256(data).hexdigest()
    return Source(folder, name, wanted, table.text("version", "?"), digest, tuple(runs))


def _single(table: Table, folder: Path, name: str) -> Run:
    scenario, environment = table.table("scenario"), table.table("environment")
    setting = Setting(
        environment.text("name"),
        len(scenario.tables("robot")) or _count(scenario.table("team"), "robots"),
        "",
        scenario.table("radio").text("model"),
        scenario.text("backend", GRID),
    )
    reachable = environment.count("reachable", low=1, high=_LATEST)
    team, base, distance = read_shares(folder, reachable)
    curves = Curves(
        np.arange(len(team), dtype=float),
        team,
        base,
        distance * setting.robots,
    )
    end = table.table("ended")
    return Run(
        name,
        setting,
        scenario.table("strategy").text("name"),
        table.count("seed", low=0, high=2**63 - 1),
        _count(scenario.table("end"), "steps"),
        end.choice("reason", get_args(Reason)),
        _count(end, "step"),
        table.text("error", "", lines=True),
        _measures(table),
        curves,
        _same(table.free("scenario"), environment.text("digest")),
    )


def _same(scenario: Mapping[str, Any], digest: str) -> tuple[str, str]:
    """What must not differ between strategies, and between runs of one strategy."""
    robots = [{key: one.get(key) for key in _OF_ROBOTS} for one in scenario.get("robot", [])]
    shared = {
        key: value
        for key, value in scenario.items()
        if key not in ("seed", "strategy", "robot", "environment")
    }
    texts = (shared, robots, digest), scenario["strategy"]
    one, other = (json.dumps(text, sort_keys=True) for text in texts)
    return one, other


def _batch(table: Table, folder: Path, name: str) -> list[Run]:
    """All runs; where the batch does not say how long they last, the scenario's default holds."""
    batch = table.table("batch")
    limit = batch.table("end").count("steps", End.steps, low=0, high=_LATEST)
    entries = {
        key: {one.text("label"): one.rest("label") for one in batch.tables(key)} for key in _LISTS
    }
    shared = batch.rest(*_LISTS, "end")
    timing = _timing(folder / TIMING)
    runs = []
    backend = batch.text("backend", GRID)
    for row in table.tables("runs"):
        run = _of_batch(row, name, limit, backend)
        team = run.setting.team or str(run.setting.robots)
        labels = run.setting.environment, team, run.setting.radio, run.strategy
        named = [entries[key].get(label) for key, label in zip(_LISTS, labels, strict=True)]
        common = {key: value for key, value in shared.items() if key not in _NO_SCENARIO}
        texts = (json.dumps(one, sort_keys=True) for one in ((common, named[:3]), named[3]))
        key = "/".join((labels[0], team, run.strategy, run.setting.radio, str(run.seed)))
        runs.append(replace(run, same=(next(texts), next(texts)), spent=timing.get(key)))
    if not runs:
        raise table.error("runs", "there is none", _AGAIN)
    return runs


def _of_batch(table: Table, name: str, limit: int, backend: str) -> Run:
    setting = Setting(
        table.text("environment"),
        _count(table, "robots"),
        table.text("team", ""),
        table.text("radio"),
        backend,
    )
    who = name, setting, table.text("strategy"), table.count("seed", low=0, high=2**63 - 1), limit
    if table.has("error"):
        return Run(*who, "", 0, table.text("error", lines=True), {}, None)
    end = table.table("ended")
    return Run(
        *who,
        end.choice("reason", get_args(Reason)),
        _count(end, "step"),
        "",
        _measures(table),
        _curves(table),
    )


def _timing(path: Path) -> dict[str, float]:
    """Processor ms by step of runs, by their keys; empty if the file is not there."""
    if not is_regular(path):
        return {}
    cure = "remove it, or run the batch again"
    found = read_csv(path, ExplorationError, cure)
    try:
        return {row["run"]: found.number(row["ms_per_step"]) for _, row in found.rows}
    except (KeyError, ValueError):
        problem = "is no table of run and ms_per_step"
        raise ExplorationError(at(path, problem, cure)) from None


def _count(table: Table, key: str) -> int:
    return table.count(key, low=0, high=_LATEST)


def _measures(table: Table) -> dict[str, float | None]:
    """All that are numbers, or missing."""
    if not table.has("measures"):
        raise table.error("measures", "is missing", _AGAIN)
    found: dict[str, float | None] = {}
    for key, value in table.free("measures").items():
        if isinstance(value, list):  # names of the robots that were lost
            continue
        number = finite(value)
        if number is None and value is not None:
            raise table.error(f"measures: {key}", f"{value!r} is no number", _AGAIN)
        found[key] = number
    return found


def _curves(table: Table) -> Curves | None:
    if not table.has("curves"):
        return None
    below = table.table("curves")

    def column(key: str, holds: Callable[[Array], object], wanted: str) -> Array:
        try:
            found = np.array(below.raw(key), float)
        except (TypeError, ValueError):
            found = np.empty(0)
        if found.ndim != 1 or not len(found) or not np.isfinite(found).all() or not holds(found):
            raise below.error(key, f"is no list of {wanted}", _AGAIN)
        return found

    steps = column("steps", lambda one: one[0] >= 0 and (np.diff(one) > 0).all(), "rising steps")
    team, base = (
        column(
            key,
            lambda one: len(one) == len(steps) and one.min() >= 0 and one.max() <= 1,
            f"{len(steps)} parts from 0 to 1",
        )
        for key in ("team", "base")
    )
    distance = None
    if below.has("distance"):
        distance = column(
            "distance",
            lambda one: len(one) == len(steps) and one[0] >= 0 and (np.diff(one) >= 0).all(),
            f"{len(steps)} distances that do not fall",
        )
    return Curves(steps, team, base, distance)
