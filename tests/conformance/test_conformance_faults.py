"""Faults that a proxy makes out of our own server are noticed, and no check is without a fault."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace

import pytest

from usarsim_conformance import planted
from usarsim_conformance.mutants.fault_proxy import Link
from usarsim_conformance.mutants.wire_faults import WireFault, all_wire_faults
from usarsim_conformance.mutants.wire_trial import try_wire_faults
from usarsim_conformance.own_server import OwnServer
from usarsim_conformance.registry import Result, Severity, Verdict, all_checks

_FAULTS = all_wire_faults()
_OPTIONS = {"own": (), "raw": ("--image-type", "RAW")}
_SERVERS = 2
"""Servers among which the faults of our own server are shared out: one for each processor."""


def _try(*shares: Sequence[WireFault]) -> dict[str, Result]:
    """Every share at a server of its own, all at the same time."""

    async def attempt(servers: Sequence[OwnServer]) -> list[dict[str, Result]]:
        return await asyncio.gather(
            *(try_wire_faults(one.ports, share) for one, share in zip(servers, shares, strict=True))
        )

    with ExitStack() as stack:
        servers = [
            stack.enter_context(OwnServer("--speed", "max", *_OPTIONS[share[0].server]))
            for share in shares
        ]
        found = asyncio.run(attempt(servers))
    return {name: result for results in found for name, result in results.items()}


def _judged(faults: Sequence[WireFault], *wanted: Verdict) -> dict[str, Result]:
    """Each judged once, and once more if another verdict was wanted: the machine may be busy."""
    results = _shared_out(faults)
    again = [fault for fault in faults if results[fault.name].verdict not in wanted]
    return {**results, **_shared_out(again)}


def _shared_out(faults: Sequence[WireFault]) -> dict[str, Result]:
    own = [fault for fault in faults if fault.server == "own"]
    raw = [fault for fault in faults if fault.server == "raw"]
    shares = (*(own[number::_SERVERS] for number in range(_SERVERS)), raw)
    return _try(*filter(None, shares))


@pytest.fixture(scope="module")
def verdicts() -> Mapping[str, Result]:
    """Every fault judged once."""
    return _judged(list(_FAULTS.values()), Verdict.FAIL)


@pytest.mark.parametrize("name", list(_FAULTS))
def test_faults_are_noticed(name: str, verdicts: Mapping[str, Result]) -> None:
    """The check that is meant for a fault fails, for what it has seen itself."""
    result = verdicts[name]
    assert result.verdict is Verdict.FAIL, (result.verdict, result.reason, result.transcript)
    assert "could not be had" not in result.reason


def test_without_faults_the_same_checks_pass() -> None:
    """Behind proxies that change nothing: the checks demand nothing that is not a rule."""
    checks = {check.id: check for check in all_checks()}
    healthy = {
        fault.check: replace(fault, name=fault.check, kind=Link)
        for fault in _FAULTS.values()
        if not checks[fault.check].exclusive and fault.dialect != "gazebo"
    }
    fine = (Verdict.PASS, Verdict.NOT_APPLICABLE)
    # Every fourth one; `usarsim conformance --self` judges all.
    tried = list(healthy.values())[::4]
    results = _judged(tried, *fine)
    assert len(results) == len(tried)
    wrong = {
        name: (result.verdict, result.reason)
        for name, result in results.items()
        if result.verdict not in fine and checks[name].severity is not Severity.INFORMATIVE
    }
    assert not wrong
    assert sum(result.verdict is Verdict.PASS for result in results.values()) > 100


def test_no_check_is_without_a_fault() -> None:
    """Every check notices a fault: of a proxy, or planted in our own server."""
    noticed = {fault.check for fault in _FAULTS.values()}
    noticed |= {check for fault in planted.all_faults() for check in fault.notices}
    assert noticed == {check.id for check in all_checks()}
