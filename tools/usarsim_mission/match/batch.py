"""A batch: each team plays each seed, several runs at once, each in a process of its own.

A run that fails, or is killed, takes no other one with it. What is done follows from the folders
alone: a batch that was interrupted goes on where it was. A run that is not whole is put aside, as
TEAM-SEED.void-1, and played again.
"""

from __future__ import annotations

import asyncio
import contextlib
import sys
import time
from asyncio.subprocess import DEVNULL, PIPE, STDOUT
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from usarsim_mission.errors import MissionError
from usarsim_mission.league.gathering import flaw_of, gather
from usarsim_mission.league.standings import rank
from usarsim_mission.league.writing import write_league
from usarsim_mission.match.archive import ARCHIVE, write_archive
from usarsim_mission.match.report import REPORT, write_report
from usarsim_mission.plan import Plan
from usarsim_mission.rescoring import live_result
from usarsim_mission.runlog import EVENTS, SCORE
from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.files import reason
from usarsim_server.base.launch import python

GRACE = 120.0
"""s of wall time in which an interrupted run writes its score."""
_LAST = 12  # lines of a run that are shown when it has failed
Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Job:
    """A run to be played.

    Attributes:
        words: of `usarsim mission run`, but for its folder.
    """

    team: str
    seed: int
    folder: Path
    words: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.team}, seed {self.seed}"


@dataclass
class Batch:
    """Plays jobs.

    Attributes:
        jobs: all of them. at_once: so many at a time.
        say: is told a line whenever something is known.
        failed: why, of those that are not whole.
    """

    jobs: Sequence[Job]
    at_once: int
    say: Say
    failed: dict[str, str] = field(default_factory=dict)
    _done: int = 0
    _took: list[float] = field(default_factory=list)

    async def play(self) -> None:
        """Play what is not done yet, in order.

        Raises:
            MissionError: a folder cannot be put aside.
        """
        waiting: deque[Job] = deque()
        for job in self.jobs:
            if is_whole(job.folder):
                _complete(job.folder)
                self._done += 1
            else:
                waiting.append(job)
        if self._done:
            self.say(f"{self._done} of {len(self.jobs)} are done already")
        workers = [asyncio.create_task(self._work(waiting)) for _ in range(self.at_once)]
        try:
            await asyncio.gather(*workers)  # which cancels them if it is cancelled
        except UsarsimError:
            for worker in workers:
                worker.cancel()
            raise
        finally:
            await asyncio.gather(*workers, return_exceptions=True)  # until they have tidied up

    async def _work(self, waiting: deque[Job]) -> None:
        while waiting:
            job = waiting.popleft()
            put_aside(job.folder)
            began = time.monotonic()
            code, lines = await self._run(job)
            self._took.append(time.monotonic() - began)
            self._done += 1
            flaw = flaw_in(job.folder)
            if flaw or code:
                why = lines[-1].strip() if lines else f"exit code {code}"
                self.failed[str(job)] = f"{flaw}: {why}" if flaw else why
                self.say(self._line(job, f"FAILED ({self.failed[str(job)]})"))
                continue
            self.say(self._line(job, _told(job.folder)))

    async def _run(self, job: Job) -> tuple[int, list[str]]:
        """The exit code of a run and its last lines; if we are to end, it ends first."""
        words = ["mission", "run", *job.words, f"--out={job.folder}"]
        process = await asyncio.create_subprocess_exec(
            *python("-m", "usarsim_server", *words, tied=True),
            stdin=DEVNULL,
            stdout=PIPE,
            stderr=STDOUT,
            start_new_session=True,  # Ctrl-C is for us
        )
        assert process.stdout is not None
        lines: deque[str] = deque(maxlen=_LAST)
        try:
            while data := await process.stdout.readline():
                text = data.decode(errors="replace").rstrip()
                lines.append(text)
                if self.at_once == 1 or text.startswith("CONSOLE"):
                    self.say(text)
            return await process.wait(), list(lines)
        finally:
            if process.returncode is None:
                process.terminate()
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(GRACE):
                        while await process.stdout.read(1 << 16):
                            pass
                        await process.wait()
                if process.returncode is None:
                    process.kill()

    def _line(self, job: Job, what: str) -> str:
        left = len(self.jobs) - self._done
        text = f"{self._done} of {len(self.jobs)}  {job}: {what}"
        if not left:
            return text
        seconds = sum(self._took) / len(self._took) * left / self.at_once
        return f"{text} (about {_span(seconds)} left)"


def flaw_in(folder: Path) -> str:
    """Why the run in a folder is not whole, in words; empty if it is."""
    if not (folder / EVENTS).exists():
        return "it did not begin"
    result = live_result(folder / SCORE)
    return "it was cut off" if result is None else flaw_of(result)


def is_whole(folder: Path) -> bool:
    """Whether a run in a folder was played to its end."""
    try:
        return not flaw_in(folder)
    except (UsarsimError, KeyError, TypeError):
        return False


def put_aside(folder: Path) -> Path | None:
    """Give what is left of a run another name; returns it, or None if there is nothing.

    Raises:
        MissionError: that cannot be.
    """
    if not folder.exists():
        return None
    number = 1
    while (aside := folder.with_name(f"{folder.name}.void-{number}")).exists():
        number += 1
    try:
        folder.rename(aside)
    except OSError as error:
        cure = "check its rights, or move it away"
        raise MissionError(at(folder, f"cannot be put aside: {reason(error)}", cure)) from None
    return aside


def finish(plan: Plan, out: Path, batch: Batch, say: Say) -> int:
    """Write the league of a batch and say how it went; returns the exit code."""
    try:
        page, *_ = write_league(rank(gather([out])), out)
        say(f"LEAGUE {page}")
    except MissionError as error:  # nothing was played, or by several versions of the rules
        print(f"no league: {error}", file=sys.stderr)
    lacking = [job for job in batch.jobs if not is_whole(job.folder)]
    played = len(batch.jobs) - len(lacking)
    say(f"BATCH {plan.mission} {played} of {len(batch.jobs)} played, {len(batch.failed)} failed")
    for job in lacking:
        print(f"{job.folder}: {batch.failed.get(str(job), 'was not played')}", file=sys.stderr)
    if lacking:
        print("the same command again plays what is missing", file=sys.stderr)
    return 1 if lacking else 0


def _complete(folder: Path) -> None:
    """Write what a run lacks that was killed after its end."""
    result = live_result(folder / SCORE)
    if result is not None and not (folder / REPORT).exists():
        write_report(folder, result)
    if not (folder / ARCHIVE).exists():
        write_archive(folder)


def _told(folder: Path) -> str:
    result = live_result(folder / SCORE) or {}
    values = result["values"]
    found = f"{values['VF']:g} of {values['V']:g} found"
    return f"{result['total']:.4g} points, {found}, ended by {result['ended']['why']}"


def _span(seconds: float) -> str:
    """A time in words."""
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"
