"""Threads that a service works on: made when they are needed, ended after a while without work."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

REST = 30.0
"""s of wall time without work after which the threads end."""

T = TypeVar("T")


class IdleThreads:
    """A pool of threads for the event loop; belongs to the loop's thread."""

    def __init__(self, name: str, most: int, rest: float = REST) -> None:
        """Describe the pool; no thread is there before work is.

        Args:
            name: of the threads. most: threads at the same time. rest: see `REST`.
        """
        self._name, self._most, self._rest = name, most, rest
        self._pool: ThreadPoolExecutor | None = None
        self._used = 0.0
        self._timer: asyncio.TimerHandle | None = None

    def run(self, call: Callable[..., T], *arguments: object) -> asyncio.Future[T]:
        """Begin a call on one of the threads."""
        loop = asyncio.get_running_loop()
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self._most, thread_name_prefix=self._name)
        self._used = loop.time()
        if self._timer is None:
            self._timer = loop.call_later(self._rest, self._look, loop)
        return loop.run_in_executor(self._pool, call, *arguments)

    def close(self) -> None:
        """Let the threads end; calls that have not begun are dropped."""
        if self._timer is not None:
            self._timer.cancel()
        pool, self._pool, self._timer = self._pool, None, None
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)

    def _look(self, loop: asyncio.AbstractEventLoop) -> None:
        left = self._used + self._rest - loop.time()
        if left > 0.0:
            self._timer = loop.call_later(left, self._look, loop)
            return
        pool, self._pool, self._timer = self._pool, None, None
        if pool is not None:
            pool.shutdown(wait=False)  # a call that takes so long still ends
