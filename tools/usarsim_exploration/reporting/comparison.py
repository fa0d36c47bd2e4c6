"""What runs say about strategies: numbers of each in every setting, and ranks.

Times of goals are censored where a run did not reach them (`survival`); all else are plain means.
A mean time ends at a horizon up to which all strategies of the setting can be told.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from usarsim_exploration.measures import MEASURES
from usarsim_exploration.reporting.ranking import Ranking, rank
from usarsim_exploration.reporting.runs import Run, Setting, Source
from usarsim_exploration.reporting.survival import (
    Time,
    band,
    common_horizon,
    interval,
    median,
    restricted_mean,
)
from usarsim_report.statistics import Interval

GOALS = tuple(f"{who}_t{share}" for who in ("team", "base") for share in (50, 90, 95))
"""Measures that are times; by these strategies are ranked."""
RANKED = ("base_t90", "team_t90")
"""Goals that get a ranking over all settings, the most important one first."""
MEASURED = (
    *GOALS, "team_area", "base_area", "base_share", "mean_wait", "distance", "overlap",
    "disconnected", "bytes_sent",
)  # fmt: skip
"""What the tables of a report tell; the files have all measures."""

_Values = Mapping[str, Mapping[str, Mapping[object, Time]]]
"""By measure, strategy and block; less is better."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One measure of one strategy in one setting.

    Attributes:
        runs: that have it. reached: of these, how many have a value.
        mean: of a time, restricted to the horizon; None: nobody reached the goal. interval: of it.
        sd, low, high: standard deviation and quartiles; None where a run has no value.
        median: also known if less than half of the runs did not reach a goal.
        horizon: of the mean of a time; None: of all else.
    """

    measure: str
    strategy: str
    runs: int
    reached: int
    mean: float | None = None
    interval: Interval | None = None
    sd: float | None = None
    median: float | None = None
    low: float | None = None
    high: float | None = None
    horizon: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """All runs of a setting that have results, by strategy.

    Attributes:
        horizon: a step up to which curves of all runs are known.
        cells: by measure and strategy; without those that no run has.
        rankings: by measure; blocks are seeds.
    """

    setting: Setting
    runs: Mapping[str, Sequence[Run]]
    limit: int
    horizon: int
    cells: Mapping[tuple[str, str], Cell]
    rankings: Mapping[str, Ranking]


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """All of it.

    Attributes:
        by_seed: rankings by goal; a block is a setting with a seed. by_setting: a block is a
            setting, by the mean times.
    """

    sources: Sequence[Source]
    strategies: Sequence[str]
    groups: Sequence[Group]
    failed: Sequence[Run]
    by_seed: Mapping[str, Ranking]
    by_setting: Mapping[str, Ranking]


def compare(sources: Sequence[Source]) -> Comparison:
    """Compare all strategies in all settings."""
    runs = [run for source in sources for run in source.runs]
    good = [run for run in runs if not run.error]
    strategies = sorted({run.strategy for run in good})
    groups = [
        _group(setting, [run for run in good if run.setting == setting])
        for setting in sorted({run.setting for run in good})
    ]
    by_seed: _Values = {
        goal: {
            strategy: {
                (run.setting, run.seed): time
                for run in good
                if run.strategy == strategy and (time := run.time(goal)) is not None
            }
            for strategy in strategies
        }
        for goal in RANKED
    }
    by_setting: _Values = {
        goal: {
            strategy: {
                group.setting: _typical(group.cells[goal, strategy])
                for group in groups
                if (goal, strategy) in group.cells
            }
            for strategy in strategies
        }
        for goal in RANKED
    }
    failed = [run for run in runs if run.error]
    return Comparison(sources, strategies, groups, failed, _ranked(by_seed), _ranked(by_setting))


def _typical(cell: Cell) -> Time:
    """The mean time; where nobody reached the goal all that is known is the horizon."""
    if cell.mean is None:
        return Time(cell.horizon or 0.0, reached=False)
    return Time(cell.mean)


def _group(setting: Setting, runs: Sequence[Run]) -> Group:
    by_strategy = {
        strategy: sorted((run for run in runs if run.strategy == strategy), key=_seed)
        for strategy in sorted({run.strategy for run in runs})
    }
    limit = min(run.limit for run in runs)
    cells = {
        (cell.measure, cell.strategy): cell
        for measure in MEASURED
        for cell in _cells(measure, by_strategy, limit)
    }
    values: _Values = {
        measure: {
            strategy: {
                run.seed: time for run in mine if (time := _ordered(run, measure)) is not None
            }
            for strategy, mine in by_strategy.items()
        }
        for measure in MEASURED
    }
    stopped = [run.step for run in runs if run.ended == "steps"]
    last = min(stopped) if stopped else max(run.step for run in runs)
    return Group(setting, by_strategy, limit, last, cells, _ranked(values))


def _seed(run: Run) -> int:
    return run.seed


def _ordered(run: Run, measure: str) -> Time | None:
    """A value for ranks, of which less is better."""
    if measure in GOALS:
        return run.time(measure)
    value = run.measures.get(measure)
    if value is None:
        return None
    return Time(-value if MEASURES[measure].better == "more" else value)


def _ranked(values: _Values) -> dict[str, Ranking]:
    found = {name: rank(one) for name, one in values.items() if one}
    return {name: one for name, one in found.items() if one is not None}


def _cells(measure: str, runs: Mapping[str, Sequence[Run]], limit: int) -> Iterable[Cell]:
    """Of all strategies that have the measure."""
    if measure not in GOALS:
        for strategy, mine in runs.items():
            told = [run.measures[measure] for run in mine if measure in run.measures]
            values = [value for value in told if value is not None]
            if values:
                yield _plain(measure, strategy, len(told), values)
        return
    times = {
        strategy: [time for run in mine if (time := run.time(measure)) is not None]
        for strategy, mine in runs.items()
    }
    known = {strategy: found for strategy, found in times.items() if found}
    horizon = common_horizon(list(known.values()), limit)
    for strategy, found in known.items():
        reached = [time.at for time in found if time.reached]
        cell = Cell(measure, strategy, len(found), len(reached), median=median(found))
        if len(reached) == len(found):
            cell = _plain(measure, strategy, len(found), reached)
        yield replace(
            cell,
            mean=restricted_mean(found, horizon) if reached else None,
            interval=interval(found, horizon) if reached else None,
            horizon=horizon,
        )


def _plain(measure: str, strategy: str, runs: int, values: Sequence[float]) -> Cell:
    array = np.array(values, float)
    found = None
    if len(array) > 2 and np.ptp(array):
        low, high = band(array[:, None])
        found = Interval(float(low[0]), float(high[0]))
    low_end, middle, high_end = np.percentile(array, (25, 50, 75)).tolist()
    several = len(values) > 1
    return Cell(
        measure,
        strategy,
        runs,
        len(values),
        float(array.mean()),
        found,
        statistics.stdev(values) if several else None,
        middle,
        low_end if several else None,
        high_end if several else None,
    )


def title(measure: str) -> str:
    """Of a measure in a sentence."""
    return MEASURES[measure].title.replace(": ", " ")
