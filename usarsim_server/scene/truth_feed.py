"""The truth feed: a row for every 0.1 s of simulated time, as long as somebody wants them.

It is a listener of the physics, like a robot's session, but nothing in the world: the physics stops
at every multiple of 0.1 s, gives it the snapshot and what touched what, and goes on; one thread
makes the row. So no row is ever left out, however fast the world goes. Time waits for rows that are
not made yet, and as long as `crowded` says so for those who read them. While nobody wants rows
there is no thread, no snapshot, and nobody looks at contacts.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.logs import Log
from usarsim_server.scene.truth_rows import Being, Moment, TruthRows, victim_of
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.simulation.snapshot import Snapshot

PERIOD = 0.1
"""Simulated s between two rows."""
_SLACK = 1e-6
"""s: a multiple of the period is at the step whose time rounds to it."""

_log = Log("truth")


class Reader(Protocol):
    """Who gets the rows; called by any thread, and returns at once."""

    def take(self, row: bytes) -> None:
        """The next row, a whole frame."""

    def crowded(self) -> bool:
        """Whether time has to wait until more has been read."""

    def end(self) -> None:
        """There will be no more."""


class TruthFeed:
    """Makes rows while somebody wants them."""

    def __init__(
        self, simulation: Simulation, rows: TruthRows, beings: Callable[[], Sequence[Being]]
    ) -> None:
        """Stand still until `start`.

        Args:
            simulation: the world.
            rows: makes them.
            beings: all robots of this moment; called by the physics thread.
        """
        self._simulation, self._rows, self._beings = simulation, rows, beings
        self._watch: _Watch | None = None

    def start(self, reader: Reader) -> None:
        """Begin with the next multiple of 0.1 s, or with this moment if it is one."""
        self.stop()
        self._watch = watch = _Watch(self._simulation, self._rows, self._beings, reader)
        threading.Thread(target=watch.run, name="truth", daemon=True).start()
        self._simulation.be_watched(watch, lambda name: victim_of(name) is not None)

    def stop(self) -> None:
        """Make no more; a second call does nothing."""
        if self._watch is not None:
            self._simulation.be_watched(None)
            self._watch.close()
            self._watch = None


class _Watch:
    """From `start` to `stop`; a `Witness`."""

    horizon = math.inf

    def __init__(
        self,
        simulation: Simulation,
        rows: TruthRows,
        beings: Callable[[], Sequence[Being]],
        reader: Reader,
    ) -> None:
        self._simulation, self._rows, self._beings = simulation, rows, beings
        self._reader = reader
        self._moments: deque[Moment] = deque()  # the first one is being told
        self._signal = threading.Condition()
        self._ended = False
        self._number = 0

    # -- called by the physics thread --------------------------------------------------------

    def begin(self, time: float) -> None:
        """See `Witness`."""
        self._number = math.ceil((time - _SLACK) / PERIOD)

    @property
    def due(self) -> float:
        """Simulated time of the next row; infinity if there will be none."""
        return math.inf if self._ended else self._number * PERIOD

    @property
    def oldest(self) -> float:
        """Simulated time of the oldest row that is not made; long ago if it cannot be read."""
        if self._reader.crowded():
            return -math.inf
        try:
            return self._moments[0].snapshot.time
        except IndexError:
            return math.inf

    def wake(self, snapshot: Snapshot) -> None:
        """Take what the next row is made of."""
        moment = Moment(snapshot, self._simulation.touches(), self._beings())
        with self._signal:
            if not self._ended:
                self._number = math.floor((snapshot.time + _SLACK) / PERIOD) + 1
                self._moments.append(moment)
                self._signal.notify()

    def settled(self) -> bool:
        """Whether the world may go on."""
        return not self._reader.crowded()

    def idle(self) -> bool:
        """Whether all rows have been made."""
        return not self._moments

    def overdue(self) -> None:
        """Nobody waits for it at a horizon."""

    def lost(self, reason: str) -> None:
        """It has no robot."""

    # -- the thread --------------------------------------------------------------------------

    def run(self) -> None:
        """Make rows until `close`."""
        try:
            while (moment := self._next()) is not None:
                self._reader.take(self._rows.row(moment))
                with self._signal:
                    if self._moments:
                        self._moments.popleft()
                self._simulation.attention()
        except UsarsimError as error:
            _log.debug("the truth feed ends", reason=error)  # the physics has ended
        except Exception as error:
            _log.exception("the truth feed died", error)
        if not self._ended:
            self.close()
            self._reader.end()

    def _next(self) -> Moment | None:
        with self._signal:
            while not (self._moments or self._ended):
                self._signal.wait()
            return None if self._ended else self._moments[0]

    def close(self) -> None:
        """No more rows are wanted; any thread."""
        with self._signal:
            self._ended = True
            self._moments.clear()
            self._signal.notify()
