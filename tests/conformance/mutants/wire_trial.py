"""Tries faults that a proxy makes: each judged by its check, many at a time in one world."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from mutants.fault_proxy import proxied
from mutants.wire_faults import WireFault
from usarsim_conformance.case import Run
from usarsim_conformance.clock import SimulatedClock
from usarsim_conformance.places import Places
from usarsim_conformance.registry import Crowded, Result, all_checks
from usarsim_conformance.runner import ROBOTS, judge
from usarsim_conformance.survey import Target, survey
from usarsim_conformance.wire import Transcript

_HANGS = 120.0
"""s of wall time without news of simulated time."""
_GIVES_UP = 600.0
"""s of wall time for a fault."""


async def try_wire_faults(
    ports: Mapping[str, int], faults: Sequence[WireFault], *, robot: str = "P2AT"
) -> dict[str, Result]:
    """What the checks say of faults, by the faults' names.

    The healthy server is looked over once. Each fault gets proxies of its own before it and a run
    of its own, so that nothing recorded for one is used for another; places and time are shared.

    Args:
        ports: of a healthy server, by service.
        faults: to try.
        robot: class that the server is looked over with.
    """
    checks = {check.id: check for check in all_checks()}
    target = Target(ports=ports, robot=robot)
    clock = SimulatedClock(_HANGS)
    results: dict[str, Result] = {}
    try:
        found = await survey(target, Transcript(), clock)
        shared = Run(target, found, clock, Places(found.places[:ROBOTS], clock))
        # A check may take two places; with one more than there are checks none waits for ever.
        slots = asyncio.Semaphore(max(1, min(ROBOTS, len(found.places)) - 1))

        async def attempt(fault: WireFault, is_beside: bool = False) -> None:
            async with proxied(fault.kind, ports, fault.services) as faulty:
                run = replace(
                    shared,
                    target=replace(target, ports=faulty),
                    survey=replace(found, robot=fault.robot),
                    shared={},
                    askers=Counter(),
                    is_beside=is_beside,
                )
                check = checks[fault.check]
                dialect = fault.dialect if check.dialects else ""
                results[fault.name] = await judge(run, check, dialect, _GIVES_UP)

        async def attempt_beside(fault: WireFault) -> None:
            async with slots:
                try:
                    await attempt(fault, is_beside=True)
                except Crowded:
                    alone.append(fault)

        alone = [fault for fault in faults if checks[fault.check].exclusive]
        beside = [fault for fault in faults if not checks[fault.check].exclusive]
        await asyncio.gather(*map(attempt_beside, beside))
        for fault in alone:
            await attempt(fault)
    finally:
        await clock.close()
    return results
