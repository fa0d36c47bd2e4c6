"""Times of goals that not every run reached: such a run is censored, never counted by its limit.

A run that was stopped (by its last step, or since the base knew enough) could have reached the goal
later: its time is known to be larger. A run whose robots went home or were all lost would never
have: its time is infinite. Sources: E. L. Kaplan, P. Meier, Nonparametric estimation from
incomplete observations, JASA 53 (1958) 457-481; P. Royston, M. K. B. Parmar, Restricted mean
survival time, BMC Medical Research Methodology 13 (2013) 152.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from usarsim_report.statistics import CONFIDENCE, SEED, Interval

RESAMPLES = 2_000
"""Bootstrap samples of an interval."""
Array = NDArray[np.float64]


class Time(NamedTuple):
    """When a goal was reached, or until when it was not.

    Attributes:
        at: steps; infinite: it never would have been.
    """

    at: float
    reached: bool = True

    def before(self, other: Time) -> bool:
        """Whether it is certain that this goal was reached first."""
        return self.reached and (self.at < other.at or (self.at == other.at and not other.reached))


def kaplan_meier(times: Sequence[Time]) -> tuple[Array, Array]:
    """The share of runs that have not reached the goal yet.

    Returns:
        Steps at which it falls, from 0 on, and the share from there on.
    """
    steps, shares = _curves(times, np.ones((1, len(times))))
    return steps, shares[0]


def restricted_mean(times: Sequence[Time], horizon: float) -> float:
    """Mean steps to the goal, or to the horizon where that comes first."""
    return float(_restricted(times, np.ones((1, len(times))), horizon)[0])


def resampled_means(times: Sequence[Time], horizon: float) -> Array:
    """(`RESAMPLES`,) restricted means of bootstrap samples; the same samples for equal counts."""
    return _restricted(times, resampled(len(times)), horizon)


def interval(times: Sequence[Time], horizon: float) -> Interval | None:
    """Of the restricted mean, by the percentile bootstrap over runs; None: they are all equal."""
    if len(times) < 3 or len(set(times)) == 1:
        return None
    means = resampled_means(times, horizon)
    low, high = np.percentile(means, _ENDS)
    return Interval(float(low), float(high))


def band(curves: Array) -> tuple[Array, Array]:
    """Pointwise interval of a mean curve, by the percentile bootstrap over its rows.

    Args:
        curves: (runs, points).
    """
    means = resampled(len(curves)) @ curves / len(curves)
    low, high = np.percentile(means, _ENDS, axis=0)
    return low, high


def resampled(count: int) -> Array:
    """How often each of so many runs is in each bootstrap sample; the same every time."""
    random = np.random.default_rng(SEED)
    found: Array = random.multinomial(count, np.full(count, 1 / count), RESAMPLES).astype(float)
    return found


def common_horizon(groups: Sequence[Sequence[Time]], limit: float) -> float:
    """How far all groups can be told: to the limit, or where the last censored run of one ends."""
    ends = [limit]
    for times in groups:
        last = max(times, key=lambda one: (one.at, not one.reached))
        if not last.reached:
            ends.append(last.at)
    return min(ends)


def median(times: Sequence[Time]) -> float | None:
    """The first step at which half of the runs are there; None: that is not known, or never."""
    steps, shares = kaplan_meier(times)
    there = np.flatnonzero(shares <= 0.5 + 1e-12)
    return float(steps[there[0]]) if len(there) else None


def log_rank(one: Sequence[Time], other: Sequence[Time], horizon: float) -> float | None:
    """P of both sides that two groups reach the goal alike; None: nobody reached it."""
    if not any(time.reached and time.at <= horizon for time in (*one, *other)):
        return None
    groups = [
        stats.CensoredData.right_censored(
            [min(time.at, horizon) for time in times],
            [not time.reached or time.at > horizon for time in times],
        )
        for times in (one, other)
    ]
    p = float(stats.logrank(*groups).pvalue)
    return p if math.isfinite(p) else None


_ENDS = (50 * (1 - CONFIDENCE), 50 * (1 + CONFIDENCE))


def _curves(times: Sequence[Time], weights: Array) -> tuple[Array, Array]:
    """Kaplan-Meier curves, one for each row of weights of the runs."""
    at = np.array([one.at for one in times], float)
    reached = np.array([one.reached for one in times])
    steps = np.unique(at[reached])
    falls = weights @ ((at[:, None] == steps) & reached[:, None])
    risk = weights @ (at[:, None] >= steps)
    kept = 1 - falls / np.where(risk > 0, risk, 1)
    ones = np.ones((len(weights), 1))
    return np.concatenate([[0.0], steps]), np.cumprod(np.hstack([ones, kept]), axis=1)


def _restricted(times: Sequence[Time], weights: Array, horizon: float) -> Array:
    steps, shares = _curves(times, weights)
    ends = np.minimum(np.append(steps, math.inf), horizon)
    found: Array = shares @ np.diff(ends)
    return found
