"""What waits to be sent to one client: bounded, lines always whole and in order.

Two planes share one first-in-first-out order (protocol reference 4.14):

* replies are never dropped. A client that asks without ever reading is condemned instead: its
  connection is to be closed, with a log line;
* streamed (periodic) lines have a byte budget. When it is full the oldest streamed lines give
  way, whole; a client that resumes finds recent data and never half a line.

Sessions write, from any thread; the event loop takes. The outbox knows no socket and no event loop:
a `wake` callback tells the taker that there is something to do.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from usarsim_server.base.token_bucket import TokenBucket

LINE_BYTES = 144
"""Memory of a line that waits in an outbox beside its characters."""
LEAST_READ = 64 * 1024
"""Bytes per s of wall time that a client has to read to be waited for."""
GRACE = 1.0
"""s of wall time for which clients that have read nothing are waited for, all of them together."""
GRACE_SHARE = 0.02
"""Part of wall time by which a used `Grace` grows again."""
EARNED = 5.0
"""s of wall time for which a client is waited for at most by what it has read before."""
ASKING = 0.25
"""s of wall time between two questions, up to which the world is taken to have waited meanwhile."""
TOGETHER = 16 * 1024
"""Bytes beyond which no further line joins those that leave together."""


@dataclass(frozen=True, slots=True)
class OutboxLimits:
    """How much may wait for one client."""

    stream_bytes: int = 256 * 1024
    """Budget of streamed lines; with scan lines just under 2048 bytes at 5 Hz (protocol reference,
    addendum) about 25 s of one laser."""
    stream_lines: int = 4096
    """The same in lines, because a short line costs far more than its bytes."""
    reply_bytes: int = 1024 * 1024
    """Replies that wait beyond this condemn the connection; thousands of CONF and GEO lines, which
    no client asks for before it reads the first. A single reply may be longer."""
    reply_lines: int = 4096  # the same in lines

    @property
    def held_bytes(self) -> int:
        """Most memory that the lines of one client take while they wait, beside one long reply."""
        lines = self.stream_lines + self.reply_lines
        return self.stream_bytes + self.reply_bytes + lines * LINE_BYTES


class Grace:
    """Wall time for which the world waits for clients, charged while it waits.

    The one that all clients of a port share holds `GRACE` and grows by `GRACE_SHARE` of the time. A
    client that comes again without ever reading finds what the last one left, and all of them slow
    the world down by that share. The one of a client holds what the client has earned by reading.
    """

    def __init__(self, bucket: TokenBucket | None = None) -> None:
        """Begin; `bucket` holds s of wall time, None stands for that which all clients share."""
        self._bucket = TokenBucket(GRACE_SHARE, GRACE) if bucket is None else bucket
        self._lock = threading.Lock()
        self._asked = 0.0
        self._waits = False

    def wait(self, now: float) -> bool:
        """Charge the time since the last call if the world waited, and tell whether it may go on
        waiting. Thread-safe.

        Args:
            now: wall time, s.
        """
        with self._lock:
            since, self._asked = now - self._asked, now
            if self._waits and since < ASKING:
                self._bucket.spend(since)
            self._waits = self._bucket.tokens > 0.0
            return self._waits

    def earn(self, seconds: float) -> None:
        """Add so much wall time. Thread-safe."""
        with self._lock:
            self._bucket.give(seconds)


class Outbox:
    """The lines of one connection that are not yet handed to the socket.

    Attributes:
        together: lines that wait may leave together. Each leaves by itself otherwise, as some old
            clients want it.
    """

    def __init__(
        self,
        wake: Callable[[], None] | None = None,
        limits: OutboxLimits | None = None,
        clock: Callable[[], float] = time.monotonic,
        grace: Grace | None = None,
    ) -> None:
        """Make an empty outbox.

        Args:
            wake: called, from whatever thread puts, when `take` has something to return after
                having returned None, and once when the outbox is condemned. Must not block.
            limits: see `OutboxLimits`.
            clock: wall time, s; only `crowded` asks it.
            grace: shared with the other clients of the port; None: one of its own.
        """
        self._grace = grace or Grace()
        self._wake = wake or _nobody
        self._clock = clock
        self._limits = limits or OutboxLimits()
        self._lock = threading.Lock()
        self.together = False
        # The number before each line restores the common order of the two planes.
        self._next = 0
        self._replies: deque[tuple[int, bytes]] = deque()
        self._stream: deque[tuple[int, bytes]] = deque()
        self._reply_bytes = 0
        self._stream_bytes = 0
        self._half = self._limits.stream_bytes / 2, self._limits.stream_lines / 2
        self._filled = False  # whether its streams have ever filled half of their budget
        self._own = Grace(TokenBucket(0.0, EARNED, start=0.0, deepest=0.0))
        self._replied = self._replied_bytes = 0
        self._dropped = 0
        self._called = False
        self._closed = False
        self._condemned: str | None = None
        self._unheard = False
        """It is condemned, and the taker has not been woken for that."""

    def put_reply(self, line: bytes) -> None:
        """Queue a whole line that must arrive, CR LF included. Thread-safe, never blocks.

        Ignored once the outbox is closed; an empty text is nothing to send.
        """
        if not line:
            return
        with self._lock:
            if self._closed:
                return
            self._append_reply(line)
        self.rouse()

    def put_stream(self, line: bytes) -> None:
        """Queue a whole periodic line, CR LF included, at the cost of the oldest ones.

        Thread-safe, never blocks. Ignored once the outbox is closed.
        """
        self.put_report((line,))
        self.rouse()

    def put_report(self, lines: Iterable[bytes], reply: bytes = b"") -> None:
        """Queue periodic lines, and a reply after them if there is one, as `put_stream` and
        `put_reply` do one after the other; but the taker sleeps on, until `rouse` or another line.
        """
        with self._lock:
            if not self._closed:
                told = [line for line in lines if line]
                first = self._next + 1
                self._next += len(told)
                self._stream.extend(zip(range(first, self._next + 1), told, strict=True))
                self._stream_bytes += sum(map(len, told))
                self._trim_stream()
                if reply:
                    self._append_reply(reply)

    def rouse(self) -> None:
        """Wake the taker if there is something that it does not know of. Thread-safe."""
        with self._lock:
            call = self._call()
        if call:
            self._wake()

    def take(self) -> bytes | None:
        """The oldest line, or all that may leave `together`; None if there is nothing, and the next
        put will then wake the taker."""
        with self._lock:
            found = self._oldest()
            if found is None:
                self._called = False
            elif self.together:
                lines, size = [found], len(found)
                while size < TOGETHER and (line := self._oldest()) is not None:
                    lines.append(line)
                    size += len(line)
                return b"".join(lines)
            return found

    @property
    def crowded(self) -> bool:
        """Whether the streams fill half of their budget, and the client is waited for.

        A world that runs as fast as it can waits meanwhile, so that lines are lost only by a
        client that reads less than `LEAST_READ`. What a client reads once its streams have filled
        up earns it time, up to `EARNED`. Without that it is waited for out of the `Grace` of all.
        """
        most, lines = self._half
        if self._stream_bytes < most and len(self._stream) < lines:
            return False  # nearly always; and it is asked at every turn of the world
        self._filled = True
        now = self._clock()
        return self._own.wait(now) or self._grace.wait(now)

    def condemn(self, reason: str) -> None:
        """Ask for the connection to be closed at once; what waits is discarded. Thread-safe.

        Args:
            reason: for the log; the first reason stays.
        """
        with self._lock:
            if self._closed:
                return
            self._shut(reason)
        self.rouse()

    def close(self) -> None:
        """Forget what waits and ignore what comes. Thread-safe, may be called again."""
        with self._lock:
            self._forget()

    @property
    def condemned(self) -> str | None:
        """Why the connection has to be closed, or None."""
        return self._condemned

    @property
    def closed(self) -> bool:
        """True once nothing more can be sent, by `close` or by condemnation."""
        return self._closed

    @property
    def dropped(self) -> int:
        """Number of streamed lines dropped so far."""
        return self._dropped

    @property
    def replied(self) -> tuple[int, int]:
        """Number of all replies put so far, and their bytes."""
        return self._replied, self._replied_bytes

    @property
    def waiting_bytes(self) -> int:
        """Bytes of both planes that wait."""
        with self._lock:
            return self._reply_bytes + self._stream_bytes

    def __len__(self) -> int:
        """Number of lines that wait."""
        with self._lock:
            return len(self._replies) + len(self._stream)

    # The methods below are called with the lock held.

    def _oldest(self) -> bytes | None:
        if self._replies and (not self._stream or self._replies[0][0] < self._stream[0][0]):
            line = self._replies.popleft()[1]
            self._reply_bytes -= len(line)
            return line
        if self._stream:
            line = self._stream.popleft()[1]
            self._stream_bytes -= len(line)
            if self._filled:
                self._own.earn(len(line) / LEAST_READ)
            return line
        return None

    def _append_reply(self, line: bytes) -> None:
        self._replies.append((self._number(), line))
        self._reply_bytes += len(line)
        self._replied += 1
        self._replied_bytes += len(line)
        if self._replies_overflow():
            self._shut(f"{len(self._replies)} replies wait and the client does not read")

    def _number(self) -> int:
        self._next += 1
        return self._next

    def _call(self) -> bool:
        """Whether the taker has to be woken: only for the first line of a burst, and the end."""
        if self._unheard:
            self._unheard = False
            return True
        if self._called or not (self._replies or self._stream):
            return False
        self._called = True
        return True

    def _replies_overflow(self) -> bool:
        limits, count = self._limits, len(self._replies)
        too_long = count > 1 and self._reply_bytes > limits.reply_bytes
        return too_long or count > limits.reply_lines

    def _trim_stream(self) -> None:
        limits = self._limits
        while self._stream_bytes > limits.stream_bytes or len(self._stream) > limits.stream_lines:
            self._stream_bytes -= len(self._stream.popleft()[1])
            self._dropped += 1

    def _shut(self, reason: str) -> None:
        self._condemned, self._unheard = reason, True
        self._forget()

    def _forget(self) -> None:
        self._closed = True
        self._replies.clear()
        self._stream.clear()
        self._reply_bytes = 0
        self._stream_bytes = 0


def _nobody() -> None:
    """The wake callback of an outbox that is only polled."""
