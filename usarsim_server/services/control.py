"""The control service: robot controllers connect here, one robot per connection, TCP 3000.

Bytes that arrive are framed into lines, parsed into commands and handed to the connection's
session in order; lines that the session puts into the outbox are sent one by one. What the commands
mean is the session's business: this file knows no robot and no clock.

A client can neither fill the memory nor delay others. Its input is read only as fast as its session
takes commands, and no faster than a rate (TCP pushes back), its output waits in a bounded outbox,
and the kernel's buffers are small and of fixed size. Who sends more commands than real controllers
do takes turns with all others who do: together they get a small part of one processor, so that the
physics and the reports come first.
"""

from __future__ import annotations

import asyncio
import math
import socket
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from usarsim_server.base.logs import Log
from usarsim_server.protocol.grammar import (
    KNOWN_WORDS,
    MAX_LINE,
    MOST_SEGMENTS,
    WEIGHT_BYTES,
    LineFramer,
    parse_line,
)
from usarsim_server.protocol.opening import Opening
from usarsim_server.services.budget import WorkBudget, whole_share
from usarsim_server.services.limits import (
    COMMAND_WORK,
    REPLY_PART,
    InputRates,
    input_cost,
    work_cost,
)
from usarsim_server.services.listener import challenge, hung_up
from usarsim_server.services.port import Guest, PortLimits, PortService, refuse
from usarsim_server.services.reading import ChunkReader
from usarsim_server.services.replies import LoopCalls
from usarsim_server.sessions.outbox import Grace, Outbox, OutboxLimits

if TYPE_CHECKING:  # which stands on the physics
    from usarsim_server.sessions.session import Session

_CHUNK = 2048
"""Bytes read at a time. Parsing them holds the event loop for half a millisecond; beside a client
that floods (180,000 commands a second) another's request is answered within 4 ms. With 4096 it is
7 ms, with 1024 3 ms at some loss of throughput."""
_SMALL_CHUNK = 256
"""The same for a client that has used up what is its own: what it is charged for a chunk comes
afterwards, and somebody who only comes to send one chunk never pays."""
_FLOOD_CHUNK = 1024
"""The same once such a client has waited for its turn: some thirty commands, so that reports never
wait for more than half a millisecond of them."""
_LINE_TOKENS = 128
"""Commands that a client has to have left if a whole chunk is to be read from it."""
_MOST_PENDING = 0.02
"""Processor time of commands that may wait at a session, s, as far as it can be told."""
_LEAST_BACKLOG = 64
"""Weight of commands that may wait there in any case."""
_REPLY_WORK = 20e-6
"""Processor time of sending a reply, s."""
LONGEST_REPLY = 256 * 1024
"""Bytes of a single reply: that to GetSTA when there are 256 objects, whose names and memories are
bounded, comes near half of it."""
_LINES_PER_TURN = 32
"""Lines sent to one client before others get their turn."""
CHALLENGE = 10.0
"""s of wall time without a line to a client whose input is not read, after which it is asked for a
sign of life (`listener.challenge`)."""
_HANG_UP_POLL = 0.2
"""Seconds between looks for a hang-up while a client's input is not read; who has had to wait for
so long in all is told of in the log."""

SessionFactory = Callable[[str, Outbox, Callable[[], None]], "Session"]
"""Makes the session of a new connection, on the event loop; must not block.

Given `host:port` of the client; the outbox for the session's lines, in which the greeting is
already; and what is to be called, from any thread, when the session's backlog has shrunk, at the
least when it is empty: reading a paused client's input then goes on at once instead of after a
fifth of a second.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlLimits(PortLimits):
    """What the clients of the control port may use.

    The number of clients was UDK's MaxConnections (protocol reference 1.1). The rate counts
    commands, see `limits.input_cost`. The share is that of all clients together that send more than
    their own share of the rate (`limits.OWN_SHARE`); it is less while the world falls behind. A
    client that stopped reading finds at most as much old text as the kernel holds when it reads on.
    """

    share: float = 0.1
    max_line: int = MAX_LINE  # longest line in bytes; longer ones are thrown away
    backlog_high: int = 256
    """Weight of commands waiting at a session beyond which its client's input is not read. One
    client of the field sends 180 a second (protocol reference, addendum). It is read no further
    than 20 ms of processor time are likely to take, either."""
    backlog_low: int = 64  # weight at which reading goes on
    outbox: OutboxLimits = field(default_factory=OutboxLimits)  # see `OutboxLimits`

    @property
    def held_bytes(self) -> int:
        """Memory that a connection can make the server hold, without the kernel's buffers.

        Half a line, which Python keeps with an eighth to spare, and the next one that is read; the
        commands that wait, and those of the line with which they became too many; the outbox, with
        one long reply.
        """
        line = self.max_line + _CHUNK
        commands = self.backlog_high * WEIGHT_BYTES + 2 * line + MOST_SEGMENTS * WEIGHT_BYTES // 4
        return 2 * line + line // 8 + commands + self.outbox.held_bytes + LONGEST_REPLY


class ControlService(PortService[ControlLimits]):
    """Accepts robot controllers on one port; all sessions are closed when `stop` returns."""

    def __init__(
        self,
        host: str,
        port: int,
        greeting: bytes,
        session_factory: SessionFactory,
        limits: ControlLimits | None = None,
        pace: Callable[[], float] = whole_share,
    ) -> None:
        """Describe the service; nothing is opened before `start`.

        Args:
            host, port, limits: see `PortService`.
            greeting: the one line, CR LF included, that every client reads first (protocol 1.2).
            session_factory: see `SessionFactory`; called once per connection.
            pace: which part of its share the service may use now.
        """
        super().__init__("control", host, port, "--port", limits or ControlLimits(), required=True)
        self._greeting = greeting
        self._agent_factory = session_factory
        self._calls: LoopCalls | None = None
        self._budget = WorkBudget(self._limits.share, pace=pace)
        self._grace = Grace()

    async def _serve(self, client: socket.socket, peer: str) -> None:
        log = self._log.bind(connection=peer)
        calls = self._calls = self._calls or LoopCalls(asyncio.get_running_loop())
        rates, budget, grace = self._rates, self._budget, self._grace
        connection = _Connection(client, self._limits, rates, budget, grace, calls, log)
        connection.outbox.put_reply(self._greeting)
        try:
            session = self._agent_factory(peer, connection.outbox, connection.resume)
        except BaseException:
            connection.outbox.close()
            raise
        log.info("client connected")
        reason = "connection closed by a server error"
        try:
            with self._guests.enter(peer) as guest:
                guest.standing = lambda: self._stands(guest, session)
                guest.leave = connection.dismiss
                reason = await connection.run(session, lambda: self._guests.heard(guest))
        except asyncio.CancelledError as error:
            reason = str(error) or "server stopped"
            raise
        finally:
            connection.outbox.close()
            session.close()
            log.info(reason, dropped_lines=connection.outbox.dropped)

    def _stands(self, guest: Guest, session: Session) -> bool:
        """Whether a client may be silent: as long as it is something in the world."""
        if session.has_role:
            self._guests.heard(guest)  # the time begins when its robot is lost
        return session.has_role


class _Connection:
    """The conversation with one client: a reader and a writer on one socket."""

    def __init__(
        self,
        client: socket.socket,
        limits: ControlLimits,
        rates: InputRates,
        budget: WorkBudget,
        grace: Grace,
        calls: LoopCalls,
        log: Log,
    ) -> None:
        self._client = client
        self._limits = limits
        self._rates = rates
        self._budget = budget
        self._allowance = rates.newcomer()
        self._own = rates.own(self._allowance)
        self._account = budget.newcomer()
        self._log = log
        self._loop = asyncio.get_running_loop()
        self._call_in_loop = calls
        self._ended: asyncio.Future[str] = self._loop.create_future()
        self._reader = ChunkReader(client)
        self._lines_wait = asyncio.Event()
        self._backlog_shrank = asyncio.Event()
        self._paused = False
        self._waited = 0.0
        self._proved = 0.0  # wall time of the last line to it, or challenge
        self._endless = False
        self._replied = (0, 0)
        self._worked = 0.0
        self._submitted = 0
        self.outbox = Outbox(self._wake, limits.outbox, grace=grace)

    async def run(self, session: Session, heard: Callable[[], None]) -> str:
        """Talk until the client goes or has to go; returns why it ended.

        Args:
            session: executes the commands.
            heard: called whenever there was one.
        """
        try:
            async with asyncio.TaskGroup() as tasks:
                works = [self._read(session, heard), self._write()]
                running = [tasks.create_task(work) for work in works]
                reason = await self._ended
                for task in running:
                    task.cancel()
        finally:
            self._reader.close()
        return reason

    def dismiss(self) -> None:
        """The client has to go: it wants nothing, or somebody else wants its place."""
        self._end("client was idle")

    def resume(self) -> None:
        """The session's backlog shrank. Any thread."""
        if self._paused:
            self._call_in_loop(self._backlog_shrank.set)

    def _wake(self) -> None:
        """The outbox has lines, or was condemned. Any thread."""
        self._call_in_loop(self._look_at_outbox)

    def _look_at_outbox(self) -> None:
        condemned = self.outbox.condemned
        if condemned is not None and not self._ended.done():
            self._log.warning("connection closed by the server", reason=condemned)
            self._end("connection condemned")
        self._lines_wait.set()

    def _end(self, reason: str) -> None:
        if not self._ended.done():
            self._ended.set_result(reason)

    async def _read(self, session: Session, heard: Callable[[], None]) -> None:
        framer, opening = LineFramer(self._limits.max_line), Opening()
        while chunk := await self._receive():
            if foreign := opening.foreign(chunk):
                refuse(self._log, foreign)
                break
            begun = time.thread_time()
            discarded = framer.discarded
            lines = framer.feed(chunk)
            self._endless = not lines
            commands = [command for line in lines for command in parse_line(line)]
            if framer.discarded != discarded:
                self._log.info("line discarded: too long", limit=framer.max_line)
            if commands:
                if any(command.word in KNOWN_WORDS for command in commands):
                    heard()
                if any(command.cut for command in commands):
                    self._log.info("end of a line discarded: too many segments")
                session.submit(commands)
            work = time.thread_time() - begun
            # `receive` does not yield while there is data: let other clients have a turn.
            await asyncio.sleep(0)
            self._submitted += sum(command.weight for command in commands)
            if not await self._catch_up(session):
                break
            if not await self._pay(session, work, input_cost(lines, len(commands))):
                break
        if framer.pending:
            self._log.warning("the connection ended within a line, which is not carried out")
        self._end("client closed the connection")

    async def _pay(self, session: Session, work: float, cost: float) -> bool:
        """Let the client pay for a chunk, and for what has been done for it since the last one.

        Args:
            session: executes its commands.
            work: processor time that it took to read the chunk, s.
            cost: of the chunk, see `input_cost`.

        Returns:
            False if the client has hung up before it may go on.
        """
        if math.isinf(self._rates.rate):
            return True
        replies, octets = self.outbox.replied
        cost += (octets - self._replied[1]) / REPLY_PART
        work += session.work - self._worked + (replies - self._replied[0]) * _REPLY_WORK
        self._replied, self._worked = (replies, octets), session.work
        self._budget.charge(self._account, work)
        cost = max(cost, work_cost(work))
        wait = self._allowance.spend(cost)
        if wait and not await self._stays_for(asyncio.sleep(wait)):
            return False
        if not self._own.spend(cost):
            return True
        return await self._stays_for(self._budget.turn(self._account))

    async def _stays_for(self, turn: Awaitable[None]) -> bool:
        """Read nothing until a turn has come; False if the client hangs up meanwhile."""
        begun = self._loop.time()
        self._rates.waiting += 1
        waiting = asyncio.ensure_future(turn)
        try:
            while not waiting.done():
                await asyncio.wait({waiting}, timeout=_HANG_UP_POLL)
                if not waiting.done() and self._gone():
                    return False
        finally:
            self._rates.waiting -= 1
            waiting.cancel()
        self._tell_of_haste(self._loop.time() - begun)
        return True

    def _tell_of_haste(self, waited: float) -> None:
        """Say once, when it has had to wait for a while in all, that a client sends too much."""
        before, self._waited = self._waited, self._waited + waited
        if before <= _HANG_UP_POLL < self._waited:
            self._log.warning(
                "client sends too fast: it is read more slowly", rate=self._limits.rate
            )

    async def _receive(self) -> bytes:
        """What came next; nothing once the client has closed, half or whole, or reset."""
        size = _CHUNK
        if not self._endless and self._own.tokens < _LINE_TOKENS:
            # A chunk can hold a line in every two bytes.
            size = _FLOOD_CHUNK if self._waited else _SMALL_CHUNK
        try:
            return await self._reader.receive(size)
        except OSError as error:
            self._end(f"connection lost: {error.strerror}")
            return b""

    async def _catch_up(self, session: Session) -> bool:
        """Read nothing while too much waits at the session; False if the client hangs up meanwhile.

        Too much is what it will be at for too long, as far as its commands so far tell: they are
        paid for once they are executed. Somebody who has nothing left to pay with is waited for
        until all is done.
        """
        limits, backlog = self._limits, session.backlog
        high = min(limits.backlog_high, _LEAST_BACKLOG)
        if session.work:
            mean = max(COMMAND_WORK, session.work / max(1, self._submitted - backlog))
            high = min(limits.backlog_high, max(high, int(_MOST_PENDING / mean)))
        if self._own.tokens < 0.0 and math.isfinite(self._rates.rate):
            high = 0
        if backlog <= high:
            return True
        return await self._pause(session, min(limits.backlog_low, high // 2))

    async def _pause(self, session: Session, low: int) -> bool:
        """Read nothing until the backlog is as low as that; False if the client hangs up."""
        self._log.debug("input paused", backlog=session.backlog)
        self._backlog_shrank.clear()
        self._paused = True
        try:
            while session.backlog > low:
                try:
                    async with asyncio.timeout(_HANG_UP_POLL):
                        await self._backlog_shrank.wait()
                except TimeoutError:
                    if self._gone():
                        return False
                self._backlog_shrank.clear()
        finally:
            self._paused = False
        return True

    def _gone(self) -> bool:
        """Whether a client whose input is not read has hung up."""
        now = self._loop.time()
        if now - self._proved > CHALLENGE:
            self._proved = now
            challenge(self._client)
        return hung_up(self._client)

    async def _write(self) -> None:
        sent = 0
        reported = 0
        try:
            while True:
                line = self.outbox.take()
                if line is None:
                    reported = self._report_drops(reported)
                    self._lines_wait.clear()
                    await self._lines_wait.wait()
                    continue
                # One send call per line (protocol reference 1.1 REQ), but for clients of lockstep;
                # it returns when the kernel has all, so nothing piles up beside the outbox.
                await self._send(line)
                sent += 1
                if sent % _LINES_PER_TURN == 0:
                    await asyncio.sleep(0)
        except OSError as error:
            self._end(f"connection lost: {error.strerror}")

    async def _send(self, line: bytes) -> None:
        self._proved = self._loop.time()
        try:
            taken = self._client.send(line)
        except (BlockingIOError, InterruptedError):
            taken = 0
        if taken < len(line):  # rare: the kernel's buffer is full
            await self._loop.sock_sendall(self._client, line[taken:])

    def _report_drops(self, reported: int) -> int:
        dropped = self.outbox.dropped
        if dropped != reported:
            self._log.info("client was too slow: periodic lines dropped", lines=dropped - reported)
        return dropped
