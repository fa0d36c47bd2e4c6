"""Our own server in a process of its own, for `usarsim conformance --self`; judged with one robot
class after another if several are named."""

from __future__ import annotations

import asyncio
import os
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from usarsim_conformance.registry import Check, Severity, Verdict
from usarsim_conformance.report import Report
from usarsim_conformance.reports import SIGNS
from usarsim_conformance.runner import judge_all
from usarsim_conformance.stage import FOLDER
from usarsim_conformance.survey import Target
from usarsim_server.base.launch import LaunchError, OwnServer, python

_SIDE = ("image", "groundtruth", "wireless", "comserver", "truth")
_MOST_ROBOTS = 32


def judged_server(*options: str, folder: Path | None = None, waits: bool = True) -> OwnServer:
    """Start a server with all services that can be judged.

    Args:
        options: further ones of `usarsim serve`.
        folder: where another copy of the server lies, to be taken instead of this one.
        waits: until it is ready.

    Raises:
        LaunchError: if it does not become ready; with what it said.
    """
    words = [f"--{name}-port=0" for name in _SIDE]
    words += [f"--world={FOLDER / 'world'}", f"--robots={FOLDER / 'robots'}"]
    # On a busy machine robots that have left may be counted a little longer.
    words.append(f"--max-robots={_MOST_ROBOTS}")
    more = {"PYTHONFAULTHANDLER": "1"}
    if folder is not None:
        more["PYTHONPATH"] = str(folder)
    return OwnServer(*words, *options, folder=folder, more=more, waits=waits)


def robot_classes() -> list[str]:
    """All classes that `usarsim robots` lists.

    Raises:
        LaunchError: if it does not.
    """
    listing = subprocess.run(
        python("-m", "usarsim_server", "robots"), capture_output=True, text=True
    )
    if listing.returncode:
        raise LaunchError(f"`usarsim robots` failed: {listing.stderr.strip()}")
    return [line.split()[0] for line in listing.stdout.splitlines()[1:] if line.strip()]


def judge_classes(
    classes: Sequence[str],
    checks: Sequence[Check],
    target: Target,
    *,
    options: Sequence[str] = (),
    name: str = "",
    tell: Callable[[str, Report], None] = lambda robot, report: None,
) -> dict[str, Report]:
    """A report for every class, each of a server of its own; as many at a time as processors.

    Args:
        classes: of robots.
        checks: from `registry.all_checks`.
        target: what else is asked for; ports and robot are filled in.
        options: of `usarsim serve`.
        name: of the server in the reports.
        tell: what is told when a class has been judged.

    Raises:
        LaunchError: if a server does not start, or dies.
        Failed: if one cannot be reached.
    """

    async def judge(robot: str) -> Report:
        async with slots:
            # It would end with another thread that had started it.
            server = judged_server(*options, waits=False)
            try:
                await asyncio.to_thread(server.wait)
                asked = replace(target, ports=dict(server.ports), robot=robot)
                report = await judge_all(asked, checks, name=f"{name} {robot}".strip())
                if server.died:
                    raise LaunchError(f"the server died while {robot} was judged: {server.said}")
            finally:
                await asyncio.to_thread(server.close)
        tell(robot, report)
        return report

    async def judge_every_one() -> list[Report]:
        return await asyncio.gather(*map(judge, classes))

    slots = asyncio.Semaphore(os.cpu_count() or 1)
    return dict(zip(classes, asyncio.run(judge_every_one()), strict=True))


def as_table(reports: dict[str, Report]) -> str:
    """A line for each class, and below it the rules that it breaks or that could not be judged."""
    width = max(map(len, reports))
    lines = [" " * width + "".join(SIGNS[verdict].rjust(7) for verdict in Verdict)]
    for robot, report in reports.items():
        counts = "".join(str(report.counts[verdict] or "").rjust(7) for verdict in Verdict)
        lines.append(f"{robot:{width}}{counts}  {'' if report.conforms else 'does NOT conform'}")
        for result in report.results:
            severity = report.rule(result.check).severity
            informative = severity is Severity.INFORMATIVE and result.verdict is Verdict.FAIL
            if result.verdict in (Verdict.FAIL, Verdict.INCONCLUSIVE) and not informative:
                where = f"{result.check} [{result.dialect}]" if result.dialect else result.check
                reason = result.reason.partition("\n")[0]
                lines.append(f"    {SIGNS[result.verdict]:4}  {where}  {reason}"[:160])
    wrong = [robot for robot, report in reports.items() if not report.conforms]
    ending = f"; not with {', '.join(wrong)}" if wrong else ""
    lines.append(f"conforms with {len(reports) - len(wrong)} of {len(reports)} classes{ending}")
    return "\n".join(line.rstrip() for line in lines)
