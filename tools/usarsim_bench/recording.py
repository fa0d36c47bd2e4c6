"""What a client received, taken apart afterwards, so that reading costs little while it counts, and
the figures that are made of moments and values. All times are seconds.
"""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, pairwise
from statistics import median

Sample = tuple[float, float]
"""A moment of wall time and the simulated time (or another value) that belongs to it."""


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


Chunk = tuple[float, bytes]
"""Bytes of one read call and the wall time at which they were there."""

_END = b"\r\n"
_STATUS_TIME = re.compile(rb"STA .*?\{Time ([0-9.]+)\}")
_TIMED_SENSOR = re.compile(rb"SEN \{Time ([0-9.]+)\} ?\{Type [^\s{}]+\} ?\{Name ([^\s{}]+)")
_SENSOR = re.compile(rb"SEN .*?\{Type ([^\s{}]+)\} ?\{Name ([^\s{}]+)")
_START_POSES = re.compile(r"NFO \{StartPoses \d+\} \{(.*)\}")
_WORDS_PER_POSE = 3
"""Tag, location and orientation (protocol reference 4.2)."""


def lines(chunks: Iterable[Chunk]) -> Iterator[tuple[float, bytes]]:
    """Whole lines without their ends, each with the moment at which its last byte was there."""
    rest = b""
    for moment, data in chunks:
        *whole, rest = (rest + data).split(_END)
        for line in whole:
            yield moment, line


def status_samples(chunks: Iterable[Chunk]) -> list[Sample]:
    """Arrival and simulated time of every STA line."""
    found = ((moment, _STATUS_TIME.match(line)) for moment, line in lines(chunks))
    return [(moment, float(status[1])) for moment, status in found if status]


def sensor_samples(chunks: Iterable[Chunk], name: str) -> list[Sample]:
    """Arrival and simulated time of every line of one sensor, if its lines tell their time."""
    found = ((moment, _TIMED_SENSOR.match(line)) for moment, line in lines(chunks))
    wanted = name.encode("latin-1")
    return [(moment, float(told[1])) for moment, told in found if told and told[2] == wanted]


def first_reading(chunks: Iterable[Chunk]) -> float | None:
    """Arrival of the first line of any sensor; None if there is none."""
    return next((moment for moment, line in lines(chunks) if line.startswith(b"SEN ")), None)


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


def between(samples: Sequence[Sample], start: float, stop: float) -> list[Sample]:
    """The samples of a span of wall time."""
    return [sample for sample in samples if start <= sample[0] <= stop]


def start_tags(line: str) -> list[str]:
    """The tags in the answer to GETSTARTPOSES."""
    found = _START_POSES.match(line)
    return found[1].split()[::_WORDS_PER_POSE] if found else []
