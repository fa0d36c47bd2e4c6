"""How much a connection can make the server hold, port by port: the worst case is built, the memory
that Python has taken is counted, and the figure that the code states bounds it."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import socket
import struct
import threading
import time
import tracemalloc
from collections.abc import Callable, Iterator

import pytest
import services_harness as control
from images_harness import BIG, FakeSource, RunningImages, rectangle
from test_services_dialogue import Running, ground
from wireless_harness import Line
from wireless_harness import Running as Radio

from usarsim_server.protocol import wireless
from usarsim_server.protocol.grammar import MAX_LINE, MOST_SEGMENTS
from usarsim_server.protocol.scene import LONGEST
from usarsim_server.services.comserver import ComServerLimits
from usarsim_server.services.control import ControlLimits
from usarsim_server.services.dialogue import MAX_REQUEST, DialogueLimits
from usarsim_server.services.images import ImageLimits
from usarsim_server.services.relay import LinkOptions
from usarsim_server.services.scene_port import SceneLimits, ScenePort
from usarsim_server.services.wireless import WirelessLimits
from usarsim_server.sessions.outbox import OutboxLimits
from usarsim_server.testing import PATIENCE

CLIENTS = 8
OURS = 300 * 1024
"""Bytes that a test needs for itself."""

MOST = 8 << 20
"""Bytes sent at most: what throws away a line without an end takes bytes for ever."""


class Counting:
    """Bytes that Python has taken since the beginning."""

    def __init__(self) -> None:
        self._before = 0

    def begin(self) -> None:
        """Everything that exists by now does not count."""
        gc.collect()
        tracemalloc.start()
        self._before = tracemalloc.get_traced_memory()[0]

    def peak(self) -> int:
        """The most that there was at a time."""
        return tracemalloc.get_traced_memory()[1] - self._before


@pytest.fixture
def memory() -> Iterator[Counting]:
    """Counts while the test runs."""
    yield Counting()
    tracemalloc.stop()


def flood(clients: list[socket.socket], data: bytes, quiet: int = 120) -> None:
    """Send, and read nothing, until the server has taken nothing at so many tries, or 8 MiB.

    Tries, no time: on a busy machine its thread waits as long as this one.
    """
    for one in clients:
        one.setblocking(False)
    tries = sent = 0
    while tries < quiet and sent < MOST:
        tries += 1
        for one in clients:
            with contextlib.suppress(BlockingIOError, ConnectionError):
                sent += one.send(data)
                tries = 0
        time.sleep(0.002)


def many(connect: Callable[[], socket.socket]) -> list[socket.socket]:
    """Clients of small buffers."""
    return [connect() for _ in range(CLIENTS)]


def test_replies_that_nobody_reads(memory: Counting) -> None:
    """7435 and 3989: replies of the longest kind, a thousand asked for at once, none read."""
    limits = DialogueLimits(share=10.0)
    reply = "x" * (limits.reply_bytes - 2)
    with Running(ground(lambda lines: [f"{reply[: -len(one)]}{one}" for one in lines])) as running:
        clients = many(lambda: running.connect(receive_buffer=4096).socket)
        requests = b"".join(b"Q%d\n" % number for number in range(400))
        memory.begin()
        flood(clients, requests)
        assert memory.peak() < CLIENTS * limits.held_bytes + OURS
        assert limits.held_bytes < 1024 * 1024


def test_commands_that_wait_and_answers_that_nobody_reads(memory: Counting) -> None:
    """3000: the mailbox full of the heaviest commands, half a line behind it, a full outbox."""
    limits = ControlLimits()
    with control.Running(limits, hold=True) as running:
        pairs = [running.pair(receive_buffer=4096) for _ in range(CLIENTS)]
        clients = [client.socket for client, _ in pairs]
        heavy = b"SET " + b"{\xe9\xe9 \xe9}" * MOST_SEGMENTS
        heavy += b"{Params " + b"y" * (MAX_LINE - len(heavy) - 9) + b"}"
        memory.begin()
        flood(clients, heavy + b"\r\n" + b"DRIVE {L 1} {R 1}\r\n" * 20)
        for _, session in pairs:
            _fill(session)
        assert memory.peak() < CLIENTS * limits.held_bytes + OURS
        assert memory.peak() > CLIENTS * limits.held_bytes // 2, "the figure is far too large"
        assert all(session.closes == 0 for _, session in pairs)


def _fill(session: control.FakeAgent) -> None:
    """Have an outbox hold as much as it takes, in as many lines as it takes, and a long reply."""
    outbox = OutboxLimits()
    for number in range(2 * outbox.stream_lines):
        length = outbox.stream_bytes // outbox.stream_lines
        session.outbox.put_stream(b"%*d\r\n" % (length - 2, number))
    session.outbox.put_reply(b"%*d\r\n" % (128 * 1024, 0))  # waits in the kernel's buffer, in part
    length = (outbox.reply_bytes - 200 * 1024) // (outbox.reply_lines - 2)
    for number in range(outbox.reply_lines - 2):
        session.outbox.put_reply(b"%*d\r\n" % (length - 2, number))


def test_half_requests(memory: Counting) -> None:
    """7435 and 3989: lines that never end."""
    with Running(ground()) as running:
        clients = many(lambda: running.connect().socket)
        memory.begin()
        flood(clients, b"x" * (MAX_REQUEST - 1))
        assert memory.peak() < CLIENTS * DialogueLimits().held_bytes + OURS


def test_wireless_dialogue(memory: Counting) -> None:
    """50000: half lines of the longest kind, long names, ports without number, none read."""
    limits = WirelessLimits(share=10.0, poll=0.02)
    with Radio(Line(), limits=limits, model="none") as running:
        clients = many(lambda: running.talker().socket)
        ports = b",".join(b"%d" % number for number in range(1, wireless.MOST_PORTS + 1))
        memory.begin()
        for number, one in enumerate(clients):
            one.sendall(b"INIT {Robot R%d} {Port %s}\r\n" % (number, ports))
            one.sendall(b"INIT {Robot %s} {Port 1}\r\n" % (b"x" * 65_000))
        flood(clients, b"DNS {Robot %s}\r\n" % (b"y" * 64) * 50)
        flood(clients, b"x" * (wireless.MAX_LINE // 2))
        assert memory.peak() < CLIENTS * limits.held_bytes + OURS


def test_links_full_both_ways(memory: Counting) -> None:
    """Relay ports: both ends send and neither reads."""
    with Radio(Line(A=0, B=1)) as running:
        a, b = running.robot("A"), running.robot("B")
        links = [a.link(b) for _ in range(CLIENTS)]
        ends = [end for pair in links for end in pair]
        memory.begin()
        flood(ends, b"x" * 65_536, quiet=200)
        assert memory.peak() < CLIENTS * LinkOptions().held_bytes + OURS


def test_older_wireless(memory: Counting) -> None:
    """5874: names, ports and messages as long and as many as can be."""
    with Radio(Line()) as running:
        limits = ComServerLimits()
        clients = many(lambda: running.com_talker().socket)
        names = b"".join(
            b"REGISTER N%d%s 127.0.0.1;LISTEN N%d%s %d;" % (n, b"x" * 58, n, b"x" * 58, n)
            for n in range(1000)
        )
        memory.begin()
        flood(clients, names[:40_000], quiet=200)
        flood(clients, b"REGISTER " + b"x" * 9000)
        assert memory.peak() < CLIENTS * limits.held_bytes + limits.names_bytes + OURS


def test_pictures_that_nobody_reads(memory: Counting) -> None:
    """5003: every client wants a picture of its own, again and again, and reads none."""
    with RunningImages(FakeSource(BIG)) as running:
        clients = many(lambda: running.connect(receive_buffer=4096).socket)
        memory.begin()
        for number, one in enumerate(clients):
            one.sendall(rectangle(number, 0, BIG.width - CLIENTS, BIG.height) * 20)
        time.sleep(1.0)
        kept = 32 * 1024 * 1024  # pictures that all clients share
        assert memory.peak() < CLIENTS * ImageLimits().held_bytes(BIG.frame) + kept + OURS


def test_half_a_message_on_the_scene_port(memory: Counting) -> None:
    """The scene port: a hello of the greatest length but for its last byte, and the next behind."""
    limits = SceneLimits(max_connections=CLIENTS)
    port = ScenePort("127.0.0.1", 0, Blind(), "yard", limits=limits)
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    endpoint = asyncio.run_coroutine_threadsafe(port.start(), loop).result(PATIENCE)
    clients = many(lambda: socket.create_connection((endpoint.host, endpoint.port)))
    try:
        memory.begin()
        flood(clients, struct.pack(">IB", LONGEST, ord("J")) + b" " * (LONGEST - 2))
        assert memory.peak() < CLIENTS * limits.held_bytes + OURS
    finally:
        asyncio.run_coroutine_threadsafe(port.stop(), loop).result(PATIENCE)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(PATIENCE)
        loop.close()
        for one in clients:
            one.close()


class Blind:
    """A feed that shows nothing."""

    def start(self, on_news: object, on_end: object) -> None:
        """Nothing happens."""

    def stop(self) -> None:
        """Nothing happens."""

    def set_rate(self, rate: float) -> None:
        """Nothing happens."""
