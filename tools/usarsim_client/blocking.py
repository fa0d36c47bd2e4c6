"""One TCP connection to any service of a server, for programs without an event loop."""

from __future__ import annotations

import socket
from functools import partial

from usarsim_client.inbox import HangupError, Inbox, Line, Read, Take, Wanted
from usarsim_client.pictures import Picture, picture
from usarsim_server.base.closing import Closing

_CHUNK = 1 << 18


class BlockingConnection(Closing):
    """What `Connection` is, with calls that wait.

    Attributes:
        socket: the connection, for who measures or selects by it.
        inbox: what has come and was not read yet.
    """

    def __init__(self, port: int, host: str = "127.0.0.1", patience: float | None = 10.0) -> None:
        """Connect.

        Args:
            port: of one of the server's services.
            host: address of the server.
            patience: s of wall time that a call waits before it raises `TimeoutError`.

        Raises:
            OSError: if nobody accepts.
        """
        self.inbox = Inbox()
        self.socket = socket.create_connection((host, port), patience)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, data: bytes) -> None:
        """Send bytes; `OSError` if the connection is gone."""
        self.socket.sendall(data)

    def take(self, take: Take[Read]) -> Read:
        """What a method of `Inbox` takes, as soon as it is there.

        Raises:
            HangupError: if the connection ends before.
        """
        while (found := take(self.inbox)) is None:
            data = self.socket.recv(_CHUNK)
            if not data:
                raise HangupError("the server hung up")
            self.inbox.feed(data)
        return found

    def line(self, wanted: Wanted = "") -> Line:
        """The next line that is wanted; others are passed over."""
        while not (line := self.take(Inbox.line)).fits(wanted):
            pass
        return line

    def ask(self, request: bytes, wanted: Wanted = "") -> Line:
        """Send bytes and read the next line that is wanted."""
        self.send(request)
        return self.line(wanted)

    def exactly(self, count: int) -> bytes:
        """So many bytes."""
        return self.take(partial(Inbox.exactly, count=count))

    def picture(self) -> Picture:
        """The next reply of the image stream."""
        return self.take(picture)

    def close(self) -> None:
        """Hang up."""
        self.socket.close()
