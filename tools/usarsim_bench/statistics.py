"""From moments and values to figures. Pure functions; all times are seconds."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import combinations, pairwise
from statistics import median

Sample = tuple[float, float]
"""A moment of wall time and the simulated time (or another value) that belongs to it."""


def percentile(values: Sequence[float], percent: float) -> float:
    """The value below which a share of all values lies, interpolated between neighbours.

    Args:
        values: at least one, in any order.
        percent: from 0 (the least) to 100 (the greatest).

    Raises:
        ValueError: without values, or for a share outside the range.
    """
    if not values:
        raise ValueError("a percentile needs at least one value")
    if not 0.0 <= percent <= 100.0:
        raise ValueError(f"percent must be from 0 to 100, not {percent!r}")
    ordered = sorted(values)
    place = (len(ordered) - 1) * percent / 100.0
    below = math.floor(place)
    above = min(below + 1, len(ordered) - 1)
    return ordered[below] + (ordered[above] - ordered[below]) * (place - below)


def real_time_factor(samples: Sequence[Sample], edge: float = 0.0) -> float:
    """Simulated seconds per wall second over all samples.

    Args:
        samples: arrivals in order, with the simulated times that they tell.
        edge: s of wall time at either end of which the promptest sample counts, the one whose
            arrival lags its simulated time least, instead of the outermost. A line that came
            late, because the reader had to wait for a processor, is not simulated time lost.

    Raises:
        ValueError: if the samples do not span any wall time, or not more than two edges.
    """
    if len(samples) < 2 or samples[-1][0] - samples[0][0] <= 2.0 * edge:
        raise ValueError(f"the samples span no more than {2.0 * edge:g} s")
    opening = [sample for sample in samples if sample[0] <= samples[0][0] + edge]
    closing = [sample for sample in samples if sample[0] >= samples[-1][0] - edge]
    first, last = min(opening, key=_lag), min(closing, key=_lag)
    return (last[1] - first[1]) / (last[0] - first[0])


def _lag(sample: Sample) -> float:
    return sample[0] - sample[1]


def worst_window(samples: Sequence[Sample], width: float) -> float:
    """The lowest real-time factor of any stretch of samples at least `width` long.

    Each stretch begins at a sample and ends with the first one that is `width` of wall time later;
    a stretch that stalls is therefore longer than `width`, never cut short.

    Raises:
        ValueError: if the samples span less than `width`.
    """
    walls = [wall for wall, _ in samples]
    factors = []
    for start, (wall, _) in enumerate(samples):
        # Half a nanosecond keeps a stretch of exactly the width from being missed by rounding.
        stop = bisect_left(walls, wall + width - 5e-10)
        if stop == len(samples):
            break
        factors.append(real_time_factor((samples[start], samples[stop])))
    if not factors:
        raise ValueError(f"the samples span less than {width:g} s")
    return min(factors)


def period(times: Sequence[float]) -> float:
    """The usual time between two moments of a stream: the median of all gaps.

    Raises:
        ValueError: for fewer than two moments.
    """
    if len(times) < 2:
        raise ValueError("a period needs two moments")
    return median(later - earlier for earlier, later in pairwise(times))


def period_errors(times: Sequence[float], expected: float) -> list[float]:
    """By how much each time between two moments differs from what it should be, s, without sign."""
    return [abs(later - earlier - expected) for earlier, later in pairwise(times)]


def rate(times: Sequence[float], start: float, stop: float) -> float:
    """Moments per second within a span.

    Raises:
        ValueError: if the span has no length.
    """
    if stop <= start:
        raise ValueError("a rate needs a span of time")
    return sum(start <= moment <= stop for moment in times) / (stop - start)


def longest_extra_gap(times: Sequence[float], start: float, stop: float) -> float:
    """By how much the longest silence of a stream within a span exceeds its period.

    A silence counts if it ends within the span, or lasts until its end: a stream that dies is
    found too.

    Args:
        times: ordered moments of the whole run, from which the period is taken.
        start, stop: the span.

    Returns:
        Seconds; negative if every silence was shorter than the period.

    Raises:
        ValueError: for fewer than two moments, or none before the end of the span.
    """
    usual = period(times)
    first, last = bisect_left(times, start), bisect_right(times, stop)
    if last == 0:
        raise ValueError("the stream had not begun")
    moments = [*times[max(0, first - 1) : last], stop]
    return max(later - earlier for earlier, later in pairwise(moments)) - usual


def trend(samples: Sequence[Sample]) -> float:
    """Change of a value per second: the median slope of all pairs of samples (Theil and Sen).

    Single steps and outliers, such as an allocator that takes a page now and then, do not move it.

    Raises:
        ValueError: if the samples do not span any time.
    """
    slopes = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in combinations(samples, 2) if b[0] != a[0]]
    if not slopes:
        raise ValueError("a trend needs samples at two moments")
    return median(slopes)
