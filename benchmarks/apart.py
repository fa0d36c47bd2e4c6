"""Measures in a process that does nothing else, and asks a server for the classes that it knows."""

from __future__ import annotations

import functools
import pickle
import subprocess
from collections.abc import Callable
from typing import TypeVar

from usarsim_bench.figures import BenchError
from usarsim_server.base.launch import python

_SHOWN_ERRORS = 2000
Found = TypeVar("Found")
_APART = (
    "import pickle, sys; measure, given = pickle.load(sys.stdin.buffer); "
    "sys.stdout.buffer.write(pickle.dumps(measure(*given)))"
)


def run_apart(
    measure: Callable[..., Found], *arguments: object, patience: float | None = None
) -> Found:
    """What a function returns in a process of its own, which does nothing else.

    Args:
        measure: found by the name of its module; what it gets and returns is pickled.
        arguments: of it.
        patience: s after which it is given up.

    Raises:
        BenchError: if it fails, with what it said, or takes too long.
    """
    name, given = measure.__module__, pickle.dumps((measure, arguments))
    command = python("-c", _APART)
    try:
        done = subprocess.run(
            command, input=given, capture_output=True, check=False, timeout=patience
        )
    except subprocess.TimeoutExpired:
        raise BenchError(f"{name} took more than {patience:g} s") from None
    if done.returncode != 0:
        said = done.stderr.decode(errors="replace")[-_SHOWN_ERRORS:].strip()
        raise BenchError(f"{name} failed: {said}")
    found: Found = pickle.loads(done.stdout)
    return found


@functools.cache
def all_classes() -> tuple[str, ...]:
    """Every class of robots that a server knows; asked for once in this process.

    Raises:
        BenchError: if it does not tell.
    """
    command = python("-m", "usarsim_server", "robots")
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    names = tuple(line.split()[0] for line in told.stdout.splitlines()[1:] if line.strip())
    if told.returncode or not names:
        raise BenchError(f"the classes are not told: {told.stderr.strip()[-500:]}")
    return names
