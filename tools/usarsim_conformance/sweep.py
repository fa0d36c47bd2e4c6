"""Judges our own server with one robot class after another: `usarsim conformance --self --robot`
with several classes, or all."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Sequence
from dataclasses import replace

from usarsim_conformance.own_server import OwnServer, StartError
from usarsim_conformance.registry import Check
from usarsim_conformance.report import Report
from usarsim_conformance.runner import judge_all
from usarsim_conformance.survey import Target
from usarsim_conformance.terminal import SIGNS
from usarsim_conformance.verdicts import Severity, Verdict


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
        StartError: if a server does not start, or dies.
        Failed: if one cannot be reached.
    """

    async def judge(robot: str) -> Report:
        async with slots:
            server = await asyncio.to_thread(OwnServer, *options)
            try:
                asked = replace(target, ports=dict(server.ports), robot=robot)
                report = await judge_all(asked, checks, name=f"{name} {robot}".strip())
                if server.died:
                    raise StartError(f"the server died while {robot} was judged: {server.said}")
            finally:
                await asyncio.to_thread(server.stop)
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
