"""Change the code of ten kernels in many small ways, and count the changes that their tests notice.

`make mutate` draws up to 100 mutants of each kernel and has them judged two at a time, each in a
copy of the checkout and by the tests of its kernel alone. It can be interrupted, and goes on where
it was; results are kept in `mutants/`. The exit status is 1 if a kernel's tests notice less than
85 % of the mutants that `survivors.toml` does not explain.
"""

from __future__ import annotations

import argparse
import ast
import os
import queue
import random
import shlex
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

TOP = Path(__file__).resolve().parents[1]
OUT = TOP / "mutants"
EXPLAINED = Path(__file__).with_name("survivors.toml")
MOST = 100
"""Mutants of a kernel."""
LEAST = 0.85
"""Part of them that its tests have to notice."""
PATIENCE = 10.0
"""A mutant is ended after so many times what the tests take without one: it runs for ever."""
AT_ONCE = 2
SAME = ("_Is_Eq", "_IsNot_NotEq", "_Eq_Is", "_NotEq_IsNot")
"""Ends of the names of changes that make no difference: None equals itself alone, and CPython keeps
one object for each small number and each word of the code."""

Place = tuple[int, int]
"""Line, from 1, and column, from 0."""


@dataclass(frozen=True, slots=True)
class Kernel:
    """Code that much rests on, and the tests that judge it; paths from the top of the checkout."""

    code: str
    tests: tuple[str, ...]


KERNELS = {
    "grammar": Kernel(
        "usarsim_server/protocol/grammar.py",
        ("tests/protocol/test_protocol_grammar.py", "tests/protocol/test_protocol_fuzz.py"),
    ),
    "framing": Kernel(
        "usarsim_server/protocol/wireless.py", ("tests/protocol/test_protocol_wireless.py",)
    ),
    "arbiter": Kernel(
        "tools/usarsim_operator/arbiter.py", ("tests/operator/test_operator_arbiter.py",)
    ),
    "referee": Kernel(
        "tools/usarsim_mission/referee.py",
        (
            "tests/mission/test_mission_scoring.py",
            "tests/mission/test_mission_credit.py",
            "tests/mission/test_mission_zones.py",
            "tests/mission/test_mission_fuzz.py",
        ),
    ),
    "scoring": Kernel(
        "tools/usarsim_mission/scoring.py",
        (
            "tests/mission/test_mission_scoring.py",
            "tests/mission/test_mission_credit.py",
            "tests/test_tables.py",
        ),
    ),
    "statistics": Kernel(
        "tools/usarsim_report/statistics.py",
        ("tests/study/test_study_statistics.py", "tests/study/test_study_verdict.py"),
    ),
    "exchange": Kernel(
        "tools/usarsim_exploration/exchange.py",
        ("tests/exploration/test_exploration_exchange.py",),
    ),
    "sensor": Kernel(
        "usarsim_server/sensors/sonar.py",
        (
            "tests/sensors/test_sensors_ranges.py",
            "tests/sensors/test_sensors_in_physics.py",
            "tests/test_tables.py",
        ),
    ),
    "radio": Kernel(
        "usarsim_server/radio/models.py",
        ("tests/radio/test_radio_models.py", "tests/test_tables.py"),
    ),
    "planning": Kernel(
        "tools/usarsim_operator/navigation.py", ("tests/operator/test_operator_policies.py",)
    ),
}


def idle_places(text: str) -> list[tuple[Place, Place]]:
    """Begin and end of what no change of makes a program do anything else: types, decorators,
    imports and docstrings."""
    idle: list[tuple[Place, Place]] = []

    def leave_out(node: ast.AST | None) -> None:
        if isinstance(node, ast.expr | ast.stmt):
            end = node.end_lineno or node.lineno, node.end_col_offset or node.col_offset
            idle.append(((node.lineno, node.col_offset), end))

    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                leave_out(node.returns)
            case ast.arg() | ast.AnnAssign():
                leave_out(node.annotation)
            case ast.Import() | ast.ImportFrom() | ast.Expr(value=ast.Constant(value=str())):
                leave_out(node)
            case ast.If(test=ast.Name(id="TYPE_CHECKING")):
                leave_out(node)
        for part in getattr(node, "decorator_list", ()):
            idle.append(((part.lineno, 0), (part.end_lineno + 1, 0)))
    return idle


def draw(name: str, items: Iterable[Any]) -> list[Any]:
    """The mutants of a kernel that are judged, of all that Cosmic Ray can make of its code."""
    idle = idle_places((TOP / KERNELS[name].code).read_text(encoding="utf-8"))

    def counts(item: Any) -> bool:
        change = item.mutations[0]
        place = tuple(change.start_pos)
        return not (
            change.operator_name.endswith(SAME) or any(begin <= place < end for begin, end in idle)
        )

    wanted = sorted(filter(counts, items), key=lambda one: str(one.mutations))
    return random.Random(name).sample(wanted, min(MOST, len(wanted)))


def tree_of(number: int) -> None:
    """Make a fresh copy of the checkout in which one worker changes code."""
    tree = OUT / f"tree{number}"
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=TOP,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    shutil.rmtree(tree, ignore_errors=True)
    for name in filter(None, listed.split("\0")):
        if (TOP / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(TOP / name, tree / name)


def judge(name: str, tree: Path) -> None:
    """Judge the mutants of a kernel that have not been judged, in a copy of the checkout."""
    from cosmic_ray.commands import init
    from cosmic_ray.mutating import mutate_and_test
    from cosmic_ray.work_db import WorkDB, use_db
    from cosmic_ray.work_item import WorkerOutcome, WorkResult

    kernel, store = KERNELS[name], OUT / f"{name}.sqlite"
    os.chdir(tree)
    os.environ["PYTHONPATH"] = os.pathsep.join((str(tree), str(tree / "tools")))
    # A compiled file is taken for fresh if it is of the same second and the same size.
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    words = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *kernel.tests]
    begun = time.monotonic()
    if subprocess.run(words, check=False, stdout=subprocess.DEVNULL).returncode:
        sys.exit(f"error: the tests of {name} fail without a mutant (cure: make test)")
    limit = 5.0 + PATIENCE * (time.monotonic() - begun)
    fresh = not store.exists()
    with use_db(str(store), WorkDB.Mode.create if fresh else WorkDB.Mode.open) as work:
        if fresh:
            init([Path(kernel.code)], work, {})
            drawn = draw(name, work.work_items)
            left = {one.job_id for one in work.work_items} - {one.job_id for one in drawn}
            work.set_multiple_results(left, WorkResult(worker_outcome=WorkerOutcome.SKIPPED))
        waiting = list(work.pending_work_items)
        for number, item in enumerate(waiting, 1):
            work.set_result(item.job_id, mutate_and_test(item.mutations, shlex.join(words), limit))
            print(f"{name}: {number} of {len(waiting)}", flush=True)


def run(names: Sequence[str]) -> None:
    """Judge what is left of some kernels, each in a process of its own."""
    trees: queue.SimpleQueue[int] = queue.SimpleQueue()
    for number in range(AT_ONCE):
        tree_of(number)
        trees.put(number)

    def work(name: str) -> None:
        number = trees.get()
        subprocess.run([sys.executable, __file__, "--worker", str(number), name], check=False)
        trees.put(number)

    with ThreadPoolExecutor(AT_ONCE) as pool:
        list(pool.map(work, names))


def changed(diff: str) -> tuple[str, str]:
    """The line before and after, of a mutant's diff."""
    lines = diff.splitlines()
    before = next(line[1:].strip() for line in lines if line[:1] == "-" and line[:3] != "---")
    after = next(line[1:].strip() for line in lines if line[:1] == "+" and line[:3] != "+++")
    return before, after


def outcomes(name: str) -> Iterator[tuple[bool, str]]:
    """Whether each judged mutant of a kernel was noticed, and its diff."""
    from cosmic_ray.work_db import WorkDB, use_db
    from cosmic_ray.work_item import WorkerOutcome

    with use_db(str(OUT / f"{name}.sqlite"), WorkDB.Mode.open) as work:
        for _, result in work.results:
            if result.worker_outcome is WorkerOutcome.NORMAL:
                yield result.is_killed, result.diff or ""


def report(names: Sequence[str]) -> bool:
    """Print what was noticed, and what was not; whether each kernel reaches its aim."""
    known = tomllib.loads(EXPLAINED.read_text(encoding="utf-8")) if EXPLAINED.exists() else {}
    enough = True
    for name in names:
        if not (OUT / f"{name}.sqlite").exists():
            continue
        reasons = {(one["line"], one["becomes"]): one["why"] for one in known.get(name, [])}
        judged = list(outcomes(name))
        survivors = [changed(diff) for noticed, diff in judged if not noticed]
        open_ones = [one for one in survivors if one not in reasons]
        killed = len(judged) - len(survivors)
        count = killed + len(open_ones)
        share = killed / count if count else 1.0
        enough = enough and share >= LEAST
        print(f"{name:12}{killed:4} of {count:3} noticed, {share:4.0%}; "
              f"{len(survivors) - len(open_ones)} explained")  # fmt: skip
        for before, after in open_ones:
            print(f"    {before}\n -> {after}")
    return enough


def main() -> int:
    """Judge what is left, two kernels at a time, and report."""
    parser = argparse.ArgumentParser(prog="make mutate ARGS=...", description=__doc__)
    parser.add_argument("kernels", nargs="*", metavar="KERNEL", help=", ".join(KERNELS))
    parser.add_argument("--report", action="store_true", help="only tell what was found so far")
    parser.add_argument("--worker", type=int, help=argparse.SUPPRESS)
    wishes = parser.parse_args()
    names = wishes.kernels or list(KERNELS)
    if strangers := [one for one in names if one not in KERNELS]:
        parser.error(f"there is no kernel {strangers[0]} (there are {', '.join(KERNELS)})")
    if wishes.worker is not None:
        judge(names[0], OUT / f"tree{wishes.worker}")
        return 0
    try:
        if not wishes.report:
            run(names)
    except KeyboardInterrupt:
        print("interrupted: the same command goes on where it was", file=sys.stderr)
        return 130
    return 0 if report(names) else 1


if __name__ == "__main__":
    sys.exit(main())
