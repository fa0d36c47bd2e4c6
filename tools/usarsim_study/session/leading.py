"""One session after the other at a desk that is served."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from usarsim_study.folder import StudyFolder
from usarsim_study.session.desk import Desk, Run
from usarsim_study.session.notebook import Notebook
from usarsim_study.session.opening import consent_of, next_participant
from usarsim_study.session.staging import limit_of
from usarsim_study.session.web import Web


async def lead_sessions(
    folder: StudyFolder,
    pages: Web,
    run: Run,
    *,
    code: str | None = None,
    sessions: int = 0,
    seconds: float | None = None,
    scripted: bool = False,
    begins: Callable[[Desk], None] = lambda desk: None,
) -> None:
    """Lead participants through a study; between two of them the experimenter says when.

    Args:
        folder: of the study. pages: to which each desk tells its steps. run: does trials.
        code: with whom to go on; None: whoever was interrupted, or somebody new.
        sessions: how many; 0: until cancelled. seconds: longest a trial may be.
        scripted: participants are made by code.
        begins: is told each desk when it begins.

    Raises:
        StudyError: a file is damaged, or the list of assignments is used up.
    """
    consent, count = consent_of(folder), 0
    while True:
        with next_participant(folder, code, scripted=scripted) as participant:
            code = None
            lasts = partial(limit_of, folder.study, folder.path, seconds=seconds)
            desk = Desk(Notebook(folder, participant, bool(consent)), consent, run, lasts)
            print(f"SESSION {participant.code} number {participant.number}", flush=True)
            pages.lead(desk)
            begins(desk)
            await desk.lead()
        ended = desk.book.participant
        told = f", {ended.reason}" if ended.reason else ""
        print(f"ENDED {ended.code} {ended.status}{told}", flush=True)
        count += 1
        if count == sessions:
            return
        await desk.another.wait()
