"""What robots tell each other in a step, and how many bytes that takes.

Over links that carry everything at once, everybody who is linked over any chain knows the same
afterwards: they fold the cells that are news to anybody, in the order of numbers (exploration
reference 6.4). Links with a bandwidth, latency or loss are those of `post`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Environment
from usarsim_exploration.kernels import agree, tell
from usarsim_exploration.known_map import KNOWN, MERGED
from usarsim_exploration.messages import ENTRY, HEAD, RUN
from usarsim_exploration.post import Carry, Post
from usarsim_exploration.radio import Links, Radio
from usarsim_exploration.strategy import BASE, Letter, Teammate

if TYPE_CHECKING:
    from usarsim_exploration.cycle import Body


PATIENCE = 100
"""Steps without news after which links are taken to carry none: they are too narrow or too bad."""


def tell_links(bodies: Sequence[Body], groups: Sequence[Sequence[int]]) -> None:
    """Let robots know whom they hear. groups: numbers of who can talk to whom."""
    for body in bodies:
        body.view.linked = frozenset()
    for group in groups:
        for number in group:
            bodies[number].view.linked = frozenset(group) - {number}


class Exchange:
    """Trades maps and news, and counts.

    Attributes:
        cells_sent: entries of maps in all messages so far. bytes_sent: size of these messages.
        sent: (n,) bytes of each radio in the last step, where links have a shape.
    """

    def __init__(
        self,
        radio: Radio,
        maps: NDArray[np.uint8],
        random: np.random.Generator,
        carry: Carry | None = None,
        *,
        fair: bool = True,
    ) -> None:
        """maps: (robots, rows, columns) of all, the base first. random: of frames that get lost.

        carry: brings messages over real links, hop by hop; None: everybody knows at once what
        anybody of a chain knows. fair: see `Post`.
        """
        self._radio = radio
        count = len(maps)
        self._maps = maps.reshape(count, -1)
        self._synced = np.full((count, count), -1, np.int64)
        self._post = None
        if radio.shaped or carry is not None:
            self._post = Post(radio.bandwidth, radio.latency, random, carry, fair=fair)
        self.cells_sent = self.bytes_sent = 0
        self.sent = np.zeros(count, np.int64)
        self._version, self._step, self._learnt = -1, 0, 0

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
        tell_links(bodies, groups)
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
        self._step = step
        if bodies[BASE].view.known.version != self._version:
            self._version, self._learnt = bodies[BASE].view.known.version, step
        for number in letters:
            strategy = bodies[number].strategy
            if strategy is not None:
                strategy.hear(bodies[number].view)

    def pending(self, bodies: Sequence[Body], links: Links) -> bool:
        """Whether the base will hear more though nobody moves.

        Robots that are linked with it know what it does not, and it has learnt something lately; or
        radios are out that will be on again.
        """
        base = bodies[BASE].view.known.bits
        linked = links.closed[BASE]
        for number, body in enumerate(bodies):
            if number == BASE or not body.works:
                continue
            later = body.heard_again or bodies[BASE].heard_again
            if not (linked[number] or later):
                continue
            if ((body.view.known.bits & KNOWN != 0) & (base & KNOWN == 0)).any():
                if later:
                    return True
                far = self._radio.latency * links.hops()
                if self._step - self._learnt <= PATIENCE + far:
                    return True
        return self._post is not None and self._post.under_way_to(BASE)

    def _trade_maps(self, step: int, group: list[Body]) -> None:
        """Fold the cells that are news to anybody, in the order of numbers (exploration 6.4)."""
        numbers = [body.view.number for body in group]
        pairs = np.ix_(numbers, numbers)
        synced = self._synced[pairs].T.tolist()
        told: list[NDArray[np.int32]] = []
        parts, end = list[tuple[int, int, int]](), 0
        for index, body in enumerate(group):
            since_of_takers = synced[index]
            del since_of_takers[index]
            for since in set(since_of_takers):
                takers, cells = since_of_takers.count(since), body.view.known.changed_since(since)
                told.append(cells)
                end += len(cells)
                parts.append((numbers[index], takers, end))
                self.cells_sent += takers * len(cells)
        self._synced[pairs] = step
        fresh, runs = tell(self._maps, np.array(parts), np.concatenate(told))
        self.bytes_sent += RUN * runs
        if not len(fresh):
            return
        changed, ends, more = agree(self._maps, np.array(numbers), fresh, MERGED, BASE in numbers)
        begin = 0
        for body, stop, counts in zip(group, ends.tolist(), more.tolist(), strict=True):
            body.view.known.note(step, changed[begin:stop], counts)
            begin = stop

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
