"""What robots tell each other in a step, and how many bytes that takes.

Over links that carry everything at once, everybody who is linked over any chain knows the same
afterwards: they fold the cells that are news to anybody, in the order of numbers (exploration
reference 6.4). Links with a bandwidth, latency or loss are those of `post`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from usarsim_exploration.environment import Environment
from usarsim_exploration.kernels import fold, tell
from usarsim_exploration.known_map import AT_BASE, KNOWN, MERGED, RELAYED
from usarsim_exploration.messages import ENTRY, HEAD, RUN
from usarsim_exploration.post import Carry, Post
from usarsim_exploration.radio import Links, Radio
from usarsim_exploration.strategy import BASE, Letter, Teammate

if TYPE_CHECKING:
    from usarsim_exploration.cycle import Body


class Exchange:
    """Trades maps and news, and counts.

    Attributes:
        cells_sent: entries of maps in all messages so far. bytes_sent: size of these messages.
        sent: (n,) bytes of each radio in the last step, where links have a shape.
    """

    def __init__(
        self, radio: Radio, count: int, random: np.random.Generator, carry: Carry | None = None
    ) -> None:
        """count: robots, the base among them. random: of frames that get lost.

        carry: brings messages over real links, hop by hop; None: everybody knows at once what
        anybody of a chain knows.
        """
        self._radio = radio
        self._synced = np.full((count, count), -1, np.int64)
        self._post = None
        if radio.shaped or carry is not None:
            self._post = Post(radio.bandwidth, radio.latency, random, carry)
        self.cells_sent = self.bytes_sent = 0
        self.sent = np.zeros(count, np.int64)

    def trade(
        self, step: int, bodies: Sequence[Body], links: Links, environment: Environment
    ) -> None:
        """One step's messages: all are written before any is read."""
        groups = links.groups()
        letters: dict[int, Letter] = {}
        for group in groups:
            for number in group:
                strategy = bodies[number].strategy
                if strategy is not None and bodies[number].works:
                    letters[number] = strategy.letter(bodies[number].view)
        bodies[BASE].base_step = step
        for body in bodies:
            body.view.linked = frozenset()
        for group in groups:
            for number in group:
                bodies[number].view.linked = frozenset(group) - {number}
        if self._post is not None:
            cells = [body.view.cell for body in bodies]
            ranges = [body.member.radio_range for body in bodies]
            losses = self._radio.losses(environment, cells, ranges, links.direct)
            self.sent = np.zeros(len(bodies), np.int64)
            for _ in range(1 if self._radio.shaped else links.hops()):
                self._post.trade(step, bodies, links.direct, losses, letters)
                self.sent += self._post.sent
            self.cells_sent = self._post.cells_sent
            self.bytes_sent += int(self.sent.sum())
        else:
            for group in groups:
                self._trade_maps(step, [bodies[number] for number in group])
                self._trade_news(step, [bodies[number] for number in group], letters)
        for number in letters:
            strategy = bodies[number].strategy
            if strategy is not None:
                strategy.hear(bodies[number].view)

    def _trade_maps(self, step: int, group: list[Body]) -> None:
        """Fold the cells that are news to anybody, in the order of numbers (reference 6.4)."""
        maps = [body.view.known for body in group]
        numbers = [body.view.number for body in group]
        fresh = np.zeros(maps[0].bits.size, np.bool_)  # to somebody
        synced = self._synced[np.ix_(numbers, numbers)].T.tolist()
        for index, known in enumerate(maps):
            since_of_takers = synced[index]
            del since_of_takers[index]
            for since, takers in Counter(since_of_takers).items():
                cells = known.changed_since(since)
                runs = tell(known.bits.reshape(-1), cells, fresh)
                self.cells_sent += takers * len(cells)
                self.bytes_sent += takers * RUN * runs
        self._synced[np.ix_(numbers, numbers)] = step
        cells = np.flatnonzero(fresh)
        if not len(cells):
            return
        shared = maps[0].news(cells)
        relayed = shared & np.uint8(RELAYED)
        for known in maps[1:]:
            fold(shared, relayed, known.bits.reshape(-1), cells, MERGED)
        shared &= ~np.uint8(RELAYED)
        if BASE in numbers:
            shared[shared & KNOWN != 0] |= AT_BASE
        for known in maps:
            known.agree(step, cells, shared, relayed)

    def _trade_news(self, step: int, group: list[Body], letters: Mapping[int, Letter]) -> None:
        """Where everybody is and what they do; of absent ones what was heard last."""
        newest = max(body.base_step for body in group)
        present: dict[int, Teammate] = {}
        for body in group:
            own = body.entry(step, letters.get(body.view.number, {}))
            present[body.view.number] = own
            self.bytes_sent += (len(group) - 1) * (HEAD + own.size)
        absent: dict[int, Teammate] = {}
        for body in group if len(group) < len(self._synced) else ():
            for other, known in body.view.teammates.items():
                newest_of = absent[other].heard if other in absent else -1
                if other not in present and known.heard > newest_of:
                    absent[other] = known
        for body in group:
            body.base_step = newest
            mates = body.view.teammates
            mates.update(present)
            del mates[body.view.number]
            for other, one in absent.items():
                if mates[other].heard < one.heard:
                    mates[other] = one
                    self.bytes_sent += ENTRY + one.size
