"""Joining two TCP connections: what one robot sends comes out at the other (side channels 4.3).

Bytes pass both ways, untouched and in order. A side that has nothing more to say is passed on as
such; the other direction goes on. What waits in a relay is bounded, and TCP pushes back on a sender
whose receiver does not read. Whether the radio reaches is looked at again and again.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import resource
import socket
from collections import Counter, deque
from collections.abc import Callable, Collection, Coroutine
from dataclasses import dataclass, field
from functools import partial

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.logs import Log
from usarsim_server.radio.configuration import LinkClock, LinkShape
from usarsim_server.radio.network import Network
from usarsim_server.services.budget import BYTE_COST, Account, WorkBudget
from usarsim_server.services.listener import set_buffers, tune
from usarsim_server.services.silence import PATIENCE, ends_when_gone

BUFFER = 32 * 1024
"""Bytes read at a time where traffic simply passes; the original read 2048 (side channels 4.3)."""
BLOCK = 8 * 1024
"""Bytes read at a time on a shaped link: the finest grain of bandwidth."""
WAITING_BYTES, WAITING_BLOCKS = 128 * 1024, 4096
"""What may be on its way in one direction of a shaped link."""
KERNEL_BUFFER = 64 * 1024
"""Bytes per socket and direction, before the kernel doubles it."""
SHARE = 0.15
"""Part of a processor that all links of a service may use: some 40 MB/s."""
DIAL_TIMEOUT = 5.0
"""s of wall time for a robot to accept a connection."""
WANTED_FILES = 8192
"""Open files that a large team may need: two for each link, one for each pair that asked."""

_log = Log("relay")


class DialError(Exception):
    """A robot does not accept the connection."""


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """What all links of a service have in common."""

    shape: LinkShape = field(default_factory=LinkShape)  # what happens to the traffic
    speed: float = 1.0  # simulated seconds per second; at infinity nothing waits
    seed: int = 0  # of losses
    budget: WorkBudget = field(default_factory=lambda: WorkBudget(SHARE))
    """Processor time for carrying it."""
    silence: float = PATIENCE
    """s of wall time after which the machine at either end counts as gone; see `silence`."""

    @property
    def plain(self) -> bool:
        """Whether traffic simply passes."""
        return self.shape.plain or math.isinf(self.speed)

    @property
    def held_bytes(self) -> int:
        """Bytes that a link can make the server hold if nobody reads at either end, without the
        kernel's buffers."""
        return 2 * (BUFFER if self.plain else WAITING_BYTES + 2 * BLOCK)

    @property
    def kernel_bytes(self) -> int:
        """The same in the kernel, which doubles what it is asked for: two sockets, two ways."""
        return 8 * KERNEL_BUFFER


class Traffic:
    """Counts the links of a service, all of them and those of each robot."""

    def __init__(self, most: int, per_robot: int) -> None:
        """There are none.

        Args:
            most: at a time.
            per_robot: the same for those that one robot began.
        """
        self.most, self.per_robot = most, per_robot
        self._links: Counter[str] = Counter()

    def enter(self, robot: str) -> bool:
        """Count a link that a robot begins; False if it may not."""
        if self._links.total() >= self.most or self._links[robot] >= self.per_robot:
            return False
        self._links[robot] += 1
        return True

    def leave(self, robot: str) -> None:
        """A link of a robot has ended."""
        self._links[robot] -= 1
        if not self._links[robot]:
            del self._links[robot]


class OutgoingConnection:
    """A connection to a robot that is about to be made.

    Attributes:
        port: of the server's own, fixed before the robot can see it.
    """

    def __init__(self, host: str, port: int) -> None:
        """Choose the port.

        Raises:
            DialError: if there is none left, or the address is of no kind that is known here.
        """
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._address = (host, port)
        try:
            self._socket = socket.socket(family, socket.SOCK_STREAM)
        except OSError as error:
            raise DialError(error.strerror) from error
        try:
            set_buffers(self._socket, KERNEL_BUFFER, KERNEL_BUFFER)
            self._socket.bind(("", 0))
            tune(self._socket)
        except OSError as error:
            self._socket.close()
            raise DialError(error.strerror) from error
        self.port: int = self._socket.getsockname()[1]

    async def connect(self) -> socket.socket:
        """Dial; returns the connected socket, which is closed if this fails.

        Raises:
            DialError: if the robot refuses or does not answer in time.
        """
        try:
            async with asyncio.timeout(DIAL_TIMEOUT):
                await asyncio.get_running_loop().sock_connect(self._socket, self._address)
        except (OSError, TimeoutError, OverflowError) as error:
            self._socket.close()
            raise DialError(str(error) or "no answer") from error
        except BaseException:
            self._socket.close()
            raise
        return self._socket


async def dial(host: str, port: int) -> socket.socket:
    """Connect to a robot at a numeric address.

    Raises:
        DialError: if that fails.
    """
    return await OutgoingConnection(host, port).connect()


async def join(
    one: socket.socket,
    other: socket.socket,
    link_options: LinkOptions,
    name: str,
    passed: Callable[[bool, int], None],
) -> None:
    """Pass bytes both ways until both sides have ended, or either is lost.

    Cancels the running task when the machine at either side is gone.

    Args:
        one: the one that connected; not closed here, as the other is not.
        other: the one that was dialled.
        link_options: what happens on the way.
        name: of the link; equal names lose equal frames.
        passed: told how many bytes were handed on, and whether from `one` to `other`.
    """
    account = link_options.budget.newcomer()

    def note(forward: bool, size: int) -> None:
        link_options.budget.charge(account, size * BYTE_COST)
        passed(forward, size)

    there, back = partial(note, True), partial(note, False)
    seconds = link_options.silence
    with (
        ends_when_gone(one, _log, seconds, link=name, end="the one that connected"),
        ends_when_gone(other, _log, seconds, link=name, end="the one that was dialled"),
    ):
        await both_ways(
            pump(one, other, link_options, f"{name}>", account, there),
            pump(other, one, link_options, f"{name}<", account, back),
            until=asyncio.FIRST_EXCEPTION,
        )


async def cancel_all(tasks: Collection[asyncio.Task[None]]) -> None:
    """End tasks, and wait for their end; how they end is of no interest."""
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def both_ways(*works: Coroutine[None, None, None], until: str) -> None:
    """Carry bytes both ways until one way ends, or, by `FIRST_EXCEPTION`, fails.

    A broken connection is an end like any other; other errors are raised.
    """
    ways = [asyncio.create_task(work) for work in works]
    try:
        done, _ = await asyncio.wait(ways, return_when=until)
        for way in done:
            if not isinstance(error := way.exception(), OSError | None):
                raise error
    finally:
        await cancel_all(ways)


async def pump(
    source: socket.socket,
    target: socket.socket,
    link_options: LinkOptions,
    name: str,
    account: Account,
    passed: Callable[[int], None],
) -> None:
    """Pass bytes one way until the source says no more; then tell the target so.

    Raises:
        OSError: if either side is lost.
    """
    if link_options.plain:
        await _pump_at_once(source, target, link_options.budget, account, passed)
    else:
        await _Delay(source, target, link_options, name, account, passed).run()
    target.shutdown(socket.SHUT_WR)


async def _pump_at_once(
    source: socket.socket,
    target: socket.socket,
    budget: WorkBudget,
    account: Account,
    passed: Callable[[int], None],
) -> None:
    loop = asyncio.get_running_loop()
    while data := await loop.sock_recv(source, BUFFER):
        await budget.turn(account)
        await loop.sock_sendall(target, data)
        passed(len(data))
        del data  # a link on which nothing passes holds nothing
        # Neither call yields while it has data and room: let the other links have a turn.
        await asyncio.sleep(0)


class _Delay:
    """One direction of a shaped link: a reader, what is on its way, a writer."""

    def __init__(
        self,
        source: socket.socket,
        target: socket.socket,
        link_options: LinkOptions,
        name: str,
        account: Account,
        passed: Callable[[int], None],
    ) -> None:
        self._source, self._target = source, target
        self._budget, self._account = link_options.budget, account
        self._speed = link_options.speed
        self._passed = passed
        self._clock = LinkClock(link_options.shape, f"{link_options.seed}\0{name}")
        self._loop = asyncio.get_running_loop()
        self._blocks: deque[tuple[float, bytes]] = deque()
        self._bytes = 0
        self._changed = asyncio.Event()

    async def run(self) -> None:
        lost: list[BaseException] = []
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._read())
                tasks.create_task(self._write())
        except* OSError as group:
            lost.extend(group.exceptions)
        if lost:
            raise lost[0]

    async def _read(self) -> None:
        data = b"begin"
        while data:
            while self._bytes >= WAITING_BYTES or len(self._blocks) >= WAITING_BLOCKS:
                await self._change()
            data = await self._loop.sock_recv(self._source, BLOCK)
            await self._budget.turn(self._account)
            due = self._clock.arrival(self._loop.time() * self._speed, len(data)) / self._speed
            self._blocks.append((due, data))
            self._bytes += len(data)
            self._changed.set()
            await asyncio.sleep(0)

    async def _write(self) -> None:
        while True:
            while not self._blocks:
                await self._change()
            due, data = self._blocks[0]
            await asyncio.sleep(max(0.0, due - self._loop.time()))
            if not data:
                return  # the end of the stream takes as long as a byte
            await self._loop.sock_sendall(self._target, data)
            self._passed(len(data))
            self._blocks.popleft()
            self._bytes -= len(data)
            self._changed.set()

    async def _change(self) -> None:
        self._changed.clear()
        await self._changed.wait()


class RadioWatch:
    """Looks at the world again and again while there is somebody to look for."""

    def __init__(
        self,
        name: str,
        network: Network,
        poll: float,
        needed: Callable[[], bool],
        review: Callable[[], None],
    ) -> None:
        """Describe the watch; nothing happens before `start`.

        Args:
            name: of the service, for the log.
            network: is looked at in a thread of its own, because that may block.
            poll: s of wall time between two looks.
            needed: whether anybody is registered.
            review: called after every look, on the event loop.
        """
        self._name = name
        self._network = network
        self._poll = poll
        self._needed = needed
        self._review = review
        self._log = Log(name)
        self._looking = asyncio.Lock()
        self._somebody = asyncio.Event()
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Begin."""
        self._task = asyncio.create_task(self._run(), name=f"{self._name}-watch")

    async def stop(self) -> None:
        """End, and wait for the end."""
        if self._task is not None:
            await cancel_all([self._task])

    def wake(self) -> None:
        """Somebody has registered."""
        self._somebody.set()

    async def look(self) -> None:
        """Look at the world now.

        Raises:
            UsarsimError: if the physics has ended.
        """
        async with self._looking:
            await asyncio.to_thread(self._network.observe)

    async def _run(self) -> None:
        while True:
            if not self._needed():
                self._somebody.clear()
                await self._somebody.wait()
            try:
                await self.look()
                self._review()
            except UsarsimError as error:
                self._log.warning("the watch ends", reason=error)
                return
            except Exception as error:  # a defect must not leave ports and links open for ever
                self._log.exception("the watch failed, goes on", error)
            await asyncio.sleep(self._poll)


def raise_descriptor_limit(wanted: int = WANTED_FILES) -> None:
    """Let the process open as many files as it may, up to a number; never lowers the limit."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def descriptor_limit() -> int:
    """Files that the process may have open."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return WANTED_FILES if soft == resource.RLIM_INFINITY else soft
