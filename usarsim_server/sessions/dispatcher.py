"""The thread that serves all connections of the control port.

It executes their commands and writes their reports. All reports that are due at one instant are
answered with one batch of rays, which costs a fraction of as many small ones, and nobody waits for
a processor that many threads fight over.

What may take long is done by a thread that is made for it and ends with it: putting a robot into
the world, which may have to grow first; the orders of a world controller; and whatever a client
sends that floods the server, until it has been worked off.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from usarsim_server.logs import Log
from usarsim_server.simulation.rays.cast import RayQuery
from usarsim_server.simulation.rays.query import RayHits
from usarsim_server.simulation.snapshot import Snapshot

AT_ONCE = 16
"""Reports that are worked out together; so what is ready first does not wait for very many."""

CastAll = Callable[[Sequence[RayQuery], Snapshot], list[list[RayHits]]]
"""Answers the queries of many viewers at one instant, see `Simulation.cast_all`."""

_log = Log("robots")


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """A report that waits for its rays.

    Attributes:
        snapshot: the instant it is about.
        query: the rays.
        finish: writes the report, given the answers to the fans of the query, in order; what it
            returns hands it over. So those who send all reports are woken once, when all are
            written.
    """

    snapshot: Snapshot
    query: RayQuery
    finish: Callable[[Sequence[RayHits]], Callable[[], None]]


class Served(Protocol):
    """A connection as the dispatcher sees it. Only one thread at a time serves it."""

    @property
    def slow(self) -> bool:
        """Whether what it has to do next may take long."""

    def begin(self, apart: bool) -> Task | None:
        """Execute commands that wait, and say what the report that is due needs, if one is.

        Must not raise.

        Args:
            apart: it has a thread of its own. Otherwise whatever is slow is left for then.
        """

    def fail(self, error: Exception) -> None:
        """It cannot go on; must not raise."""

    def pause(self) -> bool:
        """Called when nothing is left to do: False if something has come in meanwhile.

        After True nobody serves it until it calls again.
        """


class Dispatcher:
    """Serves everybody who calls."""

    def __init__(self, cast_all: CastAll, rested: Callable[[], None]) -> None:
        """Make a dispatcher; its thread starts with the first call.

        Args:
            cast_all: see there.
            rested: called whenever somebody has nothing left to do but to write, and again when
                that is done (a world without pace waits for that).
        """
        self._cast_all = cast_all
        self._rested = rested
        self._signal = threading.Condition()
        self._calls: deque[Served] = deque()
        self._held = 0
        self._thread: threading.Thread | None = None
        self._extra: set[threading.Thread] = set()
        self._stopping = False

    def call(self, caller: Served) -> None:
        """Have a caller served soon; it must not call again before `pause` was True. Any thread."""
        with self._signal:
            self._calls.append(caller)
            if self._thread is None and not self._stopping:
                self._thread = threading.Thread(target=self._run, name="robots", daemon=True)
                self._thread.start()
            self._signal.notify()

    @contextmanager
    def together(self) -> Iterator[None]:
        """Whoever calls inside is served when it ends: as one batch, in the order of the calls.

        No lock is held inside: callers have locks of their own, which they hold when they call.
        """
        with self._signal:
            self._held += 1
        try:
            yield
        finally:
            with self._signal:
                self._held -= 1
                self._signal.notify()

    def stop(self, timeout: float) -> None:
        """End all threads and wait for them, at most so many s in all; who calls is not served."""
        deadline = time.monotonic() + timeout
        with self._signal:
            self._stopping = True
            self._signal.notify_all()
            threads = [*self._extra, *([self._thread] if self._thread else [])]
        for thread in threads:
            if thread is not threading.current_thread():
                thread.join(max(0.0, deadline - time.monotonic()))

    # -- the thread --------------------------------------------------------------------------

    def _run(self) -> None:
        while callers := self._take():
            self._serve(callers)

    def _take(self) -> list[Served]:
        """Who has called, in that order; nobody at the end."""
        with self._signal:
            while (self._held or not self._calls) and not self._stopping:
                self._signal.wait()
            if self._stopping:
                return []
            callers = [*self._calls]
            self._calls.clear()
            return callers

    def _serve(self, callers: Sequence[Served]) -> None:
        prompt: list[Served] = []
        tasks: list[tuple[Served, Task]] = []
        for caller in callers:
            if caller.slow:
                self._start_extra(caller)
                continue
            task = caller.begin(apart=False)
            prompt.append(caller)
            if task is not None:
                tasks.append((caller, task))
        if tasks:
            self._rested()  # the world may go on: what is left is only written down
        for start in range(0, len(tasks), AT_ONCE):
            self._work_off(tasks[start : start + AT_ONCE])
        for caller in prompt:
            self._let_go(caller)
        self._rested()

    def _work_off(self, tasks: Sequence[tuple[Served, Task]]) -> None:
        """Cast the rays of some tasks, those of one instant together, and finish them."""
        instants: dict[int, list[tuple[Served, Task]]] = {}
        for one in tasks:
            instants.setdefault(id(one[1].snapshot), []).append(one)
        for group in instants.values():
            try:
                answers = self._cast(group)
            except Exception as error:
                if len(group) == 1:
                    group[0][0].fail(error)
                else:  # find out whose rays they are
                    for one in group:
                        self._work_off([one])
                continue
            written: list[tuple[Served, Callable[[], None]]] = []
            for (caller, task), hits in zip(group, answers, strict=True):
                try:
                    written.append((caller, task.finish(hits)))
                except Exception as error:
                    caller.fail(error)
            for caller, hand_over in written:
                try:
                    hand_over()
                except Exception as error:
                    caller.fail(error)

    def _cast(self, group: Sequence[tuple[Served, Task]]) -> Sequence[Sequence[RayHits]]:
        queries = [task.query for _, task in group]
        if not any(query.fans for query in queries):
            return [()] * len(queries)
        return self._cast_all(queries, group[0][1].snapshot)

    def _let_go(self, caller: Served) -> None:
        if not caller.pause():
            self.call(caller)

    # -- threads for what takes long ---------------------------------------------------------

    def _start_extra(self, caller: Served) -> None:
        thread = threading.Thread(
            target=self._serve_alone, args=(caller,), name="robot-alone", daemon=True
        )
        with self._signal:
            if self._stopping:
                return
            self._extra.add(thread)
        try:
            thread.start()
        except RuntimeError as error:  # no more threads to be had
            with self._signal:
                self._extra.discard(thread)
            _log.warning("no thread for what takes long", reason=str(error))
            self._serve_to_the_end(caller)

    def _serve_alone(self, caller: Served) -> None:
        try:
            self._serve_to_the_end(caller)
        finally:
            with self._signal:
                self._extra.discard(threading.current_thread())
            self._rested()

    def _serve_to_the_end(self, caller: Served) -> None:
        while not self._stopping:
            task = caller.begin(apart=True)
            if task is not None:
                self._rested()
                self._work_off([(caller, task)])
            if caller.pause():
                return
