"""One TCP connection to any service of a server; everything on it goes into a transcript, short
enough to print."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import deque
from functools import partial
from typing import TYPE_CHECKING

from usarsim_client.connection import CHUNK, Connection
from usarsim_client.inbox import Inbox, Take
from usarsim_conformance.registry import Failed

if TYPE_CHECKING:
    from usarsim_conformance.clock import SimulatedClock


_FIRST, _LAST = 30, 70
"""Entries kept from the beginning and from the end."""
_WIDTH = 300
"""Characters shown of one entry."""


class Transcript:
    """The first and the last things sent and received; bounded, whatever a server pours out."""

    def __init__(self) -> None:
        self._begun = time.monotonic()
        self._first: list[str] = []
        self._last: deque[str] = deque(maxlen=_LAST)
        self._count = 0

    def sent(self, who: str, data: bytes) -> None:
        """Note bytes that the kit sent."""
        self._add(f"{who} > {_shown(data)}")

    def received(self, who: str, data: bytes) -> None:
        """Note bytes that came from the server."""
        self._add(f"{who} < {_shown(data)}")

    def note(self, who: str, text: str) -> None:
        """Note something else: opened, closed, reset."""
        self._add(f"{who} * {text}")

    def entries(self) -> tuple[str, ...]:
        """What was kept, in order; a line of its own tells how much was left out."""
        left_out = self._count - len(self._first) - len(self._last)
        gap = (f"... {left_out} more ...",) if left_out else ()
        return (*self._first, *gap, *self._last)

    def _add(self, text: str) -> None:
        entry = f"{time.monotonic() - self._begun:8.3f} {text}"
        self._count += 1
        if len(self._first) < _FIRST:
            self._first.append(entry)
        else:
            self._last.append(entry)


def _shown(data: bytes) -> str:
    """Bytes as text with line ends visible, cut in the middle if long."""
    head, tail = data, b""
    if len(data) > _WIDTH:
        head, tail = data[: _WIDTH * 2 // 3], data[-_WIDTH // 3 :]
    text = _visible(head)
    return text + f" ...({len(data)} bytes)... " + _visible(tail) if tail else text


def _visible(data: bytes) -> str:
    signs = {10: "\\n", 13: "\\r", 9: "\\t", 92: "\\\\"}
    return "".join(
        signs.get(byte) or (chr(byte) if 32 <= byte < 127 else f"\\x{byte:02x}") for byte in data
    )


_HANGS = 60.0
"""s of wall time after which a server that accepts nobody, or takes no bytes, counts as hanging."""


class Hangup(Failed):
    """The server closed or reset the connection; few rules allow that."""


class Wire:
    """A connection; use `Case.open`, which closes it at the end of the check.

    Waiting methods take `within`, s of simulated time.

    Attributes:
        clock: simulated time, as the server tells it.
        label: name in the transcript.
        torn: how often what was received at once did not end with a line end.
    """

    def __init__(
        self, connection: Connection, transcript: Transcript, label: str, clock: SimulatedClock
    ) -> None:
        self._connection = connection
        self._transcript = transcript
        self.clock = clock
        self.label = label
        self.torn = 0
        self._reading: asyncio.Task[bytes] | None = None

    @classmethod
    async def open(
        cls,
        host: str,
        port: int,
        transcript: Transcript,
        label: str,
        clock: SimulatedClock,
        tiny: bool = False,
    ) -> Wire:
        """Connect.

        Args:
            host: address of the server.
            port: of one of its services.
            transcript: where everything goes.
            label: of the connection, there.
            clock: simulated time.
            tiny: take little in advance, so that a client that does not read stops the sender.

        Raises:
            Failed: if nobody accepts the connection.
        """
        try:
            async with asyncio.timeout(_HANGS):
                connection = await Connection.open(host, port, little=tiny)
        except (OSError, TimeoutError) as error:
            transcript.note(label, f"no connection to {host}:{port}: {error!r}")
            raise Failed(f"no connection to {host}:{port}: {error or 'no answer'}") from None
        transcript.note(label, f"connected to {host}:{port}")
        return cls(connection, transcript, label, clock)

    @property
    def local_address(self) -> str:
        """Address of the kit's end, where the server can reach it."""
        return self._connection.address[0]

    @property
    def peer_port(self) -> int:
        """Port of the other end."""
        return self._connection.peer_port

    @property
    def waiting(self) -> int:
        """How many bytes have been received and not been read."""
        return len(self._connection.inbox)

    async def send(self, data: bytes) -> None:
        """Send bytes.

        Raises:
            Hangup: if the connection is gone.
            Failed: if the server does not take them.
        """
        self._transcript.sent(self.label, data)
        try:
            async with asyncio.timeout(_HANGS):
                await self._connection.send(data)
        except TimeoutError:
            raise Failed(f"the server did not take {len(data)} bytes in {_HANGS:g} s") from None
        except OSError as error:
            raise Hangup(f"the server closed the connection ({error})") from None

    async def read(self, within: float) -> bytes:
        """Whatever comes next, at least a byte; nothing if nothing comes in time.

        Raises:
            Hangup: if the server closed the connection.
        """
        return await self.read_by(self.clock.after(within))

    async def read_by(self, moment: float, least_wall: float = 0.0) -> bytes:
        """Whatever comes next until a moment of the clock; nothing if nothing comes.

        Args:
            moment: see `SimulatedClock.after`.
            least_wall: see `read_exactly`.
        """
        return self._connection.inbox.everything() or await self._receive(moment, least_wall)

    async def read_exactly(self, count: int, within: float, least_wall: float = 0.0) -> bytes:
        """That many bytes.

        Args:
            count: of bytes.
            within: s of simulated time.
            least_wall: s of wall time that have to pass as well before they are given up, for
                what a server makes in real time at any speed of the simulation.

        Raises:
            Failed: if fewer come in time.
            Hangup: if the server closed the connection.
        """
        take = partial(Inbox.exactly, count=count)
        return await self._take(take, within, f"{count} bytes", least_wall)

    async def read_until(self, end: bytes, within: float) -> bytes:
        """Bytes up to and with an end mark.

        Raises:
            Failed: if it does not come in time.
            Hangup: if the server closed the connection.
        """
        return await self._take(partial(Inbox.until, mark=end), within, repr(end))

    async def silence(self, seconds: float) -> bytes:
        """Everything that comes within a time; a hangup ends it early and raises nothing."""
        data, moment = b"", self.clock.after(seconds)
        with contextlib.suppress(Hangup):
            while more := await self.read_by(moment):
                data += more
        return data

    async def hung_up(self, within: float) -> bool:
        """Whether the server closes the connection in time; what it still says is dropped."""
        moment = self.clock.after(within)
        try:
            while await self.read_by(moment):
                pass
        except Hangup:
            return True
        return False

    async def receive(self) -> bytes:
        """Whatever comes next, however long it takes; it is not written down.

        Raises:
            Hangup: if the connection ends.
        """
        reading, self._reading = self._reading, None
        # One that was begun and not waited for has what comes next.
        return await (self._next() if reading is None else reading)

    async def _next(self) -> bytes:
        try:
            data = await self._connection.receive()
        except OSError as error:
            raise Hangup(f"the server reset the connection ({error})") from None
        if not data:
            raise Hangup("the server closed the connection")
        return data

    def half_close(self) -> None:
        """Send end of file and go on reading."""
        self._transcript.note(self.label, "half-closed")
        self._connection.half_close()

    def reset(self) -> None:
        """Break the connection with a reset."""
        self._transcript.note(self.label, "reset")
        self._connection.reset()

    def close(self) -> None:
        """Hang up; a second call does nothing."""
        if self._reading is not None:
            self._reading.cancel()
            self._reading = None
        if not self._connection.closing:
            self._transcript.note(self.label, "closed")
            self._connection.close()

    async def _take(
        self, take: Take[bytes], within: float, what: str, least_wall: float = 0.0
    ) -> bytes:
        inbox, moment = self._connection.inbox, self.clock.after(within)
        while (found := take(inbox)) is None:
            data = await self._receive(moment, least_wall)
            if not data:
                raise Failed(
                    f"{what} did not come within {within:g} s; so far {len(inbox)} bytes: "
                    f"{inbox.rest[:80]!r}"
                )
            inbox.feed(data)
        return found

    async def _receive(self, moment: float, least_wall: float = 0.0) -> bytes:
        if self._reading is None:
            self._reading = asyncio.create_task(self._next())
            self._reading.add_done_callback(_noticed)
        # Never cancelled by a time limit: nothing that has come may be lost.
        if not await self.clock.wait(self._reading, moment, least_wall):
            return b""
        reading, self._reading = self._reading, None
        try:
            data = reading.result()
        except Hangup as error:
            self._transcript.note(self.label, str(error))
            raise
        self._transcript.received(self.label, data)
        # A read that is full was cut by the kit, not by the server.
        self.torn += not data.endswith(b"\n") and len(data) < CHUNK
        return data


def _noticed(task: asyncio.Task[bytes]) -> None:
    """Nobody has to read to the end: a hangup that is not looked at is no news."""
    if not task.cancelled():
        task.exception()
