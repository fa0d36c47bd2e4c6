"""Run the tests on five workers; what is named by files runs in this process alone."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

TOP = Path(__file__).resolve().parent.parent
WORKERS = ("-n", "5", "--dist", "loadfile")
FILE = re.compile(r"\.py(::|$)")


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
    """Run the tests; the exit status is that of pytest, to which `options` go as they are."""
    if not options:
        prepare()
    # Workers take seconds to begin, which one file is not worth.
    workers = () if any(FILE.search(option) for option in options) else WORKERS
    command = [sys.executable, "-m", "pytest", *workers, *options]
    return subprocess.run(command, cwd=TOP, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
