"""What a client received, taken apart afterwards, so that reading costs little while it counts."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from usarsim_bench.statistics import Sample

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
    samples = []
    for moment, line in lines(chunks):
        if found := _STATUS_TIME.match(line):
            samples.append((moment, float(found[1])))
    return samples


def sensor_samples(chunks: Iterable[Chunk], name: str) -> list[Sample]:
    """Arrival and simulated time of every line of one sensor, if its lines tell their time."""
    samples = []
    for moment, line in lines(chunks):
        found = _TIMED_SENSOR.match(line)
        if found is not None and found[2].decode("latin-1") == name:
            samples.append((moment, float(found[1])))
    return samples


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
