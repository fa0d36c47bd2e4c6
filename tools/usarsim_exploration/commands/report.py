"""`usarsim explore report`: one HTML file that tells what runs found."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "DIR is the folder of a run (`explore run --out`) or of a batch (`explore bench`). The report "
    "compares strategies in each setting (environment, robots, radio): curves, times of goals with "
    "runs that did not reach them as censored, ranks. The same folders give the same bytes."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `report`."""
    text = "write report.html, report.md, table.csv, runs.csv and table.tex of runs"
    parser = add_command(subparsers, "report", text, run, epilog=_EPILOG)
    parser.add_argument("folders", metavar="DIR", nargs="+", type=Path, help="folder of results")
    parser.add_argument(
        "--out", metavar="DIR", required=True, type=Path, help="folder of the report"
    )


def run(arguments: argparse.Namespace) -> int:
    """Read, compare, draw, write.

    Raises:
        UsarsimError: results are missing or damaged, or what judges them is not installed.
    """
    from usarsim_server.extras import need

    need("scipy", "matplotlib", extra="exploration", asker="the report")
    from usarsim_exploration import run_folder
    from usarsim_exploration.errors import ExplorationError
    from usarsim_exploration.reporting import report
    from usarsim_exploration.reporting.runs import read
    from usarsim_server.errors import at
    from usarsim_server.files import reason

    sources = read(arguments.folders)
    run_folder.prepare(arguments.out)
    told = sys.stderr.isatty()

    def progress(text: str) -> None:
        if told:
            print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)

    try:
        written = report.write(sources, arguments.out, progress)
    except OSError as error:
        cure = "give a folder that can be written to"
        problem = f"cannot be written: {reason(error)}"
        raise ExplorationError(at(error.filename or arguments.out, problem, cure)) from error
    finally:
        progress("")
    for path in written:
        print(path)
    return 0
