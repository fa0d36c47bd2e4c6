"""Run the tests on some workers; what is named by files runs in this process alone."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

TOP = Path(__file__).resolve().parent.parent
WORKERS = ("-n", "5", "--dist", "worksteal")
"""More than the two cores that the suite is made for: many tests wait for a server or a browser."""
KERNELS = "tests/exploration/test_exploration_kernels.py"
FILE = re.compile(r"\.py(::|$)")


def prepare() -> list[subprocess.Popen[bytes]]:
    """Do once what each worker of a fresh checkout would do for itself, and keep it on disk.

    pytest rewrites the assertions of all files; numba compiles the kernels of explorations, which
    goes on beside the first tests.

    Returns:
        What goes on.
    """
    if any(TOP.glob("tests/*/__pycache__/*-pytest-*.pyc")):
        return []
    rooms = sorted(str(room) for room in (TOP / "tests").iterdir() if room.is_dir())
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider"]
    begun = [
        subprocess.Popen([*command, *part], cwd=TOP, stdout=subprocess.DEVNULL)
        for part in (
            ["--collect-only", *rooms[::2]],
            ["--collect-only", *rooms[1::2]],
            [KERNELS],
        )
    ]
    for one in begun[:2]:
        one.wait()  # what is wrong is told by the workers
    return begun[2:]


def main(options: list[str]) -> int:
    """Run the tests; the exit status is that of pytest, to which `options` go as they are."""
    beside = [] if options else prepare()
    # Workers take seconds to begin, which one file is not worth.
    workers = () if any(FILE.search(option) for option in options) else WORKERS
    command = [sys.executable, "-m", "pytest", *workers, *options]
    status = subprocess.run(command, cwd=TOP, check=False).returncode
    for one in beside:
        one.wait()
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
