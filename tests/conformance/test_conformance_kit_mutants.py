"""The checks of the control port can fail: each fault of a small server is noticed."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

import pytest

from usarsim_conformance.mutants.control_faults import all_faults
from usarsim_conformance.mutants.control_server import control_server
from usarsim_conformance.registry import Result, Verdict, all_checks
from usarsim_conformance.runner import judge_all
from usarsim_conformance.survey import Target

_FAULTS = all_faults()
_AT_A_TIME = 64
_HANGS = 15.0
"""s of wall time without news of simulated time; two faults make servers hang."""


async def _judge(name: str) -> Result:
    """What the check that is meant for a fault says of it."""
    fault = _FAULTS[name]
    checks = [check for check in all_checks() if check.id == fault.check]
    async with control_server(fault.kind) as port:
        target = Target(ports={"control": port}, robot="P2AT", dialect=fault.dialect or None)
        report = await judge_all(target, checks, hangs=_HANGS)
    return report.results[0]


async def _judge_every_fault() -> dict[str, Result]:
    turns = asyncio.Semaphore(_AT_A_TIME)

    async def judge(name: str) -> Result:
        async with turns:
            return await _judge(name)

    results = await asyncio.gather(*map(judge, _FAULTS))
    return dict(zip(_FAULTS, results, strict=True))


@pytest.fixture(scope="module")
def verdicts() -> Mapping[str, Result]:
    """Every fault judged once, many at a time."""
    return asyncio.run(_judge_every_fault())


@pytest.mark.parametrize("name", list(_FAULTS))
def test_faults_are_noticed(name: str, verdicts: Mapping[str, Result]) -> None:
    """The check that is meant for a fault fails, and shows what was sent and received."""
    result = verdicts[name]
    assert result.verdict is Verdict.FAIL, result
    assert result.reason
    assert result.transcript


def test_faults_are_many() -> None:
    """Faults of every area are tried; a check that does not exist is no help."""
    known = {check.id for check in all_checks()}
    assert {fault.check for fault in _FAULTS.values()} <= known
    assert len(_FAULTS) >= 100
