"""One page: what waits to be sent to it, and the one task that sends.

Texts that must arrive wait in a short queue; state, pictures, scans and poses have one slot each,
where the newest wins. A page that reads or draws slowly gets rarer and smaller pictures and never
older ones, and nobody else waits for it.
"""

from __future__ import annotations

import asyncio
import json
from collections import OrderedDict, deque
from collections.abc import Mapping

from usarsim_operator import packets
from usarsim_operator.impaired_link import Data, ImpairedLink, Socket
from usarsim_operator.page_clock import PageClock
from usarsim_operator.roles import Limits, Role
from usarsim_operator.uptake import Uptake

MOST_TEXTS = 512
"""Events and answers that may wait; a page that lets more wait is shut out."""
MOST_BYTES = 256 * 1024
"""Bytes of them."""
_WORTH = 1024  # bytes from which a message is compressed for a slow page
_STATE = "state", ""


class Page:
    """A page that has said who it is.

    Attributes:
        id: never used again. name: shown to others. role: what it may do. seat: of an operator,
            by the token, from 1 on; of others 0.
        selected: the robot that it is about. cameras, lasers: robots whose pictures and scans it
            does not want. lines: the robot whose protocol lines it wants; None: of nobody.
        overrun: it was shut out; ended is set then. displaced: since another page took its place.
        limited: it drives beyond the limit.
        ready: a trial may begin as far as it is concerned: it sees, and its pad answers.
        draws: it can draw the world by WebGL. link: what impairs its connection, if anything does.
        clock: how far its clock is from ours.
        deaf: it has no socket, since it is a program's: it says, and is told nothing.
        dropped: messages that newer ones replaced, by stream.
        uptake: what it takes. deflate: window bits of what it can decompress; 0: nothing.
    """

    def __init__(
        self,
        id: int,
        name: str,
        role: Role,
        socket: Socket | None,
        now: float,
        delay: float = 0.0,
        seat: int = 1,
    ) -> None:
        self.id, self.name, self.role = id, name, role
        self.seat = seat if role is Role.OPERATOR else 0
        self.limits = Limits(now)
        self.selected = ""
        self.cameras_off: set[str] = set()
        self.lasers_off: set[str] = set()
        self.lines: str | None = None
        self.wants_lines = False
        self.dropped: dict[str, int] = {}
        self.pictured: dict[str, float] = {}
        self.draws = True
        self.uptake = Uptake()
        self.deflate = 0
        self.link: ImpairedLink | None = None
        self.clock = PageClock()
        self.overrun = self.displaced = False
        self.limited = False
        self.ready = True
        self.deaf = socket is None
        self._socket = socket
        self._delay = delay
        self._texts: deque[str] = deque()
        self._bytes = 0
        self._slots: OrderedDict[tuple[str, str], Data] = OrderedDict()
        self._stirred = asyncio.Event()
        self.ended = asyncio.Event()

    def end(self) -> None:
        """Shut the page out, even if it takes nothing any more."""
        self.overrun = True
        self.ended.set()

    def tell(self, message: Mapping[str, object]) -> None:
        """Send a text that must arrive, and soon: an answer, an event."""
        if not self.deaf:
            self._later(self._queue, json.dumps(message, separators=(",", ":")))

    def answer(self, id: int | None, ok: bool, why: str = "", **more: object) -> None:
        """Answer a request, if it wants an answer."""
        if id is not None:
            self.reply({"type": "answer", "id": id, "ok": ok, "why": why, **more})

    def reply(self, message: Mapping[str, object]) -> None:
        """Send a text that tells nothing of the world, which a viewer sees later: at once."""
        if not self.deaf:
            self._queue(json.dumps(message, separators=(",", ":")))

    def show(self, stream: str, robot: str, data: Data) -> None:
        """Send the newest of a stream; what waits of it is dropped."""
        if not self.deaf:
            self._later(self._fill, (stream, robot), data)

    def _later(self, put: object, *what: object) -> None:
        assert callable(put)
        if self._delay and self.role is Role.VIEWER:
            asyncio.get_running_loop().call_later(self._delay, put, *what)
        else:
            put(*what)

    def _queue(self, text: str) -> None:
        self._texts.append(text)
        self._bytes += len(text)
        if len(self._texts) > MOST_TEXTS or self._bytes > MOST_BYTES:
            self.end()
        self._stirred.set()

    def _fill(self, key: tuple[str, str], data: Data) -> None:
        if key in self._slots:
            self.dropped[key[0]] = self.dropped.get(key[0], 0) + 1
        self._slots[key] = data
        self._stirred.set()

    def shown(self, count: int) -> None:
        """The page says how many pictures it has drawn.

        Raises:
            ValueError: if it was not sent that many.
        """
        self.uptake.shown(count, asyncio.get_running_loop().time())
        self._stirred.set()

    async def send_all(self) -> None:
        """Send what waits, until the socket fails or the page lets too much wait."""
        last: tuple[str, str] | None = None
        while not self.overrun:
            if self._texts:
                text = self._texts.popleft()
                self._bytes -= len(text)
                await self._send(text)
            elif (key := self._next(last)) is not None:
                last = key
                await self._send(self._slots.pop(key), key)
            else:
                self._stirred.clear()
                await self._stirred.wait()

    def _next(self, last: tuple[str, str] | None) -> tuple[str, str] | None:
        """The slot to be sent, after that of `last`."""
        may = (key for key in self._slots if key[0] != "picture" or self.uptake.may(key[1]))
        # State is small and makes everything else understood; then comes the picture of the robot
        # that the page is about. One of the others goes between two such pairs: nothing starves.
        chosen = "picture", self.selected
        waiting = list(may)
        others = [key for key in waiting if key not in (_STATE, chosen)][:1]
        order = [_STATE, chosen, *others]
        if last in (_STATE, chosen):
            begin = order.index(last) + 1
            order = order[begin:] + order[:begin]
        return next((key for key in order if key in waiting), None)

    async def _send(self, data: Data, key: tuple[str, str] = ("", "")) -> None:
        clock = asyncio.get_running_loop().time
        begun, room = clock(), self.uptake.room
        if room is not None and isinstance(data, bytes) and len(data) > room:
            data = packets.slim(data, room)
        picture = isinstance(data, bytes) and data[0] == packets.PICTURE
        small = room is None or picture or len(data) < _WORTH
        compress = None if small else self.deflate or None
        lost = 0 if self.link is None else self.link.out.lost
        if picture:
            self.uptake.sent(key[1], begun)
        assert self._socket is not None
        if isinstance(data, str):
            await self._socket.send_str(data, compress)
        else:
            await self._socket.send_bytes(data, compress)
        if picture and self.link is not None and self.link.out.lost > lost:
            self.uptake.lost()
        if compress is None:  # else nobody knows how much it was
            self.uptake.took(len(data), clock() - begun)

    @property
    def waiting(self) -> int:
        """Bytes that wait here."""
        return self._bytes + sum(len(one) for one in self._slots.values())
