"""Who looks at the live world, and what each gets next on the channels `scene` and `poses`.

A channel makes a subscription for each client. Its `take` hands over one whole frame when the
client is ready for it, always of the newest instant, so nothing piles up behind who reads slowly.
Everything here is used on the event loop, but what says otherwise.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from typing import Protocol

from usarsim_server.protocol.scene import LEAST_RATE, MOST_RATE, Hello, Instant

SLACK = 0.5 / MOST_RATE
"""s by which poses may come early: those of a lower rate fall on the beat of the highest."""


class SceneSource(Protocol):
    """What makes the frames of the world: a `SceneFeed`."""

    def start(self, on_news: Callable[[Instant], None], on_end: Callable[[], None]) -> None:
        """Begin to look; instants are told by a thread."""

    def stop(self) -> None:
        """Look away."""

    def set_rate(self, rate: float) -> None:
        """Make so many instants per s of wall time at most."""


class Subscriber:
    """One client after its hello.

    Attributes:
        peer: `host:port`.
        hello: what it began with.
        rate_hz: pose frames per s of wall time that it wants now.
        leaving: what is to be done when it has gone.
    """

    def __init__(self, peer: str, hello: Hello) -> None:
        self.peer, self.hello, self.rate_hz = peer, hello, hello.rate_hz
        self.leaving = contextlib.ExitStack()
        self._news = asyncio.Event()
        self._loop = asyncio.get_running_loop()

    def wake(self) -> None:
        """There may be something to take (on the event loop)."""
        self._news.set()

    def wake_soon(self) -> None:
        """The same from any thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._news.set)

    async def news(self) -> None:
        """Wait for the next call of `wake`."""
        await self._news.wait()
        self._news.clear()


class Subscription(Protocol):
    """What one client gets on one channel; used on the event loop."""

    def take(self) -> bytes | None:
        """The next frame, None if there is nothing new; wakes the subscriber when there is."""

    def close(self) -> None:
        """The client has gone."""


Channel = Callable[[Subscriber], Subscription]
"""Makes the subscription of a client."""
Request = Callable[[Subscriber, Mapping[str, object]], Awaitable[Mapping[str, object]]]
"""Does what a client asks for; returns further keys of the reply. `SceneError`: why not."""


class Board:
    """What is to be seen now; everything on the event loop but what the feed calls."""

    def __init__(self, feed: SceneSource) -> None:
        self._feed = feed
        self._watchers: dict[object, Subscriber] = {}
        self._instant: Instant | None = None
        self._ended = False

    @property
    def instant(self) -> Instant | None:
        """The newest; None before the first. `ConnectionAbortedError` if there will be no more."""
        if self._ended:
            raise ConnectionAbortedError("the scene feed has ended")
        return self._instant

    def enter(self, watcher: object, subscriber: Subscriber) -> None:
        """Somebody looks."""
        self._watchers[watcher] = subscriber
        self.set_rate()
        if len(self._watchers) == 1:
            loop = asyncio.get_running_loop()

            def tell(call: Callable[[], None]) -> None:
                with contextlib.suppress(RuntimeError):  # the loop has ended
                    loop.call_soon_threadsafe(call)

            self._feed.start(
                lambda instant: tell(lambda: self._publish(instant)),
                lambda: tell(self._end),
            )

    def leave(self, watcher: object) -> None:
        """Somebody looks away."""
        self._watchers.pop(watcher, None)
        self.set_rate()
        if not self._watchers:
            self.close()

    def close(self) -> None:
        """Nobody looks any more."""
        self._feed.stop()
        self._instant, self._ended = None, False

    def set_rate(self) -> None:
        """Look as often as the most demanding watcher wants."""
        rates = [one.rate_hz for one in self._watchers.values()]
        self._feed.set_rate(max(rates, default=LEAST_RATE))

    def _publish(self, instant: Instant) -> None:
        if self._watchers:
            self._instant = instant
            for one in self._watchers.values():
                one.wake()

    def _end(self) -> None:
        """Let everybody go, so that nobody takes a picture of the past for the world."""
        self._ended = True
        for one in self._watchers.values():
            one.wake()


class Scene:
    """The scene once, then who is present, whenever that changes; the newest wins."""

    def __init__(self, board: Board, subscriber: Subscriber) -> None:
        self._board = board
        self._waiting: deque[bytes] = deque()
        self._sent: set[str] = set()  # ids of what was sent
        self._told: int | None = None  # generation of the last `present`
        board.enter(self, subscriber)

    def take(self) -> bytes | None:
        """See `Subscription`."""
        instant = self._board.instant
        if self._waiting:
            return self._waiting.popleft()
        if instant is None or instant.generation == self._told:
            return None
        parts = [instant.scene, *(instant.kinds[kind] for kind in instant.needed)]
        missing = {name: frame for part in parts for name, frame in part if name not in self._sent}
        if missing:
            self._sent.update(missing)
            self._waiting.extend(missing.values())
            return self._waiting.popleft()
        # What nobody remembers here is sent again if it comes again.
        known = {name for part in (instant.scene, *instant.kinds.values()) for name, _ in part}
        self._sent &= known
        self._told = instant.generation
        return instant.present

    def close(self) -> None:
        """See `Subscription`."""
        self._board.leave(self)


class Poses:
    """The newest poses, no more often than the client wants."""

    def __init__(self, board: Board, subscriber: Subscriber) -> None:
        self._board, self._subscriber = board, subscriber
        self._told: Instant | None = None
        self._last = 0.0  # when a frame was due last
        self._loop = asyncio.get_running_loop()
        self._clock = self._loop.time
        self._alarm: asyncio.TimerHandle | None = None
        board.enter(self, subscriber)

    def take(self) -> bytes | None:
        """See `Subscription`."""
        instant, now = self._board.instant, self._clock()
        # By the rate of now: who asks for more waits no longer for what it asked for before.
        period = 1.0 / self._subscriber.rate_hz
        due = self._last + period
        if instant is None or instant is self._told:
            return None
        if now < due - SLACK:  # there may be no further instant that would wake anybody
            self._forget()
            self._alarm = self._loop.call_at(due - SLACK, self._subscriber.wake)
            return None
        self._last = max(due, now - period)
        self._told = instant
        return instant.poses

    def _forget(self) -> None:
        """No alarm is set any more."""
        if self._alarm is not None:
            self._alarm.cancel()

    def close(self) -> None:
        """See `Subscription`."""
        self._forget()
        self._board.leave(self)
