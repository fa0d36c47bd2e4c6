"""Ports of the server that lead to robots (side channels reference 4.3).

Whoever connects to a `RelayPort` is joined with the robot that it leads to. A port can be closed
for a while and keeps its number.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from typing import Protocol

from usarsim_server.base.logs import Log
from usarsim_server.services.listener import OUT_OF_RESOURCES, RESOURCE_PAUSE, set_buffers, tune
from usarsim_server.services.relay import (
    KERNEL_BUFFER,
    DialError,
    LinkOptions,
    OutgoingConnection,
    join,
)

MOST_LINKS = 16
"""Connections through one port at a time."""

_log = Log("relay")


class LinkWatcher(Protocol):
    """Is told about the links of a relay port, on the event loop."""

    def enter(self) -> bool:
        """Somebody connects: count the link; False if there are too many."""

    def leave(self) -> None:
        """A link that was counted is gone."""

    def dialled(self, port: int) -> None:
        """The server is about to dial from this port of its own."""

    def established(self) -> None:
        """Both sides are joined."""

    def passed(self, forward: bool, size: int) -> None:
        """Bytes were handed on; forward is away from the one who connected."""

    def ended(self, port: int, established: bool) -> None:
        """The link of that port of the server's own is gone."""


class RelayPort:
    """A port of the server that leads to one port of one robot; used on one event loop.

    Attributes:
        port: its number, the same over all outages.
    """

    def __init__(
        self,
        host: str,
        target: tuple[str, int],
        link_options: LinkOptions,
        name: str,
        watcher: LinkWatcher,
        tasks: set[asyncio.Task[None]],
    ) -> None:
        """Take a free port; nobody can connect before `open`.

        Args:
            host: address to listen on.
            target: numeric address and port of the robot.
            link_options: what happens to the traffic.
            name: of the link, for losses and the log.
            watcher: told about links.
            tasks: holds the running links, so that whoever stops the service can wait for them.

        Raises:
            OSError: if there is no port left.
        """
        self._host = host
        self._target = target
        self._link_options = link_options
        self._name = name
        self._watcher = watcher
        self._tasks = tasks
        self._loop = asyncio.get_running_loop()
        self._links: set[asyncio.Task[None]] = set()
        self._count = 0
        self._listening = False
        self._resume: asyncio.TimerHandle | None = None
        self._socket: socket.socket | None = _bound(host, 0)
        self.port: int = self._socket.getsockname()[1]

    @property
    def listening(self) -> bool:
        """Whether connections are accepted."""
        return self._listening

    @property
    def links(self) -> int:
        """Number of connections that pass through."""
        return len(self._links)

    def open(self) -> None:
        """Accept connections; does nothing if it does already."""
        if self._listening:
            return
        try:
            self._socket = self._socket or _bound(self._host, self.port)
            self._socket.listen(MOST_LINKS)
        except OSError as error:
            _log.warning("a port cannot be opened again", port=self.port, reason=error.strerror)
            return
        self._listening = True
        self._loop.add_reader(self._socket.fileno(), self._accept)

    def close(self) -> None:
        """Refuse connections and end all links; the port stays reserved."""
        if not self._listening:
            return
        self._drop()
        # A bound socket that does not listen refuses everybody and keeps the number.
        with contextlib.suppress(OSError):
            self._socket = _bound(self._host, self.port)

    def release(self) -> None:
        """Give the port up and end all links."""
        self._drop()

    def _drop(self) -> None:
        self._listening = False
        if self._resume is not None:
            self._resume.cancel()
        if self._socket is not None:
            self._loop.remove_reader(self._socket.fileno())
            self._socket.close()
            self._socket = None
        for link in self._links:
            link.cancel()
        self._links = set()

    def _accept(self) -> None:
        assert self._socket is not None
        try:
            client, _ = self._socket.accept()
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            if error.errno in OUT_OF_RESOURCES:
                self._pause()
            return
        if len(self._links) >= MOST_LINKS or not self._watcher.enter():
            _log.warning("connection refused: too many links", link=self._name)
            client.close()
            return
        self._count += 1
        link = self._loop.create_task(self._link(client, f"{self._name}#{self._count}"))
        for tasks in (self._links, self._tasks):
            tasks.add(link)
            link.add_done_callback(tasks.discard)
        # Not a `finally` in the coroutine: one that is cancelled before its first step runs none.
        link.add_done_callback(lambda _: self._leave(client))

    def _leave(self, client: socket.socket) -> None:
        client.close()
        self._watcher.leave()

    def _pause(self) -> None:
        """Out of descriptors: look again in a while instead of at once."""
        assert self._socket is not None
        self._loop.remove_reader(self._socket.fileno())
        self._resume = self._loop.call_later(RESOURCE_PAUSE, self._accept_again)

    def _accept_again(self) -> None:
        if self._listening and self._socket is not None:
            self._loop.add_reader(self._socket.fileno(), self._accept)

    async def _link(self, client: socket.socket, name: str) -> None:
        try:
            tune(client)
            dialler = OutgoingConnection(*self._target)
        except (DialError, OSError) as error:
            _log.info("cannot dial", link=name, reason=error)
            return
        self._watcher.dialled(dialler.port)
        joined = False
        try:
            with await dialler.connect() as robot:
                joined = True
                self._watcher.established()
                await join(client, robot, self._link_options, name, self._watcher.passed)
        except DialError as error:
            _log.info("a robot does not answer", link=name, reason=error)
        except Exception as error:  # a defect in one link must not end the others
            _log.exception("link closed by a server error", error, link=name)
        finally:
            self._watcher.ended(dialler.port, joined)


def _bound(host: str, port: int) -> socket.socket:
    """A socket that has a port and does not listen."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    one = socket.socket(family, socket.SOCK_STREAM)
    try:
        one.setblocking(False)
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        set_buffers(one, KERNEL_BUFFER, KERNEL_BUFFER)
        one.bind((host, port))
    except OSError:
        one.close()
        raise
    return one
