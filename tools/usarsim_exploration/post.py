"""Messages over links that are slow, late or lossy: what is sent in a step, and when it arrives.

Each radio sends so many bytes a step at most, to all whom it hears directly together. A message
holds the news of its sender and of absent robots, then cells of its map that the taker cannot know
yet, in a round over the map, as many as fit. Frames get lost; the sender learns of it and sends
again. News that pass several robots take a step for each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels import send, waiting_news
from usarsim_exploration.known_map import AT_BASE, KNOWN, Cells, KnownMap
from usarsim_exploration.messages import ENTRY, FRAME, HEAD, RUN
from usarsim_exploration.strategy import Letter, Teammate

if TYPE_CHECKING:
    from usarsim_exploration.cycle import Body

_UNLIMITED = 10**12
LEAST = 2 * HEAD
"""Bytes of a message that is worth its head; with fewer for each, takers take turns."""
_RUNS = FRAME // RUN
"""Of a frame."""
_NONE = np.empty(0, np.int64)


@dataclass(frozen=True, slots=True)
class Message:
    """What one robot tells another one.

    Attributes:
        due: step at which it arrives. taker, giver: numbers.
        base_step: newest step of the base that the giver has heard of.
        entries: the giver's own, then absent ones'. cells, bits: news of its map.
    """

    due: int
    taker: int
    giver: int
    base_step: int
    entries: list[Teammate]
    cells: Cells
    bits: NDArray[np.uint8]


Carry = Callable[[Message], Message]
"""Brings a message over a real link; what comes out there is what the taker hears."""


@dataclass(slots=True)
class _Line:
    """What one robot knows of what another one was told.

    Attributes:
        told: bits of each cell as last told by either. waiting: cells that may be news.
        since: step up to which changes of the map were looked at. place: where the round is.
        news_first: whether the next message may be filled by news though cells wait.
        heard: by robot, how new the entry of it was that was told.
    """

    told: NDArray[np.uint8]
    waiting: Cells = field(default_factory=lambda: _NONE)
    since: int = -1
    place: int = 0
    news_first: bool = True
    heard: dict[int, int] = field(default_factory=dict)


class Post:
    """Carries the messages of a team."""

    def __init__(
        self,
        bandwidth: int,
        latency: int,
        random: np.random.Generator,
        carry: Carry | None = None,
        *,
        fair: bool = True,
    ) -> None:
        """A post that has carried nothing.

        Args:
            bandwidth: bytes a step of each radio; 0: no limit. latency: steps. carry: see there.
            fair: the map gets through however narrow links are: takers take turns where a message
                for each would be nothing but its head, and each second message of those that
                cannot hold all is for the map alone.
        """
        self._fair = fair
        self._bandwidth, self._latency, self._random = bandwidth or _UNLIMITED, latency, random
        self._carry = carry
        self._lines: dict[tuple[int, int], _Line] = {}
        self._under_way: list[Message] = []
        self.cells_sent = 0
        self.sent: NDArray[np.int64] = np.empty(0, np.int64)
        """Bytes that each radio sent in the last step."""

    def trade(
        self,
        step: int,
        bodies: Sequence[Body],
        direct: NDArray[np.bool_],
        losses: NDArray[np.float64],
        letters: Mapping[int, Letter],
    ) -> None:
        """Send, then hand over what arrives now.

        Args:
            step: now. bodies: of all. direct: (n, n) who hears whom.
            losses: (n, n) probability that a frame gets lost. letters: of those who hear anybody.
        """
        self.sent = np.zeros(len(bodies), np.int64)
        for giver in range(len(bodies)):
            takers = np.flatnonzero(direct[giver]).tolist()
            first = step % len(takers) if takers else 0  # nobody is always the last one served
            own = bodies[giver].entry(step, letters.get(giver, {}))
            takers = takers[first:] + takers[:first]
            if self._fair:
                takers = takers[: max(1, self._bandwidth // LEAST)]
            for index, taker in enumerate(takers):
                share = (self._bandwidth - int(self.sent[giver])) // (len(takers) - index)
                loss = float(losses[giver, taker])
                self.sent[giver] += self._send(step, bodies[giver], own, taker, share, loss)
        arrived = [one for one in self._under_way if one.due <= step]
        self._under_way = [one for one in self._under_way if one.due > step]
        if self._carry is not None:
            arrived = [self._carry(one) for one in arrived if direct[one.giver, one.taker]]
        for message in arrived:
            if bodies[message.taker].works:
                self._take(step, bodies[message.taker], message)

    def under_way_to(self, taker: int) -> bool:
        """Whether messages with cells are still to arrive."""
        return any(one.taker == taker and len(one.cells) > 0 for one in self._under_way)

    def _line(self, giver: int, taker: int, known: KnownMap) -> _Line:
        if (giver, taker) not in self._lines:
            self._lines[giver, taker] = _Line(np.zeros(known.bits.size, np.uint8))
        return self._lines[giver, taker]

    def _send(
        self, step: int, body: Body, own: Teammate, taker: int, share: int, loss: float
    ) -> int:
        """Write a message; bytes of it. own: what it says of its giver."""
        if share < HEAD:
            return 0
        line = self._line(own.number, taker, body.view.known)
        used = HEAD + own.size
        for_map = self._fair and len(line.waiting) > 0 and not line.news_first
        line.news_first = for_map or not len(line.waiting)
        if used > share or for_map:  # the head alone
            own, used = replace(own, letter={}, size=0), HEAD
        entries = [own]
        for other, one in sorted(body.view.teammates.items()) if not for_map else ():
            size = ENTRY + one.size
            news = one.heard > line.heard.get(other, -1)
            if news and other != taker and used + size <= share:
                entries.append(one)
                used += size
        cells, bits, size = self._pick(step, line, body.view.known, share - used, loss)
        used += size
        if self._random.random() < loss:
            entries = []
        else:
            line.heard.update((one.number, one.heard) for one in entries)
        self.cells_sent += len(cells)
        self._under_way.append(
            Message(step + self._latency, taker, own.number, body.base_step,
                     entries, cells, bits)
        )  # fmt: skip
        return used

    def _pick(
        self, step: int, line: _Line, known: KnownMap, room: int, loss: float
    ) -> tuple[Cells, NDArray[np.uint8], int]:
        """Cells and bits that get through, and bytes of all that were sent."""
        changed = known.changed_since(line.since).astype(np.int64)
        cells, bits, starts = waiting_news(known.bits.reshape(-1), line.told, line.waiting, changed)
        line.since = step - 1  # what is heard later in this step counts as well
        line.waiting = cells
        if not len(cells) or room < RUN:
            return _NONE, np.empty(0, np.uint8), 0
        count, runs = len(starts), min(len(starts), room // RUN)
        first = int(np.searchsorted(cells[starts], line.place)) % count
        after = (first + runs - 1) % count + 1
        line.place = int(cells[starts[after] - 1 if after < count else -1]) + 1
        arrives = np.ones(runs, np.bool_)
        if loss:
            frames = self._random.random(-(-runs // _RUNS)) >= loss
            arrives = np.repeat(frames, _RUNS)[:runs]
        through, told, line.waiting = send(line.told, cells, bits, starts, first, arrives)
        return through, told, RUN * runs

    def _take(self, step: int, body: Body, message: Message) -> None:
        """Learn what a message says."""
        view, known = body.view, body.view.known
        back = self._line(view.number, message.giver, known)
        if len(message.cells):
            known.merge(step, message.cells, message.bits)
            back.told[message.cells] = message.bits
            if view.role == "base":
                there = message.cells[known.news(message.cells) & KNOWN != 0]
                known.mark(step, there, AT_BASE)
        if not message.entries:
            return
        body.base_step = max(body.base_step, message.base_step)
        for one in message.entries:
            old = view.teammates.get(one.number)
            if one.number != view.number and (old is None or old.heard < one.heard):
                view.teammates[one.number] = one
                back.heard[one.number] = one.heard
