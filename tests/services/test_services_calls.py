"""Calls into an event loop from other threads."""

from __future__ import annotations

import asyncio
import threading

from usarsim_server.services.replies import LoopCalls


def test_all_are_made_in_the_order_they_came() -> None:
    """Four threads call as fast as they can; nothing is lost, and each one's order is kept."""

    async def listen() -> list[tuple[int, int]]:
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
        return heard

    heard = asyncio.run(listen())
    for name in range(4):
        assert [n for who, n in heard if who == name] == list(range(2000))


def test_one_wake_up_serves_many() -> None:
    """Calls that come while the loop is busy share one look."""

    async def count() -> int:
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
        return looks

    assert asyncio.run(count()) == 2


def test_a_call_that_calls_again_is_heard() -> None:
    """What is said during a look is heard at the next one."""

    async def listen() -> list[str]:
        heard: list[str] = []
        calls = LoopCalls(asyncio.get_running_loop())
        calls(lambda: calls(lambda: heard.append("again")))
        for _ in range(5):
            await asyncio.sleep(0)
        return heard

    assert asyncio.run(listen()) == ["again"]


def test_after_the_end_of_the_loop_calls_are_dropped() -> None:
    """A thread that still speaks then does not fail."""
    loop = asyncio.new_event_loop()
    calls = LoopCalls(loop)
    loop.close()
    calls(lambda: None)
