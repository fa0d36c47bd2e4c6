"""The thread that serves all connections of the control port.

It executes their commands and writes their reports. All reports that are due at one instant are
answered with one batch of rays, which costs a fraction of as many small ones, and nobody waits for
a processor that many threads fight over.

What may take long is done by a thread that is made for it and ends with it: putting a robot into
the world, which may have to grow first; the orders of a world controller; and whatever a client
sends that floods the server, until it has been worked off.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from usarsim_server.base.logs import Log
from usarsim_server.protocol.messages import encode_all
from usarsim_server.sessions.session import Session
from usarsim_server.simulation.rays.query import PendingReport, RayHits

AT_ONCE = 16
"""Reports that are worked out together; so what is ready first does not wait for very many."""

LOOK_AGAIN = 0.1
"""Most s of wall time between two looks at when reports leave: the pace may have changed."""

CastAll = Callable[[Sequence[PendingReport]], list[list[RayHits]]]
"""Answers the rays of many reports about one instant, see `Simulation.cast_all`."""

Waiting = tuple[Session, PendingReport]

_log = Log("robots")


class Dispatcher:
    """Serves everybody who calls."""

    def __init__(
        self,
        cast_all: CastAll,
        on_idle: Callable[[], None] | None,
        moment: Callable[[float], float] = lambda _: -math.inf,
    ) -> None:
        """Make a dispatcher; its thread starts with the first call.

        Args:
            cast_all: see there.
            on_idle: called whenever a session has nothing left to do but to write, and again when
                that is done (a world without pace waits for that); None: no call.
            moment: wall time (`time.perf_counter`) at which the reports of a simulated time leave;
                those that are ready earlier wait for it. The world is ahead of the clock at a
                pace, so streams are as even as the clock unless reports take longer than that.
        """
        self._cast_all = cast_all
        self._on_idle = on_idle or (lambda: None)
        self._moment = moment
        self._written: deque[tuple[float, list[Session]]] = deque()
        """Who has reports that have not left, and of which simulated time."""
        self._signal = threading.Condition()
        self._calls: deque[Session] = deque()
        self._held = 0
        self._thread: threading.Thread | None = None
        self._extra: set[threading.Thread] = set()
        self._stopping = False

    def call(self, caller: Session) -> None:
        """Have a caller served soon; it must not call again before `pause` was True. Any thread."""
        with self._signal:
            self._calls.append(caller)
            if self._thread is None and not self._stopping:
                self._thread = threading.Thread(target=self._run, name="robots", daemon=True)
                self._thread.start()
            if not self._held:  # else it would only look and wait on
                self._signal.notify()

    @contextmanager
    def batched(self) -> Iterator[None]:
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
        while not self._stopping:
            callers = self._take()
            self._release()
            if callers:
                self._serve(callers)

    def _take(self) -> list[Session]:
        """Who has called, in that order; nobody at the end, and when reports have to leave."""
        with self._signal:
            while (self._held or not self._calls) and not self._stopping:
                if not self._written:
                    self._signal.wait()
                    continue
                left = self._moment(self._written[0][0]) - time.perf_counter()
                if left <= 0.0:
                    return []
                self._signal.wait(min(left, LOOK_AGAIN))
            callers = [] if self._stopping else [*self._calls]
            self._calls.clear()
            return callers

    def _release(self) -> None:
        """Let the reports leave whose moment has come. The thread that serves everybody."""
        while self._written and self._moment(self._written[0][0]) <= time.perf_counter():
            for caller in self._written.popleft()[1]:
                caller.outbox.rouse()

    def _serve(self, callers: Sequence[Session]) -> None:
        prompt: list[Session] = []
        waiting: list[Waiting] = []
        for caller in callers:
            if caller.slow:
                self._start_extra(caller)
                continue
            report = _begin(caller, own_thread=False)
            prompt.append(caller)
            if report is not None:
                waiting.append((caller, report))
        if waiting:
            self._on_idle()  # the world may go on: what is left is only written down
        for start in range(0, len(waiting), AT_ONCE):
            self._work_off(waiting[start : start + AT_ONCE])
        for caller in prompt:
            self._let_go(caller)
        self._on_idle()

    def _work_off(self, waiting: Sequence[Waiting]) -> None:
        """Cast the rays of some reports, those of one instant together, and finish them.

        All are written before the first leaves, so that those who send them are woken once.
        """
        instants: dict[int, list[Waiting]] = {}
        for one in waiting:
            instants.setdefault(id(one[1].snapshot), []).append(one)
        for group in instants.values():
            try:
                answers = self._cast([report for _, report in group])
            except Exception as error:
                if len(group) == 1:
                    group[0][0].fail(error)
                else:  # find out whose rays they are
                    for one in group:
                        self._work_off([one])
                continue
            written: list[tuple[Session, list[bytes]]] = []
            for (caller, report), hits in zip(group, answers, strict=True):
                try:
                    written.append((caller, encode_all(report.finish(hits))))
                except Exception as error:
                    caller.fail(error)
            for caller, lines in written:
                try:
                    caller.tell(lines)
                except Exception as error:
                    caller.fail(error)
            told = [caller for caller, _ in written]
            if threading.current_thread() is self._thread:
                self._written.append((group[0][1].snapshot.time, told))
                self._release()
            else:  # who has a thread of his own is late anyway
                for caller in told:
                    caller.outbox.rouse()

    def _cast(self, reports: Sequence[PendingReport]) -> Sequence[Sequence[RayHits]]:
        if not any(report.fans for report in reports):
            return [()] * len(reports)
        return self._cast_all(reports)

    def _let_go(self, caller: Session) -> None:
        if not caller.pause():
            self.call(caller)

    # -- threads for what takes long ---------------------------------------------------------

    def _start_extra(self, caller: Session) -> None:
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

    def _serve_alone(self, caller: Session) -> None:
        try:
            self._serve_to_the_end(caller)
        finally:
            with self._signal:
                self._extra.discard(threading.current_thread())
            self._on_idle()

    def _serve_to_the_end(self, caller: Session) -> None:
        while not self._stopping:
            report = _begin(caller, own_thread=True)
            if report is not None:
                self._on_idle()
                self._work_off([(caller, report)])
            if caller.pause():
                return


def _begin(caller: Session, own_thread: bool) -> PendingReport | None:
    """Have a caller execute what waits; the report that is due then, if one is."""
    try:
        caller.execute(own_thread)
        return caller.next_report()
    except Exception as error:
        caller.fail(error)
        return None
