"""What a team notices of clients that mean the server no good."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

from usarsim_tools.bench.attackers import RECONNECTS, Attackers, Damage
from usarsim_tools.bench.crowd import DEFAULT_CLASS, Crowd
from usarsim_tools.bench.errors import BenchError
from usarsim_tools.bench.figures import Aim, Figure, Plan, Section
from usarsim_tools.bench.procfs import Load, Usage, load_between
from usarsim_tools.bench.recording import Chunk, lines, stream_of
from usarsim_tools.bench.server import Server
from usarsim_tools.bench.swarm import TOGETHER
from usarsim_tools.bench.team import MIB, SETTLE, gather, load_figures

__all__ = ["StreamTally", "Tally", "intervals", "measure_hostile"]

ROBOTS = 22
SECONDS = 600.0
QUIET = 10.0
"""s without attackers, for comparison; less if the whole measurement is shorter."""
SLICE = 10.0
"""s after which what a robot received is counted and forgotten, lest it pile up."""

RATE_AIM = Aim(">=", 0.95)
GROWTH_AIM = Aim("<", 50.0)


_TIME = re.compile(rb"\{Time ([0-9.]+)\}")


@dataclass(slots=True)
class StreamTally:
    """One periodic line of one robot.

    Attributes:
        interval: simulated s between two of them, as they themselves tell.
        count: lines of the span.
        gap: s of wall time of its longest silence.
        last: wall time of the latest line, at first the beginning of the span.
    """

    interval: float
    last: float
    count: int = 0
    gap: float = 0.0

    def rate(self, seconds: float) -> float:
        """Lines per s of wall time, as a part of what it should be at real time."""
        return self.count * self.interval / seconds


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
    """The streams of one robot over a span of wall time, counted as the lines come in.

    Attributes:
        streams: by the name of the line.
    """

    def __init__(self, start: float, usual: Mapping[str, float]) -> None:
        """Begin a span.

        Args:
            start: where it begins; what came before is not counted.
            usual: see `intervals`.
        """
        self.streams = {name: StreamTally(interval, start) for name, interval in usual.items()}
        self._start = start
        self._rest: list[Chunk] = []

    def digest(self, chunks: Sequence[Chunk]) -> None:
        """Count what has come since the last time."""
        chunks = [*self._rest, *chunks]
        for moment, line in lines(chunks):
            known = self.streams.get(stream_of(line) or "")
            if known is None or moment < self._start:
                continue
            known.count += 1
            known.gap = max(known.gap, moment - known.last)
            known.last = moment
        if chunks:
            rest = b"".join(data for _, data in chunks).rpartition(b"\n")[2]
            self._rest = [(chunks[-1][0], rest)]

    def end(self, stop: float) -> None:
        """The span is over: a stream that has died was silent until now."""
        for stream in self.streams.values():
            stream.gap = max(stream.gap, stop - stream.last)


@dataclass(frozen=True, slots=True)
class Span:
    """What a team saw over some time.

    Attributes:
        rate: the lowest of any stream of any robot, as a part of what it should be.
        gap: s by which the longest silence of any stream exceeded its interval.
        load: processors used meanwhile.
        growth: bytes by which the server's memory had grown at its largest.
    """

    rate: float
    gap: float
    load: Load
    growth: int


def measure_hostile(plan: Plan) -> Section:
    """A team beside attackers; `plan.seconds` of wall time are watched with them."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    plan.say(f"hostile: {robots} robots beside attackers for {seconds:g} s")
    # The attackers' own robot, which nobody reads, wants a place, too.
    with Server(plan.world, robots + 1) as server, Crowd(server.port, plan.seed) as crowd:
        gather(crowd, robots, (DEFAULT_CLASS,), TOGETHER)
        crowd.run(SETTLE)
        usual, quiet = _quiet(server, crowd, min(QUIET, seconds))
        crowd.run(SETTLE)  # what came while the clients were counting is old
        with Attackers(server.port) as attackers:
            attacked = _attacked(server, crowd, seconds, usual)
            damage = attackers.stop()
    return _section(plan, robots, seconds, quiet, attacked, damage)


Usual = list[dict[str, float]]
"""The streams of each robot, see `intervals`."""


def _quiet(server: Server, crowd: Crowd, seconds: float) -> tuple[Usual, Span]:
    """Which streams there are, and how they fare as long as nobody does any harm."""
    opening = server.usage()
    crowd.run(seconds)
    closing = server.usage()
    usual = [intervals(one.chunks) for one in crowd.controllers]
    tallies = [Tally(opening.wall, one) for one in usual]
    _digest(tallies, crowd)
    return usual, _span(tallies, opening, closing, 0)


def _attacked(server: Server, crowd: Crowd, seconds: float, usual: Usual) -> Span:
    """How the same streams fare from now on."""
    opening = server.usage()
    tallies = [Tally(opening.wall, one) for one in usual]
    most, stop = opening.resident, opening.wall + seconds
    while (left := stop - time.perf_counter()) > 0.0:
        # Robot by robot, so that the clients are never long away from their sockets.
        for tally, one in zip(tallies, crowd.controllers, strict=True):
            crowd.run(min(SLICE, left) / len(tallies))
            tally.digest(one.chunks)
            one.chunks.clear()
        most = max(most, server.usage().resident)
    closing = server.usage()
    _digest(tallies, crowd)
    return _span(tallies, opening, closing, most - opening.resident)


def _digest(tallies: Sequence[Tally], crowd: Crowd) -> None:
    for tally, one in zip(tallies, crowd.controllers, strict=True):
        tally.digest(one.chunks)
        one.chunks.clear()


def _span(tallies: Sequence[Tally], opening: Usage, closing: Usage, growth: int) -> Span:
    for tally in tallies:
        tally.end(closing.wall)
    streams = [stream for tally in tallies for stream in tally.streams.values()]
    return Span(
        rate=min(stream.rate(closing.wall - opening.wall) for stream in streams),
        gap=max(stream.gap - stream.interval for stream in streams),
        load=load_between(opening, closing),
        growth=growth,
    )


def _section(
    plan: Plan, robots: int, seconds: float, quiet: Span, attacked: Span, damage: Damage
) -> Section:
    return Section(
        "hostile",
        "A team beside hostile clients",
        f"{robots} {DEFAULT_CLASS} with all their sensors driving around in {plan.world} for "
        f"{seconds:g} s, while one more client never reads, one sends garbage as fast as it is "
        f"taken, one sends a byte a second and one connects {RECONNECTS:g} times a second. Rates "
        "are of wall time.",
        (
            Figure("Worst rate of any stream, part of nominal", attacked.rate, "", 4, RATE_AIM),
            Figure("... rate before the attack", quiet.rate, "", 4),
            Figure("Growth of memory", attacked.growth / MIB, "MiB", 1, GROWTH_AIM),
            Figure("Longest extra gap of any stream", 1e3 * attacked.gap, "ms", 1),
            Figure("... gap before the attack", 1e3 * quiet.gap, "ms", 1),
            Figure("Reconnects", damage.reconnects / damage.seconds, "1/s", 1),
            Figure("Garbage taken", damage.garbage / damage.seconds / 1e3, "kB/s", 1),
            Figure("Processor use of the server", attacked.load.process, "cores", 2),
            Figure("... use before the attack", quiet.load.process, "cores", 2),
            *load_figures(attacked.load),
        ),
    )
