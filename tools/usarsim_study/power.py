"""How many participants: power of paired tests, by simulation and in closed form.

Differences are drawn from a normal distribution with standard deviation 1 and mean dz. The closed
form for the t test is the noncentral t distribution with n - 1 degrees of freedom and
noncentrality dz sqrt(n) (J. Cohen, Statistical Power Analysis, 1988).
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from scipy import stats

from usarsim_report.statistics import CLOSE, SEED, Array

SIMULATIONS = 20_000
MOST = 1000
"""Participants beyond which nobody looks for more."""

Test = Literal["t", "wilcoxon"]


def closed_form(dz: float, n: int, alpha: float = 0.05) -> float:
    """Power of the paired t test, both sides."""
    critical = stats.t.ppf(1.0 - alpha / 2.0, n - 1)
    shift = dz * math.sqrt(n)
    upper = stats.nct.sf(critical, n - 1, shift)
    return float(upper + stats.nct.cdf(-critical, n - 1, shift))


def simulated(
    dz: float,
    n: int,
    alpha: float = 0.05,
    test: Test = "t",
    *,
    simulations: int = SIMULATIONS,
    seed: int = SEED,
) -> float:
    """Share of simulated studies in which a paired test rejects.

    Args:
        dz: true mean difference over standard deviation.
        n: pairs, at least 2; at most 50 for `wilcoxon`, which is exact.
        alpha: level.
        test: which one.
        simulations: how many studies.
        seed: of the draws.
    """
    drawn = np.random.default_rng(seed).normal(dz, 1.0, (simulations, n))
    if test == "t":
        t = np.mean(drawn, axis=1) / (np.std(drawn, axis=1, ddof=1) / math.sqrt(n))
        return float(np.mean(np.abs(t) >= stats.t.ppf(1.0 - alpha / 2.0, n - 1)))
    ranks = np.argsort(np.argsort(np.abs(drawn), axis=1), axis=1) + 1
    won = np.sum(ranks * (drawn > 0), axis=1)
    return float(np.mean(_rank_p(n)[won] <= alpha * (1.0 + CLOSE)))


def _rank_p(n: int) -> Array:
    """P of both sides for each possible rank sum of n pairs without ties."""
    counts = np.zeros(n * (n + 1) // 2 + 1)
    counts[0] = 1.0
    for rank in range(1, n + 1):
        counts[rank:] += counts[:-rank].copy()
    share = counts / np.sum(counts)
    below, above = np.cumsum(share), np.cumsum(share[::-1])[::-1]
    return np.minimum(1.0, 2.0 * np.minimum(below, above))


def needed(dz: float, power: float = 0.8, alpha: float = 0.05) -> int | None:
    """The fewest pairs with which the t test has so much power; None: more than `MOST`."""
    return next((n for n in range(2, MOST + 1) if closed_form(dz, n, alpha) >= power), None)
