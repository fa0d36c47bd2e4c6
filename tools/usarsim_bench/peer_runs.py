"""Runs a workload in a process of its own and reads what came of it."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from usarsim_bench.errors import BenchError

_SHOWN_ERRORS = 300
_FOREIGN = ("PYTHONPATH", "PYTHONHOME", "PYTHONSTARTUP")


@dataclass(frozen=True, slots=True)
class Outcome:
    """One run of the work.

    Attributes:
        version: of the simulator.
        simulated: s of simulated time measured.
        wall: s of wall time that they took.
        cpu: s of processor time that they took.
        counts: what was done meanwhile, by name.
    """

    version: str
    simulated: float
    wall: float
    cpu: float
    counts: Mapping[str, float]

    @property
    def factor(self) -> float:
        """Simulated s per s of wall time."""
        return ratio(self.simulated, self.wall)

    @property
    def cost(self) -> float:
        """Processor s per simulated s."""
        return ratio(self.cpu, self.simulated)

    def per_second(self, name: str) -> float:
        """A count per simulated s; not a number if it was not counted."""
        return ratio(self.counts.get(name, math.nan), self.simulated)


def ratio(one: float, other: float) -> float:
    """A quotient; not a number where there is none."""
    return one / other if other else math.nan


def read_outcome(text: str) -> Outcome:
    """What a workload wrote.

    Raises:
        BenchError: if it is not what a workload should write.
    """
    try:
        found = json.loads(text)
        outcome = Outcome(
            version=str(found["version"]),
            simulated=float(found["simulated"]),
            wall=float(found["wall"]),
            cpu=float(found["cpu"]),
            counts={str(name): float(value) for name, value in found["counts"].items()},
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise BenchError(f"its result is not to be understood: {error!r}") from None
    numbers = (outcome.simulated, outcome.wall, outcome.cpu)
    if not all(math.isfinite(number) for number in numbers) or min(numbers[:2]) <= 0.0:
        raise BenchError(f"its result has impossible times: {', '.join(map(str, numbers))}")
    return outcome


def run_workload(
    command: Sequence[str],
    work: str,
    timeout: float,
    after: Sequence[str] = (),
    foreign: bool = True,
) -> Outcome:
    """Run a program with the work's file and the result's file as arguments.

    Whatever it started is ended with it.

    Args:
        command: program and first arguments.
        work: text of the work's file.
        timeout: s of wall time after which it is killed.
        after: arguments behind the two files.
        foreign: keep our Python paths from it.

    Raises:
        BenchError: if it fails, takes too long or writes no result; with what it said last.
    """
    with tempfile.TemporaryDirectory(prefix="usarsim-peers-") as name:
        given, result = Path(name, "work.json"), Path(name, "result.json")
        given.write_text(work, encoding="utf-8")
        line = [*command, str(given), str(result), *after]
        hidden = _FOREIGN if foreign else ()
        environment = {key: value for key, value in os.environ.items() if key not in hidden}
        code, said = _run(line, timeout, environment, name if foreign else None)
        if code != 0:
            raise BenchError(f"it ended with code {code}: {said}")
        try:
            return read_outcome(result.read_text(encoding="utf-8"))
        except OSError:
            raise BenchError(f"it wrote no result: {said}") from None


def _run(
    line: Sequence[str], timeout: float, environment: Mapping[str, str], folder: str | None
) -> tuple[int, str]:
    try:
        process = subprocess.Popen(
            line,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,
        )
    except OSError as error:
        raise BenchError(f"it cannot be started: {error.strerror}") from None
    with process:
        try:
            _, errors = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            raise BenchError(f"it took more than {timeout:g} s") from None
        finally:
            # A workload may have processes of its own; the session's leader may be gone already.
            _kill_group(process.pid)
    return process.returncode, _last_words(errors)


def _kill_group(group: int) -> None:
    """Kill what is left of a process group that we started."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(group, signal.SIGKILL)


def _last_words(errors: str) -> str:
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    return lines[-1][-_SHOWN_ERRORS:] if lines else "it said nothing"
