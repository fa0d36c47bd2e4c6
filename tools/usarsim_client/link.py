"""One control connection, always read: what it says goes to a state, to streams, to who asks.

A task reads as fast as the server writes, and what nobody wants is forgotten, so a program that
thinks long is neither cut off by the server nor bloated by it. Questions are asked one at a time.
"""

from __future__ import annotations

import asyncio
import contextlib
import weakref
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from usarsim_client.connection import Connection
from usarsim_client.decoder import Value
from usarsim_client.inbox import HangupError, Line, ProtocolError, command
from usarsim_client.reports import StartPoses
from usarsim_client.state import RobotState
from usarsim_client.streams import Stream
from usarsim_server.base.addresses import format_address
from usarsim_server.protocol.grammar import LineFramer

Kind = TypeVar("Kind")
Accept = Callable[[Value], Kind | None]
"""Says what a value means to whoever asked; None if it is no answer."""
Claim = Callable[[], Awaitable[None]]
"""Sees, before INIT, whether a name is free; raises `SpawnError` if it is not."""

MAX_LINE = 1 << 20
"""Longest line that is read, bytes; longer ones are skipped. Strips of depth pictures have 25,000,
a list of all the objects that a world holds 60,000."""

STARTS = "GETSTARTPOSES"
"""A question that servers answer in any state."""

FENCE = command(STARTS)
"""A question that every server answers; as replies keep the order of their requests, its answer
proves that what was asked before has none."""

GRACE = 3.0
"""s of wall time for an original server, which puts robots into the world later than it answers."""


def only(kind: type[Kind]) -> Accept[Kind]:
    """Accepts the first value of a kind."""
    return lambda value: value if isinstance(value, kind) else None


class NoAnswerError(ProtocolError):
    """The server did not answer a question; it does so when there is nothing to be told."""


class SpawnError(ProtocolError):
    """The server did not let a robot in."""


class NameTakenError(SpawnError):
    """Somebody else in the world has the name."""


@dataclass(frozen=True, slots=True)
class Address:
    """Where a server is, and how long to wait for it.

    Attributes:
        host, port: of the service.
        timeout: s of wall time that a connection, a send or an answer may take.
    """

    host: str
    port: int
    timeout: float

    def __str__(self) -> str:
        return format_address(self.host, self.port)

    @contextlib.asynccontextmanager
    async def patience(self, what: str) -> AsyncIterator[None]:
        """End a wait that takes too long.

        Raises:
            TimeoutError: with what was waited for.
        """
        try:
            async with asyncio.timeout(self.timeout):
                yield
        except TimeoutError:
            problem = f"{what} within {self.timeout:g} s (server {self})"
            raise TimeoutError(problem) from None

    async def open(self) -> Connection:
        """Connect.

        Raises:
            ConnectionError: if nobody accepts; names the address.
            TimeoutError: if nobody answers at all.
        """
        async with self.patience("no connection"):
            try:
                return await Connection.open(self.host, self.port)
            except OSError as error:
                raise ConnectionError(f"no server at {self}: {error}") from None


@dataclass(frozen=True, slots=True)
class Retry:
    """How a lost connection is made again.

    Attributes:
        first: s of wall time before the first try; doubled after each.
        most: s between two tries at most.
        tries: after which it is given up; None: never.
    """

    first: float = 0.5
    most: float = 30.0
    tries: int | None = None

    async def pause(self, tries: int) -> bool:
        """Wait before a try, counted from 0; False if it is given up."""
        if self.tries is not None and tries >= self.tries:
            return False
        await asyncio.sleep(min(self.first * 2.0 ** min(tries, 30), self.most))
        return True


class _Question(Generic[Kind]):
    """Something asked, and how its answer is told from what else comes."""

    def __init__(self, asked: str, accept: Accept[Kind], fenced: bool) -> None:
        self.asked, self.accept, self.fenced = asked, accept, fenced
        self.answer: asyncio.Future[Kind] = asyncio.get_running_loop().create_future()

    def hear(self, value: Value, fences: int) -> None:
        """Take what came; so many answers to fences are still due."""
        if self.answer.done():
            return
        if (found := self.accept(value)) is not None:
            self.answer.set_result(found)
        elif self.fenced and isinstance(value, StartPoses) and fences == 0:
            self.fail(NoAnswerError(f"the server has no answer to {self.asked}"))

    def fail(self, error: Exception) -> None:
        """There will be no answer."""
        if not self.answer.done():
            self.answer.set_exception(error)


class Link:
    """A control connection with what it said.

    Attributes:
        state: what was told so far, on the newest connection.
        address: of the server.
        spawns: how often this end has entered the world.
        wants: says which lines are taken apart, the others cost hardly anything; None: all. What
            answers questions must be wanted.
        rest: s of wall time between two reads, for who need not know at once; lines that come in
            one piece cost less.
        deaf: what comes is thrown away unread, unless a question waits for its answer.
    """

    def __init__(self, address: Address, retry: Retry | None = None) -> None:
        self.address = address
        self.state = RobotState()
        self.spawns = 0
        self.wants: Callable[[bytes], bool] | None = None
        self.rest = 0.0
        self.deaf = False
        self._retry = retry
        self._connection: Connection | None = None
        self._pumping: asyncio.Task[None] | None = None
        self._returning: asyncio.Task[None] | None = None
        self._streams: list[weakref.ref[Stream[Any]]] = []
        self._entry: tuple[bytes, Accept[str], Claim] | None = None
        self._asking = asyncio.Lock()
        self._question: _Question[Any] | None = None
        self._fences = 0
        self._tries = 0  # to come back since this end was last in the world
        self._closed = False
        self._error: Exception = HangupError(f"there is no connection to {address}")
        self._cause: Exception | None = None  # why this end broke the connection by itself

    async def open(self) -> None:
        """Connect and begin to read.

        Raises:
            ConnectionError: if nobody accepts.
            TimeoutError: if nobody answers.
        """
        self._connection = await self.address.open()
        self._pumping = asyncio.create_task(self._pump(), name=f"reads {self.address}")

    @property
    def connected(self) -> bool:
        """Whether the server is there, as far as we know."""
        return self._connection is not None and self._returning is None

    @property
    def closed(self) -> bool:
        """Whether this connection is over for good."""
        return self._closed or (self._pumping is not None and self._pumping.done())

    def lines(self, keep: int = 1000) -> Stream[Line]:
        """The lines of the server themselves."""
        return self.stream(Line, keep=keep)

    def stream(self, kind: type[Kind], name: str = "", keep: int = 0) -> Stream[Kind]:
        """Values of a kind from now on; see `Stream` and `Buffer`; to be called in the event loop.

        Streams that nobody holds any longer are forgotten.
        """
        stream = Stream(kind, name, keep)
        if self.closed:
            stream.end(None if self._closed else self._error)
        self._streams.append(weakref.ref(stream))
        return stream

    def _listeners(self) -> list[Stream[Any]]:
        """Streams that somebody holds."""
        found = [stream for one in self._streams if (stream := one()) is not None]
        if len(found) < len(self._streams):
            self._streams = [one for one in self._streams if one() is not None]
        return found

    # -- reading ----------------------------------------------------------------------------

    async def _pump(self) -> None:
        try:
            self._error = await self._read()
            while self._retry is not None and self._entry is not None and await self._reconnect():
                self._error = await self._read()
        finally:
            self._lose(self._error)
            for stream in self._listeners():
                stream.end(None if self._closed else self._error)

    async def _read(self) -> Exception:
        """Read to the end; returns why it ended."""
        connection, framer = self._connection, LineFramer(MAX_LINE)
        assert connection is not None
        error = HangupError(f"the server {self.address} closed the connection")
        try:
            while data := await connection.receive():
                if self.deaf and self._question is None:
                    data = data[: data.find(b"\n") + 1] + data[data.rfind(b"\n") + 1 :]
                for line in framer.feed(data):
                    if self.wants is None or self.wants(line):
                        self._take(line)
                if self.rest > 0.0:
                    await asyncio.sleep(self.rest)
        except OSError as problem:
            error = HangupError(f"the connection to {self.address} is lost: {problem}")
        self._lose(error)
        cause, self._cause = self._cause, None
        return cause or error

    def _lose(self, error: Exception) -> None:
        if self._connection is not None:
            self._connection.abort()
        self._connection = None
        if self._question is not None:
            self._question.fail(error)

    def _take(self, line: bytes) -> None:
        values = self.state.feed(line)
        for stream in self._listeners():
            if stream.kind is Line:
                stream.offer(Line(line))
            else:
                for value in values:
                    stream.offer(value)
        for value in values:
            if isinstance(value, StartPoses):
                self._fences = max(self._fences - 1, 0)
            if self._question is not None:
                self._question.hear(value, self._fences)

    # -- asking -----------------------------------------------------------------------------

    async def send(self, data: bytes) -> None:
        """Send commands as they are, line ends included.

        Raises:
            HangupError: if the connection is gone, also while it is being made again.
            TimeoutError: if the server takes nothing.
        """
        returning = self._returning is not None and asyncio.current_task() is not self._returning
        if self._connection is None or returning:
            raise HangupError(str(self._error))
        async with self.address.patience("the server took nothing"):
            try:
                await self._connection.send(data)
            except OSError as error:
                raise HangupError(f"the connection to {self.address} is lost: {error}") from None

    async def ask(
        self, request: bytes, accept: Accept[Kind], *, fence: bool = True, wait: float = 0.0
    ) -> Kind:
        """Send a question and wait for its answer.

        Args:
            request: the question, line end included; may be empty.
            accept: what a value means; called with all that comes until it finds the answer.
            fence: ask a second question that all servers answer, so that silence is noticed at
                once and not after the timeout.
            wait: s of wall time; 0: the timeout of the address.

        Raises:
            NoAnswerError: if the server has answered what was asked afterwards.
            TimeoutError: if it has not answered anything in time.
            HangupError: if the connection ends before.
        """
        asked = request.decode("latin-1").strip()
        address = replace(self.address, timeout=wait or self.address.timeout)
        async with self._asking:
            question = _Question(asked, accept, fence)
            self._fences += fence or asked.startswith(STARTS)
            self._question = question
            try:
                await self.send(request + (FENCE if fence else b""))
                async with address.patience(f"no answer to {asked}"):
                    return await question.answer
            finally:
                self._question = None
                if not question.answer.cancel() and not question.answer.cancelled():
                    question.answer.exception()  # seen, even if the request could not be sent

    # -- coming and going -------------------------------------------------------------------

    async def enter(self, init: bytes, accept: Accept[str], claim: Claim) -> None:
        """Send INIT, and again after each loss of the connection if a `Retry` was given.

        Args:
            init: INIT and a question that only who is in the world is answered.
            accept: what shows that it has come into the world, an empty text, or why not.
            claim: called each time before.

        Raises:
            SpawnError: if it does not come into the world.
            HangupError: if the connection ends before.
            TimeoutError: if the server answers nothing at all.
        """
        await self._enter(init, accept, claim)
        self._entry = init, accept, claim

    async def _enter(self, init: bytes, accept: Accept[str], claim: Claim) -> None:
        await claim()
        try:
            reason = await self.ask(init, accept)
        except NoAnswerError:
            try:
                reason = await self.ask(b"", accept, fence=False, wait=GRACE)
            except TimeoutError:
                reason = "the server took INIT and said nothing, which is how servers refuse"
        if reason:
            raise SpawnError(reason)
        self.spawns += 1
        self._tries = 0

    async def _reconnect(self) -> bool:
        """Connect anew and begin to enter the world again; False if it is given up."""
        assert self._retry is not None
        while not self._closed and await self._retry.pause(self._tries):
            self._tries += 1
            with contextlib.suppress(OSError):
                self._connection = await self.address.open()
                self._fences, self.state = 0, RobotState()
                self._returning = asyncio.create_task(self._return())
                return True
        return False

    async def _return(self) -> None:
        """Enter the world again, while the pump reads the answers; failed, the pump goes on."""
        assert self._entry is not None
        try:
            await self._enter(*self._entry)
        except (ProtocolError, OSError) as error:
            self._cause = error
            self._lose(error)
        finally:
            self._returning = None

    async def close(self) -> None:
        """Hang up; what is in the world leaves it."""
        self._closed = True
        self._lose(HangupError("the connection was closed at this end"))
        tasks = [task for task in (self._returning, self._pumping) if task is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
