"""How far a page's clock is from the gateway's, by pings as in NTP; knows no socket.

The page says its clock in a ping, the gateway answers at once and remembers its own; a later ping
says how long the answer to which ping took. Half of that round later than the ping was said it was
heard, if both ways took equally long; that holds best for the quickest rounds, so the median of
these is told.
"""

from __future__ import annotations

import math
import statistics
from collections import deque

ROUNDS = 32
"""Rounds that are looked at, one a second."""
_BEST = 4  # one of so many counts, but at least three
_OPEN = 16  # pings whose answer may be under way
_LEAST = 1e-3  # s of change of the offset that are worth telling


class PageClock:
    """The clock of one page.

    Attributes:
        offset: s that the gateway's clock is ahead of the page's: gateway = page + offset; NaN
            before the first round. rtt: s of the quickest round.
    """

    def __init__(self) -> None:
        self.offset = self.rtt = math.nan
        self._answered: dict[float, float] = {}
        self._rounds: deque[tuple[float, float]] = deque(maxlen=ROUNDS)
        self._told = math.nan

    def ping(self, clock: float, now: float) -> None:
        """A ping that is answered now.

        Args:
            clock: s of the page, as the ping says. now: s of the gateway.
        """
        self._answered[clock] = now
        if len(self._answered) > _OPEN:
            del self._answered[next(iter(self._answered))]

    def round(self, clock: float, took: float) -> bool:
        """An answer has reached the page.

        Args:
            clock: what its ping said. took: s of the page from that ping to its answer.

        Returns:
            Whether the offset is another one than what was told last.
        """
        heard = self._answered.pop(clock, None)
        if heard is None:
            return False
        self._rounds.append((took, heard - (clock + took / 2.0)))
        best = sorted(self._rounds)[: max(3, len(self._rounds) // _BEST)]
        self.offset, self.rtt = statistics.median(one for _, one in best), best[0][0]
        if abs(self.offset - self._told) <= _LEAST:
            return False
        self._told = self.offset
        return True
