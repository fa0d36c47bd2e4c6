"""What a page takes: pictures that are on their way to it, and bytes a second. Knows no socket.

A browser reads its socket long before the page draws what came, so pictures would queue up there,
where none can be replaced. A page that tells how many it has drawn (`shown`) is therefore sent the
next picture of a robot when it has drawn the last one; meanwhile the newest wins in its slot. Over
a link that takes time, as many more may be under way as that time is long.
"""

from __future__ import annotations

import math
from collections import Counter, deque

from usarsim_operator.pictures import FULL_RATE

SLOW = 100e3
"""Bytes/s below which a page is sent less of everything."""
_BRIEF = 0.05  # s there and back that no further picture makes up for
_SHARE = 0.15  # s that one message may occupy a slow link
_LEAST = 1500  # bytes of a message that no link makes smaller
_MEMORY = 0.9


class Uptake:
    """Of one page; times are s of any clock.

    Attributes:
        tells: it says `shown`; the pictures of one that does not are sent as they come.
    """

    def __init__(self) -> None:
        self.tells = False
        self._way: deque[tuple[str, float]] = deque()
        self._under_way: Counter[str] = Counter()
        self._shown = 0
        self._there_and_back = math.inf
        self._bytes = self._waited = 0.0

    # -- pictures -----------------------------------------------------------------------------

    def may(self, robot: str) -> bool:
        """Whether a picture of a robot may be sent now."""
        return not self.tells or self._under_way[robot] < self.window

    @property
    def window(self) -> int:
        """Pictures of one robot that may be on their way at a time."""
        took = self._there_and_back
        return 1 if took < _BRIEF or math.isinf(took) else 2 + int(took * FULL_RATE)

    @property
    def under_way(self) -> int:
        """Pictures that were sent and not drawn yet."""
        return len(self._way)

    def sent(self, robot: str, now: float) -> None:
        """A picture of a robot goes out."""
        if self.tells:
            self._way.append((robot, now))
            self._under_way[robot] += 1

    def lost(self) -> None:
        """The picture that was sent last never arrives."""
        if self.tells and self._way:
            self._under_way[self._way.pop()[0]] -= 1

    def shown(self, count: int, now: float) -> None:
        """The page has drawn so many pictures since it came.

        Raises:
            ValueError: if it was not sent that many.
        """
        if not self.tells:
            return
        if not 0 <= count - self._shown <= len(self._way):
            raise ValueError("shown: count is not one of pictures that were sent")
        for _ in range(count - self._shown):
            robot, sent = self._way.popleft()
            self._under_way[robot] -= 1
            self._there_and_back = min(self._there_and_back, now - sent)
        self._shown = count

    # -- bytes --------------------------------------------------------------------------------

    def took(self, size: int, waited: float) -> None:
        """A message was taken, after the sender had waited for so many s."""
        self._bytes = _MEMORY * self._bytes + size
        self._waited = _MEMORY * self._waited + waited

    @property
    def room(self) -> int | None:
        """Bytes that a message to a slow page should have at most; None: the page is not slow."""
        if self._bytes >= SLOW * self._waited:
            return None
        return max(_LEAST, int(_SHARE * self._bytes / self._waited))
