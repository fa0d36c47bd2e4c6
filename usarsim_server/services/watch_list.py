"""What image clients look at and have seen, and how word of a new frame reaches the event loop."""

from __future__ import annotations

import asyncio
import contextlib

from usarsim_server.cameras.view import Frame, FrameSource, Region, Watch


class FrameSignal:
    """Brings new frames from the rendering thread to tasks of the event loop."""

    def __init__(self) -> None:
        """Make a bell for the event loop that is running."""
        self._loop = asyncio.get_running_loop()
        self._frame: Frame | None = None
        self._next: asyncio.Future[Frame] | None = None

    def ring(self, frame: Frame) -> None:
        """A frame is there. Any thread; returns at once."""
        waiting, self._frame = self._frame, frame
        if waiting is None:  # else the loop knows already and will take this one
            with contextlib.suppress(RuntimeError):  # the loop has ended before the renderer
                self._loop.call_soon_threadsafe(self._tell)

    def next(self) -> asyncio.Future[Frame]:
        """The frame that comes next. Shared: wait for it, but do not cancel it."""
        if self._next is None:
            self._next = self._loop.create_future()
        return self._next

    def _tell(self) -> None:
        frame, self._frame = self._frame, None
        waiting, self._next = self._next, None
        if frame is not None and waiting is not None and not waiting.done():
            waiting.set_result(frame)


class WatchList:
    """What one client has asked for lately; the renderer works for that and nothing else."""

    def __init__(self, source: FrameSource, signal: FrameSignal, linger: float, most: int) -> None:
        """Look at nothing as yet.

        Args:
            source: renders what is looked at.
            signal: rung for each new frame.
            linger: s of wall time for which a region is watched after it was asked for.
            most: regions that are watched at a time; the one asked for longest ago gives way.
        """
        self._source = source
        self._signal = signal
        self._linger = linger
        self._most = most
        self._loop = asyncio.get_running_loop()
        # In the order in which they were asked for, with the loop's time.
        self._watches: dict[Region, tuple[Watch, float]] = {}
        self._timer: asyncio.TimerHandle | None = None

    def turn_to(self, region: Region) -> None:
        """A region was asked for: have it rendered for a while."""
        found = self._watches.pop(region, None)
        if found is None and len(self._watches) >= self._most:
            self._drop(next(iter(self._watches)))
        watch = found[0] if found else self._source.watch(region, self._signal.ring)
        self._watches[region] = watch, self._loop.time()
        if self._timer is None:
            self._timer = self._loop.call_later(self._linger, self._sweep)

    def close(self) -> None:
        """Look away from everything."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        for region in tuple(self._watches):
            self._drop(region)

    def _sweep(self) -> None:
        """Look away from what was not asked for again."""
        self._timer = None
        # The loop may call a timer early by the resolution of its clock.
        limit = self._loop.time() - self._linger + 0.001
        for region, (_, asked) in tuple(self._watches.items()):
            if asked > limit:
                self._timer = self._loop.call_at(asked + self._linger, self._sweep)
                return
            self._drop(region)

    def _drop(self, region: Region) -> None:
        watch, _ = self._watches.pop(region)
        watch.close()


class Repeats:
    """What one client has got of late, so that it gets no copies without pause."""

    def __init__(self, pause: float, most: int) -> None:
        """Know of nothing as yet.

        Args:
            pause: s between two copies.
            most: regions to remember.
        """
        self._pause = pause
        self._most = most
        # By region: number of the frame and when it was sent, the region sent last at the end.
        self._got: dict[Region, tuple[int, float]] = {}

    def has(self, frame: Frame, region: Region) -> bool:
        """Whether the client has this very picture already."""
        number, _ = self._got.get(region, (-1, 0.0))
        return number == frame.number

    def pause(self, frame: Frame, region: Region, now: float) -> float:
        """Seconds to wait at a time (s) until a copy is due; 0 for what is new to the client."""
        number, sent = self._got.get(region, (-1, now))
        return max(0.0, sent + self._pause - now) if number == frame.number else 0.0

    def note(self, frame: Frame, region: Region, now: float) -> None:
        """The client is being sent a region of a frame at a time (s)."""
        self._got.pop(region, None)
        if len(self._got) >= self._most:
            del self._got[next(iter(self._got))]
        self._got[region] = frame.number, now
