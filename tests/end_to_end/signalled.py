"""A program that gets a signal some time after it took over its signals; also a command line:

    python tests/end_to_end/signalled.py 40 3.0 SIGINT serve --world arena

sends SIGINT at 40 moments of the first 3 s and prints how long each end took.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from usarsim_server.testing import PATIENCE

HANG = PATIENCE
"""s of wall time after which a program that does not end is killed."""


def finished(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run `usarsim` to its end, and take down what it says."""
    command = [sys.executable, "-m", "usarsim_server", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=HANG, check=False)


@dataclass(frozen=True)
class Ending:
    """How a program ended.

    Attributes:
        delay: s from the moment it took over its signals until it got one.
        code: its exit code. early: it ended before it got the signal.
        seconds: wall time from the signal to the end.
        output: standard output. errors: standard error.
    """

    delay: float
    code: int
    early: bool
    seconds: float
    output: str
    errors: str


def signalled(
    arguments: Sequence[str],
    delay: float,
    number: signal.Signals = signal.SIGINT,
    times: int = 1,
    group: bool = False,
) -> Ending:
    """Run `usarsim` and send it a signal.

    Args:
        arguments: of the command line.
        delay: s after it has taken over its signals.
        number: the signal.
        times: signals, a tenth of a second apart.
        group: the signal goes to its child processes, too, as that of a terminal does.
    """
    command = [sys.executable, "-m", "usarsim_server", *arguments]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    _await_handlers(process)
    try:
        process.wait(delay)
        early = True
    except subprocess.TimeoutExpired:
        early = False
    began = time.monotonic()
    for _ in range(0 if early else times):
        (os.killpg if group else os.kill)(process.pid, number)
        if times > 1:
            time.sleep(0.1)
    try:
        output, errors = process.communicate(timeout=HANG)
    finally:
        process.kill()
    return Ending(delay, process.returncode, early, time.monotonic() - began, output, errors)


def _await_handlers(process: subprocess.Popen[str]) -> None:
    """Wait until SIGTERM is caught; until then Python itself has not begun with our code."""
    deadline = time.monotonic() + HANG
    while process.poll() is None and time.monotonic() < deadline:
        status = Path(f"/proc/{process.pid}/status").read_text()
        caught = next(line for line in status.splitlines() if line.startswith("SigCgt"))
        if int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1:
            return
        time.sleep(0.001)


def main(moments: int, seconds: float, number: str, arguments: list[str]) -> int:
    """Send the signal at so many moments of so many s; 1 if an end was late or not quiet."""
    group = os.environ.get("GROUP") == "1"
    bad, worst = 0, 0.0
    for step in range(moments):
        delay = seconds * step / max(1, moments - 1)
        one = signalled(arguments, delay, signal.Signals[number], group=group)
        worst = max(worst, 0.0 if one.early else one.seconds)
        expected = 0 if arguments[0] in ("serve", "record") else 128 + signal.Signals[number]
        wrong = not one.early and (one.code != expected or "Traceback" in one.errors)
        if wrong or one.seconds > 3.0:
            bad += 1
            print(one)
    print(f"{bad} of {moments} bad, slowest end {worst:.2f} s", *arguments)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), float(sys.argv[2]), sys.argv[3], sys.argv[4:]))
