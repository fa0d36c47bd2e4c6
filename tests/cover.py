"""Measure which lines and branches of each package `make test` reaches, against `coverage.toml`.

`make coverage` runs the fast lane (or what ARGS name) and prints a table. Of the whole lane each
package has to reach the percentage that is written in `coverage.toml`; otherwise the exit status is
1. `--write` writes the percentages measured, less one point.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
GATE = Path(__file__).with_name("coverage.toml")
HEAD = """\
# Percent of lines and branches that `make test` reaches at least, by package: one point below
# what was measured when `make coverage ARGS=--write` wrote this file.
"""


def package(file: str) -> str:
    """The package that a file of the product lies in: a tool, or a room of the server."""
    parts = Path(file).parts
    if parts[0] == "tools":
        return parts[1]
    return ".".join(parts[:2]) if len(parts) > 2 else parts[0]


def measured(options: list[str]) -> tuple[dict[str, float], int]:
    """Percent by package, and the exit status of the tests. options: of pytest."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "coverage.json"
        sources = ("--cov=usarsim_server", "--cov=tools", "--cov-branch")
        reports = (f"--cov-report=json:{file}", "--cov-report=")
        command = [sys.executable, str(TOP / "tests" / "run.py"), *sources, *reports, *options]
        status = subprocess.run(command, cwd=TOP, check=False).returncode
        files = json.loads(file.read_text())["files"]
    all_of, reached = Counter[str](), Counter[str]()
    for name, one in files.items():
        totals = one["summary"]
        all_of[package(name)] += totals["num_statements"] + totals["num_branches"]
        reached[package(name)] += totals["covered_lines"] + totals["covered_branches"]
    return {name: 100.0 * reached[name] / count for name, count in all_of.items() if count}, status


def main(options: list[str]) -> int:
    """Measure, print, and judge or write."""
    write = "--write" in options
    named = [one for one in options if one != "--write"]
    found, status = measured(named)
    least = tomllib.loads(GATE.read_text()) if GATE.exists() else {}
    wrong = []
    for name, share in sorted(found.items()):
        limit = least.get(name, 0.0)
        low = not named and share < limit
        wrong += [name] if low else []
        print(f"{name:32}{share:6.1f} %" + (f"  BELOW {limit:g} %" if low else ""))
    if write and not status and not named:
        lines = [f'"{name}" = {math.floor(share) - 1}\n' for name, share in sorted(found.items())]
        GATE.write_text(HEAD + "".join(lines))
        return 0
    return status or int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
