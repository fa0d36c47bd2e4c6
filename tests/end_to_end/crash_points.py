"""Kills a program at every single step that it makes in the file system, or lets the step fail.

    python crash_points.py kill|full FOLDER FIRST STEP -- PROGRAM ARGUMENTS...

PROGRAM is `import` or `report`; see `PROGRAMS`. For every STEP-th point from FIRST on a copy of the
prepared folder is made, the program runs in it in a forked process, and that process is killed
before its n-th step, or its n-th step finds the disk full. Steps are what Python tells its audit
hooks about (PEP 578): files opened for writing, folders made, names changed and removed. The end of
each copy is judged by the test, which only looks at files.
"""

from __future__ import annotations

import errno
import os
import shutil
import signal
import sys
from collections.abc import Callable
from pathlib import Path

STEPS = {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.truncate", "os.chmod"}
NO_LIMIT = 10_000


def run_import(folder: Path) -> int:
    """`usarsim import` of the folder's map into the folder."""
    from usarsim_server.cli import main

    return main(["import", str(folder / "Room.t3d"), "--out", str(folder / "out"), "--fresh"])


def run_report(folder: Path) -> int:
    """Replace a report."""
    from usarsim_server.base.files import write_text

    write_text(folder / "report.json", "new " * 1000)
    return 0


PROGRAMS: dict[str, Callable[[Path], int]] = {"import": run_import, "report": run_report}


def main(how: str, given: Path, first: int, step: int, program: str) -> int:
    """Go through the points; prints `POINT CODE` for each, code -9 for one that was killed."""
    run = PROGRAMS[program]
    # Whatever is imported, and read for that, is imported before anybody counts.
    warm = given.with_name("warm")
    shutil.copytree(given, warm)
    os.environ["XDG_CACHE_HOME"] = str(warm / "cache")
    assert run(warm) == 0
    point = first
    while point < NO_LIMIT:
        place = given.with_name(f"{how}-{point}")
        shutil.copytree(given, place, symlinks=True)
        sys.stdout.flush()
        child = os.fork()
        if not child:
            os.environ["XDG_CACHE_HOME"] = str(place / "cache")
            counted = install(how, place, point)
            code = run(place)
            os._exit(3 if counted[0] < point else code)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        print(f"POINT {point} {code}", flush=True)
        if code == 3:  # it ended before it came so far
            return 0
        point += step
    return 1


def install(how: str, place: Path, point: int) -> list[int]:
    """Count steps below a folder from now on; the count is the first element."""
    counted = [0]
    below = str(place)

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open":
            path, _, flags = arguments
            if not isinstance(flags, int) or not flags & (os.O_WRONLY | os.O_RDWR):
                return
        elif event in STEPS:
            path = arguments[0]
        else:
            return
        if isinstance(path, bytes | str | os.PathLike) and not os.fsdecode(path).startswith(below):
            return
        counted[0] += 1
        if counted[0] != point:
            return
        if how == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    sys.addaudithook(hook)
    return counted


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), sys.argv[5]))
