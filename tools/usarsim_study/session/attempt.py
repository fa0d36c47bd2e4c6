"""Runs one training or trial for the desk: a mission with its referee, and what becomes of it.

The trial is in this process. After each row of the truth its world stands still until we have
looked at it: freeze probes are asked there, and whoever acts instead of people does it there.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import replace
from typing import Any

from usarsim_client.scene import TruthRow
from usarsim_mission.match.conditions import Conditions
from usarsim_mission.match.trial import Trial
from usarsim_mission.records import Record
from usarsim_mission.scenario.staging import Staged
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.files import reason
from usarsim_server.base.logs import Log
from usarsim_study.errors import StudyError
from usarsim_study.folder import TrialStatus
from usarsim_study.forms import FormState
from usarsim_study.session.desk import RETRY, Desk
from usarsim_study.session.happenings import attempt_told, closed, sentence
from usarsim_study.session.notebook import broken, form_record
from usarsim_study.session.probes import Scene, probe_form, probe_record
from usarsim_study.session.screens import many, panel_line, task_told
from usarsim_study.session.staging import (
    Options,
    condition_of,
    operators_of,
    panels_served,
    prepare,
    team_of,
)
from usarsim_study.session.steps import Step
from usarsim_study.session.talk import Ask, Panels, RefusedError
from usarsim_study.trial import COMPLETE

Meanwhile = Callable[["Attempt", TruthRow], Awaitable[None]]
"""Acts at an instant of a trial, instead of people."""


class Runner:
    """What the desk calls to run trainings and trials."""

    def __init__(
        self,
        options: Options,
        framed_by: Callable[[], frozenset[str]],
        meanwhile: Meanwhile | None = None,
    ) -> None:
        """framed_by: values of `Host` of the desk, asked when a trial begins.

        meanwhile: is awaited after each row of the truth.
        """
        self._options, self._framed_by, self._meanwhile = options, framed_by, meanwhile

    async def __call__(self, desk: Desk, step: Step) -> None:
        """Run the training or trial of a step, from its folder to its status."""
        attempt = Attempt(desk, step, self._options, self._meanwhile)
        await attempt.run(self._framed_by())


class Attempt:
    """One attempt.

    Attributes:
        desk, task: of whom, and which. scene: what probes ask about. trial, staged: once they are
            there.
        began: simulated s of its begin; None before. urls: of the panel, by who sees it.
    """

    def __init__(
        self, desk: Desk, step: Step, options: Options, meanwhile: Meanwhile | None
    ) -> None:
        assert step.task is not None
        self.desk, self.step, self.task = desk, step, step.task
        self.trial: Trial | None = None
        self.staged: Staged | None = None
        self.scene = Scene(())
        self.began: float | None = None
        self.urls: Mapping[str, str] = {}
        self.values: dict[str, float] = {}
        self._options, self._meanwhile = options, meanwhile
        self._ended: tuple[TrialStatus, str] | None = None
        self._trouble = self._early = ""
        self._victims: list[str] = []
        study = desk.book.session.study
        self._study = study
        self._told = task_told(desk.book.session, self.task)
        self._probes = list(enumerate(study.probe, start=1)) if self.task.kind == "trial" else []
        self._probes.sort(key=lambda one: one[1].at)

    @property
    def operators(self) -> int:
        """How many drive."""
        return operators_of(self._study, self.task, self.desk.book.session.seats)

    async def run(self, framed_by: frozenset[str]) -> None:
        """From the folder to `trial.json`."""
        desk, book = self.desk, self.desk.book
        try:
            folder = book.begin(self.task)
        except OSError as error:
            desk.log(closed(f"{self._told} cannot begin: {reason(error)} (make room on the disk)"))
            await asyncio.sleep(RETRY)
            return
        desk.refresh()
        try:
            told = panels_served(self._options, framed_by)
            facts = {
                "participant": book.participant.code,
                "stage": self.task.kind,
                "trial": self.task.number,
                "attempt": self.step.attempt,
                "allocation": self._study.allocation.digest,
            }
            conditions = Conditions(
                folder,
                self._options.speed,
                replace(told, told=self._open),
                self._hear,
                self._look,
                self.operators,
                pages=self.operators if self._options.waits else 0,
                facts=facts,
            )
            staged, conditions = await asyncio.to_thread(
                prepare, self._study, book.folder.path, self.task, conditions, self._options
            )
            self.staged = staged
            self.scene = Scene([one.entry.name for one in staged.robots])
            self._victims = [one.name for one in staged.victims]
            if desk.past.status != "running":
                self._ended = "aborted", desk.past.reason
                raise StudyError("the session has ended")
            team = team_of(book.participant.code, self.operators)
            self.trial = Trial(staged, team, conditions)
            status, why = self._judged(await self.trial.run())
        except (UsarsimError, OSError) as error:
            status, why = broken(desk.past, self.task), _short(str(error))
        except Exception as error:  # whatever it is: somebody sits there and waits
            Log("study").exception("a trial broke", error)
            status, why = broken(desk.past, self.task), f"a fault: {type(error).__name__}"
        finally:
            desk.panels, desk.probe = None, None
        if self._ended is not None:
            status, why = self._ended
        await self._close(folder, status, why)

    def _judged(self, result: Mapping[str, Any]) -> tuple[TrialStatus, str]:
        """What an attempt that came to an end is worth."""
        why = result["ended"]["why"]
        if why not in COMPLETE:
            text = self._trouble or "the trial did not come to its end"
            return broken(self.desk.past, self.task), text
        if self.task.kind == "trial":
            return "complete", self._early
        training, values = self._study.training, result["values"]
        assert training is not None
        contacts, victims = values["K"] + values["C"], values["LO"]
        if contacts <= training.contacts and victims >= training.victims:
            return "passed", ""
        touched, marked = many(int(contacts), "thing"), many(int(victims), "victim")
        return "failed", f"You touched {touched} and marked {marked} rightly."

    async def _close(self, folder: Any, status: TrialStatus, why: str) -> None:
        """Write how it ended, as soon as that can be written."""
        while True:
            try:
                self.desk.book.close(folder, status, why)
            except OSError as error:
                self.desk.log(f"Nothing can be stored: {reason(error)} (make room on the disk)")
                await asyncio.sleep(RETRY)
            else:
                break
        self.desk.log(attempt_told(self._told, status, why))

    # -- while it runs ------------------------------------------------------------------------

    def _open(self, urls: Mapping[str, str]) -> None:
        """The gateway serves pages now: those of the desk show them."""
        self.urls = urls
        variant = condition_of(self._study, self.task).panel
        more = "" if variant == "full" else f"&panel={variant}"
        more += f"&session={self.desk.book.participant.code}"  # changed keys are this person's
        operators = [url + more for who, url in urls.items() if who.startswith("operator")]
        seats = dict(enumerate(operators[: self.operators], start=1))
        line = panel_line(self._study, self.step, self.desk.lasts(self.task))
        self.desk.panels = Panels(
            self.step.number, seats, line, self._end, self._inject, self._begin_now
        )
        self.desk.panels.watch |= {
            "panel": urls.get("instructor"),
            "robots": list(self.scene.robots),
            "victims": list(self._victims),
        }
        self.desk.panels.waits = self._options.waits and self.began is None
        self.desk.show()
        if self.desk.past.status != "running":
            self._end("aborted", self.desk.past.reason)

    def _end(self, status: str, why: str) -> None:
        if status == "complete":
            if self.trial is None or self.began is None:
                raise RefusedError("it has not begun: it can only be void")
            self._early = "ended by the experimenter" + (f": {why}" if why else "")
            self.trial.end("operator", self._early)
        elif status == "passed":
            self._ended = "passed", why
            if self.trial is not None:
                self.trial.end("operator", why)
        else:
            self._ended = ("void" if status == "void" else "aborted"), why
            if self.trial is not None:
                self.trial.end("aborted", why)
        if self.desk.probe is not None:
            self.desk.probe.done.set()

    def _begin_now(self) -> bool:
        begun = self.trial is not None and self.trial.begin()
        if begun:
            self.desk.log(closed(f"{self._told} begins, though not everybody is ready"))
        return begun

    async def _inject(self, told: dict[str, Any]) -> str:
        """Make something happen, as the experimenter wants; why it did not."""
        if self.trial is None or self.began is None:
            return "the trial has not begun"
        facts = {key: value for key, value in told.items() if key != "do"}
        return await self.trial.inject(str(told.get("do")), **facts)

    def _hear(self, record: Record) -> None:
        """A record of the log."""
        self.scene.hear(record)
        kind, panels = record["kind"], self.desk.panels
        if kind == "trial_start":
            self.began = float(record["t_sim"])
            if panels is not None:
                panels.waits = False
        elif kind == "trial_end" and panels is not None:
            # The console would say that its link is lost while the last files are written.
            panels.over = f"The {self.task.kind} has ended."
            self.desk.show()
        elif kind == "error":
            self._trouble = _short(str(record.get("text", "")))
        elif kind == "score":
            self.values = record["values"]
            if panels is not None:
                panels.watch["score"] = record["total"]
        if told := sentence(record, record["t_sim"] - (self.began or 0.0), self._told):
            self.desk.log(told)

    async def _look(self, row: TruthRow) -> None:
        """The world stands still at an instant."""
        elapsed = row.time - (self.began or 0.0)
        if self.desk.panels is not None:
            self.desk.panels.watch["time"] = round(elapsed, 1)
            self.desk.overview()
        while self._probes and elapsed >= self._probes[0][1].at - 1e-6 and self._ended is None:
            await self._ask(*self._probes.pop(0), row)
        if self.task.kind == "training" and self.trial is not None:
            training = self._study.training
            if training is not None and self.values.get("LO", 0.0) >= max(1, training.victims):
                self.trial.end("operator", "all that was asked for is marked")
        if self._meanwhile is not None:
            await self._meanwhile(self, row)

    async def _ask(self, number: int, probe: Any, row: TruthRow) -> None:
        """Freeze, ask every operator, and score what they say by the truth of this instant."""
        form = probe_form(number, probe, self.scene)
        states = {seat: FormState(form) for seat in range(1, self.operators + 1)}
        trial = self.trial
        assert trial is not None

        def keep(seat: int, state: FormState) -> None:
            trial.tell("form", **form_record(state, seat))

        self.desk.probe = ask = Ask(self.step.number + 2 + number, form, states, keep)
        self.desk.show()
        await ask.done.wait()
        self.desk.probe = None
        for seat, state in states.items():
            trial.tell("probe", **probe_record(number, probe, self.scene, row, state, seat))
        self.desk.show()


def _short(text: str) -> str:
    """The first line of an error."""
    return text.strip().partition("\n")[0][:300]
