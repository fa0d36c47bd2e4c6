"""Threads of a service come with work and end without it."""

from __future__ import annotations

import asyncio
import threading
import time

from usarsim_server.services.idle_threads import IdleThreads
from usarsim_server.testing import eventually

NAME = "idle-threads-test"


def threads() -> list[threading.Thread]:
    return [one for one in threading.enumerate() if one.name.startswith(NAME)]


async def test_threads_end_without_work_and_come_again() -> None:
    pool = IdleThreads(NAME, 2, rest=0.1)
    assert threads() == []
    for _ in range(2):
        assert await asyncio.gather(*(pool.run(pow, 2, n) for n in range(5))) == [1, 2, 4, 8, 16]
        assert 1 <= len(threads()) <= 2
        while threads():  # noqa: ASYNC110 (threads tell no loop of their end)
            await asyncio.sleep(0.01)


async def test_a_call_that_takes_longer_than_the_rest_still_ends() -> None:
    pool = IdleThreads(NAME, 1, rest=0.05)
    slow = pool.run(time.sleep, 0.3)
    await asyncio.sleep(0.15)
    assert await asyncio.gather(pool.run(pow, 3, 2), slow) == [9, None]
    pool.close()
    assert eventually(lambda: threads() == [])


async def test_closing_drops_calls_that_wait() -> None:
    pool = IdleThreads(NAME, 1)
    go = threading.Event()
    first = pool.run(go.wait)
    second = pool.run(pow, 2, 2)
    await asyncio.sleep(0.1)
    pool.close()
    go.set()
    await first
    assert second.cancelled() or isinstance(second.exception(), asyncio.CancelledError)
