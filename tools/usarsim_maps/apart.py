"""Runs a library that may crash, or never end, on damaged files in a process of its own."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

from usarsim_server.base.errors import MapImportError, at

PATIENCE, SPEED = 30.0, 2e6
"""s to start a library, and bytes per second that it reads even on a busy machine."""


def patience(size: int) -> float:
    """s that a library may take for a file of this many bytes."""
    return PATIENCE + size / SPEED


def run_apart(
    command: Sequence[str],
    source: Path,
    library: str,
    cure: str,
    size: int,
    *,
    given: bytes | None = None,
    answer: IO[bytes] | None = None,
) -> subprocess.CompletedProcess[bytes]:
    """Run a program that reads a file with a library, to its end.

    Args:
        command: of the program.
        source: the file, for errors.
        library: its name, for errors.
        cure: what helps where the library fails.
        size: bytes of the file; the program gets time for them.
        given: to its standard input; None: nothing.
        answer: takes its standard output; None: the result holds it.

    Raises:
        MapImportError: it crashed, or took too long.
    """
    seconds = patience(size)
    streams: dict[str, Any] = {"stdout": subprocess.PIPE if answer is None else answer}
    streams |= {"stdin": subprocess.DEVNULL} if given is None else {"input": given}
    try:
        done = subprocess.run(
            command, timeout=seconds, check=False, stderr=subprocess.PIPE, **streams
        )
    except subprocess.TimeoutExpired:
        problem = f"the {library} library has not read it within {seconds:.0f} s"
        raise MapImportError(at(source, problem, cure)) from None
    if done.returncode < 0:
        try:
            name = signal.Signals(-done.returncode).name
        except ValueError:
            name = f"signal {-done.returncode}"
        raise MapImportError(at(source, f"the {library} library crashes on it ({name})", cure))
    return done
