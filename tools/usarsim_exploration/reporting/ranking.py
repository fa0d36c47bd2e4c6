"""Which strategy beats which: mean ranks over blocks, and pairs, by signs alone.

A block is what was the same for all: setting and seed. Within it one strategy beats another if that
is certain, also from runs that were stopped before the goal; what is not certain is a tie. Sources:
E. A. Gehan, A generalized Wilcoxon test for comparing arbitrarily singly-censored samples,
Biometrika 52 (1965) 203-223 (scores); J. Demsar, Statistical comparisons of classifiers over
multiple data sets, JMLR 7 (2006) 1-30 (Friedman, Nemenyi, the diagram).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from usarsim_exploration.reporting.survival import Time
from usarsim_report.statistics import Several, holm, several_paired

ALPHA = 0.05


@dataclass(frozen=True, slots=True)
class Pair:
    """Two strategies. wins, losses: blocks in which the first, or the second was better.

    Attributes:
        p: sign test, of both sides. holm: corrected for the number of pairs.
    """

    first: str
    second: str
    wins: int
    losses: int
    ties: int
    p: float
    holm: float


@dataclass(frozen=True, slots=True)
class Ranking:
    """Strategies by mean rank, the best first.

    Attributes:
        ranks: mean rank by strategy, 1 would be best in every block.
        blocks: how many there are in which all have run.
        friedman: whether they differ; None: cannot be told.
        difference: mean ranks that differ by less are not told apart (Nemenyi, 5 %).
        pairs: all of them.
    """

    ranks: dict[str, float]
    blocks: int
    friedman: Several | None
    difference: float
    pairs: tuple[Pair, ...]

    def alike(self) -> list[tuple[str, str]]:
        """First and last of each largest group that is not told apart."""
        names, found = list(self.ranks), []
        last = 0
        for start, name in enumerate(names):
            end = start
            while (
                end + 1 < len(names)
                and self.ranks[names[end + 1]] - self.ranks[name] < self.difference
            ):
                end += 1
            if end > max(start, last):
                found.append((name, names[end]))
                last = end
        return found


def rank(results: Mapping[str, Mapping[object, Time]]) -> Ranking | None:
    """Rank strategies.

    Args:
        results: by strategy and block; smaller is better.

    Returns:
        None: there are fewer than two strategies, or no block that all of them have.
    """
    names = list(results)
    blocks = [one for one in results[names[0]] if all(one in results[name] for name in names[1:])]
    if len(names) < 2 or not blocks:
        return None
    certain = _certain([[results[name][block] for name in names] for block in blocks])
    scores = certain.sum(axis=1) - certain.sum(axis=2)  # lost less won
    means = stats.rankdata(scores, axis=1).mean(axis=0)
    order = sorted(range(len(names)), key=lambda one: (means[one], names[one]))
    quantile = stats.studentized_range.ppf(1 - ALPHA, len(names), math.inf) / math.sqrt(2)
    return Ranking(
        {names[one]: float(means[one]) for one in order},
        len(blocks),
        several_paired(scores.tolist()),
        float(quantile * math.sqrt(len(names) * (len(names) + 1) / (6 * len(blocks)))),
        _pairs([names[one] for one in order], certain[:, order][:, :, order]),
    )


def _certain(rows: Sequence[Sequence[Time]]) -> NDArray[np.int64]:
    """(blocks, strategies, strategies) 1 where the first is better than the second."""
    return np.array([[[one.before(other) for other in row] for one in row] for row in rows], int)


def _pairs(names: Sequence[str], certain: NDArray[np.int64]) -> tuple[Pair, ...]:
    counted = []
    for a, b in combinations(range(len(names)), 2):
        wins, losses = int(certain[:, a, b].sum()), int(certain[:, b, a].sum())
        decided = wins + losses
        p = float(stats.binomtest(wins, decided).pvalue) if decided else 1.0
        counted.append((names[a], names[b], wins, losses, len(certain) - decided, p))
    corrected = holm([one[-1] for one in counted])
    return tuple(
        Pair(*one, p if p is not None else 1.0) for one, p in zip(counted, corrected, strict=True)
    )
