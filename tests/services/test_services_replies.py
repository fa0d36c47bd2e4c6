"""Calls into an event loop from other threads, and replies of ports that only answer."""

from __future__ import annotations

import asyncio
import socket
import threading

import pytest

from usarsim_server.services.replies import PIECE, LoopCalls, ReplyBuffer


async def test_all_are_made_in_the_order_they_came() -> None:
    """Four threads call as fast as they can; nothing is lost, and each one's order is kept."""
    heard: list[tuple[int, int]] = []
    calls = LoopCalls(asyncio.get_running_loop())

    def speak(name: int) -> None:
        for number in range(2000):
            calls(lambda number=number: heard.append((name, number)))  # type: ignore[misc]

    threads = [threading.Thread(target=speak, args=(name,)) for name in range(4)]
    for thread in threads:
        thread.start()
    await asyncio.to_thread(lambda: [thread.join() for thread in threads])
    done = asyncio.Event()
    calls(done.set)
    await done.wait()
    for name in range(4):
        assert [n for who, n in heard if who == name] == list(range(2000))


async def test_one_wake_up_serves_many() -> None:
    """Calls that come while the loop is busy share one look."""
    loop, looks = asyncio.get_running_loop(), 0
    original = loop.call_soon_threadsafe

    def counted(callback, *args):  # type: ignore[no-untyped-def]
        nonlocal looks
        looks += 1
        return original(callback, *args)

    loop.call_soon_threadsafe = counted  # type: ignore[method-assign]
    calls = LoopCalls(loop)
    for _ in range(50):
        calls(lambda: None)
    await asyncio.sleep(0.01)
    calls(lambda: None)
    assert looks == 2


async def test_a_call_that_calls_again_is_heard() -> None:
    """What is said during a look is heard at the next one."""
    heard: list[str] = []
    calls = LoopCalls(asyncio.get_running_loop())
    calls(lambda: calls(lambda: heard.append("again")))
    for _ in range(5):
        await asyncio.sleep(0)
    assert heard == ["again"]


def test_after_the_end_of_the_loop_calls_are_dropped() -> None:
    """A thread that still speaks then does not fail."""
    loop = asyncio.new_event_loop()
    calls = LoopCalls(loop)
    loop.close()
    calls(lambda: None)


class Pair:
    """Two ends of a connection with small buffers in the kernel; ours is non-blocking."""

    def __init__(self) -> None:
        self.ours, self.theirs = socket.socketpair()
        self.ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        self.ours.setblocking(False)

    def __enter__(self) -> Pair:
        return self

    def __exit__(self, *_: object) -> None:
        self.ours.close()
        self.theirs.close()


def test_replies_that_come_together_leave_together() -> None:
    """One send for what belongs to one chunk of requests; nothing before the flush."""

    async def converse(pair: Pair) -> bytes:
        replies = ReplyBuffer(pair.ours)
        for number in range(3):
            await replies.put(b"reply %d\r\n" % number)
        assert replies.held == 27
        await replies.flush()
        await replies.flush()
        assert replies.held == 0
        return pair.theirs.recv(1000)

    with Pair() as pair:
        assert asyncio.run(converse(pair)) == b"reply 0\r\nreply 1\r\nreply 2\r\n"


def test_replies_are_worked_out_no_faster_than_the_client_reads() -> None:
    """A million replies to a client that reads nothing: a few are made, a piece of them is held."""
    made = 0

    async def converse(pair: Pair) -> None:
        nonlocal made
        replies = ReplyBuffer(pair.ours, patience=0.05)
        for _ in range(1_000_000):
            made += 1
            await replies.put(b"x" * 1000)
            assert replies.held < PIECE + 1000

    with Pair() as pair:
        with pytest.raises(ConnectionAbortedError, match="does not read"):
            asyncio.run(converse(pair))
        assert 0 < made < 2000


def test_a_reply_that_nobody_reads_ends_the_connection_and_a_slow_reader_lives() -> None:
    """Every piece has the whole patience: who reads slowly is served as long as he likes."""

    async def converse(pair: Pair) -> int:
        pair.theirs.setblocking(False)
        replies = ReplyBuffer(pair.ours, patience=5.0)

        async def read() -> int:
            loop, read = asyncio.get_running_loop(), 0
            while read < 20 * PIECE:
                read += len(await loop.sock_recv(pair.theirs, 3000))
                await asyncio.sleep(0)
            return read

        reader = asyncio.create_task(read())
        for _ in range(20):
            await replies.put(b"x" * PIECE)
        return await reader

    with Pair() as pair:
        assert asyncio.run(converse(pair)) == 20 * PIECE
