"""Faults that a proxy makes out of our own server are noticed, and no check is without a fault."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace

import pytest

from usarsim_conformance import planted
from usarsim_conformance.mutants.control_faults import all_faults
from usarsim_conformance.mutants.fault_proxy import Link
from usarsim_conformance.mutants.side_faults import FAULTS as SIDE_FAULTS
from usarsim_conformance.mutants.wire_faults import WireFault, all_wire_faults
from usarsim_conformance.mutants.wire_trial import try_wire_faults
from usarsim_conformance.own_server import OwnServer
from usarsim_conformance.registry import Result, Verdict, all_checks

_FAULTS = all_wire_faults()
_OPTIONS = {"own": (), "raw": ("--image-type", "RAW")}
_SERVERS = 2
"""Servers among which the faults of our own server are shared out: one for each processor."""
_HEALTHY = (
    "control.conf.robot", "control.motion.back", "control.robust.flood", "images.rectangle.size",
    "images.raw.sides", "groundtruth.getpos.follows", "wireless.relay.much",
    "comserver.link.payload", "truth.query.split",
)  # fmt: skip
"""Tried without their faults, too: the proxy itself changes nothing."""


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


@pytest.fixture(scope="module")
def verdicts() -> Mapping[str, Result]:
    """Every fault judged once."""
    own = [fault for fault in _FAULTS.values() if fault.server == "own"]
    raw = [fault for fault in _FAULTS.values() if fault.server == "raw"]
    return _try(*(own[number::_SERVERS] for number in range(_SERVERS)), raw)


@pytest.mark.parametrize("name", list(_FAULTS))
def test_faults_are_noticed(name: str, verdicts: Mapping[str, Result]) -> None:
    """The check that is meant for a fault fails, for what it has seen itself."""
    result = verdicts[name]
    assert result.verdict is Verdict.FAIL, (result.verdict, result.reason, result.transcript)
    assert "could not be had" not in result.reason


def test_proxies_change_nothing_by_themselves() -> None:
    """Behind proxies without a fault the same checks pass."""
    healthy = [replace(_FAULTS[name], kind=Link) for name in _HEALTHY]
    raw = [fault for fault in healthy if fault.server == "raw"]
    results = _try([fault for fault in healthy if fault.server == "own"], raw)
    assert set(results) == set(_HEALTHY)
    for name, result in results.items():
        assert result.verdict is Verdict.PASS, (name, result.verdict, result.reason)


def test_no_check_is_without_a_fault() -> None:
    """Every check notices a fault: of a small server, of a proxy, or planted in our own server."""
    noticed = {fault.check for fault in (*all_faults().values(), *_FAULTS.values())}
    noticed |= set(SIDE_FAULTS.values())
    noticed |= {check for fault in planted.all_faults() for check in fault.notices}
    checks = {check.id for check in all_checks()}
    assert checks - noticed == set()
    assert {fault.check for fault in _FAULTS.values()} <= checks
