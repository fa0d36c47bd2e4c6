"""Runs checks against a server, many at a time where their rules allow it."""

from __future__ import annotations

import asyncio
import contextlib
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from usarsim_conformance.case import Case, Run
from usarsim_conformance.clock import HANGS, SimulatedClock, Stalled
from usarsim_conformance.places import LEAVES, Places
from usarsim_conformance.registry import (
    Check,
    Crowded,
    Failed,
    Inconclusive,
    NotApplicable,
    Result,
    Verdict,
)
from usarsim_conformance.report import Report, Rule
from usarsim_conformance.survey import Survey, Target, survey
from usarsim_conformance.wire import Transcript
from usarsim_server.base.addresses import format_address

_PARALLEL = 8
"""Checks at a time."""
ROBOTS = 14
"""Robots at a time; with the one that tells the time, and one that is leaving, they fit a small
server of 16."""
_GIVES_UP = 600.0
"""s of wall time, and of simulated time if a robot tells it, after which a check counts as
hanging."""


@dataclass(frozen=True, slots=True)
class Progress:
    """Told after every check."""

    done: int  # checks judged
    total: int  # checks to judge in all
    check: Check  # the one just judged
    result: Result  # its result


def _silent(progress: Progress) -> None:
    """Says nothing."""


async def judge_all(
    target: Target,
    checks: Sequence[Check],
    *,
    name: str = "",
    tell: Callable[[Progress], None] = _silent,
    parallel: int = _PARALLEL,
    hangs: float = HANGS,
    gives_up: float = _GIVES_UP,
) -> Report:
    """Judge a server by checks.

    Args:
        target: the server.
        checks: from `registry.all_checks`.
        name: of the server in the report; its address by default.
        tell: what is told after every check.
        parallel: checks at a time.
        hangs: s of wall time without news of simulated time after which the server hangs.
        gives_up: s of wall and of simulated time after which a check hangs.

    Raises:
        Failed: if its control port cannot be reached at all.
    """
    begun, taken = time.monotonic(), datetime.now(UTC)
    clock = SimulatedClock(hangs)
    try:
        found = await survey(target, Transcript(), clock)
        places = found.places[:ROBOTS]
        run = Run(target, found, clock, Places(places, clock))
        jobs = _jobs(checks, found)
        results: dict[tuple[str, str], Result] = {}

        async def work(check: Check, dialect: str, slots: asyncio.Semaphore) -> None:
            await slots.acquire()
            mine = replace(run, slots=slots, is_beside=slots is many)
            try:
                result = await judge(mine, check, dialect, gives_up)
            except Crowded:
                alone.append((check, dialect))
                return
            results[check.id, dialect] = result
            tell(Progress(len(results), len(jobs), check, result))

        together = [job for job in jobs if not job[0].exclusive]
        alone = [job for job in jobs if job[0].exclusive]
        # A check may take two places: with one more than there are checks, none waits for ever.
        workers = max(1, min(parallel, len(places) - 1))
        many, one = asyncio.Semaphore(workers), asyncio.Semaphore(1)
        for group, slots in ((together, many), (alone, one)):
            async with asyncio.TaskGroup() as tasks:
                for check, dialect in group:
                    tasks.create_task(work(check, dialect, slots))
            if group is together and alone:
                with contextlib.suppress(Stalled):
                    await clock.sleep(LEAVES)
    finally:
        await clock.close()
    return Report(
        name=name or format_address(target.host, target.ports["control"]),
        server=_facts(target, found),
        taken=taken,
        seconds=time.monotonic() - begun,
        dialects=tuple(found.dialects),
        rules=tuple(Rule.of(check) for check in checks),
        results=tuple(results[check.id, dialect] for check, dialect in jobs),
        staged=target.staged,
    )


async def judge(run: Run, check: Check, dialect: str, gives_up: float = _GIVES_UP) -> Result:
    """Run one check; whatever goes wrong in it becomes a result.

    Raises:
        Crowded: if others are at work and have all there is of something.
    """
    begun = time.monotonic()
    case = Case(run, dialect or run.survey.native)
    verdict, reason = Verdict.PASS, ""
    if check.service not in run.target.ports:
        verdict, reason = Verdict.NOT_APPLICABLE, f"no port of {check.service} was named"
    else:
        try:
            async with asyncio.timeout(gives_up) as limit:
                patience = asyncio.create_task(_wait_for_simulated(run.clock, gives_up, limit))
                try:
                    await check.function(case)
                finally:
                    patience.cancel()
        except NotApplicable as error:
            verdict, reason = Verdict.NOT_APPLICABLE, str(error)
        except Inconclusive as error:
            if run.is_beside and isinstance(error, Crowded):
                raise
            verdict, reason = Verdict.INCONCLUSIVE, str(error)
        except Failed as error:
            verdict, reason = Verdict.FAIL, str(error)
        except TimeoutError:
            verdict, reason = Verdict.INCONCLUSIVE, f"not judged within {gives_up:g} s"
        except Exception:
            # A defect of the check, perhaps brought to light by what the server sent.
            verdict = Verdict.INCONCLUSIVE
            reason = "the check broke: " + traceback.format_exc(limit=-2).strip()
        finally:
            case.release()
            case.leave_slot()
    return Result(
        check=check.id,
        dialect=dialect,
        verdict=verdict,
        reason=reason,
        seconds=time.monotonic() - begun,
        transcript=() if verdict is Verdict.PASS else case.entries(),
    )


async def _wait_for_simulated(
    clock: SimulatedClock, gives_up: float, limit: asyncio.Timeout
) -> None:
    """Put off a limit of wall time for as long as simulated time lags behind.

    A busy machine does not make a check hang. A clock that stands still raises `Stalled` by itself.
    """
    begun, loop = clock.now, asyncio.get_running_loop()
    while True:
        await asyncio.sleep(gives_up / 4.0)
        left = gives_up - (clock.now - begun)
        if clock.followed and left > 0.0:
            limit.reschedule(max(limit.when() or 0.0, loop.time() + left))


def _jobs(checks: Sequence[Check], found: Survey) -> list[tuple[Check, str]]:
    """Every check with each dialect in which it has to run; an empty one for "once"."""
    return [
        (check, dialect)
        for check in checks
        for dialect in (
            [name for name in found.dialects if name in check.dialects] if check.dialects else [""]
        )
    ]


def _facts(target: Target, found: Survey) -> dict[str, str]:
    return {
        "address": format_address(target.host, target.ports["control"]),
        "services": ", ".join(f"{name} {port}" for name, port in target.ports.items()),
        "greeting": found.greeting.text if found.greeting is not None else "none",
        "robot": found.robot or "none could be spawned",
        "dialect by itself": found.native or "unknown",
        "dialects judged": ", ".join(found.dialects),
        "start places used": str(len(found.places)),
        "time": "simulated, as a robot told it" if found.timed else "of the wall",
    }
