"""Closes a run that ended by itself: its program was killed, the machine lost its power.

Its logs are then whole up to some place. What stands behind it, half a line or records whose
predecessors were never written, is moved to a file of its own; the log ends with a reason.
"""

from __future__ import annotations

import contextlib
import fcntl
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from usarsim_mission.errors import RunLogError
from usarsim_mission.live import LiveRun
from usarsim_mission.records import DERIVED, Record
from usarsim_mission.referee import Referee
from usarsim_mission.runlog import EVENTS, RESERVED, TRUTH, RunFolder, RunWriter
from usarsim_server.base.errors import at
from usarsim_server.base.files import reason
from usarsim_server.protocol.json_text import parse_json

CUT = "cut.jsonl"
"""What was cut off the logs."""


def close_run(folder: Path, text: str = "the run was cut off") -> dict[str, Any]:
    """Close a run; one that is whole only gets what follows from its logs anew.

    Args:
        folder: of the run. text: why it ended, if its log does not tell.

    Returns:
        What `score.json` tells.

    Raises:
        MissionError: it is being written, cannot be read, or has no whole record.
    """
    last = mend(folder)
    run = RunFolder(folder)
    mission, world = run.world()
    referee, due = Referee(mission, run.rules(), world), list[Record]()
    for record in run.records():
        if record["kind"] not in DERIVED:
            due = referee.feed(record) if record["kind"] != "error" else due
        elif due:
            del due[0]
    live = LiveRun(RunWriter.reopen(folder, last), referee)
    for record in due:  # what follows from the last record, and was not written any more
        live.log.write(record)
    if referee.over is None:
        time = last["t_sim"]
        live.tell("error", time, text=text)
        live.tell("trial_end", time, why="aborted", text=text)
    return live.close()


def mend(folder: Path) -> Record:
    """Cut the logs of a run back to where they are whole.

    Returns:
        The last record.

    Raises:
        RunLogError: they are being written, or there is none.
    """
    run, last = RunFolder(folder), None
    for due, record in enumerate(run.records()):
        if record["seq"] != due:
            break
        last = record
    if last is None:
        raise RunLogError(at(folder, "has no whole record", "remove it, and run it again"))
    with contextlib.ExitStack() as stack:
        files = [stack.enter_context(_held(folder / name)) for name in (EVENTS, TRUTH)]
        rests = [_rest(file, last["seq"]) for file in files]
        if rest := b"\n".join(rest.rstrip(b"\n") for rest in rests if rest):
            with (folder / CUT).open("ab") as cut:
                cut.write(rest + b"\n")
        for file, part in zip(files, rests, strict=True):
            file.seek(-len(part), 2)
            file.truncate()
    with contextlib.suppress(OSError):
        (folder / RESERVED).unlink()
    return last


@contextlib.contextmanager
def _held(path: Path) -> Iterator[BinaryIO]:
    """A log, which nobody else writes meanwhile."""
    try:
        with path.open("r+b") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield file
    except BlockingIOError as error:
        raise RunLogError(at(path, "is being written", "wait for the end of the run")) from error
    except OSError as error:
        problem = f"cannot be mended: {reason(error)}"
        raise RunLogError(at(path, problem, "make room on the disk, check its rights")) from error


def _rest(file: BinaryIO, last: int) -> bytes:
    """What stands behind the last record that is kept."""
    for line in file:
        if not line.endswith(b"\n") or parse_json(line)["seq"] > last:
            return line + file.read()
    return b""
