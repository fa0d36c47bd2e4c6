"""Requests to the thread that owns the physics, from all others; giving way in long work.

Whoever computes without pause, in Python or in native code that keeps the interpreter, makes every
other thread wait for half a millisecond or more, each time it needs the interpreter; the physics
needs it several times a step.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.logs import Log

T = TypeVar("T")

REQUEST_TIMEOUT = 30.0
"""s of wall time after which a question counts as lost."""

_log = Log("simulation")


class Mailbox:
    """Actions and questions that the owner carries out, in the order they came.

    The thread that makes it is the owner until another one claims it.
    """

    def __init__(self) -> None:
        self._requests: deque[tuple[Callable[[], None], Future[Any] | None]] = deque()
        self._signal = threading.Condition()
        self._owner: int | None = threading.get_ident()
        self._events = 0
        self._ended = False

    # -- the owner's side --------------------------------------------------------------------

    def claim(self) -> None:
        """The calling thread carries out requests from now on."""
        self._owner = threading.get_ident()

    def disown(self) -> None:
        """Until somebody claims it, requests wait."""
        self._owner = None

    @property
    def empty(self) -> bool:
        """Whether nothing waits to be carried out."""
        return not self._requests

    def obey(self) -> None:
        """Carry out everything that has come; an action that fails is logged and left.

        What comes meanwhile waits, so that those who ask again and again do not stop the world.
        """
        count = len(self._requests)
        while count and self._requests:
            count -= 1
            action, _ = self._requests.popleft()
            try:
                action()
            except Exception as error:
                # One robot's bad request must not stop the world.
                _log.exception("a request to the physics failed", error)

    @property
    def events(self) -> int:
        """Counts what happened; a value read before looking around makes `wait` miss nothing."""
        return self._events

    def wait(self, seconds: float, seen: int | None = None) -> None:
        """Sleep until a request comes or something happens, for so many wall seconds at most.

        Returns at once if more has happened than the `events` seen.
        """
        with self._signal:
            if not self._requests and seen in (None, self._events):
                self._signal.wait(seconds)

    def end(self) -> None:
        """Refuse all questions from now on, also those that wait; actions are dropped."""
        with self._signal:
            self._ended = True
            waiting = [answer for _, answer in self._requests if answer is not None]
            self._requests.clear()
            self._signal.notify_all()
        for answer in waiting:
            answer.set_exception(_ended())

    # -- everybody's side --------------------------------------------------------------------

    def notify(self) -> None:
        """Something happened that the owner may be waiting for."""
        with self._signal:
            self._events += 1
            self._signal.notify_all()

    def post(self, action: Callable[[], None]) -> None:
        """Have an action carried out soon; after the end it is dropped."""
        with self._signal:
            if not self._ended:
                self._requests.append((action, None))
                self._signal.notify_all()

    def ask(self, question: Callable[[], T]) -> T:
        """Have a question answered, and wait for the answer.

        Raises:
            UsarsimError: if nobody answers any more.
            Exception: whatever the question raises.
        """
        if threading.get_ident() == self._owner:
            return question()
        answer: Future[T] = Future()

        def reply() -> None:
            try:
                answer.set_result(question())
            except Exception as error:
                answer.set_exception(error)

        with self._signal:
            if self._ended:
                raise _ended()
            self._requests.append((reply, answer))
            self._signal.notify_all()
        return answer.result(timeout=REQUEST_TIMEOUT)


def _ended() -> UsarsimError:
    return UsarsimError("the simulation has ended")


PAUSE = 0.0005
"""s of wall time, in which others get on."""


def yield_interpreter() -> None:
    """Stand back for a moment; to be called about once a millisecond."""
    time.sleep(PAUSE)
