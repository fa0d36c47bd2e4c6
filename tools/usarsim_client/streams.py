"""Bounded places between the one who reads a connection and those who use what it says."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from typing import Generic, Self, TypeVar

from usarsim_client.inbox import HangupError

Kind = TypeVar("Kind")

MOST_NAMES = 256
"""Items of which a newest-wins buffer keeps one value each; no robot has half as many."""


class Buffer(Generic[Kind]):
    """Holds values for somebody who may never come; what does not fit is dropped, oldest first.

    Attributes:
        dropped: how many values nobody took.
    """

    def __init__(self, keep: int = 0) -> None:
        """Make an empty one.

        Args:
            keep: 0: the newest value of each item wins; otherwise so many values, in order.

        Raises:
            ValueError: if it is negative.
        """
        if keep < 0:
            raise ValueError(f"a buffer keeps 0 values (the newest of each item) or more: {keep}")
        self.dropped = 0
        self._keep = keep
        self._most = keep or MOST_NAMES
        self._held: OrderedDict[object, Kind] = OrderedDict()
        self._count = 0

    def __len__(self) -> int:
        return len(self._held)

    def put(self, value: Kind) -> None:
        """Add a value."""
        key: object = type(value), getattr(value, "name", None)
        if self._keep:
            key = self._count = self._count + 1
        if key in self._held:
            self.dropped += 1
        elif len(self._held) >= self._most:
            self._held.popitem(last=False)
            self.dropped += 1
        self._held[key] = value

    def take(self) -> Kind | None:
        """The value that has waited longest; None if there is none."""
        return self._held.popitem(last=False)[1] if self._held else None


class Stream(Generic[Kind]):
    """Values of one kind as they come: `async for scan in robot.scans()`.

    It ends when its robot is closed, with `HangupError` if the server hung up. What is in the
    buffer is given out first. Several streams of one kind do not take values from each other.

    Attributes:
        kind: class of the values. name: of the item, lower case; empty for all items.
    """

    def __init__(self, kind: type[Kind], name: str = "", keep: int = 0) -> None:
        self.kind = kind
        self.name = name.lower()
        self._buffer = Buffer[Kind](keep)
        self._stirred = asyncio.Event()
        self._ended = False
        self._error: Exception | None = None

    @property
    def dropped(self) -> int:
        """How many values came and went before somebody took them."""
        return self._buffer.dropped

    def offer(self, value: object) -> None:
        """Keep a value if it is of the kind that is wanted."""
        if isinstance(value, self.kind) and (
            not self.name or getattr(value, "name", "").lower() == self.name
        ):
            self._buffer.put(value)
            self._stirred.set()

    def end(self, error: Exception | None = None) -> None:
        """Let nobody wait any longer; an error is raised once the buffer is empty."""
        self._ended, self._error = True, error
        self._stirred.set()

    async def get(self) -> Kind:
        """The next value.

        Raises:
            HangupError: if there will be none.
        """
        while (value := self._buffer.take()) is None:
            if self._ended:
                raise self._error or HangupError("the connection was closed at this end")
            self._stirred.clear()
            await self._stirred.wait()
        return value

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Kind:
        try:
            return await self.get()
        except HangupError:
            if self._error is None:
                raise StopAsyncIteration from None
            raise
