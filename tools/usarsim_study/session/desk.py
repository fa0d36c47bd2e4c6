"""The desk: leads one participant after the other through a study, and tells their pages so.

What stands before a seat follows from what is on disk (`notebook.py`, `steps.py`); here texts of
pages become lines on disk, and steps become texts of the protocol (docs/studies.md). No page is
trusted, none is waited for, and each may be gone and come back at any time.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Any

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.files import reason
from usarsim_study.errors import StudyError
from usarsim_study.forms import FormState
from usarsim_study.misread import misread
from usarsim_study.session import screens
from usarsim_study.session.notebook import Notebook
from usarsim_study.session.screens import Message
from usarsim_study.session.steps import Past, Step, Task
from usarsim_study.session.talk import Ask, Page, Panels, RefusedError, read_object

EXPERIMENTER = 0
"""Seat of whoever leads the session; operators have 1 and 2."""
OVERVIEW_EVERY = 0.5
"""s of wall time between two overviews, at least."""
RETRY = 2.0
"""s of wall time until what could not be stored is tried again."""
_EVENTS = 100  # newest lines of the log in an overview


Run = Callable[["Desk", Step], Awaitable[None]]
"""Runs the training or trial of a step, from the folder to its status."""


class Desk:
    """One session.

    Attributes:
        book: what is on disk. events: newest lines for the experimenter.
        panels: what runs now; None: nothing does. probe: what is asked now; None: nothing is.
        trouble: why nothing can be stored; empty: all is well.
        another: the session is over and the experimenter wants the next one.
    """

    def __init__(
        self,
        book: Notebook,
        consent: str,
        run: Run,
        lasts: Callable[[Task], float | None] = lambda task: None,
    ) -> None:
        """consent: the text to agree to; empty: none. run: does trainings and trials.

        lasts: s that a training or trial lasts at most; None: not known.
        """
        self.book, self.events = book, deque[str](maxlen=_EVENTS)
        self.panels: Panels | None = None
        self.probe: Ask | None = None
        self.trouble = ""
        self.another = asyncio.Event()
        self._consent, self._run, self._lasts = consent, run, lasts
        self._ready: frozenset[tuple[int, int]] = frozenset()
        self._past = book.past()
        self._turned: dict[tuple[int, int], int] = {}
        self._pages: dict[int, list[Page]] = {seat: [] for seat in range(book.session.seats + 1)}
        self._shown: dict[int, Message] = {}
        self._stirred = asyncio.Event()
        self._injecting: set[asyncio.Task[None]] = set()
        self._overviewed = float("-inf")
        self._overviewing: asyncio.TimerHandle | None = None

    @property
    def seats(self) -> range:
        """Of operators."""
        return range(1, self.book.session.seats + 1)

    @property
    def past(self) -> Past:
        """What has happened so far."""
        return self._past

    def lasts(self, task: Task) -> float | None:
        """s that a training or trial lasts at most; None: it is none, or not known."""
        return self._lasts(task) if task.joint else None

    def step(self, seat: int) -> Step:
        """What stands before a seat."""
        return self.book.session.step(self._past, seat, self._ready)

    async def lead(self) -> None:
        """Lead the participant through the session, from wherever it is to its end.

        Raises:
            StudyError: a file of the participant is damaged.
        """
        self._keep(lambda: self.book.mend())
        self.show()
        while True:
            self._stirred.clear()
            if self._past.status != "running":
                return
            step = self.step(1)
            if step.kind == "end":
                if self._keep(lambda: self.book.end("complete")):
                    continue
                await asyncio.sleep(RETRY)
            elif step.kind == "panel":
                await self._run(self, step)
                self._ready = frozenset()
                self.refresh()
                self._exclude()
            else:
                await self._stirred.wait()

    def _exclude(self) -> None:
        if self._past.status == "running" and self.book.session.training_failed(self._past):
            training = self.book.session.study.training
            assert training is not None
            text = f"did not pass the training in {training.attempts} attempts"
            self._keep(lambda: self.book.end("excluded", text))

    def _keep(self, write: Callable[[], object]) -> bool:
        """Write something and read all again; tells why it cannot be, and whether it was."""
        try:
            write()
        except OSError as error:
            self.trouble = f"nothing can be stored: {reason(error)} (make room on the disk)"
            self.log(self.trouble)
            self.show()
            return False
        self.trouble = ""
        self.refresh()
        return True

    def refresh(self) -> None:
        """Read again what is on disk, and show what follows from it."""
        self._past = self.book.past()
        self.show()
        self._stirred.set()

    def log(self, text: str) -> None:
        """A line for the experimenter."""
        self.events.append(text)
        self.overview()

    # -- what pages are told ------------------------------------------------------------------

    def enter(self, seat: int, page: Page) -> None:
        """A page has said who it is."""
        self._pages[seat].append(page)
        if seat != EXPERIMENTER:
            page.tell(self._message(seat))
        self.overview()

    def leave(self, seat: int, page: Page) -> None:
        """A page is gone; what it has answered stays."""
        if page in self._pages[seat]:
            self._pages[seat].remove(page)
        self.overview()

    def connected(self, seat: int) -> bool:
        """Whether a page of a seat is open."""
        return bool(self._pages[seat])

    def show(self) -> None:
        """Tell each page what stands before it, if that has changed."""
        for seat in self.seats:
            message = self._message(seat)
            if message != self._shown.get(seat):
                self._shown[seat] = message
                for page in self._pages[seat]:
                    page.tell(message)
        self.overview()

    def _message(self, seat: int) -> Message:
        """What stands before a seat, and in whose session."""
        return {**self._stands(seat), "session": self.book.participant.code}

    def _stands(self, seat: int) -> Message:
        if self.probe is not None and seat in self.probe.states:
            probe, state = self.probe, self.probe.states[seat]
            if not state.done:
                return screens.form_message(probe.number, probe.form, state, 1, freeze=True)
            return screens.wait_message(probe.number, "Please wait for the other operator.")
        step = self.step(seat)
        if step.kind == "panel" and self.panels is not None and self.panels.over:
            return screens.wait_message(step.number, self.panels.over)
        if step.kind == "panel" and self.panels is not None and seat in self.panels.urls:
            return screens.panel_message(step.number, self.panels.urls[seat], self.panels.line)
        page = self._page_of(seat, step)
        code = self.book.participant.code
        lasts = self.lasts(step.task) if step.kind == "ready" and step.task is not None else None
        session = self.book.session
        return screens.message(session, self._past, step, page, self._consent, code, lasts)

    def _page_of(self, seat: int, step: Step) -> int:
        """The page of a form that is shown: where it goes on, or to where it was turned."""
        if step.state is None or not step.state.answers:
            return self._turned.get((seat, step.number), 1)
        return min(self._turned.get((seat, step.number), step.state.page), step.state.page)

    def overview(self) -> None:
        """Tell the experimenter how it goes, now or soon: at most twice a second."""
        if self._overviewing is not None or not self._pages[EXPERIMENTER]:
            return
        loop = asyncio.get_running_loop()
        due = max(loop.time(), self._overviewed + OVERVIEW_EVERY)
        self._overviewing = loop.call_at(due, self._send_overview)

    def _send_overview(self) -> None:
        self._overviewing = None
        self._overviewed = asyncio.get_running_loop().time()
        for page in self._pages[EXPERIMENTER]:
            page.tell(self._overview())

    def _overview(self) -> Message:
        who, step = self.book.participant, self.step(1)
        task = step.task
        shown = {
            "kind": "form" if self.probe else step.kind,
            "what": "" if task is None else task.key,
            "number": step.number,
        }
        now, following = screens.plain(self.book.session, step, self._past)
        if self.panels is not None and self.panels.waits:
            now += ": waits for a picture or the gamepad"
        told = {
            "type": "overview",
            "now": "a question in the middle of the trial" if self.probe else now,
            "next": f"{now} goes on" if self.probe else following,
            "training": task is not None and task.kind == "training",
            "participant": who.code,
            "number": who.number,
            "status": self._past.status,
            "reason": self._past.reason,
            "step": shown,
            "trial": task.number if task is not None and task.kind == "trial" else None,
            "attempt": step.attempt or None,
            "time": None,
            "score": None,
            "panel": None,
            "robots": [],
            "victims": [],
            "trouble": self.trouble,
            "seats": [{"seat": seat, "connected": bool(self._pages[seat])} for seat in self.seats],
            "events": list(self.events),
        }
        return told | (self.panels.watch if self.panels is not None else {})

    # -- what pages say -----------------------------------------------------------------------

    def hear(self, seat: int, page: Page, text: str) -> None:
        """A page says something; whatever it is, it is answered and never fatal."""
        number: object = None
        try:
            said = read_object(text)
            number = said.get("step")
            self._obey(seat, page, said)
        except RefusedError as refusal:
            told = {"type": "refused", "step": number, "why": str(refusal)}
            told |= {} if refusal.item is None else {"item": refusal.item}
            page.tell({**told, "missing": list(refusal.missing)})

    def _obey(self, seat: int, page: Page, said: Message) -> None:
        kind = said.get("type")
        if kind == "ping":
            page.tell({"type": "pong"})
        elif kind == "order":
            if seat != EXPERIMENTER:
                raise RefusedError("only the experimenter may do that")
            self._order(page, said)
        elif kind in ("next", "answer", "turn", "hand_in"):
            if seat == EXPERIMENTER:
                raise RefusedError("only operators fill in and go on: use an order")
            if said.get("step") != self._number(seat):
                raise RefusedError("this is over: another step stands here now")
            if kind == "next":
                self.press(seat)
            else:
                self._fill_in(seat, page, kind, said)
        else:
            raise RefusedError(f"{kind!r:.40} is no text of this protocol")

    def _number(self, seat: int) -> int:
        if self.probe is not None and seat in self.probe.states:
            return self.probe.number
        return self.step(seat).number

    def press(self, seat: int) -> None:
        """The button of a text.

        Raises:
            RefusedError: there is none, or nothing can be stored.
        """
        step = self.step(seat)
        if step.kind == "ready":
            self._ready |= {(step.number, seat)}
            self.show()
            self._stirred.set()
        elif step.kind in ("welcome", "consent", "break") and step.task is not None:
            task = step.task
            self._stored(lambda: self.book.pass_(task, seat))
        else:
            raise RefusedError("there is no button here")

    def _stored(self, write: Callable[[], object]) -> None:
        if not self._keep(write):
            raise RefusedError(self.trouble)

    def _fill_in(self, seat: int, page: Page, kind: str, said: Message) -> None:
        """An answer, a page that is turned, or a form that is handed in."""
        step, probe = self.step(seat), self.probe
        state = probe.states.get(seat) if probe is not None else step.state
        if state is None or state.done:
            raise RefusedError("there is no form here")
        if kind == "answer":
            item, value = said.get("item"), said.get("value")
            try:
                self._answer(seat, step, state, item, value, said.get("clock"))
            except OSError as error:
                self.trouble = f"nothing can be stored: {reason(error)} (make room on the disk)"
                self.refresh()
                asyncio.get_running_loop().call_later(RETRY, page.end)
                raise RefusedError(self.trouble) from None
            page.tell({"type": "saved", "step": said["step"], "item": item})
        elif kind == "turn":
            self._turn(seat, step, state, said.get("page"))
            page.tell(self._message(seat))
        elif missing := state.missing():
            raise RefusedError("some questions are not answered", missing)
        else:
            self._hand_in(seat, step, state)

    def _answer(
        self, seat: int, step: Step, state: FormState, item: object, value: Any, clock: object
    ) -> None:
        seconds = float(clock) if isinstance(clock, int | float) and 0 <= clock < 1e6 else 0.0
        try:
            state.answer(str(item), value, round(seconds, 3))
        except (StudyError, TypeError) as error:
            raise RefusedError(str(error), item=str(item)) from None
        if self.probe is not None:
            self.probe.keep(seat, state)
        elif step.task is not None:
            self.book.keep(step.task, seat, state)
            self.trouble = ""
            self._past = self.book.past()
            self._shown[seat] = self._message(seat)  # the page has it already

    def _turn(self, seat: int, step: Step, state: FormState, page: object) -> None:
        """To another page of a form; forward only past answered ones."""
        if not isinstance(page, int) or not 1 <= page <= state.form.pages:
            raise RefusedError("there is no such page")
        for before in range(1, page):
            if missing := state.missing(before):
                raise RefusedError("some questions are not answered", missing)
        self._turned[seat, step.number] = page
        self._shown[seat] = self._message(seat)

    def _hand_in(self, seat: int, step: Step, state: FormState) -> None:
        if self.probe is not None:
            state.hand_in()
            self.probe.keep(seat, state)
            if all(one.done for one in self.probe.states.values()):
                self.probe.done.set()
            self.show()
            return
        task = step.task
        assert task is not None
        state.hand_in()
        try:
            self._stored(lambda: self.book.keep(task, seat, state))
        except RefusedError:
            state.done = False
            raise

    # -- orders of the experimenter -----------------------------------------------------------

    def _order(self, page: Page, said: Message) -> None:
        why = str(said.get("reason") or "")[:200]
        if taken := misread(why):
            raise RefusedError(f"{why!r} would be {taken} in a table: write the reason in words")
        match said.get("do"):
            case "next":
                self._go_on()
            case "void":
                if self.panels is None:
                    raise RefusedError("no trial runs that could be void")
                self.panels.end("void", why or "voided by the experimenter")
            case "end_trial":
                if self.panels is None:
                    raise RefusedError("no trial runs that could end")
                self.panels.end("complete", why)
            case "pass_training":
                self._pass_training(why or "passed by the experimenter")
            case "end_session":
                text = why or "ended by the experimenter"
                self._stored(lambda: self.book.end("withdrawn", text))
                if self.panels is not None:
                    self.panels.end("aborted", text)
            case "inject":
                if self.panels is None:
                    raise RefusedError("no trial runs")
                told = said.get("inject")
                work = self._inject(page, self.panels, told if isinstance(told, dict) else {})
                self._injecting.add(task := asyncio.create_task(work))
                task.add_done_callback(self._injecting.discard)
                return
            case other:
                raise RefusedError(f"{other!r:.40} is no order")
        page.tell({"type": "done", "do": said["do"]})

    def _pass_training(self, why: str) -> None:
        """Let the participant go on as if the training had been passed, whatever runs."""
        task = self.step(1).task
        if task is None or task.kind != "training" or self._past.status != "running":
            raise RefusedError("no training stands here that could be passed")
        if self.panels is not None:
            self.panels.end("passed", why)
        elif any(one.status == "running" for one in self._past.attempts(task)):
            raise RefusedError("the training is only coming: wait until it is there")
        else:
            self._stored(lambda: self.book.close(self.book.begin(task), "passed", why))

    async def _inject(self, page: Page, panels: Panels, told: Message) -> None:
        try:
            why = await panels.inject(told)
        except (ValueError, TypeError, UsarsimError) as error:
            why = str(error)
        if why:
            page.tell({"type": "refused", "step": None, "why": why, "missing": []})
        else:
            page.tell({"type": "done", "do": "inject"})

    def _go_on(self) -> None:
        """Press every button, and leave forms as they are: what is not answered is missing."""
        if self._past.status != "running":
            self.another.set()
            return
        if self.probe is not None:
            for state in self.probe.states.values():
                state.done = True
            self.probe.done.set()
            return
        went = self.panels is not None and self.panels.begin()
        for seat in self.seats:
            step = self.step(seat)
            if step.kind == "form" and step.task is not None:
                task = step.task
                self._stored(lambda task=task, seat=seat: self.book.pass_(task, seat))  # type: ignore[misc]
                went = True
            elif step.kind in ("welcome", "consent", "break", "ready"):
                self.press(seat)
                went = True
        if not went:
            raise RefusedError("nothing stands here that could be left out")
