"""What a client received, taken apart afterwards, so that reading costs little while it counts."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

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


Chunk = tuple[float, bytes]
"""Bytes of one read call and the wall time at which they were there."""

_STATUS_TIME = re.compile(rb"STA .*?\{Time ([0-9.]+)\}")


def lines(chunks: Iterable[Chunk]) -> Iterator[tuple[float, bytes]]:
    """Whole lines without their ends, each with the moment at which its last byte was there."""
    rest = b""
    for moment, data in chunks:
        *whole, rest = (rest + data).split(b"\r\n")
        for line in whole:
            yield moment, line


def status_samples(chunks: Iterable[Chunk]) -> list[Sample]:
    """Arrival and simulated time of every STA line."""
    found = ((moment, _STATUS_TIME.match(line)) for moment, line in lines(chunks))
    return [(moment, float(status[1])) for moment, status in found if status]


def first_reading(chunks: Iterable[Chunk]) -> float | None:
    """Arrival of the first line of any sensor; None if there is none."""
    return next((moment for moment, line in lines(chunks) if line.startswith(b"SEN ")), None)


def between(samples: Sequence[Sample], start: float, stop: float) -> list[Sample]:
    """The samples of a span of wall time."""
    return [sample for sample in samples if start <= sample[0] <= stop]
