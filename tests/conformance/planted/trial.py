"""Plants faults in copies of the server, links to everything else, judges the servers that have
them, and says what was noticed."""

from __future__ import annotations

import ast
import asyncio
import importlib.util
import multiprocessing
import os
import re
import shutil
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from planted.faults import Edit, Fault
from usarsim_conformance.own_server import judged_server
from usarsim_conformance.registry import Failed, Result, Verdict, all_checks
from usarsim_conformance.runner import judge_all
from usarsim_conformance.survey import Target
from usarsim_server.base.launch import LaunchError, safe_pool

_DATA = "usarsim_server/base/files.py"
"""Finds robots and worlds from where it lies, so it is copied and not linked."""


class PlantError(Exception):
    """A fault that cannot be planted: its text is not there, or nothing changes."""


def _origin(file: str) -> Path:
    """Where a file, or folder, of the server really is."""
    first, _, rest = file.partition("/")
    found = importlib.util.find_spec("usarsim_server")
    assert found is not None
    assert found.origin is not None
    package = Path(found.origin).parent
    if first == "usarsim_server":
        return package / rest
    if first in ("robots", "worlds"):
        # A wheel carries them inside the package; in a source tree they lie beside it.
        packaged = package / "_data" / first
        return (packaged if packaged.is_dir() else package.parent / first) / rest
    raise PlantError(f"{file}: neither in usarsim_server nor in robots nor in worlds")


def edited(edits: Iterable[Edit]) -> dict[str, str]:
    """Text of every edited file, by path.

    Raises:
        PlantError: if a text to replace does not stand exactly once, or the file means the same
            afterwards.
    """
    texts: dict[str, str] = {}
    for edit in edits:
        path = _origin(edit.file)
        if not path.is_file():
            raise PlantError(f"{edit.file} does not exist")
        before = texts.get(edit.file) or path.read_text(encoding="utf-8")
        count = before.count(edit.old)
        if count != 1:
            raise PlantError(f"{edit.file}: {edit.old!r} stands there {count} times, not once")
        after = before.replace(edit.old, edit.new)
        if _meaning(edit.file, before) == _meaning(edit.file, after):
            raise PlantError(f"{edit.file}: {edit.new!r} changes nothing")
        texts[edit.file] = after
    return texts


def edited_copy(edits: Iterable[Edit], folder: Path) -> None:
    """Lay out the server in a folder, with edits; `folder` then belongs on PYTHONPATH.

    Raises:
        PlantError: see `edited`.
    """
    texts = edited(edits)
    texts.setdefault(_DATA, _origin(_DATA).read_text(encoding="utf-8"))
    for top in ("usarsim_server", "robots", "worlds"):
        _lay_out(top, folder, texts)


def _lay_out(path: str, folder: Path, texts: dict[str, str]) -> None:
    target = folder / path
    if path in texts:
        target.write_text(texts[path], encoding="utf-8")
        return
    origin = _origin(path)
    if origin.is_dir() and any(file.startswith(path + "/") for file in texts):
        target.mkdir()
        for entry in origin.iterdir():
            if entry.name not in ("__pycache__", "_data"):
                _lay_out(f"{path}/{entry.name}", folder, texts)
        return
    if origin.is_file() and path.startswith("robots/") and origin.suffix != ".toml":
        # A robot file may name a body only beside it, and links do not count.
        shutil.copyfile(origin, target)
        return
    target.symlink_to(origin)


def _meaning(file: str, text: str) -> object:
    try:
        if file.endswith(".py"):
            return ast.dump(ast.parse(text))
        if file.endswith(".toml"):
            return tomllib.loads(text)
    except (SyntaxError, tomllib.TOMLDecodeError) as error:
        raise PlantError(f"{file}: cannot be read after the edit: {error}") from None
    return text


_HANGS = 20.0
"""s of wall time without news of simulated time; planted faults stop no clock."""
_GIVES_UP = 240.0
"""s of wall time after which a check counts as hanging."""
_WIDTH = 200
"""Characters of a message that the table shows."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a fault, or of the server without one."""

    name: str  # of the fault; `healthy CLASS` for the server as it is
    good: bool  # whether all checks noticed it and named the field; healthy: whether all passed
    lines: tuple[tuple[str, str, str], ...]  # check, verdict and message, one for each check


_Bench = tuple[str, str | None]
"""What several faults need alike: class of the robot, and dialect."""


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
        benches.setdefault((fault.robot, fault.dialect), set()).update(fault.notices)
    context = multiprocessing.get_context("spawn")
    with safe_pool(), ProcessPoolExecutor(jobs or os.cpu_count() or 1, mp_context=context) as pool:
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
    name = " ".join(("healthy", *filter(None, bench)))
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
    results, error = _judge(fault.edits, (fault.robot, fault.dialect), fault.notices)
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
    robot, dialect = bench
    checks = [check for check in all_checks() if check.id in ids]
    with tempfile.TemporaryDirectory(prefix="usarsim-planted-") as name:
        folder = Path(name) if edits else None
        try:
            if folder is not None:
                edited_copy(edits, folder)
            with judged_server("--speed", "max", folder=folder) as server:
                target = Target(ports=dict(server.ports), robot=robot, dialect=dialect)
                report = asyncio.run(judge_all(target, checks, hangs=_HANGS, gives_up=_GIVES_UP))
                if server.died:
                    return [], f"the server died: {server.said}"
        except (PlantError, LaunchError, Failed) as error:
            return [], str(error)
    return list(report.results), ""
