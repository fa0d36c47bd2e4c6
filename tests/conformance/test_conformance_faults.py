"""Faults that a proxy makes out of our own server are noticed, and no check is without a fault."""

from __future__ import annotations

import asyncio
import re
import signal
from collections.abc import Mapping, Sequence
from dataclasses import replace

import planted
import pytest
from mutants.fault_proxy import Link
from mutants.wire_faults import WireFault, all_wire_faults
from mutants.wire_trial import try_wire_faults

from usarsim_conformance.clock import STANDS_STILL
from usarsim_conformance.own_server import judged_server
from usarsim_conformance.registry import Result, Severity, Verdict, all_checks

_FAULTS = all_wire_faults()
_OPTIONS = {"own": (), "images": (), "raw": ("--image-type", "RAW")}
"""Of the servers that get the faults, by the name of the server that a fault asks for."""
_FINE = (Verdict.PASS, Verdict.NOT_APPLICABLE)
_FAMILIES = {"ackerman", "aerial", "arm", "flippers", "legged", "motion"}
_FIRST = {
    service if group not in _FAMILIES else group: name
    for name, fault in reversed(_FAULTS.items())
    for service, group, *_ in [fault.check.split(".")]
}
"""The first fault of each service and each family of robots: the others are slow."""


def _healthy() -> dict[str, WireFault]:
    """Proxies that change nothing, by check: for every twelfth one that has a fault."""
    checks = {check.id: check for check in all_checks()}
    all_of_them = {
        fault.check: replace(fault, name=f"healthy {fault.check}", kind=Link)
        for fault in _FAULTS.values()
        if not checks[fault.check].exclusive and fault.dialect != "gazebo"
    }
    # `usarsim conformance --self` judges all, without proxies.
    return dict(list(all_of_them.items())[::12])


def _judge_on(name: str, faults: Sequence[WireFault]) -> dict[str, Result]:
    """Verdicts of the faults that a server gets, each judged once."""
    with judged_server("--speed", "max", *_OPTIONS[name]) as server:
        results = asyncio.run(try_wire_faults(server.ports, faults))
        stalled = [one for one in results.values() if STANDS_STILL in one.reason]
        if stalled:
            server.end(signal.SIGABRT)
            print(server.errors)  # at its end, where each thread stands
            pytest.fail(f"{stalled[0].check}: {stalled[0].reason}", pytrace=False)
    return results


@pytest.fixture(scope="module")
def verdicts(request: pytest.FixtureRequest) -> Mapping[str, Result]:
    """What this run's tests ask for, one server after the other: each works as hard as it can."""
    here = [item for item in request.session.items if item.path == request.path]
    called = [item.callspec.params["name"] for item in here if hasattr(item, "callspec")]
    faults = [_FAULTS[name] for name in called]
    if any(item.name == test_without_faults_the_same_checks_pass.__name__ for item in here):
        faults += _healthy().values()
    return {
        fault: result
        for name in sorted({one.server for one in faults})
        for fault, result in _judge_on(name, [one for one in faults if one.server == name]).items()
    }


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in _FIRST.values() else pytest.mark.slow)
        for name in _FAULTS
    ],
)
def test_faults_are_noticed(name: str, verdicts: Mapping[str, Result]) -> None:
    """The check that is meant for a fault fails, for what it has seen itself, and says what the
    fault says that it should."""
    result = verdicts[name]
    assert result.verdict is Verdict.FAIL, (result.verdict, result.reason, result.transcript)
    assert "could not be had" not in result.reason
    assert re.search(_FAULTS[name].says, result.reason), result.reason


@pytest.mark.slow
def test_without_faults_the_same_checks_pass(verdicts: Mapping[str, Result]) -> None:
    """Behind proxies that change nothing: the checks demand nothing that is not a rule."""
    severities = {check.id: check.severity for check in all_checks()}
    results = {check: verdicts[fault.name] for check, fault in _healthy().items()}
    wrong = {
        check: (result.verdict, result.reason)
        for check, result in results.items()
        if result.verdict not in _FINE and severities[check] is not Severity.INFORMATIVE
    }
    assert not wrong
    assert sum(result.verdict is Verdict.PASS for result in results.values()) > 25


def test_no_check_is_without_a_fault() -> None:
    """Every check notices a fault: of a proxy, or planted in our own server."""
    noticed = {fault.check for fault in _FAULTS.values()}
    noticed |= {check for fault in planted.all_faults() for check in fault.notices}
    assert noticed == {check.id for check in all_checks()}
