"""Calls from other threads into an event loop: one wake-up for many."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable

__all__ = ["LoopCalls"]


class LoopCalls:
    """Runs callbacks on an event loop, in the order in which they come from any thread.

    Waking the loop costs a system call and a fight for the interpreter; calls that come before it
    has woken share one.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: deque[Callable[[], None]] = deque()
        self._rung = False

    def __call__(self, callback: Callable[[], None]) -> None:
        """Have a callback run soon; dropped if the loop has ended. Any thread."""
        self._waiting.append(callback)
        if not self._rung:
            self._rung = True
            # A robot may still speak while the loop is being closed at the end of the process.
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._answer)

    def _answer(self) -> None:
        # Before the look: what comes during it rings again.
        self._rung = False
        for _ in range(len(self._waiting)):
            self._waiting.popleft()()
