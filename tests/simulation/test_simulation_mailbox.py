"""Requests to the thread that owns the physics."""

from __future__ import annotations

import logging
import threading
import time

import pytest
from sim_fakes import in_parallel

from usarsim_server.base.errors import UsarsimError
from usarsim_server.simulation.mailbox import Mailbox
from usarsim_server.testing import PATIENCE

FOR_EVER = 100.0 * PATIENCE
"""s; longer than any test may take."""


class Owner:
    """A thread that owns a mailbox and obeys it until told to end."""

    def __init__(self, mail: Mailbox) -> None:
        self.mail = mail
        self.done = threading.Event()
        mail.disown()
        self.thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        self.mail.claim()
        while not self.done.is_set():
            self.mail.obey()
            self.mail.wait(0.05)
        self.mail.end()

    def __enter__(self) -> Owner:
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.done.set()
        self.mail.notify()
        self.thread.join()


def test_questions_are_answered_by_the_owner() -> None:
    """A question asked elsewhere is answered in the owner's thread."""
    with Owner(Mailbox()) as owner:
        assert owner.mail.ask(threading.get_ident) == owner.thread.ident


def test_the_owner_answers_itself_at_once() -> None:
    """The thread that made the mailbox owns it, and its questions wait for nobody."""
    mail = Mailbox()
    assert mail.ask(threading.get_ident) == threading.get_ident()
    assert mail.empty


def test_requests_keep_their_order() -> None:
    """Actions and questions of one thread are carried out in the order they came."""
    seen: list[int] = []
    with Owner(Mailbox()) as owner:
        for number in range(100):
            if number % 10 == 9:
                owner.mail.ask(lambda number=number: seen.append(number))  # type: ignore[misc]
            else:
                owner.mail.post(lambda number=number: seen.append(number))  # type: ignore[misc]
        owner.mail.ask(lambda: None)
    assert seen == list(range(100))


def test_requests_that_come_meanwhile_wait() -> None:
    mail = Mailbox()
    done: list[int] = []

    def again() -> None:
        done.append(len(done))
        if len(done) < 9:
            mail.post(again)

    mail.post(again)
    mail.obey()
    assert done == [0]
    mail.obey()
    assert done == [0, 1]


def test_many_threads_ask_at_once() -> None:
    """No answer is lost or mixed up when many threads ask."""
    answers: dict[int, list[int]] = {}
    with Owner(Mailbox()) as owner:

        def ask(start: int) -> None:
            answers[start] = [owner.mail.ask(lambda n=n: n) for n in range(start, start + 50)]  # type: ignore[misc]

        in_parallel(ask, *range(0, 8000, 1000))
    assert answers == {1000 * k: list(range(1000 * k, 1000 * k + 50)) for k in range(8)}


def test_errors_go_to_who_asked() -> None:
    """A question that raises raises where it was asked, and the owner goes on."""
    with Owner(Mailbox()) as owner:
        with pytest.raises(ZeroDivisionError):
            owner.mail.ask(lambda: 1 // 0)
        assert owner.mail.ask(lambda: 5) == 5


def test_a_failing_action_is_logged_and_left(caplog: pytest.LogCaptureFixture) -> None:
    """An action that raises does not keep the next one from being carried out."""
    mail = Mailbox()
    seen: list[str] = []
    mail.post(lambda: seen.append("before"))
    mail.post(lambda: {}["nothing"])
    mail.post(lambda: seen.append("after"))
    with caplog.at_level(logging.ERROR, "usarsim"):
        mail.obey()
    assert seen == ["before", "after"]
    assert "KeyError" in caplog.text


def test_nothing_is_missed_between_looking_and_waiting() -> None:
    """A wait with a count of events returns at once if one has happened since."""
    mail = Mailbox()
    seen = mail.events
    mail.notify()
    mail.wait(FOR_EVER, seen)


def test_a_request_ends_the_wait() -> None:
    """The owner does not sleep over a request that is there already."""
    mail = Mailbox()
    mail.post(lambda: None)
    mail.wait(FOR_EVER)


class TestEnd:
    """After the end nobody is left waiting."""

    def test_waiting_questions_are_refused(self) -> None:
        """A question that waits when the end comes raises instead of timing out."""
        mail = Mailbox()
        mail.disown()
        caught: list[Exception] = []

        def ask() -> None:
            try:
                mail.ask(lambda: None)
            except UsarsimError as error:
                caught.append(error)

        thread = threading.Thread(target=ask)
        thread.start()
        while mail.empty:
            time.sleep(0.001)
        mail.end()
        thread.join(PATIENCE)
        assert not thread.is_alive()
        assert len(caught) == 1

    def test_later_questions_are_refused(self) -> None:
        """A question after the end raises at once."""
        mail = Mailbox()
        mail.disown()
        mail.end()
        with pytest.raises(UsarsimError, match="ended"):
            mail.ask(lambda: None)

    def test_actions_are_dropped(self) -> None:
        """Actions that wait at the end, or come after it, are not carried out."""
        mail = Mailbox()
        seen: list[int] = []
        mail.post(lambda: seen.append(1))
        mail.end()
        mail.post(lambda: seen.append(2))
        mail.obey()
        assert seen == []
        assert mail.empty
