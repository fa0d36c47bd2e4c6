"""Plants faults, judges the servers that have them, and says what was noticed."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from usarsim_conformance.own_server import OwnServer, StartError
from usarsim_conformance.planted.copy import PlantError, edited_copy
from usarsim_conformance.planted.faults import Edit, Fault
from usarsim_conformance.registry import all_checks
from usarsim_conformance.runner import judge_all
from usarsim_conformance.survey import Target
from usarsim_conformance.verdicts import Failed, Result, Verdict

_HANGS = 20.0
"""s of wall time without news of simulated time; planted faults stop no clock."""
_GIVES_UP = 240.0
"""s of wall time after which a check counts as hanging."""
_WIDTH = 200
"""Characters of a message that the table shows."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a fault, or of the server without one.

    Attributes:
        name: of the fault; `healthy CLASS` for the server as it is.
        good: whether all checks noticed it and named the field; healthy: whether all passed.
        lines: check, verdict and message, one for each check.
    """

    name: str
    good: bool
    lines: tuple[tuple[str, str, str], ...]


@dataclass(frozen=True, slots=True)
class _Bench:
    """What several faults need alike."""

    robot: str
    dialect: str | None
    options: tuple[str, ...]


def try_faults(
    faults: Sequence[Fault], jobs: int = 0, tell: Callable[[Outcome], None] | None = None
) -> list[Outcome]:
    """Judge the healthy server and one server for each fault, several at a time.

    Args:
        faults: to plant.
        jobs: servers at a time; 0 for one on each processor.
        tell: what is told after each.

    Returns:
        The faults in their order, behind the healthy servers that they are compared with.
    """
    benches: dict[_Bench, set[str]] = {}
    for fault in faults:
        bench = _Bench(fault.robot, fault.dialect, fault.options)
        benches.setdefault(bench, set()).update(fault.notices)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs or os.cpu_count() or 1, mp_context=context) as pool:
        works = [pool.submit(_healthy, bench, sorted(ids)) for bench, ids in benches.items()]
        works += [pool.submit(_planted, fault) for fault in faults]
        for work in as_completed(works):
            if tell is not None:
                tell(work.result())
        return [work.result() for work in works]


def as_table(outcomes: Sequence[Outcome]) -> str:
    """One line for each fault and check, and a summary."""
    rows = [
        (outcome.name if number == 0 else "", *line)
        for outcome in outcomes
        for number, line in enumerate(outcome.lines)
    ]
    widths = [max((len(row[column]) for row in rows), default=0) for column in range(3)]
    lines = [
        "  ".join((*map(str.ljust, row[:3], widths), row[3][:_WIDTH])).rstrip() for row in rows
    ]
    faults = [one for one in outcomes if not one.name.startswith("healthy ")]
    bad = [one.name for one in outcomes if not one.good]
    noticed = sum(one.good for one in faults)
    ending = f"; wrong: {', '.join(bad)}" if bad else ""
    return "\n".join([*lines, "", f"{noticed} of {len(faults)} faults noticed{ending}"])


def _healthy(bench: _Bench, ids: Sequence[str]) -> Outcome:
    """The server as it is: every check has to pass, in at least one dialect and without doubt."""
    name = " ".join(("healthy", bench.robot, *filter(None, [bench.dialect]), *bench.options))
    results, error = _judge((), bench, ids)
    if error:
        return Outcome(name, False, (("", "error", error),))
    lines, good = [], True
    for id, found in _by_check(ids, results):
        wrong = [one for one in found if one.verdict in (Verdict.FAIL, Verdict.INCONCLUSIVE)]
        passed = [one for one in found if one.verdict is Verdict.PASS]
        if wrong or not passed:
            good = False
            said = (wrong or found)[0].reason if found else "there is no such check"
            lines.append((id, (wrong or found)[0].verdict.value if found else "error", said))
    return Outcome(name, good, tuple(lines) or (("", "passes", f"{len(ids)} checks"),))


def _planted(fault: Fault) -> Outcome:
    bench = _Bench(fault.robot, fault.dialect, fault.options)
    results, error = _judge(fault.edits, bench, fault.notices)
    if error:
        return Outcome(fault.name, False, (("", "error", error),))
    lines, good = [], True
    for id, found in _by_check(fault.notices, results):
        failed = [one for one in found if one.verdict is Verdict.FAIL]
        named = [one for one in failed if re.search(fault.field, one.reason)]
        if named:
            lines.append((id, "noticed", named[0].reason))
        elif failed:
            lines.append((id, "UNNAMED", f"no {fault.field!r} in: {failed[0].reason}"))
        else:
            verdict = found[0].verdict.value if found else "there is no such check"
            lines.append((id, "MISSED", f"{verdict} {found[0].reason if found else ''}".strip()))
        good = good and bool(named)
    return Outcome(fault.name, good, tuple(lines))


def _by_check(ids: Sequence[str], results: Sequence[Result]) -> Iterator[tuple[str, list[Result]]]:
    for id in ids:
        yield id, [one for one in results if one.check == id]


def _judge(edits: Sequence[Edit], bench: _Bench, ids: Sequence[str]) -> tuple[list[Result], str]:
    """Verdicts of checks about a server with edits, or why there are none."""
    checks = [check for check in all_checks() if check.id in ids]
    options = ("--speed", "max", *bench.options)
    with tempfile.TemporaryDirectory(prefix="usarsim-planted-") as name:
        folder = Path(name) if edits else None
        try:
            if folder is not None:
                edited_copy(edits, folder)
            with OwnServer(*options, folder=folder) as server:
                target = Target(ports=dict(server.ports), robot=bench.robot, dialect=bench.dialect)
                report = asyncio.run(judge_all(target, checks, hangs=_HANGS, gives_up=_GIVES_UP))
                if server.died:
                    return [], f"the server died: {server.said}"
        except (PlantError, StartError, Failed) as error:
            return [], str(error)
    return list(report.results), ""
