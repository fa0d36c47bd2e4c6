"""Figures that are made of moments, values and pictures. All times are seconds."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from statistics import median

import numpy as np

from usarsim_bench.recording import Chunk, Sample, lines, real_time_factor
from usarsim_bench.watching import View, waits

_SENSOR = re.compile(rb"SEN .*?\{Type ([^\s{}]+)\} ?\{Name ([^\s{}]+)")
_TIMED_SENSOR = re.compile(rb"SEN \{Time ([0-9.]+)\} ?\{Type [^\s{}]+\} ?\{Name ([^\s{}]+)")


def p99(values: Sequence[float]) -> float:
    """The 99th percentile of values."""
    return float(np.percentile(values, 99.0))


def period(times: Sequence[float]) -> float:
    """The usual time between two moments of a stream: the median of all gaps.

    Raises:
        ValueError: for fewer than two moments.
    """
    if len(times) < 2:
        raise ValueError("a period needs two moments")
    return median(later - earlier for earlier, later in pairwise(times))


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


def sensor_samples(chunks: Iterable[Chunk], name: str) -> list[Sample]:
    """Arrival and simulated time of every line of one sensor, if its lines tell their time."""
    found = ((moment, _TIMED_SENSOR.match(line)) for moment, line in lines(chunks))
    wanted = name.encode("latin-1")
    return [(moment, float(told[1])) for moment, told in found if told and told[2] == wanted]


def streams(chunks: Iterable[Chunk]) -> dict[str, list[float]]:
    """Arrivals of every periodic line: `STA`, and type and first name of each sensor line."""
    found: dict[str, list[float]] = {}
    for moment, line in lines(chunks):
        name = stream_of(line)
        if name is not None:
            found.setdefault(name, []).append(moment)
    return found


def stream_of(line: bytes) -> str | None:
    """Which periodic line this is: `STA`, or type and first name of a sensor line; else None."""
    if line.startswith(b"STA "):
        return "STA"
    sensor = _SENSOR.match(line)
    return b" ".join(sensor.groups()).decode("latin-1") if sensor else None


@dataclass(frozen=True, slots=True)
class ViewerTrial:
    """What one viewer got over a span of time."""

    pictures: float  # received per second
    news: float  # pictures per second that differed from the one before
    median: float  # s from asking to the last byte; median and 99th percentile (`waits`)
    tail: float
    longest: float  # s, the longest of them
    octets: float  # received per second


def summed_up(pictures: Sequence[View], start: float, stop: float) -> ViewerTrial:
    """What came within a span of wall time, and how long pictures took that were on their way.

    Args:
        pictures: all that the viewer got, the one too that was on its way at the end of the span.
        start, stop: the span, s of `time.perf_counter`.

    Raises:
        BenchError: if no picture was asked for.
    """
    seen = [one for one in pictures if start <= one.come <= stop]
    taken = waits(pictures, start, stop)
    news = sum(one.content != before.content for before, one in pairwise(seen))
    return ViewerTrial(
        pictures=len(seen) / (stop - start),
        news=news / (stop - start),
        median=median(taken),
        tail=p99(taken),
        longest=max(taken),
        octets=sum(one.octets for one in seen) / (stop - start),
    )
