"""One TCP connection to any service of a server; everything on it goes into a transcript, short
enough to print."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

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


_CHUNK = 65536
_TINY = 4096
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
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        transcript: Transcript,
        label: str,
        clock: SimulatedClock,
    ) -> None:
        self._reader = reader
        self._writer = writer
        self._transcript = transcript
        self.clock = clock
        self.label = label
        self.torn = 0
        self._buffer = b""
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
                sock = await _connected(host, port, tiny)
                reader, writer = await asyncio.open_connection(
                    sock=sock, limit=_TINY if tiny else _CHUNK
                )
        except (OSError, TimeoutError) as error:
            transcript.note(label, f"no connection to {host}:{port}: {error!r}")
            raise Failed(f"no connection to {host}:{port}: {error or 'no answer'}") from None
        transcript.note(label, f"connected to {host}:{port}")
        return cls(reader, writer, transcript, label, clock)

    @property
    def local_port(self) -> int:
        """Port of the kit's end."""
        name = self._writer.get_extra_info("sockname")
        return int(name[1])

    @property
    def local_address(self) -> str:
        """Address of the kit's end, where the server can reach it."""
        return str(self._writer.get_extra_info("sockname")[0])

    async def send(self, data: bytes) -> None:
        """Send bytes.

        Raises:
            Hangup: if the connection is gone.
            Failed: if the server does not take them.
        """
        self._transcript.sent(self.label, data)
        try:
            self._writer.write(data)
            async with asyncio.timeout(_HANGS):
                await self._writer.drain()
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

    async def read_by(self, moment: float) -> bytes:
        """Whatever comes next until a moment of the clock; nothing if nothing comes."""
        if self._buffer:
            data, self._buffer = self._buffer, b""
            return data
        return await self._receive(moment)

    async def read_exactly(self, count: int, within: float) -> bytes:
        """That many bytes.

        Raises:
            Failed: if fewer come in time.
            Hangup: if the server closed the connection.
        """
        await self._fill(lambda: len(self._buffer) >= count, within, f"{count} bytes")
        data, self._buffer = self._buffer[:count], self._buffer[count:]
        return data

    async def read_until(self, end: bytes, within: float) -> bytes:
        """Bytes up to and with an end mark.

        Raises:
            Failed: if it does not come in time.
            Hangup: if the server closed the connection.
        """
        await self._fill(lambda: end in self._buffer, within, repr(end))
        data, mark, self._buffer = self._buffer.partition(end)
        return data + mark

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
        try:
            data = await self._reader.read(_CHUNK)
        except OSError as error:
            raise Hangup(f"the server reset the connection ({error})") from None
        if not data:
            raise Hangup("the server closed the connection")
        return data

    def half_close(self) -> None:
        """Send end of file and go on reading."""
        self._transcript.note(self.label, "half-closed")
        with contextlib.suppress(OSError):
            self._writer.write_eof()

    def reset(self) -> None:
        """Break the connection with a reset."""
        self._transcript.note(self.label, "reset")
        sock = self._writer.get_extra_info("socket")
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self._writer.transport.abort()

    def close(self) -> None:
        """Hang up; a second call does nothing."""
        if self._reading is not None:
            self._reading.cancel()
            self._reading = None
        if not self._writer.is_closing():
            self._transcript.note(self.label, "closed")
            self._writer.close()

    async def _fill(self, enough: Callable[[], bool], within: float, what: str) -> None:
        moment = self.clock.after(within)
        while not enough():
            data = await self._receive(moment)
            if not data:
                raise Failed(
                    f"{what} did not come within {within:g} s; so far {len(self._buffer)} bytes: "
                    f"{self._buffer[:80]!r}"
                )
            self._buffer += data

    async def _receive(self, moment: float) -> bytes:
        if self._reading is None:
            self._reading = asyncio.create_task(self.receive())
            self._reading.add_done_callback(_noticed)
        # Never cancelled by a time limit: nothing that has come may be lost.
        if not await self.clock.wait(self._reading, moment):
            return b""
        reading, self._reading = self._reading, None
        try:
            data = reading.result()
        except Hangup as error:
            self._transcript.note(self.label, str(error))
            raise
        self._transcript.received(self.label, data)
        # A read that is full was cut by the kit, not by the server.
        self.torn += not data.endswith(b"\n") and len(data) < _CHUNK
        return data


def _noticed(task: asyncio.Task[bytes]) -> None:
    """Nobody has to read to the end: a hangup that is not looked at is no news."""
    if not task.cancelled():
        task.exception()


async def _connected(host: str, port: int, tiny: bool) -> socket.socket:
    """A connected socket; the buffer can be made smaller only before it connects."""
    loop = asyncio.get_running_loop()
    kind, *_, address = (await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM))[0]
    sock = socket.socket(kind, socket.SOCK_STREAM)
    try:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if tiny:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _TINY)
        await loop.sock_connect(sock, address)
    except BaseException:
        sock.close()
        raise
    return sock
