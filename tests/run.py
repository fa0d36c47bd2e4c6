"""Run the tests on five workers, and what failed once more alone.

A few hundred tests drive a real browser or a real server by the wall clock. Five of them share two
processors here, and one in ten thousand misses a patience. What fails is therefore run a second
time with the machine to itself: a fault of the code fails again, and the exit status is that of the
second run. The names of what failed only beside others are printed.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

TOP = Path(__file__).resolve().parent.parent
WORKERS = ("-n", "5", "--dist", "loadfile")
# More failures than this are no mischance: a second run would only take time.
FEW = 12
FILE = re.compile(r"\.py(::|$)")
FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+\.py\S*)")


def pytest(*options: str) -> tuple[int, dict[str, str]]:
    """Run pytest with these options: its exit status, and the summary's line of each failed test.

    What pytest prints is passed on but for those lines, which are the caller's to tell.
    """
    command = [sys.executable, "-m", "pytest", *options]
    told = {}
    with subprocess.Popen(command, cwd=TOP, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        for line in running.stdout:
            if match := FAILED.match(line):
                told[match[1]] = line.rstrip()
            else:
                print(line, end="", flush=True)
    return running.returncode, told


def prepare() -> None:
    """Have pytest rewrite the assertions of all files, and keep that on disk, in two processes.

    Where nobody has done it yet, each of the workers would do it for itself.
    """
    if any(TOP.glob("tests/*/__pycache__/*-pytest-*.pyc")):
        return
    rooms = sorted(str(room) for room in (TOP / "tests").iterdir() if room.is_dir())
    command = [sys.executable, "-m", "pytest", "--collect-only", "-p", "no:cacheprovider"]
    both = [
        subprocess.Popen([*command, *part], cwd=TOP, stdout=subprocess.DEVNULL)
        for part in (rooms[::2], rooms[1::2])
    ]
    for one in both:
        one.wait()  # what cannot be collected is told by the workers


def main(options: list[str]) -> int:
    """Run the tests: pytest's exit status, by the second run where a few tests failed.

    ``options`` go to pytest as they are.
    """
    if not options:
        prepare()
    # Workers take seconds to begin, which one file is not worth.
    workers = () if any(FILE.search(option) for option in options) else WORKERS
    status, failed = pytest(*workers, *options)
    if status == 1 and 0 < len(failed) <= FEW:
        print(f"{len(failed)} failed beside others; once more, alone:", flush=True)
        status, still = pytest("--last-failed", *options)
        if once := sorted(failed.keys() - still.keys()):
            print("WARNING: failed beside others only:", *once, sep="\n  ")
        failed = still
    print(*failed.values(), sep="\n")
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
