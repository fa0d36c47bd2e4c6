"""How much each thread of a running server uses of the processors.

`python -m benchmarks.threads FILE serve ...` is `usarsim serve ...` that looks at
the processor time of its own threads four times a second. When it ends the file gets a JSON list of
looks (`Look`). Threads are known by the names that the house gives them; those that Python did not
start, such as the workers of a software renderer, and those that have ended count as `others`.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from usarsim_server.cli import main as usarsim

PERIOD = 0.25
"""s between two looks; each costs some tenths of a millisecond."""

_WATCHER = "watcher"
_ROLES = (
    ("physics", "physics"),
    ("robots", "reports"),
    ("robot-alone", "reports"),
    ("MainThread", "sockets"),
    ("cameras", "drawing"),
    ("image-encoder", "encoding"),
)
"""How the names of threads begin, and what they do."""


@dataclass(frozen=True, slots=True)
class Look:
    """What had been used at one moment."""

    moment: float  # s, `time.perf_counter`, which all processes of the machine share
    spent: Mapping[str, float]
    """Processor seconds since the start of the process by what they were spent on: physics,
    reports, sockets, drawing, encoding, others."""


def look() -> Look:
    """Look at this process (Linux only)."""
    spent = {role: 0.0 for _, role in _ROLES}
    own = 0.0
    for thread in threading.enumerate():
        seconds = _used_by(thread)
        if thread.name == _WATCHER:
            own += seconds
        elif (role := _role(thread.name)) is not None:
            spent[role] += seconds
    total = time.process_time()
    # The threads were read before the process, so the rest is never less than nothing.
    rest = max(0.0, total - own - sum(spent.values()))
    return Look(time.perf_counter(), {**spent, "others": rest})


def _role(name: str) -> str | None:
    return next((role for prefix, role in _ROLES if name.startswith(prefix)), None)


def _used_by(thread: threading.Thread) -> float:
    """Processor seconds of a thread; 0 if it has just ended."""
    try:
        # The first of the three numbers is the time spent on a processor, ns (proc(5)). Unlike
        # `time.pthread_getcpuclockid` this is safe for a thread that ends meanwhile.
        text = Path("/proc/self/task", str(thread.native_id), "schedstat").read_text()
    except OSError:
        return 0.0
    return 1e-9 * int(text.split()[0])


def main(arguments: Sequence[str]) -> int:
    """Run `usarsim` with all words but the first, the file to write; returns its exit code."""
    file, *rest = arguments
    looks: list[Look] = []
    finished = threading.Event()

    def watch() -> None:
        while not finished.wait(PERIOD):
            looks.append(look())

    watcher = threading.Thread(target=watch, name=_WATCHER, daemon=True)
    watcher.start()
    result = usarsim(rest)
    finished.set()
    watcher.join()
    Path(file).write_text(json.dumps([asdict(one) for one in looks]))
    return result


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
