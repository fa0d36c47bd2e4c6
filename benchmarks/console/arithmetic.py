"""From moments that page and gateway noted to figures; nothing here measures.

All moments are s of one clock: on Linux `time.perf_counter` reads CLOCK_MONOTONIC everywhere.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from statistics import median

import numpy as np


@dataclass(frozen=True, slots=True)
class Heard:
    """A text of a page that moves or stops robots, when the gateway read it."""

    moment: float
    page: int
    text: str


@dataclass(frozen=True, slots=True)
class Wired:
    """A DRIVE that the gateway handed to a socket. zero: it stops the robot."""

    moment: float
    robot: str
    zero: bool


@dataclass(frozen=True, slots=True)
class Shown:
    """A picture that the gateway had from the server. asked: when it had asked for it."""

    moment: float
    robot: int
    sequence: int
    asked: float


@dataclass(slots=True)
class Notes:
    """What an instrumented gateway noted, in its order.

    Attributes:
        waiting: bytes that waited for a page, by its id, once a second each.
    """

    heard: list[Heard]
    wired: list[Wired]
    shown: list[Shown]
    waiting: list[tuple[float, int, int]]


def read_notes(lines: Iterable[str]) -> Notes:
    """Take the lines of a gateway apart; an unfinished last one is left out.

    Raises:
        ValueError: if one is no note.
    """
    notes = Notes([], [], [], [])
    for line in lines:
        if not line.endswith("\n"):
            break
        kind, moment, *rest = line.rstrip("\n").split("\t")
        if kind == "heard":
            notes.heard.append(Heard(float(moment), int(rest[0]), rest[1]))
        elif kind == "wired":
            notes.wired.append(Wired(float(moment), rest[0], rest[1] == "0"))
        elif kind == "shown":
            notes.shown.append(Shown(float(moment), int(rest[0]), int(rest[1]), float(rest[2])))
        elif kind == "waiting":
            notes.waiting.append((float(moment), int(rest[0]), int(rest[1])))
        else:
            raise ValueError(f"no note: {line!r}")
    return notes


_VALUE = re.compile(r"\{\w+ ([-+.\deE]+)\}")


def is_zero(drive: str) -> bool:
    """Whether a DRIVE asks for no motion: all its numbers are 0."""
    return all(float(value) == 0.0 for value in _VALUE.findall(drive))


def drives_wheels(text: str) -> bool:
    """Whether a `drive` text of a page asks for motion."""
    return any(float(value) != 0.0 for value in re.findall(r'"(?:left|right)": ?([-\d.e]+)', text))


@dataclass(frozen=True, slots=True)
class Legs:
    """The way of one key: s from its event to the page's send, to the gateway, to the wire."""

    page: float
    transit: float
    gateway: float

    @property
    def total(self) -> float:
        """s from the event to the wire."""
        return self.page + self.transit + self.gateway


def key_legs(
    keys: Sequence[float],
    sent: Sequence[tuple[float, str]],
    heard: Sequence[float],
    wired: Sequence[tuple[float, bool]],
    *,
    stops: bool = False,
) -> list[Legs | None]:
    """The way of each key that begins a drive, or that ends one.

    Args:
        keys: moments of the events.
        sent: moment and text of every `drive` that the page sent.
        heard: when the gateway read them; the n-th is that of the n-th sent.
        wired: moment and whether it stops, of every DRIVE of that robot.
        stops: the keys are releases.

    Returns:
        For each key its legs; None if no drive came of it before the next key.

    Raises:
        ValueError: if the gateway read more or fewer than were sent.
    """
    if len(sent) != len(heard):
        raise ValueError(f"{len(sent)} drives were sent, {len(heard)} were read")
    sends, wires = [moment for moment, _ in sent], [moment for moment, _ in wired]
    legs: list[Legs | None] = []
    for key, following in zip(keys, [*keys[1:], math.inf], strict=True):
        found = None
        for place in range(bisect_left(sends, key), bisect_left(sends, following)):
            if drives_wheels(sent[place][1]) != stops:
                after = bisect_left(wires, heard[place])
                fits = (moment for moment, zero in wired[after:] if zero == stops)
                if (wire := next(fits, None)) is not None and wire < following:
                    moments = sends[place], heard[place], wire
                    found = Legs(moments[0] - key, moments[1] - moments[0], wire - moments[1])
                break
        legs.append(found)
    return legs


def stopping_time(begun: float, robots: int, wired: Sequence[Wired]) -> float:
    """s until each of so many robots was told to stand after an emergency stop; infinite if one
    was not."""
    told: dict[str, float] = {}
    for one in wired:
        if one.zero and one.moment >= begun:
            told.setdefault(one.robot, one.moment)
    return max(told.values()) - begun if len(told) >= robots else math.inf


@dataclass(frozen=True, slots=True)
class Arrival:
    """A picture that a page has got. robot: its index."""

    moment: float
    robot: int
    sequence: int


def picture_ages(arrivals: Sequence[Arrival], shown: Sequence[Shown]) -> list[tuple[float, float]]:
    """Moment of each arrival, and s since the gateway had asked the server for that picture."""
    asked = {(one.robot, one.sequence): one.asked for one in shown}
    known = [one for one in arrivals if (one.robot, one.sequence) in asked]
    return [(one.moment, one.moment - asked[one.robot, one.sequence]) for one in known]


def longest_queue(
    arrivals: Sequence[Arrival], shown: Sequence[Shown], clock_error: float = 0.0
) -> int:
    """Most pictures of one robot that waited behind another on its way to a page.

    These are the later ones that the gateway had when a picture arrived. Moments of a page may be
    wrong by `clock_error`, which counts for it.
    """
    had: dict[int, list[float]] = {}
    place: dict[tuple[int, int], int] = {}
    for one in shown:
        moments = had.setdefault(one.robot, [])
        place[one.robot, one.sequence] = len(moments)
        moments.append(one.moment)
    longest = 0
    for arrival in arrivals:
        if (number := place.get((arrival.robot, arrival.sequence))) is not None:
            until = bisect_right(had[arrival.robot], arrival.moment - clock_error)
            longest = max(longest, until - number - 1)
    return longest


def growth(samples: Sequence[tuple[float, float]]) -> float:
    """Median of the last tenth of a span of time by that of its first; not a number without
    samples in both."""
    if not samples:
        return math.nan
    first, last = samples[0][0], samples[-1][0]
    edge = 0.1 * (last - first)
    begin = [value for moment, value in samples if moment <= first + edge]
    end = [value for moment, value in samples if moment >= last - edge]
    return median(end) / median(begin)


def p95(values: Sequence[float]) -> float:
    """The 95th percentile; not a number without values."""
    return float(np.percentile(values, 95.0)) if len(values) else math.nan


def clock_offset(rounds: Sequence[tuple[float, float, float]]) -> tuple[float, float]:
    """What a page's clock has to be added to be ours, and by how much that may be wrong, s.

    Args:
        rounds: our clock before a question, the page's clock, ours after the answer; the shortest
            round counts, in the middle of which the page has read its clock.
    """
    before, told, after = min(rounds, key=lambda one: one[2] - one[0])
    return 0.5 * (before + after) - told, 0.5 * (after - before)


def added_packages(extra: str, of: str = "usarsim-server") -> Mapping[str, int]:
    """Bytes of each installed distribution that an extra brings beside what is needed anyway.

    Raises:
        metadata.PackageNotFoundError: if the distribution, or one named by the extra, is not here.
    """
    for name, wanted in _requirements(of):
        if wanted == extra:
            metadata.distribution(name)
    added = _closure(of, extra) - _closure(of, "")
    return {name: _size(metadata.distribution(name)) for name in sorted(added)}


def _closure(of: str, extra: str) -> set[str]:
    found: set[str] = set()
    waiting = [(of, extra)]
    while waiting:
        name, wanted = waiting.pop()
        for needed, only_for in _requirements(name):
            # What is not installed is meant for other systems or versions of Python.
            if only_for in ("", wanted) and needed not in found and _installed(needed):
                found.add(needed)
                waiting.append((needed, ""))
    return found


def _requirements(name: str) -> list[tuple[str, str]]:
    """Name of everything that a distribution requires, and the extra that it is for."""
    found = []
    for text in metadata.requires(name) or ():
        needed = re.match(r"[\w.-]+", text)
        extra = re.search(r"""extra\s*==\s*['"]([^'"]+)""", text)
        assert needed is not None, text
        found.append((needed[0].lower().replace("_", "-"), extra[1] if extra else ""))
    return found


def _installed(name: str) -> bool:
    try:
        metadata.distribution(name)
    except metadata.PackageNotFoundError:
        return False
    return True


def _size(found: metadata.Distribution) -> int:
    paths = [path.locate() for path in found.files or ()]
    return sum(path.stat().st_size for path in map(_path, paths) if path.is_file())


def _path(located: object) -> Path:
    return Path(str(located))
