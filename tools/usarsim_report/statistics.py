"""Tests, intervals and effect sizes for two or more conditions, paired and unpaired.

Tests by ranks are exact for up to 50 values, ties included: the distribution of the rank sum is
counted, not approximated. Friedman's and Kruskal and Wallis's tests use the chi-squared
distribution. Everything drawn (bootstrap, permutations beyond what can be listed) depends on `SEED`
and the data alone. What cannot be computed (too few values, no spread) is None.

Measures are differences of clock times and means of few values, so equal ones differ in their last
bits. Two values, two differences, or a difference and zero, are equal if they differ by less than
`CLOSE` of the larger value measured; every test, mean and interval goes by that.

Sources: W. J. Conover, Practical Nonparametric Statistics, 3rd ed. (1999), chapters 3 and 5;
B. Efron, R. J. Tibshirani, An Introduction to the Bootstrap (1993), chapter 14 (BCa); D. S. Kerby,
The simple difference formula, Comprehensive Psychology 3 (2014) (matched rank-biserial);
J. Cohen, Statistical Power Analysis (1988) (d); N. Cliff, Psychological Bulletin 114 (1993)
494-509 (delta); S. Holm, Scandinavian Journal of Statistics 6 (1979) 65-70.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

SEED = 20240229
RESAMPLES = 9_999
"""Bootstrap samples of an interval."""
PERMUTATIONS = 20_000
"""Beyond so many sign changes or exchanges, as many are drawn."""
EXACT = 50
"""Tests by ranks are exact for so many values."""
CONFIDENCE = 0.95
CLOSE = 1e-9
"""Share of the larger value measured below which two numbers differ by rounding only."""

Array = NDArray[np.float64]
Numbers = Sequence[float]


@dataclass(frozen=True, slots=True)
class Interval:
    """From `low` to `high`, with 95 % confidence."""

    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Whether a value lies in it, ends included."""
        return self.low <= value <= self.high


@dataclass(frozen=True, slots=True)
class Summary:
    """Of one sample. sd: None for one value. interval: BCa, of the mean."""

    n: int
    mean: float
    median: float
    sd: float | None
    lower_quartile: float
    upper_quartile: float
    interval: Interval | None


@dataclass(frozen=True, slots=True)
class Paired:
    """Second less first condition, of the same participants.

    Attributes:
        n: pairs; those that count in ranks and signs are `changed`.
        mean, median: of the differences.
        interval: BCa, of their mean.
        t, t_p: paired t test.
        w, wilcoxon_p: sum of ranks of positive differences, zeros left out (Wilcoxon); p of both
            sides.
        exact: whether `wilcoxon_p` is.
        positive, negative: how many differences are.
        sign_p: sign test.
        permutation_p: of the mean, over changes of sign.
        rank_biserial: (W+ - W-) / (W+ + W-), from -1 to 1.
        dz: mean over standard deviation of the differences.
        sd: that standard deviation.
    """

    n: int
    mean: float
    median: float
    interval: Interval | None
    t: float | None
    t_p: float | None
    w: float
    wilcoxon_p: float
    exact: bool
    positive: int
    negative: int
    sign_p: float
    permutation_p: float | None
    rank_biserial: float | None
    dz: float | None
    sd: float | None

    @property
    def changed(self) -> int:
        """Pairs whose two values differ."""
        return self.positive + self.negative

    @property
    def direction(self) -> int:
        """1 if ranks say that the second condition has more, -1 if less, 0 if neither."""
        return _sign(self.rank_biserial or 0.0)

    @property
    def least_p(self) -> float:
        """The smallest p that ranks of so many pairs without ties can have."""
        return min(1.0, 2.0 / 2.0**self.changed)


@dataclass(frozen=True, slots=True)
class Unpaired:
    """Second less first condition, of different participants.

    Attributes:
        n: of the first and of the second.
        mean: difference of means. interval: BCa, of it.
        t, t_p: Welch's t test.
        u, mann_whitney_p: pairs in which the second is larger, ties half; p of both sides.
        exact: whether `mann_whitney_p` is.
        permutation_p: of the difference of means, over exchanges.
        delta: Cliff's, from -1 to 1.
        d: difference of means over the pooled standard deviation (Cohen).
        sd: that standard deviation.
    """

    n: tuple[int, int]
    mean: float
    interval: Interval | None
    t: float | None
    t_p: float | None
    u: float
    mann_whitney_p: float
    exact: bool
    permutation_p: float | None
    delta: float
    d: float | None
    sd: float | None

    @property
    def direction(self) -> int:
        """1 if ranks say that the second condition has more, -1 if less, 0 if neither."""
        return _sign(self.delta)

    @property
    def least_p(self) -> float:
        """The smallest p that ranks of so many values without ties can have."""
        return min(1.0, 2.0 / math.comb(sum(self.n), self.n[0]))


@dataclass(frozen=True, slots=True)
class Several:
    """Three or more conditions. effect: Kendall's W (paired) or epsilon squared, from 0 to 1."""

    test: str
    statistic: float
    freedom: int
    p: float
    effect: float


def rejects(p: float, alpha: float) -> bool:
    """Whether a test rejects at its level: p is at most alpha, but for rounding."""
    return p <= alpha * (1.0 + CLOSE)


def settled(values: Numbers | Array, sizes: Numbers | Array | None = None) -> Array:
    """Values of which those that differ by rounding only are equal.

    Neighbours by size are joined, and the least value of each group stands for all of it.

    Args:
        values: any numbers.
        sizes: for each the larger value measured that it was made of; by default itself.
    """
    array = np.asarray(values, dtype=float)
    if not len(array):
        return array
    measured = np.abs(array if sizes is None else np.asarray(sizes, dtype=float))
    order = np.argsort(array, kind="stable")
    ordered, measured = array[order], measured[order]
    gaps = np.diff(ordered)
    begins = (gaps > 0.0) & (gaps >= CLOSE * np.maximum(measured[1:], measured[:-1]))
    group = np.concatenate(([0], np.cumsum(begins)))
    first = np.concatenate(([True], begins))
    found: Array = np.empty_like(array)
    found[order] = ordered[first][group]
    return found


def differences(first: Numbers | Array, second: Numbers | Array) -> Array:
    """Second less first, pair by pair; zero, and equal to others, where rounding alone differs."""
    one, other = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    sizes = np.maximum(np.abs(one), np.abs(other))
    raw: Array = other - one
    raw[np.abs(raw) < CLOSE * sizes] = 0.0
    kept = raw != 0.0
    raw[kept] = np.sign(raw[kept]) * settled(np.abs(raw[kept]), sizes[kept])
    return raw


def summary(values: Numbers) -> Summary | None:
    """Of a sample; None if it is empty."""
    if not values:
        return None
    array = settled(values)
    low, middle, high = np.percentile(array, (25.0, 50.0, 75.0))
    return Summary(
        len(array),
        _mean(array),
        float(middle),
        _spread(array) if len(array) > 1 else None,
        float(low),
        float(high),
        bca(array),
    )


def bca(*samples: Numbers | Array) -> Interval | None:
    """Interval of a mean, or of the second mean less the first, by the bias-corrected and
    accelerated bootstrap; None for samples of fewer than three values or without spread."""
    arrays = [np.asarray(one, dtype=float) for one in samples]
    if any(len(one) < 3 for one in arrays) or all(np.ptp(one) == 0.0 for one in arrays):
        return None

    def statistic(*resampled: Array, axis: int = -1) -> Array:
        means = [np.mean(one, axis=axis) for one in resampled]
        difference: Array = means[-1] - means[0] if len(means) > 1 else means[0]
        return difference

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = stats.bootstrap(
            arrays,
            statistic,
            n_resamples=RESAMPLES,
            confidence_level=CONFIDENCE,
            method="BCa",
            rng=np.random.default_rng(SEED),
        ).confidence_interval
    if not (math.isfinite(found.low) and math.isfinite(found.high)):
        return None
    slack = CLOSE * max(float(np.max(np.abs(one))) for one in arrays)
    low, high = (float(one) if abs(one) >= slack else 0.0 for one in found)
    return Interval(low, high)


def paired(first: Numbers, second: Numbers) -> Paired | None:
    """Compare two conditions of the same participants; None without a pair.

    Args:
        first, second: values in the same order of participants.
    """
    found = differences(first, second)
    if not len(found):
        return None
    slack = CLOSE * float(np.mean(np.maximum(np.abs(first), np.abs(second))))
    spread = _spread(found)
    mean = _mean(found, slack)
    t = t_p = dz = sd = None
    if spread > 0.0:
        student = stats.ttest_1samp(found, 0.0)
        t, t_p = float(student.statistic), float(student.pvalue)
        dz, sd = mean / spread, spread
    w, lost, p, exact = signed_rank(found)
    positive, negative = int(np.sum(found > 0)), int(np.sum(found < 0))
    changed = positive + negative
    return Paired(
        n=len(found),
        mean=mean,
        median=float(np.median(found)),
        interval=bca(found),
        t=t,
        t_p=t_p,
        w=w,
        wilcoxon_p=p,
        exact=exact,
        positive=positive,
        negative=negative,
        sign_p=float(stats.binomtest(positive, changed).pvalue) if changed else 1.0,
        permutation_p=_permutation_p((found,), "samples", slack),
        rank_biserial=(w - lost) / (w + lost) if changed else None,
        dz=dz,
        sd=sd,
    )


def signed_rank(differences: Numbers | Array) -> tuple[float, float, float, bool]:
    """Wilcoxon's test of differences; zeros are left out, ties share their mean rank.

    Returns:
        Sums of the ranks of positive and of negative differences, p of both sides, and whether it
        is exact.
    """
    kept = np.asarray(differences, dtype=float)
    kept = kept[kept != 0.0]
    if not len(kept):
        return 0.0, 0.0, 1.0, True
    kept = np.sign(kept) * settled(np.abs(kept))
    ranks = stats.rankdata(np.abs(kept))
    won, lost = float(np.sum(ranks[kept > 0])), float(np.sum(ranks[kept < 0]))
    if len(kept) <= EXACT:
        doubled = np.rint(2.0 * ranks).astype(int)
        counts = np.zeros(int(np.sum(doubled)) + 1)
        counts[0] = 1.0
        for rank in doubled:  # each rank is added to the sum, or is not
            counts[rank:] += counts[: len(counts) - rank].copy()
        return won, lost, _two_sided(counts, round(2.0 * won)), True
    found = stats.wilcoxon(kept, correction=False, method="asymptotic")
    return won, lost, float(found.pvalue), False


def unpaired(first: Numbers, second: Numbers) -> Unpaired | None:
    """Compare two conditions of different participants; None if one has no value."""
    if not len(first) or not len(second):
        return None
    together = settled([*first, *second])
    one, other = together[: len(first)], together[len(first) :]
    slack = CLOSE * float(np.mean(np.abs(one)) + np.mean(np.abs(other)))
    mean = _mean(other) - _mean(one)
    mean = mean if abs(mean) >= slack else 0.0
    t = t_p = d = sd = None
    spreads = _spread(one), _spread(other)
    if len(one) > 1 and len(other) > 1 and any(spreads):
        squares = (len(one) - 1) * spreads[0] ** 2 + (len(other) - 1) * spreads[1] ** 2
        found = stats.ttest_ind(other, one, equal_var=False)
        t, t_p = float(found.statistic), float(found.pvalue)
        sd = math.sqrt(squares / (len(one) + len(other) - 2))
        d = mean / sd
    u, p, exact = rank_sum(one, other)
    return Unpaired(
        n=(len(one), len(other)),
        mean=mean,
        interval=bca(one, other),
        t=t,
        t_p=t_p,
        u=u,
        mann_whitney_p=p,
        exact=exact,
        permutation_p=_permutation_p((other, one), "independent", slack),
        delta=2.0 * u / (len(one) * len(other)) - 1.0,
        d=d,
        sd=sd,
    )


def rank_sum(first: Numbers | Array, second: Numbers | Array) -> tuple[float, float, bool]:
    """Mann and Whitney's test.

    Returns:
        U, the pairs in which the second is larger (ties count half); p of both sides; whether it
        is exact.
    """
    one, other = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    together = settled(np.concatenate((other, one)))
    ranks = stats.rankdata(together)
    u = float(np.sum(ranks[: len(other)])) - len(other) * (len(other) + 1) / 2.0
    if len(together) <= EXACT:
        doubled = np.rint(2.0 * ranks).astype(int)
        counts = np.zeros((len(other) + 1, int(np.sum(doubled)) + 1))
        counts[0, 0] = 1.0
        for rank in doubled:  # each value belongs to the second sample, or does not
            counts[1:, rank:] += counts[:-1, : counts.shape[1] - rank].copy()
        at = round(2.0 * (u + len(other) * (len(other) + 1) / 2.0))
        return u, _two_sided(counts[-1], at), True
    if np.ptp(together) == 0.0:
        return u, 1.0, False
    found = stats.mannwhitneyu(
        together[: len(other)],
        together[len(other) :],
        use_continuity=False,
        method="asymptotic",
    )
    return u, float(found.pvalue), False


def several_paired(rows: Sequence[Numbers]) -> Several | None:
    """Friedman's test; each row has the values of one participant in all conditions."""
    table = np.asarray(rows, dtype=float)
    if table.ndim != 2 or len(table) < 2 or table.shape[1] < 3:
        return None
    ranked = np.apply_along_axis(settled, 1, table)
    if np.all(np.ptp(ranked, axis=1) == 0.0):
        return None
    found = stats.friedmanchisquare(*ranked.T)
    freedom = table.shape[1] - 1
    statistic = float(found.statistic)
    effect = statistic / (len(table) * freedom)
    return Several("Friedman", statistic, freedom, float(found.pvalue), effect)


def several_unpaired(groups: Sequence[Numbers]) -> Several | None:
    """Kruskal and Wallis's test of independent groups."""
    if len(groups) < 3 or any(not len(one) for one in groups):
        return None
    count = sum(len(one) for one in groups)
    together = settled(np.concatenate([np.asarray(one, dtype=float) for one in groups]))
    if np.ptp(together) == 0.0:
        return None
    ends = np.cumsum([len(one) for one in groups])[:-1]
    found = stats.kruskal(*np.split(together, ends))
    statistic = float(found.statistic)
    return Several(
        "Kruskal-Wallis", statistic, len(groups) - 1, float(found.pvalue), statistic / (count - 1)
    )


def holm(values: Sequence[float | None]) -> list[float | None]:
    """P values corrected for how many there are; missing ones stay so and do not count."""
    known = sorted((p, place) for place, p in enumerate(values) if p is not None)
    corrected: list[float | None] = [None] * len(values)
    largest = 0.0
    for rank, (p, place) in enumerate(known):
        largest = max(largest, min(1.0, (len(known) - rank) * p))
        corrected[place] = largest
    return corrected


def _two_sided(counts: Array, at: int) -> float:
    """Twice the smaller tail of a distribution that is given by counts, at most 1."""
    tail = min(float(np.sum(counts[: at + 1])), float(np.sum(counts[at:])))
    return min(1.0, 2.0 * tail / float(np.sum(counts)))


def _permutation_p(samples: tuple[Array, ...], kind: str, slack: float) -> float | None:
    """Of the mean, or of the difference of means; all permutations are listed if they are few.

    Means that differ by no more than `slack` are equally extreme.
    """
    if any(len(one) < 2 for one in samples):
        return None

    def statistic(*drawn: Array, axis: int = -1) -> Array:
        means = [np.mean(one, axis=axis) for one in drawn]
        difference: Array = means[0] - means[1] if len(means) > 1 else means[0]
        return difference

    if np.ptp(np.concatenate((*samples, [0.0] if kind == "samples" else []))) == 0.0:
        return 1.0
    found = stats.permutation_test(
        samples,
        statistic,
        permutation_type=kind,
        vectorized=True,
        n_resamples=PERMUTATIONS,
        rng=np.random.default_rng(SEED),
    )
    drawn, at = found.null_distribution, float(found.statistic)
    sizes = [len(one) for one in samples]
    listed = 2 ** sizes[0] if kind == "samples" else math.comb(sum(sizes), sizes[0])
    # What was found is one of the permutations: it is among those listed, and added to those drawn.
    own = 0 if listed <= PERMUTATIONS else 1
    tails = np.sum(drawn <= at + slack), np.sum(drawn >= at - slack)
    return min(1.0, 2.0 * (float(min(tails)) + own) / (len(drawn) + own))


def _mean(values: Array, slack: float = 0.0) -> float:
    """Mean; of equal values exactly their value, of those that cancel but for `slack` exactly 0."""
    mean = float(values[0]) if np.ptp(values) == 0.0 else float(np.mean(values))
    return mean if abs(mean) >= slack else 0.0


def _spread(values: Array) -> float:
    """Standard deviation of a sample; of one value, or of equal ones, exactly 0."""
    return float(np.std(values, ddof=1)) if np.ptp(values) > 0.0 else 0.0


def _sign(value: float) -> int:
    return (value > 0.0) - (value < 0.0)
