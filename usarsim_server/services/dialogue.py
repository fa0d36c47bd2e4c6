"""Services that speak only when they are asked: one request, one reply, in order.

A client's next request is read only when its last reply has been handed to the kernel, so nothing
piles up here whatever a client sends or leaves unread, and nobody waits for anybody else. What is
asked for again within an instant gets the same text, whoever asks, and what is known of that
instant is told at once; other replies are worked out on threads of the service's own, because they
may have to wait for the physics. All of it comes out of the port's share of the processor.
"""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.logs import Log
from usarsim_server.base.token_bucket import Clock
from usarsim_server.protocol.grammar import LineFramer
from usarsim_server.protocol.opening import Opening
from usarsim_server.protocol.truth import MAX_LISTING, QueryFramer
from usarsim_server.services.budget import (
    BYTE_COST,
    HOP_COST,
    Account,
    WorkBudget,
    whole_share,
)
from usarsim_server.services.idle_threads import IdleThreads
from usarsim_server.services.limits import input_cost
from usarsim_server.services.port import Guest, PortLimits, PortService, refuse
from usarsim_server.services.replies import PIECE, ReplyBuffer

CHUNK = 2048
"""Bytes read at a time: at most some hundred requests, which wait here while one is answered."""
CHUNK_BYTES = CHUNK + CHUNK * 40
"""Memory of a chunk that is cut into as many lines as fit, with what Python needs for each."""
MAX_REQUEST = 8 * 1024
"""Longest request in bytes; the longest that means something names two points or robots."""
_WORKERS = 2
"""Threads that work out replies; so one client's hard question does not hold up the others."""
_GROUP = 8
"""Requests that a thread answers at a time; the physics is asked once for all of them."""
_KEPT, _KEPT_BYTES = 256, 1024 * 1024
"""Texts of one instant that are remembered, and their bytes in all."""


class Framer(Protocol):
    """Cuts the bytes of one connection into lines."""

    @property
    def discarded(self) -> int:
        """Number of lines thrown away because they were too long."""

    def feed(self, data: bytes) -> list[bytes]:
        """Take the next bytes and return the lines they complete, without terminators."""


Respond = Callable[[list[bytes]], list[bytes]]
"""Makes the replies to lines that came together, one for each, line ends included; an empty text is
no reply.

Called on a worker thread, may block. May raise `UsarsimError` if there is nothing left to tell; the
connection ends then.
"""


def _unknown(line: bytes) -> bytes | None:
    return None


@dataclass(frozen=True, slots=True)
class Instant:
    """For how long an answer holds."""

    span: float = 0.0  # s of wall time; 0: every request is answered anew
    version: Callable[[], object] = int  # changes with what must show at once, such as who is there
    known: Callable[[bytes], bytes | None] = _unknown
    """The reply to a line, as `Respond` makes it, if it takes neither waiting nor much work; None:
    it has to be worked out. Called on the event loop."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DialogueLimits(PortLimits):
    """What the clients of a dialogue may use."""

    share: float = 0.15
    """As in `PortLimits`. The propagation models of the original ask for every ordered pair of
    robots once a second: for 16 robots 240 questions, which take half of this on a machine that
    does much else."""
    together: bool = True  # replies may be handed over together; otherwise one by one
    pause: float = 0.0  # wall s between two replies to the same client, at the least
    reply_bytes: int = 64 * 1024
    """Longest reply. No service makes a longer one; if it does, the client is closed."""

    @property
    def held_bytes(self) -> int:
        """Bytes that a connection can make the server hold, without the kernel's buffers: half a
        request, those of one chunk that wait, the replies worked out together, and the one piece
        of them that is being sent."""
        return dialogue_bytes(self)


def dialogue_bytes(limits: DialogueLimits) -> int:
    """Bytes that a client who asks can make the server hold, see `DialogueLimits.held_bytes`."""
    together = _GROUP if limits.together else 1
    return MAX_REQUEST + CHUNK_BYTES + (together + 1) * limits.reply_bytes + PIECE


class Desk:
    """Answers lines, whoever asks."""

    def __init__(
        self,
        name: str,
        respond: Respond,
        limits: DialogueLimits,
        instant: Instant | None = None,
        clock: Clock = time.monotonic,
        pace: Callable[[], float] = whole_share,
    ) -> None:
        """Make a desk; its threads begin with the first question.

        Args:
            name: of the service.
            respond: see `Respond`.
            limits: see `DialogueLimits`.
            instant: for how long an answer holds.
            clock: wall time.
            pace: which part of the share may be used now.
        """
        self.budget = WorkBudget(limits.share, pace=pace)
        self._respond = respond
        self._limits = limits
        self._instant = instant or Instant()
        self._clock = clock
        self._threads = IdleThreads(name, _WORKERS)
        self._kept: dict[bytes, bytes] = {}
        self._kept_bytes = 0
        self._kept_since = 0.0
        self._kept_version: object = None

    def close(self) -> None:
        """Let the threads end."""
        self._threads.close()

    async def answer(self, lines: list[bytes], replies: ReplyBuffer, account: Account) -> int:
        """Send the replies to lines in their order; returns how many there were.

        The client has had its turn when this is called.

        Raises:
            UsarsimError: if there is nothing left to tell.
            OSError: if the client has gone, or does not read.
        """
        replied = place = 0
        while place < len(lines):
            if place:
                # What is at hand is told without waiting: let others have a turn.
                await asyncio.sleep(0)
                await self.budget.turn(account)
            with self.budget.work(account):
                found = list(self._at_hand(lines, place))
            if not found:
                found = await self._work_out(lines[place : place + _GROUP], account)
            place += len(found)
            replied += sum(map(bool, found))
            self.budget.charge(account, sum(map(len, found)) * BYTE_COST)
            for reply in filter(None, found):
                await self._send(reply, replies)
        await replies.flush()
        return replied

    async def _send(self, reply: bytes, replies: ReplyBuffer) -> None:
        begun = self._clock()
        await replies.put(reply)
        if not self._limits.together:
            await replies.flush()
        if self._limits.pause:
            await asyncio.sleep(self._limits.pause - (self._clock() - begun))

    def _at_hand(self, lines: list[bytes], place: int) -> Iterator[bytes]:
        """Replies that were given this instant or are known, up to the first that is neither."""
        self._look_at_clock()
        size = told = 0
        for line in lines[place:]:
            reply = self._kept.get(line)
            if reply is None and told < _GROUP and (reply := self._instant.known(line)) is not None:
                told += 1
                self._keep(line, reply, self._clock())
            if reply is None or size >= PIECE:
                return
            size += len(reply)
            yield reply

    async def _work_out(self, lines: list[bytes], account: Account) -> list[bytes]:
        if not self._limits.together:
            lines = lines[:1]
        begun = self._clock()
        replies, cost = await self._threads.run(self._measured, lines)
        self.budget.charge(account, cost + HOP_COST)
        for line, reply in zip(lines, replies, strict=True):
            self._keep(line, reply, begun)
        return replies

    def _measured(self, lines: list[bytes]) -> tuple[list[bytes], float]:
        """Replies, and s of processor time; on a worker thread."""
        begun = time.thread_time()
        replies = self._respond(lines)
        if max(map(len, replies), default=0) > self._limits.reply_bytes:
            raise UsarsimError(f"a reply is longer than {self._limits.reply_bytes} bytes")
        return replies, time.thread_time() - begun

    def _look_at_clock(self) -> None:
        """Forget the answers of an instant that has passed."""
        if not self._kept:
            return
        past = self._clock() >= self._kept_since + self._instant.span
        if past or self._instant.version() != self._kept_version:
            self._kept.clear()
            self._kept_bytes = 0

    def _keep(self, line: bytes, reply: bytes, begun: float) -> None:
        if not self._instant.span:
            return
        self._look_at_clock()
        if not self._kept:
            self._kept_since, self._kept_version = begun, self._instant.version()
        size = len(line) + len(reply)
        if len(self._kept) < _KEPT and self._kept_bytes + size <= _KEPT_BYTES:
            self._kept_bytes += size
            self._kept[line] = reply


class DialogueService(PortService[DialogueLimits]):
    """Answers requests on one port."""

    def __init__(
        self,
        name: str,
        host: str,
        port: int,
        option: str,
        framer: Callable[[], Framer],
        respond: Respond,
        *,
        required: bool = False,
        limits: DialogueLimits | None = None,
        instant: Instant | None = None,
        pace: Callable[[], float] = whole_share,
    ) -> None:
        """Describe the service; nothing is opened before `start`.

        Args:
            name, host, port, option, required, limits: see `PortService`.
            framer: makes the framer of a new connection.
            respond: see `Respond`.
            instant: for how long an answer holds.
            pace: which part of the share may be used now.
        """
        super().__init__(name, host, port, option, limits or DialogueLimits(), required)
        self._framer = framer
        self._desk = Desk(name, respond, self._limits, instant, pace=pace)

    async def stop(self) -> None:
        await super().stop()
        self._desk.close()

    async def _serve(self, client: socket.socket, peer: str) -> None:
        log = self._log.bind(connection=peer)
        log.info("client connected")
        try:
            with self._guests.enter(peer) as guest:
                await self._converse(client, guest, log)
        except UsarsimError as error:
            log.info(f"conversation ended: {error}")
        finally:
            log.info("client left")

    async def _converse(self, client: socket.socket, guest: Guest, log: Log) -> None:
        loop = asyncio.get_running_loop()
        budget = self._desk.budget
        framer, discarded, opening = self._framer(), 0, Opening()
        account, allowance = budget.newcomer(), self._rates.newcomer()
        replies = ReplyBuffer(client)
        while chunk := await loop.sock_recv(client, CHUNK):
            if foreign := opening.foreign(chunk):
                refuse(log, foreign)
                return
            await budget.turn(account)
            with budget.work(account):
                lines = framer.feed(chunk)
            if framer.discarded != discarded:
                discarded = framer.discarded
                log.info("line discarded: too long")
            if await self._desk.answer(lines, replies, account):
                self._guests.heard(guest)
            # `sock_recv` does not yield while there is data: let other clients have a turn.
            await asyncio.sleep(allowance.spend(input_cost(lines, len(lines))))


TRUTH_LIMITS = DialogueLimits(share=0.05, together=False, pause=1 / 60, reply_bytes=MAX_LISTING)
"""One listing for each query; a tool that asks again at once gets sixty a second, about as many as
the original, which answered once a tick."""


def truth_service(
    host: str, port: int, answer: Callable[[str], str], **options: Any
) -> DialogueService:
    """Scoring tools ask here for the poses of everybody, TCP 3989.

    Every line is a query, even an empty one, and is answered by a listing in one piece: a tool
    reads once after data has arrived and takes what is there (side channels reference 6 and 7).

    Args:
        host, port: where to listen; nothing is opened before `start`.
        answer: the listing, line ends included, for a query without line end; may block.
        options: see `DialogueService`.
    """

    def respond(lines: list[bytes]) -> list[bytes]:
        return [answer(line.decode("latin-1")).encode("latin-1", "replace") for line in lines]

    def framer() -> QueryFramer:
        return QueryFramer(MAX_REQUEST)

    options = {"limits": TRUTH_LIMITS, **options}
    return DialogueService("truth", host, port, "--truth-port", framer, respond, **options)


def ground_truth_service(host: str, port: int, respond: Respond, **options: Any) -> DialogueService:
    """The wireless simulation asks here who is where, TCP 7435.

    Nothing is said on connecting, every request that is known has exactly one line as its answer,
    and the server never hangs up: the program that asks would end if it did (side channels
    reference 3.1 and 3.5).

    Args:
        host, port: where to listen; nothing is opened before `start`.
        respond: in general `responder` of `GroundTruth.answers`.
        options: see `DialogueService`.
    """

    def framer() -> LineFramer:
        return LineFramer(MAX_REQUEST)

    option = "--groundtruth-port"
    return DialogueService("groundtruth", host, port, option, framer, respond, **options)


def responder(answers: Callable[[Iterable[str]], list[str | None]]) -> Respond:
    """What a desk needs, in bytes, from replies to requests that came together, without line ends.

    Args:
        answers: makes one reply for each request; None: there is no reply. May block.
    """

    def respond(lines: list[bytes]) -> list[bytes]:
        return [_line(reply) for reply in answers([line.decode("latin-1") for line in lines])]

    return respond


def ready(at_once: Callable[[str], str | None]) -> Callable[[bytes], bytes | None]:
    """What `Instant.known` needs, in bytes, from the reply to a request that is known at once, both
    without line ends; None: it is not."""

    def known(line: bytes) -> bytes | None:
        reply = at_once(line.decode("latin-1"))
        return None if reply is None else _line(reply)

    return known


def _line(reply: str | None) -> bytes:
    return b"" if reply is None else f"{reply}\r\n".encode("latin-1", "replace")
