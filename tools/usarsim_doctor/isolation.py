"""Trials in another process: what crashes there, or never ends, is one line here.

A processor that lacks an instruction, half a graphics driver or a broken wheel end a process
without any exception. So everything of that kind is done by a process that can be spared; if it
dies on one trial, another one goes on with the next. What that process runs is `trials`.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from usarsim_server.base import errors
from usarsim_server.base.launch import python
from usarsim_server.protocol.json_text import parse_json
from usarsim_server.settings import Settings

_WORKER = "usarsim_doctor.trials"
_PACKAGES = tuple(str(Path(file).resolve().parents[1]) for file in (errors.__file__, __file__))


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a trial ended."""

    values: Mapping[str, Any] = field(default_factory=dict)  # what it found out; empty if it failed
    failure: str | None = None  # why it failed, in one line; None if it did not
    told: bool = False  # the failure is an error meant for users, and no defect
    advice: str | None = None  # what such an error says about mending it
    missing: str | None = None  # it failed because this Python module is not installed


def attempt(
    names: Sequence[str], settings: Settings, timeout: float, worker: str = _WORKER
) -> dict[str, Outcome]:
    """Make trials, in order.

    Args:
        names: of the trials.
        settings: what they go by.
        timeout: s of wall time for each process that is needed.
        worker: module that is run.
    """
    outcomes: dict[str, Outcome] = {}
    while remaining := [name for name in names if name not in outcomes]:
        found, reason = _one_process(remaining, settings, timeout, worker)
        outcomes.update(found)
        if len(found) < len(remaining):
            outcomes[remaining[len(found)]] = Outcome(failure=reason)
    return outcomes


def _one_process(
    names: Sequence[str], settings: Settings, timeout: float, worker: str
) -> tuple[dict[str, Outcome], str]:
    """What a process got done, in order, and why it ended."""
    paths = [*_PACKAGES, os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    try:
        ended = subprocess.run(
            python("-m", worker),
            input=pickle.dumps((tuple(names), settings)),
            capture_output=True,
            timeout=timeout,
            env=environment,
            check=False,
        )
    except subprocess.TimeoutExpired as late:
        return _outcomes(names, late.stdout or b""), f"did not end within {timeout:g} s"
    except OSError as error:
        return {}, f"no process could be started: {error.strerror}"
    return _outcomes(names, ended.stdout), _reason(ended.returncode, ended.stderr)


def _outcomes(names: Sequence[str], written: bytes) -> dict[str, Outcome]:
    """Outcomes by trial; lines that libraries wrote among them are passed over."""
    found: dict[str, Outcome] = {}
    for line in written.decode(errors="replace").splitlines():
        with contextlib.suppress(ValueError, TypeError):
            entry = parse_json(line)
            if isinstance(entry, dict) and entry.get("trial") in names:
                name = entry.pop("trial")
                found[name] = Outcome(**entry)
    return found


def _reason(code: int, errors: bytes) -> str:
    if code < 0:
        try:
            return f"the process was ended by {signal.Signals(-code).name}"
        except ValueError:
            return f"the process was ended by signal {-code}"
    said = errors.decode(errors="replace").strip().splitlines()
    return said[-1] if said else f"the process ended with status {code}"
