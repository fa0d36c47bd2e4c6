"""A server without a fault passes: the checks demand nothing that is not a rule."""

from __future__ import annotations

import asyncio

from usarsim_conformance.mutants.control_server import control_server
from usarsim_conformance.registry import Check, Result, Verdict, all_checks
from usarsim_conformance.report import Report
from usarsim_conformance.runner import judge_all
from usarsim_conformance.survey import Target

_SERVERS = 8
"""Checks that want to be alone take long one by one; on several servers they need not wait."""
_FOREIGN = (
    "control.aerial", "control.ackerman", "control.flippers", "control.arm", "control.legged",
    "control.underwater", "control.world", "control.set.rfid", "control.set.releaser",
    "control.conf.actuator", "control.conf.both-names", "control.conf.next-line",
    "control.conf.aerial", "control.geo.actuator", "control.sensors.climb",
    "control.status.aerial", "control.status.flippers", "control.status.legged",
)  # fmt: skip
"""Rules about robots that the small server does not have."""


async def _judge(checks: list[Check]) -> Report:
    async with control_server() as port:
        target = Target(ports={"control": port}, robot="P2AT")
        return await judge_all(target, checks, parallel=10)


async def _judge_all(checks: list[Check]) -> list[Result]:
    heavy = [one for one in checks if one.exclusive or one.id.startswith("control.robust.")]
    light = [one for one in checks if one not in heavy]
    shares = [heavy[n::_SERVERS] for n in range(_SERVERS)] + [light[n::3] for n in range(3)]
    reports = await asyncio.gather(*map(_judge, filter(None, shares)))
    return [result for report in reports for result in report.results]


def test_the_healthy_server_passes() -> None:
    """No check of the control port fails or is in doubt, in either dialect."""
    checks = [
        one for one in all_checks() if one.service == "control" and not one.id.startswith(_FOREIGN)
    ]
    results = asyncio.run(_judge_all(checks))
    wrong = [
        (one.check, one.dialect, one.reason)
        for one in results
        if one.verdict in (Verdict.FAIL, Verdict.INCONCLUSIVE)
    ]
    assert not wrong
    passed = {one.check for one in results if one.verdict is Verdict.PASS}
    assert len(passed) > 150
    assert {one.dialect for one in results} == {"", "ut2004", "udk"}
