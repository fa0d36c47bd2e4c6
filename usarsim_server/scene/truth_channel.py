"""The channel `truth` of the scene port: every row, for everybody who asks.

Rows wait for a client in an outbox. While that is crowded and the client reads, simulated time
waits, as it does for the streams of robots at `--speed max`. For clients that do not read it waits
a second, for all of them together, and a fiftieth of the time after that. The first row that finds
no room ends a connection, so no client gets rows with a gap.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from usarsim_server.scene.channels import Subscriber
from usarsim_server.sessions.outbox import Grace, Outbox

if TYPE_CHECKING:  # which stands on the physics
    from usarsim_server.scene.truth_feed import TruthFeed


class TruthChannel:
    """Makes subscriptions, and wants rows while there are any; a `Reader`."""

    def __init__(self, feed: TruthFeed) -> None:
        """Want nothing yet."""
        self._feed = feed
        self.grace = Grace()
        self._readers: tuple[_Rows, ...] = ()
        """Replaced, never changed: other threads go through it."""

    def __call__(self, subscriber: Subscriber) -> _Rows:
        """See `Channel`."""
        rows = _Rows(self, subscriber)
        self._readers = (*self._readers, rows)
        if len(self._readers) == 1:
            self._feed.start(self)
        return rows

    def leave(self, rows: _Rows) -> None:
        """Somebody has gone."""
        self._readers = tuple(one for one in self._readers if one is not rows)
        if not self._readers:
            self._feed.stop()

    def take(self, row: bytes) -> None:
        """A row for everybody; any thread."""
        for one in self._readers:
            one.outbox.put_stream(row)

    def crowded(self) -> bool:
        """Whether time waits for somebody; any thread."""
        return any(one.outbox.crowded for one in self._readers)

    def end(self) -> None:
        """Let everybody go; any thread."""
        for one in self._readers:
            one.outbox.condemn("the truth feed has ended")


class _Rows:
    """The rows that wait for one client."""

    def __init__(self, channel: TruthChannel, subscriber: Subscriber) -> None:
        self._channel = channel
        self.outbox = Outbox(subscriber.wake_soon, grace=channel.grace)

    def take(self) -> bytes | None:
        """See `Subscription`.

        Raises:
            ConnectionAbortedError: if a row is missing, or there will be no more.
        """
        if self.outbox.dropped:
            raise ConnectionAbortedError("the client reads the truth too slowly")
        if self.outbox.condemned is not None:
            raise ConnectionAbortedError(self.outbox.condemned)
        return self.outbox.take()

    def close(self) -> None:
        """See `Subscription`."""
        self.outbox.close()
        self._channel.leave(self)
