"""Whether runs on cells, of points or discs, and runs of robots with physics say the same.

Compared are settings that differ by nothing but the backend. Coverage is compared at equal
distances, as a step of the grid costs no time; strategies are compared by their order (M. G.
Kendall, A new measure of rank correlation, Biometrika 30 (1938) 81-93; tau-b, which counts ties).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from usarsim_exploration.measures import MEASURES
from usarsim_exploration.reporting.comparison import RANKED, Comparison, Group
from usarsim_exploration.reporting.runs import DISCS, GRID, SERVER, Array, Curves, Run
from usarsim_exploration.reporting.survival import (
    RESAMPLES,
    Time,
    band,
    common_horizon,
    resampled_means,
    restricted_mean,
)
from usarsim_report.statistics import CONFIDENCE, Interval

POINTS = 100
"""Distances at which coverage is compared, beside none."""
FEWEST = 3
"""Strategies of which fewer have no order worth telling."""
_ENDS = (50 * (1 - CONFIDENCE), 50 * (1 + CONFIDENCE))


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """One strategy at one level: coverage in percent by distance. low, high: None of few runs."""

    runs: int
    mean: Array
    low: Array | None
    high: Array | None


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """One strategy at both levels.

    Attributes:
        distance: (`POINTS` + 1,) cells driven by all robots, as far as both levels drove.
        gap: largest difference of the means, percent points. mean_gap: mean of it.
    """

    distance: Array
    grid: Level
    real: Level
    gap: float
    mean_gap: float


@dataclass(frozen=True, slots=True, eq=False)
class Order:
    """How alike levels order strategies by a goal.

    Attributes:
        times: (grid, real) restricted mean steps by strategy.
        tau: Kendall's; None: fewer than `FEWEST` strategies, or all are equal. interval: of it.
        resampled: tau of each bootstrap sample, NaN where there is none.
    """

    times: Mapping[str, tuple[float, float]]
    tau: float | None
    interval: Interval | None
    resampled: Array


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """A setting at both levels. coverage: by strategy. orders: by goal."""

    grid: Group
    real: Group
    coverage: Mapping[str, Coverage]
    orders: Mapping[str, Order]


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """All settings that were run at a level of cells and with physics.

    Attributes:
        cells: the backend that physics is compared with. over_all: mean tau, and its interval, by
            goal.
    """

    cells: str
    pairs: Sequence[Pair]
    over_all: Mapping[str, tuple[float, Interval | None]]


def agree(found: Comparison) -> list[Agreement]:
    """Compare physics with each level of cells at which something was run as well."""
    groups = {group.setting: group for group in found.groups}
    levels = []
    for cells in (GRID, DISCS):
        pairs = [
            _pair(other, group)
            for group in found.groups
            if group.setting.backend == SERVER
            and (other := groups.get(replace(group.setting, backend=cells))) is not None
            and other.runs.keys() & group.runs.keys()
        ]
        if pairs:
            levels.append(Agreement(cells, pairs, _over_all(pairs)))
    return levels


def _over_all(pairs: Sequence[Pair]) -> dict[str, tuple[float, Interval | None]]:
    over_all = {}
    for goal in RANKED:
        orders = [one.orders[goal] for one in pairs if one.orders[goal].tau is not None]
        if orders:
            taus = [order.tau for order in orders if order.tau is not None]
            means = np.mean([order.resampled for order in orders], axis=0)
            over_all[goal] = float(np.mean(taus)), _interval(means)
    return over_all


def costs(group: Group) -> dict[str, dict[str, float]]:
    """What only real robots have, by measure and strategy: means over the runs that tell it."""
    found: dict[str, dict[str, float]] = {}
    for name, one in MEASURES.items():
        for strategy, runs in group.runs.items():
            values = [value for run in runs if (value := run.measures.get(name)) is not None]
            if (one.real or name == "collisions") and values:
                found.setdefault(name, {})[strategy] = float(np.mean(values))
    return found


def _pair(grid: Group, real: Group) -> Pair:
    both = [name for name in grid.runs if name in real.runs]
    told = ((name, _coverage(grid.runs[name], real.runs[name])) for name in both)
    coverage = {name: one for name, one in told if one is not None}
    return Pair(grid, real, coverage, {goal: _order(grid, real, goal) for goal in RANKED})


def _coverage(grid: Sequence[Run], real: Sequence[Run]) -> Coverage | None:
    curves = [
        [run.curves for run in runs if run.curves is not None and run.curves.distance is not None]
        for runs in (grid, real)
    ]
    farthest = [max((_driven(one)[-1] for one in mine), default=0.0) for mine in curves]
    if min(farthest) <= 0:
        return None
    distance = np.linspace(0, min(farthest), POINTS + 1)
    one, other = (_level(distance, mine) for mine in curves)
    gaps = np.abs(one.mean - other.mean)
    return Coverage(distance, one, other, float(gaps.max()), float(gaps.mean()))


def _driven(curve: Curves) -> Array:
    assert curve.distance is not None
    return curve.distance


def _level(distance: Array, curves: Sequence[Curves]) -> Level:
    """The team's coverage; a run that ended keeps its last value."""
    rows = []
    for one in curves:
        driven = _driven(one)
        last = np.append(np.diff(driven) > 0, True)  # of the steps in which nobody moved
        rows.append(100 * np.interp(distance, driven[last], one.team[last]))
    known = np.array(rows)
    low, high = band(known) if len(known) > 2 else (None, None)
    return Level(len(known), known.mean(axis=0), low, high)


def _order(grid: Group, real: Group, goal: str) -> Order:
    """Times are means restricted to a horizon that all strategies of a level have."""
    times = [_times(one, goal) for one in (grid, real)]
    both = [name for name in times[0] if name in times[1]]
    means, samples = [], []
    for one, mine in zip((grid, real), times, strict=True):
        horizon = common_horizon([mine[name] for name in both], one.limit) if both else 0.0
        means.append([restricted_mean(mine[name], horizon) for name in both])
        samples.append(np.array([resampled_means(mine[name], horizon) for name in both]).T)
    pairs = dict(zip(both, zip(*means, strict=True), strict=True))
    if len(both) < FEWEST:
        return Order(pairs, None, None, np.full(RESAMPLES, np.nan))
    tau = float(_tau(np.array(means[:1]), np.array(means[1:]))[0])
    if np.isnan(tau):
        return Order(pairs, None, None, np.full(RESAMPLES, np.nan))
    taus = _tau(samples[0], samples[1])
    return Order(pairs, tau, _interval(taus), taus)


def _times(group: Group, goal: str) -> dict[str, list[Time]]:
    found = {
        name: [time for run in runs if (time := run.time(goal)) is not None]
        for name, runs in group.runs.items()
    }
    return {name: times for name, times in found.items() if times}


def _tau(one: Array, other: Array) -> Array:
    """Kendall's tau-b of each row of values, (rows, strategies); NaN where all are equal."""
    first, second = np.array(list(itertools.combinations(range(one.shape[1]), 2))).T
    a, b = (np.sign(values[:, first] - values[:, second]) for values in (one, other))
    with np.errstate(invalid="ignore"):
        found: Array = (a * b).sum(axis=1) / np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1))
    return found


def _interval(taus: Array) -> Interval | None:
    """Of bootstrap samples; None: they are all equal, as those of single runs are."""
    known = taus[np.isfinite(taus)]
    if not len(known) or np.ptp(known) == 0:
        return None
    low, high = np.percentile(known, _ENDS).tolist()
    return Interval(low, high)
