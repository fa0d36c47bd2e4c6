"""Every check of the side channels that is meant for a fault notices it, and nothing else does."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

import pytest

from usarsim_conformance import side_images, side_lines
from usarsim_conformance.mutants.side_faults import FAULTS, side_server
from usarsim_conformance.registry import Check, Verdict, all_checks
from usarsim_conformance.report import Report
from usarsim_conformance.runner import judge_all
from usarsim_conformance.survey import Target

CHECKS = {check.id: check for check in all_checks()}
JPEG_FAULTS = {"image-cut-jpeg"}


async def _report(checks: Sequence[Check], *faults: str, jpeg: bool = False) -> Report:
    async with side_server(*faults, jpeg=jpeg) as ports:
        return await judge_all(Target(ports=ports), checks)


def _reports() -> dict[str, Report]:
    """One report per fault by the check meant for it, all taken at the same time."""

    async def take() -> dict[str, Report]:
        found = await asyncio.gather(
            *(
                _report([CHECKS[check]], fault, jpeg=fault in JPEG_FAULTS)
                for fault, check in FAULTS.items()
            )
        )
        return dict(zip(FAULTS, found, strict=True))

    return asyncio.run(take())


@pytest.fixture(scope="module")
def reports() -> dict[str, Report]:
    """What the checks say of each faulty server; a small server needs no patience."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(side_images, "FRAME_WITHIN", 2.0)
        patch.setattr(side_lines, "WITHIN", 2.0)
        patch.setattr(side_lines, "CARRIES", 2.0)
        patch.setattr(side_lines, "LEAVES", 2.0)
        return _reports()


@pytest.mark.parametrize("fault", FAULTS)
def test_the_fault_is_noticed(fault: str, reports: dict[str, Report]) -> None:
    """A server with this fault fails the check that is meant for it."""
    (result,) = reports[fault].results
    assert result.verdict is Verdict.FAIL, (result.verdict, result.reason, result.transcript)


@pytest.mark.parametrize("jpeg", [False, True])
def test_a_healthy_server_passes(jpeg: bool) -> None:
    """The same small server without a fault passes all those checks."""
    checks = [CHECKS[check] for check in sorted(set(FAULTS.values()))]
    report = asyncio.run(_report(checks, jpeg=jpeg))
    wrong = [one for one in report.results if one.verdict in (Verdict.FAIL, Verdict.INCONCLUSIVE)]
    assert not wrong, [(one.check, one.reason) for one in wrong]
    skipped = {one.check for one in report.results if one.verdict is Verdict.NOT_APPLICABLE}
    assert skipped == ({"images.raw.padding"} if jpeg else {"images.jpeg.markers"})
