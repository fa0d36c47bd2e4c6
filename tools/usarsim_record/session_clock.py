"""Simulated time of a session, from the lines in which a server tells it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from usarsim_record.recording import DATA, END, RESET, SERVER, Event

_TIME = re.compile(rb"\{Time (\d+\.?\d*)\}")
_CUT = 40
"""Bytes kept of a chunk: a time may go on in the next one."""


def time_told(data: bytes) -> float | None:
    """The last simulated time in some bytes, s; None without one."""
    found = _TIME.findall(data)
    return float(found[-1]) if found else None


@dataclass
class SessionClock:
    """How much simulated time was told on all connections together.

    While none is open that tells it, it stands still: how long nobody was there does not count.

    Attributes:
        elapsed: s of simulated time since the first one told; None before.
        telling: connections that are open and have told a time.
    """

    elapsed: float | None = None
    telling: set[int] = field(default_factory=set)
    _zero: float = 0.0
    _rests: dict[int, bytes] = field(default_factory=dict)

    def hear(self, connection: int, data: bytes) -> bool:
        """Take what the server said; returns whether it told a time."""
        data = self._rests.get(connection, b"") + data
        told = time_told(data)
        self._rests[connection] = data[max(data.rfind(b"}") + 1, len(data) - _CUT) :]
        if told is None:
            return False
        if not self.telling:
            self.elapsed = self.elapsed or 0.0
            self._zero = told - self.elapsed
        self.telling.add(connection)
        assert self.elapsed is not None
        self.elapsed = max(self.elapsed, told - self._zero)
        return True

    def end(self, connection: int) -> None:
        """The connection has ended."""
        self.telling.discard(connection)


@dataclass(frozen=True, slots=True)
class Cue:
    """When a controller did something.

    Attributes:
        elapsed: of a `SessionClock` before that; None if no time had been told.
        pause: s of wall time since anything happened, where no simulated time passed.
    """

    elapsed: float | None
    pause: float


def cues(events: Sequence[Event]) -> Iterator[Cue]:
    """For each event its cue; that of the server's events means nothing."""
    clock, latest = SessionClock(), 0.0
    for event in events:
        yield Cue(clock.elapsed, 0.0 if clock.telling else max(0.0, event.time - latest))
        latest = event.time
        if event.kind == DATA and event.side == SERVER:
            clock.hear(event.connection, event.data)
        elif event.kind in (END, RESET):
            clock.end(event.connection)
