"""What a team gets of its periodic lines, in wall time and in simulated time."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

from benchmarks.measures import stream_of
from usarsim_bench.figures import BenchError
from usarsim_bench.recording import Chunk, lines

_TIME = re.compile(rb"\{Time ([0-9.]+)\}")


@dataclass(slots=True)
class StreamTally:
    """One periodic line of one robot."""

    interval: float  # simulated s between two of them, as they themselves tell
    last: float  # wall time of the latest line, at first the beginning of the span
    count: int = 0  # lines of the span
    lost: int = 0  # lines of the span that are missing in simulated time
    gap: float = 0.0  # s of wall time of its longest silence in the span
    told: float | None = None  # simulated time of the latest line

    def note(self, moment: float, told: float) -> None:
        """One more line, with its wall time and its simulated time."""
        self.count += 1
        self.gap = max(self.gap, moment - self.last)
        if self.told is not None:
            self.lost += max(0, round((told - self.told) / self.interval) - 1)
        self.last, self.told = moment, told


def intervals(chunks: Iterable[Chunk]) -> dict[str, float]:
    """The periodic lines of a robot and the simulated s between two of each, as they tell.

    Raises:
        BenchError: if there is none, or too few of one to tell.
    """
    told: dict[str, list[float]] = {}
    now = 0.0
    for _, line in lines(chunks):
        # Some lines bear no time; that of the line before is theirs.
        if found := _TIME.search(line):
            now = float(found[1])
        if name := stream_of(line):
            told.setdefault(name, []).append(now)
    if not told:
        raise BenchError("nobody was there to be disturbed")
    usual = {}
    for name, times in told.items():
        gaps = [later - earlier for earlier, later in pairwise(times)]
        if not gaps or median(gaps) <= 0.0:
            raise BenchError(f"too few lines of {name}")
        usual[name] = median(gaps)
    return usual


class Tally:
    """The streams of one robot, counted as the lines come in, span by span of wall time.

    Attributes:
        streams: by the name of the line.
    """

    def __init__(self, start: float, usual: Mapping[str, float]) -> None:
        """Begin a first span; what came before is not counted. `usual` is of `intervals`."""
        self.streams = {name: StreamTally(interval, start) for name, interval in usual.items()}
        self._start = start
        self._rest: list[Chunk] = []
        self._now = 0.0
        self._edges: list[tuple[float, float]] = []

    def begin(self, start: float) -> None:
        """Begin the next span; a line lost between the two counts in the second."""
        self._start, self._edges = start, []
        for stream in self.streams.values():
            stream.count = stream.lost = 0
            stream.gap, stream.last = 0.0, start

    def digest(self, chunks: Sequence[Chunk]) -> None:
        """Count what has come since the last time."""
        chunks = [*self._rest, *chunks]
        for moment, line in lines(chunks):
            if found := _TIME.search(line):
                self._now = float(found[1])
                if moment >= self._start:
                    self._edges[1:] = [(moment, self._now)]
            known = self.streams.get(stream_of(line) or "")
            if known is not None and moment >= self._start:
                known.note(moment, self._now)
        if chunks:
            rest = b"".join(data for _, data in chunks).rpartition(b"\n")[2]
            self._rest = [(chunks[-1][0], rest)]

    def end(self, stop: float) -> None:
        """The span is over: a stream that has died was silent until now."""
        for stream in self.streams.values():
            stream.gap = max(stream.gap, stop - stream.last)

    @property
    def factor(self) -> float:
        """Simulated s per s of wall time, from the first line to the last; 0 with fewer lines."""
        if len(self._edges) < 2:
            return 0.0
        (begun, early), (ended, late) = self._edges
        return (late - early) / (ended - begun) if ended > begun else 0.0

    @property
    def count(self) -> int:
        """Lines of all streams."""
        return sum(stream.count for stream in self.streams.values())

    @property
    def lost(self) -> int:
        """Lines of all streams that are missing."""
        return sum(stream.lost for stream in self.streams.values())

    @property
    def gap(self) -> float:
        """s by which the longest silence of any stream exceeded its interval."""
        return max(stream.gap - stream.interval for stream in self.streams.values())
