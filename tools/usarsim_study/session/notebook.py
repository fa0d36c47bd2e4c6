"""What is on disk of one session: read as the past, and written before anybody hears that it is.

Every text that was read, every answer and every end of an attempt is a line or a small file in the
participant's folder; `past()` reads all of it again, so what a desk shows is what would stand there
after a crash.
"""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path
from typing import Any

from usarsim_mission.mending import close_run
from usarsim_mission.runlog import EVENTS, TRUTH
from usarsim_server.base.errors import UsarsimError
from usarsim_study.folder import (
    FORMS,
    STEPS,
    Participant,
    Stage,
    Status,
    StudyFolder,
    TrialStatus,
    append_form,
    append_lines,
)
from usarsim_study.forms import FormState
from usarsim_study.records import last_line, read_lines
from usarsim_study.session.steps import Attempt, Past, Session, Task, form_of
from usarsim_study.study_file import When
from usarsim_study.trial import Record

REPEATS = 3
"""Attempts at a trial that may break before it is given up."""
CUT_OFF = "cut off: the desk ended while it ran"


class Notebook:
    """The files of one participant.

    Attributes:
        folder: of the study. session: the participant's plan. participant: who.
    """

    def __init__(self, folder: StudyFolder, participant: Participant, consent: bool) -> None:
        self.folder, self.participant = folder, participant
        self.session = Session(folder.study, folder.orders[participant.number], consent)

    @property
    def place(self) -> Path:
        """The participant's folder."""
        return self.folder.place(self.participant.code)

    # -- what has happened --------------------------------------------------------------------

    def past(self) -> Past:
        """What has happened so far.

        Raises:
            StudyError: a file is damaged, or the study file was changed meanwhile.
        """
        code = self.participant.code
        trials = [
            Attempt(one.trial, one.attempt, one.status, one.reason)
            for one in self.folder.attempts(code)
        ]
        trainings = [
            Attempt(one.trial, one.attempt, one.status, one.reason)
            for one in self.folder.attempts(code, "training")
        ]
        steps = self.place / STEPS
        passed = frozenset(
            (str(one.get("passed")), int(one.get("seat", 1)))
            for one in (read_lines(steps) if steps.exists() else ())
        )
        forms: dict[tuple[int, str, int], FormState] = {}
        self._read_forms(forms, 0, self.place / FORMS, ("before", "after"))
        for one in self.folder.attempts(code):
            if one.status == "complete":
                self._read_forms(forms, one.trial, one.path / FORMS, ("after_trial",))
        who = self.participant
        return Past(who.status, who.reason, passed, forms, tuple(trials), tuple(trainings))

    def _read_forms(
        self,
        forms: dict[tuple[int, str, int], FormState],
        trial: int,
        path: Path,
        moments: tuple[When, ...],
    ) -> None:
        study = self.session.study
        known = {one.name for one in study.form if one.when in moments}
        for record in read_lines(path) if path.exists() else ():
            name = str(record.get("form"))
            if name in known:
                form = form_of(study, self.session.order, Task("form", trial, name))
                seat = int(record.get("operator", 1))
                forms[trial, name, seat] = FormState.from_json(form, record)

    # -- what happens -------------------------------------------------------------------------

    def pass_(self, task: Task, seat: int) -> None:
        """A seat is done with a task, without more to say.

        Raises:
            OSError: it cannot be written.
        """
        append_lines(self.place / STEPS, [{"passed": task.key, "seat": seat}])

    def keep(self, task: Task, seat: int, state: FormState) -> None:
        """Keep a form as far as it is filled in.

        Raises:
            OSError: it cannot be written.
        """
        told = form_record(state, seat)
        if not task.number:
            append_form(self.place / FORMS, [told])
            return
        run = self._run_of(task.number)
        append_form(run / FORMS, [told])
        if state.done:
            note(run, {"kind": "form", **told})

    def _run_of(self, trial: int) -> Path:
        """The folder of the attempt that counts."""
        rows = [one for one in self.folder.attempts(self.participant.code) if one.trial == trial]
        return rows[-1].path

    def begin(self, task: Task) -> Path:
        """A folder for the next attempt at a training or a trial.

        Raises:
            OSError: it cannot be made.
        """
        stage: Stage = "trial" if task.kind == "trial" else "training"
        return self.folder.new_trial(self.participant.code, task.number, stage)

    def close(self, run: Path, status: TrialStatus, reason: str) -> None:
        """Say how an attempt ended.

        Raises:
            OSError: it cannot be written.
        """
        self.folder.close_trial(run, status, reason)

    def end(self, status: Status, reason: str = "") -> None:
        """The session is over.

        Raises:
            OSError: it cannot be written.
        """
        ended = replace(self.participant, status=status, reason=reason)
        self.folder.store(ended)
        self.participant = ended

    def mend(self) -> list[str]:
        """Void what was under way when the desk ended (O-45), and close its logs.

        Returns:
            Folders of what was voided.

        Raises:
            OSError: it cannot be written.
        """
        mended = []
        stages: tuple[Stage, ...] = ("training", "trial")
        for stage in stages:
            rows = self.folder.attempts(self.participant.code, stage)
            for one in rows:
                if one.status == "running":
                    past = self.past()
                    task = Task(stage, one.trial)
                    with contextlib.suppress(UsarsimError):  # what was not written counts for none
                        close_run(one.path, CUT_OFF)
                    self.close(one.path, broken(past, task), CUT_OFF)
                    mended.append(one.path.name)
        return mended


def form_record(state: FormState, seat: int) -> Record:
    """What files say of a form; the first operator is not named."""
    return {**state.as_json()} | ({"operator": seat} if seat > 1 else {})


def broken(past: Past, task: Task) -> TrialStatus:
    """What an attempt becomes that broke: it is repeated, but not for ever."""
    voided = [one for one in past.attempts(task) if one.status == "void"]
    return "void" if task.kind == "training" or len(voided) + 1 < REPEATS else "aborted"


def note(run: Path, record: dict[str, Any]) -> None:
    """Add a record to the log of a run that is over, with the next number; at its last time.

    A log that ends in the middle of a line stays as it is: what is told here stands elsewhere, too.

    Raises:
        OSError: it cannot be written.
    """
    last = [last_line(run / name) for name in (EVENTS, TRUTH)]
    known = [one for one in last if one is not None]
    if last[0] is None or not known:
        return
    newest = max(known, key=lambda one: int(one["seq"]))
    facts = {"seq": newest["seq"] + 1, "t_wall": newest["t_wall"], "t_sim": newest["t_sim"]}
    append_lines(run / EVENTS, [{**facts, **record}])
